"""What an analysis found, kept and read again: the report comes out the same, in either language."""

import math
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from app.report.analysis.report import build_report
from app.report.export.results import encode_results
from app.report.findings import Findings, SettingsFacts, decode_findings, encode_findings
from app.report.render.write import FINDINGS, RESULTS, rewrite_reports
from app.report.words.wording import LANGUAGES, Language
from app.request import ReportRequest
from fusion.diary import DiaryEntry
from fusion.recording import QualityFlag
from tests.app.analysis_factory import make_analysis, make_quality, make_subject


def read_again(findings: Findings) -> Findings:
    return decode_findings(encode_findings(findings, make_subject())).findings


@pytest.mark.parametrize("language", LANGUAGES)
def test_kept_findings_give_the_same_report(language: Language) -> None:
    kept = decode_findings(encode_findings(make_analysis(), make_subject()))

    assert build_report(kept.findings, kept.subject, language) == build_report(
        make_analysis(), make_subject(), language
    )


def test_kept_findings_give_the_same_results_byte_for_byte() -> None:
    assert encode_results(read_again(make_analysis()), make_subject()) == encode_results(
        make_analysis(), make_subject()
    )


def test_a_minute_without_analysed_time_stays_without() -> None:
    minutes = read_again(make_analysis()).exposure.minutes

    assert np.isnan(minutes.p50_deg[125])


def test_a_clock_that_follows_a_zone_goes_on_following_it() -> None:
    start = datetime(2027, 3, 13, 22, 0, tzinfo=ZoneInfo("America/Toronto"))

    again = read_again(make_analysis(start=start))

    assert (again.recording.start, again.recording.start.tzinfo) == (start, start.tzinfo)  # type: ignore[union-attr]


def test_a_recording_without_a_clock_has_none_when_read_again() -> None:
    assert read_again(make_analysis(start=None)).recording.start is None


def test_the_diary_and_the_facts_of_a_caveat_are_kept() -> None:
    settings = SettingsFacts(
        pose="two-point",
        calibration_windows_s=((5.0, 15.0), (20.0, 30.0)),
        diary=(DiaryEntry("07:58:00", 120.0, "break", "lunch", left_out=True, line=3),),
    )
    flag = QualityFlag("W-RATE", facts={"header": 100, "measured": 99.5, "h": "x"}, spans_s=((1.0, 2.5),))
    findings = replace(
        make_analysis(), settings=settings, quality=replace(make_quality("good"), flags=(flag,))
    )

    again = read_again(findings)

    assert (again.settings, again.quality.flags) == (settings, (flag,))


def test_a_figure_that_is_no_number_is_kept_as_none() -> None:
    exposure = replace(make_analysis().exposure, elevation_p99_deg=math.nan)

    assert math.isnan(read_again(replace(make_analysis(), exposure=exposure)).exposure.elevation_p99_deg)


def test_findings_of_a_later_program_are_refused() -> None:
    text = encode_findings(make_analysis(), make_subject()).replace(b"findings/1", b"findings/9")

    with pytest.raises(ValueError, match="findings/9"):
        decode_findings(text)


def test_a_finished_analysis_is_told_in_the_other_language_from_its_folder(tmp_path: Path) -> None:
    (tmp_path / RESULTS).write_bytes(encode_results(make_analysis(), make_subject()))
    (tmp_path / FINDINGS).write_bytes(encode_findings(make_analysis(), make_subject()))
    out = tmp_path / "again"
    out.mkdir()

    rewrite_reports(tmp_path, ReportRequest("", languages=("fr",), kinds=("html",)), out)

    assert "Le bras droit a été élevé" in (out / "report.fr.html").read_text("utf-8")
