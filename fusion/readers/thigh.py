"""Find sitting and standing from an accelerometer on the thigh, by the rule of Acti4 (Skotte et al. 2014).

A second is seated if the axis along the thigh is more than 45 deg from the vertical over two seconds,
otherwise upright. Bouts of sitting shorter than 5 s are removed by a running median, as in Acti4. In 140
hours of daily life of 17 people the rule of the paper found sitting with a sensitivity of 98 % and a
specificity of 93 % (doi 10.1123/jpah.2011-0347). This shorter form was not part of that study: it has no
reference of the standing thigh, and no rules for lying and cycling, which count as seated.

Time in which the sensor did not move for 90 minutes counts as not worn, as in Acti4, and has no posture.
"""

from dataclasses import replace
from itertools import groupby
from typing import BinaryIO

import numpy as np
from scipy.ndimage import median_filter

from acromion.fusion.clocks import read_clock
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.errors import UnusablePostures
from acromion.fusion.readers import read_thigh
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, Recording, Segment

SEATED_DEG = 45.0
MEDIAN_SECONDS = 9
"""Running median over 2 x 5 - 1 seconds, for bouts of at least 5 s."""
MOVING_G, STILL_G = 0.1, 0.01
"""Standard deviations of two seconds: above the first a person moves; below the second nobody does."""
NOT_WORN_S = 5400
LEAST_S = 4
"""Shorter segments are not used."""
LEAST_MOVING_S = 60


def find_postures(file: BinaryIO, file_name: str = "", axis: int = 0) -> tuple[DiaryEntry, ...]:
    """Return the postures of a recording of the thigh, as rows of the kind "posture".

    ``axis``: the sensor's axis along the thigh, 0 for x as in Acti4; its direction does not matter.

    Raises UnusablePostures: the recording has no clock, or the axis is not along the thigh. Raises
    FusionError if the file cannot be read.
    """
    recording = _scale(read_thigh(file, file_name))
    if recording.start is None:
        raise UnusablePostures(why="thigh clock", cure="thigh clock", value=file_name)
    segments = [segment for segment in recording.segments if len(segment) > LEAST_S * segment.rate_hz]
    seconds = [_summarise_seconds(segment) for segment in segments]
    upward = _find_direction(seconds, axis, file_name)
    rows: list[DiaryEntry] = []
    for segment, (mean_g, deviation_g) in zip(segments, seconds, strict=True):
        along = upward * _normalise(mean_g)[:, axis]
        inclination_deg = np.degrees(np.arccos(np.clip(along, -1.0, 1.0)))
        is_seated = median_filter((inclination_deg > SEATED_DEG).astype(np.int8), MEDIAN_SECONDS)
        is_worn = ~_find_long(deviation_g.max(axis=1) < STILL_G, NOT_WORN_S)
        place = 0
        for (worn, seated), bout in groupby(zip(is_worn.tolist(), is_seated.tolist(), strict=True)):
            length = len(list(bout))
            if worn:
                ends_us = (segment.start_us + second * MICROSECONDS for second in (place, place + length))
                start, end = (read_clock(recording.start, end_us).isoformat() for end_us in ends_us)
                rows.append(DiaryEntry(start, end, "posture", "seated" if seated else "upright"))
            place += length
    return tuple(rows)


def _scale(recording: Recording) -> Recording:
    """Return a recording whose acceleration has a median length of 1 g; its unit has no effect."""
    lengths = np.concatenate([np.linalg.norm(one.acc_g[::50], axis=1) for one in recording.segments])
    scale = np.float32(1.0 / max(float(np.median(lengths)), 1e-9))
    segments = tuple(replace(one, acc_g=one.acc_g * scale) for one in recording.segments)
    return replace(recording, segments=segments)


def _summarise_seconds(segment: Segment) -> tuple[Float64Array, Float64Array]:
    """Return mean and standard deviation of the two seconds from each second, shape (s, 3)."""
    count = int(len(segment) / segment.rate_hz)
    edges = np.round(np.arange(count + 1) * segment.rate_hz).astype(np.int64)
    sums = np.empty((2, count, 3))
    for axis in range(3):
        values = segment.acc_g[: edges[-1], axis].astype(np.float64)
        sums[0, :, axis] = np.add.reduceat(values, edges[:-1])
        sums[1, :, axis] = np.add.reduceat(values**2, edges[:-1])
    rows = np.diff(edges)[:, np.newaxis]
    both = sums + np.concatenate([sums[:, 1:], sums[:, -1:]], axis=1)
    rows = rows + np.concatenate([rows[1:], rows[-1:]])
    mean = both[0] / rows
    return mean, np.sqrt(np.maximum(both[1] / rows - mean**2, 0.0))


def _normalise(mean_g: Float64Array) -> Float64Array:
    return np.asarray(mean_g / np.maximum(np.linalg.norm(mean_g, axis=1, keepdims=True), 1e-9), np.float64)


def _find_direction(seconds: list[tuple[Float64Array, Float64Array]], axis: int, file_name: str) -> float:
    """Return 1 or -1, so that the axis points up while the person moves on foot.

    Raises UnusablePostures if it is then more than 45 deg from the vertical, or if nobody moved for a minute.
    """
    if not seconds:
        raise UnusablePostures(why="no postures", cure="thigh axis", value=file_name)
    mean_g, deviation_g = (np.concatenate(each) for each in zip(*seconds, strict=True))
    moving_g = mean_g[deviation_g[:, axis] > MOVING_G]
    along = float(np.median(_normalise(moving_g)[:, axis])) if len(moving_g) >= LEAST_MOVING_S else 0.0
    if abs(along) < np.cos(np.radians(SEATED_DEG)):
        raise UnusablePostures(why="thigh axis", cure="thigh axis", value=file_name)
    return float(np.sign(along))


def _find_long(is_still: BoolArray, least_s: int) -> BoolArray:
    """Return the seconds in runs of at least this many seconds."""
    found = np.zeros(len(is_still), np.bool_)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_still, [False]]).astype(np.int8)))
    for first, stop in edges.reshape(-1, 2).tolist():
        found[first:stop] = stop - first >= least_s
    return found
