"""The few figures by which finished analyses are found and listed; the files stay the truth."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Row, insert, select, update

from app.jobs.database.tables import analyses, answers, recordings
from app.request import ReportRequest
from fusion.diary import DiaryEntry

# What a correction says of its recording, whose arm it is and what the day held, once it has a report.
#
# Until then the recording stays as it was: a correction that fails takes nothing along into later analyses.


FIELDS = ("subject", "side", "diary")


def adopt_description(connection: Connection, analysis_id: str) -> None:
    """Let a recording say what an analysis that was asked for on the page has been made with.

    What no analysis was ever asked with has been said of the recording since, by somebody else, and stays.
    """
    about = (recordings.c.id, *(recordings.c[name] for name in FIELDS))
    query = select(analyses.c.request, analyses.c.way_in, *about).join(
        recordings, analyses.c.recording_id == recordings.c.id
    )
    row = connection.execute(query.where(analyses.c.id == analysis_id)).one()
    asked = ReportRequest.from_json(row.request)
    if row.way_in != "web" or asked.reference is not None:
        return
    changed = _list_changed(connection, row, asked)
    if changed:
        grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
        connection.execute(update(recordings).where(recordings.c.id == row.id).values(changed | grown))


def _list_changed(connection: Connection, row: Row[Any], asked: ReportRequest) -> dict[str, object]:
    """Give the columns that the recording is to take over."""
    said = {"subject": row.subject, "side": row.side, "diary": _read_diary(row.diary)}
    wished = {name: getattr(asked, name) for name in FIELDS}
    if said == wished:
        return {}
    query = select(analyses.c.request).where(analyses.c.recording_id == row.id)
    every = [ReportRequest.from_json(text) for text in connection.execute(query).scalars()]
    known = {name: {getattr(request, name) for request in every} for name in FIELDS}
    taken = {name: wished[name] for name in FIELDS if wished[name] != said[name] in known[name]}
    if "diary" in taken:
        taken["diary"] = json.dumps([asdict(entry) for entry in asked.diary])
    return taken


def _read_diary(text: str) -> tuple[DiaryEntry, ...]:
    return tuple(DiaryEntry(**entry) for entry in json.loads(text))


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
