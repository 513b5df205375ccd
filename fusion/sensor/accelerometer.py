"""Offset and gain of the accelerometer, from the recording's own still moments.

At rest the length of the acceleration is 1 g in whatever direction it points. With still moments in many
directions this gives three offsets and a symmetric gain (scale and the mutual misalignment of the axes), and
how the offsets move through the day: a sensor that was strapped on cold warms up, and what the calibration
pose measured cold is used warm.

What the directions seen cannot tell is left to the priors: the correction is pulled towards none, the offset
towards standing still, so that a file with few poses is not bent; and it is bounded. Priors, weights and
directions know no axes: a sensor strapped on another way gives the same correction, turned.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from fusion.checks.summary import number_directions
from fusion.numerics import weigh_cauchy
from fusion.recording import Float64Array
from fusion.sensor.model import (
    PART_OFFSET_G,
    AccelerometerCorrection,
    Hats,
    hold_together,
    leave_accelerometer,
    solve_band,
)
from fusion.sensor.stillness import QuietTable

FIRST_AXIS, SECOND_AXIS = np.array([0, 1, 2, 0, 0, 1]), np.array([0, 1, 2, 1, 2, 2])
"""Where the six numbers of a symmetric matrix stand."""
PAIRS = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])
"""How often each stands there."""


@dataclass(frozen=True, slots=True)
class AccelerometerSettings:
    """How far the data may pull.

    ``offset_g`` and ``scale`` are the standard deviations expected of parts as delivered (``scale`` in every
    direction alike), the bounds are three times that; ``wander_g_per_root_min`` is the random walk of the
    offset, between knots ``knot_s`` apart. Still moments within ``cell_deg`` of each other and between the
    same two knots are one observation; its variance is ``cell_g`` squared (what they have in common) and
    ``still_g`` squared by their number. At rest in fewer than ``rest_directions``, an accelerometer is
    corrected only where the departure from 1 g that is taken off is more than ``scale``: less is what a good
    one reads, and few directions do not tell scale from offset (the trials of BROAD, at rest in one, 1 to 10
    mg off, lost up to 0.05 deg; on shifts of recorded motion three told 31 and 57 mg to within 5 mg where the
    departure was 4 and 7). At rest in fewer than ``least_directions``, a recording is also looked at while
    the arm moves (:mod:`fusion.sensor.self_calibration`), if that shows as many directions:
    ``moving_cell_g`` and ``moving_g`` are the errors of these readings, ``moving_doubt`` how many times more
    they leave open, as they are wrong together: without it the band held the truth 88 % of the time on four
    sessions of simulated tasks.

    Chosen on simulated shifts with even seeds (1 and 8 h, both devices); half or twice of any of them moves
    the angle by less than 0.01 deg RMSE.
    """

    offset_g: float = PART_OFFSET_G
    scale: float = 0.01
    wander_g_per_root_min: float = 0.0007
    knot_s: float = 300.0
    cell_deg: float = 10.0
    least_directions: int = 4
    rest_directions: int = 3
    cell_g: float = 0.0015
    still_g: float = 0.002
    moving_cell_g: float = 0.004
    moving_g: float = 0.01
    moving_doubt: float = 1.5
    rounds: int = 8


SETTINGS = AccelerometerSettings()


@dataclass(frozen=True, slots=True, eq=False)
class MovingReadings:
    """As if the sensor had been at rest: readings ``gravity_g`` (w, 3) at ``time_s`` (w,)."""

    time_s: Float64Array
    gravity_g: Float64Array


def sees_few_directions(stills: QuietTable) -> bool:
    """Whether still moments alone do not tell the offset in every direction."""
    return _count_directions(stills) < SETTINGS.least_directions


def _count_directions(stills: QuietTable) -> int:
    return int(_number_cells(stills.gravity_g).max(initial=-1)) + 1


def _number_cells(gravity_g: Float64Array) -> NDArray[np.intp]:
    unit = gravity_g / np.maximum(np.linalg.norm(gravity_g, axis=1), 1e-9)[:, None]
    return number_directions(unit, SETTINGS.cell_deg)


def calibrate_accelerometer(
    stills: QuietTable, moving: MovingReadings | None = None
) -> AccelerometerCorrection:
    """Fit offset and gain so that every direction reads 1 g, by damped least squares with Cauchy weights.

    ``moving``: readings of the moving arm, for a recording that was still in few directions; where they give
    no correction, the still moments are asked alone.
    Returns no correction where there is no still moment, where a bound is passed, where the departure from
    1 g does not become smaller, or where still moments in few directions would have but a little taken off.
    """
    if len(stills) == 0:
        return leave_accelerometer()
    if moving is not None:
        found = _find_correction(_average_cells(stills, moving), is_few=True)
        if found is not None and found.directions >= SETTINGS.least_directions:
            return replace(
                found, offset_sd_g=min(SETTINGS.moving_doubt * found.offset_sd_g, SETTINGS.offset_g)
            )
    is_few = _count_directions(stills) < SETTINGS.rest_directions
    return _find_correction(_average_cells(stills, None), is_few=is_few) or leave_accelerometer()


def _find_correction(cells: "_Cells", *, is_few: bool) -> AccelerometerCorrection | None:
    """None where a bound is passed, or where less is taken off than a good accelerometer is off.

    What is taken off counts, not the departure: that of few and lively readings may be their own error, and a
    correction that follows it explains little of it.
    """
    offset_g, gain = _fit(cells)
    corrected = (cells.reading_g - cells.hats.read(offset_g)) @ gain
    before, after = (
        float(np.mean((np.linalg.norm(table, axis=1) - 1.0) ** 2)) for table in (cells.reading_g, corrected)
    )
    farthest_g, most = np.linalg.norm(offset_g, axis=1).max(), np.abs(np.linalg.eigvalsh(gain) - 1.0).max()
    least = SETTINGS.scale**2 if is_few else 0.0
    if farthest_g > 3.0 * SETTINGS.offset_g or most > 3.0 * SETTINGS.scale or before - after <= least:
        return None
    left_g = _find_offset_sd(cells, corrected)
    return AccelerometerCorrection(cells.knots_s, offset_g, gain, cells.directions, left_g)


def _find_offset_sd(cells: "_Cells", corrected: Float64Array) -> float:
    """What the directions seen leave open of an offset that stands still, beside the gain."""
    slope = np.hstack([-corrected, _slope_by_gain(corrected, corrected)])
    departure = np.linalg.norm(corrected, axis=1) - 1.0
    weight = weigh_cauchy(departure, cells.variance)
    prior = np.concatenate([np.full(3, SETTINGS.offset_g**-2.0), PAIRS / SETTINGS.scale**2])
    covariance = np.linalg.inv((weight[:, None] * slope).T @ slope + np.diag(prior))
    return float(np.sqrt(np.trace(covariance[:3, :3]) / 3.0))


def _slope_by_gain(along: Float64Array, bare: Float64Array) -> Float64Array:
    """How the length along a direction (w, 3) changes with the six numbers of the gain, (w, 6)."""
    once = along[:, FIRST_AXIS] * bare[:, SECOND_AXIS] + along[:, SECOND_AXIS] * bare[:, FIRST_AXIS]
    return np.asarray(PAIRS / 2.0 * once)


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """One reading for each direction between each two knots, so that no pose outvotes the others.

    ``reading_g`` (c, 3), ``variance`` (c,) of its length; ``hats`` places them among the knots.
    """

    knots_s: Float64Array
    reading_g: Float64Array
    variance: Float64Array
    directions: int
    hats: Hats = field(repr=False)


def _average_cells(stills: QuietTable, moving: MovingReadings | None) -> _Cells:
    time_s, gravity_g = stills.middle_s, stills.gravity_g
    if moving is not None:
        time_s = np.concatenate([time_s, moving.time_s])
        gravity_g = np.concatenate([gravity_g, moving.gravity_g])
    is_moving = np.arange(len(time_s)) >= len(stills)
    pieces = max(1, round((time_s.max() - time_s.min()) / SETTINGS.knot_s))
    knots_s = np.linspace(time_s.min(), max(time_s.max(), time_s.min() + 1.0), pieces + 1)
    direction = _number_cells(gravity_g)
    between = np.clip(np.searchsorted(knots_s, time_s, side="right") - 1, 0, pieces - 1)
    cell = (2 * direction + is_moving) * pieces + between
    length_g = np.linalg.norm(gravity_g, axis=1)
    order = np.lexsort((length_g, cell))
    first = np.flatnonzero(np.diff(cell[order], prepend=-1))
    count = np.diff(first, append=len(order))
    mean_g = np.add.reduceat(gravity_g[order], first) / count[:, None]
    # The median length in the mean direction: the mean itself is too short by the spread of the cell.
    median_g = (length_g[order][first + (count - 1) // 2] + length_g[order][first + count // 2]) / 2.0
    reading_g = mean_g * (median_g / np.maximum(np.linalg.norm(mean_g, axis=1), 1e-9))[:, None]
    middle_s = np.add.reduceat(time_s[order], first) / count
    moves = is_moving[order][first]
    common_g = np.where(moves, SETTINGS.moving_cell_g, SETTINGS.cell_g)
    variance = common_g**2 + np.where(moves, SETTINGS.moving_g, SETTINGS.still_g) ** 2 / count
    return _Cells(knots_s, reading_g, variance, int(direction.max()) + 1, Hats(knots_s, middle_s))


def _fit(cells: _Cells) -> tuple[Float64Array, Float64Array]:
    """Offsets at the knots (k, 3) and gain (3, 3)."""
    offset_g, gain = np.zeros((len(cells.knots_s), 3)), np.eye(3)
    for _ in range(SETTINGS.rounds):
        bare = cells.reading_g - cells.hats.read(offset_g)
        corrected = bare @ gain
        length = np.linalg.norm(corrected, axis=1)
        along = corrected / np.maximum(length, 1e-9)[:, None]
        by_offset = -along @ gain
        by_gain = _slope_by_gain(along, bare)
        departure = length - 1.0
        weight = weigh_cauchy(departure, cells.variance)
        # Linear about the present solution, so that the unknowns are the solution itself.
        present = (by_offset * cells.hats.read(offset_g)).sum(axis=1)
        aim = present + by_gain @ (gain - np.eye(3))[FIRST_AXIS, SECOND_AXIS] - departure
        offset_g, six = _solve(cells, by_offset, by_gain, aim, weight)
        gain = np.eye(3)
        gain[FIRST_AXIS, SECOND_AXIS] += six
        gain[SECOND_AXIS, FIRST_AXIS] = gain[FIRST_AXIS, SECOND_AXIS]
    return offset_g, gain


def _solve(
    cells: _Cells, by_offset: Float64Array, by_gain: Float64Array, aim: Float64Array, weight: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """One round: the knots' offsets are eliminated (they form a band), then the six numbers of the gain."""
    band = hold_together(cells.knots_s, SETTINGS.wander_g_per_root_min)
    band[0] += 1.0 / (SETTINGS.offset_g**2 * len(cells.knots_s))
    right = np.zeros((1 + len(PAIRS), band.shape[1]))
    heavy = weight[:, None] * by_offset
    cells.hats.add(band, right[0], heavy[:, :, None] * by_offset[:, None, :], heavy * aim[:, None])
    for k in range(len(PAIRS)):
        cells.hats.pull(right[1 + k], heavy * by_gain[:, k, None])
    solved = solve_band(band, right).T
    both = right[1:] @ solved
    normal = (weight[:, None] * by_gain).T @ by_gain + np.diag(PAIRS / SETTINGS.scale**2) - both[:, 1:]
    six = np.linalg.solve(normal, by_gain.T @ (weight * aim) - both[:, 0])
    return (solved[:, 0] - solved[:, 1:] @ six).reshape(-1, 3), np.asarray(six, dtype=np.float64)
