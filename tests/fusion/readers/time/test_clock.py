"""Clocks: midnight, daylight saving, steps, never set. Durations come from the samples."""

from datetime import datetime, timedelta

import pytest

from fusion.readers import read_recording
from fusion.recording import Recording
from tests.fusion.readers.gt3x.gt3x_builder import INFO, pack, record, schema, second
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import line, read_text

TORONTO = "(UTC-05:00) Eastern Time (US & Canada)"
NAMES = "timestamp,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps\n"


def utc_shift(first_unix_s: int, seconds: int = 40, name: str = TORONTO) -> Recording:
    """A CentrePoint file: its stamps count UTC, and it names its zone."""
    metadata = f'{{"MetadataType":"LocalTimeLog","UsedUtc":true,"UtcOffset":"-05:00:00","Name":"{name}"}}'
    log = record(24, first_unix_s, schema()) + record(6, first_unix_s, metadata.encode())
    return read_recording(pack(log + b"".join(second(first_unix_s + k) for k in range(seconds)), INFO))


def wall_table(first: datetime, break_after: int = 4000, step: timedelta = timedelta()) -> str:
    """Forty seconds stamped by a wall clock that steps once."""
    moments = (first + timedelta(milliseconds=10 * k) + step * (k >= break_after) for k in range(4000))
    rows = (f"{moment.isoformat(timespec='milliseconds')},{line(k)}\n" for k, moment in enumerate(moments))
    return NAMES + "".join(rows)


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


def test_a_clock_that_was_never_set_gives_no_start() -> None:
    recording = read_text(wall_table(datetime(2000, 1, 1, 0, 0, 5)))  # noqa: DTZ001

    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET"]


@pytest.mark.parametrize("lost_s", [10, 300])
@pytest.mark.parametrize(
    ("first", "step_h"),
    [(datetime(2026, 11, 1, 1, 59, 40), -1), (datetime(2027, 3, 14, 1, 59, 40), 1)],  # noqa: DTZ001
    ids=["back", "forward"],
)
def test_rows_lost_while_the_clocks_are_changed_are_all_that_is_missing(
    first: datetime, step_h: int, lost_s: int
) -> None:
    recording = read_text(wall_table(first, 2000, timedelta(seconds=lost_s, hours=step_h)))

    assert recording.duration_us == 40_000_000 + 1_000_000 * lost_s
    assert codes(recording) == ["W-DST", "W-GAP"]


def test_a_start_in_the_preamble_that_the_rows_contradict_is_said_and_not_believed() -> None:
    first = datetime(2026, 3, 2, 8)  # noqa: DTZ001

    recording = read_text("# start: 2026-03-02T09:30:00-05:00\n" + wall_table(first))

    (flag,) = recording.flags
    assert f"{recording.start:%H:%M:%S %z}" == "08:00:00 -0500"
    assert (flag.code, flag.facts["header"]) == ("W-START", "2026-03-02 09:30:00")


def test_a_start_in_the_preamble_gives_the_rows_their_offset() -> None:
    recording = read_text("# start: 2026-03-02T08:00:00-05:00\n" + wall_table(datetime(2026, 3, 2, 8)))  # noqa: DTZ001

    assert (recording.time_zone, codes(recording)) == ("UTC-05:00", [])
