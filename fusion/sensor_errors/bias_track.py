"""The gyroscope's bias as a function of time."""

from dataclasses import dataclass
from typing import Any

import numpy as np
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

    def at(self, time_s: NDArray[np.floating[Any]]) -> NDArray[np.float64]:
        """Bias at the times asked for, shape (n, 3)."""
        if len(self.time_s) == 1:
            return np.repeat(self.bias_dps, len(time_s), axis=0)
        columns = [np.interp(time_s, self.time_s, self.bias_dps[:, axis]) for axis in range(3)]
        return np.stack(columns, axis=1)


def hold_bias(bias_dps: NDArray[np.float64]) -> GyroBias:
    """One bias for the whole recording."""
    return GyroBias(np.zeros(1), np.asarray(bias_dps, dtype=np.float64).reshape(1, 3))
