"""Simulated recordings with their truth, and comparisons of both."""

from dataclasses import dataclass
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.comparison.change import TaskFigures
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, Recording, Segment
from acromion.fusion.simulation import SimulatedShift
from acromion.fusion.simulation.body import ArmState
from acromion.fusion.simulation.sensor import PARTS, Device, Part, draw_errors, quantise, sense
from acromion.fusion.simulation.shift import START
from tests.simulated_shifts import play_shift
from tests.simulated_tasks import LOWERING_S

DEVICES: tuple[Device, ...] = ("gt9x", "lsm9ds1")
NAMES = {"gt9x": "GT9X", "lsm9ds1": "LSM9DS1"}


@dataclass(frozen=True, slots=True, eq=False)
class Worn:
    """A simulated recording in memory, and the arm's exact elevation at each sample, (n,), deg."""

    shift: SimulatedShift
    recording: Recording
    truth_deg: NDArray[np.float64]


def wear(shift: SimulatedShift) -> Worn:
    """Return a recording of the samples, rounded and clipped as by the device."""
    arrays = play_shift(shift)
    segment = Segment(0, arrays.rate_hz, arrays.acc_g, arrays.gyr_dps)
    return Worn(shift, _record(shift.part, shift.device, arrays.start, segment), arrays.elevation_deg)


def _record(part: Part, device: Device, start: datetime, segment: Segment) -> Recording:
    duration_us = round(len(segment) / segment.rate_hz * MICROSECONDS)
    return Recording(
        device, "0" * 64, start, None, duration_us, (segment,),
        acc_range_g=part.acc_range_g, gyr_range_dps=part.gyr_range_dps,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class WornDay:
    """A recording, the truth (n,), whether it was worn (n,), the pose windows, and the first axis (3,)."""

    recording: Recording
    truth_deg: Float64Array
    worn: BoolArray
    poses_s: tuple[tuple[float, float], ...]
    arm_axis: Float64Array


def record_motion(
    state: ArmState,
    rate_hz: float,
    device: Device,
    chance: np.random.Generator,
    poses_s: tuple[tuple[float, float], ...],
    *,
    worn: BoolArray | None = None,
    first: int = 0,
) -> WornDay:
    """Return the recording of a specimen of the device from row ``first`` on; by default always worn."""
    part, time_s = PARTS[device], np.arange(len(state.elevation_deg)) / rate_hz
    errors = draw_errors(part, rate_hz, time_s[-1], chance)
    readings = sense(state, errors, time_s, chance)
    acc = quantise(readings.acc_g, part.acc_g_per_lsb, part.acc_range_g) * np.float32(part.acc_g_per_lsb)
    gyr = quantise(readings.gyr_dps, part.gyr_dps_per_lsb, part.gyr_range_dps)
    gyr_dps = gyr * np.float32(part.gyr_dps_per_lsb)
    segment = Segment(0, rate_hz, acc[first:].astype(np.float32), gyr_dps[first:].astype(np.float32))
    recording = _record(part, device, START, segment)
    worn = np.ones(len(time_s), np.bool_) if worn is None else worn
    axis = errors.mounting @ np.array([0.0, 0.0, 1.0])
    return WornDay(recording, state.elevation_deg[first:], worn[first:], poses_s, axis)


def at_rows(values: NDArray[Any], count: int) -> NDArray[np.float64]:
    """Return values, one per sample, at the times of ``count`` rows that share the samples evenly."""
    if len(values) == count:
        return np.asarray(values, np.float64)
    places = np.arange(count) * (len(values) / count)
    return np.asarray(np.interp(places, np.arange(len(values)), values), np.float64)


def name_devices() -> str:
    """Return the devices in the order of the cells."""
    return " / ".join(NAMES[device] for device in DEVICES)


def find_rmse_deg(error_deg: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error_deg**2)))


def find_rows(worn: Worn, name: str) -> NDArray[np.bool_]:
    """Return the rows of all entries of the plan with this name, each until the arm hangs again."""
    rows = np.zeros(len(worn.truth_deg), dtype=np.bool_)
    for entry in worn.shift.plan:
        if entry.name == name:
            first, stop = (round(t * worn.shift.rate_hz) for t in (entry.start_s, entry.end_s + LOWERING_S))
            rows[first:stop] = True
    return rows


def compare(found_deg: NDArray[np.float64], truth_deg: NDArray[np.float64]) -> TaskFigures:
    error_deg = found_deg - truth_deg
    r = float(np.corrcoef(found_deg, truth_deg)[0, 1])
    return TaskFigures(r, find_rmse_deg(error_deg), float(np.abs(error_deg).mean()))
