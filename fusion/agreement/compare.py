"""The chain from two measurements of one arm to how far they agree, top to bottom."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Literal

import numpy as np

from fusion.agreement.alignment import LEAST_R, ClockSettings, align, align_roughly
from fusion.agreement.pairs import (
    Alignment,
    PairedRun,
    Pairs,
    Runs,
    join_pairs,
    measure_path,
    pair,
    take_paths,
    take_runs,
)
from fusion.agreement.statistics import Agreement, Limits, find_repeated_limits, measure_agreement
from fusion.angle_files import AngleFile, calibrate_file, resample_file
from fusion.diary import TaskWindow
from fusion.errors import NotAligned, NothingInCommon, UnknownAxis
from fusion.exposure import Exposure, summarise_exposure
from fusion.numerics.intervals import join_overlapping
from fusion.pipeline import FusedRecording
from fusion.recording import Float64Array, FloatArray

# The two sides of a comparison: a recording that we fused, or a file that holds its angle already.


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One measurement of the arm, in its own clock.

    ``device``, ``sha256``, ``understood``: as in :class:`fusion.recording.Recording`.
    ``duration_s``: from the first to the last row.
    ``runs``: the elevation, deg; empty as long as the arm's axis is not known.
    ``paths``: the path of the vertical, deg; empty where only angles are known.
    ``calibration_s``: when the arm hung still, (start, end); the other side is calibrated at the same moment.
    """

    device: str
    sha256: str
    duration_s: float
    runs: Runs
    paths: Runs = ()
    calibration_s: tuple[float, float] | None = None
    understood: Mapping[str, str] = field(default_factory=dict)


def take_recording(fused: FusedRecording) -> Side:
    """Take a recording of ours; its clock counts from its first sample."""
    recording, windows = fused.samples.recording, fused.samples.calibration.windows
    return Side(
        recording.device,
        recording.sha256,
        recording.duration_us / 1e6,
        take_runs(fused.elevation),
        take_paths(fused.elevation),
        (windows[0].start_s, windows[0].end_s) if windows else None,
        recording.understood,
    )


def take_angle_file(file: AngleFile, calibration_s: tuple[float, float] | None = None) -> Side:
    """Take a file with its angle, or with an orientation only; its clock is its own."""
    return Side(
        file.device,
        file.sha256,
        file.last_s - file.first_s,
        _lay(file, file.elevation_deg),
        _lay(file, None if file.up is None else measure_path(file.up)),
        calibration_s,
        file.understood,
    )


def _lay(file: AngleFile, values: FloatArray | None) -> Runs:
    return () if values is None else take_runs(resample_file(file, values)[1], file.first_s)


# The error by elevation and by speed, both as the reference measured them.


ELEVATION_EDGES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 180.0)
SPEED_EDGES_DPS = (0.0, 10.0, 30.0, 90.0, 180.0, float("inf"))
SPEED_SPAN_S = 0.1
"""The speed is taken over a tenth of a second, which averages the noise of single samples."""


@dataclass(frozen=True, slots=True)
class Stratum:
    """Rows with ``lower <= value < upper``; the last class holds its upper edge too."""

    lower: float
    upper: float
    percent: float
    agreement: Agreement


def measure_speed(run: PairedRun) -> Float64Array:
    """Size of the change over a tenth of a second about each row, deg/s; at the ends over what there is."""
    reach = max(1, round(SPEED_SPAN_S * run.rate_hz / 2))
    rows = np.arange(len(run))
    first, last = np.maximum(rows - reach, 0), np.minimum(rows + reach, len(run) - 1)
    seconds = np.maximum(last - first, 1) / run.rate_hz
    return np.asarray(np.abs(run.reference_deg[last] - run.reference_deg[first]) / seconds)


def _divide(pairs: Pairs, values: Float64Array, edges: tuple[float, ...]) -> tuple[Stratum, ...]:
    ours, reference = pairs.ours_deg, pairs.reference_deg
    share = 100.0 / max(len(ours), 1)
    strata = []
    for lower, upper in pairwise(edges):
        inside = (values >= lower) & ((values < upper) | ((upper == edges[-1]) & (values <= upper)))
        count = int(np.count_nonzero(inside))
        agreement = measure_agreement(ours[inside], reference[inside], count / pairs.rate_hz)
        strata.append(Stratum(lower, upper, count * share, agreement))
    return tuple(strata)


# The exposure figures of both sides over the same time: bins, repetitions, percentiles.


PERCENTILES = (10, 50, 90)


@dataclass(frozen=True, slots=True)
class FigureDifference:
    """One exposure figure on both sides, under its name in the summary; ``difference`` = ours - reference."""

    name: str
    ours: float
    reference: float

    @property
    def difference(self) -> float:
        """Ours less the reference's."""
        return self.ours - self.reference


def _compare_exposure(pairs: Pairs) -> tuple[FigureDifference, ...]:
    """Set the figures of both sides beside each other; the metric filter is applied to both alike."""
    ours, reference = (_list_figures(summarise_exposure(side)) for side in pairs.to_elevations())
    return tuple(FigureDifference(name, ours[name], reference[name]) for name in ours)


def _list_figures(exposure: Exposure) -> dict[str, float]:
    bins = {f"time_{item.lower_deg:g}_{item.upper_deg:g}_percent": item.percent for item in exposure.bins}
    above = {f"time_above_{item.threshold_deg:g}_percent": item.percent for item in exposure.time_above}
    entries = {f"entries_above_{item.threshold_deg:g}": float(item.count) for item in exposure.entries}
    percentiles = {f"elevation_p{p}_deg": exposure.percentiles_deg[p] for p in PERCENTILES}
    return {**bins, **above, **entries, **percentiles}


Axis = Literal["angle", "segment", "common pose"]


@dataclass(frozen=True, slots=True)
class ComparisonSettings:
    """What a person may decide about a comparison."""

    clock: ClockSettings = field(default_factory=ClockSettings)
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
        An orientation in which the direction of the arm is not known.
    """
    axis: Axis = "angle" if reference.up is None else "segment"
    calibrated = reference
    if reference.up is not None and reference.axis is None:
        axis, calibrated = "common pose", _calibrate_together(ours, reference, settings.clock)
    other = take_angle_file(calibrated)
    alignment = align(ours.runs, other.runs, settings.clock)
    pairs = pair(ours.runs, other.runs, alignment)
    windows = tuple(_place(task, alignment) for task in settings.tasks)
    tasks = _compare_tasks(pairs, windows)
    counted = pairs
    if windows:  # every moment that lies in a task, once, in time order
        spans_s = join_overlapping((window.start_s, window.end_s) for window in windows)
        counted = join_pairs([pairs.cut(start_s, end_s) for start_s, end_s in spans_s])
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
        _divide(counted, counted.reference_deg, ELEVATION_EDGES_DEG),
        _divide(counted, np.concatenate([measure_speed(run) for run in counted.runs]), SPEED_EDGES_DPS),
        _compare_exposure(counted),
    )


def _calibrate_together(ours: Side, reference: AngleFile, clock: ClockSettings) -> AngleFile:
    """Align by how fast the vertical moves, then calibrate the reference when our side was calibrated."""
    rough = align_roughly(ours.paths or ours.runs, take_angle_file(reference).paths, clock)
    if not rough.is_offset_given and not rough.r >= LEAST_R:
        raise NotAligned(r=round(rough.r, 2), least=LEAST_R)
    if ours.calibration_s is None:
        raise UnknownAxis
    start_s, end_s = rough.to_reference(np.array(ours.calibration_s))
    return calibrate_file(reference, (float(start_s), float(end_s)))


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


def _measure(pairs: Pairs) -> Agreement:
    return measure_agreement(pairs.ours_deg, pairs.reference_deg, pairs.duration_s)
