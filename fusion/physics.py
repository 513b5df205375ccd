"""What every recording must obey: 1 g at rest, and gravity that turns as the gyroscope says.

In the sensor frame gravity turns by da/dt = a x w. From moments at which the arm was still, gravity is
carried along the gyroscope to the next still moment and compared with what the accelerometer reads there.
The sign that fits tells a left-handed frame, the factor that fits tells the unit. Nothing is changed but on
strong evidence; what is changed is flagged.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.errors import WrongScale
from fusion.recording import QualityFlag, Recording, Segment

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
PROBED_BLOCKS = 150
BLOCK_S = 8.0
STILL_S = 0.05
LONGEST_PAIR_S = 2.0
MIN_TILT_DEG = 4.0
MIN_PAIRS = 20
CLEAR_RATIO = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class StillPair:
    """Two still moments and the angular rates from one to the other, deg/s, shape (n, 3)."""

    before_g: NDArray[np.float64]
    after_g: NDArray[np.float64]
    gyr_dps: NDArray[np.float64]
    period_s: float


@njit(cache=True, nogil=True)
def carry_gravity(
    gravity: NDArray[np.float64], gyr_dps: NDArray[np.float64], factor: float, period_s: float
) -> NDArray[np.float64]:
    """Turn a vector fixed in space as the sensor sees it turn (Rodrigues' formula, step by step)."""
    x, y, z = gravity[0], gravity[1], gravity[2]
    step = -factor * period_s * np.pi / 180.0
    for k in range(len(gyr_dps)):
        wx, wy, wz = gyr_dps[k, 0] * step, gyr_dps[k, 1] * step, gyr_dps[k, 2] * step
        angle = np.sqrt(wx * wx + wy * wy + wz * wz)
        if angle < 1e-12:
            continue
        ux, uy, uz = wx / angle, wy / angle, wz / angle
        c, s = np.cos(angle), np.sin(angle)
        along = (ux * x + uy * y + uz * z) * (1.0 - c)
        x, y, z = (
            x * c + (uy * z - uz * y) * s + ux * along,
            y * c + (uz * x - ux * z) * s + uy * along,
            z * c + (ux * y - uy * x) * s + uz * along,
        )
    return np.array([x, y, z])


def check_physics(recording: Recording) -> Recording:
    """Correct unit, frame and gyroscope scale where the evidence is strong, and flag it.

    A GT9X tells its scales and has a right-handed frame: it comes through untouched unless 1 g at rest
    fails.

    Raises
    ------
    WrongScale
        At rest the accelerometer reads something that no known unit makes 1 g.
    """
    checked = _check_gravity(recording)
    if recording.device == "gt9x":
        return checked
    pairs = find_still_pairs(checked.segments)
    checked = _check_rate_unit(checked, pairs)
    pairs = find_still_pairs(checked.segments)
    checked, is_left_handed = _check_frame(checked, pairs)
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


def probe_blocks(segments: Sequence[Segment]) -> list[tuple[Segment, int, int]]:
    """Blocks of 8 s spread over the recording: all of a short one, 150 of a long one."""
    blocks = []
    for segment in segments:
        n = max(8, round(BLOCK_S * segment.rate_hz))
        blocks += [(segment, first, min(first + n, len(segment))) for first in range(0, len(segment), n)]
    stride = max(1, -(-len(blocks) // PROBED_BLOCKS))
    return blocks[::stride]


def moving_mean(segment: Segment, first: int, stop: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean acceleration over 50 ms (3 rows at least) from each row on, shape (m, 3), and its scatter (m,)."""
    width = max(3, round(STILL_S * segment.rate_hz))
    acc = segment.acc_g[first:stop].astype(np.float64)
    if len(acc) <= width:
        return np.empty((0, 3)), np.empty(0)
    sums = np.cumsum(np.vstack([np.zeros(3), acc]), axis=0)
    squares = np.cumsum(np.vstack([np.zeros(3), acc * acc]), axis=0)
    means = (sums[width:] - sums[:-width]) / width
    variances = (squares[width:] - squares[:-width]) / width - means * means
    return means, np.sqrt(np.maximum(variances, 0.0).max(axis=1))


def find_still_pairs(segments: Sequence[Segment]) -> list[StillPair]:
    """Still moments at most 2 s apart between which the tilt changed by 4 deg or more."""
    return [
        pair for segment, first, stop in probe_blocks(segments) for pair in _pairs_in(segment, first, stop)
    ]


def _pairs_in(segment: Segment, first: int, stop: int) -> list[StillPair]:
    means, scatter = moving_mean(segment, first, stop)
    is_still = (np.abs(np.linalg.norm(means, axis=1) - 1.0) < 0.05) & (scatter < 0.05)
    places = np.flatnonzero(is_still)
    half = max(3, round(STILL_S * segment.rate_hz)) // 2
    longest = round(LONGEST_PAIR_S * segment.rate_hz)
    pairs: list[StillPair] = []
    at = 0
    while at < len(places):
        reach = np.searchsorted(places, places[at] + longest, side="right") - 1
        i, j = int(places[at]), int(places[reach])
        if _angle_deg(means[i], means[j]) >= MIN_TILT_DEG:
            rates = segment.gyr_dps[first + i + half : first + j + half].astype(np.float64)
            pairs.append(StillPair(means[i], means[j], rates, 1.0 / segment.rate_hz))
        at = max(at + 1, int(reach))
    return pairs


def _angle_deg(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    lengths = max(float(np.linalg.norm(first) * np.linalg.norm(second)), 1e-12)
    return float(np.degrees(np.arccos(np.clip(first @ second / lengths, -1.0, 1.0))))


def score_factor(pairs: Sequence[StillPair], factor: float) -> float:
    """How badly a gyroscope times ``factor`` explains the tilts: 0 wholly, 1 no better than none at all.

    Squared angles in relation to the squared tilts.
    """
    wrong = [
        _angle_deg(carry_gravity(pair.before_g, pair.gyr_dps, factor, pair.period_s), pair.after_g) ** 2
        for pair in pairs
    ]
    tilts = [_angle_deg(pair.before_g, pair.after_g) ** 2 for pair in pairs]
    return float(np.sum(wrong) / max(np.sum(tilts), 1e-12))


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
