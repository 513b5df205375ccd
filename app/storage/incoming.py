"""The bytes of resumable uploads (tus): one growing file for each, sealed as it grows.

    root/incoming/<upload>          an unfinished sealed file (:mod:`app.storage.sealed`); its head names the
                                    recording that it will be, whose key exists from the first byte on

Nothing here is a recording. The row of the upload states how many of the bytes count: bytes after them were
written but never acknowledged, and are cut off before more are written. What an earlier release took in clear
is sealed before more is written.
"""

import hashlib
import os
import re
import secrets
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from app.errors import TooMany
from app.storage.keys import KeyStore
from app.storage.permissions import create_file
from app.storage.sealed import (
    HEAD_BYTES,
    PIECE_BYTES,
    Sealer,
    measure_growing,
    measure_grown,
    measure_sealed,
    read_growing,
    read_head,
)
from app.storage.store import COPY_BYTES, BrokenSeal, sync_file, sync_folder, translate_disk_full

_OWN_NAME = re.compile(r"(up_[0-9a-f]{28,32})(\.\w+)?")


class GrowingFile:
    """The file of one upload, open at its offset; the seal is closed by the last of ``length_bytes``."""

    def __init__(self, path: Path, keys: KeyStore, offset_bytes: int, length_bytes: int) -> None:
        self.offset_bytes, self._length_bytes = offset_bytes, length_bytes
        with translate_disk_full():
            self._file: IO[bytes] = path.open("r+b")
            self._sealer = None if offset_bytes == length_bytes else _go_on(self._file, keys, offset_bytes)

    def write(self, chunk: bytes) -> None:
        """Write the next bytes.

        Raises
        ------
        DiskFull
        """
        if self._sealer is None or not chunk:
            return
        with translate_disk_full():
            self._sealer.write(chunk)
            self.offset_bytes += len(chunk)
            if self.offset_bytes == self._length_bytes:
                self._sealer.close()

    def flush(self) -> int:
        """Hand every written byte to the system; gives the offset after them."""
        with translate_disk_full():
            self._file.flush()
        return self.offset_bytes

    def sync(self) -> None:
        """Make every flushed byte durable; more may be written meanwhile."""
        with translate_disk_full():
            os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _go_on(file: IO[bytes], keys: KeyStore, offset_bytes: int) -> Sealer:
    """Cut the file behind an offset, and give what seals the bytes from there on."""
    head = read_head(file.read(HEAD_BYTES))
    if head is None:
        raise BrokenSeal
    sealer = Sealer(file.write, keys.get(head.key_id), head)
    end = measure_growing(offset_bytes)
    file.truncate(end)
    file.seek(end - offset_bytes % PIECE_BYTES)
    sealer.go_on(offset_bytes, file.read())
    return sealer


@dataclass(slots=True)
class UploadSlots:
    """Limits how many uploads run at once: each costs memory while its bytes arrive. For one thread."""

    most: int
    taken: int = 0

    @contextmanager
    def take(self) -> Iterator[None]:
        """Hold a slot until the end of the block.

        Raises
        ------
        TooMany
        """
        if self.taken >= self.most:
            raise TooMany(max=self.most)
        self.taken += 1
        try:
            yield
        finally:
            self.taken -= 1


@dataclass(slots=True)
class _Running:
    """The hash of an upload's first bytes, so that a finished upload need not be read again."""

    sha256: "hashlib._Hash"
    offset_bytes: int


@dataclass(frozen=True, slots=True)
class Incoming:
    """The folder of growing files, and the uploads that have a writer now."""

    folder: Path
    keys: KeyStore
    _busy: set[str] = field(default_factory=set)
    _hashes: dict[str, _Running] = field(default_factory=dict)
    _guard: threading.Lock = field(default_factory=threading.Lock)

    def prepare(self) -> None:
        """Create the folder."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)

    def path(self, upload_id: str) -> Path:
        """Give the path of an upload's sealed bytes."""
        return self.folder / upload_id

    def open(self, upload_id: str, offset_bytes: int, length_bytes: int) -> GrowingFile:
        """Open the file of an upload at its offset, created where there is none.

        Raises
        ------
        DiskFull
        """
        path = self.path(upload_id)
        if not path.exists() or not self._is_sealed(upload_id) or self._is_locked(upload_id):
            self._write_sealed(path, offset_bytes)
        return GrowingFile(path, self.keys, offset_bytes, length_bytes)

    def complete(self, upload_id: str, length_bytes: int) -> None:
        """Close the seal of a whole upload, if it is not yet: one that an earlier release took in clear.

        Raises
        ------
        FileNotFoundError, DiskFull
        """
        path = self.path(upload_id)
        if path.stat().st_size == measure_sealed(length_bytes) and self._is_sealed(upload_id):
            return
        if not self._is_sealed(upload_id):
            self._write_sealed(path, length_bytes)
        with translate_disk_full(), path.open("r+b") as file:
            _go_on(file, self.keys, length_bytes).close()
            file.flush()
            os.fsync(file.fileno())

    def _write_sealed(self, path: Path, size_bytes: int) -> None:
        """Begin a sealed file with the bytes that count of one in clear, if there is one."""
        key = self.keys.create(f"rec_{secrets.token_hex(8)}")
        part = path.with_name(f"{path.name}.{secrets.token_hex(8)}")
        try:
            with translate_disk_full(), create_file(part) as file:
                sealer = Sealer(file.write, key)
                if path.exists():
                    for piece in _read_plain(path, size_bytes):
                        sealer.write(piece)
            with translate_disk_full():
                sync_file(part)
                part.replace(path)
                sync_folder(self.folder)
        finally:
            part.unlink(missing_ok=True)

    def _is_sealed(self, upload_id: str) -> bool:
        with self.path(upload_id).open("rb") as file:
            return read_head(file.read(HEAD_BYTES)) is not None

    def _is_locked(self, upload_id: str) -> bool:
        """Tell whether the bytes were sealed with a key that is not here: they count no more."""
        key_id = self.find_recording_id(upload_id)
        return key_id is not None and self.keys.find(key_id) is None

    def find_recording_id(self, upload_id: str) -> str | None:
        """Give the id of the recording that an upload is to be; None before its first byte."""
        try:
            with self.path(upload_id).open("rb") as file:
                head = read_head(file.read(HEAD_BYTES))
        except FileNotFoundError:
            return None
        return None if head is None else head.key_id

    def measure(self, upload_id: str) -> int:
        """Give the number of an upload's bytes that are on the disk."""
        try:
            size_bytes = self.path(upload_id).stat().st_size
            if not self._is_sealed(upload_id):
                return size_bytes
            return 0 if self._is_locked(upload_id) else measure_grown(size_bytes)
        except FileNotFoundError:
            return 0

    def read_pieces(self, upload_id: str, size_bytes: int) -> Iterator[bytes]:
        """Give the first ``size_bytes`` of an upload, piece by piece.

        Raises
        ------
        FileNotFoundError, BrokenSeal, KeyGone
        """
        path = self.path(upload_id)
        with path.open("rb") as file:
            head = read_head(file.read(HEAD_BYTES))
            if head is None:
                yield from _read_plain(path, size_bytes)
            else:
                yield from read_growing(file, self.keys.get(head.key_id), head, size_bytes)

    def read_first(self, upload_id: str, count: int) -> bytes:
        """Give the first bytes of an upload; none where they cannot be read."""
        with suppress(FileNotFoundError, BrokenSeal):
            return b"".join(self.read_pieces(upload_id, count))
        return b""

    def acquire(self, upload_id: str) -> bool:
        """Become the only writer of an upload; False while there is another."""
        with self._guard:
            is_free = upload_id not in self._busy
            self._busy.add(upload_id)
            return is_free

    def release(self, upload_id: str) -> None:
        """Cease to be the writer of an upload."""
        with self._guard:
            self._busy.discard(upload_id)

    def hash_chunk(self, upload_id: str, offset_bytes: int, chunk: bytes) -> None:
        """Hash bytes that begin at an offset, where the hash of all bytes before it is known."""
        running = self._hashes.get(upload_id)
        if offset_bytes == 0:
            running = self._hashes[upload_id] = _Running(hashlib.sha256(), 0)
        if running is None:
            return
        if running.offset_bytes != offset_bytes:  # bytes that did not count were hashed
            del self._hashes[upload_id]
            return
        running.sha256.update(chunk)
        running.offset_bytes += len(chunk)

    def hash(self, upload_id: str, size_bytes: int) -> str:
        """Give the SHA-256 of a whole upload; it is read again only after a restart of the server."""
        running = self._hashes.get(upload_id)
        if running is not None and running.offset_bytes == size_bytes:
            return running.sha256.hexdigest()
        sha256 = hashlib.sha256()
        for piece in self.read_pieces(upload_id, size_bytes):
            sha256.update(piece)
        return sha256.hexdigest()

    def forget(self, upload_id: str) -> None:
        """Remove the bytes of an upload; the key is that of the recording, if it is one now."""
        self._hashes.pop(upload_id, None)
        self.path(upload_id).unlink(missing_ok=True)

    def find_stale(
        self, growing: Collection[str], known: Collection[str], min_age_s: float
    ) -> frozenset[str]:
        """Find the known uploads that have ended, and old unknown ones, of which there are files.

        Any file that is not ours is left alone.
        """
        newest_s = time.time() - min_age_s
        return frozenset(
            found[1]
            for path in self.folder.iterdir()
            if (found := _OWN_NAME.fullmatch(path.name)) and found[1] not in growing and path.is_file()
            if found[1] in known or path.stat().st_mtime <= newest_s
        )

    def sweep(self, upload_id: str) -> int:
        """Remove every file of an upload; gives their number."""
        left = [path for path in self.folder.glob(f"{upload_id}*") if _OWN_NAME.fullmatch(path.name)]
        for path in left:
            path.unlink(missing_ok=True)
        return len(left)


def _read_plain(path: Path, size_bytes: int) -> Iterator[bytes]:
    """Give the first bytes of a file in clear."""
    with path.open("rb") as file:
        while piece := file.read(min(COPY_BYTES, size_bytes)):
            size_bytes -= len(piece)
            yield piece
