"""The charts and tables behind page 1: each figure with its range."""

import re
from dataclasses import replace

import pytest

from app.report.words.wording import LANGUAGES, Language
from fusion.exposure import Interval, PartExposure
from tests.app.analysis_factory import make_exposure
from tests.app.report.report_reading import plain, report_of, section_of, table_of


def test_the_distribution_and_the_heat_map_hold_all_of_the_time() -> None:
    curve, heat = section_of(report_of(), "spread").figures

    ends = [plain(cell) for row in (curve.table.rows[0], curve.table.rows[-1]) for cell in row]
    assert ends == ["10°", "14.3", "180°", "100.0"]
    assert [row[-1] for row in heat.table.rows] == ["20.0"] * 5


def test_the_range_of_a_percentile_stands_on_the_curve_as_the_language_writes_it() -> None:
    exposure = replace(make_exposure(), intervals={"elevation_p90_deg": Interval(47.2, 61.4)})

    curves = [
        section_of(report_of(exposure=exposure, language=each), "spread").figures[0] for each in LANGUAGES
    ]

    assert "P90: 54° (47–61°)" in curves[0].wide
    assert "P90\u00a0: 54°" in curves[1].wide


def test_a_period_that_was_left_out_is_hatched_and_never_a_bar() -> None:
    away = PartExposure("Lunch", 0.0, 1800.0, 0.0, {}, {}, None, "break", 1800.0, "break")
    work = replace(make_exposure().by_hour[1], label="Shelves", kind="task", recorded_s=3600.0)

    section = section_of(report_of(exposure=replace(make_exposure(), by_period=(away, work))), "hours")

    chart = section.figures[1]
    assert plain(chart.wide).count("left out, 30 min") == 2  # on the bar and in the description
    assert chart.table.rows[0][1:] == ("–",) * 4


def test_the_last_sample_of_a_recording_that_ends_on_the_hour_is_no_hour() -> None:
    hours = make_exposure().by_hour
    end_s = hours[-1].end_s
    sliver = PartExposure("16", end_s, end_s + 0.02, 0.02, {}, {}, None)

    section = section_of(report_of(exposure=replace(make_exposure(), by_hour=(*hours, sliver))), "hours")

    assert len(section.tables[0].rows) == len(section.figures[0].table.rows) == len(hours)


def test_the_bar_of_the_first_page_and_those_behind_it_show_the_same_classes() -> None:
    report = report_of()

    first, hours = report.figures[0].table, section_of(report, "hours").figures[0].table
    assert (
        tuple(row[0] for row in first.rows) == hours.columns[1:] == ("0–30°", "30–60°", "60–90°", "90–180°")
    )


def test_the_ranges_of_a_part_stand_under_its_figures() -> None:
    intervals = {
        "elevation_p50_deg": Interval(17.6, 29.6),
        "time_above_60_percent": Interval(5.0, 11.2),
        "entries_above_60_per_h": Interval(18.2, 44.9),
    }
    hour = replace(make_exposure().by_hour[1], intervals=intervals)

    table = section_of(report_of(exposure=replace(make_exposure(), by_hour=(hour,))), "hours").tables[0]

    assert [plain(cell) for cell in table.rows[1]] == [
        "95 % range", "", "", "18–30", "", "", "5.0–11.2", "", "18–45",
    ]  # fmt: skip


def test_a_task_of_one_period_repeats_no_ranges() -> None:
    hour = replace(make_exposure().by_hour[1], intervals={"elevation_p50_deg": Interval(17.6, 29.6)})
    tasks = (replace(hour, label="Shelves", periods=2), replace(hour, label="Ceiling"))

    table = section_of(report_of(exposure=replace(make_exposure(), by_task=tasks)), "hours").tables[-1]

    assert [row[0] for row in table.rows] == ["Shelves (2\u00a0×)", "95\u202f% range", "Ceiling"]


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_cycles_say_what_their_range_does_not_hold(language: Language) -> None:
    caption = {"en": "Movement cycles by range", "fr": "Cycles de mouvement par amplitude"}[language]
    tables = section_of(report_of(language=language), "figures").tables

    note = next(table.note for table in tables if table.caption == caption)
    assert re.search(r"4 (of|cas sur) 10", plain(note))


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_two_tables_bear_the_same_name(language: Language) -> None:
    report = report_of(language=language)
    figures = [*report.figures, *(f for s in report.sections for f in s.figures)]
    captions = [f.table.caption for f in figures] + [t.caption for s in report.sections for t in s.tables]

    assert len(captions) == len(set(captions))


def test_the_range_of_a_speed_of_rises_and_of_episodes_stands_under_them() -> None:
    known = {"inclination_velocity_p50_dps": Interval(13.25, 16.0)}
    names = ("entries_above_60_per_h", "episodes_above_60_longest_s")
    exposure = replace(make_exposure(), intervals=known | dict.fromkeys(names, Interval(20.0, 50.0)))
    report = report_of(exposure=exposure)

    speeds, rises = (table_of(report, "figures", caption).rows for caption in ("Speed", "Rises"))

    assert speeds[1] == ("95\u202f% range", "", "13.2–16.0", "", "", "")
    assert [plain(cell) for cell in rises[2][1:]] == ["", "20–50", "", "", "20 s–50 s", ""]


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_published_value_stands_in_the_table_behind_the_first_page(language: Language) -> None:
    report = report_of(language=language)

    (section,) = [section for section in report.sections if section.key == "published"]
    (table,) = section.tables
    published = [plain(row[2]).replace(",", ".") for row in table.rows]
    assert published == ["≤ 50 %", "≤ 10 %", "≤ 60°/s", "49–124°", "2.0–4.0 h", "4.4–7.9 %", "1.0–2.8 %"]
    assert "1.23" in section.paragraphs[0].replace(",", ".")
    assert {"en": "nothing about one person", "fr": "rien pour une personne"}[language] in section.paragraphs[
        0
    ]


def test_a_table_of_many_hours_is_cut_and_says_so() -> None:
    hour = make_exposure().by_hour[0]
    hours = tuple(replace(hour, start_s=3600.0 * k, end_s=3600.0 * (k + 1), intervals={}) for k in range(20))
    exposure = replace(make_exposure(), by_hour=hours)

    table = table_of(report_of(exposure=exposure), "hours", "By clock hour")

    assert len(table.rows) == 14
    assert "The first 14 of 20 rows; periods.csv and results.json hold all." in plain(table.note)


def test_a_table_of_a_shift_without_ranges_has_a_row_for_each_hour_and_is_not_cut() -> None:
    table = table_of(report_of(), "hours", "By clock hour")

    assert len(table.rows) == len(make_exposure().by_hour)
    assert "The first" not in table.note
