"""``results.json``: every figure of an analysis, and all other content of its report.

The keys are public (docs/reference/dictionary.md). Numbers keep every digit, so that a report rendered again
from the file is the same; tables and pages round them (:func:`acromion.app.report.figures.load_results`). A
person's reason for a correction is not included.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from datetime import datetime
from functools import cache
from itertools import starmap
from math import inf, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from acromion.app.report.figures import (
    BINS,
    CYCLES,
    ENTRIES,
    EPISODES,
    EVA_SUMMARY,
    HOUR_VARIATION,
    LESS_REST,
    PERCENTILES,
    PERIOD_FIGURES,
    SINGLE_GROUPS,
    TIME_ABOVE,
    VELOCITIES,
    VELOCITY,
    WINDOWS,
    Group,
    round_all,
)
from acromion.app.report.findings import Findings, FinishedAnalysis, ReportSubject, Software
from acromion.app.report.words.numbers import Clock
from acromion.app.request import Conclusion
from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import in_zone
from acromion.fusion.comparison.levels import ComparedLevel, combine_days
from acromion.fusion.conventions import CONVENTIONS
from acromion.fusion.exposure.types import ElevationBin, Exposure, Interval, PartExposure, TimeAbove
from acromion.fusion.quality import TimeAccount, TimePart
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Span
from acromion.fusion.settings import AnalysisSettings

if TYPE_CHECKING:
    from pydantic import TypeAdapter

SCHEMA = "acromion.results/1"
POSE_ENDS = ("low_pose", "high_pose")
_ENDS = ("low", "high", *POSE_ENDS)
_PLACE_DECIMALS = 6
_NUMBERS = re.compile(r"\[\n\s+([^\[\]{}\"]+?)\n\s+\]")
"""A list of numbers over several lines; JSON text contains no line break."""
_PERCENTILE = re.compile(r"elevation_p(\d+)_deg")
_SHARE = re.compile(r"time_above_(\d+)_percent")


def build_results(findings: Findings, subject: ReportSubject) -> dict[str, object]:
    """Return an analysis in the order of the dictionary; NaN and infinity become None."""
    recording, time, quality = findings.recording, findings.time, findings.quality
    clock, reader = Clock(recording.start), recording.reader
    results: dict[str, object] = {
        "schema": SCHEMA,
        "report": {"id": subject.report_id, "version": subject.version, "changes": subject.changes},
        "recording": {
            "sha256": recording.sha256,
            "file_name": subject.file_name,
            "device": recording.device,
            "serial_hash": recording.serial_hash,
            "start": recording.start.isoformat() if recording.start else None,
            "time_zone": recording.time_zone,
            "clock_offset_s": recording.clock_offset_s,
            "rate_hz": recording.rate_hz,
            "duration_s": recording.duration_us / MICROSECONDS,
            "shift": subject.shift or None,
            "side": subject.side,
            "subject": subject.subject,
            "job_title": subject.job_title,
            "isco_code": subject.isco_code,
            "columns": json.loads(subject.columns) if subject.columns else None,
        },
        "time": {
            **_describe_us(time),
            "parts": list(map(_describe_us, time.parts)),
            "exclusions": list(map(_describe_us, findings.exclusions)),
        },
        "calibration": asdict(findings.calibration) if findings.calibration else None,
        "method": asdict(findings.method) if findings.method else None,
        "exposure": _describe_exposure(findings.exposure, clock),
        "comparison": _describe_comparison(findings, subject),
        "quality": {
            "verdict": quality.verdict,
            "reasons": quality.reasons,
            "warnings": [_describe_warning(flag, clock) for flag in quality.flags],
            "proposals": [  # possible non-wear as diary rows; nothing was excluded for it
                {"kind": "not_worn", "start_s": start_s, "end_s": end_s}
                for flag in quality.flags
                if flag.code == Caveat.NONWEAR
                for start_s, end_s in flag.spans_s
            ],
        },
        "software": {
            **asdict(subject.software),
            "reader": {"name": reader[0], "version": reader[1]} if reader else None,  # a plug-in
        },
        "conclusion": asdict(subject.conclusion) if subject.conclusion else None,
    }
    finite: dict[str, object] = round_all(results, None)
    return finite


def encode_results(findings: Findings, subject: ReportSubject) -> bytes:
    """Encode :func:`build_results` as UTF-8 JSON, lists of numbers on one line; always the same bytes."""
    return _encode(build_results(findings, subject))


def relabel_results(content: bytes, subject: ReportSubject) -> bytes:
    """Return the output of :func:`encode_results` with the label of another subject.

    Every figure keeps its digits; the names of the file and of its columns stay.
    """
    results = json.loads(content)
    results["report"] = {"id": subject.report_id, "version": subject.version, "changes": subject.changes}
    named = ("side", "subject", "job_title", "isco_code")
    if "trunk" in {results["recording"]["side"], subject.side}:
        findings = decode_results(content).findings
        results["comparison"] = round_all(_describe_comparison(findings, subject), None)
    results["recording"] |= {name: getattr(subject, name) for name in named}
    results["conclusion"] = asdict(subject.conclusion) if subject.conclusion else None
    return _encode(results)


def _encode(results: Mapping[str, object]) -> bytes:
    text = json.dumps(results, ensure_ascii=False, indent=2, allow_nan=False)
    return _NUMBERS.sub(lambda found: f"[{' '.join(found[1].split())}]", text).encode("utf-8") + b"\n"


def identify_report(settings: AnalysisSettings, findings: Findings, subject: ReportSubject) -> str:
    """Return the id of a report: 16 hexadecimal digits of a hash of input, settings and version."""
    said: dict[str, object] = {
        "input": findings.recording.sha256,
        "method": settings.method,
        "pose": settings.pose,
        "calibration_windows_s": settings.calibration_windows_s,
        "diary": [asdict(entry) for entry in settings.diary],
        "estimator": asdict(findings.method) if findings.method else None,
        "side": subject.side,
        "subject": subject.subject,
        "version": subject.software.version,
    }
    if settings.arm_axis is not None or settings.slip_times_s:  # reports without these settings keep their id
        said |= {"arm_axis": settings.arm_axis, "slip_times_s": settings.slip_times_s}
    if settings.no_slip_times_s or settings.pose_held:
        said |= {"no_slip_times_s": settings.no_slip_times_s, "pose_held": settings.pose_held}
    if settings.time_zone or settings.clock_offset_s:
        said |= {"time_zone": settings.time_zone, "clock_offset_s": settings.clock_offset_s}
    if findings.recording.reader:
        said["reader"] = findings.recording.reader
    if subject.columns:
        said["columns"] = json.loads(subject.columns)
    if subject.shift:
        said["shift"] = subject.shift
    if subject.job_title or subject.isco_code:
        said |= {"job_title": subject.job_title, "isco_code": subject.isco_code}
    if subject.conclusion:
        said["conclusion"] = asdict(subject.conclusion)
    text = json.dumps(round_all(said), sort_keys=True)
    return hashlib.sha256(text.encode("utf-8")).hexdigest()[:16]


def _describe_us(record: TimeAccount | TimePart | Span) -> dict[str, object]:
    """Convert a record with its microseconds as seconds; :func:`_read_us` reverses it."""
    described: dict[str, object] = {}
    for name, value in asdict(record).items():
        is_us = name.endswith("_us")
        described[f"{name.removesuffix('_us')}_s" if is_us else name] = (
            value / MICROSECONDS if is_us and value is not None else value
        )
    return described


def _describe_exposure(exposure: Exposure, clock: Clock) -> dict[str, object]:
    windows, quarter_hours = (
        [
            {
                "length_s": window.length_s,
                "start": _format_iso(window.start_s, clock),
                **WINDOWS.describe(window),
            }
            for window in every
        ]
        for every in (exposure.peak_windows, exposure.quarter_hours)
    )
    entries = []
    for item in exposure.entries:
        described = ENTRIES.describe(item)
        interval = exposure.intervals.get(ENTRIES["per_hour"].spell(described))
        entries.append(described | {end: getattr(interval, end, None) for end in POSE_ENDS})
    eva = exposure.eva
    return {
        "analysed_s": exposure.analysed_s,
        "metric_filter_hz": exposure.metric_filter_hz,
        "angle_sigma_deg": exposure.angle_sigma_deg,
        "bins": [_describe_ranged(BINS, part) for part in exposure.bins],
        "time_above": [_describe_ranged(TIME_ABOVE, above) for above in exposure.time_above],
        "percentiles_deg": {str(p): angle_deg for p, angle_deg in exposure.percentiles_deg.items()},
        "entries": entries,
        "cycles": [CYCLES.describe(cycles) for cycles in exposure.cycles],
        "episodes": [
            {
                **EPISODES.describe(episodes),
                "longest_start_s": episodes.longest_start_s,
                "longer": [{"than_s": limit_s, "total_s": total_s} for limit_s, total_s in episodes.longer_s],
            }
            for episodes in exposure.episodes
        ],
        "velocity_dps": {kind: _describe(VELOCITY, exposure.velocity_dps.get(kind)) for kind in VELOCITIES},
        "peak": {
            "elevation_p99_deg": exposure.elevation_p99_deg,
            "windows": windows,
            "quarter_hours": quarter_hours,
        },
        "eva": {
            "angle_edges_deg": list(eva.angle_edges_deg),
            "duration_edges_s": list(eva.duration_edges_s),
            "percent": eva.percent.tolist(),
            **{end: [[getattr(c, end) for c in row] for row in eva.intervals] or None for end in _ENDS[:2]},
        },
        "by_hour": [_describe_part(part) for part in exposure.by_hour],
        "by_period": [_describe_period(part) for part in exposure.by_period],
        "by_task": [
            {
                "periods": part.periods,
                LESS_REST: part.time_above_60_less_rest_percent,
                **_describe_period(part),
            }
            for part in exposure.by_task
        ],
        "by_mark": [
            {"kind": part.kind, "at": _format_iso(part.end_s, clock), **_describe_part(part)}
            for part in exposure.by_mark
        ],
        "by_posture": [{"kind": part.kind, **_describe_part(part)} for part in exposure.by_posture],
        **_describe_intervals(exposure.intervals),
        **{group.key: _describe(group, getattr(exposure, group.key)) for group in SINGLE_GROUPS},
        "variation": {
            "by_hour": {name: HOUR_VARIATION.describe(one) for name, one in exposure.hour_variation.items()},
            "eva": _describe(EVA_SUMMARY, exposure.eva_summary),
        },
        "conventions": [
            {
                "key": item.key,
                "source": item.source,
                "evidence": item.evidence,
                "classes": [_describe_ranged(BINS, part) for part in exposure.conventions[item.key]],
            }
            for item in CONVENTIONS
            if item.key in exposure.conventions
        ],
        "minutes": {name: column.tolist() for name, column in asdict(exposure.minutes).items()},
        "histogram_s": exposure.histogram_s.tolist(),
        "figures": exposure.figures,
    }


def _describe_comparison(findings: Findings, subject: ReportSubject) -> dict[str, object]:
    """Describe the day beside the proposed levels of an arm, and other days of the same work."""
    if subject.side == "trunk":
        nothing = {"between": None, "combined": None}
        return {"extent": findings.extent, "levels": [], "other_days": nothing}
    above = findings.find_above_60()
    days = combine_days(above.percent, above.interval)
    is_short = findings.extent == "short"
    return {
        "extent": findings.extent,
        "levels": list(map(describe_level, findings.compare_with_levels())),
        "other_days": {
            name: None if each is None or is_short else [each.low, each.high]
            for name, each in (("between", days.between), ("combined", days.combined))
        },
    }


def describe_level(level: ComparedLevel) -> dict[str, object]:
    """Return a proposed level with its figure."""
    return {
        "key": level.reference.key,
        "at_most": level.reference.high,
        "measured": level.measured,
        **{end: getattr(level.interval, end, None) for end in _ENDS},
        "standing": level.standing,
        "reason": level.reason,
    }


def _describe(group: Group, record: object) -> dict[str, object] | None:
    return None if record is None else group.describe(record)


def _describe_ranged(group: Group, item: ElevationBin | TimeAbove) -> dict[str, object]:
    """Convert a record with the ends of its range, and of the one with the error of the N-pose."""
    return group.describe(item) | {end: getattr(item.interval, end, None) for end in _ENDS}


def _describe_intervals(intervals: Mapping[str, Interval]) -> dict[str, object]:
    """Return ranges by the names of figures, and those with the error of the N-pose, if there are any."""
    ranges = dict(sorted(intervals.items()))
    posed = {name: interval.with_pose for name, interval in ranges.items()}
    return {
        "intervals": {name: [one.low, one.high] for name, one in ranges.items()},
        "intervals_pose": {name: [one.low, one.high] for name, one in posed.items() if one},
    }


def _describe_part(part: PartExposure) -> dict[str, object]:
    percentile, above = PERCENTILES[""], TIME_ABOVE["percent"]
    return {
        "label": part.label,
        "start_s": part.start_s,
        "end_s": part.end_s,
        "analysed_s": part.analysed_s,
        **{percentile.spell({"name": p}): angle_deg for p, angle_deg in part.percentiles_deg.items()},
        **{above.spell({"threshold_deg": c}): share for c, share in part.time_above_percent.items()},
        ENTRIES["per_hour"].spell({"threshold_deg": 60}): part.entries_above_60_per_h,
        **_describe_intervals(part.intervals),
    }


def _describe_period(part: PartExposure) -> dict[str, object]:
    said = {"kind": part.kind, "recorded_s": part.recorded_s, "excluded_as": part.reason or None}
    own = {name: getattr(part, name) for name in PERIOD_FIGURES}
    return {**said, **own, **_describe_part(part)}


def _describe_warning(flag: QualityFlag, clock: Clock) -> dict[str, object]:
    """Convert a flag; ``first`` and ``last`` are ISO clock times or, without a clock, ISO durations."""

    def place(elapsed_s: float | None) -> str | None:
        if elapsed_s is None or clock.start is not None:
            return _format_iso(elapsed_s, clock)
        return f"PT{round(elapsed_s, _PLACE_DECIMALS):g}S"

    return {
        "code": flag.code,
        "count": flag.count,
        "seconds": flag.seconds,
        "first": place(flag.first_s),
        "last": place(flag.last_s),
        "spans": [list(map(place, span)) for span in flag.spans_s],
        "first_s": flag.first_s,
        "last_s": flag.last_s,
        "spans_s": flag.spans_s,
        "facts": flag.facts,
    }


def _format_iso(elapsed_s: float | None, clock: Clock) -> str | None:
    moment = None if elapsed_s is None else clock.at(elapsed_s)
    return moment.isoformat() if moment else None


# Decoding.


def decode_results(content: bytes) -> FinishedAnalysis:
    """Parse the output of :func:`encode_results`; the subject lacks the reason for a correction.

    Raises ValueError if it is another file or format.
    """
    try:
        results = json.loads(content)
        if results["schema"] != SCHEMA:
            raise ValueError(results["schema"])
        return FinishedAnalysis(
            _load_adapter().validate_python(_read_findings(results)), _read_subject(results)
        )
    except (KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"no {SCHEMA}: {error}") from error


def _read_findings(results: Mapping[str, Any]) -> dict[str, Any]:
    recording, time, reader = results["recording"], results["time"], results["software"]["reader"]
    start = datetime.fromisoformat(recording["start"]) if recording["start"] else None
    timed = {
        "start": in_zone(start, recording["time_zone"]),
        "duration_us": _count_us(recording["duration_s"]),
        "reader": (reader["name"], reader["version"]) if reader else None,
    }
    return {
        "recording": recording | timed,
        "calibration": _read_calibration(results["calibration"]),
        "method": results["method"],
        "exclusions": [_read_us(span) for span in time["exclusions"]],
        "time": _read_us(time) | {"parts": list(map(_read_us, time["parts"]))},
        "exposure": _read_exposure(results["exposure"]),
        "quality": results["quality"] | {"flags": results["quality"]["warnings"]},
    }


def _read_calibration(stored: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Return the calibration; a part without an end lasts until the end of the recording."""
    if stored is None:
        return None
    ends = ({"end_s": inf} if part["end_s"] is None else {} for part in stored["parts"])
    return {**stored, "parts": [part | end for part, end in zip(stored["parts"], ends, strict=True)]}


def _read_subject(results: Mapping[str, Any]) -> ReportSubject:
    report, recording, software = results["report"], results["recording"], results["software"]
    return ReportSubject(
        file_name=recording["file_name"],
        subject=recording["subject"],
        side=recording["side"],
        software=Software(software["version"], software["revision"]),
        version=report["version"],
        changes=tuple(report["changes"]),
        columns=json.dumps(recording["columns"]) if recording["columns"] else "",
        conclusion=Conclusion(**results["conclusion"]) if results["conclusion"] else None,
        report_id=report["id"],
        shift=recording.get("shift") or "",
        job_title=recording.get("job_title", ""),
        isco_code=recording.get("isco_code", ""),
    )


@cache
def _load_adapter() -> TypeAdapter[Findings]:
    """Load the library when a file is read, because most processes only write them."""
    from pydantic import TypeAdapter  # noqa: PLC0415

    return TypeAdapter(Findings)


def _count_us(seconds: float) -> int:
    return round(seconds * MICROSECONDS)


def _read_us(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Convert seconds back to the written integer microseconds."""
    seconds = {name: value for name, value in stored.items() if name.endswith("_s") and value is not None}
    return {
        **stored,
        **{
            f"{name.removesuffix('_s')}_us": _count_us(value)
            for name, value in seconds.items()
            if value is not None
        },
    }


def _read_exposure(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the records back to the form of :class:`acromion.fusion.exposure.types.Exposure`."""
    peak, eva, variation = stored["peak"], stored["eva"], stored["variation"]
    ranges = zip(eva["low"] or (), eva["high"] or (), strict=True)
    return {
        **stored,
        "bins": [_read_range(part) for part in stored["bins"]],
        "time_above": [_read_range(above) for above in stored["time_above"]],
        "percentiles_deg": {p: _read_number(value) for p, value in stored["percentiles_deg"].items()},
        "episodes": [
            stay | {"longer_s": [(part["than_s"], part["total_s"]) for part in stay["longer"]]}
            for stay in stored["episodes"]
        ],
        "velocity_dps": {
            kind: VELOCITY.read(speed) if speed else None for kind, speed in stored["velocity_dps"].items()
        },
        "elevation_p99_deg": _read_number(peak["elevation_p99_deg"]),
        "peak_windows": peak["windows"],
        "quarter_hours": peak["quarter_hours"],
        "eva": eva
        | {
            "percent": np.array(eva["percent"], float),
            "intervals": [list(starmap(Interval, zip(*row, strict=True))) for row in ranges],
        },
        **{key: list(map(_read_part, stored[key])) for key in ("by_hour", "by_period", "by_task")},
        **{key: list(map(_read_part, stored.get(key, ()))) for key in ("by_mark", "by_posture")},  # newer
        "intervals": _read_intervals(stored),
        **{
            group.key: group.read(stored[group.key]) if stored[group.key] else None for group in SINGLE_GROUPS
        },
        "hour_variation": variation["by_hour"],
        "eva_summary": variation["eva"],
        "conventions": {
            convention["key"]: [_read_range(part) for part in convention["classes"]]
            for convention in stored["conventions"]
        },
        "minutes": {name: np.array(column, float) for name, column in stored["minutes"].items()},
        "histogram_s": np.array(stored["histogram_s"], float),
    }


def _read_number(value: float | None) -> float:
    return nan if value is None else value


def _read_range(stored: Mapping[str, Any]) -> dict[str, Any]:
    return {**stored, "interval": None if stored["low"] is None else {end: stored[end] for end in _ENDS}}


def _read_intervals(stored: Mapping[str, Any]) -> dict[str, Interval]:
    posed = stored["intervals_pose"]
    return {name: Interval(*ends, *posed.get(name, ())) for name, ends in stored["intervals"].items()}


def _read_part(stored: Mapping[str, Any]) -> dict[str, Any]:
    percentiles_deg, time_above_percent = (
        {
            found[1]: _read_number(value)
            for name, value in stored.items()
            if (found := pattern.fullmatch(name))
        }
        for pattern in (_PERCENTILE, _SHARE)
    )
    return {
        **stored,
        "percentiles_deg": percentiles_deg,
        "time_above_percent": time_above_percent,
        "reason": stored.get("excluded_as") or "",
        "intervals": _read_intervals(stored),
    }
