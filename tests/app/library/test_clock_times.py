"""Moments as people type them on the page: what is written is read again, what cannot be is refused."""

from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.app.errors import BadParameter
from acromion.app.http.pages.recording.day import (
    DayClock,
    build_hours,
    correct_request,
    place_rows,
    read_rows,
    write_csv,
)
from acromion.app.http.pages.recording.figures import compare_tasks
from acromion.app.request import ReportRequest
from acromion.fusion.diary import read_diary
from acromion.fusion.errors import UnusableCalibration, UnusableDiary
from tests.app.report.report_reading import plain

START = datetime(2026, 3, 2, 22, tzinfo=timezone(timedelta(hours=-5)))
NIGHT = DayClock(START, 8 * 3600 * 1_000_000)
TWO_DAYS = DayClock(START, 48 * 3600 * 1_000_000)
WITHOUT = DayClock(None, 3600 * 1_000_000)
SPRING, AUTUMN = (  # the clocks of Paris change 4 h and 5 h after the first sample
    DayClock.of({"start": start, "time_zone": "Europe/Paris", "duration_us": 10 * 3600 * 1_000_000})
    for start in ("2026-03-28T22:00:00+01:00", "2026-10-24T22:00:00+02:00")
)
FORM = {"pose": ["n-pose"], "side": ["left"], "subject": ["S012"]}


@settings(max_examples=50)
@given(st.integers(0, 359_999))
def test_a_moment_that_was_written_is_read_again(hundredths: int) -> None:
    second = hundredths / 100

    for clock in (NIGHT, TWO_DAYS, WITHOUT):
        assert clock.read(clock.format(second), "window") == pytest.approx(second, abs=0.006)


@pytest.mark.parametrize(
    ("clock", "elapsed_h", "field", "shown"),
    [
        (SPRING, 4.0, "03:00:00", "2026-03-29 03:00:00"),
        (SPRING, 8.0, "07:00:00", "2026-03-29 07:00:00"),
        (AUTUMN, 4.5, "2026-10-25 02:30:00+02:00", "2026-10-25 02:30:00 UTC+2"),
        (AUTUMN, 5.5, "2026-10-25 02:30:00+01:00", "2026-10-25 02:30:00 UTC+1"),
        (AUTUMN, 6.0, "03:00:00", "2026-10-25 03:00:00"),
    ],
)
def test_moments_after_a_change_of_the_zone_follow_it(
    clock: DayClock, elapsed_h: float, field: str, shown: str
) -> None:
    assert (clock.format(elapsed_h * 3600), plain(clock.show(elapsed_h * 3600, "en"))) == (field, shown)
    assert clock.read(field, "window") == elapsed_h * 3600


def test_a_moment_that_the_zone_shows_twice_is_refused_with_both_readings() -> None:
    with pytest.raises(BadParameter) as refusal:
        AUTUMN.read("02:30", "window")

    assert refusal.value.facts["allowed"] == "2026-10-25 02:30:00+02:00, 2026-10-25 02:30:00+01:00"


def test_the_timeline_is_told_the_changes_of_the_zone() -> None:
    assert (SPRING.changes, AUTUMN.changes) == ([(14_400.0, 3600)], [(18_000.0, -3600)])
    assert (NIGHT.changes, WITHOUT.changes) == ([], [])


def test_the_form_states_the_zone_and_the_correction_of_the_clock() -> None:
    stated = FORM | {"time_zone": ["europe/paris"], "clock_offset": ["-1h02m"]}

    request = correct_request(ReportRequest("a.gt3x"), stated, NIGHT)

    assert (request.time_zone, request.clock_offset_s) == ("Europe/Paris", -3720.0)
    emptied = correct_request(request, FORM | {"time_zone": [""], "clock_offset": [""]}, NIGHT)
    assert (emptied.time_zone, emptied.clock_offset_s) == ("", 0.0)


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("time_zone", "Paris", "Europe/Paris"),
        ("clock_offset", "an hour", "-1h02m, -1:02:00, -3720 (s), >= 100 h: 4d4h"),
    ],
)
def test_a_clock_that_the_form_cannot_state_is_refused_with_what_it_can(
    field: str, value: str, allowed: str
) -> None:
    with pytest.raises(BadParameter) as refusal:
        correct_request(
            ReportRequest("a.gt3x"),
            FORM | {"time_zone": [""], "clock_offset": [""]} | {field: [value]},
            NIGHT,
        )

    assert (refusal.value.facts["name"], refusal.value.facts["allowed"]) == (field, allowed)


def test_periods_keep_their_clock_time_when_the_clock_is_corrected() -> None:
    rows = {"start": ["21:30"], "end": ["22:30"], "kind": ["task"], "label": [""]}
    stated = {"time_zone": [""], "clock_offset": ["-1:02:00"]}

    request = correct_request(ReportRequest("a.gt3x"), FORM | rows | stated, NIGHT)

    assert [(row.start, row.end) for row in request.diary] == [("21:30:00", "22:30:00")]


def test_after_midnight_an_hour_is_of_the_next_day() -> None:
    assert NIGHT.read("01:30:00", "window") == 3.5 * 3600
    assert TWO_DAYS.format(0.0) == "2026-03-02 22:00:00"  # where an hour may mean two days


def test_a_moment_is_shown_as_its_language_spells_it_with_its_date_if_the_recording_spans_midnight() -> None:
    morning = DayClock(START.replace(hour=7), 3600 * 1_000_000)
    assert morning.show(305, "en") == "07:05:05"
    assert plain(morning.show(305, "fr")) == "7 h 05 min 05 s"
    assert NIGHT.show(305, "en") == "2026-03-02 22:05:05"
    assert plain(TWO_DAYS.show_span(0.0, 60.4, "fr-CA")) == (
        "2026-03-02 22 h 00 min 00 s – 2026-03-02 22 h 01 min 00 s"
    )
    assert WITHOUT.show(12.5, "fr") == "12.5"


@pytest.mark.parametrize("text", ["", "soon", "12:00:00", "21:30", "25:00", "<b>"])
def test_what_is_no_moment_of_the_recording_is_refused_with_what_is(text: str) -> None:
    with pytest.raises(BadParameter) as refusal:
        NIGHT.read(text, "window")

    assert refusal.value.facts["allowed"] == "22:00:00 … 06:00:00"


def test_a_form_becomes_the_request_of_the_next_analysis() -> None:
    rows = {
        "start": ["23:00:00", ""],
        "end": ["23:15:00", ""],
        "kind": ["break", "task"],
        "label": ["tea", ""],
    }
    form = FORM | rows | {"window_start": ["22:00:05"], "window_end": ["22:00:12,5"]}

    request = correct_request(ReportRequest("a.gt3x", rate_hz=100.0), form, NIGHT)

    assert (request.subject, request.side, request.rate_hz) == ("S012", "left", 100.0)
    assert request.calibration_windows_s == ((5.0, 12.5),)
    assert [(entry.kind, entry.label) for entry in request.diary] == [("break", "tea")]


def test_the_pose_held_again_follows_the_window_that_the_software_found() -> None:
    form = FORM | {"window_start": ["", "23:00:00"], "window_end": ["", "23:00:10"]}

    request = correct_request(ReportRequest("a.gt3x"), form, NIGHT, ((3.0, 13.0),))

    assert request.calibration_windows_s == ((3.0, 13.0), (3600.0, 3610.0))


def test_the_level_window_counts_for_two_points_alone() -> None:
    windows = {"window_start": ["22:00:05"], "window_end": ["22:00:12"]}
    level = {"level_start": ["22:00:20"], "level_end": ["22:00:30"]}

    poses = [
        correct_request(ReportRequest("a.gt3x"), FORM | windows | level | {"pose": [pose]}, NIGHT)
        for pose in ("n-pose", "two-point")
    ]

    assert [request.calibration_windows_s for request in poses] == [
        ((5.0, 12.0),),
        ((5.0, 12.0), (20.0, 30.0)),
    ]


def test_an_axis_takes_the_place_of_every_window() -> None:
    form = FORM | {"pose": ["axis"], "axis": ["-y"], "window_start": ["22:00:05"], "window_end": ["22:00:12"]}

    request = correct_request(ReportRequest("a.gt3x"), form, NIGHT)

    assert (request.arm_axis, request.calibration_windows_s, request.pose) == ("-y", (), "n-pose")
    assert correct_request(request, FORM, NIGHT).arm_axis is None  # and a pose that of the axis


@pytest.mark.parametrize(
    "wrong",
    [
        {"pose": ["handstand"]},
        {"side": ["middle"]},
        {"subject": ["\x00"]},
        {"pose": ["two-point"]},
        {"pose": ["axis"]},
        {"slips": ["noon"]},
    ],
)
def test_what_cannot_be_is_refused(wrong: dict[str, list[str]]) -> None:
    with pytest.raises(BadParameter):
        correct_request(ReportRequest("a.gt3x"), FORM | wrong, NIGHT)


def test_a_window_that_ends_before_it_begins_is_refused() -> None:
    form = FORM | {"window_start": ["22:30:00"], "window_end": ["22:20:00"]}

    with pytest.raises(UnusableCalibration) as refusal:
        correct_request(ReportRequest("a.gt3x"), form, NIGHT)

    assert refusal.value.facts == {"why": "end first", "start_s": 1800.0, "end_s": 1200.0}


@pytest.mark.parametrize(
    ("clock", "start", "end"),
    [(NIGHT, "22.30", "2245"), (WITHOUT, "1800", "2700,5")],
    ids=["clock", "seconds"],
)
def test_rows_that_were_exported_are_imported_alike(clock: DayClock, start: str, end: str) -> None:
    form = {"start": [start], "end": [end], "kind": ["task"], "label": ['shelves; "high"']}
    rows = place_rows(read_rows(form, clock), clock)

    body = write_csv([(row.start, row.end, row.kind, row.label) for row in rows], clock)

    assert place_rows(read_diary(body), clock) == rows
    assert rows[0].start == clock.format(1800.0)


@pytest.mark.parametrize("text", ["2230", "22.30", "22,30", "22h30", "22 h 30", "22:30"])
def test_the_fields_of_the_page_take_every_spelling(text: str) -> None:
    rows = {"start": [text], "end": ["23h"], "kind": ["break"], "label": [""]}
    form = FORM | rows | {"window_start": [text], "window_end": ["22.30.10"], "slips": [f"{text}; 23h10"]}

    request = correct_request(ReportRequest("a.gt3x"), form, NIGHT)

    assert request.calibration_windows_s == ((1800.0, 1810.0),)
    assert request.slip_times_s == (1800.0, 4200.0)
    assert place_rows(request.diary, NIGHT)[0].start == "22:30:00"


@pytest.mark.parametrize("text", ["7:58", "10h20", "soon"])
def test_without_a_clock_the_fields_take_seconds_alone(text: str) -> None:
    with pytest.raises(BadParameter):
        WITHOUT.read(text, "slip_at")
    with pytest.raises(UnusableDiary) as refusal:
        read_rows({"start": [text], "end": [""], "kind": ["task"], "label": [""]}, WITHOUT)

    assert refusal.value.facts["cure"] == "seconds"


# The hours of a day as the page lists them.


def test_an_hour_has_its_median_its_p90_and_its_time_above_60_deg_if_anything_was_analysed() -> None:
    begun = {"label": "2026-03-02T15:00", "analysed_s": 0.0, "entries_above_60_per_h": None}
    hour = {
        "label": "2026-03-02T07:00",
        "analysed_s": 3600.0,
        "elevation_p50_deg": 21.0,
        "elevation_p90_deg": 48.0,
        "time_above_60_percent": 5.0,
    }

    rows = build_hours({"exposure": {"by_hour": [hour, begun]}}, "en")

    assert [plain(cell) for cell in rows[0][1:]] == ["1 h", "21°", "48°", "5.0 %"]
    assert rows[1] == ("2026-03-02 15:00", "0\u202fs", "–", "–", "–")


def test_a_task_of_which_nothing_was_analysed_has_no_figure() -> None:
    idle = {"exposure": {"by_task": [{"kind": "task", "label": "A", "analysed_s": 0.0}]}}
    busy = {"exposure": {"by_task": [{"kind": "task", "label": "A", "time_above_60_percent": 5.0}]}}

    (row,) = compare_tasks(idle, busy, "en")

    assert [cell.value.replace("\u202f", " ") for cell in row.cells] == ["–", "5.0 %"]
