"""Compute the readings of an ideal sensor from joint motion: a rigid upper arm on a shoulder on a trunk.

Frames: the room has z up; the body's x points forward, y to the left, z up; the arm's z points along the
upper arm towards the shoulder. The chain from the room to the arm is heading (about z), trunk flexion (about
y), the swing of gait (about -y), then shoulder: plane, elevation and axial rotation as tilt and torsion
(Bonev), that is Rz(plane) Ry(-elevation) Rz(axial - plane), so that an arm raised by 0 deg does not turn with
its plane.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from acromion.fusion.numba_kernels import njit
from acromion.fusion.recording import STANDARD_GRAVITY, Float64Array

# Joint motion as a sum of strokes and waves, so that every derivative is exact.
#
# A channel of the body (an angle or a displacement) is the sum of *strokes* and *waves*. A stroke moves it
# from one value to another along the minimum-jerk polynomial (Flash and Hogan, J Neurosci 1985;5:1688): twice
# continuously differentiable, at rest at both ends. Strokes may overlap, so a movement need not stop before
# the next one. A wave is a sinusoid that grows and fades along the same polynomial: gait, tremor.


class Channel(IntEnum):
    """The moving channels. Angles in deg, speed in m/s, sway of the pelvis in m.

    ELEVATION is relative to the trunk (it equals the angle to gravity only while the trunk is upright), PLANE
    is the vertical plane in which the arm is raised (0 forward, -90 to the right), AXIAL turns the arm about
    its own axis, SWING swings it forward in any plane, SPEED is that of walking along HEADING.
    """

    HEADING = 0
    FLEXION = 1
    PLANE = 2
    ELEVATION = 3
    AXIAL = 4
    SWING = 5
    SPEED = 6
    SWAY_FORWARD = 7
    SWAY_LEFT = 8
    SWAY_UP = 9


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """A motion that can be evaluated at any time.

    ``strokes``: shape (k, 4), by start: channel, start in s, duration in s, change of value.
    ``waves``: shape (w, 7), by start: channel, start in s, end in s, duration of growth and of fading in s,
    frequency in Hz, amplitude, phase in rad.
    """

    strokes: Float64Array
    waves: Float64Array


def play(motion: Motion, first_sample: int, sample_count: int, rate_hz: float) -> Float64Array:
    """Evaluate all channels at ``sample_count`` samples from ``first_sample`` on, on an even grid from 0 s.

    Returns
    -------
    Shape (channels, 3, count): value, first and second derivative by time, units of :class:`Channel`.
    """
    start_s, end_s = first_sample / rate_hz, (first_sample + sample_count) / rate_hz
    out = np.zeros((len(Channel), 3, sample_count))
    strokes = motion.strokes[: np.searchsorted(motion.strokes[:, 1], end_s)]
    over = strokes[:, 1] + strokes[:, 2] <= start_s
    base = np.bincount(strokes[over, 0].astype(np.int64), strokes[over, 3], len(Channel)).astype(np.float64)
    _add_strokes(strokes[~over], base, first_sample, rate_hz, out)
    waves = motion.waves[: np.searchsorted(motion.waves[:, 1], end_s)]
    _add_waves(waves[waves[:, 2] > start_s], first_sample, rate_hz, out)
    return out


@njit(cache=True, nogil=True)
def _ramp(x: float) -> tuple[float, float, float]:  # pragma: no cover - compiled
    """Return the minimum-jerk polynomial from 0 to 1 and its two derivatives; constant outside [0, 1]."""
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
    strokes: Float64Array, base: Float64Array, first_sample: int, rate_hz: float, out: Float64Array
) -> None:  # pragma: no cover - compiled
    """Add each stroke during its movement; its final change is a step, summed at the end."""
    count = out.shape[2]
    steps = np.zeros((out.shape[0], count))
    steps[:, 0] = base
    for k in range(strokes.shape[0]):
        channel, start_s, duration_s, change = int(strokes[k, 0]), strokes[k, 1], strokes[k, 2], strokes[k, 3]
        begin = max(0, int(np.ceil(start_s * rate_hz)) - first_sample)
        end = max(begin, int(np.ceil((start_s + duration_s) * rate_hz)) - first_sample)
        for i in range(begin, min(end, count)):
            value, rate, acceleration = _ramp(((first_sample + i) / rate_hz - start_s) / duration_s)
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
    """Return an envelope that grows for ``ramp_s`` after the start and fades for ``ramp_s`` at the end."""
    if time_s - start_s < end_s - time_s:
        value, rate, acceleration = _ramp((time_s - start_s) / ramp_s)
        return value, rate / ramp_s, acceleration / (ramp_s * ramp_s)
    value, rate, acceleration = _ramp((end_s - time_s) / ramp_s)
    return value, -rate / ramp_s, acceleration / (ramp_s * ramp_s)


@njit(cache=True, nogil=True)
def _add_waves(
    waves: Float64Array, first_sample: int, rate_hz: float, out: Float64Array
) -> None:  # pragma: no cover - compiled
    """Add each wave by the product rule: envelope times sinusoid."""
    count = out.shape[2]
    for k in range(waves.shape[0]):
        channel, start_s, end_s, ramp_s = int(waves[k, 0]), waves[k, 1], waves[k, 2], waves[k, 3]
        turn, amplitude, phase = 2.0 * np.pi * waves[k, 4], waves[k, 5], waves[k, 6]
        begin = max(0, int(np.ceil(start_s * rate_hz)) - first_sample)
        end = min(count, int(np.ceil(end_s * rate_hz)) - first_sample)
        for i in range(begin, end):
            time_s = (first_sample + i) / rate_hz
            swell, swell_rate, swell_acceleration = _envelope(time_s, start_s, end_s, ramp_s)
            angle = turn * (time_s - start_s) + phase
            sine, cosine = amplitude * np.sin(angle), amplitude * np.cos(angle)
            out[channel, 0, i] += swell * sine
            out[channel, 1, i] += swell_rate * sine + swell * turn * cosine
            out[channel, 2, i] += (
                swell_acceleration - swell * turn * turn
            ) * sine + 2.0 * swell_rate * turn * cosine


@dataclass(frozen=True, slots=True)
class Body:
    """Positions in m. The defaults are those of an adult of average height.

    ``shoulder_m``: the right shoulder relative to the point about which the trunk bends.
    ``sensor_m``: the sensor relative to the shoulder, on the lateral side of the distal upper arm.
    ``field_ut``: the Earth's magnetic field in the room (approximately Quebec City: x north, z up).
    """

    shoulder_m: tuple[float, float, float] = (0.0, -0.18, 0.45)
    sensor_m: tuple[float, float, float] = (0.0, -0.05, -0.23)
    field_ut: tuple[float, float, float] = (16.5, 0.0, -50.5)


@dataclass(frozen=True, slots=True, eq=False)
class ArmState:
    """The readings of an ideal sensor aligned with the arm, and the truth.

    ``acc_g``: shape (n, 3): specific force, +1 g along the zenith at rest.
    ``gyr_dps``: shape (n, 3): angular rate of the arm in its own frame.
    ``field_ut``: shape (n, 3): the magnetic field in the arm's frame.
    ``elevation_deg``: shape (n,): angle between the arm and gravity, 0 hanging, 180 overhead. Exact.
    """

    acc_g: Float64Array
    gyr_dps: Float64Array
    field_ut: Float64Array
    elevation_deg: Float64Array


def compute_readings(channels: Float64Array, body: Body) -> ArmState:
    """Derive the readings of an ideal sensor from the channels of :func:`play`.

    The pelvis is accelerated by walking (change of speed, speed times rate of turn) and by its sway, both in
    the heading frame. The trunk's rotation accelerates the shoulder, the arm's rotation the sensor.
    """
    count = channels.shape[2]
    felt, elevation_deg = np.empty((count, 9)), np.empty(count)
    _compute_readings(
        channels, np.array([body.shoulder_m, body.sensor_m, body.field_ut]), felt, elevation_deg
    )
    return ArmState(felt[:, 0:3], felt[:, 3:6], felt[:, 6:9], elevation_deg)


_RATE, _ACCELERATION, _FORCE, _ZENITH, _FIELD = 0, 1, 2, 3, 4
_HEADING, _FLEXION, _PLANE = int(Channel.HEADING), int(Channel.FLEXION), int(Channel.PLANE)
_ELEVATION, _AXIAL = int(Channel.ELEVATION), int(Channel.AXIAL)
_SWING, _SPEED = int(Channel.SWING), int(Channel.SPEED)
_SWAY = int(Channel.SWAY_FORWARD)
_Y, _Z = 1, 2


@njit(cache=True, nogil=True)
def _turn(
    seen: Float64Array, axis: int, angle_rad: float, rate_rad_s: float, acceleration_rad_s2: float
) -> None:  # pragma: no cover - compiled
    """Transform to a frame turned about ``axis``: the rows of ``seen`` are vectors in that frame.

    With A the joint's rotation and e its axis: w' = A^T w + q' e, and dw'/dt = A^T dw/dt + q'' e - q' e x A^T
    w. Angles in rad.
    """
    a, b = (axis + 1) % 3, (axis + 2) % 3
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    for row in range(seen.shape[0]):
        u, v = seen[row, a], seen[row, b]
        seen[row, a], seen[row, b] = c * u + s * v, c * v - s * u
    seen[_ACCELERATION, a] += rate_rad_s * seen[_RATE, b]
    seen[_ACCELERATION, b] -= rate_rad_s * seen[_RATE, a]
    seen[_ACCELERATION, axis] += acceleration_rad_s2
    seen[_RATE, axis] += rate_rad_s


@njit(cache=True, nogil=True)
def _add_lever(seen: Float64Array, lever: Float64Array) -> None:  # pragma: no cover - compiled
    """Move along a rigid lever: dw/dt x l + w x (w x l)."""
    rate, acceleration = seen[_RATE], seen[_ACCELERATION]
    along = rate[0] * lever[0] + rate[1] * lever[1] + rate[2] * lever[2]
    square = rate[0] * rate[0] + rate[1] * rate[1] + rate[2] * rate[2]
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        tangential = acceleration[b] * lever[c] - acceleration[c] * lever[b]
        seen[_FORCE, a] += tangential + rate[a] * along - square * lever[a]


@njit(cache=True, nogil=True)
def _stand(seen: Float64Array, q: Float64Array, field: Float64Array) -> None:  # pragma: no cover - compiled
    """Start in the heading frame (``q``: channels x derivatives, rad)."""
    seen[:] = 0.0
    seen[_FIELD] = field
    seen[_ZENITH, 2] = 1.0
    _turn(seen, _Z, q[_HEADING, 0], q[_HEADING, 1], q[_HEADING, 2])
    seen[_FORCE, 0] = q[_SPEED, 1] + q[_SWAY, 2]
    seen[_FORCE, 1] = q[_SPEED, 0] * q[_HEADING, 1] + q[_SWAY + 1, 2]
    seen[_FORCE, 2] = STANDARD_GRAVITY + q[_SWAY + 2, 2]


@njit(cache=True, nogil=True)
def _compute_readings(
    channels: Float64Array, levers: Float64Array, felt: Float64Array, elevation: Float64Array
) -> None:  # pragma: no cover - compiled
    """Evaluate the chain for each sample; ``felt`` (n, 9) receives force in g, rate in dps, field in uT."""
    seen = np.empty((5, 3))
    degree = np.pi / 180.0
    for i in range(channels.shape[2]):
        q = channels[:, :, i].copy()
        q[:_SPEED] *= degree
        _stand(seen, q, levers[2])
        _turn(seen, _Y, q[_FLEXION, 0], q[_FLEXION, 1], q[_FLEXION, 2])
        _add_lever(seen, levers[0])
        _turn(seen, _Y, -q[_SWING, 0], -q[_SWING, 1], -q[_SWING, 2])
        _turn(seen, _Z, q[_PLANE, 0], q[_PLANE, 1], q[_PLANE, 2])
        _turn(seen, _Y, -q[_ELEVATION, 0], -q[_ELEVATION, 1], -q[_ELEVATION, 2])
        spin = q[_AXIAL] - q[_PLANE]
        _turn(seen, _Z, spin[0], spin[1], spin[2])
        _add_lever(seen, levers[1])
        felt[i, 0:3] = seen[_FORCE] / STANDARD_GRAVITY
        felt[i, 3:6] = seen[_RATE] / degree
        felt[i, 6:9] = seen[_FIELD]
        zenith = seen[_ZENITH]
        elevation[i] = np.arctan2(np.hypot(zenith[0], zenith[1]), zenith[2]) / degree
