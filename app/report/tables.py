"""Tables as CSV in two dialects, safe to open in a spreadsheet."""

import csv
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

Cell = str | int | float | None
CellKind = Literal["text", "number"]
Row = dict[str, Cell]

# A sign that a spreadsheet takes for a formula, at the start of a cell or of what another dialect would take
# for a cell; the wide forms are those of Japanese and Chinese keyboards.
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
    """Put an apostrophe before whatever a spreadsheet would run."""
    return _FORMULA.sub(r"\1\2'", text)
