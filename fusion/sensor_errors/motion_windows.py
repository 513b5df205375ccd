"""What motion itself says about the gyroscope's bias.

Inside a window of about twelve seconds the acceleration is rotated into the frame in which the window
began. A person goes nowhere far, so the mean of the second half minus the mean of the first should be nil;
a remaining bias tilts the frame, and the difference becomes ``(dM b) x g`` with ``dM`` the difference of
the mean integrals of the rotation. It is linear in the bias: many windows together give it (FUSION.md
section 3).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.sensor_errors.bias_track import GyroBias
from fusion.sensor_errors.nodes import Nodes
from fusion.sensor_errors.rotation import RADIANS, carry, turn_factors


@dataclass(frozen=True, slots=True, eq=False)
class WindowEquations:
    """One vector equation ``matrix @ bias = difference`` for each window; ``bias`` is the whole one, deg/s.

    ``time_s`` (w,) middle of the window; ``matrix`` (w, 3, 3) in g per deg/s; ``difference`` (w, 3) in g;
    ``every_s`` the distance of two windows, which overlap where it is less than their length.
    """

    time_s: NDArray[np.float64]
    matrix: NDArray[np.float64]
    difference: NDArray[np.float64]
    every_s: float

    def residual(self, bias_dps: NDArray[np.float64]) -> NDArray[np.float64]:
        """What is left of the differences under a bias (3,) or (w, 3)."""
        predicted = np.einsum("wij,wj->wi", self.matrix, np.broadcast_to(bias_dps, self.difference.shape))
        return np.asarray(self.difference - predicted)


def form_equations(
    nodes: Sequence[Nodes], bias: GyroBias, length_s: float, every_s: float
) -> WindowEquations:
    """Place windows over all runs and write down what each says, linearised about ``bias``."""
    parts = [_form_of_run(run, bias, length_s, every_s) for run in nodes]
    return WindowEquations(
        np.concatenate([part.time_s for part in parts]),
        np.concatenate([part.matrix for part in parts]),
        np.concatenate([part.difference for part in parts]),
        every_s,
    )


def _form_of_run(nodes: Nodes, bias: GyroBias, length_s: float, every_s: float) -> WindowEquations:
    half = max(1, round(length_s / nodes.period_s / 2.0))
    step = max(1, round(every_s / nodes.period_s))
    first = np.arange(0, len(nodes.acc_g) - 2 * half + 1, step)
    middle_s = np.asarray(nodes.start_s + (first + half) * nodes.period_s, dtype=np.float64)
    total = bias.at(middle_s)
    remaining = total * RADIANS - nodes.bias_rad[first + half]
    matrix, difference = _walk_windows(nodes.acc_g, nodes.turn_rad, first, half, nodes.period_s, remaining)
    whole = np.asarray(difference + np.einsum("wij,wj->wi", matrix, total), dtype=np.float64)
    return WindowEquations(middle_s, matrix, whole, every_s)


@njit(cache=True, nogil=True)
def _walk_window(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    acc: Any, turns: Any, first: int, half: int, period_s: float, bias: Any, mean_acc: Any, mean_turned: Any
) -> None:  # pragma: no cover
    """Add up the means of acceleration (2, 3) and of the integrated rotation (2, 3, 3) of both halves."""
    frame = np.eye(3)
    turned = np.zeros((3, 3))
    share = 1.0 / half
    for step in range(2 * half):
        row = first + step
        part = 0 if step < half else 1
        turn = (
            turns[row, 0] - bias[0] * period_s,
            turns[row, 1] - bias[1] * period_s,
            turns[row, 2] - bias[2] * period_s,
        )
        factors = turn_factors(turn)
        x, y, z = float(acc[row, 0]), float(acc[row, 1]), float(acc[row, 2])
        for i in range(3):
            if step > 0:
                frame[i, 0], frame[i, 1], frame[i, 2] = carry(
                    (frame[i, 0], frame[i, 1], frame[i, 2]), turn, factors
                )
            mean_acc[part, i] += share * (frame[i, 0] * x + frame[i, 1] * y + frame[i, 2] * z)
            for j in range(3):
                turned[i, j] += frame[i, j] * period_s
                mean_turned[part, i, j] += share * turned[i, j]


@njit(cache=True, nogil=True)
def _walk_windows(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    acc: Any, turns: Any, first: Any, half: int, period_s: float, bias: Any
) -> tuple[Any, Any]:  # pragma: no cover
    """Equations of the windows that begin at the nodes ``first``; ``bias`` (w, 3), rad/s, is taken off."""
    matrix, difference = np.zeros((len(first), 3, 3)), np.zeros((len(first), 3))
    for w in range(len(first)):
        mean_acc, mean_turned = np.zeros((2, 3)), np.zeros((2, 3, 3))
        _walk_window(acc, turns, first[w], half, period_s, bias[w], mean_acc, mean_turned)
        up = mean_acc[0] + mean_acc[1]
        up /= np.sqrt((up * up).sum()) + 1e-12
        spread = (mean_turned[1] - mean_turned[0]) * RADIANS
        for j in range(3):
            matrix[w, 0, j] = spread[1, j] * up[2] - spread[2, j] * up[1]
            matrix[w, 1, j] = spread[2, j] * up[0] - spread[0, j] * up[2]
            matrix[w, 2, j] = spread[0, j] * up[1] - spread[1, j] * up[0]
        difference[w] = mean_acc[1] - mean_acc[0]
    return matrix, difference
