"""Figures that tell the maker of a logger whether axes, scales and clock of a recording are right."""

import numpy as np
from numpy.typing import NDArray

from fusion.physics import find_rest_g
from fusion.recording import Recording
from fusion.still_pairs import StillPair, find_gyro_offset_dps, find_still_pairs, score_factor

SCALES = np.geomspace(0.7, 1.4, 71)
FEWEST_PAIRS = 5


def measure_sanity(recording: Recording) -> dict[str, object]:
    """1 g at rest, the frame's handedness and the gyroscope's scale, as the data show them.

    ``rest_g``: length of the acceleration at still moments, None without any. ``handedness``: +1 wholly
    right-handed, -1 wholly left-handed, from how well the angular rate and its opposite explain the turns of
    gravity. ``gyro_scale``: the factor on the angular rate that explains them best; 1 where it is right. The
    last two are None where fewer than five turns were seen. The recording is taken as it came through
    :mod:`fusion.physics`: what was corrected there is among the warnings.
    """
    rest_g, is_still = find_rest_g(recording.segments)
    pairs = find_still_pairs(recording.segments)
    has_turns = len(pairs) >= FEWEST_PAIRS
    offset_dps: NDArray[np.float64] = find_gyro_offset_dps(recording.segments)
    return {
        "rest_g": round(rest_g, 4) if is_still else None,
        "gyro_offset_dps": [round(float(value), 3) for value in offset_dps],
        "turns": len(pairs),
        "handedness": round(_score_handedness(pairs), 3) if has_turns else None,
        "gyro_scale": round(_find_scale(pairs), 3) if has_turns else None,
        "unexplained_percent": round(100.0 * score_factor(pairs, 1.0), 2) if has_turns else None,
    }


def _score_handedness(pairs: list[StillPair]) -> float:
    as_is, turned = score_factor(pairs, 1.0), score_factor(pairs, -1.0)
    return (turned - as_is) / max(turned + as_is, 1e-12)


def _find_scale(pairs: list[StillPair]) -> float:
    return float(min(SCALES, key=lambda scale: score_factor(pairs, float(scale))))
