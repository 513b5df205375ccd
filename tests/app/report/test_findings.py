"""What an analysis found, read again from results.json: the report comes out the same, in either language."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.report.analysis.report import build_report
from app.report.export.results import decode_results, encode_results
from app.report.findings import CalibrationFacts, Findings, PartFacts, QuestionFacts, RepeatFacts, StillFacts
from app.report.render.write import RESULTS, rewrite_reports
from app.report.words.subject import ReportSubject, Software
from app.report.words.wording import LANGUAGES, Language
from app.request import Conclusion, ReportRequest
from fusion.exposure import Interval
from fusion.recording import QualityFlag
from tests.app.analysis_factory import (
    make_analysis,
    make_calibration,
    make_exposure,
    make_quality,
    make_subject,
)


def read_again(findings: Findings) -> Findings:
    return decode_results(encode_results(findings, make_subject())).findings


def list_values(value: Any, path: str = "") -> dict[str, Any]:
    """Return every value of a frozen record by its path; an array as the list of its numbers."""
    if hasattr(value, "__dataclass_fields__"):
        return list_values({name: getattr(value, name) for name in value.__dataclass_fields__}, path)
    if isinstance(value, np.ndarray):
        return {path: repr(value.tolist())}
    if isinstance(value, dict | tuple | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return {key: v for name, inner in items for key, v in list_values(inner, f"{path}/{name}").items()}
    return {path: value}


def test_every_value_of_an_analysis_is_read_again_to_its_last_digit(analysed: Findings) -> None:
    assert list_values(read_again(analysed)) == list_values(analysed)


@pytest.mark.parametrize("language", LANGUAGES)
def test_an_analysis_gives_the_same_report_when_read_again(analysed: Findings, language: Language) -> None:
    assert build_report(read_again(analysed), make_subject(), language) == build_report(
        analysed, make_subject(), language
    )


def test_what_is_not_known_is_not_known_when_read_again() -> None:
    clockless = read_again(make_analysis(start=None, calibrated=False))

    assert (clockless.recording.start, clockless.calibration, clockless.method) == (None, None, None)
    assert np.isnan(read_again(make_analysis()).exposure.minutes.p50_deg[125])  # not analysed


def test_the_facts_of_a_caveat_are_kept() -> None:
    flag = QualityFlag("W-RATE", facts={"header": 100, "measured": 99.5, "h": "x"}, spans_s=((1.0, 2.5),))

    again = read_again(replace(make_analysis(), quality=replace(make_quality("good"), flags=(flag,))))

    assert again.quality.flags == (flag,)


@pytest.mark.parametrize(
    "changed",
    [
        {"pose": None, "axis": "-y", "state": "axis", "start_s": None, "duration_s": None, "score": None},
        {"pose": "two-point", "second": StillFacts(60.0, 8.0)},
        {"repeats": (RepeatFacts(7242.0, 8.0, 3.5),), "repeat_deg": 3.5},
        {"parts": (PartFacts(3600.0, 7242.0, valid=False, pose_index=None),)},
        {"proposals": (StillFacts(108.0, 10.0),), "spread_deg": 34.2, "needs_pose": True},
        {"questions": (QuestionFacts("slip", 7200.0, 7320.0, 23.0),), "slip_times_s": (3600.0,)},
    ],
)
def test_what_is_known_of_the_pose_is_kept(changed: dict[str, Any]) -> None:
    calibration: CalibrationFacts = replace(make_calibration(), **changed)

    assert read_again(replace(make_analysis(), calibration=calibration)).calibration == calibration


def test_a_range_keeps_the_ends_with_the_error_of_the_n_pose() -> None:
    interval = Interval(6.1, 9.3, 6.0, 14.2)
    intervals = {"a": Interval(1, 2), "elevation_p50_deg": interval}
    exposure = replace(make_exposure(above_60_interval=interval), intervals=intervals)

    again = read_again(make_analysis(exposure=exposure)).exposure

    assert again.time_above[1].interval == interval
    assert again.intervals == intervals


def test_whose_report_it_is_is_kept_but_not_what_a_person_said_of_a_correction() -> None:
    subject = ReportSubject(
        file_name="a.csv",
        subject="S1",
        side=None,
        software=Software("1.0", "abc"),
        version=3,
        reason="the other arm",
        changes=("side", "engine"),
        columns='{"time": "t"}',
        conclusion=Conclusion("Overhead work.", "M. Tremblay", "2026-11-23"),
        report_id="0123456789abcdef",
    )
    encoded = encode_results(make_analysis(), subject)

    assert b"the other arm" not in encoded
    assert decode_results(encoded).subject == replace(subject, reason="")


@pytest.mark.parametrize(
    ("there", "instead", "told"),
    [
        (b"results/1", b"results/9", "results/9"),
        (b'"elevation_p99_deg"', b'"p99"', r"\S"),
        (b'"rate_hz": 100.0', b'"rate_hz": "fast"', r"\S"),
        (b'"reader": null', b'"reader": "a"', r"\S"),
        (b'"state": "held_at_start"', b'"state": "guessed"', r"\S"),
        (b"{", b"[", r"\S"),
        (b'"report": {', b'"report": null, "x": {', r"\S"),
    ],
)
def test_results_of_another_version_or_form_are_refused(there: bytes, instead: bytes, told: str) -> None:
    encoded = encode_results(make_analysis(), make_subject()).replace(there, instead, 1)

    with pytest.raises(ValueError, match=told):
        decode_results(encoded)


@pytest.mark.parametrize("content", [b"", b"null", b"[]", b"{}", b'"x"', b"\xff"])
def test_what_is_no_results_is_refused(content: bytes) -> None:
    with pytest.raises(ValueError, match=r"\S"):
        decode_results(content)


def test_a_list_of_numbers_stands_in_one_line() -> None:
    text = encode_results(make_analysis(), make_subject(subject="[\\n 1 ]")).decode()

    assert '"gyro_bias_dps": [0.31, -0.12, 0.07]' in text
    assert decode_results(text.encode()).subject.subject == "[\\n 1 ]"


def test_a_finished_analysis_is_told_in_the_other_language_from_its_folder(tmp_path: Path) -> None:
    (tmp_path / RESULTS).write_bytes(encode_results(make_analysis(), make_subject()))
    out = tmp_path / "again"
    out.mkdir()

    rewrite_reports(tmp_path, ReportRequest("", languages=("fr",), kinds=("html",)), out)

    assert "Le bras droit a été élevé" in (out / "report.fr.html").read_text("utf-8")
