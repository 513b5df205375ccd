"""Turns that cannot be told for sure: what is left out for them, and what is kept with a wider range."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.pose_doubts import WITHIN, PoseEvidence
from fusion.postures import NEAR_DEG, Moments, cos_deg, find_angle_deg, find_commonest
from fusion.recording import QualityFlag
from fusion.remount import AxisPart
from fusion.slips import Doubt, SlipRules
from fusion.worn_parts import WornPart, WornParts

Table = NDArray[np.float64]
Spans = list[tuple[float, float]]
EARLY_TURN_DEG = 15.0
EARLY_S = SlipRules().least_s
"""A slip is only found with so much on both sides."""


@dataclass(frozen=True, slots=True)
class DoubtedPart:
    """A stretch, seconds from the first sample, in which the axis may be ``angle_deg`` off."""

    start_s: float
    end_s: float
    angle_deg: float

    @property
    def sigma_deg(self) -> float:
        """Half of a 95 % range is as wide as the turn."""
        return self.angle_deg / WITHIN


def find_early_turn(worn: WornParts, pose_s: float, evidence: PoseEvidence) -> tuple[AxisPart, ...]:
    """The first five minutes, left out where the arm was first held still more than 15 deg from the pose.

    A pose is held when the sensor has just been strapped on. One that walking does not know, before a window
    like walking: the sensor turned before a slip could be found, lay on a desk, or the arm was raised.
    """
    home = worn.find_home(pose_s)
    first_s = float(home.calm.time_s[0]) if len(home.calm.time_s) else 0.0
    is_early = evidence.first_s < min(first_s + EARLY_S, pose_s)
    if not evidence.is_seen or not is_early or evidence.first_deg <= EARLY_TURN_DEG:
        return ()
    return (AxisPart(home.start_s, first_s + EARLY_S, None),)


def find_doubted_parts(
    worn: WornParts, arm_axis: Table, remounts: Sequence[AxisPart]
) -> tuple[DoubtedPart, ...]:
    """The side of each doubt on which the arm hung farther from the axis that its part is read by."""
    found: list[DoubtedPart] = []
    for doubt in worn.doubts:
        part = worn.find_home((doubt.of_s[0] + doubt.of_s[1]) / 2.0)
        axis = _find_axis(part, arm_axis, remounts)
        if axis is not None:
            found += [DoubtedPart(*span_s, doubt.angle_deg) for span_s in _take_side(doubt, part, axis)]
    return tuple(found)


def _find_axis(part: WornPart, arm_axis: Table, remounts: Sequence[AxisPart]) -> Table | None:
    """The axis that a part is read by; None where it is left out."""
    span_s = (part.start_s, part.end_s)
    return next((one.arm_axis for one in remounts if (one.start_s, one.end_s) == span_s), arm_axis)


def _take_side(doubt: Doubt, part: WornPart, axis: Table) -> Spans:
    """The side that the axis fits less, as far as walking, which tells both apart, shows no other."""
    strides = part.strides
    within = (strides.time_s >= doubt.first_s) & (strides.time_s < doubt.end_s)
    if within.all() or not within.any():
        return []  # the part ends before: a slip was found beside it
    sides = [Moments(strides.time_s[rows], strides.up[rows]).thin().up for rows in (within, ~within)]
    inside, beside = (find_commonest(up)[0] for up in sides)
    is_inside = find_angle_deg(inside, axis) >= find_angle_deg(beside, axis)
    sound, turned = (beside, inside) if is_inside else (inside, beside)
    near = (strides.up @ sound >= cos_deg(NEAR_DEG)) & (strides.up @ (sound - turned) > 0.0)
    sound_s = strides.time_s[near]
    if is_inside:
        before_s = max(sound_s[sound_s < doubt.first_s], default=part.start_s)
        return [(float(before_s), float(min(sound_s[sound_s >= doubt.end_s], default=part.end_s)))]
    before = (part.start_s, float(min(sound_s[sound_s >= doubt.first_s], default=part.end_s)))
    after = (float(max(sound_s[sound_s < doubt.end_s], default=part.start_s)), part.end_s)
    return [before] * (doubt.first_s > doubt.of_s[0]) + [after] * (doubt.end_s < doubt.of_s[1])


def flag_doubted_parts(parts: Sequence[DoubtedPart], duration_s: float) -> Iterator[QualityFlag]:
    """W-SLIP-DOUBT with the places, and by how much the arm hung otherwise."""
    if not parts:
        return
    spans = tuple((max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts)
    seconds = sum(end_s - start_s for start_s, end_s in spans)
    apart_deg = round(max(part.angle_deg for part in parts))
    yield QualityFlag(
        "W-SLIP-DOUBT", len(parts), seconds, spans[0][0], spans[-1][1], {"apart_deg": apart_deg}, spans
    )
