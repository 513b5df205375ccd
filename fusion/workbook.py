"""Read the sheets of an Excel workbook (``.xlsx``, ``.xlsm``) as rows of text.

Size, members, rows and columns are checked before a value is parsed. Formulas and macros never run: a formula
has the value that the spreadsheet stored last, and a workbook with a formula without one is refused.
"""

import io
import re
import zipfile
import zlib
from collections.abc import Iterator
from datetime import date, datetime, time, timedelta
from typing import Any

from defusedxml.ElementTree import iterparse

from acromion.fusion.errors import UnusableDiary

ZIP, OLE = b"PK\x03\x04", b"\xd0\xcf\x11\xe0"
"""First bytes of a workbook; OLE is the old format (.xls), and any format with a password."""
MOST_BYTES = 4 << 20
MOST_UNPACKED_BYTES = 32 << 20
MOST_MEMBERS = 1000
MOST_COLUMNS = 256
MOST_ROWS = 500_000
"""Of all visible sheets, each counted up to the last row with a value in any of them."""
LONGEST_CELL = 32_767
"""Characters that Excel allows in a cell."""
XML_STARTS = (b"<", b"\xff\xfe", b"\xfe\xff")
MOST_NAMED = 5
FIRST_SERIAL = 30_000
"""A number from here, with a fraction, is a date and time in a cell without a format: 18 February 1982."""
ERAS = 1910
"""A time of day in a cell of date and time has the year 1900 or 1904."""
ERROR = re.compile(r"#(?:N/A|[A-Z0-9/]+[!?])")
"""The text of a cell whose formula failed."""
BROKEN = (
    *(zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, SyntaxError),
    *(ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, OSError),
)
"""The errors of zipfile, the XML parser and openpyxl for damaged files."""

Rows = list[tuple[int, list[str]]]


def is_workbook(content: bytes) -> bool:
    """Return whether the bytes are those of a spreadsheet program, not of a text file."""
    return content.startswith((ZIP, OLE))


def read_workbook(content: bytes) -> dict[str, Rows]:
    """Return the non-empty rows of each visible sheet with their row number from 1, by the sheet's name.

    Times of day are ``10:20:00``, dates and times ISO 8601, other numbers as typed; a fraction of a day in a
    cell without a format stays a number, because seconds may be meant.

    Raises UnusableDiary: another format, a password, too large, or a formula without a value.
    """
    if content.startswith(OLE):
        raise UnusableDiary(why="old workbook", cure="old workbook")
    if len(content) > MOST_BYTES:
        raise _refuse_size(f"{len(content) >> 20} MiB")
    import openpyxl  # noqa: PLC0415  slow import

    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            last_row = _check_members(archive)
        book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True, keep_links=False)
        sheets = [sheet for sheet in book.worksheets if sheet.sheet_state == "visible"]
        if len(sheets) * last_row > MOST_ROWS:
            raise _refuse_size(f"{len(sheets)} x {last_row}")
        return {sheet.title: list(_read_rows(sheet, last_row, book.epoch)) for sheet in sheets}
    except BROKEN:
        raise UnusableDiary(why="workbook", cure="workbook") from None


def _refuse_size(value: str) -> UnusableDiary:
    return UnusableDiary(why="workbook size", cure="workbook size", value=value)


def _check_members(archive: zipfile.ZipFile) -> int:
    """Return the last row with a value in any sheet.

    Refuse too much content, by the sizes that unpacking will not exceed, then look at each sheet.
    """
    members = archive.infolist()
    if len(members) > MOST_MEMBERS or sum(member.file_size for member in members) > MOST_UNPACKED_BYTES:
        raise _refuse_size("")
    last_row = 0
    for member in members:  # a sheet may have any name; a drawing (.vml) may be malformed
        if member.filename.endswith(".vml"):
            continue
        with archive.open(member) as file:
            is_xml = file.read(16).removeprefix(b"\xef\xbb\xbf").lstrip().startswith(XML_STARTS)
        if is_xml:
            with archive.open(member) as file:
                last_row = max(last_row, _check_sheet(file))
    return last_row


def _check_sheet(file: Any) -> int:
    """Return the last row with a value.

    Refuse a sheet with too many rows or columns, or with a formula whose value was never stored.
    """
    unknown: list[str] = []
    number = last_row = 0
    has_values = False
    for _, element in iterparse(file):
        name = element.tag.rpartition("}")[2]
        if name == "c":
            parts = {child.tag.rpartition("}")[2]: child for child in element}
            place, has_value = element.get("r", ""), bool(getattr(parts.get("v"), "text", None))
            is_filled = has_value or "is" in parts
            has_values |= is_filled
            if is_filled and _find_column(place) > MOST_COLUMNS:
                raise _refuse_size(place)
            if "f" in parts and not has_value and element.get("t") != "str":  # an empty text is a value
                unknown.append(place)
        elif name == "row":
            number = int(element.get("r", number + 1))
            last_row, has_values = max(last_row, number if has_values else 0), False
            if last_row > MOST_ROWS:
                raise _refuse_size(str(number))
            element.clear()
    if unknown:
        named = ", ".join(unknown[:MOST_NAMED]) + (" …" if len(unknown) > MOST_NAMED else "")
        raise UnusableDiary(why="formula", cure="formula", value=named)
    return last_row


def _find_column(place: str) -> int:
    """Return the number of a cell's column from 1: ``AB12`` is 28."""
    column = 0
    for letter in place.rstrip("0123456789")[:4]:
        column = column * 26 + ord(letter) - 64
    return column


def _read_rows(sheet: Any, last_row: int, epoch: datetime) -> Iterator[tuple[int, list[str]]]:
    sheet.reset_dimensions()  # what the file states may be wrong
    rows = sheet.iter_rows(max_row=last_row, max_col=MOST_COLUMNS, values_only=True) if last_row else ()
    for number, values in enumerate(rows, 1):
        if values.count(None) == len(values):  # also the rows that the file leaves out
            continue
        width = max(k for k, value in enumerate(values, 1) if value is not None)
        cells = [_write_cell(value, epoch) for value in values[:width]]
        is_comment = cells[0].startswith("#") and not ERROR.fullmatch(cells[0])
        if any(cells) and not is_comment:
            yield number, cells


def _write_cell(value: object, epoch: datetime) -> str:
    """Return a cell as text, as it would be in a CSV file."""
    if isinstance(value, float):
        if value.is_integer():
            return str(int(value))
        if value < FIRST_SERIAL:
            return str(value)
        value = epoch + timedelta(milliseconds=round(value * 86_400_000))
    if isinstance(value, timedelta):
        return str(value)
    if isinstance(value, datetime):
        return value.time().isoformat() if value.year < ERAS else value.isoformat(sep=" ")
    if isinstance(value, date | time):
        return value.isoformat()
    text = "" if value is None else str(value)
    if len(text) > LONGEST_CELL:
        raise _refuse_size(f"{len(text)} characters")
    return text.strip()
