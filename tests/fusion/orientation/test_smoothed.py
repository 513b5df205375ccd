"""The smoothed estimator: signs, time convention, exactness, what it survives."""

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.conventions import MethodName
from acromion.fusion.errors import UnusableArrays
from acromion.fusion.orientation import estimate_vertical
from acromion.fusion.sensor.model import SensorRun
from tests.estimates import smooth_vertical
from tests.fusion.made_motion import Motion, angle_between_deg, tumble

OFFSET = np.array([10.0, -20.0, 15.0])
METHODS: tuple[MethodName, ...] = ("smoothed", "published", "live")


def error_deg(motion: Motion, **changes: NDArray[np.float64]) -> float:
    acc, gyr = changes.get("acc", motion.acc_g), changes.get("gyr", motion.gyr_dps)
    up = estimate_vertical(acc, gyr, motion.rate_hz)
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
    broken[310:391] = [0.0, 0.0, 1.0]  # while it turns the accelerometer is of no help, only the rate

    up = estimate_vertical(broken, rate_dps, rate_hz, method)

    half_way = up[350]
    assert half_way[1] > 0.5
    assert half_way[2] > 0.5


def test_a_perfect_sensor_gives_the_vertical_at_the_time_of_each_sample() -> None:
    motion = tumble(30.0, 100.0, seed=1)

    smoothed = smooth_vertical(as_run(motion))

    assert angle_between_deg(smoothed.up, motion.up).max() < 0.01
    assert smoothed.uncertainty_deg.max() < 0.1


def test_a_fast_movement_is_integrated_without_loss_at_a_low_rate() -> None:
    # 30 deg to and fro at 3 Hz: a straight line between samples would lose (2 pi 3 / 50)^2 / 12 = 1.2 % of
    # it at 50 Hz, 0.35 deg.
    time_s = np.arange(1000) / 50.0
    speed = 2.0 * np.pi * 3.0
    angle = np.radians(30.0) * np.sin(speed * time_s)
    up = np.stack([np.zeros_like(angle), np.sin(angle), np.cos(angle)], axis=1)
    gyr = np.zeros_like(up)
    gyr[:, 0] = 30.0 * speed * np.cos(speed * time_s)
    mean = np.tile(up.mean(axis=0), (len(up), 1))  # the accelerometer is of no help within a swing

    found = smooth_vertical(SensorRun(0.0, 50.0, mean, gyr)).up[250:750]

    assert np.degrees(np.ptp(np.arctan2(found[:, 1], found[:, 2]))) == pytest.approx(60.0, abs=0.15)


@pytest.mark.parametrize(
    ("seconds", "still_s", "within_deg"),
    [(60.0, 4.0, 0.05), (120.0, 0.0, 0.3)],
    ids=["with rests", "without"],
)
def test_an_offset_of_27_deg_per_s_does_no_harm(seconds: float, still_s: float, within_deg: float) -> None:
    motion = tumble(seconds, 100.0, seed=4, still_s=still_s)

    assert error_deg(motion, gyr=motion.gyr_dps + OFFSET) < within_deg


def test_shaking_to_and_fro_averages_out() -> None:
    motion = tumble(30.0, 100.0, seed=6)
    shake = 0.5 * np.sin(2.0 * np.pi * 3.0 * np.arange(3000) / 100.0)
    to_world_x = shake[:, None] * np.cross(motion.up, [0.0, 0.0, 1.0])

    assert error_deg(motion, acc=motion.acc_g + to_world_x) < 0.6


def test_filtering_at_nodes_gives_what_filtering_at_every_sample_gives() -> None:
    run = as_run(tumble(30.0, 500.0, seed=8))

    everywhere = smooth_vertical(run, node_rate_hz=500.0).up

    assert angle_between_deg(smooth_vertical(run).up, everywhere).max() < 0.01


@pytest.mark.parametrize("method", METHODS)
def test_single_and_double_precision_agree(method: MethodName) -> None:
    motion = tumble(20.0, seed=9)

    double, single = (
        estimate_vertical(motion.acc_g.astype(kind), motion.gyr_dps.astype(kind), 100.0, method)
        for kind in (np.float64, np.float32)
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
@pytest.mark.parametrize("rows", [1, 2, 50])
def test_a_handful_of_samples_gives_their_own_direction_even_at_1_4_g(method: MethodName, rows: int) -> None:
    up = estimate_vertical(np.tile([0.0, 1.4, 0.0], (rows, 1)), np.zeros((rows, 3)), 100.0, method)

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


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("length_g", [9.807, 0.0])
def test_an_acceleration_that_is_not_in_g_is_refused(method: MethodName, length_g: float) -> None:
    with pytest.raises(UnusableArrays) as refused:
        estimate_vertical(np.tile([0.0, 0.0, length_g], (300, 1)), np.zeros((300, 3)), 100.0, method)

    assert refused.value.facts == {"why": "unit", "g": length_g}
