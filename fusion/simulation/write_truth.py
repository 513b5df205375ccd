"""Writes what is known exactly about a simulated recording: truth.parquet and truth.json."""

import json
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from fusion.numba_kernels import njit
from fusion.recording import Float64Array
from fusion.simulation.sensor import SensorErrors
from fusion.simulation.shift import SampleBlock, SimulatedShift

WholeNumbers = NDArray[np.int64]

EDGES_DEG = (0.0, 20.0, 30.0, 45.0, 60.0, 80.0, 90.0, 120.0, 150.0, 180.0)
THRESHOLDS_DEG = (30.0, 60.0, 90.0)
_SCHEMA = pa.schema([("time_s", pa.float64()), ("elevation_deg", pa.float64())])
_HALF_HYSTERESIS_DEG = 5.0


class TruthWriter:
    """Takes blocks, writes the angle on at once and adds up the true exposure; a context manager.

    ``truth.parquet`` holds every k-th sample, k such that the nominal rate comes to at most 100 Hz;
    ``truth.json`` sums over all samples, without any filter.
    """

    def __init__(self, folder: Path, shift: SimulatedShift) -> None:
        self.paths = (folder / "truth.parquet", folder / "truth.json")
        self._shift = shift
        self._every = max(1, int(np.ceil(shift.nominal_rate_hz / 100.0)))
        self._table = pq.ParquetWriter(self.paths[0], _SCHEMA)
        self._in_bins = np.zeros(len(EDGES_DEG) - 1, np.int64)
        self._above = np.zeros(len(THRESHOLDS_DEG), np.int64)
        self._entries = np.zeros(len(THRESHOLDS_DEG), np.int64)
        self._state = np.full(len(THRESHOLDS_DEG), -1, np.int64)
        self._clipped = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._table.close()
        if error is None:
            self.paths[1].write_text(json.dumps(self._describe(), indent=1) + "\n", encoding="utf-8")

    def write(self, block: SampleBlock) -> None:
        """Add a block."""
        elevation_deg = block.state.elevation_deg
        kept = slice(-block.first_sample % self._every, None, self._every)
        self._table.write_table(pa.table([block.time_s[kept], elevation_deg[kept]], schema=_SCHEMA))
        self._in_bins += np.histogram(elevation_deg, EDGES_DEG)[0]
        self._above += [int((elevation_deg >= threshold).sum()) for threshold in THRESHOLDS_DEG]
        for k, threshold_deg in enumerate(THRESHOLDS_DEG):
            entries, self._state[k] = count_entries(elevation_deg, threshold_deg, self._state[k])
            self._entries[k] += entries
        self._clipped += self._count_clipped(block)

    def _count_clipped(self, block: SampleBlock) -> int:
        """Count the samples of which any axis is beyond the range."""
        part, readings = self._shift.part, block.readings
        beyond = (np.abs(readings.acc_g) > part.acc_range_g) | (np.abs(readings.gyr_dps) > part.gyr_range_dps)
        return int(beyond.any(axis=1).sum())

    def _describe(self) -> dict[str, Any]:
        shift = self._shift
        return {
            "schema": "acromion.simulation/1",
            "device": shift.device,
            "seed": shift.seed,
            "start": shift.start.isoformat(),
            "nominal_rate_hz": shift.nominal_rate_hz,
            "rate_hz": shift.rate_hz,
            "samples": shift.sample_count,
            "calibration_s": shift.calibration_s,
            "plan": [[activity.name, activity.start_s, activity.end_s] for activity in shift.plan],
            "exposure": self._describe_exposure(),
            "sensor": describe_errors(shift.errors),
        }

    def _describe_exposure(self) -> dict[str, Any]:
        share = 100.0 / self._shift.sample_count
        return {
            "bin_edges_deg": EDGES_DEG,
            "bin_percent": (self._in_bins * share).tolist(),
            "thresholds_deg": THRESHOLDS_DEG,
            "above_percent": (self._above * share).tolist(),
            "entries": self._entries.tolist(),
            "clipped_samples": self._clipped,
        }


def describe_errors(errors: SensorErrors) -> dict[str, Any]:
    """Give the specimen's values; of what wanders, the first and last knot and the span."""
    return {
        "mounting": errors.mounting.tolist(),
        "acc_gain": errors.acc_gain.tolist(),
        "gyr_gain": errors.gyr_gain.tolist(),
        "acc_offset_g": errors.acc_offset_g.tolist(),
        "gyr_offset_dps": errors.gyr_offset_dps.tolist(),
        "acc_wander_g": _describe_wander(errors.acc_wander_g),
        "gyr_wander_dps": _describe_wander(errors.gyr_wander_dps),
        "acc_noise_g": errors.acc_noise_g,
        "gyr_noise_dps": errors.gyr_noise_dps,
    }


def _describe_wander(knots: Float64Array) -> dict[str, list[float]]:
    return {"first": knots[0].tolist(), "last": knots[-1].tolist(), "span": np.ptp(knots, axis=0).tolist()}


@njit(cache=True, nogil=True)
def count_entries(
    elevation_deg: Float64Array, threshold_deg: float, state: int
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Count rises above the threshold with 10 deg of hysteresis.

    ``state``: 1 above, 0 below, -1 not known yet (a start above is not counted); it is given back.
    """
    entries = 0
    for angle in elevation_deg:
        if state != 1 and angle > threshold_deg + _HALF_HYSTERESIS_DEG:
            entries += 0 if state == -1 else 1
            state = 1
        elif angle < threshold_deg - _HALF_HYSTERESIS_DEG or state == -1:
            state = 0
    return entries, state
