"""What makes the figures doubtful: a gyroscope that wandered, a method that cannot follow it, an arm raised
most of the day.
"""

import numpy as np
from numpy.typing import NDArray

from fusion.exposure.types import Exposure
from fusion.recording import QualityFlag
from fusion.sensor_errors.bias_track import GyroBias

LARGEST_DRIFT_DPS = 1.0
"""EXPOSURE.md A15: the gyroscope's offset should keep within 1 deg/s from one still moment to another."""

RAISED_DEG = 90.0
LEAST_ANALYSED_S = 3600.0


def flag_gyro_drift(bias: GyroBias) -> tuple[QualityFlag, ...]:
    """W-GYRO-DRIFT, from the time of one extreme to that of the other, of the axis that wandered most.

    The fusion follows the offset; what is doubtful is the sensor (or its temperature) that wandered so.
    """
    spread_dps = np.ptp(bias.bias_dps, axis=0)
    axis = int(np.argmax(spread_dps))
    if spread_dps[axis] < LARGEST_DRIFT_DPS:
        return ()
    places = (int(np.argmin(bias.bias_dps[:, axis])), int(np.argmax(bias.bias_dps[:, axis])))
    first_s, last_s = sorted(float(bias.time_s[place]) for place in places)
    facts = {"dps": round(float(spread_dps[axis]), 2)}
    return (QualityFlag("W-GYRO-DRIFT", 1, last_s - first_s, first_s, last_s, facts),)


def flag_published(bias: GyroBias, static_dps: NDArray[np.float64]) -> tuple[QualityFlag, ...]:
    """W-PUBLISHED: `published` takes the offset once (``static_dps``, (3,)) and loses slow rotation.

    Fact ``dps``: how far the offset of this recording got from that one, as `smoothed` follows it.
    """
    farthest_dps = float(np.linalg.norm(bias.bias_dps - static_dps, axis=1).max())
    return (QualityFlag("W-PUBLISHED", facts={"dps": round(farthest_dps, 2)}),)


def flag_upside_down(exposure: Exposure) -> tuple[QualityFlag, ...]:
    """W-UPSIDE where the arm would have been above level for half of an hour or more.

    No work does that: the sensor was turned end for end after its pose, or the pose was not what it was
    taken for.
    """
    if exposure.analysed_s < LEAST_ANALYSED_S or exposure.percentiles_deg[50] <= RAISED_DEG:
        return ()
    facts = {"deg": round(exposure.percentiles_deg[50], 1)}
    return (QualityFlag("W-UPSIDE", 1, exposure.analysed_s, facts=facts),)
