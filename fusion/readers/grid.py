"""From stamped rows to even segments: what is missing, what is bridged, where a segment ends (CONTRACT §5).

Compared to the contract's rule (a step longer than 1.5 periods is a hole): a step is not a hole where the
stamps after it make up for it, because then the row was stamped late, not lost; and a clock too coarse for
the rate (whole milliseconds at 952 Hz) is allowed its own step.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.errors import UnknownRate, UnusableTime
from fusion.recording import MICROSECONDS, QualityFlag, Segment

LONGEST_BRIDGE_US = 50_000
LONGEST_GAP_US = 86_400 * MICROSECONDS
LATE_ROWS = 32
"""How far to look for stamps that make up for a late one."""
SLOWEST_HZ, FASTEST_HZ = 10.0, 4000.0
BLOCK_ROWS = 32
MAX_BLOCKS = 20_000
FITTED_ROWS = 64
"""A shorter run takes the period of the whole recording: its own would be too uncertain."""


@dataclass(frozen=True, slots=True)
class Hole:
    """Before ``row``: ``step_us`` since the row before, of which ``gap_us`` are missing.

    ``rows`` are to be put in (0: the segment ends).
    """

    row: int
    gap_us: int
    rows: int


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Even segments, and the caveats found on the way."""

    segments: tuple[Segment, ...]
    duration_us: int
    flags: tuple[QualityFlag, ...]
    period_us: float
    jitter_us: float


def estimate_period_us(stamps: NDArray[np.int64]) -> float:
    """Median over blocks of 32 rows, so that coarse or jittery stamps and rare holes do not matter.

    Raises
    ------
    UnusableTime
        Fewer than two rows, or stamps that do not advance.
    UnknownRate
        The rate is none that shows an arm's movement.
    """
    if len(stamps) < 2:
        raise UnusableTime(why="rows")
    block = min(BLOCK_ROWS, len(stamps) - 1)
    stride = max(1, (len(stamps) - block) // MAX_BLOCKS)
    steps = (stamps[block::stride] - stamps[:-block:stride]) / block
    period_us = float(np.median(steps[steps >= 0])) if np.any(steps >= 0) else 0.0
    if period_us <= 0.0:
        raise UnusableTime(why="constant")
    if not SLOWEST_HZ <= MICROSECONDS / period_us <= FASTEST_HZ:
        raise UnknownRate(h="-", m=round(MICROSECONDS / period_us, 3))
    return period_us


def find_quantum_us(stamps: NDArray[np.int64]) -> int:
    """The coarseness of the stamps: the greatest common divisor of their first steps."""
    steps = np.abs(np.diff(stamps[:4096]))
    return int(np.gcd.reduce(steps[steps > 0], initial=0))


@njit(cache=True, nogil=True)
def mend_stamps(stamps: NDArray[np.int64], wrap_us: int, period_us: float, counts: NDArray[np.int64]) -> None:
    """Undo wraps of a 32-bit counter and replace single stamps that both neighbours contradict, in place.

    ``counts`` receives the wraps and the replaced stamps. A wrap is one only near both ends of the counter: a
    logger that started again is none.
    """
    shift = np.int64(0)
    margin_us = np.int64(60_000_000)
    previous_raw = stamps[0]
    for k in range(1, len(stamps)):
        raw = stamps[k]
        if wrap_us > 0 and previous_raw > wrap_us - margin_us and raw < margin_us:
            shift += wrap_us
            counts[0] += 1
        previous_raw = raw
        stamps[k] = raw + shift
    for k in range(1, len(stamps) - 1):
        around = stamps[k + 1] - stamps[k - 1]
        is_outside = stamps[k] < stamps[k - 1] or stamps[k] > stamps[k + 1]
        if is_outside and 0 < around <= 4 * period_us:
            stamps[k] = stamps[k - 1] + around // 2
            counts[1] += 1


@njit(cache=True, nogil=True)
def is_made_up(stamps: NDArray[np.int64], row: int, period_us: float) -> bool:
    """Whether the rows after a long step come so fast that nothing was lost."""
    for ahead in range(1, LATE_ROWS):
        if row + ahead >= len(stamps):
            return False
        late_us = stamps[row + ahead] - stamps[row - 1] - (ahead + 1) * period_us
        if late_us < -LONGEST_BRIDGE_US:
            return False
        if late_us <= 0.5 * period_us:
            return True
    return False


@njit(cache=True, nogil=True)
def find_long_steps(
    stamps: NDArray[np.int64], limit_us: float, period_us: float, rows: NDArray[np.int64]
) -> int:
    """Write the rows before which time is missing or runs backwards; return how many there are in all."""
    found = 0
    for k in range(1, len(stamps)):
        step = stamps[k] - stamps[k - 1]
        if step < 0 or (step > limit_us and not is_made_up(stamps, k, period_us)):
            if found < len(rows):
                rows[found] = k
            found += 1
    return found


@njit(cache=True, nogil=True)
def fit_line(stamps: NDArray[np.int64], places: NDArray[np.int64]) -> tuple[float, float, float]:
    """Least squares of stamps on their place in the grid; return offset, period and RMS of the residuals.

    ``places`` is empty where place = row.
    """
    n = len(stamps)
    has_places = len(places) > 0
    mean_x = (n - 1) / 2.0 if not has_places else places.mean()
    mean_y = 0.0
    for k in range(n):
        mean_y += (stamps[k] - stamps[0]) / n
    xx = xy = 0.0
    for k in range(n):
        x = (places[k] if has_places else k) - mean_x
        y = (stamps[k] - stamps[0]) - mean_y
        xx += x * x
        xy += x * y
    period = xy / xx
    squares = 0.0
    for k in range(n):  # a pass of its own: the sums above are too large to give it by difference
        x = (places[k] if has_places else k) - mean_x
        squares += (stamps[k] - stamps[0] - mean_y - period * x) ** 2
    return mean_y - period * mean_x, period, np.sqrt(squares / n)


def longest_even_step_us(stamps: NDArray[np.int64], period_us: float) -> float:
    """How long a step an unbroken run can show on so coarse a clock: 2 ms at 952 Hz in whole milliseconds."""
    quantum_us = find_quantum_us(stamps)
    return quantum_us * math.ceil(period_us / quantum_us - 1e-6) if quantum_us else 0.0


def find_holes(stamps: NDArray[np.int64], period_us: float) -> list[Hole]:
    """Where rows are missing.

    Raises
    ------
    UnusableTime
        One row in ten would be a hole: the stamps are not those of an even sampling.
    """
    limit_us = max(1.5 * period_us, longest_even_step_us(stamps, period_us))
    rows = np.empty(len(stamps) // 10 + 100, np.int64)
    found = find_long_steps(stamps, limit_us, period_us, rows)
    if found > len(rows):
        raise UnusableTime(why="irregular")
    return [_measure_hole(stamps, int(row), period_us) for row in rows[:found]]


def _measure_hole(stamps: NDArray[np.int64], row: int, period_us: float) -> Hole:
    step_us = int(stamps[row] - stamps[row - 1])
    if 0 < step_us <= LONGEST_BRIDGE_US:
        return Hole(row, round(step_us - period_us), max(1, round(step_us / period_us) - 1))
    if 0 < step_us <= LONGEST_GAP_US:
        return Hole(row, round(step_us - period_us), 0)
    return Hole(row, 0, 0)


def bridge_rows(values: NDArray[np.float32], holes: list[Hole], first: int) -> NDArray[np.float32]:
    """Put rows into short holes by linear interpolation; ``first`` is the place of ``values[0]``."""
    pieces: list[NDArray[np.float32]] = []
    at = 0
    for hole in holes:
        row = hole.row - first
        weights = (np.arange(1, hole.rows + 1) / (hole.rows + 1))[:, None]
        between = values[row - 1] * (1 - weights) + values[row] * weights
        pieces += [values[at:row], between.astype(np.float32)]
        at = row
    return np.concatenate([*pieces, values[at:]])


def find_places(n_rows: int, holes: list[Hole], first: int) -> NDArray[np.int64]:
    """The place of each row in the grid, once the bridged rows are in; empty where there are none."""
    if not holes:
        return np.empty(0, np.int64)
    places = np.arange(n_rows, dtype=np.int64)
    for hole in holes:
        places[hole.row - first :] += hole.rows
    return places


def bridged_ranges(holes: list[Hole], first: int) -> tuple[tuple[int, int], ...]:
    """Row ranges that were put in."""
    ranges = []
    added = 0
    for hole in holes:
        start = hole.row - first + added
        ranges.append((start, start + hole.rows))
        added += hole.rows
    return tuple(ranges)
