"""A comparison and a study of several as JSON and CSV, under the names that programs rely on."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from app.report.export.csv import Row, encode_table
from app.report.figures import round_all
from app.report.words.subject import Software, clean_text
from fusion.comparison.change import QUASI_STATIC, TABLE_1

if TYPE_CHECKING:
    from app.errors import StudyProblem
    from fusion.comparison.agreement import (
        Agreement,
        AgreementCell,
        AgreementEntry,
        Comparison,
        Limits,
        Side,
        Stratum,
    )


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
    """Write ``validation.csv``: a row for each task and class of elevation and speed, and for everything.

    ``kind`` is overall, task, elevation or speed; edges are in deg or deg/s; empty is "not computable".
    """
    rows: list[Row] = [{"kind": "overall", "name": "overall", **validation["overall"]}]
    rows += [{"kind": "task", **task} for task in validation["tasks"]]
    for kind, key, unit in (("elevation", "by_elevation", "deg"), ("speed", "by_speed", "dps")):
        for stratum in validation[key]:
            edges = {edge: stratum[f"{edge}_{unit}"] for edge in ("lower", "upper")}
            rows.append({"kind": kind, "name": kind, **stratum, **edges})
    shared = {"subject": validation["subject"], "device": validation["recording"]["device"]}
    return encode_table(COLUMNS, (shared | row for row in rows))


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
STUDY_SCHEMA = "acromion.study/1"
SPREADS = ("r", "rmse_deg", "mean_absolute_error_deg", "bias_deg")


def build_validation(comparison: Comparison, subject: ComparisonSubject) -> dict[str, Any]:
    """Lay the comparison out; NaN becomes None, numbers are rounded to six decimals."""
    alignment = comparison.alignment
    built: dict[str, Any] = round_all(
        {
            "schema": SCHEMA,
            "alignment": {
                "offset_s": alignment.offset_s,
                "drift_ppm": alignment.drift_ppm,
                "drift_margin_ppm": alignment.drift_margin_ppm,
                "r": alignment.r,
                "offset_given": alignment.is_offset_given,
                "drift_given": alignment.is_drift_given,
                "drift_fitted": alignment.is_drift_fitted,
                "windows": [{"start_s": w.start_s, "lag_s": w.lag_s, "r": w.r} for w in alignment.windows],
            },
            "overall": _describe_agreement(comparison.overall),
            "tasks": [
                {
                    "name": clean_text(task.name),
                    **_describe_agreement(task.agreement),
                    "repetitions": task.repetitions,
                    "paper_task": task.paper_task,
                    "repeated_measures": _describe_limits(task.limits),
                }
                for task in comparison.tasks
            ],
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


def _describe_agreement(agreement: Agreement) -> dict[str, Any]:
    *shared, samples, duration_s = STATISTICS
    return {
        **{name: getattr(agreement, name) for name in shared},
        "quasi_static": agreement.is_quasi_static,
        samples: agreement.count,
        duration_s: agreement.duration_s,
    }


def _describe_limits(limits: Limits) -> dict[str, Any]:
    return {
        "bias_deg": limits.bias_deg,
        "loa_low_deg": limits.low_deg,
        "loa_high_deg": limits.high_deg,
        "between_sd_deg": limits.between_sd_deg,
        "within_sd_deg": limits.within_sd_deg,
    }


def _describe_stratum(stratum: Stratum, unit: str) -> dict[str, Any]:
    upper = stratum.upper if math.isfinite(stratum.upper) else None
    edges = {f"lower_{unit}": stratum.lower, f"upper_{unit}": upper, "percent": stratum.percent}
    return edges | _describe_agreement(stratum.agreement)


def _describe_side(side: Side, file_name: str) -> dict[str, Any]:
    return {
        "file_name": clean_text(file_name),
        "sha256": side.sha256,
        "device": side.device,
        "duration_s": side.duration_s,
        "understood": {name: clean_text(value) for name, value in side.understood.items()},
    }


# ------------------------------------------------------------------ a study


def build_study_json(
    entries: Sequence[AgreementEntry],
    cells: Sequence[AgreementCell],
    problems: Sequence[StudyProblem],
    method: str,
    software: Software,
) -> bytes:
    """Write every figure of the study; ``id`` is a hash of them all."""
    study: dict[str, Any] = round_all(
        {
            "schema": STUDY_SCHEMA,
            "method": method,
            "table": [_describe_cell(cell) for cell in cells],
            "comparisons": [_describe_entry(entry) for entry in entries],
            "problems": [
                {"file": clean_text(p.name), "code": p.code, "facts": dict(p.facts)} for p in problems
            ],
            "software": asdict(software),
        }
    )
    study["id"] = hashlib.sha256(json.dumps(study, sort_keys=True).encode()).hexdigest()[:16]
    return encode_validation(study)


def _describe_cell(cell: AgreementCell) -> dict[str, Any]:
    spreads = {name: asdict(getattr(cell, name)) for name in SPREADS}
    return {
        "task": clean_text(cell.task),
        "paper_task": cell.paper_task,
        "device": cell.device,
        "people": cell.people,
        **spreads,
        "repeated_measures": _describe_limits(cell.limits),
        "paper": find_paper_row(cell),
    }


def find_paper_row(cell: AgreementCell) -> dict[str, float | None] | None:
    """Return the paper's figures for this task and device, where it has them."""
    paper = TABLE_1.get(cell.device, {}).get(cell.paper_task or 0)
    if paper is None:
        return None
    r = None if cell.paper_task in QUASI_STATIC else paper.r
    return {"r": r, "rmse_deg": paper.rmse_deg, "mean_absolute_error_deg": paper.absolute_deg}


def _describe_entry(entry: AgreementEntry) -> dict[str, Any]:
    return {
        "person": clean_text(entry.person),
        "device": entry.device,
        "task": clean_text(entry.task),
        "paper_task": entry.paper_task,
        **_describe_agreement(entry.agreement),
    }


def encode_cells(cells: Sequence[AgreementCell]) -> bytes:
    """Write one row for each task and device: means, standard deviations, limits, the paper's figures."""
    names = ["task", "paper_task", "device", "people"]
    names += [f"{name}_{part}" for name in SPREADS for part in ("mean", "sd")]
    names += ["loa_low_deg", "loa_high_deg", "paper_r", "paper_rmse_deg", "paper_mean_absolute_error_deg"]
    return encode_table(names, [_make_row(cell) for cell in cells])


def _make_row(cell: AgreementCell) -> Row:
    described: dict[str, Any] = round_all(_describe_cell(cell))
    spreads = {f"{name}_{part}": described[name][part] for name in SPREADS for part in ("mean", "sd")}
    limits = {name: described["repeated_measures"][name] for name in ("loa_low_deg", "loa_high_deg")}
    paper = {f"paper_{name}": value for name, value in (described["paper"] or {}).items()}
    own = {name: described[name] for name in ("task", "paper_task", "device", "people")}
    return {**own, **spreads, **limits, **paper}


def encode_entries(entries: Sequence[AgreementEntry]) -> bytes:
    """Write one row for each person, task and device."""
    rows: list[Row] = [round_all(_describe_entry(entry)) for entry in entries]
    return encode_table([name for name in rows[0] if name != "quasi_static"], rows)
