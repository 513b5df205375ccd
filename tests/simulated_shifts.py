"""Simulated shifts in memory, and worn by a sensor without errors."""

from dataclasses import dataclass, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.recording import Float64Array
from acromion.fusion.simulation import SimulatedShift
from acromion.fusion.simulation.sensor import CALIBRATION_K, KNOT_S, SensorErrors, draw_mounting


@dataclass(frozen=True, slots=True, eq=False)
class ShiftArrays:
    """A whole recording in memory.

    ``acc_g`` and ``gyr_dps``: shape (n, 3), float32, rounded and clipped as the part does (not where the
    sensor is perfect); ``elevation_deg``: shape (n,), exact.
    """

    rate_hz: float
    start: datetime
    acc_g: NDArray[np.float32]
    gyr_dps: NDArray[np.float32]
    elevation_deg: Float64Array


def play_shift(shift: SimulatedShift) -> ShiftArrays:
    """Play the whole day into memory (36 bytes a sample)."""
    acc_g = np.empty((shift.sample_count, 3), np.float32)
    gyr_dps = np.empty((shift.sample_count, 3), np.float32)
    elevation_deg = np.empty(shift.sample_count)
    is_perfect = shift.errors.acc_noise_g == 0.0
    for block in shift.blocks():
        rows = slice(block.first_sample, block.first_sample + len(block.time_s))
        elevation_deg[rows] = block.state.elevation_deg
        if is_perfect:
            acc_g[rows], gyr_dps[rows] = block.readings.acc_g, block.readings.gyr_dps
        else:
            acc, gyr = shift.count(block.readings)
            acc_g[rows] = acc.astype(np.float64) * shift.part.acc_g_per_lsb
            gyr_dps[rows] = gyr.astype(np.float64) * shift.part.gyr_dps_per_lsb
    return ShiftArrays(shift.rate_hz, shift.start, acc_g, gyr_dps, elevation_deg)


def make_perfect(shift: SimulatedShift) -> SimulatedShift:
    """Return the same day on a sensor without error, noise or resolution; the true rate stays."""
    chance = np.random.default_rng([shift.seed, 2])
    chance.uniform(*shift.part.rate_error)
    return replace(shift, errors=draw_perfect(shift.plan[-1].end_s, chance))


def draw_perfect(duration_s: float, chance: np.random.Generator) -> SensorErrors:
    """Draw only a mounting."""
    knots = int(duration_s / KNOT_S) + 2
    still, nothing = np.zeros((knots, 3)), np.zeros(3)
    temperature_c = np.full(knots, CALIBRATION_K)
    return SensorErrors(
        draw_mounting(chance), np.eye(3), np.eye(3), nothing, nothing, still, still, temperature_c, 0.0, 0.0
    )
