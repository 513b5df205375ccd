"""Import recordings that are already on this computer: from a watched folder, and the sample.

A watched folder is for people who never open the page. A file that has stopped growing is imported and moved
to the subfolder ``taken``. The name of any other subfolder is a subject code: ``watched/S012/shift.gt3x``.
Links to files or folders are not followed.
"""

import logging
import os
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path, PurePath
from typing import BinaryIO

from acromion.app.errors import AppError
from acromion.app.formats import ENDINGS
from acromion.app.library.claims import WayIn
from acromion.app.library.jobs import JobStore
from acromion.app.library.results import find_or_add
from acromion.app.library.rows import Job
from acromion.app.request import ReportRequest, check_subject, clean_file_name
from acromion.app.settings import Settings
from acromion.app.store.folder import COPY_BYTES, Storage, StoredRecording
from acromion.fusion.conventions import is_sidecar
from acromion.fusion.errors import EmptyFile, FusionError

SCAN_PERIOD_S = 2.0
STOP_LIMIT_S = 10.0
TAKEN = "taken"
LAST_ENDINGS = frozenset(PurePath(f"log{ending}").suffix for ending in ENDINGS)

HAS_FOLDER_HANDLES = {os.open, os.rename} <= os.supports_dir_fd
_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_READ = os.O_RDONLY | _NO_LINK | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
"""Reject links, and do not block on a pipe."""

Signature = tuple[int, int]
"""Size and modification time, which change while a file grows."""

logger = logging.getLogger(__name__)


def store_file(storage: Storage, file: BinaryIO, limit_bytes: int) -> StoredRecording:
    """Store a copy of an open file. Raises EmptyFile, FileTooLarge, DiskFull or OSError."""
    upload = storage.open_upload(limit_bytes)
    try:
        while piece := file.read(COPY_BYTES):
            upload.write(piece)
        if upload.size_bytes == 0:
            raise EmptyFile
        return upload.keep()
    finally:
        upload.discard()


@dataclass(frozen=True, slots=True)
class Intake:
    """Stores and queues recordings that do not arrive over HTTP."""

    store: JobStore
    storage: Storage
    settings: Settings

    def add(self, path: Path, request: ReportRequest, way_in: WayIn) -> Job:
        """Store a copy of a file and queue its analysis; reuse one of the same bytes and settings.

        Raises FileTooLarge, DiskFull or OSError.
        """
        with path.open("rb") as file:
            return self.add_open(file, request, way_in)

    def add_open(self, file: BinaryIO, request: ReportRequest, way_in: WayIn) -> Job:
        """Import an open file in the same way as :meth:`add`. Raises FileTooLarge, DiskFull or OSError."""
        self.storage.check_space(os.fstat(file.fileno()).st_size, self.settings.min_free_bytes)
        stored = store_file(self.storage, file, self.settings.max_upload_bytes)
        add = partial(self.store.add, stored, request, way_in)
        own = (stored.id, stored.sha256)
        job, existed = find_or_add(self.store, self.storage, own, request, way_in, add)
        if existed:
            self.storage.drop_recording(stored.id)
        return job


@dataclass(slots=True)
class FolderWatch:
    """Scans a folder every two seconds."""

    intake: Intake
    folder: Path
    _seen: dict[Path, Signature] = field(default_factory=dict)
    _links: int = 0
    _refused: set[tuple[Path, Signature]] = field(default_factory=set)
    _stopping: threading.Event = field(default_factory=threading.Event)
    _thread: threading.Thread | None = None

    def start(self) -> None:
        """Start scanning in a separate thread."""
        self.folder.mkdir(parents=True, exist_ok=True)
        self._thread = threading.Thread(target=self._scan_on, name="folder-watch", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop scanning."""
        self._stopping.set()
        if self._thread is not None:
            self._thread.join(STOP_LIMIT_S)

    def scan(self) -> list[Job]:
        """Import files that have stopped growing since the last scan; return their analyses."""
        with os.scandir(self.folder) as top:
            entries = list(top)
        for folder in [one for one in entries if one.name != TAKEN and one.is_dir(follow_symlinks=False)]:
            with os.scandir(folder.path) as inside:
                entries += inside
        links = sum(entry.is_symlink() for entry in entries)
        if links > self._links:  # logged once for each new number of links
            logger.warning("%d links in the watched folder are left alone: links are not followed", links)
        self._links = links
        found = {}
        for entry in entries:
            path = Path(entry.path)
            if path.suffix.lower() in LAST_ENDINGS and not is_sidecar(entry.name):
                status = entry.stat(follow_symlinks=False)
                if stat.S_ISREG(status.st_mode) and status.st_size:
                    found[path] = (status.st_size, status.st_mtime_ns)
        ready = [path for path, signature in found.items() if self._seen.get(path) == signature]
        self._seen = found
        self._refused &= set(found.items())
        jobs = [self._add(path) for path in sorted(ready)]
        return [job for job in jobs if job is not None]

    def _scan_on(self) -> None:
        while not self._stopping.wait(SCAN_PERIOD_S):
            try:
                self.scan()
            except OSError as error:
                logger.warning("the watched folder cannot be read (%s); trying again", error.strerror)

    def _add(self, path: Path) -> Job | None:
        """Import one file; leave a failing one in place and log it once, without its name."""
        inside = path.relative_to(self.folder)
        subject = inside.parts[0] if len(inside.parts) > 1 else ""
        try:
            name, settings = clean_file_name(path.name), self.intake.settings
            held = settings.watch_pose_held
            request = ReportRequest(
                name,
                check_subject(subject),
                paper=settings.paper,
                appendix=settings.appendix,
                pose_held=held,
            )
            with _enter_folder(path.parent, is_watched=path.parent == self.folder) as handle:
                with _open_plain(path, handle) as file:
                    job = self.intake.add_open(file, request, "api")
                self._move_to_taken(path, handle, job.id)
        except (AppError, FusionError, OSError, ValueError) as error:
            self._log_refused(path, error)
            return None
        logger.info("imported a file from the watched folder as %s", job.id)
        return job

    def _log_refused(self, path: Path, error: Exception) -> None:
        refused = (path, self._seen[path])
        if refused not in self._refused:
            self._refused.add(refused)
            size_bytes, changed_ns = self._seen[path]
            changed = datetime.fromtimestamp(changed_ns / 1e9, UTC).isoformat(timespec="seconds")
            trouble = "its name cannot be used"  # do not log text from the file
            if isinstance(error, AppError | FusionError):
                trouble = error.code
            elif isinstance(error, OSError):
                trouble = error.strerror or ""
            facts = (size_bytes, changed, trouble)
            logger.warning("a watched file of %d bytes, changed %s, could not be imported: %s", *facts)

    def _move_to_taken(self, path: Path, handle: int | None, job_id: str) -> None:
        """Move an imported file to ``taken``, from the same folder handle that it was read through."""
        inside = path.relative_to(self.folder)
        place = self.folder / TAKEN / inside.parent / f"{job_id}_{path.name}"
        for folder in (self.folder / TAKEN, place.parent):
            if folder.is_symlink():
                raise NotADirectoryError
            folder.mkdir(exist_ok=True)
        if handle is None:
            path.rename(place)
        else:
            os.rename(path.name, place, src_dir_fd=handle)


@contextmanager
def _enter_folder(folder: Path, *, is_watched: bool) -> Iterator[int | None]:
    """Hold a folder open so that it cannot be swapped; only the watched folder itself may be a link."""
    if not HAS_FOLDER_HANDLES:
        yield None
        return
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | (0 if is_watched else _NO_LINK))
    try:
        yield handle
    finally:
        os.close(handle)


def _open_plain(path: Path, handle: int | None) -> BinaryIO:
    """Open a regular file of the open folder; reject links and special files."""
    name = path if handle is None else path.name
    file = os.fdopen(os.open(name, _READ, dir_fd=handle), "rb")
    if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
        file.close()
        raise IsADirectoryError
    return file
