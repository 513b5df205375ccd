"""Whether gyroscope and accelerometer share one right-handed frame, as the motion itself shows it.

Gravity, seen from a turning sensor, turns backwards: ``da/dt = -(w x a)``. In a left-handed frame it turns
forwards, and the live angle is wrong while the arm moves. A file is put right by the same equation
(:mod:`fusion.checks.axes`); a stream is only doubted.
"""

import numpy as np
from numpy.typing import NDArray

from fusion.recording import Float64Array
from fusion.sensor.model import RADIANS

BLOCK_S = 0.1
SLOWEST_DPS = 20.0
NEAR_1_G = 0.25
ENOUGH_G2 = 0.5
"""Of turned gravity, squared and summed: about five seconds at 60 deg/s."""
LARGEST_SLOPE = -0.5
"""Gravity turned as foreseen has the slope 1, in a left-handed frame -1."""
LEAST_EXPLAINED = 0.5
"""Of what was seen, by the wrong turn: violent movement turns gravity any way, but by no rule."""


Samples = NDArray[np.float32]


class FrameWatch:
    """Compares how gravity turns with how the gyroscope says it should, in blocks of 0.1 s."""

    def __init__(self, rate_hz: float) -> None:
        self._rows = max(2, round(BLOCK_S * rate_hz))
        self._block_s = self._rows / rate_hz
        self._gathered = np.empty((0, 6))
        self._before: Float64Array | None = None
        self._agreed_g2 = self._foreseen_g2 = self._seen_g2 = 0.0

    @property
    def is_doubtful(self) -> bool:
        """Whether enough motion has been seen, and gravity turned the other way."""
        if self._foreseen_g2 < ENOUGH_G2 or self._agreed_g2 > LARGEST_SLOPE * self._foreseen_g2:
            return False
        return self._agreed_g2**2 > LEAST_EXPLAINED * self._foreseen_g2 * self._seen_g2

    def take(self, acc_g: Samples, gyr_dps: Samples) -> None:
        """Take the next samples of one unbroken run, shapes (n, 3)."""
        self._gathered = np.concatenate([self._gathered, np.hstack([acc_g, gyr_dps]).astype(np.float64)])
        whole = len(self._gathered) // self._rows
        blocks = self._gathered[: whole * self._rows].reshape(whole, self._rows, 6).mean(axis=1)
        self._gathered = self._gathered[whole * self._rows :]
        for block in blocks:
            if self._before is not None:
                self._compare(self._before, block)
            self._before = block

    def break_off(self) -> None:
        """Note a hole: what follows is no continuation."""
        self._gathered, self._before = np.empty((0, 6)), None

    def _compare(self, before: Float64Array, after: Float64Array) -> None:
        middle = 0.5 * (before + after)
        rate_dps, gravity_g = middle[3:], middle[:3]
        if np.linalg.norm(rate_dps) < SLOWEST_DPS or abs(np.linalg.norm(gravity_g) - 1.0) > NEAR_1_G:
            return
        foreseen_g = -np.cross(RADIANS * rate_dps, gravity_g) * self._block_s
        seen_g = after[:3] - before[:3]
        self._agreed_g2 += float(foreseen_g @ seen_g)
        self._seen_g2 += float(seen_g @ seen_g)
        self._foreseen_g2 += float(foreseen_g @ foreseen_g)
