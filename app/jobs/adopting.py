"""What a correction says of its recording, whose arm it is and what the day held, once it has a report.

Until then the recording stays as it was: a correction that fails takes nothing along into later analyses.
"""

import json
from dataclasses import asdict
from typing import Any

from sqlalchemy import Connection, Row, select, update

from app.jobs.tables import analyses, recordings
from app.request import ReportRequest
from fusion.diary import DiaryEntry

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
