"""Which unit, sign, order and scale of the gyroscope's axes makes gravity stand still.

Angles are measured from a pose, so that what is done to both sensors alike does not matter: it is enough to
make the gyroscope agree with the accelerometer, whichever of the two is mixed up. A left-handed frame is the
gyroscope turned about.

As it is, a recording is left alone unless another arrangement is far better, fits well by itself, and has no
rival: every other of the 48 orders and signs, at its own best scale, must be clearly worse or give the same
angles. Odds are in nats: the logarithm of how much likelier one arrangement makes what was seen than another.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.checks.gravity_windows import (
    WINDOW_S,
    GravityWindows,
    GyroModel,
    find_plain,
    fit_model,
    measure_miss,
    measure_speed_dps,
    pick_windows,
)
from fusion.recording import Float64Array, QualityFlag, flag_stretches

# Parts of a recording in which the two sensors contradict each other, though in the rest they agree.
#
# So does a sensor that was started again in another range, a program that turned an axis over from some
# hour on, or a gyroscope that was knocked. The windows that tell the axes of the whole are judged a few at
# a time.


LIVELY_G = 0.1
TOGETHER = 6
INCONSISTENT_SCORE, INCONSISTENT_MISS_G = 0.5, 0.2
"""Of good recordings, eight windows have a score of 0.39 at most, or miss by less than 0.17 g together."""


def flag_inconsistent_spans(windows: GravityWindows, model: GyroModel) -> tuple[QualityFlag, ...]:
    """Flag the stretches that contradict what holds for the whole (W-MIXED-PART)."""
    miss_g = measure_miss(windows, model)
    blind = GyroModel(np.zeros((3, 3)), np.zeros(3), np.zeros(3))
    blind_g = measure_miss(windows, blind)
    lively = np.flatnonzero(blind_g > LIVELY_G)
    odd = _mark_inconsistent(np.minimum(miss_g, blind_g)[lively], miss_g[lively], blind_g[lively])
    if not odd.any():
        return ()
    starts_s = windows.start_s[lively[odd]]
    spans_s = _join(starts_s)
    return (flag_stretches(Caveat.MIXED_PART, spans_s, {"turns": int(odd.sum())}),)


def _mark_inconsistent(
    left_g: Float64Array, miss_g: Float64Array, blind_g: Float64Array
) -> NDArray[np.bool_]:
    """Which lively windows are among any six that follow each other and are together as bad as can be."""
    odd = np.zeros(len(left_g), np.bool_)
    for first in range(len(left_g) - TOGETHER + 1):
        some = slice(first, first + TOGETHER)
        miss = float(np.sqrt(np.mean(np.minimum(miss_g[some], 2.0) ** 2)))
        if left_g[some].sum() > INCONSISTENT_SCORE * blind_g[some].sum() and miss > INCONSISTENT_MISS_G:
            odd[some] = left_g[some] > INCONSISTENT_SCORE * blind_g[some]
    return odd


def _join(starts_s: Float64Array) -> tuple[tuple[float, float], ...]:
    """Windows that follow each other closely, as stretches (start, end)."""
    joined: list[tuple[float, float]] = []
    for start_s in np.round(starts_s, 2).tolist():
        if joined and start_s <= joined[-1][1] + WINDOW_S:
            joined[-1] = (joined[-1][0], start_s + WINDOW_S)
        else:
            joined.append((start_s, start_s + WINDOW_S))
    return tuple(joined)


# A gyroscope that is written earlier or later than the accelerometer, by a part of a second.
#
# Two sensors that are read through buffers of their own may stand in one row with different times. Every
# turn is then seen too early or too late, and the angles are wrong in all movement: 50 ms cost up to 20
# deg. The same windows that tell the axes tell the lag: gravity stands still at one shift of the rates
# alone.


MOST_LAG_S, LEAST_PERIODS, PROBED_PERIODS = 0.24, 1.5, 2
FEWEST_LAG_WINDOWS = 12
LIKELY_NATS, LIKELY_LAG_S = 4.0, 0.025
CERTAIN_LAG_NATS, CERTAIN_LAG_S = 12.0, 0.06
"""Good recordings in hand fit best as they are; late by 100 ms they give 13 to 29 nats, by 50 ms 4 to 13.
The lag itself is known to about 20 ms: too little to put it right, which would leave 5 deg in fast movement.
"""
LEAST_MISS_G = 0.02


@dataclass(frozen=True, slots=True)
class SensorLag:
    """By how much the gyroscope is later than the accelerometer, and how much likelier that is than not."""

    lag_s: float
    nats: float

    @property
    def is_likely(self) -> bool:
        """Enough for a warning."""
        return self.nats > LIKELY_NATS and abs(self.lag_s) > LIKELY_LAG_S

    @property
    def is_certain(self) -> bool:
        """Enough to refuse the recording."""
        return self.nats > CERTAIN_LAG_NATS and abs(self.lag_s) > CERTAIN_LAG_S


def measure_lag(windows: GravityWindows, model: GyroModel) -> SensorLag:
    """Find the shift of the rates at which gravity stands stillest; none, where few windows tell."""
    if len(windows) < FEWEST_LAG_WINDOWS:
        return SensorLag(0.0, 0.0)
    period_s = float(np.median(windows.period_s))
    most = min(int(MOST_LAG_S / period_s), int(np.diff(windows.first).min()) // 4)
    if _is_least(windows, model, min(PROBED_PERIODS, most)):
        return SensorLag(0.0, 0.0)
    shifts = range(-most, most + 1)
    against = _weigh_shifts(windows, model, shifts)
    best = int(against.argmin())
    if abs(shifts[best]) < LEAST_PERIODS:
        return SensorLag(0.0, 0.0)
    return SensorLag(shifts[best] * period_s, float(against[most] - against[best]))


def _is_least(windows: GravityWindows, model: GyroModel, rows: int) -> bool:
    """Whether no shift fits better than one to either side: with a lag, all go down towards it."""
    earlier, as_read, later = _weigh_shifts(windows, model, (-rows, 0, rows))
    return bool(as_read <= min(earlier, later))


def _weigh_shifts(windows: GravityWindows, model: GyroModel, shifts: Sequence[int]) -> Float64Array:
    return _weigh(np.array([measure_miss(_shift(windows, rows), model) for rows in shifts]))


def _weigh(miss_g: Float64Array) -> Float64Array:
    """Nats against each shift, (m,) of misses (m, n): Cauchy, as arrangements are weighed."""
    spread_g = max(float(np.median(miss_g, axis=1).min()) / 0.8, LEAST_MISS_G)
    return np.asarray(np.log1p((miss_g / spread_g) ** 2).sum(axis=1) / 2.0)


def _shift(windows: GravityWindows, rows: int) -> GravityWindows:
    """Each acceleration beside the rates so many rows later; what has no partner falls away."""
    starts, stops = windows.first[:-1], windows.first[1:]
    kept = [np.arange(a + max(0, -rows), b - max(0, rows)) for a, b in zip(starts, stops, strict=True)]
    numbers = np.concatenate(kept)
    first = np.concatenate([[0], np.cumsum([len(one) for one in kept])]).astype(np.int64)
    return GravityWindows(
        windows.acc_g[numbers], windows.turn[numbers + rows], first, windows.period_s, windows.start_s
    )


MOST_DPS = 4500.0
"""No part in use reads more than 4000 deg/s."""

"""A window tells something if its halves would be so far apart without a gyroscope."""
FEWEST_WINDOWS = 3
GOOD_SCORE = 0.35
BAD_SCORE, BAD_MISS_G, BAD_WINDOWS = 0.6, 0.15, 6
"""No good recording in hand has a score over 0.6 and misses by more than 0.10 g (BROAD's translations)."""
CLEAR_NATS, CLEAR_RATIO = 12.0, 0.6
UNIT_NATS = 8.0
"""Enough for a unit, or a left-handed frame, where the axes are in their order."""
USUAL_ERROR, MOST_FACTOR_NATS = 0.1, 8.0
"""By what share factors are off as a rule, and the most that an odd one counts against an arrangement."""
CERTAIN_NATS, KNOWN_RATIO = 25.0, 0.75
"""A unit or a left-handed frame, which are common, may fit less well where the recording is poor."""
STRAY = 0.3
RIVAL_NATS = 4.0

SAME_SHARE = 0.02
"""Two arrangements under which the turns differ by so little (squared) give the same angles."""
SCALES = (0.25, 0.5, 0.7, 1.4, 2.0, 4.0)
SCALE_TOLERANCE, SCALE_ERRORS = 0.05, 6.0
"""Parts are up to 3 % off, which the fusion finds and corrects by itself (fusion.sensor)."""
SLOW_DPS = 45.0
"""Windows up to this rate (root mean square) judge the scale: an arm of 0.3 m then feels 0.02 g outwards. On
fast movement that force imitates a scale: right gyroscopes seemed to need factors of 0.77 to 1.14.
"""
FEWEST_SLOW = 6
FAST_DPS = 135.0
"""Over this, a window turns three times round: an error of 1 % of scale has grown to 10 deg."""
MOST_SEARCHED, MOST_REFINED = 50, 16
OFFSET = np.eye(15)[:, 9:]
"""Shape of a fit of nothing but the offsets."""

TURNS = tuple(
    np.array(signs)[:, None] * np.eye(3)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
)
"""All 48; row i says which reading, with which sign, is the rate about axis i. The first changes nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """True rate = ``factor`` times ``turn`` (3, 3) @ reading.

    ``miss_g`` (n,) of the windows, and ``score``: 0 explains everything, 1 no better than no gyroscope.
    """

    turn: Float64Array
    model: GyroModel
    miss_g: Float64Array
    score: float

    @property
    def factor(self) -> float:
        """On all axes alike."""
        return float((self.model.gain * self.turn).sum() / 3.0)

    @property
    def is_known(self) -> bool:
        """Whether the order is right, and all signs are or none is: what happens most."""
        return bool(abs(np.trace(self.turn)) > 2.0)


@dataclass(frozen=True, slots=True, eq=False)
class Scale:
    """What is left to multiply the rates by, on all axes alike, with its standard error.

    ``halves``: the same from the first and from the second half of the movement.
    """

    overall: float
    error: float
    halves: tuple[float, float]

    @property
    def is_off(self) -> bool:
        """Surely by more than parts are."""
        return abs(self.overall - 1.0) > max(SCALE_TOLERANCE, SCALE_ERRORS * self.error)

    @property
    def is_confirmed(self) -> bool:
        """Whether both halves say the same."""
        return abs(self.halves[0] / self.halves[1] - 1.0) < SCALE_TOLERANCE


@dataclass(frozen=True, slots=True, eq=False)
class FrameEvidence:
    """What the motion says: how it is as read, what fits best, and whether that is beyond doubt.

    ``lively``: windows that tell something; ``plain``: how many of them turn slowly and keep the length of
    gravity, and ``plain_score``: how much is left of these. Only there does it speak against the columns: not
    in a car, and not in a fast spin.
    ``chosen`` is another than ``as_read`` where a unit or a left-handed frame surely is to be put right;
    ``better`` is what surely fits but is not put right: columns in another order, single signs.
    ``has_better``: something else fits far better, and it is not sure what.
    """

    lively: int
    plain: int
    plain_score: float
    as_read: Arrangement
    chosen: Arrangement
    better: Arrangement | None = None
    has_better: bool = False

    @property
    def is_doubtful(self) -> bool:
        """As read it does not fit, and nothing that could be put right was found."""
        if self.chosen is not self.as_read:
            return False
        return self.has_better or _is_unexplained(self.as_read.miss_g, self.as_read.score)

    @property
    def is_settled(self) -> bool:
        """Whether the motion bears out what was chosen."""
        return self.chosen is not self.as_read or (self.as_read.score <= BAD_SCORE and not self.is_doubtful)

    @property
    def is_wrong(self) -> bool:
        """The same, on evidence enough to refuse."""
        if self.has_better:
            return self.lively >= BAD_WINDOWS
        return self.is_doubtful and self.plain >= BAD_WINDOWS and self.plain_score > BAD_SCORE


def judge_frame(
    windows: GravityWindows, offset_dps: Float64Array, factors: Sequence[float]
) -> FrameEvidence | None:
    """Find the unit factor, order and signs; None where there is too little motion to tell.

    ``offset_dps``: what the gyroscope reads at rest. ``factors``: units that come into question, the first
    unless another is surely right.
    """
    search = _start_search(windows, offset_dps, factors)
    if search.lively < FEWEST_WINDOWS:
        return None
    as_read = search.refine(search.try_out(factors[0], TURNS[0]), OFFSET)
    if as_read.score <= GOOD_SCORE and search.stays(as_read):
        return FrameEvidence(search.lively, search.lively, as_read.score, as_read, as_read)
    is_slow = measure_speed_dps(windows) * factors[0] < FAST_DPS
    plain = search.is_lively & is_slow & find_plain(windows)
    seen = FrameEvidence(
        search.lively, int(plain.sum()), search.score(as_read.miss_g, plain), as_read, as_read
    )
    return _choose(search, seen, search.rank())


def _is_unexplained(miss_g: Float64Array, score: float) -> bool:
    """Whether so much is left that it is no good recording."""
    return score > BAD_SCORE and float(np.sqrt(np.mean(np.minimum(miss_g, 2.0) ** 2))) > BAD_MISS_G


def _choose(search: "_Search", seen: FrameEvidence, ranked: list[Arrangement]) -> FrameEvidence:
    as_read = seen.as_read
    best = min([as_read, *ranked], key=lambda one: (round(one.score, 3), search.doubt(one)))
    nats = search.weigh(as_read, best, best)
    is_better = nats > CLEAR_NATS and best.score < CLEAR_RATIO * as_read.score
    is_unit = best.is_known and nats > UNIT_NATS and best.score < CLEAR_RATIO * as_read.score
    is_sure = best.is_known and nats > CERTAIN_NATS and best.score < KNOWN_RATIO * as_read.score
    has_better = is_better and not search.is_same(as_read, best)
    if is_sure or ((is_better or is_unit) and best.score < GOOD_SCORE):
        rivals = (one for one in ranked if search.weigh(one, best, best) < RIVAL_NATS)
        if search.holds_in_halves(as_read, best) and all(search.is_same(one, best) for one in rivals):
            if best.is_known:
                return replace(seen, chosen=best)
            return replace(seen, better=best, has_better=has_better)
    return replace(seen, has_better=has_better)


def measure_scale(windows: GravityWindows, chosen: Arrangement, factor: float) -> Scale | None:
    """What is left of the scale once the axes are arranged and a unit factor applied; None where too few slow
    windows tell.
    """
    start = GyroModel(factor * chosen.turn, chosen.model.drift_dps, chosen.model.offset_g)
    blind = GyroModel(np.zeros((3, 3)), np.zeros(3), np.zeros(3))
    tells = (measure_miss(windows, blind) > LIVELY_G) & (
        measure_speed_dps(windows) * chosen.factor < SLOW_DPS
    )
    slow = np.flatnonzero(tells)
    if len(slow) < FEWEST_SLOW:
        return None
    basis = make_scale_basis(chosen.turn)
    fits = [
        fit_model(pick_windows(windows, some), start, basis, factor)
        for some in (slow, *np.array_split(slow, 2))
    ]
    whole, first, second = (1.0 + float(fit.values[0]) for fit in fits)
    return Scale(whole, float(fits[0].errors[0]), (first, second))


def fit_arrangement(windows: GravityWindows, chosen: Arrangement, factor: float) -> GyroModel:
    """The model from readings to true rates that the windows give, one factor on all axes."""
    start = GyroModel(factor * chosen.turn, chosen.model.drift_dps, chosen.model.offset_g)
    return fit_model(windows, start, make_scale_basis(chosen.turn), factor).model


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The windows, what each would miss without a gyroscope, (n,), and the offset at rest."""

    windows: GravityWindows
    offset_dps: Float64Array
    factors: Sequence[float]
    blind_g: Float64Array

    @property
    def is_lively(self) -> NDArray[np.bool_]:
        return np.asarray(self.blind_g > LIVELY_G)

    @property
    def lively(self) -> int:
        return int(self.is_lively.sum())

    def holds_in_halves(self, as_read: Arrangement, best: Arrangement) -> bool:
        """Whether both halves of the movement bear out what fits better."""
        left_g = [np.minimum(one.miss_g, self.blind_g) for one in (best, as_read)]
        halves = np.array_split(np.flatnonzero(self.is_lively), 2)
        return all(left_g[0][half].sum() < KNOWN_RATIO * left_g[1][half].sum() for half in halves)

    @property
    def fastest_dps(self) -> float:
        """What all but one reading in a thousand stay below, as read."""
        rates = np.abs(self.windows.turn).max(axis=1) / np.repeat(
            self.windows.period_s, np.diff(self.windows.first)
        )
        return float(np.degrees(np.quantile(rates, 0.999)))

    def try_out(self, factor: float, turn: Float64Array) -> Arrangement:
        gain = factor * turn
        return self.measure(turn, GyroModel(gain, -gain @ self.offset_dps, np.zeros(3)))

    def measure(self, turn: Float64Array, model: GyroModel) -> Arrangement:
        miss_g = measure_miss(self.windows, model)
        return Arrangement(turn, model, miss_g, self.score(miss_g, np.ones(len(miss_g), np.bool_)))

    def score(self, miss_g: Float64Array, chosen: NDArray[np.bool_]) -> float:
        """What some windows leave unexplained: 0 nothing, 1 all."""
        left_g = np.minimum(miss_g, self.blind_g)[chosen].sum()
        return float(left_g / max(self.blind_g[chosen].sum(), 1e-9))

    def refine(self, one: Arrangement, basis: Float64Array) -> Arrangement:
        """Fit the offset, or more, and keep it only if better."""
        fitted = self.measure(one.turn, fit_model(self.windows, one.model, basis, one.factor, rounds=4).model)
        return fitted if fitted.score < one.score else one

    def stays(self, one: Arrangement) -> bool:
        """Whether a fit of all nine numbers surely stays by the arrangement."""
        fit = fit_model(self.windows, one.model, np.eye(15), one.factor, rounds=6)
        away = np.abs(fit.model.gain / one.factor - one.turn).ravel()
        return bool(np.all(away + 3.0 * fit.errors[:9] < STRAY))

    def doubt(self, one: Arrangement) -> float:
        """Nats against an arrangement before anything is seen: odd factors, and mixed-up axes."""
        odd = min((abs(np.log(max(one.factor, 1e-12) / named)) for named in self.factors), default=0.0)
        return min(0.5 * float(odd / USUAL_ERROR) ** 2, MOST_FACTOR_NATS) + (0.0 if one.is_known else 1.0)

    def weigh(self, one: Arrangement, other: Arrangement, best: Arrangement) -> float:
        """Nats in favour of the other (Cauchy with the best's spread; windows lie half over each other)."""
        spread_g = max(float(np.median(best.miss_g)) / 0.8, LEAST_MISS_G)
        first, second = (np.log1p((some.miss_g / spread_g) ** 2).sum() for some in (one, other))
        return float(first - second) / 2.0 + self.doubt(one) - self.doubt(other)

    def is_same(self, one: Arrangement, other: Arrangement) -> bool:
        """Whether both turn the windows alike, but perhaps for a scale that is measured afterwards."""
        if np.array_equal(one.turn, other.turn) and 0.5 < one.factor / other.factor < 2.0:
            return True
        first, second = (self.windows.turn @ some.model.gain.T for some in (one, other))
        return float(((first - second) ** 2).sum()) < SAME_SHARE * float((second**2).sum())

    def rank(self) -> list[Arrangement]:
        """Arrangements by their score on some of the windows; the best ones with scale and offset fitted."""
        lively = np.flatnonzero(self.is_lively)
        few = lively[:: max(1, -(-len(lively) // MOST_SEARCHED))]
        small = _Search(pick_windows(self.windows, few), self.offset_dps, self.factors, self.blind_g[few])
        possible = [factor for factor in self.factors if factor * self.fastest_dps < MOST_DPS]
        tried = [small.try_out(factor, turn) for factor in possible for turn in TURNS]
        tried += [
            small.try_out(self.factors[0] * scale, sign * TURNS[0]) for scale in SCALES for sign in (1, -1)
        ]
        tried.sort(key=lambda one: one.score)
        fitted = [small.refine(one, make_scale_basis(one.turn)) for one in tried[:MOST_REFINED]]
        ranked = [self.measure(one.turn, one.model) for one in fitted]
        return [one for one in ranked if one.factor * self.fastest_dps < MOST_DPS]


def _start_search(windows: GravityWindows, offset_dps: Float64Array, factors: Sequence[float]) -> _Search:
    blind = GyroModel(np.zeros((3, 3)), np.zeros(3), np.zeros(3))
    return _Search(windows, offset_dps, factors, measure_miss(windows, blind))


def make_scale_basis(turn: Float64Array) -> Float64Array:
    """One factor on all axes as they are arranged, and the offsets, shape (15, 7)."""
    basis = np.zeros((15, 7))
    basis[:9, 0] = turn.ravel()
    basis[9:, 1:] = np.eye(6)
    return basis
