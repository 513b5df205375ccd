"""Several people, tasks and devices together: means and standard deviations over people, as in Table 1."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isfinite, nan

import numpy as np

from fusion.agreement.statistics import Agreement, Limits, find_repeated_limits, find_sd


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
