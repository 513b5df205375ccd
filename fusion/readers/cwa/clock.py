"""The clock of a `.cwa`: one stamp for each block, from which segments, holes and the true rate follow.

The sensor samples by a clock of its own; each block gives the reading of the device's clock at one of its
rows, to 1/32768 s. The stamps of successive blocks show whether time is missing between them, within their
own scatter: the limit is half a sample period (a step longer than 1.5 periods is a hole), or
eight times the scatter of the stamps where that is more and no block's number is missing. Where the row that
a stamp belongs to moves by one, the limit is a period more: that row is rounded (40 to 41 in a real AX6,
whose stamps go on 0.4065 s apart).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import UnknownRate, UnusableTime
from fusion.readers.samples import SampleColumns
from fusion.readers.timebase.grid import (
    FASTEST_HZ,
    LONGEST_GAP_US,
    SLOWEST_HZ,
    FittedRun,
    Grid,
    Holes,
    flag_time,
    place_segments,
)
from fusion.recording import LONGEST_BRIDGE_US, MICROSECONDS, QualityFlag, flag_gaps

# The order of the blocks: one session, each block once, by their numbers where some came late.

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Decoded blocks, one entry each.

    ``first_row``, ``n_rows``: where the samples lie in the columns; ``session``, ``sequence``: the block's
    numbers; ``rate_code``: of the nominal rate; ``anchor_us``: the device's clock, microseconds since 1970,
    at the row ``anchor_row`` counted from the block's first, which may lie outside it; -1: no stamp.
    """

    first_row: Indices
    n_rows: Indices
    session: Indices
    sequence: Indices
    rate_code: Indices
    anchor_us: Indices
    anchor_row: Indices

    def __len__(self) -> int:
        return len(self.first_row)

    def take(self, chosen: NDArray[np.bool_] | Indices) -> "Blocks":
        """Return some of them, or all in another order."""
        return Blocks(*(getattr(self, name)[chosen] for name in self.__slots__))


def order_blocks(
    blocks: Blocks, columns: SampleColumns, session: int
) -> tuple[Blocks, tuple[QualityFlag, ...]]:
    """Leave out other sessions and doubles, put late blocks into their place; the columns follow.

    ``session``: the one that the header names.
    """
    is_own = find_session(blocks, session)
    own = blocks.take(is_own)
    order, late = find_order(own)
    ordered = own.take(order)
    is_double = find_doubles(ordered)
    identical = count_identical(ordered, columns, np.flatnonzero(is_double))
    kept = ordered.take(~is_double)
    other_rows = int(blocks.n_rows[~is_own].sum())
    counts = {
        Caveat.SESSION: int(np.count_nonzero(~is_own)),
        Caveat.ORDER: late,
        Caveat.DUP: identical,
        Caveat.DUP_CONFLICT: int(np.count_nonzero(is_double)) - identical,
    }
    facts = {Caveat.SESSION: {"n": other_rows}}
    flags = tuple(
        QualityFlag(code, count, facts=facts.get(code, {})) for code, count in counts.items() if count
    )
    if not flags:
        return kept, flags
    columns.arrange(find_rows(kept))
    return replace(kept, first_row=np.cumsum(kept.n_rows) - kept.n_rows), flags


def find_session(blocks: Blocks, named: int) -> NDArray[np.bool_]:
    """Mark the blocks of one session: the named one if any block is of it, else the one of most blocks.

    A device's file is emptied when it is set up anew: what bears another number is what was left of an
    earlier recording, perhaps another person's. Blocks without a number (0) are kept.
    """
    numbers, counts = np.unique(blocks.session[blocks.session != 0], return_counts=True)
    if len(numbers) < 2:
        return np.ones(len(blocks), np.bool_)
    own = named if named in numbers else int(numbers[np.argmax(counts)])
    is_own: NDArray[np.bool_] = (blocks.session == own) | (blocks.session == 0)
    return is_own


def find_order(blocks: Blocks) -> tuple[Indices, int]:
    """Order by number where number and clock agree that blocks came late; also how many did.

    A number that goes back while the clock goes on is a device that started again.
    """
    order = np.arange(len(blocks))
    back = np.diff(blocks.sequence) <= 0
    on = np.diff(blocks.anchor_us) > 0
    if not np.any(back & ~on):
        return order, 0
    starts = np.concatenate([[0], np.flatnonzero(back & on) + 1, [len(blocks)]])
    late = 0
    for part in np.unique(np.searchsorted(starts, np.flatnonzero(back & ~on), "right")).tolist():
        inside = slice(int(starts[part - 1]), int(starts[part]))
        sequence = blocks.sequence[inside]
        places = np.argsort(sequence, kind="stable")
        anchors = blocks.anchor_us[inside][places]
        if np.all(np.diff(anchors[anchors >= 0]) >= 0):
            late += int(np.count_nonzero(sequence < np.maximum.accumulate(sequence)))
            order[inside] = places + inside.start
    return order, late


def find_doubles(blocks: Blocks) -> NDArray[np.bool_]:
    """Mark blocks with the numbers and the stamp of the one before."""
    is_double = np.zeros(len(blocks), np.bool_)
    names = (blocks.session, blocks.sequence, blocks.anchor_us)
    is_double[1:] = np.logical_and.reduce([np.diff(values) == 0 for values in names])
    return is_double


def count_identical(blocks: Blocks, columns: SampleColumns, doubles: Indices) -> int:
    """How many of the doubles hold what the block before holds."""
    alike = doubles[blocks.n_rows[doubles] == blocks.n_rows[doubles - 1]]
    if len(alike) == 0:
        return 0
    here, before = (find_rows(blocks.take(alike - shift)) for shift in (0, 1))
    is_same = np.all(columns.acc[here] == columns.acc[before], axis=1)
    is_same &= np.all(columns.gyr[here] == columns.gyr[before], axis=1)
    edges = np.cumsum(blocks.n_rows[alike]) - blocks.n_rows[alike]
    return int(np.count_nonzero(np.logical_and.reduceat(is_same, edges)))


def find_rows(blocks: Blocks) -> Indices:
    """The rows of blocks one after the other."""
    stops = np.cumsum(blocks.n_rows)
    shifts = np.repeat(blocks.first_row - (stops - blocks.n_rows), blocks.n_rows)
    rows: Indices = np.arange(len(shifts)) + shifts
    return rows


HIGHEST_RATE_HZ, HIGHEST_CODE = 3200.0, 15
WIDEST_RATE_ERROR = 0.1
"""The sensor is made to keep its rate within a few percent."""
SURE_SCATTERS = 8.0
NORMAL_PER_MEDIAN = 1.4826
"""The standard deviation of a normal scatter for its median absolute deviation."""
LATE_BLOCKS = 8
"""How far to look for stamps that take a step back: until then the stamps between are not believed."""
FITTED_BLOCKS = 8
"""A shorter run takes the period of the whole recording: its own would be too uncertain."""
END_BLOCKS = 25
Floats = NDArray[np.float64]


def nominal_hz(rate_code: NDArray[np.int64]) -> Floats:
    """The rate that was asked of the sensor (Open Movement, cwa.h)."""
    return np.asarray(HIGHEST_RATE_HZ / 2.0 ** (HIGHEST_CODE - (rate_code & HIGHEST_CODE)), np.float64)


def cut_blocks(blocks: Blocks, columns: SampleColumns) -> tuple[Grid, int | None]:
    """Cut ordered blocks into segments; ``columns`` hold their rows one after the other.

    Also gives the device's clock at the first row, microseconds since 1970; None where no block has a stamp.

    Raises
    ------
    fusion.errors.UnusableTime, fusion.errors.UnknownRate
        The stamps give no even sampling at a usable rate.
    """
    period_us = measure_periods(blocks)
    lengths_us = blocks.n_rows * period_us
    starts_us = place_starts(blocks, period_us)
    jitter_us, limits_us = find_limits(blocks, starts_us, period_us)
    n_unstamped = int(np.count_nonzero(blocks.anchor_us < 0)) % len(blocks)  # if none has a stamp, 0
    mended = mend_starts(starts_us, lengths_us, limits_us) + n_unstamped
    holes = find_holes(blocks, starts_us, period_us, limits_us)
    runs = fit_runs(blocks, holes, starts_us, period_us)
    segments = place_segments(columns, holes, runs)
    usual_us = float(np.median(period_us))
    duration_us = segments[-1].end_us
    flags = flag_time(holes, mended, jitter_us / usual_us) + flag_gaps(segments, duration_us)
    grid = Grid(segments, duration_us, flags, usual_us, jitter_us)
    return grid, round(starts_us[0]) if np.any(blocks.anchor_us >= 0) else None


def measure_periods(blocks: Blocks) -> Floats:
    """The sample period of each block, microseconds: for each nominal rate the median over its blocks.

    Raises
    ------
    UnusableTime
        Stamps and nominal rate have nothing to do with each other.
    UnknownRate
        A rate is none that shows an arm's movement.
    """
    at_row = np.cumsum(blocks.n_rows) - blocks.n_rows + blocks.anchor_row
    rows, steps_us = np.diff(at_row), np.diff(blocks.anchor_us).astype(np.float64)
    follows = (np.diff(blocks.sequence) == 1) & (np.diff(blocks.session) == 0) & (rows > 0)
    follows &= (np.diff(blocks.rate_code) == 0) & (blocks.anchor_us[1:] >= 0) & (blocks.anchor_us[:-1] >= 0)
    period_us = MICROSECONDS / nominal_hz(blocks.rate_code)
    for code in np.unique(blocks.rate_code):
        chosen = follows & (blocks.rate_code[1:] == code)
        measured_us = float(np.median(steps_us[chosen] / rows[chosen])) if chosen.any() else 0.0
        if measured_us != 0.0:
            period_us[blocks.rate_code == code] = measured_us
    if np.any(np.abs(period_us * nominal_hz(blocks.rate_code) / MICROSECONDS - 1.0) > WIDEST_RATE_ERROR):
        raise UnusableTime(why="irregular")
    rates_hz = MICROSECONDS / period_us
    is_usable = (rates_hz >= SLOWEST_HZ) & (rates_hz <= FASTEST_HZ)
    if not is_usable.all():
        raise UnknownRate(m=round(float(rates_hz[np.argmin(is_usable)]), 4))
    return period_us


def place_starts(blocks: Blocks, period_us: Floats) -> Floats:
    """The time of each block's first row, us; from the numbers of the blocks where one has no stamp."""
    missed = np.clip(np.diff(blocks.sequence, prepend=blocks.sequence[0] - 1) - 1, 0, None)
    missed = np.where(missed * blocks.n_rows * period_us > LONGEST_GAP_US, 0, missed)
    rows_us = blocks.n_rows * period_us
    counted_us = np.cumsum((missed + 1) * rows_us) - rows_us
    known = np.flatnonzero(blocks.anchor_us >= 0)
    if len(known) == 0:
        return counted_us
    starts_us = blocks.anchor_us - blocks.anchor_row * period_us
    before = known[np.maximum(np.searchsorted(known, np.arange(len(blocks)), "right") - 1, 0)]
    return np.where(blocks.anchor_us >= 0, starts_us, starts_us[before] + counted_us - counted_us[before])


def find_lags(starts_us: Floats, lengths_us: Floats) -> Floats:
    """How much later each block begins than the one before it ends."""
    return starts_us[1:] - (starts_us[:-1] + lengths_us[:-1])


def find_limits(blocks: Blocks, starts_us: Floats, period_us: Floats) -> tuple[float, Floats]:
    """How much the stamps scatter, and from which lag on time is missing before each block but the first.

    Where the numbers say that a block is missing, half a period is enough.
    """
    lags_us = find_lags(starts_us, blocks.n_rows * period_us)
    if len(lags_us) == 0:
        return 0.0, lags_us
    middle_us = np.median(lags_us)
    scatter_us = NORMAL_PER_MEDIAN * float(np.median(np.abs(lags_us - middle_us)))
    is_skipped = np.diff(blocks.sequence) > 1
    sure_us = np.where(is_skipped, 0.0, SURE_SCATTERS * scatter_us)
    has_moved = np.abs(np.diff(blocks.anchor_row)) == 1
    least_us = np.where(has_moved, 1.5, 0.5) * period_us[1:]
    return scatter_us / np.sqrt(2.0), np.maximum(least_us, sure_us)


def mend_starts(starts_us: Floats, lengths_us: Floats, limits_us: Floats) -> int:
    """Put stamps that those around them contradict into line, in place; return how many.

    Raises
    ------
    UnusableTime
        One block in ten would have a wrong stamp or a hole before it: the stamps are of no use.
    """
    lags_us = find_lags(starts_us, lengths_us)
    places = np.flatnonzero(np.abs(lags_us) > limits_us)
    if len(places) > len(starts_us) // 10 + 100:
        raise UnusableTime(why="irregular")
    mended = done = 0
    for place in places.tolist():
        taken_back = np.cumsum(lags_us[place : place + LATE_BLOCKS + 1])
        (ends,) = np.nonzero(np.abs(taken_back[1:]) <= limits_us[place])
        if place < done or len(ends) == 0:
            continue
        stop = place + 1 + int(ends[0]) + 1
        starts_us[place + 1 : stop] = starts_us[place] + np.cumsum(lengths_us[place : stop - 1])
        mended += stop - place - 1
        done = stop
    if len(starts_us) < 3:
        return mended
    # a first or last stamp that lies over a day from all others
    is_far = np.abs(find_lags(starts_us, lengths_us)) > LONGEST_GAP_US
    if is_far[0] and not is_far[1]:
        starts_us[0] = starts_us[1] - lengths_us[0]
    if is_far[-1] and not is_far[-2]:
        starts_us[-1] = starts_us[-2] + lengths_us[-2]
    return mended + int(is_far[0] and not is_far[1]) + int(is_far[-1] and not is_far[-2])


def find_holes(blocks: Blocks, starts_us: Floats, period_us: Floats, limits_us: Floats) -> Holes:
    """Where rows are missing, the clock was set or the rate changed."""
    lags_us = find_lags(starts_us, blocks.n_rows * period_us)
    steps_us = lags_us + period_us[:-1]
    is_other_rate = np.diff(period_us) != 0.0
    is_hole = (lags_us > limits_us) | ((lags_us < -limits_us) & (steps_us <= 0.0)) | is_other_rate
    before = np.flatnonzero(is_hole)
    step_us = np.rint(steps_us[before]).astype(np.int64)
    added = np.maximum(1, np.rint(steps_us[before] / period_us[before]).astype(np.int64) - 1)
    is_bridge = (step_us > 0) & (step_us <= LONGEST_BRIDGE_US) & ~is_other_rate[before]
    return Holes(blocks.first_row[before + 1], step_us, np.where(is_bridge, added, 0))


def fit_runs(blocks: Blocks, holes: Holes, starts_us: Floats, period_us: Floats) -> list[FittedRun]:
    """Lay a line through the stamps of each unbroken run."""
    is_cut = holes.added == 0
    row_edges = [0, *holes.row[is_cut].tolist(), int(blocks.n_rows.sum())]
    edges = [*np.searchsorted(blocks.first_row, row_edges[:-1]).tolist(), len(blocks)]
    is_set = [False, *holes.is_set[is_cut].tolist()]
    runs = []
    for number, was_set in enumerate(is_set):
        first, stop = edges[number], edges[number + 1]
        first_row, stop_row = row_edges[number], row_edges[number + 1]
        inside = holes.take(first_row, stop_row)
        rows = blocks.first_row[first:stop] - first_row
        put_in = np.concatenate([[0], np.cumsum(inside.added)])
        places = (rows + put_in[np.searchsorted(inside.row, rows, "right")]).astype(np.float64)
        offset_us, fitted_us = fit_ends(starts_us[first:stop], places, float(period_us[first]))
        first_us = round(starts_us[first])
        runs.append(FittedRun(first_row, stop_row, first_us, offset_us, fitted_us, 0.0, was_set))
    return runs


def fit_ends(starts_us: Floats, places: Floats, period_us: float) -> tuple[float, float]:
    """A line from the first stamps of a run to its last; gives the offset of its first row and its period.

    Not least squares: over hours the sensor's clock wanders with its temperature, and a line through the
    middle of that would miss the ends, by which durations are known.
    """
    off_us = starts_us - starts_us[0] - places * period_us
    n = min(END_BLOCKS, len(places) // 4)
    if len(places) < FITTED_BLOCKS:
        return float(np.median(off_us)), period_us
    early, late = slice(0, n), slice(len(places) - n, None)
    rise_us = float(np.median(off_us[late]) - np.median(off_us[early]))
    tilt = rise_us / float(np.mean(places[late]) - np.mean(places[early]))
    return float(np.median(off_us[early]) - tilt * np.mean(places[early])), period_us + tilt
