"""Which version of a recording's report an analysis makes: other settings, or another engine, make the next.

The number stands in the request, so that the report itself can say it. It is given when the analysis is asked
for, and once more when it begins, by what has a report by then: what failed or was cancelled has no version.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

from sqlalchemy import Connection, Select, select, update

from app.jobs.job import JobState
from app.jobs.reading import select_jobs
from app.jobs.tables import analyses, recordings
from app.request import ReportRequest, compare_settings
from app.version import software_revision, software_version

AT_ONCE = 500
_COUNTED = (JobState.QUEUED, JobState.RUNNING, JobState.SUCCEEDED)

Item = tuple[str, str, ReportRequest]
"""A recording, its SHA-256 and what is asked."""


def identify_work(sha256: str, request: ReportRequest) -> str:
    """Hash input, settings and engine: the same three give the same report, whichever version it is."""
    plain = replace(request, version=1, changes=(), reason="")
    parts = (sha256, plain.to_json(), software_version(), software_revision())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def select_same(keys: Sequence[str]) -> Select[Any]:
    """Select the analyses with such keys that are there or on their way, the oldest first."""
    mine = (analyses.c.key.in_(keys), analyses.c.state.in_(_COUNTED))
    return select_jobs().where(*mine).order_by(analyses.c.created_at, analyses.c.id)


def number_versions(connection: Connection, items: Sequence[Item]) -> list[ReportRequest]:
    """Give each request the version that its report will be, and what is different from the one before."""
    earlier: dict[str, list[tuple[str, ReportRequest]]] = {}
    for recording_id, key, request in _list_earlier(connection, {item[0] for item in items}, _COUNTED):
        earlier.setdefault(recording_id, []).append((key, request))
    numbered = []
    for recording_id, sha256, request in items:
        known = earlier.setdefault(recording_id, [])
        asked = request if request.reference else _number(known, sha256, request)
        known.append((identify_work(sha256, asked), asked))
        numbered.append(asked)
    return numbered


def renumber(connection: Connection, analysis_id: str) -> None:
    """Number an analysis that begins by the reports that are there: those on their way may have failed."""
    query = select(recordings.c.id, recordings.c.sha256, analyses.c.request).join(
        recordings, analyses.c.recording_id == recordings.c.id
    )
    row = connection.execute(query.where(analyses.c.id == analysis_id)).one()
    asked = ReportRequest.from_json(row.request)
    there = [(key, old) for _, key, old in _list_earlier(connection, {row.id}, (JobState.SUCCEEDED,))]
    numbered = asked if asked.reference else _number(there, row.sha256, asked)
    if numbered != asked:
        change = update(analyses).where(analyses.c.id == analysis_id)
        connection.execute(change.values(request=numbered.to_json()))


def _list_earlier(
    connection: Connection, of: set[str], states: Sequence[JobState]
) -> Iterator[tuple[str, str, ReportRequest]]:
    """Give every analysis of some recordings in these states: recording, key, request; the oldest first."""
    columns = (analyses.c.recording_id, analyses.c.key, analyses.c.request)
    ordered = sorted(of)
    for first in range(0, len(ordered), AT_ONCE):
        some = ordered[first : first + AT_ONCE]
        query = select(*columns).where(analyses.c.recording_id.in_(some), analyses.c.state.in_(states))
        for row in connection.execute(query.order_by(analyses.c.created_at, analyses.c.id)):
            yield row.recording_id, row.key or "", ReportRequest.from_json(row.request)


def _number(known: Sequence[tuple[str, ReportRequest]], sha256: str, request: ReportRequest) -> ReportRequest:
    reports = [(key, old) for key, old in known if old.reference is None]
    if not reports:
        return replace(request, version=1, changes=())
    asked = request.name_settings()
    for old_key, old in reports:
        # Made by this engine, and told in another language or on another paper at most: the same report.
        if old_key == identify_work(sha256, old) and old.name_settings() == asked:
            reason = request.reason or old.reason
            return replace(request, version=old.version, changes=old.changes, reason=reason)
    _, last = max(reports, key=lambda report: report[1].version)
    changes = compare_settings(last.name_settings(), request.name_settings())
    return replace(request, version=last.version + 1, changes=changes or ("engine",))
