"""The figures of each period of the diary, from pieces that follow one another through the day."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np

from fusion.exposure.bins import CELLS, PartHistograms
from fusion.exposure.parts import summarise_part
from fusion.exposure.rows import EvenRun, IntArray, find_end_us
from fusion.exposure.types import PartExposure
from fusion.periods import Period, Piece
from fusion.recording import MICROSECONDS

REST_KIND = "work"


@dataclass(frozen=True, slots=True)
class DayDivision:
    """The diary's periods, and the pieces of the whole recording that each of them owns."""

    periods: tuple[Period, ...] = ()
    pieces: tuple[Piece, ...] = ()

    def start_histograms(self) -> PartHistograms:
        """Give an empty histogram for each piece."""
        edges_us = [piece.start_us for piece in self.pieces[:1]] + [piece.end_us for piece in self.pieces]
        return PartHistograms(np.array(edges_us, np.int64), np.zeros((len(self.pieces), CELLS), np.int64))


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


def summarise_periods(
    division: DayDivision, histograms: PartHistograms, entry_us: IntArray
) -> tuple[PartExposure, ...]:
    """Give the main figures of each period, in the order of the diary, then of what no row names.

    A row that others cover wholly is left out. Time that is excluded has no figures, only its length.
    """
    entries = np.histogram(entry_us, histograms.edges_us)[0] if division.pieces else np.zeros(0, np.int64)
    owners = np.array([piece.period for piece in division.pieces], np.int64)
    told = []
    for owner in (*range(len(division.periods)), -1):
        owned = np.flatnonzero(owners == owner)
        if len(owned):
            cell_us = histograms.cell_us[owned].sum(axis=0, dtype=np.int64)
            pieces = [division.pieces[k] for k in owned]
            told.append(_summarise(division.periods, pieces, cell_us, int(entries[owned].sum())))
    return tuple(told)


def _summarise(
    periods: Sequence[Period], pieces: Sequence[Piece], cell_us: IntArray, entries: int
) -> PartExposure:
    owner = periods[pieces[0].period] if pieces[0].period >= 0 else None
    rest = "outside" if pieces[0].reason else REST_KIND
    edges_us = np.array([pieces[0].start_us, pieces[-1].end_us], np.int64)
    part = summarise_part(owner.label if owner else "", edges_us, cell_us, entries)
    return replace(
        part,
        kind=owner.kind if owner else rest,
        recorded_s=sum(piece.end_us - piece.start_us for piece in pieces) / MICROSECONDS,
        reason=pieces[0].reason,
    )
