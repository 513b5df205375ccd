"""How uncertain the angle is said to be, and whether that is true."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from fusion.conventions import MethodName
from fusion.elevation import estimate_elevation
from fusion.orientation.smoothed import SmoothedNodes, UncertaintySettings, average_around, estimate_sigma
from fusion.pose.calibrate import calibrate
from fusion.sensor.accelerometer import AccelerometerCorrection, leave_accelerometer
from fusion.simulation import simulate_shift
from fusion.simulation.sensor import Device
from tests.factories import hold, record
from tests.simulated_shifts import play_shift


def smoothed(*disagreement_deg: float) -> SmoothedNodes:
    return SmoothedNodes(np.zeros((1, 3)), np.array(disagreement_deg), 20)


def test_the_parts_are_added_as_variances() -> None:
    # Offset left 5 mg = 0.2865 deg, times 0.5: 0.1432. Disagreement 2 deg: 4 / 2 x 0.15 = 0.3 deg^2.
    correction = AccelerometerCorrection(np.zeros(1), np.zeros((1, 3)), np.eye(3), 20, 0.005)

    sigma_deg = estimate_sigma(smoothed(*[2.0] * 20), correction)

    assert sigma_deg == pytest.approx(np.full(20, np.sqrt(0.10**2 + 0.1432**2 + 0.3)), abs=1e-4)


def test_an_accelerometer_that_could_not_be_calibrated_counts_as_delivered() -> None:
    sigma_deg = estimate_sigma(smoothed(0.0), leave_accelerometer(), UncertaintySettings(floor_deg=0.0))

    # 0.04 g = 2.292 deg, times 0.5.
    assert sigma_deg == pytest.approx([1.146], abs=1e-3)


@pytest.mark.parametrize("count", [1, 4, 3600])
def test_nine_seconds_are_averaged_as_scipy_does_to_the_bit(count: int) -> None:
    values = np.random.default_rng(count).exponential(5.0, count)

    assert np.array_equal(average_around(values, 9), uniform_filter1d(values, 9, mode="nearest"))


def test_there_is_one_value_for_each_second_and_the_recordings_own_is_their_root_mean_square() -> None:
    elevation = estimate_elevation(calibrate(hold((0.0, 5.0), (80.0, 5.4)).recording))

    sigma_deg = elevation.segments[0].sigma_deg
    assert sigma_deg is not None
    assert sigma_deg.shape == (11,)
    assert sigma_deg.dtype == np.float32
    assert elevation.bias_sigma_deg == pytest.approx(np.sqrt(np.mean(sigma_deg.astype(float) ** 2)))


@pytest.mark.parametrize(("method", "typical_deg"), [("published", 4.2), ("live", 1.3)])
def test_methods_without_a_measure_of_their_own_tell_their_typical_error(
    method: MethodName, typical_deg: float
) -> None:
    elevation = estimate_elevation(calibrate(hold((0.0, 10.0)).recording), method)

    assert elevation.segments[0].sigma_deg is None
    assert elevation.bias_sigma_deg == typical_deg


@pytest.mark.slow
@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
def test_on_simulated_days_the_band_of_95_percent_covers_the_truth_about_as_often(device: Device) -> None:
    # Four days of two hours; the pose is left out, for the arm axis is the true one within the sensor's
    # error. `python -m benchmarks.fusion band` prints each day.
    inside = [cover(device, seed) for seed in (1, 3, 5, 7)]

    assert 0.93 <= np.mean(inside) <= 0.97


def cover(device: Device, seed: int) -> float:
    made = play_shift(simulate_shift(device, 2.0, seed, 50.0))
    recording = record(made.acc_g.astype(float), made.gyr_dps.astype(float), made.rate_hz)
    segment = estimate_elevation(calibrate(recording)).segments[0]
    assert segment.sigma_deg is not None
    sigma_deg = segment.sigma_deg[(np.arange(len(segment)) / made.rate_hz).astype(int)]
    return float((np.abs(segment.elevation_deg - made.elevation_deg) < 1.96 * sigma_deg).mean())
