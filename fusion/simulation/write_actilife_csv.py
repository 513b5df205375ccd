"""Writes the same recording as ActiLife exports it: "-IMU.csv" (FORMATS.md, part 1, sections 7 and 9)."""

from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fusion.simulation.digits import put_stamped_rows
from fusion.simulation.imu_rows import TEMPERATURE_AT_ZERO, ImuSeconds
from fusion.simulation.open_file import OpenFile
from fusion.simulation.shift import SimulatedShift
from fusion.simulation.write_gt3x import name_serial

FloatArray = NDArray[np.float64]

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
        stamps = _write_stamps(self._start + timedelta(seconds=seconds.first), len(seconds.counts))
        out = np.empty(values.shape[0] * (32 + 24 * values.shape[1]), np.uint8)
        size = put_stamped_rows(out, stamps, round_to_millionths(values))
        self._file.write(out[:size].tobytes())


def round_to_millionths(values: FloatArray) -> NDArray[np.int64]:
    """Round half away from zero, as .NET prints (0.0078125 becomes 0.007813)."""
    return (np.sign(values) * np.floor(np.abs(values) * 1e6 + 0.5)).astype(np.int64)


def _resample(seconds: ImuSeconds) -> FloatArray:
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


def _write_stamps(start: datetime, seconds: int) -> NDArray[np.uint8]:
    """Shape (seconds, 19): each second's clock, ISO 8601."""
    text = "".join((start + timedelta(seconds=k)).isoformat() for k in range(seconds))
    return np.frombuffer(text.encode(), np.uint8).reshape(seconds, -1)


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
        f"Serial Number: {name_serial(shift.seed)}",
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
