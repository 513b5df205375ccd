"""What speaks against a calibration pose, or fails to speak for it."""

from dataclasses import dataclass

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
SHORT_MOMENTS = 300
"""Calm moments of 2 s, ten minutes of them: in less nobody has worked for long in one posture."""
SHORT_SIGMA_DEG, ALONE_SIGMA_DEG = 6.0, 35.0
"""Of a pose that nothing confirms: where it was the first posture held still in a short recording, made on
purpose and begun by a pose; and anywhere else. Ours: decision 38 has the simulated days without walking.
"""
WITHIN = 1.96
USELESS_SIGMA_DEG = 10.0
"""A range of 20 deg to both sides: 30 cannot be told from 60 deg."""


@dataclass(frozen=True, slots=True)
class PoseEvidence:
    """What is known of a pose beside its window.

    ``sigma_deg``: standard deviation where less is known of it than of any pose that is held; 0 otherwise.
    ``apart_deg``: between the window and how the arm hangs in walking; None where nobody walked enough.
    ``first_deg``, ``first_s``: between the window and the first posture that was held still, and when; 0 and
    -inf where that is the window itself, or a person gave it. ``is_sure``: five minutes of walking or more.
    """

    sigma_deg: float
    apart_deg: float | None
    first_deg: float = 0.0
    first_s: float = -np.inf
    is_sure: bool = False

    @property
    def is_seen(self) -> bool:
        """Whether five minutes of walking speak for the window, and another posture was held before it."""
        return self.is_sure and self.apart_deg is not None and self.first_s > -np.inf


def weigh_proposal(recording: Recording, blocks: Blocks, worn: WornParts, still: StillPeriod) -> PoseEvidence:
    """What confirms a pose in the window that we proposed.

    The first stretch held still, and confirmed by walking, is taken for the pose. Another one, or one further
    from walking, may be a posture near it: the axis is then known as well as walking tells it, so that twice
    the figure holds what the window differs from walking and what walking from the axis. Less than five
    minutes of walking may be another posture too: then its angle to the first stretch counts, if larger.
    """
    home = worn.find_home(still.start_s)
    quiet = find_quiet_windows(blocks, rules_for(recording.device))
    own = quiet.select((quiet.start_s >= home.start_s) & (quiet.start_s < home.end_s))
    is_first = len(own) > 0 and still.start_s - own.start_s[0] < OTHER_RULES.length_s
    first_deg = find_angle_deg(own.gravity_g[0], still.gravity_g) if len(own) and not is_first else 0.0
    first_s = float(own.start_s[0]) if len(own) and home.opens and not is_first else -np.inf
    apart_deg = _compare_walking(worn, still)
    is_pose = is_first and home.opens
    if apart_deg is None:
        is_short = sum(len(part.calm.up) for part in worn.parts) < SHORT_MOMENTS
        return PoseEvidence(SHORT_SIGMA_DEG if is_pose and is_short else ALONE_SIGMA_DEG, None)
    is_sure = len(home.strides.up) >= SURE_STRIDING
    unknown_deg = apart_deg if is_sure else max(apart_deg, first_deg)
    is_confirmed = is_pose and apart_deg <= OTHER_RULES.hanging_deg
    sigma_deg = 0.0 if is_confirmed else _hold_walking(unknown_deg)
    return PoseEvidence(sigma_deg, apart_deg, first_deg, first_s, is_sure)


def weigh_asked(worn: WornParts, still: StillPeriod, arm_axis: Vector) -> PoseEvidence:
    """What speaks against a pose in a window that a person gave; nobody needs to have walked.

    Where walking differs from the window by more than poses do, the axis is known as well as walking tells
    it, as in :func:`weigh_proposal`.
    """
    hangs = worn.find_home(still.start_s).find_hanging()
    if hangs is None:
        return PoseEvidence(0.0, None)
    apart_deg = find_angle_deg(hangs, arm_axis)
    return PoseEvidence(_hold_walking(apart_deg) if apart_deg > LIKE_WALKING_DEG else 0.0, apart_deg)


def _hold_walking(apart_deg: float) -> float:
    """Half of what a window differs from walking and what walking may differ from the axis, deg."""
    return (apart_deg + WALKING_SIGMA_DEG) / WITHIN


def flag_evidence(evidence: PoseEvidence, still: StillPeriod) -> tuple[QualityFlag, ...]:
    """Say why the range is wider than that of a held pose.

    W-POSE-ALONE where no walking confirms that the arm hung in the window that we proposed; W-POSE-DOUBT far
    from how it hangs in walking; W-POSE-APART where it is nearer, or another posture was held before it.
    """
    if not evidence.sigma_deg:
        return ()
    facts = {"deg": round(evidence.sigma_deg, 1)}
    if evidence.apart_deg is None:
        return (_flag("W-POSE-ALONE", still, facts),)
    if evidence.apart_deg > UNLIKE_WALKING_DEG:
        return (_flag("W-POSE-DOUBT", still),)
    return (_flag("W-POSE-APART", still, {**facts, "apart_deg": round(evidence.apart_deg)}),)


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
