"""What every recording must obey: 1 g at rest, and gravity that turns as the gyroscope says.

What a known device's header states is never changed: a contradiction is a caveat or a refusal. Where only the
names of columns state a unit, a slip of unit (9.81, 57.3, 1000) or a left-handed frame is put right on strong
evidence from both halves of the movement, and flagged. Where nothing is stated, rest and motion settle the
unit, or the recording is refused: nothing is assumed. A scale is never changed. Nothing follows from a
recording without rest.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import timedelta
from math import isclose

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.checks.axes import (
    BAD_WINDOWS,
    MOST_DPS,
    FrameEvidence,
    judge_frame,
    measure_scale,
)
from fusion.checks.clipping import LEAST_ACC_TOP_G, LEAST_GYR_TOP_DPS, RANGE_SHARE, find_flat_range
from fusion.checks.gravity_windows import (
    GravityWindows,
    Rests,
    cut_windows,
    find_rests,
    measure_lengths,
    measure_rest_part,
    number_directions,
)
from fusion.checks.summary import Summaries, summarise
from fusion.errors import ExchangedSensors, MixedColumns, NoGravity, TooShort, UnknownUnit, WrongScale
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
SCALE_TOLERANCE = 0.03
"""Simulated parts, ten of each device, come out within 0.015."""
ERRORS = 6.0
MOST_LEFT_G = 0.015
"""What may be left unexplained: rests of a part read within this of 1 g once it is calibrated."""
ROUNDS = 12


@dataclass(frozen=True, slots=True)
class RestScale:
    """What to multiply the acceleration by on all axes alike, with its standard error.

    ``left_g``: how far from 1 g rests still read with it (root mean square over directions).
    """

    factor: float
    error: float
    left_g: float

    @property
    def is_off(self) -> bool:
        """Surely by more than parts are."""
        away = abs(self.factor - 1.0)
        return self.is_even and away > max(SCALE_TOLERANCE, ERRORS * self.error)

    @property
    def is_even(self) -> bool:
        """Whether a factor and an offset explain what is read at rest."""
        return self.left_g < MOST_LEFT_G


def measure_rest_scale(rests_g: Float64Array) -> RestScale | None:
    """Fit a factor and an offset to mean accelerations at rest, (n, 3); None from too few directions."""
    length_g = np.linalg.norm(rests_g, axis=1)
    rests_g, length_g = rests_g[length_g > 0.0], length_g[length_g > 0.0]
    cell = number_directions(rests_g / length_g[:, None], CELL_DEG)
    if len(cell) == 0 or cell.max() + 1 < FEWEST_DIRECTIONS:
        return None
    reading_g, count = _average(rests_g, cell)
    return _fit(reading_g, CELL_SD_G**2 + REST_SD_G**2 / count)


def _average(rests_g: Float64Array, cell: NDArray[np.intp]) -> tuple[Float64Array, Float64Array]:
    """One reading for each direction, (c, 3), so that no pose outvotes the others, and how many rests, (c,).

    The median length in the mean direction: the mean itself is too short by the spread of the directions.
    """
    length_g, count = np.linalg.norm(rests_g, axis=1), np.bincount(cell)
    mean_g = np.array([rests_g[cell == k].mean(axis=0) for k in range(len(count))])
    median_g = np.array([np.median(length_g[cell == k]) for k in range(len(count))])
    return mean_g * (median_g / np.linalg.norm(mean_g, axis=1))[:, None], count.astype(np.float64)


def _fit(reading_g: Float64Array, variance: Float64Array) -> RestScale:
    """Gauss-Newton with Cauchy weights for the factor and three offsets."""
    values = np.array([1.0, 0.0, 0.0, 0.0])
    prior = np.diag([1.0, *[OFFSET_G**-2.0] * 3])
    start = values.copy()
    for _ in range(ROUNDS):
        bare = reading_g - values[1:]
        length = np.linalg.norm(bare, axis=1)
        slope = np.column_stack([length, -values[0] * bare / length[:, None]])
        departure = values[0] * length - 1.0
        weight = 1.0 / (variance + (departure / 2.385) ** 2)
        normal = (weight[:, None] * slope).T @ slope + prior
        values = values - np.linalg.solve(normal, slope.T @ (weight * departure) + prior @ (values - start))
    error = float(np.sqrt(np.linalg.inv(normal)[0, 0]))
    return RestScale(float(values[0]), error, float(np.sqrt(np.mean(departure**2))))


# Corrections of samples, in place (a shift is too large to be held twice), and their flags.


Facts = Mapping[str, str | int | float]
MIRROR = np.array([-1.0, 1.0, 1.0])


def add_flags(recording: Recording, *flags: QualityFlag) -> Recording:
    """The recording with more caveats."""
    return replace(recording, flags=(*recording.flags, *flags))


def flag_correction(recording: Recording, what: str, evidence: str, facts: Facts) -> Recording:
    """Flag a correction, with the evidence for it (W-UNITS)."""
    flag = QualityFlag(Caveat.UNITS, facts={"what": what, "evidence": evidence, **facts})
    return add_flags(recording, flag)


def flag_doubt(recording: Recording, sensor: str, **facts: float) -> Recording:
    """Flag a scale that the readings contradict and that is left as it is (W-SCALE-DOUBT)."""
    return add_flags(recording, QualityFlag(Caveat.SCALE_DOUBT, facts={"sensor": sensor, **facts}))


def multiply_acceleration(recording: Recording, factors: Float64Array | float) -> Recording:
    """Multiply the acceleration, all axes alike or each by its own factor, in place."""
    for segment in recording.segments:
        segment.acc_g[:] *= np.asarray(factors, np.float32)
    return _renew_segments(recording)


def multiply_rates(recording: Recording, factors: Float64Array | float) -> Recording:
    """Multiply the angular rate in the same way."""
    for segment in recording.segments:
        segment.gyr_dps[:] *= np.asarray(factors, np.float32)
    return _renew_segments(recording)


def _renew_segments(recording: Recording) -> Recording:
    """Make other objects of the segments: what was summarised of these samples holds no more."""
    return replace(recording, segments=tuple(replace(segment) for segment in recording.segments))


def turn_frame(recording: Recording) -> Recording:
    """Make a left-handed frame right-handed: x of both sensors is turned over, in place."""
    turned = multiply_rates(multiply_acceleration(recording, MIRROR), MIRROR)
    return flag_correction(turned, "left-handed", "motion", {"turned": "x"})


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
    accelerations = _measure_spread(measure_lengths(segments))
    if accelerations < LIVELY_RATIO:
        return False
    return accelerations > MORE_TIMES * _measure_spread(measure_lengths(segments, is_rate=True))


def _measure_spread(lengths: Float64Array) -> float:
    """The 95th percentile of the length over the 5th."""
    if len(lengths) == 0:
        return 1.0
    low, high = np.quantile(lengths, [0.05, 0.95]).tolist()
    return float(high / max(low, 1e-9))


USUAL_UNITS_G = (1.0, 1e-3, 1 / STANDARD_GRAVITY)
"""g, mg, m/s2: what one of them is under the name of another."""
REST_TOLERANCE, MOST_DOUBTED = 0.10, 0.25
"""So far from 1 g at rest an accelerometer is believed, and used with a caveat."""
MOVING_TOLERANCE, MOVING_TIMES = 0.20, 5.0
"""Without rest, the median of the movement decides between ranges, a factor of 2 apart, and between units."""
LEAST_REST_PART = 0.1
"""The acceleration at rest, over the longest: 0.20 (shaken by hand) and more in the recordings in hand, 0.03
without gravity."""
LEAST_USUAL_G = 0.05
"""Less in a stated unit is no gravity: one that is read in the wrong unit, g for m/s2, is twice as long."""
SENSITIVITIES_G = (0.000061, 0.000122, 0.000244, 0.000732)
"""LSM9DS1 at 2, 4, 8 and 16 g, g per count (ST, lsm9ds1_reg.c)."""
SENSITIVITIES_DPS = (0.00875, 0.0175, 0.07)
"""LSM9DS1 at 245, 500 and 2000 deg/s, deg/s per count (ST, lsm9ds1_reg.c)."""
RANGES_G = (2.0, 4.0, 8.0, 16.0)
RANGES_DPS = (245.0, 500.0, 2000.0)
WIDE_RANGE_FACTOR = 1.5
"""Code that takes 16/32768 for one count of the 16 g range (0.732 mg) reads 2/3 g at rest."""
SHORTEST_S = 10.0
"""Less is too short for a report, and tells nothing of a unit."""
FEWEST_RESTS, UNEVEN_G = 10, 0.15
"""Ten simulated LSM9DS1, with offsets of 0.04 g on each axis, spread by 0.10 g at most."""
UNSEEN_SCALE = 1.5
"""Fast movement, which alone is there, imitates a scale by less."""


def check_physics(recording: Recording, known: Summaries = ()) -> Recording:
    """Settle unit and frame where the evidence is strong, in place, and flag what contradicts itself.

    Raises
    ------
    WrongScale
        At rest the accelerometer reads something that no known unit makes 1 g, or not the same all round.
    NoGravity
        At rest it reads next to nothing.
    UnknownUnit
        Neither header nor rest and motion settle a unit.
    MixedColumns
        The two sensors contradict each other; or they were not read at one moment.
    ExchangedSensors
        Each sensor reads like the other.
    TooShort
        Less than ten seconds, where a unit is to be found.
    """
    if not is_header_known(recording) and are_exchanged(recording.segments):
        raise ExchangedSensors
    rests = find_rests(recording.segments)
    checked = _check_gravity(recording, rests)
    # What made 1 g of the rests made it of the samples: they are found anew where these were changed.
    if len(checked.flags) > len(recording.flags) or _known_acc_unit(recording) == "registers":
        rests = find_rests(checked.segments)
    checked = _check_rates(_check_rest_length(checked, rests.acc), rests, known)
    source = recording.understood.get("units_from") or "motion"
    return replace(checked, understood={**checked.understood, "units_from": source})


def is_header_known(recording: Recording) -> bool:
    """Whether a known device's format or header states units and axes: nothing overrules it."""
    return recording.stated.is_known


def are_units_stated(recording: Recording) -> bool:
    """Whether the file, its device or a person states both units in words that say how large they are."""
    units = (_known_unit(recording.stated.acc_unit), _known_unit(recording.stated.gyr_unit))
    return not {"", "registers"} & set(units)


def _check_rates(recording: Recording, rests: Rests, known: Summaries) -> Recording:
    unit = _known_unit(recording.stated.gyr_unit)
    candidates = _rate_candidates(unit)
    windows, cut_off = cut_whole_windows(recording.segments, known)
    offset_dps = np.median(rests.gyr, axis=0) if len(rests) else np.zeros(3)
    evidence = judge_frame(windows, offset_dps, candidates)
    if evidence is not None:
        _refuse_mixed(recording, evidence)
    if evidence is not None and evidence.is_settled:
        checked = _arrange(recording, unit, windows, evidence)
    elif unit in ("", "registers"):
        _refuse_short(recording)
        raise UnknownUnit(sensor="gyroscope")
    elif evidence is not None and evidence.is_doubtful:
        checked = add_flags(recording, QualityFlag(Caveat.MIXED, facts=_describe_mixed(evidence)))
    else:
        checked = recording
    return _narrow_ranges(checked, known, is_cut=cut_off is not None)


def _refuse_mixed(recording: Recording, evidence: FrameEvidence) -> None:
    """Refuse what contradicts a known header, and what nothing explains."""
    is_other = evidence.chosen is not evidence.as_read and evidence.lively >= BAD_WINDOWS
    if is_header_known(recording) and is_other:
        raise MixedColumns(**_describe_mixed(evidence), factor=float(f"{evidence.chosen.factor:.3g}"))
    if evidence.is_wrong:
        raise MixedColumns(**_describe_mixed(evidence))


def _describe_mixed(evidence: FrameEvidence) -> dict[str, int]:
    return {"percent": round(100.0 * evidence.as_read.score), "turns": evidence.lively}


def cut_whole_windows(
    segments: Sequence[Segment], known: Summaries = ()
) -> tuple[GravityWindows, float | None]:
    """Windows in which the gyroscope is not cut off, and the size at which it is; None where it never is."""
    seen = [one.gyr for one in summarise(segments, known)]
    cut_off = find_flat_range([segment.gyr_dps for segment in segments], known=seen)
    return cut_windows(segments, RANGE_SHARE * (cut_off or np.inf)), cut_off


def _narrow_ranges(recording: Recording, known: Summaries, *, is_cut: bool) -> Recording:
    """Take the size at which the samples are cut off for the full scale, where that is less than stated.

    ``is_cut``: the gyroscope's flat tops were seen, in whatever unit it was.
    """
    segments = recording.segments
    seen = summarise(segments, known)
    acc_g = find_flat_range([one.acc_g for one in segments], LEAST_ACC_TOP_G, [one.acc for one in seen])
    rates = [one.gyr_dps for one in segments] if is_cut else []
    gyr_dps = find_flat_range(rates, LEAST_GYR_TOP_DPS, [one.gyr for one in seen] if is_cut else [])
    return replace(
        recording,
        acc_range_g=min((r for r in (acc_g, recording.acc_range_g) if r is not None), default=None),
        gyr_range_dps=min((r for r in (gyr_dps, recording.gyr_range_dps) if r is not None), default=None),
    )


def _check_rest_length(recording: Recording, rests_g: Float64Array) -> Recording:
    """Doubt what the accelerometer surely reads too long or too short; refuse what reads unlike all round."""
    scale = measure_rest_scale(rests_g)
    if scale is not None and scale.is_even:
        return (
            flag_doubt(recording, "accelerometer", g=round(1.0 / scale.factor, 3))
            if scale.is_off
            else recording
        )
    lengths_g = np.linalg.norm(rests_g, axis=1)
    if len(lengths_g) >= FEWEST_RESTS:
        low_g, high_g = np.quantile(lengths_g, [0.02, 0.98]).tolist()
        if high_g - low_g > UNEVEN_G:
            raise WrongScale(low_g=round(low_g, 2), high_g=round(high_g, 2))
    return recording


def _arrange(recording: Recording, unit: str, windows: GravityWindows, evidence: FrameEvidence) -> Recording:
    """Apply what the motion says: unit and hand; then doubt a scale that is left."""
    chosen = evidence.chosen
    size = max(abs(chosen.factor), 1e-12)
    factor = min(_rate_candidates(unit), key=lambda named: abs(np.log(size / named)))
    if factor != 1.0:
        recording = multiply_rates(recording, factor)
        if unit == "registers":
            recording = replace(recording, gyr_range_dps=RANGES_DPS[SENSITIVITIES_DPS.index(factor)])
        recording = flag_correction(recording, "angular rate", "motion", {"factor": factor})
    if chosen.factor < 0.0:
        recording = turn_frame(recording)
        library = recording.stated.left_gyr_factor
        if library != 1.0:  # Arduino_LSM9DS1 prints 61.04 mdps for a count of 70
            recording = replace(multiply_rates(recording, library), device="lsm9ds1")
            recording = flag_correction(recording, "angular rate", "layout", {"factor": library})
            factor *= library
        factor = -factor
    scale = measure_scale(windows, chosen, factor)
    if scale is None:
        left = chosen.factor / factor
        return recording if 1.0 / UNSEEN_SCALE < left < UNSEEN_SCALE else _doubt_scale(recording, left)
    return _doubt_scale(recording, scale.overall) if scale.is_off else recording


def _doubt_scale(recording: Recording, overall: float) -> Recording:
    """Flag a scale that the movement contradicts.

    A wrong rate looks like a gyroscope of another scale: if the rows have no time, the rate is doubted.
    """
    if not recording.stated.is_counted:
        return flag_doubt(recording, "gyroscope", factor=round(overall, 3))
    other_hz = round(recording.rate_hz / overall, 1)
    facts: Facts = {"rate_from": "doubted", "rate_hz": round(recording.rate_hz, 3), "other_hz": other_hz}
    return add_flags(recording, QualityFlag(Caveat.RATE, facts=facts))


def refuse_impossible_rates(recording: Recording, known: Summaries = ()) -> Recording:
    """Give the recording back unless it holds rates that no such part can read.

    Raises
    ------
    WrongScale
    """
    for segment, seen in zip(recording.segments, summarise(recording.segments, known), strict=True):
        size = seen.gyr.find_extreme()
        if size > MOST_DPS:
            row = int(np.flatnonzero(np.abs(segment.gyr_dps).max(axis=1) > MOST_DPS)[0])
            at_s = segment.start_s + row / segment.rate_hz
            raise WrongScale(dps=round(size), **_describe_place(recording, at_s))
    return recording


def _describe_place(recording: Recording, at_s: float) -> dict[str, str]:
    if recording.start is None:
        return {"clock": f"+{at_s:.2f} s"}
    return {"clock": f"{recording.start + timedelta(seconds=at_s):%Y-%m-%d %H:%M:%S}"}


def _known_unit(unit: str) -> str:
    """The unit as stated, "" where nothing is stated that says how large it is ("raw", "lsb")."""
    return unit if unit == "registers" or acc_scale_g(unit) or gyr_scale_dps(unit) else ""


def _known_acc_unit(recording: Recording) -> str:
    return _known_unit(recording.stated.acc_unit)


def _refuse_short(recording: Recording) -> None:
    present_s = sum(segment.duration_us for segment in recording.segments) / MICROSECONDS
    if present_s < SHORTEST_S:
        raise TooShort(s=present_s)


def _check_gravity(recording: Recording, rests: Rests) -> Recording:
    """Make 1 g of what is read at rest, by a unit; without rest, by the movement where no unit is stated."""
    unit = _known_acc_unit(recording)
    if len(rests) == 0:
        return _settle_moving(recording, unit)
    off = abs(rests.length - 1.0)
    if unit != "registers" and off <= REST_TOLERANCE:
        return recording
    factor = None if is_header_known(recording) else _find_acc_factor(rests.length, unit)
    if factor is not None:
        return _set_acc_unit(recording, unit, factor, "rest", rests.length)
    if off <= MOST_DOUBTED:
        return flag_doubt(recording, "accelerometer", g=round(rests.length, 3))
    _refuse_no_gravity(recording)
    _refuse_short(recording)
    raise WrongScale(g=round(rests.length, 3))


def _settle_moving(recording: Recording, unit: str) -> Recording:
    """Without rest: a unit that is stated stays unless it is out of the question."""
    part = _refuse_no_gravity(recording)
    lengths = measure_lengths(recording.segments)
    usual = float(np.median(lengths)) if len(lengths) else 0.0
    if part is not None and acc_scale_g(unit) and usual < LEAST_USUAL_G:
        raise NoGravity
    is_likely = 1.0 / MOVING_TIMES < usual < MOVING_TIMES
    if is_header_known(recording) or (unit != "registers" and is_likely):
        is_lively = _measure_spread(lengths) > LIVELY_RATIO
        return flag_doubt(recording, "accelerometer", moving_g=round(usual, 3)) if is_lively else recording
    if unit == "registers":
        fitting = [one for one in SENSITIVITIES_G if abs(usual * one - 1.0) <= MOVING_TOLERANCE]
    else:
        fitting = [one for one in USUAL_UNITS_G[1:] if 1.0 / MOVING_TIMES < usual * one < MOVING_TIMES]
    if unit not in ("", "registers") or len(fitting) != 1:
        _refuse_short(recording)
        raise UnknownUnit(sensor="accelerometer")
    return _set_acc_unit(recording, unit, fitting[0], "motion", usual)


def _refuse_no_gravity(recording: Recording) -> float | None:
    """Refuse an acceleration that reads next to nothing at rest; see :func:`measure_rest_part`."""
    part = measure_rest_part(recording.segments)
    if part is not None and part < LEAST_REST_PART:
        raise NoGravity
    return part


def _set_acc_unit(recording: Recording, unit: str, factor: float, evidence: str, read_g: float) -> Recording:
    scaled = multiply_acceleration(recording, factor)
    if unit == "registers":
        return replace(scaled, acc_range_g=RANGES_G[SENSITIVITIES_G.index(factor)])
    return flag_correction(scaled, "acceleration", evidence, {"factor": factor, "g": round(read_g, 3)})


def _find_acc_factor(rest: float, unit: str) -> float | None:
    """What makes 1 g of what is read at rest in a unit; one that is stated is set aside for slips only."""
    tolerance = REST_TOLERANCE
    if unit == "registers":
        candidates: tuple[float, ...] = SENSITIVITIES_G
    elif unit == "":
        candidates = (1 / STANDARD_GRAVITY, 1e-3, WIDE_RANGE_FACTOR, *SENSITIVITIES_G)
    else:
        stated_g = acc_scale_g(unit) or 1.0
        slips = [true_g / stated_g for true_g in USUAL_UNITS_G if not isclose(true_g, stated_g)]
        candidates = (*slips, WIDE_RANGE_FACTOR)
        tolerance = 0.05
    fitting = [factor for factor in candidates if abs(rest * factor - 1.0) <= tolerance]
    return min(fitting, key=lambda factor: abs(rest * factor - 1.0)) if fitting else None


def _rate_candidates(unit: str) -> tuple[float, ...]:
    if unit == "registers":
        return SENSITIVITIES_DPS
    if unit == "":
        return (1.0, DEG_PER_RAD, 1e-3, *SENSITIVITIES_DPS)
    return (1.0, DEG_PER_RAD, 1 / DEG_PER_RAD, 1e-3, 1e3)
