"""``validation.json``: how far two measurements agree, under the names outsiders rely on (CONTRACT §2)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from app.report.export.csv import Row, encode_table
from app.report.figures import round_all
from app.report.words.subject import Software, clean_text

if TYPE_CHECKING:
    from fusion.agreement import Agreement, Alignment, Comparison, Limits, Side, Stratum, TaskAgreement


# ``validation.csv``: one row for each task, each class of elevation and speed, and for everything.


STATISTICS = (
    "r",
    "rmse_deg",
    "mean_absolute_error_deg",
    "bias_deg",
    "loa_low_deg",
    "loa_high_deg",
    "sd_deg",
    "icc",
    "concordance",
    "samples",
    "duration_s",
)
COLUMNS = ("subject", "device", "kind", "name", "lower", "upper", "paper_task", "repetitions", *STATISTICS)


def encode_agreement_table(validation: Mapping[str, Any]) -> bytes:
    """Write the statistics as CSV; empty is "not computable"."""
    return encode_table(COLUMNS, list_rows(validation))


def list_rows(validation: Mapping[str, Any]) -> Iterator[Row]:
    """Give the rows: ``kind`` is overall, task, elevation or speed; edges in deg or deg/s."""
    shared = {"subject": validation["subject"], "device": validation["recording"]["device"]}
    yield {**shared, "kind": "overall", "name": "overall", **_take(validation["overall"])}
    for task in validation["tasks"]:
        own = {key: task[key] for key in ("name", "paper_task", "repetitions")}
        yield {**shared, "kind": "task", **own, **_take(task)}
    for kind, key, unit in (("elevation", "by_elevation", "deg"), ("speed", "by_speed", "dps")):
        for stratum in validation[key]:
            edges = {edge: stratum[f"{edge}_{unit}"] for edge in ("lower", "upper")}
            yield {**shared, "kind": kind, "name": kind, **edges, **_take(stratum)}


def _take(statistics: Mapping[str, Any]) -> Row:
    return {name: statistics[name] for name in STATISTICS}


# Who and what was compared, and which software answers.


@dataclass(frozen=True, slots=True)
class ComparisonSubject:
    """All texts come from outside and are only ever text; ``method`` and ``pose`` are "" for ready angles."""

    file_name: str
    reference_name: str
    subject: str
    side: str | None
    method: str
    pose: str
    software: Software


SCHEMA = "acromion.validation/1"


def build_validation(comparison: Comparison, subject: ComparisonSubject) -> dict[str, Any]:
    """Lay the comparison out; NaN becomes None, numbers are rounded to six decimals."""
    built: dict[str, Any] = round_all(
        {
            "schema": SCHEMA,
            "alignment": _describe_alignment(comparison.alignment),
            "overall": describe_agreement(comparison.overall),
            "tasks": [_describe_task(task) for task in comparison.tasks],
            "by_elevation": [_describe_stratum(s, "deg") for s in comparison.by_elevation],
            "by_speed": [_describe_stratum(s, "dps") for s in comparison.by_speed],
            "exposure": [
                {"name": f.name, "ours": f.ours, "reference": f.reference, "difference": f.difference}
                for f in comparison.exposure
            ],
            "recording": _describe_side(comparison.ours, subject.file_name) | {"side": subject.side},
            "reference": _describe_side(comparison.reference, subject.reference_name)
            | {"axis": comparison.axis},
            "subject": clean_text(subject.subject),
            "method": subject.method,
            "pose": subject.pose,
            "rate_hz": comparison.pairs.rate_hz,
            "software": {"version": subject.software.version, "revision": subject.software.revision},
        }
    )
    return built


def encode_validation(validation: Mapping[str, Any]) -> bytes:
    """Write it as UTF-8 JSON: the same comparison gives the same bytes."""
    text = json.dumps(validation, ensure_ascii=False, indent=2, allow_nan=False)
    return text.encode("utf-8") + b"\n"


def describe_agreement(agreement: Agreement) -> dict[str, Any]:
    """Give every statistic of some rows."""
    return {
        "r": agreement.r,
        "rmse_deg": agreement.rmse_deg,
        "mean_absolute_error_deg": agreement.mean_absolute_error_deg,
        "bias_deg": agreement.bias_deg,
        "loa_low_deg": agreement.loa_low_deg,
        "loa_high_deg": agreement.loa_high_deg,
        "sd_deg": agreement.sd_deg,
        "icc": agreement.icc,
        "concordance": agreement.concordance,
        "quasi_static": agreement.is_quasi_static,
        "samples": agreement.count,
        "duration_s": agreement.duration_s,
    }


def describe_limits(limits: Limits) -> dict[str, Any]:
    """Give limits of agreement with repeated measures."""
    return {
        "bias_deg": limits.bias_deg,
        "loa_low_deg": limits.low_deg,
        "loa_high_deg": limits.high_deg,
        "between_sd_deg": limits.between_sd_deg,
        "within_sd_deg": limits.within_sd_deg,
    }


def _describe_alignment(alignment: Alignment) -> dict[str, Any]:
    return {
        "offset_s": alignment.offset_s,
        "drift_ppm": alignment.drift_ppm,
        "drift_margin_ppm": alignment.drift_margin_ppm,
        "r": alignment.r,
        "offset_given": alignment.is_offset_given,
        "drift_given": alignment.is_drift_given,
        "drift_fitted": alignment.is_drift_fitted,
        "windows": [{"start_s": w.start_s, "lag_s": w.lag_s, "r": w.r} for w in alignment.windows],
    }


def _describe_task(task: TaskAgreement) -> dict[str, Any]:
    return {
        "name": clean_text(task.name),
        **describe_agreement(task.agreement),
        "repetitions": task.repetitions,
        "paper_task": task.paper_task,
        "repeated_measures": describe_limits(task.limits),
    }


def _describe_stratum(stratum: Stratum, unit: str) -> dict[str, Any]:
    upper = stratum.upper if math.isfinite(stratum.upper) else None
    edges = {f"lower_{unit}": stratum.lower, f"upper_{unit}": upper, "percent": stratum.percent}
    return edges | describe_agreement(stratum.agreement)


def _describe_side(side: Side, file_name: str) -> dict[str, Any]:
    return {
        "file_name": clean_text(file_name),
        "sha256": side.sha256,
        "device": side.device,
        "duration_s": side.duration_s,
        "understood": {name: clean_text(value) for name, value in side.understood.items()},
    }
