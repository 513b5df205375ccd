"""The two sensors as parts: ranges, resolution, noise and how far their makers let them be off."""

from dataclasses import dataclass
from typing import Literal

Device = Literal["gt9x", "lsm9ds1"]


@dataclass(frozen=True, slots=True)
class Part:
    """One kind of inertial sensor as it is sold and set.

    Attributes
    ----------
    nominal_rate_hz, rate_error
        The rate it is set to, and the range (low, high) of the relative error of its own clock.
    acc_g_per_lsb, gyr_dps_per_lsb, acc_range_g, gyr_range_dps
        Resolution and full scale as set.
    acc_noise_g_per_sqrt_hz, gyr_noise_dps_per_sqrt_hz, bandwidth_hz
        White noise up to the smaller of half the rate and the part's own filter.
    acc_offset_g, gyr_offset_dps, acc_scale, gyr_scale, misalignment
        Standard deviations between parts of what a calibration would remove (scale and misalignment as
        fractions); all but misalignment lie within 1.73 times as much.
    acc_drift_g_per_k, gyr_drift_dps_per_k
        Standard deviations between parts of the offset's dependence on temperature.
    gyr_walk_dps_per_sqrt_h
        Random walk of the gyroscope's offset that no temperature explains.
    """

    nominal_rate_hz: float
    rate_error: tuple[float, float]
    acc_g_per_lsb: float
    gyr_dps_per_lsb: float
    acc_range_g: float
    gyr_range_dps: float
    acc_noise_g_per_sqrt_hz: float
    gyr_noise_dps_per_sqrt_hz: float
    bandwidth_hz: float
    acc_offset_g: float
    gyr_offset_dps: float
    acc_scale: float
    gyr_scale: float
    misalignment: float
    acc_drift_g_per_k: float
    gyr_drift_dps_per_k: float
    gyr_walk_dps_per_sqrt_h: float


GT9X = Part(
    nominal_rate_hz=100.0,
    rate_error=(0.0002, 0.0012),
    acc_g_per_lsb=1 / 2048,
    gyr_dps_per_lsb=1 / 16.384,
    acc_range_g=16.0,
    gyr_range_dps=2000.0,
    acc_noise_g_per_sqrt_hz=0.00025,
    gyr_noise_dps_per_sqrt_hz=0.006,
    bandwidth_hz=50.0,
    acc_offset_g=0.015,
    gyr_offset_dps=0.8,
    acc_scale=0.006,
    gyr_scale=0.004,
    misalignment=0.002,
    acc_drift_g_per_k=0.00015,
    gyr_drift_dps_per_k=0.015,
    gyr_walk_dps_per_sqrt_h=0.03,
)
"""ActiGraph GT9X Link: ranges and resolution from its files; rate, offset and noise about those of the first
23 s (lying still) of a real one: 100.09 Hz, (-0.77, 0.26, 0.11) dps, 1.2 to 2.2 mg, 0.035 to 0.05 dps.
Scale, drift and walk: of the order that data sheets of such parts state; not measured."""

LSM9DS1 = Part(
    nominal_rate_hz=500.0,
    rate_error=(-0.024, 0.004),
    acc_g_per_lsb=0.000244,
    gyr_dps_per_lsb=0.070,
    acc_range_g=8.0,
    gyr_range_dps=2000.0,
    acc_noise_g_per_sqrt_hz=0.00025,
    gyr_noise_dps_per_sqrt_hz=0.0125,
    bandwidth_hz=200.0,
    acc_offset_g=0.028,
    gyr_offset_dps=10.0,
    acc_scale=0.010,
    gyr_scale=0.010,
    misalignment=0.003,
    acc_drift_g_per_k=0.0004,
    gyr_drift_dps_per_k=0.04,
    gyr_walk_dps_per_sqrt_h=0.08,
)
"""ST LSM9DS1 at 8 g and 2000 dps: resolution from ST's driver; noise densities from a real part lying still
at 14.54 Hz (0.034 dps, 0.65 mg); rate error between that part's -2.4 % and +0.4 %. Offsets, scale and drift:
within what is quoted for the part (90 mg, 30 dps); not measured."""

PARTS: dict[Device, Part] = {"gt9x": GT9X, "lsm9ds1": LSM9DS1}
