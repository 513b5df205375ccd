"""Where recordings and reports are kept, and how a file becomes durable.

    root/uploads/<recording>.part        bytes still arriving
    root/recordings/<recording>          bytes whose arrival was acknowledged
    root/recordings/<recording>.json     its side file: what the rows say of it (:mod:`app.jobs.side_files`)
    root/quarantine/<name>               what lay among the recordings and is unknown; only people remove it
    root/analyses/<analysis>/<attempt>/  the files of one attempt; the job row says which attempt counts

Where many machines work together, recordings and results are objects in a bucket instead
(:mod:`app.objects`), under the same names; the folder then only holds work in hand.

Names on disk are made here; a person's file name is never one. A file counts from the moment its row is
committed, and it is on the disk before: write, fsync, rename, fsync of the folder, commit, answer.
"""

import errno
import hashlib
import os
import secrets
import shutil
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from app.errors import (
    DiskFull,
    FileTooLarge,
    FolderForbidden,
    FolderIsFile,
    FolderReadOnly,
    FolderTaken,
    FolderUnusable,
)

if sys.platform != "win32":
    import fcntl

COPY_BYTES = 1 << 20
SIDE_SUFFIX = ".json"


@dataclass(frozen=True, slots=True)
class StoredRecording:
    """The bytes of one upload, safe on the disk."""

    id: str
    sha256: str
    size_bytes: int


@dataclass(frozen=True, slots=True)
class ResultFile:
    """One file of a finished analysis."""

    name: str
    sha256: str
    size_bytes: int


class Upload(Protocol):
    """Bytes on their way in, hashed as they come."""

    size_bytes: int

    def write(self, chunk: bytes) -> None:
        """Take the next bytes. Raises FileTooLarge, DiskFull, StoreAway."""

    def keep(self) -> StoredRecording:
        """Make the bytes durable under their final name."""

    def discard(self) -> None:
        """Leave nothing behind; harmless after :meth:`keep`."""


class Storage(Protocol):
    """Where recordings and results are: a folder, or a bucket with a folder for the work in hand.

    What is fetched is a file on this machine; give it back when done with it.
    """

    @property
    def root(self) -> Path:
        """The folder of this machine."""

    def prepare(self) -> None:
        """Make what is not there; find out early that the place does not answer."""

    def identify(self) -> str:
        """Give the name of this very store, made once for all."""

    def open_upload(self, max_bytes: int) -> Upload:
        """Start taking a recording under a new name."""

    def adopt(self, path: Path, sha256: str, size_bytes: int) -> StoredRecording:
        """Take a durable file of this machine as a recording; the caller removes it after the commit."""

    def fetch_recording(self, recording_id: str, into: Path) -> Path:
        """Give a recording as a file: ``into`` or, where it is in our folder, in its place."""

    def drop_recording(self, recording_id: str) -> None:
        """Remove a recording, then its side file; no harm when they are gone."""

    def put(self, path: Path, name: str) -> None:
        """Take a durable file of this machine under a name of the store (``recordings/...``)."""

    def open_attempt(self, analysis_id: str, token: str) -> Path:
        """Make an empty folder on this machine for the files of one attempt."""

    def keep_attempt(self, analysis_id: str, token: str) -> None:
        """Make the attempt's files readable from every machine, before its row says that it counts."""

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove what an attempt that does not count has left."""

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""

    def fetch_result(self, analysis_id: str, token: str, name: str) -> Path:
        """Give a result as a file."""

    def give_back(self, path: Path) -> None:
        """Let go of a fetched file."""

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:
        """Refuse before the first byte what would fill the disk. Raises DiskFull."""

    def list_names(self) -> Iterator[str]:
        """Name every recording and every result that is kept, as :meth:`put` takes them."""

    def list_recordings(self) -> frozenset[str]:
        """Name everything that lies among the recordings, side files too."""

    def measure_recording(self, recording_id: str) -> int | None:
        """Give the size of a recording in bytes; None where it is not there."""

    def write_small(self, name: str, content: bytes) -> None:
        """Write a small file under a name of the store, durably, whole or not at all."""

    def read_small(self, name: str) -> bytes | None:
        """Read a small file of the store; None where there is none."""

    def set_aside(self, name: str) -> bool:
        """Move an unknown entry of the recordings into quarantine; False where the store leaves it in place.

        A bucket does: another machine may be about to write the row.
        """

    def take_back(self, name: str) -> bool:
        """Move a recording back from quarantine; False where the store has moved none there."""

    def list_quarantine(self) -> tuple[str, ...]:
        """Name what lies in quarantine."""

    def list_attempts(self) -> tuple[tuple[str, str], ...]:
        """Give the folders of attempts on this machine: (analysis, token)."""

    def drop_temporary(self, min_age_s: float) -> int:
        """Remove temporary files of uploads that nobody has written to for so long; gives their number."""


@contextmanager
def borrow_result(storage: Storage, analysis_id: str, token: str, name: str) -> Iterator[Path]:
    """Lend a result as a file, and give it back."""
    path = storage.fetch_result(analysis_id, token, name)
    try:
        yield path
    finally:
        storage.give_back(path)


@contextmanager
def borrow_recording(storage: Storage, recording_id: str) -> Iterator[Path]:
    """Lend a recording as a file, and give it back."""
    into = storage.root / "uploads" / f"{recording_id}.{secrets.token_hex(4)}.part"
    path = storage.fetch_recording(recording_id, into)
    try:
        yield path
    finally:
        storage.give_back(path)


class FolderLock:
    """Held by the one server of a data folder; the system lets go of it when the process ends."""

    def __init__(self, root: Path) -> None:
        self._file = (root / "server.lock").open("w")
        if sys.platform != "win32":
            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                self._file.close()
                raise FolderTaken(folder=str(root)) from error

    def release(self) -> None:
        """Let another server in."""
        self._file.close()


def seal_folder(folder: Path) -> tuple[ResultFile, ...]:
    """Make every file of a folder durable and say what each holds."""
    files = tuple(_seal_file(path) for path in sorted(folder.iterdir()))
    for changed in (folder, folder.parent, folder.parent.parent):
        sync_folder(changed)
    return files


def _seal_file(path: Path) -> ResultFile:
    sha256 = hash_file(path)
    sync_file(path)
    return ResultFile(path.name, sha256, path.stat().st_size)


def hash_file(path: Path) -> str:
    """Give the SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def check_free(folder: Path, needed_bytes: int) -> None:
    """Raise DiskFull when less than that is free."""
    if shutil.disk_usage(folder).free < needed_bytes:
        raise DiskFull


def write_durably(path: Path, content: bytes) -> None:
    """Write a small file whole or not at all."""
    part = path.with_name(f"{path.name}.{secrets.token_hex(4)}.new")
    part.write_bytes(content)
    sync_file(part)
    part.replace(path)
    sync_folder(path.parent)


def name_once(path: Path, kind: str) -> str:
    """Give the name that stands in a small file, made up when it is first asked for."""
    if not path.exists():
        write_durably(path, f"{kind}-{secrets.token_hex(8)}".encode())
    return path.read_text()


def sync_file(path: Path) -> None:
    """Make the bytes of a file durable."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Make the names in a folder durable (a rename is not, before this)."""
    if sys.platform == "win32":
        return
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def name_side(recording_id: str) -> str:
    """Name the side file of a recording in the store."""
    return f"recordings/{recording_id}{SIDE_SUFFIX}"


def too_large(size_bytes: int, max_bytes: int) -> FileTooLarge:
    """Say it in gigabytes, as people do."""
    return FileTooLarge(n=round(size_bytes / 1e9, 4), max=round(max_bytes / 1e9, 4))


@contextmanager
def name_full_disk() -> Iterator[None]:
    """Turn "no space left" into a refusal with a code; let every other error through."""
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
def name_folder_trouble(folder: Path) -> Iterator[None]:
    """Turn an error of the system about a data folder, or anything in it, into a refusal with a code."""
    try:
        with name_full_disk():
            yield
    except OSError as error:
        place = Path(os.fsdecode(error.filename)) if isinstance(error.filename, (str, bytes)) else folder
        if not (place.is_relative_to(folder) or folder.is_relative_to(place)):
            raise
        kind = _FOLDER_TROUBLE.get(error.errno or 0, FolderUnusable)
        raise kind(folder=str(folder), why=error.strerror or str(error)) from error


def check_folder(folder: Path) -> None:
    """See that a data folder, and each folder of ours in it, can be written.

    Raises
    ------
    FolderUnusable, DiskFull
    """
    with name_folder_trouble(folder):
        for name in ("", "uploads", "recordings", "analyses", "incoming"):
            place = folder / name
            if place.is_dir() or not name:
                with tempfile.TemporaryFile(dir=place):
                    pass
