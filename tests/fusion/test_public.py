"""What a caller in Python finds: names, paths as well as files, one line for each result."""

import dataclasses
import inspect
import math
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from acromion import fusion
from acromion.fusion import (
    Analysis,
    AnalysisSettings,
    ColumnProfile,
    DiaryEntry,
    FusionError,
    LiveElevation,
    UnusableArrays,
    analyse,
    read_recording,
    read_recordings,
)
from acromion.fusion.simulation import simulate_shift, write_shift
from tests.factories import hold

WINDOWS = "allowed: (start, end), s, 0 <= start < end"
TIMES = "allowed: seconds from the first sample, >= 0"
EVERY = {name: getattr(fusion, name) for name in fusion.__all__}
VALUES = {name: item for name, item in EVERY.items() if dataclasses.is_dataclass(item)}
FUNCTIONS = {name: item for name, item in EVERY.items() if inspect.isfunction(item)}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_shift(tmp_path_factory.mktemp("shift"), simulate_shift("lsm9ds1", 0.05, seed=1))[0]


@pytest.fixture(scope="module")
def analysis(path: Path) -> Analysis:
    return analyse(path)


def test_a_path_and_an_open_file_are_analysed_as_the_recording_read_from_them(
    path: Path, analysis: Analysis
) -> None:
    with path.open("rb") as file:
        step_by_step = analyse(read_recording(file))
    with path.open("rb") as file:
        from_file = analyse(file)

    assert repr(analysis) == repr(step_by_step)
    assert analysis.exposure.bins == step_by_step.exposure.bins == from_file.exposure.bins


def test_recordings_are_read_from_paths_as_from_files(path: Path) -> None:
    with path.open("rb") as file:
        from_file = read_recording(file)

    for from_path in (read_recording(str(path)), read_recording(path)):
        assert (from_path.sha256, from_path.flags) == (from_file.sha256, from_file.flags)
    assert read_recordings([str(path)]).duration_us == from_file.duration_us


def test_a_path_that_leads_nowhere_is_an_error_of_the_system(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        analyse(tmp_path / "nowhere.csv")


def test_the_extension_of_a_path_is_judged(path: Path, tmp_path: Path) -> None:
    disguised = Path(shutil.copy(path, tmp_path / "shift.gt3x"))

    with pytest.raises(FusionError):
        read_recording(disguised)


def test_an_analysis_prints_as_one_line_with_sensor_start_hours_figures_and_verdict() -> None:
    made = hold((0, 60), (75, 60)).recording

    assert made.start is not None
    assert re.fullmatch(
        rf"Analysis\(other from {made.start:%Y-%m-%d %H:%M}, 0\.03 h analysed, \d+\.\d % at 60 deg or above, "
        r"median \d+\.\d deg, quality (good|caution|poor)\)",
        repr(analyse(made)),
    )


@pytest.mark.parametrize("part", ["recording", "elevation", "exposure"])
def test_every_large_result_prints_as_one_short_line(analysis: Analysis, part: str) -> None:
    result = getattr(analysis, part)

    assert "\n" not in repr(result)
    assert len(repr(result)) <= 160
    assert all(len(repr(segment)) <= 80 for segment in getattr(result, "segments", ()))


@pytest.mark.parametrize("name", VALUES)
def test_a_value_type_documents_each_of_its_fields(name: str) -> None:
    documented = inspect.getdoc(VALUES[name]) or ""
    attributes = documented.partition("Attributes\n----------\n")[2]
    headings = re.findall(r"^(\w+(?:, \w+)*)$", attributes, re.MULTILINE)
    headings += re.findall(r"^((?:``\w+``, )*``\w+``): ", documented, re.MULTILINE)

    assert [field.strip("`") for line in headings for field in line.split(", ")] == [
        field.name for field in dataclasses.fields(VALUES[name])
    ]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_function_documents_its_parameters_and_what_it_returns(name: str) -> None:
    documented = inspect.getdoc(FUNCTIONS[name]) or ""
    section = documented.partition("Parameters\n----------\n")[2].partition("\n\n")[0]
    headings = re.findall(r"^(\w+(?:, \w+)*)$", section, re.MULTILINE)

    assert [one for line in headings for one in line.split(", ")] == [
        *inspect.signature(FUNCTIONS[name]).parameters
    ]
    assert "Returns\n-------\n" in documented


def test_the_package_offers_the_public_names_and_loads_no_compiler(tmp_path: Path) -> None:
    program = (
        "import sys, acromion; from acromion import fusion; assert 'numba' not in sys.modules;"
        "from acromion import analyse; assert analyse is fusion.analyse;"
        "assert dir(acromion) == fusion.__all__"
    )
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, check=True)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"method": "publishd"}, "method='publishd'; allowed: 'smoothed', 'published', 'live'"),
        ({"pose": "two_point"}, "pose='two_point'; allowed: 'n-pose', 'side-lean', 'two-point'"),
        ({"arm_axis": "q"}, "arm_axis='q'; allowed: None, '+x', '-x', '+y', '-y', '+z', '-z'"),
        ({"calibration_windows_s": ((15.0, 5.0),)}, WINDOWS),
        ({"calibration_windows_s": (5.0, 15.0)}, WINDOWS),
        ({"calibration_windows_s": ((5.0, math.nan),)}, WINDOWS),
        ({"calibration_windows_s": ((-5, 5),)}, WINDOWS),
        ({"calibration_windows_s": None}, WINDOWS),
        ({"slip_times_s": (-4.0,)}, TIMES),
        ({"slip_times_s": ("a",)}, TIMES),
        ({"slip_times_s": (True,)}, TIMES),
        ({"slip_times_s": 5.0}, TIMES),
        ({"no_slip_times_s": None}, TIMES),
        ({"diary": ("x",)}, "diary: ('x',); allowed: DiaryEntry, ..."),
        ({"diary": None}, "diary: None; allowed: DiaryEntry, ..."),
        ({"carried": (0, 0, 1)}, "carried: (0, 0, 1); allowed: None, CarriedPose"),
        ({"time_zone": "Mars"}, "time_zone: 'Mars'; allowed: "),
        ({"clock_offset_s": "1 h"}, "clock_offset_s: '1 h'; allowed: seconds"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_with_the_allowed_values(
    settings: dict[str, Any], told: str
) -> None:
    with pytest.raises(ValueError, match=re.escape(told)):
        AnalysisSettings(**settings)


def test_an_unknown_kind_of_a_diary_entry_is_refused_with_the_allowed_ones() -> None:
    with pytest.raises(ValueError, match=r"kind='lunch'; allowed: 'shift', 'work', .*'break'"):
        DiaryEntry(10.0, 20.0, "lunch")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ("acceleration_unit", "allowed: '', 'g', "),
        ("angular_rate_unit", "allowed: '', 'dps', "),
        ("time_unit", "allowed: '', 's', "),
        ("date_order", "allowed: None, 'ymd', 'dmy', 'mdy'"),
    ],
)
def test_an_unknown_name_in_a_column_profile_is_refused_with_the_allowed_ones(field: str, told: str) -> None:
    with pytest.raises(ValueError, match=re.escape(f"{field}='furlong'; {told}")):
        ColumnProfile(**{field: "furlong"})  # type: ignore[arg-type]


def test_an_arm_axis_by_name_is_refused_by_the_live_angle_which_takes_a_direction() -> None:
    with pytest.raises(UnusableArrays) as refused:
        LiveElevation(100.0, arm_axis="+x")

    assert refused.value.facts == {"why": "axis", "axis": "'+x'"}
