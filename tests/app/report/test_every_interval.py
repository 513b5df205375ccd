"""Every figure of results.json has a range, its own or one by its name, or a reason for having none."""

import re
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from app.report.export.results import build_results
from app.report.figures import read_figures
from app.report.findings import Findings
from tests.app.analysis_factory import make_subject

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
}


@pytest.fixture(scope="module")
def exposure(analysed: Findings) -> dict[str, Any]:
    results: dict[str, Any] = build_results(analysed, make_subject())
    told: dict[str, Any] = results["exposure"]
    return told


def list_figures(value: Any, path: str, above: tuple[dict[str, Any], ...]) -> Iterator[tuple[str, Any, Any]]:
    """Give (path, value, the objects around it) of every number."""
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


def test_periods_of_one_label_are_one_task(exposure: dict[str, Any]) -> None:
    (task,) = [part for part in exposure["by_task"] if part["label"] == "a"]
    periods = [part for part in exposure["by_period"] if part["label"] == "a"]

    assert task["periods"] == len(periods) == 2
    assert task["analysed_s"] == pytest.approx(sum(part["analysed_s"] for part in periods), abs=1e-9)
    above_s = sum(part["time_above_60_percent"] * part["analysed_s"] for part in periods)
    assert task["time_above_60_percent"] == pytest.approx(above_s / task["analysed_s"], abs=1e-6)


def test_the_tasks_add_up_to_the_recording(exposure: dict[str, Any]) -> None:
    told_s = sum(part["recorded_s"] for part in exposure["by_task"])

    assert told_s == pytest.approx(np.sum([part["recorded_s"] for part in exposure["by_period"]]), abs=1e-6)
