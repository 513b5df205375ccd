"""The day: its plan, its repeatability, and that it looks like work."""

from typing import get_args

import numpy as np
import pytest

from fusion.simulation import SimulatedShift, simulate_shift
from fusion.simulation.sensor import Device
from tests.simulated_shifts import make_perfect, play_shift
from tests.simulated_tasks import TASKS, simulate_task

DEVICES = get_args(Device)


def test_the_same_seed_gives_the_same_samples() -> None:
    once, again = (play_shift(simulate_shift("gt9x", 0.05, 7)) for _ in range(2))

    assert np.array_equal(once.acc_g, again.acc_g)
    assert np.array_equal(once.gyr_dps, again.gyr_dps)


def test_another_seed_gives_another_day() -> None:
    one, other = (play_shift(simulate_shift("gt9x", 0.05, seed)) for seed in (7, 8))

    assert not np.array_equal(one.elevation_deg[3000:18000], other.elevation_deg[3000:18000])


def test_both_devices_live_through_the_same_day() -> None:
    plans = [simulate_shift(device, 0.05, 7).plan for device in DEVICES]

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


def test_the_plan_covers_the_recording_without_a_gap() -> None:
    plan = simulate_shift("gt9x", 0.5, 1).plan

    assert [entry.end_s for entry in plan[:-1]] == [entry.start_s for entry in plan[1:]]
    assert plan[-1].end_s == 1800.0


def test_an_hour_holds_every_activity() -> None:
    names = {entry.name for entry in simulate_shift("gt9x", 1.0, 1).plan}

    assert names == {
        "calibration", "standing", "walking", "assembly", "waiting", "overhead", "lifting", "swinging",
        "throwing", "break",
    }  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2])
def test_a_day_is_as_loaded_as_published_ones(seed: int) -> None:
    elevation_deg = play_shift(simulate_shift("gt9x", 8.0, seed, 25.0)).elevation_deg

    assert 4.0 < 100.0 * (elevation_deg > 60.0).mean() < 12.0
    assert 18.0 < np.median(elevation_deg) < 32.0


def test_the_true_rate_is_a_little_off_the_nominal_one() -> None:
    rates_hz = {simulate_shift("gt9x", 0.01, seed).rate_hz for seed in range(5)}

    assert len(rates_hz) == 5
    assert all(100.0 < rate_hz < 100.2 for rate_hz in rates_hz)


def test_another_nominal_rate_may_be_asked_for() -> None:
    shift = simulate_shift("lsm9ds1", 0.01, 1, 476.0)

    assert shift.rate_hz == pytest.approx(476.0, rel=0.025)


def test_a_perfect_sensor_reads_one_g_at_rest_whatever_its_mounting() -> None:
    acc_g = play_shift(make_perfect(simulate_shift("gt9x", 0.005, 4))).acc_g

    assert np.linalg.norm(acc_g, axis=1).mean() == pytest.approx(1.0, abs=1e-4)


def test_an_imperfect_sensor_reads_whole_steps_of_its_resolution() -> None:
    gyr_dps = play_shift(simulate_shift("lsm9ds1", 0.005, 4)).gyr_dps.astype(np.float64)

    assert np.abs(gyr_dps / 0.070 - np.rint(gyr_dps / 0.070)).max() < 1e-3


def peak_rate_dps(shift: SimulatedShift) -> float:
    return float(np.abs(play_shift(shift).gyr_dps).max())


@pytest.mark.parametrize("number", TASKS)
def test_each_task_has_five_repetitions_and_throws_have_nine(number: int) -> None:
    names = [entry.name for entry in simulate_task(number, 1, "gt9x").plan]

    assert names.count("repetition") == (9 if number == 10 else 5)


@pytest.mark.parametrize(("number", "tempo_hz"), [(1, 1.0), (3, 3.0), (4, 1.0), (6, 3.0)])
def test_the_arm_is_raised_at_the_tempo_of_the_task(number: int, tempo_hz: float) -> None:
    shift = simulate_task(number, 1, "gt9x")
    first = shift.plan[1]
    rows = slice(int((first.start_s + 1.8) * shift.rate_hz), int((first.end_s - 1.0) * shift.rate_hz))

    elevation_deg = play_shift(shift).elevation_deg[rows]

    above = elevation_deg > np.median(elevation_deg)
    rises = np.flatnonzero(~above[:-1] & above[1:])
    assert shift.rate_hz / np.diff(rises).mean() == pytest.approx(tempo_hz, rel=0.06)


def test_throws_are_the_fastest_task() -> None:
    rates_dps = {number: peak_rate_dps(simulate_task(number, 2, "gt9x")) for number in TASKS}

    assert max(rates_dps, key=lambda number: rates_dps[number]) == 10
