"""From samples to nodes and back: the slow filter runs at a few nodes, the gyroscope fills in between.

A node stands at the middle sample of an odd number of rows. It holds their mean acceleration and the
rotation from the node before, composed from the samples' own rotations (``a + b + a x b / 2``, the first
terms of Baker-Campbell-Hausdorff), so that no motion of the arm is lost by the reduction.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.recording import FloatArray
from fusion.sensor_errors.accelerometer import AccelerometerCorrection, leave_accelerometer
from fusion.sensor_errors.bias_track import GyroBias
from fusion.sensor_errors.rotation import RADIANS, bend, carry, turn_factors
from fusion.sensor_errors.runs import SensorRun

NODE_RATE_HZ = 20.0
GYRO_LAG_S = 0.0005
LEAST_NODES = 30
SMALL = (1.0, 0.5)  # the factors of a small turn: second order is enough within a node


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Node j stands at row ``rows_per_node * j + rows_per_node // 2``.

    ``acc_g`` (j, 3) mean acceleration; ``turn_rad`` (j, 3) rotation vector from the node before (the first
    is nil); ``bias_rad`` (j, 3) the gyroscope's bias taken off, rad/s. ``start_s`` is the time of the first
    node in the file.
    """

    start_s: float
    period_s: float
    rows_per_node: int
    lag_rows: float
    acc_g: NDArray[np.float32]
    turn_rad: NDArray[np.float64]
    bias_rad: NDArray[np.float64]


def reduce_to_nodes(
    run: SensorRun,
    bias: GyroBias,
    node_rate_hz: float = NODE_RATE_HZ,
    gyro_lag_s: float = GYRO_LAG_S,
    correction: AccelerometerCorrection | None = None,
) -> Nodes:
    """Take an odd number of rows to a node, about ``node_rate_hz``; every row in a run of few samples.

    ``gyro_lag_s``: how late the gyroscope's filter is behind the accelerometer's; its rate is read that much
    later.
    """
    rows = 2 * int((run.rate_hz / node_rate_hz - 1.0) / 2.0 + 0.25) + 1 if node_rate_hz < run.rate_hz else 1
    rows = rows if len(run) >= LEAST_NODES * rows else 1
    middle_s = run.start_s + (np.arange(len(run) // rows) * rows + rows // 2) / run.rate_hz
    bias_rad = np.ascontiguousarray(bias.at(middle_s)) * RADIANS
    acc_g = np.zeros((len(middle_s), 3), dtype=np.float32)
    turn_rad = np.zeros((len(middle_s), 3))
    lag_rows = min(1.0, gyro_lag_s * run.rate_hz)
    steps = (rows, 1.0 / run.rate_hz, lag_rows)
    correction = correction or leave_accelerometer()
    true_acc = np.stack([correction.offset_g, correction.scale])
    _reduce(run.acc_g, run.gyr_dps, bias_rad, steps, true_acc, acc_g, turn_rad)
    return Nodes(float(middle_s[0]), rows / run.rate_hz, rows, lag_rows, acc_g, turn_rad, bias_rad)


def spread_from_nodes(
    run: SensorRun,
    nodes: Nodes,
    up: NDArray[np.float64],
    dtype: type[np.float32] | type[np.float64],
) -> FloatArray:
    """Carry the vertical from each node to its samples; the last node also serves the rows left over."""
    out: NDArray[Any] = np.empty((len(run), 3), dtype=dtype)
    steps = (nodes.rows_per_node, 1.0 / run.rate_hz, nodes.lag_rows)
    _spread(run.gyr_dps, nodes.bias_rad, steps, up, out)
    return out


@njit(inline="always")
def _rate(gyr: Any, row: int, lag_rows: float, bias: Any) -> Any:  # pragma: no cover
    """Rate at the time of a row, rad/s: a little after its stamp, since the gyroscope is late."""
    later = min(row + 1, len(gyr) - 1)
    now, then = (1.0 - lag_rows) * RADIANS, lag_rows * RADIANS
    return (
        now * gyr[row, 0] + then * gyr[later, 0] - bias[0],
        now * gyr[row, 1] + then * gyr[later, 1] - bias[1],
        now * gyr[row, 2] + then * gyr[later, 2] - bias[2],
    )


@njit(inline="always")
def _correct(acc: Any, row: int, offset_g: Any, scale: Any) -> Any:  # pragma: no cover
    return (
        scale[0] * (acc[row, 0] - offset_g[0]),
        scale[1] * (acc[row, 1] - offset_g[1]),
        scale[2] * (acc[row, 2] - offset_g[2]),
    )


@njit(inline="always")
def _add(table: Any, row: int, vector: Any, share: float) -> None:  # pragma: no cover
    table[row, 0] += share * vector[0]
    table[row, 1] += share * vector[1]
    table[row, 2] += share * vector[2]


@njit(cache=True, nogil=True)
def _reduce(  # noqa: PLR0913, PLR0917 (a kernel takes plain arrays)
    acc: Any, gyr: Any, bias: Any, steps: Any, true_acc: Any, mean_acc: Any, turns: Any
) -> None:  # pragma: no cover
    """Fill the nodes' mean accelerations and the rotations between them.

    One walk over the rows, from each node to the next: the rows still nearer to the node behind are carried
    back to it, those nearer to the node ahead are gathered and carried along.
    """
    rows, period_s, lag_rows = steps
    half, share = rows // 2, 1.0 / rows
    offset_g = (true_acc[0, 0], true_acc[0, 1], true_acc[0, 2])
    scale = (true_acc[1, 0], true_acc[1, 1], true_acc[1, 2])
    for node in range(len(mean_acc) + 1):
        start, stop = max(0, (node - 1) * rows + half), min(len(mean_acc) * rows - 1, node * rows + half)
        at = min(node, len(mean_acc) - 1)
        offset = (bias[at, 0], bias[at, 1], bias[at, 2])
        before = _rate(gyr, start, lag_rows, offset)
        whole, ahead = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if node == 0:
            ahead = _correct(acc, 0, offset_g, scale)
        for row in range(start + 1, stop + 1):
            after = _rate(gyr, row, lag_rows, offset)
            turn = bend(before, after, period_s)
            before = after
            whole = _compose(whole, turn)
            now = _correct(acc, row, offset_g, scale)
            if row < node * rows:
                _add(mean_acc, node - 1, carry(now, (-whole[0], -whole[1], -whole[2]), SMALL), share)
            else:
                ahead = carry(ahead, turn, SMALL)
                ahead = (ahead[0] + now[0], ahead[1] + now[1], ahead[2] + now[2])
        if node < len(mean_acc):
            _add(mean_acc, node, ahead, share)
            if node > 0:
                turns[node, 0], turns[node, 1], turns[node, 2] = whole


@njit(inline="always")
def _compose(first: Any, second: Any) -> Any:  # pragma: no cover
    """Rotation vector of ``first``, then ``second`` as seen after it."""
    return (
        first[0] + second[0] + 0.5 * (first[1] * second[2] - first[2] * second[1]),
        first[1] + second[1] + 0.5 * (first[2] * second[0] - first[0] * second[2]),
        first[2] + second[2] + 0.5 * (first[0] * second[1] - first[1] * second[0]),
    )


@njit(cache=True, nogil=True)
def _spread(gyr: Any, bias: Any, steps: Any, up: Any, out: Any) -> None:  # pragma: no cover
    """Carry the vertical of each node to the rows before and after it."""
    rows, period_s, lag_rows = steps
    half = rows // 2
    for node in range(len(up)):
        middle = node * rows + half
        stop = len(out) if node == len(up) - 1 else (node + 1) * rows
        offset = (bias[node, 0], bias[node, 1], bias[node, 2])
        vertical = (up[node, 0], up[node, 1], up[node, 2])
        out[middle, 0], out[middle, 1], out[middle, 2] = vertical
        before = _rate(gyr, middle, lag_rows, offset)
        for row in range(middle + 1, stop):
            after = _rate(gyr, row, lag_rows, offset)
            turn = bend(before, after, period_s)
            vertical = carry(vertical, turn, turn_factors(turn))
            out[row, 0], out[row, 1], out[row, 2] = vertical
            before = after
        vertical = (up[node, 0], up[node, 1], up[node, 2])
        before = _rate(gyr, middle, lag_rows, offset)
        for row in range(middle - 1, node * rows - 1, -1):
            after = _rate(gyr, row, lag_rows, offset)
            turn = bend(before, after, -period_s)
            vertical = carry(vertical, turn, turn_factors(turn))
            out[row, 0], out[row, 1], out[row, 2] = vertical
            before = after
