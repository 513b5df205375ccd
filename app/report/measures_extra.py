"""Tables of long stays, rest, frequency and variation."""

from __future__ import annotations

from collections.abc import Sequence

from app.report.numbers import (
    NONE,
    format_duration,
    format_number,
    format_percent,
    format_range,
    format_rate,
)
from app.report.parts import Table
from app.report.wording import Language, Words
from fusion.conventions import CONVENTIONS
from fusion.exposure.types import Episodes, Exposure


def list_extra_measures(exposure: Exposure, entry: Words, language: Language) -> tuple[Table, ...]:
    """List the tables; one without rows is left out by the caller."""
    return (
        _tabulate_long_stays(exposure, entry["long_stays"], language),
        _tabulate_recovery(exposure, entry["recovery"], language),
        _tabulate_variation(exposure, entry["variation"], language),
        _tabulate_conventions(exposure, entry["conventions"], language),
    )


def _make(entry: Words, rows: Sequence[tuple[str, ...]]) -> Table:
    """Make a table; a last column in which nothing stands (no interval anywhere) is left out."""
    width = len(entry["columns"]) - all(row[-1] == NONE for row in rows)
    kept = tuple(row[:width] for row in rows)
    return Table(entry["caption"], tuple(entry["columns"][:width]), kept, note=entry["note"])


def _tabulate_long_stays(exposure: Exposure, entry: Words, language: Language) -> Table:
    """Say how much time was spent in stays longer than 5, 10, 30 and 60 s."""
    rows = [
        (
            f"{item.threshold_deg:g}°",
            _add_range(format_rate(item.per_hour, language), item, "per_h", exposure, language),
            _add_range(format_duration(item.p90_s, language), item, "p90_s", exposure, language),
            *(format_duration(total_s, language) for _, total_s in item.longer_s),
        )
        for item in exposure.episodes
        if item.longer_s
    ]
    return _make(entry, rows)


def _add_range(told: str, item: Episodes, end: str, exposure: Exposure, language: Language) -> str:
    interval = exposure.intervals.get(f"episodes_above_{item.threshold_deg:g}_{end}")
    if interval is None:
        return told
    tell = format_rate if end == "per_h" else format_duration
    return f"{told} ({tell(interval.low, language)}–{tell(interval.high, language)})"


def _tabulate_recovery(exposure: Exposure, entry: Words, language: Language) -> Table:
    recovery, frequency = exposure.recovery, exposure.frequency
    figures: list[tuple[str, float | None, str]] = []
    if recovery is not None:
        figures += [
            ("neutral", recovery.neutral_slow_percent, "recovery_neutral_slow_percent"),
            ("neutral_per_h", recovery.neutral_slow_per_hour, "recovery_neutral_slow_per_h"),
            ("slow", recovery.slow_percent, "recovery_slow_percent"),
            ("without", recovery.longest_without_s, "recovery_longest_without_s"),
        ]
    if frequency is not None:
        crossings = "inclination_velocity_zero_crossings_per_h"
        figures += [
            ("crossings", frequency.crossings_per_hour, crossings),
            ("mpf", frequency.mean_power_hz, "inclination_velocity_mpf_hz"),
        ]
    rows = [
        (entry["row"][key], tell_figure(value, name, language), tell_interval(exposure, name, language))
        for key, value, name in figures
        if value is not None
    ]
    return _make(entry, rows)


def tell_figure(value: float, name: str, language: Language) -> str:
    """Write a figure in the unit that its name ends in."""
    if name.endswith("_percent"):
        return format_percent(value, language)
    if name.endswith("_hz"):
        return f"{format_number(value, 2, language)}\u202fHz"
    return format_duration(value, language) if name.endswith("_s") else format_rate(value, language)


def tell_interval(exposure: Exposure, name: str, language: Language) -> str:
    """Write the range of a figure; a dash where none is known."""
    interval = exposure.intervals.get(name)
    if interval is None:
        return NONE
    return f"{tell_figure(interval.low, name, language)}–{tell_figure(interval.high, name, language)}"


def _tabulate_conventions(exposure: Exposure, entry: Words, language: Language) -> Table:
    rows = [
        (
            entry["name"][convention.key],
            f"{part.lower_deg:g}–{part.upper_deg:g}°",
            format_duration(part.duration_s, language),
            format_percent(part.percent, language),
            format_range(part.interval, language) or NONE,
        )
        for convention in CONVENTIONS
        for part in exposure.conventions.get(convention.key, ())
    ]
    return _make(entry, rows)


def _tabulate_variation(exposure: Exposure, entry: Words, language: Language) -> Table:
    rows = [
        (
            entry["figure"][name],
            format_percent(item.coefficient_percent, language),
            format_number(item.spread, 1, language),
            format_number(item.last_less_first, 1, language),
        )
        for name, item in exposure.hour_variation.items()
    ]
    return _make(entry, rows)
