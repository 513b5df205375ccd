"""The estimators: arrays in, unit vector to the zenith out; no recording and no arm here."""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion.orientation.arrays import check_arrays
from fusion.orientation.published import estimate_published
from fusion.orientation.smoothed import smooth_vertical
from fusion.sensor_errors.accelerometer import calibrate_accelerometer
from fusion.sensor_errors.gyro_bias import estimate_gyro_bias
from fusion.sensor_errors.runs import SensorRun
from fusion.sensor_errors.stillness import find_quietest_rate, find_still_moments, reduce_run

MethodName = Literal["smoothed", "published"]

__all__ = ["MethodName", "estimate_vertical"]


def estimate_vertical(
    acc_g: ArrayLike, gyr_dps: ArrayLike, rate_hz: float, method: MethodName = "smoothed"
) -> NDArray[np.float64]:
    """Direction of the vertical in the sensor frame, from any sensor on anything.

    Parameters
    ----------
    acc_g, gyr_dps
        Shape (n, 3), finite, evenly sampled, one right-handed frame; at rest the acceleration points to the
        zenith with length 1. Any dtype and memory layout; not modified.
    rate_hz
        Samples per second.
    method
        `smoothed` finds the gyroscope's bias and the accelerometer's offset and scale itself; `published` takes the mean rate of the quietest 2 s.

    Returns
    -------
    Shape (n, 3), float64: unit vector to the zenith at the time of each sample.

    Raises
    ------
    fusion.orientation.arrays.UnusableArrays
        A ValueError: wrong shapes, no sample, values that are not finite, a rate that is not positive.
    """
    acc, gyr = check_arrays(acc_g, gyr_dps, rate_hz)
    run = SensorRun(0.0, float(rate_hz), acc, gyr)
    if method == "published":
        return np.asarray(estimate_published(run, find_quietest_rate(run)), dtype=np.float64)
    blocks = [reduce_run(run)]
    stills = find_still_moments(blocks)
    bias = estimate_gyro_bias([run], stills)
    return np.asarray(smooth_vertical(run, bias, calibrate_accelerometer(stills)).up, dtype=np.float64)
