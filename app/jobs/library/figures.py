"""What the rows keep of a finished analysis: its headline figures, and the description it was made with.

The headline figures serve search and lists; the result files remain the source of every figure.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy import Connection, select, update

from app.jobs.audit_log import record
from app.jobs.database.tables import analyses, recordings
from app.jobs.queries import format_diary, read_diary
from app.report.figures import load_results
from app.request import ReportRequest

DAY_STEPS = 60

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
    present = {"subject": row.subject, "side": row.side, "diary": read_diary(row.diary)}
    corrected = {name: getattr(asked, name) for name in FIELDS}
    if present == corrected:
        return
    every = connection.execute(select(analyses.c.request).where(analyses.c.recording_id == row.id)).scalars()
    requests = [ReportRequest.from_json(text) for text in every]
    known = {name: {getattr(request, name) for request in requests} for name in FIELDS}
    changed = {name: corrected[name] for name in FIELDS if corrected[name] != present[name] in known[name]}
    if "diary" in changed:
        changed["diary"] = format_diary(asked.diary)
    if changed:
        grown = {"version": recordings.c.version + 1, "revision": recordings.c.revision + 1}
        connection.execute(update(recordings).where(recordings.c.id == row.id).values(changed | grown))
        names = dict.fromkeys(changed, "adopted")
        record(connection, "recording.changed", row.id, analysis_id, other=names)


@dataclass(frozen=True, slots=True)
class HeadlineFigures:
    """The verdict and first figures of a report; ``start`` is the device's clock at the first sample.

    ``method`` and ``method_version`` made its angles, "" and 0 where they came ready. ``day`` is the day in
    short (:func:`summarise_day`), "" if it is not known. ``calibration_state``: of
    :data:`fusion.conventions.CalibrationState`, "" if there is none.
    """

    verdict: str
    start: str | None
    recorded_s: float | None
    above_60_percent: float | None
    method: str = ""
    method_version: int = 0
    day: str = ""
    calibration_state: str = ""


def read_headline(results: Path) -> HeadlineFigures | None:
    """Read the headline figures from ``results.json``; None where they are not there."""
    try:
        found = load_results(results.read_bytes())
        above = {row["threshold_deg"]: row["percent"] for row in found["exposure"]["time_above"]}
        method = found.get("method") or {"name": "", "version": 0}
        return HeadlineFigures(
            verdict=found["quality"]["verdict"],
            start=found.get("recording", {}).get("start"),
            recorded_s=found["time"]["recorded_s"],
            above_60_percent=above.get(60),
            method=method["name"],
            method_version=int(method["version"]),
            day=summarise_day(found["exposure"]["minutes"]["p50_deg"]),
            calibration_state=(found.get("calibration") or {}).get("state") or "",
        )
    except (OSError, ValueError, KeyError, TypeError):
        return None


def summarise_day(medians_deg: Sequence[float | None]) -> str:
    """Give the day in at most 60 steps of whole minutes: each the median of its minutes' medians.

    Whole degrees with commas between; nothing stands where no minute of a step was analysed.
    """
    width = max(1, math.ceil(len(medians_deg) / DAY_STEPS))
    steps = (medians_deg[first : first + width] for first in range(0, len(medians_deg), width))
    known = ([angle for angle in step if angle is not None] for step in steps)
    return ",".join(f"{statistics.median(step):.0f}" if step else "" for step in known)
