"""The stretches of a recording in which the sensor sat on the arm in one way.

A recording is cut where the sensor may have been off the arm: ten minutes or more in which, over 10 s, no
axis of the accelerometer has a standard deviation of 0.013 g (as ``fusion.quality.nonwear``), or a hole of
five minutes. It is cut, too, where it slipped while worn (:mod:`fusion.slips`); the slip itself is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.postures import Moments, find_calm_moments, find_hanging, find_striding_moments
from fusion.sensor_errors.accelerometer import AccelerometerCorrection
from fusion.sensor_errors.stillness import QuarterSeconds, QuietTable, summarise_windows
from fusion.slips import Doubt, Slip, find_slips


@dataclass(frozen=True, slots=True)
class WearRules:
    """What counts as off the arm. ``least_share`` of the calm moments: in such a part the pose is sought."""

    off_s: float = 600.0
    still_acc_sd_g: float = 0.013
    window_s: float = 10.0
    hole_s: float = 300.0
    least_share: float = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class WornPart:
    """A part of the day: in which stretch of wear it lies; its still, its calm and its walking moments.

    ``is_whole``: nothing slipped in its stretch of wear; ``opens``: it begins it.
    """

    start_s: float
    end_s: float
    wear: int
    still: Moments
    calm: Moments
    strides: Moments
    is_whole: bool = True
    opens: bool = True

    def find_hanging(self) -> NDArray[np.float64] | None:
        """The direction in which the arm hangs while walking; None where too little was walked."""
        return find_hanging(self.strides)


@dataclass(frozen=True, slots=True, eq=False)
class WornParts:
    """The recording, cut where the sensor was off or slipped; slips lie between parts, doubts in them."""

    parts: tuple[WornPart, ...]
    slips: tuple[Slip, ...]
    doubts: tuple[Doubt, ...] = ()

    def find_home(self, time_s: float) -> WornPart:
        """The part that a time lies in, or the nearest."""
        return min(self.parts, key=lambda part: max(part.start_s - time_s, time_s - part.end_s))

    def list_for_pose(self, time_s: float, rules: WearRules | None = None) -> tuple[WornPart, ...]:
        """Where to seek the pose instead of in the whole day, given when its likeliest moment is.

        The parts, in order, of the first stretch of wear in which walking tells how the arm hung (one that
        holds ``least_share`` of the calm moments: a sensor carried in a bag walks, too); without one, of the
        stretch that the time lies in, where the sensor slipped in it, or walking tells.
        """
        if len(self.parts) == 1:
            return ()
        least = (rules or WearRules()).least_share * sum(len(part.calm.up) for part in self.parts)
        homes = [
            part for part in self.parts if part.find_hanging() is not None and len(part.calm.up) >= least
        ]
        home = homes[0] if homes else self.find_home(time_s)
        wear = tuple(part for part in self.parts if part.wear == home.wear)
        return wear if len(wear) > 1 or home.find_hanging() is not None else ()


def part_recording(
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    accelerometer: AccelerometerCorrection,
    rules: WearRules | None = None,
) -> WornParts:
    """Cut a recording where the sensor may have been off the arm, and where it slipped."""
    cuts_s, off = _find_cuts(blocks, rules or WearRules())
    found = (
        _find_still_moments(stills, accelerometer),
        find_calm_moments(blocks, accelerometer),
        find_striding_moments(blocks, accelerometer),
    )
    still, calm, strides = (_leave_off(moments, off) for moments in found)
    return _divide(WornPart(-np.inf, np.inf, 0, still, calm, strides), cuts_s)


def _find_still_moments(stills: QuietTable, accelerometer: AccelerometerCorrection) -> Moments:
    return Moments(stills.middle_s, accelerometer.find_up(stills.gravity_g, stills.middle_s))


def _find_cuts(
    blocks: Sequence[QuarterSeconds], rules: WearRules
) -> tuple[list[float], list[tuple[float, float]]]:
    """Middles of the stretches in which the sensor may have been off, and those of them that hold samples."""
    off = [stretch for run in blocks for stretch in _find_off(run, rules)]
    cuts = [(first + stop) / 2.0 for first, stop in off]
    for run, following in pairwise(blocks):
        end_s = run.start_s + len(run.acc) * run.block_s
        if following.start_s - end_s >= rules.hole_s:
            cuts.append((end_s + following.start_s) / 2.0)
    return sorted(cuts), off


def _find_off(run: QuarterSeconds, rules: WearRules) -> list[tuple[float, float]]:
    """Stretches (start, end), s, of one run in which every window is still."""
    table = summarise_windows([run], rules.window_s)
    still = np.concatenate([[False], table.acc_sd_g < rules.still_acc_sd_g, [False]])
    starts, stops = np.flatnonzero(still[1:] & ~still[:-1]), np.flatnonzero(~still[1:] & still[:-1])
    long_enough = (stops - starts) * run.block_s + rules.window_s >= rules.off_s
    first_s = run.start_s + starts[long_enough] * run.block_s
    stop_s = run.start_s + (stops[long_enough] - 1) * run.block_s + rules.window_s
    return list(zip(first_s.tolist(), stop_s.tolist(), strict=True))


def _leave_off(moments: Moments, off: list[tuple[float, float]]) -> Moments:
    """Only the moments at which the sensor was worn."""
    worn = np.ones(len(moments.time_s), dtype=np.bool_)
    for first_s, stop_s in off:
        worn &= (moments.time_s <= first_s) | (moments.time_s >= stop_s)
    return Moments(moments.time_s[worn], moments.up[worn])


def _divide(day: WornPart, cuts_s: list[float]) -> WornParts:
    """Cut into parts; a slip lies between two parts, unless it begins or ends the stretch of wear."""
    parts: list[WornPart] = []
    slips: list[Slip] = []
    doubts: list[Doubt] = []
    for wear, (first_s, end_s) in enumerate(pairwise([-np.inf, *cuts_s, np.inf])):
        found, doubted = find_slips(day.calm.within(first_s, end_s), day.strides.within(first_s, end_s))
        starts_s, stops_s = [first_s, *(slip.end_s for slip in found)], [*(s.first_s for s in found), end_s]
        spans = [span_s for span_s in zip(starts_s, stops_s, strict=True) if span_s[0] < span_s[1]]
        parts += [
            replace(_cut_part(day, wear, span_s), is_whole=not found, opens=span_s[0] == first_s)
            for span_s in spans
        ]
        slips += found
        doubts += doubted
    return WornParts(tuple(parts), tuple(slips), tuple(doubts))


def _cut_part(day: WornPart, wear: int, span_s: tuple[float, float]) -> WornPart:
    still, calm, strides = (moments.within(*span_s) for moments in (day.still, day.calm, day.strides))
    return WornPart(*span_s, wear, still, calm, strides)
