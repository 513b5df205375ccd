"""Where recordings and reports are kept, and how a file becomes durable.

    root/uploads/<recording>.part        bytes still arriving
    root/recordings/<recording>          bytes whose arrival was acknowledged
    root/analyses/<analysis>/<attempt>/  the files of one attempt; the job row says which attempt counts

Names on disk are made here; a person's file name is never one. A file counts from the moment its row is
committed, and it is on the disk before: write, fsync, rename, fsync of the folder, commit, answer.
"""

import errno
import hashlib
import os
import secrets
import shutil
import sys
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from app.errors import DiskFull, FileTooLarge, FolderTaken

if sys.platform != "win32":
    import fcntl

COPY_BYTES = 1 << 20


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


class Upload:
    """Bytes on their way in: hashed as they come, kept or discarded as a whole."""

    def __init__(self, part: Path, kept: Path, max_bytes: int) -> None:
        self._part, self._kept, self._max_bytes = part, kept, max_bytes
        self._sha256 = hashlib.sha256()
        self._file: IO[bytes] = part.open("xb")
        self.size_bytes = 0

    def write(self, chunk: bytes) -> None:
        """Take the next bytes.

        Raises
        ------
        FileTooLarge, DiskFull
        """
        self.size_bytes += len(chunk)
        if self.size_bytes > self._max_bytes:
            raise too_large(self.size_bytes, self._max_bytes)
        self._sha256.update(chunk)
        with name_full_disk():
            self._file.write(chunk)

    def keep(self) -> StoredRecording:
        """Make the bytes durable under their final name."""
        with name_full_disk():
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._part.rename(self._kept)
            sync_folder(self._kept.parent)
        return StoredRecording(self._kept.name, self._sha256.hexdigest(), self.size_bytes)

    def discard(self) -> None:
        """Leave nothing behind; harmless after :meth:`keep`."""
        with suppress(OSError):
            self._file.close()
        self._part.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class Storage:
    """A folder of recordings and reports on this machine."""

    root: Path

    def prepare(self) -> None:
        """Make the folders."""
        for name in ("uploads", "recordings", "analyses"):
            (self.root / name).mkdir(parents=True, exist_ok=True, mode=0o700)

    def open_upload(self, max_bytes: int) -> Upload:
        """Start taking a recording under a new name."""
        name = f"rec_{secrets.token_hex(8)}"
        with name_full_disk():
            return Upload(self.root / "uploads" / f"{name}.part", self.recording(name), max_bytes)

    def adopt(self, path: Path, sha256: str, size_bytes: int) -> StoredRecording:
        """Take a durable file of this machine as a recording; the caller removes it after the commit.

        It keeps its own name until then, so that a crash in between loses nothing.
        """
        stored = StoredRecording(f"rec_{secrets.token_hex(8)}", sha256, size_bytes)
        with name_full_disk():
            os.link(path, self.recording(stored.id))
            sync_folder(self.root / "recordings")
        return stored

    def drop_recording(self, recording_id: str) -> None:
        """Remove the bytes of a recording."""
        self.recording(recording_id).unlink(missing_ok=True)

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""
        shutil.rmtree(self.root / "analyses" / analysis_id, ignore_errors=True)

    def recording(self, recording_id: str) -> Path:
        """Path of a kept recording."""
        return self.root / "recordings" / recording_id

    def attempt(self, analysis_id: str, token: str) -> Path:
        """Folder of one attempt's files."""
        return self.root / "analyses" / analysis_id / token

    def open_attempt(self, analysis_id: str, token: str) -> Path:
        """Make that folder, empty."""
        folder = self.attempt(analysis_id, token)
        folder.mkdir(parents=True)
        return folder

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove what an attempt that does not count has left."""
        shutil.rmtree(self.attempt(analysis_id, token), ignore_errors=True)

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:
        """Refuse before the first byte what would fill the disk.

        Raises
        ------
        DiskFull
            When less is free than ``min_free_bytes`` or three times the announced length.
        """
        if shutil.disk_usage(self.root).free < max(min_free_bytes, 3 * expected_bytes):
            raise DiskFull

    def sweep(self, recordings: Collection[str], attempts: Collection[tuple[str, str]]) -> int:
        """Remove what a crash left: half uploads, files without a row, attempts that do not count.

        Only for the one server of this folder, before it takes uploads. Returns how many were removed.
        """
        parts = list((self.root / "uploads").iterdir())
        orphans = [path for path in (self.root / "recordings").iterdir() if path.name not in recordings]
        for path in [*parts, *orphans]:
            path.unlink()
        stale = [
            folder
            for folder in (self.root / "analyses").glob("*/*")
            if (folder.parent.name, folder.name) not in attempts
        ]
        for folder in stale:
            shutil.rmtree(folder, ignore_errors=True)
        return len(parts) + len(orphans) + len(stale)


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
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(COPY_BYTES):
            digest.update(chunk)
        size_bytes = file.tell()
        os.fsync(file.fileno())
    return ResultFile(path.name, digest.hexdigest(), size_bytes)


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


def too_large(size_bytes: int, max_bytes: int) -> FileTooLarge:
    """Say it in gigabytes, as people do."""
    return FileTooLarge(n=round(size_bytes / 1e9, 2), max=round(max_bytes / 1e9, 2))


@contextmanager
def name_full_disk() -> Iterator[None]:
    """Turn "no space left" into a refusal with a code; let every other error through."""
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull from error
        raise
