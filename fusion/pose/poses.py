"""Which stillness may be the pose.

A person says when the pose was held, or that it was held at the start of wear. If nobody says, the first
stillness of 5 s or more within ten minutes of the start of wear is assumed, and every other of that time is a
candidate. A stillness that does not sway is a table: the sensor is worn from its end on.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from fusion.conventions import CalibrationState, PoseHeld
from fusion.numerics import find_angle_deg
from fusion.pose.axes import (
    ALIKE_DEG,
    ASSUMED_SIGMA_DEG,
    MOMENT_SIGMA_DEG,
    WALKING_SIGMA_DEG,
    estimate_held_sigma,
    find_spread_deg,
)
from fusion.pose.wear import Wear, divide_by_wear, find_walking
from fusion.pose.windows import (
    TABLE_SWAY_DPS,
    Blocks,
    StillPeriod,
    Window,
    find_still_stretches,
    find_tables,
    measure_stillest,
    measure_stretch,
    reduce_recording,
)
from fusion.recording import MICROSECONDS, Float64Array, Recording
from fusion.sensor.accelerometer import AccelerometerCorrection, calibrate_accelerometer
from fusion.sensor.stillness import find_still_moments

EARLY_S, HELD_S, AT_ONCE_S, LONGEST_POSE_S = 600.0, 60.0, 10.0, 60.0
MOST_REPEATS = 3


@dataclass(frozen=True, slots=True, eq=False)
class FoundPose:
    """A pose, several that agree, or what stands for one.

    ``time_s``, ``end_s``: when it was; ``axis`` (3,): the arm's axis in the sensor; ``sigma_deg``: its
    standard deviation; ``repeat_deg``: the largest angle between several. ``candidates``: the stillnesses
    that may be the pose, if nobody confirmed one.
    """

    state: CalibrationState
    time_s: float
    end_s: float
    axis: Float64Array
    sigma_deg: float
    repeat_deg: float | None = None
    still: StillPeriod | None = None
    candidates: tuple[StillPeriod, ...] = ()


@dataclass(frozen=True, slots=True)
class EarlyStills:
    """When the sensor is worn from, and the stillnesses in the ten minutes after that may be the pose."""

    worn_from_s: float
    stills: tuple[StillPeriod, ...]


def find_early_stills(
    recording: Recording, wears: Sequence[Wear], stretches_s: Sequence[Window]
) -> list[EarlyStills]:
    """Return the stillnesses that sway, in the first ten minutes of each stretch of wear.

    If none in the whole recording sways, it was made without an arm, and those of up to 60 s are taken.
    """
    sways = any(measure_stretch(recording, span_s).sway_dps >= TABLE_SWAY_DPS for span_s in stretches_s)
    return [_find_in_wear(recording, wear, stretches_s, sways=sways) for wear in wears]


def _find_in_wear(
    recording: Recording, wear: Wear, stretches_s: Sequence[Window], *, sways: bool
) -> EarlyStills:
    worn_from_s, found = wear.worn_from_s, list[StillPeriod]()
    for start_s, end_s in stretches_s:
        if not wear.start_s <= start_s < wear.end_s or end_s <= worn_from_s:
            continue
        if start_s > worn_from_s + EARLY_S:
            break
        still = measure_stretch(recording, (start_s, end_s))
        if still.sway_dps >= TABLE_SWAY_DPS if sways else end_s - start_s <= LONGEST_POSE_S:
            found.append(still)
        elif not found:
            worn_from_s = end_s
    return EarlyStills(worn_from_s, tuple(found))


def assume_pose(
    early: EarlyStills, accelerometer: AccelerometerCorrection, pose_held: PoseHeld | None
) -> FoundPose | None:
    """Return the first stillness of wear as the pose; None if there is none.

    Stated as held at the start, it is confirmed if it begins within 10 s of wear. If it begins later in the
    first minute, other stillnesses of that minute that disagree with it remain candidates.
    """
    at_start = tuple(still for still in early.stills if still.start_s <= early.worn_from_s + HELD_S)
    if pose_held == "start" and at_start:
        is_late = at_start[0].start_s > early.worn_from_s + AT_ONCE_S
        differ = is_late and find_spread_deg([each.correct(accelerometer) for each in at_start]) > ALIKE_DEG
        return describe_pose("held_at_start", at_start[0], accelerometer, at_start if differ else ())
    if not early.stills:
        return None
    pose = describe_pose("assumed", early.stills[0], accelerometer, early.stills)
    return replace(pose, sigma_deg=max(pose.sigma_deg, ASSUMED_SIGMA_DEG))


def describe_pose(
    state: CalibrationState,
    still: StillPeriod,
    accelerometer: AccelerometerCorrection,
    candidates: tuple[StillPeriod, ...] = (),
) -> FoundPose:
    """Return a stillness as a pose."""
    sigma_deg = estimate_held_sigma(still.duration_s)
    axis = still.correct(accelerometer)
    return FoundPose(state, still.start_s, still.end_s, axis, sigma_deg, None, still, candidates)


def do_without_pose(
    recording: Recording, blocks: Blocks, wear: Wear, accelerometer: AccelerometerCorrection
) -> FoundPose:
    """Return how the arm hung in a minute of walking; without that, in the stillest moment.

    Raises UnusableCalibration: nothing was ever still.
    """
    still = measure_stillest(recording, blocks)
    walking = find_walking(wear.strides)
    if walking is not None:
        first_s = float(wear.strides.time_s[0])
        return FoundPose("none", first_s, first_s, walking, WALKING_SIGMA_DEG)
    return replace(describe_pose("none", still, accelerometer), sigma_deg=MOMENT_SIGMA_DEG)


@dataclass(frozen=True, slots=True)
class ProposedPose:
    """A stretch that a person may name: the "pose", or a "repeat" of it."""

    still: StillPeriod
    kind: Literal["pose", "repeat"]


def survey(
    recording: Recording, blocks: Blocks, accelerometer: AccelerometerCorrection
) -> tuple[list[Window], tuple[Wear, ...]]:
    """Return every stillness, and the stretches of wear."""
    stretches_s = find_still_stretches(blocks, accelerometer)
    return stretches_s, divide_by_wear(blocks, accelerometer, find_tables(recording, stretches_s))


def propose_poses(recording: Recording) -> tuple[ProposedPose, ...]:
    """Return the early stillnesses of each stretch of wear, and those at the end that repeat the pose.

    Repeats: 5 to 60 s, in the last ten minutes, within 10 deg of the first early stillness.
    """
    blocks = reduce_recording(recording)
    accelerometer = calibrate_accelerometer(find_still_moments(blocks))
    stretches_s, wears = survey(recording, blocks, accelerometer)
    early = find_early_stills(recording, wears, stretches_s)
    proposed = [ProposedPose(still, "pose") for one in early for still in one.stills]
    late_s = recording.duration_us / MICROSECONDS - EARLY_S
    if not early[0].stills or late_s < early[0].worn_from_s + EARLY_S:
        return tuple(proposed)
    axis = early[0].stills[0].correct(accelerometer)
    late = [
        measure_stretch(recording, (start_s, end_s))
        for start_s, end_s in stretches_s
        if start_s >= late_s and end_s - start_s <= LONGEST_POSE_S
    ]
    near = [still for still in late if find_angle_deg(axis, still.correct(accelerometer)) <= ALIKE_DEG]
    return (*proposed, *(ProposedPose(still, "repeat") for still in near[:MOST_REPEATS]))
