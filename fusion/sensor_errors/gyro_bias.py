"""The gyroscope's bias through the recording, from still moments and from motion together.

The bias is a straight line between knots one minute apart, held together by a random walk. Two kinds of
observation pull at it: the mean angular rate of still moments, and the window equations of
:mod:`fusion.sensor_errors.motion_windows`. All are solved together by robust least squares (Cauchy weights).
Where the still moments show that it jumped, the line is broken there: a part that was switched off and on, or
another sensor from there on, has another offset, and one walk through both would be wrong on one side.
Still moments are told by how little the rate varies, never by its level, so an offset of tens of deg/s does
not hide them; a steady turn mistaken for rest is outvoted by the motion windows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from fusion.sensor_errors.bias_track import GyroBias, hold_bias
from fusion.sensor_errors.knots import JUMP_S, Hats, hold_together
from fusion.sensor_errors.motion_windows import WindowEquations, form_equations
from fusion.sensor_errors.nodes import Nodes, reduce_to_nodes
from fusion.sensor_errors.rotation import RADIANS
from fusion.sensor_errors.runs import SensorRun
from fusion.sensor_errors.stillness import QuietTable, find_still_moments, reduce_run

Table = NDArray[np.float64]
CAUCHY = 2.385
LOOSE = 1e-4  # a very weak pull to the start, so that the equations can be solved


@dataclass(frozen=True, slots=True)
class BiasSettings:
    """How the bias is sought.

    ``window_s`` is the length of the motion windows, placed every ``window_every_s`` in files up to
    ``dense_up_to_s`` and every ``window_apart_s`` in longer ones; ``wander_dps_per_root_min`` is the random
    walk; ``still_floor_dps`` the error of a still moment however quiet. With fewer than ``least_stills``
    still moments the search starts from nil, with windows that grow. A change of ``jump_dps`` from the median
    of ``jump_stills`` still moments to that of the next is a jump.
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


def estimate_gyro_bias(
    runs: Sequence[SensorRun],
    stills: QuietTable | None = None,
    settings: BiasSettings | None = None,
) -> GyroBias:
    """Find the bias of all runs of one recording together; ``stills`` where they are known already.

    Compared to the publication: the paper subtracts the mean of one still period; this is ours, for
    `smoothed`.
    """
    if stills is None:
        stills = find_still_moments([reduce_run(run) for run in runs])
    return follow_gyro_bias(reduce_about_start(runs, stills, settings), stills, settings)


def follow_gyro_bias(
    nodes: Sequence[Nodes], stills: QuietTable, settings: BiasSettings | None = None
) -> GyroBias:
    """The same from nodes that have a bias near the true one taken off."""
    settings = settings or BiasSettings()
    bias = hold_bias(nodes[0].bias_rad[0] / RADIANS)
    knots_s = _break_at(_place_knots(nodes, settings), find_jumps(stills, settings))
    dense = sum(len(run.acc_g) * run.period_s for run in nodes) <= settings.dense_up_to_s
    every_s = settings.window_every_s if dense else settings.window_apart_s
    for _ in range(settings.rounds):
        windows = form_equations(nodes, bias, settings.window_s, every_s)
        bias = _solve(knots_s, bias.at(knots_s), stills, windows, settings)
    return bias


def reduce_about_start(
    runs: Sequence[SensorRun], stills: QuietTable, settings: BiasSettings | None = None
) -> list[Nodes]:
    """The nodes of all runs with a constant taken off: the median of the still moments, or grown from nil."""
    settings = settings or BiasSettings()
    if len(stills) >= settings.least_stills:
        bias = hold_bias(np.median(stills.gyro_dps, axis=0))
    else:
        bias = _grow_windows([reduce_to_nodes(run, hold_bias(np.zeros(3))) for run in runs], settings)
    return [reduce_to_nodes(run, bias) for run in runs]


def _grow_windows(nodes: Sequence[Nodes], settings: BiasSettings) -> GyroBias:
    """From nil: windows so short that an offset of tens of deg/s barely turns them, then longer ones."""
    bias = hold_bias(np.zeros(3))
    total_s = sum(len(run.acc_g) * run.period_s for run in nodes)
    for length_s in (1.0, 1.0, 2.0, 4.0, 8.0, settings.window_s):
        windows = form_equations(nodes, bias, length_s, max(length_s / 2.0, total_s / 200.0))
        if len(windows.time_s) > 0:
            bias = hold_bias(_solve_constant(windows, bias.bias_dps[0]))
    return bias


def _place_knots(nodes: Sequence[Nodes], settings: BiasSettings) -> Table:
    first_s = nodes[0].start_s
    last_s = max(nodes[-1].start_s + len(nodes[-1].acc_g) * nodes[-1].period_s, first_s + 1e-3)
    pieces = max(1, round((last_s - first_s) / settings.knot_s))
    return np.linspace(first_s, last_s, pieces + 1)


def find_jumps(stills: QuietTable, settings: BiasSettings) -> list[float]:
    """Times, s, at which the offset jumped: between two still moments."""
    count = settings.jump_stills
    if len(stills) < 2 * count:
        return []
    medians = np.median(sliding_window_view(stills.gyro_dps, count, axis=0), axis=2)
    change_dps = np.linalg.norm(medians[count:] - medians[:-count], axis=1)
    jumps: list[float] = []
    while len(change_dps) and change_dps.max() > settings.jump_dps:
        at = int(np.argmax(change_dps))
        jumps.append(float(stills.middle_s[at + count - 1 : at + count + 1].mean()))
        change_dps[max(0, at - count) : at + count + 1] = 0.0
    return sorted(jumps)


def _break_at(knots_s: Table, jumps_s: list[float]) -> Table:
    """Two knots at each jump in place of those within a second of it."""
    for jump_s in jumps_s:
        kept = knots_s[np.abs(knots_s - jump_s) > 1.0]
        knots_s = np.sort(np.concatenate([kept, [jump_s - JUMP_S / 2.0, jump_s + JUMP_S / 2.0]]))
    return knots_s


def _weigh(residual: Table) -> Table:
    """Cauchy weights over the residuals' own scale, as inverse variances (per axis)."""
    size = np.linalg.norm(residual, axis=1)
    scale = max(1.2 * float(np.median(size)), 1e-4) if len(size) else 1.0
    return np.asarray(1.0 / (scale**2 * (1.0 + (size / (CAUCHY * scale)) ** 2)))


def _solve_constant(windows: WindowEquations, start_dps: Table) -> Table:
    bias = start_dps
    for _ in range(5):
        weight = _weigh(windows.residual(bias))
        normal = np.einsum("w,wij,wik->jk", weight, windows.matrix, windows.matrix) + 1e-3 * np.eye(3)
        right = np.einsum("w,wij,wi->j", weight, windows.matrix, windows.difference) + 1e-3 * start_dps
        bias = np.linalg.solve(normal, right)
    return bias


def _solve(
    knots_s: Table, start_dps: Table, stills: QuietTable, windows: WindowEquations, settings: BiasSettings
) -> GyroBias:
    """One round: all observations together, weights and solution in turn."""
    overlap = max(1.0, settings.window_s / windows.every_s)
    bias = GyroBias(knots_s, start_dps, len(stills), len(windows.time_s))
    in_windows, in_stills = Hats(knots_s, windows.time_s), Hats(knots_s, stills.middle_s)
    for _ in range(5):
        weight = _weigh(windows.residual(bias.at(windows.time_s))) / overlap
        still_weight = _weigh_stills(stills, bias, settings)
        band = hold_together(knots_s, settings.wander_dps_per_root_min)
        band[0] += LOOSE
        right = LOOSE * start_dps.ravel()
        squares = np.einsum("w,wij,wik->wjk", weight, windows.matrix, windows.matrix)
        pulls = np.einsum("w,wij,wi->wj", weight, windows.matrix, windows.difference)
        in_windows.add(band, right, squares, pulls)
        in_stills.add_alike(band, right, still_weight, still_weight[:, None] * stills.gyro_dps)
        values = solveh_banded(band, right, lower=True).reshape(-1, 3)
        bias = GyroBias(knots_s, values, len(stills), len(windows.time_s))
    return bias


def _weigh_stills(stills: QuietTable, bias: GyroBias, settings: BiasSettings) -> Table:
    variance = settings.still_floor_dps**2 + stills.gyro_sd_dps**2 / 4.0
    off = np.linalg.norm(stills.gyro_dps - bias.at(stills.middle_s), axis=1)
    return np.asarray(1.0 / (variance * (1.0 + off**2 / (CAUCHY**2 * variance))))
