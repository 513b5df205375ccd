"""`--profile` on the command line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from app.batch.folder import format_folder_name
from app.cli import app
from tests.badfiles.table_files import values

PROFILE = {
    "acceleration": [2, 3, 4],
    "angular_rate": [5, 6, 7],
    "acceleration_unit": "g",
    "time": 1,
    "time_unit": "ms",
}


@pytest.fixture
def log(tmp_path: Path) -> Path:
    """A minute of a table without a header."""
    path = tmp_path / "shift.csv"
    path.write_text("".join(f"{10 * k},{row}\n" for k, row in enumerate(values())))
    return path


def save(path: Path, **changes: object) -> str:
    path.write_text(json.dumps(PROFILE | changes))
    return str(path)


def test_a_table_that_does_not_tell_its_columns_is_reported_through_a_profile(
    log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    options = ["-o", str(out), "--report", "html", "--profile", save(tmp_path / "p.json")]

    refused = CliRunner().invoke(app, ["run", str(log), *options[:4]])
    ended = CliRunner().invoke(app, ["run", str(log), *options])

    assert (refused.exit_code, ended.exit_code) == (3, 0)
    assert json.loads((out / "shift" / "results.json").read_text())["time"]["analysed_s"] == 60.0


def test_inspect_takes_the_same_profile(log: Path, tmp_path: Path) -> None:
    ended = CliRunner().invoke(app, ["inspect", str(log), "--json", "--profile", save(tmp_path / "p.json")])

    seen = json.loads(ended.stdout)
    assert (seen["recorded_s"], seen["sanity"]["rest_g"]) == (60.0, pytest.approx(1.0, abs=0.01))


def test_a_slip_in_the_profile_is_a_slip_in_the_command(log: Path, tmp_path: Path) -> None:
    wrong = save(tmp_path / "p.json", acceleration_unit="stone")

    ended = CliRunner().invoke(app, ["run", str(log), "-o", str(tmp_path / "out"), "--profile", wrong])

    assert ended.exit_code == 2
    assert "E-PROFILE" in ended.stderr


def test_a_profile_that_was_used_is_found_again_by_its_name(log: Path, tmp_path: Path) -> None:
    run = ["run", str(log), "-o", str(tmp_path / "out"), "--report", "html", "--profile"]

    first = CliRunner().invoke(app, [*run, save(tmp_path / "our logger.json")])
    again = CliRunner().invoke(app, [*run, "our logger"])

    assert (first.exit_code, again.exit_code) == (0, 0)
    assert "already done" in again.stdout


def test_a_name_that_no_profile_of_the_folder_has_is_a_slip_in_the_command(log: Path, tmp_path: Path) -> None:
    ended = CliRunner().invoke(app, ["run", str(log), "-o", str(tmp_path / "out"), "--profile", "nobody"])

    assert ended.exit_code == 2
    assert "nobody" in ended.stderr


def test_the_columns_are_a_setting_that_the_results_and_the_report_state(log: Path, tmp_path: Path) -> None:
    profile = save(tmp_path / "p.json", name="our logger", rate_hz=None)

    CliRunner().invoke(app, ["run", str(log), "-o", str(tmp_path), "--report", "html", "--profile", profile])

    results = json.loads((tmp_path / "shift" / "results.json").read_text())
    report = (tmp_path / "shift" / "report.html").read_text()
    assert results["recording"]["columns"] == PROFILE
    assert "Acceleration: 2, 3, 4 (g) · Angular rate (gyroscope): 5, 6, 7 · Time: 1 (ms)" in report


def test_a_recording_never_takes_the_folder_of_the_profiles(tmp_path: Path) -> None:
    assert format_folder_name(tmp_path / "profiles.csv") == "profiles_"


SENSORS = "sensor," + ",".join(["left"] * 6 + ["right"] * 6)
NAMES = "time_ms," + ",".join(2 * ["ax_g", "ay_g", "az_g", "gx_dps", "gy_dps", "gz_dps"])


@pytest.fixture
def two_sensors(tmp_path: Path) -> Path:
    """A minute of two sensors beside each other."""
    path = tmp_path / "two.csv"
    rows = (f"{10 * k},{row},{row}\n" for k, row in enumerate(values()))
    path.write_text(f"{SENSORS}\n{NAMES}\n" + "".join(rows))
    return path


def test_a_table_of_two_sensors_asks_which_one_is_on_the_arm(two_sensors: Path) -> None:
    ended = CliRunner().invoke(app, ["inspect", str(two_sensors)])

    assert ended.exit_code == 3
    assert "left, right" in ended.stderr
    assert "--sensor" in ended.stderr


def test_the_sensor_on_the_arm_is_named_on_the_command_line(two_sensors: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    run = ["run", str(two_sensors), "-o", str(out), "--report", "html", "--sensor", "right"]

    ended = CliRunner().invoke(app, run)

    results = json.loads((out / "two" / "results.json").read_text())
    assert ended.exit_code == 0
    assert results["recording"]["columns"] == {"sensor": "right"}
