"""The estimators: from arrays to the unit vector to the zenith, independent of recordings and arms."""

from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from acromion.fusion.conventions import MethodName
from acromion.fusion.errors import UnusableArrays
from acromion.fusion.orientation.live import LiveVertical
from acromion.fusion.orientation.published import estimate_published
from acromion.fusion.orientation.smoothed import smooth_nodes
from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.model import SensorRun, check_arrays, check_gravity, propagate_vertical
from acromion.fusion.sensor.self_calibration import calibrate_sensor
from acromion.fusion.sensor.stillness import find_quietest_rate, find_still_moments, reduce_run

__all__ = ["MethodName", "estimate_vertical"]


def estimate_vertical(
    acc_g: ArrayLike, gyr_dps: ArrayLike, rate_hz: float, method: MethodName = "smoothed"
) -> Float64Array:
    """Return the direction of the vertical in the sensor frame, for any sensor on any object.

    Parameters
    ----------
    acc_g, gyr_dps
        Shape (n, 3), finite, evenly sampled, one right-handed frame; at rest the acceleration points to the
        zenith with length 1. Any dtype and memory layout; not modified.
    rate_hz
        Samples per second.
    method
        `smoothed` estimates the gyroscope's bias and the accelerometer's offset and scale itself;
        `published` uses the mean rate of the quietest 2 s.

    Returns
    -------
    numpy.ndarray
        Shape (n, 3), float64: unit vector to the zenith at the time of each sample.

    Raises
    ------
    acromion.fusion.errors.UnusableArrays
        A ValueError: wrong shapes, no sample, values that are not finite, a rate that is not positive, an
        acceleration whose median length is under 1/3 or over 3 (m/s2, mg, counts; all zeros), an unknown
        method.
    """
    if method not in get_args(MethodName):
        raise UnusableArrays(why="method", value=str(method), allowed=", ".join(get_args(MethodName)))
    acc, gyr = check_arrays(acc_g, gyr_dps, rate_hz)
    check_gravity(acc)
    if method == "live":
        return LiveVertical(float(rate_hz)).update(acc, gyr)
    run = SensorRun(0.0, float(rate_hz), acc, gyr)
    if method == "published":
        return np.asarray(estimate_published(run, find_quietest_rate(run)), dtype=np.float64)
    blocks = [reduce_run(run)]
    _, (calibrated,) = calibrate_sensor([run], blocks, find_still_moments(blocks))
    nodes, gyr_dps = calibrated.nodes, calibrated.run.gyr_dps
    up = np.empty((len(run), 3))
    propagate_vertical(gyr_dps, run.rate_hz, nodes, smooth_nodes(nodes).up, up, 0)
    return up
