"""Tables as CSV in two dialects, safe to open in a spreadsheet."""

import csv
import io
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from app.report.words.messages import Fact, describe_problem
from app.report.words.wording import Language

Cell = str | int | float | None
CellKind = Literal["text", "number"]
Row = dict[str, Cell]

# A sign that a spreadsheet reads as a formula, at the start of a cell, or of a cell in another dialect. The
# wide forms are those of Japanese and Chinese keyboards.
_FORMULA = re.compile("(^|[;,\t\r\n\u007c])([\"' ]*)(?=[=+\\-@\t\r\x00\uff1d\uff0b\uff0d\uff20])")


@dataclass(frozen=True, slots=True)
class Dialect:
    """How a table is written: what parts the cells, the decimal sign, the mark of the encoding."""

    delimiter: str
    decimal: str
    mark: str
    line_end: str


INTERNATIONAL = Dialect(",", ".", "", "\n")
FRENCH_EXCEL = Dialect(";", ",", "\ufeff", "\r\n")
"""What a French Excel opens by a double click, without taking 12.5 for the 12th of May."""


def encode_table(names: Sequence[str], rows: Iterable[Row], dialect: Dialect = INTERNATIONAL) -> bytes:
    """Write a table as CSV bytes (UTF-8); empty is "not computable"."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter=dialect.delimiter, lineterminator=dialect.line_end)
    writer.writerow(names)
    for row in rows:
        writer.writerow([_write_cell(row.get(name), dialect) for name in names])
    return (dialect.mark + text.getvalue()).encode("utf-8")


def _write_cell(value: Cell, dialect: Dialect) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return guard_text(value)
    return str(value).replace(".", dialect.decimal)


def guard_text(text: str) -> str:
    """Put an apostrophe before any sign that a spreadsheet would take for a formula."""
    return _FORMULA.sub(r"\1\2'", text)


# Which recording a row of a table is about: its path distinguishes two files of one name.


@dataclass(frozen=True, slots=True)
class Origin:
    """What is known of a recording before it is read, and where it is.

    ``path`` leads to the recording: in a run from the folder that was named, by REST its address. ``folder``
    leads to its results in the same way, and is empty where there are none.
    """

    file_name: str
    subject: str = ""
    side: str | None = None
    path: str = ""
    folder: str = ""


def add_origin(results: Mapping[str, Any], origin: Origin) -> dict[str, Any]:
    """Return the results with where they come from beside them, for the tables of many recordings.

    It stands in no ``results.json``, which is the same wherever the file lies.
    """
    return {**results, "origin": {"path": origin.path, "folder": origin.folder}}


def find_place(results: Mapping[str, Any], name: str) -> str | None:
    """Return ``path`` or ``folder``; None for results on their own."""
    place: str | None = results.get("origin", {}).get(name)
    return place or None


# Recordings without a result, as rows of ``problems.csv``.


PROBLEM_COLUMNS = ["file", "code", "title", "detail", "fix", "path", "subject", "side"]


def tell_problem(origin: Origin, code: str, facts: Mapping[str, Fact], language: Language) -> Row:
    """Return the row of one recording."""
    problem = describe_problem(code, facts, language)
    words = {"title": problem.title, "detail": problem.detail, "fix": problem.fix}
    who = {"path": origin.path, "subject": origin.subject, "side": origin.side}
    return {"file": origin.file_name, "code": code, **words, **who}
