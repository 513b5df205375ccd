"""Agreement of two measurements of one arm: the source paper's validation, for your own participants."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import isfinite, nan, sqrt
from typing import Literal

import numpy as np

from acromion.fusion.angle_files import AngleFile, calibrate_file, resample_file
from acromion.fusion.comparison.alignment import (
    LEAST_R,
    Alignment,
    ClockSettings,
    PairedRun,
    Pairs,
    Runs,
    align,
    align_roughly,
    compute_pearson_r,
    get_valid_runs,
    get_vertical_paths,
    join_pairs,
    measure_path,
    pair,
)
from acromion.fusion.diary import TaskWindow
from acromion.fusion.errors import NotAligned, NothingInCommon, UnknownAxis
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.pipeline import FusedRecording
from acromion.fusion.recording import Float64Array, FloatArray, join_overlapping

# Agreement of two angles. ``ours`` and ``reference`` are always shape (n,), deg, at the same moments.
#
# Pearson's r, root mean square and mean absolute error: as in Table 1 of the source paper. Bias and limits of
# agreement: Bland and Altman 1986; with repeated measures, Bland and Altman 2007, section 3 (the true value
# varies). ICC(A,1): McGraw and Wong 1996, two-way, absolute agreement, one measurement (Shrout and Fleiss's
# ICC(2,1)). Concordance: Lin 1989.
#
# r, ICC and concordance compare the error with the spread of the angle. If the angle hardly moves they do not
# measure the error, so they are NaN if the reference is quasi-static: standard deviation below 5 deg. The
# paper omits r for its quasi-static tasks without stating a rule.

QUASI_STATIC_DEG = 5.0
LIMIT_SD = 1.96


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement over some rows; ``bias_deg`` is ours minus reference. NaN means not computable."""

    count: int
    duration_s: float
    r: float
    rmse_deg: float
    mean_absolute_error_deg: float
    bias_deg: float
    sd_deg: float
    loa_low_deg: float
    loa_high_deg: float
    icc: float
    concordance: float
    reference_sd_deg: float

    @property
    def is_quasi_static(self) -> bool:
        """Whether the reference moves too little for r, ICC and concordance."""
        return not self.reference_sd_deg >= QUASI_STATIC_DEG


def measure_agreement(ours_deg: Float64Array, reference_deg: Float64Array, duration_s: float) -> Agreement:
    """Compare row by row.

    Standard deviations are the sample's (n - 1), except within r and concordance, as their authors define.
    """
    if not len(ours_deg):
        return Agreement(0, 0.0, *([nan] * 10))
    error = ours_deg - reference_deg
    bias, sd = float(error.mean()), compute_sd(error)
    reference_sd = compute_sd(reference_deg)
    moves = reference_sd >= QUASI_STATIC_DEG
    return Agreement(
        count=len(error),
        duration_s=duration_s,
        r=compute_pearson_r(ours_deg, reference_deg) if moves else nan,
        rmse_deg=float(np.sqrt(np.mean(error**2))),
        mean_absolute_error_deg=float(np.abs(error).mean()),
        bias_deg=bias,
        sd_deg=sd,
        loa_low_deg=bias - LIMIT_SD * sd,
        loa_high_deg=bias + LIMIT_SD * sd,
        icc=compute_icc(ours_deg, reference_deg) if moves else nan,
        concordance=compute_concordance(ours_deg, reference_deg) if moves else nan,
        reference_sd_deg=reference_sd,
    )


def compute_sd(values: Float64Array) -> float:
    """Return the sample standard deviation; NaN for fewer than two."""
    return float(values.std(ddof=1)) if len(values) > 1 else nan


def compute_concordance(a: Float64Array, b: Float64Array) -> float:
    """Return Lin's coefficient: 2 s_ab / (s_a^2 + s_b^2 + (mean_a - mean_b)^2), variances over n."""
    apart = float(a.mean() - b.mean()) ** 2 + float(a.var()) + float(b.var())
    return 2.0 * float(np.mean((a - a.mean()) * (b - b.mean()))) / apart if apart > 0 else nan


def compute_icc(a: Float64Array, b: Float64Array) -> float:
    """Return ICC(A,1): (MSR - MSE) / (MSR + MSE + 2 (MSC - MSE) / n), for two measurements of n moments."""
    n = len(a)
    if n < 2:
        return nan
    middle, grand = (a + b) / 2.0, float((a.mean() + b.mean()) / 2.0)
    rows = 2.0 * float(np.sum((middle - grand) ** 2)) / (n - 1)
    columns = n * float((a.mean() - grand) ** 2 + (b.mean() - grand) ** 2)
    residual = (a - middle - (a.mean() - grand)) ** 2 + (b - middle - (b.mean() - grand)) ** 2
    error = float(residual.sum()) / (n - 1)
    whole = rows + error + 2.0 * (columns - error) / n
    return (rows - error) / whole if whole > 0 else nan


@dataclass(frozen=True, slots=True)
class Limits:
    """Bias and 95 % limits of agreement, and the two parts of their spread."""

    bias_deg: float
    low_deg: float
    high_deg: float
    between_sd_deg: float
    within_sd_deg: float


def compute_repeated_limits(groups: Sequence[Agreement]) -> Limits:
    """Return limits of agreement for several people (or repetitions) with many rows each.

    One-way analysis of variance of the differences: within = MSW, between = (MSB - MSW) / m0 with m0 = (N^2 -
    sum m_i^2) / ((k - 1) N); limits = mean of all rows +- 1.96 sqrt(between + within). With one group they
    are the plain limits. Groups without rows are ignored.
    """
    groups = [group for group in groups if group.count > 0]
    if not groups:
        return Limits(nan, nan, nan, nan, nan)
    sizes = np.array([group.count for group in groups], np.float64)
    means = np.array([group.bias_deg for group in groups])
    total, k = float(sizes.sum()), len(groups)
    bias = float(sizes @ means / total)
    squares = sum(group.sd_deg**2 * (group.count - 1) for group in groups if group.count > 1)
    within = squares / (total - k) if total > k else 0.0
    between = 0.0
    if k > 1:
        between_ms = float(sizes @ (means - bias) ** 2) / (k - 1)
        between = max(0.0, (between_ms - within) * (k - 1) * total / (total**2 - float(sizes @ sizes)))
    spread = LIMIT_SD * sqrt(between + within)
    return Limits(bias, bias - spread, bias + spread, sqrt(between), sqrt(within))


# Several people, tasks and devices together: means and standard deviations over people, as in Table 1.


@dataclass(frozen=True, slots=True)
class AgreementEntry:
    """The agreement of one task in one comparison."""

    person: str
    device: str
    task: str
    paper_task: int | None
    agreement: Agreement


@dataclass(frozen=True, slots=True)
class Spread:
    """Mean and sample standard deviation over people; ``people``: how many have the figure."""

    mean: float
    sd: float
    people: int


@dataclass(frozen=True, slots=True)
class AgreementCell:
    """One task with one device. ``limits``: with the people as repeated measures."""

    task: str
    paper_task: int | None
    device: str
    people: int
    r: Spread
    rmse_deg: Spread
    mean_absolute_error_deg: Spread
    bias_deg: Spread
    limits: Limits


def summarise_agreement_study(entries: Sequence[AgreementEntry]) -> tuple[AgreementCell, ...]:
    """Return a cell for each task and device: tasks of the paper in its order, then the others."""
    keys = dict.fromkeys((entry.task, entry.device) for entry in entries)
    cells = [_summarise([entry for entry in entries if (entry.task, entry.device) == key]) for key in keys]
    return tuple(sorted(cells, key=lambda cell: cell.paper_task or 99))


def _summarise(entries: Sequence[AgreementEntry]) -> AgreementCell:
    people = dict.fromkeys(entry.person for entry in entries)
    of = [[entry.agreement for entry in entries if entry.person == person] for person in people]
    return AgreementCell(
        entries[0].task,
        entries[0].paper_task,
        entries[0].device,
        len(people),
        spread(_average(own, "r") for own in of),
        spread(_average(own, "rmse_deg") for own in of),
        spread(_average(own, "mean_absolute_error_deg") for own in of),
        spread(_average(own, "bias_deg") for own in of),
        compute_repeated_limits([entry.agreement for entry in entries]),
    )


def _average(agreements: Sequence[Agreement], name: str) -> float:
    """Return a person's mean of a statistic, if several recordings contain the task."""
    known = [value for agreement in agreements if isfinite(value := float(getattr(agreement, name)))]
    return sum(known) / len(known) if known else nan


def spread(values: Iterable[float]) -> Spread:
    """Return mean and sample standard deviation of the known values; NaN if most people lack the figure.

    This omits r for a task that is quasi-static for most people, even if one person moved a little more.
    """
    every = list(values)
    known = np.array([value for value in every if isfinite(value)])
    if 2 * len(known) <= len(every):
        return Spread(nan, nan, len(known))
    return Spread(float(known.mean()), compute_sd(known), len(known))


# The two sides of a comparison: a recording fused by Acromion, or a file that contains its angle.


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One measurement of the arm, in its own clock.

    ``device``, ``sha256``, ``understood``: as in :class:`acromion.fusion.recording.Recording`.
    ``duration_s``: from the first to the last row.
    ``runs``: the elevation, deg; empty until the arm axis is known.
    ``paths``: the path of the vertical, deg; empty if only angles are known.
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
    """Return a fused recording as a side; its clock counts from its first sample."""
    recording, windows = fused.samples.recording, fused.samples.calibration.windows
    return Side(
        recording.device,
        recording.sha256,
        recording.duration_us / 1e6,
        get_valid_runs(fused.elevation),
        get_vertical_paths(fused.elevation),
        (windows[0].start_s, windows[0].end_s) if windows else None,
        recording.understood,
    )


def take_angle_file(file: AngleFile, calibration_s: tuple[float, float] | None = None) -> Side:
    """Return a file with its angle, or with an orientation only, as a side, in its own clock."""
    return Side(
        file.device,
        file.sha256,
        file.last_s - file.first_s,
        _resample(file, file.elevation_deg),
        _resample(file, None if file.up is None else measure_path(file.up)),
        calibration_s,
        file.understood,
    )


def _resample(file: AngleFile, values: FloatArray | None) -> Runs:
    return () if values is None else get_valid_runs(resample_file(file, values)[1], file.first_s)


# The error by elevation and by speed, both as measured by the reference.


ELEVATION_EDGES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 180.0)
SPEED_EDGES_DPS = (0.0, 10.0, 30.0, 90.0, 180.0, float("inf"))
SPEED_SPAN_S = 0.1
"""The speed is computed over a tenth of a second, which averages the noise of single samples."""


@dataclass(frozen=True, slots=True)
class Stratum:
    """Rows with ``lower <= value < upper``; the upper edge of the last class also belongs to it."""

    lower: float
    upper: float
    percent: float
    agreement: Agreement


def measure_speed(run: PairedRun) -> Float64Array:
    """Return the absolute change over a tenth of a second around each row, deg/s; shorter at the ends."""
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
    """One exposure figure on both sides, with its name in the summary; ``difference`` = ours - reference."""

    name: str
    ours: float
    reference: float

    @property
    def difference(self) -> float:
        """Ours minus the reference."""
        return self.ours - self.reference


def _list_figures(exposure: Exposure) -> dict[str, float]:
    bins = {f"time_{item.lower_deg:g}_{item.upper_deg:g}_percent": item.percent for item in exposure.bins}
    above = {f"time_above_{item.threshold_deg:g}_percent": item.percent for item in exposure.time_above}
    entries = {f"entries_above_{item.threshold_deg:g}": float(item.count) for item in exposure.entries}
    percentiles = {f"elevation_p{p}_deg": exposure.percentiles_deg[p] for p in PERCENTILES}
    return {**bins, **above, **entries, **percentiles}


Axis = Literal["angle", "segment", "common pose"]


@dataclass(frozen=True, slots=True)
class ComparisonSettings:
    """Options of a comparison."""

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

    ``axis``: the source of the reference's angle: a precomputed angle, the arm's segment in the file, or an
    orientation calibrated at the same moment as our side.
    ``pairs``: all compared rows: the tasks if there is a task list, otherwise all common time.
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
    """Align the two sides, resample them to one rate, and compare.

    With a task list, ``overall`` covers the tasks only; otherwise all common time.

    Raises
    ------
    acromion.fusion.errors.UnusableComparison
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
    if windows:  # every moment within a task, once, in time order
        spans_s = join_overlapping((window.start_s, window.end_s) for window in windows)
        counted = join_pairs([pairs.cut(start_s, end_s) for start_s, end_s in spans_s])
    if not counted.runs:
        raise NothingInCommon(s=0.0)
    # the metric filter is applied to both sides alike
    own, theirs = (_list_figures(summarise_exposure(side)) for side in counted.to_elevations())
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
        tuple(FigureDifference(name, value, theirs[name]) for name, value in own.items()),
    )


def _calibrate_together(ours: Side, reference: AngleFile, clock: ClockSettings) -> AngleFile:
    """Align by the speed of the vertical, then calibrate the reference at the moment of our calibration."""
    rough = align_roughly(ours.paths or ours.runs, take_angle_file(reference).paths, clock)
    if not rough.is_offset_given and not rough.r >= LEAST_R:
        raise NotAligned(r=round(rough.r, 2), least=LEAST_R)
    if ours.calibration_s is None:
        raise UnknownAxis
    start_s, end_s = rough.to_reference(np.array(ours.calibration_s))
    return calibrate_file(reference, (float(start_s), float(end_s)))


def _place(task: TaskWindow, alignment: Alignment) -> TaskWindow:
    """Convert a task to the recording's clock."""
    if task.clock == "recording":
        return task
    start_s, end_s = alignment.to_recording(np.array([task.start_s, task.end_s])).tolist()
    return replace(task, start_s=start_s, end_s=end_s)


def _compare_tasks(pairs: Pairs, tasks: tuple[TaskWindow, ...]) -> tuple[TaskAgreement, ...]:
    found = []
    for name in dict.fromkeys(task.name for task in tasks):
        windows = [task for task in tasks if task.name == name]
        parts = [pairs.cut(task.start_s, task.end_s) for task in windows]
        limits = compute_repeated_limits([_measure(part) for part in parts])
        pooled = _measure(join_pairs(parts))
        found.append(TaskAgreement(name, windows[0].paper_task, len(windows), pooled, limits))
    return tuple(found)


def _measure(pairs: Pairs) -> Agreement:
    return measure_agreement(pairs.ours_deg, pairs.reference_deg, pairs.duration_s)
