"""Sensor that slips on the arm while it is worn."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.elevation import estimate_elevation
from fusion.pipeline import analyse
from fusion.pose.calibrate import calibrate
from fusion.recording import Recording
from fusion.settings import AnalysisSettings
from fusion.simulation import simulate_shift
from fusion.simulation.sensor import Device
from tests.factories import record
from tests.fusion.test_reattachment import RATE_HZ, tilt

HOUR_S = 3600.0
Table = NDArray[np.float64]


def slip(turn: Table, at_s: float, hours: float = 1.5, seed: int = 3) -> tuple[Recording, Table]:
    """Work with the sensor turned from one sample to the next, without a pause."""
    made = simulate_shift("gt9x", hours, seed, RATE_HZ, perfect=True).in_arrays()
    acc, gyr = made.acc_g.astype(float), made.gyr_dps.astype(float)
    after = slice(round(at_s * RATE_HZ), None)
    acc[after], gyr[after] = acc[after] @ turn.T, gyr[after] @ turn.T
    return record(acc, gyr, RATE_HZ), made.elevation_deg


@pytest.mark.parametrize("degrees", [60.0, 90.0, 180.0])
@pytest.mark.parametrize("at_s", [540.0, 2700.0, 4860.0])
def test_a_slip_is_found_and_timed(degrees: float, at_s: float) -> None:
    recording, _ = slip(tilt(degrees), at_s)

    parts = calibrate(recording, "n-pose").axis_parts

    assert any(part.arm_axis is None and part.start_s <= at_s <= part.end_s for part in parts)


@pytest.mark.parametrize("degrees", [60.0, 90.0])
@pytest.mark.parametrize("at_s", [540.0, 2700.0, 4860.0])
def test_rows_called_valid_are_right_all_the_same(degrees: float, at_s: float) -> None:
    recording, truth_deg = slip(tilt(degrees), at_s)

    segment = estimate_elevation(calibrate(recording, "n-pose")).segments[0]

    error_deg = (segment.elevation_deg - truth_deg)[segment.valid]
    assert np.sqrt(np.mean(error_deg**2)) < 5.0


def turn_across(degrees: float, about_deg: float, seed: int) -> Table:
    """A turn across the arm's axis on the day of this seed."""
    mounting = simulate_shift("gt9x", 2.0, seed, RATE_HZ, perfect=True).errors.mounting
    return tilt(degrees, mounting[:, :2] @ [np.cos(np.radians(about_deg)), np.sin(np.radians(about_deg))])


def test_beyond_a_slip_that_is_sure_nothing_is_valid_without_an_axis_of_its_own() -> None:
    # As a whole the 60 minutes after this slip of 20 deg look much like those before it.
    recording, _ = slip(turn_across(20.0, 120.0, 3), 3600.0, 2.0, 3)

    last = calibrate(recording, "n-pose").axis_parts[-1]

    assert (last.arm_axis, last.end_s) == (None, np.inf)


@pytest.mark.parametrize(("degrees", "minutes", "device"), [(45.0, 20.0, "gt9x"), (90.0, 60.0, "lsm9ds1")])
def test_pushed_back_later_both_edges_are_found_and_nothing_between_is_valid(
    degrees: float, minutes: float, device: Device
) -> None:
    recording, _ = push_back(degrees, minutes, device)

    samples = calibrate(recording, "n-pose")

    valid = estimate_elevation(samples).segments[0].valid
    between = slice(round(TURNED_S * RATE_HZ), round((TURNED_S + 60.0 * minutes) * RATE_HZ))
    carried = [part for part in samples.axis_parts if part.arm_axis is not None and part.start_s < TURNED_S]
    assert carried == []
    assert valid[between].mean() < 0.01


def test_what_lies_behind_a_sensor_pushed_back_is_kept_where_walking_confirms_it() -> None:
    recording, truth_deg = push_back(60.0, 20.0, "gt9x")

    samples = calibrate(recording, "n-pose")

    last = samples.axis_parts[-1]
    segment = estimate_elevation(samples).segments[0]
    error_deg = (segment.elevation_deg - truth_deg)[segment.valid]
    assert last.arm_axis is samples.calibration.arm_axis
    assert last.sigma_deg == 5.0
    assert np.sqrt(np.mean(error_deg**2)) < 1.0


TURNED_S = 3000.0


def push_back(degrees: float, minutes: float, device: Device) -> tuple[Recording, Table]:
    """Three hours of work; the sensor turns after 50 minutes and is pushed back some minutes later."""
    made = simulate_shift(device, 3.0, 7, RATE_HZ, perfect=True)
    arrays, turn = made.in_arrays(), tilt(degrees, made.errors.mounting[:, 0])
    acc, gyr = arrays.acc_g.astype(float), arrays.gyr_dps.astype(float)
    between = slice(round(TURNED_S * RATE_HZ), round((TURNED_S + 60.0 * minutes) * RATE_HZ))
    acc[between], gyr[between] = acc[between] @ turn.T, gyr[between] @ turn.T
    return record(acc, gyr, RATE_HZ), arrays.elevation_deg


@pytest.mark.parametrize("about_deg", [120.0, 300.0])
def test_a_slip_of_20_deg_is_found_where_walking_shows_it(about_deg: float) -> None:
    recording, _ = slip(turn_across(20.0, about_deg, 2), 720.0, 2.0, 2)

    parts = calibrate(recording, "n-pose").axis_parts

    assert any(part.arm_axis is None and part.start_s <= 720.0 <= part.end_s for part in parts)


def test_after_a_turn_about_the_arm_itself_rows_called_valid_are_right() -> None:
    # Walking lies some 15 deg off the arm's axis, so that such a turn may look like a slip.
    made = simulate_shift("gt9x", 1.5, 3, RATE_HZ, perfect=True)
    recording, truth_deg = slip(tilt(90.0, made.errors.mounting[:, 2]), 2700.0)

    segment = estimate_elevation(calibrate(recording, "n-pose")).segments[0]

    assert np.abs(segment.elevation_deg - truth_deg)[segment.valid].max() < 10.0


def test_it_stands_in_the_report_with_what_was_done() -> None:
    recording, _ = slip(tilt(90.0), 2700.0)

    quality = analyse(recording, AnalysisSettings()).quality

    (flag,) = [flag for flag in quality.flags if flag.code == "W-REMOUNT"]
    assert flag.facts["left_out"] == 2  # the slip, and what lies beyond it
    assert flag.first_s is not None
    assert flag.first_s < 2700.0


@pytest.mark.parametrize("seed", range(1, 5))
def test_two_hours_without_a_slip_raise_no_alarm(seed: int) -> None:
    made = simulate_shift("gt9x", 2.0, seed, RATE_HZ).in_arrays()

    samples = calibrate(record(made.acc_g.astype(float), made.gyr_dps.astype(float), RATE_HZ), "n-pose")

    assert samples.axis_parts == ()
