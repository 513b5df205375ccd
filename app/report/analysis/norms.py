"""Published values beside the measured ones, or the reason why the two cannot be compared.

Each reference value was read in its source (EXPOSURE.md A10). The velocity proposal was made from
accelerometers, so that only ``generalised_accelerometer`` is compared with it: a fused velocity reads two to
four times lower and would reassure falsely (Fan et al. 2021).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil

from app.report.charts.bars import Scale, draw_scale
from app.report.findings import Findings
from app.report.model import Reference
from app.report.words.numbers import (
    format_angle_range,
    format_number,
    format_percent,
    format_range,
    percent_sign,
)
from app.report.words.wording import Language, Words, fill
from fusion.comparison import REFERENCES, WHOLE_DAY_S, find_measured
from fusion.exposure.types import Exposure, Interval
from fusion.recording import MICROSECONDS

LIMITS = {reference.key: reference for reference in REFERENCES}


@dataclass(frozen=True, slots=True)
class _Measured:
    """A reference's key in the wording, its limits, and what was measured; None: not computed."""

    key: str
    unit: str
    end: float
    low: float | None
    high: float
    value: float | None
    interval: Interval | None = None


def compare_with_references(findings: Findings, words: Words, language: Language) -> tuple[Reference, ...]:
    """Set the measured figures beside each reference."""
    reason = find_reason(findings)
    return tuple(_compare(item, reason, words, language) for item in _measure(findings.exposure))


def _measure(exposure: Exposure) -> tuple[_Measured, ...]:
    above = {t.threshold_deg: (t.percent, t.interval) for t in exposure.time_above}
    p99, p99_interval = exposure.elevation_p99_deg, exposure.intervals.get("elevation_p99_deg")
    return (
        _Measured("above_30", "percent", 100, None, LIMITS["above_30"].high, *above.get(30, (None, None))),
        _Measured("above_60", "percent", 40, None, LIMITS["above_60"].high, *above.get(60, (None, None))),
        _Measured("velocity", "dps", 180, None, LIMITS["velocity"].high, find_measured("velocity", exposure)),
        _Measured("p99", "deg", 180, LIMITS["p99"].low, LIMITS["p99"].high, p99, p99_interval),
    )


def find_reason(findings: Findings) -> str:
    """Give the reason why no figure can be compared; empty where they can."""
    if findings.time.analysed_us < WHOLE_DAY_S * MICROSECONDS:
        return "short"
    return "poor" if findings.quality.verdict == "poor" else ""


def _compare(item: _Measured, reason: str, words: Words, language: Language) -> Reference:
    entry, common = words["reference"][item.key], words["comparison"]
    if item.value is None:
        reason = "not_computed"
    if reason:
        why = common["reason"][f"{reason}_{item.key}" if reason == "not_computed" else reason]
        statement = fill(common["does_not_apply"], {"reason": why})
        return Reference(entry["name"], entry["source"], statement, "", "")
    facts = _format_values(item, language)
    statement = fill(entry["statement"], facts)
    scale = _draw(item, entry, facts, words, language)
    return Reference(entry["name"], entry["source"], statement, statement, scale)


def _format_values(item: _Measured, language: Language) -> dict[str, str]:
    """Write the measured value with our decimals and the published one as it was published."""
    value = _format_published(item.value, item.unit, language)
    if item.unit == "percent":
        value = format_percent(item.value, language)
    told = format_range if item.unit == "percent" else format_angle_range
    low = _format_published(item.low, item.unit, language) if item.low is not None else ""
    return {
        "value": value,
        "high": _format_published(item.high, item.unit, language),
        "low": low,
        "range": told(item.interval, language),
    }


def _format_published(value: float | None, unit: str, language: Language) -> str:
    sign = {"percent": percent_sign(language), "deg": "°", "dps": "°/s"}[unit]
    return f"{format_number(value, 0, language)}{sign}"


def _find_end(item: _Measured) -> float:
    """Give the end of the scale: further than usual, to a ten, where the measured value needs it."""
    if item.unit == "deg" or item.value is None:
        return item.end
    further = extend_scale(item.end, item.value * 1.1)
    return min(further, 100.0) if item.unit == "percent" else further


def extend_scale(end: float, largest: float) -> float:
    """Give the end of a scale that must hold ``largest``: the usual one, or the next ten."""
    return end if largest <= end else 10.0 * ceil(largest / 10.0)


def _draw(
    item: _Measured, entry: Mapping[str, str], facts: Mapping[str, str], words: Words, language: Language
) -> str:
    end = _find_end(item)
    scale = Scale(
        key=f"ref-{item.key.replace('_', '-')}",
        words=(entry["name"], fill(entry["statement"], facts)),
        end=end,
        end_labels=("0", _format_published(end, item.unit, language)),
        low=item.low,
        high=item.high,
        high_label=fill(words["comparison"][f"mark_{item.unit}"], facts),
        measured=item.value or 0.0,
        measured_label=fill("{value}[ ({range})]", facts),
        interval=(item.interval.low, item.interval.high) if item.interval else None,
    )
    return draw_scale(scale)
