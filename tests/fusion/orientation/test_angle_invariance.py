"""What must not change the angle through the whole chain: mounting, units, cuts, direction of time."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acromion.fusion.checks.physics import check_physics
from acromion.fusion.elevation import estimate_elevation
from acromion.fusion.orientation import estimate_vertical
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.recording import Recording, Segment
from acromion.fusion.settings import AnalysisSettings
from tests.factories import record as make_recording
from tests.fusion.made_motion import angle_between_deg, rest_and_turn, tumble
from tests.fusion.readers.tables.table_builder import read_text

Array = NDArray[np.float64]
RATE_HZ = 100.0
POSE_S = ((0.0, 6.0),)
ACC_GAIN = np.array([1.01, 0.995, 0.99])
ACC_OFFSET_G = np.array([0.02, -0.03, 0.01])
GYR_OFFSET_DPS = np.array([1.0, -0.5, 2.0])


@cache
def readings() -> tuple[Array, Array]:
    """What an imperfect sensor reads: 6 s of rest, then 40 turns in all directions, a rest before each."""
    motion = rest_and_turn(40, seed=5)
    rest = 400
    up = np.concatenate([np.tile(motion.up[0], (rest, 1)), motion.up])
    rates = np.concatenate([np.zeros((rest, 3)), motion.gyr_dps])
    noise = np.random.default_rng(1)
    acc_g = ACC_GAIN * up + ACC_OFFSET_G + noise.normal(0.0, 0.002, up.shape)
    return acc_g, rates + GYR_OFFSET_DPS + noise.normal(0.0, 0.05, up.shape)


def record(acc_g: Array, gyr_dps: Array, rate_hz: float = RATE_HZ) -> Recording:
    return make_recording(acc_g, gyr_dps, rate_hz)


def find_elevation(recording: Recording) -> Array:
    (segment,) = estimate_elevation(
        calibrate(recording, AnalysisSettings(calibration_windows_s=POSE_S))
    ).segments
    return segment.elevation_deg.astype(np.float64)


@cache
def unchanged() -> Array:
    return find_elevation(record(*readings()))


MOUNTINGS = [
    np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    np.diag([-1.0, 1.0, -1.0]),
    *Rotation.random(3, random_state=1).as_matrix(),
]


@pytest.mark.parametrize("turn", MOUNTINGS, ids=["axes exchanged", "upside down", "askew", "askew", "askew"])
def test_an_imperfect_sensor_strapped_on_another_way_gives_the_same_elevation(turn: Array) -> None:
    acc_g, gyr_dps = readings()

    turned = find_elevation(record(acc_g @ turn.T, gyr_dps @ turn.T))

    assert np.abs(turned - unchanged()).max() < 0.01


def test_a_table_in_other_units_gives_the_same_elevation() -> None:
    acc_g, gyr_dps = readings()

    plain = find_elevation(read_text(write_table(acc_g, gyr_dps, "g", "dps")))
    converted = find_elevation(read_text(write_table(9.80665 * acc_g, np.radians(gyr_dps), "m/s^2", "rad/s")))

    assert np.abs(converted - plain).max() < 0.01


def write_table(acc: Array, gyr: Array, acc_unit: str, gyr_unit: str) -> str:
    names = [f"acc {a} ({acc_unit})" for a in "xyz"] + [f"gyr {a} ({gyr_unit})" for a in "xyz"]
    rows = (
        f"{k / RATE_HZ:.2f}," + ",".join(f"{value:.9g}" for value in row)
        for k, row in enumerate(np.hstack([acc, gyr]))
    )
    return ",".join(["time (s)", *names]) + "\n" + "\n".join(rows) + "\n"


@pytest.mark.parametrize("mirror", [*(1.0 - 2.0 * np.eye(3)), -np.ones(3)], ids=["x", "y", "z", "all"])
def test_a_left_handed_frame_gives_the_same_elevation(mirror: Array) -> None:
    acc_g, gyr_dps = readings()

    mirrored = check_physics(record(acc_g * mirror, gyr_dps * mirror))

    assert np.abs(find_elevation(mirrored) - unchanged()).max() < 0.01


@pytest.mark.parametrize("turns", [2, 20, 38])
def test_cut_at_a_still_moment_the_pieces_give_the_same_elevation(turns: int) -> None:
    # In the middle of the 2 s rest before a turn: 4 s, then 3 s for each turn before it, then 1 s.
    row = round((5.0 + 3.0 * turns) * RATE_HZ)
    samples = calibrate(record(*readings()), AnalysisSettings(calibration_windows_s=POSE_S))
    (segment,) = samples.recording.segments
    pieces = tuple(
        Segment(first * 10_000, RATE_HZ, segment.acc_g[first:stop], segment.gyr_dps[first:stop])
        for first, stop in ((0, row), (row, len(segment)))
    )

    cut = estimate_elevation(replace(samples, recording=replace(samples.recording, segments=pieces)))

    joined = np.concatenate([piece.elevation_deg for piece in cut.segments])
    assert np.abs(joined - unchanged()).max() < 0.1


def test_at_half_the_rate_the_elevation_is_the_same() -> None:
    acc_g, gyr_dps = readings()

    halved = find_elevation(record(acc_g[::2], gyr_dps[::2], RATE_HZ / 2.0))

    assert np.abs(halved - unchanged()[::2]).max() < 0.2


@pytest.mark.parametrize("seed", [1, 2])
def test_run_backwards_with_everything_found_anew_the_vertical_is_the_same(seed: int) -> None:
    # 99 Hz: five rows to a node; 1980 samples are 396 nodes, so that they fall alike both ways.
    motion = tumble(20.0, 99.0, seed=seed)

    there = estimate_vertical(motion.acc_g, motion.gyr_dps, 99.0)
    back = estimate_vertical(motion.acc_g[::-1], -motion.gyr_dps[::-1], 99.0)[::-1]

    assert angle_between_deg(there, back).max() < 0.02


def test_a_good_sensor_is_not_made_worse_by_calibrating_itself() -> None:
    motion = rest_and_turn(60, seed=1)

    up = estimate_vertical(motion.acc_g, motion.gyr_dps, RATE_HZ)

    assert angle_between_deg(up, motion.up).max() < 0.02
