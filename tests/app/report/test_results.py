"""``results.json`` holds what its schema says, byte for byte the same each time."""

import json
from dataclasses import replace
from datetime import datetime
from math import inf
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from acromion.app.report.export.results import build_results, decode_results, encode_results, identify_report
from acromion.app.report.export.tables import describe_tables
from acromion.app.report.figures import load_results
from acromion.app.report.findings import (
    CalibrationFacts,
    Findings,
    PartFacts,
    QuestionFacts,
    RepeatFacts,
    ReportSubject,
    Software,
    StillFacts,
)
from acromion.app.report.words.numbers import Clock
from acromion.app.request import Conclusion
from acromion.fusion.diary import read_diary
from acromion.fusion.exposure.periods import place_diary
from acromion.fusion.exposure.types import Interval, PeakWindow
from acromion.fusion.quality import Quality
from acromion.fusion.recording import QualityFlag
from acromion.fusion.settings import DEFAULT_SETTINGS, AnalysisSettings
from tests.app.analysis_factory import (
    make_analysis,
    make_calibration,
    make_exposure,
    make_quality,
    make_subject,
    with_velocity,
)
from tests.app.report.report_reading import plain


@pytest.fixture(scope="module")
def results() -> dict[str, Any]:
    answer: dict[str, Any] = json.loads(encode_results(make_analysis(), make_subject()))
    return answer


def test_the_parts_stand_in_the_order_of_the_contract(results: dict[str, Any]) -> None:
    assert list(results) == [
        "schema", "report", "recording", "time", "calibration", "method", "exposure", "comparison", "quality",
            "software", "conclusion"
    ]  # fmt: skip
    assert results["schema"] == "acromion.results/1"
    assert " ".join(results["exposure"]["percentiles_deg"]) == "1 5 10 25 50 75 90 95 99"


def test_the_recording(results: dict[str, Any]) -> None:
    assert results["recording"] == {
        "sha256": "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08",
        "file_name": "S012_right.gt3x",
        "device": "gt9x",
        "serial_hash": "3f2a9c01b7de",
        "start": "2026-03-03T07:58:12-05:00",
        "time_zone": "UTC-05:00",
        "clock_offset_s": 0.0,
        "rate_hz": 100.0,
        "duration_s": 28740.0,
        "shift": None,
        "side": "right",
        "subject": "S012",
        "job_title": "",
        "isco_code": "",
        "columns": None,
    }


def test_analysed_missing_and_excluded_make_the_recorded_time(results: dict[str, Any]) -> None:
    time = results["time"]

    assert time["analysed_s"] + time["missing_s"] + time["excluded_s"] == time["recorded_s"] == 28740.0


def test_the_calibration(results: dict[str, Any]) -> None:
    assert results["calibration"] == {
        "pose": "n-pose", "state": "held_at_start", "sigma_deg": 5.0, "start_s": 42.5, "duration_s": 6.2,
        "score": 0.93, "gyro_bias_dps": [0.31, -0.12, 0.07], "second": None, "repeats": [],
        "repeat_deg": None, "parts": [], "axis": None, "slip_times_s": [], "no_slip_times_s": [],
        "walking_apart_deg": 12.0, "proposals": [], "spread_deg": 0.0, "needs_pose": False, "questions": [],
    }  # fmt: skip


def test_the_figures_stand_in_the_order_of_the_contract(results: dict[str, Any]) -> None:
    assert list(results["exposure"]) == [
        "analysed_s", "metric_filter_hz", "angle_sigma_deg", "bins", "time_above", "percentiles_deg",
        "entries", "cycles", "episodes", "velocity_dps", "peak", "eva", "by_hour", "by_period", "by_task",
        "by_mark", "by_posture", "intervals", "intervals_pose", "recovery", "frequency", "variation",
        "conventions", "minutes", "histogram_s", "figures",
    ]  # fmt: skip


def test_a_bin_without_an_interval_has_nulls(results: dict[str, Any]) -> None:
    assert results["exposure"]["bins"][0] == {
        "lower_deg": 0, "upper_deg": 20, "duration_s": 11781.0, "percent": 46.2,
        "low": None, "high": None, "low_pose": None, "high_pose": None,
    }  # fmt: skip


def test_four_speeds_of_which_an_uncomputed_one_is_null() -> None:
    exposure = with_velocity(make_exposure(), "generalised_accelerometer", None)
    results = json.loads(encode_results(make_analysis(exposure=exposure), make_subject()))

    speeds = results["exposure"]["velocity_dps"]

    assert (list(speeds), speeds["generalised_accelerometer"], list(speeds["inclination"])) == (
        ["inclination", "generalised", "generalised_accelerometer", "gyroscope"],
        None,
        ["10", "50", "90", "99", "mean"],
    )


def test_the_worst_window_has_seconds_and_clock_time(results: dict[str, Any]) -> None:
    assert results["exposure"]["peak"]["windows"][1] == {
        "length_s": 900,
        "start": "2026-03-03T13:05:12-05:00",
        "start_s": 18420.0,
        "percent_above_60": 41.2,
    }


def test_a_window_that_does_not_exist_is_null() -> None:
    exposure = replace(make_exposure(), peak_windows=(PeakWindow(3600, None, None),))

    peak = build_results(make_analysis(exposure=exposure), make_subject())["exposure"]["peak"]  # type: ignore[index]

    assert peak["windows"] == [{"length_s": 3600, "start": None, "start_s": None, "percent_above_60": None}]


def test_an_hour_has_units_in_its_names(results: dict[str, Any]) -> None:
    assert results["exposure"]["by_hour"][1] == {
        "label": "08", "start_s": 108.0, "end_s": 3708.0, "analysed_s": 3600.0, "elevation_p10_deg": 8.0,
        "elevation_p50_deg": 21.0, "elevation_p90_deg": 52.0, "time_above_30_percent": 29.0,
        "time_above_60_percent": 6.0, "time_above_90_percent": 1.4, "entries_above_60_per_h": 25.0,
        "intervals": {}, "intervals_pose": {},
    }  # fmt: skip


def test_a_warning_has_its_clock_times(results: dict[str, Any]) -> None:
    assert results["quality"]["warnings"][0] == {
        "code": "W-GAP",
        "count": 1,
        "seconds": 540.0,
        "first": "2026-03-03T13:38:12-05:00",
        "last": "2026-03-03T13:47:12-05:00",
        "spans": [],
        "first_s": 20400.0,
        "last_s": 20940.0,
        "spans_s": [],
        "facts": {},
    }


def test_without_a_clock_a_warning_has_its_time_from_the_first_sample() -> None:
    quality = Quality("good", (), (QualityFlag("W-GAP", 1, 2.0, 62.5, None),))

    told = build_results(make_analysis(start=None, quality=quality), make_subject())["quality"]["warnings"][0]  # type: ignore[index]

    assert (told["first"], told["last"]) == ("PT62.5S", None)


def test_a_device_clock_without_offset_stays_without() -> None:
    start = datetime(2026, 3, 3, 7, 58, 12)  # noqa: DTZ001 - a device clock has no zone

    results = build_results(make_analysis(start=start), make_subject())

    assert results["recording"]["start"] == "2026-03-03T07:58:12"  # type: ignore[index]


@pytest.mark.parametrize(
    ("figure", "written", "in_tables"),
    [(101.123456789, "101.123456789", 101.123457), (np.float64("nan"), "null", None)],
)
def test_a_figure_keeps_every_digit_is_rounded_for_tables_and_null_if_it_is_no_number(
    figure: float, written: str, in_tables: float | None
) -> None:
    exposure = replace(make_exposure(), elevation_p99_deg=figure)

    encoded = encode_results(make_analysis(exposure=exposure), make_subject(subject="Été"))

    assert f'"elevation_p99_deg": {written}' in encoded.decode("utf-8")
    assert load_results(encoded)["exposure"]["peak"]["elevation_p99_deg"] == in_tables
    assert "Été" in encoded.decode("utf-8")
    assert encoded.endswith(b"}\n")


def test_the_report_id_follows_the_settings() -> None:
    every = (
        AnalysisSettings(),
        AnalysisSettings(pose="side-lean"),
        AnalysisSettings(arm_axis="+y"),
        AnalysisSettings(slip_times_s=(3600.0,)),
        AnalysisSettings(no_slip_times_s=(3600.0,)),
        AnalysisSettings(pose_held="start"),
    )

    assert len({identify_report(each, make_analysis(), make_subject()) for each in every}) == 6


def test_the_report_id_does_not_follow_the_name_of_the_file() -> None:
    one, other = (make_subject(file_name=name) for name in ("a.gt3x", "b.gt3x"))

    assert identify_report(DEFAULT_SETTINGS, make_analysis(), one) == identify_report(
        DEFAULT_SETTINGS, make_analysis(), other
    )


# What an analysis found, read again from results.json: the report comes out the same.


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
        {"parts": (PartFacts(3600.0, inf, valid=False, pose_index=None),)},  # until the end
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


# What may not have been worn is proposed, as a row that a diary takes.


FLAG = QualityFlag("W-NONWEAR", 1, 900.0, 600.0, 1500.0, spans_s=((600.0, 1500.0),))


def propose() -> list[dict[str, Any]]:
    quality = Quality("caution", ("W-NONWEAR",), (FLAG,))
    results: dict[str, Any] = build_results(make_analysis(quality=quality), make_subject())
    proposals: list[dict[str, Any]] = results["quality"]["proposals"]
    return proposals


def test_a_stretch_that_may_not_have_been_worn_is_proposed() -> None:
    assert propose() == [{"kind": "not_worn", "start_s": 600.0, "end_s": 1500.0}]


def test_without_such_a_stretch_nothing_is() -> None:
    assert build_results(replace(make_analysis()), make_subject())["quality"]["proposals"] == []  # type: ignore[index]


def test_a_proposal_is_a_row_of_a_diary() -> None:
    (row,) = propose()
    diary = read_diary(f"start_s,end_s,kind\n{row['start_s']},{row['end_s']},{row['kind']}\n".encode())

    (period,) = place_diary(diary, None, 3_600_000_000).periods
    assert (period.start_us, period.end_us, period.reason) == (600_000_000, 1_500_000_000, "not-worn")


def test_stored_results_follow_the_zone_of_their_start() -> None:
    """Paris: 28 March 22:00 and 8 h of true time are 07:00 on the clock."""
    start = datetime(2026, 3, 28, 22, tzinfo=ZoneInfo("Europe/Paris"))
    findings = make_analysis(start=start)
    recording = replace(findings.recording, time_zone="Europe/Paris", clock_offset_s=-3720.0)

    content = encode_results(replace(findings, recording=recording), make_subject())
    kept = decode_results(content).findings.recording

    assert json.loads(content)["recording"]["start"] == "2026-03-28T22:00:00+01:00"
    assert Clock(kept.start).format(8 * 3600.0) == "07:00"
    assert (kept.time_zone, kept.clock_offset_s) == ("Europe/Paris", -3720.0)


def test_only_the_times_that_the_clocks_show_twice_have_their_offset() -> None:
    """Paris: 24 October 22:00 and 4 h are 02:00, and again after 5 h."""
    clock = Clock(datetime(2026, 10, 24, 22, tzinfo=ZoneInfo("Europe/Paris")), "en", 10 * 3600.0)

    shown = [plain(clock.format_range(h * 3600.0, h * 3600.0 + 3600.0, is_hour=True)) for h in (3, 4, 5, 6)]

    assert shown == [
        "01:00–02:00 UTC+2 on 25 October",
        "02:00 UTC+2–02:00 UTC+1 on 25 October",
        "02:00 UTC+1–03:00 on 25 October",
        "03:00–04:00 on 25 October",
    ]
    whole = "24 October 2026, 22:00 UTC+2 to 25 October 2026, 07:00 UTC+1"
    assert plain(clock.format_whole()) == whole
    assert plain(replace(clock, duration_s=3600.0).format_whole()) == "24 October 2026, 22:00 to 23:00"


def test_the_hours_of_the_table_have_their_offset() -> None:
    zone = "Europe/Paris"
    findings = make_analysis(start=datetime(2026, 10, 25, 1, 58, 12, tzinfo=ZoneInfo(zone)))
    findings = replace(findings, recording=replace(findings.recording, time_zone=zone))

    rows = describe_tables([load_results(encode_results(findings, make_subject()))])["hours"]

    assert [(row["start"], row["utc_offset"]) for row in rows][:3] == [
        ("2026-10-25T01:58:12", "UTC+02:00"),
        ("2026-10-25T02:00:00", "UTC+02:00"),
        ("2026-10-25T02:00:00", "UTC+01:00"),
    ]


def test_a_stated_clock_changes_the_id_of_a_report() -> None:
    findings, subject = make_analysis(), make_subject()

    ids = {
        identify_report(settings, findings, subject)
        for settings in (
            DEFAULT_SETTINGS,
            AnalysisSettings(time_zone="Europe/Paris"),
            AnalysisSettings(clock_offset_s=-3720.0),
        )
    }

    assert len(ids) == 3
