"""Sensor that sat otherwise on the arm for a part of the recording: taken off and put back, or slipped.

Each part of a recording (:mod:`fusion.worn_parts`) is compared with the one that holds the calibration. After
the sensor was off, it was turned where the commonest direction of still moments moved by more than 25 deg and
neither part knows the other's (RELIABILITY.md 93). Beyond a slip a part is left out unless an axis for it is
known, however alike it looks.

Postures alone cannot tell a turned sensor from other work: an hour of walking about and an hour at the wheel
differ as much. So walking decides where both parts have half a minute of it (the arm hangs then): hanging
within 10 deg in both, nothing turned, whatever the postures say; beyond a slip the sensor was pushed back. So
it is where the first part has no walking, but the calibrated axis is the direction of walking in the other.

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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.postures import build_frame, compare_hanging, compare_postures, find_angle_deg, find_commonest
from fusion.recording import QualityFlag
from fusion.worn_parts import WornPart, WornParts

Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RemountRules:
    """What counts as another direction, and as enough to tell.

    Below ``known`` (see :func:`fusion.postures.compare_postures`) the other part's commonest direction is not
    known. A part with fewer than ``least_moments`` still moments cannot be compared; with fewer than
    ``least_to_carry`` it is left out rather than calibrated. Up to ``carried_from_deg`` it is left out, too.
    Hanging within ``hangs_alike_deg`` of each other in walking, nothing turned.
    ``axis_sigma_deg`` is how well an axis is known beyond a turn.
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
    arm_axis: Table | None
    sigma_deg: float = 0.0


def find_remounts(
    worn: WornParts, calibrated: tuple[float, Table], rules: RemountRules | None = None
) -> tuple[AxisPart, ...]:
    """Parts that need an axis of their own; ``calibrated``: when the pose was held, and the axis it gave."""
    (pose_s, arm_axis), rules = calibrated, rules or RemountRules()
    home = worn.find_home(pose_s)
    judged = [_judge_part(home, part, arm_axis, rules) for part in worn.parts if part is not home]
    known = [part for part in judged if part is not None]
    known += [AxisPart(slip.first_s, slip.end_s, None) for slip in worn.slips]
    return tuple(sorted(known, key=lambda part: part.start_s))


def count_readable(
    worn: WornParts, calibrated: tuple[float, Table], rules: RemountRules | None = None
) -> int:
    """How many of the calm moments an axis reads, in its own part and in those to which it is carried."""
    (pose_s, arm_axis), rules = calibrated, rules or RemountRules()
    home = worn.find_home(pose_s)
    return sum(len(part.calm.up) for part in worn.parts if _is_readable(home, part, arm_axis, rules))


def _is_readable(home: WornPart, part: WornPart, arm_axis: Table, rules: RemountRules) -> bool:
    judged = None if part is home else _judge_part(home, part, arm_axis, rules)
    return judged is None or judged.arm_axis is not None


def _judge_part(home: WornPart, part: WornPart, arm_axis: Table, rules: RemountRules) -> AxisPart | None:
    """The part with an axis of its own, or left out; None where nothing turned."""
    if _hangs_alike(home, part, arm_axis, rules):
        is_plain = part.wear != home.wear and part.is_whole
        return None if is_plain else AxisPart(part.start_s, part.end_s, arm_axis, rules.axis_sigma_deg)
    if part.wear != home.wear and part.is_whole and not _is_turned(home, part, rules):
        return None
    return _calibrate_part(home, part, arm_axis, rules)


def _hangs_alike(home: WornPart, part: WornPart, arm_axis: Table, rules: RemountRules) -> bool:
    """Whether walking shows the arm hanging in the same direction, or as it did in the pose."""
    apart_deg = compare_hanging(home.strides, part.strides)
    hangs = part.find_hanging()
    if apart_deg is None and hangs is not None:
        apart_deg = find_angle_deg(hangs, arm_axis)
    return apart_deg is not None and apart_deg < rules.hangs_alike_deg


def _is_turned(home: WornPart, part: WornPart, rules: RemountRules) -> bool:
    """Whether the commonest directions differ, and neither part knows the other's."""
    if min(len(home.still.up), len(part.still.up)) < rules.least_moments:
        return False
    angle_deg, known = compare_postures(home.still, part.still)
    return angle_deg > rules.turned_deg and known < rules.known


def _calibrate_part(home: WornPart, part: WornPart, arm_axis: Table, rules: RemountRules) -> AxisPart:
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


def _carry_over(home: WornPart, part: WornPart, arm_axis: Table, rules: RemountRules) -> Iterator[Table]:
    """The axis by still moments and by calm ones, each only where the arm mostly hung at home, and where
    walking confirms it.
    """
    hung, hangs = home.find_hanging(), part.find_hanging()
    if hung is None or hangs is None:
        return
    for at_home, in_part in ((home.still, part.still), (home.calm, part.calm)):
        before, after = at_home.thin().up, in_part.thin().up
        turn = build_frame(after).T @ build_frame(before)
        confirmed = find_angle_deg(turn @ hung, hangs) <= rules.hangs_deg
        if confirmed and find_angle_deg(find_commonest(before)[0], arm_axis) <= rules.hangs_deg:
            yield np.asarray(turn @ arm_axis)


def flag_remounts(parts: Sequence[AxisPart], duration_s: float) -> tuple[QualityFlag, ...]:
    """W-REMOUNT with the first and last time it concerns, and how many parts were calibrated or left out."""
    if not parts:
        return ()
    spans = [(max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts]
    left_out = sum(part.arm_axis is None for part in parts)
    facts = {"calibrated": len(parts) - left_out, "left_out": left_out}
    seconds = sum(end_s - start_s for start_s, end_s in spans)
    return (QualityFlag("W-REMOUNT", len(parts), seconds, spans[0][0], spans[-1][1], facts, tuple(spans)),)
