"""What speaks against a calibration pose, or fails to speak for it."""

import numpy as np
from numpy.typing import NDArray

from fusion.calibration_rules import OTHER_RULES, rules_for
from fusion.choices import Pose
from fusion.pose_windows import Blocks, StillPeriod
from fusion.postures import find_angle_deg
from fusion.recording import MICROSECONDS, QualityFlag, Recording
from fusion.still_proposals import find_quiet_windows
from fusion.worn_parts import WornParts

Vector = NDArray[np.float64]
UNLIKE_WALKING_DEG = 30.0
"""Between a calibration pose and walking: 10 deg at most was seen; a load carried may add to it."""
LIKE_WALKING_DEG = 15.0
ALONE_FROM_S = 600.0
ALONE_FIRST_SIGMA_DEG, ALONE_SIGMA_DEG = 6.0, 25.0
"""Of a pose that nothing confirms, where it was the first that was held, and where it was not.

Ours: on 18 simulated days at the wheel without walking the wheel was taken for the pose, 24 to 48 deg wrong,
and the pose had been held before; on 24 days of other work without walking the first one held was right.
"""


def flag_pose_unlike_walking(
    worn: WornParts, still: StillPeriod, arm_axis: Vector
) -> tuple[QualityFlag, ...]:
    """W-POSE-DOUBT where the axis from a window is far from how the arm hangs in walking."""
    hangs = worn.find_home(still.start_s).find_hanging()
    if hangs is None or find_angle_deg(hangs, arm_axis) <= UNLIKE_WALKING_DEG:
        return ()
    return (_flag("W-POSE-DOUBT", still),)


def flag_pose_alone(
    recording: Recording, blocks: Blocks, worn: WornParts, still: StillPeriod, arm_axis: Vector
) -> tuple[QualityFlag, ...]:
    """W-POSE-ALONE where we proposed the window and no walking confirms that the arm hung in it.

    Only in recordings of ten minutes and more: in shorter ones nobody has worked for long in one posture.
    """
    if recording.duration_us < ALONE_FROM_S * MICROSECONDS:
        return ()
    found = (part.find_hanging() for part in worn.parts)
    hangs = [direction for direction in found if direction is not None]
    at_home = worn.find_home(still.start_s).find_hanging() is not None
    if at_home or any(find_angle_deg(one, arm_axis) <= LIKE_WALKING_DEG for one in hangs):
        return ()
    quiet = find_quiet_windows(blocks, rules_for(recording.device))
    is_first = len(quiet) > 0 and still.start_s - quiet.start_s[0] < OTHER_RULES.length_s
    facts = {"deg": ALONE_FIRST_SIGMA_DEG if is_first else ALONE_SIGMA_DEG}
    return (_flag("W-POSE-ALONE", still, facts),)


def flag_unseen_lean(pose: Pose, still: StillPeriod) -> tuple[QualityFlag, ...]:
    """W-LEAN: no sensor on the arm can tell whether the trunk was leaning in the window that we proposed."""
    return (_flag("W-LEAN", still),) if pose == "side-lean" else ()


def flag_unquiet(still: StillPeriod) -> tuple[QualityFlag, ...]:
    """W-NO-STILL where a proposal had to make do with less than 5 s."""
    if still.duration_s >= OTHER_RULES.length_s - 0.5:
        return ()
    return (_flag("W-NO-STILL", still, {"score": still.score}),)


def flag_short_windows(windows: tuple[StillPeriod, ...]) -> tuple[QualityFlag, ...]:
    """W-POSE-SHORT for each window that a person asked for and that is shorter than 5 s."""
    short = (still for still in windows if still.duration_s < OTHER_RULES.length_s - 1e-6)
    return tuple(_flag("W-POSE-SHORT", still) for still in short)


def _flag(code: str, still: StillPeriod, facts: dict[str, float] | None = None) -> QualityFlag:
    end_s = still.start_s + still.duration_s
    return QualityFlag(code, 1, still.duration_s, still.start_s, end_s, dict(facts or {}))
