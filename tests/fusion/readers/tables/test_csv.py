"""Tables of loggers: time, holes, and the form we publish for device makers."""

import io
from datetime import datetime, timedelta, timezone

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.errors import (
    FusionError,
    NoGyroscope,
    UnknownColumns,
    UnknownFormat,
    UnknownRate,
    UnusableTime,
)
from acromion.fusion.readers import read_recording
from tests.fusion.readers.seen import codes, counts
from tests.fusion.readers.tables.table_builder import HEADER, PREAMBLE, line, read_text, table

SHIFT = table(range(0, 20_000_000, 2000))


def test_the_canonical_form_is_read_with_clock_and_ranges() -> None:
    recording = read_text(PREAMBLE + SHIFT)

    assert recording.device == "lsm9ds1"
    assert recording.start == datetime(2026, 3, 3, 7, 58, tzinfo=timezone(timedelta(hours=-5)))
    assert recording.time_zone == "UTC-05:00"
    assert (recording.acc_range_g, recording.gyr_range_dps) == (8.0, 2000.0)
    assert recording.rate_hz == pytest.approx(500.0)
    assert recording.duration_us == 20_000_000
    assert recording.flags == ()
    assert recording.segments[0].acc_g[2] == pytest.approx([0.002, 0.0, 1.0])
    assert recording.segments[0].gyr_dps[1999].tolist() == [0.5, -0.25, 999.5]


@pytest.mark.parametrize(
    ("line", "held", "windows_s", "axis"),
    [
        *((f"pose_held: {text}", "start", (), None) for text in ("start", "Start", "début", "DEBUT")),
        *((f"pose_held: {text}", "no", (), None) for text in ("no", "non")),
        ("pose_window_s: 5,10.5", None, ((5.0, 10.5),), None),
        ("arm_axis: -y", None, (), "-y"),
    ],
)
def test_the_header_states_the_pose(line: str, held: str | None, windows_s: object, axis: str | None) -> None:
    recording = read_text(f"# {line}\n{SHIFT}")

    pose = (recording.pose_held, recording.pose_windows_s, recording.arm_axis)
    assert (pose, recording.flags) == ((held, windows_s, axis), ())


@pytest.mark.parametrize(
    "line",
    [
        "pose_held: yes",
        "pose_window_s: 10-5",
        "pose_window_s: 10,5",
        "pose_window_s: -5,5",
        "pose_window_s: 5,inf",
        "pose_window_s: 5,10,15",
        "arm_axis: q",
    ],
)
def test_a_header_line_about_the_pose_that_cannot_be_read_is_told(line: str) -> None:
    recording = read_text(f"# {line}\n{SHIFT}")

    (flag,) = recording.flags
    assert (flag.code, flag.count, flag.facts) == ("W-HEADER", 1, {"text": line})
    assert (recording.pose_windows_s, recording.arm_axis, recording.pose_held) == ((), None, None)


def test_all_header_lines_about_the_pose_that_cannot_be_read_are_one_caveat() -> None:
    recording = read_text("# pose_held: yes\n# arm_axis: q\n" + SHIFT)

    (flag,) = recording.flags
    assert (flag.count, flag.facts) == (2, {"text": "arm_axis: q; pose_held: yes"})


def test_a_short_hole_is_bridged_and_its_time_is_missing() -> None:
    stamps = [k * 2000 for k in range(5000) if k not in (1000, 1001)]

    recording = read_text(table(stamps))

    (segment,) = recording.segments
    assert len(segment) == 5000
    assert segment.bridged == ((1000, 1002),)
    assert counts(recording) == [("W-GAP", 1)]
    assert recording.flags[0].seconds == pytest.approx(0.004)


def test_rows_stamped_late_are_not_a_hole() -> None:
    stamps = [k * 2000 for k in range(5000)]
    for k in range(1000, 1010):
        stamps[k] = 1009 * 2000 + (k - 1009) * 20

    recording = read_text(table(stamps))

    assert [len(s) for s in recording.segments] == [5000]
    assert recording.segments[0].bridged == ()


def test_whole_milliseconds_at_952_hz_are_one_segment() -> None:
    stamps_ms = [round(k * 1000 / 952) for k in range(9520)]
    text = table([], HEADER.replace("time_us", "time_ms"))
    text += "".join(f"{ms},{line(k)}\n" for k, ms in enumerate(stamps_ms))

    recording = read_text(text)

    assert [len(s) for s in recording.segments] == [9520]
    assert recording.rate_hz == pytest.approx(952.0, rel=1e-4)


def test_a_logger_that_started_again_gives_a_second_segment() -> None:
    stamps = [*range(60_000_000, 70_000_000, 2000)]
    text = table(stamps) + table(range(0, 10_000_000, 2000))

    recording = read_text(text)

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 5000), (10_000_000, 5000)]
    assert codes(recording) == ["W-HEADER-REPEAT", "W-CLOCK-BACK"]


@given(st.lists(st.integers(0, 4999), max_size=30, unique=True))
@settings(max_examples=20)
def test_present_and_missing_time_add_up_whatever_rows_are_lost(lost: list[int]) -> None:
    gone = set(lost) - {0, 4999}
    recording = read_text(table(k * 2000 for k in range(5000) if k not in gone))

    present_us = sum(segment.duration_us for segment in recording.segments)
    bridged = sum(stop - first for s in recording.segments for first, stop in s.bridged)
    gap_us = sum(flag.seconds for flag in recording.flags if flag.code == "W-GAP") * 1e6
    assert recording.duration_us == 10_000_000
    assert present_us - bridged * 2000 + gap_us == pytest.approx(10_000_000, abs=1.0)


def outcome(content: bytes) -> str:
    """The refusal's code, or ok; any other exception is a bug and fails the test."""
    try:
        read_recording(io.BytesIO(content))
    except FusionError as refusal:
        return refusal.code
    return "ok"


@given(st.binary(max_size=400))
@settings(max_examples=100)
def test_any_bytes_are_read_or_refused_by_our_own_errors(content: bytes) -> None:
    assert outcome(content).startswith(("E-", "ok"))


def test_a_header_of_unknown_names_is_shown_and_not_denied() -> None:
    rows = "".join(f"{row / 100:.2f},0.1,0.2,0.9,1,2,{row % 7}\n" for row in range(200))

    with pytest.raises(UnknownColumns) as refusal:
        read_recording(io.BytesIO(f"when,p,q,r,s,u,v\n{rows}".encode()), file_name="strange.csv")

    assert refusal.value.facts["list"] == "when,p,q,r,s,u,v"
    assert refusal.value.facts["missing"] == "ax, ay, az, gx, gy, gz"


# Damaged tables and files of other kinds: one row is lost, or the file is refused with the place.
#
# `tests/badfiles` (rows 59 to 82) has more of them.


@pytest.mark.parametrize(
    ("content", "error"),
    [
        ("time_s,ax,ay,az\n" + "".join(f"{k / 100},0,0,1\n" for k in range(50)), NoGyroscope),
        ("t_ms,ax,ay,az,b,c\n" + "10,0,0,1,5,6\n" * 50, NoGyroscope),
        ("ax,ay,az,gx,gy,gz\n" + "0,0,1,0,0,0\n" * 50, UnknownRate),
        ("time_s,ax,ay,az,gx,gy,gz\n" + "".join(f"{10 * k},0,0,1,0,0,0\n" for k in range(50)), UnknownRate),
        ("time_s,ax,ay,az,gx,gy,gz\n" + "7,0,0,1,0,0,0\n" * 50, UnusableTime),
        ("nothing to see here\n" * 20, UnknownFormat),
    ],
)
def test_what_is_no_recording_is_refused_by_kind(content: str, error: type[FusionError]) -> None:
    with pytest.raises(error):
        read_text(content)


def test_a_layout_without_time_is_read_at_the_rate_that_is_told() -> None:
    text = "ax,ay,az,gx,gy,gz\n" + "".join(line(k) + "\n" for k in range(1200))

    recording = read_text(text, rate_hz=50.0)

    assert recording.duration_us == 24_000_000
    assert codes(recording)[:1] == ["W-RATE"]
