"""The worker: claims a job, runs it in a child process, publishes the result, claims the next."""

import argparse
import importlib
import logging
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

from sqlalchemy.exc import OperationalError

from acromion.app.analysis.attempt import (
    Attempt,
    Died,
    Finished,
    MakeReport,
    Outcome,
    Refused,
    Stopped,
    Unstarted,
    choose_limits,
    load_and_make_report,
    run_attempt,
    run_beside,
)
from acromion.app.analysis.fork_server import warm_up_and_wait
from acromion.app.errors import AppError, Crashed, DiskFull, NotHere, ResultDamaged, StoreAway, StoreDamaged
from acromion.app.library.database.connect import translate_database_errors, translate_start_errors
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import HeadlineFigures, read_headline
from acromion.app.library.mappings import MappingStore
from acromion.app.library.rows import Job
from acromion.app.logs import start_logging
from acromion.app.report.words.messages import describe_problem
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.decoded import DecodedCache
from acromion.app.store.folder import (
    TEMPORARY_S,
    KnownFiles,
    Storage,
    borrow_recording,
    borrow_result,
    check_folder,
    check_free,
    describe_files,
    format_result_name,
    load_extra,
    open_storage,
    translate_disk_full,
)
from acromion.app.store.permissions import restrict_new_files
from acromion.app.store.reserve import RESERVE_BYTES

IDLE_S = 0.25
LABEL_IDLE_S = 0.1
"""Pause between two looks for a new label, which a person awaits; a look only reads."""
STOP_S = 5.0
"""How long a worker that stops waits for the report that it is setting."""
RESULTS = "results.json"
RENEWAL_S = 1.0
TROUBLE_S = 2.0
LONGEST_PAUSE_S = 60.0
DEATH_GRACE_S = 1.0
"""A shutdown may kill the child first, so its death counts only if the worker survives this much longer."""

T = TypeVar("T")

logger = logging.getLogger(__name__)


class Lease:
    """The time for which a worker holds a claimed job without renewal.

    The worker's main loop renews it when it receives the progress of the child process; no thread does.
    A worker that hangs, was killed or has lost the database loses its job. Every write includes the token of
    the attempt, so that a worker that lost its job changes nothing.
    """

    def __init__(self, store: JobStore, analysis_id: str, token: str) -> None:
        self._store, self._claim = store, (analysis_id, token)
        self._progress: tuple[str | None, float] = (None, 0.0)
        self._renewed_s = time.monotonic()

    def renew(self, stage: str | None, fraction: float) -> bool:
        """Renew the lease on progress or after a second; return False if the job is lost.

        While the database is unreachable no other worker can take the job: the attempt continues, and its end
        is guarded.
        """
        now_s, progress = time.monotonic(), (stage, fraction)
        if progress == self._progress and now_s - self._renewed_s < RENEWAL_S:
            return True
        self._progress, self._renewed_s = progress, now_s
        try:
            return self._store.renew(*self._claim, *progress)
        except OperationalError:
            logger.warning("%s: not renewed, the database does not respond", self._claim[0])
            return True

    def keep_during(self, act: Callable[[], T], limit_s: float) -> T:
        """Renew the lease while a step reads or writes large files; return its result.

        A step over the limit waits for a disk or network that never responds: this process exits, and the
        next worker starts the job again.
        """
        end_s = time.monotonic() + limit_s

        def renew_until_limit() -> None:
            if time.monotonic() > end_s:
                logger.critical("the store has not responded for %.0f s; the worker exits", limit_s)
                os._exit(1)
            self.renew(*self._progress)

        return run_beside(act, renew_until_limit)


@dataclass(frozen=True, slots=True)
class WorkerContext:
    """Everything that a worker needs; ``make`` replaces the analysis in tests."""

    store: JobStore
    storage: Storage
    settings: Settings
    stopping: threading.Event
    cache: DecodedCache
    make: MakeReport | None = None


def open_worker_context(settings: Settings, make: MakeReport | None = None) -> WorkerContext:
    """Open database and store for one worker; ``make`` replaces the analysis.

    Raises ServerRefused, DatabaseAway, StoreAway, DiskFull.
    """
    with translate_start_errors(settings):
        storage = open_storage(settings)
        storage.prepare()
        check_folder(settings.data_dir)
        store = JobStore(settings)
        store.check_belongs(storage.identify())
    cache = DecodedCache(settings.data_dir / "cache", settings.max_cache_bytes)
    return WorkerContext(store, storage, settings, threading.Event(), cache, make)


def run_next(worker: WorkerContext, *, is_label: bool | None = None) -> bool:
    """Do one job, from claim to published report; return False if none waits.

    ``is_label``: see :func:`acromion.app.library.claims.find_next`.
    """
    return_expired(worker)
    job = worker.store.claim(is_label=is_label)
    if job is None or job.token is None:
        return False
    started_s, lease = time.monotonic(), Lease(worker.store, job.id, job.token)
    outcome = _attempt_or_delay(worker, job, job.token, lease)
    while True:
        try:
            _publish(worker, job, job.token, outcome, lease)
            break
        except (OperationalError, StoreAway):  # a finished analysis is worth the wait
            logger.exception("database or store does not respond; trying again")
            lease.renew(None, 0.0)
            if worker.stopping.wait(TROUBLE_S):
                raise
    seconds = time.monotonic() - started_s
    logger.info("%s attempt %d: %s in %.1f s", job.id, job.attempts, type(outcome).__name__.lower(), seconds)
    return True


def return_expired(worker: WorkerContext) -> None:
    """Put back jobs of dead workers, and remove their unfinished files."""
    for analysis_id, token in worker.store.return_expired():
        logger.warning("%s: its worker is gone", analysis_id)
        worker.storage.drop_attempt(analysis_id, token)


def run_worker(settings: Settings, make: MakeReport | None = None, parent_pid: int | None = None) -> None:
    """Run jobs until SIGTERM or SIGINT or, between two jobs, until the parent is gone."""
    worker = open_worker_context(settings, make)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: worker.stopping.set())
    warm_up_and_wait()
    with setting_reports(worker):
        while not worker.stopping.is_set() and (parent_pid is None or os.getppid() == parent_pid):
            if not run_next_patiently(worker, is_label=False):
                worker.stopping.wait(IDLE_S)
    worker.store.close()


@contextmanager
def setting_reports(worker: WorkerContext) -> Iterator[None]:
    """Set reports again in a thread, while analyses run in child processes: a new label never waits for them.

    A report is rendered in this process, which loads the libraries once. It reads our own results, and no
    bytes of a recording.
    """

    def work() -> None:
        while not worker.stopping.wait(LABEL_IDLE_S):
            try:
                while worker.store.is_label_waiting() and not worker.stopping.is_set():
                    if not run_next_patiently(worker, is_label=True):
                        break  # it awaits its figures, or another worker has it
            except Exception:  # as a process that ends would be: tried again, and the row counts
                logger.exception("no report was set again; trying again")
                worker.stopping.wait(TROUBLE_S)

    thread = threading.Thread(target=work, name="set-again", daemon=True)
    thread.start()
    try:
        yield
    finally:
        worker.stopping.set()
        thread.join(STOP_S)


def run_by_settings(settings: Settings, parent_pid: int | None = None) -> None:
    """Run the engine of the settings; Procrastinate is loaded only if it is chosen.

    Raises ServerRefused, DatabaseAway, StoreAway, DiskFull at the start, and DatabaseDamaged later.
    """
    with translate_database_errors(settings.database_url):
        if settings.engine == "embedded":
            run_worker(settings, parent_pid=parent_pid)
        else:
            cluster = load_extra("acromion.app.queue.cluster")
            cluster.run_cluster_worker(settings, parent_pid=parent_pid)


def run_next_patiently(worker: WorkerContext, *, is_label: bool | None = None) -> bool:
    """Do one job; wait if the database does not respond. The row remains authoritative meanwhile."""
    try:
        return run_next(worker, is_label=is_label)
    except OperationalError:
        logger.exception("the database does not respond; trying again")
        worker.stopping.wait(TROUBLE_S)
        return False


def _attempt_or_delay(worker: WorkerContext, job: Job, token: str, lease: Lease) -> Outcome:
    """Make the attempt; if store or disk fail, delay the job and put it back without counting."""
    try:
        outcome = _attempt(worker, job, token, lease)
    except StoreAway as trouble:
        return _delay(worker, job, lease, trouble.code, TROUBLE_S)
    except DiskFull:
        outcome = Refused(DiskFull.code, {})
    except StoreDamaged as damaged:
        logger.error("%s: the stored recording %s: %s", job.id, job.recording_id, damaged.code)
        return Refused(damaged.code, damaged.facts)
    if not isinstance(outcome, Refused) or outcome.code != DiskFull.code:
        return outcome
    worker.storage.drop_attempt(job.id, token)  # its files also fill the disk
    if job.put_backs >= worker.settings.max_put_backs:
        return Refused(DiskFull.code, {"tries": job.put_backs + 1})
    pause_s = min(TROUBLE_S * 2**job.put_backs, LONGEST_PAUSE_S)
    job = replace(job, put_backs=job.put_backs + 1)
    return _delay(worker, job, lease, DiskFull.code, pause_s)


def _delay(worker: WorkerContext, job: Job, lease: Lease, code: str, pause_s: float) -> Outcome:
    """Record the delay, and keep the job for a while: another worker on this disk would fail as well."""
    logger.warning("%s: delayed for %.0f s, then put back: %s", job.id, pause_s, code)
    with suppress(OperationalError):  # the database may be on the full disk
        worker.store.record_delay(job.id, str(job.token), code, job.put_backs)
    end_s = time.monotonic() + pause_s
    while time.monotonic() < end_s and _renew_unless_stopping(worker, lease, None, 0.0):
        worker.stopping.wait(IDLE_S)
    return Stopped()


def _attempt(worker: WorkerContext, job: Job, token: str, lease: Lease) -> Outcome:
    worker.storage.drop_temporary(TEMPORARY_S)  # a killed worker may have left copies from a bucket
    check_free(worker.storage.root, RESERVE_BYTES)  # the last of the disk is for reading and deleting
    out = worker.storage.open_attempt(job.id, token)
    limits = choose_limits(worker.settings, job.size_bytes)
    if job.is_label and worker.make is None:
        return _set_again(worker, job, out, lease) or _measure(worker, job)
    # The digest was just verified: the child need not compute it again.
    digests = () if job.request.joined else (job.sha256,)
    known = KnownFiles(digests, replace(worker.cache, recording_id=job.recording_id))
    make = worker.make or partial(load_and_make_report, known=known)
    with ExitStack() as stack:
        own = borrow_recording(worker.storage, job.recording_id, job.sha256)
        recording_path = lease.keep_during(partial(stack.enter_context, own), limits.wall_s)
        reference = _borrow_reference(worker, job)
        request = lease.keep_during(partial(stack.enter_context, reference), limits.wall_s)
        attempt = Attempt(recording_path, request, out, make, limits, gives_way=True)
        on_progress = partial(_renew_unless_stopping, worker, lease)
        outcome = run_attempt(attempt, on_progress)
        header = outcome.facts.get("header") if isinstance(outcome, Refused) else None
        if header is None or job.request.profile:
            return outcome
        # use the columns that were confirmed for this header
        asked = MappingStore(worker.store.engine, worker.store.reader).adopt(job.id, token, str(header))
        if asked is None:
            return outcome
        named = replace(asked, reference=request.reference)
        return run_attempt(replace(attempt, request=named), on_progress)


def _set_again(worker: WorkerContext, job: Job, out: Path, lease: Lease) -> Finished | None:
    """Make the report from the analysis that has its figures; None if there is none or it is damaged."""
    source = worker.store.find_source(job)
    files = {file.name: file for file in worker.store.find_files(source.id)} if source else {}
    if source is None or RESULTS not in files:
        return None
    products = importlib.import_module("acromion.app.report.products")
    limit_s = choose_limits(worker.settings, job.size_bytes).wall_s
    try:
        own_results = borrow_result(worker.storage, source.id, str(source.token), files[RESULTS])
        with own_results as results, translate_disk_full():
            make = partial(
                products.set_report_again,
                results,
                job.request,
                out,
                left_out=job.request.list_deferred(),
            )
            lease.keep_during(make, limit_s)
        made = describe_files(out)
        shared = [files[name] for name in products.MEASURED if name in files]
        for file in shared:
            kept = format_result_name(source.id, str(source.token), file.name)
            own = format_result_name(job.id, str(job.token), file.name)
            lease.keep_during(partial(worker.storage.share, kept, own), limit_s)
    except AppError as trouble:
        if isinstance(trouble, ResultDamaged):
            return None
        raise
    except Exception:  # a full analysis then makes the report, or states why it cannot
        logger.exception("%s: the report was not set again from %s", job.id, source.id)
        return None
    return Finished((*made, *shared))


def _measure(worker: WorkerContext, job: Job) -> Stopped:
    worker.store.measure(job)
    return Stopped()


def _renew_unless_stopping(worker: WorkerContext, lease: Lease, stage: str | None, fraction: float) -> bool:
    """Renew the lease; return False if the job was cancelled or taken, or this worker must stop."""
    return not worker.stopping.is_set() and lease.renew(stage, fraction)


@contextmanager
def _borrow_reference(worker: WorkerContext, job: Job) -> Iterator[ReportRequest]:
    """Yield the request with the file path of its reference, which the row identifies by id."""
    reference = job.request.reference
    if reference is None:
        yield job.request
        return
    try:
        sha256 = worker.store.find_sha256(reference.path)
    except NotHere as gone:  # deleted with its recording in the meantime
        raise StoreDamaged from gone
    with borrow_recording(worker.storage, reference.path, sha256) as path:
        yield replace(job.request, reference=replace(reference, path=str(path)))


def _publish(worker: WorkerContext, job: Job, token: str, outcome: Outcome, lease: Lease) -> None:
    kept = False
    if isinstance(outcome, Finished):
        limit_s = choose_limits(worker.settings, job.size_bytes).wall_s
        lease.keep_during(lambda: worker.storage.keep_attempt(job.id, token), limit_s)
        won = worker.store.finish(
            job.id, token, outcome.files, _read_headline(worker, job.id, token, outcome)
        )
        kept = won or worker.store.is_published(job.id, token)
    elif isinstance(outcome, Refused):
        worker.store.fail(job.id, token, outcome.code, outcome.facts)
    elif isinstance(outcome, Died) and not worker.stopping.wait(DEATH_GRACE_S):
        logger.warning("%s: the analysis died (exit code %s)", job.id, outcome.exit_code)
        if job.attempts < worker.settings.max_attempts:
            worker.store.release(job.id, token)
        else:
            crashed = Crashed(attempts=job.attempts)
            worker.store.fail(job.id, token, crashed.code, crashed.facts)
    elif isinstance(outcome, Unstarted) and not worker.stopping.wait(TROUBLE_S):
        worker.store.interrupt(job.id, token)
    else:
        worker.store.release(job.id, token, forgiven=True)
    if not kept:
        worker.storage.drop_attempt(job.id, token)


def _read_headline(
    worker: WorkerContext, analysis_id: str, token: str, made: Finished
) -> HeadlineFigures | None:
    """Return the headline figures of a finished attempt; a comparison with a reference has none."""
    file = next((file for file in made.files if file.name == RESULTS), None)
    if file is None:
        return None
    try:
        with borrow_result(worker.storage, analysis_id, token, file) as results:
            return read_headline(results)
    except ResultDamaged:  # every reader of the file gets this error
        return None


def main() -> None:
    """Run the worker (``python -m acromion.app.queue.worker``); other settings come from ``ACROMION_*``."""
    parser = argparse.ArgumentParser(description="Do queued analyses until stopped.")
    parser.add_argument("--data", type=Path, required=True, help="data folder of the server")
    parser.add_argument("--parent", type=int, help="end when this process is gone")
    arguments = parser.parse_args()
    restrict_new_files()
    start_logging()
    try:
        run_by_settings(Settings(data_dir=arguments.data), arguments.parent)
    except AppError as refusal:
        words = describe_problem(refusal.code, refusal.facts, "en")
        logger.error("%s %s %s %s", refusal.code, words.title, words.detail, words.fix)
        sys.exit(2)


if __name__ == "__main__":
    main()
