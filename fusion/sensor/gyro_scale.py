"""Scale and misalignment of the gyroscope's axes, from how the arm turned from one still moment to the next.

At rest the accelerometer alone tells the vertical. Carried from one still moment to the next by the
gyroscope, it should arrive where the next one has it; what is missing is linear in the nine errors of scale
and misalignment. Unlike the motion windows, still moments carry no acceleration of the arm's own, which would
pass for a scale error of up to 0.5 %. The prior knows no axes, so that the answer does not depend on how the
sensor is strapped on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np

from fusion.numba_kernels import kernel
from fusion.recording import Float64Array
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.model import RADIANS, GyroBias, carry, turn_factors
from fusion.sensor.nodes import Nodes
from fusion.sensor.stillness import QuietTable


@dataclass(frozen=True, slots=True)
class GyroScaleSettings:
    """How scale is sought, and when it is believed.

    Still moments up to ``longest_s`` apart are compared. ``scale`` is the standard deviation expected of each
    of the nine errors in a part (1 % of scale and 0.3 % of misalignment together); ``still_g``, ``bias_dps``
    and ``turn_share`` the error of a vertical at rest, of the bias, and for each radian turned. The gain is
    applied only where the root mean square of the nine standard errors is under ``believed_error`` and no
    rate is changed by more than ``most``; otherwise it is left out. Of more than ``most_pairs`` in a run, as
    many are taken at even steps.
    """

    longest_s: float = 40.0
    scale: float = 0.006
    still_g: float = 0.004
    bias_dps: float = 0.03
    turn_share: float = 0.0005
    believed_error: float = 0.002
    most: float = 0.03
    most_pairs: int = 2000
    rounds: int = 6


@dataclass(frozen=True, slots=True, eq=False)
class GyroScale:
    """True rate = ``gain`` (3, 3) @ the measured one; ``error``: root mean square of its nine standard
    errors; ``pairs`` used.
    """

    gain: Float64Array
    error: float
    pairs: int = 0


def leave_gyro_scale() -> GyroScale:
    """No correction."""
    return GyroScale(np.eye(3), GyroScaleSettings().scale)


def estimate_gyro_scale(
    nodes: Sequence[Nodes],
    stills: QuietTable,
    bias: GyroBias,
    accelerometer: AccelerometerCorrection,
    settings: GyroScaleSettings | None = None,
) -> GyroScale:
    """Compare successive still moments; ``nodes`` with some bias taken off, ``bias`` the true one."""
    settings = settings or GyroScaleSettings()
    up = accelerometer.find_up(stills.gravity_g, stills.middle_s)
    parts = [_compare_in_run(run, stills.middle_s, up, bias, settings) for run in nodes]
    slope, miss, variance = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if len(miss) == 0:
        return leave_gyro_scale()
    errors, standard_error = _fit(slope, miss, variance, settings)
    if standard_error > settings.believed_error or np.linalg.norm(errors, 2) > settings.most:
        return leave_gyro_scale()
    return GyroScale(np.eye(3) + errors, standard_error, len(miss))


def _compare_in_run(
    nodes: Nodes, middle_s: Float64Array, up: Float64Array, bias: GyroBias, settings: GyroScaleSettings
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Slopes (w, 3, 9), misses (w, 3) and variances (w,) of the pairs of still moments inside a run."""
    place = np.round((middle_s - nodes.start_s) / nodes.period_s).astype(np.int64)
    inside = np.flatnonzero((place >= 0) & (place < len(nodes.acc_g)))
    gap_s = np.diff(middle_s[inside])
    near = np.flatnonzero(gap_s < settings.longest_s)
    near = near[:: -(-len(near) // settings.most_pairs) or 1]
    first, second = inside[near], inside[near + 1]
    left_rad = bias.at(middle_s[first] + gap_s[near] / 2.0) * RADIANS - nodes.bias_rad[place[first]]
    frame, drift, turned = np.zeros((len(near), 3, 3)), np.zeros((len(near), 3, 9)), np.zeros(len(near))
    _carry_between(
        nodes.turn_rad, left_rad * nodes.period_s, place[first], place[second], frame, drift, turned
    )
    slope = np.cross(drift, up[first][:, :, None], axis=1)
    miss = np.einsum("wij,wj->wi", frame, up[second]) - up[first]
    variance = settings.still_g**2 + (np.radians(settings.bias_dps) * gap_s[near]) ** 2
    return slope, miss, variance + (settings.turn_share * turned) ** 2


def _fit(
    slope: Float64Array, miss: Float64Array, variance: Float64Array, settings: GyroScaleSettings
) -> tuple[Float64Array, float]:
    """Damped least squares with Cauchy weights; the gain less one, (3, 3), and its standard error."""
    prior = np.eye(9) / settings.scale**2
    weight, solution, normal = 1.0 / variance, np.zeros(9), prior
    for _ in range(settings.rounds):
        normal = np.einsum("w,wij,wik->jk", weight, slope, slope, optimize=True) + prior
        solution = np.linalg.solve(normal, np.einsum("w,wij,wi->j", weight, slope, miss, optimize=True))
        square = ((miss - slope @ solution) ** 2).sum(axis=1)
        excess = max(1.0, float(np.median(square / variance)) / 1.4)
        weight = 1.0 / (excess * variance * (1.0 + square / (5.7 * excess * variance)))
    return solution.reshape(3, 3), float(np.sqrt(np.trace(np.linalg.inv(normal)) / 9.0))


@kernel
def _carry_between(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    turns: Any, left: Any, first: Any, second: Any, frames: Any, drifts: Any, turned: Any
) -> None:  # pragma: no cover
    """How the sensor turned from one node to another: what takes vectors of the second to the first.

    ``left`` (w, 3) is the rotation of each step that is bias still. Column 3 j + k of the drifts: what a
    share of the rate about axis k that shows on axis j does; ``turned`` is the length of the way, rad.
    """
    for w in range(len(first)):
        x, y, z = left[w, 0], left[w, 1], left[w, 2]
        for i in range(3):
            frames[w, i, i] = 1.0
        for row in range(first[w] + 1, second[w] + 1):
            turn = (turns[row, 0] - x, turns[row, 1] - y, turns[row, 2] - z)
            factors = turn_factors(turn)
            turned[w] += sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
            for i in range(3):
                seen = carry((frames[w, i, 0], frames[w, i, 1], frames[w, i, 2]), turn, factors)
                frames[w, i, 0], frames[w, i, 1], frames[w, i, 2] = seen
                for j in range(3):
                    drifts[w, i, 3 * j] -= frames[w, i, j] * turn[0]
                    drifts[w, i, 3 * j + 1] -= frames[w, i, j] * turn[1]
                    drifts[w, i, 3 * j + 2] -= frames[w, i, j] * turn[2]
