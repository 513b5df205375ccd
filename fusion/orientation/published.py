"""`published`: the algorithm of Boyer, Frasie, Bouyer, Roy, Poitras and Campeau-Lecours.

Orientation A comes from the ratios of the accelerations (Freescale AN3461). Orientation G rotates the last
orientation by the resultant angular velocity. Both are split into a rotation about an axis in the world's XY
plane and a rotation about world Z. The XY parts are joined by slerp and multiplied by the gyroscope's Z part.
Elevation is the tilt of Bonev's tilt-and-torsion angles.
``tests/fusion/orientation/published_step_by_step.py`` follows every step, sample by sample. The kernel here
only tracks the direction of the vertical, because nothing else affects the tilt.
"""

from dataclasses import dataclass
from math import exp, pi
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.numba_kernels import inner, kernel
from acromion.fusion.recording import Float64Array, FloatArray
from acromion.fusion.sensor.model import RADIANS, SensorRun, carry, turn_factors


@dataclass(frozen=True, slots=True)
class PublishedParameters:
    """Parameters that the paper states, and choices that it leaves open.

    Compared to the publication
    ---------------------------
    lowpass_acc_hz, lowpass_gyr_hz
        50 Hz, order 1, as stated. At 100 Hz this is the Nyquist frequency, for which a Butterworth design
        fails; both are one-pole RC filters (backward Euler) at every rate.
    highpass_gyr_hz
        0.002 Hz, order 1, as stated; a one-pole RC filter. It removes true slow rotation; 0 disables it.
    time_constant_s
        The paper does not state the slerp weight. The share of A in each step is ``1 - exp(-period /
        time_constant_s)``, so that the sampling rate has no effect. In the sweep that
        ``benchmarks/fusion.py`` prints, the best is 0.5 s on BROAD and 1.5 s on simulated shifts; 1 s (a
        weight of 0.01 at 100 Hz) is in between.
    The XY part
        is one rotation about an axis in the XY plane (the tilt of tilt-and-torsion), not roll and pitch. A
        slerp between two such rotations is such a rotation again, so the Z part comes from the gyroscope
        only, as in the paper.
    The static bias
        is the mean rate of the calibration window, computed once, as stated. Later changes of the bias are
        not tracked.
    The start
        of each run is orientation A; the filters start at their first sample.
    """

    lowpass_acc_hz: float = 50.0
    lowpass_gyr_hz: float = 50.0
    highpass_gyr_hz: float = 0.002
    time_constant_s: float = 1.0

    def accelerometer_weight(self, rate_hz: float) -> float:
        """Return the share of orientation A in each slerp."""
        return 1.0 - exp(-1.0 / (rate_hz * self.time_constant_s))


def lowpass_gain(cutoff_hz: float, rate_hz: float) -> float:
    """Return the share of the new sample in a one-pole RC low-pass."""
    return 1.0 / (1.0 + rate_hz / (2.0 * pi * cutoff_hz))


def highpass_gain(cutoff_hz: float, rate_hz: float) -> float:
    """Return the share of the past in a one-pole RC high-pass; 1 (no high-pass) for 0 Hz."""
    return 1.0 / (1.0 + 2.0 * pi * cutoff_hz / rate_hz)


@inner
def _unit(x: float, y: float, z: float) -> tuple[float, float, float]:  # pragma: no cover
    length = np.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        return 0.0, 0.0, 1.0
    return x / length, y / length, z / length


@inner
def _tilt_quaternion(up: Any) -> tuple[float, float, float]:  # pragma: no cover
    """Return (w, x, y) of the shortest rotation from ``up`` to z; its z component is zero."""
    across = np.sqrt(up[0] * up[0] + up[1] * up[1])
    if across < 1e-12:
        return (1.0, 0.0, 0.0) if up[2] > 0.0 else (0.0, 1.0, 0.0)
    half = 0.5 * np.arctan2(across, up[2])
    sine = np.sin(half) / across
    return np.cos(half), sine * up[1], -sine * up[0]


@inner
def _slerp(start: Any, end: Any, weight: float) -> tuple[float, float, float]:  # pragma: no cover
    dot = start[0] * end[0] + start[1] * end[1] + start[2] * end[2]
    sign = -1.0 if dot < 0.0 else 1.0
    x, y, z = sign * end[0] - start[0], sign * end[1] - start[1], sign * end[2] - start[2]
    angle = 2.0 * np.arcsin(min(1.0, 0.5 * np.sqrt(x * x + y * y + z * z)))
    first, second = 1.0 - weight, weight
    if angle > 1e-6:
        first, second = np.sin(first * angle) / np.sin(angle), np.sin(second * angle) / np.sin(angle)
    second *= sign
    return _unit(
        first * start[0] + second * end[0],
        first * start[1] + second * end[1],
        first * start[2] + second * end[2],
    )


@inner
def _vertical_of(tilt: Any) -> tuple[float, float, float]:  # pragma: no cover
    """Return the direction that the tilt quaternion (w, x, y) rotates to z."""
    w, x, y = tilt
    return -2.0 * w * y, 2.0 * w * x, w * w - x * x - y * y


@kernel
def _run_published(
    acc: Any, gyr: Any, bias: Any, steps: Any, room: Any, out: Any
) -> None:  # pragma: no cover
    """Run one pass: filters, A, G, slerp of the two tilts, vertical.

    ``steps``: period, gains of acc, gyr and high-pass, weight of A; ``room``: (3,) for each filter.
    """
    period_s, gain_acc, gain_gyr, keep, weight = steps
    smooth_acc, smooth_gyr, rate = room
    up = (0.0, 0.0, 1.0)
    for k in range(len(acc)):
        for i in range(3):
            present_acc, present_gyr = float(acc[k, i]), (gyr[k, i] - bias[i]) * RADIANS
            if k == 0:
                smooth_acc[i], smooth_gyr[i], rate[i] = present_acc, present_gyr, present_gyr
            else:
                smooth_acc[i] += gain_acc * (present_acc - smooth_acc[i])
                last = smooth_gyr[i]
                smooth_gyr[i] += gain_gyr * (present_gyr - last)
                rate[i] = keep * (rate[i] + smooth_gyr[i] - last)
        from_acc = _unit(smooth_acc[0], smooth_acc[1], smooth_acc[2])
        if k == 0:
            up = from_acc
        else:
            turn = (rate[0] * period_s, rate[1] * period_s, rate[2] * period_s)
            from_gyr = carry(up, turn, turn_factors(turn))
            up = _vertical_of(_slerp(_tilt_quaternion(from_gyr), _tilt_quaternion(from_acc), weight))
        out[k, 0], out[k, 1], out[k, 2] = up


def estimate_published(
    run: SensorRun,
    bias_dps: Float64Array,
    parameters: PublishedParameters | None = None,
    dtype: type[np.float32] | type[np.float64] = np.float64,
) -> FloatArray:
    """Return the unit vector to the zenith at each sample, (n, 3).

    ``bias_dps``: mean rate of the calibration.
    """
    parameters = parameters or PublishedParameters()
    steps = (
        1.0 / run.rate_hz,
        lowpass_gain(parameters.lowpass_acc_hz, run.rate_hz),
        lowpass_gain(parameters.lowpass_gyr_hz, run.rate_hz),
        highpass_gain(parameters.highpass_gyr_hz, run.rate_hz),
        parameters.accelerometer_weight(run.rate_hz),
    )
    out: NDArray[Any] = np.zeros((len(run), 3), dtype=dtype)
    room = (np.empty(3), np.empty(3), np.empty(3))
    _run_published(run.acc_g, run.gyr_dps, np.asarray(bias_dps, dtype=np.float64), steps, room, out)
    return out
