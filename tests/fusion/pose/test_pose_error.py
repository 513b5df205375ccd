"""The N-pose reads a raised arm low: the range of the draws with and without that error."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from acromion.fusion.angle_files import read_angle_file
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.metric_filter import filter_elevation
from acromion.fusion.exposure.resampling import (
    draw_blocks,
    lower_thresholds,
    raise_angles,
    spread_errors,
)
from acromion.fusion.exposure.stays import HALF_WIDTHS_DEG, LoweredEntries, find_stays
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure, Interval
from acromion.fusion.pipeline import analyse, analyse_angle_file, analyse_angles
from acromion.fusion.recording import Float64Array
from acromion.fusion.settings import AnalysisSettings
from tests.factories import elevate, hold

# 200 shares, every 200th of [0, 1] once: their 97.5th percentile is (0.975 x 199 + 0.5) / 200
SHARE = 0.9726


def summarise(angle_deg: Float64Array, sigma_deg: float = 0.0, rate_hz: float = 1.0) -> Exposure:
    return summarise_exposure(elevate(angle_deg, rate_hz=rate_hz), bias_sigma_deg=sigma_deg, is_npose=True)


def move_at_random(seed: int, seconds: int = 7200, rate_hz: float = 10.0) -> Float64Array:
    """Wander about 50 deg, by 25 deg, changing within a second or so. Ten rows a second: not filtered."""
    steps = np.random.default_rng(seed).normal(size=round(seconds * rate_hz))
    smooth = np.convolve(steps, np.ones(12) / np.sqrt(12), "same")
    return np.asarray(np.clip(50.0 + 25.0 * smooth, 0.0, 180.0))


@pytest.mark.parametrize(
    ("read_deg", "share", "raised_deg"),
    [(45.0, 1.0, 52.5), (90.0, 1.0, 105.0), (120.0, 1.0, 135.0), (60.0, 0.5, 65.0)],
)
def test_the_error_grows_to_15_deg_at_90_deg_and_stays_there(
    read_deg: float, share: float, raised_deg: float
) -> None:
    assert raise_angles(np.array(read_deg), np.array(share)) == pytest.approx(raised_deg)


@given(st.floats(0.0, 180.0), st.floats(0.0, 1.0))
def test_a_lowered_threshold_is_raised_to_where_it_was(angle_deg: float, share: float) -> None:
    lowered = lower_thresholds(np.array(angle_deg), np.array(share))

    assert raise_angles(lowered, np.array(share)) == pytest.approx(angle_deg)


def test_the_draws_share_the_error_out_evenly_and_apart_from_the_error_of_the_angle() -> None:
    draws = draw_blocks(np.ones(12), 5.0).with_npose_error()

    assert np.sort(draws.share) == pytest.approx((np.arange(200) + 0.5) / 200)
    assert abs(np.corrcoef(draws.share, draws.error_deg)[0, 1]) < 0.01


def test_an_arm_held_at_50_deg_may_have_been_held_at_58_deg() -> None:
    median = summarise(np.full(7200, 50.05)).intervals["elevation_p50_deg"]

    assert (median.low, median.low_pose) == pytest.approx((50.05, 50.05), abs=0.05)
    # 50.05 deg and the share of 15 deg x 50.05 / 90
    assert median.high_pose == pytest.approx(50.05 + SHARE * 8.342, abs=0.06)


@pytest.mark.parametrize(("place", "threshold_deg", "lowered_deg"), [(1, 60, 51.63), (2, 90, 77.45)])
def test_an_even_spread_gains_the_time_between_the_lowered_threshold_and_the_threshold(
    place: int, threshold_deg: int, lowered_deg: float
) -> None:
    interval = summarise(np.tile(np.arange(0.05, 180, 0.1), 6), rate_hz=6.0).time_above[place].interval

    assert interval is not None
    # read above threshold / (1 + SHARE / 6) of 180 deg
    assert interval.high_pose == pytest.approx(100 * (180 - lowered_deg) / 180, abs=0.05)
    assert interval.low_pose == pytest.approx(100 * (180 - threshold_deg) / 180, abs=0.05)


def test_a_bin_from_30_deg_may_lose_time_to_the_one_above_and_so_may_a_class_of_a_standard() -> None:
    exposure = summarise(np.full(7200, 59.05))
    bins = {part.lower_deg: part.interval for part in exposure.bins}

    # all of it read in 45 to 60 deg; with the error in 60 to 80 deg
    assert bins[45] == Interval(100.0, 100.0, 0.0, 100.0)
    assert bins[60] == Interval(0.0, 0.0, 0.0, 100.0)
    assert bins[20] == Interval(0.0, 0.0)
    assert exposure.conventions["iso_11226"][-1].interval == exposure.time_above[1].interval


def test_the_range_with_the_pose_holds_the_range_without() -> None:
    exposure = summarise(move_at_random(0), 5.0, rate_hz=10.0)

    intervals = [above.interval for above in exposure.time_above]
    intervals += [part.interval for part in exposure.bins if part.lower_deg >= 30]
    intervals += [i for name, i in exposure.intervals.items() if name.startswith(("elevation_p", "entries"))]
    told = [i for i in intervals if i is not None and i.low_pose is not None and i.high_pose is not None]
    assert len(told) == 3 + 7 + 9 + 6  # of the entries those an hour and in all; busy minutes have none
    assert all(i.low_pose <= i.low and i.high <= i.high_pose for i in told)  # type: ignore[operator]


def test_without_the_n_pose_nothing_else_changes() -> None:
    day = elevate(move_at_random(1), rate_hz=10.0)
    plain, posed = (
        summarise_exposure(day, bias_sigma_deg=5.0, is_npose=is_npose) for is_npose in (False, True)
    )

    assert all(i.low_pose is None and i.high_pose is None for i in plain.intervals.values())
    assert {name: (i.low, i.high) for name, i in posed.intervals.items()} == {
        name: (i.low, i.high) for name, i in plain.intervals.items()
    }


def test_at_every_level_the_entries_are_those_of_its_own_trigger() -> None:
    segment = elevate(move_at_random(3, 600), rate_hz=10.0).segments[0]
    segment.valid[2000:2100] = False
    angle = filter_elevation(segment)
    lowered = LoweredEntries(spread_errors(5.0), np.array([0, 200_000_000, 600_000_000]))

    lowered.add(angle)

    entries = lowered.entries[1].sum(axis=1)
    assert entries.tolist() == [len(find_stays(angle, level).entry_us) for level in lowered.levels_deg]


def test_entries_of_the_raised_angle_are_those_of_the_lowered_trigger() -> None:
    read_deg = move_at_random(4)
    angle = filter_elevation(elevate(read_deg, rate_hz=10.0).segments[0])
    raised_deg = raise_angles(read_deg.astype(np.float32).astype(np.float64), np.ones(1))
    raised = elevate(np.clip(raised_deg, 0.0, 180.0), rate_hz=10.0).segments[0]
    lowered = LoweredEntries(spread_errors(5.0), np.array([0, 7_200_000_000]))
    lowered.add(angle)
    draws = replace(draw_blocks(np.ones(1), 0.0), share=np.ones(200))

    for threshold_deg in (30, 60, 90):
        truth = len(find_stays(filter_elevation(raised), threshold_deg).entry_us)
        drawn = lowered.draw(threshold_deg, lowered.entries, draws)
        assert drawn == pytest.approx(np.full(200, truth), rel=0.02)  # between levels of 2.5 deg


def test_the_narrow_trigger_is_the_one_of_the_whole_error() -> None:
    enter_deg, leave_deg = (lower_thresholds(np.array(end), np.ones(1))[0] for end in (65.0, 55.0))

    assert (enter_deg - leave_deg) / 2 == pytest.approx(HALF_WIDTHS_DEG[0])


def test_swings_to_60_deg_enter_above_60_deg_in_the_draws_that_raise_them_beyond_65_deg() -> None:
    swings = np.tile([0.0, 30.0, 62.0, 30.0], 1800)  # 1800 in two hours; 62 deg may be 72.3 deg
    rate = summarise(swings).intervals["entries_above_60_per_h"]

    assert (rate.low, rate.high) == (0.0, 0.0)
    assert (rate.low_pose, rate.high_pose) == pytest.approx((0.0, 900.0), abs=1.0)


def find_pose_end(exposure: Exposure) -> float | None:
    """Return the upper end with the pose of the time above 60 deg."""
    interval = exposure.time_above[1].interval
    assert interval is not None
    return interval.high_pose


RAISED = hold((0, 20), *((55, 20), (10, 20)) * 46, rate_hz=25.0).recording


@pytest.mark.parametrize(
    ("settings", "has_range"),
    [
        (AnalysisSettings(), True),
        (AnalysisSettings(calibration_windows_s=((2.0, 15.0),)), True),
        (AnalysisSettings("smoothed", "side-lean", ((2.0, 15.0),)), False),
        (AnalysisSettings(arm_axis="+z"), False),
    ],
    ids=["found", "given", "side-lean", "axis"],
)
def test_a_held_n_pose_alone_has_the_range_of_the_pose(settings: AnalysisSettings, has_range: bool) -> None:
    analysis = analyse(RAISED, settings)

    assert (find_pose_end(analysis.exposure) is not None) is has_range
    assert any(flag.code == "W-NPOSE" for flag in analysis.quality.flags) is has_range


def test_ready_angles_whose_pose_nobody_knows_have_none() -> None:
    text = "time_s,elevation_deg\n" + "".join(f"{k},50\n" for k in range(3600))

    assert find_pose_end(analyse_angles(io.BytesIO(text.encode())).exposure) is None


def test_orientations_whose_axis_is_an_arm_that_hangs_have_one() -> None:
    rows = "".join(f"{k / 10},1,0,0,0\n" for k in range(36_000))
    file = read_angle_file(io.BytesIO(f"time,qw,qx,qy,qz\n{rows}".encode()), "sensor.csv")

    assert find_pose_end(analyse_angle_file(file).exposure) == 0.0


def test_a_segment_of_one_row_is_counted() -> None:
    one = ElevationSegment(0, 10.0, np.array([70.0], np.float32), np.ones(1, np.bool_))
    exposure = summarise_exposure(Elevation((one,), None), bias_sigma_deg=5.0, is_npose=True)

    assert exposure.entries[1].count == 0
