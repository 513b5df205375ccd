"""The chapters behind the first page of several days: means, group, change, days, sources."""

from __future__ import annotations

from collections.abc import Iterator

from app.report.days.document import FIGURES, describe_arm, find_group_pose, list_changes, list_groups
from app.report.days.people import PoseEnds, Side, Stage, StudiedDays
from app.report.figures import format_figure, format_figure_range
from app.report.model import Section, Table
from app.report.pairs import format_points, format_pose, load_pair_words, name_method
from app.report.words.numbers import (
    NONE,
    Clock,
    format_angle_range,
    format_date,
    format_duration,
    format_ends,
    format_range,
)
from app.report.words.subject import clean_text
from app.report.words.wording import Language, Words, fill, find_device_name, load_wording
from fusion.comparison import SOURCE
from fusion.exposure.types import Interval
from fusion.recording import MICROSECONDS

TILES = ("time_above_30_percent", "time_above_60_percent", "time_above_90_percent", "entries_above_60_per_h")
MOST_DAYS = 60
"""Rows of a table of days in the report; all of them are in profile.csv."""


def load_days_words(language: Language) -> Words:
    """Read the words of a report of several days."""
    return load_wording(language, "days")


def name_arm(side: Side | None, stage: Stage, language: Language) -> str:
    """Name an arm, and the side of the change where there is one: "Right arm, before"."""
    words = load_days_words(language)
    arm = str(words["arm"][side or "unknown"])
    return arm if stage == "all" else fill(words["arm_stage"], {"arm": arm, "stage": words["stage"][stage]})


def format_span(interval: Interval | None, name: str, language: Language) -> str:
    """Write a range of a figure; empty without one."""
    if name.endswith("_percent"):
        return format_range(interval, language)
    if name.endswith("_deg"):
        return format_angle_range(interval, language, 1)
    return format_figure_range(interval, name, language) if interval else ""


def _name_figure(name: str, language: Language) -> str:
    return str(load_pair_words(language)["compare"]["table"]["figure"][name])


def build_means(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with the mean of each figure over the days of each arm; none without any."""
    entry, tables = words["means"], []
    for arm in studied.arms:
        rows = tuple(
            (
                _name_figure(name, language),
                str(figure.days),
                format_figure(figure.mean, name, language),
                format_span(figure.mean_range, name, language) or NONE,
                _format_pose(arm.find_pose_ends(name), name, language),
                _format_points(figure.sd, name, language),
                format_ends(figure.sd_range, 1, language) or NONE,
            )
            for name, figure in describe_arm(arm).items()
        )
        name = name_arm(arm.side, arm.stage, language)
        tables += [Table(name, tuple(entry["columns"]), rows, note=entry["note"])] if arm.counted else []
    if tables:
        yield Section("means", entry["title"], tables=tuple(tables))


def _format_pose(ends: PoseEnds | None, name: str, language: Language) -> str:
    return format_figure(ends[1], name, language) if ends else NONE


def _format_points(points: float | None, name: str, language: Language) -> str:
    return NONE if points is None else format_points(points, name, language)


def build_group(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with the mean of a group, its spread between and within people; none without any."""
    entry, tables = words["group"], []
    for side, stage, figures in list_groups(studied):
        rows = tuple(
            (
                _name_figure(name, language),
                f"{spread.people} / {spread.days}",
                format_figure(spread.mean, name, language),
                format_span(spread.mean_range, name, language) or NONE,
                _format_pose(find_group_pose(studied, name, side, stage), name, language),
                _format_points(spread.between_sd, name, language),
                _format_points(spread.within_sd, name, language),
            )
            for name, spread in figures.items()
        )
        caption = name_arm(side, stage, language)
        tables.append(Table(caption, tuple(entry["columns"]), rows, note=entry["note"]))
    if tables:
        yield Section("group", entry["title"], tables=tuple(tables))


def build_changes(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with the change of each arm: its range, or the least change that days do not make."""
    entry, tables = words["change"], []
    for side, figures in list_changes(studied):
        rows = tuple(
            (
                _name_figure(name, language),
                str(change["people"]),
                format_figure(change["before"], name, language),
                format_figure(change["after"], name, language),
                format_points(change["change"], name, language, is_signed=True),
                format_ends(Interval(*change["change_range"]), 1, language)
                if change["change_range"]
                else NONE,
                _format_points(change["detectable"], name, language),
                entry["verdict"][change["verdict"]],
            )
            for name, change in figures.items()
        )
        caption, note = name_arm(side, "all", language), fill(entry["note"], {"source": SOURCE})
        tables.append(Table(caption, tuple(entry["columns"]), rows, note=note, even=True))
    if tables:
        yield Section("changes", entry["title"], tables=tuple(tables))


def build_days_table(studied: StudiedDays, words: Words, language: Language) -> Section:
    """Return every day, the earliest first, cut at a stated number of rows.

    A day is named by its date, with arm and side of the change where there are two: "left, 3 March 2026".
    """
    entry, sides, rows = words["days"], load_wording(language)["side"], []
    verdicts = load_pair_words(language)["pair"]["verdict"]
    for arm, day in ((one, day) for one in studied.arms for day in one.days):
        named = (
            str(sides[arm.side or "unknown"]) if len(studied.sides) > 1 else "",
            str(words["stage"][arm.stage]) if len(studied.stages) > 1 else "",
            format_date(day.start, language) if day.start else words["no_clock"],
        )
        findings, figures = day.kept.findings, day.list_figures()
        lasted = format_duration(findings.time.analysed_us / MICROSECONDS, language)
        told = (
            NONE if (value := figures[name]) is None else format_figure(value, name, language)
            for name in FIGURES
        )
        rows.append(
            (
                ", ".join(filter(None, named)),
                f"{lasted} ({words['left_out'][day.left_out]})" if day.left_out else lasted,
                *told,
                verdicts[findings.quality.verdict],
            )
        )
    first, second, last = entry["columns"]
    columns = (first, second, *(_name_figure(name, language) for name in FIGURES), last)
    note = entry["note"] if len(rows) <= MOST_DAYS else f"{entry['cut']} {entry['note']}"
    table = Table(entry["caption"], columns, tuple(rows[:MOST_DAYS]), note=note, even=True)
    return Section("days", entry["title"], tables=(table,))


def build_sources(studied: StudiedDays, words: Words, language: Language) -> Section:
    """Return where each day comes from."""
    entry, common, rows = words["sources"], load_wording(language), []
    for day in studied.days:
        findings, subject, begins = day.kept.findings, day.kept.subject, words["no_clock"]
        if day.start:
            begins = f"{format_date(day.start, language)}, {Clock(day.start, language).format(0)}"
        rows.append(
            (
                clean_text(subject.file_name) or NONE,
                findings.recording.sha256[:8] + "…",
                find_device_name(common, findings.recording.device),
                begins,
                name_method(findings) or NONE,
                format_pose(findings, common),
                subject.report_id[:8] + "…",
            )
        )
    note = "" if len(rows) <= MOST_DAYS else words["days"]["cut"]
    table = Table(entry["caption"], tuple(entry["columns"]), tuple(rows[:MOST_DAYS]), note=note, even=True)
    return Section("provenance", entry["title"], tables=(table,))
