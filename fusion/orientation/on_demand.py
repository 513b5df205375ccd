"""The vertical at every sample, computed when it is read.

Eight hours at 500 Hz are 165 MiB of unit vectors. They follow from the nodes (10 MiB) and the gyroscope's
samples, which are kept anyway; the same rows always give the same bits, whatever slice is read.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.recording import Float64Array, FloatArray
from fusion.sensor.nodes import Nodes, spread_rows

ROWS_AT_ONCE = 16_384
"""So many vectors are still in the processor's cache when their angle is computed."""


@dataclass(frozen=True, slots=True, eq=False)
class VerticalOnDemand:
    """Behaves as an array (n, 3) of float32 that is read by slices of rows.

    ``up`` (j, 3) is the vertical at the nodes, ``gyr_dps`` (n, 3) carries it to the rows between.
    """

    gyr_dps: FloatArray
    rate_hz: float
    nodes: Nodes
    up: Float64Array

    def __len__(self) -> int:
        return len(self.gyr_dps)

    def __getitem__(self, rows: slice) -> NDArray[np.float32]:
        """Rows of a slice without a step."""
        first, stop, _ = rows.indices(len(self))
        if stop <= first:
            return np.zeros((0, 3), dtype=np.float32)
        per_node = self.nodes.rows_per_node
        node = min(first // per_node, len(self.up) - 1)
        end = len(self) if stop > len(self.up) * per_node else min(-(-stop // per_node) * per_node, len(self))
        out = self._spread(node, end)
        return out[first - node * per_node : stop - node * per_node]

    def blocks(self) -> Iterator[tuple[int, NDArray[np.float32]]]:
        """All rows, a block at a time: (first row, vectors)."""
        per_node = self.nodes.rows_per_node
        at_once = max(1, ROWS_AT_ONCE // per_node)
        for node in range(0, len(self.up), at_once):
            last = node + at_once >= len(self.up)
            yield node * per_node, self._spread(node, len(self) if last else (node + at_once) * per_node)

    @property
    def nbytes(self) -> int:
        """Bytes kept."""
        return self.up.nbytes + self.nodes.bias_rad.nbytes

    def _spread(self, node: int, end_row: int) -> NDArray[np.float32]:
        out = np.empty((end_row - node * self.nodes.rows_per_node, 3), dtype=np.float32)
        spread_rows(self.gyr_dps, self.rate_hz, self.nodes, self.up, out, node)
        return out
