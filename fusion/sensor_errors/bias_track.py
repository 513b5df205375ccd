"""The gyroscope's bias as a function of time."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class GyroBias:
    """Bias at knots: ``time_s`` (k,), ``bias_dps`` (k, 3); a straight line between them, constant outside.

    ``still_moments`` and ``motion_windows`` count the observations it rests on.
    """

    time_s: NDArray[np.float64]
    bias_dps: NDArray[np.float64]
    still_moments: int = 0
    motion_windows: int = 0

    def at(self, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Bias at the times asked for, shape (n, 3)."""
        columns = [np.interp(time_s, self.time_s, self.bias_dps[:, axis]) for axis in range(3)]
        return np.stack(columns, axis=1)

    def along(self, start_s: float, period_s: float, count: int) -> NDArray[np.float64]:
        """Bias at ``count`` even steps, shape (count, 3)."""
        out = np.empty((count, 3))
        _draw_lines(self.time_s, self.bias_dps, start_s, period_s, out)
        return out


@njit(cache=True, nogil=True)
def _draw_lines(
    time_s: Any, bias: Any, start_s: float, period_s: float, out: Any
) -> None:  # pragma: no cover
    left, last = 0, len(time_s) - 1
    for step in range(len(out)):
        now_s = start_s + step * period_s
        while left < last - 1 and now_s >= time_s[left + 1]:
            left += 1
        share = 0.0
        if last > 0:
            share = min(max((now_s - time_s[left]) / (time_s[left + 1] - time_s[left]), 0.0), 1.0)
        right = min(left + 1, last)
        for axis in range(3):
            out[step, axis] = bias[left, axis] + share * (bias[right, axis] - bias[left, axis])


def hold_bias(bias_dps: NDArray[np.float64]) -> GyroBias:
    """One bias for the whole recording."""
    return GyroBias(np.zeros(1), np.asarray(bias_dps, dtype=np.float64).reshape(1, 3))
