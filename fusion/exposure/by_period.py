"""The figures of each period of the diary, from pieces that follow one another through the day."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from fusion.exposure.parts import summarise_part
from fusion.exposure.rows import EvenRun, IntArray, find_end_us
from fusion.exposure.stretches import AnyArray
from fusion.exposure.types import PartExposure
from fusion.periods import Period, Piece
from fusion.recording import MICROSECONDS

REST_KIND = "work"

Group = tuple[int, ...]
"""Numbers of pieces that are summed into one part."""


@dataclass(frozen=True, slots=True)
class DayDivision:
    """The diary's periods, and the pieces of the whole recording that each of them owns."""

    periods: tuple[Period, ...] = ()
    pieces: tuple[Piece, ...] = ()

    def list_edges(self) -> IntArray:
        """Give the edges of the pieces, shape (p + 1,); none without a diary."""
        edges_us = [piece.start_us for piece in self.pieces[:1]] + [piece.end_us for piece in self.pieces]
        return np.array(edges_us, np.int64)

    def group_by_row(self) -> tuple[Group, ...]:
        """Give the pieces of each row, in the order of the diary, then those that no row names.

        A row that others cover wholly is left out.
        """
        owners = (*range(len(self.periods)), -1)
        owned = (tuple(k for k, piece in enumerate(self.pieces) if piece.period == o) for o in owners)
        return tuple(group for group in owned if group)

    def group_by_task(self) -> tuple[Group, ...]:
        """Give the pieces of all rows of one kind and label, in the order of the first of each.

        What is left out and what is analysed stay apart.
        """
        groups: dict[tuple[str, str, str], list[int]] = {}
        for group in self.group_by_row():
            for k in group:
                kind, label = self.name_owner(k)
                groups.setdefault((kind, label, self.pieces[k].reason), []).append(k)
        return tuple(tuple(sorted(group)) for group in groups.values())

    def name_owner(self, piece: int) -> tuple[str, str]:
        """Give kind and label of the row that owns a piece."""
        found = self.pieces[piece]
        if found.period < 0:
            return ("outside" if found.reason else REST_KIND), ""
        return self.periods[found.period].kind, self.periods[found.period].label


def snap_periods(periods: Sequence[Period], runs: Sequence[EvenRun]) -> tuple[Period, ...]:
    """Move each edge to where a sample begins, so that no sample belongs to two periods.

    The move is less than one sample period; it lets the parts of the day add up to the microsecond.
    """
    snapped = (
        replace(period, start_us=_snap(period.start_us, runs), end_us=_snap(period.end_us, runs))
        for period in periods
    )
    return tuple(period for period in snapped if period.end_us > period.start_us)


def _snap(time_us: int, runs: Sequence[EvenRun]) -> int:
    for run in runs:
        if run.start_us < time_us < find_end_us(run):
            row = ceil((time_us - run.start_us - 1) * (run.rate_hz / MICROSECONDS))
            return run.start_us + round(row * MICROSECONDS / run.rate_hz)
    return time_us


def summarise_group(
    division: DayDivision, group: Group, cell_us: AnyArray, entries: IntArray
) -> PartExposure:
    """Give the main figures of pieces taken together.

    ``cell_us``, shape (p, 1800), and ``entries`` above 60 deg, shape (p,), are those of each piece. Time that
    is excluded has no figures, only its length.
    """
    pieces, chosen = [division.pieces[k] for k in group], list(group)
    kind, label = division.name_owner(group[0])
    edges_us = np.array([pieces[0].start_us, pieces[-1].end_us], np.int64)
    summed_us: IntArray = cell_us[chosen].sum(axis=0, dtype=np.int64)
    part = summarise_part(label, edges_us, summed_us, int(entries[chosen].sum()))
    return replace(
        part,
        kind=kind,
        recorded_s=sum(piece.end_us - piece.start_us for piece in pieces) / MICROSECONDS,
        reason=pieces[0].reason,
        periods=len({piece.period for piece in pieces}),
    )
