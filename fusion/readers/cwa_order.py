"""Blocks of a `.cwa` in order: one session, each block once, by their numbers where some came late."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.readers.samples import SampleColumns
from fusion.recording import QualityFlag

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
        "W-SESSION": int(np.count_nonzero(~is_own)),
        "W-ORDER": late,
        "W-DUP": identical,
        "W-DUP-CONFLICT": int(np.count_nonzero(is_double)) - identical,
    }
    facts = {"W-SESSION": {"n": other_rows}}
    flags = tuple(
        QualityFlag(code, count, facts=facts.get(code, {})) for code, count in counts.items() if count
    )
    return (_follow(kept, columns) if flags else kept), flags


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
    here, before = (list_rows(blocks.take(alike - shift)) for shift in (0, 1))
    is_same = np.all(columns.acc[here] == columns.acc[before], axis=1)
    is_same &= np.all(columns.gyr[here] == columns.gyr[before], axis=1)
    edges = np.cumsum(blocks.n_rows[alike]) - blocks.n_rows[alike]
    return int(np.count_nonzero(np.logical_and.reduceat(is_same, edges)))


def list_rows(blocks: Blocks) -> Indices:
    """The rows of blocks one after the other."""
    stops = np.cumsum(blocks.n_rows)
    shifts = np.repeat(blocks.first_row - (stops - blocks.n_rows), blocks.n_rows)
    rows: Indices = np.arange(len(shifts)) + shifts
    return rows


def _follow(blocks: Blocks, columns: SampleColumns) -> Blocks:
    """Put the columns into the order of the blocks."""
    columns.arrange(list_rows(blocks))
    stops = np.cumsum(blocks.n_rows)
    return Blocks(stops - blocks.n_rows, *(getattr(blocks, name) for name in Blocks.__slots__[1:]))
