"""Samples at the end of the range are bridged, and what cannot be bridged is left alone."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.orientation import estimate_vertical
from fusion.sensor.model import SensorRun
from fusion.sensor.self_calibration import bridge_saturation
from fusion.sensor.stillness import reduce_run
from tests.fusion.made_motion import angle_between_deg, rest_and_turn

Table = NDArray[np.float64]


def bridge(gyr: Table, **ranges: float) -> Table:
    run = SensorRun(0.0, 100.0, np.zeros((400, 3)), gyr)
    return np.asarray(bridge_saturation([run], [reduce_run(run)], **ranges)[0].gyr_dps)


def swing(peak_dps: float) -> Table:
    gyr = np.zeros((400, 3))
    gyr[:, 1] = peak_dps * np.sin(2.0 * np.pi * np.arange(400) / 100.0)
    return gyr


def test_a_run_that_is_nowhere_clipped_is_given_back_as_it_is() -> None:
    run = SensorRun(0.0, 100.0, np.zeros((400, 3)), swing(600.0))

    assert bridge_saturation([run], [reduce_run(run)])[0] is run


def test_the_top_of_a_swing_is_drawn_again_and_the_input_is_not_modified() -> None:
    # A sine of 600 deg/s cut at 500: 18 to 19 samples at each top. The cubic with the slopes at the cut comes
    # within a twentieth of what was lost.
    true, cut = swing(600.0), np.clip(swing(600.0), -500.0, 500.0)

    bridged = bridge(cut)

    assert np.abs(bridged[10:-10] - true[10:-10]).max() < 10.0
    assert np.abs(bridged[:, 1]).max() > 590.0
    assert np.abs(cut).max() == 500.0


def test_a_known_range_is_used_if_the_signal_does_not_rest_at_it() -> None:
    gyr = swing(2500.0)
    gyr[25, 1], gyr[24, 1], gyr[26, 1] = 2000.0, 1999.5, 1999.5

    assert bridge(np.clip(gyr, -2000.0, 2000.0), gyr_range_dps=2000.0)[25, 1] > 2000.0


@pytest.mark.parametrize("rows", [slice(0, 20), slice(380, 400), slice(100, 160)])
def test_clipping_at_an_end_or_for_long_is_left_as_it_is(rows: slice) -> None:
    gyr = np.zeros((400, 3))
    gyr[rows, 0] = 500.0

    assert np.array_equal(bridge(gyr), gyr)


def test_small_values_that_rest_at_their_extreme_are_no_clipping() -> None:
    gyr = np.clip(swing(200.0), -100.0, 100.0)

    assert np.array_equal(bridge(gyr), gyr)


def test_after_clipping_the_direction_is_right_at_once() -> None:
    # Turns of 40 to 120 deg in a third of a second, up to 720 deg/s, cut at 600; rests of two thirds.
    motion = rest_and_turn(20, seed=3)
    gyr, rate_hz = 3.0 * motion.gyr_dps, 300.0

    cut = estimate_vertical(motion.acc_g, np.clip(gyr, -600.0, 600.0), rate_hz)

    resting = np.flatnonzero(np.abs(gyr).max(axis=1) == 0.0)
    assert np.abs(gyr).max() > 610.0
    assert angle_between_deg(cut[resting], motion.up[resting]).max() < 1.0
