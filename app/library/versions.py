"""The version of a report: other settings or another engine create the next version.

The number is in the request, so that the report can state it. It is assigned when the analysis is queued, and
again when it starts, from the reports that exist then: a failed or cancelled analysis has no version.

A conclusion is valid only for the figures it was written for. An analysis with the same settings and engine
keeps it (:func:`drop_outdated_conclusion`); any other receives it as a draft, and passes it on until a person
confirms or dismisses it.
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from sqlalchemy import Connection, Select, select, update

from acromion.app.library.database.tables import analyses, answers, recordings
from acromion.app.library.rows import Job, JobState, read_job, select_jobs
from acromion.app.request import Conclusion, ConclusionDraft, ReportRequest, compare_settings
from acromion.app.version import identify_engine

KEYS_PER_QUERY = 500
COUNTED = (JobState.QUEUED, JobState.RUNNING, JobState.SUCCEEDED)

Item = tuple[str, str, ReportRequest]
"""A recording, its SHA-256 and the request."""


def identify_work(sha256: str, request: ReportRequest) -> str:
    """Return a hash of input, settings and engine: the same three give the same report in every version."""
    plain = replace(request, version=1, changes=(), reason="", draft=None)
    parts = (sha256, plain.to_json(), identify_engine())
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def select_same(keys: Sequence[str]) -> Select[Any]:
    """Select the analyses with these keys that are queued, running or done and not replaced, oldest first."""
    mine = (analyses.c.key.in_(keys), analyses.c.state.in_(COUNTED), analyses.c.replaced_by.is_(None))
    return select_jobs().where(*mine).order_by(analyses.c.created_at, analyses.c.id)


@dataclass(slots=True)
class _History:
    """The reports of one recording, or of one shift of it, in the order in which they were requested.

    ``ours``: this engine's reports by their settings; ``last``: the highest version; ``newest``: requested
    last; ``concluded``: the report of each conclusion, and whether it is this engine's. ``measured``: this
    engine's requests; ``is_capture``: the file is known to be a motion capture.
    """

    ours: dict[str, ReportRequest] = field(default_factory=dict)
    last: ReportRequest | None = None
    newest: ReportRequest | None = None
    concluded: dict[Conclusion, tuple[ReportRequest, bool]] = field(default_factory=dict)
    measured: list[ReportRequest] = field(default_factory=list)
    is_capture: bool = False

    def add(self, request: ReportRequest, *, is_ours: bool) -> None:
        if request.reference is not None:
            return
        if is_ours:
            self.ours.setdefault(_write_settings(request), request)
            self.measured.append(request)
        if self.last is None or request.version > self.last.version:
            self.last = request
        if request.conclusion is not None:
            self.concluded[request.conclusion] = request, is_ours
        self.newest = request

    def has_figures(self, request: ReportRequest) -> bool:
        """Return whether another request has, or will have, the figures of this one."""
        wanted = request.describe_figures(is_capture=self.is_capture)
        every = (one.describe_figures(is_capture=self.is_capture) for one in self.measured)
        return request.reference is None and wanted in every


def number_versions(connection: Connection, items: Sequence[Item]) -> list[tuple[ReportRequest, bool]]:
    """Return the requests with their versions and drafts, and whether each only has another label.

    Each states the version of its report, the differences from the previous version, and a draft of the
    conclusion that is no longer valid. Only the label differs if another analysis has the figures.
    """
    digests = {recording_id: sha256 for recording_id, sha256, _ in items}
    histories = _read_histories(connection, digests, COUNTED)
    numbered = []
    for recording_id, _, request in items:
        history = histories[recording_id, request.shift]
        asked = request
        if not request.reference:
            asked = _number(history, request)
            asked = replace(asked, draft=_find_draft(history, asked))
        numbered.append((asked, history.has_figures(asked)))
        history.add(asked, is_ours=True)
    return numbered


def find_source(connection: Connection, job: Job) -> Job | None:
    """Find the newest finished analysis of this engine that has the figures of a job."""
    query = select_jobs().join(answers, answers.c.analysis_id == analyses.c.id)
    query = query.add_columns(analyses.c.key, answers.c.method)
    mine = (analyses.c.recording_id == job.recording_id, analyses.c.state == JobState.SUCCEEDED)
    newest_first = (analyses.c.created_at.desc(), analyses.c.id.desc())
    for row in connection.execute(query.where(*mine).order_by(*newest_first)):
        one, is_capture = read_job(row), not row.method
        if one.replaced_by is None and one.request.reference is None:
            is_ours = row.key == identify_work(one.sha256, one.request)
            wanted, found = (each.request.describe_figures(is_capture=is_capture) for each in (job, one))
            if is_ours and wanted == found:
                return one
    return None


def renumber(connection: Connection, analysis_id: str) -> None:
    """Number a starting analysis by the existing reports, because earlier queued ones may have failed."""
    query = select(recordings.c.id, recordings.c.sha256, analyses.c.request).join(
        recordings, analyses.c.recording_id == recordings.c.id
    )
    row = connection.execute(query.where(analyses.c.id == analysis_id)).one()
    asked = ReportRequest.from_json(row.request)
    histories = _read_histories(connection, {row.id: row.sha256}, (JobState.SUCCEEDED,))
    history = histories[row.id, asked.shift]
    numbered = asked if asked.reference else _number(history, asked)
    if numbered.draft is not None:
        numbered = replace(numbered, draft=_compare_draft(history, numbered.draft, numbered))
    if numbered != asked:
        change = update(analyses).where(analyses.c.id == analysis_id)
        connection.execute(change.values(request=numbered.to_json()))


def _read_histories(
    connection: Connection, digests: Mapping[str, str], states: Sequence[JobState]
) -> dict[tuple[str, str], _History]:
    """Return the reports of some recordings and their shifts, in the order in which they were requested."""
    histories: dict[tuple[str, str], _History] = defaultdict(_History)
    columns = (analyses.c.recording_id, analyses.c.key, analyses.c.request, answers.c.method)
    joined = select(*columns).outerjoin(answers, answers.c.analysis_id == analyses.c.id)
    ordered = sorted(digests)
    for first in range(0, len(ordered), KEYS_PER_QUERY):
        some = ordered[first : first + KEYS_PER_QUERY]
        query = joined.where(analyses.c.recording_id.in_(some), analyses.c.state.in_(states))
        for row in connection.execute(query.order_by(analyses.c.created_at, analyses.c.id)):
            request = ReportRequest.from_json(row.request)
            is_ours = row.key == identify_work(digests[row.recording_id], request)
            histories[row.recording_id, request.shift].add(request, is_ours=is_ours)
            histories[row.recording_id, request.shift].is_capture |= row.method == ""
    return histories


def _number(history: _History, request: ReportRequest) -> ReportRequest:
    if history.last is None:
        return replace(request, version=1, changes=())
    old = history.ours.get(_write_settings(request))
    if old is not None:  # at most another language or paper: the same report
        reason = request.reason or old.reason
        return replace(request, version=old.version, changes=old.changes, reason=reason)
    last = history.last
    changes = compare_settings(last.describe_settings(), request.describe_settings())
    return replace(request, version=last.version + 1, changes=changes or ("engine",))


def _find_draft(history: _History, request: ReportRequest) -> ConclusionDraft | None:
    """Find the newest report's conclusion or draft that this request does not take over."""
    newest = history.newest
    if newest is None or request.conclusion is not None:
        return None
    if newest.conclusion is not None:
        return _compare_draft(history, ConclusionDraft(newest.conclusion, newest.version), request)
    return _compare_draft(history, newest.draft, request) if newest.draft is not None else None


def _compare_draft(history: _History, draft: ConclusionDraft, request: ReportRequest) -> ConclusionDraft:
    """Compare a request with the report of a draft, which may have been deleted."""
    origin, is_ours = history.concluded.get(draft.conclusion, (None, True))
    if origin is None:
        names = (*draft.changes, *request.changes)
        return replace(draft, changes=tuple(dict.fromkeys(name for name in names if name != "conclusion")))
    changes = compare_settings(origin.describe_settings(), request.describe_settings())
    changes = tuple(name for name in changes if name != "conclusion")
    if "diary" not in changes and origin.select_diary() != request.select_diary():
        changes += ("diary",)  # the subject code also selects its rows
    return replace(draft, version=origin.version, changes=changes if is_ours else (*changes, "engine"))


def drop_outdated_conclusion(connection: Connection, job: Job, asked: ReportRequest) -> ReportRequest:
    """Return the request; keep the conclusion from ``job`` only if the figures stay the same."""
    if asked.conclusion is None or asked.conclusion != job.request.conclusion:
        return asked
    key = connection.execute(select(analyses.c.key).where(analyses.c.id == job.id)).scalar()
    is_ours = key == identify_work(job.sha256, job.request)
    is_same = is_ours and asked.describe_settings() == job.request.describe_settings()
    return asked if is_same else replace(asked, conclusion=None)


def build_item(connection: Connection, job: Job, asked: ReportRequest) -> Item:
    """Return the item to queue for the recording of a job."""
    return job.recording_id, job.sha256, drop_outdated_conclusion(connection, job, asked)


def drop_drafts(connection: Connection, job: Job) -> bool:
    """Delete the draft of a conclusion from every analysis of a recording or shift; False without one."""
    same = (analyses.c.recording_id == job.recording_id, analyses.c.shift == job.request.shift)
    mine = select(analyses.c.id, analyses.c.request).where(*same)
    asked = {
        row.id: ReportRequest.from_json(row.request) for row in connection.execute(mine.with_for_update())
    }
    drafted = {analysis_id: request for analysis_id, request in asked.items() if request.draft is not None}
    for analysis_id, request in drafted.items():
        values = {"request": replace(request, draft=None).to_json()}
        connection.execute(update(analyses).where(analyses.c.id == analysis_id).values(values))
    return bool(drafted)


def _write_settings(request: ReportRequest) -> str:
    return json.dumps(request.describe_settings(), sort_keys=True)
