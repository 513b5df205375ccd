"""The report of several days, for people: of one person, of both arms, of a group, before and after.

Pure. Its figures are those of :mod:`app.report.days.document`; each is defined in docs/profile.md.
"""

from __future__ import annotations

from dataclasses import replace

from app.report.analysis.chapters import format_accuracy, format_pose_caution
from app.report.days.charts import FigureRow, build_overlays, build_rows, build_visits
from app.report.days.document import (
    MAIN,
    describe_arm,
    describe_profile,
    find_group_pose,
    follow_days,
    list_changes,
    list_groups,
    tell_days,
)
from app.report.days.people import ArmDays, MeasuredDay, PoseEnds, Side, Stage, StudiedDays
from app.report.days.tables import (
    TILES,
    build_changes,
    build_days_table,
    build_group,
    build_means,
    build_sources,
    format_span,
    load_days_words,
    name_arm,
)
from app.report.figures import format_figure
from app.report.model import Chart, Note, Pair, Report, Section, VerdictLine
from app.report.pairs import format_person, format_points, identify
from app.report.render.brief import format_signature
from app.report.words.numbers import NONE, format_date, format_number
from app.report.words.subject import cut_text
from app.report.words.wording import Language, Words, fill, load_wording
from fusion.comparison import SOURCE
from fusion.days import LEAST_OWN_DAYS
from fusion.exposure.types import Interval

MOST_ROWS = 14
"""Rows of the drawing of days; all of them are in the table behind and in profile.csv."""
_LONGEST_CODE = 24


def build_days(studied: StudiedDays, language: Language) -> Report:
    """Turn several days into one report."""
    words = load_days_words(language)
    report_id = identify(describe_profile(studied))
    header = _build_header(studied, words, language)
    version = max(day.kept.subject.software.version for day in studied.days)
    footer = fill(words["footer"], {"version": version, "id": report_id})
    limits, use = _build_limits(studied, language)
    ends = [day.end for day in studied.days if day.end]
    return Report(
        language=language,
        title=words["title_group" if studied.is_group else "title"],
        subtitle=load_wording(language)["heading"]["subtitle"],
        header=header,
        verdict=_build_verdict(studied, words),
        sentences=_list_sentences(studied, words, language),
        pose_caution=" ".join(filter(None, _list_cautions(studied, words, language))),
        range_note=words["range_note"],
        figures=_list_figures(studied, words, language),
        limits=limits,
        intended_use=use,
        sections=_list_sections(studied, words, language),
        report_id=report_id,
        footer=footer,
        brief=format_signature(header, footer, language),
        made_of=max(ends, default=None),
        amendment="",
        words=load_wording(language)["label"],
    )


def _build_header(studied: StudiedDays, words: Words, language: Language) -> tuple[Pair, ...]:
    label, codes = load_wording(language)["label"], studied.people
    if studied.is_group:
        who = fill(words["people"], {"count": str(len(codes))})
    else:
        who = cut_text(codes[0], _LONGEST_CODE) or label["not_given"]
    sides = load_wording(language)["side"]
    starts = sorted(day.start for day in studied.days if day.start)
    dates = dict.fromkeys(format_date(start, language) for start in (*starts[:1], *starts[-1:]))
    counted = sum(day.left_out is None for day in studied.days)
    facts = {"count": str(counted), "all": str(len(studied.days))}
    return (
        Pair(label["subject"], who),
        Pair(label["date"], " – ".join(dates) or label["no_clock"]),
        Pair(label["arm"], ", ".join(sides[side or "unknown"] for side in studied.sides)),
        Pair(words["counted"], fill(words["of_all"], facts)),
    )


def _build_verdict(studied: StudiedDays, words: Words) -> VerdictLine:
    """State first whether there are days to compare, then whether they are alike."""
    entry = words["verdict"]
    most = max(len(arm.counted) for arm in studied.arms)
    if most < 2 and not studied.is_group:  # whose range comes from its people
        return VerdictLine("poor", entry["one"]["label"], entry["one"]["reason"])
    if not studied.differences:
        return VerdictLine("good", entry["alike"]["label"], entry["alike"]["reason"])
    told = "; ".join(words["difference"][name] for name in studied.differences)
    level = "poor" if "poor" in studied.differences else "caution"
    return VerdictLine(level, entry["unlike"]["label"], fill(entry["unlike"]["reason"], {"list": told}))


def _list_cautions(studied: StudiedDays, words: Words, language: Language) -> tuple[str, ...]:
    told = (format_pose_caution(day.kept.findings, load_wording(language)) for day in studied.days)
    person = format_person(studied.one_person, language)
    rule = fill(words["caution"], {"source": SOURCE, "own": str(LEAST_OWN_DAYS)})
    return (person, "" if studied.is_group else rule, words["cause"], *filter(None, dict.fromkeys(told)))


# ------------------------------------------------------------------ the answer in sentences


def _list_sentences(studied: StudiedDays, words: Words, language: Language) -> tuple[str, ...]:
    """State the change, where there is one; else mean and spread, which then stand in the tables."""
    if "after" in studied.stages:
        return tuple(_list_change_sentences(studied, words, language))
    if studied.is_group:
        return tuple(_list_group_sentences(studied, words, language))
    return tuple(told for arm in studied.arms for told in _list_arm_sentences(arm, words, language))


def _list_arm_sentences(arm: ArmDays, words: Words, language: Language) -> list[str]:
    entry, name = words["sentence"], name_arm(arm.side, arm.stage, language)
    days, telling, values = describe_arm(arm).get(MAIN), tell_days(arm), arm.list_values(MAIN)
    if days is None or telling is None:
        return [fill(entry["none"], {"arm": name})]
    facts = {
        "arm": name,
        "days": str(days.days),
        "mean": format_figure(days.mean, MAIN, language),
        "range": format_span(days.mean_range, MAIN, language),
        "pose": _format_pose(arm.find_pose_ends(MAIN), language),
        "low": format_figure(min(values), MAIN, language),
        "high": format_figure(max(values), MAIN, language),
        "sd": format_points(days.sd, MAIN, language) if days.sd is not None else "",
        "sd_low": _format_end(days.sd_range, 0, language),
        "sd_high": _format_end(days.sd_range, 1, language),
        "needed": str(max(telling.days, days.days)),
        "more": str(telling.more_days),
        "points": format_points(telling.detectable, MAIN, language),
        "points_low": _format_end(telling.detectable_range, 0, language),
        "points_high": _format_end(telling.detectable_range, 1, language),
        "own": entry["own"][telling.sd_from],
    }
    if days.days < 2:
        return [fill(entry["one"], facts), fill(entry["more"], facts)]
    needed = fill(entry["more" if telling.more_days else "enough"], facts)
    trend = _tell_trend(arm, words, language)
    return [fill(entry["mean"], facts), f"{fill(entry['spread'], facts)} {needed}", *trend]


def _tell_trend(arm: ArmDays, words: Words, language: Language) -> list[str]:
    """Say whether the last day differs from the first by more than single days do."""
    trend, entry = follow_days(arm), words["sentence"]["trend"]
    starts = [day.start for day in arm.counted if day.start]
    if trend is None:
        return []
    facts = {
        "from": format_date(starts[0], language),
        "to": format_date(starts[-1], language),
        "first": format_figure(trend.first, MAIN, language),
        "last": format_figure(trend.last, MAIN, language),
        "change": format_points(trend.change, MAIN, language, is_signed=True),
        "detectable": format_points(trend.detectable, MAIN, language),
        "own": words["sentence"]["own"][trend.sd_from],
        "outside": str(trend.outside),
        "later": str(len(starts) - 1),
    }
    told = f"{fill(entry['told'], facts)} {fill(entry['larger' if trend.is_larger else 'not larger'], facts)}"
    outside = fill(entry["outside" if trend.outside else "none"], facts)
    return [f"{told} {outside}" if len(starts) > 2 else told]


def _list_group_sentences(studied: StudiedDays, words: Words, language: Language) -> list[str]:
    told = []
    for side, stage, figures in list_groups(studied):
        spread = figures.get(MAIN)
        if spread is None:
            continue
        facts = {
            "arm": name_arm(side, stage, language),
            "people": str(spread.people),
            "days": str(spread.days),
            "mean": format_figure(spread.mean, MAIN, language),
            "range": format_span(spread.mean_range, MAIN, language),
            "pose": _format_pose(find_group_pose(studied, MAIN, side, stage), language),
            "between": _format_sd(spread.between_sd, language),
            "within": _format_sd(spread.within_sd, language),
        }
        told.append(fill(words["sentence"]["group"], facts))
        known = spread.between_sd is not None
        told.append(fill(words["sentence"]["split" if known else "unsplit"], facts))
    return told


def _format_end(interval: Interval | None, end: int, language: Language) -> str:
    return format_number((interval.low, interval.high)[end], 1, language) if interval else ""


def _format_pose(ends: PoseEnds | None, language: Language) -> str:
    return format_figure(ends[1], MAIN, language) if ends else ""


def _format_sd(sd: float | None, language: Language) -> str:
    return "" if sd is None else format_points(sd, MAIN, language)


def _list_change_sentences(studied: StudiedDays, words: Words, language: Language) -> list[str]:
    entry, told = words["sentence"]["change"], []
    changes = dict(list_changes(studied))
    if not changes:
        return [entry["few" if studied.is_group else "nobody"]]
    for side, figures in changes.items():
        change = figures.get(MAIN)
        if change is None:
            continue
        span = change["change_range"]
        facts = {
            "arm": name_arm(side, "all", language),
            "people": str(change["people"]),
            "before_days": str(_count_days(studied, side, "before")),
            "after_days": str(_count_days(studied, side, "after")),
            "before": format_figure(change["before"], MAIN, language),
            "after": format_figure(change["after"], MAIN, language),
            "change": format_points(change["change"], MAIN, language, is_signed=True),
            "low": format_number(span[0], 1, language) if span else "",
            "high": format_number(span[1], 1, language) if span else "",
            "detectable": format_points(change["detectable"], MAIN, language) if change["detectable"] else "",
        }
        kind = "group" if span else "person"
        told.append(f"{fill(entry[kind]['told'], facts)} {fill(entry[kind][change['verdict']], facts)}")
    return told


def _count_days(studied: StudiedDays, side: Side | None, stage: Stage) -> int:
    """Count the days of an arm on one side of the change."""
    return sum(len(arm.counted) for arm in studied.arms if (arm.side, arm.stage) == (side, stage))


# ------------------------------------------------------------------ drawings and chapters


def _list_figures(studied: StudiedDays, words: Words, language: Language) -> tuple[Chart, ...]:
    """Draw one person's days; a group has figures alone."""
    if studied.is_group:
        return ()
    columns = words["rows"]["columns"]
    shown = [
        (name_arm(arm.side, arm.stage, language), arm)
        for arm in studied.arms
        if any(band.percentiles_deg for band in arm.bands)
    ]
    overlays = (build_overlays(shown, words, language),) if shown else ()
    heads = (words["rows"]["days"], words["rows"]["day"])
    return (*overlays, build_rows(_lay_days(studied, words, language), heads, columns, words))


def _lay_days(studied: StudiedDays, words: Words, language: Language) -> list[FigureRow]:
    """Lay the last days of each arm under its mean."""
    rows: list[FigureRow] = []
    each = max(MOST_ROWS // len(studied.arms), 2)
    for arm in studied.arms:
        mean = _lay_mean(arm, name_arm(arm.side, arm.stage, language), language)
        rows += [mean] if mean else []
        rows += [_lay_day(day, words, language) for day in arm.days[-each:]]
    return rows


def _lay_mean(arm: ArmDays, name: str, language: Language) -> FigureRow | None:
    figures = describe_arm(arm)
    if not figures:
        return None
    means = [figures.get(key) for key in TILES]
    return FigureRow(
        name,
        tuple(figure.mean if figure else None for figure in means),
        tuple(
            format_figure(figure.mean, key, language) if figure else NONE
            for key, figure in zip(TILES, means, strict=True)
        ),
        tuple(
            (figure.mean_range.low, figure.mean_range.high) if figure and figure.mean_range else None
            for figure in means
        ),
        is_mean=True,
    )


def _lay_day(day: MeasuredDay, words: Words, language: Language) -> FigureRow:
    figures = day.list_figures()
    values = tuple(figures[key] for key in TILES)
    told = tuple(
        NONE if value is None else format_figure(value, key, language)
        for key, value in zip(TILES, values, strict=True)
    )
    label = format_date(day.start, language) if day.start else words["no_clock"]
    return FigureRow(label, values, told, is_left_out=day.left_out is not None)


def _list_sections(studied: StudiedDays, words: Words, language: Language) -> tuple[Section, ...]:
    changes = build_changes(studied, words, language)
    made: tuple[Section | None, ...]
    if studied.is_group:
        made = (build_group(studied, words, language), changes)
    else:
        visits = build_visits(studied.arms, words, language)
        made = (
            build_means(studied, words, language),
            changes,
            replace(build_days_table(studied, words, language), figures=visits),
            build_sources(studied, words, language),
        )
    return tuple(section for section in made if section)


def _build_limits(studied: StudiedDays, language: Language) -> tuple[Note, Note]:
    words = load_wording(language)
    limits, use = words["limits"], words["intended_use"]
    accuracy = dict.fromkeys(format_accuracy(day.kept.findings, words) for day in studied.days)
    paragraphs = (*limits["paragraphs"], *accuracy)
    return Note(limits["title"], paragraphs), Note(use["title"], (use["text"],))
