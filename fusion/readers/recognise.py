"""What the content of a file is, so that a refusal can name it."""

import re

from fusion.errors import (
    BlankFile,
    FusionError,
    RefusedXml,
    TooShort,
    UnknownColumns,
    UnknownFormat,
    UnsafeArchive,
    WrongExtension,
)
from fusion.readers.source import Source, read_chunks
from fusion.readers.tables.columns import parse_column_name
from fusion.readers.tables.layout import (
    DELIMITERS,
    SNIFFED_LINES,
    decode_head,
    find_form,
    find_layout,
    split_fields,
)

MAGIC = (
    (b"%PDF-", "PDF"),
    (b"\xd0\xcf\x11\xe0", "Excel/Word (.xls, .doc)"),
    (b"\xff\xd8\xff", "JPEG"),
    (b"\x89PNG", "PNG"),
    (b"GIF8", "GIF"),
    (b"MATLAB", "MATLAB (.mat)"),
    (b"\x1f\x8b", "gzip"),
    (b"Rar!", "RAR"),
    (b"7z\xbc\xaf", "7-Zip"),
    (b"SQLite format 3", "SQLite"),
    (b"PAR1", "Parquet"),
    (b"\x7fELF", "ELF"),
    (b"MZ", "Windows (.exe)"),
)
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
TEXT_EXTENSIONS = (".csv", ".txt", ".tsv", ".dat", ".log")
DEVICE_EXTENSIONS = (".gt3x", ".cwa")


def identify_content(head: bytes) -> str:
    """Give a short name of the content, the same in every language."""
    for magic, name in MAGIC:
        if head.startswith(magic):
            return name
    start = head[:1024].lstrip(b"\xef\xbb\xbf \t\r\n").lower()
    if start.startswith((b"<!doctype html", b"<html")):
        return "HTML"
    if start.startswith(b"<"):
        return "XML"
    if start.startswith((b"{", b"[")):
        return "JSON"
    return "binary" if b"\0" in head and not find_form(head).encoding else "text"


def refuse_blank(source: Source) -> None:
    """Refuse a file of zeros: a logger reserves room on its card before it writes.

    Raises
    ------
    BlankFile
    """
    if any(source.head):
        return
    n_bytes = 0
    for chunk in read_chunks(source):
        if chunk.count(0) < len(chunk):
            return
        n_bytes += len(chunk)
    raise BlankFile(n=n_bytes)


def explain_refusal(source: Source) -> FusionError:
    """The error for bytes that no reader recognised."""
    kind = identify_content(source.head)
    if kind == "gzip":
        return UnsafeArchive(reason="nested")
    if kind == "text":
        return _explain_text(source)
    if kind == "XML" and b"<!doctype" in _COMMENT.sub(b"", source.head).lower():
        return RefusedXml(reason="forbidden")
    return UnknownFormat(kind=kind)


def _explain_text(source: Source) -> FusionError:
    if source.extension == ".gt3x":
        return WrongExtension(ext=".gt3x", kind="text", right=".csv")
    layout = find_layout(decode_head(source))
    if layout is None and has_column_names(source):
        return TooShort(s=0.0)
    if layout is None:
        return UnknownFormat(kind="text")
    return UnknownColumns(list=" | ".join(layout.sample_rows[0])[:200], line=layout.first_line + 1)


def has_column_names(source: Source) -> bool:
    """Whether a line of the head names six channels or more: a table without rows."""
    lines = decode_head(source).split("\n")[:SNIFFED_LINES]
    return any(
        sum(parse_column_name(field).channel in ("acc", "gyr") for field in split_fields(line, mark)) >= 6
        for line in lines
        for mark in DELIMITERS
    )


def check_extension(source: Source, own: str | None) -> None:
    """Refuse a name that contradicts the content; ``own``: the ending of a device's own format.

    Raises
    ------
    WrongExtension
    """
    named = source.extension
    if own is not None and named != own and named in (*TEXT_EXTENSIONS, *DEVICE_EXTENSIONS):
        raise WrongExtension(ext=named, kind=own, right=own)
    if own is None and named in DEVICE_EXTENSIONS:
        raise WrongExtension(ext=named, kind="text", right=".csv")
