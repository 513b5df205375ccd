"""An imperfect sensor on the arm: mounting, offset, scale, wander, noise, range and resolution.

Not simulated: the sensor's own low-pass filter and its delay, sensitivity of the gyroscope to acceleration,
and soft tissue: the sensor is mounted on a rigid arm.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.recording import Float64Array
from acromion.fusion.simulation.body import ArmState

# The two sensor models: ranges, resolution, noise and the makers' tolerances.


Device = Literal["gt9x", "lsm9ds1"]


@dataclass(frozen=True, slots=True)
class Part:
    """One model of inertial sensor, as sold and configured.

    ``nominal_rate_hz``, ``rate_error``: the configured rate, and the range (low, high) of the relative error
    of the sensor's clock.
    ``acc_g_per_lsb``, ``gyr_dps_per_lsb``, ``acc_range_g``, ``gyr_range_dps``: resolution and full scale as
    configured.
    ``acc_noise_g_per_sqrt_hz``, ``gyr_noise_dps_per_sqrt_hz``, ``bandwidth_hz``: white noise up to the
    smaller of half the rate and the sensor's own filter.
    ``acc_offset_g``, ``gyr_offset_dps``, ``acc_scale``, ``gyr_scale``, ``misalignment``: standard deviations
    between specimens of errors that a calibration would remove (scale and misalignment as fractions); all but
    misalignment are within 1.73 times these.
    ``acc_drift_g_per_k``, ``gyr_drift_dps_per_k``: standard deviations between specimens of the offset's
    dependence on temperature.
    ``gyr_walk_dps_per_sqrt_h``: random walk of the gyroscope's offset that is independent of temperature.
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
"""ActiGraph GT9X Link: ranges and resolution from its files; rate, offset and noise similar to those of the
first 23 s (at rest) of a real one: 100.09 Hz, (-0.77, 0.26, 0.11) dps, 1.2 to 2.2 mg, 0.035 to 0.05 dps.
Scale, drift and walk: the order of magnitude in data sheets of such sensors; not measured.
"""

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
"""ST LSM9DS1 at 8 g and 2000 dps: resolution from ST's driver; noise densities from a real one at rest at
14.54 Hz (0.034 dps, 0.65 mg); rate error between its -2.4 % and +0.4 %. Offsets, scale and drift: within the
quoted limits (90 mg, 30 dps); not measured.
"""

PARTS: dict[Device, Part] = {"gt9x": GT9X, "lsm9ds1": LSM9DS1}


RawArray = NDArray[np.int16]

KNOT_S = 60.0
"""Distance between the knots of slowly changing values (temperature, offsets)."""

CALIBRATION_K = 25.0
"""Temperature (deg C) at which the stated offsets apply."""


@dataclass(frozen=True, slots=True, eq=False)
class SensorErrors:
    """One specimen of a sensor model, mounted on one morning.

    A reading is ``gain @ mounting @ ideal + offset + offset_wander(t) + noise``, clipped at the range and
    rounded to the resolution.

    ``mounting``: shape (3, 3): from the arm's frame to the sensor's.
    ``acc_gain``, ``gyr_gain``: shape (3, 3): scale on the diagonal, misalignment off it.
    ``acc_offset_g``, ``gyr_offset_dps``: shape (3,).
    ``acc_wander_g``, ``gyr_wander_dps``: shape (knots, 3): change of the offsets, every ``KNOT_S`` seconds,
    linear in between.
    ``temperature_c``: shape (knots,): of the sensor.
    ``acc_noise_g``, ``gyr_noise_dps``: standard deviation of each sample.
    """

    mounting: Float64Array
    acc_gain: Float64Array
    gyr_gain: Float64Array
    acc_offset_g: Float64Array
    gyr_offset_dps: Float64Array
    acc_wander_g: Float64Array
    gyr_wander_dps: Float64Array
    temperature_c: Float64Array
    acc_noise_g: float
    gyr_noise_dps: float


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """The sensor's readings before they are digitised: shapes (n, 3), g and dps."""

    acc_g: Float64Array
    gyr_dps: Float64Array


def draw_errors(part: Part, rate_hz: float, duration_s: float, chance: np.random.Generator) -> SensorErrors:
    """Draw a specimen of ``part`` and its mounting."""
    knots = int(duration_s / KNOT_S) + 2
    bandwidth_hz = min(rate_hz / 2, part.bandwidth_hz)
    # it warms up on the skin within the first hour, then drifts with the work
    warming_k = 7.0 * (1.0 - np.exp(-(KNOT_S * np.arange(knots)) / 1200.0))
    drifting_k = np.cumsum(chance.normal(0.0, 0.12, knots))
    temperature_c = np.asarray(CALIBRATION_K + chance.normal(0.0, 1.0) + warming_k + drifting_k)
    warmer_k = (temperature_c - CALIBRATION_K)[:, None]
    walk_dps = part.gyr_walk_dps_per_sqrt_h * np.sqrt(KNOT_S / 3600)
    return SensorErrors(
        mounting=draw_mounting(chance),
        acc_gain=_draw_gain(part.acc_scale, part.misalignment, chance),
        gyr_gain=_draw_gain(part.gyr_scale, part.misalignment, chance),
        acc_offset_g=_draw_evenly(part.acc_offset_g, chance),
        gyr_offset_dps=_draw_evenly(part.gyr_offset_dps, chance),
        acc_wander_g=warmer_k * chance.normal(0.0, part.acc_drift_g_per_k, 3),
        gyr_wander_dps=warmer_k * chance.normal(0.0, part.gyr_drift_dps_per_k, 3)
        + np.cumsum(chance.normal(0.0, walk_dps, (knots, 3)), axis=0),
        temperature_c=temperature_c,
        acc_noise_g=part.acc_noise_g_per_sqrt_hz * float(np.sqrt(bandwidth_hz)),
        gyr_noise_dps=part.gyr_noise_dps_per_sqrt_hz * float(np.sqrt(bandwidth_hz)),
    )


def sense(
    state: ArmState, errors: SensorErrors, time_s: Float64Array, chance: np.random.Generator
) -> Readings:
    """Return the readings of this specimen of the arm's motion at the times ``time_s``, shape (n,)."""
    knots_s = KNOT_S * np.arange(len(errors.temperature_c))
    acc_g = state.acc_g @ (errors.acc_gain @ errors.mounting).T + errors.acc_offset_g
    gyr_dps = state.gyr_dps @ (errors.gyr_gain @ errors.mounting).T + errors.gyr_offset_dps
    for axis in range(3):
        acc_g[:, axis] += np.interp(time_s, knots_s, errors.acc_wander_g[:, axis])
        gyr_dps[:, axis] += np.interp(time_s, knots_s, errors.gyr_wander_dps[:, axis])
    acc_g += errors.acc_noise_g * chance.standard_normal(acc_g.shape, dtype=np.float32)
    gyr_dps += errors.gyr_noise_dps * chance.standard_normal(gyr_dps.shape, dtype=np.float32)
    return Readings(acc_g, gyr_dps)


def quantise(values: Float64Array, unit_per_lsb: float, full_scale: float) -> RawArray:
    """Round to the nearest step and clip at full scale, as 16-bit counts."""
    limit = min(32767, int(full_scale / unit_per_lsb))
    counts = np.rint(values / unit_per_lsb)
    return np.clip(counts, -limit, limit).astype(np.int16)


def draw_mounting(chance: np.random.Generator) -> Float64Array:
    """Draw a mounting: y axis roughly along the arm, any rotation about it, tilted by a few degrees."""
    along_y = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    tilt_deg = chance.normal(0.0, 3.0, 3)
    tilt_deg[1] = chance.uniform(-180.0, 180.0)
    tilted = _rotation_about(tilt_deg[0], 0) @ _rotation_about(tilt_deg[2], 2)
    mounting: Float64Array = tilted @ _rotation_about(tilt_deg[1], 1) @ along_y
    return mounting


def _rotation_about(angle_deg: float, axis: int) -> Float64Array:
    """Return the rotation matrix about a coordinate axis."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[a, a] = matrix[b, b] = c
    matrix[b, a], matrix[a, b] = s, -s
    return matrix


def _draw_evenly(deviation: float, chance: np.random.Generator) -> Float64Array:
    """Draw three values of a given standard deviation within hard limits (makers reject the worst)."""
    limit = deviation * float(np.sqrt(3.0))
    return chance.uniform(-limit, limit, 3)


def _draw_gain(scale: float, misalignment: float, chance: np.random.Generator) -> Float64Array:
    """Draw scale errors on the diagonal and misalignment off it."""
    gain = chance.normal(0.0, misalignment, (3, 3))
    np.fill_diagonal(gain, 1.0 + _draw_evenly(scale, chance))
    return gain
