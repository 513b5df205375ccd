"""Each figure is declared once: its name, its place in results.json and its words follow from one entry."""

import json
import re
from collections.abc import Iterator
from typing import Any

import pytest

from acromion.app.report.export.results import build_results, encode_results
from acromion.app.report.figures import (
    GROUPS,
    RANGE_ENDS,
    REST_TABLE,
    TABLES,
    Column,
    Group,
    format_figure,
    read_figures,
    read_ranges,
)
from acromion.app.report.findings import Findings
from acromion.app.report.words.wording import LANGUAGES, Language, load_wording
from acromion.fusion.exposure.types import Interval
from tests.app.analysis_factory import make_analysis, make_exposure, make_subject


def results_of(**exposure: Any) -> dict[str, Any]:
    analysis = make_analysis(exposure=make_exposure(**exposure))
    results: dict[str, Any] = json.loads(encode_results(analysis, make_subject()))
    return results


def test_every_name_of_a_figure_or_column_stands_once_and_the_table_of_rest_has_its_words() -> None:
    figures = [figure.name for group in GROUPS for figure in group.figures if figure.name]
    tables = [[column.name for column in columns] for columns in TABLES.values()]
    rest = [set(load_wording(language)["measure"]["recovery"]["row"]) for language in LANGUAGES]

    assert len(figures) == len(set(figures))
    assert [names for names in tables if len(names) != len(set(names))] == []
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


@pytest.mark.parametrize("table", ["summary", "days", "hours", "periods", "tasks"])
def test_every_number_in_a_table_is_a_declared_figure(table: str) -> None:
    declared = {figure.name for group in GROUPS for figure in group.figures}
    known = {*declared, *read_figures(results_of()), *(f"{{figure}}{end}" for end in RANGE_ENDS)}

    numbers = {column.pattern for column in TABLES[table] if column.kind == "number"}
    own = {"start_s", "end_s", "periods", "time_above_60_less_rest_percent"}
    assert numbers - known <= (set() if table in ("summary", "days") else own)


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


# Every figure of results.json has a range, its own or one by its name, or a reason for having none.


ENDS = ("low", "high", "low_pose", "high_pose")
KEYS = ("lower_deg", "upper_deg", "threshold_deg", "length_s", "than_s", "start_s", "end_s", *ENDS)
"""What names a figure, says where it lies or is a range."""

EXCEPTIONS = {
    r"(bins|time_above|classes)\.duration_s": "its percent, which has a range, of the analysed time",
    r"episodes\.censored": "a fact of this recording: stays cut off by a hole, a break or its end",
    r"(by_hour|by_period|by_task)\.(analysed_s|recorded_s|periods)": "a length, known exactly",
    r"variation\.by_hour\..*\.hours": "how many hours were compared, known exactly",
    r"quarter_hours\.percent_above_60": "where to look; the worst has its range as the worst 15 min",
    r"(angle_edges_deg|duration_edges_s)": "edges of classes",
    r"intervals(_pose)?\..*": "the ranges themselves",
    r"^(analysed_s|metric_filter_hz|angle_sigma_deg|histogram_s|minutes\.\w+)": "what figures are made of",
    r"longest_start_s": "a place",
    r"^figures\.\w+": "the same figures by the names of the tables",
}


@pytest.fixture(scope="module")
def exposure(analysed: Findings) -> dict[str, Any]:
    results: dict[str, Any] = build_results(analysed, make_subject())
    told: dict[str, Any] = results["exposure"]
    return told


def list_figures(value: Any, path: str, above: tuple[dict[str, Any], ...]) -> Iterator[tuple[str, Any, Any]]:
    """Return (path, value, the objects around it) of every number."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from list_figures(inner, f"{path}.{key}" if path else key, (*above, value))
    elif isinstance(value, list):
        for inner in value:
            yield from list_figures(inner, path, above)
    elif isinstance(value, int | float) and not isinstance(value, bool):
        yield path, value, above


def find_names(path: str, around: tuple[dict[str, Any], ...]) -> list[str]:
    """Name the ranges that a figure may have: the rules by which names are made from places."""
    parts, last = path.split("."), around[-1]
    key = parts[-1]
    c, lower = f"{last.get('threshold_deg', 0):g}", f"{last.get('lower_deg') or 0:g}"
    upper = "up" if last.get("upper_deg") is None else f"{last['upper_deg']:g}"
    told = {
        "percentiles_deg": f"elevation_p{key}_deg",
        "entries": f"entries_above_{c}_{key.replace('per_hour', 'per_h')}",
        "episodes": f"episodes_above_{c}_{key.replace('per_hour', 'per_h')}",
        "cycles": f"cycles_{lower}_{upper}_count",
        "velocity_dps": f"{parts[1]}_velocity_{key if key == 'mean' else 'p' + key}_dps" if parts[1:] else "",
        "recovery": f"recovery_{key}",
        "peak": f"worst_{last.get('length_s', 0) // 60}_min_above_60_percent" if "windows" in parts else key,
        "variation": f"by_hour_{parts[-2]}_{key}" if "by_hour" in parts else f"eva_{key}",
    }
    names = [key, told.get(parts[0], "")]
    if "longer" in parts:
        stay = f"{around[-2]['threshold_deg']:g}"
        names = [f"episodes_above_{stay}_longer_than_{last['than_s']:g}_s_total_s"]
    return names


def has_range(path: str, around: tuple[dict[str, Any], ...], ranges: dict[str, Any]) -> bool:
    key = path.rsplit(".", 1)[-1]
    if key == "percent" and around[-1].get("low") is not None:
        return True
    if key in {"by_angle_percent", "by_duration_percent"}:
        ending = "deg_percent" if key == "by_angle_percent" else "s_percent"
        summed = [name for name in ranges if re.fullmatch(rf"eva_\d+_(\d+|up)_{ending}", name)]
        return len(summed) == len(around[-1][key])
    own = around[-1].get("intervals", {}) if path.startswith(("by_hour", "by_period", "by_task")) else ranges
    names = find_names(path, around)
    return any(name in own for name in names)


def test_every_figure_has_a_range_or_a_reason_for_none(exposure: dict[str, Any]) -> None:
    ranges = exposure["intervals"]

    without = {
        path
        for path, _, around in list_figures(exposure, "", ())
        if path.rsplit(".", 1)[-1] not in KEYS
        and not any(re.search(rf"{pattern}$", path) for pattern in EXCEPTIONS)
        and not has_range(path, around, ranges)
    }
    assert without == set()


def test_every_range_is_of_a_declared_figure(exposure: dict[str, Any]) -> None:
    figures = set(read_figures({"exposure": exposure}))

    classes = r"eva_\d+_(\d+|up)_(deg|s)_percent|episodes_above_\d+_longer_than_\d+_s_total_s"
    assert [n for n in exposure["intervals"] if n not in figures and not re.fullmatch(classes, n)] == []


def test_every_range_holds_its_figure_in_each_part_of_the_day(exposure: dict[str, Any]) -> None:
    parts = [*exposure["by_hour"], *exposure["by_period"], *exposure["by_task"]]

    outside = [
        (part["label"], name, part[name], interval)
        for part in parts
        for name, interval in part["intervals"].items()
        if not interval[0] - 1e-6 <= part[name] <= interval[1] + 1e-6
    ]
    assert outside == []
