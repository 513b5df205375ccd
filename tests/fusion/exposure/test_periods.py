"""The rows of a diary find their place on the recording, and the parts of the day make the whole."""

import io
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from acromion.fusion.diary import KINDS, POSTURES, DiaryEntry, Kind, read_diary
from acromion.fusion.errors import TooShort, UnusableDiary, split_facts
from acromion.fusion.exposure.parts import DayDivision
from acromion.fusion.exposure.periods import Period, Placed, divide_day, find_contradictions, place_diary
from acromion.fusion.exposure.resampling import find_intervals
from acromion.fusion.exposure.summary import describe_hours, draw_variation, summarise_exposure
from acromion.fusion.exposure.types import PartExposure
from acromion.fusion.pipeline import Analysis, analyse, analyse_angles
from acromion.fusion.quality import TimePart
from acromion.fusion.settings import AnalysisSettings
from tests.factories import elevate, hold

SECOND = 1_000_000
HOUR = 3600 * SECOND
START = datetime(2026, 3, 2, 7, 0)  # noqa: DTZ001 - a device's own clock


def place(*entries: DiaryEntry, start: datetime | None = START, hours: int = 8) -> Placed:
    return place_diary(entries, start, hours * HOUR)


def refuse(*entries: DiaryEntry, start: datetime | None = START, hours: int = 8) -> dict[str, object]:
    with pytest.raises(UnusableDiary) as refusal:
        place(*entries, start=start, hours=hours)
    return dict(refusal.value.facts)


ZONED = datetime(2027, 3, 14, 0, 0, tzinfo=ZoneInfo("America/Toronto"))
NIGHT = START.replace(hour=22)


@pytest.mark.parametrize(
    ("entries", "start", "hours"),
    [
        ([DiaryEntry("09:00:00", "10:30:00", "task")], START, [(2.0, 3.5)]),
        ([DiaryEntry(5400.0, 7200.0, "task")], None, [(1.5, 2.0)]),
        ([DiaryEntry("23:30:00", "02:00:00", "task")], NIGHT, [(1.5, 4.0)]),
        (
            [DiaryEntry("08:00:00", None, "task"), DiaryEntry("09:00:00", None, "break")],
            START,
            [(1.0, 2.0), (2.0, 8.0)],
        ),
        ([DiaryEntry("06:50:00", "15:30:00", "shift")], START, [(0.0, 8.0)]),
        ([DiaryEntry("01:00:00", "04:00:00", "task")], ZONED, [(1.0, 3.0)]),
        (
            [DiaryEntry("2026-03-02T09:00:00+01:00", "2026-03-02T10:00:00+01:00", "task")],
            START.replace(tzinfo=UTC),
            [(1.0, 2.0)],
        ),
    ],
    ids=[
        "from the first sample", "seconds need no clock", "next day after midnight", "until the next row",
        "cut to the recording", "over a change of clocks", "a time with an offset",
    ],
)  # fmt: skip
def test_the_rows_of_a_diary_have_their_place(
    entries: list[DiaryEntry], start: datetime | None, hours: list[tuple[float, float]]
) -> None:
    placed = place(*entries, start=start)

    assert [(period.start_us / HOUR, period.end_us / HOUR) for period in placed.periods] == hours


def test_rows_outside_the_recording_are_left_aside_with_a_caveat() -> None:
    placed = place(DiaryEntry("08:00:00", "09:00:00", "task"), DiaryEntry("16:00:00", "16:15:00", "break"))

    assert (len(placed.periods), placed.flags[0].code, placed.flags[0].count) == (1, "W-DIARY", 1)


@pytest.mark.parametrize(
    ("entry", "start", "hours", "why"),
    [
        (DiaryEntry("09:00:00", "08:00:00", "task", line=4), START, 8, "end first"),
        (DiaryEntry(20.0, 10.0, "task", line=4), START, 8, "end first"),
        (DiaryEntry("09:00:00", "10:00:00", "task", line=4), None, 8, "no clock"),
        (DiaryEntry("09:00:00", "10:00:00", "task", line=4), START, 30, "which day"),
        (DiaryEntry("2026-03-02T09:00:00Z", None, "task", line=4), START, 8, "zone"),
        (
            DiaryEntry("2025-03-02T09:00:00", "2025-03-02T09:30:00", "task", line=4),
            START,
            8,
            "outside recording",
        ),
    ],
    ids=["ends first", "seconds end first", "no clock", "two days", "no zone", "another year"],
)
def test_a_row_without_a_place_is_refused_with_its_line(
    entry: DiaryEntry, start: datetime | None, hours: int, why: str
) -> None:
    facts = refuse(entry, start=start, hours=hours)

    assert (facts["why"], facts["line"]) == (why, 4)


@pytest.mark.parametrize(
    ("first", "second", "why"),
    [(("09:00:00", None), ("08:00:00", None), "order"), ((0.0, 101.1), (100.0, 150.0), "overlap")],
)
def test_rows_out_of_order_and_two_tasks_at_once_are_refused_at_the_later_line(
    first: tuple[Any, Any], second: tuple[Any, Any], why: str
) -> None:
    facts = refuse(DiaryEntry(*first, "task", line=2), DiaryEntry(*second, "task", line=3))

    assert (facts["why"], facts["line"]) == (why, 3)
    assert why != "overlap" or facts["other"] == 2


def test_rows_of_one_person_for_another_day_are_left_aside_without_a_caveat() -> None:
    rows = [
        DiaryEntry(f"2026-03-{day:02}T08:00:00", f"2026-03-{day:02}T09:00:00", "work", line=day, file="S01")
        for day in (1, 2, 3)
    ]
    late = replace(rows[1], start="2026-03-02T20:00:00", end="2026-03-02T21:00:00")

    assert [period.line for period in place(*rows).periods] == [2]
    assert place(*rows).flags == ()
    assert [flag.count for flag in place(*rows, late).flags] == [1]
    assert [flag.count for flag in place(rows[0], rows[2]).flags] == [2]


def test_rows_with_dates_or_seconds_are_compared_before_a_recording_is_read() -> None:
    rows = (
        DiaryEntry("2026-03-02T08:00:00", "2026-03-02T10:00:00", "task", line=2, file="S01"),
        DiaryEntry("2026-03-02T09:00:00", "2026-03-02T11:00:00", "task", line=3, file="S02"),
        DiaryEntry("2026-03-02T09:00:00", "2026-03-02T11:00:00", "task", line=4, file="S01"),
        DiaryEntry(60.0, 50.0, "break", line=5),
        DiaryEntry("08:00:00", "07:00:00", "break", line=6),
    )

    errors = find_contradictions(rows)

    assert [(error.facts["line"], error.facts["why"]) for error in errors] == [
        (4, "overlap"),
        (5, "end first"),
    ]


def test_lines_that_cannot_be_read_and_lines_that_contradict_each_other_are_named_at_once() -> None:
    rows = ("08:00,09:00,task", "08:30,09:30,task", "25:00,26:00,task", "10:00,10:30,nap")

    with pytest.raises(UnusableDiary) as refusal:
        read_diary("\n".join(("start,end,kind", *rows)).encode(), find_contradictions)

    errors = ((row["line"], row["why"]) for row in split_facts(refusal.value.facts))
    assert sorted(errors) == [(3, "overlap"), (4, "time"), (5, "kind")]


def test_every_line_is_named_if_all_are_outside_the_recording() -> None:
    with pytest.raises(UnusableDiary) as refusal:
        place(
            DiaryEntry("2026-03-09T08:00:00", "2026-03-09T09:00:00", "task", line=2),
            DiaryEntry("2026-03-09T09:00:00", "2026-03-09T09:30:00", "break", line=3),
        )

    assert [row["line"] for row in split_facts(refusal.value.facts)] == [2, 3]


def test_tasks_may_overlap_by_a_rounded_second() -> None:
    placed = place(DiaryEntry(0.0, 101.0, "task"), DiaryEntry(100.0, 150.0, "task"))

    assert len(placed.periods) == 2


@pytest.mark.parametrize(
    ("kind", "left_out", "reason"),
    [
        ("break", None, "break"),
        ("not_worn", None, "not-worn"),
        ("supported", None, ""),
        ("seated", True, "seated"),
        ("supported", True, "supported"),
        ("break", False, ""),
    ],
    ids=["break", "not worn", "supported", "seated, asked for", "supported, asked for", "break, kept"],
)
def test_what_a_kind_means_for_the_time_and_how_a_row_overrides_it(
    kind: Kind, left_out: bool | None, reason: str
) -> None:
    placed = place(DiaryEntry(0.0, 60.0, kind, left_out=left_out))

    assert placed.periods[0].reason == reason


@st.composite
def periods_of(draw: st.DrawFn) -> list[Period]:
    kinds = draw(st.lists(st.sampled_from(KINDS), max_size=6))
    edges = [sorted(draw(st.lists(st.integers(0, 1000), min_size=2, max_size=2, unique=True))) for _ in kinds]
    return [Period(a, b, kind) for (a, b), kind in zip(edges, kinds, strict=True)]


@given(periods_of())
def test_the_pieces_of_a_day_follow_one_another_from_its_beginning_to_its_end(periods: list[Period]) -> None:
    pieces = divide_day(periods, 1000)

    assert [0, *(piece.end_us for piece in pieces)] == [*(piece.start_us for piece in pieces), 1000]


@given(periods_of(), st.integers(0, 999))
def test_each_moment_belongs_to_the_period_laid_on_last(periods: list[Period], moment: int) -> None:
    owner = next(p.period for p in divide_day(periods, 1000) if p.start_us <= moment < p.end_us)

    covering = [KINDS.index(p.kind) for p in periods if p.start_us <= moment < p.end_us]
    assert (owner >= 0) == bool(covering)
    assert not covering or KINDS.index(periods[owner].kind) == max(covering)


@given(st.timedeltas(timedelta(0), timedelta(hours=8)))
def test_the_clock_of_any_moment_leads_back_to_it(after: timedelta) -> None:
    moment = (START + after).time().isoformat()
    (period,) = place(DiaryEntry(moment, None, "task"), hours=9).periods

    assert period.start_us == after // timedelta(microseconds=1)


def test_a_break_over_a_task_is_flagged_with_its_time() -> None:
    entries = (
        DiaryEntry(0.0, 100.0, "task", "a", line=2),
        DiaryEntry(100.0, 200.0, "task", "b", line=3),
        DiaryEntry(90.0, 130.0, "break", line=4),
        DiaryEntry(199.5, 210.0, "not_worn", line=5),
    )

    (flag,) = place_diary(entries, None, 300_000_000).flags
    assert (flag.code, flag.count, flag.seconds) == ("W-OVERLAP", 2, 40.0)
    assert (flag.first_s, flag.last_s) == (90.0, 130.0)
    assert flag.spans_s == ((90.0, 100.0), (100.0, 130.0))


def test_every_row_that_cannot_be_placed_is_told() -> None:
    entries = (
        DiaryEntry(10.0, 5.0, "task", line=2),
        DiaryEntry(20.0, 30.0, "task", line=3),
        DiaryEntry("08:00:00", "09:00:00", "task", line=4),
    )

    with pytest.raises(UnusableDiary) as refusal:
        place_diary(entries, None, 300_000_000)
    facts = refusal.value.facts
    assert (facts["line"], facts["why"], facts["line_2"], facts["why_2"]) == (2, "end first", 4, "no clock")


# What a diary does to an analysis: breaks leave the denominator, nothing is lost, nothing counted twice.

MINUTE = 60_000_000


def analyse_hours(
    *diary: DiaryEntry, seconds: int = 600, rate_hz: int = 10, hole: slice = slice(0, 0)
) -> Analysis:
    """Analyse ready angles: 10 deg, but 70 deg from the second to the fourth minute."""
    rows = np.arange(seconds * rate_hz)
    angle = np.where((rows >= 120 * rate_hz) & (rows < 240 * rate_hz), 70, 10)
    kept = np.delete(rows, hole)
    lines = (f"{i / rate_hz:.6f},{angle[i]}\n" for i in kept)
    table = f"time_s,elevation_deg\n{''.join(lines)}".encode()
    return analyse_angles(io.BytesIO(table), settings=AnalysisSettings(diary=diary))


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
        DiaryEntry(0.0, 180.0, "task", "Boxes"), DiaryEntry(180.0, 300.0, "supported")
    ).exposure.by_period

    assert (first.label, first.analysed_s) == ("Boxes", 180.0)
    assert first.time_above_percent[60] == pytest.approx(100 / 3)
    assert (second.kind, second.time_above_percent[60]) == ("supported", 50.0)
    assert (rest.kind, rest.label, rest.analysed_s, rest.time_above_percent[60]) == ("work", "", 300.0, 0.0)


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
    posture = draw(st.sampled_from(POSTURES))  # two that overlap are refused
    chosen = [kind for kind in KINDS if kind == posture or kind not in POSTURES]
    kinds: list[Kind] = draw(st.lists(st.sampled_from(chosen), max_size=5, unique=True))
    bounds = [sorted(draw(st.tuples(st.floats(0, 99), st.floats(1, 100)))) for _ in kinds]
    return tuple(
        DiaryEntry(a, b + 0.5, kind, "upright" if kind == "posture" else "")
        for (a, b), kind in zip(bounds, kinds, strict=True)
    )


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
    divides = any(entry.kind not in ("pose", "mark", "posture", *POSTURES) for entry in diary)
    assert not divides or round(told_s * 1e6) == round(analysis.exposure.analysed_s * 1e6)
    assert length_s or time.missing_us <= 1  # no sample is lost at the edge of a period


# Parts of the day: tasks pooled from the rows of a diary, and ranges of the differences between hours.

SECOND_US = 1_000_000


def divide(*rows: tuple[int, int, str, str]) -> DayDivision:
    """Divide an hour by rows of (start_s, end_s, label, reason)."""
    periods = tuple(
        Period(start * SECOND_US, end * SECOND_US, "task", label, reason)
        for start, end, label, reason in rows
    )
    return DayDivision(periods, divide_day(periods, 3600 * SECOND_US))


def test_rows_of_one_label_are_one_task_of_their_pooled_time_and_what_no_row_names_is_work() -> None:
    angles = np.full(3600, 100.0)
    angles[:600], angles[1200:1500] = 10.0, 70.0
    division = divide((0, 600, "a", ""), (600, 900, "b", ""), (1200, 1500, "a", ""))

    tasks = summarise_exposure(elevate(angles, rate_hz=1.0), division=division).by_task

    told = [(part.kind, part.label, part.periods, part.recorded_s) for part in tasks]
    assert told == [("task", "a", 2, 900.0), ("task", "b", 1, 300.0), ("work", "", 1, 2400.0)]
    assert round(tasks[0].percentiles_deg[50]) == 10  # two thirds of the pooled time
    assert tasks[0].time_above_percent[60] == pytest.approx(100 / 3)


def test_a_task_has_its_longest_episode_its_rest_and_its_difference_to_the_rest_of_the_shift() -> None:
    angles = np.full(3600, 10.0)
    angles[540:720] = 70.0  # 60 s at the end of the task, 120 s after it
    day = elevate(angles, rate_hz=1.0)

    task, work = summarise_exposure(day, bias_sigma_deg=3.0, division=divide((0, 600, "a", ""))).by_task

    assert (task.episodes_above_60_longest_s, work.episodes_above_60_longest_s) == (60.0, 120.0)
    assert task.recovery_neutral_slow_percent == pytest.approx(90.0, abs=0.5)
    assert task.time_above_60_less_rest_percent == pytest.approx(10.0 - 4.0)
    assert work.time_above_60_less_rest_percent == pytest.approx(4.0 - 10.0)
    known = task.intervals["time_above_60_less_rest_percent"]
    assert known.low < 6.0 < known.high
    assert task.intervals["episodes_above_60_longest_s"].high == pytest.approx(60.0)
    assert task.intervals["recovery_neutral_slow_percent"].low <= 90.0


def test_the_only_task_of_a_day_has_no_rest_of_the_shift() -> None:
    day = elevate(np.full(3600, 70.0), rate_hz=1.0)

    (task,) = summarise_exposure(day, bias_sigma_deg=3.0, division=divide((0, 3600, "a", ""))).by_task

    assert task.time_above_60_less_rest_percent is None
    assert "time_above_60_less_rest_percent" not in task.intervals


def test_a_row_that_is_left_out_is_not_pooled_with_those_that_are_analysed() -> None:
    division = divide((0, 600, "a", ""), (1200, 1500, "a", "task"))
    day = elevate(np.full(3600, 40.0), rate_hz=1.0)
    day.segments[0].valid[1200:1500] = False

    tasks = summarise_exposure(day, division=division).by_task

    told = [(part.label, part.reason, part.recorded_s, part.analysed_s) for part in tasks]
    assert told == [("a", "", 600.0, 600.0), ("a", "task", 300.0, 0.0), ("", "", 2700.0, 2700.0)]


def test_the_ranges_of_the_differences_between_hours_hold_them() -> None:
    # blocks that differ at random: hours drawn again differ more than the hours themselves
    blocks = np.random.default_rng(1).normal(50.0, 8.0, 48)
    exposure = summarise_exposure(elevate(np.repeat(blocks, 300), rate_hz=1.0), bias_sigma_deg=0.0)

    figure = exposure.hour_variation["elevation_p50_deg"]
    spread = exposure.intervals["by_hour_elevation_p50_deg_spread"]
    coefficient = exposure.intervals["by_hour_elevation_p50_deg_coefficient_percent"]
    assert spread.low < figure.spread < spread.high
    assert figure.coefficient_percent is not None
    assert coefficient.low < figure.coefficient_percent < coefficient.high


def test_the_draws_of_a_spread_are_moved_to_lie_about_it() -> None:
    # hours alike but for their sampling: drawn again, they differ more, all 200 times
    drawn = [{"elevation_p50_deg": 40.0 + k * np.linspace(4.0, 6.0, 200)} for k in range(2)]
    hours = [PartExposure("", 0.0, 3600.0, 3600.0, {50: 40.0 + 2 * k}, {60: 0.0}, 0.0) for k in range(2)]
    figures = {"elevation_p50_deg": describe_hours(hours)["elevation_p50_deg"]}

    spread = find_intervals(draw_variation(hours, drawn, figures))["by_hour_elevation_p50_deg_spread"]
    assert (spread.low + spread.high) / 2 == pytest.approx(2.0)
