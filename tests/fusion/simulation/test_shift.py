"""The day: its plan, its repeatability, and that it looks like work."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise
from typing import get_args

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.simulation import SimulatedShift, simulate_shift
from acromion.fusion.simulation.body import ArmState
from acromion.fusion.simulation.sensor import (
    GT9X,
    LSM9DS1,
    Device,
    draw_errors,
    quantise,
    sense,
)
from tests.simulated_shifts import draw_perfect, make_perfect, play_shift
from tests.simulated_tasks import CALIBRATION_S, LOWERING_S, TASKS, simulate_session, simulate_task

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


# The imperfect sensor: what it adds, and where it stops.

TIME_S = np.arange(6000) / 100.0


def hang_still() -> ArmState:
    up, still = np.zeros((6000, 3)), np.zeros((6000, 3))
    up[:, 2] = 1.0
    return ArmState(up, still, still, np.zeros(6000))


def test_a_perfect_sensor_reads_the_arm_through_its_mounting() -> None:
    errors = draw_perfect(60.0, np.random.default_rng(1))

    readings = sense(hang_still(), errors, TIME_S, np.random.default_rng(2))

    assert np.allclose(readings.acc_g, errors.mounting[:, 2], atol=1e-12)


def test_a_mounting_is_a_rotation_with_the_arm_near_the_sensors_y_axis() -> None:
    mountings = [draw_perfect(60.0, np.random.default_rng(seed)).mounting for seed in range(50)]

    assert all(np.linalg.det(turn) == pytest.approx(1.0) and turn[1, 2] > 0.95 for turn in mountings)


def test_at_rest_the_gyroscope_reads_its_offset_and_the_wander_between_two_knots() -> None:
    errors = draw_errors(LSM9DS1, 100.0, 60.0, np.random.default_rng(1))
    errors = replace(errors, acc_noise_g=0.0, gyr_noise_dps=0.0)

    readings = sense(hang_still(), errors, TIME_S, np.random.default_rng(2))

    first, second = errors.gyr_wander_dps[:2]
    assert readings.gyr_dps[0] == pytest.approx(errors.gyr_offset_dps + first)
    assert readings.gyr_dps[3000] == pytest.approx(errors.gyr_offset_dps + (first + second) / 2)


def test_noise_has_the_stated_size() -> None:
    errors = draw_errors(GT9X, 100.0, 60.0, np.random.default_rng(1))

    readings = sense(hang_still(), errors, TIME_S, np.random.default_rng(2))

    assert np.diff(readings.acc_g, axis=0).std() / np.sqrt(2) == pytest.approx(errors.acc_noise_g, rel=0.03)


@pytest.mark.parametrize(
    ("value", "counts"), [(0.00024, 0), (0.00025, 1), (-1.0, -2048), (17.0, 32767), (-17, -32767)]
)
def test_counts_are_rounded_to_the_step_and_cut_at_full_scale(value: float, counts: int) -> None:
    assert quantise(np.array([value]), GT9X.acc_g_per_lsb, GT9X.acc_range_g)[0] == counts


def test_the_lsm9ds1_stops_at_2000_dps_though_its_counts_could_go_on() -> None:
    counts = quantise(np.array([2100.0]), LSM9DS1.gyr_dps_per_lsb, LSM9DS1.gyr_range_dps)

    assert counts[0] * LSM9DS1.gyr_dps_per_lsb == pytest.approx(2000.0, abs=0.07)


# The ten tasks of the paper, each by itself and all in one session.

TRUNK_FLEXION, THROWS = 7, 10


@pytest.fixture(scope="module")
def session() -> SimulatedShift:
    return simulate_session(1, "gt9x")


@pytest.fixture(scope="module")
def elevation_deg(session: SimulatedShift) -> NDArray[np.float64]:
    return play_shift(session).elevation_deg


def at(session: SimulatedShift, time_s: float) -> int:
    return round(time_s * session.rate_hz)


def test_a_session_holds_each_task_as_often_as_the_paper_asks(session: SimulatedShift) -> None:
    names = Counter(entry.name for entry in session.plan)
    rests = [entry.end_s - entry.start_s for entry in session.plan if entry.name == "rest"]

    assert names == {
        "calibration": 1, "rest": len(TASKS),
        **{f"repetition {number}": 9 if number == THROWS else 5 for number in TASKS},
    }  # fmt: skip
    assert (session.plan[0].start_s, session.plan[0].end_s) == (0.0, CALIBRATION_S)
    assert all(before.end_s <= after.start_s for before, after in pairwise(session.plan))
    assert min(rests) >= 20.0


def test_the_arm_hangs_when_it_has_been_lowered(
    session: SimulatedShift, elevation_deg: NDArray[np.float64]
) -> None:
    ends_s = [entry.end_s + LOWERING_S for entry in session.plan if entry.name.startswith("repetition")]

    lowered_deg = elevation_deg[[at(session, end_s) for end_s in ends_s]]

    assert lowered_deg.max() < 10.0


@pytest.mark.parametrize(
    ("number", "lowest_deg", "highest_deg"), [(2, 70.0, 110.0), (TRUNK_FLEXION, 0.0, 15.0)]
)
def test_the_arm_stays_about_level_while_it_rotates_and_plumb_while_the_trunk_bends(
    session: SimulatedShift,
    elevation_deg: NDArray[np.float64],
    number: int,
    lowest_deg: float,
    highest_deg: float,
) -> None:
    first = next(entry for entry in session.plan if entry.name == f"repetition {number}")

    task_deg = elevation_deg[at(session, first.start_s + 1.0) : at(session, first.end_s)]

    assert lowest_deg <= task_deg.min() <= task_deg.max() <= highest_deg


def test_a_person_does_a_task_alike_in_a_session_and_alone_and_people_differ(session: SimulatedShift) -> None:
    alone, together = (
        [entry.end_s - entry.start_s for entry in shift.plan if entry.name == name]
        for shift, name in ((simulate_task(8, 1, "gt9x"), "repetition"), (session, "repetition 8"))
    )

    assert together == pytest.approx(alone)
    assert simulate_session(2, "gt9x").plan != session.plan
    assert np.array_equal(simulate_session(1, "lsm9ds1").motion.strokes, session.motion.strokes)
