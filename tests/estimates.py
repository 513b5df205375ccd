"""The steps of `smoothed` alone, without the calibration of the sensor that goes before them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from acromion.fusion.orientation.smoothed import smooth_nodes
from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.gyroscope import estimate_gyro_bias_track, reduce_about_start
from acromion.fusion.sensor.model import (
    NODE_RATE_HZ,
    GyroBias,
    SensorRun,
    build_constant_bias,
    propagate_vertical,
    reduce_to_nodes,
)
from acromion.fusion.sensor.stillness import QuietTable, find_still_moments, reduce_run


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedVertical:
    """The vertical at every sample, shape (n, 3), with the disagreement each ``rows_per_value`` samples."""

    up: Float64Array
    uncertainty_deg: Float64Array
    rows_per_value: int


def smooth_vertical(
    run: SensorRun, bias: GyroBias | None = None, node_rate_hz: float = NODE_RATE_HZ
) -> SmoothedVertical:
    """Find the vertical at the time of each sample, and how far past and future disagree."""
    nodes = reduce_to_nodes(run, bias or build_constant_bias(np.zeros(3)), node_rate_hz)
    smoothed = smooth_nodes(nodes)
    up = np.empty((len(run), 3))
    propagate_vertical(run.gyr_dps, run.rate_hz, nodes, smoothed.up, up, 0)
    return SmoothedVertical(up, smoothed.disagreement_deg, smoothed.nodes_per_value * nodes.rows_per_node)


def estimate_gyro_bias(runs: Sequence[SensorRun], stills: QuietTable | None = None) -> GyroBias:
    """Find the bias of all runs of one recording together; ``stills`` where they are known already."""
    if stills is None:
        stills = find_still_moments([reduce_run(run) for run in runs])
    return estimate_gyro_bias_track(reduce_about_start(runs, stills), stills)
