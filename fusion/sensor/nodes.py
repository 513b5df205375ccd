"""From samples to nodes and back: the slow filter runs at a few nodes, the gyroscope fills in between.

A node stands at the middle sample of an odd number of rows. It holds their mean acceleration and the
rotation from the node before, composed from the samples' own rotations (``a + b + a x b / 2``, the first
terms of Baker-Campbell-Hausdorff), so that no motion of the arm is lost by the reduction.

Between two samples the rate is a cubic through four of them: ``T (13 (w1 + w2) - w0 - w3) / 24``. A straight
line loses ``(w T)^2 / 12`` of a movement, 0.8 % at 5 Hz and 100 samples a second. Taking a twelfth of the
second difference off each sample and then the trapezoid is the same sum.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fusion.numba_kernels import fused, inner, kernel
from fusion.recording import Float64Array, FloatArray
from fusion.sensor.accelerometer import AccelerometerCorrection, leave_accelerometer
from fusion.sensor.model import RADIANS, GyroBias, SensorRun, bend, carry, turn_factors

NODE_RATE_HZ = 20.0
LEAST_NODES = 30
TAPS = -RADIANS / 12.0, RADIANS * (14.0 / 12.0), RADIANS * (-1.0 / 12.0)
"""What the row before, the row and the row after give to its rate, rad/s for a deg/s."""
SMALL = (1.0, 0.5)  # the factors of a small turn: second order is enough within a node


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Node j stands at row ``rows_per_node * j + rows_per_node // 2``.

    ``acc_g`` (j, 3) mean acceleration; ``turn_rad`` (j, 3) rotation vector from the node before (the first
    is nil); ``bias_rad`` (j, 3) the gyroscope's bias taken off, rad/s; ``gyro_gain`` (3, 3) what the rest
    was multiplied with. ``start_s`` is the time of the first node in the file.
    """

    start_s: float
    period_s: float
    rows_per_node: int
    acc_g: Float64Array
    turn_rad: Float64Array
    bias_rad: Float64Array
    gyro_gain: Float64Array


def reduce_to_nodes(run: SensorRun, bias: GyroBias, node_rate_hz: float = NODE_RATE_HZ) -> Nodes:
    """Take an odd number of rows to a node, about ``node_rate_hz``; every row in a run of few samples."""
    rows = 2 * int((run.rate_hz / node_rate_hz - 1.0) / 2.0 + 0.25) + 1 if node_rate_hz < run.rate_hz else 1
    rows = rows if len(run) >= LEAST_NODES * rows else 1
    start_s, period_s, count = run.start_s + rows // 2 / run.rate_hz, rows / run.rate_hz, len(run) // rows
    bias_rad = bias.at(start_s + period_s * np.arange(count))
    bias_rad *= RADIANS
    acc_g, turn_rad = np.zeros((2, count, 3))
    _reduce(run.acc_g, run.gyr_dps, bias_rad, (rows, 1.0 / run.rate_hz, TAPS), acc_g, turn_rad)
    return Nodes(start_s, period_s, rows, acc_g, turn_rad, bias_rad, np.eye(3))


def correct_nodes(
    nodes: Nodes,
    bias: GyroBias,
    gyro_gain: Float64Array | None = None,
    accelerometer: AccelerometerCorrection | None = None,
    *,
    in_place: bool = False,
) -> Nodes:
    """The same nodes under another bias, gyroscope gain and accelerometer correction; no sample is read.

    A constant rate adds to a rotation vector exactly where the axis stands still; within a node, a twentieth
    of a second, it nearly does: 1e-4 deg for a bias wrong by 1 deg/s. ``in_place``: the given nodes are not
    needed any more, and their arrays are written over (fresh memory takes ten times as long as the sums).
    """
    gyro_gain = np.eye(3) if gyro_gain is None else gyro_gain
    felt = accelerometer or leave_accelerometer()
    bias_rad = nodes.bias_rad if in_place else nodes.bias_rad.copy()
    turn_rad, acc_g = (table if in_place else np.empty_like(table) for table in (nodes.turn_rad, nodes.acc_g))
    change = gyro_gain @ np.linalg.inv(nodes.gyro_gain)
    times = (nodes.start_s, nodes.period_s)
    gyr_line, acc_line = (bias.time_s, bias.bias_dps * RADIANS), (felt.time_s, felt.offset_g)
    _correct(nodes.turn_rad, (*times, nodes.period_s, change), gyr_line, bias_rad, turn_rad)
    turn_rad[:1] = 0.0
    _correct(nodes.acc_g, (*times, 1.0, felt.gain), acc_line, np.empty((0, 3)), acc_g)
    return replace(nodes, acc_g=acc_g, turn_rad=turn_rad, bias_rad=bias_rad, gyro_gain=gyro_gain)


@kernel
def _correct(readings: Any, steps: Any, line: Any, taken: Any, out: Any) -> None:  # pragma: no cover
    """Draw a line between knots (constant outside); ``gain @ (reading - share * change)``.

    ``taken`` (n, 3) is what was taken off before, and holds the line afterwards; empty for nothing. ``out``
    may be the readings themselves.
    """
    (start_s, period_s, share, gain), (knots_s, values) = steps, line
    last, left = len(knots_s) - 1, 0
    for node in range(len(readings)):
        now_s = start_s + node * period_s
        while left < last - 1 and now_s >= knots_s[left + 1]:
            left += 1
        right = left + 1 if last > 0 else left
        part = (now_s - knots_s[left]) / (knots_s[right] - knots_s[left]) if last > 0 else 0.0
        part = 0.0 if part < 0.0 else 1.0 if part > 1.0 else part
        for axis in range(3):
            value = values[left, axis] + part * (values[right, axis] - values[left, axis])
            change = value
            if len(taken):
                change = value - taken[node, axis]
                taken[node, axis] = value
            out[node, axis] = readings[node, axis] - share * change
        x, y, z = out[node, 0], out[node, 1], out[node, 2]
        for axis in range(3):
            out[node, axis] = gain[axis, 0] * x + gain[axis, 1] * y + gain[axis, 2] * z


def spread_rows(
    gyr_dps: FloatArray, rate_hz: float, nodes: Nodes, up: Float64Array, out: FloatArray, first: int
) -> None:
    """Carry the vertical from each node to the rows about it, into ``out`` for the nodes from ``first`` on.

    ``out`` begins with the first row of node ``first`` and ends with the last row of a node, or of the run:
    the last node also serves the rows left over.
    """
    gain = tuple(tuple(row) for row in nodes.gyro_gain.tolist())
    _spread(gyr_dps, nodes.bias_rad, (nodes.rows_per_node, 1.0 / rate_hz, TAPS, gain), up, first, out)


@inner
def _read(table: Any, row: int) -> Any:  # pragma: no cover
    """A row as a triple; the first and last stand for what lies outside."""
    inside = 0 if row < 0 else row if row < len(table) else len(table) - 1
    return float(table[inside, 0]), float(table[inside, 1]), float(table[inside, 2])


@fused
def _mix(before: Any, now: Any, after: Any, taps: Any, offset: Any) -> Any:  # pragma: no cover
    """Rate of a row, rad/s, as the trapezoid wants it; ``taps`` rad/s for each deg/s, ``offset`` rad/s."""
    a, b, c = taps
    return (
        a * before[0] + b * now[0] + c * after[0] - offset[0],
        a * before[1] + b * now[1] + c * after[1] - offset[1],
        a * before[2] + b * now[2] + c * after[2] - offset[2],
    )


@inner
def _add(table: Any, row: int, vector: Any, share: float) -> None:  # pragma: no cover
    table[row, 0] += share * vector[0]
    table[row, 1] += share * vector[1]
    table[row, 2] += share * vector[2]


@kernel
def _reduce(acc: Any, gyr: Any, bias: Any, steps: Any, mean_acc: Any, turns: Any) -> None:  # pragma: no cover
    """Fill the nodes' mean accelerations and the rotations between them.

    One walk over the rows, from each node to the next: the rows still nearer to the node behind are carried
    back to it, those nearer to the node ahead are gathered and carried along.
    """
    rows, period_s, taps = steps
    half, share = rows // 2, 1.0 / rows
    for node in range(len(mean_acc) + 1):
        first, at, stop = node == 0, node, node * rows + half
        start = 0 if first else stop - rows
        if node == len(mean_acc):
            at, stop = node - 1, node * rows - 1
        offset = (bias[at, 0], bias[at, 1], bias[at, 2])
        last, now = _read(gyr, start), _read(gyr, start + 1)
        before = _mix(_read(gyr, start - 1), last, now, taps, offset)
        whole, ahead = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        if first:
            ahead = _read(acc, start)
        for row in range(start + 1, stop + 1):
            following = _read(gyr, row + 1)
            after = _mix(last, now, following, taps, offset)
            turn = bend(before, after, period_s)
            last, now, before = now, following, after
            whole = _compose(whole, turn)
            felt = _read(acc, row)
            if row < node * rows:
                _add(mean_acc, node - 1, carry(felt, (-whole[0], -whole[1], -whole[2]), SMALL), share)
            else:
                ahead = carry(ahead, turn, SMALL)
                ahead = (ahead[0] + felt[0], ahead[1] + felt[1], ahead[2] + felt[2])
        if node < len(mean_acc):
            _add(mean_acc, node, ahead, share)
            if not first:
                turns[node, 0], turns[node, 1], turns[node, 2] = whole


@fused
def _compose(first: Any, second: Any) -> Any:  # pragma: no cover
    """Rotation vector of ``first``, then ``second`` as seen after it."""
    return (
        first[0] + second[0] + 0.5 * (first[1] * second[2] - first[2] * second[1]),
        first[1] + second[1] + 0.5 * (first[2] * second[0] - first[0] * second[2]),
        first[2] + second[2] + 0.5 * (first[0] * second[1] - first[1] * second[0]),
    )


@kernel
def _spread(gyr: Any, bias: Any, steps: Any, up: Any, first: int, out: Any) -> None:  # pragma: no cover
    """Carry the vertical of each node to the rows before and after it."""
    rows, period_s, taps, gain = steps
    shift = first * rows
    ahead, behind = (period_s, taps, gain), (-period_s, (taps[2], taps[1], taps[0]), gain)
    node, end = first, shift + len(out)
    while node < len(up) and node * rows < end:
        middle, last = node * rows + rows // 2, end if node == len(up) - 1 else (node + 1) * rows
        offset = (bias[node, 0], bias[node, 1], bias[node, 2])
        vertical = (up[node, 0], up[node, 1], up[node, 2])
        out[middle - shift, 0], out[middle - shift, 1], out[middle - shift, 2] = vertical
        _walk(gyr, middle + 1, last - middle - 1, (ahead, offset), vertical, shift, out)
        _walk(gyr, middle - 1, rows // 2, (behind, offset), vertical, shift, out)
        node += 1


@fused
def _multiply(matrix: Any, vector: Any) -> Any:  # pragma: no cover
    x, y, z = vector
    a, b, c = matrix
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


@inner
def _walk(
    gyr: Any, row: int, row_count: int, motion: Any, vertical: Any, shift_rows: int, out: Any
) -> None:  # pragma: no cover
    """From the row beside a node outwards: forwards, or where the period is negative backwards in time."""
    (period_s, taps, gain), offset = motion
    step = 1 if period_s > 0.0 else -1
    last, now = _read(gyr, row - step), _read(gyr, row)
    before = _mix(_read(gyr, row - 2 * step), last, now, taps, offset)
    for _ in range(row_count):
        following = _read(gyr, row + step)
        after = _mix(last, now, following, taps, offset)
        turn = _multiply(gain, bend(before, after, period_s))
        vertical = carry(vertical, turn, turn_factors(turn))
        out[row - shift_rows, 0], out[row - shift_rows, 1], out[row - shift_rows, 2] = vertical
        last, now, before, row = now, following, after, row + step
