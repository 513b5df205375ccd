"""Stated clocks: a time zone, its changes inside a recording, a device set to the wrong time.

Paris, 2026: 29 March 02:00 becomes 03:00, 25 October 03:00 becomes 02:00, both at 01:00 UTC. Toronto, 2026:
8 March 02:00 becomes 03:00 (07:00 UTC), 1 November 02:00 becomes 01:00 (06:00 UTC).
"""

from datetime import UTC, datetime

import pytest

from acromion.fusion.clocks import (
    correct_start,
    find_instants,
    find_time_zone,
    format_clock_offset,
    list_zone_changes,
    measure_us,
    parse_clock_offset,
    parse_time_zone,
    read_clock,
)
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.errors import UnusableClock, UnusableDiary
from acromion.fusion.exposure.parts import split_hours
from acromion.fusion.exposure.periods import place_diary, place_moment
from acromion.fusion.readers.time.clock import set_clock
from acromion.fusion.recording import QualityFlag, Recording

HOUR_US = 3_600_000_000
PARIS, TORONTO = "Europe/Paris", "America/Toronto"
NIGHTS = [
    # the evening before a change, by a device without an offset; hours until the change; its step in s
    ("2026-03-28T22:00", PARIS, 4, 3600),
    ("2026-10-24T22:00", PARIS, 5, -3600),
    ("2026-03-07T22:00", TORONTO, 4, 3600),
    ("2026-10-31T22:00", TORONTO, 4, -3600),
]


def record(start: str | None, hours: float = 10.0, *flags: str) -> Recording:
    return Recording(
        device="other",
        sha256="",
        start=datetime.fromisoformat(start) if start else None,
        time_zone=None,
        duration_us=round(hours * HOUR_US),
        segments=(),
        flags=tuple(map(QualityFlag, flags)),
    )


def start_of(recording: Recording) -> datetime:
    assert recording.start is not None
    return recording.start


def read(recording: Recording, hours: float) -> str:
    return read_clock(start_of(recording), round(hours * HOUR_US)).isoformat(timespec="minutes")


@pytest.mark.parametrize(("start", "zone", "hours", "step_s"), NIGHTS)
def test_a_change_inside_a_recording_is_flagged_at_its_second(
    start: str, zone: str, hours: int, step_s: int
) -> None:
    (flag,) = set_clock(record(start), zone).flags

    assert (flag.code, flag.first_s) == ("W-DST", hours * 3600.0)
    assert flag.facts == {"step_s": step_s, "zone": zone}


@pytest.mark.parametrize(
    ("start", "zone", "before", "after", "end"),
    [
        ("2026-03-28T22:00", PARIS, "29T01:30+01:00", "29T03:30+02:00", "29T09:00+02:00"),
        ("2026-10-24T22:00", PARIS, "25T01:30+02:00", "25T02:30+02:00", "25T07:00+01:00"),
        ("2026-03-07T22:00", TORONTO, "08T01:30-05:00", "08T03:30-04:00", "08T09:00-04:00"),
        ("2026-10-31T22:00", TORONTO, "01T01:30-04:00", "01T01:30-05:00", "01T07:00-05:00"),
    ],
)
def test_clock_times_after_a_change_follow_the_zone(
    start: str, zone: str, before: str, after: str, end: str
) -> None:
    recording = set_clock(record(start), zone)

    assert [read(recording, hours)[8:] for hours in (3.5, 4.5, 10.0)] == [before, after, end]


@pytest.mark.parametrize(("start", "zone", "hours", "step_s"), NIGHTS)
def test_a_zone_changes_no_duration(start: str, zone: str, hours: int, step_s: int) -> None:
    assert set_clock(record(start), zone).duration_us == 10 * HOUR_US


def test_a_start_without_an_offset_is_local_time_of_the_zone() -> None:
    assert read(set_clock(record("2026-07-01T08:00"), PARIS), 0) == "2026-07-01T08:00+02:00"


def test_a_start_with_an_offset_is_converted_to_the_zone() -> None:
    recording = set_clock(record("2026-07-01T06:00+00:00", 8.0, "W-UTC", "W-GAP"), PARIS)

    assert read(recording, 0) == "2026-07-01T08:00+02:00"
    assert [flag.code for flag in recording.flags] == ["W-GAP"]  # its times are no longer UTC


def test_without_a_statement_nothing_changes() -> None:
    recording = record("2026-03-28T22:00", 10.0, "W-UTC")

    assert set_clock(recording) is recording


def test_a_change_that_the_reader_has_found_is_flagged_once() -> None:
    flags = set_clock(record("2026-03-28T22:00", 10.0, "W-DST"), PARIS).flags

    assert [flag.code for flag in flags] == ["W-DST"]


def test_two_changes_in_a_long_recording_are_both_found() -> None:
    start = datetime(2026, 3, 28, 22, tzinfo=find_time_zone(PARIS))
    hours_to_october = 210 * 24 + 4  # from 28 March 21:00 UTC to 25 October 01:00 UTC

    changes = list_zone_changes(start, 220 * 24 * HOUR_US)

    assert changes == [(4 * 3600.0, 3600), (hours_to_october * 3600.0, -3600)]


# The correction of a device that was set to the wrong time.


def test_a_device_62_minutes_fast_is_set_back() -> None:
    recording = set_clock(record("2026-03-02T09:00"), clock_offset_s=-62 * 60)

    assert recording.start == datetime(2026, 3, 2, 7, 58)  # noqa: DTZ001
    assert recording.clock_offset_s == -3720.0
    (flag,) = recording.flags
    assert (flag.code, flag.facts) == ("W-CLOCK-SET", {"offset": "-1:02:00"})


def test_the_clock_is_corrected_before_the_zone_applies() -> None:
    """03:02 on the device is 02:00 CET, which the clocks of Paris show as 03:00."""
    with pytest.raises(UnusableClock) as refused:
        set_clock(record("2026-03-29T03:02"), PARIS, -62 * 60)
    assert (refused.value.facts["why"], refused.value.facts["value"]) == ("never", "2026-03-29 02:00:00")

    assert read(set_clock(record("2026-03-29T04:02"), PARIS, -62 * 60), 0) == "2026-03-29T03:00+02:00"


def test_a_statement_applies_once() -> None:
    once = set_clock(record("2026-03-02T09:00"), PARIS, -62 * 60)

    assert set_clock(once, PARIS, -62 * 60) is once


def test_a_correction_across_a_change_of_the_zone_is_true_time() -> None:
    start = correct_start(datetime.fromisoformat("2026-03-29T03:30+02:00"), PARIS, -3600)

    assert start is not None
    assert start.isoformat() == "2026-03-29T01:30:00+01:00"


@pytest.mark.parametrize(
    ("start", "zone", "offset_s", "why"),
    [
        ("2026-10-25T02:30", PARIS, 0.0, "twice"),
        ("2026-11-01T01:30", TORONTO, 0.0, "twice"),
        ("2026-03-29T02:30", PARIS, 0.0, "never"),
        ("2026-03-08T02:30", TORONTO, 0.0, "never"),
        (None, "", -3720.0, "unset"),
        ("2026-03-02T09:00", "", 1e10, "year"),
        ("2026-03-02T09:00", "", -1e15, "year"),
    ],
)
def test_a_clock_that_cannot_be_set_is_refused(
    start: str | None, zone: str, offset_s: float, why: str
) -> None:
    with pytest.raises(UnusableClock) as refused:
        set_clock(record(start), zone, offset_s)

    assert refused.value.facts["why"] == why


def test_a_zone_for_a_file_without_a_clock_changes_nothing() -> None:
    recording = record(None)

    assert set_clock(recording, PARIS) is recording


# Clock times of a diary, across a change.


def place(moment: str, start: str, zone: str, hours: float = 10.0) -> float:
    recording = set_clock(record(start, hours), zone)
    return place_moment(moment, 7, recording.start, recording.duration_us) / HOUR_US


@pytest.mark.parametrize(
    ("moment", "start", "zone", "hours"),
    [
        ("01:30", "2026-03-28T22:00", PARIS, 3.5),
        ("03:30", "2026-03-28T22:00", PARIS, 4.5),
        ("06:00", "2026-03-28T22:00", PARIS, 7.0),
        ("01:30", "2026-10-24T22:00", PARIS, 3.5),
        ("03:00", "2026-10-24T22:00", PARIS, 6.0),
        ("06:00", "2026-10-24T22:00", PARIS, 9.0),
        ("2026-10-25 02:30+02:00", "2026-10-24T22:00", PARIS, 4.5),
        ("2026-10-25 02:30+01:00", "2026-10-24T22:00", PARIS, 5.5),
        ("03:30", "2026-03-07T22:00", TORONTO, 4.5),
        ("00:30", "2026-10-31T22:00", TORONTO, 2.5),
        ("02:30", "2026-10-31T22:00", TORONTO, 5.5),
    ],
)
def test_a_clock_time_after_a_change_is_placed_by_the_zone(
    moment: str, start: str, zone: str, hours: float
) -> None:
    assert place(moment, start, zone) == hours


@pytest.mark.parametrize(
    ("moment", "start", "zone", "why", "cure"),
    [
        ("02:30", "2026-10-24T22:00", PARIS, "twice", "offset"),
        ("2026-10-25 02:30", "2026-10-24T22:00", PARIS, "twice", "offset"),
        ("01:30", "2026-10-31T22:00", TORONTO, "twice", "offset"),
        ("02:30", "2026-03-28T22:00", PARIS, "never", "never"),
        ("02:30", "2026-03-07T22:00", TORONTO, "never", "never"),
    ],
)
def test_a_clock_time_that_exists_twice_or_never_is_refused(
    moment: str, start: str, zone: str, why: str, cure: str
) -> None:
    with pytest.raises(UnusableDiary) as refused:
        place(moment, start, zone)

    facts = refused.value.facts
    assert (facts["line"], facts["why"], facts["cure"]) == (7, why, cure)


def test_an_ambiguous_time_of_another_day_refuses_nothing() -> None:
    """02:30 on the Saturday; on the Sunday, after this recording, it exists twice."""
    assert place("02:30", "2026-10-24T00:00", PARIS, 12.0) == 2.5


def test_a_task_over_a_change_keeps_its_true_length() -> None:
    recording = set_clock(record("2026-10-24T22:00"), PARIS)
    placed = place_diary([DiaryEntry("01:00", "04:00", "task")], recording.start, recording.duration_us)

    (period,) = placed.periods
    assert (period.end_us - period.start_us) / HOUR_US == 4.0


def test_the_hours_of_the_day_follow_the_zone() -> None:
    spring = set_clock(record("2026-03-28T22:00", 8.0), PARIS)
    autumn = set_clock(record("2026-10-24T22:00", 8.0), PARIS)

    labels = [split_hours(one.start, one.duration_us).labels for one in (spring, autumn)]
    assert [[label[11:13] for label in one] for one in labels] == [
        ["22", "23", "00", "01", "03", "04", "05", "06"],
        ["22", "23", "00", "01", "02", "02", "03", "04"],
    ]
    assert labels[1][3:7] == (
        "2026-10-25T01:00",
        "2026-10-25T02:00+02:00",
        "2026-10-25T02:00+01:00",
        "2026-10-25T03:00",
    )


def test_the_time_between_two_starts_of_one_zone_is_true_time() -> None:
    zone = find_time_zone(PARIS)
    first, second = datetime(2026, 3, 29, 1, tzinfo=zone), datetime(2026, 3, 29, 4, tzinfo=zone)

    assert measure_us(first, second) == 2 * HOUR_US


def test_a_start_with_and_one_without_an_offset_are_readings_of_one_clock() -> None:
    first, second = datetime(2026, 3, 2, 8), datetime(2026, 3, 2, 9, tzinfo=UTC)  # noqa: DTZ001

    assert measure_us(first, second) == HOUR_US


# Names and forms.


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Europe/Paris", "Europe/Paris"),
        (" europe/paris ", "Europe/Paris"),
        ("America/Toronto", "America/Toronto"),
        ("UTC", "UTC+00:00"),
        ("UTC-05:00", "UTC-05:00"),
        ("+05:30", "UTC+05:30"),
        ("", ""),
    ],
)
def test_a_zone_is_a_place_or_an_offset(text: str, name: str) -> None:
    assert parse_time_zone(text) == name


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("Paris", "Europe/Paris"),
        ("Toronto", "America/Toronto"),
        ("Europe/Pari", "Europe/Paris"),
        ("EST", "Europe/Paris, America/Toronto, UTC-05:00"),
        ("Europe", "Europe/Paris, America/Toronto, UTC-05:00"),
        ("GMT+1", "^UTC[+]01:00$"),
        ("UTC-5", "^UTC-05:00$"),
        ("gmt -05:00", "^UTC-05:00$"),
        ("UTC-00:00:01", "Europe/Paris, America/Toronto, UTC-05:00"),
        ("../etc/passwd", "Europe/Paris, America/Toronto, UTC-05:00"),
        ("UTC+15:00", "Europe/Paris, America/Toronto, UTC-05:00"),
    ],
)
def test_an_unknown_zone_is_refused_with_the_nearest(text: str, hint: str) -> None:
    with pytest.raises(ValueError, match=hint):
        parse_time_zone(text)


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("-1h02m", -3720.0),
        ("\u22121 h 02 min", -3720.0),
        ("-1h02", -3720.0),
        ("-62m", -3720.0),
        ("-1:02:00", -3720.0),
        ("-1:02", -3720.0),
        ("-3720", -3720.0),
        ("-1:00:00", -3600.0),
        ("+0:00:01.5", 1.5),
        ("90s", 90.0),
        ("2d", 172_800.0),
        ("0", 0.0),
    ],
)
def test_a_correction_is_read_in_each_form(text: str, seconds: float) -> None:
    assert parse_clock_offset(text) == seconds


@pytest.mark.parametrize(
    "text", ["", "-", "1:2:3:4", "an hour", "1:75", "--5", "1h 2x", "nan", "1e3", "1000:00:00", "360000"]
)
def test_another_form_of_a_correction_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="-1h02m"):
        parse_clock_offset(text)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (-3720.0, "-1:02:00"),
        (1.5, "+0:00:01.5"),
        (172_800.0, "+48:00:00"),
        (-820_450_801.5, "-9495d23h0m1.5s"),
        (0.0, ""),
    ],
)
def test_a_correction_is_written_as_it_is_read(seconds: float, text: str) -> None:
    assert format_clock_offset(seconds) == text
    assert not text or parse_clock_offset(text) == seconds


@pytest.mark.parametrize(
    ("moment", "count"),
    [("2026-10-25T02:30", 2), ("2026-03-29T02:30", 0), ("2026-03-29T03:00", 1), ("2026-10-25T03:00", 1)],
)
def test_the_clocks_of_paris_show_a_time_so_often(moment: str, count: int) -> None:
    zone = find_time_zone(PARIS)
    assert zone is not None
    assert len(find_instants(datetime.fromisoformat(moment), zone)) == count
