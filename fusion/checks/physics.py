"""What every recording must obey: 1 g at rest, and gravity that turns as the gyroscope says.

What a known device's header states is never changed: a contradiction is a caveat or a refusal. Where only the
names of columns state a unit, a slip of unit (9.81, 57.3, 1000) or a left-handed frame is put right on strong
evidence from both halves of the movement, and flagged. Where nothing is stated, rest and motion settle the
unit, or the recording is refused: nothing is assumed. A scale is never changed. Nothing follows from a
recording without rest.
"""

from collections.abc import Sequence
from dataclasses import replace
from datetime import timedelta
from math import isclose

import numpy as np

from fusion.caveats import Caveat
from fusion.checks.frame import (
    BAD_WINDOWS,
    MOST_DPS,
    FrameEvidence,
    GravityWindows,
    cut_windows,
    judge_frame,
    measure_scale,
)
from fusion.checks.rests import Rests, find_rests, measure_lengths, measure_rest_part, measure_rest_scale
from fusion.checks.summary import LEAST_ACC_TOP_G, LEAST_GYR_TOP_DPS, find_flat_range, summarise
from fusion.errors import ExchangedSensors, MixedColumns, NoGravity, TooShort, UnknownUnit, WrongScale
from fusion.recording import MICROSECONDS, Float64Array, QualityFlag, Recording, Segment
from fusion.units import DEG_PER_RAD, STANDARD_GRAVITY, acc_scale_g, gyr_scale_dps

LIVELY_RATIO, MORE_TIMES = 5.0, 3.0
"""Long readings over short ones. In the recordings in hand, an accelerometer's are at most 1.8 times as long,
in throws 7, and the gyroscope's beside them at least a hundred times; with an offset at rest five times.
"""
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
RANGES_G = {0.000061: 2.0, 0.000122: 4.0, 0.000244: 8.0, 0.000732: 16.0}
"""LSM9DS1: full scale by g per count (ST, lsm9ds1_reg.c)."""
RANGES_DPS = {0.00875: 245.0, 0.0175: 500.0, 0.07: 2000.0}
"""LSM9DS1: full scale by deg/s per count (ST, lsm9ds1_reg.c)."""
WIDE_RANGE_FACTOR = 1.5
"""Code that takes 16/32768 for one count of the 16 g range (0.732 mg) reads 2/3 g at rest."""
SHORTEST_S = 10.0
"""Less is too short for a report, and tells nothing of a unit."""
FEWEST_RESTS, UNEVEN_G = 10, 0.15
"""Ten simulated LSM9DS1, with offsets of 0.04 g on each axis, spread by 0.10 g at most."""
UNSEEN_SCALE = 1.5
"""Fast movement, which alone is there, imitates a scale by less."""


def check_physics(recording: Recording) -> Recording:
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
    if not recording.stated.is_known and are_exchanged(recording.segments):
        raise ExchangedSensors
    rests = find_rests(recording.segments)
    checked = _check_gravity(recording, rests)
    # What made 1 g of the rests made it of the samples: they are found anew where these were changed.
    if len(checked.flags) > len(recording.flags) or recording.stated.acc_unit == "registers":
        rests = find_rests(checked.segments)
    checked = _check_rates(_check_rest_length(checked, rests.acc), rests)
    source = recording.understood.get("units_from") or "motion"
    return replace(checked, understood={**checked.understood, "units_from": source})


def are_exchanged(segments: Sequence[Segment]) -> bool:
    """Return whether the angular rate keeps the length of gravity, and the acceleration does not.

    An accelerometer on an arm reads about the length of gravity all the time; a gyroscope reads next to
    nothing at rest and a hundred times as much in movement. Where the columns show the opposite, they stand
    under each other's names.
    """
    accelerations = _measure_spread(measure_lengths(segments))
    if accelerations < LIVELY_RATIO:
        return False
    return accelerations > MORE_TIMES * _measure_spread(measure_lengths(segments, is_rate=True))


def _measure_spread(lengths: Float64Array) -> float:
    """Return the 95th percentile of the length over the 5th."""
    if len(lengths) == 0:
        return 1.0
    low, high = np.quantile(lengths, [0.05, 0.95]).tolist()
    return float(high / max(low, 1e-9))


def are_units_stated(recording: Recording) -> bool:
    """Return whether both units are stated in words that say how large they are."""
    units = {_drop_unknown(recording.stated.acc_unit), _drop_unknown(recording.stated.gyr_unit)}
    return not {"", "registers"} & units


def _drop_unknown(unit: str) -> str:
    """Return a unit, "" for a word that does not say how large it is ("raw", "lsb")."""
    return unit if unit == "registers" or acc_scale_g(unit) or gyr_scale_dps(unit) else ""


# Corrections of samples, in place (a shift is too large to be held twice), and their flags.


def add_flags(recording: Recording, *flags: QualityFlag) -> Recording:
    """Return the recording with more caveats."""
    return replace(recording, flags=(*recording.flags, *flags))


def _flag_correction(recording: Recording, what: str, evidence: str, **facts: str | float) -> Recording:
    """Flag a correction, with the evidence for it (W-UNITS)."""
    flag = QualityFlag(Caveat.UNITS, facts={"what": what, "evidence": evidence, **facts})
    return add_flags(recording, flag)


def _flag_doubt(recording: Recording, sensor: str, **facts: float) -> Recording:
    """Flag a scale that the readings contradict and that is left as it is (W-SCALE-DOUBT)."""
    return add_flags(recording, QualityFlag(Caveat.SCALE_DOUBT, facts={"sensor": sensor, **facts}))


def _multiply(
    recording: Recording, acc: float | Float64Array = 1.0, gyr: float | Float64Array = 1.0
) -> Recording:
    """Multiply the samples, all axes alike or each by its own factor, in place.

    The segments become other objects: what was summarised of these samples holds no more.
    """
    for segment in recording.segments:
        for samples, factors in ((segment.acc_g, acc), (segment.gyr_dps, gyr)):
            if np.any(np.not_equal(factors, 1.0)):
                samples[:] *= np.asarray(factors, np.float32)
    return replace(recording, segments=tuple(replace(segment) for segment in recording.segments))


# The accelerometer: 1 g at rest.


def _check_gravity(recording: Recording, rests: Rests) -> Recording:
    """Make 1 g of what is read at rest, by a unit; without rest, by the movement where no unit is stated."""
    unit = _drop_unknown(recording.stated.acc_unit)
    if len(rests) == 0:
        return _settle_moving(recording, unit)
    off = abs(rests.length - 1.0)
    if unit != "registers" and off <= REST_TOLERANCE:
        return recording
    factor = None if recording.stated.is_known else _find_acc_factor(rests.length, unit)
    if factor is not None:
        return _set_acc_unit(recording, unit, factor, "rest", rests.length)
    if off <= MOST_DOUBTED:
        return _flag_doubt(recording, "accelerometer", g=round(rests.length, 3))
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
    if recording.stated.is_known or (unit != "registers" and is_likely):
        is_lively = _measure_spread(lengths) > LIVELY_RATIO
        return _flag_doubt(recording, "accelerometer", moving_g=round(usual, 3)) if is_lively else recording
    if unit == "registers":
        fitting = [one for one in RANGES_G if abs(usual * one - 1.0) <= MOVING_TOLERANCE]
    else:
        fitting = [one for one in USUAL_UNITS_G[1:] if 1.0 / MOVING_TIMES < usual * one < MOVING_TIMES]
    if unit not in ("", "registers") or len(fitting) != 1:
        _refuse_short(recording)
        raise UnknownUnit(sensor="accelerometer")
    return _set_acc_unit(recording, unit, fitting[0], "motion", usual)


def _find_acc_factor(rest: float, unit: str) -> float | None:
    """Find what makes 1 g of a reading at rest in a unit; one that is stated is set aside for slips only."""
    tolerance, candidates = REST_TOLERANCE, tuple(RANGES_G)
    if unit == "":
        candidates = (1 / STANDARD_GRAVITY, 1e-3, WIDE_RANGE_FACTOR, *RANGES_G)
    elif unit != "registers":
        stated_g = acc_scale_g(unit) or 1.0
        slips = (true_g / stated_g for true_g in USUAL_UNITS_G if not isclose(true_g, stated_g))
        tolerance, candidates = 0.05, (*slips, WIDE_RANGE_FACTOR)
    fitting = [factor for factor in candidates if abs(rest * factor - 1.0) <= tolerance]
    return min(fitting, key=lambda factor: abs(rest * factor - 1.0), default=None)


def _set_acc_unit(recording: Recording, unit: str, factor: float, evidence: str, read_g: float) -> Recording:
    scaled = _multiply(recording, acc=factor)
    if unit == "registers":
        return replace(scaled, acc_range_g=RANGES_G[factor])
    return _flag_correction(scaled, "acceleration", evidence, factor=factor, g=round(read_g, 3))


def _refuse_no_gravity(recording: Recording) -> float | None:
    """Refuse an acceleration that reads next to nothing at rest; see :func:`measure_rest_part`."""
    part = measure_rest_part(recording.segments)
    if part is not None and part < LEAST_REST_PART:
        raise NoGravity
    return part


def _refuse_short(recording: Recording) -> None:
    present_s = sum(segment.duration_us for segment in recording.segments) / MICROSECONDS
    if present_s < SHORTEST_S:
        raise TooShort(s=present_s)


def _check_rest_length(recording: Recording, rests_g: Float64Array) -> Recording:
    """Doubt what the accelerometer surely reads too long or too short; refuse what reads unlike all round."""
    scale = measure_rest_scale(rests_g)
    if scale is not None and scale.is_even:
        is_off = scale.is_off
        return (
            _flag_doubt(recording, "accelerometer", g=round(1.0 / scale.factor, 3)) if is_off else recording
        )
    if len(rests_g) >= FEWEST_RESTS:
        low_g, high_g = np.quantile(np.linalg.norm(rests_g, axis=1), [0.02, 0.98]).tolist()
        if high_g - low_g > UNEVEN_G:
            raise WrongScale(low_g=round(low_g, 2), high_g=round(high_g, 2))
    return recording


# The gyroscope: unit and hand, by the gravity that it turns.


def _check_rates(recording: Recording, rests: Rests) -> Recording:
    unit = _drop_unknown(recording.stated.gyr_unit)
    windows = cut_windows(recording.segments)
    offset_dps = np.median(rests.gyr, axis=0) if len(rests) else np.zeros(3)
    is_cut = find_flat_range([summarise(segment)[1] for segment in recording.segments]) is not None
    evidence = judge_frame(windows, offset_dps, _list_rate_factors(unit))
    if evidence is not None:
        _refuse_mixed(recording, evidence)
    if evidence is not None and evidence.is_settled:
        recording = _arrange(recording, unit, windows, evidence)
    elif unit in ("", "registers"):
        _refuse_short(recording)
        raise UnknownUnit(sensor="gyroscope")
    elif evidence is not None and evidence.is_doubtful:
        recording = add_flags(recording, QualityFlag(Caveat.MIXED, facts=_describe_mixed(evidence)))
    return _narrow_ranges(recording, is_cut=is_cut)


def _list_rate_factors(unit: str) -> tuple[float, ...]:
    if unit == "registers":
        return tuple(RANGES_DPS)
    if unit == "":
        return (1.0, DEG_PER_RAD, 1e-3, *RANGES_DPS)
    return (1.0, DEG_PER_RAD, 1 / DEG_PER_RAD, 1e-3, 1e3)


def _refuse_mixed(recording: Recording, evidence: FrameEvidence) -> None:
    """Refuse what contradicts a known header, and what nothing explains."""
    is_other = evidence.chosen is not evidence.as_read and evidence.lively >= BAD_WINDOWS
    if recording.stated.is_known and is_other:
        raise MixedColumns(**_describe_mixed(evidence), factor=float(f"{evidence.chosen.factor:.3g}"))
    if evidence.is_wrong:
        raise MixedColumns(**_describe_mixed(evidence))


def _describe_mixed(evidence: FrameEvidence) -> dict[str, int]:
    return {"percent": round(100.0 * evidence.as_read.score), "turns": evidence.lively}


def _arrange(recording: Recording, unit: str, windows: GravityWindows, evidence: FrameEvidence) -> Recording:
    """Apply what the motion says: unit and hand; then doubt a scale that is left."""
    chosen = evidence.chosen
    size = max(abs(chosen.factor), 1e-12)
    factor = min(_list_rate_factors(unit), key=lambda named: abs(np.log(size / named)))
    if factor != 1.0:
        recording = _multiply(recording, gyr=factor)
        if unit == "registers":
            recording = replace(recording, gyr_range_dps=RANGES_DPS[factor])
        recording = _flag_correction(recording, "angular rate", "motion", factor=factor)
    if chosen.factor < 0.0:  # left-handed: x of both sensors is turned over
        mirror = np.array([-1.0, 1.0, 1.0])
        recording = _multiply(recording, mirror, mirror)
        recording = _flag_correction(recording, "left-handed", "motion", turned="x")
        library = recording.stated.left_gyr_factor
        if library != 1.0:  # Arduino_LSM9DS1 prints 61.04 mdps for a count of 70
            recording = replace(_multiply(recording, gyr=library), device="lsm9ds1")
            recording = _flag_correction(recording, "angular rate", "layout", factor=library)
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
        return _flag_doubt(recording, "gyroscope", factor=round(overall, 3))
    facts: dict[str, str | float] = {
        "rate_from": "doubted",
        "rate_hz": round(recording.rate_hz, 3),
        "other_hz": round(recording.rate_hz / overall, 1),
    }
    return add_flags(recording, QualityFlag(Caveat.RATE, facts=facts))


def _narrow_ranges(recording: Recording, *, is_cut: bool) -> Recording:
    """Take the size at which the samples are cut off for the full scale, where that is less than stated.

    ``is_cut``: the gyroscope's flat tops were seen, in whatever unit it was.
    """
    acc, gyr = zip(*map(summarise, recording.segments), strict=True)
    acc_g = find_flat_range(acc, LEAST_ACC_TOP_G)
    gyr_dps = find_flat_range(gyr if is_cut else (), LEAST_GYR_TOP_DPS)
    return replace(
        recording,
        acc_range_g=min((r for r in (acc_g, recording.acc_range_g) if r is not None), default=None),
        gyr_range_dps=min((r for r in (gyr_dps, recording.gyr_range_dps) if r is not None), default=None),
    )


def refuse_impossible_rates(recording: Recording) -> Recording:
    """Return the recording unless it holds rates that no such part can read; raises WrongScale."""
    for segment in recording.segments:
        size = summarise(segment)[1].find_extreme()
        if size > MOST_DPS:
            row = int(np.flatnonzero(np.abs(segment.gyr_dps).max(axis=1) > MOST_DPS)[0])
            at_s = segment.start_s + row / segment.rate_hz
            clock = f"+{at_s:.2f} s"
            if recording.start is not None:
                clock = f"{recording.start + timedelta(seconds=at_s):%Y-%m-%d %H:%M:%S}"
            raise WrongScale(dps=round(size), clock=clock)
    return recording
