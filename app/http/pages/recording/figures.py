"""The main figures of a report. With an earlier version: its figures, these figures and the difference."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from acromion.app.report.figures import find_unit, read_figures, read_ranges
from acromion.app.report.pairs import format_points
from acromion.app.report.words.numbers import (
    NONE,
    format_angle,
    format_duration,
    format_number,
    format_percent,
)
from acromion.app.report.words.wording import Language, fill, load_wording

Results = Mapping[str, Any]
FIGURES = {
    "time_above_30_percent": "above_30",
    "time_above_60_percent": "above_60",
    "time_above_90_percent": "above_90",
    "entries_above_60_count": "entries",
    "entries_above_60_per_h": "entries_per_h",
    "elevation_p50_deg": "median",
    "elevation_p90_deg": "p90",
    "generalised_accelerometer_velocity_p50_dps": "velocity",
    "analysed_s": "analysed",
}
"""The figures of the page and their words, in order."""
MAIN = "time_above_60_percent"


@dataclass(frozen=True, slots=True)
class Cell:
    """A formatted value, and below it its duration and its 95 % range; both may be empty."""

    value: str
    more: str = ""


@dataclass(frozen=True, slots=True)
class FigureRow:
    """A figure of the shown report. With an earlier version, the figure of that version comes first.

    ``difference`` is between the two. ``key``: of its definition; "" for none.
    """

    name: str
    cells: tuple[Cell, ...]
    difference: str = ""
    key: str = ""


@dataclass(frozen=True, slots=True)
class FigureTable:
    """The figures of a report; with an earlier version also the settings that differ: name, before, now.

    ``before_id`` and ``versions``, of the earlier report and of this one, are empty without it.
    """

    rows: tuple[FigureRow, ...]
    settings: tuple[tuple[str, str, str], ...] = ()
    before_id: str = ""
    versions: tuple[int, ...] = ()


def build_figures(now: Results, before: Results | None, language: Language) -> tuple[FigureRow, ...]:
    """Return the main figures and the bound of the pose error.

    With an earlier version, also return each task, the quality of the data and the evidence for the pose.
    """
    words = load_wording(language, "page")["figure"]
    facts = {"recorded": format_duration(now["time"]["recorded_s"], language)}
    reports = (before, now) if before else (now,)
    rows = list(_list_rows(reports, {key: fill(words[key], facts) for key in FIGURES.values()}, language))
    bounds = [_find_pose_bound(results) for results in reports]
    if any(bound is not None for bound in bounds):
        shown = tuple(Cell(format_percent(bound, language)) for bound in bounds)
        rows.insert(2, FigureRow(words["pose_bound"], shown, format_difference(bounds, MAIN, language)))
    if before is not None:
        rows += compare_tasks(before, now, language)
        rows += _compare_told(reports, language)
    return tuple(rows)


def format_difference(values: Sequence[Any], name: str, language: Language) -> str:
    """Format the difference between a figure before and now, as printed: of the rounded values.

    Empty for a single figure.
    """
    words = load_wording(language, "day")["changes"]
    if len(values) == 1:
        return ""
    if None in values:
        return str(words["same" if values[0] == values[1] else "changed"])
    is_percent = find_unit(name) == "%"
    before, now = (round(value, 1 if is_percent else 0) for value in values)
    apart = round(now - before, 1)
    if not apart:
        return str(words["same"])
    if is_percent:
        return format_points(apart, name, language, is_signed=True)
    return ("+" if apart > 0 else "−") + format_value(abs(apart), name, language)


def format_value(value: Any, name: str, language: Language) -> str:
    """Format a figure of the page with its unit."""
    match find_unit(name):
        case "%":
            return format_percent(value, language)
        case "deg":
            return format_angle(value, language)
        case "s":
            return format_duration(value, language)
        case "deg/s":
            return NONE if value is None else f"{format_angle(value, language)}/s"
    return format_number(value, 0, language)


def _list_rows(
    reports: Sequence[Results], names: Mapping[str, str], language: Language
) -> Iterator[FigureRow]:
    read = [read_figures(results) for results in reports]
    for figure, key in FIGURES.items():
        values = [each.get(figure) for each in read]
        if values == [None] * len(values):
            continue
        cells = tuple(
            Cell(format_value(value, figure, language), _format_more(figure, results, language))
            for value, results in zip(values, reports, strict=True)
        )
        yield FigureRow(names[key], cells, format_difference(values, figure, language), key)


def _format_more(name: str, results: Results, language: Language) -> str:
    """Format the duration of a share, and the 95 % range of a figure."""
    shown, ends = [], read_ranges(results).get(name)
    duration_s = read_figures(results).get(name.replace("_percent", "_s"))
    if name.endswith("_percent") and duration_s is not None:
        shown.append(format_duration(float(duration_s), language))
    if ends:
        low = format_number(float(ends[0] or 0.0), 1 if name.endswith("_percent") else 0, language)
        high = format_value(ends[1], name, language)
        is_known = results.get("method") is not None and results.get("calibration") is not None
        words = load_wording(language)["profile"]["range"]["known" if is_known else "ready"]
        shown.append(fill(words, {"range": f"{low}–{high}"}))
    return " · ".join(shown)


def _find_pose_bound(results: Results) -> float | None:
    """Return the time above 60 deg at most, with the one-sided error of the pose; None if it adds nothing."""
    bound, ends = read_ranges(results, "_pose").get(MAIN), read_ranges(results).get(MAIN)
    if bound is None or ends is None or float(bound[1] or 0.0) <= float(ends[1] or 0.0):
        return None
    return float(bound[1] or 0.0)


def compare_tasks(before: Results, now: Results, language: Language) -> Iterator[FigureRow]:
    """Yield the time above 60 deg of every task in either report; "–" if a report does not have the task."""
    words = load_wording(language, "page")["figure_of_task"]
    earlier, later = (
        {
            part["label"]: part.get("time_above_60_percent")
            for part in results["exposure"].get("by_task", ())
            if part["kind"] == "task" and part["label"]
        }
        for results in (before, now)
    )
    for label in dict.fromkeys((*later, *earlier)):
        shares = (earlier.get(label), later.get(label))
        cells = tuple(Cell(format_percent(share, language)) for share in shares)
        difference = format_difference(shares, MAIN, language)
        if label not in earlier:
            difference = str(load_wording(language, "day")["changes"]["new"])
        yield FigureRow(fill(words, {"task": label}), cells, difference)


def _compare_told(reports: Sequence[Results], language: Language) -> Iterator[FigureRow]:
    """Yield the verdict on the data and the evidence for the pose."""
    changes, verdicts = (
        load_wording(language, "day")["changes"],
        load_wording(language, "page")["verdict_short"],
    )
    told = [("quality", [verdicts[results["quality"]["verdict"]] for results in reports])]
    poses = [results["calibration"] for results in reports if results.get("calibration")]
    if len(poses) == len(reports):
        states = [
            changes["needed"] if pose.get("needs_pose") else changes["state"][pose["state"]] for pose in poses
        ]
        told.append(("pose", states))
    for key, (earlier, later) in told:
        difference = changes["same" if later == earlier else "changed"]
        yield FigureRow(str(changes[key]), (Cell(str(earlier)), Cell(str(later))), str(difference))
