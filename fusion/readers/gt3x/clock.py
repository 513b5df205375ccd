"""The clock of a `.gt3x`: its seconds in order, with runs, gaps, doubles and a clock that was set.

Each SENSOR_DATA record carries one second of the device's clock and the rows of that second. The order of the
file is the order of time; the stamps give the time missing between two records, and may be wrong.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.recording import QualityFlag, flag_counts

LONGEST_GAP_S = 86_400
"""A longer step forward is a clock that was set, not a gap: it adds no time."""
LONGEST_ALONE_S = 60
"""A single first or last second, so far from the others, has a wrong stamp."""
MAX_CLOCK_ZEROS = 16
ROW_TOLERANCE = 0.04
"""A second whose row count is further from the usual one has lost rows, and it is not known which."""


@dataclass(frozen=True, slots=True, eq=False)
class Seconds:
    """The SENSOR_DATA records in the order of the file, one row each.

    ``unix_s``: device clock; ``first_row``, ``n_rows``: where its samples lie; ``schema``: counts the changes
    of the row layout.
    """

    unix_s: NDArray[np.int64]
    first_row: NDArray[np.int64]
    n_rows: NDArray[np.int64]
    schema: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.unix_s)

    def keep(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> "Seconds":
        """Return some of them."""
        return Seconds(self.unix_s[chosen], self.first_row[chosen], self.n_rows[chosen], self.schema[chosen])


@dataclass(frozen=True, slots=True)
class Run:
    """Seconds without a break. ``start_s`` from the recording's first second, device steps taken out."""

    start_s: int
    first: int
    stop: int

    @property
    def end_s(self) -> int:
        """First second after the run."""
        return self.start_s + self.stop - self.first


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """Runs in the order of the file; ``seconds`` are those that were kept.

    ``clock_zeros_s``: what the device's clock read at the first sample, once for each time it was set.
    """

    seconds: Seconds
    runs: tuple[Run, ...]
    flags: tuple[QualityFlag, ...]
    clock_zeros_s: tuple[int, ...]

    def place_s(self, unix_s: int) -> int:
        """Where a stamp of the device lies, seconds from the first sample.

        A clock that was set in between has several readings of the file's time; the first that lies inside
        the recording is taken.
        """
        places = [unix_s - zero_s for zero_s in self.clock_zeros_s]
        inside = [place for place in places if 0 <= place <= self.runs[-1].end_s]
        return inside[0] if inside else min(places, key=abs)


def repair_outliers(unix_s: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Replace single stamps whose neighbours agree with each other but not with them.

    Returns the stamps, shape (n,), Unix seconds, and how many were replaced.
    """
    stamps = unix_s.copy()
    if len(stamps) < 3:
        return stamps, 0
    before, here, after = stamps[:-2], stamps[1:-1], stamps[2:]
    lonely = (after - before == 2) & (here != before + 1)
    stamps[1:-1][lonely] = before[lonely] + 1
    count = int(lonely.sum())
    if abs(stamps[1] - stamps[0]) > LONGEST_ALONE_S and stamps[2] - stamps[1] == 1:
        stamps[0] = stamps[1] - 1
        count += 1
    if abs(stamps[-1] - stamps[-2]) > LONGEST_ALONE_S and stamps[-2] - stamps[-3] == 1:
        stamps[-1] = stamps[-2] + 1
        count += 1
    return stamps, count


def find_doubles(
    seconds: Seconds, acc: NDArray[np.float32], gyr: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], int, int]:
    """Mark seconds to leave out because the one before has the same stamp.

    Returns the mask of those kept, the count of identical doubles and of doubles that differ.
    """
    kept = np.ones(len(seconds), np.bool_)
    kept[1:] = np.diff(seconds.unix_s) != 0
    identical = 0
    for place in np.flatnonzero(~kept):
        rows = [
            slice(seconds.first_row[k], seconds.first_row[k] + seconds.n_rows[k]) for k in (place - 1, place)
        ]
        identical += int(
            np.array_equal(acc[rows[0]], acc[rows[1]]) and np.array_equal(gyr[rows[0]], gyr[rows[1]])
        )
    return kept, identical, int((~kept).sum()) - identical


def find_runs(seconds: Seconds) -> tuple[tuple[Run, ...], tuple[QualityFlag, ...]]:
    """Cut the seconds where the clock does not step by one, or the row layout changes.

    A step back, or a step forward by more than a day, is a clock that was set: the next run follows at once,
    because the length of the break is unknown.
    """
    unix_s = seconds.unix_s
    breaks = np.flatnonzero((np.diff(unix_s) != 1) | (np.diff(seconds.schema) != 0)) + 1
    edges = [0, *breaks.tolist(), len(unix_s)]
    runs: list[Run] = []
    flags: list[QualityFlag] = []
    for first, stop in pairwise(edges):
        if not runs:
            runs.append(Run(0, first, stop))
            continue
        step_s = int(unix_s[first] - unix_s[first - 1])
        gap_s = step_s - 1 if 1 < step_s <= LONGEST_GAP_S else 0
        if gap_s == 0 and step_s != 1:
            code, at_s = Caveat.CLOCK_BACK if step_s < 0 else Caveat.CLOCK_FWD, float(runs[-1].end_s)
            flags.append(QualityFlag(code, 1, 0.0, at_s, at_s, {"step_s": step_s}))
        runs.append(Run(runs[-1].end_s + gap_s, first, stop))
    return tuple(runs), tuple(flags)


def order_seconds(seconds: Seconds, acc: NDArray[np.float32], gyr: NDArray[np.float32]) -> Timeline:
    """Repair lonely stamps, leave out doubles and partial seconds, and find the runs."""
    stamps, repaired = repair_outliers(seconds.unix_s)
    stamped = replace(seconds, unix_s=stamps)
    kept, identical, differing = find_doubles(stamped, acc, gyr)
    single = stamped.keep(kept)
    usual = float(np.median(single.n_rows))
    whole = single.keep(np.abs(single.n_rows - usual) <= max(2.0, ROW_TOLERANCE * usual))
    runs, clock_flags = find_runs(whole)
    counts = {
        Caveat.CLOCK_FWD: repaired,
        Caveat.DUP: identical,
        Caveat.DUP_CONFLICT: differing,
        Caveat.SEC_COUNT: int((single.n_rows < usual).sum()),
    }
    zeros = dict.fromkeys(int(whole.unix_s[run.first]) - run.start_s for run in runs)
    return Timeline(whole, runs, flag_counts(counts) + clock_flags, tuple(zeros)[:MAX_CLOCK_ZEROS])
