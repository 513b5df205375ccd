"""The report on several days: of one person, of both arms, of a group, before and after.

All functions are pure. The figures come from :mod:`acromion.app.report.several.document`; docs/profile.md
defines each.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

from acromion.app.report.figures import format_figure, format_figure_range
from acromion.app.report.model import Chart, Pair, Report, Section, Table, VerdictLine
from acromion.app.report.pairs import (
    MAIN_LEVEL,
    build_report,
    format_level,
    format_levels_note,
    format_person,
    format_points,
    format_pose,
    format_rounding_note,
    format_standing,
    lay_level,
    load_pair_words,
    mark_rounding,
    name_method,
)
from acromion.app.report.several.charts import FigureRow, build_overlays, build_rows, build_visits
from acromion.app.report.several.document import (
    FIGURES,
    MAIN,
    compute_trend,
    describe_arm,
    describe_profile,
    estimate_days_needed,
    find_group_pose,
    list_changes,
    list_groups,
    list_jobs,
)
from acromion.app.report.several.levels import MeanLevel, compare_arms, compare_group
from acromion.app.report.several.people import ArmDays, PoseEnds, Stage, StudiedDays
from acromion.app.report.single.chapters import format_pose_caution
from acromion.app.report.words.numbers import (
    NONE,
    Clock,
    format_angle_range,
    format_date,
    format_duration,
    format_ends,
    format_number,
    format_range,
)
from acromion.app.report.words.wording import (
    LONGEST_CODE,
    Language,
    Words,
    clean_text,
    cut_text,
    fill,
    find_device_name,
    join_clauses,
    load_wording,
)
from acromion.fusion.comparison.change import DAYS_ABOVE, SOURCE
from acromion.fusion.comparison.days import LEAST_OWN_DAYS, DayMean, GroupSpread
from acromion.fusion.conventions import Side
from acromion.fusion.exposure.types import Interval
from acromion.fusion.recording import MICROSECONDS

TILES = ("time_above_30_percent", "time_above_60_percent", "time_above_90_percent", "entries_above_60_per_h")
MOST_DAYS = 60
"""Maximum rows in a table of days; profile.csv has all."""
MOST_ROWS = 14
"""Maximum rows in the chart of days; the table behind it and profile.csv have all."""


def build_days(studied: StudiedDays, language: Language) -> Report:
    """Build one report on several days."""
    words, common = load_wording(language, "days"), load_wording(language)
    every = [day.kept for day in studied.days]
    rule = fill(words["caution"], {"source": SOURCE, "own": str(LEAST_OWN_DAYS)})
    poses = dict.fromkeys(format_pose_caution(kept.findings, common) for kept in every)
    return build_report(
        every,
        describe_profile(studied),
        words,
        language,
        title=words["title_group" if studied.is_group else "title"],
        version=max(kept.subject.software.version for kept in every),
        header=_build_header(studied, words, common, language),
        verdict=_build_verdict(studied, words["verdict"], words["difference"], language),
        sentences=_list_sentences(studied, words["sentence"], language),
        cautions=(
            format_person(studied.one_person, language),
            "" if studied.is_group else rule,
            words["cause"],
            *poses,
        ),
        figures=(_list_group_figures if studied.is_group else _list_figures)(studied, words, language),
        sections=_list_sections(studied, words, language),
        range_note=words["range_note"],
    )


def _build_header(studied: StudiedDays, words: Words, common: Words, language: Language) -> tuple[Pair, ...]:
    label, codes = common["label"], studied.people
    if studied.is_group:
        who = fill(words["people"], {"count": str(len(codes))})
    else:
        who = cut_text(codes[0], LONGEST_CODE) or label["not_given"]
    starts = sorted(day.start for day in studied.days if day.start)
    dates = dict.fromkeys(format_date(start, language) for start in (*starts[:1], *starts[-1:]))
    counted = sum(day.left_out is None for day in studied.days)
    facts = {"count": str(counted), "all": str(len(studied.days))}
    return (
        Pair(label["subject"], who),
        Pair(label["date"], " – ".join(dates) or label["no_clock"]),
        Pair(label["arm"], ", ".join(common["side"][side or "unknown"] for side in studied.sides)),
        Pair(words["counted"], fill(words["of_all"], facts)),
    )


def _build_verdict(studied: StudiedDays, entry: Words, differences: Words, language: Language) -> VerdictLine:
    """State first whether there are days to compare, then whether they are alike."""
    most, hours = max(len(arm.counted) for arm in studied.arms), _name_hours(studied.least_hours, language)
    if most < 2 and not studied.is_group:  # the range of a group comes from its people
        return VerdictLine("poor", entry["one"]["label"], entry["one"]["reason"])
    if not studied.differences:
        return VerdictLine("good", entry["alike"]["label"], fill(entry["alike"]["reason"], hours))
    shown = join_clauses((fill(differences[name], hours) for name in studied.differences), language)
    level = "poor" if "poor" in studied.differences else "caution"
    return VerdictLine(level, entry["unlike"]["label"], fill(entry["unlike"]["reason"], {"list": shown}))


def _name_hours(least_hours: float, language: Language) -> dict[str, str]:
    return {"hours": format_number(least_hours, 0 if least_hours.is_integer() else 1, language)}


# The answer in sentences.


def _list_sentences(studied: StudiedDays, entry: Words, language: Language) -> Iterable[str]:
    """State the change if there is one, else mean and spread."""
    if "after" in studied.stages:
        return _list_change_sentences(studied, entry["change"], language)
    if studied.is_group:
        return _list_group_sentences(studied, entry, language)
    return (shown for arm in studied.arms for shown in _list_arm_sentences(arm, entry, language))


def _list_arm_sentences(arm: ArmDays, entry: Words, language: Language) -> list[str]:
    name = _name_arm(arm.side, arm.stage, language)
    days, telling, values = describe_arm(arm).get(MAIN), estimate_days_needed(arm), arm.list_values(MAIN)
    if days is None or telling is None:
        hours = _name_hours(arm.days[0].least_hours, language)
        return [fill(entry["none"], {"arm": name, **hours})]
    facts = {
        "arm": name,
        "days": str(days.days),
        "mean": format_figure(days.mean, MAIN, language),
        "range": _format_span(days.mean_range, MAIN, language),
        "pose": _format_pose(arm.find_pose_ends(MAIN), MAIN, language),
        "low": format_figure(min(values), MAIN, language),
        "high": format_figure(max(values), MAIN, language),
        "sd": format_points(days.sd, MAIN, language) if days.sd is not None else "",
        **_format_two_ends("sd", days.sd_range, language),
        "needed": str(max(telling.days, days.days)),
        "more": str(telling.more_days),
        "points": format_points(telling.detectable, MAIN, language),
        **_format_two_ends("points", telling.detectable_range, language),
        "own": entry["own"][telling.sd_from],
    }
    if days.days < 2:
        return [fill(entry["one"], facts), fill(entry["more"], facts)]
    needed = fill(entry["more" if telling.more_days else "enough"], facts)
    trend = _format_trend(arm, entry, language)
    mean = f"{fill(entry['mean'], facts)} {_format_level_sentence(compare_arms([arm]), language)}"
    return [mean, f"{fill(entry['spread'], facts)} {needed}", *trend]


def _format_level_sentence(levels: Sequence[MeanLevel], language: Language) -> str:
    level = next(level.mean for level in levels if level.mean.reference.key == MAIN_LEVEL)
    facts = {
        "level": format_level(level.reference, language),
        "standing": format_standing(level, language),
    }
    return fill(load_wording(language, "days")["levels"]["sentence"], facts)


def _format_trend(arm: ArmDays, sentence: Words, language: Language) -> list[str]:
    """Return whether the last day differs from the first by more than single days usually do."""
    trend, entry = compute_trend(arm), sentence["trend"]
    starts = [day.start for day in arm.counted if day.start]
    if trend is None:
        return []
    facts = {
        "from": format_date(starts[0], language),
        "to": format_date(starts[-1], language),
        "first": format_figure(trend.first, MAIN, language),
        "last": format_figure(trend.last, MAIN, language),
        "change": _format_change(trend.first, trend.last, trend.change, language),
        "detectable": format_points(trend.detectable, MAIN, language),
        "own": sentence["own"][trend.sd_from],
        "outside": str(trend.outside),
        "later": str(len(starts) - 1),
    }
    shown = (
        f"{fill(entry['told'], facts)} {fill(entry['larger' if trend.is_larger else 'not larger'], facts)}"
    )
    outside = fill(entry["outside" if trend.outside else "none"], facts)
    return [f"{shown} {outside}" if len(starts) > 2 else shown]


def _format_change(before: float, after: float, change: float, language: Language) -> str:
    """Format a change in a sentence, with a note if the printed values do not give it."""
    mark = load_pair_words(language)["compare"]["unrounded"]
    shown = format_points(change, MAIN, language, is_signed=True)
    return shown + mark_rounding(before, after, change, MAIN, mark)


def _list_group_sentences(studied: StudiedDays, entry: Words, language: Language) -> Iterator[str]:
    for side, stage, figures in list_groups(studied):
        spread = figures.get(MAIN)
        if spread is None:
            continue
        between, within = (
            "" if sd is None else format_points(sd, MAIN, language)
            for sd in (spread.between_sd, spread.within_sd)
        )
        facts = {
            "arm": _name_arm(side, stage, language),
            "people": str(spread.people),
            "days": str(spread.days),
            "mean": format_figure(spread.mean, MAIN, language),
            "range": _format_span(spread.mean_range, MAIN, language),
            "pose": _format_pose(find_group_pose(studied, MAIN, side, stage), MAIN, language),
            "between": between,
            "within": within,
        }
        level = _format_level_sentence(compare_group(studied, side, stage), language)
        yield f"{fill(entry['group'], facts)} {level}"
        yield fill(entry["unsplit" if spread.between_sd is None else "split"], facts)


def _format_two_ends(name: str, interval: Interval | None, language: Language) -> dict[str, str]:
    ends = (interval.low, interval.high) if interval else ()
    shown = (format_number(end, 1, language) for end in ends)
    return dict(zip((f"{name}_low", f"{name}_high"), shown, strict=False))


def _format_pose(ends: PoseEnds | None, name: str, language: Language) -> str:
    return format_figure(ends[1], name, language) if ends else ""


def _list_change_sentences(studied: StudiedDays, entry: Words, language: Language) -> Iterator[str]:
    changes = dict(list_changes(studied))
    if not changes:
        yield entry["few" if studied.is_group else "nobody"]
    for side, figures in changes.items():
        change = figures.get(MAIN)
        if change is None:
            continue
        span = change["change_range"]
        before_days, after_days = (
            str(sum(len(arm.counted) for arm in studied.arms if (arm.side, arm.stage) == (side, stage)))
            for stage in ("before", "after")
        )
        facts = {
            "arm": _name_arm(side, "all", language),
            "people": str(change["people"]),
            "before_days": before_days,
            "after_days": after_days,
            "before": format_figure(change["before"], MAIN, language),
            "after": format_figure(change["after"], MAIN, language),
            "change": _format_change(change["before"], change["after"], change["change"], language),
            "low": format_number(span[0], 1, language) if span else "",
            "high": format_number(span[1], 1, language) if span else "",
            "detectable": format_points(change["detectable"], MAIN, language) if change["detectable"] else "",
        }
        shown = entry["group" if span else "person"]
        yield f"{fill(shown['told'], facts)} {fill(shown[change['verdict']], facts)}"


# Charts and chapters.


def _list_figures(studied: StudiedDays, words: Words, language: Language) -> Iterator[Chart]:
    """Draw one person's days: overlaid, and the last days of each arm below its mean."""
    shown = [
        (_name_arm(arm.side, arm.stage, language), arm)
        for arm in studied.arms
        if any(band.percentiles_deg for band in arm.bands)
    ]
    if shown:
        yield build_overlays(shown, words, language)
    rows: list[FigureRow] = []
    each = max(MOST_ROWS // len(studied.arms), 2)
    for arm in studied.arms:
        rows += _lay_mean(_name_arm(arm.side, arm.stage, language), describe_arm(arm), language)
        for day in arm.days[-each:]:
            label = format_date(day.start, language) if day.start else words["no_clock"]
            figures, is_left_out = day.list_figures(), day.left_out is not None
            rows.append(_lay_row(label, [figures[key] for key in TILES], language, is_left_out=is_left_out))
    heads = (words["rows"]["days"], words["rows"]["day"])
    yield build_rows(rows, heads, words["rows"]["columns"], words)


def _list_group_figures(studied: StudiedDays, words: Words, language: Language) -> Iterator[Chart]:
    """Draw the mean of each arm of a group with its range, and no single people."""
    rows = [
        row
        for side, stage, figures in list_groups(studied)
        for row in _lay_mean(_name_arm(side, stage, language), figures, language)
    ]
    if rows:
        entry = words["rows"]
        chart = build_rows(rows, (entry["group"], entry["arm"]), entry["columns"], words)
        yield replace(chart, note=entry["group_note"])


def _lay_mean(
    name: str, figures: Mapping[str, DayMean] | Mapping[str, GroupSpread], language: Language
) -> list[FigureRow]:
    means = [figures.get(key) for key in TILES]
    row = _lay_row(name, [mean.mean if mean else None for mean in means], language)
    spans = (mean.mean_range if mean else None for mean in means)
    ranges = tuple((span.low, span.high) if span else None for span in spans)
    return [replace(row, ranges=ranges, is_mean=True)] if figures else []


def _lay_row(
    label: str, values: list[float | None], language: Language, *, is_left_out: bool = False
) -> FigureRow:
    shown = (
        NONE if value is None else format_figure(value, key, language)
        for key, value in zip(TILES, values, strict=True)
    )
    return FigureRow(label, tuple(values), tuple(shown), is_left_out=is_left_out)


def _list_sections(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    yield from _build_levels(studied, words["levels"], language)
    yield from (_build_group if studied.is_group else _build_means)(studied, words, language)
    yield from _build_changes(studied, words, language)
    if not studied.is_group:
        visits = build_visits(
            [(_name_arm(arm.side, arm.stage, language), arm) for arm in studied.arms], words, language
        )
        yield replace(_build_days_table(studied, words, language), figures=visits)
        yield _build_sources(studied, words, language)


def _name_arm(side: Side | None, stage: Stage, language: Language) -> str:
    """Return the name of an arm, with the side of the change if there is one: "Right arm, before"."""
    words = load_wording(language, "days")
    arm = str(words["arm"][side or "unknown"])
    return arm if stage == "all" else fill(words["arm_stage"], {"arm": arm, "stage": words["stage"][stage]})


def _format_span(interval: Interval | None, name: str, language: Language) -> str:
    """Format a range of a figure; empty without one."""
    if name.endswith("_percent"):
        return format_range(interval, language)
    if name.endswith("_deg"):
        return format_angle_range(interval, language, 1)
    return format_figure_range(interval, name, language) if interval else ""


def _name_figure(name: str, language: Language) -> str:
    return str(load_pair_words(language)["compare"]["table"]["figure"][name])


# The chapters.


def _build_means(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with the mean of each figure over the days of each arm; none if no day counts."""
    entry, tables = words["means"], []
    for arm in studied.arms:
        rows = tuple(
            (
                _name_figure(name, language),
                str(figure.days),
                format_figure(figure.mean, name, language),
                _format_span(figure.mean_range, name, language) or NONE,
                _format_pose(arm.find_pose_ends(name), name, language) or NONE,
                format_points(figure.sd, name, language),
                format_ends(figure.sd_range, 1, language) or NONE,
            )
            for name, figure in describe_arm(arm).items()
        )
        name = _name_arm(arm.side, arm.stage, language)
        if arm.counted:
            tables.append(Table(name, tuple(entry["columns"]), rows, note=entry["note"], even=True))
    if tables:
        yield Section("means", entry["title"], tables=tuple(tables))


def _build_levels(studied: StudiedDays, entry: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with each mean beside the proposed levels; none if no day counts."""
    named = [(_name_arm(arm.side, arm.stage, language), compare_arms([arm])) for arm in studied.arms]
    if studied.is_group:
        named = [
            (_name_arm(side, stage, language), compare_group(studied, side, stage))
            for side, stage, _ in list_groups(studied)
        ]
    is_part = any(day.kept.findings.extent == "part" for day in studied.days if day.left_out is None)
    ranges = {key: Interval(*ends) for key, ends in DAYS_ABOVE.items()}
    others = fill(entry["others"], {key: format_range(ends, language) for key, ends in ranges.items()})
    columns = (*load_pair_words(language)["levels"]["columns"], entry["column"])

    def lay(level: MeanLevel) -> tuple[str, ...]:
        days = {"above": str(level.days_above), "days": str(level.days)}
        return (*lay_level(level.mean, language), fill(entry["above"], days) if level.days else NONE)

    has_several = any(level.days > 1 for _, levels in named for level in levels)  # context for several days
    notes = (format_levels_note(language, is_part=is_part), entry["note"], others if has_several else "")
    note = " ".join(filter(None, notes))
    tables = tuple(
        Table(name, columns, tuple(lay(level) for level in levels), even=True)
        for name, levels in named
        if levels
    )
    if tables:
        shown = (*tables[:-1], replace(tables[-1], note=note))
        yield Section("levels", load_pair_words(language)["levels"]["title"], tables=shown)


def _build_group(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with the mean and spread of a group; none without figures."""
    entry, jobs, tables, by_job = words["group"], words["jobs"], [], []
    figure, counts, mean, span, _, *spreads = entry["columns"]
    for side, stage, figures in list_groups(studied):
        rows = tuple(
            (
                *cells[:4],
                _format_pose(find_group_pose(studied, name, side, stage), name, language) or NONE,
                *cells[4:],
            )
            for name, cells in _lay_spreads(figures, language)
        )
        caption, columns = _name_arm(side, stage, language), tuple(entry["columns"])
        tables.append(Table(caption, columns, rows, note=entry["note"], even=True))
    for side, stage, job, figures in list_jobs(studied):
        facts = {"arm": _name_arm(side, stage, language)}
        facts["job"] = " ".join(filter(None, (job.isco_code, job.title))) or jobs["other"]
        rows = tuple(cells for _, cells in _lay_spreads(figures, language))
        columns = (figure, counts, mean, span, *spreads)
        by_job.append(Table(fill(jobs["caption"], facts), columns, rows, even=True))
    if tables:
        yield Section("group", entry["title"], tables=tuple(tables))
    if by_job:
        by_job[-1] = replace(by_job[-1], note=jobs["note"])
        yield Section("jobs", jobs["title"], tables=tuple(by_job))


def _lay_spreads(
    figures: Mapping[str, GroupSpread], language: Language
) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Return each figure with its cells: its name, counts, mean, range and the two deviations."""
    for name, spread in figures.items():
        yield (
            name,
            (
                _name_figure(name, language),
                f"{spread.people} / {spread.days}",
                format_figure(spread.mean, name, language),
                _format_span(spread.mean_range, name, language) or NONE,
                format_points(spread.between_sd, name, language),
                format_points(spread.within_sd, name, language),
            ),
        )


def _build_changes(studied: StudiedDays, words: Words, language: Language) -> Iterator[Section]:
    """Build the chapter with the change of each arm: its range, or the minimal detectable change."""
    entry, tables = words["change"], []
    for side, figures in list_changes(studied):
        rows = tuple(
            (
                _name_figure(name, language),
                str(change["people"]),
                format_figure(change["before"], name, language),
                format_figure(change["after"], name, language),
                format_points(change["change"], name, language, is_signed=True)
                + mark_rounding(change["before"], change["after"], change["change"], name, "*"),
                format_ends(Interval(*change["change_range"]), 1, language)
                if change["change_range"]
                else NONE,
                format_points(change["detectable"], name, language),
                entry["verdict"][change["verdict"]],
            )
            for name, change in figures.items()
        )
        notes = (fill(entry["note"], {"source": SOURCE}), format_rounding_note(rows, language))
        caption, note = _name_arm(side, "all", language), " ".join(filter(None, notes))
        tables.append(Table(caption, tuple(entry["columns"]), rows, note=note, even=True))
    if tables:
        yield Section("changes", entry["title"], tables=tuple(tables))


def _build_days_table(studied: StudiedDays, words: Words, language: Language) -> Section:
    """Build a table of every day, earliest first, cut at a stated number of rows.

    A day is identified by its date, with arm and side of the change if there are two: "left, 3 March 2026".
    """
    entry, sides, rows = words["days"], load_wording(language)["side"], []
    verdicts = load_pair_words(language)["pair"]["verdict"]
    hours = _name_hours(studied.least_hours, language)
    for arm, day in ((one, day) for one in studied.arms for day in one.days):
        named = (
            str(sides[arm.side or "unknown"]) if len(studied.sides) > 1 else "",
            str(words["stage"][arm.stage]) if len(studied.stages) > 1 else "",
            format_date(day.start, language) if day.start else words["no_clock"],
        )
        findings, figures = day.kept.findings, day.list_figures()
        lasted = format_duration(findings.time.analysed_us / MICROSECONDS, language)
        shown = (
            NONE if (value := figures[name]) is None else format_figure(value, name, language)
            for name in FIGURES
        )
        rows.append(
            (
                ", ".join(filter(None, named)),
                f"{lasted} ({fill(words['left_out'][day.left_out], hours)})" if day.left_out else lasted,
                *shown,
                verdicts[findings.quality.verdict],
            )
        )
    first, second, last = entry["columns"]
    columns = (first, second, *(_name_figure(name, language) for name in FIGURES), last)
    note = entry["note"] if len(rows) <= MOST_DAYS else f"{entry['cut']} {entry['note']}"
    table = Table(entry["caption"], columns, tuple(rows[:MOST_DAYS]), note=note, even=True)
    return Section("days", entry["title"], tables=(table,))


def _build_sources(studied: StudiedDays, words: Words, language: Language) -> Section:
    """Build the table of the source of each day."""
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
