"""Reading goes before the rest of the science is loaded, and changes nothing."""

import subprocess
import sys
from pathlib import Path

import pytest

from app.request import ReportRequest
from app.roads.analyse import ignore_stage, make_report
from app.roads.reading import Logs, read_ahead
from app.storage.known import NOTHING_KNOWN, KnownLogs
from fusion.readers import holds_device_format
from fusion.simulation import write_recordings

AHEAD = """
import sys
from pathlib import Path
from app.storage.known import NOTHING_KNOWN
from app.roads.reading import read_ahead
from app.request import ReportRequest
log, stages = Path(sys.argv[1]), []
known = read_ahead(log, ReportRequest(log.name), NOTHING_KNOWN, lambda stage, _: stages.append(stage))
print(known.recording is not None, "app.roads.analyse" in sys.modules, stages)
"""
TWO_FORKS = """
import os, sys
import app.jobs.children.preloaded_reading
heavy = ("app.roads.analyse", "app.roads.inspect", "typst")
for _ in range(2):
    if not (child := os.fork()):
        os._exit(0)
    os.waitpid(child, 0)
    print(*(name in sys.modules for name in heavy))
"""


def run_program(program: str, *arguments: str) -> str:
    command = [sys.executable, "-c", program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()


def make_table(folder: Path, header: str) -> Path:
    path = folder / "table.csv"
    path.write_text(header + "\n" + 2000 * ("1" + 8 * ",0" + "\n"), "utf-8")
    return path


@pytest.fixture
def shift(tmp_path: Path) -> Path:
    return write_recordings(tmp_path, "gt9x", 0.05, 1)[0]


def test_a_devices_file_is_read_while_the_rest_is_loaded(shift: Path) -> None:
    assert run_program(AHEAD, str(shift)) == "True True ['reading']"


def test_a_table_that_may_be_a_motion_capture_is_left_for_later(tmp_path: Path) -> None:
    header = "time_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps,a,b"

    assert run_program(AHEAD, str(make_table(tmp_path, header))) == "False False []"


def test_where_everything_is_loaded_nothing_is_read_ahead(shift: Path) -> None:
    request = ReportRequest(shift.name)

    assert read_ahead(shift, request, NOTHING_KNOWN, ignore_stage) is NOTHING_KNOWN


def test_a_recording_read_ahead_gives_the_same_results(shift: Path, tmp_path: Path) -> None:
    request = ReportRequest(shift.name, kinds=("html",), languages=("en",))
    known = KnownLogs(recording=Logs(shift, request, NOTHING_KNOWN).read())
    folders = [tmp_path / "ahead", tmp_path / "plain"]
    for folder in folders:
        folder.mkdir()

    make_report(shift, request, folders[0], known=known)
    make_report(shift, request, folders[1])

    ahead, plain = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in folders)
    assert ahead == plain


def test_the_server_of_a_run_loads_the_rest_before_a_second_child() -> None:
    assert run_program(TWO_FORKS).splitlines() == ["False False False", "True True True"]


@pytest.mark.parametrize(
    ("first_lines", "expected"),
    [
        ("time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps", True),
        ("time_s,ax_g,ay_g,az_g,gx_dps,gy_dps,gz_dps", False),
        ("PacketCounter,SampleTimeFine,Quat_W,Quat_X,Quat_Y,Quat_Z", False),
        ('<?xml version="1.0"?>\n<mvnx version="4">', False),
    ],
)
def test_tables_whose_header_only_names_columns_may_hold_anything(
    tmp_path: Path, first_lines: str, expected: bool
) -> None:
    with make_table(tmp_path, first_lines).open("rb") as file:
        assert holds_device_format(file) is expected
        assert file.tell() == 0


def test_both_files_of_the_link_are_a_devices_own(tmp_path: Path) -> None:
    for path in write_recordings(tmp_path, "gt9x", 0.05, 1)[:2]:
        with path.open("rb") as file:
            assert holds_device_format(file)
