"""Rest of the upper arm: hanging and slow, and for how long it has none (EXPOSURE.md A3).

Neutral and slow: elevation under 20 deg and generalised speed under 5 deg/s for 3 s or more without a gap;
where there is no vertical (a ready angle series) the speed of inclination takes its place. This says where
the arm was, not that its muscles rested.
"""

from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.exposure.types import Recovery
from fusion.recording import BoolArray

NEUTRAL_DEG = 20.0
SLOW_DPS = 5.0
SHORTEST_S = 3.0
# the sums: seconds and number of neutral and slow stays, seconds and number of slow ones, longest without
REST_S, RESTS, SLOW_S, SLOWS, WITHOUT_S = range(5)
# the state in rows: of the stay under way (neutral and slow, slow), and since the last rest ended
REST, SLOW, SINCE = range(3)

FloatVector = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RecoveryTally:
    """Sums over the day, shape (5,), filled in place; the state, shape (3,), is carried on."""

    sums: FloatVector = field(default_factory=lambda: np.zeros(5))
    state: NDArray[np.int64] = field(default_factory=lambda: np.zeros(3, np.int64))

    def add(self, angle_deg: FloatVector, valid: BoolArray, speeds_dps: FloatVector, rate_hz: float) -> None:
        """Count rows that follow those before; the speed of a row is that of the step to it, NaN for none."""
        _scan_rest(angle_deg, valid, speeds_dps, rate_hz, (self.sums, self.state))

    def end_segment(self, rate_hz: float) -> None:
        """Let a hole end all that is under way."""
        _end_run(rate_hz, self.sums, self.state)

    def summarise(self, analysed_s: float) -> Recovery:
        """Give shares of the analysed time and rates per hour of it."""
        percent, per_hour = 100.0 / analysed_s, 3600.0 / analysed_s
        return Recovery(
            neutral_slow_percent=float(self.sums[REST_S]) * percent,
            neutral_slow_per_hour=float(self.sums[RESTS]) * per_hour,
            slow_percent=float(self.sums[SLOW_S]) * percent,
            slow_per_hour=float(self.sums[SLOWS]) * per_hour,
            longest_without_s=float(self.sums[WITHOUT_S]),
        )


@njit(cache=True, nogil=True)
def _scan_rest(angle_deg, valid, speeds_dps, rate_hz, tally):  # type: ignore[no-untyped-def]
    """Grow the stays row by row; a row without a speed (the first of a run) is not slow."""
    sums, state = tally
    for i in range(len(angle_deg)):
        if not valid[i]:
            _end_run(rate_hz, sums, state)
            continue
        slow = speeds_dps[i] < SLOW_DPS
        state[SINCE] += 1
        if slow:
            state[SLOW] += 1
        elif state[SLOW] > 0:
            _end_slow(rate_hz, sums, state)
        if slow and angle_deg[i] < NEUTRAL_DEG:
            state[REST] += 1
        elif state[REST] > 0:
            _end_rest(rate_hz, sums, state, 1)


@njit(cache=True, nogil=True)
def _end_slow(rate_hz, sums, state):  # type: ignore[no-untyped-def]
    if state[SLOW] >= SHORTEST_S * rate_hz - 1e-3:
        sums[SLOW_S] += state[SLOW] / rate_hz
        sums[SLOWS] += 1
    state[SLOW] = 0


@njit(cache=True, nogil=True)
def _end_rest(rate_hz, sums, state, rows_after):  # type: ignore[no-untyped-def]
    """End a neutral and slow stay; if it was long enough, the time without rest starts anew after it."""
    if state[REST] >= SHORTEST_S * rate_hz - 1e-3:
        sums[REST_S] += state[REST] / rate_hz
        sums[RESTS] += 1
        sums[WITHOUT_S] = max(sums[WITHOUT_S], (state[SINCE] - rows_after - state[REST]) / rate_hz)
        state[SINCE] = rows_after
    state[REST] = 0


@njit(cache=True, nogil=True)
def _end_run(rate_hz, sums, state):  # type: ignore[no-untyped-def]
    _end_slow(rate_hz, sums, state)
    _end_rest(rate_hz, sums, state, 0)
    sums[WITHOUT_S] = max(sums[WITHOUT_S], state[SINCE] / rate_hz)
    state[SINCE] = 0
