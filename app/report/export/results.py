"""``results.json``: every figure of an analysis under the names outsiders rely on (CONTRACT §2)."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from app.report.findings import CalibrationFacts, Findings, MethodFacts, StillFacts
from app.report.words.numbers import Clock
from app.report.words.subject import ReportSubject
from fusion.caveats import Caveat
from fusion.conventions import CONVENTIONS, Convention
from fusion.exposure.types import (
    ElevationBin,
    Episodes,
    Eva,
    EvaSummary,
    Exposure,
    Frequency,
    HourVariation,
    Interval,
    PartExposure,
    Recovery,
    Velocity,
)
from fusion.quality.types import TimeAccount
from fusion.recording import MICROSECONDS, QualityFlag

# The figures of ``results.json`` beyond those of the first contract; names are only ever added.


def pick(record: object, *names: str) -> dict[str, object]:
    """Lay out the fields of a record that stand in the results under their own names, in this order."""
    return {name: getattr(record, name) for name in names}


def describe_episodes(episodes: Episodes) -> dict[str, object]:
    """Lay out the stays above one threshold."""
    names = ("threshold_deg", "count", "longest_s", "median_s", "per_hour", "total_s", "p90_s", "censored")
    longer = [{"than_s": limit_s, "total_s": total_s} for limit_s, total_s in episodes.longer_s]
    return {**pick(episodes, *names), "longer": longer}


def describe_extra(exposure: Exposure) -> dict[str, object]:
    """Lay out rest, frequency, variation (None where the exposure does not carry them) and conventions."""
    return {
        "recovery": _describe_recovery(exposure.recovery),
        "frequency": _describe_frequency(exposure.frequency),
        "variation": {
            "by_hour": _describe_variation(exposure.hour_variation),
            "eva": _describe_eva_summary(exposure.eva_summary),
        },
        "conventions": [
            _describe_convention(item, exposure.conventions[item.key])
            for item in CONVENTIONS
            if item.key in exposure.conventions
        ],
    }


def _describe_convention(convention: Convention, classes: Sequence[ElevationBin]) -> dict[str, object]:
    """Lay out the time in the classes of a standard or method."""
    return {
        "key": convention.key,
        "source": convention.source,
        "evidence": convention.evidence,
        "classes": [describe_bin(part) for part in classes],
    }


def describe_bin(part: ElevationBin) -> dict[str, object]:
    """Lay out the time between two angles."""
    return {
        "lower_deg": part.lower_deg,
        "upper_deg": part.upper_deg,
        "duration_s": part.duration_s,
        "percent": part.percent,
        **describe_interval(part.interval),
    }


def describe_interval(interval: Interval | None) -> dict[str, object]:
    """Lay out the range of a figure that has one of its own."""
    if interval is None:
        return {"low": None, "high": None}
    return {"low": interval.low, "high": interval.high}


def _describe_recovery(recovery: Recovery | None) -> dict[str, object] | None:
    if recovery is None:
        return None
    return {
        "neutral_slow_percent": recovery.neutral_slow_percent,
        "neutral_slow_per_h": recovery.neutral_slow_per_hour,
        "slow_percent": recovery.slow_percent,
        "slow_per_h": recovery.slow_per_hour,
        "longest_without_s": recovery.longest_without_s,
    }


def _describe_frequency(frequency: Frequency | None) -> dict[str, object] | None:
    if frequency is None:
        return None
    return {
        "inclination_velocity_mpf_hz": frequency.mean_power_hz,
        "inclination_velocity_zero_crossings_per_h": frequency.crossings_per_hour,
    }


def _describe_variation(figures: Mapping[str, HourVariation]) -> dict[str, object]:
    names = ("hours", "coefficient_percent", "spread", "last_less_first")
    return {figure: pick(item, *names) for figure, item in figures.items()}


def _describe_eva_summary(summary: EvaSummary | None) -> dict[str, object] | None:
    if summary is None:
        return None
    names = ("by_angle_percent", "by_duration_percent", "cell_sd_percent", "centroid_deg", "centroid_s")
    return pick(summary, *names)


SCHEMA = "acromion.results/1"
VELOCITIES = ("inclination", "generalised", "generalised_accelerometer", "gyroscope")
_SPEEDS = {"10": "p10_dps", "50": "p50_dps", "90": "p90_dps", "99": "p99_dps", "mean": "mean_dps"}
_DECIMALS = 6


def build_results(findings: Findings, subject: ReportSubject) -> dict[str, object]:
    """Lay the analysis out in the order of the contract; NaN and infinity become None."""
    clock = Clock(findings.recording.start)
    results: dict[str, object] = {
        "schema": SCHEMA,
        "recording": _describe_recording(findings, subject),
        "time": _describe_time(findings.time),
        "calibration": _describe_calibration(findings.calibration),
        "method": _describe_method(findings.method),
        "exposure": _describe_exposure(findings.exposure, clock),
        "quality": {
            "verdict": findings.quality.verdict,
            "warnings": [_describe_warning(flag, clock) for flag in findings.quality.flags],
            "proposals": _propose_periods(findings.quality.flags),
        },
        "software": {"version": subject.software.version, "revision": subject.software.revision},
    }
    rounded: dict[str, object] = round_all(results)
    return rounded


def encode_results(findings: Findings, subject: ReportSubject) -> bytes:
    """Write :func:`build_results` as UTF-8 JSON: the same analysis gives the same bytes."""
    text = json.dumps(build_results(findings, subject), ensure_ascii=False, indent=2, allow_nan=False)
    return text.encode("utf-8") + b"\n"


def identify_report(findings: Findings, subject: ReportSubject) -> str:
    """Name the report by a hash of input, settings and engine version: 16 hexadecimal digits."""
    settings = findings.settings
    said = {
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
    }


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


def _describe_calibration(calibration: CalibrationFacts | None) -> dict[str, object] | None:
    if calibration is None:
        return None
    still = calibration.still
    return {
        "pose": calibration.pose,
        "start_s": still.start_s,
        "duration_s": still.duration_s,
        "score": still.score,
        "gyro_bias_dps": list(still.gyro_bias_dps),
        "second": _describe_second(calibration.second),
    }


def _describe_second(still: StillFacts | None) -> dict[str, object] | None:
    return {"start_s": still.start_s, "duration_s": still.duration_s} if still else None


def _describe_method(method: MethodFacts | None) -> dict[str, object] | None:
    if method is None:
        return None
    return {"name": method.name, "version": method.version, "parameters": dict(method.parameters)}


def _describe_exposure(exposure: Exposure, clock: Clock) -> dict[str, object]:
    return {
        **_describe_distribution(exposure),
        **_describe_repetition(exposure),
        "velocity_dps": {kind: _describe_velocity(exposure.velocity_dps.get(kind)) for kind in VELOCITIES},
        "peak": _describe_peak(exposure, clock),
        "eva": _describe_eva(exposure.eva),
        "by_hour": [_describe_part(part) for part in exposure.by_hour],
        "by_period": [_describe_period(part) for part in exposure.by_period],
        "by_task": [{"periods": part.periods, **_describe_period(part)} for part in exposure.by_task],
        "intervals": _describe_intervals(exposure.intervals),
        **describe_extra(exposure),
    }


def _describe_distribution(exposure: Exposure) -> dict[str, object]:
    return {
        "bins": [describe_bin(b) for b in exposure.bins],
        "time_above": [
            {**pick(t, "threshold_deg", "duration_s", "percent"), **describe_interval(t.interval)}
            for t in exposure.time_above
        ],
        "percentiles_deg": {str(p): value for p, value in exposure.percentiles_deg.items()},
    }


def _describe_intervals(intervals: Mapping[str, Interval]) -> dict[str, object]:
    return {name: [interval.low, interval.high] for name, interval in sorted(intervals.items())}


def _describe_repetition(exposure: Exposure) -> dict[str, object]:
    return {
        "entries": [
            pick(e, "threshold_deg", "count", "per_hour", "busy_minutes_percent") for e in exposure.entries
        ],
        "cycles": [pick(c, "lower_deg", "upper_deg", "count") for c in exposure.cycles],
        "episodes": [describe_episodes(e) for e in exposure.episodes],
    }


def _describe_velocity(velocity: Velocity | None) -> dict[str, object] | None:
    if velocity is None:
        return None
    return {rank: getattr(velocity, field) for rank, field in _SPEEDS.items()}


def _describe_peak(exposure: Exposure, clock: Clock) -> dict[str, object]:
    return {
        "elevation_p99_deg": exposure.elevation_p99_deg,
        "windows": [
            {
                "length_s": window.length_s,
                "start": _tell_iso(window.start_s, clock),
                "start_s": window.start_s,
                "percent_above_60": window.percent_above_60,
            }
            for window in exposure.peak_windows
        ],
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
        **{f"elevation_p{p}_deg": value for p, value in part.percentiles_deg.items()},
        **{f"time_above_{c}_percent": value for c, value in part.percent_above.items()},
        "entries_above_60_per_h": part.entries_above_60_per_h,
        "intervals": _describe_intervals(part.intervals),
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
        "first": _tell_place(flag.first_s, clock),
        "last": _tell_place(flag.last_s, clock),
        "spans": [[_tell_place(at, clock) for at in span] for span in flag.spans_s],
    }


def _propose_periods(flags: Sequence[QualityFlag]) -> list[dict[str, object]]:
    """Offer what may not have been worn as rows of a diary; nothing was left out for it."""
    return [
        {"kind": "not_worn", "start_s": start_s, "end_s": end_s}
        for flag in flags
        if flag.code == Caveat.NONWEAR
        for start_s, end_s in flag.spans_s
    ]


def _tell_place(seconds: float | None, clock: Clock) -> str | None:
    if seconds is None or clock.start is not None:
        return _tell_iso(seconds, clock)
    return f"PT{round(seconds, _DECIMALS):g}S"


def _tell_iso(seconds: float | None, clock: Clock) -> str | None:
    moment = None if seconds is None else clock.at(seconds)
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
