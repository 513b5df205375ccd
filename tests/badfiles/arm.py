"""One minute of a worn arm, from which every bad file is made: holds at five heights, with sensor noise."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from tests.factories import hold

Matrix = NDArray[np.float64]
POSES = ((0.0, 15.0), (60.0, 10.0), (5.0, 10.0), (90.0, 10.0), (20.0, 15.0))
"""Elevation and seconds; whatever is damaged below is damaged while the arm is held."""
GYRO_OFFSET_DPS = (0.5, -0.3, 0.2)


@cache
def minute(rate_hz: float = 100.0, times: int = 1) -> tuple[Matrix, Matrix]:
    """Acceleration in g and angular rate in deg/s, shapes (n, 3): the same minute ``times`` times."""
    (segment,) = hold(*(POSES * times), rate_hz=rate_hz).recording.segments
    chance = np.random.default_rng(7)
    acc_g = segment.acc_g + chance.normal(0.0, 0.004, segment.acc_g.shape)
    gyr_dps = segment.gyr_dps + chance.normal(0.0, 0.1, segment.gyr_dps.shape) + GYRO_OFFSET_DPS
    return acc_g, gyr_dps
