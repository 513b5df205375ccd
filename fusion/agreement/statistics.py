"""How far two angles agree. ``ours`` and ``reference`` are always shape (n,), deg, at the same moments.

Pearson's r, root mean square and mean absolute error: as in Table 1 of the source paper. Bias and limits of
agreement: Bland and Altman 1986; with repeated measures, Bland and Altman 2007, section 3 (the true value
varies). ICC(A,1): McGraw and Wong 1996, two-way, absolute agreement, one measurement (Shrout and Fleiss's
ICC(2,1)). Concordance: Lin 1989.

r, ICC and concordance compare the error with the spread of the angle. Where the angle hardly moves they
do not measure the error, so they are not given (NaN) where the reference is quasi-static: its standard
deviation below 5 deg. The paper leaves r out of its quasi-static tasks without naming a rule.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite, nan, sqrt

import numpy as np

from fusion.recording import Float64Array

QUASI_STATIC_DEG = 5.0
LIMIT_SD = 1.96


@dataclass(frozen=True, slots=True)
class Agreement:
    """Agreement over some rows; ``bias_deg`` is ours minus reference. NaN is "not computable"."""

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
    bias, sd = float(error.mean()), find_sd(error)
    reference_sd = find_sd(reference_deg)
    moves = reference_sd >= QUASI_STATIC_DEG
    return Agreement(
        count=len(error),
        duration_s=duration_s,
        r=find_r(ours_deg, reference_deg) if moves else nan,
        rmse_deg=float(np.sqrt(np.mean(error**2))),
        mean_absolute_error_deg=float(np.abs(error).mean()),
        bias_deg=bias,
        sd_deg=sd,
        loa_low_deg=bias - LIMIT_SD * sd,
        loa_high_deg=bias + LIMIT_SD * sd,
        icc=find_icc(ours_deg, reference_deg) if moves else nan,
        concordance=find_concordance(ours_deg, reference_deg) if moves else nan,
        reference_sd_deg=reference_sd,
    )


def find_sd(values: Float64Array) -> float:
    """Sample standard deviation; NaN of fewer than two."""
    return float(values.std(ddof=1)) if len(values) > 1 else nan


def find_r(a: Float64Array, b: Float64Array) -> float:
    """Pearson's correlation; NaN where one does not vary."""
    u, v = a - a.mean(), b - b.mean()
    size = sqrt(float(u @ u) * float(v @ v))
    return float(u @ v) / size if size > 0 else nan


def find_concordance(a: Float64Array, b: Float64Array) -> float:
    """Lin's coefficient: 2 s_ab / (s_a^2 + s_b^2 + (mean_a - mean_b)^2), variances over n."""
    apart = float(a.mean() - b.mean()) ** 2 + float(a.var()) + float(b.var())
    return 2.0 * float(np.mean((a - a.mean()) * (b - b.mean()))) / apart if apart > 0 else nan


def find_icc(a: Float64Array, b: Float64Array) -> float:
    """ICC(A,1): (MSR - MSE) / (MSR + MSE + 2 (MSC - MSE) / n), for two measurements of n moments."""
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


def find_repeated_limits(groups: Sequence[Agreement]) -> Limits:
    """Return limits of agreement for several people (or repetitions) with many rows each.

    One-way analysis of variance of the differences: within = MSW, between = (MSB - MSW) / m0 with
    m0 = (N^2 - sum m_i^2) / ((k - 1) N); limits = mean of all rows +- 1.96 sqrt(between + within). With one
    group they are the plain limits. Groups without rows are left out.
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
    """Mean and sample standard deviation over people; ``people`` is how many have the figure."""

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
    """Return a cell for each task and device, tasks in the paper's order first, then as they come."""
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
        find_repeated_limits([entry.agreement for entry in entries]),
    )


def _average(agreements: Sequence[Agreement], name: str) -> float:
    """Return a person's own mean of a statistic, where several recordings hold the task."""
    known = [value for agreement in agreements if isfinite(value := float(getattr(agreement, name)))]
    return sum(known) / len(known) if known else nan


def spread(values: Iterable[float]) -> Spread:
    """Mean and sample standard deviation of what is known; NaN where most people do not have the figure.

    So r is not given for a task that is quasi-static for most, because one person moved a little more.
    """
    every = list(values)
    known = np.array([value for value in every if isfinite(value)])
    if 2 * len(known) <= len(every):
        return Spread(nan, nan, len(known))
    return Spread(float(known.mean()), find_sd(known), len(known))
