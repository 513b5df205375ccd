"""The recordings that other tests order."""

import numpy as np
import pytest

from tests.factories import hold, move_arm


def test_hold_passes_half_way_at_the_boundary_and_lasts_as_long_as_its_poses() -> None:
    made = hold((0, 2), (95, 3), rate_hz=500)

    assert made.recording.duration_us == 5_000_000
    assert made.elevation_deg[[0, 1000, -1]] == pytest.approx([0.0, 47.5, 95.0])


def test_hold_reads_gravity_at_the_angle_held_through_its_mounting() -> None:
    turned = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])

    acc_g = hold((0, 2), (60, 2), plane_deg=0.0, mounting=turned).recording.segments[0].acc_g

    assert acc_g[-1] == pytest.approx([0.5, np.sin(np.radians(60)), 0.0], abs=1e-6)


def test_what_move_arm_feels_turns_as_its_gyroscope_says() -> None:
    """In a slow movement the acceleration is the vertical: da/dt = a x omega."""
    segment = move_arm(lambda t: 30.0 + 5.0 * t, 2.0).recording.segments[0]

    turned = np.gradient(segment.acc_g.astype(float), 0.01, axis=0)

    assert segment.gyr_dps[100] == pytest.approx([0.0, -5.0, 0.0], abs=1e-4)
    assert np.allclose(turned, np.cross(segment.acc_g, np.radians(segment.gyr_dps)), atol=1e-4)
