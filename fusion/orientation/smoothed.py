"""`smoothed`: uses past and future samples, for a complete recording.

In a frame that turns with the gyroscope the vertical is constant, and a person's own acceleration averages
out over a few seconds. The acceleration is low-passed in that frame in both directions, then transformed back
to the sensor. Only the vertical is needed, so the frame itself is never computed: the filter's state is a
vector that is rotated to the sensor's next position (:mod:`acromion.fusion.sensor.model`).

The weights of the two-sided mean are ``exp(-s)(cos s + sin s)`` with ``s = |t| / time_constant_s``. This is
the zero-phase second-order Butterworth low-pass ``1 / (1 + (w T)^4 / 4)``, with half power at ``sqrt(2) / (2
pi T)``, 0.075 Hz for 3 s. It corrects the slow error of the gyroscope's integral and suppresses the arm's
acceleration.

Such a slow filter does not need every sample. It runs at nodes (:mod:`acromion.fusion.sensor.model`), and the
gyroscope alone propagates the vertical from each node to the samples around it.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from acromion.fusion.numba_kernels import fused, kernel
from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.model import NODE_RATE_HZ, AccelerometerCorrection, Nodes, carry, turn_factors


@dataclass(frozen=True, slots=True)
class SmoothedParameters:
    """Time constant of the filter, its node rate, and the assumed delay of the gyroscope.

    ``time_constant_s`` was chosen on the even-numbered half of BROAD (2.6 to 3.2 s agree within 0.002 deg).
    ``gyro_lag_s``: a gyroscope's internal filter may be slower than the accelerometer's (1 ms in an MPU-9250,
    register map RM-MPU-9250A-00). It is 0 here, because it differs between parts and cannot be estimated from
    a recording: hand motion looks like a lag.
    """

    time_constant_s: float = 3.0
    node_rate_hz: float = NODE_RATE_HZ
    gyro_lag_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedNodes:
    """The vertical at the nodes, and the disagreement of past and future.

    ``up``: shape (j, 3): unit vector to the zenith, sensor frame.
    ``disagreement_deg``: one value for each ``nodes_per_value`` nodes (about a second): the root mean square
    of the angle between the estimates from the past alone and from the future alone, times the share of the
    lighter estimate in the result (one half, except near the ends).
    """

    up: Float64Array
    disagreement_deg: Float64Array
    nodes_per_value: int


def smooth_nodes(nodes: Nodes) -> SmoothedNodes:
    """Filter in both directions."""
    decay = np.exp(-(1.0 + 1.0j) * nodes.period_s / SmoothedParameters().time_constant_s)
    per_second = max(1, round(1.0 / nodes.period_s))
    up = np.zeros((len(nodes.acc_g), 3))
    disagreement = np.zeros(-(-len(up) // per_second))
    for direction in (1, -1):
        _sweep(nodes.acc_g, nodes.turn_rad, decay, direction, up, disagreement, per_second)
    return SmoothedNodes(up, np.degrees(np.sqrt(disagreement / per_second)), per_second)


@fused
def _disagree(past: Any, future: Any) -> Any:  # pragma: no cover
    """Return the squared sine of the angle (1 beyond a right angle) times the smaller share."""
    first = past[0] * past[0] + past[1] * past[1] + past[2] * past[2]
    second = future[0] * future[0] + future[1] * future[1] + future[2] * future[2]
    both = past[0] * future[0] + past[1] * future[1] + past[2] * future[2]
    if first * second == 0.0:
        return 0.0
    square = 1.0 if both < 0.0 else 1.0 - both * both / (first * second)
    smaller = first if first < second else second
    return (square if square > 0.0 else 0.0) * smaller / (first + second + 2.0 * sqrt(first * second))


@fused
def _fade(real: Any, imaginary: Any, decay: complex, acc: Any) -> Any:  # pragma: no cover
    """Advance one step: the complex state decays and rotates in its own plane; add the new sample."""
    keep, mix = decay.real, decay.imag
    return (
        (
            keep * real[0] - mix * imaginary[0] + acc[0],
            keep * real[1] - mix * imaginary[1] + acc[1],
            keep * real[2] - mix * imaginary[2] + acc[2],
        ),
        (
            keep * imaginary[0] + mix * real[0],
            keep * imaginary[1] + mix * real[1],
            keep * imaginary[2] + mix * real[2],
        ),
    )


@kernel
def _sweep(
    acc: Any, turns: Any, decay: complex, direction: int, out: Any, disagreement: Any, per_value: int
) -> None:  # pragma: no cover
    """Filter in one direction and add to ``out``.

    The backward sweep adds to the forward result in ``out``. It records the disagreement of both, counts the
    present node once, not twice, and scales to unit length.
    """
    nodes, backwards = len(acc), direction < 0
    real, imaginary = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    turn = real
    for step in range(nodes):
        k = nodes - 1 - step if backwards else step
        if step > 0:
            if not backwards:
                turn = (turns[k, 0], turns[k, 1], turns[k, 2])
            factors = turn_factors(turn)
            real, imaginary = carry(real, turn, factors), carry(imaginary, turn, factors)
        felt = (float(acc[k, 0]), float(acc[k, 1]), float(acc[k, 2]))
        real, imaginary = _fade(real, imaginary, decay, felt)
        mean = (real[0] - imaginary[0], real[1] - imaginary[1], real[2] - imaginary[2])
        if backwards:
            turn = (-turns[k, 0], -turns[k, 1], -turns[k, 2])
            past = (out[k, 0], out[k, 1], out[k, 2])
            disagreement[k // per_value] += _disagree(past, mean)
            mean = _scale_to_unit(past, mean, felt)
        out[k, 0], out[k, 1], out[k, 2] = mean


@fused
def _scale_to_unit(past: Any, future: Any, present: Any) -> Any:  # pragma: no cover
    x = past[0] + future[0] - present[0]
    y = past[1] + future[1] - present[1]
    z = past[2] + future[2] - present[2]
    length = sqrt(x * x + y * y + z * z)
    if length > 0.0:
        return x / length, y / length, z / length
    return 0.0, 0.0, 1.0


# Uncertainty of the smoothed angle for each second, without the error of the calibration pose.
#
# Three variances are added. First, errors that a recording cannot show, such as the gyroscope's misalignment.
# Second, the part of the accelerometer's offset that the directions at rest leave undetermined
# (:mod:`acromion.fusion.sensor.self_calibration`); it is large if the arm only hung. Third, the effect of the
# day's movements: half the angle between the estimate from the past alone and that from the future alone,
# averaged over nine seconds. Faster movements make this angle larger, so speed is not a separate term (a fit
# gave it zero weight).


@dataclass(frozen=True, slots=True)
class UncertaintySettings:
    """Weights, fitted on simulated days with even seeds: 2 to 10 of one hour, 2 and 4 of eight.

    On these days 1.96 sigma covers the truth 95.5 % (LSM9DS1) and 95.8 % (GT9X) of the time, on single days
    93.3 to 97.6 %. Figures for odd seeds are in ``docs/validation.md``.

    ``floor_deg``: the constant part.
    ``offset_times``: factor of the offset's standard deviation.
    ``disagreement_share``: share of the variance between past and future, averaged over ``over_values``
    seconds.
    """

    floor_deg: float = 0.10
    offset_times: float = 0.5
    disagreement_share: float = 0.15
    over_values: int = 9


def estimate_sigma(
    smoothed: SmoothedNodes,
    accelerometer: AccelerometerCorrection,
    settings: UncertaintySettings = UncertaintySettings(),
) -> Float64Array:
    """Return the standard deviation of the elevation, deg, one value per ``smoothed.disagreement_deg``."""
    offset_deg = settings.offset_times * float(np.degrees(accelerometer.offset_sd_g))
    between = average_around(smoothed.disagreement_deg**2 / 2.0, settings.over_values)
    steady = settings.floor_deg**2 + offset_deg**2
    return np.asarray(np.sqrt(steady + settings.disagreement_share * between))


def average_around(values: Float64Array, count: int) -> Float64Array:
    """Return the mean of ``count`` values (odd) around each; the end values are repeated beyond the ends.

    Shape (n,). Bit-identical to ``scipy.ndimage.uniform_filter1d`` with mode "nearest".
    """
    padded = np.pad(values, count // 2, mode="edge")
    first = np.cumsum(padded[:count])[-1:]
    return np.asarray(np.cumsum(np.concatenate([first, padded[count:] - padded[:-count]])) / count)
