"""The bytes of resumable uploads (tus): one growing file each.

 root/incoming/<upload>          the received bytes

Nothing here is a recording. The row of the upload states how many bytes count: later bytes were written but
never acknowledged, and are truncated before more are written.
"""

import hashlib
import os
import re
import threading
import time
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from acromion.app.errors import TooMany
from acromion.app.store.folder import sync_folder, translate_disk_full
from acromion.app.store.permissions import create_file

_OWN_NAME = re.compile(r"(up_[0-9a-f]{28,32})(\.\w+)?")


class GrowingFile:
    """The file of one upload, open at its offset."""

    def __init__(self, path: Path, offset_bytes: int) -> None:
        self.offset_bytes = offset_bytes
        with translate_disk_full():
            self._file: IO[bytes] = path.open("r+b")
            self._file.truncate(offset_bytes)
            self._file.seek(offset_bytes)

    def write(self, chunk: bytes) -> None:
        """Write the next bytes. Raises DiskFull."""
        with translate_disk_full():
            self._file.write(chunk)
        self.offset_bytes += len(chunk)

    def flush(self) -> int:
        """Pass every written byte to the system; return the offset after them."""
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


@dataclass(slots=True)
class UploadSlots:
    """Limits how many uploads run at once, because each costs memory while its bytes arrive. For one thread.

    The last quarter is for people without a running upload: one person with many slow uploads blocks nobody.
    """

    most: int
    taken: Counter[str] = field(default_factory=Counter)

    @contextmanager
    def take(self, who: str) -> Iterator[None]:
        """Hold a slot for ``who`` until the end of the block. Raises TooMany."""
        taken = self.taken.total()
        if taken >= (self.most * 3 // 4 if self.taken[who] else self.most):
            raise TooMany(max=self.most)
        self.taken[who] += 1
        try:
            yield
        finally:
            self.taken[who] -= 1
            self.taken += Counter()  # drops zeros


@dataclass(slots=True)
class _Running:
    """The hash of an upload's first bytes, so that a finished upload need not be read again."""

    sha256: "hashlib._Hash"
    offset_bytes: int


@dataclass(frozen=True, slots=True)
class Incoming:
    """The folder of growing files, and the uploads with a current writer."""

    folder: Path
    _busy: set[str] = field(default_factory=set)
    _hashes: dict[str, _Running] = field(default_factory=dict)
    _guard: threading.Lock = field(default_factory=threading.Lock)

    def prepare(self) -> None:
        """Create the folder."""
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)

    def path(self, upload_id: str) -> Path:
        """Return the path of an upload's bytes."""
        return self.folder / upload_id

    def open(self, upload_id: str, offset_bytes: int) -> GrowingFile:
        """Open the file of an upload at its offset; create it if needed. Raises DiskFull."""
        with translate_disk_full(), suppress(FileExistsError):
            create_file(self.path(upload_id)).close()
            sync_folder(self.folder)
        return GrowingFile(self.path(upload_id), offset_bytes)

    def measure(self, upload_id: str) -> int:
        """Return the number of an upload's bytes on disk."""
        try:
            return self.path(upload_id).stat().st_size
        except FileNotFoundError:
            return 0

    def read_first(self, upload_id: str, count: int) -> bytes:
        """Return the first bytes of an upload; empty if there are none yet."""
        try:
            with self.path(upload_id).open("rb") as file:
                return file.read(count)
        except FileNotFoundError:
            return b""

    def acquire(self, upload_id: str) -> bool:
        """Become the only writer of an upload; return False if there is another."""
        with self._guard:
            is_free = upload_id not in self._busy
            self._busy.add(upload_id)
            return is_free

    def release(self, upload_id: str) -> None:
        """Stop being the writer of an upload."""
        with self._guard:
            self._busy.discard(upload_id)

    def hash_chunk(self, upload_id: str, offset_bytes: int, chunk: bytes) -> None:
        """Hash bytes at an offset, if the hash of all bytes before it is known."""
        running = self._hashes.get(upload_id)
        if offset_bytes == 0:
            running = self._hashes[upload_id] = _Running(hashlib.sha256(), 0)
        if running is None:
            return
        if running.offset_bytes != offset_bytes:  # hashed bytes that were not acknowledged
            del self._hashes[upload_id]
            return
        running.sha256.update(chunk)
        running.offset_bytes += len(chunk)

    def hash(self, upload_id: str, size_bytes: int) -> str:
        """Return the SHA-256 of a whole upload; it is read again only after a restart of the server.

        Bytes after the last acknowledged one are truncated. Raises FileNotFoundError.
        """
        with self.path(upload_id).open("r+b") as file:
            if os.fstat(file.fileno()).st_size > size_bytes:
                file.truncate(size_bytes)
                os.fsync(file.fileno())
            running = self._hashes.get(upload_id)
            if running is not None and running.offset_bytes == size_bytes:
                return running.sha256.hexdigest()
            return hashlib.file_digest(file, "sha256").hexdigest()

    def forget(self, upload_id: str) -> None:
        """Remove the bytes of an upload."""
        self._hashes.pop(upload_id, None)
        self.path(upload_id).unlink(missing_ok=True)

    def find_stale(
        self, growing: Collection[str], known: Collection[str], min_age_s: float
    ) -> frozenset[str]:
        """Find files of known uploads that have ended, and old files of unknown ones.

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
        """Remove every file of an upload; return their number."""
        left = [path for path in self.folder.glob(f"{upload_id}*") if _OWN_NAME.fullmatch(path.name)]
        for path in left:
            path.unlink(missing_ok=True)
        return len(left)


def name_recording(upload_id: str) -> str:
    """Return the id of the recording from an upload; repeated calls return the same id."""
    return f"rec_{upload_id.removeprefix('up_')[:16]}"
