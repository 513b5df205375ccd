"""The stretches of a recording in which the sensor sat on the arm in one way.

A recording is cut where the sensor may have been off the arm: ten minutes or more in which, over 10 s, no
axis of the accelerometer has a standard deviation of 0.013 g (as in ``fusion.quality.time_account``), or a
hole of five minutes. It is cut, too, where it slipped while worn, as walking shows (:mod:`fusion.pose.slips`)
or the person says; the slip itself is left out.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from fusion.caveats import Caveat
from fusion.pose.postures import (
    Moments,
    compare_hanging,
    compare_postures,
    find_angle_deg,
    find_calm_moments,
    find_hanging,
    find_striding_moments,
)
from fusion.pose.slips import Slip, find_slips
from fusion.recording import Float64Array, QualityFlag, flag_stretches
from fusion.sensor.accelerometer import AccelerometerCorrection
from fusion.sensor.stillness import QuarterSeconds, QuietTable, summarise_windows
from fusion.still_limits import OFF_THE_ARM

SAID_S = 60.0
"""How exactly a person knows when the sensor slipped: so much on both sides is left out."""


@dataclass(frozen=True, slots=True)
class WearRules:
    """What counts as off the arm. ``least_share`` of the calm moments: in such a stretch the pose is sought;
    a sensor in a bag or in a hand is moved for less.
    """

    off_s: float = 600.0
    still_acc_sd_g: float = OFF_THE_ARM.acc_sd_g
    window_s: float = OFF_THE_ARM.window_s
    hole_s: float = 300.0
    least_share: float = 0.15


@dataclass(frozen=True, slots=True, eq=False)
class WearPart:
    """A part of the day: in which stretch of wear it lies; its still, its calm and its walking moments.

    ``is_whole``: nothing slipped in its stretch of wear; ``opens``: it begins it, at ``worn_from_s``.
    """

    start_s: float
    end_s: float
    stretch: int
    still: Moments
    calm: Moments
    strides: Moments
    is_whole: bool = True
    opens: bool = True
    worn_from_s: float = 0.0

    def find_hanging(self) -> Float64Array | None:
        """The direction in which the arm hangs while walking; None where too little was walked."""
        return find_hanging(self.strides)


@dataclass(frozen=True, slots=True, eq=False)
class Wear:
    """The recording, cut where the sensor was off or slipped; slips lie between parts."""

    parts: tuple[WearPart, ...]
    slips: tuple[Slip, ...]

    def find_part(self, time_s: float) -> WearPart:
        """The part that a time lies in, or the nearest."""
        return min(self.parts, key=lambda part: max(part.start_s - time_s, time_s - part.end_s))

    def find_openings(self) -> tuple[WearPart, ...]:
        """The parts that begin a stretch of wear worth the name; all that begin one where none is."""
        worn: Counter[int] = Counter()
        for part in self.parts:
            worn[part.stretch] += len(part.calm.up)
        least = WearRules().least_share * worn.total()
        openings = [part for part in self.parts if part.opens]
        return tuple(part for part in openings if worn[part.stretch] >= least) or tuple(openings)


def divide_by_wear(
    blocks: Sequence[QuarterSeconds],
    stills: QuietTable,
    accelerometer: AccelerometerCorrection,
    slip_times_s: Sequence[float] = (),
) -> Wear:
    """Cut a recording where the sensor may have been off the arm, and where it slipped."""
    rules = WearRules()
    cuts, off = _find_cuts(blocks, rules)
    found = (
        _find_still_moments(stills, accelerometer),
        find_calm_moments(blocks, accelerometer),
        find_striding_moments(blocks, accelerometer),
    )
    still, calm, strides = (_leave_off(moments, off) for moments in found)
    opened_s, ended_s = (blocks[0].start_s, _end(blocks[-1])) if blocks else (0.0, 0.0)
    said = [
        Slip(at_s - SAID_S, at_s + SAID_S) for at_s in sorted(slip_times_s) if opened_s <= at_s <= ended_s
    ]
    day = WearPart(-np.inf, np.inf, 0, still, calm, strides, worn_from_s=opened_s)
    return _divide(day, cuts, said, ended_s)


def _end(run: QuarterSeconds) -> float:
    return run.start_s + len(run.acc) * run.block_s


def _find_still_moments(stills: QuietTable, accelerometer: AccelerometerCorrection) -> Moments:
    return Moments(stills.middle_s, accelerometer.find_up(stills.gravity_g, stills.middle_s))


Cut = tuple[float, float]
"""Middle of a stretch in which the sensor may have been off, and its end."""


def _find_cuts(
    blocks: Sequence[QuarterSeconds], rules: WearRules
) -> tuple[list[Cut], list[tuple[float, float]]]:
    """Where to cut, and the stretches off the arm that hold samples."""
    off = [stretch for run in blocks for stretch in _find_off(run, rules)]
    cuts = [((first + stop) / 2.0, stop) for first, stop in off]
    for run, following in pairwise(blocks):
        end_s = _end(run)
        if following.start_s - end_s >= rules.hole_s:
            cuts.append(((end_s + following.start_s) / 2.0, following.start_s))
    return sorted(cuts), off


def _find_off(run: QuarterSeconds, rules: WearRules) -> list[tuple[float, float]]:
    """Stretches (start, end), s, of one run in which every window is still."""
    table = summarise_windows([run], rules.window_s)
    still = np.concatenate([[False], table.acc_sd_g < rules.still_acc_sd_g, [False]])
    starts, stops = np.flatnonzero(still[1:] & ~still[:-1]), np.flatnonzero(~still[1:] & still[:-1])
    long_enough = (stops - starts) * run.block_s + rules.window_s >= rules.off_s
    first_s = run.start_s + starts[long_enough] * run.block_s
    stop_s = run.start_s + (stops[long_enough] - 1) * run.block_s + rules.window_s
    return list(zip(first_s.tolist(), stop_s.tolist(), strict=True))


def _leave_off(moments: Moments, off: list[tuple[float, float]]) -> Moments:
    """Only the moments at which the sensor was worn."""
    worn = np.ones(len(moments.time_s), dtype=np.bool_)
    for first_s, stop_s in off:
        worn &= (moments.time_s <= first_s) | (moments.time_s >= stop_s)
    return Moments(moments.time_s[worn], moments.up[worn])


def _divide(day: WearPart, cuts: list[Cut], said: list[Slip], ended_s: float) -> Wear:
    """Cut into parts; a slip lies between two parts, unless it begins or ends the stretch of wear.

    After a slip at the very start the sensor is worn from its end on.
    """
    parts: list[WearPart] = []
    slips: list[Slip] = []
    edges = [(-np.inf, day.worn_from_s), *cuts]
    ends_s = [*(middle_s for middle_s, _ in cuts), np.inf]
    for stretch, ((first_s, worn_from_s), end_s) in enumerate(zip(edges, ends_s, strict=True)):
        found = _find_slips(day, (first_s, end_s), said)
        starts_s, stops_s = [first_s, *(slip.end_s for slip in found)], [*(s.first_s for s in found), end_s]
        spans = [
            (start_s, stop_s)
            for start_s, stop_s in zip(starts_s, stops_s, strict=True)
            if start_s < min(stop_s, ended_s) and stop_s > worn_from_s
        ] or [(first_s, end_s)]
        parts += [
            replace(
                _cut_part(day, stretch, span_s),
                is_whole=not found,
                opens=span_s is spans[0],
                worn_from_s=max(worn_from_s, spans[0][0]),
            )
            for span_s in spans
        ]
        slips += found
    return Wear(tuple(parts), tuple(slips))


def _find_slips(day: WearPart, span_s: tuple[float, float], said: list[Slip]) -> list[Slip]:
    """The slips that the person names in a stretch of wear, and those that walking shows between them."""
    named = [slip for slip in said if span_s[0] < slip.first_s and slip.end_s < span_s[1]]
    starts_s = [span_s[0], *(slip.end_s for slip in named)]
    ends_s = [*(slip.first_s for slip in named), span_s[1]]
    found = [
        slip
        for between_s in zip(starts_s, ends_s, strict=True)
        for slip in find_slips(day.calm.within(*between_s), day.strides.within(*between_s))
    ]
    return sorted([*named, *found], key=lambda slip: slip.first_s)


def _cut_part(day: WearPart, stretch: int, span_s: tuple[float, float]) -> WearPart:
    still, calm, strides = (moments.within(*span_s) for moments in (day.still, day.calm, day.strides))
    return WearPart(*span_s, stretch, still, calm, strides)


# Sensor that sat otherwise on the arm for a part of the recording: taken off and put back, or slipped.
#
# Each part in which no pose was held is compared with the part that holds the first. After the sensor was
# off, it was turned where the commonest direction of still moments moved by more than 25 deg and neither part
# knows the other's (RELIABILITY.md 93); beyond a slip it is taken for turned. Walking decides where both
# parts have half a minute of it (the arm hangs then): hanging within 10 deg in both, nothing turned, or the
# sensor was pushed back, whatever the postures say. So it is where the first part has no walking, but the
# calibrated axis is the direction of walking in the other. A part that turned is left out.


@dataclass(frozen=True, slots=True)
class ReattachmentRules:
    """What counts as another direction, and as enough to tell.

    Below ``known`` (see :func:`fusion.pose.postures.compare_postures`) the other part's commonest direction
    is not known. A part with fewer than ``least_moments`` still moments is compared by walking alone. Hanging
    within ``hangs_alike_deg`` of each other in walking, nothing turned.
    """

    turned_deg: float = 25.0
    known: float = 1.0
    least_moments: int = 10
    hangs_alike_deg: float = 10.0


REATTACHMENT = ReattachmentRules()
REATTACHED_SIGMA_DEG = 5.0
"""What is not known of the axis, beside the pose, where the sensor was pushed back or put back."""


@dataclass(frozen=True, slots=True, eq=False)
class AxisPart:
    """A stretch, seconds from the first sample, that the first axis does not read as it reads the others.

    ``arm_axis`` (3,) is the axis there, ``sigma_deg`` what its uncertainty adds to that of the first; None
    where the stretch is left out, ``apart_deg`` then the angle between the poses on both sides of it.
    ``is_posed``: a pose was held in it.
    """

    start_s: float
    end_s: float
    arm_axis: Float64Array | None
    sigma_deg: float = 0.0
    apart_deg: float = 0.0
    is_posed: bool = False


def judge_part(posed: WearPart, part: WearPart, arm_axis: Float64Array) -> AxisPart | None:
    """How a part without a pose is read, by the part ``posed`` whose axis is known; None: as that part."""
    is_plain = part.stretch != posed.stretch and part.is_whole
    if _hangs_alike(posed, part, arm_axis):
        kept = AxisPart(part.start_s, part.end_s, arm_axis, REATTACHED_SIGMA_DEG)
        return None if is_plain else kept
    if is_plain and not _is_turned(posed, part):
        return None
    return AxisPart(part.start_s, part.end_s, None)


def _hangs_alike(posed: WearPart, part: WearPart, arm_axis: Float64Array) -> bool:
    """Whether walking shows the arm hanging in the same direction, or as it did in the pose."""
    apart_deg = compare_hanging(posed.strides, part.strides)
    hangs = part.find_hanging()
    if apart_deg is None and hangs is not None:
        apart_deg = find_angle_deg(hangs, arm_axis)
    return apart_deg is not None and apart_deg < REATTACHMENT.hangs_alike_deg


def _is_turned(posed: WearPart, part: WearPart) -> bool:
    """Whether the commonest directions differ, and neither part knows the other's.

    Where somebody was hardly ever still, walking on both sides tells.
    """
    if min(len(posed.still.up), len(part.still.up)) < REATTACHMENT.least_moments:
        hangs_deg = compare_hanging(posed.strides, part.strides)
        return hangs_deg is not None and hangs_deg > REATTACHMENT.turned_deg
    angle_deg, known = compare_postures(posed.still, part.still)
    return angle_deg > REATTACHMENT.turned_deg and known < REATTACHMENT.known


def flag_axis_parts(parts: Sequence[AxisPart], duration_s: float) -> Iterator[QualityFlag]:
    """Flag parts that turned (W-REMOUNT) and poses that differ (W-POSES-DIFFER)."""
    differ = [part for part in parts if part.apart_deg]
    turned = [part for part in parts if not (part.apart_deg or part.is_posed)]
    if turned:
        left_out = sum(part.arm_axis is None for part in turned)
        facts = {"calibrated": len(turned) - left_out, "left_out": left_out}
        yield flag_stretches(Caveat.REMOUNT, _bound(turned, duration_s), facts)
    if differ:
        apart_deg = round(max(part.apart_deg for part in differ))
        yield flag_stretches(Caveat.POSES_DIFFER, _bound(differ, duration_s), {"apart_deg": apart_deg})


def _bound(parts: Sequence[AxisPart], duration_s: float) -> list[tuple[float, float]]:
    return [(max(part.start_s, 0.0), min(part.end_s, duration_s)) for part in parts]
