"""The day: its plan, its repeatability, and that it looks like work."""

from typing import get_args

import numpy as np
import pytest

from fusion.simulation import simulate_shift
from fusion.simulation.sensor import Device
from tests.simulated_shifts import make_perfect, play_shift

DEVICES = get_args(Device)


def test_the_same_seed_gives_the_same_day_on_both_devices_and_another_seed_another() -> None:
    once, again, other = (play_shift(simulate_shift("gt9x", 0.05, seed)) for seed in (7, 7, 8))
    plans = [simulate_shift(device, 0.05, 7).plan for device in DEVICES]

    assert np.array_equal(once.acc_g, again.acc_g)
    assert np.array_equal(once.gyr_dps, again.gyr_dps)
    assert not np.array_equal(once.elevation_deg[3000:18000], other.elevation_deg[3000:18000])
    assert plans[0] == plans[1]


@pytest.mark.parametrize("device", DEVICES)
def test_a_day_begins_with_twenty_seconds_of_an_arm_hanging_still(device: Device) -> None:
    shift = make_perfect(simulate_shift(device, 0.02, 1))
    still = slice(0, int(20.0 * shift.rate_hz))

    whole = play_shift(shift)

    assert shift.calibration_s == (0.0, 20.0)
    assert whole.elevation_deg[still].max() < 0.5
    assert np.abs(whole.gyr_dps[still]).max() < 1.0


def test_the_blocks_follow_each_other_without_a_gap() -> None:
    shift = simulate_shift("lsm9ds1", 0.05, 1)

    time_s = np.concatenate([block.time_s for block in shift.blocks()])

    assert np.array_equal(time_s, np.arange(shift.sample_count) / shift.rate_hz)


def test_the_plan_of_an_hour_has_every_activity_and_no_gap() -> None:
    plan = simulate_shift("gt9x", 1.0, 1).plan

    assert [entry.end_s for entry in plan[:-1]] == [entry.start_s for entry in plan[1:]]
    assert plan[-1].end_s == 3600.0
    assert {entry.name for entry in plan} == {
        "calibration", "standing", "walking", "assembly", "waiting", "overhead", "lifting", "swinging",
        "throwing", "break",
    }  # fmt: skip


def test_a_day_is_as_loaded_as_published_ones() -> None:
    elevation_deg = play_shift(simulate_shift("gt9x", 8.0, 1, 25.0)).elevation_deg

    assert 4.0 < 100.0 * (elevation_deg > 60.0).mean() < 12.0
    assert 18.0 < np.median(elevation_deg) < 32.0


def test_the_true_rate_is_a_little_off_the_nominal_one_which_may_be_asked_for() -> None:
    rates_hz = {simulate_shift("gt9x", 0.01, seed).rate_hz for seed in range(5)}

    assert len(rates_hz) == 5
    assert all(100.0 < rate_hz < 100.2 for rate_hz in rates_hz)
    assert simulate_shift("lsm9ds1", 0.01, 1, 476.0).rate_hz == pytest.approx(476.0, rel=0.025)


def test_an_imperfect_sensor_reads_whole_steps_of_its_resolution() -> None:
    gyr_dps = play_shift(simulate_shift("lsm9ds1", 0.005, 4)).gyr_dps.astype(np.float64)

    assert np.abs(gyr_dps / 0.070 - np.rint(gyr_dps / 0.070)).max() < 1e-3
