"""Rows that a phone received together carry one stamp; the sensor measured them evenly."""

import io
import zipfile
from collections.abc import Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.errors import UnusableTime
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import line, read_text, table

Stamps = NDArray[np.int64]
ROWS, PERIOD_US = 6000, 10_000
"""A minute at 100 Hz."""
MINUTE_US = ROWS * PERIOD_US


def receive(sizes: tuple[int, int], waits_s: Sequence[tuple[float, float]] = (), late_us: int = 0) -> Stamps:
    """Return the stamp of each row: a phone fetches all rows so far, each time after another number of them.

    ``waits_s``: from when to when it fetches nothing; ``late_us``: the mean delay of a stamp.
    """
    random = np.random.default_rng(1)
    fetched_us = np.cumsum(random.integers(sizes[0], sizes[1] + 1, ROWS)) * PERIOD_US + 1000
    for from_s, to_s in waits_s:
        is_waiting = (fetched_us >= 1e6 * from_s) & (fetched_us < 1e6 * to_s)
        fetched_us[is_waiting] = round(1e6 * to_s)
    stamps_us = np.maximum.accumulate(fetched_us + random.exponential(late_us, ROWS).astype(np.int64))
    stamps: Stamps = stamps_us[np.searchsorted(fetched_us, PERIOD_US * np.arange(ROWS))]
    return stamps // 1000 * 1000


def pack_pair(stamps: Stamps) -> bytes:
    """Write the rows as an archive of two tables, each with these stamps."""
    packed = io.BytesIO()
    fields = [line(k).split(",") for k in range(len(stamps))]
    with zipfile.ZipFile(packed, "w") as archive:
        for name, first in (("Accelerometer", 0), ("Gyroscope", 3)):
            rows = (
                f"{us},{','.join(row[first : first + 3])}\n" for us, row in zip(stamps, fields, strict=True)
            )
            unit = "deg/s" if first else "g"
            archive.writestr(f"{name}.csv", f"time_us,X ({unit}),Y ({unit}),Z ({unit})\n" + "".join(rows))
    return packed.getvalue()


def read_both(stamps: Stamps) -> tuple[Recording, Recording]:
    """Read the rows as one table and as two."""
    pair = read_recording(io.BytesIO(pack_pair(stamps)), file_name="arm.zip")
    return read_text(table(stamps.tolist())), pair


def count_measured(recording: Recording) -> int:
    return sum(len(one) - sum(stop - first for first, stop in one.bridged) for one in recording.segments)


@pytest.mark.parametrize("sizes", [(3, 3), (1, 5), (10, 10), (5, 15), (20, 40)])
@pytest.mark.parametrize("late_us", [0, 20_000])
def test_rows_of_uneven_bursts_keep_rate_and_duration(sizes: tuple[int, int], late_us: int) -> None:
    for recording in read_both(receive(sizes, late_us=late_us)):
        (segment,) = recording.segments
        assert (len(segment), segment.bridged) == (ROWS, ())
        assert recording.duration_us == pytest.approx(MINUTE_US, abs=20_000)
        assert not {"W-GAP", "W-ROWS-DROPPED", "W-RATE-CHANGE"} & set(codes(recording))


@pytest.mark.parametrize("sizes", [(1, 1), (3, 3), (5, 15), (20, 40)])
def test_a_wait_that_loses_no_row_is_no_gap(sizes: tuple[int, int]) -> None:
    for recording in read_both(receive(sizes, [(10.0, 11.0), (12.0, 13.0), (40.0, 45.0)])):
        (segment,) = recording.segments
        assert len(segment) == ROWS
        assert recording.duration_us == pytest.approx(MINUTE_US, abs=20_000)
        assert segment.gyr_dps[3000, 2] == pytest.approx(0.5)  # the value that numbers the row


@pytest.mark.parametrize("sizes", [(3, 3), (5, 15), (20, 40)])
def test_rows_that_were_lost_stay_missing(sizes: tuple[int, int]) -> None:
    """Two seconds of them, one in a wait of three."""
    kept = np.ones(ROWS, np.bool_)
    kept[1100:1200] = kept[4000:4100] = False

    for recording in read_both(receive(sizes, [(10.0, 13.0)])[kept]):
        assert recording.duration_us == pytest.approx(MINUTE_US, abs=20_000)
        assert count_measured(recording) == ROWS - 200
        assert max(segment.rate_hz for segment in recording.segments) == pytest.approx(100.0, abs=0.1)


def test_a_fifth_of_even_bursts_may_be_lost() -> None:
    """The rate of the 4800 rows that are left stays 100 Hz."""
    kept = np.repeat(np.random.default_rng(2).permutation(np.arange(600) % 5 > 0), 10)

    recording = read_text(table(receive((10, 10), late_us=5000)[kept].tolist()))

    assert count_measured(recording) == 4800
    assert recording.rate_hz == pytest.approx(100.0, abs=0.2)
    assert recording.duration_us == pytest.approx(MINUTE_US, abs=200_000)


def test_bursts_that_no_rate_explains_are_refused() -> None:
    """Half of the rows are lost, and the count of a burst has nothing to do with the time since the last."""
    random = np.random.default_rng(3)
    stamps = np.repeat(100_000 * np.arange(300), random.geometric(0.1, 300))

    with pytest.raises(UnusableTime) as refusal:
        read_text(table(stamps.tolist()))

    assert refusal.value.facts == {"why": "irregular"}


def test_rows_that_a_program_stamped_while_it_read_them_are_a_burst() -> None:
    """`time.time()` for each line of a serial port: 50 us apart, then a step of as long as the rows took."""
    stamps = receive((5, 15), [(20.0, 21.0)], late_us=5000)
    place = np.arange(ROWS) - np.searchsorted(stamps, stamps)
    text = table((stamps + 50 * place).tolist()).replace("time_us", "time", 1)

    (segment,) = read_text(text).segments

    assert (len(segment), segment.bridged) == (ROWS, ())
    assert segment.rate_hz == pytest.approx(100.0, abs=0.05)


def test_a_stamp_that_comes_twice_before_a_double_step_hides_no_gap() -> None:
    """A ZED camera: one row in twelve carries the stamp of the row before."""
    stamps = 2500 * np.arange(ROWS)
    stamps[5::12] = stamps[4::12]

    (segment,) = read_text(table(stamps.tolist())).segments

    assert (len(segment), segment.bridged) == (ROWS, ())
    assert segment.rate_hz == pytest.approx(400.0, abs=0.05)


def test_bursts_of_a_board_that_restarted_are_two_pieces() -> None:
    stamps = receive((5, 15))
    second = int(np.searchsorted(stamps, stamps[3000]))
    stamps[second:] -= stamps[second]

    recording = read_text(table(stamps.tolist()))

    assert "W-CLOCK-BACK" in codes(recording)
    assert [len(segment) for segment in recording.segments] == [second, ROWS - second]
    assert recording.duration_us == pytest.approx(MINUTE_US, abs=50_000)
