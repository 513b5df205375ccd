"""Gyroscope errors: the bias through the recording, and the scale and misalignment of its axes.

The bias is estimated from still moments and motion together. It is piecewise linear between knots one minute
apart, regularised by a random walk. There are two kinds of observation: the mean angular rate of still
moments, and window equations from motion. Robust least squares (Cauchy weights) solves all of them together.
If the still moments show a jump, the line is broken there: a sensor that was switched off and on, or
replaced, has another offset, and one continuous line through both offsets would be wrong on both sides of the
jump. Still moments are detected by the variation of the rate, not by its level, so an offset of tens of deg/s
does not hide them. If a steady rotation is mistaken for rest, the motion windows outweigh it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from acromion.fusion.numba_kernels import kernel
from acromion.fusion.numerics import CAUCHY
from acromion.fusion.recording import Float64Array
from acromion.fusion.sensor.model import (
    JUMP_S,
    RADIANS,
    AccelerometerCorrection,
    GyroBias,
    LinearInterpolator,
    Nodes,
    SensorRun,
    build_constant_bias,
    build_random_walk,
    carry,
    reduce_to_nodes,
    solve_band,
    turn_factors,
)
from acromion.fusion.sensor.stillness import QuietTable

# Estimate the gyroscope's bias from motion.
#
# Within a window of about twelve seconds the acceleration is rotated into the frame at the start of the
# window. A person does not accelerate for long, so the mean of the second half minus the mean of the first
# should be zero. A remaining bias tilts the frame, and the difference becomes ``(dM b) x g`` with ``dM`` the
# difference of the mean integrals of the rotation. This is linear in the bias, and many windows together
# determine it.


@dataclass(frozen=True, slots=True, eq=False)
class WindowEquations:
    """One vector equation ``matrix @ bias = difference`` per window; ``bias`` is the total bias, deg/s.

    ``time_s`` (w,): middle of the window.
    ``matrix`` (w, 3, 3): in g per deg/s.
    ``difference`` (w, 3): in g.
    ``every_s``: distance between windows; they overlap if it is less than their length.
    """

    time_s: Float64Array
    matrix: Float64Array
    difference: Float64Array
    every_s: float

    def residual(self, bias_dps: Float64Array) -> Float64Array:
        """Return the remaining differences for a bias (3,) or (w, 3)."""
        predicted = np.einsum("wij,wj->wi", self.matrix, np.broadcast_to(bias_dps, self.difference.shape))
        return np.asarray(self.difference - predicted)


def form_equations(
    nodes: Sequence[Nodes], bias: GyroBias, length_s: float, every_s: float
) -> WindowEquations:
    """Build the equations of windows over all runs, linearised about ``bias``."""
    parts = [_form_of_run(run, bias, length_s, every_s) for run in nodes]
    time_s, matrix, difference = (np.concatenate(column) for column in zip(*parts, strict=True))
    return WindowEquations(time_s, matrix, difference, every_s)


def _form_of_run(
    nodes: Nodes, bias: GyroBias, length_s: float, every_s: float
) -> tuple[Float64Array, Float64Array, Float64Array]:
    half = max(1, round(length_s / nodes.period_s / 2.0))
    step = max(1, round(every_s / nodes.period_s))
    first = np.arange(0, len(nodes.acc_g) - 2 * half + 1, step)
    middle_s = np.asarray(nodes.start_s + (first + half) * nodes.period_s, dtype=np.float64)
    total = bias.at(middle_s)
    remaining = total * RADIANS - nodes.bias_rad[first + half]
    spread, difference, felt = np.zeros((len(first), 3, 3)), *np.zeros((2, len(first), 3))
    room = (np.empty((3, 3)), np.empty((3, 3)))
    steps, out = (half, nodes.period_s), (spread, difference, felt)
    _walk_windows(nodes.acc_g, nodes.turn_rad, first, steps, remaining, room, out)
    up = felt / (np.linalg.norm(felt, axis=1, keepdims=True) + 1e-12)
    matrix = np.cross(RADIANS * spread, up[:, :, None], axis=1)
    whole = np.asarray(difference + np.einsum("wij,wj->wi", matrix, total), dtype=np.float64)
    return middle_s, matrix, whole


@kernel
def _walk_windows(
    acc: Any, turns: Any, first: Any, steps: Any, bias: Any, room: Any, out: Any
) -> None:  # pragma: no cover
    """Integrate the windows that begin at the nodes ``first``, with ``bias`` (w, 3), rad/s, subtracted.

    Writes to ``out``, all in the window's first frame: the mean of the second half minus that of the first,
    of the integrated rotation (w, 3, 3) and of the acceleration (w, 3); and the sum of the acceleration (w,
    3).
    """
    half, period_s = steps
    frame, turned = room
    spread, difference, total = out
    for w in range(len(first)):
        x, y, z = period_s * bias[w, 0], period_s * bias[w, 1], period_s * bias[w, 2]
        for i in range(3):
            for j in range(3):
                frame[i, j], turned[i, j] = 1.0 if i == j else 0.0, 0.0
        for step in range(2 * half):
            row = first[w] + step
            share = -1.0 / half if step < half else 1.0 / half
            moved = 1.0 if step > 0 else 0.0
            turn = (moved * (turns[row, 0] - x), moved * (turns[row, 1] - y), moved * (turns[row, 2] - z))
            factors = turn_factors(turn)
            for i in range(3):
                seen = carry((frame[i, 0], frame[i, 1], frame[i, 2]), turn, factors)
                frame[i, 0], frame[i, 1], frame[i, 2] = seen
                felt = seen[0] * acc[row, 0] + seen[1] * acc[row, 1] + seen[2] * acc[row, 2]
                difference[w, i] += share * felt
                total[w, i] += felt
                for j in range(3):
                    turned[i, j] += frame[i, j] * period_s
                    spread[w, i, j] += share * turned[i, j]


LOOSE = 1e-4  # a very weak pull towards the starting value, so that the equations can be solved


@dataclass(frozen=True, slots=True)
class BiasSettings:
    """Settings of the bias estimate.

    ``window_s``: length of the motion windows, placed every ``window_every_s`` in files up to
    ``dense_up_to_s`` and every ``window_apart_s`` in longer ones.
    ``wander_dps_per_root_min``: the random walk.
    ``still_floor_dps``: the error of even the quietest still moment.
    ``least_stills``: with fewer still moments the search starts from zero, with windows of increasing length.
    ``jump_dps``: a larger change from the median of ``jump_stills`` still moments to that of the next is a
    jump.
    """

    window_s: float = 12.0
    window_every_s: float = 3.0
    window_apart_s: float = 30.0
    dense_up_to_s: float = 1200.0
    knot_s: float = 60.0
    wander_dps_per_root_min: float = 0.03
    still_floor_dps: float = 0.05
    least_stills: int = 3
    rounds: int = 2
    jump_dps: float = 5.0
    jump_stills: int = 7


BIAS = BiasSettings()


def estimate_gyro_bias_track(nodes: Sequence[Nodes], stills: QuietTable) -> GyroBias:
    """Estimate the bias of all runs of a recording together, from nodes with an approximate bias subtracted.

    Compared to the publication: the paper subtracts the mean of one still period; this estimate is ours, for
    `smoothed`.
    """
    bias = build_constant_bias(nodes[0].bias_rad[0] / RADIANS)
    first_s = nodes[0].start_s
    last_s = max(nodes[-1].start_s + len(nodes[-1].acc_g) * nodes[-1].period_s, first_s + 1e-3)
    pieces = max(1, round((last_s - first_s) / BIAS.knot_s))
    knots_s = np.linspace(first_s, last_s, pieces + 1)
    for jump_s in find_jumps(stills):  # two knots replace those within a second of it
        kept = knots_s[np.abs(knots_s - jump_s) > 1.0]
        knots_s = np.sort(np.concatenate([kept, [jump_s - JUMP_S / 2.0, jump_s + JUMP_S / 2.0]]))
    dense = sum(len(run.acc_g) * run.period_s for run in nodes) <= BIAS.dense_up_to_s
    every_s = BIAS.window_every_s if dense else BIAS.window_apart_s
    for _ in range(BIAS.rounds):
        windows = form_equations(nodes, bias, BIAS.window_s, every_s)
        bias = _solve(knots_s, bias.at(knots_s), stills, windows)
    return bias


def reduce_about_start(runs: Sequence[SensorRun], stills: QuietTable) -> list[Nodes]:
    """Return the nodes of all runs minus a constant: the median of still moments, or from motion."""
    if len(stills) >= BIAS.least_stills:
        bias = build_constant_bias(np.median(stills.gyro_dps, axis=0))
    else:
        bias = _grow_windows([reduce_to_nodes(run, build_constant_bias(np.zeros(3))) for run in runs])
    return [reduce_to_nodes(run, bias) for run in runs]


def _grow_windows(nodes: Sequence[Nodes]) -> GyroBias:
    """Estimate a constant bias from zero, with windows that start so short that it barely rotates them."""
    bias = build_constant_bias(np.zeros(3))
    total_s = sum(len(run.acc_g) * run.period_s for run in nodes)
    for length_s in (1.0, 1.0, 2.0, 4.0, 8.0, BIAS.window_s):
        windows = form_equations(nodes, bias, length_s, max(length_s / 2.0, total_s / 200.0))
        if len(windows.time_s) == 0:
            continue
        bias_dps = start_dps = bias.bias_dps[0]
        for _ in range(5):
            weight = _weigh(windows.residual(bias_dps))
            normal = np.einsum("w,wij,wik->jk", weight, windows.matrix, windows.matrix) + 1e-3 * np.eye(3)
            right = np.einsum("w,wij,wi->j", weight, windows.matrix, windows.difference) + 1e-3 * start_dps
            bias_dps = np.linalg.solve(normal, right)
        bias = build_constant_bias(bias_dps)
    return bias


def find_jumps(stills: QuietTable) -> list[float]:
    """Return the times, s, at which the offset jumped: between two still moments."""
    count = BIAS.jump_stills
    if len(stills) < 2 * count:
        return []
    medians = np.median(sliding_window_view(stills.gyro_dps, count, axis=0), axis=2)
    change_dps = np.linalg.norm(medians[count:] - medians[:-count], axis=1)
    jumps: list[float] = []
    while len(change_dps) and change_dps.max() > BIAS.jump_dps:
        # medians show a jump some moments too early and too late, so take the middle of the highest plateau
        highest = int(np.argmax(change_dps))
        lower = np.flatnonzero(change_dps < 0.5 * change_dps[highest])
        first = int(lower[lower < highest].max(initial=-1)) + 1
        at = (first + int(lower[lower > highest].min(initial=len(change_dps))) - 1) // 2
        jumps.append(float(stills.middle_s[at + count - 1 : at + count + 1].mean()))
        change_dps[max(0, at - count) : at + count + 1] = 0.0
    return sorted(jumps)


def _weigh(residual: Float64Array) -> Float64Array:
    """Return Cauchy weights relative to the scale of the residuals, as inverse variances (per axis)."""
    size = np.linalg.norm(residual, axis=1)
    scale = max(1.2 * float(np.median(size)), 1e-4) if len(size) else 1.0
    return np.asarray(1.0 / (scale**2 * (1.0 + (size / (CAUCHY * scale)) ** 2)))


def _solve(
    knots_s: Float64Array, start_dps: Float64Array, stills: QuietTable, windows: WindowEquations
) -> GyroBias:
    """Run one round with all observations, alternating weights and solution."""
    overlap = max(1.0, BIAS.window_s / windows.every_s)
    variance = BIAS.still_floor_dps**2 + stills.gyro_sd_dps**2 / 4.0
    bias = GyroBias(knots_s, start_dps, len(stills), len(windows.time_s))
    in_windows, in_stills = (
        LinearInterpolator(knots_s, windows.time_s),
        LinearInterpolator(knots_s, stills.middle_s),
    )
    for _ in range(5):
        weight = _weigh(windows.residual(bias.at(windows.time_s))) / overlap
        off_dps = np.linalg.norm(stills.gyro_dps - bias.at(stills.middle_s), axis=1)
        still_weight = 1.0 / (variance * (1.0 + off_dps**2 / (CAUCHY**2 * variance)))
        band = build_random_walk(knots_s, BIAS.wander_dps_per_root_min)
        band[0] += LOOSE
        right = LOOSE * start_dps.ravel()
        squares = np.einsum("w,wij,wik->wjk", weight, windows.matrix, windows.matrix)
        pulls = np.einsum("w,wij,wi->wj", weight, windows.matrix, windows.difference)
        in_windows.add(band, right, squares, pulls)
        in_stills.add_alike(band, right, still_weight, still_weight[:, None] * stills.gyro_dps)
        values = solve_band(band, right[None]).reshape(-1, 3)
        bias = GyroBias(knots_s, values, len(stills), len(windows.time_s))
    return bias


# Scale and misalignment of the gyroscope's axes, from the rotation between successive still moments.


@dataclass(frozen=True, slots=True)
class GyroScaleSettings:
    """Settings of the scale estimate, and when it is applied.

    ``longest_s``: still moments up to this far apart are compared.
    ``scale``: expected standard deviation of each of the nine errors (1 % of scale and 0.3 % of misalignment
    together).
    ``still_g``, ``bias_dps``, ``turn_share``: the error of a vertical at rest, of the bias, and per radian of
    rotation.
    ``believed_error``: the gain is applied only if the root mean square of the nine standard errors is
    smaller.
    ``most``: the gain is applied only if no rate changes by more than this. ``most_pairs``: if a run has more
    pairs, this many are used at even steps.
    """

    longest_s: float = 40.0
    scale: float = 0.006
    still_g: float = 0.004
    bias_dps: float = 0.03
    turn_share: float = 0.0005
    believed_error: float = 0.002
    most: float = 0.03
    most_pairs: int = 2000
    rounds: int = 6


SCALE = GyroScaleSettings()


@dataclass(frozen=True, slots=True, eq=False)
class GyroScale:
    """The correction: true rate = ``gain`` (3, 3) @ the measured one.

    ``error``: root mean square of the nine standard errors; ``pairs``: number of pairs used.
    """

    gain: Float64Array
    error: float
    pairs: int = 0


def build_identity_gyro_scale() -> GyroScale:
    """Return no correction."""
    return GyroScale(np.eye(3), SCALE.scale)


def estimate_gyro_scale(
    nodes: Sequence[Nodes], stills: QuietTable, bias: GyroBias, accelerometer: AccelerometerCorrection
) -> GyroScale:
    """Compare successive still moments; ``nodes`` with some bias subtracted, ``bias`` the final one."""
    up = accelerometer.find_up(stills.gravity_g, stills.middle_s)
    parts = [_compare_in_run(run, stills.middle_s, up, bias) for run in nodes]
    slope, miss, variance = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    if len(miss) == 0:
        return build_identity_gyro_scale()
    errors, standard_error = _fit(slope, miss, variance)
    if standard_error > SCALE.believed_error or np.linalg.norm(errors, 2) > SCALE.most:
        return build_identity_gyro_scale()
    return GyroScale(np.eye(3) + errors, standard_error, len(miss))


def _compare_in_run(
    nodes: Nodes, middle_s: Float64Array, up: Float64Array, bias: GyroBias
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return slopes (w, 3, 9), misses (w, 3) and variances (w,) of the still-moment pairs in a run."""
    place = np.round((middle_s - nodes.start_s) / nodes.period_s).astype(np.int64)
    inside = np.flatnonzero((place >= 0) & (place < len(nodes.acc_g)))
    gap_s = np.diff(middle_s[inside])
    near = np.flatnonzero(gap_s < SCALE.longest_s)
    near = near[:: -(-len(near) // SCALE.most_pairs) or 1]
    first, second = inside[near], inside[near + 1]
    left_rad = bias.at(middle_s[first] + gap_s[near] / 2.0) * RADIANS - nodes.bias_rad[place[first]]
    frame, drift, turned = np.zeros((len(near), 3, 3)), np.zeros((len(near), 3, 9)), np.zeros(len(near))
    _carry_between(
        nodes.turn_rad, left_rad * nodes.period_s, place[first], place[second], frame, drift, turned
    )
    slope = np.cross(drift, up[first][:, :, None], axis=1)
    miss = np.einsum("wij,wj->wi", frame, up[second]) - up[first]
    variance = SCALE.still_g**2 + (np.radians(SCALE.bias_dps) * gap_s[near]) ** 2
    return slope, miss, variance + (SCALE.turn_share * turned) ** 2


def _fit(slope: Float64Array, miss: Float64Array, variance: Float64Array) -> tuple[Float64Array, float]:
    """Solve damped least squares, Cauchy weights; return the gain minus one, (3, 3), and standard error."""
    prior = np.eye(9) / SCALE.scale**2
    weight, solution, normal = 1.0 / variance, np.zeros(9), prior
    for _ in range(SCALE.rounds):
        normal = np.einsum("w,wij,wik->jk", weight, slope, slope, optimize=True) + prior
        solution = np.linalg.solve(normal, np.einsum("w,wij,wi->j", weight, slope, miss, optimize=True))
        square = ((miss - slope @ solution) ** 2).sum(axis=1)
        excess = max(1.0, float(np.median(square / variance)) / 1.4)
        weight = 1.0 / (excess * variance * (1.0 + square / (5.7 * excess * variance)))
    return solution.reshape(3, 3), float(np.sqrt(np.trace(np.linalg.inv(normal)) / 9.0))


@kernel
def _carry_between(
    turns: Any, left: Any, first: Any, second: Any, frames: Any, drifts: Any, turned: Any
) -> None:  # pragma: no cover
    """Compute the rotation from one node to another: it takes vectors of the second frame to the first.

    ``left`` (w, 3): the part of each step's rotation that is remaining bias. Column 3 j + k of the drifts:
    the effect of a share of the rate about axis k that appears on axis j. ``turned``: length of the path,
    rad.
    """
    for w in range(len(first)):
        x, y, z = left[w, 0], left[w, 1], left[w, 2]
        for i in range(3):
            frames[w, i, i] = 1.0
        for row in range(first[w] + 1, second[w] + 1):
            turn = (turns[row, 0] - x, turns[row, 1] - y, turns[row, 2] - z)
            factors = turn_factors(turn)
            turned[w] += sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
            for i in range(3):
                seen = carry((frames[w, i, 0], frames[w, i, 1], frames[w, i, 2]), turn, factors)
                frames[w, i, 0], frames[w, i, 1], frames[w, i, 2] = seen
                for j in range(3):
                    drifts[w, i, 3 * j] -= frames[w, i, j] * turn[0]
                    drifts[w, i, 3 * j + 1] -= frames[w, i, j] * turn[1]
                    drifts[w, i, 3 * j + 2] -= frames[w, i, j] * turn[2]
