"""Rows in which nothing was measured are missing: zeros however short, repeats of half a second or more."""

import io
from collections.abc import Callable

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.checks.faults import leave_out_zeros
from acromion.fusion.errors import DeadSensor, UnusableTime
from acromion.fusion.pipeline import analyse
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.tables.csv import RECORD
from acromion.fusion.recording import QualityFlag, Recording
from tests import factories
from tests.badfiles import gt3x_files as g
from tests.badfiles import signal_files as s
from tests.badfiles.arm import Matrix, minute
from tests.badfiles.table_files import changed, stamped, values
from tests.fusion.readers.gt3x.gt3x_builder import T0, record
from tests.fusion.readers.seen import spans_s
from tests.fusion.readers.tables.table_builder import HEADER

ZERO_ROW = "0,0,0,0,0,0"
NAMES = HEADER.split(",")


def write_parquet(columns: Matrix) -> bytes:
    file = io.BytesIO()
    held = {"time_us": np.arange(len(columns)) * 10_000}
    pq.write_table(pa.table(held | dict(zip(NAMES[1:], columns.T, strict=True))), file)
    return file.getvalue()


def write_counted(columns: Matrix) -> bytes:
    """A table without time; its preamble tells the rate."""
    rows = "".join(",".join(f"{value:.5f}" for value in row) + "\n" for row in columns.tolist())
    return ("# rate_hz: 100\n" + ",".join(NAMES[1:]) + "\n" + rows).encode()


def write_gt3x(columns: Matrix) -> bytes:
    seconds = (g.rows_of(one[:, :3], one[:, 3:]) for one in np.split(columns, len(columns) // 100))
    records = (record(25, T0 + k, b"\x01\0" + rows) for k, rows in enumerate(seconds))
    return g.pack(g.SCHEMA + b"".join(records))


WRITERS: dict[str, Callable[[Matrix], bytes]] = {
    "shift.csv": lambda columns: changed(columns).encode(),
    "shift-IMU.csv": lambda columns: s.write_actilife(columns).encode(),
    "shift.parquet": write_parquet,
    "counted.csv": write_counted,
    "shift.dat": s.write_registers,
    "shift.gt3x": write_gt3x,
}


def read(name: str, columns: Matrix) -> Recording:
    return read_recording(io.BytesIO(WRITERS[name](columns)), file_name=name)


def read_filled(
    rows: slice, value: float | Matrix, name: str = "shift.csv", axes: slice = slice(6)
) -> Recording:
    """Read the minute with one value in some rows and channels."""
    columns = s.readings().copy()
    columns[rows, axes] = value
    return read(name, columns)


def told(recording: Recording) -> dict[str, QualityFlag]:
    return {flag.code: flag for flag in recording.flags}


@pytest.mark.parametrize(
    ("name", "rows"),
    [*(("shift.csv", rows) for rows in (1, 4, 5, 49, 300)), *((name, 20) for name in WRITERS)],
)
def test_zeros_are_missing_however_short(name: str, rows: int) -> None:
    recording = read_filled(slice(2000, 2000 + rows), 0.0, name)

    time, lost_us = analyse(recording).time, 10_000 * rows
    flag, gap = told(recording)["W-STUCK-PART"], told(recording)["W-GAP"]
    assert (time.recorded_us, time.analysed_us, time.missing_us) == (
        60_000_000,
        60_000_000 - lost_us,
        lost_us,
    )
    assert (flag.count, flag.first_s, flag.facts) == (1, 20.0, {"filled": "zeros"})
    assert flag.seconds == gap.seconds == lost_us / 1e6


def test_four_rows_at_100_hz_are_bridged_and_five_end_the_segment() -> None:
    four, five = (read_filled(slice(2000, stop), 0.0).segments for stop in (2004, 2005))

    assert [(len(one), one.bridged) for one in four] == [(6000, ((2000, 2004),))]
    assert [(len(one), one.bridged) for one in five] == [(2000, ()), (3995, ())]


def test_zeros_at_both_ends_count_as_recorded_and_missing() -> None:
    columns = s.readings().copy()
    columns[:200] = columns[5900:] = 0.0

    recording = read("shift.csv", columns)

    (segment,) = recording.segments
    assert (recording.duration_us, segment.start_us, len(segment)) == (60_000_000, 2_000_000, 5700)


@pytest.mark.parametrize(
    ("rows", "axes", "value", "lost_s"),
    [
        *((slice(2000, 2010), slice(6), value, 0.1) for value in (-0.001, 9.0, 999.0)),
        (slice(2000, 2010), slice(3), 0.0, 0.1),
        (slice(2000, 2300), slice(3, 6), -999.0, 3.0),
    ],
    ids=["-1 mg", "9", "999", "accelerometer alone at zero", "gyroscope alone at one value"],
)
def test_one_value_that_no_sensor_can_have_is_no_reading(
    rows: slice, axes: slice, value: float, lost_s: float
) -> None:
    assert told(read_filled(rows, value, axes=axes))["W-STUCK-PART"].seconds == lost_s


def test_registers_that_did_not_answer_are_no_reading() -> None:
    """All bits set: -1 in each of the six."""
    content = bytearray(s.write_registers(s.readings()))
    records = np.frombuffer(content, RECORD)
    records["acc"][2000:2010], records["gyr"][2000:2010] = -1, -1

    recording = read_recording(io.BytesIO(content), file_name="shift.dat")

    assert told(recording)["W-STUCK-PART"].seconds == 0.1


def test_a_gyroscope_at_zero_while_the_arm_is_still_is_a_reading() -> None:
    assert told(read_filled(slice(2000, 2040), 0.0, axes=slice(3, 6))) == {}


def test_a_gyroscope_of_whole_degrees_may_rest_at_one_of_them() -> None:
    acc_g, gyr_dps = minute()
    resting = factories.record(acc_g, np.round(gyr_dps), 100.0)
    resting.segments[0].gyr_dps[2000:2040] = 1.0

    assert leave_out_zeros(resting) is resting


def test_a_hole_next_to_zeros_is_bridged_with_them() -> None:
    rows = list(values())
    rows[2000:2002] = [ZERO_ROW] * 2
    stamps = [10_000 * k for k in range(6000)]
    del rows[2002], stamps[2002]

    recording = read_recording(io.BytesIO(stamped(stamps, rows).encode()))

    (segment,) = recording.segments
    assert segment.bridged == ((2000, 2003),)
    assert np.abs(np.linalg.norm(segment.acc_g[1999:2004], axis=1) - 1.0).max() < 0.05


def test_rows_without_a_stamp_are_no_time() -> None:
    """A block of the card was never written, and the file was cut to its length beforehand."""
    rows, stamps = list(values()), [10_000 * k for k in range(6000)]
    for first, stop in ((3000, 3200), (5900, 6000)):
        rows[first:stop], stamps[first:stop] = [ZERO_ROW] * (stop - first), [0] * (stop - first)

    recording = read_recording(io.BytesIO(stamped(stamps, rows).encode()))

    flags = told(recording)
    assert recording.duration_us == 59_000_000
    assert (flags["W-ROWS-DROPPED"].count, flags["W-GAP"].seconds) == (300, 2.0)
    assert "W-CLOCK-BACK" not in flags


def test_a_logger_that_is_faster_than_its_sensor_is_read_at_the_sensors_rate() -> None:
    pairs = [row for value in values() for row in (value, ZERO_ROW)]

    recording = read_recording(io.BytesIO(stamped(range(0, 60_000_000, 5_000), pairs).encode()))

    assert (recording.rate_hz, len(recording.segments)) == (100.0, 1)
    assert told(recording)["W-ROWS-DROPPED"].count == 6000


def test_zeros_between_all_rows_of_a_table_without_time_are_refused() -> None:
    columns = np.repeat(s.readings(), 2, axis=0)
    columns[::2] = 0.0

    with pytest.raises(UnusableTime):
        read("counted.csv", columns)


def test_an_axis_that_is_dead_between_the_zeros_is_named() -> None:
    columns = s.readings().copy()
    columns[:, 4] = 0.25
    columns[2000:2100] = 0.0

    with pytest.raises(DeadSensor) as refusal:
        read("shift.csv", columns)

    assert refusal.value.facts == {"sensor": "gyroscope", "axis": "y"}


@pytest.mark.parametrize("name", WRITERS)
def test_repeats_that_a_program_wrote_are_missing(name: str) -> None:
    recording = read_filled(slice(2001, 2300), s.readings()[2000], name)

    flag = told(recording)["W-STUCK-PART"]
    assert spans_s(recording) == [(0.0, 2001), (23.0, 3700)]
    assert (flag.count, flag.seconds, flag.facts) == (1, 2.99, {"filled": "held"})


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 2990), st.integers(1, 60)), max_size=12))
def test_every_row_is_kept_or_missing(zeros: list[tuple[int, int]]) -> None:
    acc_g, gyr_dps = (values[:3000].copy() for values in minute())
    is_zero = np.zeros(3000, np.bool_)
    for first, rows in zeros:
        is_zero[first : first + rows] = True
    acc_g[is_zero], gyr_dps[is_zero] = 0.0, 0.0

    left = leave_out_zeros(factories.record(acc_g, gyr_dps, 100.0))

    measured = sum(len(one) - sum(b - a for a, b in one.bridged) for one in left.segments)
    assert measured == 3000 - is_zero.sum()
    assert all(np.abs(np.linalg.norm(one.acc_g, axis=1) - 1.0).max() < 0.5 for one in left.segments)
    assert left.duration_us == 30_000_000
