"""Which stillness is the pose, and how well it ties the sensor to the arm.

A window that a person gives is the pose; nothing outvotes it. Otherwise the pose is the first still stretch
of 5 to 60 s within ten minutes of the start of wear. A longer stillness is a table: where one comes before
all else, the sensor is worn from its end on. Walking, a minute or more in the same part, can only veto: more
than 30 deg away, and the next early stretch is taken. FUSION.md, section 5.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from fusion.conventions import ARM_AXES, ArmAxis, Found
from fusion.pose.postures import MINUTE_STRIDING, find_angle_deg, find_commonest
from fusion.pose.rules import RULES
from fusion.pose.wear import Wear, WearPart, divide_by_wear
from fusion.pose.windows import (
    Blocks,
    StillPeriod,
    Window,
    find_still_stretches,
    measure_stillest,
    measure_stretch,
    reduce_recording,
)
from fusion.recording import MICROSECONDS, Float64Array, Recording
from fusion.sensor.accelerometer import AccelerometerCorrection, calibrate_accelerometer
from fusion.sensor.stillness import find_still_moments

EARLY_S, HELD_S, LONGEST_POSE_S = 600.0, 60.0, 60.0
ALIKE_DEG = 10.0
"""Two clips of one person in the same stance differ by 2 to 10 deg."""
VETO_DEG = 30.0
TENDENCY_SIGMA_DEG, REPEAT_SIGMA_DEG = 4.0, 3.0
"""Of a held pose: what this person always does (arms hang 8 to 13 deg from plumb), and what changes from one
pose to the next; 5 deg together.
"""
AXIS_SIGMA_DEG = 8.0
WALKING_SIGMA_DEG = 10.0
"""In ordinary gait gravity's mean lies 14 to 18 deg from the arm's axis."""
HELD_SIGMA_DEG = float(np.hypot(TENDENCY_SIGMA_DEG, REPEAT_SIGMA_DEG))
MOMENT_SIGMA_DEG = 35.0
WITHIN = 1.96
STEADY_SHARE = 0.75
MOST_REPEATS = 3


@dataclass(frozen=True, slots=True, eq=False)
class FoundPose:
    """A pose, or what stands for one.

    ``time_s``: when it was; ``axis`` (3,): the arm's axis in the sensor; ``sigma_deg``: its standard
    deviation. ``proposals``: the early stretches, where they differ and nobody named one. ``vetoed_deg``:
    angle to walking where it speaks against every early stretch; else 0.
    """

    found: Found
    time_s: float
    axis: Float64Array
    sigma_deg: float
    still: StillPeriod | None = None
    proposals: tuple[StillPeriod, ...] = ()
    vetoed_deg: float = 0.0


def estimate_held_sigma(held_s: float) -> float:
    """Standard deviation of one pose held for so long: 5 deg, more where shorter than 5 s, up to 10."""
    return HELD_SIGMA_DEG * float(np.sqrt(np.clip(RULES.length_s / held_s, 1.0, 4.0)))


def estimate_repeated_sigma(apart_deg: Sequence[float]) -> float:
    """Standard deviation of the mean of poses that lie so far from it.

    What changes from pose to pose is measured, beside two poses' worth of what people show; its mean shrinks
    with the number of poses. What the person always does stays.
    """
    count = len(apart_deg)
    squares = 2.0 * REPEAT_SIGMA_DEG**2 + float(np.sum(np.square(apart_deg)))
    repeat_deg2 = squares / (2.0 + 2.0 * (count - 1))
    return float(np.sqrt(TENDENCY_SIGMA_DEG**2 + repeat_deg2 / count))


def point_along(axis: ArmAxis) -> Float64Array:
    """Unit vector (3,) of the sensor's axis that was strapped along the arm, towards the shoulder."""
    return np.where(np.arange(3) == "xyz".index(axis[1]), -1.0 if axis[0] == "-" else 1.0, 0.0)


def find_nearest_axis(direction: Float64Array) -> tuple[ArmAxis, float]:
    """The sensor's axis nearest to a direction (3,), and the angle between them, deg."""
    apart_deg = {axis: find_angle_deg(point_along(axis), direction) for axis in ARM_AXES}
    nearest = min(ARM_AXES, key=lambda axis: apart_deg[axis])
    return nearest, apart_deg[nearest]


def find_walking(part: WearPart) -> Float64Array | None:
    """How the arm hung in a minute of walking or more, most of it in one direction; None without it.

    Fast work passes for walking, but not in one direction: of recorded motion 93 to 100 % of walking lay
    within 10 deg of its commonest direction, 55 to 62 % of what was none.
    """
    if len(part.strides.up) < MINUTE_STRIDING:
        return None
    direction, share = find_commonest(part.strides.thin().up)
    return direction if share >= STEADY_SHARE else None


def find_poses(
    recording: Recording, blocks: Blocks, wear: Wear, accelerometer: AccelerometerCorrection
) -> tuple[FoundPose, ...]:
    """The pose of each stretch of wear that has one; without any, one that stands for it.

    Raises
    ------
    UnusableCalibration
        Nothing was ever still: regular swinging passes for walking (RELIABILITY.md 91).
    """
    stretches_s = find_still_stretches(blocks, accelerometer)
    found = (_choose_early(recording, part, stretches_s, accelerometer) for part in wear.find_openings())
    poses = tuple(pose for pose in found if pose is not None)
    return poses or (_do_without(recording, blocks, wear, accelerometer),)


def _choose_early(
    recording: Recording,
    part: WearPart,
    stretches_s: Sequence[Window],
    accelerometer: AccelerometerCorrection,
) -> FoundPose | None:
    """The first early stretch that walking does not veto; all vetoed, the one nearest to walking.

    Where it comes after the first minute and others differ, the person is asked which it was; the standard
    deviation covers those that walking does not veto.
    """
    worn_from_s, early = list_early(stretches_s, part)
    stills = [measure_stretch(recording, stretch_s) for stretch_s in early]
    if not stills:
        return None
    axes, walking = [still.correct(accelerometer) for still in stills], find_walking(part)
    apart_deg = [0.0 if walking is None else find_angle_deg(walking, axis) for axis in axes]
    agreed = [place for place, deg in enumerate(apart_deg) if deg <= VETO_DEG]
    first = agreed[0] if agreed else int(np.argmin(apart_deg))
    still, axis = stills[first], axes[first]
    held_deg = estimate_held_sigma(still.duration_s)
    if not agreed:
        least_deg = apart_deg[first]
        sigma_deg = max(WALKING_SIGMA_DEG, least_deg / WITHIN)
        return FoundPose("early", still.start_s, axis, sigma_deg, still, vetoed_deg=least_deg)
    if still.start_s <= worn_from_s + HELD_S:
        return FoundPose("held", still.start_s, axis, held_deg, still)
    if find_spread_deg(axes) <= ALIKE_DEG:
        return FoundPose("early", still.start_s, axis, held_deg, still)
    farthest_deg = max(find_angle_deg(axis, axes[place]) for place in agreed)
    sigma_deg = max(held_deg, farthest_deg / WITHIN)
    return FoundPose("early", still.start_s, axis, sigma_deg, still, tuple(stills))


def list_early(stretches_s: Sequence[Window], part: WearPart) -> tuple[float, list[Window]]:
    """When the sensor is worn from, and the still stretches of 5 to 60 s in the ten minutes after."""
    worn_from_s, early = part.worn_from_s, list[Window]()
    for start_s, end_s in stretches_s:
        if not part.start_s <= start_s < part.end_s or end_s <= worn_from_s:
            continue
        if start_s > worn_from_s + EARLY_S:
            break
        if end_s - start_s <= LONGEST_POSE_S:
            early.append((start_s, end_s))
        elif not early:
            worn_from_s = end_s
    return worn_from_s, early


def _do_without(
    recording: Recording, blocks: Blocks, wear: Wear, accelerometer: AccelerometerCorrection
) -> FoundPose:
    """How the arm hung where most was walked; without a minute of it, in the stillest moment."""
    still = measure_stillest(recording, blocks)
    most = max(wear.parts, key=lambda part: len(part.strides.up))
    walking = find_walking(most)
    if walking is not None:
        return FoundPose("walking", float(most.strides.time_s[0]), walking, WALKING_SIGMA_DEG)
    return FoundPose("moment", still.start_s, still.correct(accelerometer), MOMENT_SIGMA_DEG, still)


@dataclass(frozen=True, slots=True)
class ProposedPose:
    """A stretch that a person may name: the "pose", or a "repeat" of it."""

    still: StillPeriod
    kind: Literal["pose", "repeat"]


def propose_poses(recording: Recording, slip_times_s: Sequence[float] = ()) -> tuple[ProposedPose, ...]:
    """The early still stretches, in order of time, and those at the end that repeat the pose.

    Repeats: 5 to 60 s, in the last ten minutes, within 10 deg of the first early stretch that walking does
    not veto.
    """
    blocks = reduce_recording(recording)
    stills = find_still_moments(blocks)
    accelerometer = calibrate_accelerometer(stills)
    wear = divide_by_wear(blocks, stills, accelerometer, slip_times_s)
    stretches_s = find_still_stretches(blocks, accelerometer)
    proposed: list[ProposedPose] = []
    for part in wear.find_openings():
        _, early = list_early(stretches_s, part)
        proposed += [ProposedPose(measure_stretch(recording, stretch_s), "pose") for stretch_s in early]
    return (*proposed, *_propose_repeats(recording, wear, stretches_s, accelerometer))


def _propose_repeats(
    recording: Recording, wear: Wear, stretches_s: Sequence[Window], accelerometer: AccelerometerCorrection
) -> list[ProposedPose]:
    part = wear.find_openings()[0]
    first = _choose_early(recording, part, stretches_s, accelerometer)
    late_s = recording.duration_us / MICROSECONDS - EARLY_S
    if first is None or late_s < part.worn_from_s + EARLY_S:
        return []
    late = [
        measure_stretch(recording, (start_s, end_s))
        for start_s, end_s in stretches_s
        if start_s >= late_s and end_s - start_s <= LONGEST_POSE_S
    ]
    near = [still for still in late if find_angle_deg(first.axis, still.correct(accelerometer)) <= ALIKE_DEG]
    return [ProposedPose(still, "repeat") for still in near[:MOST_REPEATS]]


def find_spread_deg(axes: Sequence[Float64Array]) -> float:
    """Largest angle between any two directions; 0 for one."""
    return max((find_angle_deg(one, other) for one, other in combinations(axes, 2)), default=0.0)
