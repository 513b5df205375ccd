"""The stillness limits of all steps, side by side, and why they differ.

Each limits a standard deviation within a window. ``still_g`` of the calibration settings is different: the
error of an accelerometer reading at rest.
"""

from dataclasses import dataclass
from math import inf


@dataclass(frozen=True, slots=True)
class StillLimit:
    """A window is still if its standard deviations are below these.

    They apply to the axis that varies most, as in published rules, unless the limit says otherwise.
    """

    window_s: float
    acc_sd_g: float
    gyro_sd_dps: float = inf


BOTH_ACCELEROMETERS = StillLimit(1.0, 0.02)
"""To compare the two accelerometers of a GT9X Link, second by second."""

MOMENT = StillLimit(1.5, 0.02, 1.4)
"""For the calibration of the sensor (:mod:`acromion.fusion.sensor`); applies to all three axes together, so
that the strapping direction does not matter. The gyroscope limit keeps slow turns out of its offset.
"""

POSE = StillLimit(5.0, 0.01, 5.0)
"""For the pose; the strictest accelerometer limit. The gyroscope limit is our own: it excludes a turn about
the vertical, which the accelerometer cannot see. The two upper-arm recordings of the project stand still at
2.8 deg/s about one axis, and 0.005 g.
"""

OFF_THE_ARM = StillLimit(10.0, 0.013)
"""For a sensor on a desk.

It must be this still in each window of ten minutes. An arm at rest moves more, through breathing and small
corrections.
"""
