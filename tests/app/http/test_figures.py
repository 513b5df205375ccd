"""The figures on a recording's page, with the figures of the version before."""

import re
from typing import Any

import pytest

from acromion.app.http.pages.recording.figures import FigureRow, build_figures, format_difference


def plain(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def write_results(percent: float, high: float, **changes: Any) -> dict[str, Any]:
    """Write the parts of ``results.json`` that the page reads; above 60 deg at most ``high`` by the pose."""
    above = {"low": percent - 1.0, "high": percent + 1.0, "high_pose": high, "low_pose": percent - 1.0}
    exposure = {
        "time_above": [{"threshold_deg": 60, "duration_s": 360.0, "percent": percent, **above}],
        "percentiles_deg": {"50": 26.6},
        "intervals": {"elevation_p50_deg": [20.2, 30.7]},
        "by_task": [],
    }
    return {
        "time": {"recorded_s": 7200.0, "analysed_s": 7200.0},
        "exposure": exposure,
        "method": {"name": "smoothed"},
        "quality": {"verdict": "good"},
        "calibration": {"state": "given", "needs_pose": False},
    } | changes


def find(rows: tuple[FigureRow, ...], name: str) -> list[str]:
    """Return the values of a row and, behind them, the difference."""
    (row,) = (row for row in rows if row.name == name)
    return [*(plain(cell.value) for cell in row.cells), plain(row.difference)]


@pytest.mark.parametrize(
    ("name", "before", "now", "told"),
    [
        ("time_above_60_percent", 7.54, 7.46, "same"),  # 7.5 and 7.5
        ("time_above_60_percent", 7.54, 5.04, "−2.5 points"),
        ("time_above_60_percent", 5.0, 6.0, "+1.0 points"),
        ("elevation_p50_deg", 26.4, 26.6, "+1°"),  # 26 and 27
        ("entries_above_60_count", 214, 198, "−16"),
        ("analysed_s", 7200.0, 6300.0, "−15 min"),
        ("entries_above_60_per_h", None, 12.0, "changed"),
    ],
)
def test_a_difference_is_that_of_the_printed_values(
    name: str, before: float | None, now: float | None, told: str
) -> None:
    assert plain(format_difference((before, now), name, "en")) == told


def test_the_bound_of_the_pose_and_the_evidence_for_it_have_a_difference() -> None:
    assumed = {"calibration": {"state": "assumed", "needs_pose": False}, "quality": {"verdict": "caution"}}

    rows = build_figures(write_results(7.5, 12.3), write_results(7.5, 33.9, **assumed), "en")

    assert find(rows, "Time above 60° at most, if the pose read low") == ["33.9 %", "12.3 %", "−21.6 points"]
    assert find(rows, "Data quality") == ["use with care", "good data", "changed"]
    assert find(rows, "Calibration pose") == ["assumed, not confirmed", "stated", "changed"]


def test_a_value_has_its_duration_and_its_range_below_it() -> None:
    rows = build_figures(write_results(7.5, 8.5), None, "en")

    assert [plain(row.cells[0].more) for row in rows[:2]] == ["6 min · 95 %: 6.5–8.5 %", "95 %: 20–31°"]
    assert [len(row.cells) for row in rows] == [1] * 3
