"""A week that is cut into its shifts gives the figures of the days given singly."""

from dataclasses import asdict
from datetime import datetime, timedelta
from pathlib import Path
from zipfile import ZipFile

import pytest

from acromion.fusion.clocks import ShiftWindow
from acromion.fusion.errors import UnusableShift
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.readers import measure_extent, read_recording
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.shifts import find_by_hours, parse_hours
from tests.simulated_week import DAYS, MINUTES, TABLE_S, WITHOUT_POSE, Week, write_week

SETTINGS = AnalysisSettings(pose_held="start")


@pytest.fixture(scope="module")
def week(tmp_path_factory: pytest.TempPathFactory) -> Week:
    return write_week(tmp_path_factory.mktemp("week"))


@pytest.fixture(scope="module")
def windows(week: Week) -> tuple[ShiftWindow, ...]:
    with week.path.open("rb") as file:
        extent = measure_extent(file)
    assert extent.start is not None
    return find_by_hours(extent.start, extent.duration_us, parse_hours("07:00-07:20"))


def describe(analysis: Analysis) -> object:
    """Return every figure, the time account, the pose and the verdict, to the last digit."""
    calibration = analysis.calibration
    assert calibration is not None
    return (
        repr(asdict(analysis.exposure)),
        asdict(analysis.time),
        (calibration.state, calibration.arm_axis.tolist(), calibration.sigma_deg),
        [asdict(flag) for flag in analysis.quality.flags],
        analysis.quality.verdict,
    )


def test_the_extent_of_a_week_is_found_without_decoding_it(week: Week) -> None:
    with week.path.open("rb") as file:
        extent = measure_extent(file)

    assert extent.start is not None
    assert extent.start.replace(tzinfo=None) == DAYS[0] - timedelta(seconds=TABLE_S)
    assert extent.duration_us == (4 * 86400 + MINUTES * 60 + 2 * TABLE_S) * 1_000_000
    assert extent.sha256 == read_recording(week.path).sha256


def test_the_extent_of_a_week_lists_the_stretches_with_samples(week: Week) -> None:
    with week.path.open("rb") as file:
        extent = measure_extent(file)

    day_s = MINUTES * 60 + 2 * TABLE_S
    expected = [(86400 * day * 1_000_000, (86400 * day + day_s) * 1_000_000) for day in range(5)]
    assert list(extent.covered_us) == expected


def test_a_device_that_was_off_over_days_keeps_the_dates_after_it(tmp_path: Path) -> None:
    """It was off on Tuesday and Wednesday."""
    week = write_week(tmp_path, days=4, minutes=2)
    log = b"".join(ZipFile(week.days[day]).read("log.bin") for day in (0, 3))
    path = tmp_path / "off.gt3x"
    with ZipFile(path, "w") as archive:
        archive.writestr("info.txt", ZipFile(week.path).read("info.txt"))
        archive.writestr("log.bin", log)

    recording = read_recording(path)

    assert [segment.start_us for segment in recording.segments] == [0, 3 * 86400 * 1_000_000]
    assert [flag.code for flag in recording.flags if flag.code.startswith("W-CLOCK")] == []


def test_hours_cut_a_week_into_one_shift_for_each_day(windows: tuple[ShiftWindow, ...]) -> None:
    assert [window.start.replace(tzinfo=None) for window in windows] == list(DAYS)


@pytest.mark.parametrize("place", range(5))
def test_a_shift_of_a_week_has_the_figures_of_the_day_given_singly(
    week: Week, windows: tuple[ShiftWindow, ...], place: int
) -> None:
    cut = analyse(read_recording(week.path, window=windows[place]), SETTINGS)
    single = analyse(read_recording(week.days[place]), SETTINGS)

    assert describe(cut) == describe(single)
    assert cut.recording.start == single.recording.start


def test_the_day_without_a_pose_is_not_good(week: Week, windows: tuple[ShiftWindow, ...]) -> None:
    shift = analyse(read_recording(week.path, window=windows[WITHOUT_POSE]), SETTINGS)

    assert shift.calibration is not None
    assert shift.calibration.state in {"assumed", "none"}
    assert shift.quality.verdict != "good"


def test_a_shift_after_a_clock_that_was_set_may_have_a_wrong_date(tmp_path: Path) -> None:
    """Between its two days the clock steps by 40 days."""
    first = write_week(tmp_path / "a", days=1, minutes=2)
    later = write_week(tmp_path / "b", days=1, minutes=2, first=DAYS[0] + timedelta(days=40))
    path = tmp_path / "set.gt3x"
    with ZipFile(path, "w") as archive:
        archive.writestr("info.txt", ZipFile(first.path).read("info.txt"))
        archive.writestr("log.bin", b"".join(ZipFile(week.path).read("log.bin") for week in (first, later)))
    window = ShiftWindow(*(DAYS[0] + timedelta(days=40, minutes=minutes) for minutes in (0, 2)))

    shift = read_recording(path, window=window)

    assert [flag.facts for flag in shift.flags if flag.code == "W-CLOCK-FWD"] == [{"step_s": 3_455_641}]


def test_no_day_is_lost_if_the_clock_was_set_back_between_two(week: Week, tmp_path: Path) -> None:
    """The file has the first day, the third and the second."""
    path = tmp_path / "back.gt3x"
    with ZipFile(path, "w") as archive:
        archive.writestr("info.txt", ZipFile(week.path).read("info.txt"))
        archive.writestr("log.bin", b"".join(ZipFile(week.days[day]).read("log.bin") for day in (0, 2, 1)))
    with path.open("rb") as file:
        extent = measure_extent(file)
    assert extent.start is not None

    windows = find_by_hours(extent.start, extent.duration_us, parse_hours("07:00-07:20"), extent.covered_us)
    shifts = [read_recording(path, window=window) for window in windows]

    assert [window.start.day for window in windows] == [2, 3, 4]
    assert all("W-CLOCK-BACK" in {flag.code for flag in shift.flags} for shift in shifts)


def test_only_the_samples_of_the_window_are_read(week: Week, windows: tuple[ShiftWindow, ...]) -> None:
    shift = read_recording(week.path, window=windows[1])

    assert shift.duration_us == MINUTES * 60 * 1_000_000
    assert not [flag.code for flag in shift.flags if flag.code in {"W-GAP", "W-MULTIDAY", "W-EARLY-END"}]


def test_a_window_without_samples_is_refused_with_its_hours(week: Week) -> None:
    night = ShiftWindow(*map(datetime.fromisoformat, ("2026-03-03T22:00", "2026-03-04T05:00")))

    with pytest.raises(UnusableShift) as refusal:
        read_recording(week.path, window=night)

    assert refusal.value.facts["why"] == "no samples"
