"""Small recordings to order, without noise and with their exact truth, and ready angle series."""

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.recording import MICROSECONDS, Recording, Segment
from acromion.fusion.simulation.activities import Choreography
from acromion.fusion.simulation.body import Body, Channel, compute_readings, play

START = datetime(2026, 3, 2, 7, 0, 0)  # noqa: DTZ001 - a device's own clock, which has no zone


@dataclass(frozen=True, slots=True, eq=False)
class MadeRecording:
    """A recording of one segment and the exact elevation at each of its samples, shape (n,)."""

    recording: Recording
    elevation_deg: NDArray[np.float64]


def hold(
    *poses: tuple[float, float],
    rate_hz: float = 100.0,
    change_s: float = 1.0,
    plane_deg: float = -45.0,
    mounting: NDArray[np.float64] | None = None,
) -> MadeRecording:
    """Hold each (elevation_deg, seconds) in turn: ``hold((0, 60), (95, 60), rate_hz=500)``.

    The change from one to the next lasts ``change_s`` and is centred on the boundary, so that the arm passes
    half way exactly there and the whole lasts the sum of the seconds. Sensor 0.235 m from the shoulder;
    ``mounting``, shape (3, 3), turns the arm's frame (z towards the shoulder) into the sensor's.
    """
    body = Choreography()
    body.move(1e-6, {Channel.PLANE: plane_deg, Channel.ELEVATION: poses[0][0]}, after_s=-1.0)
    for (_, seconds), (elevation_deg, _) in itertools.pairwise(poses):
        body.wait(seconds)
        body.move(change_s, {Channel.ELEVATION: elevation_deg}, after_s=-change_s / 2)
    count = round(sum(seconds for _, seconds in poses) * rate_hz)
    state = compute_readings(play(body.finish(), 0, count, rate_hz), Body())
    turn = np.eye(3) if mounting is None else mounting
    recording = record(state.acc_g @ turn.T, state.gyr_dps @ turn.T, rate_hz)
    return MadeRecording(recording, state.elevation_deg)


def move_arm(
    elevation_deg: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    seconds: float,
    *,
    rate_hz: float = 100.0,
    distance_m: float = 0.23,
) -> MadeRecording:
    """Raise the arm in one plane along any smooth curve theta(t); the sensor sits at a distance r.

    With the arm's z towards the shoulder and y the axis of turning:
    a_z = g cos(theta) + r theta'^2, a_x = g sin(theta) + r theta'', gyro_y = -theta'.
    The derivatives of the curve are taken by central differences of 0.1 ms.
    """
    time_s, step_s = np.arange(round(seconds * rate_hz)) / rate_hz, 1e-4
    before, now, after = (np.radians(elevation_deg(time_s + k * step_s)) for k in (-1, 0, 1))
    rate, acceleration = (after - before) / (2 * step_s), (after - 2 * now + before) / step_s**2
    nothing, reach_g = np.zeros_like(now), distance_m / 9.80665
    acc_x, acc_z = np.sin(now) + reach_g * acceleration, np.cos(now) + reach_g * rate**2
    acc_g = np.stack([acc_x, nothing, acc_z], axis=1)
    gyr_dps = np.stack([nothing, -np.degrees(rate), nothing], axis=1)
    return MadeRecording(record(acc_g, gyr_dps, rate_hz), elevation_deg(time_s))


def record(acc_g: NDArray[np.float64], gyr_dps: NDArray[np.float64], rate_hz: float) -> Recording:
    """Make a recording of one segment from arrays, shapes (n, 3)."""
    segment = Segment(0, rate_hz, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    return Recording("other", "0" * 64, START, None, segment.duration_us, (segment,))


def elevate(
    *runs: NDArray[np.float64], rate_hz: float = 100.0, hole_s: float = 1.0, valid: bool = True
) -> Elevation:
    """Make an elevation of ready angles, one segment for each run, with holes of ``hole_s`` between them."""
    segments, start_us = [], 0
    for run in runs:
        flags = np.full(len(run), valid)
        segments.append(ElevationSegment(start_us, rate_hz, run.astype(np.float32), flags))
        start_us += round((len(run) / rate_hz + hole_s) * MICROSECONDS)
    return Elevation(tuple(segments), None)
