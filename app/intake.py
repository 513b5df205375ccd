"""Recordings that lie on this computer already: those of a watched folder, and a sample.

A watched folder is for people who never open the page: a file that is put there, and no longer grows, is
taken in and moved to ``taken`` within it. A folder inside it is a subject code: ``watched/S012/shift.gt3x``.
"""

import logging
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path, PurePath

from app.errors import AppError
from app.formats import ENDINGS
from app.jobs.job import Job
from app.jobs.queueing import WayIn
from app.jobs.renewing import find_same
from app.jobs.store import JobStore
from app.request import ReportRequest, check_subject, clean_file_name
from app.settings import Settings
from app.storage import COPY_BYTES, Storage

LOOK_S = 2.0
STOP_S = 10.0
TAKEN = "taken"
LAST_ENDINGS = frozenset(PurePath(f"log{ending}").suffix for ending in ENDINGS)

Signature = tuple[int, int]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Intake:
    """Where recordings go that come without HTTP."""

    store: JobStore
    storage: Storage
    settings: Settings

    def take(self, path: Path, request: ReportRequest, way_in: WayIn) -> Job:
        """Store a copy of a file and queue its analysis; the same bytes asked alike are not analysed twice.

        Raises
        ------
        FileTooLarge, DiskFull, OSError
        """
        self.storage.check_space(path.stat().st_size, self.settings.min_free_bytes)
        upload = self.storage.open_upload(self.settings.max_upload_bytes)
        try:
            with path.open("rb") as file:
                while chunk := file.read(COPY_BYTES):
                    upload.write(chunk)
            stored = upload.keep()
        finally:
            upload.discard()
        own = (stored.id, stored.sha256)
        same = find_same(self.store, self.storage, own, request, way_in)
        if same is None:
            return self.store.add(stored, request, way_in)
        self.storage.drop_recording(stored.id)
        return same


@dataclass(slots=True)
class FolderWatch:
    """Looks into a folder again and again."""

    intake: Intake
    folder: Path
    _seen: dict[Path, Signature] = field(default_factory=dict)
    _stopping: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def start(self) -> None:
        """Look from now on, in a thread of its own."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._thread = threading.Thread(target=self._go_on, name="folder-watch", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Look no more."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(STOP_S)

    def look(self) -> list[Job]:
        """Take in what has stopped growing since the last look; gives the analyses."""
        found = dict(_list_files(self.folder))
        ready = [path for path, signature in found.items() if self._seen.get(path) == signature]
        self._seen = found
        jobs = [self._take(path) for path in sorted(ready)]
        return [job for job in jobs if job is not None]

    def _go_on(self) -> None:
        while not self._stopping.wait(LOOK_S):
            try:
                self.look()
            except OSError as error:
                logger.error("the watched folder cannot be read; trying again: %s", error.strerror)

    def _take(self, path: Path) -> Job | None:
        """Take one file in; one that cannot be taken stays where it is, and the log tells its size and age.

        Neither folder nor file is named in the log: their names are subject codes, or hold them.
        """
        inside = path.relative_to(self.folder)
        subject = inside.parts[0] if len(inside.parts) > 1 else ""
        try:
            name, paper = clean_file_name(path.name), self.intake.settings.paper
            request = ReportRequest(name, check_subject(subject), paper=paper)
            job = self.intake.take(path, request, "api")
        except (AppError, OSError, ValueError) as error:
            size_bytes, changed_ns = self._seen[path]
            changed = datetime.fromtimestamp(changed_ns / 1e9, UTC).isoformat(timespec="seconds")
            told = (size_bytes, changed, _name_trouble(error))
            logger.error("a watched file of %d bytes, changed %s, could not be taken in: %s", *told)
            return None
        place = self.folder / TAKEN / inside.parent / f"{job.id}_{path.name}"
        place.parent.mkdir(parents=True, exist_ok=True)
        path.rename(place)
        logger.info("a watched file was taken in as %s", job.id)
        return job


def _name_trouble(error: AppError | OSError | ValueError) -> str:
    """Name it without any word of the file's."""
    if isinstance(error, AppError):
        return error.code
    return (error.strerror or "") if isinstance(error, OSError) else "its name cannot be used"


def _list_files(folder: Path) -> Iterator[tuple[Path, Signature]]:
    """Give the recordings of the folder and of those in it, with what changes while they grow."""
    for path in (*folder.glob("*"), *folder.glob("*/*")):
        is_taken = path.relative_to(folder).parts[0] == TAKEN
        if not is_taken and path.suffix.lower() in LAST_ENDINGS and not path.name.startswith("."):
            status = path.stat()
            if path.is_file() and status.st_size:
                yield path, (status.st_size, status.st_mtime_ns)
