"""How the angle that was shown live differs from the one that the report gives afterwards."""

from array import array
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fusion.elevation import Elevation
from fusion.live.session import THRESHOLDS_DEG, LiveRows
from fusion.recording import MICROSECONDS, Float64Array

KEPT_HZ = 10.0
"""So often the shown angle is kept: 8 h take 3.5 MB."""


class ShownAngles:
    """The angles of a session, thinned to :data:`KEPT_HZ`."""

    def __init__(self) -> None:
        self._time_us = array("q")
        self._angle_deg = array("f")
        self._next_us = 0

    def keep(self, rows: LiveRows) -> None:
        """Take the rows of the next frames."""
        step_us = round(MICROSECONDS / KEPT_HZ)
        for row in np.flatnonzero(rows.valid & (rows.time_us >= self._next_us)).tolist():
            time_us = int(rows.time_us[row])
            if time_us >= self._next_us:
                self._time_us.append(time_us)
                self._angle_deg.append(float(rows.elevation_deg[row]))
                self._next_us = time_us - time_us % step_us + step_us

    def read(self) -> tuple[Float64Array, Float64Array]:
        """Return the times, s, and the angles, deg, shapes (n,)."""
        return np.array(self._time_us) / MICROSECONDS, np.array(self._angle_deg, np.float64)


@dataclass(frozen=True, slots=True)
class LiveDifference:
    """Live against the report, at the same moments.

    ``compared_s``: seconds at which both are known.
    ``rmse_deg``, ``bias_deg``: root mean square and mean of live less report.
    ``live_percent``, ``report_percent``: shares of that time below 30 deg, from 30, from 60 and from 90 deg
    on.
    """

    compared_s: float
    rmse_deg: float
    bias_deg: float
    live_percent: tuple[float, ...]
    report_percent: tuple[float, ...]


def compare_shown(shown: ShownAngles, elevation: Elevation) -> LiveDifference | None:
    """Compare what was shown with the angle of the report; None where no moment has both."""
    time_s, live_deg = shown.read()
    report_deg = _read_at(elevation, time_s)
    both = np.isfinite(report_deg)
    if not both.any():
        return None
    live_deg, report_deg = live_deg[both], report_deg[both]
    error_deg = live_deg - report_deg
    return LiveDifference(
        float(both.sum() / KEPT_HZ),
        float(np.sqrt(np.mean(error_deg**2))),
        float(error_deg.mean()),
        _divide(live_deg),
        _divide(report_deg),
    )


def _read_at(elevation: Elevation, time_s: Float64Array) -> Float64Array:
    """Return the angle of the row nearest to each time; NaN in holes and where it is not valid."""
    found = np.full(len(time_s), np.nan)
    for segment in elevation.segments:
        rows = np.rint((time_s - segment.start_us / MICROSECONDS) * segment.rate_hz).astype(np.int64)
        inside = (rows >= 0) & (rows < len(segment))
        angle_deg = np.where(segment.valid, segment.elevation_deg, np.nan)
        found[inside] = angle_deg[rows[inside]]
    return found


def _divide(angle_deg: Float64Array) -> tuple[float, ...]:
    edges_deg = (-np.inf, *THRESHOLDS_DEG, np.inf)
    return tuple(
        100.0 * float(np.mean((angle_deg >= low) & (angle_deg < high))) for low, high in pairwise(edges_deg)
    )
