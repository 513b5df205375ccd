"""The figures of ``results.json`` beyond those of the first contract; names are only ever added."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from fusion.conventions import CONVENTIONS, Convention
from fusion.exposure.types import (
    ElevationBin,
    Episodes,
    EvaSummary,
    Exposure,
    Frequency,
    HourVariation,
    Interval,
    Recovery,
)


def pick(record: object, *names: str) -> dict[str, object]:
    """Lay out the fields of a record that stand in the results under their own names, in this order."""
    return {name: getattr(record, name) for name in names}


def describe_episodes(episodes: Episodes) -> dict[str, object]:
    """Lay out the stays above one threshold."""
    names = ("threshold_deg", "count", "longest_s", "median_s", "per_hour", "total_s", "p90_s", "censored")
    longer = [{"than_s": limit_s, "total_s": total_s} for limit_s, total_s in episodes.longer_s]
    return {**pick(episodes, *names), "longer": longer}


def describe_extra(exposure: Exposure) -> dict[str, object]:
    """Lay out rest, frequency, variation (None where the exposure does not carry them) and conventions."""
    return {
        "recovery": _describe_recovery(exposure.recovery),
        "frequency": _describe_frequency(exposure.frequency),
        "variation": {
            "by_hour": _describe_variation(exposure.hour_variation),
            "eva": _describe_eva_summary(exposure.eva_summary),
        },
        "conventions": [
            _describe_convention(item, exposure.conventions[item.key])
            for item in CONVENTIONS
            if item.key in exposure.conventions
        ],
    }


def _describe_convention(convention: Convention, classes: Sequence[ElevationBin]) -> dict[str, object]:
    """Lay out the time in the classes of a standard or method."""
    return {
        "key": convention.key,
        "source": convention.source,
        "evidence": convention.evidence,
        "classes": [describe_bin(part) for part in classes],
    }


def describe_bin(part: ElevationBin) -> dict[str, object]:
    """Lay out the time between two angles."""
    return {
        "lower_deg": part.lower_deg,
        "upper_deg": part.upper_deg,
        "duration_s": part.duration_s,
        "percent": part.percent,
        **describe_interval(part.interval),
    }


def describe_interval(interval: Interval | None) -> dict[str, object]:
    """Lay out the range of a figure that has one of its own."""
    if interval is None:
        return {"low": None, "high": None}
    return {"low": interval.low, "high": interval.high}


def _describe_recovery(recovery: Recovery | None) -> dict[str, object] | None:
    if recovery is None:
        return None
    return {
        "neutral_slow_percent": recovery.neutral_slow_percent,
        "neutral_slow_per_h": recovery.neutral_slow_per_hour,
        "slow_percent": recovery.slow_percent,
        "slow_per_h": recovery.slow_per_hour,
        "longest_without_s": recovery.longest_without_s,
    }


def _describe_frequency(frequency: Frequency | None) -> dict[str, object] | None:
    if frequency is None:
        return None
    return {
        "inclination_velocity_mpf_hz": frequency.mean_power_hz,
        "inclination_velocity_zero_crossings_per_h": frequency.crossings_per_hour,
    }


def _describe_variation(figures: Mapping[str, HourVariation]) -> dict[str, object]:
    names = ("hours", "coefficient_percent", "spread", "last_less_first")
    return {figure: pick(item, *names) for figure, item in figures.items()}


def _describe_eva_summary(summary: EvaSummary | None) -> dict[str, object] | None:
    if summary is None:
        return None
    names = ("by_angle_percent", "by_duration_percent", "cell_sd_percent", "centroid_deg", "centroid_s")
    return pick(summary, *names)
