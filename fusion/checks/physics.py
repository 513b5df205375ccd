"""Check every recording against physics: 1 g at rest, and gravity that turns as the gyroscope indicates.

A statement in a known device's header is never changed: a contradiction gives a caveat or an error. If only
column names state a unit, a wrong unit (9.81, 57.3, 1000) or a left-handed frame is corrected on strong
evidence from both halves of the movement, and flagged. If nothing is stated, rest and motion determine the
unit, or the recording is rejected; nothing is assumed. A scale is never changed. A recording without rest
gives no evidence.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, isclose, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.summary import (
    LEAST_ACC_TOP_G,
    LEAST_GYR_TOP_DPS,
    RANGE_SHARE,
    Rests,
    find_flat_range,
    find_rests,
    measure_lengths,
    measure_rest_part,
    measure_rest_scale,
    summarise,
)
from acromion.fusion.clocks import read_clock
from acromion.fusion.errors import (
    ExchangedSensors,
    MixedColumns,
    NoGravity,
    TooShort,
    UnknownUnit,
    WrongScale,
)
from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import (
    DEG_PER_RAD,
    MICROSECONDS,
    STANDARD_GRAVITY,
    Float64Array,
    QualityFlag,
    Recording,
    Segment,
    acc_scale_g,
    gyr_scale_dps,
)

# Find the unit and handedness of the gyroscope that keep gravity constant, and check that both sensors agree.
#
# Angles are relative to a pose, so an error common to both sensors has no effect. It is enough that the
# gyroscope agrees with the accelerometer. A left-handed frame appears as a reversed gyroscope: a negative
# factor on its rates.
#
# A recording is changed only if another factor is far better, fits well by itself in both halves of the
# movement, and has no rival. Odds are in nats: the logarithm of the likelihood ratio of two factors.

# The evidence: is gravity, rotated by the gyroscope for eight seconds, still in the same place?
#
# Within a window the acceleration of every row is rotated into the frame of the first row with the gyroscope.
# The means of the two halves must then agree: gravity is constant, and an arm's own acceleration averages to
# its change of speed, a few hundredths of g over four seconds. The difference is the evidence for unit, sign,
# order and scale of the gyroscope's axes. Whole windows are used, because moments selected for stillness tend
# to be the turning points of a swing, where the arm's own acceleration looks like a scale error of 10 %.

WINDOW_S = 8.0
SHORTEST_WINDOW_S = 0.8
"""A segment shorter than a window counts as one window if it has at least this length."""
ROW_S = 0.02
PLAIN_G = 0.05
MOST_WINDOWS = 150
LIKELY_GAIN, LIKELY_DRIFT_DPS, LIKELY_OFFSET_G = 1.0, 15.0, 0.04
"""Expected standard deviation of a fitted value from its start value (for a gain: relative)."""
LEAST_SPREAD_G = 0.005
RADIANS = np.pi / 180.0


@dataclass(frozen=True, slots=True, eq=False)
class GravityWindows:
    """Rows of about 20 ms of all windows, one after the other.

    ``acc_g`` (m, 3): acceleration.
    ``turn`` (m, 3): the gyroscope's reading times the period, from each row to the next; in rad if it reads
    deg/s.
    ``first`` (n + 1,): first row of each window.
    ``period_s`` (n,): period of the rows.
    """

    acc_g: Float64Array
    turn: Float64Array
    first: NDArray[np.int64]
    period_s: Float64Array

    def __len__(self) -> int:
        return len(self.period_s)


@dataclass(frozen=True, slots=True, eq=False)
class GyroModel:
    """True rate = ``gain`` (3, 3) @ reading + ``drift_dps``; true acceleration = reading - ``offset_g``."""

    gain: Float64Array
    drift_dps: Float64Array
    offset_g: Float64Array


def cut_windows(segments: Sequence[Segment]) -> GravityWindows:
    """Return windows of 8 s that overlap by half, spread over the recording.

    Windows in which the gyroscope is clipped or a channel is stuck are excluded, because this looks like
    another scale or mixed-up columns.
    """
    cut_off = find_flat_range([summarise(segment)[1] for segment in segments])
    places = []
    for segment in segments:
        rows = min(round(WINDOW_S * segment.rate_hz), len(segment))
        if rows >= max(8, SHORTEST_WINDOW_S * segment.rate_hz):
            places += [(segment, first, rows) for first in range(0, len(segment) - rows + 1, rows // 2)]
    if cut_off:  # a gyroscope that reads 0 throughout a short recording is not clipped
        places = [
            (segment, first, rows)
            for segment, first, rows in places
            if float(np.abs(segment.gyr_dps[first : first + rows]).max()) < RANGE_SHARE * cut_off
        ]
    chosen = places[:: max(1, -(-len(places) // MOST_WINDOWS))]
    # A channel that never changes is dead; :mod:`acromion.fusion.checks.faults` rejects it.
    flat = np.array([_find_flat(*place) for place in chosen], np.bool_).reshape(-1, 6)
    is_stuck = np.asarray((flat & ~flat.all(axis=0)).any(axis=1))
    cut = [_cut_window(*place) for place, stuck in zip(chosen, is_stuck, strict=True) if not stuck]
    if not cut:
        return GravityWindows(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros(0))
    acc, turn, period_s = zip(*cut, strict=True)
    first = np.concatenate([[0], np.cumsum([len(part) for part in acc])]).astype(np.int64)
    return GravityWindows(np.concatenate(acc), np.concatenate(turn), first, np.array(period_s))


def _find_flat(segment: Segment, first_row: int, rows: int) -> NDArray[np.bool_]:
    """Return which of the six channels keep one value in a window; check the first rows before the rest."""
    flat = []
    for samples in (segment.acc_g, segment.gyr_dps):
        values = samples[first_row : first_row + rows]
        is_flat = (values[:8] == values[0]).all(axis=0)
        flat.append((values == values[0]).all(axis=0) if is_flat.any() else is_flat)
    return np.concatenate(flat)


def _cut_window(segment: Segment, first_row: int, rows: int) -> tuple[Float64Array, Float64Array, float]:
    """Return means of 20 ms; the rate is linear between two rows."""
    width = max(1, round(ROW_S * segment.rate_hz))
    means = np.empty((2, rows // width // 2 * 2, 3))
    _average(segment.acc_g[first_row:], width, means[0])
    _average(segment.gyr_dps[first_row:], width, means[1])
    acc_g, gyr_dps = means
    period_s = width / segment.rate_hz
    turn = np.zeros_like(gyr_dps)
    turn[:-1] = (gyr_dps[:-1] + gyr_dps[1:]) * (0.5 * period_s * RADIANS)
    return acc_g, turn, period_s


@kernel
def _average(samples: Any, width: int, means: Any) -> None:  # pragma: no cover
    """Compute the mean of each ``width`` rows."""
    for k in range(len(means)):
        for axis in range(3):
            total = 0.0
            for row in range(k * width, (k + 1) * width):
                total += samples[row, axis]
            means[k, axis] = total / width


def pick_windows(windows: GravityWindows, numbers: NDArray[np.int64]) -> GravityWindows:
    """Return some of the windows."""
    lengths = np.diff(windows.first)[numbers]
    rows = np.concatenate(
        [np.arange(windows.first[k], windows.first[k + 1]) for k in numbers] or [np.zeros(0, np.int64)]
    )
    first = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    return GravityWindows(windows.acc_g[rows], windows.turn[rows], first, windows.period_s[numbers])


def measure_speed_dps(windows: GravityWindows) -> Float64Array:
    """Return the root mean square of the angular rate in each window, deg/s if it reads deg/s, shape (n,)."""
    if len(windows) == 0:
        return np.zeros(0)
    square = np.add.reduceat((windows.turn**2).sum(axis=1), windows.first[:-1])
    return np.asarray(np.sqrt(square / np.diff(windows.first)) / (windows.period_s * RADIANS))


def find_plain(windows: GravityWindows) -> NDArray[np.bool_]:
    """Return which windows have an acceleration as long as gravity in both halves, shape (n,)."""
    if len(windows) == 0:
        return np.zeros(0, np.bool_)
    length_g = np.linalg.norm(windows.acc_g, axis=1)
    edges = np.sort(np.concatenate([windows.first[:-1], (windows.first[:-1] + windows.first[1:]) // 2]))
    halves_g = np.add.reduceat(length_g, edges) / np.diff(np.append(edges, len(length_g)))
    return np.asarray((np.abs(halves_g - 1.0) < PLAIN_G).reshape(-1, 2).all(axis=1))


def measure_miss(windows: GravityWindows, model: GyroModel) -> Float64Array:
    """Return the distance, in g, between gravity in the second half and in the first, shape (n,)."""
    miss, _ = _carry(windows, model, has_slope=False)
    return np.asarray(np.linalg.norm(miss, axis=1))


def fit_model(
    windows: GravityWindows, start: GyroModel, shape: Float64Array, factor: float = 1.0, rounds: int = 8
) -> tuple[GyroModel, Float64Array, Float64Array]:
    """Return the fitted model, the change of its free values from the start, (p,), and their standard errors.

    Gauss-Newton with Cauchy weights from ``start`` along the columns of ``shape``, (15, p). Rows of the
    shape: the gain row by row in units of ``factor``, the drift in units of 100 deg/s, and the offset of the
    accelerometer in g. Without the last, an offset of 0.04 g looks like a scale error of 5 %.
    """
    origin = np.concatenate([start.gain.ravel(), start.drift_dps / 100.0, start.offset_g])
    basis = shape * np.repeat([factor, 1.0], (9, 6))[:, None]
    likely = np.select(
        [shape[:9].any(axis=0), shape[9:12].any(axis=0)],
        [LIKELY_GAIN, LIKELY_DRIFT_DPS / 100.0],
        LIKELY_OFFSET_G,
    )
    prior = np.diag(1.0 / likely**2)
    values, normal = np.zeros(basis.shape[1]), prior
    for _ in range(rounds):
        miss, slope = _carry(windows, _unpack(origin + basis @ values), has_slope=True)
        slope = slope @ basis
        square = (miss**2).sum(axis=1)
        spread = max(float(np.median(square)) / 1.4, LEAST_SPREAD_G**2)
        weight = 1.0 / (spread * (1.0 + square / (5.7 * spread)))
        normal = np.einsum("w,wij,wik->jk", weight, slope, slope, optimize=True) + prior
        wrong = np.einsum("w,wij,wi->j", weight, slope, miss, optimize=True) + prior @ values
        step = np.linalg.solve(normal, wrong)
        values = values - step
        if np.abs(step).max() < 1e-4:
            break
    errors = np.sqrt(2.0 * np.diag(np.linalg.inv(normal)))  # windows overlap by half
    return _unpack(origin + basis @ values), values, errors


def _unpack(numbers: Float64Array) -> GyroModel:
    return GyroModel(numbers[:9].reshape(3, 3), numbers[9:12] * 100.0, numbers[12:])


def _carry(
    windows: GravityWindows, model: GyroModel, *, has_slope: bool
) -> tuple[Float64Array, Float64Array]:
    """Return the misses (n, 3) and, if requested, their slopes (n, 3, 15)."""
    miss = np.zeros((len(windows), 3))
    slope = np.zeros((len(windows) if has_slope else 0, 3, 15))
    drift = model.drift_dps * RADIANS
    gain = np.ascontiguousarray(model.gain, dtype=np.float64)
    acc_g = windows.acc_g - model.offset_g
    room = (np.empty((3, 3)), np.empty((3, 12)))
    _carry_windows(acc_g, windows.turn, windows.first, windows.period_s, gain, drift, room, miss, slope)
    slope[:, :, 9:12] *= 100.0 * RADIANS
    return miss, slope


@kernel
def _carry_windows(
    acc: Any, turn: Any, first: Any, period: Any, gain: Any, drift: Any, room: Any, miss: Any, slope: Any
) -> None:  # pragma: no cover
    """Sum the accelerations in the frame of the first row, minus in the first half, plus in the second.

    ``frame`` takes vectors of the present row to the first; ``lean`` (3, 12) is the rotation of that frame
    per unit of gain and drift. Uses exact sine and cosine, because a unit may be wrong by a factor of
    thousands.
    """
    frame, lean = room
    for w in range(len(period)):
        for i in range(3):
            for j in range(3):
                frame[i, j] = 1.0 if i == j else 0.0
            for q in range(12):
                lean[i, q] = 0.0
        half = (first[w + 1] - first[w]) // 2
        for row in range(first[w], first[w + 1]):
            part = (1.0 if row >= first[w] + half else -1.0) / half
            a = acc[row]
            x = part * (frame[0, 0] * a[0] + frame[0, 1] * a[1] + frame[0, 2] * a[2])
            y = part * (frame[1, 0] * a[0] + frame[1, 1] * a[1] + frame[1, 2] * a[2])
            z = part * (frame[2, 0] * a[0] + frame[2, 1] * a[1] + frame[2, 2] * a[2])
            miss[w, 0] += x
            miss[w, 1] += y
            miss[w, 2] += z
            if len(slope):
                for q in range(12):
                    slope[w, 0, q] += lean[1, q] * z - lean[2, q] * y
                    slope[w, 1, q] += lean[2, q] * x - lean[0, q] * z
                    slope[w, 2, q] += lean[0, q] * y - lean[1, q] * x
                for i in range(3):
                    for j in range(3):
                        slope[w, i, 12 + j] -= part * frame[i, j]
            _turn_frame(frame, lean, turn[row], gain, drift, period[w], len(slope) > 0)


@inner
def _turn_frame(
    frame: Any, lean: Any, turn: Any, gain: Any, drift: Any, period_s: float, has_slope: Any
) -> None:  # pragma: no cover
    """Advance one row: ``frame @ exp([turn]x)`` (Rodrigues)."""
    x = gain[0, 0] * turn[0] + gain[0, 1] * turn[1] + gain[0, 2] * turn[2] + drift[0] * period_s
    y = gain[1, 0] * turn[0] + gain[1, 1] * turn[1] + gain[1, 2] * turn[2] + drift[1] * period_s
    z = gain[2, 0] * turn[0] + gain[2, 1] * turn[1] + gain[2, 2] * turn[2] + drift[2] * period_s
    square = x * x + y * y + z * z
    angle = sqrt(square)
    sine = sin(angle) / angle if angle > 1e-9 else 1.0
    cosine = (1.0 - cos(angle)) / square if angle > 1e-4 else 0.5
    for i in range(3):
        u, v, w = frame[i, 0], frame[i, 1], frame[i, 2]
        # u x turn, and its cross product with turn
        p, q, r = v * z - w * y, w * x - u * z, u * y - v * x
        frame[i, 0] = u + sine * p + cosine * (q * z - r * y)
        frame[i, 1] = v + sine * q + cosine * (r * x - p * z)
        frame[i, 2] = w + sine * r + cosine * (p * y - q * x)
        if has_slope:
            for j in range(3):
                for k in range(3):
                    lean[i, 3 * j + k] += frame[i, j] * turn[k]
                lean[i, 9 + j] += frame[i, j] * period_s


# The verdict.

LIVELY_G = 0.1
"""A window counts as evidence if, without the gyroscope, its halves would be this far apart."""
LEAST_MISS_G = 0.02
MOST_DPS = 4500.0
"""No sensor in use reads more than 4000 deg/s."""
FEWEST_WINDOWS = 3
GOOD_SCORE = 0.35
BAD_SCORE, BAD_MISS_G, BAD_WINDOWS = 0.5, 0.15, 6
"""No correct recording of the project has a score over 0.5 with a miss over 0.10 g, or a score over 0.25 in
slow movement.
"""
CLEAR_NATS, CLEAR_RATIO = 12.0, 0.6
UNIT_NATS = 8.0
"""Enough for a factor that then fits well."""
USUAL_ERROR, MOST_FACTOR_NATS = 0.1, 8.0
"""Usual relative error of factors, and the largest penalty for an unusual factor."""
CERTAIN_NATS, KNOWN_RATIO = 25.0, 0.75
"""A factor may fit less well if the recording is poor."""
RIVAL_NATS = 4.0
SCALES = (0.25, 0.5, 0.7, 1.4, 2.0, 4.0)
SCALE_TOLERANCE, SCALE_ERRORS = 0.05, 6.0
"""Sensors are up to 3 % off; the fusion estimates and corrects this (acromion.fusion.sensor)."""
SLOW_DPS = 45.0
"""Windows up to this rate (root mean square) are used for the scale: at 0.3 m from the axis, the centripetal
acceleration is then 0.02 g. In fast movement it imitates a scale: correct gyroscopes seemed to need factors
of 0.77 to 1.14.
"""
FEWEST_SLOW = 6
FAST_DPS = 135.0
"""Above this rate a window contains three full turns: an error of 1 % of scale grows to 10 deg."""
MOST_SEARCHED, MOST_REFINED = 50, 16
OFFSET_BASIS = np.eye(15)[:, 9:]
"""Shape of a fit of the offsets only."""
SCALE_BASIS = np.column_stack([np.append(np.eye(3).ravel(), np.zeros(6)), OFFSET_BASIS])
"""Shape of a fit of one factor on all axes, and the offsets."""
BLIND = GyroModel(np.zeros((3, 3)), np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """True rate = ``factor`` times the reading, minus an offset; negative for a left-handed frame.

    ``miss_g`` (n,): misses of the windows.
    ``score``: 0 explains everything, 1 is as bad as without a gyroscope.
    """

    model: GyroModel
    miss_g: Float64Array
    score: float

    @property
    def factor(self) -> float:
        """The factor common to all axes."""
        return float(np.trace(self.model.gain) / 3.0)

    def is_like(self, other: "Arrangement") -> bool:
        """Return whether both agree, apart from a scale that is measured later."""
        return 0.5 < self.factor / (other.factor or 1e-12) < 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Scale:
    """The remaining scale error of the rates, common to all axes, with its standard error."""

    overall: float
    error: float

    @property
    def is_off(self) -> bool:
        """Whether it exceeds the usual error of sensors with certainty."""
        return abs(self.overall - 1.0) > max(SCALE_TOLERANCE, SCALE_ERRORS * self.error)


@dataclass(frozen=True, slots=True, eq=False)
class FrameEvidence:
    """The evidence of the motion: the fit as read, the best fit, and whether it is beyond doubt.

    ``lively``: number of windows that are evidence.
    ``plain``: how many of them turn slowly and keep the length of gravity.
    ``plain_score``: the unexplained part of these. Only these are enough evidence for an error: a car or a
    fast spin is not.
    ``chosen``: differs from ``as_read`` if a unit or a left-handed frame has to be corrected with certainty.
    ``has_better``: another factor fits far better, but which one is uncertain.
    """

    lively: int
    plain: int
    plain_score: float
    as_read: Arrangement
    chosen: Arrangement
    has_better: bool = False

    @property
    def is_doubtful(self) -> bool:
        """Whether it does not fit as read, and no correction was found."""
        if self.chosen is not self.as_read:
            return False
        miss_g = float(np.sqrt(np.mean(np.minimum(self.as_read.miss_g, 2.0) ** 2)))
        return self.is_wrong or self.has_better or (self.as_read.score > BAD_SCORE and miss_g > BAD_MISS_G)

    @property
    def is_settled(self) -> bool:
        """Whether the motion supports the chosen factor."""
        return self.chosen is not self.as_read or (self.as_read.score <= BAD_SCORE and not self.is_doubtful)

    @property
    def is_wrong(self) -> bool:
        """Whether it is doubtful, with enough evidence for an error."""
        if self.chosen is not self.as_read:
            return False
        is_unlike = self.plain >= BAD_WINDOWS and self.plain_score > BAD_SCORE
        return is_unlike or (self.has_better and self.lively >= BAD_WINDOWS)


def judge_frame(
    windows: GravityWindows, offset_dps: Float64Array, factors: Sequence[float]
) -> FrameEvidence | None:
    """Return the evidence on unit factor and handedness; None if there is too little motion.

    ``offset_dps``: the gyroscope's reading at rest. ``factors``: possible units; the first is used unless
    another one is clearly right.
    """
    search = _Search(windows, offset_dps, factors, measure_miss(windows, BLIND))
    is_lively = search.blind_g > LIVELY_G
    lively = int(is_lively.sum())
    if lively < FEWEST_WINDOWS:
        return None
    as_read = search.refine(search.try_factor(factors[0]), OFFSET_BASIS)
    if as_read.score <= GOOD_SCORE:
        return FrameEvidence(lively, lively, as_read.score, as_read, as_read)
    plain = is_lively & (measure_speed_dps(windows) * factors[0] < FAST_DPS) & find_plain(windows)
    plain_score = search.score(as_read.miss_g, plain)
    seen = FrameEvidence(lively, int(plain.sum()), plain_score, as_read, as_read)
    ranked = search.rank(np.flatnonzero(is_lively))
    best = min([as_read, *ranked], key=lambda one: (round(one.score, 3), search.doubt(one)))
    nats = search.weigh(as_read, best, best)
    is_clear = best.score < CLEAR_RATIO * as_read.score
    is_sure = nats > CERTAIN_NATS and best.score < min(BAD_SCORE, KNOWN_RATIO * as_read.score)
    if is_sure or (nats > UNIT_NATS and is_clear and best.score < GOOD_SCORE):
        rivals = (one for one in ranked if search.weigh(one, best, best) < RIVAL_NATS)
        if search.is_supported_by_halves(as_read, best) and all(one.is_like(best) for one in rivals):
            return replace(seen, chosen=best)
    return replace(seen, has_better=nats > CLEAR_NATS and is_clear and not as_read.is_like(best))


def measure_scale(windows: GravityWindows, chosen: Arrangement, factor: float) -> Scale | None:
    """Return the remaining scale after ``factor`` is applied; None if there are too few slow windows."""
    is_slow = measure_speed_dps(windows) * abs(chosen.factor) < SLOW_DPS
    slow = np.flatnonzero((measure_miss(windows, BLIND) > LIVELY_G) & is_slow)
    if len(slow) < FEWEST_SLOW:
        return None
    start = GyroModel(factor * np.eye(3), chosen.model.drift_dps, chosen.model.offset_g)
    _, values, errors = fit_model(pick_windows(windows, slow), start, SCALE_BASIS, factor)
    return Scale(1.0 + float(values[0]), float(errors[0]))


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Windows, offset at rest and possible units; ``blind_g`` (n,): misses without a gyroscope."""

    windows: GravityWindows
    offset_dps: Float64Array
    factors: Sequence[float]
    blind_g: Float64Array

    def is_supported_by_halves(self, as_read: Arrangement, best: Arrangement) -> bool:
        """Return whether both halves of the movement support the better fit."""
        left_g = [np.minimum(one.miss_g, self.blind_g) for one in (best, as_read)]
        halves = np.array_split(np.flatnonzero(self.blind_g > LIVELY_G), 2)
        return all(left_g[0][half].sum() < KNOWN_RATIO * left_g[1][half].sum() for half in halves)

    def try_factor(self, factor: float) -> Arrangement:
        gain = factor * np.eye(3)
        return self.measure(GyroModel(gain, -gain @ self.offset_dps, np.zeros(3)))

    def measure(self, model: GyroModel) -> Arrangement:
        miss_g = measure_miss(self.windows, model)
        return Arrangement(model, miss_g, self.score(miss_g, np.ones(len(miss_g), np.bool_)))

    def score(self, miss_g: Float64Array, chosen: NDArray[np.bool_]) -> float:
        """Return the unexplained share of some windows: 0 none, 1 all."""
        left_g = np.minimum(miss_g, self.blind_g)[chosen].sum()
        return float(left_g / max(self.blind_g[chosen].sum(), 1e-9))

    def refine(self, one: Arrangement, basis: Float64Array) -> Arrangement:
        """Fit the offset, or more, and keep the result only if it is better."""
        fitted = self.measure(fit_model(self.windows, one.model, basis, one.factor, rounds=4)[0])
        return fitted if fitted.score < one.score else one

    def doubt(self, one: Arrangement) -> float:
        """Return the prior nats against a factor."""
        size = max(abs(one.factor), 1e-12)
        odd = min(abs(np.log(size / named)) for named in self.factors)
        return min(0.5 * float(odd / USUAL_ERROR) ** 2, MOST_FACTOR_NATS)

    def weigh(self, one: Arrangement, other: Arrangement, best: Arrangement) -> float:
        """Return the nats in favour of ``other`` (Cauchy with the best's spread; windows overlap by half)."""
        spread_g = max(float(np.median(best.miss_g)) / 0.8, LEAST_MISS_G)
        first, second = (np.log1p((some.miss_g / spread_g) ** 2).sum() for some in (one, other))
        return float(first - second) / 2.0 + self.doubt(one) - self.doubt(other)

    def rank(self, lively: NDArray[np.intp]) -> list[Arrangement]:
        """Rank both signs of each possible factor by score on some of the windows, and fit the best ones."""
        rates = np.abs(self.windows.turn).max(axis=1)
        rates /= np.repeat(self.windows.period_s, np.diff(self.windows.first))
        fastest_dps = float(np.degrees(np.quantile(rates, 0.999)))  # ignores one reading in a thousand
        few = lively[:: max(1, -(-len(lively) // MOST_SEARCHED))]
        small = _Search(pick_windows(self.windows, few), self.offset_dps, self.factors, self.blind_g[few])
        possible = [factor for factor in self.factors if factor * fastest_dps < MOST_DPS]
        possible += [self.factors[0] * scale for scale in SCALES]
        tried = [small.try_factor(sign * factor) for factor in possible for sign in (1.0, -1.0)]
        tried.sort(key=lambda one: one.score)
        fitted = [small.refine(one, SCALE_BASIS) for one in tried[:MOST_REFINED]]
        return [self.measure(one.model) for one in fitted if abs(one.factor) * fastest_dps < MOST_DPS]


# The checks, in order.

LIVELY_RATIO, MORE_TIMES = 5.0, 3.0
"""Ratio of long to short readings. In the recordings of the project it is at most 1.8 for an accelerometer, 7
in throws, and at least a hundred for the gyroscope, or five with an offset at rest.
"""
USUAL_UNITS_G = (1.0, 1e-3, 1 / STANDARD_GRAVITY)
"""g, mg, m/s2: the units that may be confused with each other."""
REST_TOLERANCE, MOST_DOUBTED = 0.10, 0.25
"""Up to this far from 1 g at rest an accelerometer is used, with a caveat."""
MOVING_TOLERANCE, MOVING_TIMES = 0.20, 5.0
"""Without rest, the median length in movement distinguishes units, and ranges a factor of 2 apart."""
LEAST_REST_PART = 0.1
"""Acceleration at rest relative to the longest: at least 0.20 (shaken by hand) in the recordings of the
project, 0.03 without gravity.
"""
LEAST_USUAL_G = 0.05
"""Below this length in a stated unit it is not gravity; even m/s2 that was read as g is twice as long."""
RANGES_G = {0.000061: 2.0, 0.000122: 4.0, 0.000244: 8.0, 0.000732: 16.0}
"""LSM9DS1: full scale by g per count (ST, lsm9ds1_reg.c)."""
RANGES_DPS = {0.00875: 245.0, 0.0175: 500.0, 0.07: 2000.0}
"""LSM9DS1: full scale by deg/s per count (ST, lsm9ds1_reg.c)."""
WIDE_RANGE_FACTOR = 1.5
"""Programs that use 16/32768 for one count of the 16 g range (0.732 mg) read 2/3 g at rest."""
SHORTEST_S = 10.0
"""A shorter recording is too short for a report, and not enough to determine a unit."""
FEWEST_RESTS, UNEVEN_G = 10, 0.15
"""Ten simulated LSM9DS1, with offsets of 0.04 g on each axis, spread by 0.10 g at most."""
UNSEEN_SCALE = 1.5
"""With fast movement only, a false scale is smaller than this."""


def check_physics(recording: Recording) -> Recording:
    """Correct unit and frame in place on strong evidence, and flag contradictions.

    Raises
    ------
    WrongScale
        The accelerometer's reading at rest is not 1 g in any known unit, or differs between directions.
    NoGravity
        The reading at rest is almost zero; without rest, its length varies as gravity's never does.
    UnknownUnit
        Neither header nor rest and motion determine a unit.
    MixedColumns
        The two sensors contradict each other, or were not read at the same moment.
    ExchangedSensors
        Each sensor reads like the other.
    TooShort
        Less than ten seconds, if a unit has to be determined.
    """
    if not recording.stated.is_known and are_exchanged(recording.segments):
        raise ExchangedSensors
    rests = find_rests(recording.segments)
    checked = _check_gravity(recording, rests)
    # The samples may have been rescaled, so the rests are searched again if they were.
    if len(checked.flags) > len(recording.flags) or recording.stated.acc_unit == "registers":
        rests = find_rests(checked.segments)
    checked = _check_rates(_check_rest_length(checked, rests.acc), rests)
    source = recording.stated.units_from or "motion"
    return replace(checked, understood={**checked.understood, "units_from": source})


def are_exchanged(segments: Sequence[Segment]) -> bool:
    """Return whether the angular rate keeps the length of gravity, and the acceleration does not.

    The reading of an accelerometer on an arm always has about the length of gravity. A gyroscope reads almost
    zero at rest and a hundred times as much in movement. If the columns show the opposite, their names are
    exchanged.
    """
    accelerations = _measure_spread(measure_lengths(segments))
    if accelerations < LIVELY_RATIO:
        return False
    return accelerations > MORE_TIMES * _measure_spread(measure_lengths(segments, is_rate=True))


def _measure_spread(lengths: Float64Array) -> float:
    """Return the 95th percentile of the length over the 5th."""
    if len(lengths) == 0:
        return 1.0
    low, high = np.quantile(lengths, [0.05, 0.95]).tolist()
    return float(high / max(low, 1e-9))


def are_units_stated(recording: Recording) -> bool:
    """Return whether both units are stated in words with a known scale."""
    units = {_drop_unknown(recording.stated.acc_unit), _drop_unknown(recording.stated.gyr_unit)}
    return not {"", "registers"} & units


def _drop_unknown(unit: str) -> str:
    """Return a unit, or "" for a word without a scale ("raw", "lsb")."""
    return unit if unit == "registers" or acc_scale_g(unit) or gyr_scale_dps(unit) else ""


# Corrections of samples, in place (a shift is too large for a copy), and their flags.


def add_flags(recording: Recording, *flags: QualityFlag) -> Recording:
    """Return the recording with more caveats."""
    return replace(recording, flags=(*recording.flags, *flags))


def _flag_correction(recording: Recording, what: str, evidence: str, **facts: str | float) -> Recording:
    """Flag a correction, with the evidence for it (W-UNITS)."""
    flag = QualityFlag(Caveat.UNITS, facts={"what": what, "evidence": evidence, **facts})
    return add_flags(recording, flag)


def _flag_doubt(recording: Recording, sensor: str, **facts: float) -> Recording:
    """Flag a scale that the readings contradict but that stays unchanged (W-SCALE-DOUBT)."""
    return add_flags(recording, QualityFlag(Caveat.SCALE_DOUBT, facts={"sensor": sensor, **facts}))


def _multiply(
    recording: Recording, acc: float | Float64Array = 1.0, gyr: float | Float64Array = 1.0
) -> Recording:
    """Multiply the samples, all axes alike or each by its own factor, in place.

    The segments become new objects, because summaries of the old samples are invalid.
    """
    for segment in recording.segments:
        for samples, factors in ((segment.acc_g, acc), (segment.gyr_dps, gyr)):
            if np.any(np.not_equal(factors, 1.0)):
                samples[:] *= np.asarray(factors, np.float32)
    return replace(recording, segments=tuple(replace(segment) for segment in recording.segments))


# The accelerometer: 1 g at rest.


def _check_gravity(recording: Recording, rests: Rests) -> Recording:
    """Find the unit that makes the reading at rest 1 g; without rest and a stated unit, use the movement."""
    unit = _drop_unknown(recording.stated.acc_unit)
    if len(rests) == 0:
        return _check_moving_gravity(recording, unit)
    off = abs(rests.length - 1.0)
    if unit != "registers" and off <= REST_TOLERANCE:
        return recording
    factor = None if recording.stated.is_known else _find_acc_factor(rests.length, unit)
    if factor is not None:
        return _set_acc_unit(recording, unit, factor, "rest", rests.length)
    if off <= MOST_DOUBTED:
        return _flag_doubt(recording, "accelerometer", g=round(rests.length, 3))
    _check_gravity_present(recording)
    _refuse_short(recording)
    raise WrongScale(g=round(rests.length, 3))


def _check_moving_gravity(recording: Recording, unit: str) -> Recording:
    """Handle a recording without rest: a stated unit is kept unless it is impossible."""
    part = _check_gravity_present(recording)
    lengths = measure_lengths(recording.segments)
    usual = float(np.median(lengths)) if len(lengths) else 0.0
    if part is not None and acc_scale_g(unit) and usual < LEAST_USUAL_G:
        raise NoGravity
    is_likely = 1.0 / MOVING_TIMES < usual < MOVING_TIMES
    is_lively = _measure_spread(lengths) > LIVELY_RATIO
    if recording.stated.is_known or (unit != "registers" and is_likely):
        return _flag_doubt(recording, "accelerometer", moving_g=round(usual, 3)) if is_lively else recording
    if unit == "registers":
        fitting = [one for one in RANGES_G if abs(usual * one - 1.0) <= MOVING_TOLERANCE]
    else:
        fitting = [one for one in USUAL_UNITS_G[1:] if 1.0 / MOVING_TIMES < usual * one < MOVING_TIMES]
    if unit not in ("", "registers") or len(fitting) != 1:
        _refuse_short(recording)
        raise NoGravity if is_lively else UnknownUnit(sensor="accelerometer")
    return _set_acc_unit(recording, unit, fitting[0], "motion", usual)


def _find_acc_factor(rest: float, unit: str) -> float | None:
    """Return the factor that makes a rest reading 1 g; replaces a stated unit only for typical mistakes."""
    tolerance, candidates = REST_TOLERANCE, tuple(RANGES_G)
    if unit == "":
        candidates = (1 / STANDARD_GRAVITY, 1e-3, WIDE_RANGE_FACTOR, *RANGES_G)
    elif unit != "registers":
        stated_g = acc_scale_g(unit) or 1.0
        slips = (true_g / stated_g for true_g in USUAL_UNITS_G if not isclose(true_g, stated_g))
        tolerance, candidates = 0.05, (*slips, WIDE_RANGE_FACTOR)
    fitting = [factor for factor in candidates if abs(rest * factor - 1.0) <= tolerance]
    return min(fitting, key=lambda factor: abs(rest * factor - 1.0), default=None)


def _set_acc_unit(recording: Recording, unit: str, factor: float, evidence: str, read_g: float) -> Recording:
    scaled = _multiply(recording, acc=factor)
    if unit == "registers":
        return replace(scaled, acc_range_g=RANGES_G[factor])
    return _flag_correction(scaled, "acceleration", evidence, factor=factor, g=round(read_g, 3))


def _check_gravity_present(recording: Recording) -> float | None:
    """Raise NoGravity if the acceleration at rest is almost zero; see :func:`measure_rest_part`."""
    part = measure_rest_part(recording.segments)
    if part is not None and part < LEAST_REST_PART:
        raise NoGravity
    return part


def _refuse_short(recording: Recording) -> None:
    present_s = sum(segment.duration_us for segment in recording.segments) / MICROSECONDS
    if present_s < SHORTEST_S:
        raise TooShort(s=present_s)


def _check_rest_length(recording: Recording, rests_g: Float64Array) -> Recording:
    """Flag an accelerometer that reads too long or too short; reject it if the length is uneven."""
    scale = measure_rest_scale(rests_g)
    if scale is not None and scale.is_even:
        is_off = scale.is_off
        return (
            _flag_doubt(recording, "accelerometer", g=round(1.0 / scale.factor, 3)) if is_off else recording
        )
    if len(rests_g) >= FEWEST_RESTS:
        low_g, high_g = np.quantile(np.linalg.norm(rests_g, axis=1), [0.02, 0.98]).tolist()
        if high_g - low_g > UNEVEN_G:
            raise WrongScale(low_g=round(low_g, 2), high_g=round(high_g, 2))
    return recording


# The gyroscope: unit and handedness, from the rotation of gravity.


def _check_rates(recording: Recording, rests: Rests) -> Recording:
    unit = _drop_unknown(recording.stated.gyr_unit)
    windows = cut_windows(recording.segments)
    offset_dps = np.median(rests.gyr, axis=0) if len(rests) else np.zeros(3)
    is_cut = find_flat_range([summarise(segment)[1] for segment in recording.segments]) is not None
    evidence = judge_frame(windows, offset_dps, _list_rate_factors(unit))
    if evidence is not None:
        _check_mixed(recording, evidence)
    if evidence is not None and evidence.is_settled:
        recording = _apply_arrangement(recording, unit, windows, evidence)
    elif unit in ("", "registers"):
        _refuse_short(recording)
        is_gravity = _measure_spread(measure_lengths(recording.segments)) <= LIVELY_RATIO
        raise UnknownUnit(sensor="gyroscope") if is_gravity else NoGravity
    elif evidence is not None and evidence.is_doubtful:
        recording = add_flags(recording, QualityFlag(Caveat.MIXED, facts=_describe_mixed(evidence)))
    return _narrow_ranges(recording, is_cut=is_cut)


def _list_rate_factors(unit: str) -> tuple[float, ...]:
    if unit == "registers":
        return tuple(RANGES_DPS)
    if unit == "":
        return (1.0, DEG_PER_RAD, 1e-3, *RANGES_DPS)
    return (1.0, DEG_PER_RAD, 1 / DEG_PER_RAD, 1e-3, 1e3)


def _check_mixed(recording: Recording, evidence: FrameEvidence) -> None:
    """Raise MixedColumns if a known header is contradicted, or if nothing explains the motion."""
    is_other = evidence.chosen is not evidence.as_read and evidence.lively >= BAD_WINDOWS
    if recording.stated.is_known and is_other:
        raise MixedColumns(**_describe_mixed(evidence), factor=float(f"{evidence.chosen.factor:.3g}"))
    if evidence.is_wrong:
        raise MixedColumns(**_describe_mixed(evidence))


def _describe_mixed(evidence: FrameEvidence) -> dict[str, int]:
    return {"percent": round(100.0 * evidence.as_read.score), "turns": evidence.lively}


def _apply_arrangement(
    recording: Recording, unit: str, windows: GravityWindows, evidence: FrameEvidence
) -> Recording:
    """Apply the unit and handedness from the motion, then flag a remaining scale error."""
    chosen = evidence.chosen
    size = max(abs(chosen.factor), 1e-12)
    factor = min(_list_rate_factors(unit), key=lambda named: abs(np.log(size / named)))
    if factor != 1.0:
        recording = _multiply(recording, gyr=factor)
        if unit == "registers":
            recording = replace(recording, gyr_range_dps=RANGES_DPS[factor])
        recording = _flag_correction(recording, "angular rate", "motion", factor=factor)
    if chosen.factor < 0.0:  # left-handed: reverse x of both sensors
        mirror = np.array([-1.0, 1.0, 1.0])
        recording = _multiply(recording, mirror, mirror)
        recording = _flag_correction(recording, "left-handed", "motion", turned="x")
        library = recording.stated.left_gyr_factor
        if library != 1.0:  # Arduino_LSM9DS1 prints 61.04 mdps for a count of 70
            recording = replace(_multiply(recording, gyr=library), device="lsm9ds1")
            recording = _flag_correction(recording, "angular rate", "layout", factor=library)
            factor *= library
        factor = -factor
    scale = measure_scale(windows, chosen, factor)
    if scale is None:
        left = chosen.factor / factor
        return recording if 1.0 / UNSEEN_SCALE < left < UNSEEN_SCALE else _doubt_scale(recording, left)
    return _doubt_scale(recording, scale.overall) if scale.is_off else recording


def _doubt_scale(recording: Recording, overall: float) -> Recording:
    """Flag a scale that the movement contradicts.

    A wrong sampling rate looks like a gyroscope of another scale. If the rows have no time, the rate is
    flagged instead.
    """
    if not recording.stated.is_counted:
        return _flag_doubt(recording, "gyroscope", factor=round(overall, 3))
    facts: dict[str, str | float] = {
        "rate_from": "doubted",
        "rate_hz": round(recording.rate_hz, 3),
        "other_hz": round(recording.rate_hz / overall, 1),
    }
    return add_flags(recording, QualityFlag(Caveat.RATE, facts=facts))


def _narrow_ranges(recording: Recording, *, is_cut: bool) -> Recording:
    """Set the full scale to the level at which the samples are clipped, if it is lower than stated.

    ``is_cut``: flat tops of the gyroscope were found, in any unit.
    """
    acc, gyr = zip(*map(summarise, recording.segments), strict=True)
    acc_g = find_flat_range(acc, LEAST_ACC_TOP_G)
    gyr_dps = find_flat_range(gyr if is_cut else (), LEAST_GYR_TOP_DPS)
    return replace(
        recording,
        acc_range_g=min((r for r in (acc_g, recording.acc_range_g) if r is not None), default=None),
        gyr_range_dps=min((r for r in (gyr_dps, recording.gyr_range_dps) if r is not None), default=None),
    )


def refuse_impossible_rates(recording: Recording) -> Recording:
    """Return the recording; raises WrongScale if it contains rates that no such sensor can read."""
    for segment in recording.segments:
        size = summarise(segment)[1].find_extreme()
        if size > MOST_DPS:
            row = int(np.flatnonzero(np.abs(segment.gyr_dps).max(axis=1) > MOST_DPS)[0])
            at_s = segment.start_s + row / segment.rate_hz
            clock = f"+{at_s:.2f} s"
            if recording.start is not None:
                clock = f"{read_clock(recording.start, round(at_s * MICROSECONDS)):%Y-%m-%d %H:%M:%S}"
            raise WrongScale(dps=round(size), clock=clock)
    return recording
