"""Which axis reads which stretch of a recording, what a person is asked about it, and the other readings.

A pose reads on until one that disagrees, or until the sensor was put on for that one. After a slip that a
person named nothing reads until a pose is given. Nothing else moves an axis or leaves time out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fusion.conventions import CONFIRMED, SAID_S
from fusion.numerics import find_angle_deg, scale_to_unit
from fusion.pose.axes import (
    ALIKE_DEG,
    AxisPart,
    Reading,
    choose_apart,
    estimate_repeated_sigma,
    find_spread_deg,
)
from fusion.pose.poses import EarlyStills, FoundPose, describe_pose
from fusion.pose.wear import MOVED_SHARE, Question, Wear, ask_for_slip, compare_postures, find_wear
from fusion.pose.windows import Window
from fusion.recording import Float64Array, join_overlapping
from fusion.sensor.accelerometer import AccelerometerCorrection


@dataclass(frozen=True, slots=True, eq=False)
class Read:
    """The first axis, the stretches that it does not read, in order of time, and poses that disagree."""

    first: FoundPose
    parts: tuple[AxisPart, ...]
    differ: tuple[Question, ...]


def read_recording(wears: Sequence[Wear], poses: Sequence[FoundPose], slip_times_s: Sequence[float]) -> Read:
    """Read each stretch between the slips that a person named by the poses held in it."""
    slips = join_overlapping([(time_s - SAID_S, time_s + SAID_S) for time_s in slip_times_s])
    edges_s = [-np.inf, *(edge_s for slip in slips for edge_s in slip), np.inf]
    sections = list(zip(edges_s[::2], edges_s[1::2], strict=True))
    own = [
        _join_agreeing([pose for pose in poses if start_s - 2.0 * SAID_S <= pose.time_s < end_s])
        for start_s, end_s in sections
    ]
    first = next(known[0] for known in own if known)
    parts = [AxisPart(*slip, None) for slip in slips]
    for section, known in zip(sections, own, strict=True):
        parts += _place(section, known, wears, first) if known else [AxisPart(*section, None)]
    differ = [
        Question("poses", before.end_s, one.time_s, find_angle_deg(before.axis, one.axis))
        for known in own
        for before, one in pairwise(known)
        if find_wear(wears, one.time_s).start_s <= before.end_s
    ]
    return Read(first, tuple(sorted(parts, key=lambda part: part.start_s)), tuple(differ))


def _place(
    section: Window, known: Sequence[FoundPose], wears: Sequence[Wear], first: FoundPose
) -> Iterator[AxisPart]:
    """Yield the stretches of a section that the first axis does not read."""
    start_s, end_s = section
    worn_s = [find_wear(wears, one.time_s).start_s for one in known[1:]]
    pairs = zip(worn_s, pairwise(known), strict=True)
    turns_s = [from_s if from_s > before.end_s else one.time_s for from_s, (before, one) in pairs]
    for one, from_s, to_s in zip(known, [start_s, *turns_s], [*turns_s, end_s], strict=True):
        if one is not first:
            wider_deg = float(np.sqrt(max(0.0, one.sigma_deg**2 - first.sigma_deg**2)))
            yield AxisPart(from_s, to_s, one.axis, wider_deg, is_posed=True)


def _join_agreeing(poses: Sequence[FoundPose]) -> list[FoundPose]:
    """Join poses that follow each other within 10 deg."""
    groups: list[list[FoundPose]] = []
    for pose in poses:
        if groups and find_angle_deg(_average(groups[-1]), pose.axis) <= ALIKE_DEG:
            groups[-1].append(pose)
        else:
            groups.append([pose])
    return [_join(group) for group in groups]


def _join(poses: list[FoundPose]) -> FoundPose:
    if len(poses) == 1:
        return poses[0]
    axis = _average(poses)
    sigma_deg = estimate_repeated_sigma([find_angle_deg(axis, pose.axis) for pose in poses])
    repeat_deg = find_spread_deg([pose.axis for pose in poses])
    return replace(poses[0], axis=axis, sigma_deg=sigma_deg, repeat_deg=repeat_deg, end_s=poses[-1].end_s)


def _average(poses: Sequence[FoundPose]) -> Float64Array:
    return poses[0].axis if len(poses) == 1 else scale_to_unit(np.sum([pose.axis for pose in poses], axis=0))


def ask(wears: Sequence[Wear], poses: Sequence[FoundPose], answers_s: Sequence[float]) -> Iterator[Question]:
    """Yield when the sensor may have moved, as no answer, no pose and no two poses that agree settle."""
    for wear in wears:
        is_posed = any(wear.start_s <= pose.time_s < wear.end_s for pose in poses)
        asked = [ask_for_slip(wear.strides, wear.calm)]
        if wear is not wears[0] and not is_posed and poses[0].state != "axis":
            asked.insert(0, Question("put_back", wear.worn_from_s - wear.off_s, wear.worn_from_s))
        for question in asked:
            if question and not question.is_answered(answers_s) and not _is_refuted(question, poses):
                yield replace(question, until_s=wear.end_s)


def _is_refuted(question: Question, poses: Sequence[FoundPose]) -> bool:
    """Return whether poses that a person gave on both sides agree."""
    before = [pose.axis for pose in poses if pose.time_s < question.first_s]
    after = [pose.axis for pose in poses if pose.time_s > question.end_s]
    is_given = poses[0].state in CONFIRMED
    return is_given and bool(before and after) and find_angle_deg(before[-1], after[0]) <= ALIKE_DEG


def assume_put_back(
    wears: Sequence[Wear],
    early: Sequence[EarlyStills],
    questions: Sequence[Question],
    accelerometer: AccelerometerCorrection,
) -> Iterator[FoundPose]:
    """Yield the first stillness after the sensor was off, if the postures are other ones than before."""
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    for (before, wear), one in zip(pairwise(wears), early[1:], strict=True):
        moments = before.calm.thin().up, wear.calm.thin().up
        if one.stills and wear.worn_from_s in asked_s and compare_postures(*moments) < MOVED_SHARE:
            yield describe_pose("assumed", one.stills[0], accelerometer)


def list_readings(
    read: Read,
    candidates: Sequence[Float64Array],
    questions: Sequence[Question],
    stills: Sequence[tuple[Wear, list[Float64Array]]],
) -> Iterator[Reading]:
    """Yield the readings beside the one that is used, as no person has ruled them out.

    ``stills``: each stretch of wear with its early stillnesses. Later parts go before earlier ones.
    """
    axis, parts = read.first.axis, read.parts
    yield from (Reading(candidates[place], parts) for place in choose_apart(candidates)[1:])
    asked_s = [question.end_s for question in questions if question.kind == "put_back"]
    put_back = [(wear, axes) for wear, axes in stills if axes and wear.worn_from_s in asked_s]
    for turn in range(max((len(choose_apart(axes)) for _, axes in put_back), default=0)):
        again = [
            AxisPart(wear.start_s, wear.end_s, axes[place])
            for wear, axes in put_back
            for place in choose_apart(axes)[turn : turn + 1]
        ]
        yield Reading(axis, (*parts, *again))
    for question in questions:
        if question.turn is not None:
            middle_s = (question.first_s + question.end_s) / 2.0
            yield Reading(axis, (*parts, AxisPart(middle_s, question.until_s, question.turn @ axis)))
    for question in read.differ:
        later = next(part for part in parts if part.is_posed and part.end_s > question.end_s)
        yield Reading(axis, (*parts, replace(later, start_s=question.first_s)))
