"""Whatever a person writes is only ever text: in the HTML, in the drawings, in the PDF, in every table."""

import csv
import io
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import openpyxl
import pytest
from pypdf import PdfReader

from app.report.analysis.report import Report, build_report
from app.report.export.all import encode_redcap_import
from app.report.export.columns import encode_summary, summarise_results
from app.report.export.csv import FRENCH_EXCEL, INTERNATIONAL
from app.report.export.results import build_results
from app.report.export.xlsx import encode_workbook
from app.report.findings import Findings
from app.report.model import format_brief
from app.report.render.html import render_html
from app.report.render.pdf import render_pdf, spell_uncovered
from app.report.words.wording import Language
from fusion.exposure import PartExposure
from fusion.quality import Quality
from fusion.recording import QualityFlag, Span
from tests.app.analysis_factory import make_analysis, make_exposure, make_subject
from tests.app.payloads import FAMILIES, PAYLOADS
from tests.app.report.test_html import read

RESULTS: dict[str, Any] = build_results(make_analysis(), make_subject())
SHARES = ({10: 1.0, 50: 2.0, 90: 3.0}, {30: 1.0, 60: 1.0, 90: 1.0}, None)


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
    return build_report(analysis_with(texts), make_subject(texts[0], texts[0]), language)


def harmless(texts: Sequence[str]) -> list[str]:
    """Give other texts of the same lengths, as the layout depends on those."""
    return [f"{k:02d}".ljust(len(text), "x")[: len(text)] for k, text in enumerate(texts)]


def squeeze(text: str) -> str:
    return re.sub(r"\s", "", text)


@pytest.mark.parametrize("family", FAMILIES)
def test_the_page_has_no_other_element_and_no_other_attribute(family: str) -> None:
    texts = FAMILIES[family]

    clean, hostile = (read(render_html(report_with(some))) for some in (harmless(texts), texts))

    assert hostile.tags == clean.tags
    assert [name for name, _ in hostile.attributes] == [name for name, _ in clean.attributes]


@pytest.mark.parametrize("family", FAMILIES)
def test_every_drawing_stays_well_formed_with_the_same_elements(family: str) -> None:
    def elements(texts: Sequence[str]) -> list[list[str]]:
        report = report_with(texts)
        figures = [*report.figures, *(f for s in report.sections for f in s.figures)]
        drawings = [svg for figure in figures for svg in (figure.wide, figure.narrow)]
        return [[e.tag for e in ET.fromstring(svg).iter()] for svg in drawings]

    assert elements(FAMILIES[family]) == elements(harmless(FAMILIES[family]))


def test_the_pdf_prints_every_payload_as_it_is() -> None:
    document = render_pdf(report_with(PAYLOADS), {})

    text = squeeze("".join(page.extract_text() for page in PdfReader(io.BytesIO(document)).pages))
    missing = [p for p in PAYLOADS if squeeze(spell_uncovered(p))[:40] not in text]
    assert missing == []


def test_a_text_of_two_hundred_signs_without_a_space_is_broken_into_lines() -> None:
    document = render_pdf(build_report(make_analysis(), make_subject("W" * 200), "en"), {}, "letter")

    lines = PdfReader(io.BytesIO(document)).pages[-1].extract_text().splitlines()
    assert 0 < max(line.count("W") for line in lines) < 60
    assert sum(line.count("WW") for line in lines) >= 95


def test_no_sign_that_nobody_typed_stands_in_the_text_of_the_pdf() -> None:
    document = render_pdf(build_report(make_analysis(), make_subject("A-" * 40, "b_" * 40), "en"), {})

    text = "".join(page.extract_text() for page in PdfReader(io.BytesIO(document)).pages)
    assert not {"\u200b", "\u00ad", "\u2060"} & set(text)
    assert "A-" * 40 in text.replace("\n", "")
    assert make_analysis().recording.sha256 in text


def results_with(text: str) -> dict[str, Any]:
    """The results of an analysis whose subject and file are called so."""
    who = {"subject": text, "file_name": text}
    return RESULTS | {"recording": RESULTS["recording"] | who}


@pytest.mark.parametrize("payload", PAYLOADS)
def test_no_cell_of_any_csv_begins_as_a_formula_however_it_is_read(payload: str) -> None:
    row = summarise_results(results_with(payload))
    tables = [encode_summary([row], d) for d in (INTERNATIONAL, FRENCH_EXCEL)]
    tables.append(encode_redcap_import([results_with(payload)]))

    starts = {
        cell.lstrip(' "')[:1]
        for body in tables
        for delimiter in ",;\t"
        for cells in csv.reader(io.StringIO(body.decode("utf-8-sig"), newline=""), delimiter=delimiter)
        for cell in cells
        if not re.fullmatch(r"-?[\d.,e-]+", cell)
    }

    assert starts & set("=+-@\uff1d") == set()


@pytest.mark.parametrize("payload", PAYLOADS)
def test_the_workbook_holds_the_text_itself_and_no_formula(payload: str) -> None:
    body = encode_workbook([results_with(payload)])

    sheet = openpyxl.load_workbook(io.BytesIO(body), read_only=True)["summary"]
    cell = next(iter(sheet.iter_rows(min_row=2)))[1]
    assert (cell.value, cell.data_type) == (payload, "s")


def test_the_answer_to_paste_keeps_its_six_lines() -> None:
    counts = {
        format_brief(build_report(make_analysis(), make_subject(p), "en")).count(b"\n") for p in PAYLOADS[::5]
    }

    assert counts == {6}
