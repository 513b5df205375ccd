"""A study: a folder of people and devices, one table over people."""

import csv
import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser
from typer.testing import CliRunner

from acromion.app.analysis.validate import find_study_files
from acromion.app.cli import app
from acromion.app.report.agreement import build_study
from acromion.app.report.findings import Software
from acromion.app.report.render.html import render_html
from acromion.fusion.comparison.agreement import AgreementEntry, measure_agreement, summarise_agreement_study
from acromion.fusion.errors import UnusableStudy
from tests.fusion.comparison.test_agreement import OURS, REFERENCE
from tests.simulated_tasks import TITLES

Done = tuple[int, Path]


@pytest.fixture(scope="module")
def study(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two people with one recording each; a file that is none, one without reference, a task reversed."""
    folder = tmp_path_factory.mktemp("study")
    for person in ("P01", "P02"):
        (folder / person).mkdir()
        shutil.copy(shift_gt3x, folder / person / "gt9x.gt3x")
        shutil.copy(shift_gt3x.with_name("truth.parquet"), folder / person / "reference.parquet")
        (folder / person / "tasks.csv").write_text("name,start_s,end_s,paper_task\nwork,30,150,4\n")
    (folder / "P02" / "broken.csv").write_text("a,b\n1,2\n")
    shutil.copytree(folder / "P01", folder / "P03")
    (folder / "P03" / "reference.parquet").unlink()
    shutil.copytree(folder / "P01", folder / "P04")
    (folder / "P04" / "tasks.csv").write_text("name,start_s,end_s\nwork,150,30\n")
    return folder


@pytest.fixture(scope="module")
def done(study: Path, tmp_path_factory: pytest.TempPathFactory) -> Done:
    """The exit code and the folder of the study's results."""
    out = tmp_path_factory.mktemp("result")
    told = CliRunner().invoke(app, ["validate", str(study), "-o", str(out), "--lang", "fr"])
    return told.exit_code, out


def test_a_study_lists_what_failed_with_its_place(done: Done) -> None:
    with (done[1] / "problems.csv").open(newline="") as file:
        rows = {(row["file"], row["code"]) for row in csv.DictReader(file)}

    assert done[0] == 1
    assert rows == {
        ("P02/broken.csv", "E-TYPE"),
        ("P03/gt9x.gt3x", "E-REFERENCE"),
        ("P04/gt9x.gt3x", "E-TASKS"),
    }


def test_the_table_counts_people_without_spread_if_they_are_one_and_holds_the_paper(done: Done) -> None:
    study: dict[str, Any] = json.loads((done[1] / "study.json").read_text())
    with (done[1] / "table.csv").open(newline="") as file:
        row = next(csv.DictReader(file))

    # Table 1, abduction at 1 Hz, GT9X.
    assert (row["people"], row["paper_rmse_deg"], row["paper_r"]) == ("2", "3.05", "0.998")
    assert study["table"][0]["rmse_deg"]["sd"] == 0.0


def test_the_sheet_is_written_in_the_language_asked_for(done: Done) -> None:
    assert "Accord avec une référence" in (done[1] / "study.html").read_text()
    assert (done[1] / "study.pdf").read_bytes().startswith(b"%PDF-")


def test_a_folder_without_a_reference_is_refused(tmp_path: Path) -> None:
    (tmp_path / "shift.gt3x").write_bytes(b"x")

    with pytest.raises(UnusableStudy):
        find_study_files(tmp_path, tmp_path / "out")


def test_a_folder_below_the_person_is_a_task(tmp_path: Path) -> None:
    folder = tmp_path / "P07" / "task-03 flexion"
    folder.mkdir(parents=True)
    for name in ("reference.csv", "gt9x.gt3x", "tasks.csv", "truth.parquet"):
        (folder / name).write_bytes(b"x")

    files = find_study_files(tmp_path, tmp_path / "out")

    told = [(file.recording_path.name, file.person, file.task, file.paper_task) for file in files]
    assert told == [("gt9x.gt3x", "P07", "task-03 flexion", 3)]


def test_means_are_over_people_and_one_person_has_no_standard_deviation() -> None:
    # P1 has errors of 1 and 3 deg in two recordings, P2 of 6 deg: mean of 2 and 6.
    entries = [
        AgreementEntry(person, "gt9x", "lift", None, measure_agreement(REFERENCE + error, REFERENCE, 1.0))
        for person, error in (("P1", 1.0), ("P1", 3.0), ("P2", 6.0))
    ]

    both, one = (summarise_agreement_study(some)[0] for some in (entries, entries[:1]))

    assert both.people == 2
    assert both.rmse_deg.mean == pytest.approx(4.0)
    assert one.rmse_deg.sd != one.rmse_deg.sd


def test_r_is_not_given_where_it_is_quasi_static_for_most() -> None:
    moving, still = measure_agreement(OURS, REFERENCE, 1.0), measure_agreement(OURS / 10, REFERENCE / 10, 1.0)
    people = (("P1", moving), ("P2", still), ("P3", still))

    cell = summarise_agreement_study(
        [AgreementEntry(person, "gt9x", "hold", None, one) for person, one in people]
    )[0]

    assert (cell.r.mean != cell.r.mean, cell.r.people, cell.rmse_deg.people) == (True, 1, 3)


def test_the_table_of_two_devices_fits_the_page(browser: Browser, study_of_two_devices: Path) -> None:
    page = browser.new_page(viewport={"width": 1200, "height": 900})
    page.goto(study_of_two_devices.as_uri())
    box = page.locator(".scroll").first

    widths = (box.evaluate("box => box.scrollWidth"), box.evaluate("box => box.clientWidth"))

    page.close()
    assert widths[0] == widths[1]


@pytest.fixture
def study_of_two_devices(tmp_path: Path) -> Path:
    """The page of ten of the paper's tasks with both devices."""
    agreement = measure_agreement(OURS, REFERENCE, 1.0)
    entries = [
        AgreementEntry(person, device, TITLES[task], task, agreement)
        for person in ("P1", "P2")
        for device in ("gt9x", "lsm9ds1")
        for task in TITLES
    ]
    cells = summarise_agreement_study(entries)
    report = build_study(entries, cells, [], Software("1", "a"), "id", "en")
    (tmp_path / "study.html").write_bytes(render_html(report))
    return tmp_path / "study.html"
