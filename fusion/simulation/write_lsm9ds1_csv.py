"""Writes what a logger with an LSM9DS1 writes: a CSV with a microsecond counter, in g and deg/s.

The part's registers are left-handed; loggers that print g and deg/s, as this one, turn them into one
right-handed frame, and so does this file: acc and gyr share it.
"""

from pathlib import Path

import numpy as np

from fusion.simulation.digits import put_counter_rows
from fusion.simulation.open_file import OpenFile
from fusion.simulation.shift import SampleBlock, SimulatedShift

COUNTER_SIZE = 2**32
"""micros() wraps here: every 71.6 minutes."""

LATENCY_US = 40.0
"""A sample is read up to so long after it was taken."""

_COLUMNS = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"
_DECIMALS = np.array([6, 6, 6, 3, 3, 3])


class Lsm9ds1CsvWriter(OpenFile):
    """Takes blocks of samples and writes them on at once; a context manager."""

    def __init__(self, path: Path, shift: SimulatedShift) -> None:
        self._shift = shift
        self._chance = np.random.default_rng([shift.seed, 4])
        self._switched_on_us = self._chance.integers(3_000_000, 600_000_000)
        super().__init__(path, _write_header(shift))

    def write(self, block: SampleBlock) -> None:
        """Write the rows of a block; values are whole multiples of the resolution, so text loses nothing."""
        part = self._shift.part
        acc, gyr = self._shift.count(block.readings)
        values = np.empty((len(acc), 6), np.int64)
        values[:, :3] = acc.astype(np.int64) * round(part.acc_g_per_lsb * 1e6)
        values[:, 3:] = gyr.astype(np.int64) * round(part.gyr_dps_per_lsb * 1e3)
        out = np.empty(values.shape[0] * 7 * 24, np.uint8)
        size = put_counter_rows(out, self._stamp(block), values, _DECIMALS)
        self._file.write(out[:size].tobytes())

    def _stamp(self, block: SampleBlock) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Read the counter when each sample is fetched."""
        late_us = self._chance.uniform(0.0, LATENCY_US, len(block.time_s))
        return (self._switched_on_us + (block.time_s * 1e6 + late_us).astype(np.int64)) % COUNTER_SIZE


def _write_header(shift: SimulatedShift) -> bytes:
    """Give the comment lines and the columns."""
    lines = (
        "# device: LSM9DS1",
        f"# start: {shift.start.isoformat()}",
        f"# acc_range_g: {shift.part.acc_range_g:g}",
        f"# gyr_range_dps: {shift.part.gyr_range_dps:g}",
        _COLUMNS,
    )
    return "".join(line + "\n" for line in lines).encode()
