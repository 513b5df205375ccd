"""The stretches of a recording in which the sensor sat on the arm in one way.

A recording is cut where the sensor may have been off the arm: ten minutes or more in which, over 10 s, no
axis of the accelerometer has a standard deviation of 0.013 g (as in ``fusion.quality.time_account``), or a
hole of five minutes. It is cut, too, where it slipped while worn (:mod:`fusion.pose.slips`); the slip itself
is left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fusion.caveats import Caveat
from fusion.pose.postures import (
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
from fusion.pose.slips import Doubt, Slip, find_slips
from fusion.recording import Float64Array, QualityFlag, flag_stretches
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.stillness import QuarterSeconds, QuietTable, summarise_windows
from fusion.still_limits import OFF_THE_ARM


@dataclass(frozen=True, slots=True)
class WearRules:
    """What counts as off the arm. ``least_share`` of the calm moments: in such a part the pose is sought."""

    off_s: float = 600.0
    still_acc_sd_g: float = OFF_THE_ARM.acc_sd_g
    window_s: float = OFF_THE_ARM.window_s
    hole_s: float = 300.0
    least_share: float = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class WearPart:
    """A part of the day: in which stretch of wear it lies; its still, its calm and its walking moments.

    ``is_whole``: nothing slipped in its stretch of wear; ``opens``: it begins it.
    """

    start_s: float
    end_s: float
    stretch: int
    still: Moments
    calm: Moments
    strides: Moments
    is_whole: bool = True
    opens: bool = True

    def find_hanging(self) -> Float64Array | None:
        """The direction in which the arm hangs while walking; None where too little was walked."""
        return find_hanging(self.strides)


@dataclass(frozen=True, slots=True, eq=False)
class Wear:
    """The recording, cut where the sensor was off or slipped; slips lie between parts, doubts in them."""

    parts: tuple[WearPart, ...]
    slips: tuple[Slip, ...]
    doubts: tuple[Doubt, ...] = ()

    def find_part(self, time_s: float) -> WearPart:
        """The part that a time lies in, or the nearest."""
        return min(self.parts, key=lambda part: max(part.start_s - time_s, time_s - part.end_s))

    def find_parts_for_pose(self, time_s: float, rules: WearRules | None = None) -> tuple[WearPart, ...]:
        """Where to seek the pose instead of in the whole day, given when its likeliest moment is.

        The parts, in order, of the first stretch of wear in which walking tells how the arm hung (one that
        holds ``least_share`` of the calm moments: a sensor carried in a bag walks, too); without one, of the
        stretch that the time lies in, where the sensor slipped in it, or walking tells.
        """
        if len(self.parts) == 1:
            return ()
        least = (rules or WearRules()).least_share * sum(len(part.calm.up) for part in self.parts)
        likely = [
            part for part in self.parts if part.find_hanging() is not None and len(part.calm.up) >= least
        ]
        pose_part = likely[0] if likely else self.find_part(time_s)
        alike = tuple(part for part in self.parts if part.stretch == pose_part.stretch)
        return alike if len(alike) > 1 or pose_part.find_hanging() is not None else ()


def divide_by_wear(
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    accelerometer: AccelerometerCorrection,
    rules: WearRules | None = None,
) -> Wear:
    """Cut a recording where the sensor may have been off the arm, and where it slipped."""
    cuts_s, off = _find_cuts(blocks, rules or WearRules())
    found = (
        _find_still_moments(stills, accelerometer),
        find_calm_moments(blocks, accelerometer),
        find_striding_moments(blocks, accelerometer),
    )
    still, calm, strides = (_leave_off(moments, off) for moments in found)
    return _divide(WearPart(-np.inf, np.inf, 0, still, calm, strides), cuts_s)


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


def _divide(day: WearPart, cuts_s: list[float]) -> Wear:
    """Cut into parts; a slip lies between two parts, unless it begins or ends the stretch of wear."""
    parts: list[WearPart] = []
    slips: list[Slip] = []
    doubts: list[Doubt] = []
    for stretch, (first_s, end_s) in enumerate(pairwise([-np.inf, *cuts_s, np.inf])):
        found, doubted = find_slips(day.calm.within(first_s, end_s), day.strides.within(first_s, end_s))
        starts_s, stops_s = [first_s, *(slip.end_s for slip in found)], [*(s.first_s for s in found), end_s]
        spans = [span_s for span_s in zip(starts_s, stops_s, strict=True) if span_s[0] < span_s[1]]
        parts += [
            replace(_cut_part(day, stretch, span_s), is_whole=not found, opens=span_s[0] == first_s)
            for span_s in spans
        ]
        slips += found
        doubts += doubted
    return Wear(tuple(parts), tuple(slips), tuple(doubts))


def _cut_part(day: WearPart, stretch: int, span_s: tuple[float, float]) -> WearPart:
    still, calm, strides = (moments.within(*span_s) for moments in (day.still, day.calm, day.strides))
    return WearPart(*span_s, stretch, still, calm, strides)


# Sensor that sat otherwise on the arm for a part of the recording: taken off and put back, or slipped.
#
# Each part of a recording (:mod:`fusion.pose.wear`) is compared with the one that holds the calibration.
# After the sensor was off, it was turned where the commonest direction of still moments moved by more than
# 25 deg and neither part knows the other's (RELIABILITY.md 93). Beyond a slip a part is left out unless an
# axis for it is known, however alike it looks.
#
# Postures alone cannot tell a turned sensor from other work: an hour of walking about and an hour at the
# wheel differ as much. So walking decides where both parts have half a minute of it (the arm hangs then):
# hanging within 10 deg in both, nothing turned, whatever the postures say; beyond a slip the sensor was
# pushed back. So it is where the first part has no walking, but the calibrated axis is the direction of
# walking in the other.
#
# Where the commonest direction moved by more than 35 deg and both parts have still moments enough, the arm
# axis is carried over by the turn that takes the commonest and the mean direction of one part to those of
# the other. That is done twice, from still moments and from all calm ones, and believed only where both
# agree within 5 deg, the part of the calibration has its commonest direction within 15 deg of the arm axis,
# as an arm has that mostly hangs, and the turn takes the direction of walking in one part to within 15 deg
# of that in the other. On simulated days parted at five places (ten minutes or more on both sides) such an
# axis was right within 4 deg (median 2, the worst 7.4 deg). Without walking in both parts the part is left
# out: what other work may explain is not corrected (hours with the arm held at 45 and 70 deg were read 22
# and 38 deg wrong before). A turn about the arm's own axis changes nothing and is not looked for.


@dataclass(frozen=True, slots=True)
class ReattachmentRules:
    """What counts as another direction, and as enough to tell.

    Below ``known`` (see :func:`fusion.pose.postures.compare_postures`) the other part's commonest direction
    is not known. A part with fewer than ``least_moments`` still moments cannot be compared; with fewer than
    ``least_to_carry`` it is left out rather than calibrated. Up to ``carried_from_deg`` it is left out, too.
    Hanging within ``hangs_alike_deg`` of each other in walking, nothing turned. ``axis_sigma_deg`` is how
    well an axis is known beyond a turn.
    """

    turned_deg: float = 25.0
    carried_from_deg: float = 35.0
    known: float = 1.0
    least_moments: int = 10
    least_to_carry: int = 120
    agree_deg: float = 5.0
    hangs_deg: float = 15.0
    hangs_alike_deg: float = 10.0
    axis_sigma_deg: float = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class AxisPart:
    """A stretch, seconds from the first sample, in which the sensor sat otherwise than at the calibration.

    ``arm_axis`` (3,) is the axis there, with its own uncertainty ``sigma_deg``; None where none could be
    found, and the part is left out.
    """

    start_s: float
    end_s: float
    arm_axis: Float64Array | None
    sigma_deg: float = 0.0


def find_reattachments(
    wear: Wear, calibrated: tuple[float, Float64Array], rules: ReattachmentRules | None = None
) -> tuple[AxisPart, ...]:
    """Parts that need an axis of their own; ``calibrated``: when the pose was held, and the axis it gave."""
    (pose_s, arm_axis), rules = calibrated, rules or ReattachmentRules()
    pose_part = wear.find_part(pose_s)
    judged = [_judge_part(pose_part, part, arm_axis, rules) for part in wear.parts if part is not pose_part]
    known = [part for part in judged if part is not None]
    known += [AxisPart(slip.first_s, slip.end_s, None) for slip in wear.slips]
    return tuple(sorted(known, key=lambda part: part.start_s))


def count_readable(
    wear: Wear, calibrated: tuple[float, Float64Array], rules: ReattachmentRules | None = None
) -> int:
    """How many of the calm moments an axis reads, in its own part and in those to which it is carried."""
    (pose_s, arm_axis), rules = calibrated, rules or ReattachmentRules()
    pose_part = wear.find_part(pose_s)
    return sum(len(part.calm.up) for part in wear.parts if _is_readable(pose_part, part, arm_axis, rules))


def _is_readable(
    pose_part: WearPart, part: WearPart, arm_axis: Float64Array, rules: ReattachmentRules
) -> bool:
    judged = None if part is pose_part else _judge_part(pose_part, part, arm_axis, rules)
    return judged is None or judged.arm_axis is not None


def _judge_part(
    pose_part: WearPart, part: WearPart, arm_axis: Float64Array, rules: ReattachmentRules
) -> AxisPart | None:
    """The part with an axis of its own, or left out; None where nothing turned."""
    if _hangs_alike(pose_part, part, arm_axis, rules):
        is_plain = part.stretch != pose_part.stretch and part.is_whole
        return None if is_plain else AxisPart(part.start_s, part.end_s, arm_axis, rules.axis_sigma_deg)
    if part.stretch != pose_part.stretch and part.is_whole and not _is_turned(pose_part, part, rules):
        return None
    return _calibrate_part(pose_part, part, arm_axis, rules)


def _hangs_alike(
    pose_part: WearPart, part: WearPart, arm_axis: Float64Array, rules: ReattachmentRules
) -> bool:
    """Whether walking shows the arm hanging in the same direction, or as it did in the pose."""
    apart_deg = compare_hanging(pose_part.strides, part.strides)
    hangs = part.find_hanging()
    if apart_deg is None and hangs is not None:
        apart_deg = find_angle_deg(hangs, arm_axis)
    return apart_deg is not None and apart_deg < rules.hangs_alike_deg


def _is_turned(pose_part: WearPart, part: WearPart, rules: ReattachmentRules) -> bool:
    """Whether the commonest directions differ, and neither part knows the other's."""
    if min(len(pose_part.still.up), len(part.still.up)) < rules.least_moments:
        return False
    angle_deg, known = compare_postures(pose_part.still, part.still)
    return angle_deg > rules.turned_deg and known < rules.known


def _calibrate_part(
    pose_part: WearPart, part: WearPart, arm_axis: Float64Array, rules: ReattachmentRules
) -> AxisPart:
    """The axis carried over, or none."""
    left_out = AxisPart(part.start_s, part.end_s, None)
    if min(len(pose_part.still.up), len(part.still.up)) < rules.least_to_carry:
        return left_out
    if compare_postures(pose_part.still, part.still)[0] <= rules.carried_from_deg:
        return left_out
    axes = list(_carry_over(pose_part, part, arm_axis, rules))
    if len(axes) < 2 or find_angle_deg(axes[0], axes[1]) > rules.agree_deg:
        return left_out
    both = axes[0] + axes[1]
    return AxisPart(part.start_s, part.end_s, both / np.linalg.norm(both), rules.axis_sigma_deg)


def _carry_over(
    pose_part: WearPart, part: WearPart, arm_axis: Float64Array, rules: ReattachmentRules
) -> Iterator[Float64Array]:
    """The axis by still moments and by calm ones, each only where the arm mostly hung at pose_part, and where
    walking confirms it.
    """
    hung, hangs = pose_part.find_hanging(), part.find_hanging()
    if hung is None or hangs is None:
        return
    for in_pose_part, in_part in ((pose_part.still, part.still), (pose_part.calm, part.calm)):
        before, after = in_pose_part.thin().up, in_part.thin().up
        turn = build_frame(after).T @ build_frame(before)
        confirmed = find_angle_deg(turn @ hung, hangs) <= rules.hangs_deg
        if confirmed and find_angle_deg(find_commonest(before)[0], arm_axis) <= rules.hangs_deg:
            yield np.asarray(turn @ arm_axis)


def flag_reattachments(parts: Sequence[AxisPart], duration_s: float) -> tuple[QualityFlag, ...]:
    """Flag the parts with an axis of their own: how many were calibrated, how many left out (W-REMOUNT)."""
    if not parts:
        return ()
    spans = [(max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts]
    left_out = sum(part.arm_axis is None for part in parts)
    facts = {"calibrated": len(parts) - left_out, "left_out": left_out}
    return (flag_stretches(Caveat.REMOUNT, spans, facts),)
