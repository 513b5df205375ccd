"""Work with the arm held raised for an hour is neither a sensor that turned nor the calibration pose."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.conventions import MethodName
from fusion.elevation import estimate_elevation
from fusion.pose.calibrate import calibrate
from fusion.pose.wear import AxisPart
from fusion.recording import MICROSECONDS, Recording, Segment
from fusion.simulation.activities import (
    HANGING,
    Activity,
    Choreography,
    assemble,
    hold_still,
    lift,
    stand,
    walk,
)
from fusion.simulation.body import Channel
from fusion.simulation.shift import PlannedActivity, wear_sensor

RATE_HZ, POSE_S = 25.0, 20.0
Table = NDArray[np.float64]
Chance = np.random.Generator


def sit_at(elevation_deg: float) -> Activity:
    return partial(_sit, elevation_deg)


def _sit(elevation_deg: float, body: Choreography, duration_s: float, chance: Chance) -> None:
    """Hold the wheel or an instrument: a new place every few seconds, all near one posture."""
    end_s = body.time_s + duration_s
    while body.time_s < end_s:
        pose = {
            Channel.FLEXION: chance.normal(3.0, 2.0),
            Channel.PLANE: chance.normal(-10.0, 10.0),
            Channel.ELEVATION: chance.normal(elevation_deg, 5.0),
            Channel.AXIAL: chance.normal(0.0, 8.0),
        }
        body.go(chance.uniform(0.6, 1.5), pose)
        hold_still(body, chance.uniform(2.0, 25.0), chance)


def walk_about(body: Choreography, duration_s: float, chance: Chance) -> None:
    end_s = body.time_s + duration_s
    while body.time_s < end_s:
        (stand, walk, lift)[int(chance.integers(3))](body, 60.0, chance)


def work(*parts: tuple[Activity, float], seed: int = 1) -> tuple[Recording, Table]:
    """A pose of 20 s, then each part with its length in seconds."""
    chance, body = np.random.default_rng(seed), Choreography()
    hold_still(body, POSE_S, chance)
    for activity, duration_s in parts:
        body.go(0.8, HANGING)
        activity(body, duration_s, chance)
    plan = (PlannedActivity("work", 0.0, body.time_s),)
    made = wear_sensor("gt9x", seed, plan, body.finish(), rate_hz=RATE_HZ).in_arrays()
    segment = Segment(0, made.rate_hz, made.acc_g, made.gyr_dps)
    return Recording("gt9x", "0" * 64, None, None, segment.duration_us, (segment,)), made.elevation_deg


def cut_out(recording: Recording, truth_deg: Table, first_s: float, stop_s: float) -> tuple[Recording, Table]:
    """The same with a hole, and the truth without it."""
    (whole,) = recording.segments
    first, stop = round(first_s * whole.rate_hz), round(stop_s * whole.rate_hz)
    before = Segment(0, whole.rate_hz, whole.acc_g[:first], whole.gyr_dps[:first])
    after = Segment(
        round(stop / whole.rate_hz * MICROSECONDS), whole.rate_hz, whole.acc_g[stop:], whole.gyr_dps[stop:]
    )
    kept_deg = np.concatenate([truth_deg[:first], truth_deg[stop:]])
    return replace(recording, segments=(before, after)), kept_deg


def find_worst_valid_deg(recording: Recording, truth_deg: Table) -> float:
    segments = estimate_elevation(calibrate(recording, "n-pose")).segments
    found_deg = np.concatenate([segment.elevation_deg for segment in segments])
    valid = np.concatenate([segment.valid for segment in segments])
    return float(np.abs(found_deg - truth_deg)[valid].max())


@pytest.mark.parametrize("elevation_deg", [45.0, 70.0])
def test_an_hour_at_the_wheel_is_never_read_as_an_arm_that_hangs(elevation_deg: float) -> None:
    # Nothing turned. An axis carried over read the second hour 45 and 70 deg too low, and called it valid.
    recording, truth_deg = work((walk, 60.0), (walk_about, 3000.0), (sit_at(elevation_deg), 3000.0))

    assert find_worst_valid_deg(recording, truth_deg) < 10.0


def test_nor_is_it_after_a_hole() -> None:
    made = work((walk, 60.0), (walk_about, 3000.0), (sit_at(45.0), 3000.0))
    recording, truth_deg = cut_out(*made, 3060.0, 3460.0)

    assert find_worst_valid_deg(recording, truth_deg) < 10.0


def test_where_the_wearer_walks_now_and_then_it_raises_no_alarm() -> None:
    # 30 s of walking in ten minutes at the wheel: the arm hangs in it as it did before.
    recording, _ = work((walk_about, 3000.0), *([(sit_at(45.0), 570.0), (walk, 30.0)] * 5))

    assert calibrate(recording, "n-pose").axis_parts == ()


def test_of_a_day_at_the_wheel_the_pose_is_proposed_and_not_the_wheel() -> None:
    # The arm is still at the wheel nine times as often as it hangs; but it hangs when the wearer walks.
    recording, _ = work(*([(sit_at(45.0), 1080.0), (walk, 120.0)] * 3))

    samples = calibrate(recording, "n-pose")

    assert samples.calibration.windows[0].start_s < POSE_S
    assert samples.flags == ()


def test_at_the_wheel_without_any_walking_the_pose_is_the_pose() -> None:
    # The wheel was taken for it, 39 deg wrong.
    recording, truth_deg = work((sit_at(45.0), 1800.0))

    assert calibrate(recording, "n-pose").calibration.windows[0].start_s < POSE_S
    assert find_worst_valid_deg(recording, truth_deg) < 10.0


@pytest.mark.parametrize("seconds", [300.0, 1800.0])
def test_nobody_needs_to_have_walked(seconds: float) -> None:
    recording, _ = work((assemble, seconds))

    assert calibrate(recording, "n-pose").flags == ()


@pytest.mark.parametrize("method", ["published", "live", "smoothed"])
def test_a_part_with_an_axis_of_its_own_widens_the_range_whatever_the_method(method: MethodName) -> None:
    recording, _ = work((walk_about, 1500.0))
    samples = calibrate(recording, "n-pose")
    half_s = recording.duration_us / MICROSECONDS / 2.0
    turned = AxisPart(half_s, np.inf, samples.calibration.arm_axis, 18.0)

    sigma_deg = estimate_elevation(replace(samples, axis_parts=(turned,)), method).bias_sigma_deg

    # Half of the time 18 deg: 18 / sqrt(2) = 12.7 deg, and the method's own beside it.
    assert sigma_deg is not None
    assert 12.6 < sigma_deg < 13.6
