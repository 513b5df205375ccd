"""Tables of long stays, rest, frequency and variation."""

from __future__ import annotations

from collections.abc import Sequence

from app.report.numbers import format_duration, format_number, format_percent, format_rate
from app.report.parts import Table
from app.report.wording import Language, Words
from fusion.exposure.types import Episodes, Exposure


def list_extra_measures(exposure: Exposure, entry: Words, language: Language) -> tuple[Table, ...]:
    """List the tables; one without rows is left out by the caller."""
    return (
        _tabulate_long_stays(exposure, entry["long_stays"], language),
        _tabulate_recovery(exposure, entry["recovery"], language),
        _tabulate_variation(exposure, entry["variation"], language),
    )


def _make(entry: Words, rows: Sequence[tuple[str, ...]]) -> Table:
    return Table(entry["caption"], tuple(entry["columns"]), tuple(rows), note=entry["note"])


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
    recovery, frequency, row = exposure.recovery, exposure.frequency, entry["row"]
    rows: list[tuple[str, ...]] = []
    if recovery is not None:
        rows += [
            (row["neutral"], format_percent(recovery.neutral_slow_percent, language)),
            (row["neutral_per_h"], format_rate(recovery.neutral_slow_per_hour, language)),
            (row["slow"], format_percent(recovery.slow_percent, language)),
            (row["without"], format_duration(recovery.longest_without_s, language)),
        ]
    if frequency is not None:
        mpf = frequency.mean_power_hz
        rows.append((row["crossings"], format_rate(frequency.crossings_per_hour, language)))
        if mpf is not None:
            rows.append((row["mpf"], f"{format_number(mpf, 2, language)}\u202fHz"))
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
