"""All compared estimators, ours and the peers from PyPI, with one signature.

Each takes acceleration (n, 3) in g and angular rate (n, 3) in deg/s with the rate in Hz, and returns the unit
vector to the zenith in the sensor frame, (n, 3). None uses a magnetometer.
"""

from collections.abc import Mapping

import ahrs
import imufusion
import numpy as np
import vqf

from acromion.fusion.orientation import MethodName, estimate_vertical
from acromion.fusion.sensor.model import SensorRun
from tests.estimates import estimate_gyro_bias, smooth_vertical
from tests.validation.broad import Estimator, Table

GRAVITY = 9.80665
RAISED_CLIP_DPS = 60.0
BIAS_ONLY = "smoothed, bias only"


def run_ours(method: MethodName) -> Estimator:
    def estimate(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
        return estimate_vertical(acc_g, gyr_dps, rate_hz, method)

    return estimate


def run_bias_only(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    """Run `smoothed` without its self-calibration: only the gyroscope's bias is subtracted."""
    run = SensorRun(0.0, rate_hz, acc_g, gyr_dps)
    return np.asarray(smooth_vertical(run, estimate_gyro_bias([run])).up, dtype=np.float64)


def to_vqf(acc_g: Table, gyr_dps: Table) -> tuple[Table, Table]:
    """Return angular rate in rad/s, then acceleration in m/s2, as VQF and ahrs expect them."""
    return np.ascontiguousarray(np.radians(gyr_dps)), np.ascontiguousarray(acc_g * GRAVITY)


def vertical_of(quaternion: Table) -> Table:
    """Return the room's z axis in the sensor frame; quaternions (n, 4), scalar first, sensor to room."""
    w, x, y, z = quaternion.T
    return np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)


def run_vqf(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    gyr, acc = to_vqf(acc_g, gyr_dps)
    return vertical_of(vqf.VQF(1.0 / rate_hz).updateBatch(gyr, acc)["quat6D"])


def run_offline_vqf(bias_clip_dps: float | None = None) -> Estimator:
    """Run with the default clip (2 deg/s) or another; the clip also limits its rest detection."""
    parameters = {} if bias_clip_dps is None else {"biasClip": bias_clip_dps}

    def estimate(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
        gyr, acc = to_vqf(acc_g, gyr_dps)
        return vertical_of(vqf.offlineVQF(gyr, acc, None, 1.0 / rate_hz, parameters)["quat6D"])

    return estimate


def run_madgwick(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    gyr, acc = to_vqf(acc_g, gyr_dps)
    return vertical_of(ahrs.filters.Madgwick(gyr=gyr, acc=acc, frequency=rate_hz).Q)


def run_mahony(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    gyr, acc = to_vqf(acc_g, gyr_dps)
    return vertical_of(ahrs.filters.Mahony(gyr=gyr, acc=acc, frequency=rate_hz).Q)


def run_imufusion(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    """Run with its bias estimator; acceleration off by more than 10 deg is rejected for up to 5 s."""
    settings, bias_settings = imufusion.AhrsSettings(), imufusion.BiasSettings()
    settings.sample_rate = bias_settings.sample_rate = rate_hz
    settings.gyroscope_range, settings.acceleration_rejection, settings.rejection_timeout = 2000.0, 10.0, 5.0
    fused, bias = imufusion.Ahrs(), imufusion.Bias()
    fused.set_settings(settings)
    bias.set_settings(bias_settings)
    up = np.empty_like(acc_g)
    for row in range(len(acc_g)):
        fused.update_no_magnetometer(bias.update(gyr_dps[row]), acc_g[row])
        up[row] = fused.get_gravity()
    return up


QUICK: Mapping[str, Estimator] = {
    "smoothed": run_ours("smoothed"),
    "live": run_ours("live"),
    "published": run_ours("published"),
    "offlineVQF": run_offline_vqf(),
    f"offlineVQF, clip {RAISED_CLIP_DPS:.0f}": run_offline_vqf(RAISED_CLIP_DPS),
    "VQF": run_vqf,
    "imufusion": run_imufusion,
}
ON_BROAD_ONLY: Mapping[str, Estimator] = {
    BIAS_ONLY: run_bias_only,
    "Madgwick": run_madgwick,
    "Mahony": run_mahony,
}
