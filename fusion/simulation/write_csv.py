"""Writes the same recording as ActiLife exports it: "-IMU.csv" (FORMATS.md, part 1, sections 7 and 9)."""

from datetime import datetime, timedelta
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import njit
from fusion.recording import Float64Array
from fusion.simulation.imu_rows import TEMPERATURE_AT_ZERO, ImuSeconds
from fusion.simulation.shift import SampleBlock, SimulatedShift
from fusion.simulation.write_gt3x import format_serial

# Numbers as text, millions of rows at a time: fixed decimals from whole numbers, so nothing is rounded.


Bytes = NDArray[np.uint8]
WholeNumbers = NDArray[np.int64]

_COMMA, _DOT, _MINUS, _NEWLINE, _ZERO = 44, 46, 45, 10, 48


@njit(cache=True, nogil=True)
def put_digits(out: Bytes, at_byte: int, value: int, width: int) -> int:  # pragma: no cover - compiled
    """Write ``value`` >= 0 with leading zeros to at least ``width`` digits; returns the place after it."""
    digits, rest = 1, value // 10
    while rest > 0:
        digits += 1
        rest //= 10
    end = at_byte + max(digits, width)
    for place in range(end - 1, at_byte - 1, -1):
        out[place] = _ZERO + value % 10
        value //= 10
    return end


@njit(cache=True, nogil=True)
def put_fixed(out: Bytes, at_byte: int, value: int, decimals: int) -> int:  # pragma: no cover - compiled
    """Write ``value`` / 10**decimals with all its decimals; returns the place after it."""
    if value < 0:
        out[at_byte] = _MINUS
        at_byte += 1
        value = -value
    one = 10**decimals
    at_byte = put_digits(out, at_byte, value // one, 1)
    out[at_byte] = _DOT
    return put_digits(out, at_byte + 1, value % one, decimals)


@njit(cache=True, nogil=True)
def put_counter_rows(
    out: Bytes, counter: WholeNumbers, values: WholeNumbers, decimals: WholeNumbers
) -> int:  # pragma: no cover - compiled
    """Write rows ``counter,value,...``; ``values`` (n, columns) are in units of 10**-decimals.

    Returns the number of bytes written; ``out`` must hold 24 bytes for each number.
    """
    at = 0
    for i in range(values.shape[0]):
        at = put_digits(out, at, counter[i], 1)
        for column in range(values.shape[1]):
            out[at] = _COMMA
            at = put_fixed(out, at + 1, values[i, column], decimals[column])
        out[at] = _NEWLINE
        at += 1
    return at


@njit(cache=True, nogil=True)
def put_stamped_rows(out: Bytes, seconds: Bytes, values: WholeNumbers) -> int:  # pragma: no cover - compiled
    """Write 100 rows for each second: ``SECOND.ff00000,value,...`` with values in millionths.

    ``seconds`` (s, width): the stamp of each second as text; ``values`` (100 s, columns). Returns the number
    of bytes written; ``out`` must hold 24 bytes for each number and 32 for the stamp.
    """
    at = 0
    for i in range(values.shape[0]):
        for place in range(seconds.shape[1]):
            out[at + place] = seconds[i // 100, place]
        at += seconds.shape[1]
        out[at] = _DOT
        at = put_digits(out, at + 1, (i % 100) * 100_000, 7)
        for column in range(values.shape[1]):
            out[at] = _COMMA
            at = put_fixed(out, at + 1, values[i, column], 6)
        out[at] = _NEWLINE
        at += 1
    return at


# What the writers of text logs share: a file that is open from the start to the end of a ``with``.


class OpenFile:
    """A file with its head written, to be written on; a context manager."""

    def __init__(self, path: Path, head: bytes) -> None:
        self._file = path.open("wb")
        self._file.write(head)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()


# Writes what a logger with an LSM9DS1 writes: a CSV with a microsecond counter, in g and deg/s.
#
# The part's registers are left-handed; loggers that print g and deg/s, as this one, turn them into one
# right-handed frame, and so does this file: acc and gyr share it.


COUNTER_SIZE = 2**32
"""micros() wraps here: every 71.6 minutes."""

LATENCY_US = 40.0
"""A sample is read up to so long after it was taken."""

_LSM9DS1_COLUMNS = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
_DECIMALS = np.array([6, 6, 6, 3, 3, 3])


class Lsm9ds1CsvWriter(OpenFile):
    """Takes blocks of samples and writes them on at once; a context manager."""

    def __init__(self, path: Path, shift: SimulatedShift) -> None:
        self._shift = shift
        self._chance = np.random.default_rng([shift.seed, 4])
        self._switched_on_us = self._chance.integers(3_000_000, 600_000_000)
        super().__init__(path, _write_lsm9ds1_header(shift))

    def write(self, block: SampleBlock) -> None:
        """Write the rows of a block; values are whole multiples of the resolution, so text loses nothing."""
        part = self._shift.part
        acc, gyr = self._shift.count(block.readings)
        values = np.empty((len(acc), 6), np.int64)
        values[:, :3] = acc.astype(np.int64) * round(part.acc_g_per_lsb * 1e6)
        values[:, 3:] = gyr.astype(np.int64) * round(part.gyr_dps_per_lsb * 1e3)
        out = np.empty(values.shape[0] * 7 * 24, np.uint8)
        size = put_counter_rows(out, self._stamp(block), values, _DECIMALS)
        self._file.write(out[:size].tobytes())

    def _stamp(self, block: SampleBlock) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Read the counter when each sample is fetched."""
        late_us = self._chance.uniform(0.0, LATENCY_US, len(block.time_s))
        return (self._switched_on_us + (block.time_s * 1e6 + late_us).astype(np.int64)) % COUNTER_SIZE


def _write_lsm9ds1_header(shift: SimulatedShift) -> bytes:
    """Give the comment lines and the columns."""
    lines = (
        "# device: LSM9DS1",
        f"# start: {shift.start.isoformat()}",
        f"# acc_range_g: {shift.part.acc_range_g:g}",
        f"# gyr_range_dps: {shift.part.gyr_range_dps:g}",
        _LSM9DS1_COLUMNS,
    )
    return "".join(line + "\n" for line in lines).encode()


_COLUMNS = (
    "Timestamp,Accelerometer X,Accelerometer Y,Accelerometer Z,Temperature,"
    "Gyroscope X,Gyroscope Y,Gyroscope Z,Magnetometer X,Magnetometer Y,Magnetometer Z"
)

DIVISORS = np.array([2048.0] * 3 + [333.87] + [16.383999] * 3 + [6.826667] * 3)
"""What ActiLife divides the counts by; 16.383999 is its own rounding."""

ROWS_PER_SECOND = 100


class ActilifeCsvWriter(OpenFile):
    """Takes seconds of rows and writes them on at once; a context manager."""

    def __init__(self, path: Path, shift: SimulatedShift) -> None:
        self._start = shift.start
        super().__init__(path, _write_header(shift))

    def write(self, seconds: ImuSeconds) -> None:
        """Resample each second to 100 rows by ActiLife's rule and write them."""
        values = _resample(seconds) / DIVISORS
        values[:, 3] += TEMPERATURE_AT_ZERO
        stamps = _write_stamps(self._start + timedelta(seconds=seconds.first_s), len(seconds.counts))
        out = np.empty(values.shape[0] * (32 + 24 * values.shape[1]), np.uint8)
        size = put_stamped_rows(out, stamps, round_to_millionths(values))
        self._file.write(out[:size].tobytes())


def round_to_millionths(values: Float64Array) -> NDArray[np.int64]:
    """Round half away from zero, as .NET prints (0.0078125 becomes 0.007813)."""
    return (np.sign(values) * np.floor(np.abs(values) * 1e6 + 0.5)).astype(np.int64)


def _resample(seconds: ImuSeconds) -> Float64Array:
    """Interpolate each second's n rows at k n / 100, k = 0 ... 99, held at the last row."""
    rows = seconds.rows
    counts = np.column_stack((rows["acc"], rows["temp"], rows["gyr"], rows["mag"])).astype(np.float64)
    place = np.arange(ROWS_PER_SECOND) * seconds.counts[:, None] / ROWS_PER_SECOND
    place = np.minimum(place, seconds.counts[:, None] - 1)
    low = place.astype(np.int64)
    part = (place - low).reshape(-1, 1)
    high = np.minimum(low + 1, seconds.counts[:, None] - 1) + seconds.starts()[:-1, None]
    low += seconds.starts()[:-1, None]
    return np.asarray(counts[low.ravel()] * (1.0 - part) + counts[high.ravel()] * part)


def _write_stamps(start: datetime, duration_s: int) -> NDArray[np.uint8]:
    """Shape (seconds, 19): each second's clock, ISO 8601."""
    text = "".join((start + timedelta(seconds=k)).isoformat() for k in range(duration_s))
    return np.frombuffer(text.encode(), np.uint8).reshape(duration_s, -1)


def _write_header(shift: SimulatedShift) -> bytes:
    """Give the ten lines above the columns."""
    start, day = shift.start, f"{shift.start.month}/{shift.start.day}/{shift.start.year}"
    end = start + timedelta(seconds=int(shift.sample_count / shift.rate_hz) + 301)
    title = (
        "------------ Data File Created By ActiGraph Link IMU 9DOF Sensor ActiLife v6.13.3 Firmware v1.7.2 "
        "date format M/d/yyyy at 100 Hz  -----------"
    )
    lines = (
        title,
        f"Serial Number: {format_serial(shift.seed)}",
        f"Start Time {start:%H:%M:%S}",
        f"Start Date {day}",
        "Epoch Period (hh:mm:ss) 00:00:00",
        f"Download Time {end:%H:%M:%S}",
        f"Download Date {end.month}/{end.day}/{end.year}",
        "Current Memory Address: 0",
        "Current Battery Voltage: 4.12     Mode = 12",
        "-" * 50,
        _COLUMNS,
    )
    return "".join(line + "\n" for line in lines).encode()
