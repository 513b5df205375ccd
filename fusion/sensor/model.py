"""One unbroken run as input for the estimators: plain arrays, the sensor's errors, and its nodes."""

from dataclasses import dataclass, replace
from math import isfinite, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.errors import UnusableArrays
from acromion.fusion.numba_kernels import fused, inner, kernel
from acromion.fusion.recording import Float64Array, FloatArray, Segment

# The rotation between two samples, and its effect on a vector.
#
# Time convention: the angular rate of sample k is the instantaneous rate at the time of sample k. Between two
# samples it is linear (trapezoid), with the first coning term (Bortz 1971): the rotation vector over one
# period T is ``(w0 + w1) T / 2 + (w0 x w1) T^2 / 12``.


RADIANS = pi / 180.0
Scalars = tuple[float, float, float]
S1, S2, S3, S4 = 1.0 / 6.0, 1.0 / 20.0, 1.0 / 42.0, 1.0 / 72.0
C1, C2, C3, C4 = 1.0 / 24.0, 1.0 / 30.0, 1.0 / 56.0, 1.0 / 90.0
"""Ratios of successive terms of both series, as factors because a division takes five times as long."""


@fused
def bend(before: Any, after: Any, period_s: float) -> Scalars:  # pragma: no cover
    """Return the rotation vector (rad) from one sample to the next; rates in rad/s, each a triple."""
    half, twelfth = 0.5 * period_s, period_s * period_s / 12.0
    x = half * (before[0] + after[0]) + twelfth * (before[1] * after[2] - before[2] * after[1])
    y = half * (before[1] + after[1]) + twelfth * (before[2] * after[0] - before[0] * after[2])
    z = half * (before[2] + after[2]) + twelfth * (before[0] * after[1] - before[1] * after[0])
    return x, y, z


@fused
def turn_factors(turn: Any) -> tuple[float, float]:  # pragma: no cover
    """Return ``sin(a)/a`` and ``(1 - cos(a))/a^2`` of a rotation of length a, by series (1e-7 at 1 rad)."""
    square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    sine = 1.0 - square * S1 * (1.0 - square * S2 * (1.0 - square * S3 * (1.0 - square * S4)))
    cosine = 0.5 - square * C1 * (1.0 - square * C2 * (1.0 - square * C3 * (1.0 - square * C4)))
    return sine, cosine


@fused
def carry(vector: Any, turn: Any, factors: Any) -> Scalars:  # pragma: no cover
    """Return the coordinates of a vector fixed in space after the sensor has turned by ``turn``.

    Seen from a turning sensor, a fixed vector turns backwards: ``exp(-[turn]x) vector``.
    """
    sine, cosine = factors
    x = turn[1] * vector[2] - turn[2] * vector[1]
    y = turn[2] * vector[0] - turn[0] * vector[2]
    z = turn[0] * vector[1] - turn[1] * vector[0]
    return (
        vector[0] - sine * x + cosine * (turn[1] * z - turn[2] * y),
        vector[1] - sine * y + cosine * (turn[2] * x - turn[0] * z),
        vector[2] - sine * z + cosine * (turn[0] * y - turn[1] * x),
    )


# Normal equations of three unknowns that are piecewise linear between knots.


BAND = 6
"""Three unknowns at each knot, coupled to the neighbouring knots."""


JUMP_S = 0.02
"""Two knots this close represent a jump: the random walk does not connect them."""


def build_random_walk(knots_s: Float64Array, sd_per_root_min: float) -> Float64Array:
    """Return the lower band of a random walk from knot to knot, the same for each of the three unknowns."""
    band = np.zeros((BAND, 3 * len(knots_s)))
    apart_s = np.diff(knots_s)
    stiffness = 1.0 / (sd_per_root_min**2 * np.maximum(apart_s, 1.0) / 60.0)
    stiffness[apart_s < 1.5 * JUMP_S] = 0.0
    per_axis = np.repeat(stiffness, 3)
    band[0, :-3] += per_axis
    band[0, 3:] += per_axis
    band[3, :-3] -= per_axis
    return band


def solve_band(band: Float64Array, right: Float64Array) -> Float64Array:
    """Solve a symmetric positive definite band for each row of the right side, by Cholesky factors.

    ``band``: shape (d, n): row k is the k-th diagonal below the main one.
    ``right``: shape (m, n).

    Returns
    -------
    Float64Array
        Shape (m, n).

    Raises
    ------
    numpy.linalg.LinAlgError
        The band is not positive definite.
    """
    solved = right.copy()
    if not _solve_band(band.copy(), solved):
        raise np.linalg.LinAlgError("the band is not positive definite")
    return solved


@inner
def _factor_band(band):  # type: ignore[no-untyped-def] # pragma: no cover
    """Replace the band by its factor; return False if there is none."""
    depth, n = band.shape
    for j in range(n):
        if not band[0, j] > 0.0:
            return False
        band[0, j] = sqrt(band[0, j])
        end = min(depth, n - j)
        for i in range(1, end):
            band[i, j] /= band[0, j]
        for k in range(1, end):
            for i in range(k, end):
                band[i - k, j + k] -= band[i, j] * band[k, j]
    return True


@kernel
def _solve_band(band, right):  # type: ignore[no-untyped-def] # pragma: no cover
    if not _factor_band(band):
        return False
    depth, n = band.shape
    for row in range(len(right)):
        for j in range(n):
            right[row, j] /= band[0, j]
            for i in range(1, min(depth, n - j)):
                right[row, j + i] -= band[i, j] * right[row, j]
        for j in range(n - 1, -1, -1):
            for i in range(1, min(depth, n - j)):
                right[row, j] -= band[i, j] * right[row, j + i]
            right[row, j] /= band[0, j]
    return True


class LinearInterpolator:
    """Distributes observations at given times to the two knots around each."""

    def __init__(self, knots_s: Float64Array, time_s: Float64Array) -> None:
        self.left = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, len(knots_s) - 2)
        width_s = knots_s[self.left + 1] - knots_s[self.left]
        self.share = np.clip((time_s - knots_s[self.left]) / width_s, 0.0, 1.0)

    def add(
        self, band: Float64Array, right: Float64Array, squares: Float64Array, pulls: Float64Array
    ) -> None:
        """Add ``squares`` (w, 3, 3) to the lower band and ``pulls`` (w, 3) to the right side."""
        here, there = 1.0 - self.share, self.share
        self.pull(right, pulls)
        for row in range(3):
            for column in range(3):
                value = squares[:, row, column]
                self._collect(band[3 + row - column], column, here * there * value)
                if row >= column:
                    self._collect(band[row - column], column, here**2 * value)
                    self._collect(band[row - column], column + 3, there**2 * value)

    def add_alike(
        self, band: Float64Array, right: Float64Array, weight: Float64Array, pulls: Float64Array
    ) -> None:
        """Do the same for observations of the three unknowns themselves, with one ``weight`` (w,)."""
        here, there = 1.0 - self.share, self.share
        self.pull(right, pulls)
        for place, values in (
            (band[0], here**2 * weight),
            (band[0, 3:], there**2 * weight),
            (band[3], here * there * weight),
        ):
            sums = np.bincount(self.left, weights=values)
            place[: 3 * len(sums)] += np.repeat(sums, 3)

    def pull(self, right: Float64Array, pulls: Float64Array) -> None:
        """Add ``pulls`` (w, 3) to the right side only."""
        for row in range(3):
            self._collect(right, row, (1.0 - self.share) * pulls[:, row])
            self._collect(right, row + 3, self.share * pulls[:, row])

    def read(self, values: Float64Array) -> Float64Array:
        """Return values (k, 3) of the knots at the times of the observations, (w, 3)."""
        share = self.share[:, None]
        return np.asarray((1.0 - share) * values[self.left] + share * values[self.left + 1])

    def _collect(self, target: Float64Array, offset: int, values: Float64Array) -> None:
        """Add ``values`` (w,) at ``offset`` places after the first unknown of the left knot."""
        sums = np.bincount(self.left, weights=values)
        target[offset : offset + 3 * len(sums) : 3] += sums


# The gyroscope's bias as a function of time.


@dataclass(frozen=True, slots=True, eq=False)
class GyroBias:
    """Bias at knots: ``time_s`` (k,), ``bias_dps`` (k, 3); linear between them, constant outside.

    ``still_moments`` and ``motion_windows`` count the observations it is based on.
    """

    time_s: Float64Array
    bias_dps: Float64Array
    still_moments: int = 0
    motion_windows: int = 0

    def at(self, time_s: NDArray[np.floating[Any]]) -> Float64Array:
        """Return the bias at the given times, shape (n, 3)."""
        if len(self.time_s) == 1:
            return np.repeat(self.bias_dps, len(time_s), axis=0)
        columns = [np.interp(time_s, self.time_s, self.bias_dps[:, axis]) for axis in range(3)]
        return np.stack(columns, axis=1)


def build_constant_bias(bias_dps: Float64Array) -> GyroBias:
    """Return one constant bias for the whole recording."""
    return GyroBias(np.zeros(1), np.asarray(bias_dps, dtype=np.float64).reshape(1, 3))


@dataclass(frozen=True, slots=True, eq=False)
class SensorRun:
    """Evenly sampled acceleration (g) and angular rate (deg/s), (n, 3), from ``start_s`` in the file."""

    start_s: float
    rate_hz: float
    acc_g: FloatArray
    gyr_dps: FloatArray

    def __len__(self) -> int:
        return len(self.acc_g)


def view_segment(segment: Segment) -> SensorRun:
    """Return a segment as a run, without a copy."""
    return SensorRun(segment.start_s, segment.rate_hz, segment.acc_g, segment.gyr_dps)


PART_OFFSET_G = 0.04
"""Standard deviation of the offset of an accelerometer as delivered."""


@dataclass(frozen=True, slots=True, eq=False)
class AccelerometerCorrection:
    """The correction ``gain @ (acceleration - offset_g(t))``.

    ``gain`` (3, 3): symmetric.
    ``offset_g`` (k, 3): at the knots ``time_s`` (k,), linear between them, constant outside.
    ``directions``: the number of distinct directions it is based on (0: no correction was found).
    ``offset_sd_g``: remaining standard deviation of the offset, root mean square over all directions of
    space; that of a part as delivered if no direction was seen.
    """

    time_s: Float64Array
    offset_g: Float64Array
    gain: Float64Array
    directions: int = 0
    offset_sd_g: float = PART_OFFSET_G

    def apply(self, acc_g: Float64Array, time_s: float | Float64Array) -> Float64Array:
        """Correct accelerations, shape (3,) or (n, 3), measured at one time or at the times (n,)."""
        offset_g = [np.interp(time_s, self.time_s, self.offset_g[:, axis]) for axis in range(3)]
        return np.asarray((acc_g - np.stack(offset_g, axis=-1)) @ self.gain)

    def find_up(self, gravity_g: Float64Array, time_s: Float64Array) -> Float64Array:
        """Return directions to the zenith, unit vectors (n, 3), of accelerations at rest."""
        up = self.apply(gravity_g, time_s)
        return np.asarray(up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9))

    @property
    def mean_offset_g(self) -> Float64Array:
        """The mean over the recording, shape (3,)."""
        return np.asarray(self.offset_g.mean(axis=0))


def build_identity_accelerometer() -> AccelerometerCorrection:
    """Return no correction."""
    return AccelerometerCorrection(np.zeros(1), np.zeros((1, 3)), np.eye(3))


# From samples to nodes and back: the slow filter runs at a few nodes, the gyroscope fills in between.
#
# A node is at the middle sample of an odd number of rows. It contains their mean acceleration and the
# rotation from the previous node, composed from the samples' own rotations (``a + b + a x b / 2``, the first
# terms of Baker-Campbell-Hausdorff), so that the reduction loses no motion of the arm.
#
# Between two samples the rate is a cubic through four of them: ``T (13 (w1 + w2) - w0 - w3) / 24``. A linear
# rate would lose ``(w T)^2 / 12`` of a movement, 0.8 % at 5 Hz and 100 samples a second. The sum is computed
# by subtracting a twelfth of the second difference from each sample and applying the trapezoid.

NODE_RATE_HZ = 20.0
LEAST_NODES = 30
TAPS = -RADIANS / 12.0, RADIANS * (14.0 / 12.0), RADIANS * (-1.0 / 12.0)
"""Weights of the previous row, the row and the next row in its rate, rad/s per deg/s."""
SMALL = (1.0, 0.5)  # the factors of a small turn: second order is enough within a node


@dataclass(frozen=True, slots=True, eq=False)
class Nodes:
    """Reduced run: node j is at row ``rows_per_node * j + rows_per_node // 2``.

    ``acc_g`` (j, 3): mean acceleration.
    ``turn_rad`` (j, 3): rotation vector from the previous node (zero for the first).
    ``bias_rad`` (j, 3): the subtracted gyroscope bias, rad/s.
    ``gyro_gain`` (3, 3): the gain applied after it.
    ``start_s``: the time of the first node in the file.
    """

    start_s: float
    period_s: float
    rows_per_node: int
    acc_g: Float64Array
    turn_rad: Float64Array
    bias_rad: Float64Array
    gyro_gain: Float64Array


def reduce_to_nodes(run: SensorRun, bias: GyroBias, node_rate_hz: float = NODE_RATE_HZ) -> Nodes:
    """Reduce an odd number of rows to a node, about ``node_rate_hz``; a short run keeps every row."""
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
    """Return the nodes with another bias, gyroscope gain and accelerometer correction.

    A constant rate adds exactly to a rotation vector if the axis of the rotation is fixed. Within a node (a
    twentieth of a second) the axis hardly moves: if the bias changes by 1 deg/s, the error is 1e-4 deg.
    ``in_place``: overwrite the arrays of the given nodes (allocating memory takes ten times as long as the
    sums).
    """
    gyro_gain = np.eye(3) if gyro_gain is None else gyro_gain
    felt = accelerometer or build_identity_accelerometer()
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
    """Interpolate linearly between knots; compute ``gain @ (reading - share * change)``.

    ``taken`` (n, 3): the values subtracted before; overwritten with the new ones; empty if none were. ``out``
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


def propagate_vertical(
    gyr_dps: FloatArray, rate_hz: float, nodes: Nodes, up: Float64Array, out: FloatArray, first: int
) -> None:
    """Propagate the vertical from each node to the rows around it, for the nodes from ``first`` on.

    ``out`` begins with the first row of node ``first`` and ends with the last row of a node, or of the run:
    the last node also covers the remaining rows.
    """
    gain = tuple(tuple(row) for row in nodes.gyro_gain.tolist())
    _spread(gyr_dps, nodes.bias_rad, (nodes.rows_per_node, 1.0 / rate_hz, TAPS, gain), up, first, out)


@inner
def _read(table: Any, row: int) -> Any:  # pragma: no cover
    """Return a row as a triple; rows outside are replaced by the first or last row."""
    inside = 0 if row < 0 else row if row < len(table) else len(table) - 1
    return float(table[inside, 0]), float(table[inside, 1]), float(table[inside, 2])


@fused
def _mix(before: Any, now: Any, after: Any, taps: Any, offset: Any) -> Any:  # pragma: no cover
    """Return the rate of a row, rad/s, for the trapezoid; ``taps`` rad/s per deg/s, ``offset`` rad/s."""
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
    """Compute the nodes' mean accelerations and the rotations between them.

    One pass over the rows, from each node to the next. The rows nearer to the previous node are rotated back
    to it; those nearer to the next node are summed and rotated forward.
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
    """Return the rotation vector of ``first``, then ``second`` in the rotated frame."""
    return (
        first[0] + second[0] + 0.5 * (first[1] * second[2] - first[2] * second[1]),
        first[1] + second[1] + 0.5 * (first[2] * second[0] - first[0] * second[2]),
        first[2] + second[2] + 0.5 * (first[0] * second[1] - first[1] * second[0]),
    )


@kernel
def _spread(gyr: Any, bias: Any, steps: Any, up: Any, first: int, out: Any) -> None:  # pragma: no cover
    """Propagate the vertical of each node to the rows before and after it."""
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
    """Propagate from the row beside a node outwards; backwards in time if the period is negative."""
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


# Checks of the arrays that callers pass to the estimators.

UNIT_WITHIN = 0.01
OTHER_UNIT = 3.0
"""If the median length differs from 1 g by this factor, the unit is not g: nobody moves so hard all day."""


def check_arrays(acc_g: object, gyr_dps: object, rate_hz: float) -> tuple[FloatArray, FloatArray]:
    """Return both as float32 or float64 arrays of shape (n, 3), C order; views if no change is needed.

    Raises UnusableArrays: other shapes, unequal lengths, values that are not finite, or a rate that is not
    positive.
    """
    acc, gyr = _as_floats(acc_g), _as_floats(gyr_dps)
    if acc.ndim != 2 or acc.shape[1] != 3 or acc.shape != gyr.shape:
        raise UnusableArrays(why="shape", acc=str(acc.shape), gyr=str(gyr.shape))
    check_rate(rate_hz)
    if not (np.isfinite(acc).all() and np.isfinite(gyr).all()):
        raise UnusableArrays(why="finite")
    return acc, gyr


def check_rate(rate_hz: float) -> None:
    """Raise UnusableArrays if the rate is not positive."""
    if not (isfinite(rate_hz) and rate_hz > 0.0):
        raise UnusableArrays(why="rate", rate_hz=float(rate_hz))


def check_direction(axis: object) -> Float64Array:
    """Return a unit vector as a separate array, shape (3,).

    A length more than 1 % from 1 indicates an acceleration or a typing error instead of a direction.

    Raises UnusableArrays.
    """
    try:
        vector = np.array(axis, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UnusableArrays(why="axis", axis=repr(axis)[:60]) from error
    if vector.shape != (3,) or not abs(np.linalg.norm(vector) - 1.0) <= UNIT_WITHIN:
        raise UnusableArrays(why="axis", axis=str(vector.tolist()))
    return vector


def check_gravity(acc_g: FloatArray) -> None:
    """Check that there are samples, and that the acceleration is in g: its median length is near 1.

    Raises UnusableArrays.
    """
    if len(acc_g) == 0:
        raise UnusableArrays(why="empty")
    few = acc_g[:: -(-len(acc_g) // 10_000)].astype(np.float64)
    length_g = float(np.median(np.linalg.norm(few, axis=1)))
    if not 1.0 / OTHER_UNIT < length_g < OTHER_UNIT:
        raise UnusableArrays(why="unit", g=round(length_g, 3))


def _as_floats(values: object) -> FloatArray:
    array: NDArray[np.generic] = np.asarray(values)
    if array.dtype == np.float32:
        return np.ascontiguousarray(array, dtype=np.float32)
    try:
        return np.ascontiguousarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise UnusableArrays(why="numbers") from error
