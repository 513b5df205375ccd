"""Tables in which acceleration and angular rate stand under each other's names.

An accelerometer on an arm reads about the length of gravity all the time; a gyroscope reads next to nothing
at rest and a hundred times as much in movement. Where the columns show the opposite, they are exchanged.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.corrections import flag_correction, multiply_acceleration, multiply_rates
from fusion.recording import Recording, Segment
from fusion.rest_probes import STILL_S, probe_blocks, slide_mean
from fusion.units import acc_scale_g, gyr_scale_dps

LIVELY_RATIO, MORE_TIMES = 5.0, 3.0
"""Long readings over short ones. In the recordings in hand, an accelerometer's are at most 1.8 times as long,
in throws 7, and the gyroscope's beside them at least a hundred times; with an offset at rest five times.
"""


def look_exchanged(segments: Sequence[Segment]) -> bool:
    """Whether the angular rate keeps the length of gravity, and the acceleration does not."""
    accelerations = _measure_spread(segments, is_rate=False)
    if accelerations < LIVELY_RATIO:
        return False
    return accelerations > MORE_TIMES * _measure_spread(segments, is_rate=True)


def _measure_spread(segments: Sequence[Segment], *, is_rate: bool) -> float:
    """The 95th percentile of the length over the 5th."""
    lengths = [_measure_lengths(*block, is_rate=is_rate) for block in probe_blocks(segments)]
    every = np.concatenate(lengths) if lengths else np.empty(0)
    if len(every) == 0:
        return 1.0
    low, high = np.quantile(every, [0.05, 0.95]).tolist()
    return float(high / max(low, 1e-9))


def _measure_lengths(segment: Segment, first: int, stop: int, *, is_rate: bool) -> NDArray[np.float64]:
    samples = (segment.gyr_dps if is_rate else segment.acc_g)[first:stop]
    width = max(3, round(STILL_S * segment.rate_hz))
    if len(samples) < width:
        return np.empty(0)
    return np.asarray(np.linalg.norm(slide_mean(samples, width)[0], axis=1))


def exchange_sensors(recording: Recording) -> Recording:
    """Let the sensors change places, each in the unit that the file names for it, and say so (W-UNITS)."""
    segments = tuple(replace(s, acc_g=s.gyr_dps, gyr_dps=s.acc_g) for s in recording.segments)
    exchanged = replace(recording, segments=segments)
    acc_g = acc_scale_g(recording.understood.get("acceleration_unit")) or 1.0
    gyr_dps = gyr_scale_dps(recording.understood.get("angular_rate_unit")) or 1.0
    if acc_g != gyr_dps:
        multiply_acceleration(exchanged, acc_g / gyr_dps)
        multiply_rates(exchanged, gyr_dps / acc_g)
    return flag_correction(exchanged, "exchanged sensors", "motion", {})
