"""The tutorial does what it says: its commands run, its addresses exist."""

import contextlib
import re
from pathlib import Path

import pytest
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.main import create_app
from acromion.app.report.words.wording import load_wording
from acromion.app.settings import Settings
from tests import ROOT

TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text("utf-8")
BLOCKS = re.findall(r"```(\w+)(?: ([\w.]+))?\n(.*?)```", TUTORIAL, re.DOTALL)


@pytest.fixture(scope="module")
def tutorial_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Follow the tutorial from top to bottom, with a shift of twelve minutes instead of eight hours."""
    folder = tmp_path_factory.mktemp("tutorial")
    for language, name, body in BLOCKS:
        if language == "csv":
            (folder / name).write_text(body.replace("10:00", "07:05").replace("10:15", "07:06"), "utf-8")
        elif name != "serve":
            run_line(body.strip().replace("--hours 8", "--hours 0.2"), folder)
    return folder


def run_line(line: str, folder: Path) -> None:
    program, *words = line.split()
    assert program == "acromion"
    with contextlib.chdir(folder):
        result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output


@pytest.mark.parametrize("name", sorted(set(re.findall(r"^\| (`[^|]+) \|", TUTORIAL, re.MULTILINE))))
def test_the_folder_holds_every_file_that_the_tutorial_names(tutorial_folder: Path, name: str) -> None:
    made = {path.name for path in (tutorial_folder / "results" / "shift_seed1").iterdir()}

    assert set(re.findall(r"`([^`]+)`", name)) <= made


def test_the_ready_angles_give_a_report_in_french(tutorial_folder: Path) -> None:
    page = (tutorial_folder / "from-angles" / "angles" / "report.html").read_text("utf-8")

    assert '<html lang="fr">' in page


def test_every_address_of_the_tutorial_exists(tmp_path: Path) -> None:
    known = create_app(Settings(data_dir=tmp_path)).openapi()["paths"]
    patterns = [re.sub(r"\{[^}]+\}", "[^/]+", path) + "$" for path in known]

    asked = re.findall(r"(/api/v1/[\w/.]+)", TUTORIAL)

    assert [path for path in asked if not any(re.match(pattern, path) for pattern in patterns)] == []


@pytest.mark.parametrize("folder", ["both/both-arms", "compared/before-after"])
def test_the_reports_of_two_are_made(tutorial_folder: Path, folder: str) -> None:
    made = {path.name for path in (tutorial_folder / folder).iterdir()}

    assert made >= {"report.html", "report.pdf", "answer.txt"}


def test_a_page_says_which_export_is_needed() -> None:
    page = (ROOT / "docs" / "exports.md").read_text("utf-8")

    heading = load_wording("en", "help")["export"]
    assert heading in load_wording("en")["problem"]["E-EPOCH"]["fix"]
    assert [
        code for code in re.findall(r"`(E-[A-Z0-9-]+)`", page) if code not in load_wording("en")["problem"]
    ] == []
