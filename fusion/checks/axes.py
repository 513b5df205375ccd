"""Which unit and hand of the gyroscope makes gravity stand still, and whether the two sensors agree at all.

Angles are measured from a pose, so that what is done to both sensors alike does not matter: it is enough to
make the gyroscope agree with the accelerometer. A left-handed frame is the gyroscope turned about: a negative
factor on its rates.

A recording is left alone unless another factor is far better, fits well by itself in both halves of the
movement, and has no rival. Odds are in nats: the logarithm of how much likelier one factor makes what was
seen than another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.checks.gravity_windows import (
    GravityWindows,
    GyroModel,
    find_plain,
    fit_model,
    measure_miss,
    measure_speed_dps,
    pick_windows,
)
from fusion.recording import Float64Array

LIVELY_G = 0.1
"""A window tells something if its halves would be so far apart without a gyroscope."""
LEAST_MISS_G = 0.02
MOST_DPS = 4500.0
"""No part in use reads more than 4000 deg/s."""
FEWEST_WINDOWS = 3
GOOD_SCORE = 0.35
BAD_SCORE, BAD_MISS_G, BAD_WINDOWS = 0.5, 0.15, 6
"""No right recording of a body in hand has a score over 0.5 and misses by more than 0.10 g, or a score over
0.25 in slow movement.
"""
CLEAR_NATS, CLEAR_RATIO = 12.0, 0.6
UNIT_NATS = 8.0
"""Enough for a factor that then fits well."""
USUAL_ERROR, MOST_FACTOR_NATS = 0.1, 8.0
"""By what share factors are off as a rule, and the most that an odd one counts against an arrangement."""
CERTAIN_NATS, KNOWN_RATIO = 25.0, 0.75
"""A factor may fit less well where the recording is poor."""
RIVAL_NATS = 4.0
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
OFFSET_BASIS = np.eye(15)[:, 9:]
"""Shape of a fit of nothing but the offsets."""
SCALE_BASIS = np.column_stack([np.append(np.eye(3).ravel(), np.zeros(6)), OFFSET_BASIS])
"""Shape of a fit of one factor on all axes, and the offsets."""
BLIND = GyroModel(np.zeros((3, 3)), np.zeros(3), np.zeros(3))


@dataclass(frozen=True, slots=True, eq=False)
class Arrangement:
    """True rate = ``factor`` times the reading, less an offset; negative for a left-handed frame.

    ``miss_g`` (n,) of the windows, and ``score``: 0 explains everything, 1 no better than no gyroscope.
    """

    model: GyroModel
    miss_g: Float64Array
    score: float

    @property
    def factor(self) -> float:
        """On all axes alike."""
        return float(np.trace(self.model.gain) / 3.0)

    def is_like(self, other: "Arrangement") -> bool:
        """Whether both say the same, but perhaps for a scale that is measured afterwards."""
        return 0.5 < self.factor / (other.factor or 1e-12) < 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Scale:
    """What is left to multiply the rates by, on all axes alike, with its standard error."""

    overall: float
    error: float

    @property
    def is_off(self) -> bool:
        """Surely by more than parts are."""
        return abs(self.overall - 1.0) > max(SCALE_TOLERANCE, SCALE_ERRORS * self.error)


@dataclass(frozen=True, slots=True, eq=False)
class FrameEvidence:
    """What the motion says: how it is as read, what fits best, and whether that is beyond doubt.

    ``lively``: windows that tell something; ``plain``: how many of them turn slowly and keep the length of
    gravity, and ``plain_score``: how much is left of these. Only these are evidence enough to refuse: not a
    car, and not a fast spin.
    ``chosen`` is another than ``as_read`` if a unit or a left-handed frame surely is to be put right.
    ``has_better``: another factor fits far better, and it is not sure which.
    """

    lively: int
    plain: int
    plain_score: float
    as_read: Arrangement
    chosen: Arrangement
    has_better: bool = False

    @property
    def is_doubtful(self) -> bool:
        """As read it does not fit, and nothing that could be put right was found."""
        if self.chosen is not self.as_read:
            return False
        miss_g = float(np.sqrt(np.mean(np.minimum(self.as_read.miss_g, 2.0) ** 2)))
        return self.is_wrong or self.has_better or (self.as_read.score > BAD_SCORE and miss_g > BAD_MISS_G)

    @property
    def is_settled(self) -> bool:
        """Whether the motion bears out what was chosen."""
        return self.chosen is not self.as_read or (self.as_read.score <= BAD_SCORE and not self.is_doubtful)

    @property
    def is_wrong(self) -> bool:
        """The same, on evidence enough to refuse."""
        if self.chosen is not self.as_read:
            return False
        is_unlike = self.plain >= BAD_WINDOWS and self.plain_score > BAD_SCORE
        return is_unlike or (self.has_better and self.lively >= BAD_WINDOWS)


def judge_frame(
    windows: GravityWindows, offset_dps: Float64Array, factors: Sequence[float]
) -> FrameEvidence | None:
    """Find the unit factor and the hand; None if there is too little motion to tell.

    ``offset_dps``: what the gyroscope reads at rest. ``factors``: units that come into question, the first
    unless another is surely right.
    """
    search = _Search(windows, offset_dps, factors, measure_miss(windows, BLIND))
    is_lively = search.blind_g > LIVELY_G
    lively = int(is_lively.sum())
    if lively < FEWEST_WINDOWS:
        return None
    as_read = search.refine(search.try_out(factors[0]), OFFSET_BASIS)
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
        if search.holds_in_halves(as_read, best) and all(one.is_like(best) for one in rivals):
            return replace(seen, chosen=best)
    return replace(seen, has_better=nats > CLEAR_NATS and is_clear and not as_read.is_like(best))


def measure_scale(windows: GravityWindows, chosen: Arrangement, factor: float) -> Scale | None:
    """Return what is left of the scale once ``factor`` is applied; None if too few slow windows tell."""
    is_slow = measure_speed_dps(windows) * abs(chosen.factor) < SLOW_DPS
    slow = np.flatnonzero((measure_miss(windows, BLIND) > LIVELY_G) & is_slow)
    if len(slow) < FEWEST_SLOW:
        return None
    start = GyroModel(factor * np.eye(3), chosen.model.drift_dps, chosen.model.offset_g)
    fit = fit_model(pick_windows(windows, slow), start, SCALE_BASIS, factor)
    return Scale(1.0 + float(fit.values[0]), float(fit.errors[0]))


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """Windows, the offset at rest, units in question; ``blind_g`` (n,): their misses without a gyroscope."""

    windows: GravityWindows
    offset_dps: Float64Array
    factors: Sequence[float]
    blind_g: Float64Array

    def holds_in_halves(self, as_read: Arrangement, best: Arrangement) -> bool:
        """Whether both halves of the movement bear out what fits better."""
        left_g = [np.minimum(one.miss_g, self.blind_g) for one in (best, as_read)]
        halves = np.array_split(np.flatnonzero(self.blind_g > LIVELY_G), 2)
        return all(left_g[0][half].sum() < KNOWN_RATIO * left_g[1][half].sum() for half in halves)

    def try_out(self, factor: float) -> Arrangement:
        gain = factor * np.eye(3)
        return self.measure(GyroModel(gain, -gain @ self.offset_dps, np.zeros(3)))

    def measure(self, model: GyroModel) -> Arrangement:
        miss_g = measure_miss(self.windows, model)
        return Arrangement(model, miss_g, self.score(miss_g, np.ones(len(miss_g), np.bool_)))

    def score(self, miss_g: Float64Array, chosen: NDArray[np.bool_]) -> float:
        """What some windows leave unexplained: 0 nothing, 1 all."""
        left_g = np.minimum(miss_g, self.blind_g)[chosen].sum()
        return float(left_g / max(self.blind_g[chosen].sum(), 1e-9))

    def refine(self, one: Arrangement, basis: Float64Array) -> Arrangement:
        """Fit the offset, or more, and keep it only if better."""
        fitted = self.measure(fit_model(self.windows, one.model, basis, one.factor, rounds=4).model)
        return fitted if fitted.score < one.score else one

    def doubt(self, one: Arrangement) -> float:
        """Nats against a factor before anything is seen."""
        size = max(abs(one.factor), 1e-12)
        odd = min(abs(np.log(size / named)) for named in self.factors)
        return min(0.5 * float(odd / USUAL_ERROR) ** 2, MOST_FACTOR_NATS)

    def weigh(self, one: Arrangement, other: Arrangement, best: Arrangement) -> float:
        """Nats in favour of the other (Cauchy with the best's spread; windows lie half over each other)."""
        spread_g = max(float(np.median(best.miss_g)) / 0.8, LEAST_MISS_G)
        first, second = (np.log1p((some.miss_g / spread_g) ** 2).sum() for some in (one, other))
        return float(first - second) / 2.0 + self.doubt(one) - self.doubt(other)

    def rank(self, lively: NDArray[np.intp]) -> list[Arrangement]:
        """Both hands at each possible factor by their score on some of the windows; the best ones fitted."""
        rates = np.abs(self.windows.turn).max(axis=1)
        rates /= np.repeat(self.windows.period_s, np.diff(self.windows.first))
        fastest_dps = float(np.degrees(np.quantile(rates, 0.999)))  # but one reading in a thousand
        few = lively[:: max(1, -(-len(lively) // MOST_SEARCHED))]
        small = _Search(pick_windows(self.windows, few), self.offset_dps, self.factors, self.blind_g[few])
        possible = [factor for factor in self.factors if factor * fastest_dps < MOST_DPS]
        possible += [self.factors[0] * scale for scale in SCALES]
        tried = [small.try_out(sign * factor) for factor in possible for sign in (1.0, -1.0)]
        tried.sort(key=lambda one: one.score)
        fitted = [small.refine(one, SCALE_BASIS) for one in tried[:MOST_REFINED]]
        return [self.measure(one.model) for one in fitted if abs(one.factor) * fastest_dps < MOST_DPS]
