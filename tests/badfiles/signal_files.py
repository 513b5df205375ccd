"""Files whose form is right and whose readings are not (E)."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from acromion.fusion.readers.tables.csv import RECORD
from tests.badfiles.arm import Matrix, minute
from tests.badfiles.outcomes import Content
from tests.badfiles.table_files import ACTILIFE, ACTILIFE_COLUMNS, changed
from tests.fusion.made_motion import rest_and_turn, tumble
from tests.fusion.readers.tables.table_builder import HEADER

PREAMBLE = "# acc_range_g: 16\n# gyr_range_dps: 2000\n"
UNITLESS = "time_us,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z"


@cache
def tumble_and_rest() -> Matrix:
    """Four minutes of turning about all axes with rests between."""
    parts = [tumble(10.0, 100.0, seed, 2.0) for seed in range(24)]
    columns = np.vstack([np.hstack([part.acc_g, part.gyr_dps]) for part in parts])
    noise: Matrix = np.random.default_rng(1).normal(0.0, 1.0, columns.shape) * ([0.002] * 3 + [0.1] * 3)
    return columns + noise


def tumbled(
    change: Callable[[Matrix], None], write: Callable[[Matrix], str] = changed
) -> Callable[[], bytes]:
    """Those four minutes changed in place."""

    def make() -> bytes:
        columns = tumble_and_rest().copy()
        change(columns)
        return write(columns).encode()

    return make


def turned_all_round(change: Callable[[Matrix], None]) -> Callable[[], bytes]:
    """Two minutes of rests in forty directions, changed in place."""

    def make() -> bytes:
        motion = rest_and_turn(40)
        columns = np.hstack([motion.acc_g, motion.gyr_dps])
        columns += np.random.default_rng(1).normal(0.0, 1.0, columns.shape) * ([0.002] * 3 + [0.1] * 3)
        change(columns)
        return changed(columns).encode()

    return make


def write_actilife(columns: Matrix) -> str:
    """The export of a GT9X, as ActiLife writes it."""
    rows = ("{:.6f},{:.6f},{:.6f},{:.6f},{:.6f},{:.6f}\n".format(*row) for row in columns.tolist())
    head = ACTILIFE.format(order="M/d/yyyy", date="3/14/2026", epoch="00:00:00")
    return head + ACTILIFE_COLUMNS + "\n" + "".join(rows)


def write_registers(columns: Matrix) -> bytes:
    """26-byte records of the LSM9DS1 at 2 g and 245 deg/s, whose frame is left-handed."""
    records = np.zeros(len(columns), RECORD)
    time_us = 1_772_438_220_000_000 + 10_000 * np.arange(len(columns))
    records["s"], records["us"] = np.divmod(time_us, 1_000_000)
    mirror = [-1, 1, 1]
    records["acc"] = np.round(columns[:, :3] / 0.000061) * mirror
    records["gyr"] = np.round(columns[:, 3:] / 0.00875) * mirror
    return records.tobytes()


def mixed(order: Sequence[int] = range(6), factors: Sequence[float] = (1.0,) * 6) -> Callable[[Matrix], None]:
    """The channels in another order, then times factors."""

    def change(columns: Matrix) -> None:
        columns[:] = columns[:, list(order)] * factors

    return change


def multiply_gyro(factor: float) -> Callable[[Matrix], None]:
    return mixed(factors=[1.0] * 3 + [factor] * 3)


def filled(rows: slice, axes: slice, value: float | None = None) -> Callable[[Matrix], None]:
    """One value in some rows and channels; by default that of the first of these rows."""

    def change(columns: Matrix) -> None:
        columns[rows, axes] = columns[rows, axes][0] if value is None else value

    return change


def in_turn(*changes: Callable[[Matrix], None]) -> Callable[[Matrix], None]:
    def change(columns: Matrix) -> None:
        for one in changes:
            one(columns)

    return change


def hang(columns: Matrix) -> None:
    """The arm hangs all the time; nothing tells the gyroscope's unit."""
    columns[:] = columns[np.arange(len(columns)) % 1300]


def readings(times: int = 1) -> Matrix:
    """Shape (n, 6): g and deg/s."""
    return np.hstack(minute(100.0, times))


def altered(change: Callable[[Matrix], None], header: str = HEADER, times: int = 1) -> Callable[[], Content]:
    """The minute with its readings changed in place."""
    return rewritten(change, lambda columns: changed(columns, header), times)


def rewritten(
    change: Callable[[Matrix], None], write: Callable[[Matrix], Content], times: int = 1
) -> Callable[[], Content]:
    """The same, as another device writes it."""

    def make() -> Content:
        columns = readings(times)
        change(columns)
        return write(columns)

    return make


def scaled(acc: float, gyr: float, header: str = UNITLESS, times: int = 1) -> Callable[[], Content]:
    def change(columns: Matrix) -> None:
        columns[:, :3] *= acc
        columns[:, 3:] *= gyr

    return altered(change, header, times)


def leave(columns: Matrix) -> None:
    """Nothing is changed: the control."""


negate_gyro = multiply_gyro(-1.0)


def delay_gyro(rows: int) -> Callable[[Matrix], None]:
    """The gyroscope so many hundredths of a second late."""

    def change(columns: Matrix) -> None:
        columns[:, 3:] = np.roll(columns[:, 3:], rows, axis=0)

    return change


def noise_for_gyro(columns: Matrix) -> None:
    columns[:, 3:] = np.random.default_rng(2).normal(0.0, 30.0, (len(columns), 3))


def throw(columns: Matrix) -> None:
    """A jerk to one side and back, cut off at 2000 deg/s."""
    columns[4800:4805, 3] = 1999.94
    columns[4805:4810, 3] = -1999.94


def zeros_of(rows: int, every: int = 1000) -> Callable[[Matrix], None]:
    """Holes of so many rows, one every so many, filled with zeros."""

    def change(columns: Matrix) -> None:
        for first in range(1500, len(columns) - rows, every):
            columns[first : first + rows] = 0.0

    return change


def zero_acc(columns: Matrix) -> None:
    """The accelerometer alone at zero for 80 ms, five times."""
    for first in range(1500, 6000, 1000):
        columns[first : first + 8, :3] = 0.0


def spikes(columns: Matrix) -> None:
    """Bits that flipped on the bus: eight samples in all."""
    for k, row in enumerate(range(1700, 5700, 500)):
        columns[row, k % 6] += 8.0 if k % 6 < 3 else 1500.0
