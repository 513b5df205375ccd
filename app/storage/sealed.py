"""Sealed files: pieces of 1 MiB, each sealed by itself, so that any part can be read alone.

    head      16 bytes that tell a sealed file, 32 of salt, 32 with the id of the key (a recording's)
    pieces    the content in pieces of 1 MiB, each followed by its tag; the last one may be shorter
    closing   the tag of an empty piece that states the length

AES-256-GCM. The key of a file is derived from the recording's with the file's own salt, and the nonce of a
piece is its place: pieces of one file, or of two, cannot be exchanged, and a file without its closing is not
whole. A file can be written as its bytes come and gone on with at any byte: what stands in an unfinished
piece is its ciphertext already, only the tag is missing. (Bytes that were written, did not count, and come
again with another content are sealed with the same stream: a copy of the disk in between could be compared.)
"""

import hashlib
import io
import os
import secrets
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import IO, Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers import Cipher
from cryptography.hazmat.primitives.ciphers.aead import AESGCM
from cryptography.hazmat.primitives.ciphers.algorithms import AES
from cryptography.hazmat.primitives.ciphers.modes import CTR, GCM

from app.storage.keys import TAG_BYTES, RecordingKey
from app.storage.store import BrokenSeal

MAGIC = b"acromion.sealed\x01"
SALT_BYTES, ID_BYTES = 32, 32
HEAD_BYTES = len(MAGIC) + SALT_BYTES + ID_BYTES
PIECE_BYTES = 1 << 20
_SEALED_BYTES = PIECE_BYTES + TAG_BYTES
_PIECE, _CLOSING = b"\0\0\0\0", b"\0\0\0\1"
_FIRST_BLOCK = (2).to_bytes(4, "big")  # GCM counts the blocks of its content from 2


@dataclass(frozen=True, slots=True)
class Head:
    """The first bytes of a sealed file: the id of its key, and its salt."""

    key_id: str
    salt: bytes

    def encode(self) -> bytes:
        """Give the bytes."""
        return MAGIC + self.salt + self.key_id.encode().ljust(ID_BYTES, b"\0")


def read_head(content: bytes) -> Head | None:
    """Read the head from a file's first bytes; None where the file is not sealed."""
    if len(content) < HEAD_BYTES or not content.startswith(MAGIC):
        return None
    salt, name = content[len(MAGIC) :][:SALT_BYTES], content[HEAD_BYTES - ID_BYTES : HEAD_BYTES]
    return Head(name.rstrip(b"\0").decode("ascii", "replace"), salt)


def measure_sealed(size_bytes: int) -> int:
    """Give the size of a sealed file by that of its content."""
    return HEAD_BYTES + size_bytes + TAG_BYTES * (-(-size_bytes // PIECE_BYTES) + 1)


def measure_content(sealed_bytes: int) -> int:
    """Give the size of the content by that of a whole sealed file; -1 where no such file has this size."""
    pieces, rest = divmod(sealed_bytes - HEAD_BYTES - TAG_BYTES, _SEALED_BYTES)
    if pieces < 0 or 0 < rest <= TAG_BYTES:
        return -1
    return pieces * PIECE_BYTES + max(0, rest - TAG_BYTES)


def measure_growing(size_bytes: int) -> int:
    """Give the place in an unfinished file where the byte after so much content goes."""
    return HEAD_BYTES + size_bytes + TAG_BYTES * (size_bytes // PIECE_BYTES)


def measure_grown(sealed_bytes: int) -> int:
    """Give the most content that an unfinished file of this size can hold."""
    pieces, rest = divmod(max(0, sealed_bytes - HEAD_BYTES), _SEALED_BYTES)
    return pieces * PIECE_BYTES + min(rest, PIECE_BYTES)


class Sealer:
    """Seals content as it comes; ``write`` takes the sealed bytes, the head first where the file is new."""

    def __init__(self, write: Callable[[bytes], object], key: RecordingKey, head: Head | None = None) -> None:
        self._write = write
        self.head = head or Head(key.id, secrets.token_bytes(SALT_BYTES))
        self._secret = key.derive(self.head.salt, b"file")
        self.size_bytes = 0
        self._piece: Any = None
        if head is None:
            write(self.head.encode())

    def go_on(self, size_bytes: int, begun: bytes) -> None:
        """Go on after so much content; ``begun`` is what the file holds of an unfinished piece, sealed."""
        self.size_bytes = size_bytes
        if begun:
            self._piece = self._begin(size_bytes // PIECE_BYTES)
            self._piece.update(_open_begun(self._secret, size_bytes // PIECE_BYTES, begun))

    def write(self, chunk: bytes | memoryview) -> None:
        """Seal the next bytes of the content."""
        view = memoryview(chunk)
        while view:
            place = self.size_bytes % PIECE_BYTES
            if self._piece is None:
                self._piece = self._begin(self.size_bytes // PIECE_BYTES)
            part, view = view[: PIECE_BYTES - place], view[PIECE_BYTES - place :]
            self._write(self._piece.update(part))
            self.size_bytes += len(part)
            if self.size_bytes % PIECE_BYTES == 0:
                self._end_piece()

    def close(self) -> None:
        """End the file: from then on it is whole, and nothing can be added."""
        if self._piece is not None:
            self._end_piece()
        self._write(_seal_closing(self._secret, self.size_bytes))

    def _begin(self, index: int) -> Any:
        return Cipher(AES(self._secret), GCM(_make_nonce(index, _PIECE))).encryptor()

    def _end_piece(self) -> None:
        self._piece.finalize()
        self._write(self._piece.tag)
        self._piece = None


class SealedFile:
    """A whole sealed file, open for reading."""

    def __init__(self, file: IO[bytes], key: RecordingKey, head: Head) -> None:
        """Check the closing.

        Raises
        ------
        BrokenSeal
            The file is not whole, or was sealed with another key.
        """
        self._file, self._secret = file, key.derive(head.salt, b"file")
        sealed_bytes = file.seek(0, os.SEEK_END)
        self.size_bytes = measure_content(sealed_bytes)
        file.seek(sealed_bytes - TAG_BYTES)
        if self.size_bytes < 0 or file.read() != _seal_closing(self._secret, self.size_bytes):
            raise BrokenSeal

    def read_pieces(self, first_byte: int = 0) -> Iterator[bytes]:
        """Give the content from a byte on, piece by piece.

        Raises
        ------
        BrokenSeal
            Altered bytes are never given.
        """
        opener = AESGCM(self._secret)
        first = first_byte // PIECE_BYTES
        self._file.seek(HEAD_BYTES + first * _SEALED_BYTES)
        for index in range(first, -(-self.size_bytes // PIECE_BYTES)):
            content_bytes = min(PIECE_BYTES, self.size_bytes - index * PIECE_BYTES)
            sealed = self._file.read(content_bytes + TAG_BYTES)
            try:
                piece = opener.decrypt(_make_nonce(index, _PIECE), sealed, None)
            except (InvalidTag, ValueError):
                raise BrokenSeal from None
            yield piece[first_byte - index * PIECE_BYTES :] if first_byte > index * PIECE_BYTES else piece

    def read(self, first_byte: int, count: int) -> bytes:
        """Give up to ``count`` bytes of the content from a byte on.

        Raises
        ------
        BrokenSeal
        """
        found = bytearray()
        for piece in self.read_pieces(first_byte):
            found += piece[: count - len(found)]
            if len(found) >= count:
                break
        return bytes(found)

    def hash(self) -> str:
        """Give the SHA-256 of the content.

        Raises
        ------
        BrokenSeal
        """
        sha256 = hashlib.sha256()
        for piece in self.read_pieces():
            sha256.update(piece)
        return sha256.hexdigest()


class _Stream(io.RawIOBase):
    """The content of a sealed file, from its first byte to its last."""

    def __init__(self, pieces: Iterator[bytes]) -> None:
        self._pieces, self._piece = pieces, memoryview(b"")

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        if not self._piece:
            self._piece = memoryview(next(self._pieces, b""))
        count = min(len(buffer), len(self._piece))
        buffer[:count], self._piece = self._piece[:count], self._piece[count:]
        return count


def open_stream(file: IO[bytes], key: RecordingKey) -> IO[bytes]:
    """Open a sealed file to read its content from the first byte to the last.

    Raises
    ------
    BrokenSeal
        It is not sealed, or not with this key; from the reading too.
    """
    head = read_head(file.read(HEAD_BYTES))
    if head is None:
        raise BrokenSeal
    return io.BufferedReader(_Stream(SealedFile(file, key, head).read_pieces()), PIECE_BYTES)


def read_growing(file: IO[bytes], key: RecordingKey, head: Head, size_bytes: int) -> Iterator[bytes]:
    """Give the first ``size_bytes`` of the content of an unfinished file, piece by piece.

    The tags of its whole pieces are checked; an unfinished one has none yet.

    Raises
    ------
    BrokenSeal
    """
    secret = key.derive(head.salt, b"file")
    opener = AESGCM(secret)
    file.seek(HEAD_BYTES)
    for index in range(size_bytes // PIECE_BYTES):
        try:
            yield opener.decrypt(_make_nonce(index, _PIECE), file.read(_SEALED_BYTES), None)
        except (InvalidTag, ValueError):
            raise BrokenSeal from None
    rest = file.read(size_bytes % PIECE_BYTES)
    if rest:
        yield _open_begun(secret, size_bytes // PIECE_BYTES, rest)


def _open_begun(secret: bytes, index: int, begun: bytes) -> bytes:
    """Open the bytes of an unfinished piece: inside, GCM is a plain stream of counted blocks."""
    counter = CTR(_make_nonce(index, _PIECE) + _FIRST_BLOCK)
    return Cipher(AES(secret), counter).decryptor().update(begun)


def _seal_closing(secret: bytes, size_bytes: int) -> bytes:
    nonce = _make_nonce(-(-size_bytes // PIECE_BYTES), _CLOSING)
    return AESGCM(secret).encrypt(nonce, b"", size_bytes.to_bytes(8, "big"))


def _make_nonce(index: int, kind: bytes) -> bytes:
    return index.to_bytes(8, "big") + kind
