"""A clock that stops while the sensor goes on: rows with one and the same stamp, for seconds."""

import numpy as np
import pytest

from fusion.errors import UnusableTime
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.grid import leave_out_stopped
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import read_text, table

SECOND_US = 1_000_000
ROWS = 6000
"""A minute at 100 Hz."""


def stopped(first: int, stop: int, stamp_us: int | None = None, hole_us: int = 0) -> list[int]:
    """A minute whose clock stops at a row, shows one stamp up to another, and goes on as if nothing was."""
    held = 10_000 * first if stamp_us is None else stamp_us
    return [held if first <= k < stop else 10_000 * k + hole_us * (k >= stop) for k in range(ROWS)]


@pytest.mark.parametrize("rows", [60, 2400])
def test_rows_of_a_stopped_clock_are_missing_time(rows: int) -> None:
    recording = read_text(table(stopped(3000, 3000 + rows)))

    assert sum(len(segment) for segment in recording.segments) == ROWS - rows
    assert recording.duration_us == 60 * SECOND_US
    assert codes(recording) == ["W-ROWS-DROPPED", "W-GAP"]


def test_rows_of_a_stopped_clock_beside_a_hole_are_missing() -> None:
    recording = read_text(table(stopped(3000, 4000, hole_us=15 * SECOND_US)))

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 3000), (55 * SECOND_US, 2000)]
    assert codes(recording) == ["W-ROWS-DROPPED", "W-GAP"]


@pytest.mark.parametrize("stamp_us", [None, 0])
def test_a_clock_that_stops_before_the_end_leaves_the_rest_as_it_was(stamp_us: int | None) -> None:
    """Before, the rows had another rate than the sensor's, or division by zero ended the reading."""
    recording = read_text(table(stopped(4000, ROWS, stamp_us)))

    assert [(len(s), round(s.rate_hz, 6)) for s in recording.segments] == [(4000, 100.0)]
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-ROWS-DROPPED", 2000)]


@pytest.mark.parametrize("offset_us", [0, 10**12])
@pytest.mark.parametrize("rows", [60, 2900])
def test_a_clock_that_starts_after_the_sensor_gives_no_time_before(rows: int, offset_us: int) -> None:
    stamps = [0] * rows + [offset_us + 10_000 * k for k in range(rows, ROWS)]

    recording = read_text(table(stamps))

    assert [(len(s), round(s.rate_hz, 6)) for s in recording.segments] == [(ROWS - rows, 100.0)]
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-ROWS-DROPPED", rows)]


@pytest.mark.parametrize("rows_in_a_second", [4, 100, 130])
def test_a_clock_of_whole_seconds_has_not_stopped(rows_in_a_second: int) -> None:
    seconds = [k // 100 for k in range(ROWS)]
    seconds[3000 : 3000 + rows_in_a_second] = [30] * rows_in_a_second

    recording = read_text(table(SECOND_US * s for s in seconds))

    assert "W-CLOCK-FWD" not in codes(recording)
    assert "W-ROWS-DROPPED" not in codes(recording)


def test_rows_in_uneven_bunches_are_no_stopped_clock() -> None:
    """Without knowing when each was measured there is nothing to time them by."""
    lengths = np.random.default_rng(5).geometric(1 / 40, 400)
    stamps = 10_000 * np.repeat(np.cumsum(lengths), lengths)
    columns = SampleColumns()
    rows = columns.extend(len(stamps))
    columns.stamps[rows] = stamps

    flags = leave_out_stopped(columns)

    assert flags == ()
    assert columns.stamps[: columns.rows].tolist() == stamps.tolist()


@pytest.mark.parametrize("stamps", [stopped(1000, ROWS), [0]], ids=["most rows", "one row"])
def test_a_clock_that_stands_most_of_the_time_is_refused(stamps: list[int]) -> None:
    with pytest.raises(UnusableTime):
        read_text(table(stamps))
