"""The rows of the angle: at most 100 a second, averaged from the samples about them.

A sensor of 500 Hz gives five samples to a row. The row stands at its stamp and lasts until the next; its
vertical is the mean over 10 ms about that stamp, so that it is neither early nor late. Its time is that of
the five samples from the stamp on.

The rows of a segment share its time evenly. Samples over a last whole row (4 at most, of 500 Hz) thus lose no
time: each row lasts a little longer, 0.8 percent in a segment of 1 s, 0.01 percent in one of a minute, and
stands where its time begins, between two samples if need be.
"""

from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import kernel
from fusion.recording import MICROSECONDS, Float64Array, FloatArray, Segment
from fusion.sensor.nodes import Nodes, spread_rows

MOST_HZ = 100.5
"""A nominal 100 Hz sensor runs at 100 +- 0.1 Hz and keeps every sample."""


# The vertical at the samples, computed for the slice that is asked for.
#
# Eight hours at 100 Hz are 33 MiB of unit vectors. They follow from nodes and gyroscope samples, which are
# kept anyway: to work them out again for the speeds takes no longer than to get that much memory. At 500 Hz
# it would take five times as long, so there the vectors of the rows are kept. The same samples always give
# the same bits, whatever slice is read.


@dataclass(frozen=True, slots=True, eq=False)
class VerticalOnDemand:
    """Behaves as an array (n, 3) of float32 that is read by slices of samples.

    ``up`` (j, 3) is the vertical at the nodes, ``gyr_dps`` (n, 3) carries it to the samples between.
    """

    gyr_dps: FloatArray
    rate_hz: float
    nodes: Nodes
    up: Float64Array

    def __len__(self) -> int:
        return len(self.gyr_dps)

    def __getitem__(self, samples: slice) -> NDArray[np.float32]:
        """Samples of a slice without a step."""
        first, stop, _ = samples.indices(len(self))
        if stop <= first:
            return np.zeros((0, 3), dtype=np.float32)
        per_node = self.nodes.rows_per_node
        node = min(first // per_node, len(self.up) - 1)
        end = len(self) if stop > len(self.up) * per_node else min(-(-stop // per_node) * per_node, len(self))
        out = np.empty((end - node * per_node, 3), dtype=np.float32)
        spread_rows(self.gyr_dps, self.rate_hz, self.nodes, self.up, out, node)
        return out[first - node * per_node : stop - node * per_node]


Vertical = FloatArray | VerticalOnDemand
"""The vertical at every sample, (n, 3): an array, or what is read like one."""


@dataclass(frozen=True, slots=True)
class AngleRows:
    """How the samples of a segment make rows; as long as the segment, to the microsecond.

    ``start_us``, ``rate_hz``: time of the first row, which is that of the first sample; rows per second.
    ``count``, ``samples``: how many rows, of how many samples.
    ``per_row``: whole samples that are averaged for a row; 1: each sample is a row.
    """

    start_us: int
    rate_hz: float
    count: int
    samples: int
    per_row: int

    def __len__(self) -> int:
        return self.count

    @property
    def period_us(self) -> float:
        """How long one row lasts."""
        return MICROSECONDS / self.rate_hz

    def hold(self, first: int, stop: int) -> slice:
        """Return the rows with any of the samples [first, stop)."""
        if self.per_row == 1:
            return slice(first, stop)
        return slice(first * self.count // self.samples, -(-stop * self.count // self.samples))


def lay_rows(run: Segment) -> AngleRows:
    """Take as few whole samples to a row as come to at most 100 rows a second."""
    samples, per_row = len(run), ceil(run.rate_hz / MOST_HZ)
    if per_row == 1 or samples == 0:
        return AngleRows(run.start_us, run.rate_hz, samples, samples, 1)
    count = max(samples // per_row, 1)
    return AngleRows(run.start_us, run.rate_hz * count / samples, count, samples, per_row)


def read_rows(vertical: Vertical, rows: AngleRows, first: int, stop: int) -> FloatArray:
    """Unit vectors of the rows [first, stop), (stop - first, 3), from the vertical of all samples, (n, 3)."""
    if rows.per_row == 1:
        return vertical[first:stop]
    reach, pace = rows.per_row, rows.samples / rows.count
    start = max(int(first * pace) - reach, 0)
    around: NDArray[np.float32] = vertical[start : int(stop * pace) + reach].astype(np.float32, copy=False)
    out = np.empty((stop - first, 3), dtype=np.float32)
    places: Float64Array = np.arange(first, stop) * float(rows.samples) / rows.count - start
    _average(around, places, 0.5 * (rows.per_row + 1), out)
    return out


@kernel
def _average(vertical: Any, places: Any, reach: float, out: Any) -> None:  # pragma: no cover
    """Mean direction about each place, counted in samples.

    A sample stands for half a period on each side of it; it weighs as much of that as lies in the window.
    """
    for k in range(len(out)):
        place = places[k]
        low = int(place - reach) + 1 if place > reach else 0
        stop = int(place + reach) + 1
        x, y, z = 0.0, 0.0, 0.0
        for i in range(low, stop if stop < len(vertical) else len(vertical)):
            weight = reach - abs(i - place)
            weight = 1.0 if weight > 1.0 else weight
            x += weight * vertical[i, 0]
            y += weight * vertical[i, 1]
            z += weight * vertical[i, 2]
        scale = 1.0 / np.sqrt(x * x + y * y + z * z)
        out[k, 0], out[k, 1], out[k, 2] = scale * x, scale * y, scale * z
