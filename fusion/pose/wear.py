"""The stretches of a recording in which the sensor was worn without being taken off.

A recording is cut where the sensor may have been off the arm: ten minutes or more in which, over 10 s, no
axis of the accelerometer has a standard deviation of 0.013 g (as in ``fusion.quality.time_account``), or a
hole of five minutes.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.moments import Moments, find_calm_moments, find_striding_moments
from fusion.sensor.stillness import QuarterSeconds, summarise_windows
from fusion.still_limits import OFF_THE_ARM

OFF_S, HOLE_S = 600.0, 300.0
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
    blocks: Sequence[QuarterSeconds], accelerometer: AccelerometerCorrection
) -> tuple[Wear, ...]:
    """Return the stretches of wear worth the name, one at least, which cover the whole recording."""
    cuts = _find_cuts(blocks)
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


def _find_cuts(blocks: Sequence[QuarterSeconds]) -> list[Cut]:
    cuts = [cut for run in blocks for cut in _find_off(run)]
    for run, following in pairwise(blocks):
        end_s = run.start_s + len(run.acc) * run.block_s
        if following.start_s - end_s >= HOLE_S:
            cuts.append((end_s, following.start_s))
    return sorted(cuts)


def _find_off(run: QuarterSeconds) -> list[Cut]:
    """Return the stretches of one run in which every window is still."""
    table = summarise_windows([run], OFF_THE_ARM.window_s)
    still = np.concatenate([[False], table.acc_sd_g < OFF_THE_ARM.acc_sd_g, [False]])
    starts, stops = np.flatnonzero(still[1:] & ~still[:-1]), np.flatnonzero(~still[1:] & still[:-1])
    long_enough = (stops - starts) * run.block_s + OFF_THE_ARM.window_s >= OFF_S
    first_s = run.start_s + starts[long_enough] * run.block_s
    stop_s = run.start_s + (stops[long_enough] - 1) * run.block_s + OFF_THE_ARM.window_s
    return list(zip(first_s.tolist(), stop_s.tolist(), strict=True))
