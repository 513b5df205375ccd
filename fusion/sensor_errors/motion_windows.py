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
from numpy.typing import NDArray

from fusion.numba_kernels import kernel
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
    spread, difference, felt = np.zeros((len(first), 3, 3)), *np.zeros((2, len(first), 3))
    room = (np.empty((3, 3)), np.empty((3, 3)))
    _walk_windows(
        nodes.acc_g,
        nodes.turn_rad,
        first,
        (half, nodes.period_s),
        remaining,
        room,
        (spread, difference, felt),
    )
    up = felt / (np.linalg.norm(felt, axis=1, keepdims=True) + 1e-12)
    matrix = np.cross(RADIANS * spread, up[:, :, None], axis=1)
    whole = np.asarray(difference + np.einsum("wij,wj->wi", matrix, total), dtype=np.float64)
    return WindowEquations(middle_s, matrix, whole, every_s)


@kernel
def _walk_windows(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    acc: Any, turns: Any, first: Any, steps: Any, bias: Any, room: Any, out: Any
) -> None:  # pragma: no cover
    """For the windows that begin at the nodes ``first``, with ``bias`` (w, 3), rad/s, taken off.

    Into ``out``, all in the window's first frame: mean of the second half less that of the first, of the
    integrated rotation (w, 3, 3) and of the acceleration (w, 3); and the sum of the acceleration (w, 3).
    """
    half, period_s = steps
    frame, turned = room
    spread, difference, total = out
    for w in range(len(first)):
        x, y, z = period_s * bias[w, 0], period_s * bias[w, 1], period_s * bias[w, 2]
        for i in range(3):
            for j in range(3):
                frame[i, j], turned[i, j] = 1.0 if i == j else 0.0, 0.0
        for step in range(2 * half):
            row = first[w] + step
            share = -1.0 / half if step < half else 1.0 / half
            moved = 1.0 if step > 0 else 0.0
            turn = (moved * (turns[row, 0] - x), moved * (turns[row, 1] - y), moved * (turns[row, 2] - z))
            factors = turn_factors(turn)
            for i in range(3):
                seen = carry((frame[i, 0], frame[i, 1], frame[i, 2]), turn, factors)
                frame[i, 0], frame[i, 1], frame[i, 2] = seen
                felt = seen[0] * acc[row, 0] + seen[1] * acc[row, 1] + seen[2] * acc[row, 2]
                difference[w, i] += share * felt
                total[w, i] += felt
                for j in range(3):
                    turned[i, j] += frame[i, j] * period_s
                    spread[w, i, j] += share * turned[i, j]
