"""Files of a finished analysis, checked against the digests in their rows whenever they are opened."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from app.errors import NoSuchFile, NotFinished, ResultDamaged
from app.jobs.audit_log import touch
from app.jobs.job import Job, JobState
from app.jobs.store import JobStore
from app.storage.store import ResultFile, Storage, borrow_result


@dataclass(frozen=True, slots=True)
class ResultReader:
    """Reads published files by analysis and name."""

    store: JobStore
    storage: Storage

    def find(self, job: Job, name: str) -> ResultFile:
        """Give the row of a published file. Raises NotFinished, NoSuchFile."""
        check_succeeded(job, name)
        file = self.store.find_file(job.id, name)
        if file is None:
            raise NoSuchFile(name=name)
        touch(job.recording_id, job.id)
        return file

    @contextmanager
    def borrow(self, job: Job, name: str) -> Iterator[Path]:
        """Lend a published file whose bytes are those of its row.

        Raises NotFinished, NoSuchFile, and ResultDamaged, which names the one that replaces it.
        """
        file = self.find(job, name)
        try:
            with borrow_result(self.storage, job.id, str(job.token), file) as path:
                yield path
        except ResultDamaged as damaged:
            again = {"again": job.replaced_by} if job.replaced_by else {}
            raise ResultDamaged(**damaged.facts, **again) from damaged

    def read(self, job: Job, name: str) -> bytes:
        """Give the bytes of a published file. Raises NotFinished, NoSuchFile, ResultDamaged."""
        with self.borrow(job, name) as path:
            return path.read_bytes()


def check_succeeded(job: Job, name: str) -> None:
    """Check that an analysis has files; ``name`` is the one that is asked for.

    Raises NotFinished, NoSuchFile.
    """
    if not job.is_over:
        raise NotFinished(state=job.state.value)
    if job.state is not JobState.SUCCEEDED or job.token is None:
        raise NoSuchFile(name=name)
