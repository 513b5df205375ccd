"""Simulated days on which the sensor turns on the arm while it is worn, and what is made of them."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.validation.worn import Worn, find_rmse_deg
from fusion.elevation import estimate_elevation
from fusion.pipeline import POSE_SIGMA_DEG
from fusion.pose.calibrate import calibrate
from fusion.recording import MICROSECONDS, Recording, Segment
from fusion.simulation import SimulatedShift, simulate_shift
from fusion.simulation.body import ArmState
from fusion.simulation.sensor import Device, sense

HOURS, RATE_HZ, ABRUPT_S = 2.0, 50.0, 0.5
BAND = 1.96
TELLING = frozenset({"W-REMOUNT", "W-SLIP-DOUBT", "W-POSE-APART", "W-POSE-DOUBT"})


@dataclass(frozen=True, slots=True)
class Turned:
    """One day: whether a turn was found, and what the angle is worth.

    ``is_named``: some caveat names it. ``ranged_percent``: valid rows within their range, the pose in it.
    ``turned_percent``: share of the rows between two turns that are valid.
    """

    is_found: bool
    is_named: bool
    valid_percent: float
    rmse_deg: float
    covered_percent: float
    ranged_percent: float = 0.0
    turned_percent: float = 0.0


def draw_across(chance: np.random.Generator) -> NDArray[np.float64]:
    """A direction across the arm, in its own frame."""
    about = chance.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(about), np.sin(about), 0.0])


@dataclass(frozen=True, slots=True)
class Turn:
    """``angle_deg`` about ``axis`` (arm's frame), from ``start_s`` on, within ``during_s``; back from
    ``back_s`` on, as fast.
    """

    angle_deg: float
    axis: NDArray[np.float64]
    start_s: float
    during_s: float
    back_s: float = np.inf

    def apply(self, state: ArmState, time_s: NDArray[np.float64]) -> ArmState:
        """What the sensor feels, seen from the frame in which it sat before."""
        there, back = (
            np.clip((time_s - at_s) / self.during_s, 0.0, 1.0) for at_s in (self.start_s, self.back_s)
        )
        turn = Rotation.from_rotvec(np.radians(self.angle_deg) * (there - back)[:, None] * self.axis)
        way = ((there > 0.0) & (there < 1.0)).astype(float) - ((back > 0.0) & (back < 1.0))
        slip_dps = (way * self.angle_deg / self.during_s)[:, None] * self.axis
        return replace(state, acc_g=turn.apply(state.acc_g), gyr_dps=turn.apply(state.gyr_dps) - slip_dps)


@cache
def _play(device: Device, seed: int, hours: float) -> tuple[SimulatedShift, tuple[ArmState, ...]]:
    shift = simulate_shift(device, hours, seed, RATE_HZ)
    return shift, tuple(block.state for block in shift.blocks())


def wear_turning(device: Device, seed: int, turn: Turn | None, hours: float = HOURS) -> Worn:
    """Play a day with the sensor turning as given; nothing else differs, down to the noise."""
    shift, states = _play(device, seed, hours)
    rows, first = [], 0
    for number, state in enumerate(states):
        time_s = (first + np.arange(len(state.elevation_deg))) / shift.rate_hz
        felt = turn.apply(state, time_s) if turn else state
        acc, gyr = shift.count(sense(felt, shift.errors, time_s, np.random.default_rng([seed, 3, number])))
        rows.append(np.hstack([acc * shift.part.acc_g_per_lsb, gyr * shift.part.gyr_dps_per_lsb]))
        first += len(time_s)
    both = np.concatenate(rows).astype(np.float32)
    segment = Segment(0, shift.rate_hz, both[:, :3].copy(), both[:, 3:].copy())
    duration_us = round(first / shift.rate_hz * MICROSECONDS)
    recording = Recording(device, "0" * 64, shift.start, None, duration_us, (segment,))
    return Worn(shift, recording, np.concatenate([state.elevation_deg for state in states]))


def measure(worn: Worn, turned_s: tuple[float, float] = (0.0, 0.0)) -> Turned:
    """Calibrate, fuse, and hold the valid rows against the truth; ``turned_s``: between two turns."""
    samples = calibrate(worn.recording, "n-pose")
    (found,) = estimate_elevation(samples).segments
    error_deg = (found.elevation_deg - worn.truth_deg)[found.valid]
    second = (np.arange(len(found)) / found.rate_hz).astype(np.int64)[found.valid]
    between = slice(*(round(at_s * found.rate_hz) for at_s in turned_s))
    sigma_deg = np.zeros(1) if found.sigma_deg is None else found.sigma_deg
    pose_deg = max(POSE_SIGMA_DEG, samples.calibration.sigma_deg)
    return Turned(
        bool(samples.remounts),
        any(flag.code in TELLING for flag in samples.flags),
        100.0 * float(found.valid.mean()),
        find_rmse_deg(error_deg),
        100.0 * float(np.mean(np.abs(error_deg) <= BAND * sigma_deg[second])),
        100.0 * float(np.mean(np.abs(error_deg) <= BAND * np.hypot(pose_deg, sigma_deg[second]))),
        100.0 * float(found.valid[between].mean()) if turned_s[1] else 0.0,
    )
