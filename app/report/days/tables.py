"""The chapters behind the first page of several days: means, group, change, days, sources."""

from __future__ import annotations

from app.report.days.document import FIGURES, describe_arm, find_group_pose, list_changes, list_groups
from app.report.days.people import ArmDays, MeasuredDay, PoseEnds, Side, Stage, StudiedDays
from app.report.figures import format_figure, format_figure_range
from app.report.model import Section, Table
from app.report.pairs import format_points, format_pose, load_pair_words
from app.report.words.numbers import (
    NONE,
    Clock,
    format_angle_range,
    format_date,
    format_duration,
    format_number,
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
    if interval is None:
        return ""
    if name.endswith("_percent"):
        return format_range(interval, language)
    if name.endswith("_deg"):
        return format_angle_range(interval, language, 1)
    return format_figure_range(interval, name, language)


def _name_figure(name: str, language: Language) -> str:
    return str(load_pair_words(language)["compare"]["table"]["figure"][name])


def build_means(studied: StudiedDays, words: Words, language: Language) -> Section | None:
    """Return the mean of each figure over the days of each arm."""
    entry = words["means"]
    tables = tuple(_tabulate_means(arm, words, language) for arm in studied.arms if arm.counted)
    return Section("means", entry["title"], tables=tables) if tables else None


def _tabulate_means(arm: ArmDays, words: Words, language: Language) -> Table:
    entry = words["means"]
    rows = tuple(
        (
            _name_figure(name, language),
            str(figure.days),
            format_figure(figure.mean, name, language),
            format_span(figure.mean_range, name, language) or NONE,
            _format_pose(arm.find_pose_ends(name), name, language),
            NONE if figure.sd is None else format_points(figure.sd, name, language),
            _format_sds(figure.sd_range, language),
        )
        for name, figure in describe_arm(arm).items()
    )
    name = name_arm(arm.side, arm.stage, language)
    return Table(name, tuple(entry["columns"]), rows, note=entry["note"])


def _format_pose(ends: PoseEnds | None, name: str, language: Language) -> str:
    return format_figure(ends[1], name, language) if ends else NONE


def _format_sds(interval: Interval | None, language: Language) -> str:
    if interval is None:
        return NONE
    return "–".join(format_number(end, 1, language) for end in (interval.low, interval.high))


def build_group(studied: StudiedDays, words: Words, language: Language) -> Section | None:
    """Give the mean of a group with its spread between and within people."""
    entry = words["group"]
    tables = []
    for side, stage, figures in list_groups(studied):
        rows = tuple(
            (
                _name_figure(name, language),
                f"{spread.people} / {spread.days}",
                format_figure(spread.mean, name, language),
                format_span(spread.mean_range, name, language) or NONE,
                _format_pose(find_group_pose(studied, name, side, stage), name, language),
                NONE if spread.between_sd is None else format_points(spread.between_sd, name, language),
                NONE if spread.within_sd is None else format_points(spread.within_sd, name, language),
            )
            for name, spread in figures.items()
        )
        caption = name_arm(side, stage, language)
        tables.append(Table(caption, tuple(entry["columns"]), rows, note=entry["note"]))
    return Section("group", entry["title"], tables=tuple(tables)) if tables else None


def build_changes(studied: StudiedDays, words: Words, language: Language) -> Section | None:
    """Give the change of each arm with its range, or the least change that days do not make."""
    entry = words["change"]
    tables = []
    for side, figures in list_changes(studied):
        rows = []
        for name, change in figures.items():
            span, least = change["change_range"], change["detectable"]
            rows.append(
                (
                    _name_figure(name, language),
                    str(change["people"]),
                    format_figure(change["before"], name, language),
                    format_figure(change["after"], name, language),
                    format_points(change["change"], name, language, is_signed=True),
                    _format_sds(Interval(*span), language) if span else NONE,
                    NONE if least is None else format_points(least, name, language),
                    entry["verdict"][change["verdict"]],
                )
            )
        caption = name_arm(side, "all", language)
        note = fill(entry["note"], {"source": SOURCE})
        tables.append(Table(caption, tuple(entry["columns"]), tuple(rows), note=note, even=True))
    return Section("changes", entry["title"], tables=tuple(tables)) if tables else None


def build_days_table(studied: StudiedDays, words: Words, language: Language) -> Section:
    """Give every day, the earliest first, cut at a stated number of rows."""
    entry = words["days"]
    rows = [
        (
            _name_day(arm, day, studied, words, language),
            _format_analysed(day, words, language),
            *(
                NONE if (value := day.list_figures()[name]) is None else format_figure(value, name, language)
                for name in FIGURES
            ),
            load_pair_words(language)["pair"]["verdict"][day.kept.findings.quality.verdict],
        )
        for arm in studied.arms
        for day in arm.days
    ]
    columns = (entry["columns"][0], entry["columns"][1], *(_name_figure(name, language) for name in FIGURES))
    note = entry["note"] if len(rows) <= MOST_DAYS else f"{entry['cut']} {entry['note']}"
    shown = tuple(rows[:MOST_DAYS])
    table = Table(entry["caption"], (*columns, entry["columns"][2]), shown, note=note, even=True)
    return Section("days", entry["title"], tables=(table,))


def _name_day(arm: ArmDays, day: MeasuredDay, studied: StudiedDays, words: Words, language: Language) -> str:
    """Name a day by its date, with arm and side of the change where there are two: "left, 3 March 2026"."""
    told = (
        str(load_wording(language)["side"][arm.side or "unknown"]) if len(studied.sides) > 1 else "",
        str(words["stage"][arm.stage]) if len(studied.stages) > 1 else "",
        format_date(day.start, language) if day.start else words["no_clock"],
    )
    return ", ".join(filter(None, told))


def _format_analysed(day: MeasuredDay, words: Words, language: Language) -> str:
    lasted = format_duration(day.kept.findings.time.analysed_us / MICROSECONDS, language)
    return f"{lasted} ({words['left_out'][day.left_out]})" if day.left_out else lasted


def build_sources(studied: StudiedDays, words: Words, language: Language) -> Section:
    """Give where each day comes from."""
    entry = words["sources"]
    rows = [_lay_source(day, words, language) for day in studied.days]
    note = "" if len(rows) <= MOST_DAYS else words["days"]["cut"]
    table = Table(entry["caption"], tuple(entry["columns"]), tuple(rows[:MOST_DAYS]), note=note, even=True)
    return Section("provenance", entry["title"], tables=(table,))


def _lay_source(day: MeasuredDay, words: Words, language: Language) -> tuple[str, ...]:
    findings, report_words = day.kept.findings, load_wording(language)
    method = findings.method
    begins = words["no_clock"]
    if day.start:
        begins = f"{format_date(day.start, language)}, {Clock(day.start, language).format(0)}"
    return (
        clean_text(day.kept.subject.file_name) or NONE,
        findings.recording.sha256[:8] + "…",
        find_device_name(report_words, findings.recording.device),
        begins,
        f"{method.name} {method.version}" if method else NONE,
        format_pose(findings, report_words),
        day.kept.subject.report_id[:8] + "…",
    )
