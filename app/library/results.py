"""Files of a finished analysis, checked against the digests in their rows at each use.

If they are damaged or missing, the analysis is made again.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from acromion.app.errors import NoSuchFile, NotFinished, ResultDamaged, StoreDamaged
from acromion.app.library.audit_log import touch
from acromion.app.library.claims import WayIn
from acromion.app.library.database.connect import lock_requests
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job, JobState
from acromion.app.request import ReportRequest
from acromion.app.store.folder import ResultFile, Storage, borrow_result, is_recording_whole, is_result_whole

_one_at_a_time = threading.Lock()


@dataclass(frozen=True, slots=True)
class ResultReader:
    """Reads published files by analysis and name."""

    store: JobStore
    storage: Storage

    def find(self, job: Job, name: str) -> ResultFile:
        """Return the row of a published file. Raises NotFinished, NoSuchFile."""
        check_succeeded(job, name)
        file = self.store.find_file(job.id, name)
        if file is None:
            raise NoSuchFile(name=name)
        touch(job.recording_id, job.id)
        return file

    @contextmanager
    def borrow(self, job: Job, name: str) -> Iterator[Path]:
        """Yield the path of a published file whose bytes match its row.

        Raises NotFinished, NoSuchFile, and ResultDamaged with the id of the analysis that replaces it.
        """
        file = self.find(job, name)
        try:
            with borrow_result(self.storage, job.id, str(job.token), file) as path:
                yield path
        except ResultDamaged as damaged:
            again = {"again": job.replaced_by} if job.replaced_by else {}
            raise ResultDamaged(**damaged.facts, **again) from damaged

    def read(self, job: Job, name: str) -> bytes:
        """Return the bytes of a published file. Raises NotFinished, NoSuchFile, ResultDamaged."""
        with self.borrow(job, name) as path:
            return path.read_bytes()


def check_succeeded(job: Job, name: str) -> None:
    """Check that an analysis has files; ``name`` is the requested one.

    Raises NotFinished, NoSuchFile.
    """
    if not job.is_over:
        raise NotFinished(state=job.state.value)
    if job.state is not JobState.SUCCEEDED or job.token is None:
        raise NoSuchFile(name=name)


# A report can be made again. Its recording and settings still exist, so the new report is the same. If the
# recording itself is damaged, upload the original again or restore a backup.


def find_or_add(
    store: JobStore,
    storage: Storage,
    recording: tuple[str, str],
    request: ReportRequest,
    way_in: WayIn,
    add: Callable[[], Job],
    *,
    again: bool = False,
) -> tuple[Job, bool]:
    """Return the existing analysis, or a new one from ``add``; and whether it existed.

    ``again``: create a new one in any case. The same request sent twice at once, also to two servers, creates
    one analysis, because requests take turns. Raises StoreDamaged.
    """
    if again:
        return add(), False
    with _one_at_a_time, lock_requests(store.engine):
        same = find_same(store, storage, recording, request, way_in)
        return same or add(), same is not None


def is_damaged(store: JobStore, storage: Storage, job: Job) -> bool:
    """Return whether a file of a finished analysis is missing or altered."""
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return False
    token, files = job.token, store.find_files(job.id)
    return not all(is_result_whole(storage, job.id, token, file) for file in files)


def retry(store: JobStore, storage: Storage, analysis_id: str, way_in: WayIn) -> Job:
    """Queue an analysis again that failed, was cancelled or is damaged; any other stays unchanged.

    Raises
    ------
    NotHere StoreDamaged
        The recording is also damaged.
    """
    job = store.retry(analysis_id, way_in)
    return regenerate(store, storage, job, way_in) if is_damaged(store, storage, job) else job


def regenerate(store: JobStore, storage: Storage, job: Job, way_in: WayIn) -> Job:
    """Queue a finished analysis again; the new one replaces it.

    Raises
    ------
    StoreDamaged
        The recording or its reference is damaged, so that no new report can be made.
    """
    if not can_regenerate(store, storage, job):
        raise StoreDamaged
    return store.repeat(job, way_in)


def can_regenerate(store: JobStore, storage: Storage, job: Job) -> bool:
    """Return whether the recording of an analysis, and its reference if it has one, are intact."""
    reference = job.request.reference
    others = () if reference is None else ((reference.path, store.find_sha256(reference.path)),)
    sources = ((job.recording_id, job.sha256), *others)
    return all(is_recording_whole(storage, *source) for source in sources)


def find_same(
    store: JobStore, storage: Storage, recording: tuple[str, str], request: ReportRequest, way_in: WayIn
) -> Job | None:
    """Find the analysis of the same bytes with the same settings by the same engine.

    A damaged analysis is queued again. An analysis of another recording with damaged bytes does not count:
    the new bytes (``recording`` is their id and SHA-256) are then the only good ones, and are kept. Raises
    StoreDamaged.
    """
    recording_id, sha256 = recording
    for job in store.find_same(sha256, request):
        if job.recording_id == recording_id or is_recording_whole(storage, job.recording_id, sha256):
            return regenerate(store, storage, job, way_in) if is_damaged(store, storage, job) else job
    return None
