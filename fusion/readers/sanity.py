"""Figures that tell the maker of a logger whether axes, scales and clock of a recording are right."""

import numpy as np
from numpy.typing import NDArray

from fusion.corrections import name_axes
from fusion.gravity_windows import GravityWindows, GyroModel, measure_miss
from fusion.gyro_frame import judge_frame, measure_scale
from fusion.physics import cut_whole_windows, find_rest_g
from fusion.recording import Recording
from fusion.rest_probes import find_gyro_offset_dps

Table = NDArray[np.float64]
WIDEST_MARGIN = 0.1


def measure_sanity(recording: Recording) -> dict[str, object]:
    """1 g at rest, and the gyroscope's axes and scale, as the data show them.

    ``rest_g``: length of the acceleration at still moments, None without any. ``turns``: windows of 8 s in
    which gravity turned enough to tell something. ``handedness``: +1 wholly right-handed, -1 wholly
    left-handed, from how well the angular rate and its opposite explain the turns. ``axes``: the readings
    that explain them as rates about x, y and z, "+x +y +z" where all is right. ``gyro_scale``: the factor on
    the rates that explains them best, 1 where it is right, give or take ``gyro_scale_margin`` (twice its
    standard error); ``gyro_scale_axes`` the same for each axis, None where its margin is over 10 %. What
    rests on turns is None where there are too few. The recording is taken as it came through
    :mod:`fusion.physics`: what was corrected there is among the warnings.
    """
    rest_g, is_still = find_rest_g(recording.segments)
    offset_dps = find_gyro_offset_dps(recording.segments)
    return {
        "rest_g": round(rest_g, 4) if is_still else None,
        "gyro_offset_dps": [round(float(value), 3) for value in offset_dps],
        **_measure_turns(recording, offset_dps),
    }


def _measure_turns(recording: Recording, offset_dps: Table) -> dict[str, object]:
    windows, _ = cut_whole_windows(recording.segments)
    evidence = judge_frame(windows, offset_dps, (1.0,))
    if evidence is None:
        none = (
            "handedness",
            "axes",
            "gyro_scale",
            "gyro_scale_margin",
            "gyro_scale_axes",
            "unexplained_percent",
        )
        return {"turns": 0, **dict.fromkeys(none)}
    scale = measure_scale(windows, evidence.as_read, 1.0)
    margins = 2.0 * scale.axes_errors
    return {
        "turns": evidence.lively,
        "handedness": round(_score_handedness(windows, evidence.as_read.model), 3),
        "axes": None if evidence.is_doubtful else name_axes(evidence.chosen.turn),
        "gyro_scale": round(scale.overall, 3),
        "gyro_scale_margin": round(2.0 * scale.error, 3),
        "gyro_scale_axes": [
            round(float(k), 3) if margin < WIDEST_MARGIN else None
            for k, margin in zip(scale.axes, margins, strict=True)
        ],
        "unexplained_percent": round(100.0 * evidence.as_read.score, 2),
    }


def _score_handedness(windows: GravityWindows, model: GyroModel) -> float:
    turned = GyroModel(-model.gain, -model.drift_dps, model.offset_g)
    right, left = (float((measure_miss(windows, one) ** 2).sum()) for one in (model, turned))
    return (left - right) / max(left + right, 1e-12)
