"""Both angles at the same moments: the slower side's own samples, the faster side interpolated between its.

So neither side gets samples at a rate that it was not measured at. Holes of either stay holes.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import nan

import numpy as np
from numpy.typing import NDArray

from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import NothingInCommon
from fusion.numba_kernels import njit
from fusion.numerics.runs import find_runs
from fusion.recording import MICROSECONDS, Float64Array, FloatArray

# The angle of one side as unbroken, even runs in its own clock.


PATH_HZ = 50.0
SHORTEST_ROWS = 4
"""What a cubic needs; a shorter run holds nothing that could be compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Run:
    """Values at ``start_s + k / rate_hz``, seconds of the side's own clock; all of them valid."""

    start_s: float
    rate_hz: float
    values: FloatArray

    def __len__(self) -> int:
        return len(self.values)

    @property
    def end_s(self) -> float:
        """Time of the last value."""
        return self.start_s + (len(self) - 1) / self.rate_hz

    @property
    def time_s(self) -> Float64Array:
        """Time of each value, shape (n,)."""
        return self.start_s + np.arange(len(self)) / self.rate_hz


Runs = tuple[Run, ...]


def take_runs(elevation: Elevation, first_s: float = 0.0) -> Runs:
    """Take the valid rows; ``first_s`` is the clock at the recording's first sample."""
    return tuple(
        Run(first_s + (segment.start_us / MICROSECONDS) + start / segment.rate_hz, segment.rate_hz, values)
        for segment in elevation.segments
        for start, values in _cut_valid(segment)
    )


def take_paths(elevation: Elevation) -> Runs:
    """Take the path of the vertical in the sensor's frame, deg, at about 50 Hz.

    Its rate of change is the same however the sensor sits on the arm: what aligns an orientation whose arm
    axis is not known yet. Empty where the vertical is not known.
    """
    paths = []
    for segment in elevation.segments:
        if segment.vertical is None:
            continue
        step = max(1, round(segment.rate_hz / PATH_HZ))
        for start, values in _cut_valid(segment):
            path = measure_path(segment.vertical[start : start + len(values)][::step])
            start_s = segment.start_us / MICROSECONDS + start / segment.rate_hz
            if len(path) >= SHORTEST_ROWS:
                paths.append(Run(start_s, segment.rate_hz / step, path))
    return tuple(paths)


def measure_path(up: FloatArray) -> Float64Array:
    """Sum of the angles between successive unit vectors (n, 3), deg, shape (n,), from 0."""
    chord = np.linalg.norm(np.diff(up.astype(np.float64), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))))])


def _cut_valid(segment: ElevationSegment) -> Iterable[tuple[int, NDArray[np.float32]]]:
    usable = segment.valid & np.isfinite(segment.elevation_deg)
    for first, stop in find_runs(usable, SHORTEST_ROWS).tolist():
        yield first, segment.elevation_deg[first:stop]


def interpolate(run: Run, time_s: Float64Array) -> Float64Array:
    """Value at each time, by the cubic through the four nearest values; times must lie within the run.

    At 60 Hz they follow a swing of 3 Hz to 0.02 % of its amplitude (a straight line: to 1.2 %).
    """
    out = np.empty(len(time_s))
    _interpolate(run.values, (time_s - run.start_s) * run.rate_hz, out)
    return out


@njit(cache=True, nogil=True)
def _interpolate(
    values: FloatArray, places: Float64Array, out: Float64Array
) -> None:  # pragma: no cover - compiled
    """Lagrange's cubic on an even grid; at both ends the first and last four values are used."""
    last = len(values) - 4
    for k in range(len(places)):
        first = min(max(int(np.floor(places[k])) - 1, 0), last)
        u = places[k] - first
        a, b, c, d = values[first], values[first + 1], values[first + 2], values[first + 3]
        out[k] = (
            -a * (u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0
            + b * u * (u - 2.0) * (u - 3.0) / 2.0
            - c * u * (u - 1.0) * (u - 3.0) / 2.0
            + d * u * (u - 1.0) * (u - 2.0) / 6.0
        )


def find_rate_hz(runs: Sequence[Run]) -> float:
    """The rate of the longest run."""
    return max(runs, key=len).rate_hz


# The alignment of the two clocks.


TIMING_S = 0.01
"""Uncertainty of the time between two samples where the stamps are of whole seconds (GT9X)."""


@dataclass(frozen=True, slots=True)
class WindowLag:
    """The lag of the reference in one stretch, beyond the alignment so far, and its correlation there."""

    start_s: float
    lag_s: float
    r: float


@dataclass(frozen=True, slots=True)
class Alignment:
    """reference clock = ``offset_s`` + recording clock x (1 + ``drift_ppm`` / 1e6).

    ``r`` is the correlation of the speeds under this alignment. ``is_offset_given`` and ``is_drift_given``
    are true where a person set it by hand; ``is_drift_fitted`` is False where the motion does not determine
    a drift, which is then 0.
    """

    offset_s: float
    drift_ppm: float
    r: float = nan
    is_offset_given: bool = False
    is_drift_given: bool = False
    is_drift_fitted: bool = False
    windows: tuple[WindowLag, ...] = ()

    @property
    def drift_margin_ppm(self) -> float:
        """How far a fitted drift may be off: 10 ms over the span of the stretches; nan where none is."""
        if not self.is_drift_fitted:
            return nan
        starts_s = [window.start_s for window in self.windows]
        return TIMING_S / (max(starts_s) - min(starts_s)) * 1e6

    @property
    def pace(self) -> float:
        """Seconds of the reference's clock in one second of the recording's."""
        return 1.0 + self.drift_ppm / 1e6

    def to_reference(self, time_s: Float64Array) -> Float64Array:
        """Seconds of the recording's clock to the reference's."""
        return self.offset_s + time_s * self.pace

    def to_recording(self, time_s: Float64Array) -> Float64Array:
        """Seconds of the reference's clock to the recording's."""
        return (time_s - self.offset_s) / self.pace


@dataclass(frozen=True, slots=True, eq=False)
class PairedRun:
    """Unbroken rows of both, at ``start_s + k / rate_hz`` of the recording's clock; shapes (n,)."""

    start_s: float
    rate_hz: float
    ours_deg: Float64Array
    reference_deg: Float64Array

    def __len__(self) -> int:
        return len(self.ours_deg)

    @property
    def end_s(self) -> float:
        """Time of the end of the last row."""
        return self.start_s + len(self) / self.rate_hz

    @property
    def time_s(self) -> Float64Array:
        """Recording's clock, shape (n,)."""
        return self.start_s + np.arange(len(self)) / self.rate_hz


@dataclass(frozen=True, slots=True, eq=False)
class Pairs:
    """All runs that both sides have, in time order, at one rate."""

    runs: tuple[PairedRun, ...]

    @property
    def ours_deg(self) -> Float64Array:
        """All rows, shape (n,)."""
        return np.concatenate([np.zeros(0), *(run.ours_deg for run in self.runs)])

    @property
    def reference_deg(self) -> Float64Array:
        """All rows, shape (n,)."""
        return np.concatenate([np.zeros(0), *(run.reference_deg for run in self.runs)])

    @property
    def duration_s(self) -> float:
        """How long both were measured together."""
        return sum(len(run) / run.rate_hz for run in self.runs)

    @property
    def rate_hz(self) -> float:
        """Rows in a second."""
        return max(self.runs, key=len).rate_hz if self.runs else float("nan")

    def cut(self, start_s: float, end_s: float) -> "Pairs":
        """Return the rows from ``start_s`` on and before ``end_s``, recording's clock."""
        parts = []
        for run in self.runs:
            first, stop = (
                int(np.clip(np.ceil((edge_s - run.start_s) * run.rate_hz - 1e-6), 0, len(run)))
                for edge_s in (start_s, end_s)
            )
            if stop > first:
                rows = slice(first, stop)
                start = run.start_s + first / run.rate_hz
                parts.append(PairedRun(start, run.rate_hz, run.ours_deg[rows], run.reference_deg[rows]))
        return Pairs(tuple(parts))

    def to_elevations(self) -> tuple[Elevation, Elevation]:
        """Return both sides for the exposure figures: same rows, same holes."""
        first_s = self.runs[0].start_s if self.runs else 0.0
        ours: list[ElevationSegment] = []
        reference: list[ElevationSegment] = []
        for run in self.runs:
            start_us, valid = round((run.start_s - first_s) * MICROSECONDS), np.ones(len(run), np.bool_)
            for segments, deg in ((ours, run.ours_deg), (reference, run.reference_deg)):
                segments.append(ElevationSegment(start_us, run.rate_hz, deg.astype(np.float32), valid))
        return Elevation(tuple(ours), None), Elevation(tuple(reference), None)


def join_pairs(parts: Sequence[Pairs]) -> Pairs:
    """Put several cuts together, such as the repetitions of one task."""
    return Pairs(tuple(run for part in parts for run in part.runs))


def pair(ours: Runs, reference: Runs, alignment: Alignment) -> Pairs:
    """Bring both to the recording's clock and to the rate of the slower one; raises NothingInCommon."""
    moved = tuple(move_run(run, alignment) for run in reference)
    if not ours or not moved:
        raise NothingInCommon(s=0.0)
    if find_rate_hz(ours) <= find_rate_hz(moved):
        found = tuple(_find_common(ours, moved))
    else:
        exchanged = _find_common(moved, ours)
        found = tuple(replace(r, ours_deg=r.reference_deg, reference_deg=r.ours_deg) for r in exchanged)
    if not found:
        raise NothingInCommon(s=0.0)
    return Pairs(found)


def move_run(run: Run, alignment: Alignment) -> Run:
    """Bring a run of the reference to the recording's clock."""
    start_s = float(alignment.to_recording(np.array([run.start_s]))[0])
    return Run(start_s, run.rate_hz * alignment.pace, run.values)


def _find_common(slow: Runs, fast: Runs) -> Iterator[PairedRun]:
    """Return the rows wherever two runs overlap, with the slower side as ours."""
    for run in slow:
        for other in fast:
            first = max(0, int(np.ceil((other.start_s - run.start_s) * run.rate_hz - 1e-6)))
            stop = min(len(run), int(np.floor((other.end_s - run.start_s) * run.rate_hz + 1e-6)) + 1)
            if stop - first >= SHORTEST_ROWS:
                time_s = run.start_s + np.arange(first, stop) / run.rate_hz
                values = run.values[first:stop].astype(np.float64)
                within = np.clip(interpolate(other, time_s), 0.0, 180.0)
                yield PairedRun(float(time_s[0]), run.rate_hz, values, within)
