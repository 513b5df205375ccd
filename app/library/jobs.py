"""The rows of jobs: the single source of truth for requests, running analyses and their ends."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal

from sqlalchemy import (
    Connection,
    Engine,
    Executable,
    and_,
    case,
    func,
    insert,
    or_,
    select,
    tuple_,
    update,
)
from sqlalchemy.exc import OperationalError

from acromion.app.errors import Interrupted, NotHere, StaleVersion, StoreMismatch
from acromion.app.library.audit_log import Act, record
from acromion.app.library.batches import join_study, replace_cut, update_studies
from acromion.app.library.claims import (
    LABEL_PRIORITY,
    PAGE_PRIORITY,
    SCRIPT_PRIORITY,
    DatabaseClock,
    WayIn,
    cancel_job,
    change_state,
    enqueue,
    enqueue_all,
    find_next,
    replace_job,
    start_job,
)
from acromion.app.library.database.connect import READ_ONLY, lock_tables, open_database
from acromion.app.library.database.tables import analyses, answers, facts, recordings, result_files
from acromion.app.library.listing import HeadlineFigures, apply_description
from acromion.app.library.recordings import Description, check_not_purged, insert_recording
from acromion.app.library.rows import (
    PURGING,
    TRASHED,
    Job,
    JobState,
    Place,
    RowStore,
    format_now,
    read_job,
    select_items,
    select_jobs,
    select_page,
)
from acromion.app.library.side_files import increment_revision
from acromion.app.library.versions import (
    COUNTED,
    build_item,
    drop_drafts,
    drop_outdated_conclusion,
    find_source,
    identify_work,
    renumber,
    select_same,
)
from acromion.app.request import Conclusion, ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import ResultFile, StoredRecording
from acromion.fusion.errors import Fact

_BACK: Mapping[str, object] = {"token": None, "stage": None, "progress": 0.0}
MOST_SAME = 20
AWAITED = "header"
"""The fact of a refusal that identifies the table header whose columns must be named."""


@dataclass(frozen=True, slots=True)
class JobFilter:
    """A filter for jobs; "" matches any. ``shift``: of one shift, "" for the whole recording; None: any."""

    state: JobState | Literal[""] = ""
    batch_id: str = ""
    recording_id: str = ""
    shift: str | None = None


class JobStore(RowStore):
    """Rows of recordings and analyses in one database.

    Every change of state is one guarded UPDATE that names the allowed start states and, for a running job,
    the attempt's token. If two workers, or a worker and a person, act at once, one of them wins.
    """

    def __init__(self, settings: Settings) -> None:
        engine = open_database(settings.database_url)
        super().__init__(engine, engine.execution_options(**READ_ONLY))
        self._lease_s, self._most_interruptions = settings.lease_s, settings.max_interruptions

    def close(self) -> None:
        """Close every connection to the database."""
        self._engine.dispose()

    @property
    def engine(self) -> Engine:
        """The writing engine, for the other stores of the same database."""
        return self._engine

    @property
    def reader(self) -> Engine:
        """The read-only engine."""
        return self._reader

    def check_belongs(self, store_id: str) -> None:
        """Check that this database belongs to this folder or bucket; the first one is remembered.

        Raises StoreMismatch.
        """
        query = select(facts.c.value).where(facts.c.name == "store")
        with self._engine.begin() as connection:
            lock_tables(connection)
            known = connection.execute(query).scalar()
            if known is None:
                connection.execute(insert(facts).values(name="store", value=store_id))
        if known not in (None, store_id):
            raise StoreMismatch(found=store_id, needed=str(known))

    def add(
        self,
        stored: StoredRecording,
        request: ReportRequest,
        way_in: WayIn = "api",
        external_id: str = "",
        study: str = "",
    ) -> Job:
        """Store a recording and queue its analysis in one commit; the analysis joins the named study.

        Raises PurgedSince.
        """
        about = Description(
            request.file_name,
            request.subject,
            request.side,
            external_id,
            job_title=request.job_title,
            isco_code=request.isco_code,
        )
        with self._engine.begin() as connection:
            check_not_purged(connection, stored, about)
            insert_recording(connection, stored, about)
            analysis_id = enqueue(connection, (stored.id, stored.sha256), request, way_in)
            if study:
                join_study(connection, study, analysis_id)
        return self.get(analysis_id)

    def add_analysis(
        self,
        recording: tuple[str, str],
        request: ReportRequest,
        way_in: WayIn = "api",
        *,
        is_fresh: bool = False,
    ) -> Job:
        """Queue an analysis of a stored recording (its id and SHA-256); ``is_fresh``: read it again."""
        with self._engine.begin() as connection:
            analysis_id = enqueue(connection, recording, request, way_in, is_fresh=is_fresh)
        return self.get(analysis_id)

    def correct(self, job: Job, asked: ReportRequest) -> Job:
        """Queue a person's correction of the current version; repeating the same correction adds nothing.

        Raises StaleVersion if ``job`` is not the current version any more.
        """
        with self._engine.begin() as connection:
            newest = _find_newer(connection, job, drop_outdated_conclusion(connection, job, asked))
            if newest is not None:
                return newest
            analysis_id = _queue_again(connection, job, asked)
            if asked.conclusion != job.request.conclusion:
                act: Act = "report.concluded" if asked.conclusion else "conclusion.dismissed"
                record(connection, act, job.recording_id, analysis_id)
            if asked.conclusion is None and job.request.conclusion is not None:
                drop_drafts(connection, job)
        return self.get(analysis_id)

    def add_correction(self, job: Job, asked: ReportRequest, *, is_fresh: bool = False) -> Job:
        """Queue another analysis of a recording; it replaces the earlier one in every study."""
        with self._engine.begin() as connection:
            analysis_id = _queue_again(connection, job, asked, is_fresh=is_fresh)
        return self.get(analysis_id)

    def cut(self, job: Job, asked: Sequence[ReportRequest]) -> tuple[Job, ...]:
        """Queue an analysis for each shift that a person states; return them.

        They replace the analyses of all other shifts of the recording, or of the whole, also in its studies.
        An analysis that exists is kept.
        """
        kept = {request.shift for request in asked}
        with self._engine.begin() as connection:
            lock = select(recordings.c.id).where(recordings.c.id == job.recording_id).with_for_update()
            connection.execute(lock)
            ids: list[str] = []
            for request in asked:
                same = select_same([identify_work(job.sha256, request)])
                known = connection.execute(same.where(analyses.c.recording_id == job.recording_id)).first()
                items = [] if known else [build_item(connection, job, request)]
                ids += [known.id] if known else enqueue_all(connection, items, "web")
            others = select_jobs().where(analyses.c.recording_id == job.recording_id)
            others = others.where(analyses.c.shift.not_in(kept), analyses.c.replaced_by.is_(None))
            for other in map(read_job, connection.execute(others).all()):
                if other.request.reference is None:
                    cancel_job(connection, other.id)
                    is_finished = other.state is JobState.SUCCEEDED
                    replace_cut(connection, other.id, ids, is_finished=is_finished)
        return tuple(self.get(one) for one in ids)

    def conclude(self, job: Job, conclusion: Conclusion | None) -> Job:
        """Queue the next version of a report with a conclusion; None removes it and any draft.

        Raises StaleVersion as :meth:`correct`.
        """
        return self.correct(job, replace(job.request, conclusion=conclusion, reason=""))

    def dismiss_draft(self, analysis_id: str) -> None:
        """Delete the draft of a conclusion, so that no later analysis gets it; without one do nothing.

        Raises NotHere.
        """
        job = self.get(analysis_id)
        with self._engine.begin() as connection:
            if drop_drafts(connection, job):
                increment_revision(connection, job.recording_id)
                record(connection, "conclusion.dismissed", job.recording_id, job.id)

    def join_study(self, name: str, analysis_id: str) -> str:
        """Add an analysis to the study of this name; return the study's id."""
        with self._engine.begin() as connection:
            return join_study(connection, name, analysis_id)

    def find_same(self, sha256: str, request: ReportRequest) -> tuple[Job, ...]:
        """Return the analyses of the same bytes with the same settings and engine, oldest first."""
        query = select_same([identify_work(sha256, request)]).limit(MOST_SAME)
        return tuple(read_job(row) for row in self._read_all(query))

    def retry(self, analysis_id: str, way_in: WayIn = "api") -> Job:
        """Queue a failed or cancelled analysis again, once; any other stays unchanged.

        Raises NotHere.
        """
        job = self.get(analysis_id)
        if job.replaced_by is not None:
            return self.get(job.replaced_by)
        return self.repeat(job, way_in) if job.state in (JobState.FAILED, JobState.CANCELLED) else job

    def repeat(self, job: Job, way_in: WayIn) -> Job:
        """Queue an analysis again, once; the new one replaces it. A finished one is read again."""
        mine = analyses.c.id == job.id
        with self._engine.begin() as connection:
            repeated = select(analyses.c.replaced_by).where(mine).with_for_update()
            if connection.execute(repeated).scalar() is None:
                item = build_item(connection, job, job.request)
                is_fresh = job.state is JobState.SUCCEEDED
                (again,) = enqueue_all(connection, [item], way_in, job.batch_id, is_fresh=is_fresh)
                replace_job(connection, job.id, again)
        return self.get(str(self.get(job.id).replaced_by))

    def repeat_all(self, asked: Sequence[tuple[Job, ReportRequest]], *, is_fresh: bool = False) -> int:
        """Queue analyses of recordings again, each with its request, in one commit; return their number.

        A failed or cancelled analysis is replaced, also in its batch. A report stays until the new one is
        made. Every study contains the new analyses at once, or a report with another label once it is made.
        The jobs take turns with all other waiting jobs; a file dropped on the page goes first.
        ``is_fresh``: read every recording again.
        """
        with self._engine.begin() as connection:
            items = [build_item(connection, job, request) for job, request in asked]
            queued = enqueue_all(connection, items, "api", is_fresh=is_fresh)
            for (job, _), again in zip(asked, queued, strict=True):
                if job.state in (JobState.FAILED, JobState.CANCELLED):
                    replace_job(connection, job.id, again)
                _update_studies(connection, again)
        return len(asked)

    def withdraw(self, analysis_id: str) -> Job:
        """Replace a failed analysis by the previous report; return the analysis of that report.

        Raises NotHere if the analysis has not failed, or there is no earlier report.
        """
        job = self.get(analysis_id)
        reports = self.find_reports(job)
        if job.state is not JobState.FAILED or not reports:
            raise NotHere
        mine = (analyses.c.id == job.id, analyses.c.replaced_by.is_(None))
        with self._engine.begin() as connection:
            connection.execute(update(analyses).where(*mine).values(replaced_by=reports[0].id))
            increment_revision(connection, job.recording_id)
            again = {"again": reports[0].id}
            record(connection, "analysis.replaced", job.recording_id, job.id, other=again)
        return reports[0]

    def get(self, analysis_id: str) -> Job:
        """Return one job. Raises NotHere."""
        row = self._read_one(select_jobs().where(analyses.c.id == analysis_id))
        if row is None:
            raise NotHere
        return read_job(row)

    def find_trashed(self, analysis_id: str) -> str | None:
        """Return the recording id of an analysis in the trash; None for any other."""
        query = select(analyses.c.recording_id).join(recordings, analyses.c.recording_id == recordings.c.id)
        row = self._read_one(query.where(analyses.c.id == analysis_id, recordings.c.state == TRASHED))
        return None if row is None else str(row.recording_id)

    def find_newest(self, limit: int = 100) -> tuple[Job, ...]:
        """Return the most recently requested jobs, newest first."""
        return self.find_page(JobFilter(), limit)

    def find_page(self, wanted: JobFilter, limit: int = 100, after: Place | None = None) -> tuple[Job, ...]:
        """Return the newest jobs that match the filter, from ``after`` on."""
        query = select_jobs()
        for name, value in asdict(wanted).items():
            if name == "batch_id" and value:
                query = query.where(analyses.c.id.in_(select_items(value)))
            elif value or (name == "shift" and value is not None):
                query = query.where(analyses.c[name] == value)
        page = select_page(query, (analyses.c.created_at, analyses.c.id), limit, after)
        return tuple(read_job(row) for row in self._read_all(page))

    def find_reports(self, job: Job) -> tuple[Job, ...]:
        """Return the reports of the recording or shift of a job, newest first.

        Comparisons and replaced reports are left out.
        """
        same = JobFilter(JobState.SUCCEEDED, recording_id=job.recording_id, shift=job.request.shift)
        finished = self.find_page(same)
        return tuple(job for job in finished if job.replaced_by is None and job.request.reference is None)

    def count_states(self) -> dict[JobState, int]:
        """Count the jobs of each state."""
        query = select(analyses.c.state, func.count()).group_by(analyses.c.state)
        counts = {JobState(state): number for state, number in self._read_all(query)}
        return {state: counts.get(state, 0) for state in JobState}

    def count_problems(self) -> dict[str, int]:
        """Count the failed jobs by code."""
        failed = analyses.c.state == JobState.FAILED
        query = select(analyses.c.problem_code, func.count()).where(failed).group_by(analyses.c.problem_code)
        return {str(code): number for code, number in self._read_all(query)}

    def count_waiting(self) -> int:
        """Count the waiting jobs."""
        return int(self._read_value(select(func.count()).where(analyses.c.state == JobState.QUEUED)))

    def is_label_waiting(self) -> bool:
        """Return whether a job that needs no analysis waits; it only reads."""
        waits = (analyses.c.state == JobState.QUEUED, analyses.c.priority == LABEL_PRIORITY)
        return self._read_value(select(analyses.c.id).where(*waits).limit(1)) is not None

    def claim(self, *, is_label: bool | None = None) -> Job | None:
        """Claim the next job (:func:`acromion.app.library.claims.find_next`); None if no job waits."""
        with self._engine.begin() as connection:
            analysis_id = find_next(connection, is_label=is_label)
            if analysis_id is None:
                return None
            renumber(connection, analysis_id)
            start_job(connection, analysis_id, self._lease_s)
        return self.get(analysis_id)

    def renew(self, analysis_id: str, token: str, stage: str | None, progress: float) -> bool:
        """Renew the lease of an attempt and record its progress; return False if it has lost the job."""
        lease = {"lease_until_s": DatabaseClock() + self._lease_s, "is_lease_missed": 0}
        change = (
            update(analyses)
            .where(analyses.c.id == analysis_id, analyses.c.token == token)
            .where(analyses.c.state == JobState.RUNNING)
            .values(lease | {"stage": stage, "progress": progress})
        )
        return self._write(change) == 1

    def return_expired(self) -> tuple[tuple[str, str], ...]:
        """Put back jobs whose lease ran out twice in a row; return analysis and token of each attempt.

        The first time the lease is only extended: after a computer slept, the database was unreachable or a
        clock was changed, a running worker renews it before it runs out again. The end of a worker is no
        evidence against the file: it counts as an interruption (:meth:`interrupt`).
        """
        now_s, missed = DatabaseClock(), analyses.c.is_lease_missed
        # far in the future: the clock was set back
        is_out = or_(analyses.c.lease_until_s < now_s, analyses.c.lease_until_s > now_s + self._lease_s + 1.0)
        out = (analyses.c.state == JobState.RUNNING, is_out)
        is_last = and_(missed == 1, analyses.c.interruptions >= self._most_interruptions - 1)
        change = update(analyses).where(*out, ~is_last)
        change = change.values(
            state=case((missed == 1, JobState.QUEUED.value), else_=JobState.RUNNING.value),
            attempts=analyses.c.attempts - missed,
            interruptions=analyses.c.interruptions + missed,
            stage=case((missed == 1, None), else_=analyses.c.stage),
            progress=case((missed == 1, 0.0), else_=analyses.c.progress),
            lease_until_s=now_s + self._lease_s,
            is_lease_missed=1 - missed,
        )
        attempt = (analyses.c.id, analyses.c.token)
        with self._engine.begin() as connection:
            changed = connection.execute(change.returning(*attempt, analyses.c.state)).all()
            last = connection.execute(select(*attempt).where(*out, is_last)).all()
        for row in last:
            self.interrupt(row.id, row.token)
        back = [row for row in changed if row.state == JobState.QUEUED]
        return tuple((row.id, row.token) for row in (*back, *last))

    def finish(
        self,
        analysis_id: str,
        token: str,
        files: Iterable[ResultFile],
        headline: HeadlineFigures | None = None,
    ) -> bool:
        """Publish the attempt's files together; publish none if another attempt counts."""
        rows = [{"analysis_id": analysis_id, **asdict(file)} for file in files]
        with self._engine.begin() as connection:
            ended = {"progress": 1.0, "ended_at": format_now()}
            if not change_state(connection, analysis_id, JobState.SUCCEEDED, ended, token):
                return False
            connection.execute(insert(result_files), rows)
            apply_description(connection, analysis_id)
            _update_studies(connection, analysis_id, is_made=True)
            if headline is not None:
                connection.execute(insert(answers).values(analysis_id=analysis_id, **asdict(headline)))
        return True

    def is_published(self, analysis_id: str, token: str) -> bool:
        """Return whether this attempt's files are the report, after the reply to a commit was lost."""
        mine = (analyses.c.id == analysis_id, analyses.c.token == token)
        query = select(analyses.c.id).where(*mine, analyses.c.state == JobState.SUCCEEDED)
        return self._read_value(query) is not None

    def fail(self, analysis_id: str, token: str, code: str, facts: Mapping[str, Fact]) -> bool:
        """End the job with the reason."""
        with self._engine.begin() as connection:
            ended = _write_end(code, facts)
            return change_state(connection, analysis_id, JobState.FAILED, ended, token)

    def release(self, analysis_id: str, token: str, *, forgiven: bool = False) -> bool:
        """Put the job back into the queue; a ``forgiven`` attempt (an orderly stop) is not counted."""
        back = {**_BACK, "attempts": analyses.c.attempts - 1} if forgiven else _BACK
        with self._engine.begin() as connection:
            return change_state(connection, analysis_id, JobState.QUEUED, back, token)

    def measure(self, job: Job) -> bool:
        """Put a job back to be analysed: the figures for its report are missing or damaged."""
        usual = case((analyses.c.way_in == "web", PAGE_PRIORITY), else_=SCRIPT_PRIORITY)
        back = {**_BACK, "attempts": analyses.c.attempts - 1, "priority": usual}
        with self._engine.begin() as connection:
            return change_state(connection, job.id, JobState.QUEUED, back, job.token)

    def find_source(self, job: Job) -> Job | None:
        """Find the finished analysis with a job's figures (:mod:`acromion.app.library.versions`)."""
        with self._reader.connect() as connection:
            return find_source(connection, job)

    def interrupt(self, analysis_id: str, token: str) -> bool:
        """Put back a job whose worker or computer has stopped, without counting the attempt.

        After ``max_interruptions`` it fails, because the analysis itself may crash its computer.
        """
        mine = select(analyses.c.interruptions).where(analyses.c.id == analysis_id)
        counted = {"attempts": analyses.c.attempts - 1, "interruptions": analyses.c.interruptions + 1}
        with self._engine.begin() as connection:
            times = 1 + int(connection.execute(mine).scalar() or 0)
            if times < self._most_interruptions:
                return change_state(connection, analysis_id, JobState.QUEUED, {**_BACK, **counted}, token)
            ended = _write_end(Interrupted.code, {"times": times})
            return change_state(connection, analysis_id, JobState.FAILED, {**ended, **counted}, token)

    def record_delay(self, analysis_id: str, token: str, code: str, put_backs: int) -> None:
        """Record the cause of a delay, and how often it has put back the job."""
        facts = json.dumps({"tries": put_backs} if put_backs else {})
        mine = (analyses.c.id == analysis_id, analyses.c.token == token)
        delay = {"problem_code": code, "problem_facts": facts, "put_backs": put_backs}
        self._write(update(analyses).where(*mine, analyses.c.state == JobState.RUNNING).values(delay))

    def cancel(self, analysis_id: str) -> Job:
        """Cancel the job unless it is over; its worker notices that its attempt no longer counts.

        Raises NotHere.
        """
        with self._engine.begin() as connection:
            cancel_job(connection, analysis_id)
        return self.get(analysis_id)

    def find_file(self, analysis_id: str, name: str) -> ResultFile | None:
        """Return the published file of this name; None if there is none."""
        return next((file for file in self.find_files(analysis_id) if file.name == name), None)

    def find_files(self, analysis_id: str) -> tuple[ResultFile, ...]:
        """Return every published file, by name."""
        columns = (result_files.c.name, result_files.c.sha256, result_files.c.size_bytes)
        query = select(*columns).where(result_files.c.analysis_id == analysis_id)
        return tuple(ResultFile(*row) for row in self._read_all(query.order_by(result_files.c.name)))

    def find_sha256(self, recording_id: str) -> str:
        """Return the SHA-256 of a recording, or of a reference. Raises NotHere."""
        sha256 = self._read_value(select(recordings.c.sha256).where(recordings.c.id == recording_id))
        if sha256 is None:
            raise NotHere(id=recording_id)
        return str(sha256)

    def run(self, change: Executable) -> None:
        """Execute a change in a separate transaction."""
        self._write(change)

    def may_have_row(self, recording_id: str) -> bool:
        """Return whether a recording has a row; True if the database does not respond."""
        try:
            return self._read_one(select(recordings.c.id).where(recordings.c.id == recording_id)) is not None
        except OperationalError:
            return True

    def find_recordings(self) -> frozenset[str]:
        """Return the id of every stored recording."""
        return self._read_ids(select(recordings.c.id))

    def find_with_side(self) -> frozenset[str]:
        """Return the id of every recording whose side file was written."""
        written = (recordings.c.side_revision > 0, recordings.c.state != PURGING)
        return self._read_ids(select(recordings.c.id).where(*written))

    def read_revision(self, recording_id: str) -> int:
        """Return the revision of a recording's rows; 0 if it has none."""
        query = select(recordings.c.revision).where(recordings.c.id == recording_id)
        return int(self._read_value(query) or 0)

    def is_kept(self, recording_id: str) -> bool:
        """Return whether a recording is neither in the trash nor being purged."""
        gone = recordings.c.state.in_((TRASHED, PURGING))
        query = select(recordings.c.id).where(recordings.c.id == recording_id, ~gone)
        return self._read_one(query) is not None

    def mark_purging(self, recording_id: str) -> None:
        """Record that the purge of a recording has begun; the next start continues it."""
        mine = recordings.c.id == recording_id
        gone = update(recordings).where(mine).values(state=PURGING, revision=recordings.c.revision + 1)
        with self._engine.begin() as connection:
            connection.execute(gone)
            record(connection, "recording.purging", recording_id)

    def find_recording(self, analysis_id: str) -> str:
        """Return the recording of an analysis; "" if there is no such analysis."""
        query = select(analyses.c.recording_id).where(analyses.c.id == analysis_id)
        return str(self._read_value(query) or "")

    def find_analyses(self) -> frozenset[str]:
        """Return the id of every analysis."""
        return self._read_ids(select(analyses.c.id))

    def find_attempts(self) -> frozenset[tuple[str, str]]:
        """Return every attempt that is running or counts: (analysis, token)."""
        kept = (JobState.RUNNING, JobState.SUCCEEDED)
        query = select(analyses.c.id, analyses.c.token).where(analyses.c.state.in_(kept))
        return frozenset((row.id, row.token) for row in self._read_all(query))


def _find_newer(connection: Connection, job: Job, asked: ReportRequest) -> Job | None:
    """Find a later analysis with the same request; None if ``job`` is the current version.

    Locks the recording until the end of the transaction. Raises StaleVersion.
    """
    connection.execute(select(recordings.c.id).where(recordings.c.id == job.recording_id).with_for_update())
    place = (analyses.c.created_at, analyses.c.id)
    is_later = tuple_(*place) > tuple_(job.created_at.isoformat(timespec="microseconds"), job.id)
    counts = (analyses.c.state.in_(COUNTED), analyses.c.replaced_by.is_(None), is_later)
    same = (analyses.c.recording_id == job.recording_id, analyses.c.shift == job.request.shift)
    query = select_jobs().where(*same, *counts)
    newest_first = query.order_by(*(column.desc() for column in place))
    jobs = (read_job(row) for row in connection.execute(newest_first).all())
    newest = next((one for one in jobs if one.request.reference is None), None)
    if newest is None:
        return None
    key = select(analyses.c.key).where(analyses.c.id == newest.id)
    if connection.execute(key).scalar() == identify_work(job.sha256, asked):
        return newest
    if job.state is not JobState.SUCCEEDED or newest.request.version != job.request.version:
        raise StaleVersion(analysis=newest.id)
    return None


def _queue_again(connection: Connection, job: Job, asked: ReportRequest, *, is_fresh: bool = False) -> str:
    items = [build_item(connection, job, asked)]
    (analysis_id,) = enqueue_all(connection, items, "web", is_fresh=is_fresh)
    _update_studies(connection, analysis_id)
    return analysis_id


def _update_studies(connection: Connection, analysis_id: str, *, is_made: bool = False) -> None:
    """Update the studies of a recording: at once, or once a report with another label is made.

    Until then they contain the earlier report, if there is one.
    """
    row = connection.execute(select_jobs().where(analyses.c.id == analysis_id)).one_or_none()
    if row is None or (is_made and row.priority != LABEL_PRIORITY):
        return
    if row.priority == LABEL_PRIORITY:
        same = (analyses.c.recording_id == row.recording_id, analyses.c.shift == row.shift)
        others = select(analyses.c.id).where(*same)
        place = (analyses.c.created_at, analyses.c.id)
        is_later = tuple_(*place) > tuple_(row.created_at, analysis_id)  # and already in the studies
        is_kept = (
            analyses.c.state.in_(COUNTED) & is_later if is_made else analyses.c.state == JobState.SUCCEEDED
        )
        if connection.execute(others.where(is_kept).limit(1)).first() is not None:
            return
    update_studies(connection, analysis_id)


def _write_end(code: str, facts: Mapping[str, Fact]) -> dict[str, object]:
    return {
        "problem_code": code,
        "problem_facts": json.dumps(dict(facts)),
        "awaits": facts.get(AWAITED),
        "ended_at": format_now(),
    }
