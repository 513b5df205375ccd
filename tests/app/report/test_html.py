"""The HTML report: one file that asks for nothing, in which user text is only ever text."""

import base64
import csv
import hashlib
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from typing import Any

import openpyxl
import pytest
from pypdf import PdfReader

from acromion.app.report.export.results import build_results
from acromion.app.report.export.tables import FRENCH_EXCEL, INTERNATIONAL, describe_tables, encode_rows
from acromion.app.report.export.xlsx import encode_workbook
from acromion.app.report.findings import Findings
from acromion.app.report.model import format_brief
from acromion.app.report.render.html import content_security_policy, render_html
from acromion.app.report.render.pdf import render_pdf, replace_uncovered
from acromion.app.report.single.report import Report, build_report
from acromion.app.report.words.wording import LANGUAGES, Language
from acromion.app.request import Conclusion
from acromion.fusion.exposure.types import PartExposure
from acromion.fusion.quality import Quality
from acromion.fusion.recording import QualityFlag, Span
from tests.app.analysis_factory import make_analysis, make_exposure, make_subject
from tests.app.payloads import FAMILIES, PAYLOADS


class Elements(HTMLParser):
    """Counts elements and attributes as a browser would see them."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def read(html: bytes) -> Elements:
    elements = Elements()
    elements.feed(html.decode("utf-8"))
    return elements


@cache
def page(language: Language = "en", subject: str = "S012", file_name: str = "a.gt3x") -> bytes:
    return render_html(build_report(make_analysis(), make_subject(subject, file_name), language))


def test_nothing_is_loaded_from_anywhere() -> None:
    loading = {"src", "href", "srcset", "data", "action", "poster", "xlink:href", "background"}

    found = read(page())

    assert [value for name, value in found.attributes if name in loading] == ["#answer"]
    assert not {"script", "iframe", "object", "embed", "link", "form"} & set(found.tags)
    assert not re.search(rb"url\((?!#)|@import", page())
    assert "style" not in {name for name, _ in found.attributes}  # which the policy would block


def test_the_policy_forbids_everything_but_the_style() -> None:
    style = re.search(rb"<style>(.*?)</style>", page(), re.DOTALL)
    assert style is not None
    digest = base64.b64encode(hashlib.sha256(style[1]).digest()).decode()

    assert content_security_policy() == (
        f"default-src 'none'; style-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_page_declares_its_language_and_is_light(language: Language) -> None:
    assert f'<html lang="{language}">'.encode() in page(language)
    assert len(page(language)) <= 400_000


def test_no_id_appears_twice_and_every_header_cell_has_a_scope() -> None:
    ids = [value for name, value in read(page()).attributes if name == "id"]

    assert len(ids) == len(set(ids))
    assert re.findall(r"<th(?! scope=)[ >]", page().decode()) == []


def test_every_chart_has_a_title_a_description_and_a_table() -> None:
    tags = read(page()).tags

    tiles, how_sure = 4, 1
    drawn_once = tiles + how_sure
    assert tags.count("figure") * 2 + drawn_once == tags.count("svg") == tags.count("desc")
    assert tags.count("figure") == tags.count("details")


# Whatever a person writes is only ever text: in the HTML, the drawings, the PDF, every table.


RESULTS: dict[str, Any] = build_results(make_analysis(), make_subject())
SHARES = ({10: 1.0, 50: 2.0, 90: 3.0}, {30: 1.0, 60: 1.0, 90: 1.0}, None)


Reports = tuple[Report, Report, Sequence[str]]


def analysis_with(texts: Sequence[str]) -> Findings:
    """Put texts wherever a file or a person could: labels, reasons, zone, facts, unknown codes and kinds."""
    tasks = (
        PartExposure(text, 60.0 * k, 60.0 * k + 60, 60.0, *SHARES, kind="task", recorded_s=60.0)
        for k, text in enumerate(texts)
    )
    breaks = (
        PartExposure("", 9e3 + k, 9e3 + k + 1, 0.0, {}, {}, None, kind=text, recorded_s=1.0, reason=text)
        for k, text in enumerate(texts)
    )
    flags = tuple(
        flag
        for text in texts
        for flag in (QualityFlag("W-ROWS-DROPPED", 1, facts={"why": text}), QualityFlag(text, 1))
    )
    analysis = make_analysis(exposure=replace(make_exposure(), by_period=(*tasks, *breaks)))
    spans = tuple(Span(400_000_000 * k, 300_000_000, text) for k, text in enumerate(texts))
    return replace(
        analysis,
        recording=replace(analysis.recording, time_zone=texts[0], serial_hash=texts[0]),
        exclusions=(*analysis.exclusions, *spans),
        quality=Quality("caution", (texts[0],), flags),
    )


def report_with(texts: Sequence[str], language: Language = "en") -> Report:
    said = Conclusion(texts[0], texts[0], "2026-11-23")
    subject = replace(make_subject(texts[0], texts[0]), conclusion=said)
    return build_report(analysis_with(texts), subject, language)


def squeeze(text: str) -> str:
    return re.sub(r"\s", "", text)


@pytest.fixture(scope="module", params=FAMILIES)
def reports(request: pytest.FixtureRequest) -> Reports:
    """A report with the payloads of a family, one with harmless texts of the same lengths, the payloads."""
    texts = FAMILIES[request.param]
    harmless = [f"{k:02d}".ljust(len(text), "x")[: len(text)] for k, text in enumerate(texts)]
    return report_with(texts), report_with(harmless), texts


def test_the_page_has_no_other_element_and_attribute_and_shows_each_text_as_it_is(reports: Reports) -> None:
    hostile, clean = (read(render_html(report)) for report in reports[:2])
    words = " ".join(hostile.words)

    assert hostile.tags == clean.tags
    assert [name for name, _ in hostile.attributes] == [name for name, _ in clean.attributes]
    assert [text for text in reports[2] if text.strip() not in words] == []


def test_every_drawing_stays_well_formed_with_the_same_elements(reports: Reports) -> None:
    hostile, clean = (
        [
            [element.tag for element in ET.fromstring(svg).iter()]
            for figure in (*report.figures, *(f for section in report.sections for f in section.figures))
            for svg in (figure.wide, figure.narrow)
        ]
        for report in reports[:2]
    )

    assert hostile == clean


def test_the_pdf_prints_every_payload_as_it_is() -> None:
    document = render_pdf(report_with(PAYLOADS), {}, has_appendix=True)

    text = squeeze("".join(page.extract_text() for page in PdfReader(io.BytesIO(document)).pages))
    missing = [p for p in PAYLOADS if squeeze(replace_uncovered(p))[:40] not in text]
    assert missing == []


def test_a_text_of_two_hundred_signs_without_a_space_is_broken_into_lines() -> None:
    report = build_report(make_analysis(), make_subject("W" * 200), "en")
    document = render_pdf(report, {}, "letter", has_appendix=True)

    pages = PdfReader(io.BytesIO(document)).pages
    lines = [line for page in pages for line in page.extract_text().splitlines()]
    assert 0 < max(line.count("W") for line in lines) < 60
    assert sum(line.count("WW") for line in lines) >= 95


def test_no_sign_that_nobody_typed_stands_in_the_text_of_the_pdf() -> None:
    report = build_report(make_analysis(), make_subject("A-" * 40, "b_" * 40), "en")
    document = render_pdf(report, {}, has_appendix=True)

    text = "".join(page.extract_text() for page in PdfReader(io.BytesIO(document)).pages)
    assert not {"\u200b", "\u00ad", "\u2060"} & set(text)
    assert "A-" * 40 in text.replace("\n", "")
    assert make_analysis().recording.sha256 in text


def results_with(text: str) -> dict[str, Any]:
    """The results of an analysis whose subject and file are called so."""
    who = {"subject": text, "file_name": text}
    return RESULTS | {"recording": RESULTS["recording"] | who}


@pytest.mark.parametrize("payload", PAYLOADS)
def test_no_cell_of_a_csv_for_spreadsheets_begins_as_a_formula_however_it_is_read(payload: str) -> None:
    rows = describe_tables([results_with(payload)])["summary"]
    tables = [encode_rows("summary", rows, d) for d in (INTERNATIONAL, FRENCH_EXCEL)]

    starts = {
        cell.lstrip(' "')[:1]
        for body in tables
        for delimiter in ",;\t"
        for cells in csv.reader(io.StringIO(body.decode("utf-8-sig"), newline=""), delimiter=delimiter)
        for cell in cells
        if not re.fullmatch(r"-?[\d.,e-]+", cell)
    }

    assert starts & set("=+-@\uff1d") == set()


def test_the_workbook_holds_the_texts_themselves_and_no_formula() -> None:
    body = encode_workbook(describe_tables(map(results_with, PAYLOADS)))

    sheet = openpyxl.load_workbook(io.BytesIO(body))["summary"]
    cells = [row[1] for row in sheet.iter_rows(min_row=2)]
    assert [(cell.value, cell.data_type) for cell in cells] == [(payload, "s") for payload in PAYLOADS]


def test_the_answer_to_paste_keeps_its_six_lines() -> None:
    counts = {
        format_brief(build_report(make_analysis(), make_subject(p), "en")).count(b"\n") for p in PAYLOADS[::5]
    }

    assert counts == {6}
