"""Good, caution or poor, and why."""

from collections.abc import Iterable

from fusion.caveats import FEW_H, POOR_H, TIME_LOST, Caveat, Grade
from fusion.conventions import NPOSE_ERROR_DEG, is_npose
from fusion.exposure.types import LEAST_RANGED_S
from fusion.numerics.intervals import find_uncovered
from fusion.pose.calibrate import Calibration
from fusion.quality.time_account import count_beside_us
from fusion.quality.types import Quality, TimeAccount, Verdict
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Span, flag_spans

HOUR_S = 3600.0
VERDICTS: tuple[Verdict, ...] = ("good", "caution", "poor")
"""By :class:`fusion.caveats.Grade`."""
SIGNAL_REASONS = frozenset({"docked", "asleep", "clipped", "short-segment", "spikes", "stuck"})


def assess_quality(
    recording: Recording,
    calibration: Calibration | None,
    time: TimeAccount,
    exclusions: tuple[Span, ...],
    calibration_flags: tuple[QualityFlag, ...] = (),
) -> Quality:
    """Collect every caveat and return the verdict with the codes of all that count, the gravest first.

    Poor: less than 2 h or half of the recording analysed, no pose held still, a pose in a stretch that is not
    trusted, more than 30 deg from walking or known no better than 10 deg, a sensor that sat otherwise for
    half of the recording, sensor upside down. Caution: less than
    4 h, 1 % or more missing, 0.1 % or more clipped, any other doubt about the signal (the sensor may
    not have been worn). A note (a duplicate second, the N-pose) leaves the verdict good. Within a grade the
    caveat that cost the most time comes first.
    """
    given = (*recording.flags, *calibration_flags)
    told = {flag.code for flag in given}
    own = _find_own_flags(recording, calibration, time, exclusions)
    flags = [*given, *(flag for flag in own if flag.code not in told)]
    flags = sorted(flags, key=lambda flag: (-_grade(flag, time), -_find_lost_s(flag)))  # else as read
    worst = max((_grade(flag, time) for flag in flags), default=Grade.NOTE)
    reasons = dict.fromkeys(flag.code for flag in flags if _grade(flag, time) > Grade.NOTE)
    return Quality(VERDICTS[worst], tuple(reasons), tuple(flags))


def _grade(flag: QualityFlag, time: TimeAccount) -> Grade:
    """Return the grade that is declared for a caveat, or the next where it passes its limit."""
    caveat = Caveat(flag.code)
    is_graver = (
        flag.seconds * MICROSECONDS >= caveat.limit.from_share * time.recorded_us
        or flag.seconds < caveat.limit.below_s
    )
    return Grade(caveat.grade + is_graver)


def _find_lost_s(flag: QualityFlag) -> float:
    """Return the seconds that were not analysed because of a caveat; 0 where it cost none."""
    return flag.seconds if flag.code in TIME_LOST else 0.0


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
    """Return what the person left out, as opposed to what the signal or the device says."""
    return tuple(span for span in exclusions if span.reason not in SIGNAL_REASONS)


def find_holes(recording: Recording, left_out: tuple[Span, ...] = ()) -> list[Span]:
    """Return the stretches between segments that neither the device nor the diary accounts for."""
    if not recording.holds_samples:
        return []  # its segments hold no samples; the reader of angles tells its holes
    known = [(segment.start_us, segment.end_us) for segment in recording.segments]
    known += [(span.start_us, span.end_us) for span in (*recording.excluded, *left_out)]
    holes = find_uncovered(known, 0, recording.duration_us, 1)  # a microsecond is rounding
    return [Span(start_us, end_us - start_us, "missing") for start_us, end_us in holes]


def _flag_untrusted(
    recording: Recording, time: TimeAccount, holes: list[Span], exclusions: tuple[Span, ...]
) -> Iterable[QualityFlag]:
    """Flag time that was recorded but whose direction the fusion did not trust."""
    if not recording.holds_samples:
        return
    bridged_us = sum(
        (stop - first) * MICROSECONDS / segment.rate_hz
        for segment in recording.segments
        for first, stop in segment.bridged
        if not _is_within(segment.start_us + first * MICROSECONDS / segment.rate_hz, exclusions)
    )
    beside_us = count_beside_us(recording, exclusions)
    untrusted_us = time.missing_us - bridged_us - beside_us - sum(span.duration_us for span in holes)
    if untrusted_us >= MICROSECONDS:
        yield QualityFlag(Caveat.UNTRUSTED, seconds=untrusted_us / MICROSECONDS)


def _is_within(time_us: float, spans: tuple[Span, ...]) -> bool:
    return any(span.start_us <= time_us < span.end_us for span in spans)


def _flag_length(
    recording: Recording, time: TimeAccount, exclusions: tuple[Span, ...]
) -> Iterable[QualityFlag]:
    """Flag too little time; what the person left out was never meant to be analysed."""
    analysed_s = time.analysed_us / MICROSECONDS
    wanted_us = time.recorded_us - sum(span.duration_us for span in _find_diary_spans(exclusions))
    share_percent = 100.0 * time.analysed_us / max(wanted_us, 1)
    if 2 * time.analysed_us < wanted_us:
        yield QualityFlag(Caveat.LOWCOVER, seconds=analysed_s, facts={"percent": round(share_percent, 1)})
    if analysed_s < 60.0 and recording.holds_samples:
        yield QualityFlag(Caveat.SHORT, seconds=analysed_s)
    elif analysed_s < FEW_H * HOUR_S:
        facts = {"hours": POOR_H if analysed_s < POOR_H * HOUR_S else FEW_H}
        if analysed_s < LEAST_RANGED_S:
            facts["minutes"] = round(LEAST_RANGED_S / 60.0)
        yield QualityFlag(Caveat.FEW_HOURS, seconds=analysed_s, facts=facts)
