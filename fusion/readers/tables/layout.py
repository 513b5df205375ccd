"""The layout of a table: encoding, preamble, header, delimiter, decimal mark, columns; its lines in bytes."""

import codecs
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from acromion.fusion.caveats import Caveat
from acromion.fusion.devices import KnownDevice, find_known_device
from acromion.fusion.errors import AmbiguousDecimal, EpochFile, UnknownFormat, UnusableTime
from acromion.fusion.readers.source import Source, UnpackedFile, read_chunks
from acromion.fusion.readers.tables.columns import (
    MONTHS,
    REMARKS,
    STAMP_LIKE,
    Column,
    DateDialect,
    DateOrder,
    StampWriter,
    choose_vector,
    find_dates,
    find_last_date,
    find_open_date,
    find_order_by_span,
    find_own_axes,
    names_epochs,
    parse_column_name,
    read_unit,
)
from acromion.fusion.readers.tables.csv_lines import LEAD_BYTES, TRAIL_BYTES, LinePiece
from acromion.fusion.recording import QualityFlag, acc_scale_g

Place = str | int
"""A column by its name in the header, or by its number, counted from 1."""
DELIMITERS = (";", "\t", ",", "|", " ")
SNIFFED_LINES, FEWEST_HEADER_LINES = 400, 40

# Which lines are rows of values.

NUMBER = re.compile(r"\s*+\"?\s*+[-+]?(?:\d++(?:[.,]\d*+)?|[.,]\d++)(?:[eE][-+]?\d++)?\s*+\"?\s*+")
CALENDAR = re.compile(r"\s*+\"?\d{4}-\d{1,2}-\d{1,2}[T ]\d{1,2}:\d{2}:\d{2}(?:[.,]\d++)?Z?\"?\s*+")
WHOLE, WITH_COMMA = re.compile(r"[-+]?\d*"), re.compile(r"[-+]?\d*,\d+(?:[eE][-+]?\d+)?")
FILLERS = ',;" \t\r\n\f\v\u00a0'
"""Characters that spreadsheets append to the value of a preamble line."""
WORD_ABSENT = frozenset({"", "-", "nan", "na", "null", "inf", "-inf"})
MIN_COLUMNS = 6
COLUMNS_OF_ONE = 4
COLUMNS_OF_THIGH = 3
"""A table of one sensor has at least its time and its three axes."""


def split_fields(line: str, delimiter: str) -> list[str]:
    """Return the fields of a line; runs of spaces are one delimiter; empty last fields are dropped."""
    fields = line.split() if delimiter == " " else _cut_fields(line, delimiter)
    while len(fields) > 1 and not fields[-1].strip():
        fields.pop()
    return [field.strip().strip('"').strip() for field in fields]


def _cut_fields(line: str, delimiter: str) -> list[str]:
    """Cut a line at its delimiters, except those between quotes, unless the whole line is quoted."""
    parts = line.split(delimiter)
    if '"' not in line:
        return parts
    fields: list[str] = []
    opened: list[str] = []
    for part in parts:
        is_odd = part.count('"') % 2 == 1
        if opened or (is_odd and part.lstrip().startswith('"')):
            opened.append(part)
        else:
            fields.append(part)
        if opened and is_odd and len(opened) > 1:
            fields.append(delimiter.join(opened))
            opened = []
    return [*fields, *opened] if len(fields) > 1 else parts


def _is_value(field: str) -> bool:
    return bool(NUMBER.fullmatch(field) or CALENDAR.fullmatch(field)) or field.lower() in WORD_ABSENT


def is_row(line: str, delimiter: str, fewest: int = MIN_COLUMNS) -> bool:
    """Return whether a line is a row of at least ``fewest`` values, not all absent."""
    if delimiter != " " and line.count(delimiter) < fewest - 1:
        return False
    fields = split_fields(line, delimiter)
    present = sum(bool(NUMBER.fullmatch(field)) for field in fields)
    return len(fields) >= fewest and all(map(_is_value, fields)) and present >= len(fields) // 2


# The lines above the first row and the columns that they describe.
#
# Most tables have one line of names. Shimmer's exports have up to four (sensor, name, CAL or RAW, unit);
# tables of several sensors have the sensor above each name, or in the name.

REACH = 5
"""So many lines above the first row are looked at."""
FEWEST_NAMES = 3
NAME_REACH = 3
"""A line that names fewer sensors than three columns stands so near the rows."""
COMMENT = re.compile(r"^\s*(?:#|%|//)+\s*")
FEWEST_UNITS = 2
AXES = frozenset("xyz")


@dataclass(frozen=True, slots=True)
class Header:
    """The lines from ``first_line`` to before ``stop_line``: the line of names, and the columns."""

    first_line: int
    stop_line: int
    names: str
    columns: tuple[Column, ...]


def find_header(lines: Sequence[str], first_row: int, delimiter: str) -> Header | None:
    """Parse the lines above the first row; None if they name no columns."""
    width = len(split_fields(lines[first_row], delimiter))
    above = range(first_row - 1, max(-1, first_row - 1 - REACH), -1)
    fields = {k: split_fields(COMMENT.sub("", lines[k]), delimiter) for k in above}
    if merged := _read_merged_header(fields, first_row, lines):
        return merged
    at = _find_names(fields, width)
    if at is None:
        return None
    columns = [parse_column_name(name) for name in fields[at]]
    first, stop = at, at + 1
    for k in range(at + 1, first_row):
        units = [read_unit(field) for field in fields[k]]
        is_row_of_units = 2 * units.count(None) < len(units) and not any(map(NUMBER.fullmatch, fields[k]))
        if is_row_of_units and sum(map(bool, units)) >= FEWEST_UNITS:
            units += [None] * len(columns)
            columns = [
                replace(column, unit=unit) if column.unit is None and unit else column
                for column, unit in zip(columns, units, strict=False)
            ]
            stop = k + 1
        elif 2 * sum(field.lower() in REMARKS for field in fields[k]) > len(fields[k]):
            stop = k + 1
    labels = fields.get(at - 1, [])
    if sensors := _find_sensor_names(labels, columns):
        columns = [
            replace(column, sensor=label) if label in sensors else column
            for column, label in zip(columns, labels, strict=True)
        ]
        first = at - 1
    return Header(first, stop, lines[at], tuple(columns))


def _read_merged_header(
    fields: Mapping[int, Sequence[str]], first_row: int, lines: Sequence[str]
) -> Header | None:
    """Read names over several columns: `Accelerometer,,,Gyroscope,,` above `X,Y,Z,X,Y,Z`; None for others.

    If the first name comes again, each time begins another sensor; its name is the last word in the line
    above.
    """
    axes = fields.get(first_row - 1, [])
    if sum(field.lower() in AXES for field in axes) < MIN_COLUMNS or first_row - 2 not in fields:
        return None
    words = [*fields[first_row - 2], *[""] * len(axes)][: len(axes)]
    counts = Counter(word for word in words if word)
    repeated = next((word for word in words if counts[word] > 1), None)
    starts = [k for k, word in enumerate(words) if word == repeated] if repeated else []
    labels, columns, word, sensor = fields.get(first_row - 3, []), [], "", ""
    for k, axis in enumerate(axes):
        word = words[k] or word
        if k in starts:
            stop = next((start for start in starts if start > k), len(axes))
            named = [label for label in labels[k:stop] if label and not NUMBER.fullmatch(label)]
            sensor = named[-1] if named else f"{starts.index(k) + 1}"
        column = parse_column_name(f"{word} {axis}" if axis else word)
        columns.append(replace(column, sensor=sensor) if column.channel in ("acc", "gyr") else column)
    return Header(first_row - 2, first_row, lines[first_row - 1], tuple(columns))


def _find_names(fields: dict[int, list[str]], width: int) -> int | None:
    """Return the line with the most axis names; else the nearest with three names, or one among words."""
    axes = {
        k: sum(_split_sensor(parse_column_name(field)).channel in ("acc", "gyr") for field in row)
        for k, row in fields.items()
    }
    best = max(axes, key=lambda k: axes[k], default=None)
    if best is not None and axes[best] >= FEWEST_NAMES:
        return best
    for k, row in list(fields.items())[:NAME_REACH]:
        known = sum(parse_column_name(field).channel != "other" for field in row)
        is_foreign = known > 0 and len(row) == width and not any(map(_is_value, row))
        if len(row) >= FEWEST_NAMES and (known >= FEWEST_NAMES or is_foreign):
            return k
    return None


def _find_sensor_names(labels: Sequence[str], columns: Sequence[Column]) -> set[str]:
    """Return the sensor of each column, from a line above the names; empty for any other line."""
    if len(labels) != len(columns):
        return set()
    found = [label for label, column in zip(labels, columns, strict=True) if column.channel in ("acc", "gyr")]
    is_plain = all(found) and not any(map(_is_value, found)) and len(set(found)) <= len(found) // MIN_COLUMNS
    return set(found) if is_plain else set()


def find_sensors(columns: Sequence[Column]) -> dict[str, tuple[Column, ...]]:
    """Return the sensors with all six columns, from the line above the names or from the names.

    Each comes with its view of the columns: columns of other sensors are "other". A time column without a
    sensor belongs to all of them.
    """
    named = [_split_sensor(column) for column in columns]
    labels = dict.fromkeys(column.sensor for column in named if column.channel in ("acc", "gyr"))
    found = {
        label: tuple(one if one.sensor in ("", label) else Column(one.name, "other") for one in named)
        for label in labels
    }
    return {
        label: chosen
        for label, chosen in found.items()
        if choose_vector(chosen, "acc") and choose_vector(chosen, "gyr")
    }


MOST_WORDS = 12
"""Longer names are not searched for a sensor: each part of the name is tried."""


def _split_sensor(column: Column) -> Column:
    """Find the sensor in a name with more than axis and channel: `left_acc_x`, `IMU 2 Gyroscope X`."""
    if column.sensor or column.channel in ("acc", "gyr"):
        return column
    plain, bracket, rest = column.name.partition("(")
    words = [word for word in re.split(r"[ _.:\-|/]+", plain) if word]
    if len(words) > MOST_WORDS:
        return column
    for length in range(len(words) - 1, 0, -1):
        for first in range(len(words) - length + 1):
            inner = parse_column_name(" ".join(words[first : first + length]) + " " + bracket + rest)
            if inner.channel in ("acc", "gyr"):
                others = [*words[:first], *words[first + length :]]
                label = " ".join(word for word in others if word.lower() not in REMARKS)
                return replace(inner, name=column.name, unit=inner.unit or column.unit, sensor=label)
    return column


# Rows that name every value, as a sketch prints them to its serial port: `ax: 0.1 ay: -0.2 az: 9.8 ...`.
#
# They are rewritten to a table before anything else looks at them. The serial monitor's own time of day
# (`12:30:01.123 -> ax: ...`) becomes a column.

PAIR = re.compile(
    r"([A-Za-z_][\w .]{0,60}?(?: ?\([^)\n]{0,40}\))?)\"? ?[:=] *+"
    r"([-+]?(?:\d++(?:\.\d*+)?+|\.\d++)(?:[eE][-+]?\d++)?+)"
    r"(?: ?(m/s(?:\^?2|\u00b2)|rad(?:ians)?/s|deg/s|\u00b0/s|m?dps|m?g)(?![\w:=/^]))?(?![\w:.])"
)
"""A name has at most 61 characters and its unit 40: the search takes time in proportion to the line."""
OF_A_DAY = r"\d{1,2}:\d{2}:\d{2}(?:[.,:]\d{1,6})?"
ARRIVED = re.compile(
    r"^(?:\[(?=[^\]\n]{7,30}\]) *(?:(?P<date>\d{4}-\d{2}-\d{2}[ T])|(?P<days>\d{1,5}) "
    r"|[A-Z][a-z]{2} (?P<month>[A-Z][a-z]{2}) {1,2}(?P<day>\d{1,2}) )?"
    rf"(?P<clock>{OF_A_DAY})(?: (?P<year>\d{{4}}))?\]"
    rf"|(?P<bare_date>\d{{4}}-\d{{2}}-\d{{2}}[ T])?(?P<bare_clock>{OF_A_DAY}) ?(?:->|>)"
    r"|[EWIDV] \((?P<booted_ms>\d{1,12})\) [\w.\-]{1,40}:"
    rf"|(?P<begun_date>\d{{4}}-\d{{2}}-\d{{2}} )?(?P<begun_clock>{OF_A_DAY})"
    r":?(?:[ \t]*$|[ \t]+(?=[A-Za-z][\w .]*[:=])| +(?=[-+.\d][^,;\t|]*[,;\t|])|\t(?=[-+.\d][^\t]*$))"
    r"(?! *[+-](?:\d\d:\d\d|(?:0\d|1[0-4])(?:00|30|45))[,;\t|]))[ \t]*"
)
"""The time at which a serial monitor received a line: `12:30:01.123 -> `, `12:30:01 -> `,
`[2026-03-02 12:30:01.123] `; CoolTerm's, with no mark before a number or a label; Tera Term's
`[Mon Mar 02 12:30:01.123 2026] `, and its time since the start, `[0 00:00:01.123] `, with the days;
an ESP32's milliseconds since it started, `I (1250) imu: `."""
STAMPED_NAMES = re.compile(rf"^(?:\d{{4}}-\d{{2}}-\d{{2}} )?{OF_A_DAY}:?[ \t]+(?=[A-Za-z])")
ARRIVAL = "arrived"
TRIPLE = re.compile(
    r"([A-Za-z]\w{0,30}) ?[:=] *([-+]?\d++(?:\.\d*+)?+)[, \t]++([-+]?\d++(?:\.\d*+)?+)"
    r"[, \t]++([-+]?\d++(?:\.\d*+)?+)(?: *([A-Za-z°][\w°/^]{0,10}))?[ \t\r]*"
)
"""SparkFun's sketches print `A: 0.01, 0.02, 0.99 g`."""
LABELLED_LINES, FEWEST_LINES = 40, 3


@dataclass(frozen=True, slots=True)
class LabelWriter:
    """Writes the values of labelled rows with tabs between them; other lines are left as they are.

    ``groups``: the names of a line, in their order, "arrived" first if a serial monitor put its time before
    each line. If several lines make one row, a line for each sensor say, the names of each; the time is then
    that of the first.
    """

    groups: tuple[tuple[str, ...], ...]
    _row: list[str] = field(default_factory=list, init=False, compare=False)
    _next: list[int] = field(default_factory=lambda: [0], init=False, compare=False)
    _lines: list[int] = field(default_factory=lambda: [-1, 0], init=False, compare=False)

    @property
    def labels(self) -> tuple[str, ...]:
        """The names of a row."""
        first, *others = self.groups
        return (*first, *(label for group in others for label in group if label != ARRIVAL))

    def rewrite(self, text: str) -> str:
        """Rewrite whole lines."""
        *lines, last = text.split("\n")
        rewritten = [line for line in map(self._rewrite_line, lines) if line is not None]
        is_torn = last and read_labels(last)[0] not in self.groups  # the end of a file that was cut
        return "\n".join([*rewritten, last if is_torn else (self._rewrite_line(last) or "") if last else ""])

    def tabulate_head(self, head: str) -> str:
        """Rewrite the head as a table, with a line of names before the first row."""
        lines = replace(self).rewrite(head).split("\n")
        first = next(k for k, line in enumerate(head.split("\n")) if read_labels(line)[0] in self.groups)
        return "\n".join([*lines[:first], "\t".join(self.labels), *lines[first:]])

    def _rewrite_line(self, line: str) -> str | None:
        """Return the row that ends with a line, the line itself if it belongs to none, None within a row.

        Of several lines to a row, others between them (blank, or of the temperature) belong to none either.
        """
        names, values = read_labels(line)
        if names not in self.groups:
            return None if len(self.groups) > 1 and self._lines[0] >= 0 else line
        place = self.groups.index(names)
        filler = self._end_row(place)
        if place == 0:
            self._row[:] = values
        elif place == self._next[0]:
            self._row.extend(values[names[0] == ARRIVAL :])
        else:  # the lines before it are lost
            self._next[0] = 0
            return filler
        self._next[0] = (place + 1) % len(self.groups)
        return filler if self._next[0] else "\t".join(self._row)

    def _end_row(self, place: int) -> str | None:
        """Return a row without values for the row before, if it lacked a line and no stamp shows the hole."""
        last, found = self._lines
        is_next = place <= last
        is_lost = is_next and found < len(self.groups) and self.groups[0][0] != ARRIVAL
        self._lines[:] = place, 1 if is_next else found + 1
        return "\t".join(["nan"] * len(self.labels)) if is_lost else None


def read_labels(line: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Read the names and the values of a line; `Accel X: 1 Y: 2 Z: 3` names three axes of one sensor.

    So does `A: 1, 2, 3 g`, with their unit.
    """
    arrived = ARRIVED.match(line)
    labels, values = ([ARRIVAL], [_read_arrival(arrived)]) if arrived else ([], [])
    rest = line[arrived.end() :] if arrived else line
    if triple := TRIPLE.fullmatch(rest):
        name, *axes, unit = triple.groups()
        labels += [f"{name} {axis}" + (f" ({unit})" if unit else "") for axis in "XYZ"]
        return tuple(labels), (*values, *axes)
    units: list[str] = [""] * len(labels)
    for label, value, unit in PAIR.findall(rest):
        is_later = label.lower() in ("y", "z") and labels and labels[-1][-1:].lower() in "xy"
        labels.append(labels[-1][:-1] + label if is_later else label)
        values.append(value)
        units.append(unit)
        for k in range(len(units) - 2, -1, -1) if is_later and unit else ():  # `X: 1, Y: 2, Z: 3 m/s^2`
            if units[k] or labels[k][:-1] != labels[-1][:-1]:
                break
            units[k] = unit
    named = (f"{label} ({unit})" if unit else label for label, unit in zip(labels, units, strict=True))
    return tuple(named), tuple(values)


def _find_groups(lines: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Find the names of the lines that form one row; empty if they name fewer than two sensors."""
    lines = [line for line in lines if ARRIVED.sub("", line).strip()]
    named = [labels for labels, _ in map(read_labels, lines) if len(labels) >= len(AXES)]
    counts = Counter(named)
    usual = [labels for labels in dict.fromkeys(named) if counts[labels] >= FEWEST_LINES]
    columns = [parse_column_name(label) for labels in usual for label in labels]
    is_whole = choose_vector(columns, "acc") and choose_vector(columns, "gyr")
    return tuple(usual) if is_whole and 2 * sum(counts[one] for one in usual) > len(lines) else ()


def _read_arrival(found: re.Match[str]) -> str:
    """Write the time of a serial monitor in the form of the other stamps, or as seconds since the start."""
    if found["booted_ms"]:
        return f"{int(found['booted_ms']) / 1000:.3f}"
    clock = (found["clock"] or found["bare_clock"] or found["begun_clock"]).replace(",", ".")
    hour, minute, second, *fraction = clock.replace(".", ":").split(":")
    fraction = fraction or ["0"]
    if found["days"]:
        return (
            f"{86_400 * int(found['days']) + 3600 * int(hour) + 60 * int(minute) + int(second)}.{fraction[0]}"
        )
    day = (found["date"] or found["bare_date"] or found["begun_date"] or "").replace(" ", "T")
    if found["month"] and found["year"]:
        day = f"{found['year']}-{MONTHS.get(found['month'].lower(), 0):02d}-{int(found['day']):02d}T"
    return f"{day}{hour}:{minute}:{second}.{fraction[0]}"


@dataclass(frozen=True, slots=True)
class ArrivalWriter:
    """Writes the time that a serial monitor put before each line as a column; other lines stay as they are.

    ``delimiter``: that of the rows; ``width``: how many values follow the time. A line of so many names that
    a person added has no time before it.
    """

    delimiter: str
    width: int

    def rewrite(self, text: str) -> str:
        """Rewrite whole lines."""
        return "\n".join(map(self._rewrite_line, text.split("\n")))

    def _rewrite_line(self, line: str) -> str:
        found = ARRIVED.match(line)
        if found is None:
            line = STAMPED_NAMES.sub("", line)
            is_header = line.lstrip('"\ufeff ')[:1].isalpha() and self._count(line) == self.width
            return f"{ARRIVAL}{self.delimiter}{line}" if is_header else line
        rest = line[found.end() :]
        if not rest.strip():
            return ""
        is_header = rest.lstrip('" ')[:1].isalpha()
        return f"{ARRIVAL if is_header else _read_arrival(found)}{self.delimiter}{rest}"

    def _count(self, line: str) -> int:
        return len(split_fields(line, self.delimiter))


# A time in several columns: its parts, or in UTC and as local time.

TIME_PARTS: Mapping[str, int] = {
    **dict.fromkeys(("year", "yyyy", "annee"), 0),
    **dict.fromkeys(("month", "mois"), 1),
    **dict.fromkeys(("day", "dd", "jour"), 2),
    **dict.fromkeys(("hour", "hours", "hh", "hr", "h", "heure", "heures"), 3),
    **dict.fromkeys(("minute", "minutes", "min", "mins", "mm", "m"), 4),
    **dict.fromkeys(("second", "seconds", "sec", "secs", "ss", "s", "seconde", "secondes"), 5),
    **dict.fromkeys(("millisecond", "milliseconds", "millis", "msec", "ms", "millisecondes"), 6),
}
"""Names of the columns of year, month, day, hour, minute, second and thousandths of it."""
OF_DATE, OF_CLOCK, THOUSANDTHS = (0, 1, 2), (3, 4, 5), 6
LATEST_PARTS = (2099, 12, 31, 23, 59, 60, 999)
ANY_DATE = re.compile(r"\d{1,4}([/.\-])\d{1,2}\1\d{1,4}")
UTC_NAME = re.compile(r"(?<![a-z])(?:utc|gmt)(?![a-z])", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class ClockWriter:
    """Joins the parts of a time (`7,58,0.01` to `07:58:00.01`), and empties the columns of another clock.

    ``parts``: the columns of :data:`TIME_PARTS`, -1 for none; the time replaces the first of them.
    """

    delimiter: str
    parts: tuple[int, ...] = ()
    emptied: tuple[int, ...] = ()

    def rewrite(self, text: str) -> str:
        """Rewrite whole lines."""
        return "\n".join(map(self._rewrite_line, text.split("\n")))

    def _rewrite_line(self, line: str) -> str:
        fields = _cut_fields(line, self.delimiter)
        places = [place for place in self.parts if place >= 0]
        if len(fields) <= max((*places, *self.emptied)) or not any(map(str.isdigit, line)):
            return line
        if self.parts:
            joined = join_parts([fields[k].strip('" \r') if k >= 0 else "" for k in self.parts])
            if joined is None:
                return line
            for place in places:
                fields[place] = joined if place == min(places) else ""
        for place in self.emptied:
            if STAMP_LIKE.search(fields[place]):
                fields[place] = ""
        return self.delimiter.join(fields)


def join_parts(parts: Sequence[str]) -> str | None:
    """Write the values of :data:`TIME_PARTS`, "" for none, as a time; None for other values."""
    whole = [part.partition(".")[0] if k == OF_CLOCK[2] else part for k, part in enumerate(parts)]
    if not all(
        part.isdigit() and int(part) <= most for part, most in zip(whole, LATEST_PARTS, strict=True) if part
    ):
        return None
    year, month, day, hour, minute, _, thousandths = parts
    second, _, fraction = parts[OF_CLOCK[2]].partition(".")
    fraction = fraction or (f"{int(thousandths):03d}" if thousandths else "")
    clock = f"{hour:0>2}:{minute:0>2}:{second:0>2}" + (f".{fraction}" if fraction else "")
    return f"{year}-{month:0>2}-{day:0>2}T{clock}" if year and month and day else clock


def _find_clock_parts(lines: Sequence[str], stated_time: Place | None) -> ClockWriter | None:
    """Find a header that names the parts of a time, or one time in UTC beside another; None for others.

    The time in UTC is not used, unless a person states that it is the time.
    """
    for k, line in enumerate(lines[:FEWEST_HEADER_LINES]):
        for delimiter in DELIMITERS[:-1]:
            names = split_fields(COMMENT.sub("", line), delimiter)
            if len(names) < MIN_COLUMNS or any(map(NUMBER.fullmatch, names)):
                continue
            rows = [split_fields(row, delimiter) for row in lines[k + 1 : k + 1 + FEWEST_HEADER_LINES]]
            rows = [row for row in rows if len(row) >= MIN_COLUMNS][-FEWEST_LINES:]
            parts = _find_parts(names, rows)
            emptied = _find_other_clock(names, rows, stated_time)
            if parts or emptied:
                return ClockWriter(delimiter, parts, emptied)
    return None


def _find_other_clock(
    names: Sequence[str], rows: Sequence[Sequence[str]], stated_time: Place | None
) -> tuple[int, ...]:
    """Return the columns of times in UTC if others are not, with a date if those in UTC have one."""
    stamps = {k for row in rows for k, field in enumerate(row[: len(names)]) if STAMP_LIKE.search(field)}
    dated = {k for row in rows for k in stamps if k < len(row) and ANY_DATE.search(row[k])}
    utc = {k for k in stamps if UTC_NAME.search(names[k])}
    wanted = stated_time - 1 if isinstance(stated_time, int) else None
    wanted = names.index(stated_time) if stated_time in names else wanted
    if not utc or utc == stamps or (dated & utc and not dated - utc):
        return ()
    return tuple(sorted(stamps - utc if wanted in utc else utc))


def _find_parts(names: Sequence[str], rows: Sequence[Sequence[str]]) -> tuple[int, ...]:
    """Return the columns of the parts of a time if hour, minute and second are there; else nothing."""
    found = [-1] * len(LATEST_PARTS)
    for place, name in enumerate(names):
        part = TIME_PARTS.get(re.sub(r"[\W_]", "", name.lower()))
        if part is not None and found[part] < 0:
            found[part] = place
    if any(found[part] < 0 for part in OF_CLOCK) or not rows:
        return ()
    if any(found[part] < 0 for part in OF_DATE):
        found[:3] = [-1] * 3
    read = [join_parts([row[k] if 0 <= k < len(row) else "" for k in found]) for row in rows]
    if None in read and found[THOUSANDTHS] >= 0:  # a counter of milliseconds since power-on
        found[THOUSANDTHS] = -1
        read = [join_parts([row[k] if 0 <= k < len(row) else "" for k in found]) for row in rows]
    return () if None in read else tuple(found)


# The layout of a head.

ASKED = ("date-order", "dates")
"""Problems of dates whose form is known."""


@dataclass(frozen=True, slots=True)
class TextLayout:
    """How a table is written.

    ``header`` is the header line as written, None if there is none; ``first_line`` counts lines before
    the first row of numbers; ``preamble`` holds the lines before the header; ``sample_rows`` some rows,
    split. ``dates``: how stamps are written, if they are not ISO without an offset. ``is_single_spaced``:
    each space of a row is a separator, with nothing between two of them where a value is absent; such rows
    are read with their spaces as tabs. ``device``: the known device whose header this is.
    ``writer``: how rows that name every value, or begin with a serial monitor's time, are rewritten.
    ``doubt``: why a time in a column cannot be read, if a person says which column is the time.
    ``misfit_header``: a header with more or fewer names than the rows have fields; ``header`` is then None.
    ``fields_of_a_row``: the fewest and the most; columns that are not always there come last.
    """

    delimiter: str
    decimal: str
    header: str | None
    columns: tuple[Column, ...]
    first_line: int
    preamble: tuple[str, ...]
    sample_rows: tuple[tuple[str, ...], ...]
    dates: DateDialect | None = None
    is_single_spaced: bool = False
    device: KnownDevice | None = None
    writer: LabelWriter | ArrivalWriter | ClockWriter | None = None
    doubt: UnusableTime | None = None
    misfit_header: str = ""
    fields_of_a_row: tuple[int, int] = (0, 0)

    @property
    def n_columns(self) -> int:
        """Fields of a row."""
        return len(self.columns)

    def facts(self) -> dict[str, str]:
        """`key: value` and `key = value` lines of the preamble, keys in lower case."""
        found = (
            re.match(r"[\s#/;%\"]*+([A-Za-z][\w \-]{0,40}?)\s*+[:=]\s*+(.)(.*)$", x) for x in self.preamble
        )
        return {m[1].lower().replace(" ", "_"): m[2] + m[3].rstrip(FILLERS) for m in found if m}


@lru_cache(maxsize=4)
def find_layout(
    head: str, order: DateOrder | None = None, *, stated_time: Place | None = None, fewest: int = MIN_COLUMNS
) -> TextLayout | None:
    """Understand the head of a table; None if no rows of ``fewest`` numbers are found.

    Every reader calls this for the same head, so the last results are cached.

    ``stated_time``: the column that a person states as the time, by name or number from 1; "": none is;
    0: all columns are to be shown; None: nobody states anything.

    Raises
    ------
    AmbiguousDecimal
        The comma is both separator and decimal mark.
    acromion.fusion.errors.UnusableTime
        The stamps cannot be understood, as in :func:`acromion.fusion.readers.tables.columns.find_dates`
        (``order``: of day, month and year, as a person gives it).
    """
    lines = [line for line in head.split("\n")[:LABELLED_LINES] if line.strip()]
    named = [labels for labels, _ in map(read_labels, lines) if len(labels) >= MIN_COLUMNS]
    is_labelled = len(named) >= FEWEST_LINES and 2 * named.count(named[-1]) > len(lines)
    if groups := (named[-1],) if is_labelled else _find_groups(lines):  # most rows begin their values so
        layout = _find_table(LabelWriter(groups).tabulate_head(head), order, stated_time=stated_time)
        return (
            replace(layout, writer=LabelWriter(groups), first_line=layout.first_line - 1) if layout else None
        )
    rests = [line[found.end() :] for line in lines if (found := ARRIVED.match(line))]
    if len(rests) < FEWEST_LINES or 2 * len(rests) <= len(lines):
        writer = None if stated_time == 0 else _find_clock_parts(head.split("\n"), stated_time)
        rewritten = writer.rewrite(head) if writer else head
        layout = _find_table(rewritten, order, stated_time=stated_time, fewest=fewest)
        return replace(layout, writer=writer) if layout else None
    counts = {mark: sum(rest.count(mark) for rest in rests) for mark in DELIMITERS[:-1]}
    delimiter = max(counts, key=lambda mark: counts[mark])
    delimiter = delimiter if counts[delimiter] >= len(rests) else " "
    widths = Counter(len(split_fields(rest, delimiter)) for rest in rests)
    arrivals = ArrivalWriter(delimiter, widths.most_common(1)[0][0])
    layout = _find_table(arrivals.rewrite(head), order, stated_time=stated_time, fewest=fewest)
    if layout and layout.header is None:
        layout = replace(layout, columns=(Column(ARRIVAL, "time"), *layout.columns[1:]))
    return replace(layout, writer=arrivals) if layout else None


def _find_table(
    head: str, order: DateOrder | None, *, stated_time: Place | None, fewest: int = MIN_COLUMNS
) -> TextLayout | None:
    """Parse a head whose rows do not name their values."""
    try:
        dates, doubt = find_dates(head, order, fewest), None
    except UnusableTime as error:  # another column may hold a time that can be read
        dates, doubt = None, error
    if dates is not None and not dates.is_iso:
        head = StampWriter(dates).rewrite(head)
    # only newlines count as line ends, as in the kernel: str.splitlines knows many more
    lines = [line.rstrip("\r") for line in head.split("\n")]
    lines = (lines[:-1] if len(lines) > 1 else lines)[:SNIFFED_LINES]
    for line in lines[:FEWEST_HEADER_LINES]:  # before their times or columns are found wanting
        if any(names_epochs(split_fields(line, mark)) for mark in DELIMITERS[:-1]):
            raise EpochFile
    votes = {
        mark: Counter(len(split_fields(line, mark)) for line in lines if is_row(line, mark, fewest))
        for mark in DELIMITERS
    }
    delimiter = max(DELIMITERS, key=lambda mark: max(votes[mark].values(), default=0))
    if not votes[delimiter]:
        delimiter, lines = _hide_words(lines, fewest)
    elif _begins_with_words(lines, delimiter, fewest):
        hidden = _hide_words(lines, fewest)
        delimiter, lines = hidden if hidden[1] and hidden[0] == delimiter else (delimiter, lines)
    if not lines:
        if doubt is not None:
            raise doubt
        return None
    if delimiter == " " and (tabbed := _tab_single_spaces(lines, fewest)):
        return replace(_describe(tabbed, "\t", fewest), is_single_spaced=True)
    layout = replace(_describe(lines, delimiter, fewest), dates=dates)
    if doubt is None or any(c.channel == "time" and c.unit for c in layout.columns):
        return layout
    if stated_time is None or doubt.facts["why"] in ASKED:
        raise doubt
    return replace(layout, doubt=doubt)


def _begins_with_words(lines: Sequence[str], delimiter: str, fewest: int) -> bool:
    """Return whether a line with a word among its numbers precedes the first row that has values alone."""
    first = next(k for k, line in enumerate(lines) if is_row(line, delimiter, fewest))
    width = lines[first].count(delimiter)
    above = [split_fields(line, delimiter) for line in lines[:first] if line.count(delimiter) == width]
    return any(sum(bool(NUMBER.fullmatch(field)) for field in row) >= fewest for row in above)


def _hide_words(lines: Sequence[str], fewest: int) -> tuple[str, list[str]]:
    """Replace words in columns without a channel by 0; return no lines if rows have too few numbers.

    Columns with a label or a device name are ignored, so that the rows can be read. If no header names six
    channels, a person may name them.
    """
    for k, line in enumerate(lines):
        for delimiter in DELIMITERS[:-1]:
            names = split_fields(line, delimiter)
            columns = [parse_column_name(name) for name in names]
            axes = sum(column.channel in ("acc", "gyr") for column in columns)
            if axes >= MIN_COLUMNS or (fewest < MIN_COLUMNS and find_own_axes(names)):
                hidden = [_hide_fields(row, delimiter, columns) for row in lines[k + 1 :]]
                found = any(is_row(row, delimiter, fewest) for row in hidden)
                return delimiter, [*lines[: k + 1], *hidden] if found else []
    for delimiter in DELIMITERS[:-1]:
        fields = [split_fields(line, delimiter) for line in lines]
        numbers = [sum(bool(NUMBER.fullmatch(field)) for field in row) for row in fields]
        widths = Counter(len(row) for row, count in zip(fields, numbers, strict=True) if count >= MIN_COLUMNS)
        width, count = widths.most_common(1)[0] if widths else (0, 0)
        if count >= FEWEST_LINES and 2 * count > len(lines):
            unnamed = [Column("", "other")] * width
            return delimiter, [
                _hide_fields(line, delimiter, unnamed) if found >= MIN_COLUMNS else line
                for line, found in zip(lines, numbers, strict=True)
            ]
    return "", []


def _hide_fields(row: str, delimiter: str, columns: Sequence[Column]) -> str:
    """Hide labels, and dates in an unknown form."""
    fields = _cut_fields(row, delimiter)
    if len(fields) < len(columns):
        return row
    for k, column in enumerate(columns):
        if column.channel in ("other", "time") and not _is_value(fields[k].strip()):
            fields[k] = "0"
    return delimiter.join(fields)


def _tab_single_spaces(lines: Sequence[str], fewest: int) -> list[str] | None:
    """Replace spaces by tabs if the header has one name per space of a row, not one per run of spaces."""
    rows = [k for k, line in enumerate(lines) if is_row(line, " ", fewest)]
    header = find_header(lines, rows[0], " ")
    if header is None:
        return None
    header_at = header.first_line
    width = len(lines[header_at].split(" "))
    if any(len(lines[k].split(" ")) != width or len(lines[k].split()) == width for k in rows):
        return None
    tabbed = [line.replace(" ", "\t") if k >= header_at else line for k, line in enumerate(lines)]
    return tabbed if any(is_row(line, "\t", fewest) for line in tabbed) else None


def _describe(lines: Sequence[str], delimiter: str, fewest: int = MIN_COLUMNS) -> TextLayout:
    rows = [k for k, line in enumerate(lines) if is_row(line, delimiter, fewest)]
    found = find_header(lines, rows[0], delimiter)
    samples = tuple(tuple(split_fields(lines[k], delimiter)) for k in rows)
    columns = found.columns if found else tuple(Column("", "other") for _ in samples[0])
    if delimiter == "," and found is not None:
        # a row with about twice as many whole numbers as the header has names was split at its decimals
        width, names = len(samples[0]), len(columns)
        is_whole = all(WHOLE.fullmatch(field) for row in samples[:20] for field in row)
        if is_whole and 2 * names - 2 <= width <= 2 * names and width > names:
            raise AmbiguousDecimal(line=rows[0] + 1)
    if delimiter == "," and _holds(WITH_COMMA, samples):  # between quotes
        raise AmbiguousDecimal(line=rows[0] + 1)
    width = Counter(map(len, samples)).most_common(1)[0][0]
    cut = {
        k: lines[k].split() if delimiter == " " else _cut_fields(lines[k], delimiter)
        for k in range(rows[0], len(lines))
    }
    usual, misfit_header = Counter(len(cut[k]) for k in rows).most_common(1)[0][0], ""
    is_whole = any(len(fields) == len(columns) for fields in cut.values())
    if width > len(columns) or (
        usual < len(columns) and not is_whole
    ):  # which name belongs to which is unknown
        misfit_header, found = (found.names.strip() if found else ""), None
    if found is None:
        columns = (Column("", "other"),) * usual
    above = split_fields(lines[rows[0] - 1], delimiter) if rows[0] and found is None else ()
    preamble = tuple(lines[: found.first_line if found else rows[0]])
    device = find_known_device(found.names, preamble) if found else None
    units = {"acc": device.acc_unit, "gyr": device.gyr_unit, "time": device.time_unit} if device else {}
    return TextLayout(
        delimiter=delimiter,
        decimal="," if delimiter != "," and _holds(WITH_COMMA, samples) else ".",
        header=found.names if found else None,
        columns=tuple(
            replace(one, unit=units.get(one.channel) or None) if one.unit is None else one for one in columns
        ),
        first_line=found.stop_line if found else rows[0],
        preamble=preamble,
        sample_rows=samples,
        device=device,
        misfit_header=misfit_header,
        fields_of_a_row=(min(usual, len(columns)), max(usual, len(columns), len(above))),
    )


def _holds(pattern: re.Pattern[str], rows: Iterable[Sequence[str]]) -> bool:
    return any(pattern.fullmatch(field) for row in rows for field in row)


# The layout by head, middle and tail of a file, and its caveats: encoding, locale, rounding.

SAMPLE_BYTES = 1 << 15
SAMPLED_PLACES = (0.5, 1.0)
"""Where to look besides the head: the middle and the tail."""
COARSEST_STEP_G = 0.009
"""Half a degree of tilt: an accelerometer's own step is a tenth of it."""


def read_layout(
    source: Source, order: DateOrder | None = None, *, stated_time: Place | None = None
) -> TextLayout | None:
    """Parse a table from its head, and from its middle and tail if the head has whole numbers only.

    Raises
    ------
    AmbiguousDecimal
        Further on, numbers contain the comma that separates columns.
    acromion.fusion.errors.FusionError
        As :func:`find_layout`.
    """
    fewest = COLUMNS_OF_THIGH if source.is_thigh else MIN_COLUMNS
    layout = sniff_layout(source, order, stated_time=stated_time, fewest=fewest)
    if layout is None or find_form(source.head).encoding or isinstance(source.file, UnpackedFile):
        return layout
    has_point = any(re.search(r"\d\.\d", field) for row in layout.sample_rows for field in row)
    if layout.decimal == "," or has_point or source.size_bytes <= len(source.head):
        return layout
    rows: list[list[str]] = []
    for place in SAMPLED_PLACES:
        source.file.seek(max(0, round(place * source.size_bytes) - SAMPLE_BYTES))
        lines = source.file.read(SAMPLE_BYTES).decode("latin-1").splitlines()[1:-1]
        rows += [split_fields(line, layout.delimiter) for line in lines]
    if layout.delimiter == ",":
        widths = [len(row) for row in rows if all(WHOLE.fullmatch(field) for field in row)]
        if widths and min(widths) > layout.n_columns:
            raise AmbiguousDecimal(line=layout.first_line)
        return layout
    return replace(layout, decimal=",") if _holds(WITH_COMMA, rows) else layout


def sniff_layout(
    source: Source,
    order: DateOrder | None = None,
    *,
    stated_time: Place | None = None,
    fewest: int = MIN_COLUMNS,
) -> TextLayout | None:
    """Parse a table from its head and, if day and month remain ambiguous, from its last row.

    Raises FusionError: as :func:`find_layout`.
    """
    head = decode_head(source)
    first = find_open_date(head, fewest)
    if first and order is None:
        last = find_last_date(_read_tail(source), fewest)
        order = find_order_by_span(first, last) if last else None
    return find_layout(head, order, stated_time=stated_time, fewest=fewest)


def _read_tail(source: Source) -> str:
    """Return the last bytes as text; a packed file is unpacked to its end."""
    tail = b""
    if isinstance(source.file, UnpackedFile):
        for chunk in read_chunks(source):
            tail = (tail + chunk)[-SAMPLE_BYTES:]
    else:
        source.file.seek(max(0, source.size_bytes - SAMPLE_BYTES) // 2 * 2)
        tail = source.file.read()
    form = find_form(source.head)
    text = tail.decode(form.encoding or "latin-1", errors="replace")
    return text.replace("\r", "\n") if form.is_return_only else text


def flag_text(source: Source, layout: TextLayout) -> tuple[QualityFlag, ...]:
    """Flag the encoding, a decimal comma, and rounded values."""
    is_utf8 = True
    try:
        source.head.decode("utf-8")
    except UnicodeDecodeError as error:  # a character may be cut at the head's end
        is_utf8 = error.start >= len(source.head) - 3
    # the acceleration has lost decimals if its steps are coarser than any sensor's
    places = choose_vector(layout.columns, "acc") or ()
    scale_g = acc_scale_g(layout.columns[places[0]].unit) if places else None
    fields = [row[place] for row in layout.sample_rows for place in places if place < len(row)]
    fractions = (re.fullmatch(r"[-+]?\d*[.,](\d+)", field) for field in fields)
    decimals = max((len(match.group(1)) for match in fractions if match), default=0)
    found = {
        Caveat.ENCODING: find_form(source.head).encoding is not None or not is_utf8,
        Caveat.LOCALE: layout.decimal == ",",
        Caveat.PRECISION: decimals > 0 and (scale_g or 0.0) * 10.0**-decimals > COARSEST_STEP_G,
    }
    return tuple(QualityFlag(code) for code, is_found in found.items() if is_found)


# Text of any encoding and line ends as pieces of whole lines in bytes.

TEXT_CHUNK_BYTES = 1 << 20
"""Small enough that a piece and its field ends stay in the processor's cache."""
MAX_LINE_BYTES = 1 << 16
UTF8_MARK = codecs.BOM_UTF8
UTF16_MARKS = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


@dataclass(frozen=True, slots=True)
class TextForm:
    """How the bytes become lines: encoding (None: bytes as they are), byte order mark, line end."""

    encoding: str | None
    mark_bytes: int
    is_return_only: bool


def find_form(head: bytes) -> TextForm:
    """Judge by the first bytes."""
    encoding = UTF16_MARKS.get(head[:2])
    mark_bytes = 2 if encoding else len(UTF8_MARK) if head.startswith(UTF8_MARK) else 0
    is_return_only = encoding is None and b"\r" in head and b"\n" not in head
    return TextForm(encoding, mark_bytes, is_return_only)


def decode_head(source: Source) -> str:
    """Return the head as text with newlines; undecodable bytes become Windows-1252 characters."""
    form = find_form(source.head)
    content = source.head[form.mark_bytes :]
    if form.is_return_only:
        content = content.replace(b"\r", b"\n")
    if form.encoding:
        return content[: len(content) // 2 * 2].decode(form.encoding, errors="replace")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        if error.start >= len(content) - 3:
            return content[: error.start].decode("utf-8")
        return content.decode("cp1252", errors="replace")


def read_text_pieces(source: Source) -> Iterator[bytes]:
    """Pieces in an encoding whose first 128 characters are ASCII, with newlines only."""
    form = find_form(source.head)
    decoder = codecs.getincrementaldecoder(form.encoding)(errors="replace") if form.encoding else None
    for chunk in read_chunks(source, form.mark_bytes, TEXT_CHUNK_BYTES):
        piece = decoder.decode(chunk).encode() if decoder else chunk
        yield piece.replace(b"\r", b"\n") if form.is_return_only else piece


def drop_lines(pieces: Iterable[bytes], line_count: int) -> Iterator[bytes]:
    """Skip the first ``line_count`` lines."""
    for piece in pieces:
        at = 0
        while line_count and (end := piece.find(b"\n", at) + 1):
            at, line_count = end, line_count - 1
        if line_count == 0:
            yield piece[at:] if at else piece


def read_line_pieces(pieces: Iterable[bytes]) -> Iterator[LinePiece]:
    """Cut pieces at line ends; add a line end to a last line without one.

    Only lines at the seams are copied: a line that continues in the next piece, and lines too near the ends
    of the bytes for :mod:`acromion.fusion.readers.tables.csv_lines`.

    Raises UnknownFormat if a line is longer than 64 KiB, because no table of samples has such a line.
    """
    carried = b""
    for piece in pieces:
        cut = piece.find(b"\n", LEAD_BYTES) + 1
        end = piece.rfind(b"\n", cut, max(cut, len(piece) - TRAIL_BYTES)) + 1
        if end == 0:
            end = cut = piece.rfind(b"\n") + 1
        if cut == 0:
            carried += piece
        else:
            yield _copy_lines(carried + piece[:cut])
            if end > cut:
                yield LinePiece(np.frombuffer(piece, np.uint8), cut, end)
            carried = piece[end:]
        if len(carried) - carried.rfind(b"\n") > MAX_LINE_BYTES:
            raise UnknownFormat(kind="text", line=1)
    if carried:
        yield _copy_lines(carried if carried.endswith(b"\n") else carried + b"\n")


def _copy_lines(lines: bytes) -> LinePiece:
    padded = bytes(LEAD_BYTES) + lines + bytes(TRAIL_BYTES)
    return LinePiece(np.frombuffer(padded, np.uint8), LEAD_BYTES, LEAD_BYTES + len(lines))
