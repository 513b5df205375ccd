"""Does gravity, carried along the gyroscope for eight seconds, stay where it was: the evidence for its axes.

Within a window the acceleration of every row is turned into the frame of the first row by what the gyroscope
says. There the mean of the second half must be that of the first: gravity stands still, and an arm's own
acceleration averages to its change of speed, a few hundredths of g over four seconds. What is missing is the
evidence for unit, sign, order and scale of the gyroscope's axes. Unlike moments picked because they look
still, whole windows are not drawn to the turning points of a swing, where the arm's own acceleration would
pass for a scale error of 10 %.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from math import cos, sin, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import inner, kernel
from fusion.recording import Float64Array, Segment

# Short looks, spread over a recording: where nothing moves, and what the sensors read then.


PROBED_BLOCKS = 150
BLOCK_S, MEAN_S = 8.0, 0.05
REST_S, FEWEST_RESTS = 1.0, 2
REST_PART = 0.015
"""At rest the acceleration scatters by less than this part of its length."""
RESTING_PART, ROUGH = 0.02, 0.3
"""The gyroscope rests where it scatters by less than this part of its liveliest stretch, or where each
reading is nearly independent of the one before: noise is, movement is not.
"""
STEADY_PART, SAME_DEG = 0.04, 10.0
"""The middle half of all rests in one direction read lengths within this part of each other: on a boat they
do not.
"""


def probe_blocks(segments: Sequence[Segment]) -> list[tuple[Segment, int, int]]:
    """Blocks of 8 s spread over the recording: all of a short one, 150 of a long one."""
    blocks = []
    for segment in segments:
        n, rows = max(8, round(BLOCK_S * segment.rate_hz)), len(segment)
        blocks += [(segment, first, min(first + n, rows)) for first in range(0, rows, n)]
    stride = max(1, -(-len(blocks) // PROBED_BLOCKS))
    return blocks[::stride]


@dataclass(frozen=True, slots=True, eq=False)
class Rests:
    """Mean readings, (n, 3) each, of seconds in which nothing moves, in whatever unit they are read.

    None (n = 0) is a state of its own: nothing follows for gravity from a recording without rest.
    """

    acc: Float64Array
    gyr: Float64Array

    def __len__(self) -> int:
        return len(self.acc)

    @property
    def length(self) -> float:
        """Median length of the acceleration."""
        return float(np.median(np.linalg.norm(self.acc, axis=1)))


def find_rests(segments: Sequence[Segment]) -> Rests:
    """Find the seconds in which neither sensor shows movement; none where fewer than two do, or where they
    differ in length as they do on a boat.

    A channel that keeps one value measures nothing (a hole filled with zeros, an axis that stuck), unless
    most of the rests look so: then the readings are that coarse.
    """
    looks = [_look(*some) for some in _place_stretches(segments, REST_S, 8)]
    if not looks:
        return Rests(np.zeros((0, 3)), np.zeros((0, 3)))
    acc, acc_sd, gyr, gyr_sd, rough, flat = (np.concatenate(column) for column in zip(*looks, strict=True))
    length = np.linalg.norm(acc, axis=1)
    is_resting = (acc_sd <= REST_PART * length) & ((gyr_sd <= _find_quiet(segments)) | (rough > ROUGH))
    is_flat = is_resting & (flat > 0.0)
    if 2 * is_flat.sum() <= is_resting.sum():
        is_resting &= ~is_flat
    rests = Rests(acc[is_resting], gyr[is_resting])
    return rests if len(rests) >= FEWEST_RESTS and _is_steady(rests) else Rests(acc[:0], gyr[:0])


def measure_rest_part(segments: Sequence[Segment]) -> float | None:
    """Length of the acceleration while the gyroscope rests, over the longest of the recording.

    Gravity is also there at rest, whatever the unit. An acceleration from which it was taken out reads almost
    nothing then. None if the gyroscope never rests.
    """
    looks = [_look(*some) for some in _place_stretches(segments, REST_S, 8)]
    lengths = measure_lengths(segments)
    if not looks or len(lengths) == 0:
        return None
    acc, _, _, gyr_sd, rough, _ = (np.concatenate(column) for column in zip(*looks, strict=True))
    is_resting = (gyr_sd <= _find_quiet(segments)) | (rough > ROUGH)
    if np.count_nonzero(is_resting) < FEWEST_RESTS:
        return None
    longest = float(np.quantile(lengths, 0.95))
    return float(np.median(np.linalg.norm(acc[is_resting], axis=1))) / max(longest, 1e-12)


def _is_steady(rests: Rests) -> bool:
    """Whether the middle half of the rests reads one length wherever it reads one direction."""
    length = np.linalg.norm(rests.acc, axis=1)
    place = number_directions(rests.acc / np.maximum(length, 1e-12)[:, None], SAME_DEG)
    usual = np.array([np.median(length[place == k]) for k in range(place.max() + 1)])
    low, high = np.quantile(length - usual[place], [0.25, 0.75]).tolist()
    return bool(high - low <= STEADY_PART * rests.length)


def _place_stretches(
    segments: Sequence[Segment], length_s: float, fewest_rows: int
) -> Iterator[tuple[Segment, NDArray[np.int64], int]]:
    """Cut the blocks of each segment into stretches: their first rows (m,), and how many rows each has."""
    for _, some in groupby(probe_blocks(segments), key=lambda block: id(block[0])):
        blocks = list(some)
        segment = blocks[0][0]
        width = max(fewest_rows, round(length_s * segment.rate_hz))
        yield (
            segment,
            np.concatenate([np.arange(first, stop - width + 1, width) for _, first, stop in blocks]),
            width,
        )


def _look(segment: Segment, firsts: NDArray[np.int64], width_rows: int) -> tuple[Float64Array, ...]:
    """Of each stretch: means (m, 3) and scatter (m,) of both sensors, roughness, stuck channels."""
    acc, acc_sd, _ = _measure_stretches(segment.acc_g, firsts, width_rows)
    gyr, gyr_sd, steps = _measure_stretches(segment.gyr_dps, firsts, width_rows)
    rough = steps.mean(axis=1) / np.maximum(2.0 * np.square(gyr_sd).mean(axis=1), 1e-12)
    flat = (acc_sd == 0.0).any(axis=1) | (gyr_sd == 0.0).any(axis=1)
    return acc, acc_sd.max(axis=1), gyr, gyr_sd.max(axis=1), rough, flat.astype(np.float64)


def _find_quiet(segments: Sequence[Segment]) -> float:
    """Up to which scatter the gyroscope rests, in its own unit."""
    liveliest = 0.0
    for segment, first, stop in probe_blocks(segments):
        _, scatter, _ = _measure_stretches(segment.gyr_dps, np.array([first]), stop - first)
        liveliest = max(liveliest, float(scatter.max()))
    return RESTING_PART * liveliest


def _measure_stretches(
    samples: NDArray[np.float32], firsts: NDArray[np.int64], width_rows: int
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Mean, standard deviation and mean square step, (m, 3) each, of stretches of ``width_rows`` rows."""
    means, scatter, steps = (np.empty((len(firsts), 3)) for _ in range(3))
    _reduce_stretches(samples, firsts, width_rows, means, scatter, steps)
    return means, scatter, steps


@kernel
def _reduce_stretches(
    samples: Any, firsts: Any, width: int, means: Any, scatter: Any, steps: Any
) -> None:  # pragma: no cover
    for k in range(len(firsts)):
        start, stop = firsts[k], firsts[k] + width
        for axis in range(3):
            first = samples[start, axis]  # deviations from it are exactly 0 where nothing changes
            mean, square, step, last = 0.0, 0.0, 0.0, float(first)
            for row in range(start, stop):
                mean += (samples[row, axis] - first) / width
            for row in range(start, stop):
                away, value = samples[row, axis] - first - mean, float(samples[row, axis])
                square += away * away / width
                step += (value - last) * (value - last)
                last = value
            means[k, axis], scatter[k, axis], steps[k, axis] = first + mean, sqrt(square), step / (width - 1)


def measure_lengths(segments: Sequence[Segment], *, is_rate: bool = False) -> Float64Array:
    """Lengths, (n,), of means over 50 ms (3 rows at least): of the acceleration, or of the angular rate."""
    lengths = [np.zeros(0)]
    for segment, firsts, width in _place_stretches(segments, MEAN_S, 3):
        means, _, _ = _measure_stretches(segment.gyr_dps if is_rate else segment.acc_g, firsts, width)
        lengths.append(np.linalg.norm(means, axis=1))
    return np.concatenate(lengths)


def number_directions(unit: Float64Array, near_deg: float) -> NDArray[np.intp]:
    """Number the directions: each moment belongs to the first, in order of time, that is near it."""
    number, found = np.full(len(unit), -1, dtype=np.intp), 0
    left = np.arange(len(unit))
    while len(left):
        near = unit[left] @ unit[left[0]] > np.cos(np.radians(near_deg))
        near[0] = True
        number[left[near]] = found
        left, found = left[~near], found + 1
    return number


WINDOW_S = 8.0
SHORTEST_S = 0.8
"""Of a segment shorter than a window, the whole is one if it lasts so long."""
ROW_S = 0.02
PLAIN_G = 0.05
MOST_WINDOWS = 150
LIKELY_GAIN, LIKELY_DRIFT_DPS, LIKELY_OFFSET_G = 1.0, 15.0, 0.04
"""How far a fit may stray from where it began (a gain, as a share of it), one standard deviation."""
LEAST_SPREAD_G = 0.005
RADIANS = np.pi / 180.0


@dataclass(frozen=True, slots=True, eq=False)
class GravityWindows:
    """Rows of about 20 ms of all windows, one after the other.

    ``acc_g`` (m, 3); ``turn`` (m, 3): the gyroscope's reading times the period, from each row to the next, in
    rad if it reads deg/s; ``first`` (n + 1,): where the windows begin; ``period_s`` (n,).
    """

    acc_g: Float64Array
    turn: Float64Array
    first: NDArray[np.int64]
    period_s: Float64Array

    def __len__(self) -> int:
        return len(self.period_s)


@dataclass(frozen=True, slots=True, eq=False)
class GyroModel:
    """True rate = ``gain`` (3, 3) @ reading + ``drift_dps``; true acceleration = reading - ``offset_g``."""

    gain: Float64Array
    drift_dps: Float64Array
    offset_g: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class GyroFit:
    """A fitted model, its free values less where they began, (p,), and their standard errors."""

    model: GyroModel
    values: Float64Array
    errors: Float64Array


def cut_windows(
    segments: Sequence[Segment], cut_off_dps: float = np.inf, most: int = MOST_WINDOWS
) -> GravityWindows:
    """Windows of 8 s, each half over the one before, spread over the recording.

    Those in which the gyroscope reads ``cut_off_dps`` or more, or in which a channel stuck, are left out:
    what was cut off, or stood still while the arm turned, passes for a scale or for columns mixed up.
    """
    places = []
    for segment in segments:
        rows = min(round(WINDOW_S * segment.rate_hz), len(segment))
        if rows >= max(8, SHORTEST_S * segment.rate_hz):
            places += [(segment, first, rows) for first in range(0, len(segment) - rows + 1, rows // 2)]
    if np.isfinite(cut_off_dps):
        places = [place for place in places if _find_size(*place) < cut_off_dps]
    chosen = places[:: max(1, -(-len(places) // most))]
    stuck = _find_stuck(chosen)
    chosen = [place for place, is_stuck in zip(chosen, stuck, strict=True) if not is_stuck]
    cut = [_cut_window(*place) for place in chosen]
    if not cut:
        return GravityWindows(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(1, np.int64), np.zeros(0))
    acc, turn, period_s = zip(*cut, strict=True)
    first = np.concatenate([[0], np.cumsum([len(part) for part in acc])]).astype(np.int64)
    return GravityWindows(np.concatenate(acc), np.concatenate(turn), first, np.array(period_s))


def _find_size(segment: Segment, first_row: int, rows: int) -> float:
    return float(np.abs(segment.gyr_dps[first_row : first_row + rows]).max())


def _find_stuck(places: Sequence[tuple[Segment, int, int]]) -> NDArray[np.bool_]:
    """Which windows hold a channel that keeps one value all along, shape (n,), if elsewhere it does not.

    A channel that never changes is dead; :mod:`fusion.checks.faults` refuses it.
    """
    flat = np.array([_find_flat(*place) for place in places], np.bool_).reshape(-1, 6)
    return np.asarray((flat & ~flat.all(axis=0)).any(axis=1))


def _find_flat(segment: Segment, first_row: int, rows: int) -> NDArray[np.bool_]:
    sensors = (segment.acc_g[first_row : first_row + rows], segment.gyr_dps[first_row : first_row + rows])
    return np.concatenate([_keeps_value(values) for values in sensors])


def _keeps_value(values: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Which axes keep one value, (3,); most do not even at first."""
    is_flat = (values[:8] == values[0]).all(axis=0)
    return np.asarray((values == values[0]).all(axis=0) if is_flat.any() else is_flat)


def _cut_window(segment: Segment, first_row: int, rows: int) -> tuple[Float64Array, Float64Array, float]:
    """Means of 20 ms; the rate between two rows is a straight line."""
    width = max(1, round(ROW_S * segment.rate_hz))
    means = np.empty((2, rows // width // 2 * 2, 3))
    _average(segment.acc_g[first_row:], width, means[0])
    _average(segment.gyr_dps[first_row:], width, means[1])
    acc_g, gyr_dps = means
    period_s = width / segment.rate_hz
    turn = np.zeros_like(gyr_dps)
    turn[:-1] = (gyr_dps[:-1] + gyr_dps[1:]) * (0.5 * period_s * RADIANS)
    return acc_g, turn, period_s


@kernel
def _average(samples: Any, width: int, means: Any) -> None:  # pragma: no cover
    """Mean of each ``width`` rows."""
    for k in range(len(means)):
        for axis in range(3):
            total = 0.0
            for row in range(k * width, (k + 1) * width):
                total += samples[row, axis]
            means[k, axis] = total / width


def pick_windows(windows: GravityWindows, numbers: NDArray[np.int64]) -> GravityWindows:
    """Some of the windows."""
    lengths = np.diff(windows.first)[numbers]
    rows = np.concatenate(
        [np.arange(windows.first[k], windows.first[k + 1]) for k in numbers] or [np.zeros(0, np.int64)]
    )
    first = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
    return GravityWindows(windows.acc_g[rows], windows.turn[rows], first, windows.period_s[numbers])


def measure_speed_dps(windows: GravityWindows) -> Float64Array:
    """Root mean square of the angular rate in each window, deg/s if it reads deg/s, shape (n,)."""
    if len(windows) == 0:
        return np.zeros(0)
    square = np.add.reduceat((windows.turn**2).sum(axis=1), windows.first[:-1])
    return np.asarray(np.sqrt(square / np.diff(windows.first)) / (windows.period_s * RADIANS))


def find_plain(windows: GravityWindows) -> NDArray[np.bool_]:
    """In which windows the acceleration keeps the length of gravity in both halves, shape (n,)."""
    if len(windows) == 0:
        return np.zeros(0, np.bool_)
    length_g = np.linalg.norm(windows.acc_g, axis=1)
    edges = np.sort(np.concatenate([windows.first[:-1], (windows.first[:-1] + windows.first[1:]) // 2]))
    halves_g = np.add.reduceat(length_g, edges) / np.diff(np.append(edges, len(length_g)))
    return np.asarray((np.abs(halves_g - 1.0) < PLAIN_G).reshape(-1, 2).all(axis=1))


def measure_miss(windows: GravityWindows, model: GyroModel) -> Float64Array:
    """How far, in g, gravity of the second half is from that of the first, shape (n,)."""
    miss, _ = _carry(windows, model, has_slope=False)
    return np.asarray(np.linalg.norm(miss, axis=1))


def fit_model(
    windows: GravityWindows, start: GyroModel, shape: Float64Array, factor: float = 1.0, rounds: int = 8
) -> GyroFit:
    """Gauss-Newton with Cauchy weights from ``start`` along the columns of ``shape``, (15, p).

    Rows of the shape: the gain row by row in units of ``factor``, the drift in units of 100 deg/s, and the
    offset of the accelerometer in g. Without the last, an offset of 0.04 g passes for a scale error of 5 %.
    """
    origin = np.concatenate([start.gain.ravel(), start.drift_dps / 100.0, start.offset_g])
    basis = shape * np.repeat([factor, 1.0], (9, 6))[:, None]
    likely = np.select(
        [shape[:9].any(axis=0), shape[9:12].any(axis=0)],
        [LIKELY_GAIN, LIKELY_DRIFT_DPS / 100.0],
        LIKELY_OFFSET_G,
    )
    prior = np.diag(1.0 / likely**2)
    values, normal = np.zeros(basis.shape[1]), prior
    for _ in range(rounds):
        miss, slope = _carry(windows, _unpack(origin + basis @ values), has_slope=True)
        slope = slope @ basis
        square = (miss**2).sum(axis=1)
        spread = max(float(np.median(square)) / 1.4, LEAST_SPREAD_G**2)
        weight = 1.0 / (spread * (1.0 + square / (5.7 * spread)))
        normal = np.einsum("w,wij,wik->jk", weight, slope, slope, optimize=True) + prior
        wrong = np.einsum("w,wij,wi->j", weight, slope, miss, optimize=True) + prior @ values
        step = np.linalg.solve(normal, wrong)
        values = values - step
        if np.abs(step).max() < 1e-4:
            break
    errors = np.sqrt(2.0 * np.diag(np.linalg.inv(normal)))  # windows lie half over each other
    return GyroFit(_unpack(origin + basis @ values), values, errors)


def _unpack(numbers: Float64Array) -> GyroModel:
    return GyroModel(numbers[:9].reshape(3, 3), numbers[9:12] * 100.0, numbers[12:])


def _carry(
    windows: GravityWindows, model: GyroModel, *, has_slope: bool
) -> tuple[Float64Array, Float64Array]:
    """Misses (n, 3) and, if asked for, their slopes (n, 3, 15)."""
    miss = np.zeros((len(windows), 3))
    slope = np.zeros((len(windows) if has_slope else 0, 3, 15))
    drift = model.drift_dps * RADIANS
    gain = np.ascontiguousarray(model.gain, dtype=np.float64)
    acc_g = windows.acc_g - model.offset_g
    room = (np.empty((3, 3)), np.empty((3, 12)))
    _carry_windows(acc_g, windows.turn, windows.first, windows.period_s, gain, drift, room, miss, slope)
    slope[:, :, 9:12] *= 100.0 * RADIANS
    return miss, slope


@kernel
def _carry_windows(
    acc: Any, turn: Any, first: Any, period: Any, gain: Any, drift: Any, room: Any, miss: Any, slope: Any
) -> None:  # pragma: no cover
    """Sum the accelerations in the frame of the first row, minus in the first half, plus in the second.

    ``frame`` takes vectors of the present row to the first; ``lean`` (3, 12) is the turn of that frame for
    each unit of gain and drift. Exact sine and cosine: a unit may be wrong by a factor of thousands.
    """
    frame, lean = room
    for w in range(len(period)):
        for i in range(3):
            for j in range(3):
                frame[i, j] = 1.0 if i == j else 0.0
            for q in range(12):
                lean[i, q] = 0.0
        half = (first[w + 1] - first[w]) // 2
        for row in range(first[w], first[w + 1]):
            part = (1.0 if row >= first[w] + half else -1.0) / half
            a = acc[row]
            x = part * (frame[0, 0] * a[0] + frame[0, 1] * a[1] + frame[0, 2] * a[2])
            y = part * (frame[1, 0] * a[0] + frame[1, 1] * a[1] + frame[1, 2] * a[2])
            z = part * (frame[2, 0] * a[0] + frame[2, 1] * a[1] + frame[2, 2] * a[2])
            miss[w, 0] += x
            miss[w, 1] += y
            miss[w, 2] += z
            if len(slope):
                for q in range(12):
                    slope[w, 0, q] += lean[1, q] * z - lean[2, q] * y
                    slope[w, 1, q] += lean[2, q] * x - lean[0, q] * z
                    slope[w, 2, q] += lean[0, q] * y - lean[1, q] * x
                for i in range(3):
                    for j in range(3):
                        slope[w, i, 12 + j] -= part * frame[i, j]
            _turn_frame(frame, lean, turn[row], gain, drift, period[w], len(slope) > 0)


@inner
def _turn_frame(
    frame: Any, lean: Any, turn: Any, gain: Any, drift: Any, period_s: float, has_slope: Any
) -> None:  # pragma: no cover
    """One row on: ``frame @ exp([turn]x)`` (Rodrigues)."""
    x = gain[0, 0] * turn[0] + gain[0, 1] * turn[1] + gain[0, 2] * turn[2] + drift[0] * period_s
    y = gain[1, 0] * turn[0] + gain[1, 1] * turn[1] + gain[1, 2] * turn[2] + drift[1] * period_s
    z = gain[2, 0] * turn[0] + gain[2, 1] * turn[1] + gain[2, 2] * turn[2] + drift[2] * period_s
    square = x * x + y * y + z * z
    angle = sqrt(square)
    sine = sin(angle) / angle if angle > 1e-9 else 1.0
    cosine = (1.0 - cos(angle)) / square if angle > 1e-4 else 0.5
    for i in range(3):
        u, v, w = frame[i, 0], frame[i, 1], frame[i, 2]
        # u x turn, and once more
        p, q, r = v * z - w * y, w * x - u * z, u * y - v * x
        frame[i, 0] = u + sine * p + cosine * (q * z - r * y)
        frame[i, 1] = v + sine * q + cosine * (r * x - p * z)
        frame[i, 2] = w + sine * r + cosine * (p * y - q * x)
        if has_slope:
            for j in range(3):
                for k in range(3):
                    lean[i, 3 * j + k] += frame[i, j] * turn[k]
                lean[i, 9 + j] += frame[i, j] * period_s
