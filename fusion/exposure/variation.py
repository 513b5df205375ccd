"""How the exposure varies: from hour to hour (EXPOSURE.md A8) and in the EVA matrix (A6)."""

from collections.abc import Sequence

import numpy as np

from fusion.exposure.types import Eva, EvaSummary, HourVariation, PartExposure

LEAST_ANALYSED_S = 1800.0
MIDDLE_OF_LONGEST_S = 255.0 * 1.5


def describe_hours(hours: Sequence[PartExposure]) -> dict[str, HourVariation]:
    """Compare the clock hours of which half an hour or more was analysed; nothing with fewer than two."""
    kept = [hour for hour in hours if hour.analysed_s >= LEAST_ANALYSED_S]
    if len(kept) < 2:
        return {}
    return {
        "elevation_p50_deg": _describe([hour.percentiles_deg[50] for hour in kept]),
        "time_above_60_percent": _describe([hour.percent_above[60] for hour in kept]),
        "entries_above_60_per_h": _describe([hour.entries_above_60_per_h or 0.0 for hour in kept]),
    }


def _describe(values: list[float]) -> HourVariation:
    """Coefficient of variation with the sample's standard deviation; None about a mean of nought."""
    mean = float(np.mean(values))
    return HourVariation(
        hours=len(values),
        coefficient_percent=100.0 * float(np.std(values, ddof=1)) / mean if mean > 0 else None,
        spread=max(values) - min(values),
        last_less_first=values[-1] - values[0],
    )


def summarise_eva_matrix(eva: Eva) -> EvaSummary:
    """Give the marginals, the standard deviation of the cells and the centroid of the matrix.

    The centroid is in degrees (middles of the angle classes) and seconds (middles of the duration classes;
    the last, without an end, at one and a half times its beginning).
    """
    angles = np.array(eva.angle_edges_deg)
    ends = [edge if edge is not None else 2 * MIDDLE_OF_LONGEST_S - 255.0 for edge in eva.duration_edges_s]
    by_angle, by_duration = eva.percent.sum(axis=1), eva.percent.sum(axis=0)
    durations = np.array(ends)
    return EvaSummary(
        by_angle_percent=tuple(by_angle.tolist()),
        by_duration_percent=tuple(by_duration.tolist()),
        cell_sd_percent=float(eva.percent.std()),
        centroid_deg=float(by_angle @ (angles[:-1] + angles[1:]) / 200.0),
        centroid_s=float(by_duration @ (durations[:-1] + durations[1:]) / 200.0),
    )
