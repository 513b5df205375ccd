"""Clocks: midnight, daylight saving, steps, never set. Durations come from the samples."""

from datetime import UTC, datetime, timedelta

import pytest

from fusion.readers import read_recording
from fusion.recording import Recording
from tests.fusion.readers.gt3x.gt3x_builder import INFO, codes, pack, record, schema, second
from tests.fusion.readers.tables.table_builder import line, read_text

TORONTO = "(UTC-05:00) Eastern Time (US & Canada)"
NAMES = "timestamp,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n"


def utc_shift(first_unix_s: int, seconds: int = 40, name: str = TORONTO) -> Recording:
    """A CentrePoint file: its stamps count UTC, and it names its zone."""
    metadata = f'{{"MetadataType":"LocalTimeLog","UsedUtc":true,"UtcOffset":"-05:00:00","Name":"{name}"}}'
    log = record(24, first_unix_s, schema()) + record(6, first_unix_s, metadata.encode())
    return read_recording(pack(log + b"".join(second(first_unix_s + k) for k in range(seconds)), INFO))


def wall_table(first: datetime, change_after_s: float = 0.0, step_h: int = 0) -> str:
    """Forty seconds stamped by a wall clock that is changed once."""
    rows = []
    for k in range(4000):
        step = timedelta(hours=step_h if change_after_s and k / 100 >= change_after_s else 0)
        stamp = first + timedelta(milliseconds=10 * k) + step
        rows.append(f"{stamp.isoformat(timespec='milliseconds')},{line(k)}\n")
    return NAMES + "".join(rows)


def test_midnight_leaves_no_mark() -> None:
    recording = read_text(wall_table(datetime(2026, 3, 2, 23, 59, 40)))  # noqa: DTZ001

    assert recording.duration_us == 40_000_000
    assert codes(recording) == []


@pytest.mark.parametrize(
    ("change", "offset_h", "step_s"),
    [(1_793_512_800, -4, -3600), (1_805_007_600, -5, 3600)],
    ids=["2026-11-01 back", "2027-03-14 forward"],
)
def test_a_file_that_counts_utc_follows_its_zone(change: int, offset_h: int, step_s: int) -> None:
    recording = utc_shift(change - 20)

    (flag,) = recording.flags
    assert recording.start is not None
    assert recording.start.utcoffset() == timedelta(hours=offset_h)
    assert recording.duration_us == 40_000_000
    assert (flag.code, flag.first_s, flag.facts) == ("W-DST", 20.0, {"step_s": step_s})


def test_far_from_the_change_nothing_is_said() -> None:
    assert codes(utc_shift(1_793_512_800 - 86_400)) == []


def test_an_unknown_zone_keeps_the_offset_of_the_file() -> None:
    recording = utc_shift(1_793_512_800 - 20, name="(UTC-05:00) Nowhere")

    assert recording.start is not None
    assert recording.start.utcoffset() == timedelta(hours=-5)
    assert codes(recording) == []


def test_the_clock_of_an_actilife_file_has_no_jump() -> None:
    log = record(24, 1_793_498_380, schema())
    log += b"".join(second(1_793_498_380 + k) for k in range(40))  # 2026-11-01 01:59:40 on the wall

    recording = read_recording(pack(log))

    assert recording.duration_us == 40_000_000
    assert codes(recording) == []


@pytest.mark.parametrize(
    ("first", "step_h"),
    [(datetime(2026, 11, 1, 1, 59, 40), -1), (datetime(2027, 3, 14, 1, 59, 40), 1)],  # noqa: DTZ001
    ids=["back", "forward"],
)
def test_a_wall_clock_that_was_changed_costs_no_time(first: datetime, step_h: int) -> None:
    recording = read_text(wall_table(first, 20.0, step_h))

    assert recording.duration_us == 40_000_000
    assert len(recording.segments) == 1
    assert codes(recording) == ["W-DST"]


def test_an_hours_step_at_another_time_is_a_gap() -> None:
    recording = read_text(wall_table(datetime(2027, 3, 15, 9, 15, 40), 20.0, 1))  # noqa: DTZ001

    assert recording.duration_us == 3_640_000_000
    assert codes(recording) == ["W-GAP"]


def test_a_wall_clock_set_back_by_hand_keeps_the_durations() -> None:
    recording = read_text(wall_table(datetime(2027, 3, 15, 9, 15, 40), 20.0, -1))  # noqa: DTZ001

    assert recording.duration_us == 40_000_000
    assert codes(recording) == ["W-CLOCK-BACK"]


def test_a_clock_that_was_never_set_gives_no_start() -> None:
    recording = read_text(wall_table(datetime(2000, 1, 1, 0, 0, 5)))  # noqa: DTZ001

    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET"]


def test_a_zone_behind_each_stamp_is_read() -> None:
    text = "".join(f"2026-03-14T08:00:{k / 100:05.2f}-04:00,{line(k)}\n" for k in range(2000))

    recording = read_text(NAMES + text)

    assert recording.duration_us == 20_000_000
    assert recording.start == datetime(2026, 3, 14, 12, tzinfo=UTC)


@pytest.mark.parametrize("lost_s", [0, 10, 300])
@pytest.mark.parametrize(
    ("first", "step_h"),
    [(datetime(2026, 11, 1, 1, 59, 40), -1), (datetime(2027, 3, 14, 1, 59, 40), 1)],  # noqa: DTZ001
    ids=["back", "forward"],
)
def test_rows_lost_while_the_clocks_are_changed_are_all_that_is_missing(
    first: datetime, step_h: int, lost_s: int
) -> None:
    moments = [first + timedelta(seconds=k / 100) for k in range(2000)]
    later = first + timedelta(seconds=20 + lost_s, hours=step_h)
    moments += [later + timedelta(seconds=k / 100) for k in range(2000)]
    rows = [f"{moment.isoformat(timespec='milliseconds')},{line(k)}\n" for k, moment in enumerate(moments)]

    recording = read_text(NAMES + "".join(rows))

    assert recording.duration_us == 40_000_000 + 1_000_000 * lost_s
    assert codes(recording) == (["W-DST", "W-GAP"] if lost_s else ["W-DST"])


def test_a_start_in_the_preamble_that_the_rows_contradict_is_said_and_not_believed() -> None:
    first = datetime(2026, 3, 2, 8)  # noqa: DTZ001

    recording = read_text("# start: 2026-03-02T09:30:00-05:00\n" + wall_table(first))

    (flag,) = recording.flags
    assert f"{recording.start:%H:%M:%S %z}" == "08:00:00 -0500"
    assert (flag.code, flag.facts["header"]) == ("W-START", "2026-03-02 09:30:00")


def test_a_start_in_the_preamble_gives_the_rows_their_offset() -> None:
    recording = read_text("# start: 2026-03-02T08:00:00-05:00\n" + wall_table(datetime(2026, 3, 2, 8)))  # noqa: DTZ001

    assert (recording.time_zone, codes(recording)) == ("UTC-05:00", [])
