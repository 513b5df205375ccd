"""Text as pieces of whole lines in bytes, whatever its encoding and line ends."""

import codecs
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.errors import UnknownFormat
from fusion.readers.source import Source, read_chunks
from fusion.readers.text_words import LEAD_BYTES, NEWLINE, TRAIL_BYTES

TEXT_CHUNK_BYTES = 1 << 20
"""Small enough that a piece and its field ends stay in the processor's cache."""
MAX_LINE_BYTES = 1 << 16
UTF8_MARK = codecs.BOM_UTF8
UTF16_MARKS = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


@dataclass(frozen=True, slots=True)
class TextForm:
    """How the bytes become lines: encoding (None: bytes as they are), byte order mark, line end."""

    encoding: str | None
    mark_bytes: int
    is_return_only: bool


@dataclass(frozen=True, slots=True, eq=False)
class LinePiece:
    """Whole lines: ``buffer[first:stop]``, with room before and after as ``text_words`` needs it."""

    buffer: NDArray[np.uint8]
    first: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.first


def find_form(head: bytes) -> TextForm:
    """Judge by the first bytes."""
    encoding = UTF16_MARKS.get(head[:2])
    mark_bytes = 2 if encoding else len(UTF8_MARK) if head.startswith(UTF8_MARK) else 0
    is_return_only = encoding is None and b"\r" in head and b"\n" not in head
    return TextForm(encoding, mark_bytes, is_return_only)


def decode_head(source: Source, form: TextForm) -> str:
    """Return the head as text with newlines; undecodable bytes become Windows-1252 characters."""
    content = source.head[form.mark_bytes :]
    if form.is_return_only:
        content = content.replace(b"\r", b"\n")
    if form.encoding:
        return content[: len(content) // 2 * 2].decode(form.encoding, errors="replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start >= len(content) - 3:
            return content[: error.start].decode("utf-8")
        return content.decode("cp1252", errors="replace")


def read_text_pieces(source: Source, form: TextForm) -> Iterator[bytes]:
    """Pieces in an encoding whose first 128 characters are ASCII, with newlines only."""
    decoder = codecs.getincrementaldecoder(form.encoding)(errors="replace") if form.encoding else None
    for chunk in read_chunks(source, form.mark_bytes, TEXT_CHUNK_BYTES):
        piece = decoder.decode(chunk).encode() if decoder else chunk
        yield piece.replace(b"\r", b"\n") if form.is_return_only else piece


def read_line_pieces(pieces: Iterable[bytes]) -> Iterator[LinePiece]:
    """Cut pieces at line ends; a last line without one is given one.

    Most lines are left where they lie. Only those at the seams are copied: a line that goes on in the next
    piece, and those too near the ends of the bytes for :mod:`fusion.readers.text_words`.

    Raises
    ------
    UnknownFormat
        A line is longer than 64 KiB: not a table of samples.
    """
    carried = b""
    for piece in pieces:
        cut = piece.find(b"\n", LEAD_BYTES) + 1
        end = piece.rfind(b"\n", cut, max(cut, len(piece) - TRAIL_BYTES)) + 1
        if end == 0:
            end = cut = piece.rfind(b"\n") + 1
        if cut == 0:
            carried += piece
        else:
            yield copy_lines(carried + piece[:cut])
            if end > cut:
                yield LinePiece(np.frombuffer(piece, np.uint8), cut, end)
            carried = piece[end:]
        _refuse_long(carried)
    if carried:
        yield copy_lines(carried if carried.endswith(b"\n") else carried + b"\n")


def copy_lines(lines: bytes) -> LinePiece:
    """Give whole lines the room around them that the kernels need."""
    padded = bytes(LEAD_BYTES) + lines + bytes(TRAIL_BYTES)
    return LinePiece(np.frombuffer(padded, np.uint8), LEAD_BYTES, LEAD_BYTES + len(lines))


def _refuse_long(carried: bytes) -> None:
    if len(carried) - carried.rfind(b"\n") > MAX_LINE_BYTES:
        raise UnknownFormat(kind="text", line=1)


def drop_lines(pieces: Iterable[LinePiece], count: int) -> Iterator[LinePiece]:
    """Leave out the first ``count`` lines."""
    for piece in pieces:
        if count == 0:
            yield piece
            continue
        ends = np.flatnonzero(piece.buffer[piece.first : piece.stop] == NEWLINE) + piece.first + 1
        first = int(ends[min(count, len(ends)) - 1])
        count -= min(count, len(ends))
        if first < piece.stop:
            yield LinePiece(piece.buffer, first, piece.stop)
