"""The test signals for other software: what is expected of them, and that ours gives it."""

import csv
from collections.abc import Sequence
from math import acos, pi
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from acromion.app.cli import app
from acromion.fusion.angle_files.angle_series import read_angle_series
from acromion.fusion.exposure.summary import summarise_exposure

Row = tuple[str, str, float]


def conform(folder: Path) -> Result:
    return CliRunner().invoke(app, ["conformance", str(folder)])


def read_expected(folder: Path) -> list[Row]:
    with (folder / "expected.csv").open(encoding="utf-8", newline="") as file:
        return [(row["signal"], row["figure"], float(row["value"])) for row in csv.DictReader(file)]


def write_results(folder: Path, rows: Sequence[tuple[str, str, float | str]]) -> None:
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


@pytest.fixture(scope="module")
def signals(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the signals and of what is expected; results of any test lie in it for a while."""
    folder = tmp_path_factory.mktemp("signals")
    told = conform(folder)
    assert told.exit_code == 0
    assert "signal,figure,value" in told.output  # what to put beside the signals
    return folder


def test_the_signals_lie_beside_what_is_expected_and_a_hole_has_no_value(signals: Path) -> None:
    names = {path.name for path in signals.iterdir()} - {"results.csv"}
    lines = (signals / "hole.csv").read_text().splitlines()

    assert names == {"day.csv", "expected.csv", "hold.csv", "hole.csv", "ripple.csv", "swing.csv"}
    assert (lines[1], lines[1 + 30_000]) == ("0.025,35.000000", "1500.025,")


def test_the_swing_is_above_60_deg_for_the_share_that_its_arc_says(signals: Path) -> None:
    expected = {(signal, figure): value for signal, figure, value in read_expected(signals)}

    assert expected["swing", "time_above_60_percent"] == pytest.approx(100 * acos(15 / 40) / pi, abs=1e-4)


def test_our_own_figures_lie_within_every_tolerance(signals: Path) -> None:
    rows = read_expected(signals)
    measured = {signal: measure(signals / f"{signal}.csv") for signal in {row[0] for row in rows}}
    write_results(signals, [(signal, figure, measured[signal][figure] or 0.0) for signal, figure, _ in rows])

    told = conform(signals)

    assert [line for line in told.output.splitlines() if line.startswith(("OUTSIDE", "MISSING"))] == []
    assert f"{len(rows)} of {len(rows)} figures" in told.output
    assert told.exit_code == 0


def test_a_figure_beyond_its_tolerance_that_is_missing_or_no_number_is_named(signals: Path) -> None:
    given: dict[tuple[str, str], float | str] = {
        ("hold", "time_above_60_percent"): 33.7,
        ("day", "worst_15_min_start_s"): "noon",
    }
    rows = [(*row[:2], given.get(row[:2], row[2])) for row in read_expected(signals)]
    write_results(signals, [row for row in rows if row[:2] != ("hole", "analysed_s")])

    told = conform(signals)

    assert told.exit_code == 1
    for line in (
        "OUTSIDE hold time_above_60_percent: expected 33.3333 ± 0.3 %, given 33.7",
        "MISSING day worst_15_min_start_s",
        "MISSING hole analysed_s",
    ):
        assert line in told.output


def test_a_figure_at_the_edge_of_its_tolerance_is_within(signals: Path) -> None:
    write_results(signals, [("hold", "time_above_60_percent", 33.6)])

    assert "ok hold " in conform(signals).output
