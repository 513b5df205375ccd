"""Tables of every figure, each with its interval where the exposure carries one."""

from __future__ import annotations

from collections.abc import Sequence

from app.report.figures import (
    CYCLES,
    ENTRIES,
    EPISODES,
    PERCENTILES,
    REST_TABLE,
    SINGLE_GROUPS,
    VELOCITIES,
    VELOCITY,
    WINDOWS,
    format_figure,
    format_figure_range,
)
from app.report.model import Table
from app.report.single.context import Context
from app.report.words.numbers import (
    NONE,
    format_angle,
    format_angle_range,
    format_duration,
    format_ends,
    format_number,
    format_percent,
    format_range,
    format_rate,
)
from app.report.words.wording import Language, Words, fill
from fusion.conventions import CONVENTIONS
from fusion.exposure.types import ElevationBin, Exposure, TimeAbove

Rows = list[tuple[str, ...]]


def build_measures(context: Context) -> tuple[Table, ...]:
    """Build the tables of all figures; a table without rows is left out."""
    exposure, language, entry = context.exposure, context.language, context.words["measure"]
    bins = [(f"{b.lower_deg:g}–{b.upper_deg:g}°", *_format_share(b, language)) for b in exposure.bins]
    above = [(f"≥ {t.threshold_deg:g}°", *_format_share(t, language)) for t in exposure.time_above]
    tables = (
        _tabulate(entry["bins"], bins),
        _tabulate(entry["time_above"], above),
        _tabulate(entry["cycles"], _list_cycles(exposure, language)),
        _tabulate(entry["windows"], _list_windows(context)),
        _tabulate_percentiles(exposure, entry["percentiles"], language),
        _tabulate(entry["entries"], _list_entries(exposure, entry["percentiles"], language)),
        _tabulate(entry["long_stays"], _list_long_stays(exposure, language), droppable=_LAST),
        _tabulate(entry["velocities"], _list_velocities(exposure, entry, language)),
        _tabulate(
            entry["recovery"], _list_rest(exposure, entry["recovery"]["row"], language), droppable=_LAST
        ),
        _tabulate(
            entry["variation"],
            _list_variation(exposure, entry["variation"]["figure"], language),
            droppable=_LAST,
        ),
        _tabulate(entry["conventions"], _list_conventions(exposure, entry["conventions"]["name"], language)),
    )
    return tuple(table for table in tables if table.rows)


_FROM_THIRD, _LAST = slice(2, None), slice(-1, None)


def _tabulate(entry: Words, rows: Sequence[tuple[str, ...]], droppable: slice = _FROM_THIRD) -> Table:
    """Make a table; a ``droppable`` column in which nothing stands (no interval anywhere) is left out."""
    columns = tuple(entry["columns"])
    places = range(len(columns))
    empty = [i for i in places[droppable] if all(row[i] == NONE for row in rows)]
    kept = [i for i in places if i not in empty]
    return Table(
        fill(entry["caption"], {}),
        tuple(columns[i] for i in kept),
        tuple(tuple(row[i] for i in kept) for row in rows),
        note=entry.get("note", ""),
    )


def _format_share(item: ElevationBin | TimeAbove, language: Language) -> tuple[str, str, str, str]:
    """Write time, share, its range, and the one that also holds the error of the pose."""
    posed = item.interval.with_pose if item.interval else None
    known, pose = (format_range(interval, language) or NONE for interval in (item.interval, posed))
    return format_duration(item.duration_s, language), format_percent(item.percent, language), known, pose


def _tabulate_percentiles(exposure: Exposure, said: Words, language: Language) -> Table:
    """Tabulate the percentiles in one row, which is how they are compared, with their ranges below."""
    ranks = sorted(exposure.percentiles_deg)
    if not ranks:
        return Table("", (), ())
    intervals = [exposure.intervals.get(PERCENTILES[""].spell({"name": p})) for p in ranks]
    posed = [interval.with_pose if interval else None for interval in intervals]
    rows = [(said["row"], *(format_angle(exposure.percentiles_deg[p], language, 1) for p in ranks))]
    for name, ranges in (("range", intervals), ("pose", posed)):
        if any(ranges):
            rows.append((said[name], *(format_angle_range(i, language) or NONE for i in ranges)))
    columns = (said["column"], *(f"P{p}" for p in ranks))
    return Table(said["caption"], columns, tuple(rows), note=said["note"])


def _list_entries(exposure: Exposure, said: Words, language: Language) -> Rows:
    episodes, rows = {e.threshold_deg: e for e in exposure.episodes}, []
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
        above = {"threshold_deg": item.threshold_deg}
        per_h = ENTRIES["per_hour"].spell(above)
        median, longest = (EPISODES[key].spell(above) for key in ("median_s", "longest_s"))
        rows += [row, *_list_ranges(exposure, ("", per_h, "", median, longest, ""), said, language)]
        interval = exposure.intervals.get(per_h)
        posed = interval.with_pose if interval else None
        if posed:  # the range of the rate that holds the error of the pose
            ends = "–".join(format_rate(end, language) for end in (posed.low, posed.high))
            rows.append((said["pose"], "", ends, "", "", "", ""))
    return rows


def _list_ranges(exposure: Exposure, names: Sequence[str], said: Words, language: Language) -> Rows:
    """Return the row of ranges under a row of figures, in its units; none where none is known."""
    intervals = [exposure.intervals.get(name) for name in names]
    if not any(intervals):
        return []
    cells = (
        "–".join(_format_end(end, name, language) for end in (interval.low, interval.high))
        if interval
        else ""
        for name, interval in zip(names, intervals, strict=True)
    )
    return [(said["range"], *cells)]


def _format_end(value: float, name: str, language: Language) -> str:
    if name.endswith("_per_h"):
        return format_rate(value, language)
    if name.endswith("_s"):
        return format_duration(value, language)
    return format_number(value, 0 if value >= 99.95 else 1, language)  # a wide range stays on its line


def _list_cycles(exposure: Exposure, language: Language) -> Rows:
    rows: Rows = []
    for c in exposure.cycles:
        name = f"{c.lower_deg:g}–{c.upper_deg:g}°" if c.upper_deg is not None else f"≥ {c.lower_deg:g}°"
        interval = exposure.intervals.get(CYCLES["count"].spell(CYCLES.describe(c)))
        told = format_ends(interval, 1, language) or NONE
        rows.append((name, format_number(c.count, 1, language), told))
    return rows


def _list_velocities(exposure: Exposure, entry: Words, language: Language) -> Rows:
    rows: Rows = []
    for kind in VELOCITIES:
        velocity = exposure.velocity_dps.get(kind)
        if velocity is not None:
            values = VELOCITY.name_values(velocity, kind)
            told = (format_number(value, 1, language) for value in values.values())
            rows.append((entry["velocities"]["kind"][kind], *told))
            rows += _list_ranges(exposure, list(values), entry["percentiles"], language)
    return rows


def _list_windows(context: Context) -> Rows:
    exposure, clock, language = context.exposure, context.clock, context.language
    rows: Rows = []
    for window in exposure.peak_windows:
        length = format_duration(window.length_s, language).replace("1\u202fh", "60\u202fmin")
        place, share = NONE, format_percent(window.percent_above_60, language)
        if window.start_s is not None:
            place = "–".join(clock.format(window.start_s + at_s) for at_s in (0, window.length_s))
        interval = exposure.intervals.get(WINDOWS["percent_above_60"].spell({"length_s": window.length_s}))
        rows.append((length, place, f"{share} ({format_range(interval, language)})" if interval else share))
    return rows


def _list_long_stays(exposure: Exposure, language: Language) -> Rows:
    rows: Rows = []
    for item in exposure.episodes:
        if item.longer_s:
            stays = EPISODES.describe(item)
            rates = _format_range(exposure, EPISODES["per_hour"].spell(stays), language)
            lengths = _format_range(exposure, EPISODES["p90_s"].spell(stays), language)
            row = (
                f"{item.threshold_deg:g}°",
                format_rate(item.per_hour, language) + (f" ({rates})" if rates else ""),
                format_duration(item.p90_s, language) + (f" ({lengths})" if lengths else ""),
                *(format_duration(total_s, language) for _, total_s in item.longer_s),
            )
            rows.append(row)
    return rows


def _list_rest(exposure: Exposure, names: Words, language: Language) -> Rows:
    values = {
        name: value
        for group in SINGLE_GROUPS
        if (record := getattr(exposure, group.key)) is not None
        for name, value in group.name_values(record).items()
    }
    return [
        (
            names[name],
            format_figure(values[name], name, language),
            _format_range(exposure, name, language) or NONE,
        )
        for name in REST_TABLE
        if values.get(name) is not None
    ]


def _format_range(exposure: Exposure, name: str, language: Language) -> str:
    interval = exposure.intervals.get(name)
    return format_figure_range(interval, name, language) if interval else ""


def _list_conventions(exposure: Exposure, names: Words, language: Language) -> Rows:
    return [
        (
            names[convention.key],
            f"{part.lower_deg:g}–{part.upper_deg:g}°",
            *_format_share(part, language)[1:],
        )
        for convention in CONVENTIONS
        for part in exposure.conventions.get(convention.key, ())
    ]


def _list_variation(exposure: Exposure, names: Words, language: Language) -> Rows:
    return [
        (
            names[name],
            format_percent(item.coefficient_percent, language),
            format_number(item.spread, 1, language),
            format_number(item.last_less_first, 1, language),
        )
        for name, item in exposure.hour_variation.items()
    ]
