"""Where the arm hung still, and what that says about the sensor: arm axis and gyroscope offset."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Pose = Literal["n-pose", "side-lean", "two-point"]
Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class StillPeriod:
    """A stretch in which the arm did not move.

    Attributes
    ----------
    start_s, duration_s
        Seconds from the recording's first sample.
    gravity_g
        Shape (3,): mean acceleration, points to the zenith.
    gyro_bias_dps
        Shape (3,): mean angular rate.
    score
        0 to 1: how still, how near 1 g, how long (definition in ``score_still_period``).
    """

    start_s: float
    duration_s: float
    gravity_g: Vector
    gyro_bias_dps: Vector
    score: float


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """The pose that tied the sensor to the arm.

    ``arm_axis`` is a unit vector, shape (3,), in the sensor frame along the upper arm towards the shoulder
    (it points to the zenith when the arm hangs), so that elevation is the angle between it and the vertical.
    """

    pose: Pose
    still: StillPeriod
    arm_axis: Vector
    second: StillPeriod | None = None
