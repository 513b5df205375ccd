"""What each speed must be, worked out by hand: EXPOSURE.md part D, rows 3, 4, 9 and 17."""

import numpy as np
import pytest

from fusion.elevation import Elevation, ElevationSegment
from fusion.exposure import summarise_exposure
from fusion.exposure.speeds import SpeedTally
from tests.spec.curves import sample, swing, triangle


@pytest.mark.parametrize(
    ("figure", "speed_dps"),
    [
        ("p10_dps", 9.8291),
        ("p50_dps", 44.4288),
        ("p90_dps", 62.0583),
        ("p99_dps", 62.8241),
        ("mean_dps", 40.0),
    ],
    ids=["10th percentile", "median", "90th percentile", "99th percentile", "mean"],
)
def test_3_a_swinging_arm_has_the_speeds_of_the_cosine(figure: str, speed_dps: float) -> None:
    speeds = SpeedTally()
    speeds.add_inclination(sample(swing, 600, rate_hz=997.0))

    assert getattr(speeds.summarise(), figure) == pytest.approx(speed_dps, abs=0.05)


def test_4_a_swinging_arm_is_slower_than_5_deg_per_s_for_a_twentieth_of_the_time() -> None:
    speeds = SpeedTally()
    speeds.add_inclination(sample(swing, 600, rate_hz=997.0))

    slow_share = speeds.cell_s[:501].sum() / speeds.cell_s.sum()  # 500 cells of 0.01 deg/s, and standstill
    assert slow_share == pytest.approx(0.050714, abs=0.0005)


def test_9_an_arm_at_even_speed_moves_at_40_deg_per_s() -> None:
    speeds = SpeedTally()
    speeds.add_inclination(sample(triangle, 600))

    velocity = speeds.summarise()
    assert velocity is not None
    assert velocity.p50_dps == pytest.approx(40.0, abs=0.011)


def turn_about(axis: tuple[float, float, float], rate_dps: float, start: tuple[float, ...]) -> Elevation:
    """Let a sensor turn at an even rate: it sees the vertical ``start`` turn the other way about ``axis``."""
    turned = -np.radians(rate_dps) * np.arange(2000) / 100.0
    k, v = np.array(axis), np.array(start)
    vertical = (
        np.outer(np.cos(turned), v)
        + np.outer(np.sin(turned), np.cross(k, v))
        + np.outer(1 - np.cos(turned), k * (k @ v))
    )
    angle = np.degrees(np.arccos(np.clip(vertical[:, 2], -1, 1)))
    valid = np.ones(2000, np.bool_)
    valid[:300] = valid[-300:] = False  # the filter's first and last second
    segment = ElevationSegment(0, 100.0, angle.astype(np.float32), valid, vertical.astype(np.float32))
    return Elevation((segment,), None)


SIXTY = (np.sin(np.radians(60.0)), 0.0, np.cos(np.radians(60.0)))


@pytest.mark.parametrize(
    ("axis", "rate_dps", "start", "inclination_dps", "generalised_dps"),
    [
        (SIXTY, 90.0, SIXTY, 0.0, 0.0),
        ((0.0, 0.0, 1.0), 90.0, SIXTY, 0.0, 77.9423),
        ((0.0, 0.0, 1.0), 45.0, SIXTY, 0.0, 38.9711),  # 90 deg/s times the cosine of 60 deg
        ((0.0, 1.0, 0.0), 9.0, (0.0, 0.0, 1.0), 9.0, 9.0),
    ],
    ids=[
        "the body turns round",
        "the arm spins about its own axis at 60 deg",
        "the arm circles at 60 deg without spinning",
        "the arm is raised at 9 deg/s",
    ],
)
def test_17_each_speed_sees_its_own_kind_of_turning(
    axis: tuple[float, float, float],
    rate_dps: float,
    start: tuple[float, float, float],
    inclination_dps: float,
    generalised_dps: float,
) -> None:
    velocity = summarise_exposure(turn_about(axis, rate_dps, start)).velocity_dps

    inclination, generalised = velocity["inclination"], velocity["generalised"]
    assert inclination is not None
    assert generalised is not None
    assert inclination.p50_dps == pytest.approx(inclination_dps, abs=0.02)
    assert generalised.p50_dps == pytest.approx(generalised_dps, abs=0.02)
