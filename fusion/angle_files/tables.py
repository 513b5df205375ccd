"""Text tables of angles or orientations: MT Manager, Xsens DOT, and any CSV with a time column."""

from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa
from pyarrow import csv

from fusion.angle_files.vertical import Up, take_up_of_euler, take_up_of_quaternion, take_up_of_row
from fusion.errors import EmptyFile, UnknownColumns, UnreadableRows, UnusableTime
from fusion.readers.samples import check_rows
from fusion.readers.source import Source
from fusion.recording import Float64Array

MISSING = ["", "NaN", "nan", "NAN", "NA", "N/A", "null", "-"]
DELIMITERS = ("\t", ";", ",", " ")
LINES_LOOKED_AT = 60
MOST_UNREADABLE = 0.05


@dataclass(frozen=True, slots=True)
class Layout:
    """Where the header is and how its fields are separated; ``before`` are the lines above it."""

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


def read_columns(source: Source, layout: Layout, wanted: Sequence[str]) -> Mapping[str, Float64Array]:
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


def _to_numbers(column: pa.Array, decimal: str) -> Float64Array:
    from pyarrow import compute as pc  # noqa: PLC0415  slow to load, and only this needs it

    text = pc.utf8_trim_whitespace(column)
    if decimal == ",":
        text = pc.replace_substring(text, ",", ".")
    readable = pc.match_substring_regex(text, NUMBER)
    numbers = pc.if_else(readable, text, None).cast(pa.float64())
    return np.asarray(numbers.to_numpy(zero_copy_only=False), np.float64)


def require(layout: Layout | None, source: Source) -> Layout:
    """Give the layout; refuse a file without one, with its first line as the fact."""
    if layout is None:
        lines = source.head.decode("utf-8-sig", "replace").splitlines() or [""]
        raise UnknownColumns(list=lines[0][:200], line=1)
    return layout


# Which columns of a table hold an orientation, by the names that Xsens and others give them.
#
# A matrix before a quaternion before Euler angles, where an export holds several: they are equivalent.


MATRIX_ROW = (("mat31", "mat32", "mat33"),)
QUATERNIONS = (
    ("quat_q0", "quat_q1", "quat_q2", "quat_q3"),
    ("quat_w", "quat_x", "quat_y", "quat_z"),
    ("quatw", "quatx", "quaty", "quatz"),
    ("qw", "qx", "qy", "qz"),
    ("q_w", "q_x", "q_y", "q_z"),
    ("q0", "q1", "q2", "q3"),
    ("q_0", "q_1", "q_2", "q_3"),
    ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z"),
    ("w", "x", "y", "z"),
)
EULER = (("roll", "pitch"), ("euler_x", "euler_y"))

Kind = str
FORMS: Sequence[tuple[Kind, Sequence[tuple[str, ...]]]] = (
    ("matrix", MATRIX_ROW),
    ("quaternion", QUATERNIONS),
    ("euler", EULER),
)


def find_orientation(names: Sequence[str]) -> tuple[Kind, tuple[str, ...]] | None:
    """Find the columns that give the vertical, and in which form."""
    for kind, choices in FORMS:
        for columns in choices:
            if set(columns) <= set(names):
                return kind, columns
    return None


def read_up(
    source: Source, layout: Layout, orientation: tuple[Kind, tuple[str, ...]], others: Sequence[str]
) -> tuple[Up, Mapping[str, Float64Array]]:
    """Read the zenith in the sensor's frame (n, 3), and other columns beside it."""
    kind, columns = orientation
    values = read_columns(source, layout, [*columns, *others])
    numbers = [values[name] for name in columns]
    if kind == "euler":
        return take_up_of_euler(numbers[0], numbers[1]), values
    stacked = np.stack(numbers, axis=1)
    return (take_up_of_row if kind == "matrix" else take_up_of_quaternion)(stacked), values


# Seconds from the counters that Xsens writes.


COUNTER_SPAN = {"packetcounter": 2.0**16, "sampletimefine": 2.0**32}


def unwrap_counter(counter: Float64Array, span: float) -> Float64Array:
    """Undo the wraps of a counter that starts over at ``span``; a large step back is one.

    Raises
    ------
    UnusableTime
        A counter that goes back without wrapping, or is missing.
    """
    if not np.isfinite(counter).all():
        raise UnusableTime(why="missing")
    steps = np.diff(counter)
    wrapped = counter + span * np.concatenate([[0], np.cumsum(steps < -span / 2)])
    backwards = np.flatnonzero(np.diff(wrapped) <= 0)
    if len(backwards):
        raise UnusableTime(why="backwards", line=int(backwards[0] + 2))
    return np.asarray(wrapped - wrapped[0])
