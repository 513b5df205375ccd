"""A third language from one file of words: German on page 1, English where there is none, and said so."""

import re
from pathlib import Path

import pypdf

from app.report.analysis.chapters import build_verdict
from app.report.analysis.report import build_report
from app.report.render.pdf import render_pdf
from app.report.words.numbers import format_clock, format_date, format_number, format_percent
from app.report.words.wording import Language, load_wording
from fusion.quality import Quality
from fusion.recording import QualityFlag
from tests.app.analysis_factory import START, make_analysis, make_subject
from tests.ways_in.typed import run

WORD = re.compile(r"[A-Za-zÄÖÜäöüß]{4,}")
FACT = re.compile(r"\{(\w+)")
ALIKE = {"Acromion", "ActiGraph", "Arvidsson", "Lewis", "Link", "Sensor", "Wahlström"}
"""Names, and a word of both languages."""


def read_pages(folder: Path, language: Language) -> list[str]:
    path = folder / f"{language}.pdf"
    path.write_bytes(render_pdf(build_report(make_analysis(), make_subject(), language), {}))
    return [page.extract_text() for page in pypdf.PdfReader(path).pages]


def test_page_1_has_no_word_of_the_english_page(tmp_path: Path) -> None:
    german, english = (set(WORD.findall(read_pages(tmp_path, code)[0])) for code in ("de", "en"))

    assert german & english <= ALIKE


def test_the_foot_of_every_page_says_that_the_rest_is_english(tmp_path: Path) -> None:
    assert all("nicht übersetzte Teile: auf Englisch" in page for page in read_pages(tmp_path, "de"))


def test_what_is_not_translated_is_english() -> None:
    german, english = (load_wording(code)["section"]["provenance"] for code in ("de", "en"))

    assert german == english


def test_every_caveat_is_told_in_german_with_the_same_facts() -> None:
    german, english = (load_wording(code)["flag"] for code in ("de", "en"))

    assert [code for code in english if german[code]["detail"] == english[code]["detail"]] == []
    assert [
        code
        for code in english
        if set(FACT.findall(german[code]["detail"])) != set(FACT.findall(english[code]["detail"]))
    ] == []


def test_a_caveat_within_a_sentence_keeps_the_capital_of_its_noun() -> None:
    flags = (QualityFlag("W-GAP", 1, 540.0), QualityFlag("W-CLIP", 1, 9.0), QualityFlag("W-LOCALE", 1))
    quality = Quality("poor", ("W-GAP", "W-CLIP", "W-LOCALE"), flags)

    told = build_verdict(make_analysis(quality=quality), load_wording("de"), "de").reason

    assert "Außerdem: Außerhalb des Messbereichs (9\u202fs); Dezimalkommas." in told
    assert told.endswith("Nicht ausgewertet: Pause 45\u202fmin, Fehlende Daten 9\u202fmin.")


def test_numbers_dates_and_times_are_written_as_in_german() -> None:
    assert format_number(1234.5, 1, "de") == "1\u202f234,5"
    assert format_percent(7.6, "de") == "7,6\u202f%"
    assert format_date(START.date(), "de") == "3.\u00a0März\u00a02026"
    assert format_clock(START.replace(hour=7, minute=58), "de") == "07:58"


def test_the_command_line_makes_a_german_report(shift_gt3x: Path, tmp_path: Path) -> None:
    assert run("run", shift_gt3x, "-o", tmp_path, "--lang", "de").exit_code == 0

    assert '<html lang="de">' in (tmp_path / shift_gt3x.stem / "report.html").read_text("utf-8")
