"""The test signals for other software: what is expected of them, and that ours gives it."""

import csv
from math import acos, pi
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from fusion.angle_series import read_angle_series
from fusion.exposure import summarise_exposure

Row = tuple[str, str, float]


def conform(folder: Path) -> Result:
    return CliRunner().invoke(app, ["conformance", str(folder)])


def read_expected(folder: Path) -> list[Row]:
    with (folder / "expected.csv").open(encoding="utf-8", newline="") as file:
        return [(row["signal"], row["figure"], float(row["value"])) for row in csv.DictReader(file)]


def write_results(folder: Path, rows: list[Row]) -> None:
    with (folder / "results.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([("signal", "figure", "value"), *rows])


def measure(path: Path) -> dict[str, float | None]:
    """The figures of page 1 as our own code gives them."""
    with path.open("rb") as file:
        _, elevation = read_angle_series(file)
    exposure = summarise_exposure(elevation)
    window = next(window for window in exposure.peak_windows if window.length_s == 900)
    return {
        **{f"time_above_{item.threshold_deg:g}_percent": item.percent for item in exposure.time_above},
        "entries_above_60_per_h": next(e.per_hour for e in exposure.entries if e.threshold_deg == 60),
        "episodes_above_60_longest_s": next(e.longest_s for e in exposure.episodes if e.threshold_deg == 60),
        "elevation_p50_deg": exposure.percentiles_deg[50],
        "worst_15_min_above_60_percent": window.percent_above_60,
        "worst_15_min_start_s": window.start_s,
        "analysed_s": exposure.analysed_s,
    }


def test_our_own_figures_lie_within_every_tolerance(tmp_path: Path) -> None:
    conform(tmp_path)
    rows = read_expected(tmp_path)
    measured = {signal: measure(tmp_path / f"{signal}.csv") for signal in {row[0] for row in rows}}
    write_results(tmp_path, [(signal, figure, measured[signal][figure] or 0.0) for signal, figure, _ in rows])

    told = conform(tmp_path)

    assert [line for line in told.output.splitlines() if line.startswith(("OUTSIDE", "MISSING"))] == []
    assert f"{len(rows)} of {len(rows)} figures" in told.output
    assert told.exit_code == 0


def test_without_results_it_says_what_to_lay_beside_the_signals(tmp_path: Path) -> None:
    told = conform(tmp_path)

    assert told.exit_code == 0
    assert "signal,figure,value" in told.output
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["day.csv", "expected.csv", "hold.csv", "hole.csv", "ripple.csv", "swing.csv"]


@pytest.mark.parametrize(
    ("given", "line"),
    [(33.7, "OUTSIDE hold time_above_60_percent: expected 33.3333 ± 0.3 %, given 33.7"), (33.6, "ok hold ")],
)
def test_a_figure_beyond_its_tolerance_is_named(tmp_path: Path, given: float, line: str) -> None:
    write_results(tmp_path, [("hold", "time_above_60_percent", given)])

    told = conform(tmp_path)

    assert line in told.output
    assert told.exit_code == 1  # the others are missing


def test_a_figure_that_is_not_given_is_missing(tmp_path: Path) -> None:
    conform(tmp_path)
    write_results(tmp_path, [row for row in read_expected(tmp_path) if row[:2] != ("hole", "analysed_s")])

    told = conform(tmp_path)

    assert "MISSING hole analysed_s" in told.output
    assert told.exit_code == 1


def test_a_word_for_a_number_is_missing(tmp_path: Path) -> None:
    (tmp_path / "results.csv").write_text("signal,figure,value\nday,worst_15_min_start_s,noon\n")

    assert "MISSING day worst_15_min_start_s" in conform(tmp_path).output


def test_the_swing_is_above_60_deg_for_the_share_that_its_arc_says(tmp_path: Path) -> None:
    conform(tmp_path)

    expected = {(signal, figure): value for signal, figure, value in read_expected(tmp_path)}
    assert expected["swing", "time_above_60_percent"] == pytest.approx(100 * acos(15 / 40) / pi, abs=1e-4)


def test_a_hole_has_no_value_in_its_file(tmp_path: Path) -> None:
    conform(tmp_path)

    lines = (tmp_path / "hole.csv").read_text().splitlines()
    assert (lines[1], lines[1 + 30_000]) == ("0.025,35.000000", "1500.025,")
