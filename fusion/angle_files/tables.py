"""Text tables of angles or orientations: MT Manager, Xsens DOT, and any CSV with a time column."""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from pyarrow import compute as pc
from pyarrow import csv

from fusion.angle_files.types import Vector
from fusion.errors import EmptyFile, UnknownColumns, UnreadableRows
from fusion.readers.samples import check_rows
from fusion.readers.source import Source

MISSING = ["", "NaN", "nan", "NAN", "NA", "N/A", "null", "-"]
DELIMITERS = ("\t", ";", ",", " ")
LINES_LOOKED_AT = 60
MOST_UNREADABLE = 0.05


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the header stands and how its fields are parted; ``before`` are the lines above it."""

    header_line: int
    delimiter: str
    names: tuple[str, ...]
    before: tuple[str, ...]
    decimal: str = "."


def find_layout(source: Source, needed: Sequence[frozenset[str]]) -> Layout | None:
    """Find the line that names at least one of each set of columns (lower case, without spaces)."""
    lines = source.head.decode("utf-8-sig", "replace").splitlines()[:LINES_LOOKED_AT]
    for number, line in enumerate(lines):
        for delimiter in DELIMITERS:
            names = tuple(simplify(field) for field in line.split(delimiter))
            if len(names) > 1 and all(options & set(names) for options in needed):
                rows = lines[number + 1 : number + 4]
                return Layout(number, delimiter, names, tuple(lines[:number]), _find_decimal(rows, delimiter))
    return None


def simplify(field: str) -> str:
    """Write a column's name in one way: lower case, no quotes, spaces or brackets."""
    return "".join(sign for sign in field.strip().lower() if sign.isalnum() or sign == "_")


def _find_decimal(rows: Sequence[str], delimiter: str) -> str:
    return "," if delimiter in "\t;" and any("," in row for row in rows) else "."


def read_columns(source: Source, layout: Layout, wanted: Sequence[str]) -> Mapping[str, Vector]:
    """Read columns as numbers, piece by piece; NaN where a field is empty or no number.

    Raises
    ------
    UnreadableRows
        More than 5 % of the rows have too many or too few fields.
    EmptyFile
        A header without rows.
    fusion.errors.TooLong
    """
    broken: list[int | None] = []

    def skip_row(row: csv.InvalidRow) -> str:
        broken.append(row.number)
        return "skip"

    source.file.seek(0)
    names = list(_make_unique(layout.names))
    rows = csv.open_csv(
        source.file,
        csv.ReadOptions(column_names=names, skip_rows=layout.header_line + 1, use_threads=False),
        csv.ParseOptions(delimiter=layout.delimiter, invalid_row_handler=skip_row),
        csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.string()), include_columns=list(wanted), null_values=MISSING
        ),
    )
    columns: dict[str, array[float]] = {name: array("d") for name in wanted}
    n_rows = 0
    for batch in rows:
        for name in wanted:
            columns[name].frombytes(_to_numbers(batch.column(name), layout.decimal).tobytes())
        n_rows += batch.num_rows
        check_rows(n_rows, source.read_bytes, source.size_bytes)
    if len(broken) > MOST_UNREADABLE * (n_rows + len(broken)):
        raise UnreadableRows(k=len(broken), line=broken[0] or layout.header_line + 2)
    if n_rows == 0:
        raise EmptyFile
    return {name: np.frombuffer(values) for name, values in columns.items()}


def _make_unique(names: Sequence[str]) -> Sequence[str]:
    """Rename columns that are named twice; the first keeps its name."""
    return [name if names.index(name) == at and name else f"{name}#{at}" for at, name in enumerate(names)]


NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"


def _to_numbers(column: pa.Array, decimal: str) -> Vector:
    text = pc.utf8_trim_whitespace(column)
    if decimal == ",":
        text = pc.replace_substring(text, ",", ".")
    readable = pc.match_substring_regex(text, NUMBER)
    numbers = pc.if_else(readable, text, None).cast(pa.float64())
    return np.asarray(numbers.to_numpy(zero_copy_only=False), np.float64)


def require(layout: Layout | None, source: Source) -> Layout:
    """Give the layout, or refuse with the first line as it stands."""
    if layout is None:
        lines = source.head.decode("utf-8-sig", "replace").splitlines() or [""]
        raise UnknownColumns(list=lines[0][:200], line=1)
    return layout
