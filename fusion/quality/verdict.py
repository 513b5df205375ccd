"""Caveats that the analysis adds, and the verdict (good, caution or poor) with its reasons."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from acromion.fusion.caveats import FEW_H, TIME_LOST, Caveat, Grade
from acromion.fusion.checks.summary import number_directions
from acromion.fusion.conventions import NPOSE_ERROR_DEG, is_npose
from acromion.fusion.elevation import Elevation, group_rows
from acromion.fusion.exposure.types import LEAST_RANGED_S, Exposure
from acromion.fusion.pose.calibrate import TABLE_SWAY_DPS, CalibratedSamples, Calibration, StillPeriod
from acromion.fusion.pose.rules import RULES
from acromion.fusion.quality import Quality, TimeAccount, Verdict
from acromion.fusion.quality.time_account import count_partial_rows_us
from acromion.fusion.recording import (
    MICROSECONDS,
    Float64Array,
    QualityFlag,
    Recording,
    Span,
    find_uncovered,
    flag_spans,
    flag_stretches,
)
from acromion.fusion.runs import find_runs, list_touched_rows
from acromion.fusion.sensor.model import AccelerometerCorrection, GyroBias
from acromion.fusion.sensor.stillness import QuietTable
from acromion.fusion.settings import AnalysisSettings

HOUR_S = 3600.0
VERDICTS: tuple[Verdict, ...] = ("good", "caution", "poor")
"""By :class:`acromion.fusion.caveats.Grade`."""
SIGNAL_REASONS = frozenset({"docked", "asleep", "clipped", "short-segment", "spikes", "stuck"})


def assess_quality(
    recording: Recording,
    calibration: Calibration | None,
    time: TimeAccount,
    exclusions: tuple[Span, ...],
    calibration_flags: tuple[QualityFlag, ...] = (),
) -> Quality:
    """Collect every caveat and return the verdict with the codes that count, the most serious first.

    Poor: less than half of the recording analysed; no pose held still; a pose in a stretch that is not
    trusted, more than 30 deg from walking or with an uncertainty over 10 deg; a sensor with another
    orientation for half of the recording; a sensor upside down. Caution: 1 % or more missing, 0.1 % or more
    clipped, or any other doubt about the signal (such as a sensor that may not have been worn). A note (a
    duplicate second, the N-pose, few hours) leaves the verdict good: a short recording can be without fault.
    Within a grade the caveat that cost the most time comes first.
    """
    given = (*recording.flags, *calibration_flags)
    known_codes = {flag.code for flag in given}
    own = _find_own_flags(recording, calibration, time, exclusions)
    flags = [*given, *(flag for flag in own if flag.code not in known_codes)]
    # then by the time that a caveat cost; otherwise in the order found
    flags = sorted(flags, key=lambda flag: (-_grade(flag, time), -flag.seconds * (flag.code in TIME_LOST)))
    worst = max((_grade(flag, time) for flag in flags), default=Grade.NOTE)
    reasons = dict.fromkeys(flag.code for flag in flags if _grade(flag, time) > Grade.NOTE)
    return Quality(VERDICTS[worst], tuple(reasons), tuple(flags))


def _grade(flag: QualityFlag, time: TimeAccount) -> Grade:
    """Return the declared grade of a caveat, or the next one if it passes its limit."""
    caveat = Caveat(flag.code)
    is_graver = flag.seconds * MICROSECONDS >= caveat.limit.from_share * time.recorded_us
    return Grade(caveat.grade + is_graver)


def _find_own_flags(
    recording: Recording, calibration: Calibration | None, time: TimeAccount, exclusions: tuple[Span, ...]
) -> Iterable[QualityFlag]:
    holes = find_holes(recording, _find_diary_spans(exclusions))
    yield from flag_spans(Caveat.GAP, holes)
    yield from flag_spans(Caveat.CLIP, [span for span in exclusions if span.reason == "clipped"])
    yield from _flag_untrusted(recording, time, holes, exclusions)
    yield from _flag_length(recording, time, exclusions)
    if calibration is not None and is_npose(calibration.pose, calibration.state):
        yield QualityFlag(Caveat.NPOSE, facts={"reads_low_by_up_to_deg": NPOSE_ERROR_DEG})


def _find_diary_spans(exclusions: tuple[Span, ...]) -> tuple[Span, ...]:
    """Return the time that the person excluded, without exclusions by the signal or the device."""
    return tuple(span for span in exclusions if span.reason not in SIGNAL_REASONS)


def find_holes(recording: Recording, left_out: tuple[Span, ...] = ()) -> list[Span]:
    """Return the stretches between segments that neither the device nor the diary explains."""
    if not recording.holds_samples:
        return []  # its segments have no samples; the reader of angles reports its gaps
    known = [(segment.start_us, segment.end_us) for segment in recording.segments]
    known += [(span.start_us, span.end_us) for span in (*recording.excluded, *left_out)]
    holes = find_uncovered(known, 0, recording.duration_us, 1)  # a microsecond is rounding
    return [Span(start_us, end_us - start_us, "missing") for start_us, end_us in holes]


def _flag_untrusted(
    recording: Recording, time: TimeAccount, holes: list[Span], exclusions: tuple[Span, ...]
) -> Iterable[QualityFlag]:
    """Return the flag of time that was recorded but whose direction the fusion did not trust."""
    if not recording.holds_samples:
        return
    bridged_us = sum(
        (stop - first) * MICROSECONDS / segment.rate_hz
        for segment in recording.segments
        for first, stop in segment.bridged
        if not any(
            span.start_us <= segment.start_us + first * MICROSECONDS / segment.rate_hz < span.end_us
            for span in exclusions
        )
    )
    beside_us = count_partial_rows_us(recording, exclusions)
    untrusted_us = time.missing_us - bridged_us - beside_us - sum(span.duration_us for span in holes)
    if untrusted_us >= MICROSECONDS:
        yield QualityFlag(Caveat.UNTRUSTED, seconds=untrusted_us / MICROSECONDS)


def _flag_length(
    recording: Recording, time: TimeAccount, exclusions: tuple[Span, ...]
) -> Iterable[QualityFlag]:
    """Return the flags of too little time; time that the person excluded is not expected to be analysed."""
    analysed_s = time.analysed_us / MICROSECONDS
    wanted_us = time.recorded_us - sum(span.duration_us for span in _find_diary_spans(exclusions))
    share_percent = 100.0 * time.analysed_us / max(wanted_us, 1)
    if 2 * time.analysed_us < wanted_us:
        yield QualityFlag(Caveat.LOWCOVER, seconds=analysed_s, facts={"percent": round(share_percent, 1)})
    if analysed_s < 60.0 and recording.holds_samples:
        yield QualityFlag(Caveat.SHORT, seconds=analysed_s)
    elif analysed_s < FEW_H * HOUR_S:
        facts = {"hours": FEW_H}
        if analysed_s < LEAST_RANGED_S:
            facts["minutes"] = round(LEAST_RANGED_S / 60.0)
        yield QualityFlag(Caveat.FEW_HOURS, seconds=analysed_s, facts=facts)


# Caveats on the pose, the sensor, and the figures.

LARGEST_DRIFT_DPS = 1.0
"""Usual limit of the change of the gyroscope's offset between still moments."""

RAISED_DEG = 90.0
LEAST_ANALYSED_S = 3600.0


def flag_gyro_drift(bias: GyroBias) -> tuple[QualityFlag, ...]:
    """Return the flag of the axis with the largest drift, from one extreme to the other (W-GYRO-DRIFT).

    The fusion corrects the offset; the drift indicates a faulty sensor (or a change of temperature).
    """
    spread_dps = np.ptp(bias.bias_dps, axis=0)
    axis = int(np.argmax(spread_dps))
    if spread_dps[axis] < LARGEST_DRIFT_DPS:
        return ()
    places = (int(np.argmin(bias.bias_dps[:, axis])), int(np.argmax(bias.bias_dps[:, axis])))
    first_s, last_s = sorted(float(bias.time_s[place]) for place in places)
    facts = {"dps": round(float(spread_dps[axis]), 2)}
    return (QualityFlag(Caveat.GYRO_DRIFT, 1, last_s - first_s, first_s, last_s, facts),)


SAME_DEG, FEWEST_RESTS, LEAST_DRIFT_G = 10.0, 8, 0.015
"""The recordings of the project differ by up to 4 mg, simulated devices by up to 7; from 25 mg on time is
lost.
"""


def flag_accelerometer_drift(
    stills: QuietTable, accelerometer: AccelerometerCorrection
) -> tuple[QualityFlag, ...]:
    """Return the flag of an accelerometer whose reading at rest changes from start to end (W-ACC-DRIFT).

    Compares the first and the last quarter of the still moments of each direction. The constant offset and
    gain are removed first, because within a direction they would look like a change.
    """
    read_g = (stills.gravity_g - accelerometer.mean_offset_g) @ accelerometer.gain
    length_g = np.linalg.norm(read_g, axis=1)
    direction = number_directions(read_g / np.maximum(length_g, 1e-9)[:, None], SAME_DEG)
    found = (0.0, 0.0, 0.0)
    for rows in (np.flatnonzero(direction == number) for number in range(direction.max(initial=-1) + 1)):
        if len(rows) < FEWEST_RESTS:
            continue
        few = len(rows) // 4
        change_g = float(np.median(length_g[rows[-few:]]) - np.median(length_g[rows[:few]]))
        first_s, last_s = float(stills.start_s[rows[0]]), float(stills.start_s[rows[-1]])
        found = max(found, (abs(change_g), first_s, last_s))
    change_g, first_s, last_s = found
    if change_g < LEAST_DRIFT_G:
        return ()
    facts = {"mg": round(1000.0 * change_g)}
    return (QualityFlag(Caveat.ACC_DRIFT, 1, last_s - first_s, first_s, last_s, facts),)


def flag_published(bias: GyroBias, static_dps: Float64Array) -> tuple[QualityFlag, ...]:
    """Return the flag of `published`: its offset is constant, ``static_dps`` (3,) (W-PUBLISHED).

    Fact ``dps``: the largest difference between the offset tracked by `smoothed` and that one.
    """
    farthest_dps = float(np.linalg.norm(bias.bias_dps - static_dps, axis=1).max())
    return (QualityFlag(Caveat.PUBLISHED, facts={"dps": round(farthest_dps, 2)}),)


def flag_upside_down(exposure: Exposure) -> tuple[QualityFlag, ...]:
    """Return the flag of an arm above level for more than half of the time, in an hour or more (W-UPSIDE).

    No work causes this. Either the sensor was turned end to end after the pose, or the pose was not the
    stated one.
    """
    if exposure.analysed_s < LEAST_ANALYSED_S or exposure.percentiles_deg[50] <= RAISED_DEG:
        return ()
    facts = {"deg": round(exposure.percentiles_deg[50], 1)}
    return (QualityFlag(Caveat.UPSIDE, 1, exposure.analysed_s, facts=facts),)


def flag_untrusted(
    recording: Recording, elevation: Elevation, exclusions: Sequence[Span]
) -> tuple[QualityFlag, ...]:
    """Return the flag of stretches that count as missing although they have samples, with their times.

    ``elevation``: of the recording, segment by segment. Rows that bridge a gap of up to 50 ms belong to that
    gap, and excluded time is not missing. Less than a second in total is not flagged.
    """
    bridged = {
        segment.start_us: [group_rows(segment).hold(first, stop) for first, stop in segment.bridged]
        for segment in recording.segments
    }
    spans: list[Span] = []
    for segment in elevation.segments:
        doubted = ~segment.valid
        for rows in (*bridged.get(segment.start_us, ()), *list_touched_rows(segment, exclusions)):
            doubted[rows] = False
        times_us = segment.start_us + np.rint(find_runs(doubted) * (MICROSECONDS / segment.rate_hz))
        spans += [Span(int(a), int(b - a), "untrusted") for a, b in times_us]
    if sum(span.duration_us for span in spans) < MICROSECONDS:
        return ()
    return flag_spans(Caveat.UNTRUSTED, spans)


def flag_untrusted_pose(calibration: Calibration, elevation: Elevation) -> tuple[QualityFlag, ...]:
    """Return the flag of a calibration window that is at most half trusted (W-POSE-DOUBT)."""
    found = []
    for still in calibration.windows:
        valid = []
        for segment in elevation.segments:
            from_start = (
                MICROSECONDS * np.array([still.start_s, still.end_s]) - segment.start_us
            ) / segment.period_us
            first, stop = np.clip(np.rint(from_start), 0, len(segment)).astype(np.int64)
            valid.append(segment.valid[first:stop])
        rows = np.concatenate(valid)
        if len(rows) and 2.0 * float(rows.mean()) <= 1.0:
            found.append(_flag_window(Caveat.POSE_DOUBT, still))
    return tuple(found)


def flag_pose(samples: CalibratedSamples, settings: AnalysisSettings) -> tuple[QualityFlag, ...]:
    """Return the caveats of a calibration."""
    return (*_flag_state(samples.calibration, settings), *_flag_moves(samples))


def _flag_window(
    caveat: Caveat, still: StillPeriod, facts: Mapping[str, str | float] | None = None
) -> QualityFlag:
    return QualityFlag(caveat, 1, still.duration_s, still.start_s, still.end_s, dict(facts or {}))


def _flag_state(calibration: Calibration, settings: AnalysisSettings) -> Iterator[QualityFlag]:
    """Yield the flags of what is unknown about the pose."""
    state, facts = calibration.state, {"deg": round(calibration.sigma_deg, 1)}
    if state in {"axis", "none"}:
        yield QualityFlag(Caveat.AXIS if state == "axis" else Caveat.NO_STILL, facts=facts)
    spans_s = [(still.start_s, still.end_s) for still in calibration.proposals]
    if calibration.needs_pose:
        yield flag_stretches(Caveat.WHICH_POSE, spans_s, {"apart_deg": round(calibration.spread_deg)})
    elif state == "assumed":
        yield flag_stretches(Caveat.POSE_ASSUMED, spans_s)
    if state == "assumed" and calibration.pose == "side-lean":  # nobody stated that the trunk was leaning
        yield _flag_window(Caveat.LEAN, calibration.windows[0])
    if state in {"assumed", "none"} and settings.pose_held == "start":
        yield QualityFlag(Caveat.NOT_HELD)
    if state == "carried":
        yield QualityFlag(Caveat.CARRIED)
    for still in calibration.windows if state != "none" else ():
        if settings.calibration_windows_s and still.duration_s < RULES.length_s - 1e-6:
            yield _flag_window(Caveat.POSE_SHORT, still)
        if still.is_moving or still.sway_dps < TABLE_SWAY_DPS:
            yield _flag_window(
                Caveat.POSE_UNSTEADY, still, {"what": "moving" if still.is_moving else "table"}
            )


def _flag_moves(samples: CalibratedSamples) -> Iterator[QualityFlag]:
    """Yield the flags of possible slips, conflicting poses, and time excluded around a stated slip."""
    questions = (*samples.calibration.questions, *samples.calibration.differ)
    codes = {"slip": Caveat.SLIP, "put_back": Caveat.PUT_BACK, "poses": Caveat.POSES_DIFFER}
    for kind, code in codes.items():
        asked = [question for question in questions if question.kind == kind]
        apart_deg = round(max((question.apart_deg for question in asked), default=0.0))
        if asked:
            spans_s = [(question.first_s, question.end_s) for question in asked]
            yield flag_stretches(code, spans_s, {"apart_deg": apart_deg} if apart_deg else {})
    end_s = samples.recording.duration_us / MICROSECONDS
    left_out = [
        (max(part.start_s, 0.0), min(part.end_s, end_s))
        for part in samples.axis_parts
        if part.arm_axis is None
    ]
    if left_out:
        yield flag_stretches(Caveat.REMOUNT, left_out)
