"""Files that show what the person did with the sensor: rows 91 to 94 and 96."""

from collections.abc import Callable
from functools import cache

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.simulation import simulate_shift
from tests.badfiles.arm import Matrix, minute
from tests.badfiles.table_files import canon, changed, stamped
from tests.factories import move_arm
from tests.simulated_shifts import make_perfect, play_shift

SWING_HZ, SWING_DEG, PAUSE_AT_S = 0.25, 30.0, 28.0
DESK_S = 720
WORK_HZ = 25.0
LUNCH_US = 360_000_000


def with_noise(columns: Matrix, acc_g: float = 0.004, gyr_dps: float = 0.1) -> Matrix:
    """What a sensor adds of its own."""
    return columns + np.random.default_rng(7).normal(0.0, 1.0, columns.shape) * (3 * [acc_g] + 3 * [gyr_dps])


def swing(pause_s: float, duration_s: float = 60.0) -> Callable[[], bytes]:
    """An arm goes up and down without a rest but one of ``pause_s`` while it hangs."""

    def elevate(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        moved_s = time_s - np.clip(time_s - PAUSE_AT_S, 0.0, pause_s)
        return SWING_DEG * (1.0 - np.cos(2 * np.pi * SWING_HZ * moved_s))

    def make() -> bytes:
        (segment,) = move_arm(elevate, duration_s).recording.segments
        return changed(with_noise(np.hstack([segment.acc_g, segment.gyr_dps]))).encode()

    return make


def turned(signs: tuple[int, int, int]) -> Callable[[], bytes]:
    """The sensor sits on the arm turned by half a turn: two of its axes point the other way."""
    return lambda: changed(np.hstack(minute()) * (*signs, *signs)).encode()


def left_on_a_desk() -> bytes:
    """From the last hold on, the sensor lies where it is."""
    worn = np.hstack(minute())
    lying = with_noise(np.tile(worn[-500:].mean(axis=0), (DESK_S * 100, 1)), 0.002, 0.05)
    return changed(np.vstack([worn, lying])).encode()


@cache
def put_back_turned() -> bytes:
    """Work, six minutes switched off at lunch, and work with the sensor a quarter turn about its x axis."""
    made = play_shift(make_perfect(simulate_shift("gt9x", 1.5, 1, WORK_HZ)))
    work = with_noise(np.hstack([made.acc_g, made.gyr_dps]).astype(float))
    half = len(work) // 2
    work[half:] = work[half:, [0, 2, 1, 3, 5, 4]] * (1, -1, 1, 1, -1, 1)
    rows = changed(work).split("\n")[1:-1]
    stamps = (round(k * 1e6 / WORK_HZ) + (LUNCH_US if k >= half else 0) for k in range(len(work)))
    return stamped(list(stamps), [row.split(",", 1)[1] for row in rows]).encode()


def the_same_twice() -> bytes:
    """The rows of a file a second time behind themselves, as a copy that was begun anew leaves them."""
    return (canon() + canon().split("\n", 1)[1]).encode()
