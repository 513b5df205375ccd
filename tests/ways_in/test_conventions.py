"""Exports in conventions of the field, each opened by a tool of others."""

import csv
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
from frictionless import validate
from rocrate.rocrate import ROCrate

from tests.app.cli.typed import copy_gt3x, read_table, run

NAME = "Mme Tremblay.gt3x"


@pytest.fixture(scope="module")
def results(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two arms of one person, a person whose code reads alike, a copy, and a file that is none."""
    folder = tmp_path_factory.mktemp("study")
    for name in (NAME, "left.gt3x", "other.gt3x"):
        copy_gt3x(shift_gt3x, folder / name)
    shutil.copy(folder / "left.gt3x", folder / "left again.gt3x")
    (folder / "empty.gt3x").touch()
    rows = [
        *("file,subject,side,Age (years),sensor,load,group", f"{NAME},S-01,right,34,-2,+33612,=1+1"),
        *("left.gt3x,S-01,left,34,7,33612,=1+1", 'other.gt3x,S01,right,NA,-2,"1,5",-x'),
    ]
    (folder / "people.csv").write_text("\n".join(rows) + "\n")
    out = tmp_path_factory.mktemp("results") / "out"
    assert run("run", folder, "-o", out, "--participants", folder / "people.csv", "-j", "2").exit_code == 1
    return out


# ------------------------------------------------------------------ tables: Frictionless


def find_errors(package: Path) -> list[str]:
    report = validate(package)
    return [error.message for task in report.tasks for error in task.errors] + [
        e.message for e in report.errors
    ]


@pytest.mark.parametrize("folder", ["", "left"], ids=["run", "recording"])
def test_the_tables_keep_their_schema(results: Path, folder: str) -> None:
    assert find_errors(results / folder / "datapackage.json") == []


def test_a_table_whose_cell_is_no_number_does_not(results: Path, tmp_path: Path) -> None:
    shutil.copytree(results, tmp_path / "out")
    table = tmp_path / "out" / "summary.csv"
    rows = list(csv.reader(table.read_text("utf-8").splitlines()))
    rows[1][rows[0].index("analysed_s")] = "long"
    table.write_text("".join(",".join(row) + "\n" for row in rows), "utf-8")

    assert any("analysed_s" in error for error in find_errors(tmp_path / "out" / "datapackage.json"))


# ------------------------------------------------------------------ origin: RO-Crate


def test_the_crate_names_what_was_done_with_each_recording(results: Path) -> None:
    crate = ROCrate(results)

    named = [crate.dereference(one.id) for one in crate.root_dataset["mentions"]]
    actions = [one for one in named if one.type == "CreateAction"]

    assert [(one["name"], one["actionStatus"].rpartition("/")[2]) for one in actions] == [
        ("Analysis of the recording in row 1 of summary.csv", "CompletedActionStatus"),
        ("Analysis of the recording in row 2 of summary.csv", "FailedActionStatus"),
        ("Analysis of the recording in row 4 of summary.csv", "CompletedActionStatus"),
        ("Analysis of the recording in row 5 of summary.csv", "CompletedActionStatus"),
    ]
    assert {one["instrument"]["name"] for one in actions} == {"Acromion"}


def test_the_crate_names_every_recording_also_failed_ones_and_doubles(results: Path) -> None:
    crate = ROCrate(results)
    digests = {row["path"]: row["sha256"] for row in read_table(results / "summary.csv")}

    named = [crate.dereference(one.id) for one in crate.root_dataset["mentions"]]
    found = {one["identifier"]: one["description"] for one in named if one.type == "CreativeWork"}

    assert found == {
        digests[NAME]: "Row 1 of summary.csv: analysed.",
        hashlib.sha256(b"").hexdigest(): "Row 2 of summary.csv: failed with E-EMPTY.",
        digests["left.gt3x"]: "Row 3 of summary.csv: the recording of row 4 again, not analysed. "
        "Row 4 of summary.csv: analysed.",
        digests["other.gt3x"]: "Row 5 of summary.csv: analysed.",
    }
    failed = crate.dereference("#analysis-2")
    assert [one["identifier"] for one in failed["object"] if one.type == "CreativeWork"] == [
        hashlib.sha256(b"").hexdigest()
    ]


def test_every_file_of_the_crate_is_there_and_as_long_as_it_says(results: Path) -> None:
    described = {file.id: int(file["contentSize"]) for file in ROCrate(results).data_entities}

    found = {name: (results / name.replace("%20", " ")).stat().st_size for name in described}

    assert described == found
    assert {"summary.csv", "left/results.json", "left/elevation.parquet"} <= described.keys()


# ------------------------------------------------------------------ angles: Motion-BIDS


@pytest.fixture(scope="module")
def dataset(results: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bids") / "dataset"
    assert run("export", results, "-o", out).exit_code == 0
    return out


def find_bids_errors(dataset: Path) -> list[str]:
    validator = Path(sys.executable).with_name("bids-validator-deno")
    with tempfile.TemporaryDirectory(dir="/var/tmp") as disk:  # the validator reads nothing below /dev
        place = shutil.copytree(dataset, Path(disk) / "dataset")
        told = subprocess.run([validator, place, "--json"], capture_output=True, check=False, timeout=120)
    report: dict[str, Any] = json.loads(told.stdout)
    assert report["summary"]["modalities"] == ["motion"]
    return [issue["code"] for issue in report["issues"]["issues"] if issue["severity"] == "error"]


def test_the_dataset_is_valid_bids_but_not_without_its_channels(dataset: Path, tmp_path: Path) -> None:
    shutil.copytree(dataset, tmp_path / "dataset")
    for path in (tmp_path / "dataset").rglob("*_channels.tsv"):
        path.write_text("name\nlatency\n")

    assert find_bids_errors(dataset) == []
    assert find_bids_errors(tmp_path / "dataset") != []


def test_each_arm_of_each_person_has_its_run(dataset: Path) -> None:
    assert sorted(path.name for path in dataset.rglob("*_motion.tsv")) == [
        "sub-S01_ses-01_task-work_tracksys-acromion_acq-left_run-01_motion.tsv",
        "sub-S01_ses-01_task-work_tracksys-acromion_acq-right_run-01_motion.tsv",
        "sub-S01x2_ses-01_task-work_tracksys-acromion_acq-right_run-01_motion.tsv",
    ]


def test_further_columns_of_the_list_are_columns_of_the_recordings_and_people(dataset: Path) -> None:
    def read(place: str) -> list[dict[str, str]]:
        with (dataset / place).open(encoding="utf-8") as file:
            return list(csv.DictReader(file, delimiter="\t"))

    people = [(row["code"], row["age_years"], row["sensor"]) for row in read("participants.tsv")]
    scans = read("sub-S01/ses-01/sub-S01_ses-01_scans.tsv")

    assert people == [("S-01", "34", "n/a"), ("S01", "n/a", "-2")]  # the arms of S-01 had two sensors
    assert {(row["age_years"], row["sensor"]) for row in scans} == {("34", "7"), ("34", "-2")}
    described = json.loads((dataset / "participants.json").read_bytes())
    assert described["age_years"] == {"Description": "From the list of participants, as given"}


def test_a_dataset_has_numbers_as_the_tables_have_them_and_text_as_it_was_given(dataset: Path) -> None:
    (head, *people), (scan_head, *scans) = (
        [line.split("\t") for line in (dataset / place).read_text("utf-8").splitlines()]
        for place in ("participants.tsv", "sub-S01x2/ses-01/sub-S01x2_ses-01_scans.tsv")
    )

    assert (head[-2:], scan_head[-2:]) == (["load", "group"], ["load", "group"])
    assert [row[-2:] for row in people] == [["33612", "=1+1"], ["1.5", "-x"]]
    assert [row[-2:] for row in scans] == [["1.5", "-x"]]


def test_the_angles_are_those_of_the_results(dataset: Path, results: Path) -> None:
    pandas = pytest.importorskip("pandas")
    angles = pandas.read_parquet(results / "left" / "elevation.parquet")

    rows = pandas.read_csv(next(dataset.rglob("*left*_motion.tsv")), sep="\t", header=None, na_values="n/a")

    assert rows[0].tolist() == (angles["time_us"] / 1e6).tolist()
    assert rows[1].tolist() == (angles["elevation_cdeg"] / 100).tolist()
    assert rows[2].tolist() == angles["analysed"].astype(int).tolist()


def test_no_name_of_a_file_stands_in_the_dataset_and_other_folders_are_refused(
    dataset: Path, tmp_path: Path
) -> None:
    contents = b"".join(path.read_bytes() for path in dataset.rglob("*") if path.is_file())
    refused = run("export", tmp_path, "-o", tmp_path / "bids")

    assert b"Tremblay" not in contents
    assert (refused.exit_code, "E-NO-RESULTS" in refused.stderr) == (3, True)
