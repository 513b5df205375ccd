"""Sensor that sat otherwise on the arm for a part of the recording: taken off and put back, or slipped.

A recording is cut where the sensor may have been off the arm: ten minutes or more in which, over 10 s, no
axis of the accelerometer has a standard deviation of 0.013 g (as ``fusion.quality.nonwear``), or a hole of
five minutes. It is cut, too, where it slipped while worn (:mod:`fusion.slips`); the slip itself is left out.

Each part is compared with the one that holds the calibration. After the sensor was off, it was turned where
the commonest direction of still moments moved by more than 25 deg and neither part knows the other's
(RELIABILITY.md 93). While it was worn the proof must be stronger: the moments of both parts must know
each other by less than 0.3 of 2; up to 0.45 the part is kept and said to be less certain. Beyond a slip
that is sure, a part with neither is left out, however alike it looks.

Postures alone cannot tell a turned sensor from other work: an hour of walking about and an hour at the wheel
differ as much. So walking decides where both parts have half a minute of it (the arm hangs then): hanging
within 10 deg in both, nothing turned, whatever the postures say. (Hanging apart is no proof of a turn: where
little is walked, other work may pass for it.)

Where the commonest direction moved by more than 35 deg and both parts have still moments enough, the arm axis
is carried over by the turn that takes the commonest and the mean direction of one part to those of the other.
That is done twice, from still moments and from all calm ones, and believed only where both agree within 5
deg, the part of the calibration has its commonest direction within 15 deg of the arm axis, as an arm has that
mostly hangs, and the turn takes the direction of walking in one part to within 15 deg of that in the other.
On simulated days parted at five places (ten minutes or more on both sides) such an axis was right within 4
deg (median 2, the worst 7.4 deg). Without walking in both parts the part is left out: what other work may
explain is not corrected (hours with the arm held at 45 and 70 deg were read 22 and 38 deg wrong before). A
turn about the arm's own axis changes nothing and is not looked for.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.postures import (
    Moments,
    build_frame,
    compare_hanging,
    compare_postures,
    find_angle_deg,
    find_calm_moments,
    find_commonest,
    find_hanging,
    find_striding_moments,
)
from fusion.recording import QualityFlag
from fusion.sensor_errors.accelerometer import AccelerometerCorrection
from fusion.sensor_errors.stillness import QuarterSeconds, QuietTable, summarise_windows
from fusion.slips import Slip, SlipRules, find_slips_in_wear

Table = NDArray[np.float64]
UNLIKE_WALKING_DEG = 30.0
"""Between a calibration pose and walking: 10 deg at most was seen; a load carried may add to it."""


@dataclass(frozen=True, slots=True)
class RemountRules:
    """What counts as off the arm, as another direction, and as enough to tell.

    Below ``known`` (see :func:`fusion.postures.compare_postures`) the other part's commonest direction is not
    known. A part with fewer than ``least_moments`` still moments cannot be compared; with fewer than
    ``least_to_carry`` it is left out rather than calibrated. Up to ``carried_from_deg`` it is left out, too.
    Hanging within ``hangs_alike_deg`` of each other in walking, nothing turned.
    ``axis_sigma_deg`` is how well the axis is carried over; ``doubt`` the standard deviation of a part that
    may have turned, as a share of the angle. ``least_share`` of the calm moments: in such a part the pose is
    sought first.
    """

    off_s: float = 600.0
    still_acc_sd_g: float = 0.013
    window_s: float = 10.0
    hole_s: float = 300.0
    turned_deg: float = 25.0
    carried_from_deg: float = 35.0
    known: float = 1.0
    least_moments: int = 10
    least_to_carry: int = 120
    agree_deg: float = 5.0
    hangs_deg: float = 15.0
    hangs_alike_deg: float = 10.0
    axis_sigma_deg: float = 5.0
    doubt: float = 0.6
    least_share: float = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class AxisPart:
    """A stretch, seconds from the first sample, in which the sensor sat otherwise than at the calibration.

    ``arm_axis`` (3,) is the axis there, with its own uncertainty ``sigma_deg``; None where none could be
    found, and the part is left out. ``is_doubted``: perhaps it did not turn, and the axis is the same.
    """

    start_s: float
    end_s: float
    arm_axis: Table | None
    sigma_deg: float = 0.0
    is_doubted: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A part of the day: in which stretch of wear it lies; its still, its calm and its walking moments."""

    start_s: float
    end_s: float
    wear: int
    still: Moments
    calm: Moments
    strides: Moments


@dataclass(frozen=True, slots=True, eq=False)
class WornParts:
    """The recording, cut where the sensor was off or slipped; ``slipping`` are the slips that are sure,
    ``doubted`` the others: a cut in the middle of each.
    """

    parts: tuple[_Part, ...]
    slipping: tuple[AxisPart, ...]
    doubted: tuple[Slip, ...]

    def find_home(self, time_s: float) -> _Part:
        """The part that a time lies in, or the nearest."""
        return min(self.parts, key=lambda part: max(part.start_s - time_s, time_s - part.end_s))

    def list_for_pose(self, time_s: float, rules: RemountRules | None = None) -> tuple[_Part, ...]:
        """Where to seek the pose instead of in the whole day, given when its likeliest moment is.

        The parts, in order, of the first stretch of wear in which walking tells how the arm hung (one that
        holds ``least_share`` of the calm moments: a sensor carried in a bag walks, too); without one, of the
        stretch that the time lies in, where the sensor slipped in it or may have, or walking tells.
        """
        if len(self.parts) == 1:
            return ()
        least = (rules or RemountRules()).least_share * sum(len(part.calm.up) for part in self.parts)
        homes = [part for part in self.parts if _tells(part) and len(part.calm.up) >= least]
        home = homes[0] if homes else self.find_home(time_s)
        wear = tuple(part for part in self.parts if part.wear == home.wear)
        return wear if len(wear) > 1 or _tells(home) else ()


def _tells(part: _Part) -> bool:
    return find_hanging(part.strides) is not None


def part_recording(
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    accelerometer: AccelerometerCorrection,
    rules: RemountRules | None = None,
) -> WornParts:
    """Cut a recording where the sensor may have been off the arm, and where it slipped."""
    cuts_s, off = _find_cuts(blocks, rules or RemountRules())
    found = (
        _find_still_moments(stills, accelerometer),
        find_calm_moments(blocks, accelerometer),
        find_striding_moments(blocks, accelerometer),
    )
    still, calm, strides = (_leave_off(moments, off) for moments in found)
    return _divide(_Part(-np.inf, np.inf, 0, still, calm, strides), cuts_s)


def find_remounts(
    worn: WornParts, calibrated: tuple[float, Table], rules: RemountRules | None = None
) -> tuple[AxisPart, ...]:
    """Parts that need an axis of their own; ``calibrated``: when the pose was held, and the axis it gave."""
    if len(worn.parts) == 1:
        return ()
    home = worn.find_home(calibrated[0])
    rules = rules or RemountRules()
    others = [part for part in worn.parts if part is not home]
    found = [_judge_part(home, part, calibrated[1], rules) or _stand_by(worn, home, part) for part in others]
    known = [*filter(None, found), *worn.slipping]
    for slip in worn.doubted:
        known = _leave_out_slip(known, slip)
    return tuple(sorted(known, key=lambda part: part.start_s))


def _leave_out_slip(known: list[AxisPart], slip: Slip) -> list[AxisPart]:
    """Leave out a slip that was doubted, too, where the part beside it, as a whole, turned for sure."""
    if not any(slip.middle_s in (part.start_s, part.end_s) and not part.is_doubted for part in known):
        return known
    trimmed = [
        replace(
            part,
            start_s=slip.end_s if part.start_s == slip.middle_s else part.start_s,
            end_s=slip.first_s if part.end_s == slip.middle_s else part.end_s,
        )
        for part in known
    ]
    return [
        *(part for part in trimmed if part.start_s < part.end_s),
        AxisPart(slip.first_s, slip.end_s, None),
    ]


def _stand_by(worn: WornParts, home: _Part, part: _Part) -> AxisPart | None:
    """What lies beyond a slip that is sure is left out, also where the whole part looks like home."""
    first_s, end_s = min(home.end_s, part.end_s), max(home.start_s, part.start_s)
    slipped = part.wear == home.wear and any(first_s <= slip.start_s < end_s for slip in worn.slipping)
    return AxisPart(part.start_s, part.end_s, None) if slipped else None


def _find_still_moments(stills: QuietTable, accelerometer: AccelerometerCorrection) -> Moments:
    up = accelerometer.apply(stills.gravity_g, stills.middle_s)
    return Moments(stills.middle_s, up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9))


def _find_cuts(
    blocks: Sequence[QuarterSeconds], rules: RemountRules
) -> tuple[list[float], list[tuple[float, float]]]:
    """Middles of the stretches in which the sensor may have been off, and those of them that hold samples."""
    off = [stretch for run in blocks for stretch in _find_off(run, rules)]
    cuts = [(first + stop) / 2.0 for first, stop in off]
    for run, following in pairwise(blocks):
        end_s = run.start_s + len(run.acc) * run.block_s
        if following.start_s - end_s >= rules.hole_s:
            cuts.append((end_s + following.start_s) / 2.0)
    return sorted(cuts), off


def _find_off(run: QuarterSeconds, rules: RemountRules) -> list[tuple[float, float]]:
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


def _divide(day: _Part, cuts_s: list[float]) -> WornParts:
    """Cut into parts; a slip that is sure lies between two parts and is left out."""
    parts: list[_Part] = []
    slipping: list[AxisPart] = []
    doubted: list[Slip] = []
    for wear, (first_s, end_s) in enumerate(pairwise([-np.inf, *cuts_s, np.inf])):
        start_s = first_s
        for slip in find_slips_in_wear(day.calm.within(first_s, end_s), day.strides.within(first_s, end_s)):
            stop_s, next_s = (slip.middle_s,) * 2 if slip.is_doubted else (slip.first_s, slip.end_s)
            parts.append(_cut_part(day, wear, (start_s, stop_s)))
            if slip.is_doubted:
                doubted.append(slip)
            else:
                slipping.append(AxisPart(stop_s, next_s, None))
            start_s = next_s
        parts.append(_cut_part(day, wear, (start_s, end_s)))
    return WornParts(tuple(parts), tuple(slipping), tuple(doubted))


def _cut_part(day: _Part, wear: int, span_s: tuple[float, float]) -> _Part:
    still, calm, strides = (moments.within(*span_s) for moments in (day.still, day.calm, day.strides))
    return _Part(*span_s, wear, still, calm, strides)


def _judge_part(home: _Part, part: _Part, arm_axis: Table, rules: RemountRules) -> AxisPart | None:
    if part.wear != home.wear:
        hangs_deg = compare_hanging(home.strides, part.strides)
        if hangs_deg is not None and hangs_deg < rules.hangs_alike_deg:
            return None
        return _calibrate_part(home, part, arm_axis, rules) if _is_turned(home, part, rules) else None
    slip = SlipRules()
    if min(len(home.calm.up), len(part.calm.up)) < slip.least_moments:
        return AxisPart(part.start_s, part.end_s, None)
    angle_deg, known = compare_postures(home.calm, part.calm)
    if known >= slip.doubted or angle_deg < slip.turned_deg:
        return None
    if known < slip.known:
        return _calibrate_part(home, part, arm_axis, rules)
    return AxisPart(part.start_s, part.end_s, arm_axis, rules.doubt * angle_deg, is_doubted=True)


def _is_turned(home: _Part, part: _Part, rules: RemountRules) -> bool:
    """Whether the commonest directions differ, and neither part knows the other's."""
    if min(len(home.still.up), len(part.still.up)) < rules.least_moments:
        return False
    angle_deg, known = compare_postures(home.still, part.still)
    return angle_deg > rules.turned_deg and known < rules.known


def _calibrate_part(home: _Part, part: _Part, arm_axis: Table, rules: RemountRules) -> AxisPart:
    """The axis carried over, or none."""
    left_out = AxisPart(part.start_s, part.end_s, None)
    if min(len(home.still.up), len(part.still.up)) < rules.least_to_carry:
        return left_out
    if compare_postures(home.still, part.still)[0] <= rules.carried_from_deg:
        return left_out
    axes = list(_carry_over(home, part, arm_axis, rules))
    if len(axes) < 2 or find_angle_deg(axes[0], axes[1]) > rules.agree_deg:
        return left_out
    both = axes[0] + axes[1]
    return AxisPart(part.start_s, part.end_s, both / np.linalg.norm(both), rules.axis_sigma_deg)


def _carry_over(home: _Part, part: _Part, arm_axis: Table, rules: RemountRules) -> Iterator[Table]:
    """The axis by still moments and by calm ones, each only where the arm mostly hung at home, and where
    walking confirms it.
    """
    hung, hangs = find_hanging(home.strides), find_hanging(part.strides)
    if hung is None or hangs is None:
        return
    for at_home, in_part in ((home.still, part.still), (home.calm, part.calm)):
        before, after = at_home.thin().up, in_part.thin().up
        turn = build_frame(after).T @ build_frame(before)
        confirmed = find_angle_deg(turn @ hung, hangs) <= rules.hangs_deg
        if confirmed and find_angle_deg(find_commonest(before)[0], arm_axis) <= rules.hangs_deg:
            yield np.asarray(turn @ arm_axis)


def flag_remounts(parts: Sequence[AxisPart], duration_s: float) -> tuple[QualityFlag, ...]:
    """W-REMOUNT with the first and last time it concerns, and how many parts were calibrated, doubted or
    left out.
    """
    if not parts:
        return ()
    spans = [(max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts]
    left_out, doubted = sum(part.arm_axis is None for part in parts), sum(part.is_doubted for part in parts)
    facts = {"calibrated": len(parts) - left_out - doubted, "doubted": doubted, "left_out": left_out}
    seconds = sum(end_s - start_s for start_s, end_s in spans)
    return (QualityFlag("W-REMOUNT", len(parts), seconds, spans[0][0], spans[-1][1], facts, tuple(spans)),)


def flag_pose_unlike_walking(
    worn: WornParts, window_s: tuple[float, float], arm_axis: Table
) -> tuple[QualityFlag, ...]:
    """W-POSE-DOUBT where the axis from a window (start, length) is far from how the arm hangs in walking."""
    hangs = find_hanging(worn.find_home(window_s[0]).strides)
    if hangs is None or find_angle_deg(hangs, arm_axis) <= UNLIKE_WALKING_DEG:
        return ()
    return (QualityFlag("W-POSE-DOUBT", 1, window_s[1], window_s[0], sum(window_s)),)
