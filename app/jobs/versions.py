"""Which version of a recording's report an analysis makes: other settings, or another engine, make the next.

The number stands in the request, so that the report itself can say it. What failed or was cancelled has no
version: its number goes to the next.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from sqlalchemy import Connection, Select, select

from app.jobs.job import JobState
from app.jobs.reading import select_jobs
from app.jobs.tables import analyses
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


@dataclass(slots=True)
class _History:
    """The reports of one recording: those of this engine by their settings, and the newest of all."""

    ours: dict[str, ReportRequest] = field(default_factory=dict)
    last: ReportRequest | None = None

    def add(self, request: ReportRequest, *, is_ours: bool) -> None:
        if request.reference is not None:
            return
        if is_ours:
            self.ours.setdefault(_write_settings(request), request)
        if self.last is None or request.version > self.last.version:
            self.last = request


def number_versions(connection: Connection, items: Sequence[Item]) -> list[ReportRequest]:
    """Give each request the version that its report will be, and what is different from the one before."""
    digests = {recording_id: sha256 for recording_id, sha256, _ in items}
    histories = {recording_id: _History() for recording_id in digests}
    for recording_id, key, request in _list_earlier(connection, set(digests)):
        is_ours = key == identify_work(digests[recording_id], request)
        histories[recording_id].add(request, is_ours=is_ours)
    numbered = []
    for recording_id, _, request in items:
        asked = request if request.reference else _number(histories[recording_id], request)
        histories[recording_id].add(asked, is_ours=True)
        numbered.append(asked)
    return numbered


def _list_earlier(connection: Connection, recordings: set[str]) -> Iterator[tuple[str, str, ReportRequest]]:
    """Give every report that is there or on its way: recording, key, request; the oldest first."""
    columns = (analyses.c.recording_id, analyses.c.key, analyses.c.request)
    ordered = sorted(recordings)
    for first in range(0, len(ordered), AT_ONCE):
        some = ordered[first : first + AT_ONCE]
        query = select(*columns).where(analyses.c.recording_id.in_(some), analyses.c.state.in_(_COUNTED))
        for row in connection.execute(query.order_by(analyses.c.created_at, analyses.c.id)):
            yield row.recording_id, row.key or "", ReportRequest.from_json(row.request)


def _number(history: _History, request: ReportRequest) -> ReportRequest:
    if history.last is None:
        return replace(request, version=1, changes=())
    old = history.ours.get(_write_settings(request))
    if old is not None:  # told in another language or on another paper at most: the same report
        reason = request.reason or old.reason
        return replace(request, version=old.version, changes=old.changes, reason=reason)
    last = history.last
    changes = compare_settings(last.name_settings(), request.name_settings())
    return replace(request, version=last.version + 1, changes=changes or ("engine",))


def _write_settings(request: ReportRequest) -> str:
    return json.dumps(request.name_settings(), sort_keys=True)
