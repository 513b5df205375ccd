"""A recording beside its reference, through the pipeline and the command."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner, Result

from acromion.app.analysis.validate import make_validation
from acromion.app.cli import app
from acromion.app.report.agreement import format_drift, tabulate_lags
from acromion.app.report.model import Table
from acromion.app.report.words.wording import load_wording
from acromion.app.request import Reference, ReportRequest
from acromion.fusion.comparison.alignment import WindowLag
from acromion.fusion.diary import TaskWindow
from tests.simulated_mvnx import write_mvnx

STATISTICS = {"r", "rmse_deg", "mean_absolute_error_deg", "bias_deg", "loa_low_deg", "loa_high_deg"}


TASKS = (
    TaskWindow("first", 30.0, 90.0, 1),
    TaskWindow("first", 100.0, 130.0, 1),
    TaskWindow("next", 140.0, 200.0),
)


@pytest.fixture(scope="session")
def shift_mvnx(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The truth of the simulated shift as MVN saw it, begun 20 s earlier; 60 frames a second."""
    truth = pq.read_table(shift_gt3x.with_name("truth.parquet"))
    time_s, elevation_deg = (np.asarray(truth[name].to_numpy()) for name in ("time_s", "elevation_deg"))
    seen_s = np.arange(int((time_s[-1] + 20.0) * 60)) / 60 - 20.0
    folder = tmp_path_factory.mktemp("reference")
    return write_mvnx(folder / "reference.mvnx", np.interp(seen_s, time_s, elevation_deg), 60.0)


@pytest.fixture(scope="session")
def compared(shift_gt3x: Path, shift_mvnx: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one comparison with two tasks."""
    out = tmp_path_factory.mktemp("compared")
    given = Reference(str(shift_mvnx), shift_mvnx.name, tasks=TASKS)
    make_validation(shift_gt3x, ReportRequest("shift.gt3x", reference=given, side="right"), out)
    return out


@pytest.fixture(scope="session")
def validation(compared: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((compared / "validation.json").read_text())
    return found


def test_the_clock_of_the_reference_is_found(validation: dict[str, Any]) -> None:
    assert validation["alignment"]["offset_s"] == pytest.approx(20.0, abs=0.005)


@pytest.mark.parametrize(
    ("drift_ppm", "margin_ppm", "told"),
    [(58.23, 29.4, "58\u00a0±\u00a029"), (41.26, 0.36, "41.3\u00a0±\u00a00.4"), (40.0, None, "40.0")],
)
def test_a_drift_is_told_to_what_its_margin_bears(
    drift_ppm: float, margin_ppm: float | None, told: str
) -> None:
    assert format_drift(drift_ppm, margin_ppm, "en") == told


def test_overall_and_every_task_have_the_statistics_over_the_time_of_the_tasks(
    validation: dict[str, Any],
) -> None:
    overall, tasks = validation["overall"], validation["tasks"]

    assert all(set(part) >= STATISTICS for part in (overall, *tasks))
    assert [(task["name"], task["repetitions"]) for task in tasks] == [("first", 2), ("next", 1)]
    assert overall["duration_s"] == pytest.approx(60 + 30 + 60, abs=0.1)
    assert overall["rmse_deg"] < 1.0


def test_bias_is_the_difference_of_the_mean_percentile_figures_sign(validation: dict[str, Any]) -> None:
    figures = {figure["name"]: figure for figure in validation["exposure"]}

    p50 = figures["elevation_p50_deg"]
    assert p50["difference"] == pytest.approx(p50["ours"] - p50["reference"], abs=1e-5)


def test_page_pdf_and_table_are_written_with_the_figures_and_the_paper(
    compared: Path, validation: dict[str, Any]
) -> None:
    with (compared / "validation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    for ending in ("en.html", "fr.html", "en.pdf", "fr.pdf"):
        assert (compared / f"validation.{ending}").stat().st_size > 10_000
    assert float(rows[0]["rmse_deg"]) == validation["overall"]["rmse_deg"]
    # Table 1, flexion at 1 Hz, GT9X: RMSE 4.47 deg.
    assert "4.47°" in (compared / "validation.en.html").read_text()


def validate(log: Path, reference: Path, out: Path, *more: str) -> Result:
    return CliRunner().invoke(
        app, ["validate", str(log), "--reference", str(reference), "-o", str(out), *more]
    )


def test_a_clock_set_by_hand_is_kept_and_an_angle_file_may_be_judged_too(
    shift_gt3x: Path, shift_mvnx: Path, tmp_path: Path
) -> None:
    truth = shift_gt3x.with_name("truth.parquet")

    validate(shift_gt3x, truth, tmp_path / "by hand", "--offset-s", "0.25", "--drift-ppm", "-3")
    done = validate(shift_mvnx, truth, tmp_path / "angles")

    assert done.exit_code == 0, done.output
    by_hand, found = (
        json.loads((tmp_path / name / "validation.json").read_text())["alignment"]
        for name in ("by hand", "angles")
    )
    assert (by_hand["offset_s"], by_hand["drift_ppm"]) == (0.25, -3.0)
    # Here the truth's clock stands 20 s behind MVN's.
    assert found["offset_s"] == pytest.approx(-20.0, abs=0.005)


def test_a_reference_of_something_else_and_tasks_that_cannot_be_read_are_refused_with_their_codes(
    shift_gt3x: Path, tmp_path: Path
) -> None:
    angles = np.random.default_rng(0).uniform(0, 90, 6000)
    rows = "".join(f"{k / 60:.4f},{a:.2f}\n" for k, a in enumerate(angles))
    (tmp_path / "other.csv").write_text(f"time_s,elevation_deg\n{rows}")
    (tmp_path / "tasks.csv").write_text("name,start_s,end_s\nlift,20,10\n")

    other = validate(shift_gt3x, tmp_path / "other.csv", tmp_path)
    reversed_ = validate(shift_gt3x, shift_gt3x, tmp_path, "--tasks", str(tmp_path / "tasks.csv"))

    assert (other.exit_code, "E-ALIGN" in other.output) == (3, True)
    assert (reversed_.exit_code, "E-TASKS" in reversed_.output) == (2, True)


def test_a_motion_capture_is_told_for_what_it_is(shift_mvnx: Path) -> None:
    done = CliRunner().invoke(app, ["inspect", str(shift_mvnx), "--json"])

    found = json.loads(done.stdout)
    assert (done.exit_code, found["device"], found["rate_hz"], found["gaps"]) == (0, "mvn", 60.0, [])
    assert found["understood"]["segment"] == "RightUpperArm"
    assert found["present_s"] == found["recorded_s"]


def test_the_sheet_names_the_facts_of_the_reference_in_words(compared: Path) -> None:
    sheet = (compared / "validation.en.html").read_text()

    assert "Segment: RightUpperArm" in sheet
    assert "t_pose_elevation_deg" not in sheet


@pytest.mark.real_recordings
def test_a_motion_capture_is_a_recording_of_its_own(
    shared_data: Callable[[str], Path], tmp_path: Path
) -> None:
    path = shared_data("xsens/test_mocap.mvnx")

    done = CliRunner().invoke(app, ["run", str(path), "-o", str(tmp_path), "--report", "html"])

    results = json.loads((tmp_path / "test_mocap" / "results.json").read_text())
    assert done.exit_code == 0
    assert (results["recording"]["device"], results["recording"]["rate_hz"]) == ("mvn", 60.0)
    # 112 frames at 60 a second.
    assert results["time"]["analysed_s"] == pytest.approx(112 / 60, abs=1e-5)


# The lags of the clocks in the report: all of a few, an even choice of many.


def tabulate(count: int) -> Table:
    windows = [WindowLag(10.0 * k, 0.001 * k, 0.99) for k in range(count)]
    return tabulate_lags(windows, load_wording("en", "agreement"), "en")


@pytest.mark.parametrize("count", [0, 1, 12])
def test_a_few_stretches_are_all_shown(count: int) -> None:
    table = tabulate(count)

    assert len(table.rows) == count
    assert "Shown are" not in table.note


def test_of_many_twelve_are_shown_from_the_first_to_the_last() -> None:
    table = tabulate(60)

    # 59 / 11 = 5.36 stretches from one to the next
    places = [0, 5, 11, 16, 21, 27, 32, 38, 43, 48, 54, 59]
    assert [row[0] for row in table.rows] == [str(10 * place) for place in places]
    assert table.note.endswith("Shown are 12 of 60 stretches, evenly spread; validation.json has all.")
