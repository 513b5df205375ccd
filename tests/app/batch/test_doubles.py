"""Recordings that are in a run twice are analysed once."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from acromion.app.batch.doubles import mark_doubles
from acromion.app.batch.folder import Task
from acromion.app.errors import UnusableParticipants
from acromion.app.request import ReportRequest
from acromion.fusion.simulation import simulate_shift, write_shift

HEAD = """------------ Data File Created By ActiGraph Link IMU 9DOF Sensor ActiLife v6.13.3 Firmware v1.7.2 \
date format M/d/yyyy at 100 Hz  -----------
Serial Number: {serial}
Start Time {start}
Start Date 2/14/2019
"""


def make_task(log: Path, line: int = 0, subject: str = "S01") -> Task:
    return Task(log, ReportRequest(log.name, subject), log.parent / "out", path=log.name, line=line)


def write(folder: Path, *contents: str) -> list[Path]:
    paths = [folder / f"{name}.csv" for name in "abcd"[: len(contents)]]
    for path, content in zip(paths, contents, strict=True):
        path.write_text(content)
    return paths


def test_of_the_same_bytes_the_first_is_analysed(tmp_path: Path) -> None:
    tasks = mark_doubles([make_task(path) for path in write(tmp_path, "one", "two", "one", "one")])

    assert [task.double_of for task in tasks] == ["", "", "a.csv", "a.csv"]


def test_of_the_same_bytes_the_one_with_a_row_in_the_list_is_analysed(tmp_path: Path) -> None:
    first, second = write(tmp_path, "one", "one")

    tasks = mark_doubles([make_task(first, subject=""), make_task(second, line=2)])

    assert [task.double_of for task in tasks] == ["b.csv", ""]


def test_rows_that_give_the_same_bytes_to_two_people_are_refused_with_both_lines(tmp_path: Path) -> None:
    first, second = write(tmp_path, "one", "one")

    with pytest.raises(UnusableParticipants) as caught:
        mark_doubles([make_task(first, 2, "S01"), make_task(second, 3, "S02")])

    facts = caught.value.facts
    assert (facts["why"], facts["line"], facts["other"]) == ("double people", 3, 2)


def test_empty_files_are_no_doubles(tmp_path: Path) -> None:
    tasks = mark_doubles([make_task(path) for path in write(tmp_path, "", "")])

    assert [task.double_of for task in tasks] == ["", ""]


@pytest.mark.parametrize(
    ("serial", "start", "double_of"),
    [
        ("TAS1E31150129", "08:58:00", "day.gt3x"),
        ("TAS1E31150129", "13:30:00", ""),  # another recording of the device on that day
        ("TAS1E31150130", "08:58:00", ""),  # the other arm, started together
    ],
)
def test_an_export_is_told_by_serial_number_and_start(
    tmp_path: Path, shared_data: Callable[[str], Path], serial: str, start: str, double_of: str
) -> None:
    shutil.copy(shared_data("gt9x/link_imu_100hz_179s.gt3x"), tmp_path / "day.gt3x")
    (tmp_path / "any name.csv").write_text(HEAD.format(serial=serial, start=start))

    tasks = mark_doubles([make_task(tmp_path / name) for name in ("any name.csv", "day.gt3x")])

    assert [task.double_of for task in tasks] == [double_of, ""]


def test_the_real_exports_of_a_real_recording_are_found(shared_data: Callable[[str], Path]) -> None:
    folder = shared_data("gt9x")
    paths = sorted(path for path in folder.iterdir() if path.suffix in {".csv", ".gt3x"})

    doubles = {task.log.name: task.double_of for task in mark_doubles([make_task(path) for path in paths])}

    assert doubles == {
        "link_imu_100hz_179s.gt3x": "",
        "link_imu_100hz_179s_actilife.csv": "link_imu_100hz_179s.gt3x",
        "link_imu_23s_excel_resaved.csv": "link_imu_100hz_179s.gt3x",  # the first 23 s of the same export
    }


def test_the_export_of_a_simulated_recording_is_found(tmp_path: Path) -> None:
    paths = write_shift(tmp_path, simulate_shift("gt9x", 0.02, seed=3))[:2]

    tasks = mark_doubles([make_task(path) for path in paths])

    assert [bool(task.double_of) for task in tasks] == [False, True]
