"""The stretches of a recording in which the sensor was worn without being taken off.

A recording is cut where the sensor may have been off the arm: a table of five minutes or more
(:func:`fusion.pose.windows.find_tables`), or a hole as long.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.moments import Moments, find_calm_moments, find_striding_moments
from fusion.sensor.stillness import QuarterSeconds

HOLE_S = 300.0
LEAST_SHARE = 0.15
"""Of the calm moments of the longest stretch: one with fewer is a sensor in a bag or in a hand."""
Cut = tuple[float, float]
"""Start and end of a stretch in which the sensor may have been off, s."""


@dataclass(frozen=True, slots=True, eq=False)
class Wear:
    """A stretch of wear, at ``worn_from_s`` at the earliest; ``off_s``: how long it was off before.

    ``calm``: how the sensor saw gravity; ``strides``: while the wearer seemed to walk.
    """

    start_s: float
    end_s: float
    worn_from_s: float
    off_s: float
    calm: Moments
    strides: Moments


def divide_by_wear(
    blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection, tables_s: Sequence[Cut]
) -> tuple[Wear, ...]:
    """Return the stretches of wear worth the name, one at least, which cover the whole recording."""
    ends_s = [(run.start_s, run.start_s + len(run.acc) * run.block_s) for run in blocks]
    holes_s = [(before[1], after[0]) for before, after in pairwise(ends_s) if after[0] - before[1] >= HOLE_S]
    cuts = sorted([*tables_s, *holes_s])
    calm, strides = find_calm_moments(blocks, accelerometer), find_striding_moments(blocks, accelerometer)
    for off_s, on_s in cuts:
        calm = calm.select((calm.time_s <= off_s) | (calm.time_s >= on_s))
    edges_s = [-np.inf, *((off_s + on_s) / 2.0 for off_s, on_s in cuts), np.inf]
    worn = [len(calm.within(*span_s).up) for span_s in pairwise(edges_s)]
    opened_s = blocks[0].start_s if blocks else 0.0
    openings = [(opened_s, opened_s), *cuts]
    kept = [k for k, count in enumerate(worn) if count >= LEAST_SHARE * max(worn)]
    starts_s = [-np.inf, *(edges_s[k] for k in kept[1:]), np.inf]
    return tuple(
        Wear(
            *span_s,
            openings[k][1],
            openings[k][1] - openings[k][0],
            calm.within(*span_s),
            strides.within(*span_s),
        )
        for k, span_s in zip(kept, pairwise(starts_s), strict=True)
    )


def find_wear(wears: Sequence[Wear], time_s: float) -> Wear:
    """Return the stretch of wear that a time lies in."""
    return next(wear for wear in reversed(wears) if wear.start_s <= time_s)
