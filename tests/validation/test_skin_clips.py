"""Clips with a sensor on the skin: what it feels, and that the truth stays the humerus."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.validation.real_clips import CLIP_HZ, Track, compute_readings
from benchmarks.validation.skin_clips import Strap, load_skin_library

X = np.array([1.0, 0.0, 0.0])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One trial at 100 Hz: 3 s hanging, in 4 s to level, 3 s level; the plate turns with it, by 10 deg."""
    angle_deg = np.interp(np.arange(1000) / 100.0, [3.0, 7.0], [0.0, 90.0])
    trial = {
        "humerus_quat_xyzw_0": Rotation.from_rotvec(np.radians(angle_deg)[:, None] * X).as_quat(),
        "shoulder_acc_mps2_0": np.zeros((1000, 3)),
        "sensor_quat_in_humerus_xyzw_0": Rotation.from_rotvec(
            np.radians(angle_deg / 9.0)[:, None] * X
        ).as_quat(),
        "sensor_from_shoulder_m_0": np.tile([0.05, 0.0, -0.2], (1000, 1)),
    }
    np.savez(tmp_path / "adl01R.npz", rate_hz=100.0, **trial)  # type: ignore[arg-type]
    return tmp_path


def test_the_truth_is_the_humerus_while_gravity_is_read_on_the_plate(folder: Path) -> None:
    (clip,) = load_skin_library(folder, is_rigid=False)["adl01R"]

    state = compute_readings(clip, 100.0)

    assert state.elevation_deg[900] == pytest.approx(90.0, abs=0.1)
    assert np.linalg.norm(state.acc_g[900]) == pytest.approx(1.0, abs=1e-3)
    # Mounted as it sits below 25 deg, where it has turned by 0 to 2.8 deg.
    read_deg = np.degrees(np.arccos(state.acc_g[900, 2]))
    assert 97.2 < read_deg < 100.0


def test_a_rigid_plate_reads_what_the_humerus_does(folder: Path) -> None:
    (clip,) = load_skin_library(folder, is_rigid=True)["adl01R"]

    assert np.degrees(np.arccos(compute_readings(clip, 100.0).acc_g[900, 2])) == pytest.approx(90.0, abs=0.1)


def test_a_posture_held_between_clips_takes_the_plate_along(folder: Path) -> None:
    (clip,) = load_skin_library(folder, is_rigid=False)["adl01R"]
    track = Track(np.random.default_rng(1), Strap([clip]))
    track.hold(Rotation.identity(), 5.0)
    track.append(clip)
    track.hold(Rotation.identity(), 5.0)

    plate = track.join().plate

    assert plate is not None
    steps_dps = np.degrees((plate.turn[:-1].inv() * plate.turn[1:]).magnitude()) * CLIP_HZ
    assert steps_dps.max() < 25.0
