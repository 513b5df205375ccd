"""The recordings that other tests order."""

import numpy as np
import pytest

from tests.factories import elevate, hold, move_arm


def test_hold_lasts_as_long_as_its_poses() -> None:
    made = hold((0, 2), (95, 3), rate_hz=500)

    assert made.recording.duration_us == 5_000_000
    assert len(made.elevation_deg) == 2500


def test_hold_passes_half_way_at_the_boundary() -> None:
    made = hold((0, 2), (95, 3), rate_hz=500)

    assert made.elevation_deg[[0, 1000, -1]] == pytest.approx([0.0, 47.5, 95.0])


def test_hold_reads_gravity_at_the_angle_held() -> None:
    acc_g = hold((0, 2), (60, 2), plane_deg=0.0).recording.segments[0].acc_g

    assert acc_g[-1] == pytest.approx([np.sin(np.radians(60)), 0.0, 0.5], abs=1e-6)


def test_a_mounting_turns_the_readings() -> None:
    turned = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

    acc_g = hold((0, 2), mounting=turned).recording.segments[0].acc_g

    assert acc_g[0] == pytest.approx([1.0, 0.0, 0.0])


def test_the_top_of_a_swing_reads_83_94_deg_by_acceleration_alone() -> None:
    """EXPOSURE.md D18: theta = 45 + 40 sin(2 pi 0.5 t), sensor at 0.25 m; true 85 deg."""
    made = move_arm(lambda t: 45 + 40 * np.sin(np.pi * t), 1.0, distance_m=0.25)

    acc_x, _, acc_z = made.recording.segments[0].acc_g[50].astype(float)

    assert np.degrees(np.arctan2(acc_x, acc_z)) == pytest.approx(83.9374, abs=0.01)


def test_move_arm_turns_the_gyroscope_by_the_slope_of_the_angle() -> None:
    made = move_arm(lambda t: 9.0 * t, 2.0)

    assert made.recording.segments[0].gyr_dps[100] == pytest.approx([0.0, -9.0, 0.0], abs=1e-4)


def test_what_move_arm_feels_turns_as_its_gyroscope_says() -> None:
    """In a slow movement the acceleration is the vertical: da/dt = a x omega."""
    segment = move_arm(lambda t: 30.0 + 5.0 * t, 2.0).recording.segments[0]

    turned = np.gradient(segment.acc_g.astype(float), 0.01, axis=0)

    assert np.allclose(turned, np.cross(segment.acc_g, np.radians(segment.gyr_dps)), atol=1e-4)


def test_elevate_leaves_a_hole_between_runs() -> None:
    elevation = elevate(np.zeros(100), np.zeros(100), rate_hz=100.0, hole_s=2.0)

    assert [segment.start_us for segment in elevation.segments] == [0, 3_000_000]
