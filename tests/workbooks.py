"""Excel workbooks as a person would type them."""

import io
from collections.abc import Sequence

import openpyxl

Cells = Sequence[object]


def write(*rows: Cells, **others: Sequence[Cells]) -> bytes:
    """Return a workbook with a sheet of rows, and others by name."""
    book = openpyxl.Workbook()
    sheet = book.active
    assert sheet is not None
    for row in rows:
        sheet.append(row)
    for name, more in others.items():
        other = book.create_sheet(name)
        for row in more:
            other.append(row)
    return save(book)


def save(book: openpyxl.Workbook) -> bytes:
    body = io.BytesIO()
    book.save(body)
    return body.getvalue()
