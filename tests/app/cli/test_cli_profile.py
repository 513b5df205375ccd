"""`--profile` on the command line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acromion.app.cli import app
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


@pytest.mark.parametrize(
    ("profile", "told"), [({"acceleration_unit": "stone"}, "E-PROFILE"), ("nobody", "nobody")]
)
def test_a_slip_in_the_profile_or_its_name_is_a_slip_in_the_command(
    log: Path, tmp_path: Path, profile: dict[str, str] | str, told: str
) -> None:
    named = profile if isinstance(profile, str) else save(tmp_path / "p.json", **profile)

    ended = CliRunner().invoke(app, ["run", str(log), "-o", str(tmp_path / "out"), "--profile", named])

    assert (ended.exit_code, told in ended.stderr) == (2, True)


def test_a_table_that_does_not_tell_its_columns_is_reported_through_a_profile_found_again_by_name(
    log: Path, tmp_path: Path
) -> None:
    run = ["run", str(log), "-o", str(tmp_path / "out"), "--report", "html"]
    profile = save(tmp_path / "our logger.json", name="our logger", rate_hz=None)

    refused, ended, again = (
        CliRunner().invoke(app, [*run, *more])
        for more in ([], ["--profile", profile], ["--profile", "our logger"])
    )

    assert (refused.exit_code, ended.exit_code, again.exit_code) == (3, 0, 0)
    assert "already done" in again.stdout
    folder = tmp_path / "out" / "shift"
    results = json.loads((folder / "results.json").read_text())
    assert results["time"]["analysed_s"] == 60.0
    assert results["recording"]["columns"] == PROFILE
    columns = "Acceleration: 2, 3, 4 (g) · Angular rate (gyroscope): 5, 6, 7 · Time: 1 (ms)"
    assert columns in (folder / "report.html").read_text()


def test_inspect_takes_the_same_profile(log: Path, tmp_path: Path) -> None:
    ended = CliRunner().invoke(app, ["inspect", str(log), "--json", "--profile", save(tmp_path / "p.json")])

    seen = json.loads(ended.stdout)
    assert (seen["recorded_s"], seen["sanity"]["rest_g"]) == (60.0, pytest.approx(1.0, abs=0.01))


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
