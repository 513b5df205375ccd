"""Align two measurements of one arm: both angles at the same moments, with offset and drift of the clocks.

The slower side keeps its own samples, and the faster side is interpolated between its samples. Neither side
gets samples at a higher rate than it was measured at. Gaps of either side remain gaps.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite, nan, sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.signal import correlate
from scipy.stats import theilslopes

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import NotAligned, NothingInCommon
from acromion.fusion.numba_kernels import njit
from acromion.fusion.numerics import weigh_huber
from acromion.fusion.recording import MICROSECONDS, Float64Array, FloatArray
from acromion.fusion.runs import find_runs

# The angle of one side as unbroken, even runs in its own clock.


PATH_HZ = 50.0
SHORTEST_ROWS = 4
"""A cubic needs this many rows; a shorter run cannot be compared."""


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


def get_valid_runs(elevation: Elevation, first_s: float = 0.0) -> Runs:
    """Return the valid rows as runs; ``first_s`` is the clock at the recording's first sample."""
    return tuple(
        Run(first_s + (segment.start_us / MICROSECONDS) + start / segment.rate_hz, segment.rate_hz, values)
        for segment in elevation.segments
        for start, values in _cut_valid(segment)
    )


def get_vertical_paths(elevation: Elevation) -> Runs:
    """Return the path of the vertical in the sensor's frame, deg, at about 50 Hz.

    Its rate of change does not depend on the mounting of the sensor. It is used to align an orientation whose
    arm axis is not known yet. Empty if the vertical is not known.
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
    """Return the sum of the angles between successive unit vectors (n, 3), deg, shape (n,), from 0."""
    chord = np.linalg.norm(np.diff(up.astype(np.float64), axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(np.degrees(2.0 * np.arcsin(np.minimum(chord / 2.0, 1.0))))])


def _cut_valid(segment: ElevationSegment) -> Iterable[tuple[int, NDArray[np.float32]]]:
    usable = segment.valid & np.isfinite(segment.elevation_deg)
    for first, stop in find_runs(usable, SHORTEST_ROWS).tolist():
        yield first, segment.elevation_deg[first:stop]


def interpolate(run: Run, time_s: Float64Array) -> Float64Array:
    """Return the value at each time, by the cubic through the four nearest values; times within the run.

    At 60 Hz it follows a swing of 3 Hz to 0.02 % of its amplitude (linear interpolation: to 1.2 %).
    """
    out = np.empty(len(time_s))
    _interpolate(run.values, (time_s - run.start_s) * run.rate_hz, out)
    return out


@njit(cache=True, nogil=True)
def _interpolate(
    values: FloatArray, places: Float64Array, out: Float64Array
) -> None:  # pragma: no cover - compiled
    """Compute Lagrange's cubic on an even grid; both ends use the first or last four values."""
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
    """Return the rate of the longest run."""
    return max(runs, key=len).rate_hz


# The alignment of the two clocks.


TIMING_S = 0.01
"""Uncertainty of the time between two samples if the timestamps are whole seconds (GT9X)."""


@dataclass(frozen=True, slots=True)
class WindowLag:
    """The lag of the reference in one stretch, beyond the alignment so far, and its correlation there."""

    start_s: float
    lag_s: float
    r: float


@dataclass(frozen=True, slots=True)
class Alignment:
    """The relation: reference clock = ``offset_s`` + recording clock x (1 + ``drift_ppm`` / 1e6).

    ``r``: correlation of the speeds with this alignment.
    ``is_offset_given``, ``is_drift_given``: whether a person set the value.
    ``is_drift_fitted``: False if the motion does not determine a drift, which is then 0.
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
        """Uncertainty of a fitted drift: 10 ms over the span of the stretches; NaN if there is no fit."""
        if not self.is_drift_fitted:
            return nan
        starts_s = [window.start_s for window in self.windows]
        return TIMING_S / (max(starts_s) - min(starts_s)) * 1e6

    @property
    def pace(self) -> float:
        """Seconds of the reference's clock in one second of the recording's."""
        return 1.0 + self.drift_ppm / 1e6

    def to_reference(self, time_s: Float64Array) -> Float64Array:
        """Convert seconds of the recording's clock to the reference's."""
        return self.offset_s + time_s * self.pace

    def to_recording(self, time_s: Float64Array) -> Float64Array:
        """Convert seconds of the reference's clock to the recording's."""
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
        """Duration of the common time."""
        return sum(len(run) / run.rate_hz for run in self.runs)

    @property
    def rate_hz(self) -> float:
        """Rows per second."""
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
        """Return both sides for the exposure figures: same rows, same gaps."""
        first_s = self.runs[0].start_s if self.runs else 0.0
        ours: list[ElevationSegment] = []
        reference: list[ElevationSegment] = []
        for run in self.runs:
            start_us, valid = round((run.start_s - first_s) * MICROSECONDS), np.ones(len(run), np.bool_)
            for segments, deg in ((ours, run.ours_deg), (reference, run.reference_deg)):
                segments.append(ElevationSegment(start_us, run.rate_hz, deg.astype(np.float32), valid))
        return Elevation(tuple(ours), None), Elevation(tuple(reference), None)


def join_pairs(parts: Sequence[Pairs]) -> Pairs:
    """Join several cuts, such as the repetitions of one task."""
    return Pairs(tuple(run for part in parts for run in part.runs))


def pair(ours: Runs, reference: Runs, alignment: Alignment) -> Pairs:
    """Convert both to the recording's clock and the rate of the slower one; raises NothingInCommon."""
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
    """Convert a run of the reference to the recording's clock."""
    start_s = float(alignment.to_recording(np.array([run.start_s]))[0])
    return Run(start_s, run.rate_hz * alignment.pace, run.values)


def _find_common(slow: Runs, fast: Runs) -> Iterator[PairedRun]:
    """Yield the rows where two runs overlap, with the slower side as ours."""
    for run in slow:
        for other in fast:
            first = max(0, int(np.ceil((other.start_s - run.start_s) * run.rate_hz - 1e-6)))
            stop = min(len(run), int(np.floor((other.end_s - run.start_s) * run.rate_hz + 1e-6)) + 1)
            if stop - first >= SHORTEST_ROWS:
                time_s = run.start_s + np.arange(first, stop) / run.rate_hz
                values = run.values[first:stop].astype(np.float64)
                within = np.clip(interpolate(other, time_s), 0.0, 180.0)
                yield PairedRun(float(time_s[0]), run.rate_hz, values, within)


def compute_pearson_r(a: Float64Array, b: Float64Array) -> float:
    """Return Pearson's correlation; NaN if one does not vary."""
    u, v = a - a.mean(), b - b.mean()
    size = sqrt(float(u @ u) * float(v @ v))
    return float(u @ v) / size if size > 0 else nan


# Estimate offset and drift between the clocks of recording and reference, from the motion in both.
#
# 1. Coarse offset: normalised cross-correlation of the angles' rates of change (10 Hz grid, limited to 150
#    deg/s, zero in gaps). A held pose has no rate of change, so quasi-static parts do not count, at any
#    angle. An error of the pose has no effect either.
# 2. Drift: the same in stretches, each within 4 s of the first result, to a fraction of a sample by a
#    parabola through the peak; then the line through most stretches (Theil and Sen). A drift is only fitted
#    if the agreeing stretches span at least 2 min; otherwise it is 0, and reported as such.
# 3. To the millisecond: least squares of the difference of the angles over offset, drift and bias together,
#    the reference interpolated by cubics, with Huber's weights (1964) and a few Gauss-Newton steps.
#
# A constant delay of a filter on one side becomes part of the offset and cannot be separated from it.

GRID_HZ = 10.0
LEAST_R = 0.5
"""Below this correlation the motions do not match, and there is no alignment."""

LEAST_ENERGY = 0.2
"""With a smaller share of the motion in the common time, the edges of the recordings match by chance.

The share is that of the side with less motion.
"""

LEAST_MOTION_S, MOVING_DPS = 10.0, 5.0
"""The common time must contain at least this much motion of both sides, faster than this, to search for a
shift.
"""

SURE_MOTION_S, SURE_R = 30.0, 0.7
"""With this much common motion and this correlation, a match is not chance.

The best of 3e5 shifts of 60 independent values has a correlation of 0.65.
"""

MOST_RIVAL = 0.95
"""Any other match must be unique: no shift more than ``REACH_S`` away may reach this share of its score."""

OVERLAP_WORTH = 0.25
FASTEST_DPS = 150.0
"""Faster motion counts as this speed, so that no single throw dominates."""

REACH_S = 4.0
WINDOW_R = 0.7
LEAST_SPAN_S = 120.0
MOST_WINDOWS, SHORTEST_WINDOW_S, LONGEST_WINDOW_S = 60, 20.0, 300.0
STEPS = 25
SLOPE_S = 0.2
MOST_SHIFT_S = 1.0
"""If the refinement moves the offset by more than this, it has diverged, and the previous result is kept."""


@dataclass(frozen=True, slots=True)
class ClockSettings:
    """Alignment values that a person sets by hand.

    ``offset_s``: the reference's clock at the recording's first sample; None: estimate it from the motion.
    ``drift_ppm``: how much faster the reference's clock runs; None: estimate it from the motion.
    """

    offset_s: float | None = None
    drift_ppm: float | None = None


def align(ours: Runs, reference: Runs, clock: ClockSettings | None = None) -> Alignment:
    """Estimate offset and drift, except values that are given.

    Raises
    ------
    NotAligned
        Unless the offset is given: the rates of change correlate by less than 0.5 at the best shift, the
        common time has less than 10 s of motion there, or another shift has nearly the same score.
    NothingInCommon
        A side without any valid row.
    """
    refined = _refine(ours, reference, align_roughly(ours, reference, clock or ClockSettings()))
    aligned = replace(refined, r=_correlate_rates(ours, reference, refined))
    if not aligned.is_offset_given and not aligned.r >= LEAST_R:
        raise NotAligned(r=round(aligned.r, 2) if isfinite(aligned.r) else 0.0, least=LEAST_R)
    return aligned


def align_roughly(ours: Runs, reference: Runs, clock: ClockSettings) -> Alignment:
    """Estimate offset and drift to some hundredths of a second, from any two curves with similar slopes.

    Raises
    ------
    NotAligned
        The offset is not given, and the motion does not determine it.
    NothingInCommon
        A side without any valid row.
    """
    if not ours or not reference:
        raise NothingInCommon(s=0.0)
    if clock.offset_s is None:
        first = _find_shift(ours, reference)
        middle_s = (ours[0].start_s + ours[-1].end_s) / 2.0  # a shift without drift is exact here
    else:
        first, middle_s = Alignment(clock.offset_s, 0.0, is_offset_given=True), 0.0
    if clock.drift_ppm is not None:
        offset_s = first.offset_s - clock.drift_ppm / 1e6 * middle_s
        first = replace(first, offset_s=offset_s, drift_ppm=clock.drift_ppm, is_drift_given=True)
    return _fit_windows(ours, reference, first, clock)


def _sample_rates(runs: Runs, start_s: float, sample_count: int) -> Float64Array:
    """Return rates of change on an even grid of 10 Hz: the change over one grid step; 0 if there is none."""
    rates = np.zeros(sample_count)
    for run in runs:
        first = max(0, int(np.ceil((run.start_s - start_s) * GRID_HZ)))
        stop = min(sample_count, int(np.floor((run.end_s - start_s) * GRID_HZ)) + 1)
        if stop - first >= 2:
            values = interpolate(run, start_s + np.arange(first, stop) / GRID_HZ)
            rates[first : stop - 1] = np.diff(values) * GRID_HZ
    return np.clip(rates, -FASTEST_DPS, FASTEST_DPS)


def _find_shift(ours: Runs, reference: Runs) -> Alignment:
    """Return the shift with the best match of the rates of change, to about 0.05 s, assuming no drift.

    Raises NotAligned: too little common motion there, or another shift has nearly the same score.
    """
    own_start_s, other_start_s = ours[0].start_s, reference[0].start_s
    own = _sample_rates(ours, own_start_s, _count_steps(ours))
    other = _sample_rates(reference, other_start_s, _count_steps(reference))
    correlation, worth = _score_shifts(own, other)
    best = int(np.argmax(worth))
    lag = best - (len(own) - 1)
    first, stop = max(0, -lag), min(len(own), len(other) - lag)
    moving = np.abs(own[first:stop]) > MOVING_DPS
    moving &= np.abs(other[first + lag : stop + lag]) > MOVING_DPS
    motion_s = float(np.count_nonzero(moving)) / GRID_HZ
    if motion_s < SURE_MOTION_S or correlation[best] < SURE_R:
        if motion_s < LEAST_MOTION_S:
            raise NotAligned(motion_s=round(motion_s, 1), least_s=LEAST_MOTION_S)
        reach = int(REACH_S * GRID_HZ)
        elsewhere = np.concatenate([worth[: max(0, best - reach)], worth[best + reach + 1 :]])
        rival = float(elsewhere.max(initial=0.0))
        if rival > MOST_RIVAL * worth[best]:
            raise NotAligned(best=round(float(worth[best]), 2), rival=round(rival, 2))
    return Alignment(other_start_s - own_start_s + lag / GRID_HZ, 0.0, float(correlation[best]))


def _count_steps(runs: Runs) -> int:
    return int((runs[-1].end_s - runs[0].start_s) * GRID_HZ) + 1


def _score_shifts(own: Float64Array, other: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return correlation and score for every shift of ``other`` to the right; index len(own) - 1: no shift.

    Of two shifts with the same correlation, the one with more common motion has the higher score.
    """
    product = correlate(other, own, mode="full", method="fft")
    own_energy = correlate((other != 0).astype(float), own**2, mode="full", method="fft")
    other_energy = correlate(other**2, np.ones(len(own)), mode="full", method="fft")
    whole = max(min(float(own @ own), float(other @ other)), 1e-9)
    least = LEAST_ENERGY * whole
    shared = np.sqrt(np.maximum(own_energy, least) * np.maximum(other_energy, least))
    correlation: Float64Array = product / shared
    return correlation, correlation * np.minimum(shared / whole, 1.0) ** OVERLAP_WORTH


def _fit_windows(ours: Runs, reference: Runs, first: Alignment, clock: ClockSettings) -> Alignment:
    """Align stretches one by one and fit the line through most of them."""
    windows = _place_windows(ours, reference, first)
    start_s = np.array([window.start_s for window in windows])
    lags_s = np.array([window.lag_s for window in windows])
    spans = len(windows) >= 3 and float(np.ptp(start_s)) >= LEAST_SPAN_S
    slope = 0.0
    if spans and clock.drift_ppm is None:
        slope = float(theilslopes(lags_s, start_s).slope)
    if len(windows) and clock.offset_s is None:
        offset_s = first.offset_s + float(np.median(lags_s - slope * start_s))
    else:
        offset_s = first.offset_s
    return replace(
        first,
        offset_s=offset_s,
        drift_ppm=first.drift_ppm + slope * 1e6,
        is_drift_fitted=spans and clock.drift_ppm is None,
        windows=windows,
    )


def _place_windows(ours: Runs, reference: Runs, first: Alignment) -> tuple[WindowLag, ...]:
    """Return the lag of each stretch with a correlation of at least 0.7."""
    start_s, end_s = ours[0].start_s, ours[-1].end_s
    length_s = float(np.clip((end_s - start_s) / MOST_WINDOWS, SHORTEST_WINDOW_S, LONGEST_WINDOW_S))
    count = int(length_s * GRID_HZ)
    reach = int(REACH_S * GRID_HZ)
    own = _sample_rates(ours, start_s, _count_steps(ours))
    moved = tuple(move_run(run, first) for run in reference)
    other = _sample_rates(moved, start_s - REACH_S, len(own) + 2 * reach)
    found = []
    for at in range(0, len(own) - count + 1, count):
        lag, r = _place(own[at : at + count], other[at : at + count + 2 * reach], reach)
        if r >= WINDOW_R:
            found.append(WindowLag(start_s + (at + count / 2) / GRID_HZ, lag / GRID_HZ, r))
    return tuple(found)


def _place(own: Float64Array, other: Float64Array, reach_samples: int) -> tuple[float, float]:
    """Return the lag in grid steps, to a fraction by a parabola through the peak, and its correlation."""
    energy = float(own @ own)
    if energy <= 0:
        return 0.0, 0.0
    product = correlate(other, own, mode="valid", method="direct")
    sums = np.concatenate([[0.0], np.cumsum(other**2)])
    others = sums[len(own) :] - sums[: -len(own)]
    score = product / np.sqrt(energy * np.maximum(others, energy / 4.0))
    best = int(np.argmax(score))
    if not 0 < best < len(score) - 1:
        return 0.0, 0.0
    before, peak, after = score[best - 1 : best + 2]
    bend = before - 2 * peak + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return best - reach_samples + float(shift), float(peak)


def _refine(ours: Runs, reference: Runs, placed: Alignment) -> Alignment:
    """Solve least squares over offset, drift (if fitted) and bias; given values stay fixed."""
    free = [not placed.is_offset_given, placed.is_drift_fitted]
    now = placed
    for _ in range(STEPS):
        step = _find_step(ours, reference, now, free)
        if step is None:
            return placed
        now = replace(now, offset_s=now.offset_s + step[0], drift_ppm=now.drift_ppm + step[1] * 1e6)
        if abs(now.offset_s - placed.offset_s) > MOST_SHIFT_S:
            return placed
        if abs(step[0]) < 1e-5 and abs(step[1]) < 1e-8:
            break
    return now


def _find_step(
    ours: Runs, reference: Runs, now: Alignment, free: Sequence[bool]
) -> tuple[float, float] | None:
    """Return one Gauss-Newton step; None if the common time does not determine it."""
    if not any(free):
        return 0.0, 0.0
    pairs = pair(ours, reference, now)
    slopes = np.concatenate([_find_slopes(run) for run in pairs.runs])
    time_s = np.concatenate([run.time_s for run in pairs.runs])
    error = pairs.ours_deg - pairs.reference_deg
    columns = [slopes, slopes * time_s]
    design = np.stack(
        [*(c for c, is_free in zip(columns, free, strict=True) if is_free), np.ones(len(error))]
    )
    weights = weigh_huber(error - np.median(error))
    weighted = design * weights
    normal = weighted @ design.T
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0).all():
        return None
    solution = np.linalg.lstsq(normal / np.outer(scale, scale), weighted @ error / scale, rcond=1e-12)[0]
    found = iter((solution / scale).tolist())
    return (next(found) if free[0] else 0.0), (next(found) if free[1] else 0.0)


def _find_slopes(run: PairedRun) -> Float64Array:
    """Return the slope of the reference over a fifth of a second.

    Over a shorter time the slope contains more noise, which makes every step too short.
    """
    reach = max(1, round(SLOPE_S * run.rate_hz / 2))
    rows = np.arange(len(run))
    first, last = np.maximum(rows - reach, 0), np.minimum(rows + reach, len(run) - 1)
    return np.asarray((run.reference_deg[last] - run.reference_deg[first]) * run.rate_hz / (last - first))


def _correlate_rates(ours: Runs, reference: Runs, alignment: Alignment) -> float:
    """Return the correlation of the rates of change over the common time."""
    try:
        pairs = pair(ours, reference, alignment)
    except NothingInCommon:
        return nan
    steps = max(1, round(find_rate_hz(ours) / GRID_HZ))
    parts = [(run.ours_deg[::steps], run.reference_deg[::steps]) for run in pairs.runs]
    changes = [np.concatenate([np.diff(part[k]) for part in parts]) for k in (0, 1)]
    return compute_pearson_r(changes[0], changes[1]) if len(changes[0]) > 1 else nan
