"""Elevation while the sensor is worn: samples in, angle out, nothing kept but a few numbers."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fusion.elevation import measure_elevation
from fusion.orientation.arrays import check_arrays, check_direction, check_gravity
from fusion.orientation.live import LiveVertical
from fusion.recording import Float64Array


class LiveElevation:
    """Arm elevation for real-time feedback.

    Feed samples one at a time or in chunks of any size: the result does not depend on how they were cut.
    Without ``arm_axis`` the arm is taken to hang at the first still moment (the N-pose); until then the
    elevation is NaN.
    """

    def __init__(self, rate_hz: float, arm_axis: ArrayLike | None = None) -> None:
        """Start afresh; ``arm_axis``, shape (3,): unit vector towards the shoulder, in the sensor's frame.

        Raises UnusableArrays.
        """
        self._rate_hz = rate_hz
        self._vertical = LiveVertical(rate_hz)
        self._arm_axis: Float64Array | None = None if arm_axis is None else check_direction(arm_axis)

    def update(self, acc_g: ArrayLike, gyr_dps: ArrayLike) -> NDArray[np.float32]:
        """Take the next samples, shapes (n, 3) or (3,), g and deg/s; give the elevation of each, (n,), deg.

        A chunk may be empty; one that is refused changes nothing. At the first still moment the acceleration
        must be about 1 g long, as in no other unit.

        Raises UnusableArrays.
        """
        acc, gyr = check_arrays(np.atleast_2d(acc_g), np.atleast_2d(gyr_dps), self._rate_hz)
        if self._arm_axis is not None:
            return measure_elevation(self._vertical.update(acc, gyr), self._arm_axis)
        return self._wait_for_rest(acc, gyr)

    @property
    def has_rested(self) -> bool:
        """Whether a still moment has told the gyroscope's bias; until then the angle may drift."""
        return self._vertical.has_rested

    def _wait_for_rest(self, acc: NDArray[np.generic], gyr: NDArray[np.generic]) -> NDArray[np.float32]:
        """Sample by sample, so that the arm axis is set at the same sample however the chunks were cut."""
        waiting = np.full(len(acc), np.nan, dtype=np.float32)
        for row in range(len(acc)):
            up = self._vertical.update(acc[row], gyr[row])
            if self._vertical.has_rested:
                check_gravity(np.asarray(acc[row : row + 1], dtype=np.float64))
                self._arm_axis = up[0]
                waiting[row] = 0.0
                waiting[row + 1 :] = self.update(acc[row + 1 :], gyr[row + 1 :]) if row + 1 < len(acc) else []
                break
        return waiting
