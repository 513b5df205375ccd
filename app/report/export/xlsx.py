"""The figures as an Excel workbook with typed cells: numbers are numbers, a subject code stays text."""

import io
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from typing import Any

import xlsxwriter

from acromion.app.report.export.tables import Row, describe_dictionary, list_columns
from acromion.app.report.figures import Column

_NO_TIME = datetime(2000, 1, 1, tzinfo=UTC).replace(tzinfo=None)
"""A workbook must state its creation time; a constant keeps its bytes the same."""

_OPTIONS = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}


def encode_workbook(tables: Mapping[str, Sequence[Row]], further: Sequence[Column] = ()) -> bytes:
    """Encode tables (:data:`acromion.app.report.figures.TABLES`) and their dictionary, one sheet each.

    ``further``: columns of the list of participants, at the end of every sheet about recordings.
    Text is always written as text: none of our cells is a formula.
    """
    body = io.BytesIO()
    with xlsxwriter.Workbook(body, _OPTIONS) as book:
        book.set_properties({"title": "Acromion", "created": _NO_TIME})
        head = book.add_format({"bold": True, "bottom": 1})
        for name, rows in {**tables, "dictionary": describe_dictionary(further)}.items():
            columns = [column.name for column in list_columns(name, further)]
            _fill_sheet(book.add_worksheet(name), columns, rows, head)
    return body.getvalue()


def _fill_sheet(sheet: Any, columns: Sequence[str], rows: Iterable[Row], head: Any) -> None:
    sheet.freeze_panes(1, 1)
    sheet.set_column(0, len(columns) - 1, 16)
    for place, name in enumerate(columns):
        sheet.write_string(0, place, name, head)
    for rank, row in enumerate(rows, 1):
        for place, name in enumerate(columns):
            value = row.get(name)
            if isinstance(value, str):
                sheet.write_string(rank, place, value)
            elif value is not None:
                sheet.write_number(rank, place, value)
