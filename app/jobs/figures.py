"""What the rows keep of a finished analysis: its headline figures, and the description it was made with.

The headline figures serve search and lists; the result files remain the source of every figure.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from sqlalchemy import Connection, Row, insert, select, update

from app.jobs.database.tables import analyses, answers, recordings
from app.jobs.queries import format_diary, read_diary
from app.request import ReportRequest

FIELDS = ("subject", "side", "diary")
"""What a correction on the page may change in the description of a recording."""


def adopt_description(connection: Connection, analysis_id: str) -> None:
    """Copy the corrected subject, side and diary of a successful analysis into its recording.

    Only an analysis that was asked for on the page corrects its recording, and only once it has a report: a
    correction that fails does not reach later analyses. A present value that no analysis was ever asked with
    was entered by somebody else in the meantime, and stays.
    """
    about = (recordings.c.id, *(recordings.c[name] for name in FIELDS))
    query = select(analyses.c.request, analyses.c.way_in, *about).join(
        recordings, analyses.c.recording_id == recordings.c.id
    )
    row = connection.execute(query.where(analyses.c.id == analysis_id)).one()
    asked = ReportRequest.from_json(row.request)
    if row.way_in != "web" or asked.reference is not None:
        return
    changed = _find_changed(connection, row, asked)
    if changed:
        grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
        connection.execute(update(recordings).where(recordings.c.id == row.id).values(changed | grown))


def _find_changed(connection: Connection, row: Row[Any], asked: ReportRequest) -> dict[str, object]:
    """Give the columns that the recording is to take over."""
    present = {"subject": row.subject, "side": row.side, "diary": read_diary(row.diary)}
    corrected = {name: getattr(asked, name) for name in FIELDS}
    if present == corrected:
        return {}
    query = select(analyses.c.request).where(analyses.c.recording_id == row.id)
    every = [ReportRequest.from_json(text) for text in connection.execute(query).scalars()]
    known = {name: {getattr(request, name) for request in every} for name in FIELDS}
    changed = {name: corrected[name] for name in FIELDS if corrected[name] != present[name] in known[name]}
    if "diary" in changed:
        changed["diary"] = format_diary(asked.diary)
    return changed


@dataclass(frozen=True, slots=True)
class HeadlineFigures:
    """The verdict and first figures of a report; ``start`` is the device's clock at the first sample."""

    verdict: str
    start: str | None
    recorded_s: float | None
    above_60_percent: float | None


def read_headline(results: Path) -> HeadlineFigures | None:
    """Read the headline figures from ``results.json``; None where they are not there."""
    try:
        found: Mapping[str, Any] = json.loads(results.read_bytes())
        above = {row["threshold_deg"]: row["percent"] for row in found["exposure"]["time_above"]}
        start = found.get("recording", {}).get("start")
        return HeadlineFigures(found["quality"]["verdict"], start, found["time"]["recorded_s"], above.get(60))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def insert_headline(connection: Connection, analysis_id: str, headline: HeadlineFigures) -> None:
    """Write the row of a finished analysis."""
    connection.execute(insert(answers).values(analysis_id=analysis_id, **asdict(headline)))
