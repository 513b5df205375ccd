"""The rows of a GT9X's inertial unit, cut into the seconds of its clock (FORMATS.md, part 1, 6 and 7)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.simulation.sensor import KNOT_S
from fusion.simulation.shift import SampleBlock, SimulatedShift

ROW = np.dtype([("acc", ">i2", 3), ("temp", ">i2"), ("gyr", ">i2", 3), ("mag", "<i2", 3), ("pad", "u1")])
"""21 bytes; the magnetometer is little-endian, the rest big-endian, as the device writes it."""

Rows = NDArray[Any]

TEMPERATURE_PER_LSB, TEMPERATURE_AT_ZERO = 1 / 333.87, 21.0
FIELD_UT_PER_LSB = 1 / 6.826667
_PADDING = 16
_FIELD_REFRESH = 13
"""The magnetometer renews its value far more slowly than the rows come (23 times in 300 on a real one)."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuSeconds:
    """Whole seconds of rows: ``counts`` (s,) rows in each second from second ``first_s`` on."""

    first_s: int
    counts: NDArray[np.int64]
    rows: Rows

    def starts(self) -> NDArray[np.int64]:
        """Index of each second's first row; shape (s + 1,), the last is the number of rows."""
        return np.concatenate(([0], np.cumsum(self.counts)))


def make_rows(shift: SimulatedShift, block: SampleBlock) -> Rows:
    """Make the device's rows of a block."""
    rows = np.empty(len(block.time_s), ROW)
    rows["acc"], rows["gyr"] = shift.count(block.readings)
    knots_s = KNOT_S * np.arange(len(shift.errors.temperature_c))
    temperature_c = np.interp(block.time_s, knots_s, shift.errors.temperature_c)
    rows["temp"] = np.rint((temperature_c - TEMPERATURE_AT_ZERO) / TEMPERATURE_PER_LSB)
    held = np.arange(len(rows)) // _FIELD_REFRESH * _FIELD_REFRESH
    rows["mag"] = np.rint(block.state.field_ut[held] @ shift.errors.mounting.T / FIELD_UT_PER_LSB)
    rows["pad"] = _PADDING
    return rows


class SecondCutter:
    """Collects rows until a second of the device's clock is full."""

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._second = 0
        self._rest = np.empty(0, ROW)

    def cut(self, rows: Rows) -> ImuSeconds:
        """Take further rows and give all seconds that are complete now.

        Row i was measured at i / rate, so second T holds the rows from ceil(T rate) on: at 100.09 Hz
        mostly 100, now and then 101.
        """
        rows = np.concatenate((self._rest, rows), dtype=ROW)  # else numpy makes the rows little-endian
        begun = self._first_row(self._second)
        last = int((begun + len(rows)) / self._rate_hz) + 2
        edges = np.array([self._first_row(second) for second in range(self._second, last)]) - begun
        edges = edges[edges <= len(rows)]
        whole = ImuSeconds(self._second, np.diff(edges), rows[: edges[-1]])
        self._second += len(whole.counts)
        self._rest = rows[edges[-1] :]
        return whole

    def _first_row(self, second: int) -> int:
        """Index of the first row of a second."""
        return int(np.ceil(second * self._rate_hz))
