"""``results.json``: every figure of an analysis under the names outsiders rely on (CONTRACT §2)."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from app.report.figures import (
    BINS,
    CYCLES,
    ENTRIES,
    ENTRIES_PER_H,
    EPISODES,
    EVA_SUMMARY,
    HOUR_VARIATION,
    PERCENTILE,
    SHARE_ABOVE,
    SINGLE_GROUPS,
    TIME_ABOVE,
    VELOCITIES,
    VELOCITY,
    WINDOWS,
    Group,
)
from app.report.findings import Findings, MethodFacts, StillFacts
from app.report.words.numbers import Clock
from app.report.words.subject import ReportSubject
from fusion.caveats import Caveat
from fusion.conventions import CONVENTIONS, Convention
from fusion.exposure.types import (
    ElevationBin,
    Entries,
    Episodes,
    Eva,
    Exposure,
    Interval,
    PartExposure,
    PeakWindow,
)
from fusion.quality.types import TimeAccount
from fusion.recording import MICROSECONDS, QualityFlag

SCHEMA = "acromion.results/1"
POSE_ENDS = ("low_pose", "high_pose")
_DECIMALS = 6


def build_results(findings: Findings, subject: ReportSubject) -> dict[str, object]:
    """Describe an analysis in the order of the contract; NaN and infinity become None."""
    clock = Clock(findings.recording.start)
    results: dict[str, object] = {
        "schema": SCHEMA,
        "recording": _describe_recording(findings, subject),
        "time": _describe_time(findings.time),
        "calibration": _describe_calibration(findings),
        "method": _describe_method(findings.method),
        "exposure": _describe_exposure(findings.exposure, clock),
        "quality": {
            "verdict": findings.quality.verdict,
            "warnings": [_describe_warning(flag, clock) for flag in findings.quality.flags],
            "proposals": _propose_periods(findings.quality.flags),
        },
        "software": {
            "version": subject.software.version,
            "revision": subject.software.revision,
            "reader": _describe_reader(findings.recording.reader),
        },
        "conclusion": asdict(subject.conclusion) if subject.conclusion else None,
    }
    rounded: dict[str, object] = round_all(results)
    return rounded


def encode_results(findings: Findings, subject: ReportSubject) -> bytes:
    """Write :func:`build_results` as UTF-8 JSON: the same analysis gives the same bytes."""
    text = json.dumps(build_results(findings, subject), ensure_ascii=False, indent=2, allow_nan=False)
    return text.encode("utf-8") + b"\n"


def identify_report(findings: Findings, subject: ReportSubject) -> str:
    """Give the identity of a report: a hash of input, settings and engine version, 16 hexadecimal digits."""
    settings = findings.settings
    said: dict[str, object] = {
        "input": findings.recording.sha256,
        "method": settings.method,
        "pose": settings.pose,
        "calibration_windows_s": settings.calibration_windows_s,
        "diary": [asdict(entry) for entry in settings.diary],
        "estimator": _describe_method(findings.method),
        "side": subject.side,
        "subject": subject.subject,
        "version": subject.software.version,
    }
    if settings.arm_axis is not None or settings.slip_times_s:  # reports made without keep their identity
        said |= {"arm_axis": settings.arm_axis, "slip_times_s": settings.slip_times_s}
    if settings.no_slip_times_s or settings.pose_held:
        said |= {"no_slip_times_s": settings.no_slip_times_s, "pose_held": settings.pose_held}
    if findings.recording.reader:
        said["reader"] = findings.recording.reader
    if subject.columns:
        said["columns"] = json.loads(subject.columns)
    if subject.conclusion:
        said["conclusion"] = asdict(subject.conclusion)
    text = json.dumps(round_all(said), sort_keys=True)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()[:16]


def _describe_recording(findings: Findings, subject: ReportSubject) -> dict[str, object]:
    recording = findings.recording
    return {
        "sha256": recording.sha256,
        "file_name": subject.file_name,
        "device": recording.device,
        "serial_hash": recording.serial_hash,
        "start": recording.start.isoformat() if recording.start else None,
        "time_zone": recording.time_zone,
        "rate_hz": findings.recording.rate_hz,
        "side": subject.side,
        "subject": subject.subject,
        "columns": json.loads(subject.columns) if subject.columns else None,
    }


def _describe_reader(reader: tuple[str, str] | None) -> dict[str, str] | None:
    """Name the plug-in that read the file; none for a reader of our own."""
    return {"name": reader[0], "version": reader[1]} if reader else None


def _describe_time(time: TimeAccount) -> dict[str, object]:
    return {
        "recorded_s": time.recorded_us / MICROSECONDS,
        "analysed_s": time.analysed_us / MICROSECONDS,
        "missing_s": time.missing_us / MICROSECONDS,
        "excluded_s": time.excluded_us / MICROSECONDS,
        "parts": [
            {"account": part.account, "name": part.name, "duration_s": part.duration_us / MICROSECONDS}
            for part in time.parts
        ],
    }


def _describe_calibration(findings: Findings) -> dict[str, object] | None:
    calibration = findings.calibration
    if calibration is None:
        return None
    still, arm_axis = calibration.still, findings.settings.arm_axis
    return {
        "pose": None if arm_axis else calibration.pose,
        "state": calibration.state,
        "sigma_deg": calibration.sigma_deg,
        "start_s": still.start_s if still else None,
        "duration_s": still.duration_s if still else None,
        "score": still.score if still else None,
        "gyro_bias_dps": list(calibration.bias_dps),
        "second": _describe_still(calibration.second) if calibration.second else None,
        "repeats": [_describe_still(again) | {"apart_deg": again.apart_deg} for again in calibration.repeats],
        "repeat_deg": calibration.repeat_deg,
        "parts": [
            {
                "start_s": part.start_s,
                "end_s": part.end_s,
                "valid": part.is_valid,
                "pose_index": part.pose_index,
            }
            for part in calibration.parts
        ],
        "axis": arm_axis.removeprefix("+") if arm_axis else None,
        "slip_times_s": list(findings.settings.slip_times_s),
        "no_slip_times_s": list(findings.settings.no_slip_times_s),
        "walking_apart_deg": calibration.walking_deg,
        "proposals": [_describe_still(proposed) for proposed in calibration.proposals],
        "spread_deg": calibration.spread_deg,
        "questions": [asdict(question) for question in calibration.questions],
    }


def _describe_still(still: StillFacts) -> dict[str, object]:
    return {"start_s": still.start_s, "duration_s": still.duration_s}


def _describe_method(method: MethodFacts | None) -> dict[str, object] | None:
    if method is None:
        return None
    return {"name": method.name, "version": method.version, "parameters": dict(method.parameters)}


def _describe_exposure(exposure: Exposure, clock: Clock) -> dict[str, object]:
    return {
        "bins": [BINS.describe(part) | _describe_range(part.interval) for part in exposure.bins],
        "time_above": [
            TIME_ABOVE.describe(above) | _describe_range(above.interval) for above in exposure.time_above
        ],
        "percentiles_deg": {str(p): angle_deg for p, angle_deg in exposure.percentiles_deg.items()},
        "entries": [
            ENTRIES.describe(entries) | _describe_entries_pose(entries, exposure)
            for entries in exposure.entries
        ],
        "cycles": [CYCLES.describe(cycles) for cycles in exposure.cycles],
        "episodes": [_describe_episodes(episodes) for episodes in exposure.episodes],
        "velocity_dps": {kind: _describe(VELOCITY, exposure.velocity_dps.get(kind)) for kind in VELOCITIES},
        "peak": {
            "elevation_p99_deg": exposure.elevation_p99_deg,
            "windows": [_describe_window(window, clock) for window in exposure.peak_windows],
            "quarter_hours": [_describe_window(window, clock) for window in exposure.quarter_hours],
        },
        "eva": _describe_eva(exposure.eva),
        "by_hour": [_describe_part(part) for part in exposure.by_hour],
        "by_period": [_describe_period(part) for part in exposure.by_period],
        "by_task": [{"periods": part.periods, **_describe_period(part)} for part in exposure.by_task],
        "intervals": _describe_intervals(exposure.intervals),
        "intervals_pose": _describe_pose_intervals(exposure.intervals),
        **{group.key: _describe(group, getattr(exposure, group.key)) for group in SINGLE_GROUPS},
        "variation": {
            "by_hour": {
                figure: HOUR_VARIATION.describe(varied) for figure, varied in exposure.hour_variation.items()
            },
            "eva": _describe(EVA_SUMMARY, exposure.eva_summary),
        },
        "conventions": [
            _describe_convention(item, exposure.conventions[item.key])
            for item in CONVENTIONS
            if item.key in exposure.conventions
        ],
    }


def _describe(group: Group, record: object) -> dict[str, object] | None:
    """Describe a record that an exposure may lack."""
    return None if record is None else group.describe(record)


def _describe_range(interval: Interval | None) -> dict[str, object]:
    """Describe the range that a record holds itself, and the one with the error of the N-pose."""
    ends = ("low", "high", *POSE_ENDS)
    return {end: getattr(interval, end) if interval else None for end in ends}


def _describe_entries_pose(entries: Entries, exposure: Exposure) -> dict[str, object]:
    """Describe the range of the rate per hour with the error of the N-pose."""
    interval = exposure.intervals.get(ENTRIES_PER_H.spell({"threshold_deg": entries.threshold_deg}))
    return {end: getattr(interval, end) if interval else None for end in POSE_ENDS}


def _describe_intervals(intervals: Mapping[str, Interval]) -> dict[str, object]:
    return {name: [interval.low, interval.high] for name, interval in sorted(intervals.items())}


def _describe_pose_intervals(intervals: Mapping[str, Interval]) -> dict[str, object]:
    """Describe the ranges with the error of the N-pose; empty in any other pose."""
    posed = {name: interval.with_pose for name, interval in intervals.items()}
    return _describe_intervals({name: interval for name, interval in posed.items() if interval})


def _describe_episodes(episodes: Episodes) -> dict[str, object]:
    """Describe the stays above one threshold."""
    longer = [{"than_s": limit_s, "total_s": total_s} for limit_s, total_s in episodes.longer_s]
    return {**EPISODES.describe(episodes), "longer": longer}


def _describe_window(window: PeakWindow, clock: Clock) -> dict[str, object]:
    start = _format_iso(window.start_s, clock)
    return {"length_s": window.length_s, "start": start, **WINDOWS.describe(window)}


def _describe_convention(convention: Convention, classes: Sequence[ElevationBin]) -> dict[str, object]:
    """Describe the time in the classes of a standard or method."""
    return {
        "key": convention.key,
        "source": convention.source,
        "evidence": convention.evidence,
        "classes": [BINS.describe(part) | _describe_range(part.interval) for part in classes],
    }


def _describe_eva(eva: Eva) -> dict[str, object]:
    return {
        "angle_edges_deg": list(eva.angle_edges_deg),
        "duration_edges_s": list(eva.duration_edges_s),
        "percent": eva.percent.tolist(),
        "low": [[cell.low for cell in row] for row in eva.intervals] or None,
        "high": [[cell.high for cell in row] for row in eva.intervals] or None,
    }


def _describe_part(part: PartExposure) -> dict[str, object]:
    return {
        "label": part.label,
        "start_s": part.start_s,
        "end_s": part.end_s,
        "analysed_s": part.analysed_s,
        **{PERCENTILE.spell({"name": p}): angle_deg for p, angle_deg in part.percentiles_deg.items()},
        **{SHARE_ABOVE.spell({"threshold_deg": c}): share for c, share in part.percent_above.items()},
        ENTRIES_PER_H.spell({"threshold_deg": 60}): part.entries_above_60_per_h,
        "intervals": _describe_intervals(part.intervals),
        "intervals_pose": _describe_pose_intervals(part.intervals),
    }


def _describe_period(part: PartExposure) -> dict[str, object]:
    said = {"kind": part.kind, "recorded_s": part.recorded_s, "excluded_as": part.reason or None}
    return {**said, **_describe_part(part)}


def _describe_warning(flag: QualityFlag, clock: Clock) -> dict[str, object]:
    """``first`` and ``last``: ISO clock time; without a clock, ISO duration from the first sample."""
    return {
        "code": flag.code,
        "count": flag.count,
        "seconds": flag.seconds,
        "first": _format_place(flag.first_s, clock),
        "last": _format_place(flag.last_s, clock),
        "spans": [[_format_place(at, clock) for at in span] for span in flag.spans_s],
    }


def _propose_periods(flags: Sequence[QualityFlag]) -> list[dict[str, object]]:
    """Offer what may not have been worn as rows of a diary; nothing was left out for it."""
    return [
        {"kind": "not_worn", "start_s": start_s, "end_s": end_s}
        for flag in flags
        if flag.code == Caveat.NONWEAR
        for start_s, end_s in flag.spans_s
    ]


def _format_place(elapsed_s: float | None, clock: Clock) -> str | None:
    if elapsed_s is None or clock.start is not None:
        return _format_iso(elapsed_s, clock)
    return f"PT{round(elapsed_s, _DECIMALS):g}S"


def _format_iso(elapsed_s: float | None, clock: Clock) -> str | None:
    moment = None if elapsed_s is None else clock.at(elapsed_s)
    return moment.isoformat() if moment else None


def round_all(value: Any) -> Any:
    """Round every number as results.json has it; NaN and infinity become None."""
    if isinstance(value, dict):
        return {key: round_all(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [round_all(inner) for inner in value]
    if isinstance(value, float):
        return round(float(value), _DECIMALS) + 0.0 if math.isfinite(value) else None
    return value
