"""What speaks against a calibration pose, or fails to speak for it."""

import numpy as np
from numpy.typing import NDArray

from fusion.calibration_rules import OTHER_RULES, rules_for
from fusion.choices import Pose
from fusion.pose_windows import Blocks, StillPeriod
from fusion.postures import SURE_STRIDING, find_angle_deg
from fusion.recording import QualityFlag, Recording
from fusion.still_proposals import find_quiet_windows
from fusion.worn_parts import WornParts

Vector = NDArray[np.float64]
UNLIKE_WALKING_DEG = 30.0
"""Between a calibration pose and walking: 10 deg at most was seen; a load carried may add to it."""
LIKE_WALKING_DEG = 15.0
WALKING_SIGMA_DEG = 7.1
"""How far the commonest direction of walking came from the arm's axis at most, on 16 simulated days."""
ALONE_FROM = 300
"""Calm moments of 2 s, ten minutes of them: in less nobody has worked for long in one posture."""
ALONE_FIRST_SIGMA_DEG, ALONE_SIGMA_DEG = 6.0, 25.0
"""Of a pose that nothing confirms, where it was the first that was held, and where it was not.

Ours: on 18 simulated days at the wheel without walking the wheel was taken for the pose, 24 to 48 deg wrong,
and the pose had been held before; on 24 days of other work without walking the first one held was right.
"""
WITHIN = 1.96


def flag_pose_unlike_walking(
    worn: WornParts, still: StillPeriod, arm_axis: Vector
) -> tuple[QualityFlag, ...]:
    """W-POSE-DOUBT where the axis from a window is far from how the arm hangs in walking."""
    hangs = worn.find_home(still.start_s).find_hanging()
    if hangs is None or find_angle_deg(hangs, arm_axis) <= UNLIKE_WALKING_DEG:
        return ()
    return (_flag("W-POSE-DOUBT", still),)


def doubt_proposal(recording: Recording, blocks: Blocks, worn: WornParts, still: StillPeriod) -> float:
    """Standard deviation, deg, of a pose in the window that we proposed; 0 where it is that of any held pose.

    The first stretch held still, and confirmed by walking, is taken for the pose. Another one, or one further
    from walking, may be a posture near it: the axis is then known as well as walking tells it, so that twice
    the figure holds what the window differs from walking and what walking from the axis. Less than a minute
    of walking may be another posture too: then its angle to the first stretch counts, if larger.
    """
    if sum(len(part.calm.up) for part in worn.parts) < ALONE_FROM:
        return 0.0
    home = worn.find_home(still.start_s)
    quiet = find_quiet_windows(blocks, rules_for(recording.device))
    own = quiet.select(quiet.start_s >= home.start_s)
    is_first = home.opens and len(own) > 0 and still.start_s - own.start_s[0] < OTHER_RULES.length_s
    hangs_deg = _compare_walking(worn, still)
    if hangs_deg is None:
        return ALONE_FIRST_SIGMA_DEG if is_first else ALONE_SIGMA_DEG
    if len(own) and len(home.strides.up) < SURE_STRIDING:
        hangs_deg = max(hangs_deg, find_angle_deg(own.gravity_g[0], still.gravity_g))
    is_confirmed = is_first and hangs_deg <= OTHER_RULES.hanging_deg
    return 0.0 if is_confirmed else _hold_walking(hangs_deg)


def doubt_asked(worn: WornParts, still: StillPeriod, arm_axis: Vector) -> float:
    """Standard deviation, deg, of a pose in a window that a person gave; 0 where it is that of any held pose.

    Nobody needs to have walked. But where walking speaks against the window, by more than poses differ from
    it, the axis is known as well as walking tells it, as in :func:`doubt_proposal`.
    """
    hangs = worn.find_home(still.start_s).find_hanging()
    hangs_deg = 0.0 if hangs is None else find_angle_deg(hangs, arm_axis)
    return _hold_walking(hangs_deg) if hangs_deg > LIKE_WALKING_DEG else 0.0


def _hold_walking(hangs_deg: float) -> float:
    """Half of what a window differs from walking and what walking may differ from the axis, deg."""
    return (hangs_deg + WALKING_SIGMA_DEG) / WITHIN


def flag_pose_alone(worn: WornParts, still: StillPeriod, sigma_deg: float) -> tuple[QualityFlag, ...]:
    """W-POSE-ALONE where we proposed the window and no walking confirms that the arm hung in it."""
    if not sigma_deg or _compare_walking(worn, still) is not None:
        return ()
    return (_flag("W-POSE-ALONE", still, {"deg": sigma_deg}),)


def _compare_walking(worn: WornParts, still: StillPeriod) -> float | None:
    """Angle to how the arm hangs in walking: in the part of the pose, or in another one that confirms it."""
    own = worn.find_home(still.start_s).find_hanging()
    if own is not None:
        return find_angle_deg(own, still.gravity_g)
    found = (part.find_hanging() for part in worn.parts)
    apart_deg = [find_angle_deg(hangs, still.gravity_g) for hangs in found if hangs is not None]
    return next((deg for deg in sorted(apart_deg) if deg <= LIKE_WALKING_DEG), None)


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
