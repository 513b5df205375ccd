"""The angle of one side as unbroken, even runs in its own clock."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.elevation import Elevation, ElevationSegment
from fusion.recording import MICROSECONDS, FloatArray

Vector = NDArray[np.float64]
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
    def time_s(self) -> Vector:
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


def take_paths(elevation: Elevation, first_s: float = 0.0) -> Runs:
    """Take the way that the vertical has gone in the sensor's frame, deg, at about 50 Hz.

    Its rate of change is the same however the sensor sits on the arm: what aligns an orientation whose arm
    axis is not known yet. Empty where the vertical is not known.
    """
    return tuple(
        Run(first_s + segment.start_us / MICROSECONDS + start / segment.rate_hz, segment.rate_hz / step, path)
        for segment in elevation.segments
        if segment.vertical is not None
        for step in (max(1, round(segment.rate_hz / PATH_HZ)),)
        for start, values in _cut_valid(segment)
        if len(path := measure_path(segment.vertical[start : start + len(values)][::step])) >= SHORTEST_ROWS
    )


def measure_path(up: FloatArray) -> Vector:
    """Sum of the angles between successive unit vectors (n, 3), deg, shape (n,), from 0."""
    chord = np.linalg.norm(np.diff(up.astype(np.float64), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))))])


def _cut_valid(segment: ElevationSegment) -> Iterable[tuple[int, NDArray[np.float32]]]:
    usable = segment.valid & np.isfinite(segment.elevation_deg)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(np.int8)))
    for first, stop in edges.reshape(-1, 2).tolist():
        if stop - first >= SHORTEST_ROWS:
            yield first, segment.elevation_deg[first:stop]


def interpolate(run: Run, time_s: Vector) -> Vector:
    """Value at each time, by the cubic through the four nearest values; times must lie within the run.

    At 60 Hz they follow a swing of 3 Hz to 0.02 % of its amplitude (a straight line: to 1.2 %).
    """
    out = np.empty(len(time_s))
    _interpolate(run.values, (time_s - run.start_s) * run.rate_hz, out)
    return out


@njit(cache=True, nogil=True)
def _interpolate(values: FloatArray, places: Vector, out: Vector) -> None:  # pragma: no cover - compiled
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


def measure_duration_s(runs: Sequence[Run]) -> float:
    """How long the runs last together."""
    return sum(len(run) / run.rate_hz for run in runs)


def find_rate_hz(runs: Sequence[Run]) -> float:
    """The rate of the longest run."""
    return max(runs, key=len).rate_hz
