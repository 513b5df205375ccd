"""`--profile` on the command line."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

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
