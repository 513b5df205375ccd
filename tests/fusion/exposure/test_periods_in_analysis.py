"""What a diary does to an analysis: breaks leave the denominator, nothing is lost, nothing counted twice."""

import io

import numpy as np
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st

from fusion.diary import KINDS, DiaryEntry, Kind
from fusion.errors import TooShort
from fusion.pipeline import Analysis, analyse, analyse_angles
from fusion.quality import TimePart
from fusion.settings import AnalysisSettings
from tests.factories import hold

MINUTE = 60_000_000


def analyse_hours(
    *diary: DiaryEntry, seconds: int = 600, rate_hz: int = 10, hole: slice = slice(0, 0)
) -> Analysis:
    """Analyse ready angles: 10 deg, but 70 deg from the second to the fourth minute."""
    rows = np.arange(seconds * rate_hz)
    angle = np.where((rows >= 120 * rate_hz) & (rows < 240 * rate_hz), 70, 10)
    kept = np.delete(rows, hole)
    lines = (f"{i / rate_hz:.6f},{angle[i]}\n" for i in kept)
    return analyse_angles(io.BytesIO(f"time_s,elevation_deg\n{''.join(lines)}".encode()), diary=diary)


def parts_of(analysis: Analysis) -> dict[tuple[str, str], int]:
    return {(part.account, part.name): part.duration_us for part in analysis.time.parts}


def test_a_break_leaves_the_denominator() -> None:
    analysis = analyse_hours(DiaryEntry(0.0, 120.0, "break"))

    assert analysis.exposure.time_above[1].percent == pytest.approx(25.0)  # 2 of 8 minutes


def test_a_break_stays_valid() -> None:
    analysis = analyse_hours(DiaryEntry(0.0, 120.0, "break"))

    assert all(segment.valid.all() for segment in analysis.elevation.segments)


def test_a_stay_ends_where_a_break_begins() -> None:
    stays = analyse_hours(DiaryEntry(180.0, 200.0, "break")).exposure.episodes[1]

    assert (stays.count, stays.longest_s, stays.censored) == (2, 60.0, 1)


def test_the_arm_that_is_up_when_a_break_ends_has_not_come_up_again() -> None:
    assert analyse_hours(DiaryEntry(180.0, 200.0, "break")).exposure.entries[1].count == 1


def test_each_period_has_its_figures() -> None:
    first, second, rest = analyse_hours(
        DiaryEntry(0.0, 180.0, "task", "Boxes"), DiaryEntry(180.0, 300.0, "seated")
    ).exposure.by_period

    assert (first.label, first.analysed_s) == ("Boxes", 180.0)
    assert first.percent_above[60] == pytest.approx(100 / 3)
    assert (second.kind, second.percent_above[60]) == ("seated", 50.0)
    assert (rest.kind, rest.label, rest.analysed_s, rest.percent_above[60]) == ("work", "", 300.0, 0.0)


def test_a_task_that_a_break_cuts_is_told_once_with_the_time_that_is_left() -> None:
    task, pause, _ = analyse_hours(
        DiaryEntry(60.0, 300.0, "task"), DiaryEntry(120.0, 180.0, "break")
    ).exposure.by_period

    assert (task.start_s, task.end_s, task.recorded_s, task.analysed_s) == (60.0, 300.0, 180.0, 180.0)
    assert (pause.reason, pause.recorded_s, pause.analysed_s, pause.percentiles_deg) == (
        "break",
        60.0,
        0.0,
        {},
    )


def test_the_parts_of_the_day_are_named() -> None:
    analysis = analyse_hours(
        DiaryEntry(60.0, 540.0, "shift"),
        DiaryEntry(60.0, 180.0, "task", "Boxes"),
        DiaryEntry(180.0, 240.0, "break"),
        DiaryEntry(240.0, 300.0, "not_worn"),
    )

    assert analysis.time.parts == (
        TimePart("analysed", "shift", 4 * MINUTE),
        TimePart("analysed", "task", 2 * MINUTE),
        TimePart("excluded", "outside", 2 * MINUTE),
        TimePart("excluded", "break", MINUTE),
        TimePart("excluded", "not-worn", MINUTE),
    )


def test_a_hole_within_a_break_is_break() -> None:
    analysis = analyse_hours(DiaryEntry(300.0, 400.0, "break"), hole=slice(3200, 3400))

    assert analysis.time.missing_us == 0


def test_a_hole_at_work_is_missing() -> None:
    analysis = analyse_hours(DiaryEntry(0.0, 100.0, "break"), hole=slice(3200, 3400))

    assert parts_of(analysis) == {
        ("analysed", "work"): 8 * MINUTE,
        ("excluded", "break"): 100_000_000,
        ("missing", "missing"): 20_000_000,
    }


def test_what_the_diary_leaves_out_does_not_count_against_the_coverage() -> None:
    codes = [flag.code for flag in analyse_hours(DiaryEntry(0.0, 200.0, "shift")).quality.flags]

    assert "W-LOWCOVER" not in codes


def test_too_little_of_a_shift_is_told() -> None:
    analysis = analyse_hours(DiaryEntry(0.0, 400.0, "shift"), hole=slice(100, 2500))

    assert "W-LOWCOVER" in [flag.code for flag in analysis.quality.flags]


def test_without_a_diary_all_analysed_time_is_work() -> None:
    assert parts_of(analyse_hours()) == {("analysed", "work"): 10 * MINUTE}


def test_without_a_diary_there_are_no_periods() -> None:
    assert analyse_hours().exposure.by_period == ()


def test_a_recording_from_a_sensor_follows_its_diary_too() -> None:
    recording = hold((0, 20), (70, 20), (0, 20)).recording
    analysis = analyse(recording, AnalysisSettings(diary=(DiaryEntry("07:00:40", None, "break"),)))

    assert analysis.exposure.time_above[1].percent == pytest.approx(50.0, abs=2.0)
    assert parts_of(analysis) == {("analysed", "work"): 40_000_000, ("excluded", "break"): 20_000_000}


@st.composite
def diaries(draw: st.DrawFn) -> tuple[DiaryEntry, ...]:
    kinds: list[Kind] = draw(st.lists(st.sampled_from(KINDS), max_size=5, unique=True))
    bounds = [sorted(draw(st.tuples(st.floats(0, 99), st.floats(1, 100)))) for _ in kinds]
    return tuple(DiaryEntry(a, b + 0.5, kind) for (a, b), kind in zip(bounds, kinds, strict=True))


@given(diaries(), st.sampled_from([7, 25, 64]), st.integers(0, 60), st.integers(0, 30))
def test_the_parts_add_up_to_the_recording_to_the_microsecond(
    diary: tuple[DiaryEntry, ...], rate_hz: int, hole_s: int, length_s: int
) -> None:
    hole = slice(1 + hole_s * rate_hz, 1 + (hole_s + length_s) * rate_hz)
    try:
        analysis = analyse_hours(*diary, seconds=100, rate_hz=rate_hz, hole=hole)
    except TooShort:
        reject()

    assert sum(part.duration_us for part in analysis.time.parts) == analysis.time.recorded_us
    assert analysis.time.analysed_us + analysis.time.missing_us + analysis.time.excluded_us == (
        analysis.time.recorded_us
    )


@given(diaries(), st.sampled_from([7, 25, 64]))
def test_the_figures_of_the_periods_cover_the_analysed_time(
    diary: tuple[DiaryEntry, ...], rate_hz: int
) -> None:
    try:
        analysis = analyse_hours(*diary, seconds=100, rate_hz=rate_hz)
    except TooShort:  # nothing at all is left to analyse
        reject()

    told_s = sum(part.analysed_s for part in analysis.exposure.by_period)
    assert not diary or round(told_s * 1e6) == round(analysis.exposure.analysed_s * 1e6)
    missing_us = analysis.time.missing_us
    assert missing_us <= 1  # no sample is lost at the edge of a period
