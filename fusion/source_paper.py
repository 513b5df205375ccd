"""Table 1 of the source paper: what others can set their own figures beside."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

QUASI_STATIC = (2, 5, 7)
"""Where elevation hardly changes, so that the paper gives no r."""


@dataclass(frozen=True, slots=True)
class TaskFigures:
    """Correlation, root mean square error and mean absolute error."""

    r: float
    rmse_deg: float
    absolute_deg: float

    @staticmethod
    def mean(found: Sequence["TaskFigures"]) -> "TaskFigures":
        """Return the mean of each statistic, as the paper does over people."""
        r, rmse, absolute = np.mean([(a.r, a.rmse_deg, a.absolute_deg) for a in found], axis=0)
        return TaskFigures(float(r), float(rmse), float(absolute))


TABLE_1: Mapping[str, Mapping[int, TaskFigures]] = {
    "gt9x": {
        1: TaskFigures(0.986, 4.47, 3.61),
        2: TaskFigures(np.nan, 2.20, 1.86),
        3: TaskFigures(0.964, 9.95, 7.73),
        4: TaskFigures(0.998, 3.05, 2.48),
        5: TaskFigures(np.nan, 2.13, 1.87),
        6: TaskFigures(0.982, 7.44, 5.47),
        7: TaskFigures(np.nan, 3.74, 3.18),
        8: TaskFigures(0.996, 3.37, 2.78),
        9: TaskFigures(0.995, 3.88, 3.25),
        10: TaskFigures(0.894, 11.25, 8.00),
    },
    "lsm9ds1": {
        1: TaskFigures(0.998, 2.91, 2.47),
        2: TaskFigures(np.nan, 1.66, 1.23),
        3: TaskFigures(0.973, 9.25, 7.18),
        4: TaskFigures(0.998, 2.37, 1.75),
        5: TaskFigures(np.nan, 1.87, 1.59),
        6: TaskFigures(0.988, 6.23, 4.50),
        7: TaskFigures(np.nan, 2.91, 2.33),
        8: TaskFigures(0.993, 3.62, 2.93),
        9: TaskFigures(0.995, 3.70, 3.12),
        10: TaskFigures(0.900, 11.24, 7.50),
    },
}
"""Boyer, Frasie, Bouyer, Roy, Poitras, Campeau-Lecours: mean of five adults against Xsens MVN."""
