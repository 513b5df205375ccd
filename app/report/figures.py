"""Every figure of a recording, declared once: its name, its place in ``results.json``, and its tables.

A figure is a field of a record of :mod:`acromion.fusion.exposure.types`. To add one: compute it there, add an
entry to its group here (and to :data:`SUMMARY` or :data:`REST_TABLE`, if it belongs there), and one line to
``words/en.toml`` and ``words/fr.toml``, under its place in ``results.json``. The JSON, the CSV, Excel and
Parquet tables, the dictionary, the REDCap form and the FHIR bundle are built from the entries.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from acromion.app.report.words.numbers import (
    NARROW,
    format_angle,
    format_duration,
    format_number,
    format_percent,
    format_rate,
)
from acromion.app.report.words.wording import Language, fill, load_wording
from acromion.fusion.diary import NAMED

if TYPE_CHECKING:
    from acromion.app.report.export.tables import Cell, CellKind
    from acromion.fusion.exposure.types import Interval

Results = Mapping[str, Any]
"""The parsed ``results.json``."""

DECIMALS = 6
_PLACEHOLDER = re.compile(r"\{(\w+)\}")
RANGE_ENDS = ("_low", "_high", "_low_pose", "_high_pose")
"""Suffixes of range columns: the 95 % range, and the range with the error of the N-pose."""
_UNITS = {"percent": "%", "per_h": "1/h", "dps": "deg/s", "deg": "deg", "cdeg": "0.01 deg", "hz": "Hz"}
_UNITS |= {"s": "s", "us": "us"}


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure, of one record or of each record of a list.

    ``key``: its key in ``results.json``; empty if the value has no record around it. ``name``: its name as a
    column, as FHIR code and in ``exposure.intervals``, ending in the unit. A placeholder such as
    ``{threshold_deg}`` takes the value of that key in the same record, ``{name}`` the name of the record.
    Empty for a value that is not a figure (an edge) or already has another name. ``attribute``: the field of
    the record, if it differs from the key.
    """

    key: str
    name: str = ""
    attribute: str = ""

    def spell(self, record: Mapping[str, Any]) -> str:
        """Return the name for one record: ``time_above_60_percent``."""
        facts = {"length_min": record["length_s"] // 60, **record} if "length_s" in record else record

        def spell_edge(place: re.Match[str]) -> str:
            value = facts[place[1]]
            if value is None:
                return "up"  # no upper edge
            return value if isinstance(value, str) else f"{value:g}"

        return _PLACEHOLDER.sub(spell_edge, self.name)


@dataclass(frozen=True, slots=True)
class Group:
    """The figures of one kind of record; ``path`` is its place: ``[]`` any list item, ``*`` any name."""

    path: str
    figures: tuple[Figure, ...]

    @property
    def key(self) -> str:
        """The last step of the path."""
        return self.path.rpartition(".")[2]

    def __getitem__(self, key: str) -> Figure:
        """Return the figure with a key."""
        return next(figure for figure in self.figures if figure.key == key)

    def describe(self, record: object) -> dict[str, Any]:
        """Convert a record of the exposure to its form in ``results.json``."""
        return {f.key: getattr(record, f.attribute or f.key) for f in self.figures}

    def read(self, described: Mapping[str, Any]) -> dict[str, Any]:
        """Convert the result of :meth:`describe` back to the fields of a record."""
        return {f.attribute or f.key: described[f.key] for f in self.figures}

    def name_values(self, record: object, name: str = "") -> dict[str, Any]:
        """Return the figures of a record of the exposure by name."""
        described = {"name": name, **self.describe(record)}
        return {figure.spell(described): described[figure.key] for figure in self.figures if figure.name}


BINS = Group(
    "exposure.bins[]",
    (
        Figure("lower_deg"),
        Figure("upper_deg"),
        Figure("duration_s", "time_{lower_deg}_{upper_deg}_s"),
        Figure("percent", "time_{lower_deg}_{upper_deg}_percent"),
    ),
)
TIME_ABOVE = Group(
    "exposure.time_above[]",
    (
        Figure("threshold_deg"),
        Figure("duration_s", "time_above_{threshold_deg}_s"),
        Figure("percent", "time_above_{threshold_deg}_percent"),
    ),
)
PERCENTILES = Group("exposure.percentiles_deg.*", (Figure("", "elevation_p{name}_deg"),))
ENTRIES = Group(
    "exposure.entries[]",
    (
        Figure("threshold_deg"),
        Figure("count", "entries_above_{threshold_deg}_count"),
        Figure("per_hour", "entries_above_{threshold_deg}_per_h"),
        Figure("busy_minutes_percent", "entries_above_{threshold_deg}_busy_minutes_percent"),
    ),
)
CYCLES = Group(
    "exposure.cycles[]",
    (Figure("lower_deg"), Figure("upper_deg"), Figure("count", "cycles_{lower_deg}_{upper_deg}_count")),
)
EPISODES = Group(
    "exposure.episodes[]",
    (
        Figure("threshold_deg"),
        Figure("count", "episodes_above_{threshold_deg}_count"),
        Figure("longest_s", "episodes_above_{threshold_deg}_longest_s"),
        Figure("median_s", "episodes_above_{threshold_deg}_median_s"),
        Figure("per_hour", "episodes_above_{threshold_deg}_per_h"),
        Figure("total_s", "episodes_above_{threshold_deg}_total_s"),
        Figure("p90_s", "episodes_above_{threshold_deg}_p90_s"),
        Figure("censored", "episodes_above_{threshold_deg}_censored"),
    ),
)
VELOCITY = Group(
    "exposure.velocity_dps.*",
    (
        Figure("10", "{name}_velocity_p10_dps", "p10_dps"),
        Figure("50", "{name}_velocity_p50_dps", "p50_dps"),
        Figure("90", "{name}_velocity_p90_dps", "p90_dps"),
        Figure("99", "{name}_velocity_p99_dps", "p99_dps"),
        Figure("mean", "{name}_velocity_mean_dps", "mean_dps"),
    ),
)
VELOCITIES = ("inclination", "generalised", "generalised_accelerometer", "gyroscope")
"""Kinds of speed, in the order of ``results.json`` and of the report."""

WINDOWS = Group(
    "exposure.peak.windows[]",
    (Figure("start_s"), Figure("percent_above_60", "worst_{length_min}_min_above_60_percent")),
)
RECOVERY = Group(
    "exposure.recovery",
    (
        Figure("neutral_slow_percent", "recovery_neutral_slow_percent"),
        Figure("neutral_slow_per_h", "recovery_neutral_slow_per_h"),
        Figure("slow_percent", "recovery_slow_percent"),
        Figure("slow_per_h", "recovery_slow_per_h"),
        Figure("longest_without_s", "recovery_longest_without_s"),
    ),
)
FREQUENCY = Group(
    "exposure.frequency",
    (
        Figure("inclination_velocity_mpf_hz", "inclination_velocity_mpf_hz"),
        Figure("inclination_velocity_zero_crossings_per_h", "inclination_velocity_zero_crossings_per_h"),
    ),
)
HOUR_VARIATION = Group(
    "exposure.variation.by_hour.*",
    (
        Figure("hours", "by_hour_{name}_hours"),
        Figure("coefficient_percent", "by_hour_{name}_coefficient_percent"),
        Figure("spread", "by_hour_{name}_spread"),
        Figure("last_less_first", "by_hour_{name}_last_less_first"),
    ),
)
EVA_SUMMARY = Group(
    "exposure.variation.eva",
    (
        Figure("by_angle_percent"),
        Figure("by_duration_percent"),
        Figure("cell_sd_percent", "eva_cell_sd_percent"),
        Figure("centroid_deg", "eva_centroid_deg"),
        Figure("centroid_s", "eva_centroid_s"),
    ),
)
_FACTS = (
    Group(
        "recording",
        tuple(
            Figure(key, key)
            for key in (
                *("file_name", "subject", "side", "device", "start", "rate_hz", "sha256"),
                *("shift", "job_title", "isco_code"),
            )
        ),
    ),
    Group("time", tuple(Figure(key, key) for key in ("recorded_s", "analysed_s", "missing_s", "excluded_s"))),
    Group(
        "calibration",
        (
            Figure("state", "calibration_state"),
            Figure("pose", "pose"),
            Figure("sigma_deg", "pose_sigma_deg"),
        ),
    ),
    Group("method", (Figure("name", "method"), Figure("version", "method_version"))),
    Group("software", (Figure("version", "software_version"),)),
    Group("quality", (Figure("verdict", "verdict"),)),
    Group("origin", tuple(Figure(key, key) for key in ("path", "folder", "settings"))),
)
"""Facts about the recording; ``origin`` appears only in tables of many recordings."""

GROUPS = (
    *(BINS, TIME_ABOVE, PERCENTILES, ENTRIES, CYCLES, EPISODES, VELOCITY, WINDOWS, RECOVERY, FREQUENCY),
    *(HOUR_VARIATION, EVA_SUMMARY),
)
SINGLE_GROUPS = (RECOVERY, FREQUENCY)
"""Groups with at most one record in an exposure."""

PERIOD_FIGURES = ("episodes_above_60_longest_s", "recovery_neutral_slow_percent")
"""Further figures of periods and tasks; fields of :class:`acromion.fusion.exposure.types.PartExposure`."""
LESS_REST = "time_above_60_less_rest_percent"
"""Of a task: its share of time above 60 deg minus that of all other analysed time, in points."""

REST_TABLE = (
    "recovery_neutral_slow_percent",
    "recovery_neutral_slow_per_h",
    "recovery_slow_percent",
    "recovery_longest_without_s",
    "inclination_velocity_zero_crossings_per_h",
    "inclination_velocity_mpf_hz",
)
"""Rows of the report's table of rest and change of direction, from the single groups."""


def load_results(content: bytes | str) -> dict[str, Any]:
    """Parse ``results.json`` for tables and pages, with numbers rounded to six decimals."""
    results: dict[str, Any] = round_all(json.loads(content))
    return results


def round_all(value: Any, decimals: int | None = DECIMALS) -> Any:
    """Round every number, unless ``decimals`` is None; NaN and infinity become None."""
    if isinstance(value, float):  # most values, and the check for a Mapping is slow
        if not math.isfinite(value):
            return None
        return (float(value) if decimals is None else round(float(value), decimals)) + 0.0
    if value is None or isinstance(value, str | int):
        return value
    if isinstance(value, list | tuple):
        return [round_all(inner, decimals) for inner in value]
    if isinstance(value, Mapping):
        return {key: round_all(inner, decimals) for key, inner in value.items()}
    return value


def read_figures(results: Results) -> dict[str, Cell]:
    """Return every figure of ``results.json`` by name."""
    return {
        figure.spell(record): record[figure.key]
        for group in (*_FACTS, *GROUPS)
        for record in _find_records(results, group.path.split("."))
        for figure in group.figures
        if figure.name and figure.key in record
    }


def read_ranges(results: Results, suffix: str = "") -> dict[str, tuple[Cell, Cell]]:
    """Return both ends of the 95 % ranges by the names of their figures; figures without a range are absent.

    ``suffix``: "_pose" for the ranges with the error of the N-pose, which other poses do not have.
    """
    own = {  # records that contain the ends
        figure.spell(record): (record.get(f"low{suffix}"), record.get(f"high{suffix}"))
        for group, figure in ((TIME_ABOVE, TIME_ABOVE["percent"]), (BINS, BINS["percent"]))
        for record in _find_records(results, group.path.split("."))
    }
    named = results["exposure"].get(f"intervals{suffix}", {})
    others = {name: (low, high) for name, (low, high) in named.items()}
    return {name: pair for name, pair in {**others, **own}.items() if None not in pair}


def _find_records(value: Any, steps: list[str], name: str = "") -> Iterator[dict[str, Any]]:
    """Find the records at a path; a value without a record gets the empty key."""
    if value is None:
        return
    if not steps:
        yield {"name": name, **(value if isinstance(value, Mapping) else {"": value})}
        return
    step, *rest = steps
    if step == "*":
        for key, inner in value.items():
            yield from _find_records(inner, rest, key)
    elif step.endswith("[]"):
        for inner in value.get(step.removesuffix("[]"), ()):
            yield from _find_records(inner, rest)
    else:
        yield from _find_records(value.get(step), rest)


# Columns of the tables: their figures and order.


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table; ``pattern`` is its name with placeholders."""

    pattern: str
    facts: Mapping[str, str] = field(default_factory=dict)
    kind: CellKind = "number"

    @property
    def name(self) -> str:
        """The name, which ends in the unit, followed by the suffix of a range (:data:`RANGE_ENDS`)."""
        return fill(self.pattern, self.facts)

    @property
    def unit(self) -> str:
        """The unit at the end of the name; a column of the list of participants states none."""
        return "" if self.pattern == "{header}" else find_unit(self.name)

    def explain(self, language: Language, table: str = "summary") -> str:
        """Return the meaning of the column: the table's own text, the common one, or that of its field."""
        words = load_wording(language, "tables")
        for place in (words[table], words["common"]):
            if text := place.get(self.name) or place.get(self.pattern):
                return fill(text, self.facts)
        return str(load_wording(language, "fields")[_PATHS[self.pattern]])


_PATHS = {f.name: f"{group.path}.{f.key}".removesuffix(".") for group in GROUPS for f in group.figures}

_RANGED = (
    *(f"time_above_{threshold_deg}_percent" for threshold_deg in (30, 60, 90)),
    *(f"elevation_p{p}_deg" for p in (10, 50, 90, 99)),
)
SUMMARY: tuple[Column, ...] = (
    *(Column(name, kind="text") for name in ("file_name", "subject", "side", "device", "start")),
    *map(Column, ("rate_hz", "recorded_s", "analysed_s", "missing_s", "excluded_s")),
    *(
        Column(BINS["percent"].name, {"lower_deg": low, "upper_deg": high})
        for low, high in pairwise(["0", "20", "30", "45", "60", "80", "90", "120", "150", "180"])
    ),
    *(
        Column(figure.name, {"threshold_deg": threshold_deg})
        for threshold_deg in ("30", "60", "90")
        for figure in (TIME_ABOVE["percent"], TIME_ABOVE["duration_s"], ENTRIES["per_hour"])
    ),
    *(
        Column(PERCENTILES[""].name, {"name": p})
        for p in ["1", "5", "10", "25", "50", "75", "90", "95", "99"]
    ),
    Column("{name}_velocity_p50_dps", {"name": "inclination"}),
    Column(WINDOWS["percent_above_60"].name, {"length_min": "15"}),
    *(Column(name, kind="text") for name in ("verdict", "warnings", "sha256", "error_code")),
    *(Column("{figure}_" + end, {"figure": name}) for name in _RANGED for end in ("low", "high")),
    *(Column(name, kind="text") for name in ("path", "folder", "calibration_state")),
    Column("pose_sigma_deg"),
    *(Column("{figure}_" + end, {"figure": "entries_above_60_per_h"}) for end in ("low", "high")),
    *(
        Column("{figure}_" + end, {"figure": name})
        for name in (*_RANGED, "entries_above_60_per_h")
        for end in ("low_pose", "high_pose")
    ),
    Column("{name}_velocity_p50_dps", {"name": "generalised_accelerometer"}),
    *(Column(name, kind="text") for name in ("utc_offset", "job_title", "isco_code")),
    *(Column(name, kind="text") for name in ("method", "method_version", "software_version", "pose")),
    *(Column(name, kind="text") for name in ("settings", "shift")),
)
"""Columns of ``summary.csv``, one row per recording. Append new columns at the end."""

SUMMARY_OF_ONE = tuple(
    column for column in SUMMARY if column.name not in ("error_code", "path", "folder", "settings")
)
"""Without the columns that are only useful in a table of many recordings."""


def names_task(kind: str, label: str, excluded_as: str | None) -> bool:
    """Return whether a period of the diary, or its pooled rows, is a task whose time is analysed.

    Work counts only with a name in the diary.
    """
    return not excluded_as and (kind in NAMED or (kind == "work" and bool(label)))


def _text(*names: str) -> tuple[Column, ...]:
    return tuple(Column(name, kind="text") for name in names)


def _ranges(*names: str) -> tuple[Column, ...]:
    return tuple(Column("{figure}_" + end, {"figure": name}) for name in names for end in ("low", "high"))


_WHO = ("file_name", "subject", "side")
_CLOCK = ("day", "start", "end")
_PLACE = ("path", "utc_offset")
_OF_PART = (
    *(Column(PERCENTILES[""].name, {"name": p}) for p in ("10", "50", "90")),
    *(Column(TIME_ABOVE["percent"].name, {"threshold_deg": c}) for c in ("30", "60", "90")),
    Column(ENTRIES["per_hour"].name, {"threshold_deg": "60"}),
)
_OF_PERIOD = (
    *map(Column, ("recorded_s", "analysed_s")),
    *_OF_PART,
    Column(EPISODES["longest_s"].name, {"threshold_deg": "60"}),
    Column("recovery_neutral_slow_percent"),
)
_PART_RANGES = _ranges("time_above_60_percent", "entries_above_60_per_h")
_PERIOD_RANGES = (*_PART_RANGES, *_ranges(*PERIOD_FIGURES))
_BEFORE = ("analysed_s", "time_above_60_percent", "elevation_p50_deg", "entries_above_60_per_h")
_OF_DAY = (*(f"time_above_{c}_percent" for c in (30, 60, 90)), "entries_above_60_per_h", "elevation_p50_deg")

TABLES: Mapping[str, tuple[Column, ...]] = {
    "summary": SUMMARY,
    "days": (
        *_text("subject", "side", "day", "start", "end", "file_name", "left_out", "verdict"),
        *_text("calibration_state"),
        *map(Column, ("recorded_s", "analysed_s", *_OF_DAY)),
        *_ranges(*_OF_DAY),
        *_text("job_title", "isco_code", *_PLACE),
    ),
    "hours": (
        *_text(*_WHO, "label", *_CLOCK),
        *map(Column, ("start_s", "end_s", "analysed_s")),
        *_OF_PART,
        *_PART_RANGES,
        *_text(*_PLACE),
    ),
    "periods": (
        *_text(*_WHO, "kind", "label", "excluded_as", *_CLOCK),
        *map(Column, ("start_s", "end_s")),
        *_OF_PERIOD,
        *_PERIOD_RANGES,
        *_text(*_PLACE),
    ),
    "tasks": (
        *_text(*_WHO, "kind", "label", *_CLOCK),
        *map(Column, ("start_s", "end_s", "periods")),
        *_OF_PERIOD,
        Column(LESS_REST),
        *_PERIOD_RANGES,
        *_ranges(LESS_REST),
        *_text(*_PLACE),
    ),
    "postures": (
        *_text(*_WHO, "kind"),
        *_OF_PERIOD,
        *_PERIOD_RANGES,
        *_text("path"),
    ),
    "marks": (
        *_text(*_WHO, "label", "at"),
        *map(Column, ("mark_s", *_BEFORE)),
        *(Column("rest_{figure}", {"figure": name}) for name in _BEFORE),
        *_text(*_PLACE),
    ),
    "pairs": (
        *_text("subject", "left", "right", "trunk", "certainty"),
        *map(Column, ("offset_s", "offset_margin_s", "drift_ppm", "movement_offset_s", "shared_s")),
        *map(Column, ("left_time_above_60_percent", "right_time_above_60_percent", "both_above_60_percent")),
        *map(Column, ("right_to_left_time_above_60", "left_elevation_p50_deg", "right_elevation_p50_deg")),
        *map(Column, ("left_minus_trunk_p50_deg", "right_minus_trunk_p50_deg")),
        *_text("error_code", "why", "trunk_certainty"),
    ),
    "problems": _text("file_name", "code", "title", "detail", "fix", "path", "subject", "side"),
    "bins": (
        *_text("file_name", "subject", "side"),
        *map(Column, ("lower_deg", "upper_deg", "duration_s", "percent", "low", "high")),
        *_text("path"),
    ),
    "warnings": (
        *_text("file_name", "subject", "side", "code"),
        *map(Column, ("count", "seconds")),
        *_text("first", "last", "path"),
    ),
    "dictionary": _text("file", "column", "kind", "unit", "english", "french"),
}
"""The columns of every table of a run, by its name. Append new columns at the end."""


# Units: the end of a figure's name determines its unit.


def find_unit(name: str) -> str:
    """Return the unit from the end of a name, before the suffix of a range."""
    stem = name.removesuffix("_pose").removesuffix("_low").removesuffix("_high").removesuffix("[]")
    return next((unit for ending, unit in _UNITS.items() if stem.endswith(f"_{ending}")), "")


def format_figure(value: float, name: str, language: Language) -> str:
    """Format a figure with its unit; a rate per hour has none."""
    unit = find_unit(name)
    if unit == "%":
        return format_percent(value, language)
    if unit == "deg":
        return format_angle(value, language, 1)
    if unit == "Hz":
        return f"{format_number(value, 2, language)}{NARROW}Hz"
    return format_duration(value, language) if unit == "s" else format_rate(value, language)


def format_figure_range(interval: Interval, name: str, language: Language) -> str:
    """Format both ends of a range like the figure."""
    return f"{format_figure(interval.low, name, language)}–{format_figure(interval.high, name, language)}"
