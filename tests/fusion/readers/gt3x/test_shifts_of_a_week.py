"""A week that is cut into its shifts gives the figures of the days given singly."""

from dataclasses import asdict
from datetime import datetime, timedelta

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
        start, duration_us, _ = measure_extent(file)
    assert start is not None
    return find_by_hours(start, duration_us, parse_hours("07:00-07:20"))


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
        start, duration_us, sha256 = measure_extent(file)

    assert start is not None
    assert start.replace(tzinfo=None) == DAYS[0] - timedelta(seconds=TABLE_S)
    assert duration_us == (4 * 86400 + MINUTES * 60 + 2 * TABLE_S) * 1_000_000
    assert sha256 == read_recording(week.path).sha256


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


def test_only_the_samples_of_the_window_are_read(week: Week, windows: tuple[ShiftWindow, ...]) -> None:
    shift = read_recording(week.path, window=windows[1])

    assert shift.duration_us == MINUTES * 60 * 1_000_000
    assert not [flag.code for flag in shift.flags if flag.code in {"W-GAP", "W-MULTIDAY", "W-EARLY-END"}]


def test_a_window_without_samples_is_refused_with_its_hours(week: Week) -> None:
    night = ShiftWindow(*map(datetime.fromisoformat, ("2026-03-03T22:00", "2026-03-04T05:00")))

    with pytest.raises(UnusableShift) as refusal:
        read_recording(week.path, window=night)

    assert refusal.value.facts["why"] == "no samples"
