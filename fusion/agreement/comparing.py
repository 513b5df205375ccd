"""The chain from two measurements of one arm to how far they agree, top to bottom."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from fusion.agreement.alignment import LEAST_R, ClockWishes, align, align_roughly
from fusion.agreement.clocks import Alignment
from fusion.agreement.exposure_differences import FigureDifference, compare_exposure
from fusion.agreement.pairing import Pairs, join_pairs, pair
from fusion.agreement.sides import Side, share_calibration, take_angle_file
from fusion.agreement.statistics import Agreement, Limits, find_repeated_limits, measure_agreement
from fusion.agreement.strata import Stratum, divide_by_elevation, divide_by_speed
from fusion.angle_files import AngleFile
from fusion.errors import NotAligned, NothingInCommon
from fusion.task_windows import TaskWindow

Axis = Literal["angle", "segment", "common pose"]


@dataclass(frozen=True, slots=True)
class ComparisonSettings:
    """What a person may decide about a comparison."""

    wishes: ClockWishes = field(default_factory=ClockWishes)
    tasks: tuple[TaskWindow, ...] = ()


@dataclass(frozen=True, slots=True)
class TaskAgreement:
    """One task, its repetitions pooled. ``limits``: with the repetitions as repeated measures."""

    name: str
    paper_task: int | None
    repetitions: int
    agreement: Agreement
    limits: Limits


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Two measurements of one arm, aligned and compared.

    ``axis`` says where the reference's angle comes from: a ready angle, the arm's segment in the file, or an
    orientation calibrated at the moment at which ours was. ``pairs`` is all that was compared: the tasks
    where there is a list of them, else all common time.
    """

    ours: Side
    reference: Side
    axis: Axis
    alignment: Alignment
    pairs: Pairs
    overall: Agreement
    tasks: tuple[TaskAgreement, ...]
    by_elevation: tuple[Stratum, ...]
    by_speed: tuple[Stratum, ...]
    exposure: tuple[FigureDifference, ...]


def compare_sides(ours: Side, reference: AngleFile, settings: ComparisonSettings) -> Comparison:
    """Align the two, bring them to one rate, and compare.

    With a list of tasks, ``overall`` is over the tasks alone; else over all the time they have in common.

    Raises
    ------
    fusion.errors.UnusableComparison
        The motions are not alike, or have no time in common.
    UnknownAxis
        An orientation of which nothing says how the arm lies in it.
    """
    axis = name_axis(reference)
    calibrated = reference if axis != "common pose" else _calibrate_together(ours, reference, settings.wishes)
    other = take_angle_file(calibrated)
    alignment = align(ours.runs, other.runs, settings.wishes)
    pairs = pair(ours.runs, other.runs, alignment)
    windows = tuple(_place(task, alignment) for task in settings.tasks)
    tasks = _compare_tasks(pairs, windows)
    counted = _join_tasks(pairs, windows) if windows else pairs
    if not counted.runs:
        raise NothingInCommon(s=0.0)
    return Comparison(
        ours,
        other,
        axis,
        alignment,
        counted,
        _measure(counted),
        tasks,
        divide_by_elevation(counted),
        divide_by_speed(counted),
        compare_exposure(counted),
    )


def name_axis(reference: AngleFile) -> Axis:
    """Say where the angle of a file comes from."""
    if reference.up is None:
        return "angle"
    return "common pose" if reference.axis is None else "segment"


def _calibrate_together(ours: Side, reference: AngleFile, wishes: ClockWishes) -> AngleFile:
    """Align by how fast the vertical moves, then calibrate both at one moment."""
    rough = align_roughly(ours.paths or ours.runs, take_angle_file(reference).paths, wishes)
    if not rough.is_offset_given and not rough.r >= LEAST_R:
        raise NotAligned(r=round(rough.r, 2), least=LEAST_R)
    return share_calibration(reference, ours, rough)


def _place(task: TaskWindow, alignment: Alignment) -> TaskWindow:
    """Bring a task to the recording's clock."""
    if task.clock == "recording":
        return task
    start_s, end_s = alignment.to_recording(np.array([task.start_s, task.end_s])).tolist()
    return replace(task, start_s=start_s, end_s=end_s)


def _compare_tasks(pairs: Pairs, tasks: tuple[TaskWindow, ...]) -> tuple[TaskAgreement, ...]:
    found = []
    for name in dict.fromkeys(task.name for task in tasks):
        windows = [task for task in tasks if task.name == name]
        parts = [pairs.cut(task.start_s, task.end_s) for task in windows]
        limits = find_repeated_limits([_measure(part) for part in parts])
        pooled = _measure(join_pairs(parts))
        found.append(TaskAgreement(name, windows[0].paper_task, len(windows), pooled, limits))
    return tuple(found)


def _join_tasks(pairs: Pairs, tasks: tuple[TaskWindow, ...]) -> Pairs:
    """Every moment that lies in a task, once, in time order."""
    joined: list[tuple[float, float]] = []
    for start_s, end_s in sorted((task.start_s, task.end_s) for task in tasks):
        if joined and start_s <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(joined[-1][1], end_s))
        else:
            joined.append((start_s, end_s))
    return join_pairs([pairs.cut(start_s, end_s) for start_s, end_s in joined])


def _measure(pairs: Pairs) -> Agreement:
    return measure_agreement(pairs.ours_deg, pairs.reference_deg, pairs.duration_s)
