"""The store that everybody uses: bytes in clear outside, sealed in the folder or bucket.

A recording is sealed with its own key as it comes, the files of its analyses with the same key when they
are kept. Whatever is fetched is opened into a copy that is removed after its use (:mod:`app.storage.opened`).
What an earlier release stored in clear is read as it is, until :func:`SealedStorage.seal` has sealed it.
"""

import hashlib
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from app.errors import KeyGone, StoreDamaged
from app.storage.byte_store import ByteStore, ByteWriter
from app.storage.keys import KeyStore, RecordingKey
from app.storage.opened import OpenedFiles
from app.storage.permissions import create_file
from app.storage.sealed import HEAD_BYTES, SealedFile, Sealer, measure_content, read_head
from app.storage.store import (
    COPY_BYTES,
    BrokenSeal,
    Fetched,
    Mark,
    StoredRecording,
    VerifiedFiles,
    find_owner,
    format_recording_name,
    hash_file,
    read_mark,
    too_large,
    translate_disk_full,
)

SMALL_SEALED = b"\x01"
LIBRARY = "library"
"""The id of the key of small files that belong to no single recording."""


class SealedUpload:
    """Bytes that arrive: hashed, sealed, and sent on. Their key is in memory alone until they are kept."""

    def __init__(self, keys: KeyStore, recording_id: str, writer: ByteWriter, max_bytes: int) -> None:
        self._keys, self._key, self._max_bytes = keys, keys.new(recording_id), max_bytes
        self._writer, self._sha256 = writer, hashlib.sha256()
        self._sealer = Sealer(writer.write, self._key)

    @property
    def size_bytes(self) -> int:
        """How many bytes have come."""
        return self._sealer.size_bytes

    def write(self, chunk: bytes) -> None:
        """Take the next bytes.

        Raises
        ------
        FileTooLarge, DiskFull, StoreAway
        """
        if self.size_bytes + len(chunk) > self._max_bytes:
            raise too_large(self.size_bytes + len(chunk), self._max_bytes)
        self._sha256.update(chunk)
        self._sealer.write(chunk)

    def keep(self) -> StoredRecording:
        """Make first the key durable, then the bytes."""
        self._sealer.close()
        with translate_disk_full():
            self._keys.keep(self._key)
        self._writer.keep()
        return StoredRecording(self._key.id, self._sha256.hexdigest(), self.size_bytes)

    def discard(self) -> None:
        """Leave nothing behind; harmless after :meth:`keep`."""
        self._writer.discard()


@dataclass(frozen=True, slots=True)
class SealedStorage:
    """A folder or a bucket behind seals; :class:`app.storage.store.Storage` documents the methods."""

    inner: ByteStore
    keys: KeyStore
    verified: VerifiedFiles = field(default_factory=VerifiedFiles, compare=False, repr=False)
    opened: OpenedFiles = field(init=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "opened", OpenedFiles(self.inner.root / "opened"))

    @property
    def is_local(self) -> bool:
        """Reading goes over no network."""
        return self.inner.is_local

    @property
    def root(self) -> Path:
        """The folder of this machine."""
        return self.inner.root

    def prepare(self) -> None:
        """Prepare the store, and check that the organisation's key is the one that it was."""
        self.inner.prepare()
        self.keys.check()

    def identify(self) -> str:
        """Give the permanent id of this store."""
        return self.inner.identify()

    def open_upload(self, max_bytes: int) -> SealedUpload:
        """Start an upload of a recording under a new name."""
        recording_id = f"rec_{secrets.token_hex(8)}"
        return SealedUpload(self.keys, recording_id, self.inner.open_writer(recording_id), max_bytes)

    def adopt(self, path: Path, sha256: str, size_bytes: int) -> StoredRecording:
        """Store a whole sealed file of this machine under the id of its key; twice does no harm."""
        with path.open("rb") as file:
            head = read_head(file.read(HEAD_BYTES))
        if head is None:
            raise StoreDamaged
        self.inner.adopt(path, head.key_id)
        return StoredRecording(head.key_id, sha256, size_bytes)

    def fetch(self, name: str) -> Fetched:
        """Open a file into a copy, unverified; one of an earlier release is given as it is."""
        found = self.inner.fetch(name)
        try:
            self.opened.hold(found.path)
            with found.path.open("rb") as file:
                head = read_head(file.read(HEAD_BYTES))
                if head is None:
                    return found
                sealed = SealedFile(file, self.keys.get(head.key_id), head)
                path = self.opened.write(sealed.read_pieces())
        except BaseException:
            self.release(found.path)
            raise
        self.release(found.path)
        return Fetched(path, (sealed.size_bytes, *found.mark[1:]), read_mark(path))

    def hash_stored(self, path: Path) -> str:
        """Give the SHA-256 of the content of a file as it is stored.

        Raises
        ------
        BrokenSeal, KeyGone
        """
        with path.open("rb") as file:
            head = read_head(file.read(HEAD_BYTES))
            return (
                hash_file(path) if head is None else SealedFile(file, self.keys.get(head.key_id), head).hash()
            )

    def find_key_id(self, name: str) -> str | None:
        """Give the id of the key that a file was sealed with; None where it is in clear, or not there."""
        found = self.inner.read_start(name, HEAD_BYTES)
        head = None if found is None else read_head(found[0])
        return None if head is None else head.key_id

    def hash(self, name: str) -> tuple[str, Mark]:
        """Give the SHA-256 of a file's content, and its mark, without a copy in clear."""
        with self._reading(name) as (found, sealed):
            if sealed is None:
                return hash_file(found.path), found.mark
            return sealed.hash(), (sealed.size_bytes, *found.mark[1:])

    def read_part(self, name: str, first_byte: int, count: int) -> bytes:
        """Give a part of a file's content, without a copy in clear."""
        with self._reading(name) as (found, sealed):
            if sealed is not None:
                return sealed.read(first_byte, count)
            with found.path.open("rb") as file:
                file.seek(first_byte)
                return file.read(count)

    @contextmanager
    def _reading(self, name: str) -> Iterator[tuple[Fetched, SealedFile | None]]:
        """Give a file as it is stored, and open where it is sealed."""
        found = self.inner.fetch(name)
        try:
            self.opened.hold(found.path)
            with found.path.open("rb") as file:
                head = read_head(file.read(HEAD_BYTES))
                yield found, None if head is None else SealedFile(file, self.keys.get(head.key_id), head)
        finally:
            self.release(found.path)

    def holds(self, recording_id: str) -> bool:
        """Tell whether there are bytes of a recording, in quarantine too."""
        is_stored = self.inner.read_start(format_recording_name(recording_id), 0) is not None
        return is_stored or recording_id in self.inner.find_quarantined()

    def fetch_sealed(self, name: str) -> Path:
        """Give a file as it is stored, for a backup; the caller releases it."""
        found = self.inner.fetch(name)
        self.opened.hold(found.path)
        return found.path

    def find_mark(self, name: str) -> Mark | None:
        """Give the size of a file's content, and what else changes with its bytes; None where it is not."""
        found = self.inner.read_start(name, HEAD_BYTES)
        if found is None or read_head(found[0]) is None:
            return found and found[1]
        return measure_content(int(found[1][0])), *found[1][1:]

    def is_sealed(self, name: str) -> bool:
        """Tell whether a file is stored sealed; False where there is none."""
        found = self.inner.read_start(name, HEAD_BYTES)
        return found is not None and read_head(found[0]) is not None

    def drop_recording(self, recording_id: str) -> None:
        """Remove a recording and its side file, then its key; no harm when they are gone.

        A purge has destroyed the key before; of what was never acknowledged, no bytes without a key are left.
        """
        self.inner.drop_recording(recording_id)
        self.keys.destroy(recording_id)

    def put(self, path: Path, name: str) -> None:
        """Store a file as it is: sealed before, or of a backup."""
        self.inner.put(path, name)

    def seal(self, name: str, recording_id: str, sha256: str) -> bool:
        """Seal a file that was stored in clear; False where it is sealed, missing or not that of its row.

        What is sealed is read again and compared before it takes the place of the other.
        """
        if self.is_sealed(name):
            return False
        try:
            found = self.inner.fetch(name)
        except FileNotFoundError:
            return False
        try:
            self.opened.hold(found.path)
            return self._replace(found.path, name, self.find_key(recording_id), sha256)
        finally:
            self.release(found.path)

    def _replace(self, path: Path, name: str, key: RecordingKey, sha256: str) -> bool:
        part = self.root / "uploads" / f"{secrets.token_hex(8)}.part"
        try:
            _seal_file(path, part, key)
            if _hash_sealed(part, key) != sha256:
                return False
            self.inner.put(part, name)
            return True
        finally:
            part.unlink(missing_ok=True)

    def find_key(self, recording_id: str) -> RecordingKey:
        """Give the key of a recording; one that an earlier release stored in clear gets its first now.

        Raises
        ------
        KeyGone
            It was erased; or its bytes were sealed and their key is not here: no other may take its place.
        """
        found = self.keys.find(recording_id)
        if found is not None:
            return found
        is_lost = self.is_sealed(format_recording_name(recording_id))
        if is_lost or recording_id in self.keys.find_erased():
            raise KeyGone(id=recording_id)
        return self.keys.create(recording_id)

    def open_attempt(self, analysis_id: str, token: str) -> Path:
        """Create an empty folder on this machine for the files of one attempt."""
        return self.inner.open_attempt(analysis_id, token)

    def keep_attempt(self, analysis_id: str, token: str, recording_id: str) -> None:
        """Seal the files of an attempt with the key of its recording, and have them kept."""
        folder = self.root / "analyses" / analysis_id / token
        if folder.is_dir():  # else they are kept already
            key = self.find_key(recording_id)
            for path in sorted(folder.iterdir()):
                _seal_in_place(path, key)
        self.inner.keep_attempt(analysis_id, token)

    def drop_attempt(self, analysis_id: str, token: str) -> None:
        """Remove the files of an attempt that does not count."""
        self.inner.drop_attempt(analysis_id, token)

    def drop_analysis(self, analysis_id: str) -> None:
        """Remove every file of an analysis."""
        self.inner.drop_analysis(analysis_id)

    def release(self, path: Path) -> None:
        """Remove a copy."""
        self.inner.release(path)
        self.opened.release(path)

    def check_space(self, expected_bytes: int, min_free_bytes: int) -> None:
        """Refuse an upload that would fill the disk, before its first byte."""
        self.inner.check_space(expected_bytes, min_free_bytes)

    def find_names(self) -> Iterator[str]:
        """Give the name of every stored recording and result."""
        return self.inner.find_names()

    def find_recordings(self) -> frozenset[str]:
        """Give every name among the recordings, those of side files too."""
        return self.inner.find_recordings()

    def write_small(self, name: str, content: bytes) -> None:
        """Seal and write a small file."""
        owner = find_owner(name)
        key = self.keys.create(LIBRARY) if owner is None else self.find_key(owner)
        self.inner.write_small(name, key.seal(content, name))

    def read_small(self, name: str) -> bytes | None:
        """Read a small file; None where there is none, or none that opens."""
        content = self.inner.read_small(name)
        if content is None or not content.startswith(SMALL_SEALED):
            return content
        key = self.keys.find(find_owner(name) or LIBRARY)
        try:
            return None if key is None else key.open(content, name)
        except BrokenSeal:
            return None

    def is_small_sealed(self, name: str) -> bool:
        """Tell whether a small file is stored sealed; True where there is none."""
        content = self.inner.read_small(name)
        return content is None or content.startswith(SMALL_SEALED)

    def quarantine(self, name: str) -> bool:
        """Move an unknown entry of the recordings into quarantine."""
        return self.inner.quarantine(name)

    def unquarantine(self, name: str) -> bool:
        """Move a recording back from quarantine."""
        return self.inner.unquarantine(name)

    def find_quarantined(self) -> tuple[str, ...]:
        """Give the names of everything in quarantine."""
        return self.inner.find_quarantined()

    def find_attempts(self) -> tuple[tuple[str, str], ...]:
        """Give the folders of attempts on this machine: (analysis, token)."""
        return self.inner.find_attempts()

    def drop_temporary(self, min_age_s: float) -> int:
        """Remove temporary files that nobody has written to for so long, and copies that nobody holds."""
        return self.opened.sweep() + self.inner.drop_temporary(min_age_s)


def _seal_file(path: Path, into: Path, key: RecordingKey) -> None:
    with translate_disk_full(), path.open("rb") as source, create_file(into) as file:
        sealer = Sealer(file.write, key)
        while chunk := source.read(COPY_BYTES):
            sealer.write(chunk)
        sealer.close()


def _seal_in_place(path: Path, key: RecordingKey) -> None:
    """Seal a file unless it is; it is made durable by whoever keeps it."""
    with path.open("rb") as file:
        if read_head(file.read(HEAD_BYTES)) is not None:
            return
    part = path.with_name(f"{path.name}.part")
    part.unlink(missing_ok=True)
    _seal_file(path, part, key)
    part.replace(path)


def _hash_sealed(path: Path, key: RecordingKey) -> str:
    with path.open("rb") as file:
        head = read_head(file.read(HEAD_BYTES))
        return "" if head is None else SealedFile(file, key, head).hash()
