"""What every recording must obey: 1 g at rest, and gravity that turns as the gyroscope says.

In the sensor frame gravity turns by da/dt = a x w. From moments at which the arm was still, gravity is
carried along the gyroscope to the next still moment and compared with what the accelerometer reads there.
The sign that fits tells a left-handed frame, the factor that fits tells the unit. Nothing is changed but on
strong evidence; what is changed is flagged.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.errors import TooShort, WrongScale
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Segment
from fusion.still_pairs import StillPair, find_still_pairs, moving_mean, probe_blocks, score_factor

STANDARD_GRAVITY = 9.80665
DEG_PER_RAD = 180.0 / np.pi
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
WIDE_RANGE_FACTOR = 1.5
"""Code that takes 16/32768 for one count of the 16 g range (0.732 mg) reads 2/3 g at rest."""
SHORTEST_S = 1.0
MIN_PAIRS = 20
CLEAR_RATIO = 0.6
WRONG_AXES, RIGHT_AXES = 0.5, 0.15
"""Scores from which the axes are taken to be mixed up, and below which another order is believed."""
RIVAL_RATIO = 2.0
TURNS = [
    (order, signs)
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]


def check_physics(recording: Recording) -> Recording:
    """Correct unit, frame and gyroscope scale where the evidence is strong, and flag it.

    A GT9X tells its scales and has a right-handed frame: it comes through untouched unless 1 g at rest
    fails.

    Raises
    ------
    WrongScale
        At rest the accelerometer reads something that no known unit makes 1 g.
    TooShort
        Less than a second, which tells nothing of a unit.
    """
    checked = _check_gravity(recording)
    if recording.device == "gt9x":
        return checked
    pairs = find_still_pairs(checked.segments)
    rated = _check_rate_unit(checked, pairs)
    if rated.segments[0].gyr_dps is not checked.segments[0].gyr_dps:
        pairs = find_still_pairs(rated.segments)
    checked, is_left_handed = _check_frame(rated, pairs)
    if not is_left_handed:
        checked = _check_axes(checked, pairs)
    return _check_arduino(checked, is_left_handed=is_left_handed)


def find_rest_g(segments: Sequence[Segment]) -> tuple[float, bool]:
    """Median length of the acceleration at still moments, and whether there were any; else over all."""
    still: list[NDArray[np.float64]] = []
    every: list[NDArray[np.float64]] = []
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


def _check_gravity(recording: Recording) -> Recording:
    rest, is_still = find_rest_g(recording.segments)
    tolerance = REST_TOLERANCE if is_still else MOVING_TOLERANCE
    unit = recording.understood.get("acceleration_unit", "g")
    is_stated = unit not in ("", "registers")
    if is_stated and (abs(rest - 1.0) <= tolerance or not is_still):
        return recording
    if unit == "" and abs(rest - 1.0) <= tolerance:
        return recording
    factor = _find_acc_factor(rest, unit, tolerance, is_still=is_still)
    if factor is None:
        present_s = sum(segment.duration_us for segment in recording.segments) / MICROSECONDS
        if present_s < SHORTEST_S:
            raise TooShort(s=present_s)
        raise WrongScale(g=round(rest, 3))
    scaled = scale_recording(recording, acc_factor=factor)
    if unit == "registers":
        return replace(scaled, acc_range_g=RANGES_G[SENSITIVITIES_G.index(factor)])
    flag = QualityFlag("W-UNITS", facts={"what": "acceleration", "factor": factor, "g": round(rest, 3)})
    return replace(scaled, flags=(*scaled.flags, flag))


def _find_acc_factor(rest: float, unit: str, tolerance: float, *, is_still: bool) -> float | None:
    if unit == "registers":
        candidates: tuple[float, ...] = SENSITIVITIES_G
    elif unit == "":
        candidates = (1 / STANDARD_GRAVITY, 1e-3, WIDE_RANGE_FACTOR, *SENSITIVITIES_G)
    else:
        # a stated unit is set aside for the well-known slips only, and only on still evidence
        candidates = (1 / STANDARD_GRAVITY, WIDE_RANGE_FACTOR) if is_still else ()
        tolerance = min(tolerance, 0.05)
    fitting = [factor for factor in candidates if abs(rest * factor - 1.0) <= tolerance]
    return min(fitting, key=lambda factor: abs(rest * factor - 1.0)) if fitting else None


def scale_recording(recording: Recording, acc_factor: float = 1.0, gyr_factor: float = 1.0) -> Recording:
    """The same recording with its samples multiplied."""
    segments = tuple(
        replace(
            segment,
            acc_g=segment.acc_g * np.float32(acc_factor) if acc_factor != 1.0 else segment.acc_g,
            gyr_dps=segment.gyr_dps * np.float32(gyr_factor) if gyr_factor != 1.0 else segment.gyr_dps,
        )
        for segment in recording.segments
    )
    return replace(recording, segments=segments)


def _check_rate_unit(recording: Recording, pairs: Sequence[StillPair]) -> Recording:
    unit = recording.understood.get("angular_rate_unit", "deg/s")
    candidates = _rate_candidates(unit)
    default = candidates[0]
    factor = default
    if len(pairs) >= MIN_PAIRS:
        scores = {k: min(score_factor(pairs, k), score_factor(pairs, -k)) for k in candidates}
        best = min(scores, key=lambda k: scores[k])
        if scores[best] < CLEAR_RATIO * scores[default] and scores[best] < 0.5:
            factor = best
    scaled = scale_recording(recording, gyr_factor=factor)
    if unit == "registers":
        scaled = replace(scaled, gyr_range_dps=RANGES_DPS[SENSITIVITIES_DPS.index(factor)])
    if factor == 1.0 and unit not in ("", "registers"):
        return scaled
    if factor == 1.0 and len(pairs) >= MIN_PAIRS:
        return scaled
    evidence = "motion" if len(pairs) >= MIN_PAIRS else "assumed"
    flag = QualityFlag("W-UNITS", facts={"what": "angular rate", "factor": factor, "evidence": evidence})
    return replace(scaled, flags=(*scaled.flags, flag))


def _rate_candidates(unit: str) -> tuple[float, ...]:
    if unit == "registers":
        return SENSITIVITIES_DPS
    if unit == "":
        return (1.0, DEG_PER_RAD, 1e-3, *SENSITIVITIES_DPS)
    return (1.0, DEG_PER_RAD, 1 / DEG_PER_RAD)


def _check_frame(recording: Recording, pairs: Sequence[StillPair]) -> tuple[Recording, bool]:
    if len(pairs) < MIN_PAIRS:
        return recording, False
    as_is, turned = score_factor(pairs, 1.0), score_factor(pairs, -1.0)
    if turned >= CLEAR_RATIO * as_is or turned >= 1.0:
        return recording, False
    mirror = np.array([-1.0, 1.0, 1.0], np.float32)
    segments = tuple(
        replace(s, acc_g=s.acc_g * mirror, gyr_dps=s.gyr_dps * mirror) for s in recording.segments
    )
    facts: dict[str, str | int | float] = {
        "what": "left-handed",
        "evidence": "motion",
        "as_is": round(as_is, 3),
        "turned": round(turned, 3),
    }
    flag = QualityFlag("W-UNITS", facts=facts)
    return replace(recording, segments=segments, flags=(*recording.flags, flag)), True


def _check_axes(recording: Recording, pairs: Sequence[StillPair]) -> Recording:
    """Put the gyroscope's axes in the order and with the signs in which they explain how gravity turns.

    Only where they do not as they are, exactly one other order does, and there are pairs enough.
    """
    if len(pairs) < MIN_PAIRS or score_factor(pairs, 1.0) < WRONG_AXES:
        return recording
    scores = sorted((score_factor([_turn(pair, *turn) for pair in pairs], 1.0), turn) for turn in TURNS)
    (best, (order, signs)), (rival, _) = scores[0], scores[1]
    if best > RIGHT_AXES or rival < RIVAL_RATIO * best or rival < WRONG_AXES:
        return recording
    segments = tuple(
        replace(s, gyr_dps=np.ascontiguousarray(s.gyr_dps[:, order]) * np.array(signs, np.float32))
        for s in recording.segments
    )
    names = " ".join(
        f"{'-' if sign < 0 else '+'}{'xyz'[axis]}" for axis, sign in zip(order, signs, strict=True)
    )
    facts: dict[str, str | int | float] = {"what": "axes", "evidence": "motion", "order": names}
    flag = QualityFlag("W-UNITS", facts=facts)
    return replace(recording, segments=segments, flags=(*recording.flags, flag))


def _turn(pair: StillPair, order: tuple[int, ...], signs: tuple[float, ...]) -> StillPair:
    return replace(pair, gyr_dps=np.ascontiguousarray(pair.gyr_dps[:, order]) * np.array(signs))


def _check_arduino(recording: Recording, *, is_left_handed: bool) -> Recording:
    """Undo the library's gyroscope scale: its grid of values in the left-handed frame of an LSM9DS1.

    The grid alone is no proof: parts with a true 2000/32768 deg/s per count share it, but are right-handed.
    """
    if not (is_left_handed and is_on_grid(recording.segments, ARDUINO_DPS)):
        return recording
    scaled = scale_recording(recording, gyr_factor=ARDUINO_FACTOR)
    flag = QualityFlag(
        "W-UNITS", facts={"what": "angular rate", "factor": ARDUINO_FACTOR, "evidence": "grid"}
    )
    return replace(scaled, device="lsm9ds1", flags=(*scaled.flags, flag))


def is_on_grid(segments: Sequence[Segment], step_dps: float) -> bool:
    """Whether the angular rates are whole multiples of a step, as far as three decimals show it."""
    values = np.concatenate(
        [s.gyr_dps[first : first + 200].ravel() for s, first, _ in probe_blocks(segments)]
    )
    ratios = values.astype(np.float64) / step_dps
    return bool(np.mean(np.abs(ratios - np.round(ratios)) < 0.02) > 0.99 and np.ptp(values) > 10 * step_dps)
