"""The figures as an Excel workbook with typed cells: numbers are numbers, a subject code stays text."""

import io
from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from typing import Any

import xlsxwriter

from app.report.export.tables import (
    DICTIONARY_COLUMNS,
    MARK_COLUMNS,
    PERIOD_COLUMNS,
    Row,
    describe_dictionary,
    describe_marks,
    describe_periods,
    find_place,
    split_offset,
    summarise_results,
)
from app.report.figures import SUMMARY, Results

_NO_TIME = datetime(2000, 1, 1, tzinfo=UTC).replace(tzinfo=None)
"""A workbook must state its creation time; a constant keeps its bytes the same."""

_BINS = ["file_name", "subject", "lower_deg", "upper_deg", "duration_s", "percent", "low", "high", "path"]
_WARNINGS = ["file_name", "subject", "code", "count", "seconds", "first", "last", "path"]
_OPTIONS = {"in_memory": True, "strings_to_formulas": False, "strings_to_urls": False}


def encode_workbook(every: Sequence[Results]) -> bytes:
    """Encode summary, bins, periods, marks, warnings and dictionary, one sheet each.

    Text is always written as text: none of our cells is a formula.
    """
    bins = (_name(one) | part for one in every for part in one["exposure"]["bins"])
    periods = (row for one in every for row in describe_periods(one))
    warnings = (
        flag | _name(one) | {place: split_offset(flag[place])[0] for place in ("first", "last")}
        for one in every
        for flag in one["quality"]["warnings"]
    )
    sheets = (
        ("summary", [column.name for column in SUMMARY], map(summarise_results, every)),
        ("bins", _BINS, bins),
        ("periods", PERIOD_COLUMNS, periods),
        ("marks", MARK_COLUMNS, (row for one in every for row in describe_marks(one))),
        ("warnings", _WARNINGS, warnings),
        ("dictionary", DICTIONARY_COLUMNS, describe_dictionary()),
    )
    body = io.BytesIO()
    with xlsxwriter.Workbook(body, _OPTIONS) as book:
        book.set_properties({"title": "Acromion", "created": _NO_TIME})
        head = book.add_format({"bold": True, "bottom": 1})
        for name, columns, rows in sheets:
            _fill_sheet(book.add_worksheet(name), columns, rows, head)
    return body.getvalue()


def _name(results: Results) -> Row:
    recording, path = results["recording"], find_place(results, "path")
    return {"file_name": recording["file_name"], "subject": recording["subject"], "path": path}


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
