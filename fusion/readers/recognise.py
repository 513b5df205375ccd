"""What the content of a file is, so that a refusal can name it."""

import re
from collections.abc import Sequence

from fusion.errors import (
    BlankFile,
    FusionError,
    NoGyroscope,
    NoSamples,
    RefusedXml,
    UnknownColumns,
    UnknownFormat,
    UnsafeArchive,
    WrongExtension,
)
from fusion.readers.source import Source, read_chunks
from fusion.readers.tables.columns import name_missing, parse_column_name, read_axis
from fusion.readers.tables.layout import (
    DELIMITERS,
    MIN_COLUMNS,
    SNIFFED_LINES,
    TextLayout,
    decode_head,
    find_form,
    find_layout,
    split_fields,
)
from fusion.units import ACC_UNITS_G

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
    """Return a short name of the content, the same in every language."""
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
    """Refuse a file of zeros: a logger reserves room on its card before it writes; raises BlankFile."""
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
    head = decode_head(source)
    layout, lines = find_layout(head), head.split("\n")
    if layout is not None:
        return _name_header(lines, layout) or UnknownColumns(why="no header", line=layout.first_line + 1)
    for line in lines[:SNIFFED_LINES]:
        for mark in DELIMITERS:
            names = [parse_column_name(field) for field in split_fields(line, mark)]
            if sum(column.channel in ("acc", "gyr") for column in names) >= MIN_COLUMNS:
                return NoSamples()  # a table without rows
    return _explain_one_sensor(lines) or UnknownFormat(kind="text")


def _name_header(lines: Sequence[str], layout: TextLayout) -> FusionError | None:
    """The error that shows the line above the rows, where it names every column by unknown names."""
    above = lines[: layout.first_line][-1:]
    fields = [field.strip() for line in above for field in split_fields(line, layout.delimiter)]
    if not above or len(fields) != len(layout.sample_rows[0]):
        return None
    if not all(any(letter.isalpha() for letter in field) for field in fields):
        return None
    columns = [parse_column_name(field) for field in fields]
    return UnknownColumns(list=above[0].strip()[:200], missing=name_missing(columns))


def _explain_one_sensor(lines: Sequence[str]) -> FusionError | None:
    """The error for a table of one sensor, as the apps of phones write one for each; None for any other."""
    for line in lines[:SNIFFED_LINES]:
        for mark in DELIMITERS[:-1]:
            fields = split_fields(line, mark)
            columns = [parse_column_name(field) for field in fields]
            axes = dict(found for field in fields if (found := read_axis(field)))
            channels = {column.channel for column in columns} & {"acc", "linear", "gyr"}
            if channels and "gyr" not in channels:
                return NoGyroscope()
            if channels == {"gyr"} or (len(axes) == len("xyz") and columns[0].channel == "time"):
                if any(unit in ACC_UNITS_G for unit in axes.values()):
                    return NoGyroscope(cure="two tables")
                return UnknownColumns(why="one sensor", list=line.strip()[:200])
    return None


def check_extension(source: Source, own: str | None) -> None:
    """Refuse a name that contradicts the content; ``own``: the ending of a device's own format.

    Raises WrongExtension.
    """
    named = source.extension
    if own is not None and named != own and named in (*TEXT_EXTENSIONS, *DEVICE_EXTENSIONS):
        raise WrongExtension(ext=named, kind=own, right=own)
    if own is None and named in DEVICE_EXTENSIONS:
        raise WrongExtension(ext=named, kind="text", right=".csv")
