"""A study as JSON and CSV: task by device over people, and person by task by device."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from app.report.agreement.export import describe_agreement, describe_limits, encode_validation
from app.report.export.csv import Row, encode_table
from app.report.figures import round_all
from app.report.words.subject import Software, clean_text
from fusion.source_paper import QUASI_STATIC, TABLE_1

if TYPE_CHECKING:
    from app.errors import StudyProblem
    from fusion.agreement import AgreementCell, AgreementEntry

SCHEMA = "acromion.study/1"
SPREADS = ("r", "rmse_deg", "mean_absolute_error_deg", "bias_deg")


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
            "schema": SCHEMA,
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
        "repeated_measures": describe_limits(cell.limits),
        "paper": find_paper_row(cell),
    }


def find_paper_row(cell: AgreementCell) -> dict[str, float | None] | None:
    """Give the paper's figures for this task and device, where it has them."""
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
        **describe_agreement(entry.agreement),
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
    for row in rows:
        row.pop("quasi_static")
    return encode_table(tuple(rows[0]), rows)
