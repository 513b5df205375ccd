"""Table 1 of the paper, and the statistics it gives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fusion.simulation.parts import Device

QUASI_STATIC = (2, 5, 7)
"""Where elevation hardly changes, so that the paper gives no r."""

TITLES = {
    1: "flexion 1 Hz",
    2: "ext. rotation at 90 flexion",
    3: "flexion 3 Hz",
    4: "abduction 1 Hz",
    5: "ext. rotation at 90 abduction",
    6: "abduction 3 Hz",
    7: "trunk flexion, static arm",
    8: '"Z" clockwise',
    9: '"Z" counterclockwise',
    10: "ball throws",
}


@dataclass(frozen=True, slots=True)
class Agreement:
    """Correlation, root mean square error and mean absolute error."""

    r: float
    rmse_deg: float
    absolute_deg: float

    @staticmethod
    def mean(found: Sequence["Agreement"]) -> "Agreement":
        """Give the mean of each statistic, as the paper does over people."""
        r, rmse, absolute = np.mean([(a.r, a.rmse_deg, a.absolute_deg) for a in found], axis=0)
        return Agreement(float(r), float(rmse), float(absolute))


TABLE_1: Mapping[Device, Mapping[int, Agreement]] = {
    "gt9x": {
        1: Agreement(0.986, 4.47, 3.61),
        2: Agreement(np.nan, 2.20, 1.86),
        3: Agreement(0.964, 9.95, 7.73),
        4: Agreement(0.998, 3.05, 2.48),
        5: Agreement(np.nan, 2.13, 1.87),
        6: Agreement(0.982, 7.44, 5.47),
        7: Agreement(np.nan, 3.74, 3.18),
        8: Agreement(0.996, 3.37, 2.78),
        9: Agreement(0.995, 3.88, 3.25),
        10: Agreement(0.894, 11.25, 8.00),
    },
    "lsm9ds1": {
        1: Agreement(0.998, 2.91, 2.47),
        2: Agreement(np.nan, 1.66, 1.23),
        3: Agreement(0.973, 9.25, 7.18),
        4: Agreement(0.998, 2.37, 1.75),
        5: Agreement(np.nan, 1.87, 1.59),
        6: Agreement(0.988, 6.23, 4.50),
        7: Agreement(np.nan, 2.91, 2.33),
        8: Agreement(0.993, 3.62, 2.93),
        9: Agreement(0.995, 3.70, 3.12),
        10: Agreement(0.900, 11.24, 7.50),
    },
}
"""Boyer, Frasie, Bouyer, Roy, Poitras, Campeau-Lecours: mean of five adults against Xsens MVN."""
