"""The vertical at the samples, computed for the slice that is asked for.

Eight hours at 100 Hz are 33 MiB of unit vectors. They follow from nodes and gyroscope samples, which
are kept anyway: to work them out again for the speeds takes no longer than to get that much memory. At 500 Hz
it would take five times as long, so there the vectors of the rows are kept
(:mod:`fusion.orientation.angle_rows`). The same samples always give the same bits, whatever slice is read.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.recording import Float64Array, FloatArray
from fusion.sensor.nodes import Nodes, spread_rows


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
