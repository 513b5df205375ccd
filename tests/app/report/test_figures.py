"""Each figure is declared once: its name, its place in results.json and its words follow from one entry."""

import json
from typing import Any

import pytest

from app.report.export.results import encode_results
from app.report.figures import (
    GROUPS,
    PERIODS,
    RANGE_ENDS,
    REST_TABLE,
    SUMMARY,
    Column,
    Group,
    format_figure,
    read_figures,
    read_ranges,
)
from app.report.words.wording import LANGUAGES, Language, load_wording
from fusion.exposure import Interval
from tests.app.analysis_factory import make_analysis, make_exposure, make_subject


def results_of(**exposure: Any) -> dict[str, Any]:
    analysis = make_analysis(exposure=make_exposure(**exposure))
    results: dict[str, Any] = json.loads(encode_results(analysis, make_subject()))
    return results


def test_every_name_of_a_figure_or_column_stands_once_and_the_table_of_rest_has_its_words() -> None:
    figures = [figure.name for group in GROUPS for figure in group.figures if figure.name]
    columns = [column.name for column in PERIODS]
    rest = [set(load_wording(language)["measure"]["recovery"]["row"]) for language in LANGUAGES]

    assert (len(figures), len(columns)) == (len(set(figures)), len(set(columns)))
    assert rest == [set(REST_TABLE)] * 2


@pytest.mark.parametrize("group", GROUPS, ids=lambda group: group.path)
def test_every_figure_is_explained_at_its_place(group: Group) -> None:
    explained = load_wording("en", "fields")

    assert [f.key for f in group.figures if f"{group.path}.{f.key}".removesuffix(".") not in explained] == []


def test_a_figure_is_read_by_its_name() -> None:
    results = results_of()
    figures = read_figures(results)

    assert figures["time_above_60_percent"] == results["exposure"]["time_above"][1]["percent"]
    assert figures["elevation_p90_deg"] == results["exposure"]["percentiles_deg"]["90"]
    assert figures["worst_15_min_above_60_percent"] in {
        window["percent_above_60"] for window in results["exposure"]["peak"]["windows"]
    }


def test_a_range_is_read_by_the_name_of_its_figure() -> None:
    ranges = read_ranges(results_of(above_60_interval=Interval(6.0, 9.5)))

    assert ranges["time_above_60_percent"] == (6.0, 9.5)
    assert "time_above_30_percent" not in ranges


@pytest.mark.parametrize("columns", [SUMMARY, PERIODS], ids=["summary", "periods"])
def test_every_number_in_a_table_is_a_declared_figure(columns: tuple[Column, ...]) -> None:
    declared = {figure.name for group in GROUPS for figure in group.figures}
    known = {*declared, *read_figures(results_of()), *(f"{{figure}}{end}" for end in RANGE_ENDS)}

    numbers = {column.pattern for column in columns if column.kind == "number"}
    assert numbers - known == ({"start_s", "end_s", "periods"} if columns is PERIODS else set())


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_column_without_words_of_its_own_has_those_of_its_field(language: Language) -> None:
    column = Column("recovery_slow_percent")

    assert column.explain(language) == load_wording(language, "fields")["exposure.recovery.slow_percent"]


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("time_above_60_percent", "12.3\u202f%"),
        ("elevation_p50_deg", "12.3°"),
        ("inclination_velocity_mpf_hz", "12.34\u202fHz"),
        ("recovery_longest_without_s", "12\u202fs"),
        ("entries_above_60_per_h", "12"),
    ],
)
def test_a_figure_is_written_in_the_unit_of_its_name(name: str, told: str) -> None:
    assert format_figure(12.34, name, "en") == told
