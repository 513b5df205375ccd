"""How still is still: the limits that the steps set, side by side, and why they differ.

Each bounds a standard deviation within a window. What ``still_g`` of the calibration settings says is another
thing: the error of what an accelerometer reads at rest.
"""

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True, slots=True)
class StillLimit:
    """A window is still where the standard deviations stay under these.

    They are those of the axis that varies most, as published rules have it, unless the limit says otherwise.
    """

    window_s: float
    acc_sd_g: float
    gyro_sd_dps: float = inf


BOTH_ACCELEROMETERS = StillLimit(1.0, 0.02)
"""For holding the two accelerometers of a GT9X Link against each other: the seconds of its log."""

MOMENT = StillLimit(1.5, 0.02, 1.4)
"""For the calibration of the sensor (:mod:`fusion.sensor`), of all three axes together, so that it does not
matter how the sensor is strapped on. The gyroscope's limit keeps slow turns out of its offset.
"""

POSE = StillLimit(5.0, 0.01, 5.0)
"""For the pose, the strictest of the accelerometer. The gyroscope's limit is ours: it keeps
out a turn about the vertical, which the accelerometer cannot see. The two worn upper arms among the project's
recordings stand still at 2.8 deg/s about one axis, and 0.005 g.
"""

OFF_THE_ARM = StillLimit(10.0, 0.013)
"""For a sensor that lies on a desk, window after window for ten minutes: an arm at rest moves more than that
through breathing and small corrections.
"""
