"""Regenerate finished analyses whose files are damaged or missing.

Recording and settings are still there, so that the same report can be made again. Where the recording itself
is damaged, too, the original has to be uploaded again, or a backup restored.
"""

import threading
from collections.abc import Callable

from app.errors import StoreDamaged
from app.jobs.database.connect import one_request_at_a_time
from app.jobs.job import Job, JobState
from app.jobs.queue import WayIn
from app.jobs.store import JobStore
from app.request import ReportRequest
from app.storage.store import Storage, is_recording_whole, is_result_whole

_one_at_a_time = threading.Lock()


def find_or_add(
    store: JobStore,
    storage: Storage,
    recording: tuple[str, str],
    request: ReportRequest,
    way_in: WayIn,
    add: Callable[[], Job],
) -> tuple[Job, bool]:
    """Return the analysis that counts, else the one that ``add`` makes; and whether it was there before.

    The same request sent twice at once, also to two servers, makes one analysis: this is done for one request
    at a time. Raises StoreDamaged.
    """
    with _one_at_a_time, one_request_at_a_time(store.engine):
        same = find_same(store, storage, recording, request, way_in)
        return same or add(), same is not None


def is_damaged(store: JobStore, storage: Storage, job: Job) -> bool:
    """Tell whether a file of a finished analysis is missing or altered."""
    if job.state is not JobState.SUCCEEDED or job.token is None:
        return False
    token, files = job.token, store.find_files(job.id)
    return not all(is_result_whole(storage, job.id, token, file) for file in files)


def retry(store: JobStore, storage: Storage, analysis_id: str, way_in: WayIn) -> Job:
    """Queue an analysis again that failed, was cancelled or is damaged; any other stays as it is.

    Raises
    ------
    NotHere
    StoreDamaged
        The recording is damaged, too.
    """
    job = store.retry(analysis_id, way_in)
    return regenerate(store, storage, job, way_in) if is_damaged(store, storage, job) else job


def regenerate(store: JobStore, storage: Storage, job: Job, way_in: WayIn) -> Job:
    """Queue a finished analysis again; the new one replaces it.

    Raises
    ------
    StoreDamaged
        The recording, or the reference it is compared with, is damaged: no new report could be made.
    """
    if not can_regenerate(store, storage, job):
        raise StoreDamaged
    return store.repeat(job, way_in)


def can_regenerate(store: JobStore, storage: Storage, job: Job) -> bool:
    """Tell whether the recording of an analysis, and its reference where it has one, are whole."""
    reference = job.request.reference
    others = () if reference is None else ((reference.path, store.find_sha256(reference.path)),)
    sources = ((job.recording_id, job.sha256), *others)
    return all(is_recording_whole(storage, *source) for source in sources)


def find_same(
    store: JobStore, storage: Storage, recording: tuple[str, str], request: ReportRequest, way_in: WayIn
) -> Job | None:
    """Find the analysis of the same bytes with the same settings by the same engine, if one counts.

    A damaged analysis is queued again. An analysis of another recording whose bytes are damaged does not
    count: the new bytes (``recording`` is their id and SHA-256) are then the only good ones, and are kept.
    Raises StoreDamaged.
    """
    recording_id, sha256 = recording
    for job in store.find_same(sha256, request):
        if job.recording_id == recording_id or is_recording_whole(storage, job.recording_id, sha256):
            return regenerate(store, storage, job, way_in) if is_damaged(store, storage, job) else job
    return None
