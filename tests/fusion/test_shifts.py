"""Find the shifts of a recording of several days."""

import re
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

import pytest

from acromion.fusion.clocks import INTERVAL_HINT, parse_interval
from acromion.fusion.diary import DiaryEntry, read_diary
from acromion.fusion.errors import UnusableDiary, UnusableShift
from acromion.fusion.recording import Span
from acromion.fusion.shifts import (
    cut_diary,
    find_by_diary,
    find_by_hours,
    parse_hours,
    propose,
    widen_to_pose,
)

DAY_US = 86_400_000_000
HOUR_US = 3_600_000_000
MONDAY = datetime(2026, 3, 2, 6)  # noqa: DTZ001  the device's clock


def hours_of(start: datetime, days: float, hours: str) -> list[str]:
    return [str(window) for window in find_by_hours(start, round(days * DAY_US), parse_hours(hours))]


def test_each_calendar_day_has_one_shift() -> None:
    assert hours_of(MONDAY, 2.0, "07:00-15:30") == [
        "2026-03-02T07:00:00/2026-03-02T15:30:00",
        "2026-03-03T07:00:00/2026-03-03T15:30:00",
    ]


def test_a_night_shift_ends_on_the_next_day_and_may_begin_before_the_recording() -> None:
    assert hours_of(MONDAY.replace(hour=1), 1.0, "22h-6h") == [
        "2026-03-01T22:00:00/2026-03-02T06:00:00",
        "2026-03-02T22:00:00/2026-03-03T06:00:00",
    ]


def test_a_day_without_a_second_in_these_hours_has_no_shift() -> None:
    assert hours_of(MONDAY.replace(hour=16), 0.5, "07:00-15:30") == []


def test_a_night_in_which_the_clocks_go_forward_is_an_hour_shorter() -> None:
    start = datetime(2026, 3, 7, 12, tzinfo=ZoneInfo("America/Toronto"))

    (night,) = find_by_hours(start, DAY_US, parse_hours("22:00-06:00"))

    first_us, stop_us = night.place(start)
    assert (first_us, stop_us - first_us) == (10 * HOUR_US, 7 * HOUR_US)


PARIS = ZoneInfo("Europe/Paris")
CHANGES = [
    (datetime(2026, 3, 28, 12, tzinfo=PARIS), "never"),
    (datetime(2026, 10, 24, 12, tzinfo=PARIS), "twice"),
]


@pytest.mark.parametrize(("start", "why"), CHANGES)
def test_a_shift_at_a_time_that_the_clocks_skip_or_repeat_cannot_be_placed(start: datetime, why: str) -> None:
    """Of two nights, the clocks change in the first."""
    first, second = find_by_hours(start, 2 * DAY_US, parse_hours("02:30-08:00"))

    with pytest.raises(UnusableShift) as refusal:
        first.place(start)
    assert refusal.value.facts["why"] == why
    assert refusal.value.facts["value"] == f"{first.start:%Y-%m-%d} 02:30:00"
    assert second.place(start)[1] - second.place(start)[0] == 5.5 * HOUR_US


def test_a_window_without_an_offset_follows_the_zone_of_the_recording() -> None:
    """04:00 on the clocks of Paris is three hours after midnight in the night in which they go forward."""
    window = parse_interval("2026-03-29T04:00/2026-03-29T05:00")

    assert window.place(datetime(2026, 3, 29, tzinfo=PARIS)) == (3 * HOUR_US, 4 * HOUR_US)


@pytest.mark.parametrize("text", ["0001-01-01T00:00/2026-03-02T08:00", "2026-03-02T00:00/9999-12-31T23:59"])
def test_a_window_at_the_end_of_the_calendar_is_refused_because_a_zone_would_leave_it(text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(INTERVAL_HINT)):
        parse_interval(text)


@pytest.mark.parametrize(("start", "why"), CHANGES)
def test_every_row_of_a_diary_at_such_a_time_is_named(start: datetime, why: str) -> None:
    night = start.date() + timedelta(days=1)
    diary = diary_of(f"{night} 02:30,{night} 08:00,shift,\n{start.date()} 22:00,02:45,shift,\n")

    with pytest.raises(UnusableDiary) as refusal:
        find_by_diary(diary, start, 2 * DAY_US)

    assert {refusal.value.facts[name] for name in ("line", "line_2")} == {2, 3}
    assert {refusal.value.facts[name] for name in ("why", "why_2")} == {why}


def test_a_shift_of_the_diary_with_its_offset_lasts_until_the_clock_time_after_the_change() -> None:
    start = datetime(2026, 10, 24, 12, tzinfo=PARIS)

    (night,) = find_by_diary(diary_of("2026-10-25 02:30+02:00,08:00,shift,\n"), start, DAY_US)

    assert str(night) == "2026-10-25T02:30:00+02:00/2026-10-25T08:00:00+01:00"


@pytest.mark.parametrize("text", ["", "07:00", "7-25:00", "07:00-09:00-11:00", "soon-later", "07:00-07:00"])
def test_what_are_no_hours_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_hours(text)


def diary_of(rows: str) -> tuple[DiaryEntry, ...]:
    return read_diary(f"start,end,kind,label\n{rows}".encode())


def test_the_shift_rows_of_a_diary_are_the_shifts() -> None:
    diary = diary_of(
        "2026-03-02 07:00,2026-03-02 15:00,shift,\n2026-03-02 09:00,2026-03-02 10:00,task,Boxes\n"
        "2026-03-03 22:00,2026-03-04 06:00,shift,\n"
    )

    assert [str(window) for window in find_by_diary(diary, MONDAY, 7 * DAY_US)] == [
        "2026-03-02T07:00:00/2026-03-02T15:00:00",
        "2026-03-03T22:00:00/2026-03-04T06:00:00",
    ]


def test_without_shift_rows_each_date_is_a_shift_from_its_first_start_to_its_last_end() -> None:
    diary = diary_of(
        "2026-03-02 07:30,2026-03-02 09:00,task,A\n2026-03-02 10:00,2026-03-02 12:00,task,B\n"
        "2026-03-03 08:00,2026-03-03 09:00,task,A\n12:00,12:30,break,\n"
    )

    assert [str(window) for window in find_by_diary(diary, MONDAY, 7 * DAY_US)] == [
        "2026-03-02T07:30:00/2026-03-02T12:00:00",
        "2026-03-03T08:00:00/2026-03-03T09:00:00",
    ]


def windows_of(rows: str) -> list[str]:
    return [str(window) for window in find_by_diary(diary_of(rows), MONDAY, 7 * DAY_US)]


def test_a_row_without_an_end_lasts_until_the_next_row() -> None:
    """The layout of ActiPASS: work, lunch, work, stop."""
    diary = read_diary(
        b"time,event\n2026-03-02 07:00,work\n2026-03-02 12:00,lunch\n2026-03-02 12:30,work\n"
        b"2026-03-02 15:30,stop\n2026-03-03 08:00,work\n2026-03-03 16:00,stop\n"
    )

    assert [str(window) for window in find_by_diary(diary, MONDAY, 7 * DAY_US)] == [
        "2026-03-02T07:00:00/2026-03-02T15:30:00",
        "2026-03-03T08:00:00/2026-03-03T16:00:00",
    ]


@pytest.mark.parametrize(
    "rows",
    [
        "2026-03-02 07:00,,work,\n",
        "2026-03-02 07:00,,work,\n2026-03-03 07:00,2026-03-03 15:00,work,\n",
        "2026-03-02 07:00,,shift,\n2026-03-02 09:00,2026-03-02 10:00,task,Boxes\n",
    ],
    ids=["last row", "next row a day later", "shift"],
)
def test_a_row_whose_end_nobody_stated_is_refused_with_its_line(rows: str) -> None:
    with pytest.raises(UnusableDiary) as refusal:
        windows_of(rows)

    assert (refusal.value.facts["line"], refusal.value.facts["why"]) == (2, "no end")


@pytest.mark.parametrize(
    "row",
    ["2026-03-02 21:00,,mark,pain", "2026-03-02 22:00,23:00,outside,", "2026-03-02 16:00,17:00,not_worn,"],
)
def test_what_is_not_work_extends_no_shift(row: str) -> None:
    assert windows_of(f"2026-03-02 07:00,2026-03-02 15:00,task,A\n{row}\n") == [
        "2026-03-02T07:00:00/2026-03-02T15:00:00"
    ]


def test_shifts_that_overlap_are_refused_with_both_lines() -> None:
    with pytest.raises(UnusableDiary) as refusal:
        windows_of("2026-03-02 07:00,12:00,shift,\n2026-03-02 11:00,16:00,shift,\n")

    assert (refusal.value.facts["line"], refusal.value.facts["other"]) == (3, 2)


def test_a_night_is_one_shift_and_the_next_night_another() -> None:
    nights = "".join(
        f"2026-03-0{day} 22:00,2026-03-0{day + 1} 02:00,task,A\n"
        f"2026-03-0{day + 1} 02:30,2026-03-0{day + 1} 06:00,task,B\n"
        for day in (2, 3)
    )

    assert windows_of(nights) == [
        "2026-03-02T22:00:00/2026-03-03T06:00:00",
        "2026-03-03T22:00:00/2026-03-04T06:00:00",
    ]


def test_hours_without_samples_have_no_shift() -> None:
    """The device was off from Monday 20:00 to Wednesday 06:00."""
    covered_us = ((0, 14 * HOUR_US), (48 * HOUR_US, 72 * HOUR_US))

    windows = find_by_hours(MONDAY, 3 * DAY_US, parse_hours("07:00-15:30"), covered_us)

    assert [window.start.day for window in windows] == [2, 4]


@pytest.mark.parametrize(
    ("begins_us", "begin_us"),
    [
        ((7 * HOUR_US,), 7 * HOUR_US),
        ((7 * HOUR_US, 9 * HOUR_US), 8 * HOUR_US),
        ((5 * HOUR_US,), 8 * HOUR_US),
        ((), 8 * HOUR_US),
    ],
    ids=["an hour before", "another pose in the shift", "three hours before", "no pose"],
)
def test_a_shift_begins_at_a_pose_held_up_to_two_hours_before(
    begins_us: tuple[int, ...], begin_us: int
) -> None:
    assert widen_to_pose(8 * HOUR_US, 16 * HOUR_US, 0, begins_us) == begin_us


def test_a_pose_of_the_shift_before_leaves_a_shift_unchanged() -> None:
    assert widen_to_pose(8 * HOUR_US, 16 * HOUR_US, 7 * HOUR_US + 1, (7 * HOUR_US,)) == 8 * HOUR_US


def test_a_mark_is_in_the_shift_of_its_moment_only() -> None:
    diary = diary_of("2026-03-02 07:30,,mark,pain\n2026-03-02 16:00,2026-03-02 17:00,task,A\n")

    kept = [cut_diary(diary, MONDAY, DAY_US, hour * HOUR_US, (hour + 1) * HOUR_US) for hour in (1, 9, 10)]

    assert [[entry.kind for entry in rows] for rows in kept] == [["mark"], [], ["task"]]


def test_a_diary_without_dates_has_no_shifts() -> None:
    assert find_by_diary(diary_of("07:00,15:00,shift,\n"), MONDAY, 7 * DAY_US) == ()


def test_a_shift_has_its_own_rows_of_the_diary_and_those_without_a_date() -> None:
    diary = diary_of(
        "2026-03-02 09:00,2026-03-02 10:00,task,Monday\n2026-03-03 09:00,2026-03-03 10:00,task,Tuesday\n"
        "12:00,12:30,break,\n"
    )

    kept = cut_diary(diary, MONDAY, 7 * DAY_US, 25 * HOUR_US, 33 * HOUR_US)

    assert [entry.label or entry.kind for entry in kept] == ["Tuesday", "break"]


def test_seconds_of_the_diary_become_clock_times_in_a_shift() -> None:
    rows = (DiaryEntry(60.0, 70.0, "pose"), DiaryEntry(3660.0, 3670.0, "pose"))

    kept = cut_diary(rows, MONDAY, 2 * HOUR_US, HOUR_US, 2 * HOUR_US)

    assert [(entry.start, entry.end) for entry in kept] == [("2026-03-02T07:01:00", "2026-03-02T07:01:10")]


def test_wear_between_long_stretches_off_the_arm_is_proposed_as_shifts() -> None:
    off = [Span(9 * HOUR_US, 15 * HOUR_US), Span(28 * HOUR_US, HOUR_US), Span(33 * HOUR_US, 15 * HOUR_US)]

    assert [str(window) for window in propose(off, MONDAY, 2 * DAY_US)] == [
        "2026-03-02T06:00:00/2026-03-02T15:00:00",
        "2026-03-03T06:00:00/2026-03-03T15:00:00",
    ]
