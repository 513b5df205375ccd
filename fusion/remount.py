"""Sensor taken off and put back turned: the arm axis found anew, or that part left out.

A recording is cut where the sensor may have been off the arm: ten minutes or more in which, over 10 s, no
axis of the accelerometer has a standard deviation of 0.013 g (as ``fusion.quality.nonwear``), or a hole of
five minutes. On both sides the still moments are counted by direction. A worker's commonest direction stays
the same within a few degrees from one part of a day to another; the sensor was turned where it moved by more
than 25 deg and neither part knows the other's (RELIABILITY.md 93).

Where it moved by more than 35 deg and both parts have still moments enough, the arm axis is carried over by
the turn that takes the commonest and the mean direction of one part to those of the other; else the part is
left out, for other work may look alike: of one simulated hour with a hole, the commonest directions differed
by 20.5 deg though nothing was turned, and an axis carried over there was 19 deg wrong. On 20 simulated days
cut in two (1 to 3 half hours on each side) it was right within 3.6 deg (median; 95 %: 10 deg); at a bound of
20 deg none was falsely called turned and every turn of 30 deg or more was seen. A turn about the arm's own
axis changes nothing and is not looked for; nor is a sensor that slips while worn.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.recording import QualityFlag
from fusion.sensor_errors.accelerometer import AccelerometerCorrection
from fusion.sensor_errors.stillness import QuarterSeconds, QuietTable, summarise_windows

Table = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RemountRules:
    """What counts as off the arm, as another direction, and as enough to tell.

    Directions are counted within ``near_deg``; below ``known`` (both shares added) of the commonest's count
    the other part's commonest direction is not known. A part with fewer than ``least_moments`` still moments
    cannot be compared; with fewer than ``least_to_carry`` it is left out rather than calibrated.
    Up to ``carried_from_deg`` it is left out, too. ``axis_sigma_deg`` is how well the axis is carried over.
    """

    off_s: float = 600.0
    still_acc_sd_g: float = 0.013
    window_s: float = 10.0
    hole_s: float = 300.0
    near_deg: float = 10.0
    turned_deg: float = 25.0
    carried_from_deg: float = 35.0
    known: float = 1.0
    least_moments: int = 10
    least_to_carry: int = 120
    axis_sigma_deg: float = 5.0


@dataclass(frozen=True, slots=True, eq=False)
class AxisPart:
    """A stretch, seconds from the first sample, in which the sensor sat otherwise than at the calibration.

    ``arm_axis`` (3,) is the axis there, with its own uncertainty ``sigma_deg``; None where none could be
    found, and the part is left out.
    """

    start_s: float
    end_s: float
    arm_axis: Table | None
    sigma_deg: float = 0.0


def find_remounts(
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    accelerometer: AccelerometerCorrection,
    calibrated: tuple[float, Table],
    rules: RemountRules | None = None,
) -> tuple[AxisPart, ...]:
    """Parts that need an axis of their own; ``calibrated``: when the pose was held, and the axis it gave."""
    rules = rules or RemountRules()
    cuts_s = _find_cuts(blocks, rules)
    if not cuts_s:
        return ()
    edges_s = np.array([-np.inf, *cuts_s, np.inf])
    up = accelerometer.apply(stills.gravity_g, stills.middle_s)
    up = up / np.maximum(np.linalg.norm(up, axis=1, keepdims=True), 1e-9)
    part_of = np.searchsorted(edges_s, _leave_off(stills, blocks, rules), side="right") - 1
    parts = [up[part_of == k] for k in range(len(edges_s) - 1)]
    home = int(np.searchsorted(edges_s, calibrated[0], side="right")) - 1
    return tuple(
        _calibrate_part((float(edges_s[k]), float(edges_s[k + 1])), parts[home], part, calibrated[1], rules)
        for k, part in enumerate(parts)
        if k != home and _is_turned(parts[home], part, rules)
    )


def _find_cuts(blocks: Sequence[QuarterSeconds], rules: RemountRules) -> list[float]:
    """Middles of the stretches in which the sensor may have been off."""
    cuts = [(first + stop) / 2.0 for run in blocks for first, stop in _find_off(run, rules)]
    ends_s = [run.start_s + len(run.acc) * run.block_s for run in blocks]
    for end_s, run in zip(ends_s[:-1], blocks[1:], strict=True):
        if run.start_s - end_s >= rules.hole_s:
            cuts.append((end_s + run.start_s) / 2.0)
    return sorted(cuts)


def _find_off(run: QuarterSeconds, rules: RemountRules) -> list[tuple[float, float]]:
    """Stretches (start, end), s, of one run in which every window is still."""
    table = summarise_windows([run], rules.window_s)
    still = np.concatenate([[False], table.acc_sd_g < rules.still_acc_sd_g, [False]])
    starts, stops = np.flatnonzero(still[1:] & ~still[:-1]), np.flatnonzero(~still[1:] & still[:-1])
    long_enough = (stops - starts) * run.block_s + rules.window_s >= rules.off_s
    first_s = run.start_s + starts[long_enough] * run.block_s
    stop_s = run.start_s + (stops[long_enough] - 1) * run.block_s + rules.window_s
    return list(zip(first_s.tolist(), stop_s.tolist(), strict=True))


def _leave_off(stills: QuietTable, blocks: Sequence[QuarterSeconds], rules: RemountRules) -> Table:
    """Middle of each still moment; infinite (in no part) where the sensor may have been off."""
    middle_s = stills.middle_s.copy()
    for run in blocks:
        for first_s, stop_s in _find_off(run, rules):
            middle_s[(stills.middle_s > first_s) & (stills.middle_s < stop_s)] = np.inf
    return middle_s


def _thin(up: Table) -> Table:
    """Five hundred moments at even steps are enough to compare all with all."""
    return up[:: -(-len(up) // 500) or 1]


def _share_near(up: Table, directions: Table, rules: RemountRules) -> Table:
    """Share of the moments near each direction."""
    return np.asarray((up @ directions.T >= _cos(rules.near_deg)).mean(axis=0))


def _cos(angle_deg: float) -> float:
    return float(np.cos(np.radians(angle_deg)))


def _find_commonest(up: Table, rules: RemountRules) -> tuple[Table, float]:
    """The commonest direction, and the share of the moments near it."""
    shares = _share_near(up, up, rules)
    best = int(np.argmax(shares))
    near = up[up @ up[best] >= _cos(rules.near_deg)]
    mean = near.mean(axis=0)
    return mean / np.linalg.norm(mean), float(shares[best])


def _is_turned(home: Table, part: Table, rules: RemountRules) -> bool:
    """Whether the commonest directions differ, and neither part knows the other's."""
    if min(len(home), len(part)) < rules.least_moments:
        return False
    home, part = _thin(home), _thin(part)
    at_home, home_share = _find_commonest(home, rules)
    in_part, part_share = _find_commonest(part, rules)
    if at_home @ in_part > _cos(rules.turned_deg):
        return False
    known_in_part = _share_near(part, at_home[None], rules)[0] / part_share
    known_at_home = _share_near(home, in_part[None], rules)[0] / home_share
    return bool(known_in_part + known_at_home < rules.known)


def _calibrate_part(
    span_s: tuple[float, float], home: Table, part: Table, arm_axis: Table, rules: RemountRules
) -> AxisPart:
    if min(len(home), len(part)) < rules.least_to_carry:
        return AxisPart(*span_s, None)
    home, part = _thin(home), _thin(part)
    if _find_commonest(home, rules)[0] @ _find_commonest(part, rules)[0] > _cos(rules.carried_from_deg):
        return AxisPart(*span_s, None)
    turn = _build_frame(part, rules).T @ _build_frame(home, rules)
    return AxisPart(*span_s, np.asarray(turn @ arm_axis), rules.axis_sigma_deg)


def _build_frame(up: Table, rules: RemountRules) -> Table:
    """Rows: the commonest direction, and two across it, set by the mean of all."""
    commonest, _ = _find_commonest(up, rules)
    across = np.cross(commonest, up.mean(axis=0))
    across = across / max(float(np.linalg.norm(across)), 1e-9)
    return np.stack([commonest, across, np.cross(commonest, across)])


def flag_remounts(parts: Sequence[AxisPart], duration_s: float) -> tuple[QualityFlag, ...]:
    """W-REMOUNT with the first and last time it concerns, and how many parts were calibrated or left out."""
    if not parts:
        return ()
    spans = [(max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts]
    left_out = sum(part.arm_axis is None for part in parts)
    facts = {"calibrated": len(parts) - left_out, "left_out": left_out}
    seconds = sum(end_s - start_s for start_s, end_s in spans)
    return (QualityFlag("W-REMOUNT", len(parts), seconds, spans[0][0], spans[-1][1], facts, tuple(spans)),)
