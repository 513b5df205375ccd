"""Text as pieces of whole lines in bytes, whatever its encoding and line ends."""

import codecs
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from fusion.errors import UnknownFormat
from fusion.readers.source import Source, read_chunks

MAX_LINE_BYTES = 1 << 16
UTF8_MARK = codecs.BOM_UTF8
UTF16_MARKS = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


@dataclass(frozen=True, slots=True)
class TextForm:
    """How the bytes become lines: encoding (None: bytes as they are), byte order mark, line end."""

    encoding: str | None
    mark_bytes: int
    is_return_only: bool


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
    for chunk in read_chunks(source, form.mark_bytes):
        piece = decoder.decode(chunk).encode() if decoder else chunk
        yield piece.replace(b"\r", b"\n") if form.is_return_only else piece


def read_line_pieces(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Cut pieces at line ends; a last line without one is given one.

    Raises
    ------
    UnknownFormat
        A line is longer than 64 KiB: not a table of samples.
    """
    carried = b""
    for piece in pieces:
        cut = piece.rfind(b"\n") + 1
        if cut == 0:
            carried += piece
        else:
            yield carried + piece[:cut] if carried else piece[:cut]
            carried = piece[cut:]
        if len(carried) > MAX_LINE_BYTES:
            raise UnknownFormat(kind="text", line=1)
    if carried:
        yield carried + b"\n"


def drop_bytes(pieces: Iterable[bytes], count: int) -> Iterator[bytes]:
    """Leave out the first ``count`` bytes."""
    for piece in pieces:
        if count < len(piece):
            yield piece[count:]
        count = max(0, count - len(piece))
