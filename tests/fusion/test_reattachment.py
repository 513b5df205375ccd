"""Sensor taken off and put back turned."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion.elevation import estimate_elevation
from fusion.pose.calibrate import calibrate
from fusion.recording import MICROSECONDS, Recording, Segment
from fusion.simulation import simulate_shift
from fusion.simulation.sensor import Device
from tests.factories import record

RATE_HZ = 25.0
DESK_S = 720.0
Table = NDArray[np.float64]


def work(hours: float, seed: int, device: Device = "gt9x") -> tuple[Table, Table, Table]:
    made = simulate_shift(device, hours, seed, RATE_HZ, perfect=True).in_arrays()
    return made.acc_g.astype(float), made.gyr_dps.astype(float), made.elevation_deg


def take_off_half_way(
    turn: Table, seed: int = 1, hours: float = 1.5, share: float = 0.5
) -> tuple[Recording, Table]:
    """Work, 12 minutes on a desk after a ``share`` of it, and the rest of the work with the sensor turned."""
    acc, gyr, truth = work(hours, seed)
    half, desk = int(len(acc) * share), round(DESK_S * RATE_HZ)
    rng = np.random.default_rng(seed)
    still = np.array([0.0, 0.6, 0.8]) + rng.normal(0.0, 0.002, (desk, 3))
    rest = rng.normal(0.0, 0.05, (desk, 3))
    both = np.concatenate([acc[:half], still, acc[half:] @ turn.T])
    rates = np.concatenate([gyr[:half], rest, gyr[half:] @ turn.T])
    return record(both, rates, RATE_HZ), np.concatenate([truth[:half], np.full(desk, np.nan), truth[half:]])


def tilt(degrees: float, about: Iterable[float] = (1.0, 0.0, 0.0)) -> Table:
    return np.asarray(Rotation.from_rotvec(np.radians(degrees) * np.array(list(about))).as_matrix())


@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
@pytest.mark.parametrize("seed", range(1, 11))
def test_a_day_on_which_the_sensor_stayed_on_raises_no_alarm(seed: int, device: Device) -> None:
    made = simulate_shift(device, 1.0, seed, RATE_HZ).in_arrays()

    samples = calibrate(record(made.acc_g.astype(float), made.gyr_dps.astype(float), RATE_HZ), "n-pose")

    assert samples.axis_parts == ()
    assert all(flag.code != "W-REMOUNT" for flag in samples.flags)


def test_put_back_as_it_was_it_raises_no_alarm() -> None:
    recording, _ = take_off_half_way(np.eye(3))

    assert calibrate(recording, "n-pose").axis_parts == ()


def test_a_hole_and_other_work_after_it_raise_no_alarm() -> None:
    # Of this hour the commonest directions before and after the hole differ by 20.5 deg.
    made = simulate_shift("gt9x", 1.0, 3).in_arrays()
    acc, gyr, rate_hz = made.acc_g, made.gyr_dps, made.rate_hz
    before, after = round(1080 * rate_hz), round(1620 * rate_hz)
    parts = (
        Segment(0, rate_hz, acc[:before], gyr[:before]),
        Segment(1_620_000_000, rate_hz, acc[after:], gyr[after:]),
    )
    whole = record(acc.astype(float), gyr.astype(float), rate_hz)

    assert calibrate(replace(whole, segments=parts), "n-pose").axis_parts == ()


@pytest.mark.parametrize("degrees", [40.0, 90.0, 180.0])
def test_put_back_turned_it_is_noticed_and_timed(degrees: float) -> None:
    # 45 minutes of work, then the desk from 2700 s to 3420 s: cut in the middle of it, at 3060 s.
    recording, _ = take_off_half_way(tilt(degrees))

    samples = calibrate(recording, "n-pose")

    (part,) = samples.axis_parts
    (flag,) = [flag for flag in samples.flags if flag.code == "W-REMOUNT"]
    assert part.start_s == pytest.approx(3060.0, abs=30.0)
    assert (flag.first_s, flag.last_s) == pytest.approx((part.start_s, recording.duration_us / MICROSECONDS))


def test_what_was_held_still_within_a_minute_of_being_put_back_stands_for_a_pose_there() -> None:
    recording, truth = take_off_half_way(tilt(60.0))

    samples = calibrate(recording, "n-pose")

    (part,) = samples.axis_parts
    segment = estimate_elevation(samples).segments[0]
    after = slice(round(3500.0 * RATE_HZ), len(truth))
    error_deg = (segment.elevation_deg[after] - truth[after])[segment.valid[after]]
    assert abs(error_deg.mean()) < 1.96 * np.hypot(samples.calibration.sigma_deg, part.sigma_deg)


def test_a_short_part_that_turned_is_left_out_and_the_rest_kept() -> None:
    recording, _ = take_off_half_way(tilt(90.0))
    segment = recording.segments[0]
    end = round((2700.0 + DESK_S + 60.0) * RATE_HZ)
    short = Segment(0, RATE_HZ, segment.acc_g[:end], segment.gyr_dps[:end])
    samples = calibrate(replace(recording, duration_us=short.duration_us, segments=(short,)), "n-pose")

    valid = estimate_elevation(samples).segments[0].valid

    assert [part.arm_axis is None for part in samples.axis_parts] == [True]
    assert not valid[-100:].any()
    assert valid[: round(2700.0 * RATE_HZ)].mean() > 0.99


@pytest.mark.parametrize(("degrees", "turned"), [(0.0, []), (70.0, ["W-REMOUNT"])])
def test_where_nobody_was_still_walking_before_and_after_tells_a_turn(
    degrees: float, turned: list[str]
) -> None:
    rng, up = np.random.default_rng(0), np.array([0.0, 0.0, 1.0])
    time_s = np.arange(60.0 * RATE_HZ) / RATE_HZ
    walk = (1.0 + 0.4 * np.sin(4.0 * np.pi * time_s))[:, None] * up
    pose, work, desk = np.tile(up, (250, 1)), up + rng.normal(0.0, 0.6, (5000, 3)), np.tile(up, (18000, 1))
    after = np.concatenate([work, walk]) @ tilt(degrees).T
    acc = np.concatenate([pose, work, walk, desk, after])
    acc += rng.normal(0.0, 0.002, acc.shape)

    samples = calibrate(record(acc, rng.normal(0.0, 0.1, acc.shape), RATE_HZ), "n-pose")

    assert [flag.code for flag in samples.flags] == turned
