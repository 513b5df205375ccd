"""How uncertain the smoothed angle is, second by second, the calibration pose left out.

Three parts are added as variances. What no recording shows: the gyroscope's misalignment, and the like. What
the directions seen at rest leave open of the accelerometer's offset
(:mod:`fusion.sensor_errors.accelerometer`); much where the arm only hung. What the day's movements do: half
the angle between what the past and the future alone say, as one of two directions, over nine seconds. That
grows with the speed of the arm by itself; speed adds nothing to it (a fit gave it a weight of nil).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from fusion.orientation.smoothed import SmoothedNodes
from fusion.sensor_errors.accelerometer import AccelerometerCorrection

Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class UncertaintySettings:
    """Weights, fitted on simulated days of both devices with even seeds 2 to 10.

    There 1.96 sigma covers the truth 95.3 % (GT9X) and 96.2 % (LSM9DS1) of the time; with odd seeds 1 to 9,
    not used for the fit, 95.0 and 95.8 % (the worst single day 91.7 %; two hours each).

    ``floor_deg``; ``offset_times`` what the offset's standard deviation counts for; ``disagreement_share``
    of the variance between past and future, averaged over ``over_values`` seconds.
    """

    floor_deg: float = 0.10
    offset_times: float = 0.7
    disagreement_share: float = 0.12
    over_values: int = 9


def estimate_sigma(
    smoothed: SmoothedNodes,
    accelerometer: AccelerometerCorrection,
    settings: UncertaintySettings | None = None,
) -> Table:
    """Standard deviation of the elevation, deg, one value as in ``smoothed.disagreement_deg``."""
    settings = settings or UncertaintySettings()
    offset_deg = settings.offset_times * float(np.degrees(accelerometer.offset_sd_g))
    between = uniform_filter1d(smoothed.disagreement_deg**2 / 2.0, settings.over_values, mode="nearest")
    steady = settings.floor_deg**2 + offset_deg**2
    return np.asarray(np.sqrt(steady + settings.disagreement_share * between))
