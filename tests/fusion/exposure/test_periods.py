"""The rows of a diary find their place on the recording, and the parts of the day make the whole."""

from datetime import UTC, datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fusion.diary import KINDS, DiaryEntry, Kind
from fusion.errors import UnusableDiary
from fusion.exposure.periods import Period, Placed, divide_day, place_diary

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


def test_tasks_may_overlap_by_a_rounded_second() -> None:
    placed = place(DiaryEntry(0.0, 101.0, "task"), DiaryEntry(100.0, 150.0, "task"))

    assert len(placed.periods) == 2


def test_a_break_within_a_task_cuts_it_and_what_no_row_names_is_work() -> None:
    pieces = divide_day([Period(0, 100, "task"), Period(40, 60, "break", reason="break")], 180)

    assert [(p.end_us, p.period, p.reason) for p in pieces] == [
        (40, 0, ""), (60, 1, "break"), (100, 0, ""), (180, -1, ""),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("kind", "left_out", "reason"),
    [
        ("break", None, "break"),
        ("not_worn", None, "not-worn"),
        ("seated", None, ""),
        ("supported", True, "supported"),
        ("break", False, ""),
    ],
    ids=["break", "not worn", "seated", "supported, asked for", "break, kept"],
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
