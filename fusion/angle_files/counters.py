"""Seconds from the counters that Xsens writes."""

import numpy as np

from fusion.angle_files.types import Vector
from fusion.errors import UnusableTime

COUNTER_SPAN = {"packetcounter": 2.0**16, "sampletimefine": 2.0**32}


def unwrap_counter(counter: Vector, span: float) -> Vector:
    """Undo the wraps of a counter that starts over at ``span``; a large step back is one.

    Raises
    ------
    UnusableTime
        A counter that goes back without wrapping, or is missing.
    """
    if not np.isfinite(counter).all():
        raise UnusableTime(why="missing")
    steps = np.diff(counter)
    wrapped = counter + span * np.concatenate([[0], np.cumsum(steps < -span / 2)])
    backwards = np.flatnonzero(np.diff(wrapped) <= 0)
    if len(backwards):
        raise UnusableTime(why="backwards", line=int(backwards[0] + 2))
    return np.asarray(wrapped - wrapped[0])
