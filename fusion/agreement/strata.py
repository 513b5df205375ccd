"""The error by how high the arm was and how fast it moved, both as the reference saw them."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fusion.agreement.pairing import PairedRun, Pairs
from fusion.agreement.runs import Vector
from fusion.agreement.statistics import Agreement, measure_agreement

ELEVATION_EDGES_DEG = (0.0, 30.0, 60.0, 90.0, 120.0, 180.0)
SPEED_EDGES_DPS = (0.0, 10.0, 30.0, 90.0, 180.0, float("inf"))
SPEED_SPAN_S = 0.1
"""The speed is taken over a tenth of a second, so that the noise of single samples is no speed."""


@dataclass(frozen=True, slots=True)
class Stratum:
    """Rows with ``lower <= value < upper``; the last class holds its upper edge too."""

    lower: float
    upper: float
    percent: float
    agreement: Agreement


def divide_by_elevation(pairs: Pairs) -> tuple[Stratum, ...]:
    """Divide by the reference's elevation."""
    return _divide(pairs, pairs.reference_deg, ELEVATION_EDGES_DEG)


def divide_by_speed(pairs: Pairs) -> tuple[Stratum, ...]:
    """Divide by the size of the reference's rate of change."""
    speeds = [measure_speed(run) for run in pairs.runs]
    return _divide(pairs, np.concatenate(speeds) if speeds else np.zeros(0), SPEED_EDGES_DPS)


def measure_speed(run: PairedRun) -> Vector:
    """Size of the change over a tenth of a second about each row, deg/s; at the ends over what there is."""
    reach = max(1, round(SPEED_SPAN_S * run.rate_hz / 2))
    rows = np.arange(len(run))
    first, last = np.maximum(rows - reach, 0), np.minimum(rows + reach, len(run) - 1)
    seconds = np.maximum(last - first, 1) / run.rate_hz
    return np.asarray(np.abs(run.reference_deg[last] - run.reference_deg[first]) / seconds)


def _divide(pairs: Pairs, values: Vector, edges: tuple[float, ...]) -> tuple[Stratum, ...]:
    ours, reference = pairs.ours_deg, pairs.reference_deg
    share = 100.0 / max(len(ours), 1)
    strata = []
    for lower, upper in pairwise(edges):
        inside = (values >= lower) & ((values < upper) | ((upper == edges[-1]) & (values <= upper)))
        count = int(np.count_nonzero(inside))
        agreement = measure_agreement(ours[inside], reference[inside], count / pairs.rate_hz)
        strata.append(Stratum(lower, upper, count * share, agreement))
    return tuple(strata)
