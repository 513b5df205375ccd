"""Both angles at the same moments: the slower side's own samples, the faster side interpolated between its.

So nothing is invented at a rate that one of them never had. Holes of either stay holes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.agreement.clocks import Alignment
from fusion.agreement.runs import SHORTEST_ROWS, Run, Runs, Vector, find_rate_hz, interpolate
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import NothingInCommon
from fusion.recording import MICROSECONDS


@dataclass(frozen=True, slots=True, eq=False)
class PairedRun:
    """Unbroken rows of both, at ``start_s + k / rate_hz`` of the recording's clock; shapes (n,)."""

    start_s: float
    rate_hz: float
    ours_deg: Vector
    reference_deg: Vector

    def __len__(self) -> int:
        return len(self.ours_deg)

    @property
    def time_s(self) -> Vector:
        """Recording's clock, shape (n,)."""
        return self.start_s + np.arange(len(self)) / self.rate_hz


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """All runs that both sides have, in time order, at one rate."""

    runs: tuple[PairedRun, ...]

    @property
    def ours_deg(self) -> Vector:
        """All rows, shape (n,)."""
        return _join([run.ours_deg for run in self.runs])

    @property
    def reference_deg(self) -> Vector:
        """All rows, shape (n,)."""
        return _join([run.reference_deg for run in self.runs])

    @property
    def duration_s(self) -> float:
        """How long both were measured together."""
        return sum(len(run) / run.rate_hz for run in self.runs)

    @property
    def rate_hz(self) -> float:
        """Rows in a second."""
        return max(self.runs, key=len).rate_hz if self.runs else float("nan")

    def cut(self, start_s: float, end_s: float) -> "Pairs":
        """Give the rows from ``start_s`` on and before ``end_s``, recording's clock."""
        return Pairs(tuple(part for run in self.runs if (part := _cut(run, start_s, end_s)) is not None))

    def to_elevations(self) -> tuple[Elevation, Elevation]:
        """Give both sides for the exposure figures: same rows, same holes."""
        first_s = self.runs[0].start_s if self.runs else 0.0
        ours = tuple(_lay(run, run.ours_deg, first_s) for run in self.runs)
        reference = tuple(_lay(run, run.reference_deg, first_s) for run in self.runs)
        return Elevation(ours, None), Elevation(reference, None)


def join_pairs(parts: Sequence[Pairs]) -> Pairs:
    """Put several cuts together, such as the repetitions of one task."""
    return Pairs(tuple(run for part in parts for run in part.runs))


def pair(ours: Runs, reference: Runs, alignment: Alignment) -> Pairs:
    """Bring both to the recording's clock and to the rate of the slower one.

    Raises
    ------
    NothingInCommon
    """
    moved = tuple(_move(run, alignment) for run in reference)
    if not ours or not moved:
        raise NothingInCommon(s=0.0)
    if find_rate_hz(ours) <= find_rate_hz(moved):
        found = [PairedRun(a, b, c, d) for a, b, c, d in _meet(ours, moved)]
    else:
        found = [PairedRun(a, b, d, c) for a, b, c, d in _meet(moved, ours)]
    if not found:
        raise NothingInCommon(s=0.0)
    return Pairs(tuple(found))


def _move(run: Run, alignment: Alignment) -> Run:
    start_s = float(alignment.to_recording(np.array([run.start_s]))[0])
    return Run(start_s, run.rate_hz * alignment.pace, run.values)


def _meet(slow: Runs, fast: Runs) -> Iterator[tuple[float, float, Vector, Vector]]:
    """Give (start, rate, slower values, faster values) wherever two runs overlap."""
    for run in slow:
        for other in fast:
            first = max(0, int(np.ceil((other.start_s - run.start_s) * run.rate_hz - 1e-6)))
            stop = min(len(run), int(np.floor((other.end_s - run.start_s) * run.rate_hz + 1e-6)) + 1)
            if stop - first >= SHORTEST_ROWS:
                time_s = run.start_s + np.arange(first, stop) / run.rate_hz
                values = run.values[first:stop].astype(np.float64)
                within = np.clip(interpolate(other, time_s), 0.0, 180.0)
                yield float(time_s[0]), run.rate_hz, values, within


def _cut(run: PairedRun, start_s: float, end_s: float) -> PairedRun | None:
    first, stop = (
        int(np.clip(np.ceil((edge_s - run.start_s) * run.rate_hz - 1e-6), 0, len(run)))
        for edge_s in (start_s, end_s)
    )
    if stop <= first:
        return None
    start = run.start_s + first / run.rate_hz
    return PairedRun(start, run.rate_hz, run.ours_deg[first:stop], run.reference_deg[first:stop])


def _lay(run: PairedRun, values_deg: Vector, first_s: float) -> ElevationSegment:
    start_us = round((run.start_s - first_s) * MICROSECONDS)
    return ElevationSegment(
        start_us, run.rate_hz, values_deg.astype(np.float32), np.ones(len(run), dtype=np.bool_)
    )


def _join(parts: Sequence[Vector]) -> Vector:
    return np.concatenate(parts) if parts else np.zeros(0)
