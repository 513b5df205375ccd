"""The few figures by which finished analyses are found and listed; the files stay the truth."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, insert

from app.jobs.tables import answers


@dataclass(frozen=True, slots=True)
class Answer:
    """Verdict, the device's clock at the first sample, and the first figure of a report."""

    verdict: str
    start: str | None
    recorded_s: float | None
    above_60_percent: float | None


def read_answer(results: Path) -> Answer | None:
    """Take the answer from ``results.json``; None where it does not hold one."""
    try:
        told: Mapping[str, Any] = json.loads(results.read_bytes())
        above = {row["threshold_deg"]: row["percent"] for row in told["exposure"]["time_above"]}
        start = told.get("recording", {}).get("start")
        return Answer(told["quality"]["verdict"], start, told["time"]["recorded_s"], above.get(60))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def insert_answer(connection: Connection, analysis_id: str, answer: Answer) -> None:
    """Write the row of a finished analysis."""
    row = {
        "analysis_id": analysis_id,
        "verdict": answer.verdict,
        "start": answer.start,
        "recorded_s": answer.recorded_s,
        "above_60_percent": answer.above_60_percent,
    }
    connection.execute(insert(answers).values(row))
