"""The PDF report: tagged, archivable, with the figures attached, and the same bytes everywhere."""

import io
import re
from collections.abc import Callable
from dataclasses import asdict, replace
from functools import cache
from typing import Any, get_args

import pytest
from pypdf import PageObject, PdfReader

from acromion.app.report.export.results import decode_results, encode_results
from acromion.app.report.findings import Findings, StillFacts
from acromion.app.report.render.html import render_html
from acromion.app.report.render.pdf import render_pdf, replace_uncovered
from acromion.app.report.single.report import build_report
from acromion.app.report.words.wording import LANGUAGES, Language, Part, load_wording
from acromion.app.request import Paper
from acromion.fusion.exposure.types import PeakWindow
from acromion.fusion.quality import Quality
from acromion.fusion.recording import QualityFlag
from tests import ROOT
from tests.app.analysis_factory import make_analysis, make_exposure, make_subject
from tests.app.report.test_wording import walk_texts

PAPERS: tuple[Paper, ...] = ("a4", "letter")
FOOTER = 0.045
"""Share of the height below which only the footer stands (14 mm of 297)."""


@cache
def pdf_of(language: Language = "en", subject: str = "S012", file_name: str = "a.gt3x") -> bytes:
    analysis, who = make_analysis(), make_subject(subject, file_name)
    return render_pdf(build_report(analysis, who, language), {"results.json": b"{}\n"})


def catalogue_of(document: bytes) -> Any:
    return PdfReader(io.BytesIO(document)).trailer["/Root"]


def date_of(document: bytes) -> str:
    metadata = PdfReader(io.BytesIO(document)).metadata
    return str(metadata["/CreationDate"]) if metadata else ""


def fonts_of(document: bytes) -> set[str]:
    pages: Any = PdfReader(io.BytesIO(document)).pages
    fonts = (font for page in pages for font in page["/Resources"]["/Font"].values())
    return {str(font.get_object()["/BaseFont"]).split("+")[-1] for font in fonts}


def flatten(text: str) -> str:
    """Leave out every space: the engine breaks lines where it likes."""
    return re.sub(r"\s", "", text)


def read_page(page: PageObject) -> tuple[str, float]:
    """Return the text, and how far up the page its last line above the footer stands, as a share."""
    places: list[float] = []

    def note(text: str, cm: list[float], tm: list[float], *_: object) -> None:
        if text.strip():
            places.append((tm[4] * cm[1] + tm[5] * cm[3] + cm[5]) / float(page.mediabox.height))

    told = page.extract_text(visitor_text=note)
    return told, min(place for place in places if place > FOOTER)


@cache
def read_example() -> Findings:
    """A full shift with three tasks and the range of every figure."""
    return decode_results((ROOT / "templates/example/results.json").read_bytes()).findings


def make_half_day() -> Findings:
    exposure = replace(read_example().exposure, by_task=(), by_period=(), analysed_s=15_840.0)
    return replace(read_example(), exposure=replace(exposure, by_hour=exposure.by_hour[:5]))


def make_unposed() -> Findings:
    stills = tuple(StillFacts(60.0 * k, 10.0) for k in range(8))
    known = read_example().calibration
    assert known is not None
    calibration = replace(known, state="assumed", proposals=stills, spread_deg=55.0, needs_pose=True)
    flags = (QualityFlag("W-WHICH-POSE", 8, 62.0), QualityFlag("W-NPOSE", 1))
    return replace(
        read_example(), calibration=calibration, quality=Quality("caution", ("W-WHICH-POSE",), flags)
    )


def make_poor() -> Findings:
    codes = ("W-SHORT", "W-GAP", "W-CLIP", "W-REMOUNT", "W-NONWEAR", "W-SPIKES", "W-WRAP", "W-NPOSE")
    flags = tuple(QualityFlag(code, 12, 3600.0, 100.0, 20_000.0) for code in codes)
    return replace(read_example(), quality=Quality("poor", codes[:4], flags))


def make_long(hours: int = 14, tasks: int = 13) -> Findings:
    """Make a long shift with many tasks: more rows on page 2 than it has room for."""
    exposure = read_example().exposure
    hour, task = exposure.by_hour[0], exposure.by_task[0]
    by_hour = tuple(
        replace(hour, label=str(k), start_s=3600.0 * k, end_s=3600.0 * (k + 1)) for k in range(hours)
    )
    by_task = tuple(
        replace(task, label=f"Unloading and driving back to depot {k + 1}", start_s=3600.0 * k)
        for k in range(tasks)
    )
    return replace(read_example(), exposure=replace(exposure, by_hour=by_hour, by_task=by_task))


TYPICAL: dict[str, Callable[[], Findings]] = {
    "clean": lambda: replace(
        read_example(), exposure=replace(read_example().exposure, by_task=(), by_period=())
    ),
    "diary": read_example,
    "half day": make_half_day,
    "no pose": make_unposed,
    "poor": make_poor,
    "long": make_long,
    "most hours and tasks with both tables": lambda: make_long(8, 7),
    "two days without tasks": lambda: make_long(48, 0),
    "lsm9ds1": lambda: replace(read_example(), recording=replace(read_example().recording, device="lsm9ds1")),
}


LOOSEST, TIGHTEST = ("en", "a4"), ("fr", "letter")


@pytest.mark.parametrize(("language", "paper"), [LOOSEST, TIGHTEST])
@pytest.mark.parametrize("day", TYPICAL)
def test_a_report_has_four_pages_of_which_none_leaves_a_quarter_empty_and_breaks_no_range(
    day: str, language: Language, paper: Paper
) -> None:
    report = build_report(TYPICAL[day](), make_subject(), language)
    pages = PdfReader(io.BytesIO(render_pdf(report, {}, paper))).pages

    told, lowest = zip(*map(read_page, pages), strict=True)
    assert len(pages) == 4
    assert flatten(report.intended_use.paragraphs[0])[-40:] in flatten(told[3])
    assert max(lowest) < 0.25
    assert [line for text in told for line in text.splitlines() if re.search(r"\d[ %°s]*–$", line)] == []
    points = {"a4": (595, 842), "letter": (612, 792)}[paper]
    assert {(round(page.mediabox.width), round(page.mediabox.height)) for page in pages} == {points}


def test_the_appendix_alone_has_the_sources_the_sha_256_and_the_rest_of_the_tables() -> None:
    report = build_report(make_analysis(), make_subject(), "fr")
    without, whole = (
        flatten("".join(page.extract_text() for page in PdfReader(io.BytesIO(document)).pages))
        for document in (pdf_of("fr"), render_pdf(report, {}, has_appendix=True))
    )

    own = (make_analysis().recording.sha256, flatten(report.sections[-1].sources[0]), "Annexe")
    assert [(part in whole, part in without) for part in own] == [(True, False)] * 3
    assert flatten(report.words["more"]) in without
    assert flatten(report.words["more"]) not in whole


def test_every_figure_of_the_tables_stands_in_the_pdf_with_its_appendix() -> None:
    report = build_report(make_analysis(), make_subject(), "fr")
    document = PdfReader(io.BytesIO(render_pdf(report, {}, has_appendix=True)))
    text = flatten("".join(page.extract_text() for page in document.pages))

    missing = [
        cell
        for section in report.sections
        for table in section.tables
        for row in table.rows
        for cell in row
        if flatten(cell) not in text
    ]

    assert missing == []


def test_it_is_tagged_declares_pdf_ua_1_and_pdf_a_3_names_its_language_and_uses_our_fonts_alone() -> None:
    root = catalogue_of(pdf_of("fr"))
    metadata = root["/Metadata"].get_data().decode()

    assert (root["/MarkInfo"]["/Marked"], root["/Lang"]) == (True, "fr")
    assert re.search(r"pdfuaid:part>1<", metadata)
    assert re.search(r"pdfaid:part>3<.*pdfaid:conformance>A<", metadata, re.DOTALL)
    assert fonts_of(pdf_of()) == {"Inter-Regular-Identity-H", "Inter-SemiBold-Identity-H"}


def test_the_figures_are_attached_byte_for_byte() -> None:
    analysis, who = make_analysis(), make_subject()
    results = encode_results(analysis, who)

    document = render_pdf(build_report(analysis, who, "en"), {"results.json": results})

    assert PdfReader(io.BytesIO(document)).attachments == {"results.json": [results]}


def test_its_date_is_the_end_of_the_recording_and_1970_without_a_clock() -> None:
    clockless = build_report(make_analysis(start=None), make_subject(), "en")

    assert date_of(pdf_of()).startswith("D:20260303155712")
    assert date_of(render_pdf(clockless, {})).startswith("D:19700101")


def test_any_script_in_a_subject_code_gives_a_report() -> None:
    assert pdf_of(subject="中文 \u0627\u0644 🙂 a\u0301 Ωж").startswith(b"%PDF-")


def test_a_character_that_the_font_lacks_is_spelled_out() -> None:
    assert replace_uncovered("Été 中") == "Été [U+4E2D]"


@pytest.mark.parametrize("language", LANGUAGES)
def test_all_our_own_words_can_be_drawn(language: Language) -> None:
    words = [text for part in get_args(Part) for _, text in walk_texts(load_wording(language, part))]
    report = asdict(build_report(make_analysis(), make_subject(), language))

    assert [
        word for word in (*words, str(report)) if "[U+" in replace_uncovered(word.replace("\n", " "))
    ] == []


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_full_shift_with_seven_periods_is_light(language: Language) -> None:
    exposure = make_exposure()
    findings = replace(make_analysis(), exposure=replace(exposure, by_period=exposure.by_hour[:7]))
    results = encode_results(findings, make_subject())

    document = render_pdf(build_report(findings, make_subject(), language), {"results.json": results})

    assert len(document) <= 200_000


def test_the_heat_map_is_told_to_those_who_do_not_see_it() -> None:
    report = build_report(make_analysis(), make_subject(), "en")
    heat = next(s for s in report.sections if s.key == "spread").figures[1]

    assert heat.alternative.count("2.2") == 45


def test_the_french_of_quebec_reaches_the_page_and_the_pdf() -> None:
    shift = replace(make_exposure(), peak_windows=(PeakWindow(900, None, None),))
    report = build_report(make_analysis(exposure=shift), make_subject(), "fr-CA")
    document = render_pdf(report, {})

    assert '<html lang="fr-CA">' in render_html(report).decode()
    assert catalogue_of(document)["/Lang"] == "fr-CA"
    told = " ".join(report.sentences)
    assert "30\u00a0par heure); plus longue durée" in told.replace("30 par", "30\u00a0par")
    assert "\u202f;" not in told
