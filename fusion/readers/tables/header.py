"""The lines of a table: which are rows of values, and what the lines above them say of the columns.

Most tables have one line of names. Shimmer's exports have up to four (sensor, name, CAL or RAW, unit); tables
of several sensors have the sensor above each name, or in the name.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from fusion.readers.tables.columns import REMARKS, Column, choose_vector, parse_column_name, read_unit

NUMBER = re.compile(r"\s*\"?\s*[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?\s*\"?\s*")
CALENDAR = re.compile(r"\s*\"?\d{4}-\d{1,2}-\d{1,2}[T ]\d{1,2}:\d{2}:\d{2}([.,]\d+)?Z?\"?\s*")
WORD_ABSENT = frozenset({"", "-", "nan", "na", "null", "inf", "-inf"})
MIN_COLUMNS = 6


def split_fields(line: str, delimiter: str) -> list[str]:
    """Fields of a line; runs of spaces are one delimiter; empty fields at the end are dropped."""
    fields = line.split() if delimiter == " " else line.split(delimiter)
    while len(fields) > 1 and not fields[-1].strip():
        fields.pop()
    return [field.strip().strip('"').strip() for field in fields]


def is_value(field: str) -> bool:
    """Whether a field can stand in a row of samples."""
    return bool(NUMBER.fullmatch(field) or CALENDAR.fullmatch(field)) or field.lower() in WORD_ABSENT


def is_row(line: str, delimiter: str) -> bool:
    """Whether a line is a row of at least six values, not all absent."""
    if delimiter != " " and line.count(delimiter) < MIN_COLUMNS - 1:
        return False
    fields = split_fields(line, delimiter)
    values = [is_value(field) for field in fields]
    present = sum(bool(NUMBER.fullmatch(field)) for field in fields)
    return len(fields) >= MIN_COLUMNS and all(values) and present >= len(fields) // 2


# The lines above the first row.


REACH = 5
"""So many lines above the first row are looked at."""
FEWEST_NAMES = 3
NAME_REACH = 3
"""A line that names fewer sensors than three columns stands so near the rows."""
COMMENT = re.compile(r"^\s*(?:#|%|//)+\s*")
FEWEST_UNITS = 2


@dataclass(frozen=True, slots=True)
class Header:
    """The lines from ``first_line`` to before ``stop_line``: the line of names, and the columns."""

    first_line: int
    stop_line: int
    names: str
    columns: tuple[Column, ...]


def find_header(lines: Sequence[str], first_row: int, delimiter: str) -> Header | None:
    """Understand the lines above the first row; None where they name no columns."""
    width = len(split_fields(lines[first_row], delimiter))
    above = range(first_row - 1, max(-1, first_row - 1 - REACH), -1)
    fields = {k: split_fields(COMMENT.sub("", lines[k]), delimiter) for k in above}
    at = _find_names(fields, width)
    if at is None:
        return None
    columns = [parse_column_name(name) for name in fields[at]]
    first, stop = at, at + 1
    for k in range(at + 1, first_row):
        if is_unit_row(fields[k]):
            columns = _add_units(columns, fields[k])
            stop = k + 1
        elif 2 * sum(field.lower() in REMARKS for field in fields[k]) > len(fields[k]):
            stop = k + 1
    labels = fields.get(at - 1, [])
    if sensors := _find_labels(labels, columns):
        columns = [
            replace(column, sensor=label) if label in sensors else column
            for column, label in zip(columns, labels, strict=True)
        ]
        first = at - 1
    return Header(first, stop, lines[at], tuple(columns))


def _find_names(fields: dict[int, list[str]], width: int) -> int | None:
    """The line that names most axes; else the nearest with three known names, or with one among words."""
    axes = {k: sum(_names_axis(field) for field in row) for k, row in fields.items()}
    best = max(axes, key=lambda k: axes[k], default=None)
    if best is not None and axes[best] >= FEWEST_NAMES:
        return best
    for k, row in list(fields.items())[:NAME_REACH]:
        known = sum(parse_column_name(field).channel != "other" for field in row)
        is_foreign = known > 0 and len(row) == width and not any(map(is_value, row))
        if len(row) >= FEWEST_NAMES and (known >= FEWEST_NAMES or is_foreign):
            return k
    return None


def _names_axis(field: str) -> bool:
    return _split_sensor(parse_column_name(field)).channel in ("acc", "gyr")


def is_unit_row(fields: Sequence[str]) -> bool:
    """Whether a line holds units and nothing else."""
    units = [read_unit(field) for field in fields]
    return None not in units and sum(bool(unit) for unit in units) >= FEWEST_UNITS


def _add_units(columns: Sequence[Column], fields: Sequence[str]) -> list[Column]:
    """Give each column the unit that stands below its name, where the name itself states none."""
    units = [*(read_unit(field) for field in fields), *[None] * len(columns)]
    return [
        replace(column, unit=unit) if column.unit is None and unit else column
        for column, unit in zip(columns, units, strict=False)
    ]


def _find_labels(labels: Sequence[str], columns: Sequence[Column]) -> set[str]:
    """The sensors that a line above the names gives, one for each column; none for any other line."""
    if len(labels) != len(columns):
        return set()
    found = [label for label, column in zip(labels, columns, strict=True) if column.channel in ("acc", "gyr")]
    is_plain = all(found) and not any(map(is_value, found)) and len(set(found)) <= len(found) // MIN_COLUMNS
    return set(found) if is_plain else set()


# Which of several sensors.


def find_sensors(columns: Sequence[Column]) -> dict[str, tuple[Column, ...]]:
    """The sensors whose six columns are all there: by the line above the names, or by their names.

    Each with the columns as they are to be read for it: those of the other sensors are "other".
    """
    named = [_split_sensor(column) for column in columns]
    labels = dict.fromkeys(column.sensor for column in named if column.channel in ("acc", "gyr"))
    found = {label: _keep_sensor(named, label) for label in labels}
    return {
        label: chosen
        for label, chosen in found.items()
        if choose_vector(chosen, "acc") and choose_vector(chosen, "gyr")
    }


def _keep_sensor(columns: Sequence[Column], label: str) -> tuple[Column, ...]:
    """Leave one sensor's columns; a time that has none is everybody's, one of another sensor is nobody's."""
    return tuple(
        column if column.sensor in ("", label) else Column(column.name, "other") for column in columns
    )


def _split_sensor(column: Column) -> Column:
    """Find the sensor in a name that holds more than axis and channel: `left_acc_x`, `IMU 2 Gyroscope X`."""
    if column.sensor or column.channel in ("acc", "gyr"):
        return column
    plain, bracket, rest = column.name.partition("(")
    words = [word for word in re.split(r"[ _.:\-|/]+", plain) if word]
    for length in range(len(words) - 1, 0, -1):
        for first in range(len(words) - length + 1):
            inner = parse_column_name(" ".join(words[first : first + length]) + " " + bracket + rest)
            if inner.channel in ("acc", "gyr"):
                others = [*words[:first], *words[first + length :]]
                label = " ".join(word for word in others if word.lower() not in REMARKS)
                return replace(inner, name=column.name, unit=inner.unit or column.unit, sensor=label)
    return column
