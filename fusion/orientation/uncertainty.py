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

from fusion.orientation.smoothed import SmoothedNodes
from fusion.sensor_errors.accelerometer import AccelerometerCorrection

Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class UncertaintySettings:
    """Weights, fitted on simulated days with even seeds: 2 to 10 of one hour, 2 and 4 of eight.

    There 1.96 sigma covers the truth 95.5 % (LSM9DS1) and 95.8 % (GT9X) of the time, on single days 93.3 to
    97.6 %. A first choice (0.10, 0.7, 0.12), with the same mean but 92.2 % on one even day, was given up when
    an odd day of eight hours showed 92.4 %. What odd seeds give stands in ``docs/validation.md`` (d).

    ``floor_deg``; ``offset_times`` what the offset's standard deviation counts for; ``disagreement_share``
    of the variance between past and future, averaged over ``over_values`` seconds.
    """

    floor_deg: float = 0.10
    offset_times: float = 0.5
    disagreement_share: float = 0.15
    over_values: int = 9


def estimate_sigma(
    smoothed: SmoothedNodes,
    accelerometer: AccelerometerCorrection,
    settings: UncertaintySettings | None = None,
) -> Table:
    """Standard deviation of the elevation, deg, one value as in ``smoothed.disagreement_deg``."""
    settings = settings or UncertaintySettings()
    offset_deg = settings.offset_times * float(np.degrees(accelerometer.offset_sd_g))
    between = average_around(smoothed.disagreement_deg**2 / 2.0, settings.over_values)
    steady = settings.floor_deg**2 + offset_deg**2
    return np.asarray(np.sqrt(steady + settings.disagreement_share * between))


def average_around(values: Table, count: int) -> Table:
    """Mean of ``count`` values (odd) around each; the first and the last value stand for what is beyond.

    Shape (n,). To the bit what ``scipy.ndimage.uniform_filter1d`` gives with the mode "nearest".
    """
    padded = np.pad(values, count // 2, mode="edge")
    first = np.cumsum(padded[:count])[-1:]
    return np.asarray(np.cumsum(np.concatenate([first, padded[count:] - padded[:-count]])) / count)
