"""Recordings and reports in a folder of this machine."""

import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from app.storage.erasures import LEDGER_FILE, FolderLedger
from app.storage.permissions import FILE_MODE, FOLDER_MODE, create_file, make_folder
from app.storage.store import (
    COPY_BYTES,
    SIDE_SUFFIX,
    UNREADABLE,
    Fetched,
    Mark,
    Upload,
    VerifiedFiles,
    check_free,
    hash_file,
    make_recording_id,
    read_mark,
    read_or_create_id,
    sync_file,
    sync_folder,
    translate_disk_full,
)

TEMPORARY = re.compile(r"((rec_)?[0-9a-f]{16}(\.[0-9a-f]{8})?|restored)\.part")
"""The names of our temporary files in ``uploads``; any other file is left alone."""


class FolderWriter:
    """Bytes that arrive in a folder: kept or discarded as a whole."""

    def __init__(self, part: Path, kept: Path) -> None:
        self._part, self._kept = part, kept
        self._file: IO[bytes] = create_file(part)

    def write(self, chunk: bytes) -> None:
        """Write the next bytes.

        Raises
        ------
        DiskFull
        """
        with translate_disk_full():
            self._file.write(chunk)

    def keep(self) -> None:
        """Make the bytes durable under their final name."""
        with translate_disk_full():
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
            self._part.rename(self._kept)
            sync_folder(self._kept.parent)

    def discard(self) -> None:
        """Leave nothing behind; harmless after :meth:`keep`."""
        with suppress(OSError):
            self._file.close()
        self._part.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True)
class FolderStorage:
    """A folder of recordings and reports on this machine; ``Storage`` documents the methods."""

    root: Path
    verified: VerifiedFiles = field(default_factory=VerifiedFiles, compare=False, repr=False)

    @property
    def ledger(self) -> FolderLedger:
        """The ledger of erasures, a file."""
        return FolderLedger(self.root / LEDGER_FILE)

    @property
    def is_local(self) -> bool:
        """Files are read in place."""
        return True

    def prepare(self) -> None:
        """Create missing folders."""
        for name in ("uploads", "recordings", "analyses"):
            make_folder(self.root / name)

    def identify(self) -> str:
        """Give the permanent id of this folder's contents; the first call creates it."""
        return read_or_create_id(self.root / "store.id", "folder")

    def open_upload(self, max_bytes: int) -> Upload:
        """Start an upload of a recording under a new name."""
        recording_id = make_recording_id()
        part = self.root / "uploads" / f"{recording_id}.part"
        with translate_disk_full():
            return Upload(recording_id, FolderWriter(part, self.recording(recording_id)), max_bytes)

    def recording(self, recording_id: str) -> Path:
        """Give the path of a recording."""
        return self.root / "recordings" / recording_id

    def adopt(self, path: Path, recording_id: str) -> None:
        """Give a durable file of this disk a second name, as a recording; the caller removes the first."""
        with translate_disk_full(), suppress(FileExistsError):  # a peer, or a crash, has linked it before
            os.link(path, self.recording(recording_id))
        sync_folder(self.root / "recordings")

    def fetch(self, name: str) -> Fetched:
        """Return the file in place."""
        mark = read_mark(self.root / name)
        return Fetched(self.root / name, mark, mark)

    def hash(self, name: str) -> tuple[str, Mark]:
        """Return the SHA-256 of a file, and its size, time and inode."""
        mark = read_mark(self.root / name)
        return hash_file(self.root / name), mark

    def read_part(self, name: str, first_byte: int, count: int) -> bytes:
        """Return a part of a file."""
        with (self.root / name).open("rb") as file:
            file.seek(first_byte)
            return file.read(count)

    def find_mark(self, name: str) -> Mark | None:
        """Return size, time and inode of a file; None where it cannot be read."""
        try:
            mark = read_mark(self.root / name)
            with (self.root / name).open("rb"):
                return mark
        except OSError as error:
            if error.errno not in UNREADABLE:
                raise
            return None

    def drop_recording(self, recording_id: str) -> None:
        """Remove a recording, then its side file; no harm when they are gone."""
        for name in (recording_id, f"{recording_id}{SIDE_SUFFIX}"):
            if self.recording(name).is_dir():  # not ours
                self.quarantine(name)
            self.recording(name).unlink(missing_ok=True)
        for path in (self.root / "quarantine").glob(f"{recording_id}.*{SIDE_SUFFIX}"):
            path.unlink()
        sync_folder(self.root / "recordings")

    def put(self, path: Path, name: str) -> None:
        """Copy a file to its name in the store, whole or not at all."""
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

    def attempt(self, analysis_id: str, token: str) -> Path:
        """Give the folder of one attempt's files."""
        return self.root / "analyses" / analysis_id / token

    def open_attempt(self, analysis_id: str, token: str) -> Path:
        """Create that folder, empty."""
        folder = self.attempt(analysis_id, token)
        with translate_disk_full():
            make_folder(folder.parent)
            folder.mkdir(mode=FOLDER_MODE)
        return folder

    def keep_attempt(self, analysis_id: str, token: str) -> None:
        """Make the files durable, in their final folder."""
        folder = self.attempt(analysis_id, token)
        with translate_disk_full():
            for path in folder.iterdir():
                path.chmod(FILE_MODE)
                sync_file(path)
            for changed in (folder, folder.parent, folder.parent.parent):
                sync_folder(changed)

    def release(self, path: Path) -> None:
        """Do nothing: files are read in place."""

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove the files of an attempt that does not count."""
        shutil.rmtree(self.attempt(analysis_id, token), ignore_errors=True)

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""
        shutil.rmtree(self.root / "analyses" / analysis_id, ignore_errors=True)

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:
        """Refuse an upload that would fill the disk, before its first byte.

        Raises
        ------
        DiskFull
            Less is free than ``min_free_bytes`` or three times the announced length.
        """
        check_free(self.root, max(min_free_bytes, 3 * expected_bytes))

    def find_names(self) -> Iterator[str]:
        """Give the name of every stored recording and result."""
        for kind in ("recordings", "analyses"):
            for path in (self.root / kind).rglob("*"):
                if path.is_file():
                    yield path.relative_to(self.root).as_posix()

    def find_recordings(self) -> frozenset[str]:
        """Give every name among the recordings, those of side files too."""
        with os.scandir(self.root / "recordings") as entries:
            return frozenset(entry.name for entry in entries)

    def write_small(self, name: str, content: bytes) -> None:
        """Write a small file, durably, whole or not at all."""
        part = self.root / "uploads" / f"{secrets.token_hex(8)}.part"
        with translate_disk_full():
            make_folder((self.root / name).parent)
            with create_file(part) as file:
                file.write(content)
            sync_file(part)
            part.rename(self.root / name)
            sync_folder((self.root / name).parent)

    def read_small(self, name: str) -> bytes | None:
        """Read a small file; None where there is none."""
        path = self.root / name
        try:
            return path.read_bytes() if path.is_file() else None  # a foreign pipe would block
        except FileNotFoundError:
            return None

    def quarantine(self, name: str) -> bool:
        """Move an unknown entry of the recordings into quarantine, under a name that is free there."""
        quarantine = self.root / "quarantine"
        make_folder(quarantine)
        kept = quarantine / name
        if kept.exists() or kept.is_symlink():
            kept = quarantine / f"{name}.{secrets.token_hex(4)}"
        (self.root / "recordings" / name).rename(kept)
        sync_folder(quarantine)
        sync_folder(self.root / "recordings")
        return True

    def unquarantine(self, name: str) -> bool:
        """Move a recording back from quarantine."""
        (self.root / "quarantine" / name).rename(self.recording(name))
        sync_folder(self.root / "recordings")
        return True

    def find_quarantined(self) -> tuple[str, ...]:
        """Give the names of everything in quarantine."""
        try:
            return tuple(sorted(os.listdir(self.root / "quarantine")))  # noqa: PTH208 - names are all we need
        except FileNotFoundError:
            return ()

    def find_attempts(self) -> tuple[tuple[str, str], ...]:
        """Give the folders of attempts: (analysis, token)."""
        folders = (path for path in (self.root / "analyses").glob("*/*") if path.is_dir())
        return tuple((path.parent.name, path.name) for path in folders)

    def drop_temporary(self, min_age_s: float) -> int:
        """Remove our temporary files that nobody has written to for so long; gives their number."""
        newest_s = time.time() - min_age_s
        old = [
            path
            for path in (self.root / "uploads").iterdir()
            if TEMPORARY.fullmatch(path.name) and path.is_file() and path.stat().st_mtime <= newest_s
        ]
        for path in old:
            path.unlink(missing_ok=True)
        return len(old)
