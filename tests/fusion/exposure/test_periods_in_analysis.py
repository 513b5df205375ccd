"""What a diary does to an analysis: breaks leave the denominator, nothing is lost, nothing counted twice."""

import io

import numpy as np
import pytest
from hypothesis import given, reject, settings
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


def test_a_break_leaves_the_denominator_and_its_angle_stays_valid() -> None:
    analysis = analyse_hours(DiaryEntry(0.0, 120.0, "break"))

    assert analysis.exposure.time_above[1].percent == pytest.approx(25.0)  # 2 of 8 minutes
    assert all(segment.valid.all() for segment in analysis.elevation.segments)


def test_a_stay_ends_at_a_break_and_the_arm_that_is_up_after_it_has_not_come_up_again() -> None:
    exposure = analyse_hours(DiaryEntry(180.0, 200.0, "break")).exposure

    stays = exposure.episodes[1]
    assert (stays.count, stays.longest_s, stays.censored) == (2, 60.0, 1)
    assert exposure.entries[1].count == 1


def test_each_period_has_its_figures() -> None:
    first, second, rest = analyse_hours(
        DiaryEntry(0.0, 180.0, "task", "Boxes"), DiaryEntry(180.0, 300.0, "seated")
    ).exposure.by_period

    assert (first.label, first.analysed_s) == ("Boxes", 180.0)
    assert first.percent_above[60] == pytest.approx(100 / 3)
    assert (second.kind, second.percent_above[60]) == ("seated", 50.0)
    assert (rest.kind, rest.label, rest.analysed_s, rest.percent_above[60]) == ("work", "", 300.0, 0.0)


def test_a_task_that_a_break_cuts_is_told_once_with_the_time_that_is_left() -> None:
    diary = DiaryEntry(60.0, 300.0, "task"), DiaryEntry(120.0, 180.0, "break")

    task, pause, _ = analyse_hours(*diary).exposure.by_period

    assert (task.start_s, task.end_s, task.recorded_s, task.analysed_s) == (60.0, 300.0, 180.0, 180.0)
    assert (pause.reason, pause.recorded_s, pause.analysed_s) == ("break", 60.0, 0.0)
    assert pause.percentiles_deg == {}


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


@pytest.mark.parametrize(("start_s", "missing_s"), [(300.0, 0), (0.0, 20)], ids=["in a break", "at work"])
def test_a_hole_is_missing_at_work_and_part_of_a_break_in_it(start_s: float, missing_s: int) -> None:
    analysis = analyse_hours(DiaryEntry(start_s, start_s + 100.0, "break"), hole=slice(3200, 3400))

    assert analysis.time.missing_us == missing_s * 1_000_000
    assert parts_of(analysis)["analysed", "work"] == (500 - missing_s) * 1_000_000


@pytest.mark.parametrize(
    ("shift_s", "hole", "told"), [(200.0, slice(0, 0), False), (400.0, slice(100, 2500), True)]
)
def test_the_coverage_is_that_of_the_shift(shift_s: float, hole: slice, told: bool) -> None:
    analysis = analyse_hours(DiaryEntry(0.0, shift_s, "shift"), hole=hole)

    assert ("W-LOWCOVER" in [flag.code for flag in analysis.quality.flags]) is told


def test_without_a_diary_all_analysed_time_is_work_without_periods() -> None:
    analysis = analyse_hours()

    assert parts_of(analysis) == {("analysed", "work"): 10 * MINUTE}
    assert analysis.exposure.by_period == ()


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


@settings(max_examples=40, deadline=None)
@given(diaries(), st.sampled_from([7, 25, 64]), st.integers(0, 60), st.integers(0, 30))
def test_the_parts_add_up_to_the_recording_to_the_microsecond(
    diary: tuple[DiaryEntry, ...], rate_hz: int, hole_s: int, length_s: int
) -> None:
    hole = slice(1 + hole_s * rate_hz, 1 + (hole_s + length_s) * rate_hz)
    try:
        analysis = analyse_hours(*diary, seconds=100, rate_hz=rate_hz, hole=hole)
    except TooShort:
        reject()

    time = analysis.time
    told_s = sum(part.analysed_s for part in analysis.exposure.by_period)
    assert sum(part.duration_us for part in time.parts) == time.recorded_us
    assert time.analysed_us + time.missing_us + time.excluded_us == time.recorded_us
    assert not diary or round(told_s * 1e6) == round(analysis.exposure.analysed_s * 1e6)
    assert length_s or time.missing_us <= 1  # no sample is lost at the edge of a period
