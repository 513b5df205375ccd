"""What speaks against a calibration pose, or fails to speak for it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.caveats import Caveat
from fusion.conventions import Pose
from fusion.pose.postures import NEAR_DEG, SURE_STRIDING, Moments, cos_deg, find_angle_deg, find_commonest
from fusion.pose.rules import OTHER_RULES, rules_for
from fusion.pose.slips import Doubt, SlipRules
from fusion.pose.wear import AxisPart, Wear, WearPart
from fusion.pose.windows import Blocks, StillPeriod, find_quiet_windows
from fusion.recording import Float64Array, QualityFlag, Recording, flag_stretches

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


def weigh_proposal(recording: Recording, blocks: Blocks, wear: Wear, still: StillPeriod) -> PoseEvidence:
    """What confirms a pose in the window that we proposed.

    The first stretch held still, and confirmed by walking, is taken for the pose. Another one, or one further
    from walking, may be a posture near it: the axis is then known as well as walking tells it, so that twice
    the figure holds what the window differs from walking and what walking from the axis. Less than five
    minutes of walking may be another posture too: then its angle to the first stretch counts, if larger.
    """
    pose_part = wear.find_part(still.start_s)
    quiet = find_quiet_windows(blocks, rules_for(recording.device))
    own = quiet.select((quiet.start_s >= pose_part.start_s) & (quiet.start_s < pose_part.end_s))
    is_first = len(own) > 0 and still.start_s - own.start_s[0] < OTHER_RULES.length_s
    first_deg = find_angle_deg(own.gravity_g[0], still.gravity_g) if len(own) and not is_first else 0.0
    first_s = float(own.start_s[0]) if len(own) and pose_part.opens and not is_first else -np.inf
    apart_deg = _compare_walking(wear, still)
    is_pose = is_first and pose_part.opens
    if apart_deg is None:
        is_short = sum(len(part.calm.up) for part in wear.parts) < SHORT_MOMENTS
        return PoseEvidence(SHORT_SIGMA_DEG if is_pose and is_short else ALONE_SIGMA_DEG, None)
    is_sure = len(pose_part.strides.up) >= SURE_STRIDING
    unknown_deg = apart_deg if is_sure else max(apart_deg, first_deg)
    is_confirmed = is_pose and apart_deg <= OTHER_RULES.hanging_deg
    sigma_deg = 0.0 if is_confirmed else _hold_walking(unknown_deg)
    return PoseEvidence(sigma_deg, apart_deg, first_deg, first_s, is_sure)


def weigh_asked(wear: Wear, still: StillPeriod, arm_axis: Float64Array) -> PoseEvidence:
    """What speaks against a pose in a window that a person gave; nobody needs to have walked.

    Where walking differs from the window by more than poses do, the axis is known as well as walking tells
    it, as in :func:`weigh_proposal`.
    """
    hangs = wear.find_part(still.start_s).find_hanging()
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
        return (flag_window(Caveat.POSE_ALONE, still, facts),)
    if evidence.apart_deg > UNLIKE_WALKING_DEG:
        return (flag_window(Caveat.POSE_DOUBT, still),)
    return (flag_window(Caveat.POSE_APART, still, {**facts, "apart_deg": round(evidence.apart_deg)}),)


def _compare_walking(wear: Wear, still: StillPeriod) -> float | None:
    """Angle to how the arm hangs in walking: in the part of the pose, or in another one that confirms it."""
    own = wear.find_part(still.start_s).find_hanging()
    if own is not None:
        return find_angle_deg(own, still.gravity_g)
    found = (part.find_hanging() for part in wear.parts)
    apart_deg = [find_angle_deg(hangs, still.gravity_g) for hangs in found if hangs is not None]
    return next((deg for deg in sorted(apart_deg) if deg <= LIKE_WALKING_DEG), None)


def flag_unseen_lean(pose: Pose, still: StillPeriod) -> tuple[QualityFlag, ...]:
    """Flag a proposed leaning pose (W-LEAN): no sensor on the arm knows whether the trunk was leaning."""
    return (flag_window(Caveat.LEAN, still),) if pose == "side-lean" else ()


def flag_unquiet(still: StillPeriod) -> tuple[QualityFlag, ...]:
    """Flag a proposal of less than 5 s (W-NO-STILL)."""
    if still.duration_s >= OTHER_RULES.length_s - 0.5:
        return ()
    return (flag_window(Caveat.NO_STILL, still, {"score": still.score}),)


def flag_short_windows(windows: tuple[StillPeriod, ...]) -> tuple[QualityFlag, ...]:
    """Flag each window that a person chose and that is shorter than 5 s (W-POSE-SHORT)."""
    short = (still for still in windows if still.duration_s < OTHER_RULES.length_s - 1e-6)
    return tuple(flag_window(Caveat.POSE_SHORT, still) for still in short)


def flag_window(caveat: Caveat, still: StillPeriod, facts: dict[str, float] | None = None) -> QualityFlag:
    """One flag for a calibration window, with its place."""
    end_s = still.start_s + still.duration_s
    return QualityFlag(caveat, 1, still.duration_s, still.start_s, end_s, dict(facts or {}))


# Turns that cannot be told for sure: what is left out for them, and what is kept with a wider range.


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


def find_early_turn(wear: Wear, pose_s: float, evidence: PoseEvidence) -> tuple[AxisPart, ...]:
    """The first five minutes, left out where the arm was first held still more than 15 deg from the pose.

    A pose is held when the sensor has just been strapped on. One that walking does not know, before a window
    like walking: the sensor turned before a slip could be found, lay on a desk, or the arm was raised.
    """
    pose_part = wear.find_part(pose_s)
    first_s = float(pose_part.calm.time_s[0]) if len(pose_part.calm.time_s) else 0.0
    is_early = evidence.first_s < min(first_s + EARLY_S, pose_s)
    if not evidence.is_seen or not is_early or evidence.first_deg <= EARLY_TURN_DEG:
        return ()
    return (AxisPart(pose_part.start_s, first_s + EARLY_S, None),)


def find_doubted_parts(
    wear: Wear, arm_axis: Float64Array, remounts: Sequence[AxisPart]
) -> tuple[DoubtedPart, ...]:
    """The side of each doubt on which the arm hung farther from the axis that its part is read by."""
    found: list[DoubtedPart] = []
    for doubt in wear.doubts:
        part = wear.find_part((doubt.of_s[0] + doubt.of_s[1]) / 2.0)
        axis = _find_axis(part, arm_axis, remounts)
        if axis is not None:
            found += [DoubtedPart(*span_s, doubt.angle_deg) for span_s in _take_side(doubt, part, axis)]
    return tuple(found)


def _find_axis(part: WearPart, arm_axis: Float64Array, remounts: Sequence[AxisPart]) -> Float64Array | None:
    """The axis that a part is read by; None where it is left out."""
    span_s = (part.start_s, part.end_s)
    return next((one.arm_axis for one in remounts if (one.start_s, one.end_s) == span_s), arm_axis)


def _take_side(doubt: Doubt, part: WearPart, axis: Float64Array) -> Spans:
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
    """Flag the places of doubtful turns, and by how much the arm hung otherwise (W-SLIP-DOUBT)."""
    if not parts:
        return
    spans = tuple((max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts)
    apart_deg = round(max(part.angle_deg for part in parts))
    yield flag_stretches(Caveat.SLIP_DOUBT, spans, {"apart_deg": apart_deg})
