"""What the accelerometer reads of gravity while the arm moves.

Turned into one frame by the gyroscope and averaged over some seconds, the sensor's own acceleration becomes
the change of its velocity by the time, next to nothing: wherever the sensor sits, as centripetal acceleration
is a part of it. What is left is gravity and the offset as the motion turned it about, so that the length of
the mean tells the offset along the mean direction of gravity in the sensor.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fusion.sensor_errors.accelerometer import MovingReadings
from fusion.sensor_errors.nodes import Nodes

Table = NDArray[np.float64]
WINDOW_S = 4.0
EVERY_S = 1.0
MOST_WINDOWS = 2000
LEAST_SHARE = 0.5
"""Where the sensor turned about so much that less of the offset is left, the window tells too little."""
CALM_G = 0.15
"""A livelier one (root mean square about the mean) tells errors of scale, too, and of the gyroscope."""


def read_while_moving(nodes: Sequence[Nodes]) -> MovingReadings:
    """One reading for each window of 4 s of all runs; ``nodes`` with the bias taken off.

    Runs of one rate are read together: a day of thousands of short ones takes no longer than a whole one.
    """
    alike: dict[int, list[Nodes]] = {}
    for run in nodes:
        alike.setdefault(max(1, round(WINDOW_S / run.period_s)), []).append(run)
    parts = [_read_runs(runs, steps) for steps, runs in alike.items()]
    return MovingReadings(
        np.concatenate([part.time_s for part in parts]), np.concatenate([part.gravity_g for part in parts])
    )


def _read_runs(runs: Sequence[Nodes], steps: int) -> MovingReadings:
    first, middle_s = _place_windows(runs, steps)
    acc_g = np.concatenate([run.acc_g for run in runs])
    turn_rad = np.concatenate([run.turn_rad for run in runs])
    felt, turned, squares = _average(acc_g, turn_rad, first, steps)
    length_g = np.maximum(np.linalg.norm(felt, axis=1), 1e-9)
    spread = squares - length_g**2
    # The mean is as long as gravity and, of the offset, what points along it in the mean.
    slope = np.einsum("wij,wi->wj", turned, felt / length_g[:, None])
    share = np.linalg.norm(slope, axis=1)
    told = (share > LEAST_SHARE) & (spread < CALM_G**2)
    slope, share, length_g = slope[told], share[told], length_g[told]
    gravity_g = slope / share[:, None] * (1.0 + (length_g - 1.0) / share)[:, None]
    return MovingReadings(middle_s[told], gravity_g)


def _place_windows(runs: Sequence[Nodes], steps: int) -> tuple[NDArray[np.intp], Table]:
    """First node of each window, counted through all runs, and its middle, s; none spans two runs."""
    firsts, middles_s, before = [], [], 0
    for run in runs:
        own = np.arange(0, len(run.acc_g) - steps + 1, max(1, round(EVERY_S / run.period_s)))
        firsts.append(own + before)
        middles_s.append(run.start_s + (own + steps / 2.0) * run.period_s)
        before += len(run.acc_g)
    first, middle_s = np.concatenate(firsts), np.concatenate(middles_s)
    every = -(-len(first) // MOST_WINDOWS) or 1
    return first[::every], middle_s[::every]


def _average(
    acc_g: Table, turn_rad: Table, first: NDArray[np.intp], steps: int
) -> tuple[Table, Table, Table]:
    """Mean acceleration (w, 3) and rotation (w, 3, 3) in each window's first frame, and mean square (w,)."""
    weight = np.hanning(steps + 2)[1:-1]
    weight /= weight.sum()
    frame = np.repeat(np.eye(3)[None], len(first), axis=0)
    felt, turned, squares = np.zeros((len(first), 3)), np.zeros((len(first), 3, 3)), np.zeros(len(first))
    for step in range(steps):
        if step > 0:
            frame = frame @ _turn_back(turn_rad[first + step])
        felt += weight[step] * np.einsum("wij,wj->wi", frame, acc_g[first + step])
        turned += weight[step] * frame
        squares += weight[step] * (acc_g[first + step] ** 2).sum(axis=1)
    return felt, turned, squares


def _turn_back(turn_rad: Table) -> Table:
    """Matrices (w, 3, 3) that take what is seen after each turn (w, 3) to what was seen before."""
    angle = np.maximum(np.linalg.norm(turn_rad, axis=1), 1e-12)[:, None, None]
    x, y, z = turn_rad.T
    nil = np.zeros(len(turn_rad))
    cross = np.stack([nil, -z, y, z, nil, -x, -y, x, nil], axis=1).reshape(-1, 3, 3)
    return np.asarray(
        np.eye(3) + np.sin(angle) / angle * cross + (1.0 - np.cos(angle)) / angle**2 * (cross @ cross)
    )
