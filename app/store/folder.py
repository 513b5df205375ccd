"""Store recordings and results in a folder; each file is durable before it counts, and verified at each use.

 root/uploads/<name>.part             bytes still arriving, and copies from a bucket while they are read
 root/recordings/<recording>          bytes whose arrival was acknowledged
 root/recordings/<recording>.json     its side file: a copy of its rows
 (:mod:`acromion.app.library.side_files`) root/quarantine/<name>               unknown entries among the
 recordings; only people remove them root/analyses/<analysis>/<attempt>/  the files of one attempt; the job
 row states which attempt counts root/erasures.jsonl                  the ledger of erasures: one line each,
 only id and time,
                                      synced before the first file is deleted

The ledger is outside the database: ``restore``, ``recover`` and every start erase its entries again.

With many machines, recordings and results are objects in a bucket instead (:mod:`acromion.app.store.bucket`),
under the same names; the folder then contains only temporary files.

The program creates every name on disk and never uses a person's file name. A file counts once its row is
committed, and is on disk before that: write, fsync, rename, fsync of the folder, commit, response.
"""

import errno
import hashlib
import importlib
import json
import logging
import os
import re
import secrets
import shutil
import sys
import tempfile
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from stat import S_ISREG
from types import ModuleType
from typing import IO, TYPE_CHECKING, ClassVar

from acromion.app.errors import (
    AppError,
    DiskFull,
    FileTooLarge,
    FolderForbidden,
    FolderIsFile,
    FolderReadOnly,
    FolderTaken,
    FolderUnusable,
    NotInstalled,
    ResultDamaged,
    StoreDamaged,
)
from acromion.app.store.permissions import FILE_MODE, FOLDER_MODE, create_file, make_folder
from acromion.fusion.documents import HEAD_BYTES, refuse_document

if TYPE_CHECKING:
    from acromion.app.settings import Settings
    from acromion.app.store.decoded import DecodedCache


if sys.platform != "win32":
    import fcntl

COPY_BYTES = 1 << 20
TEMPORARY_S = 6 * 3600.0
"""A temporary file unchanged for this time belongs to no running upload or reading."""
SIDE_SUFFIX = ".json"
VERIFIED_TERM_S = 3600.0
MOST_VERIFIED = 100_000
MOST_READ_FOR_PAGE_BYTES = 512 << 20
"""Largest recording that is read completely to show a page: at most a second of work, once an hour."""
LEDGER_FILE = "erasures.jsonl"
TEMPORARY = re.compile(r"((rec_)?[0-9a-f]{16}(\.[0-9a-f]{8})?|restored)\.part")
"""Names of our temporary files in ``uploads``; any other file is left alone."""
UNREADABLE = frozenset(
    {errno.ENOENT, errno.ENOTDIR, errno.EISDIR, errno.ELOOP, errno.EACCES, errno.EPERM, errno.EIO}
)
"""System error numbers for a file that is missing, not a file, or on a broken disk."""

logger = logging.getLogger(__name__)


Mark = tuple[int | str, ...]
"""Changes when stored bytes change: size, time and inode of a file, size and ETag of an object."""


@dataclass(frozen=True, slots=True)
class StoredRecording:
    """The stored bytes of one upload."""

    id: str
    sha256: str
    size_bytes: int


@dataclass(frozen=True, slots=True)
class ResultFile:
    """One file of a finished analysis."""

    name: str
    sha256: str
    size_bytes: int


@dataclass(frozen=True, slots=True)
class Fetched:
    """A stored file, not verified yet; ``mark`` is the store's, ``own_mark`` belongs to ``path``."""

    path: Path
    mark: Mark
    own_mark: Mark


@dataclass(frozen=True, slots=True)
class KnownFiles:
    """Known facts about files before they are read: their SHA-256, and the cache of their samples."""

    digests: tuple[str, ...] = ()
    cache: "DecodedCache | None" = None


NOTHING_KNOWN = KnownFiles()


class VerifiedFiles:
    """The stored files whose bytes matched the SHA-256 of their rows.

    A verification is valid for an hour at most, in this process, and until the mark changes. Damage is not
    remembered, so that a repaired file is served at once.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock, self._lock = clock, threading.Lock()
        self._whole: dict[str, tuple[str, Mark, float]] = {}

    def is_known(self, name: str, sha256: str, mark: Mark) -> bool:
        """Return whether the file was verified within the last hour and has not changed since."""
        with self._lock:
            known = self._whole.get(name)
        return (
            known is not None and known[:2] == (sha256, mark) and self._clock() - known[2] < VERIFIED_TERM_S
        )

    def remember(self, name: str, sha256: str, mark: Mark) -> None:
        """Remember that the file is verified; drop the oldest one if there are too many."""
        with self._lock:
            self._whole.pop(name, None)
            self._whole[name] = (sha256, mark, self._clock())
            if len(self._whole) > MOST_VERIFIED:
                del self._whole[next(iter(self._whole))]


class Upload(ABC):
    """An upload, hashed while it arrives: kept or discarded as a whole."""

    def __init__(self, recording_id: str, max_bytes: int) -> None:
        self._id, self._max_bytes = recording_id, max_bytes
        self._sha256, self.size_bytes = hashlib.sha256(), 0
        self._head = b""

    def write(self, chunk: bytes) -> None:
        """Write the next bytes. Raises FileTooLarge, DiskFull, StoreAway."""
        if self.size_bytes + len(chunk) > self._max_bytes:
            raise too_large(self.size_bytes + len(chunk), self._max_bytes)
        self._sha256.update(chunk)
        self._head += bytes(chunk[: HEAD_BYTES - len(self._head)])
        self._write(chunk)
        self.size_bytes += len(chunk)

    def keep(self) -> StoredRecording:
        """Make the bytes durable under their final name.

        Raises DiskFull, StoreAway, or acromion.fusion.errors.UnknownFormat for a photo or a document.
        """
        refuse_document(self._head)
        self._keep()
        return StoredRecording(self._id, self._sha256.hexdigest(), self.size_bytes)

    @abstractmethod
    def _write(self, chunk: bytes) -> None: ...

    @abstractmethod
    def _keep(self) -> None: ...

    @abstractmethod
    def discard(self) -> None:
        """Remove all traces; does nothing after :meth:`keep`."""


class FolderUpload(Upload):
    """An upload to a folder."""

    def __init__(self, recording_id: str, max_bytes: int, part: Path, kept: Path) -> None:
        super().__init__(recording_id, max_bytes)
        self._part, self._kept = part, kept
        self._file: IO[bytes] = create_file(part)

    def _write(self, chunk: bytes) -> None:
        with translate_disk_full():
            self._file.write(chunk)

    def _keep(self) -> None:
        with translate_disk_full():
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._part.rename(self._kept)
            sync_folder(self._kept.parent)

    def discard(self) -> None:
        """Close and remove the file, unless it was kept."""
        with suppress(OSError):
            self._file.close()
        self._part.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class Storage:
    """Storage of recordings and results: a folder, or a bucket (:mod:`acromion.app.store.bucket`).

    :meth:`fetch` returns a file of this machine, which the caller releases. It verifies nothing: use
    :func:`borrow_recording` and :func:`borrow_result` for everything that is shown or computed. A name
    identifies a file in the store, such as ``recordings/...``. With a bucket, each method may raise
    StoreAway.
    """

    is_local: ClassVar[bool] = True
    """Whether files can be read in place; otherwise each reading is a copy."""

    root: Path
    """The folder of this machine."""
    verified: VerifiedFiles = field(default_factory=VerifiedFiles, compare=False, repr=False)

    def prepare(self) -> None:
        """Create missing folders; fail early if the store does not respond."""
        for name in ("uploads", "recordings", "analyses"):
            make_folder(self.root / name)

    def identify(self) -> str:
        """Return the permanent id of this store; the first call creates it."""
        path = self.root / "store.id"
        if not path.exists():
            write_durably(path, f"folder-{secrets.token_hex(8)}".encode())
        return path.read_text()

    # Recordings, and files by name.

    def open_upload(self, max_bytes: int) -> Upload:
        """Start an upload of a recording under a new name."""
        recording_id = make_recording_id()
        part = self.root / "uploads" / f"{recording_id}.part"
        with translate_disk_full():
            return FolderUpload(recording_id, max_bytes, part, self.recording(recording_id))

    def recording(self, recording_id: str) -> Path:
        """Return the path of a recording in the folder of this machine."""
        return self.root / "recordings" / recording_id

    def adopt(self, path: Path, recording_id: str) -> None:
        """Store a durable local file as a recording; can be repeated. The caller removes the file."""
        with translate_disk_full(), suppress(FileExistsError):  # an earlier call has linked it
            os.link(path, self.recording(recording_id))
        sync_folder(self.root / "recordings")

    def put(self, path: Path, name: str) -> None:
        """Store a copy of a file of this machine under a name, completely or not at all."""
        kept = self.root / name
        make_folder(kept.parent)
        part = self.root / "uploads" / f"{secrets.token_hex(8)}.part"
        with translate_disk_full():
            with path.open("rb") as source, create_file(part) as target:
                shutil.copyfileobj(source, target, COPY_BYTES)
            sync_file(part)
            part.rename(kept)
        for folder in (kept.parent, *kept.parent.parents[: len(Path(name).parts) - 1]):
            sync_folder(folder)

    def fetch(self, name: str) -> Fetched:
        """Return a file, unverified. Raises FileNotFoundError."""
        mark = read_mark(self.root / name)
        return Fetched(self.root / name, mark, mark)

    def release(self, path: Path) -> None:
        """End the use of a fetched file; remove it if it is a copy."""

    def hash(self, name: str) -> tuple[str, Mark]:
        """Return the SHA-256 of a file, and its mark. Raises FileNotFoundError."""
        mark = read_mark(self.root / name)
        return hash_file(self.root / name), mark

    def read_part(self, name: str, first_byte: int, count: int) -> bytes:
        """Return a part of a file, unverified. Raises FileNotFoundError."""
        with (self.root / name).open("rb") as file:
            file.seek(first_byte)
            return file.read(count)

    def find_mark(self, name: str) -> Mark | None:
        """Return the mark of a file, its size first; None if it is missing or unreadable."""
        try:
            mark = read_mark(self.root / name)
            with (self.root / name).open("rb"):
                return mark
        except OSError as error:
            if error.errno not in UNREADABLE:
                raise
            return None

    def write_small(self, name: str, content: bytes) -> None:
        """Write a small file durably, completely or not at all."""
        part = self.root / "uploads" / f"{secrets.token_hex(8)}.part"
        with translate_disk_full():
            make_folder((self.root / name).parent)
            with create_file(part) as file:
                file.write(content)
            sync_file(part)
            part.rename(self.root / name)
            sync_folder((self.root / name).parent)

    def read_small(self, name: str) -> bytes | None:
        """Return the content of a small file; None if it does not exist."""
        path = self.root / name
        try:
            return path.read_bytes() if path.is_file() else None  # a foreign pipe would block
        except FileNotFoundError:
            return None

    def drop_recording(self, recording_id: str) -> None:
        """Remove a recording, then its side file; ignore missing ones."""
        for name in (recording_id, f"{recording_id}{SIDE_SUFFIX}"):
            if self.recording(name).is_dir():  # not ours
                self.quarantine(name)
            self.recording(name).unlink(missing_ok=True)
        for path in (self.root / "quarantine").glob(f"{recording_id}.*{SIDE_SUFFIX}"):
            path.unlink()
        sync_folder(self.root / "recordings")

    # Attempts: files are written on this machine, and kept before the row states that the attempt counts.

    def attempt(self, analysis_id: str, token: str) -> Path:
        """Return the local folder for one attempt's files."""
        return self.root / "analyses" / analysis_id / token

    def open_attempt(self, analysis_id: str, token: str) -> Path:
        """Create the local folder of an attempt, empty."""
        folder = self.attempt(analysis_id, token)
        with translate_disk_full():
            make_folder(folder.parent)
            folder.mkdir(mode=FOLDER_MODE)
        return folder

    def keep_attempt(self, analysis_id: str, token: str) -> None:
        """Make the attempt's files durable and readable from every machine."""
        folder = self.attempt(analysis_id, token)
        with translate_disk_full():
            for path in folder.iterdir():
                path.chmod(FILE_MODE)
                sync_file(path)
            for changed in (folder, folder.parent, folder.parent.parent):
                sync_folder(changed)

    def share(self, kept: str, name: str) -> None:
        """Store a file, which never changes, also under another name. Raises FileNotFoundError."""
        with translate_disk_full(), suppress(FileExistsError):
            os.link(self.root / kept, self.root / name)

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove the files of a discarded attempt."""
        shutil.rmtree(self.attempt(analysis_id, token), ignore_errors=True)

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""
        shutil.rmtree(self.root / "analyses" / analysis_id, ignore_errors=True)

    def find_attempts(self) -> tuple[tuple[str, str], ...]:
        """Return the folders of attempts on this machine: (analysis, token)."""
        folders = (path for path in (self.root / "analyses").glob("*/*") if path.is_dir())
        return tuple((path.parent.name, path.name) for path in folders)

    # What is in the store.

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:
        """Reject an upload that would fill the disk, before its first byte.

        Raises DiskFull if less is free than ``min_free_bytes`` or three times the announced length.
        """
        check_free(self.root, max(min_free_bytes, 3 * expected_bytes))

    def find_names(self) -> Iterator[str]:
        """Return the name of every stored recording and result, as :meth:`put` expects it."""
        for kind in ("recordings", "analyses"):
            for path in (self.root / kind).rglob("*"):
                if path.is_file():
                    yield path.relative_to(self.root).as_posix()

    def find_recordings(self) -> frozenset[str]:
        """Return every name among the recordings, including side files."""
        with os.scandir(self.root / "recordings") as entries:
            return frozenset(entry.name for entry in entries)

    def drop_temporary(self, min_age_s: float) -> int:
        """Remove our temporary files that are older than this; return their number."""
        newest_s = time.time() - min_age_s
        old = [
            path
            for path in (self.root / "uploads").iterdir()
            if TEMPORARY.fullmatch(path.name) and path.is_file() and path.stat().st_mtime <= newest_s
        ]
        for path in old:
            path.unlink(missing_ok=True)
        return len(old)

    # Quarantine: unknown entries of the recordings. A bucket leaves them in place: another machine may be
    # about to write the row.

    def quarantine(self, name: str) -> bool:
        """Move an entry into quarantine under a free name; return False if it stays in place."""
        quarantine = self.root / "quarantine"
        make_folder(quarantine)
        kept = quarantine / name
        if kept.exists() or kept.is_symlink():
            kept = quarantine / f"{name}.{secrets.token_hex(4)}"
        self.recording(name).rename(kept)
        sync_folder(quarantine)
        sync_folder(self.root / "recordings")
        return True

    def unquarantine(self, name: str) -> bool:
        """Move a recording back from quarantine; return False if this store never moves any there."""
        (self.root / "quarantine" / name).rename(self.recording(name))
        sync_folder(self.root / "recordings")
        return True

    def find_quarantined(self) -> tuple[str, ...]:
        """Return the names of everything in quarantine."""
        try:
            return tuple(sorted(os.listdir(self.root / "quarantine")))  # noqa: PTH208 - names are all we need
        except FileNotFoundError:
            return ()

    # The ledger of erasures: entries are never removed.

    def find_erased(self) -> frozenset[str]:
        """Return the id of every recording and analysis that was erased."""
        try:
            return parse_ledger((self.root / LEDGER_FILE).read_bytes())
        except FileNotFoundError:
            return frozenset()

    def add_erased(self, ids: Collection[str]) -> None:
        """Add ids to the ledger, one writer at a time; durable on return. Raises DiskFull."""
        make_folder(self.root)
        opener = partial(os.open, mode=FILE_MODE)
        with translate_disk_full(), open(self.root / LEDGER_FILE, "a+b", opener=opener) as file:
            if sys.platform != "win32":
                fcntl.flock(file, fcntl.LOCK_EX)
            file.seek(0)
            content = file.read()
            if not content.endswith(b"\n") and content:  # a power failure has cut the last line
                file.write(b"\n")
            file.write(format_ledger(set(ids) - parse_ledger(content)))
            file.flush()
            os.fsync(file.fileno())
        sync_folder(self.root)


@contextmanager
def borrow_result(storage: Storage, analysis_id: str, token: str, file: ResultFile) -> Iterator[Path]:
    """Yield the path of a result, verified against the SHA-256 of its row.

    Raises ResultDamaged if it is missing or altered, or was altered during the block.
    """
    damaged = ResultDamaged(name=file.name, analysis=analysis_id)
    with _borrow(storage, format_result_name(analysis_id, token, file.name), file.sha256, damaged) as path:
        yield path


@contextmanager
def borrow_recording(storage: Storage, recording_id: str, sha256: str) -> Iterator[Path]:
    """Yield the path of a recording, verified against the SHA-256 of its row.

    Raises StoreDamaged if it is missing or altered, or was altered during the block.
    """
    with _borrow(storage, format_recording_name(recording_id), sha256, StoreDamaged()) as path:
        yield path


def read_recording(storage: Storage, recording_id: str, first_byte: int, count: int) -> bytes:
    """Read a part of a recording, unverified. Raises StoreDamaged."""
    name = format_recording_name(recording_id)
    with _translate_read_errors(name, StoreDamaged()):
        return storage.read_part(name, first_byte, count)


def is_result_whole(storage: Storage, analysis_id: str, token: str, file: ResultFile) -> bool:
    """Return whether a result exists and matches its row; reads it unless a verification is cached."""
    return _is_whole(storage, format_result_name(analysis_id, token, file.name), file.sha256)


def is_recording_whole(storage: Storage, recording_id: str, sha256: str) -> bool:
    """Return whether a recording exists and matches its row; reads it unless a verification is cached."""
    return _is_whole(storage, format_recording_name(recording_id), sha256)


def seems_intact(storage: Storage, stored: StoredRecording) -> bool:
    """Return whether a displayed recording seems complete, by its size only if reading it takes long."""
    mark = storage.find_mark(format_recording_name(stored.id))
    if mark is None or mark[0] != stored.size_bytes:
        return False
    is_read = storage.is_local and stored.size_bytes <= MOST_READ_FOR_PAGE_BYTES
    return not is_read or is_recording_whole(storage, stored.id, stored.sha256)


def make_recording_id() -> str:
    """Return a new recording id."""
    return f"rec_{secrets.token_hex(8)}"


def format_recording_name(recording_id: str) -> str:
    """Return the name of a recording in the store."""
    return f"recordings/{recording_id}"


def format_result_name(analysis_id: str, token: str, name: str) -> str:
    """Return the name of a result in the store."""
    return f"analyses/{analysis_id}/{token}/{name}"


def read_mark(path: Path) -> Mark:
    """Return size, time and inode of a file.

    Raises FileNotFoundError, also for a folder, a device or a pipe.
    """
    status = path.stat()
    if not S_ISREG(status.st_mode):
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path))
    return status.st_size, status.st_mtime_ns, status.st_ino


@contextmanager
def _borrow(storage: Storage, name: str, sha256: str, damaged: AppError) -> Iterator[Path]:
    """Verify a file, yield its path, and check at the end that it has not changed."""
    with _translate_read_errors(name, damaged):
        fetched = storage.fetch(name)
    try:
        if not storage.verified.is_known(name, sha256, fetched.mark):
            _compare(fetched, name, sha256, damaged)
            storage.verified.remember(name, sha256, fetched.mark)
        yield fetched.path
        with _translate_read_errors(name, damaged):
            is_same = read_mark(fetched.path) == fetched.own_mark
        if not is_same:
            _compare(fetched, name, sha256, damaged)
    finally:
        storage.release(fetched.path)


def _compare(fetched: Fetched, name: str, sha256: str, damaged: AppError) -> None:
    with _translate_read_errors(name, damaged):
        found = hash_file(fetched.path)
    if found != sha256:
        logger.error("%s is damaged: SHA-256 %s in its row, %s in the file", name, sha256, found)
        raise damaged


@contextmanager
def _translate_read_errors(name: str, damaged: AppError) -> Iterator[None]:
    """Convert the error of a missing or unreadable file to a refusal with a code."""
    try:
        yield
    except OSError as error:
        if not isinstance(error, FileNotFoundError) and error.errno not in UNREADABLE:
            raise
        logger.error("%s cannot be read: %s", name, error.strerror or "missing")
        raise damaged from error


def _is_whole(storage: Storage, name: str, sha256: str) -> bool:
    mark = storage.find_mark(name)
    if mark is None or storage.verified.is_known(name, sha256, mark):
        return mark is not None
    try:
        with _translate_read_errors(name, StoreDamaged()):
            found, mark = storage.hash(name)
    except StoreDamaged:
        return False
    if found != sha256:
        logger.error("%s is damaged: SHA-256 %s in its row, %s in the file", name, sha256, found)
        return False
    storage.verified.remember(name, sha256, mark)
    return True


class FolderLock:
    """The lock of the one server of a data folder; the system releases it when the process ends."""

    def __init__(self, root: Path) -> None:
        self._file = os.fdopen(os.open(root / "server.lock", os.O_WRONLY | os.O_CREAT, FILE_MODE), "w")
        if sys.platform != "win32":
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                self._file.close()
                raise FolderTaken(folder=str(root)) from error

    def release(self) -> None:
        """Release the lock."""
        self._file.close()


def describe_files(folder: Path) -> tuple[ResultFile, ...]:
    """Return name, SHA-256 and size of every file in a folder."""
    paths = sorted(folder.iterdir())
    return tuple(ResultFile(path.name, hash_file(path), path.stat().st_size) for path in paths)


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_free(folder: Path, needed_bytes: int) -> None:
    """Raise DiskFull if less than ``needed_bytes`` is free."""
    if shutil.disk_usage(folder).free < needed_bytes:
        raise DiskFull


def write_durably(path: Path, content: bytes) -> None:
    """Write a small file completely or not at all."""
    part = path.with_name(f"{path.name}.{secrets.token_hex(4)}.new")
    with create_file(part) as file:
        file.write(content)
    sync_file(part)
    part.replace(path)
    sync_folder(path.parent)


def sync_file(path: Path) -> None:
    """Make the bytes of a file durable."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable, for example after a rename."""
    if sys.platform == "win32":
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def format_side_file_name(recording_id: str) -> str:
    """Return the name of a recording's side file in the store."""
    return f"recordings/{recording_id}{SIDE_SUFFIX}"


def too_large(size_bytes: int, max_bytes: int) -> FileTooLarge:
    """Return the error for a file that is too large, in gigabytes."""
    return FileTooLarge(n=round(size_bytes / 1e9, 4), max=round(max_bytes / 1e9, 4))


@contextmanager
def translate_disk_full() -> Iterator[None]:
    """Convert "no space left" to a refusal with a code; every other error passes unchanged."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull from error
        raise


_FOLDER_TROUBLE: Mapping[int, type[FolderUnusable]] = {
    errno.EROFS: FolderReadOnly,
    errno.EACCES: FolderForbidden,
    errno.EPERM: FolderForbidden,
    errno.EEXIST: FolderIsFile,
    errno.ENOTDIR: FolderIsFile,
}


@contextmanager
def translate_folder_errors(folder: Path) -> Iterator[None]:
    """Convert a system error about a data folder or its content to a refusal with a code."""
    try:
        with translate_disk_full():
            yield
    except OSError as error:
        place = Path(os.fsdecode(error.filename)) if isinstance(error.filename, (str, bytes)) else folder
        if not (place.is_relative_to(folder) or folder.is_relative_to(place)):
            raise
        kind = _FOLDER_TROUBLE.get(error.errno or 0, FolderUnusable)
        raise kind(folder=str(folder), why=error.strerror or str(error)) from error


def check_folder(folder: Path) -> None:
    """Check that a data folder and each of our folders in it are writable.

    Raises FolderUnusable, DiskFull.
    """
    with translate_folder_errors(folder):
        for name in ("", "uploads", "recordings", "analyses", "incoming"):
            place = folder / name
            if place.is_dir() or not name:
                with tempfile.TemporaryFile(dir=place):
                    pass


def format_ledger(ids: Collection[str]) -> bytes:
    """Return ledger lines for these ids with the current time."""
    at = datetime.now(UTC).isoformat(timespec="seconds")
    return b"".join(json.dumps({"id": one, "at": at}).encode() + b"\n" for one in sorted(ids))


def parse_ledger(content: bytes) -> frozenset[str]:
    """Return the ids of a ledger; an incomplete line does not count."""
    found = set()
    for line in content.splitlines():
        try:
            found.add(str(json.loads(line)["id"]))
        except (ValueError, TypeError, KeyError):
            continue
    return frozenset(found)


# The storage of the settings.


def open_storage(settings: "Settings") -> Storage:
    """Open the folder or the bucket. Raises NotInstalled, StoreAway."""
    if not settings.object_store:
        return Storage(settings.data_dir)
    bucket: Storage = load_extra("acromion.app.store.bucket").open_bucket(settings)
    return bucket


def load_extra(module: str, extra: str = "many") -> ModuleType:
    """Import our module that needs the libraries of an extra. Raises NotInstalled."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        raise NotInstalled(name=error.name or "", extra=extra) from error
