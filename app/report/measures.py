"""Tables of every figure, each with its interval where the exposure carries one."""

from collections.abc import Sequence
from itertools import pairwise

from app.report.answers import format_range
from app.report.clock import Clock
from app.report.numbers import (
    NONE,
    format_angle,
    format_duration,
    format_number,
    format_percent,
    format_rate,
)
from app.report.parts import Table
from app.report.results import VELOCITIES
from app.report.wording import Language, Words, fill
from fusion.exposure import ElevationBin, Eva, Exposure, PeakWindow, TimeAbove


def list_measures(exposure: Exposure, clock: Clock, words: Words) -> tuple[Table, ...]:
    """List all figures as tables; a table without rows is left out."""
    language, entry = clock.language, words["measure"]
    tables = (
        _tabulate_bins(exposure.bins, entry, language),
        _tabulate_above(exposure.time_above, entry, language),
        _tabulate_percentiles(exposure, entry, language),
        _tabulate_entries(exposure, entry, language),
        _tabulate_cycles(exposure, entry, language),
        _tabulate_velocities(exposure, entry, language),
        _tabulate_windows(exposure.peak_windows, entry, clock),
        _tabulate_eva(exposure.eva, entry, language),
    )
    return tuple(table for table in tables if table.rows)


def _tabulate_bins(bins: Sequence[ElevationBin], entry: Words, language: Language) -> Table:
    rows = [(f"{b.lower_deg:g}–{b.upper_deg:g}°", *_tell_share(b, language)) for b in bins]
    return _tabulate(entry["bins"], rows)


def _tabulate_above(above: Sequence[TimeAbove], entry: Words, language: Language) -> Table:
    rows = [(f"≥ {t.threshold_deg:g}°", *_tell_share(t, language)) for t in above]
    return _tabulate(entry["time_above"], rows)


def _tell_share(item: ElevationBin | TimeAbove, language: Language) -> tuple[str, str, str]:
    told = format_range(item.interval, language) or NONE
    return format_duration(item.duration_s, language), format_percent(item.percent, language), told


def _tabulate_percentiles(exposure: Exposure, entry: Words, language: Language) -> Table:
    """Lay the percentiles out in one row, which is how they are compared."""
    ranks = sorted(exposure.percentiles_deg)
    if not ranks:
        return Table("", (), ())
    values = tuple(format_angle(exposure.percentiles_deg[p], language, 1) for p in ranks)
    columns = (entry["percentiles"]["column"], *(f"P{p}" for p in ranks))
    row = (entry["percentiles"]["row"], *values)
    return Table(entry["percentiles"]["caption"], columns, (row,), note=entry["percentiles"]["note"])


def _tabulate_entries(exposure: Exposure, entry: Words, language: Language) -> Table:
    episodes = {e.threshold_deg: e for e in exposure.episodes}
    rows = []
    for item in exposure.entries:
        stay = episodes.get(item.threshold_deg)
        row = (
            f"{item.threshold_deg:g}°",
            format_number(item.count, 0, language),
            format_rate(item.per_hour, language),
            format_number(stay.count if stay else None, 0, language),
            format_duration(stay.median_s if stay else None, language),
            format_duration(stay.longest_s if stay else None, language),
            format_number(stay.censored if stay else None, 0, language),
        )
        rows.append(row)
    return _tabulate(entry["entries"], rows)


def _tabulate_cycles(exposure: Exposure, entry: Words, language: Language) -> Table:
    rows = [
        (
            f"{c.lower_deg:g}–{c.upper_deg:g}°" if c.upper_deg is not None else f"≥ {c.lower_deg:g}°",
            format_number(c.count, 1, language),
        )
        for c in exposure.cycles
    ]
    return _tabulate(entry["cycles"], rows)


def _tabulate_velocities(exposure: Exposure, entry: Words, language: Language) -> Table:
    rows = []
    for kind in VELOCITIES:
        velocity = exposure.velocity_dps.get(kind)
        if velocity is not None:
            values = (
                velocity.p10_dps,
                velocity.p50_dps,
                velocity.p90_dps,
                velocity.p99_dps,
                velocity.mean_dps,
            )
            told = (format_number(value, 1, language) for value in values)
            rows.append((entry["velocities"]["kind"][kind], *told))
    return _tabulate(entry["velocities"], rows)


def _tabulate_windows(windows: Sequence[PeakWindow], entry: Words, clock: Clock) -> Table:
    rows = [
        (
            format_duration(window.length_s, clock.language).replace("1\u202fh", "60\u202fmin"),
            _tell_window(window, clock),
            format_percent(window.percent_above_60, clock.language),
        )
        for window in windows
    ]
    return _tabulate(entry["windows"], rows)


def _tell_window(window: PeakWindow, clock: Clock) -> str:
    if window.start_s is None:
        return NONE
    return f"{clock.tell(window.start_s)}–{clock.tell(window.start_s + window.length_s)}"


def _tabulate_eva(eva: Eva, entry: Words, language: Language) -> Table:
    """Lay out exposure variation analysis: angle class by how long the arm stayed in it."""
    if not eva.percent.size:
        return Table("", (), ())
    columns = (entry["eva"]["column"], *_name_classes(eva.duration_edges_s, "s"))
    names = _name_classes(eva.angle_edges_deg, "°")
    rows = tuple(
        (name, *(format_number(float(cell), 1, language) for cell in row))
        for name, row in zip(names, eva.percent, strict=True)
    )
    return Table(entry["eva"]["caption"], columns, rows, note=entry["eva"]["note"])


def _name_classes(edges: Sequence[float | None], unit: str) -> tuple[str, ...]:
    end = unit if unit == "°" else f"\u202f{unit}"
    names = []
    for low, high in pairwise(edges):
        names.append(f"≥ {low:g}{end}" if high is None else f"{low:g}–{high:g}{end}")
    return tuple(names)


def _tabulate(entry: Words, rows: Sequence[tuple[str, ...]]) -> Table:
    """Make a table; a column in which nothing stands (no interval anywhere) is left out."""
    columns = tuple(entry["columns"])
    kept = [i for i in range(len(columns)) if i < 2 or any(row[i] != NONE for row in rows)]
    return Table(
        fill(entry["caption"], {}),
        tuple(columns[i] for i in kept),
        tuple(tuple(row[i] for i in kept) for row in rows),
        note=entry.get("note", ""),
    )
