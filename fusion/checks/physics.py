"""What every recording must obey: 1 g at rest, and gravity that turns as the gyroscope says.

The unit of the acceleration follows from 1 g at rest; unit, axes and scale of the gyroscope follow from the
motion (:mod:`fusion.checks.axes`). Nothing is changed but on strong evidence; what is changed is flagged, and
what contradicts itself and cannot be put right is refused.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from math import isclose, sqrt

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.checks.axes import (
    GOOD_SCORE,
    MOST_DPS,
    Arrangement,
    FrameEvidence,
    Scale,
    SensorLag,
    flag_inconsistent_spans,
    judge_frame,
    measure_lag,
    measure_scale,
)
from fusion.checks.clipping import LEAST_ACC_TOP_G, LEAST_GYR_TOP_DPS, RANGE_SHARE, find_flat_range
from fusion.checks.gravity_windows import (
    MEAN_S,
    GravityWindows,
    cut_windows,
    find_gyro_offset_dps,
    measure_rests_g,
    moving_mean,
    number_directions,
    probe_blocks,
    slide_mean,
)
from fusion.errors import ExchangedSensors, MixedColumns, TooShort, WrongScale
from fusion.recording import MICROSECONDS, Float64Array, QualityFlag, Recording, Segment
from fusion.units import DEG_PER_RAD, STANDARD_GRAVITY, acc_scale_g, gyr_scale_dps

# Scale of the accelerometer: how long gravity reads at rest, in all the directions that were seen.
#
# A part's own few per cent belong to the fusion (:mod:`fusion.sensor.accelerometer`), whose fit is
# held to what parts have. A factor past that, as a wrong sensitivity leaves, makes it give up, or pass the
# factor off as an offset, which bends every angle. Offset and factor are told apart by rests in many
# directions only: at one, both read alike.


CELL_DEG, FEWEST_DIRECTIONS = 10.0, 6
CELL_SD_G, REST_SD_G = 0.002, 0.004
"""Standard deviation of the length at a direction, and of a single rest."""
OFFSET_G = 0.04
"""What parts have, one standard deviation (LSM9DS1: 90 mg at most)."""
SCALE_TOLERANCE, AXIS_TOLERANCE = 0.03, 0.05
"""Simulated parts, ten of each device, come out within 0.015, their axes within 0.021."""
ERRORS = 6.0
MOST_LEFT_G = 0.015
"""What may be left unexplained: rests of a part read within this of 1 g once it is calibrated."""
ROUNDS = 12


@dataclass(frozen=True, slots=True, eq=False)
class RestScale:
    """What to multiply the acceleration by: on all axes alike, and on each (3,), with standard errors.

    ``left_g``: how far from 1 g rests still read with either (root mean square over directions).
    """

    overall: float
    error: float
    left_g: float
    axes: Float64Array
    axes_errors: Float64Array
    axes_left_g: float

    @property
    def is_overall_off(self) -> bool:
        """Surely by more than parts are."""
        away = abs(self.overall - 1.0)
        return self.is_even and away > max(SCALE_TOLERANCE, ERRORS * self.error)

    @property
    def is_even(self) -> bool:
        """Whether a factor and an offset explain what is read at rest."""
        return self.left_g < MOST_LEFT_G

    @property
    def is_axis_off(self) -> bool:
        """Whether one axis surely has a scale of its own."""
        away = np.abs(self.axes / np.median(self.axes) - 1.0)
        is_far = away > np.maximum(AXIS_TOLERANCE, ERRORS * self.axes_errors)
        return self.axes_left_g < MOST_LEFT_G and bool(np.any(is_far))


def measure_rest_scale(rests_g: Float64Array) -> RestScale | None:
    """Fit factors and offset to mean accelerations at rest, (n, 3); None from too few directions."""
    length_g = np.linalg.norm(rests_g, axis=1)
    rests_g, length_g = rests_g[length_g > 0.0], length_g[length_g > 0.0]
    cell = number_directions(rests_g / length_g[:, None], CELL_DEG)
    if len(cell) == 0 or cell.max() + 1 < FEWEST_DIRECTIONS:
        return None
    reading_g, count = _average(rests_g, cell)
    variance = CELL_SD_G**2 + REST_SD_G**2 / count
    values, errors, left_g = _fit(reading_g, variance, np.ones((3, 1)))
    axes, axes_errors, axes_left_g = _fit(reading_g, variance, np.eye(3))
    return RestScale(float(values[0]), float(errors[0]), left_g, axes, axes_errors, axes_left_g)


def _average(rests_g: Float64Array, cell: NDArray[np.intp]) -> tuple[Float64Array, Float64Array]:
    """One reading for each direction, (c, 3), so that no pose outvotes the others, and how many rests, (c,).

    The median length in the mean direction: the mean itself is too short by the spread of the directions.
    """
    length_g, count = np.linalg.norm(rests_g, axis=1), np.bincount(cell)
    mean_g = np.array([rests_g[cell == k].mean(axis=0) for k in range(len(count))])
    median_g = np.array([np.median(length_g[cell == k]) for k in range(len(count))])
    return mean_g * (median_g / np.linalg.norm(mean_g, axis=1))[:, None], count.astype(np.float64)


def _fit(
    reading_g: Float64Array, variance: Float64Array, shape: Float64Array
) -> tuple[Float64Array, Float64Array, float]:
    """Factors along the columns of ``shape`` (3, p), their errors, and what is left, with Cauchy weights."""
    p = shape.shape[1]
    values = np.concatenate([np.ones(p), np.zeros(3)])
    prior = np.diag(np.concatenate([np.full(p, 1.0), np.full(3, OFFSET_G**-2.0)]))
    start = values.copy()
    for _ in range(ROUNDS):
        factors, bare = shape @ values[:p], reading_g - values[p:]
        length = np.linalg.norm(bare * factors, axis=1)
        by_axis = bare**2 * factors / length[:, None]
        slope = np.hstack([by_axis @ shape, -bare * factors**2 / length[:, None]])
        weight = 1.0 / (variance + ((length - 1.0) / 2.385) ** 2)
        normal = (weight[:, None] * slope).T @ slope + prior
        values = values - np.linalg.solve(
            normal, slope.T @ (weight * (length - 1.0)) + prior @ (values - start)
        )
    errors = np.sqrt(np.diag(np.linalg.inv(normal)))
    return shape @ values[:p], shape @ errors[:p], float(np.sqrt(np.mean((length - 1.0) ** 2)))


# Corrections of samples, in place (a shift is too large to be held twice), and their flags.


Facts = Mapping[str, str | int | float]
BLOCK_ROWS = 1 << 16
"""Rows that change places in one step."""
MIRROR = np.array([-1.0, 1.0, 1.0])


def flag_correction(recording: Recording, what: str, evidence: str, facts: Facts) -> Recording:
    """Flag a correction, with the evidence for it (W-UNITS)."""
    flag = QualityFlag(Caveat.UNITS, facts={"what": what, "evidence": evidence, **facts})
    return replace(recording, flags=(*recording.flags, flag))


def multiply_acceleration(recording: Recording, factors: Float64Array | Sequence[float] | float) -> None:
    """Multiply the acceleration, all axes alike or each by its own factor, in place."""
    for segment in recording.segments:
        segment.acc_g[:] *= np.asarray(factors, np.float32)


def multiply_rates(recording: Recording, factors: Float64Array | Sequence[float] | float) -> None:
    """Multiply the angular rate in the same way."""
    for segment in recording.segments:
        segment.gyr_dps[:] *= np.asarray(factors, np.float32)


def is_mirrored(turn: Float64Array) -> bool:
    """Whether all three rates are the other way about, as in a left-handed frame."""
    return bool(np.all(turn == -np.eye(3)))


def turn_axes(recording: Recording, turn: Float64Array) -> Recording:
    """Put the rates in the order and signs of ``turn`` (3, 3), in place, and say which were not.

    Row i of ``turn`` says which reading, with which sign, is the rate about axis i. Where all are the other
    way about, x of both sensors is turned instead: the frame was left-handed.
    """
    if np.all(turn == np.eye(3)):
        return recording
    if is_mirrored(turn):
        multiply_acceleration(recording, MIRROR)
        multiply_rates(recording, MIRROR)
        return flag_correction(recording, "left-handed", "motion", {"turned": "x"})
    order, signs = np.abs(turn).argmax(axis=1), turn.sum(axis=1)
    for segment in recording.segments:
        reorder_columns(segment.gyr_dps, order)
    multiply_rates(recording, signs)
    if np.all(order == np.arange(3)):
        turned = ", ".join(axis for axis, sign in zip("xyz", signs, strict=True) if sign < 0)
        return flag_correction(recording, "signs", "motion", {"turned": turned, "order": format_axes(turn)})
    return flag_correction(recording, "axes", "motion", {"order": format_axes(turn)})


def reorder_columns(values: NDArray[np.float32], order: NDArray[np.intp]) -> None:
    """Reorder the columns of (n, 3), in place."""
    for first in range(0, len(values), BLOCK_ROWS):
        values[first : first + BLOCK_ROWS] = values[first : first + BLOCK_ROWS, order]


def format_axes(turn: Float64Array) -> str:
    """Which readings, with which signs, are the rates about x, y and z: "+x +y +z" as it should be."""
    return " ".join(f"{'-' if row.sum() < 0 else '+'}{'xyz'[int(np.abs(row).argmax())]}" for row in turn)


def describe_factors(axes: Float64Array) -> dict[str, float]:
    """Factors of x, y and z as facts."""
    return {f"factor_{axis}": round(float(k), 3) for axis, k in zip("xyz", axes, strict=True)}


# Tables in which acceleration and angular rate stand under each other's names.
#
# An accelerometer on an arm reads about the length of gravity all the time; a gyroscope reads next to
# nothing at rest and a hundred times as much in movement. Where the columns show the opposite, they are
# exchanged.


LIVELY_RATIO, MORE_TIMES = 5.0, 3.0
"""Long readings over short ones. In the recordings in hand, an accelerometer's are at most 1.8 times as long,
in throws 7, and the gyroscope's beside them at least a hundred times; with an offset at rest five times.
"""


def are_exchanged(segments: Sequence[Segment]) -> bool:
    """Whether the angular rate keeps the length of gravity, and the acceleration does not."""
    accelerations = _measure_spread(segments, is_rate=False)
    if accelerations < LIVELY_RATIO:
        return False
    return accelerations > MORE_TIMES * _measure_spread(segments, is_rate=True)


def _measure_spread(segments: Sequence[Segment], *, is_rate: bool) -> float:
    """The 95th percentile of the length over the 5th."""
    lengths = [_measure_lengths(*block, is_rate=is_rate) for block in probe_blocks(segments)]
    every = np.concatenate(lengths) if lengths else np.empty(0)
    if len(every) == 0:
        return 1.0
    low, high = np.quantile(every, [0.05, 0.95]).tolist()
    return float(high / max(low, 1e-9))


def _measure_lengths(segment: Segment, first_row: int, stop_row: int, *, is_rate: bool) -> Float64Array:
    samples = (segment.gyr_dps if is_rate else segment.acc_g)[first_row:stop_row]
    width = max(3, round(MEAN_S * segment.rate_hz))
    if len(samples) < width:
        return np.empty(0)
    return np.asarray(np.linalg.norm(slide_mean(samples, width)[0], axis=1))


def exchange_sensors(recording: Recording) -> Recording:
    """Exchange the sensors, each in the unit that the file names for it, and flag it (W-UNITS)."""
    segments = tuple(replace(s, acc_g=s.gyr_dps, gyr_dps=s.acc_g) for s in recording.segments)
    exchanged = replace(recording, segments=segments)
    acc_g = acc_scale_g(recording.understood.get("acceleration_unit")) or 1.0
    gyr_dps = gyr_scale_dps(recording.understood.get("angular_rate_unit")) or 1.0
    if acc_g != gyr_dps:
        multiply_acceleration(exchanged, acc_g / gyr_dps)
        multiply_rates(exchanged, gyr_dps / acc_g)
    return flag_correction(exchanged, "exchanged sensors", "motion", {})


USUAL_UNITS_G = (1.0, 1e-3, 1 / STANDARD_GRAVITY)
"""g, mg, m/s2: what one of them is under the name of another."""
REST_TOLERANCE = 0.10
MOVING_TOLERANCE = 0.20
"""Where no still moment is found, the median of a moving arm must do."""
SENSITIVITIES_G = (0.000061, 0.000122, 0.000244, 0.000732)
"""LSM9DS1 at 2, 4, 8 and 16 g, g per count (ST, lsm9ds1_reg.c)."""
SENSITIVITIES_DPS = (0.00875, 0.0175, 0.07)
"""LSM9DS1 at 245, 500 and 2000 deg/s, deg/s per count (ST, lsm9ds1_reg.c)."""
RANGES_G = (2.0, 4.0, 8.0, 16.0)
RANGES_DPS = (245.0, 500.0, 2000.0)
ARDUINO_DPS = 2000.0 / 32768.0
"""What Arduino_LSM9DS1 takes for one count; the data sheet says 0.07 deg/s."""
ARDUINO_FACTOR = 0.07 / ARDUINO_DPS
SURE_ERRORS = 3.0
"""A GT9X has the same grid: the scale of the motion distinguishes its negated columns from the library."""
WIDE_RANGE_FACTOR = 1.5
"""Code that takes 16/32768 for one count of the 16 g range (0.732 mg) reads 2/3 g at rest."""
SHORTEST_S = 1.0
COUNTED = ("row number", "packet counter")
"""The readers' words for a table whose rows bear no time: its rate comes from a person or a header."""
FEWEST_RESTS, UNEVEN_G = 20, 0.15
"""Ten simulated LSM9DS1, with offsets of 0.04 g on each axis, spread by 0.10 g at most."""


def check_physics(recording: Recording) -> Recording:
    """Correct unit, axes and gyroscope scale where the evidence is strong, in place, and flag it.

    Raises
    ------
    WrongScale
        At rest the accelerometer reads something that no known unit makes 1 g, or not the same all round.
    MixedColumns
        The two sensors contradict each other, and no one order and sign of the axes puts it right; or they
        were not read at one moment.
    ExchangedSensors
        Each sensor reads like the other, and their exchange alone does not surely put it right.
    TooShort
        Less than a second, which tells nothing of a unit.
    """
    if not are_exchanged(recording.segments):
        return _check_as_named(recording)[0]
    try:
        checked, is_borne_out = _check_as_named(exchange_sensors(recording))
    except (WrongScale, MixedColumns) as refusal:
        raise ExchangedSensors from refusal
    if not is_borne_out:
        raise ExchangedSensors
    return checked


def _check_as_named(recording: Recording) -> tuple[Recording, bool]:
    """The recording put right, and whether the motion bears it out."""
    checked = _correct_rest_length(_check_gravity(recording))
    unit = _known_unit(checked.understood.get("angular_rate_unit", "deg/s"))
    candidates = _rate_candidates(unit)
    windows, cut_off = cut_whole_windows(checked.segments)
    evidence = judge_frame(windows, find_gyro_offset_dps(checked.segments), candidates)
    if evidence is not None and evidence.is_wrong:
        raise MixedColumns(percent=round(100.0 * evidence.as_read.score), turns=evidence.lively)
    if evidence is None or not evidence.is_settled:
        assumed = _assume(checked, unit, candidates[0], evidence)
        return _narrow_ranges(assumed, is_cut=cut_off is not None), False
    return _narrow_ranges(_arrange(checked, unit, windows, evidence), is_cut=cut_off is not None), True


def _check_agreement(
    recording: Recording, windows: GravityWindows, chosen: Arrangement, scale: Scale
) -> Recording:
    """Whether the sensors agree at each moment and in each part, a factor on each axis allowed for."""
    checked = _check_lag(recording, measure_lag(windows, scale.model))
    odd = flag_inconsistent_spans(windows, scale.model) if chosen.score <= GOOD_SCORE else ()
    return replace(checked, flags=(*checked.flags, *odd))


def _check_lag(recording: Recording, lag: SensorLag) -> Recording:
    """Refuse what was surely not read at one moment; say what likely was not (W-LAG)."""
    lag_ms = round(1000.0 * abs(lag.lag_s), -1)
    if lag.is_certain:
        raise MixedColumns(lag_ms=int(lag_ms))
    if not lag.is_likely:
        return recording
    flag = QualityFlag(Caveat.LAG, facts={"lag_ms": int(lag_ms)})
    return replace(recording, flags=(*recording.flags, flag))


def cut_whole_windows(segments: Sequence[Segment]) -> tuple[GravityWindows, float | None]:
    """Windows in which the gyroscope is not cut off, and the size at which it is; None where it never is."""
    cut_off = find_flat_range([segment.gyr_dps for segment in segments])
    return cut_windows(segments, RANGE_SHARE * (cut_off or np.inf)), cut_off


def _narrow_ranges(recording: Recording, *, is_cut: bool) -> Recording:
    """Take the size at which the samples are cut off for the full scale, where that is less than stated.

    ``is_cut``: the gyroscope's flat tops were seen, in whatever unit it was.
    """
    acc_g = find_flat_range([segment.acc_g for segment in recording.segments], LEAST_ACC_TOP_G)
    rates = [segment.gyr_dps for segment in recording.segments] if is_cut else []
    gyr_dps = find_flat_range(rates, LEAST_GYR_TOP_DPS)
    return replace(
        recording,
        acc_range_g=min((r for r in (acc_g, recording.acc_range_g) if r is not None), default=None),
        gyr_range_dps=min((r for r in (gyr_dps, recording.gyr_range_dps) if r is not None), default=None),
    )


def _correct_rest_length(recording: Recording) -> Recording:
    """Undo what the accelerometer surely reads too long or too short; refuse what reads unlike all round."""
    rests_g = measure_rests_g(recording.segments)
    scale = measure_rest_scale(rests_g)
    if scale is None or not (scale.is_axis_off or scale.is_overall_off):
        if scale is None or not scale.is_even:
            _refuse_uneven(np.linalg.norm(rests_g, axis=1))
        return recording
    if scale.is_axis_off:
        multiply_acceleration(recording, scale.axes)
        return flag_correction(
            recording, "scale of the accelerometer's axes", "rest", describe_factors(scale.axes)
        )
    multiply_acceleration(recording, scale.overall)
    return flag_correction(recording, "accelerometer scale", "rest", {"factor": round(scale.overall, 3)})


def _refuse_uneven(lengths_g: Float64Array) -> None:
    """An accelerometer that reads another length at rest in every direction has an axis of another scale."""
    if len(lengths_g) < FEWEST_RESTS:
        return
    low_g, high_g = np.quantile(lengths_g, [0.02, 0.98]).tolist()
    if high_g - low_g > UNEVEN_G:
        raise WrongScale(low_g=round(low_g, 2), high_g=round(high_g, 2))


def _assume(recording: Recording, unit: str, factor: float, evidence: FrameEvidence | None) -> Recording:
    """Take the first unit, where the motion does not tell; say so where nothing else does."""
    taken = _set_unit(recording, unit, factor)
    if unit in ("", "registers"):
        taken = flag_correction(taken, "angular rate", "assumed", {"factor": factor})
    if evidence is None or not evidence.is_doubtful:
        return taken
    percent = round(100.0 * evidence.as_read.score)
    doubt = QualityFlag(Caveat.MIXED, facts={"percent": percent, "turns": evidence.lively})
    return replace(taken, flags=(*taken.flags, doubt))


def _arrange(recording: Recording, unit: str, windows: GravityWindows, evidence: FrameEvidence) -> Recording:
    """Apply what the motion says: unit, axes, then what is left of the scale."""
    chosen, candidates = evidence.chosen, _rate_candidates(unit)
    factor = _find_unit_factor(chosen.factor, candidates)
    arranged = _set_unit(recording, unit, factor)
    if factor != 1.0:
        arranged = flag_correction(arranged, "angular rate", "motion", {"factor": factor})
    arranged = turn_axes(arranged, chosen.turn)
    scale = measure_scale(windows, chosen, factor)
    arranged = _check_agreement(arranged, windows, chosen, scale)
    is_arduino = is_mirrored(chosen.turn) and is_on_grid(arranged.segments, ARDUINO_DPS)
    if is_arduino and scale.overall + SURE_ERRORS * scale.error > sqrt(ARDUINO_FACTOR):
        return _undo_arduino(arranged)
    return _correct_scale(arranged, scale)


def _find_unit_factor(factor: float, candidates: Sequence[float]) -> float:
    """The unit nearest to what fits; how far it is off is a matter of scale."""
    return min(candidates, key=lambda named: abs(np.log(factor / named)) if factor > 0.0 else named)


def _set_unit(recording: Recording, unit: str, factor: float) -> Recording:
    if factor != 1.0:
        multiply_rates(recording, factor)
    if unit != "registers":
        return recording
    return replace(recording, gyr_range_dps=RANGES_DPS[SENSITIVITIES_DPS.index(factor)])


def _correct_scale(recording: Recording, scale: Scale) -> Recording:
    """Multiply the rates by what the motion says, if it is surely more than parts are off."""
    if scale.is_axis_off:
        multiply_rates(recording, scale.axes)
        return flag_correction(recording, "scale of the axes", "motion", describe_factors(scale.axes))
    if scale.is_overall_off:
        multiply_rates(recording, scale.overall)
        facts = {"factor": round(scale.overall, 3)}
        return _flag_rate(flag_correction(recording, "gyroscope scale", "motion", facts), scale.overall)
    return recording


def _flag_rate(recording: Recording, factor: float) -> Recording:
    """Flag a rate without stamps: a wrong one looks like a gyroscope of another scale (W-RATE)."""
    if recording.understood.get("time") not in COUNTED:
        return recording
    told_hz, other_hz = round(recording.rate_hz, 3), round(recording.rate_hz / factor, 1)
    doubt = QualityFlag(Caveat.RATE, facts={"rate_from": "doubted", "rate_hz": told_hz, "other_hz": other_hz})
    return replace(recording, flags=(*recording.flags, doubt))


def _undo_arduino(recording: Recording) -> Recording:
    """Undo the library's gyroscope scale: its grid of values in the left-handed frame of an LSM9DS1.

    The grid alone is no proof: parts with a true 2000/32768 deg/s per count share it, but are right-handed.
    """
    multiply_rates(recording, ARDUINO_FACTOR)
    known = replace(recording, device="lsm9ds1")
    return flag_correction(known, "angular rate", "grid", {"factor": ARDUINO_FACTOR})


def refuse_impossible_rates(recording: Recording) -> Recording:
    """Give the recording back unless it holds rates that no such part can read.

    Raises
    ------
    WrongScale
    """
    for segment in recording.segments:
        size = max(segment.gyr_dps.max(initial=0.0), -segment.gyr_dps.min(initial=0.0))
        if size > MOST_DPS:
            row = int(np.flatnonzero(np.abs(segment.gyr_dps).max(axis=1) > MOST_DPS)[0])
            at_s = segment.start_s + row / segment.rate_hz
            raise WrongScale(dps=round(float(size)), **_describe_place(recording, at_s))
    return recording


def _describe_place(recording: Recording, at_s: float) -> dict[str, str]:
    if recording.start is None:
        return {"clock": f"+{at_s:.2f} s"}
    return {"clock": f"{recording.start + timedelta(seconds=at_s):%Y-%m-%d %H:%M:%S}"}


def find_rest_g(segments: Sequence[Segment]) -> tuple[float, bool]:
    """Median length of the acceleration at still moments, and whether there were any; else over all."""
    still: list[Float64Array] = []
    every: list[Float64Array] = []
    for segment, first, stop in probe_blocks(segments):
        means, scatter = moving_mean(segment, first, stop)
        lengths = np.linalg.norm(means, axis=1)
        every.append(lengths)
        still.append(lengths[scatter < 0.02 * np.maximum(lengths, 1e-12)])
    found = np.concatenate(still) if still else np.empty(0)
    if len(found) >= 10:
        return float(np.median(found)), True
    lengths = np.concatenate(every) if every else np.empty(0)
    return (float(np.median(lengths)) if len(lengths) else 0.0), False


def _known_unit(unit: str) -> str:
    """The unit as stated, "" where nothing is stated that says how large it is ("raw", "lsb")."""
    return unit if unit == "registers" or acc_scale_g(unit) or gyr_scale_dps(unit) else ""


def _check_gravity(recording: Recording) -> Recording:
    rest, is_still = find_rest_g(recording.segments)
    tolerance = REST_TOLERANCE if is_still else MOVING_TOLERANCE
    unit = _known_unit(recording.understood.get("acceleration_unit", "g"))
    is_stated = unit not in ("", "registers")
    if is_stated and (abs(rest - 1.0) <= tolerance or not is_still):
        return recording
    if unit == "" and abs(rest - 1.0) <= tolerance:
        return recording
    factor = _find_acc_factor(rest, unit, tolerance)
    if factor is None:
        present_s = sum(segment.duration_us for segment in recording.segments) / MICROSECONDS
        if present_s < SHORTEST_S:
            raise TooShort(s=present_s)
        raise WrongScale(g=round(rest, 3))
    multiply_acceleration(recording, factor)
    if unit == "registers":
        return replace(recording, acc_range_g=RANGES_G[SENSITIVITIES_G.index(factor)])
    return flag_correction(recording, "acceleration", "rest", {"factor": factor, "g": round(rest, 3)})


def _find_acc_factor(rest: float, unit: str, tolerance: float) -> float | None:
    """What makes 1 g of what is read at rest in a unit; one that is stated is set aside for slips only."""
    if unit == "registers":
        candidates: tuple[float, ...] = SENSITIVITIES_G
    elif unit == "":
        candidates = (1 / STANDARD_GRAVITY, 1e-3, WIDE_RANGE_FACTOR, *SENSITIVITIES_G)
    else:
        stated_g = acc_scale_g(unit) or 1.0
        slips = [true_g / stated_g for true_g in USUAL_UNITS_G if not isclose(true_g, stated_g)]
        candidates = (*slips, WIDE_RANGE_FACTOR)
        tolerance = min(tolerance, 0.05)
    fitting = [factor for factor in candidates if abs(rest * factor - 1.0) <= tolerance]
    return min(fitting, key=lambda factor: abs(rest * factor - 1.0)) if fitting else None


def _rate_candidates(unit: str) -> tuple[float, ...]:
    if unit == "registers":
        return SENSITIVITIES_DPS
    if unit == "":
        return (1.0, DEG_PER_RAD, 1e-3, *SENSITIVITIES_DPS)
    return (1.0, DEG_PER_RAD, 1 / DEG_PER_RAD, 1e-3, 1e3)


def is_on_grid(segments: Sequence[Segment], step_dps: float) -> bool:
    """Whether the angular rates are whole multiples of a step, as far as three decimals show it."""
    values = np.concatenate(
        [s.gyr_dps[first : first + 200].ravel() for s, first, _ in probe_blocks(segments)]
    )
    ratios = values.astype(np.float64) / step_dps
    return bool(np.mean(np.abs(ratios - np.round(ratios)) < 0.02) > 0.99 and np.ptp(values) > 10 * step_dps)
