"""From a simulated wearing of the sensor to a recording, its truth, and what is compared in both."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.recording import MICROSECONDS, Recording, Segment
from fusion.simulation import SimulatedShift
from fusion.simulation.sensor import Device
from fusion.simulation.tasks import LOWERING_S
from fusion.source_paper import TaskFigures

DEVICES: tuple[Device, ...] = ("gt9x", "lsm9ds1")
NAMES = {"gt9x": "GT9X", "lsm9ds1": "LSM9DS1"}


@dataclass(frozen=True, slots=True, eq=False)
class Worn:
    """A simulated recording in memory, and the arm's exact elevation at each sample, (n,), deg."""

    shift: SimulatedShift
    recording: Recording
    truth_deg: NDArray[np.float64]


def wear(shift: SimulatedShift) -> Worn:
    """Play it and put the samples, as the device rounds and clips them, into a recording."""
    arrays = shift.in_arrays()
    segment = Segment(0, arrays.rate_hz, arrays.acc_g, arrays.gyr_dps)
    recording = Recording(
        shift.device,
        "0" * 64,
        arrays.start,
        None,
        round(len(segment) / arrays.rate_hz * MICROSECONDS),
        (segment,),
        acc_range_g=shift.part.acc_range_g,
        gyr_range_dps=shift.part.gyr_range_dps,
    )
    return Worn(shift, recording, arrays.elevation_deg)


def at_rows(values: NDArray[Any], count: int) -> NDArray[np.float64]:
    """Values, one for each sample, at the stamps of ``count`` rows of angle that share the samples evenly."""
    if len(values) == count:
        return np.asarray(values, np.float64)
    places = np.arange(count) * (len(values) / count)
    return np.asarray(np.interp(places, np.arange(len(values)), values), np.float64)


def find_rmse_deg(error_deg: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(error_deg**2)))


def find_rows(worn: Worn, name: str) -> NDArray[np.bool_]:
    """Rows of all entries of the plan with this name, each until the arm hangs again."""
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
