"""The smoothed estimator: signs, time convention, exactness, what it survives."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fusion.conventions import MethodName
from fusion.errors import UnusableArrays
from fusion.orientation import estimate_vertical
from fusion.sensor.model import SensorRun, hold_bias
from tests.estimates import smooth_vertical
from tests.fusion.made_motion import Motion, angle_between_deg, tumble

OFFSET = np.array([10.0, -20.0, 15.0])
METHODS: tuple[MethodName, ...] = ("smoothed", "published", "live")


def error_deg(motion: Motion, **changes: NDArray[np.float64]) -> float:
    up = estimate_vertical(
        changes.get("acc", motion.acc_g), changes.get("gyr", motion.gyr_dps), motion.rate_hz
    )
    return float(np.sqrt(np.mean(angle_between_deg(up, motion.up) ** 2)))


def as_run(motion: Motion) -> SensorRun:
    return SensorRun(0.0, motion.rate_hz, motion.acc_g, motion.gyr_dps)


@pytest.mark.parametrize("method", METHODS)
def test_turning_about_x_at_90_deg_per_s_swings_the_vertical_from_z_to_y(method: MethodName) -> None:
    # By hand: the sensor's y axis starts level and turns towards where z (up) was. After one second it points
    # up, so the zenith, which was on +z, is on +y. The reading at rest shows it: acceleration +1 g on y.
    rate_hz = 100.0
    turned = np.concatenate([np.zeros(300), np.linspace(0.0, 90.0, 101), np.full(299, 90.0)])
    rate_dps = np.zeros((700, 3))
    rate_dps[300:401, 0] = 90.0
    rate_dps[[300, 400], 0] = 45.0
    acc = np.stack([np.zeros(700), np.sin(np.radians(turned)), np.cos(np.radians(turned))], axis=1)
    broken = acc.copy()
    broken[310:391] = [
        0.0,
        0.0,
        1.0,
    ]  # while it turns the accelerometer is no help: only the sign of the rate is

    up = estimate_vertical(broken, rate_dps, rate_hz, method)

    half_way = up[350]
    assert half_way[1] > 0.5
    assert half_way[2] > 0.5


def test_a_perfect_sensor_gives_the_vertical_at_the_time_of_each_sample() -> None:
    motion = tumble(30.0, 100.0, seed=1)

    prompt = smooth_vertical(as_run(motion)).up

    assert angle_between_deg(np.asarray(prompt, dtype=float), motion.up).max() < 0.01


def test_a_perfect_sensor_is_not_made_worse_by_calibrating_itself() -> None:
    assert error_deg(tumble(30.0, 100.0, seed=1)) < 0.01


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_a_fast_movement_is_integrated_without_loss_at_a_low_rate(rate_hz: float) -> None:
    # 30 deg to and fro at 3 Hz: a straight line between samples would lose (2 pi 3 / 50)^2 / 12 = 1.2 % of
    # it at 50 Hz, 0.35 deg.
    time_s = np.arange(round(20.0 * rate_hz)) / rate_hz
    speed = 2.0 * np.pi * 3.0
    angle = np.radians(30.0) * np.sin(speed * time_s)
    up = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    gyr = np.zeros_like(up)
    gyr[:, 0] = 30.0 * speed * np.cos(speed * time_s)
    mean = np.tile(up.mean(axis=0), (len(up), 1))  # the accelerometer is of no help within a swing

    found = smooth_vertical(SensorRun(0.0, rate_hz, mean, gyr)).up

    middle = slice(len(up) // 4, -len(up) // 4)
    excursion = np.degrees(np.ptp(np.arctan2(found[middle, 1], found[middle, 2])))
    assert excursion == pytest.approx(60.0, abs=0.15)


@settings(max_examples=12, deadline=None)
@given(st.permutations([0, 1, 2]), st.integers(0, 3))
def test_the_order_and_signs_of_the_axes_do_not_matter(order: list[int], flipped: int) -> None:
    # Any right-handed relabelling of the axes: a permutation with signs that make its determinant one.
    turn = np.eye(3)[order]
    turn[flipped % 3] *= np.linalg.det(turn)
    motion = tumble(20.0, 100.0, seed=21)

    relabelled = estimate_vertical(motion.acc_g @ turn.T, motion.gyr_dps @ turn.T, 100.0)

    straight = estimate_vertical(motion.acc_g, motion.gyr_dps, 100.0)
    assert angle_between_deg(relabelled @ turn, straight).max() < 1e-6


def test_half_the_rate_gives_the_same_vertical() -> None:
    fine, coarse = tumble(30.0, 100.0, seed=2), tumble(30.0, 50.0, seed=2)

    from_fine = estimate_vertical(fine.acc_g, fine.gyr_dps, 100.0)[::2]
    from_coarse = estimate_vertical(coarse.acc_g, coarse.gyr_dps, 50.0)

    assert angle_between_deg(from_fine, from_coarse).max() < 0.2


def test_an_offset_of_27_deg_per_s_does_no_harm() -> None:
    motion = tumble(60.0, 100.0, seed=4)

    assert error_deg(motion, gyr=motion.gyr_dps + OFFSET) < 0.05


def test_an_offset_is_found_without_any_rest() -> None:
    motion = tumble(120.0, 100.0, seed=5, still_s=0.0)

    assert error_deg(motion, gyr=motion.gyr_dps + OFFSET) < 0.3


def test_shaking_to_and_fro_averages_out() -> None:
    motion = tumble(30.0, 100.0, seed=6)
    shake = 0.5 * np.sin(2.0 * np.pi * 3.0 * np.arange(3000) / 100.0)
    to_world_x = shake[:, None] * np.cross(motion.up, [0.0, 0.0, 1.0])

    assert error_deg(motion, acc=motion.acc_g + to_world_x) < 0.6


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10_000))
def test_the_mounting_of_the_sensor_does_not_matter(seed: int) -> None:
    motion = tumble(20.0, 100.0, seed=7)
    turn = Rotation.random(random_state=seed).as_matrix()

    turned = estimate_vertical(motion.acc_g @ turn.T, motion.gyr_dps @ turn.T, 100.0)

    straight = estimate_vertical(motion.acc_g, motion.gyr_dps, 100.0)
    assert angle_between_deg(turned @ turn, straight).max() < 0.01


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 10_000))
def test_run_backwards_the_smoothed_vertical_is_the_same(seed: int) -> None:
    # Backwards in time the sensor turns the other way round; the two-sided mean has no direction of its own.
    motion = tumble(20.0, 99.0, seed=seed)
    forwards = as_run(motion)
    backwards = SensorRun(0.0, 99.0, motion.acc_g[::-1].copy(), -motion.gyr_dps[::-1])

    there = smooth_vertical(forwards, hold_bias(np.zeros(3)), node_rate_hz=99.0).up
    back = smooth_vertical(backwards, hold_bias(np.zeros(3)), node_rate_hz=99.0).up[::-1]

    assert angle_between_deg(np.asarray(there, dtype=float), np.asarray(back, dtype=float)).max() < 1e-6


def test_filtering_at_nodes_gives_what_filtering_at_every_sample_gives() -> None:
    motion = tumble(30.0, 500.0, seed=8)
    run = as_run(motion)

    at_nodes = smooth_vertical(run).up
    everywhere = smooth_vertical(run, node_rate_hz=500.0).up

    assert angle_between_deg(np.asarray(at_nodes, float), np.asarray(everywhere, float)).max() < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_single_and_double_precision_agree(method: MethodName) -> None:
    motion = tumble(20.0, seed=9)

    double = estimate_vertical(motion.acc_g, motion.gyr_dps, 100.0, method)
    single = estimate_vertical(
        motion.acc_g.astype(np.float32), motion.gyr_dps.astype(np.float32), 100.0, method
    )

    assert angle_between_deg(double, single).max() < 0.001


@pytest.mark.parametrize("method", METHODS)
def test_any_memory_layout_is_taken_and_nothing_is_modified(method: MethodName) -> None:
    motion = tumble(20.0, seed=10)
    acc, gyr = np.asfortranarray(motion.acc_g), np.repeat(motion.gyr_dps, 2, axis=0)[::2]
    acc.flags.writeable = False
    gyr.flags.writeable = False

    up = estimate_vertical(acc, gyr, 100.0, method)

    assert np.array_equal(up, estimate_vertical(motion.acc_g.tolist(), motion.gyr_dps, 100.0, method))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("rows", [1, 2, 3, 7, 50])
def test_a_handful_of_samples_at_rest_gives_their_own_direction(method: MethodName, rows: int) -> None:
    up = estimate_vertical(np.tile([0.0, 1.3, 0.0], (rows, 1)), np.zeros((rows, 3)), 100.0, method)

    assert np.abs(up - [0.0, 1.0, 0.0]).max() < 1e-9


@pytest.mark.parametrize(
    ("acc", "gyr", "rate_hz", "why"),
    [
        (np.zeros((5, 2)), np.zeros((5, 2)), 100.0, "shape"),
        (np.zeros((5, 3)), np.zeros((4, 3)), 100.0, "shape"),
        (np.zeros(5), np.zeros(5), 100.0, "shape"),
        (np.zeros((0, 3)), np.zeros((0, 3)), 100.0, "empty"),
        (np.full((5, 3), np.nan), np.zeros((5, 3)), 100.0, "finite"),
        (np.zeros((5, 3)), np.full((5, 3), np.inf), 100.0, "finite"),
        (np.zeros((5, 3)), np.zeros((5, 3)), 0.0, "rate"),
        (np.zeros((5, 3)), np.zeros((5, 3)), float("nan"), "rate"),
        ([["a", "b", "c"]], np.zeros((1, 3)), 100.0, "numbers"),
    ],
)
def test_arrays_that_cannot_be_fused_are_refused(acc: object, gyr: object, rate_hz: float, why: str) -> None:
    with pytest.raises(UnusableArrays) as refusal:
        estimate_vertical(acc, gyr, rate_hz)  # type: ignore[arg-type]

    assert refusal.value.facts["why"] == why
    assert isinstance(refusal.value, ValueError)


def test_past_and_future_agree_on_a_perfect_sensor() -> None:
    motion = tumble(20.0, seed=11)

    smoothed = smooth_vertical(as_run(motion))

    assert smoothed.uncertainty_deg.max() < 0.1


def test_a_turn_that_the_gyroscope_missed_is_noticed() -> None:
    # The vertical jumps by 40 deg and the rate reads nil. Past and future are 40 deg apart at the jump, so
    # half of that is uncertain there; over a second about it a little less.
    acc = np.zeros((2000, 3))
    acc[:1000, 2] = 1.0
    acc[1000:] = [np.sin(np.radians(40.0)), 0.0, np.cos(np.radians(40.0))]

    smoothed = smooth_vertical(SensorRun(0.0, 100.0, acc, np.zeros((2000, 3))))

    assert 14.0 < smoothed.uncertainty_deg[1000 // smoothed.rows_per_value] < 20.0


def test_an_unknown_method_is_refused_not_replaced() -> None:
    still = np.tile([0.0, 0.0, 1.0], (100, 1))

    with pytest.raises(ValueError, match=r"madgwick.*smoothed, published, live"):
        estimate_vertical(still, np.zeros((100, 3)), 100.0, method="madgwick")  # type: ignore[arg-type]


@pytest.mark.parametrize(("factor", "length_g"), [(9.80665, 9.807), (1000.0, 1000.0), (0.0, 0.0)])
@pytest.mark.parametrize("method", METHODS)
def test_an_acceleration_that_is_not_in_g_is_refused(
    method: MethodName, factor: float, length_g: float
) -> None:
    still = np.tile([0.0, 0.0, factor], (300, 1))

    with pytest.raises(UnusableArrays) as refused:
        estimate_vertical(still, np.zeros((300, 3)), 100.0, method)

    assert refused.value.facts == {"why": "unit", "g": length_g}


@pytest.mark.parametrize("method", METHODS)
def test_an_arm_that_is_thrown_about_throughout_is_no_other_unit(method: MethodName) -> None:
    thrown = np.tile([0.0, 0.0, 1.4], (300, 1))

    vertical = estimate_vertical(thrown, np.zeros((300, 3)), 100.0, method)

    assert vertical[-1] == pytest.approx([0.0, 0.0, 1.0])
