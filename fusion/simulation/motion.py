"""Joint motion as a score of strokes and waves, so that every derivative is exact.

A channel of the body (an angle or a displacement) is the sum of *strokes* and *waves*. A stroke carries it
from one value to another along the minimum-jerk polynomial (Flash and Hogan, J Neurosci 1985;5:1688): twice
continuously differentiable, at rest at both ends. Strokes may overlap, so that a movement need not stop
before the next begins. A wave is a sinusoid that swells and fades along the same polynomial: gait, tremor.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Channel(IntEnum):
    """What moves. Angles in deg, speed in m/s, sway of the pelvis in m.

    ELEVATION is relative to the trunk (it equals the angle to gravity only while the trunk is upright), PLANE
    is the vertical plane in which the arm is raised (0 forward, -90 to the right), AXIAL turns the arm about
    itself, SPEED is that of walking along HEADING.
    """

    HEADING = 0
    FLEXION = 1
    PLANE = 2
    ELEVATION = 3
    AXIAL = 4
    SPEED = 5
    SWAY_FORWARD = 6
    SWAY_LEFT = 7
    SWAY_UP = 8


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A score, ready to be played at any instants.

    Attributes
    ----------
    strokes
        Shape (k, 4), in order of start: channel, start in s, duration in s, change of value.
    waves
        Shape (w, 7), in order of start: channel, start in s, end in s, length of the swelling and of the
        fading in s, frequency in Hz, amplitude, phase in rad.
    """

    strokes: FloatArray
    waves: FloatArray


def play(motion: Motion, first: int, count: int, rate_hz: float) -> FloatArray:
    """Evaluate all channels at samples ``first`` to ``first + count`` of an even grid that starts at 0 s.

    Returns
    -------
    Shape (channels, 3, count): value, first and second derivative by time, units of :class:`Channel`.
    """
    start_s, end_s = first / rate_hz, (first + count) / rate_hz
    out = np.zeros((len(Channel), 3, count))
    strokes = motion.strokes[: np.searchsorted(motion.strokes[:, 1], end_s)]
    over = strokes[:, 1] + strokes[:, 2] <= start_s
    base = np.bincount(strokes[over, 0].astype(np.int64), strokes[over, 3], len(Channel)).astype(np.float64)
    _add_strokes(strokes[~over], base, first, rate_hz, out)
    waves = motion.waves[: np.searchsorted(motion.waves[:, 1], end_s)]
    _add_waves(waves[waves[:, 2] > start_s], first, rate_hz, out)
    return out


@njit(cache=True, nogil=True)
def _ramp(x: float) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Give the minimum-jerk polynomial from 0 to 1 and its two derivatives; constant outside [0, 1]."""
    if x <= 0.0:
        return 0.0, 0.0, 0.0
    if x >= 1.0:
        return 1.0, 0.0, 0.0
    return (
        x * x * x * (10.0 + x * (6.0 * x - 15.0)),
        30.0 * x * x * (1.0 - x) * (1.0 - x),
        60.0 * x * (1.0 - x) * (1.0 - 2.0 * x),
    )


@njit(cache=True, nogil=True)
def _add_strokes(
    strokes: FloatArray, base: FloatArray, first: int, rate_hz: float, out: FloatArray
) -> None:  # pragma: no cover - compiled
    """Add each stroke where it moves; what it leaves behind is a step, summed up at the end."""
    count = out.shape[2]
    steps = np.zeros((out.shape[0], count))
    steps[:, 0] = base
    for k in range(strokes.shape[0]):
        channel, start_s, duration_s, change = int(strokes[k, 0]), strokes[k, 1], strokes[k, 2], strokes[k, 3]
        begin = max(0, int(np.ceil(start_s * rate_hz)) - first)
        end = max(begin, int(np.ceil((start_s + duration_s) * rate_hz)) - first)
        for i in range(begin, min(end, count)):
            value, rate, acceleration = _ramp(((first + i) / rate_hz - start_s) / duration_s)
            out[channel, 0, i] += change * value
            out[channel, 1, i] += change * rate / duration_s
            out[channel, 2, i] += change * acceleration / (duration_s * duration_s)
        if end < count:
            steps[channel, end] += change
    for channel in range(out.shape[0]):
        total = 0.0
        for i in range(count):
            total += steps[channel, i]
            out[channel, 0, i] += total


@njit(cache=True, nogil=True)
def _envelope(
    time_s: float, start_s: float, end_s: float, ramp_s: float
) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Swell over ``ramp_s`` after the start, fade over ``ramp_s`` before the end."""
    if time_s - start_s < end_s - time_s:
        value, rate, acceleration = _ramp((time_s - start_s) / ramp_s)
        return value, rate / ramp_s, acceleration / (ramp_s * ramp_s)
    value, rate, acceleration = _ramp((end_s - time_s) / ramp_s)
    return value, -rate / ramp_s, acceleration / (ramp_s * ramp_s)


@njit(cache=True, nogil=True)
def _add_waves(
    waves: FloatArray, first: int, rate_hz: float, out: FloatArray
) -> None:  # pragma: no cover - compiled
    """Add each wave by the product rule: envelope times sinusoid."""
    count = out.shape[2]
    for k in range(waves.shape[0]):
        channel, start_s, end_s, ramp_s = int(waves[k, 0]), waves[k, 1], waves[k, 2], waves[k, 3]
        turn, amplitude, phase = 2.0 * np.pi * waves[k, 4], waves[k, 5], waves[k, 6]
        begin = max(0, int(np.ceil(start_s * rate_hz)) - first)
        end = min(count, int(np.ceil(end_s * rate_hz)) - first)
        for i in range(begin, end):
            time_s = (first + i) / rate_hz
            swell, swell_rate, swell_acceleration = _envelope(time_s, start_s, end_s, ramp_s)
            angle = turn * (time_s - start_s) + phase
            sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
            out[channel, 0, i] += swell * sine
            out[channel, 1, i] += swell_rate * sine + swell * turn * cosine
            out[channel, 2, i] += (
                swell_acceleration - swell * turn * turn
            ) * sine + 2.0 * swell_rate * turn * cosine
