"""Finding out how a table is written: preamble, header, delimiter, decimal mark, columns."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from fusion.errors import AmbiguousDecimal, UnknownColumns
from fusion.readers.columns import Column, understand_column
from fusion.readers.date_dialects import DateDialect, find_dates
from fusion.readers.date_order import DateOrder
from fusion.readers.stamp_writing import StampWriter

DELIMITERS = (";", "\t", ",", "|", " ")
NUMBER = re.compile(r"\s*\"?\s*[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?\s*\"?\s*")
CALENDAR = re.compile(r"\s*\"?\d{4}-\d{1,2}-\d{1,2}[T ]\d{1,2}:\d{2}:\d{2}([.,]\d+)?Z?\"?\s*")
WORD_ABSENT = frozenset({"", "-", "nan", "na", "null", "inf", "-inf"})
SNIFFED_LINES = 400
MIN_COLUMNS = 6


@dataclass(frozen=True, slots=True)
class TextLayout:
    """How a table is written.

    ``header`` is the header line as it stands, None where there is none; ``first_line`` counts lines before
    the first row of numbers; ``preamble`` holds the lines before the header; ``sample_rows`` some rows,
    split. ``dates``: how stamps are written, where they are not ISO without an offset. ``is_single_spaced``:
    each space of a row is a separator, with nothing between two of them where a value is absent; such rows
    are read with their spaces as tabs.
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

    @property
    def n_columns(self) -> int:
        """Fields of a row."""
        return len(self.columns)

    def facts(self) -> dict[str, str]:
        """`key: value` and `key = value` lines of the preamble, keys in lower case."""
        found = [
            re.match(r"[\s#/;%\"]*([A-Za-z][\w \-]{0,40}?)\s*[:=]\s*(.+?)[,;\s\"]*$", x)
            for x in self.preamble
        ]
        return {m.group(1).lower().replace(" ", "_"): m.group(2) for m in found if m}


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


@lru_cache(maxsize=2)
def find_layout(head: str, order: DateOrder | None = None) -> TextLayout | None:
    """Understand the head of a table; None where no rows of six numbers are found.

    Every reader asks this of the same head, so the last answers are kept.

    Raises
    ------
    AmbiguousDecimal
        The comma is both separator and decimal mark.
    UnknownColumns
        The rows have more fields than the header has names.
    fusion.errors.UnusableTime
        The stamps cannot be understood, as :func:`fusion.readers.date_dialects.find_dates` says (``order`` is
        what a person says of day, month and year).
    """
    dates = find_dates(head, order)
    if dates is not None and not dates.is_iso:
        head = StampWriter(dates).rewrite(head)
    # only newlines count as line ends, as in the kernel: str.splitlines knows many more
    lines = [line.rstrip("\r") for line in head.split("\n")]
    lines = (lines[:-1] if len(lines) > 1 else lines)[:SNIFFED_LINES]
    votes = {delimiter: _count_rows(lines, delimiter) for delimiter in DELIMITERS}
    delimiter = max(DELIMITERS, key=lambda mark: votes[mark])
    if votes[delimiter] == 0:
        delimiter, lines = _hide_words(lines)
    if not lines:
        return None
    if delimiter == " " and (tabbed := _tab_single_spaces(lines)):
        return replace(_describe(tabbed, "\t"), is_single_spaced=True)
    return replace(_describe(lines, delimiter), dates=dates)


def _hide_words(lines: Sequence[str]) -> tuple[str, list[str]]:
    """Write 0 for the words of columns that hold no channel; no lines where no header names six channels.

    A label, the name of a device: such a column is left aside, and the rows are rows all the same.
    """
    for k, line in enumerate(lines):
        for delimiter in DELIMITERS[:-1]:
            columns = [understand_column(name) for name in split_fields(line, delimiter)]
            if sum(column.channel in ("acc", "gyr") for column in columns) >= MIN_COLUMNS:
                hidden = [_hide_fields(row, delimiter, columns) for row in lines[k + 1 :]]
                found = any(is_row(row, delimiter) for row in hidden)
                return delimiter, [*lines[: k + 1], *hidden] if found else []
    return "", []


def _hide_fields(row: str, delimiter: str, columns: Sequence[Column]) -> str:
    fields = row.split(delimiter)
    if len(fields) < len(columns):
        return row
    names = [*columns, *[None] * (len(fields) - len(columns))]
    return delimiter.join(
        "0" if column is not None and column.channel == "other" and not is_value(field.strip()) else field
        for field, column in zip(fields, names, strict=True)
    )


def _tab_single_spaces(lines: Sequence[str]) -> list[str] | None:
    """Write tabs for spaces where the header has a name for each space of a row, not for each run of them."""
    rows = [k for k, line in enumerate(lines) if is_row(line, " ")]
    header_at = _find_header(lines, rows[0], " ")
    if header_at is None:
        return None
    width = len(lines[header_at].split(" "))
    if any(len(lines[k].split(" ")) != width or len(lines[k].split()) == width for k in rows):
        return None
    tabbed = [line.replace(" ", "\t") if k >= header_at else line for k, line in enumerate(lines)]
    return tabbed if any(is_row(line, "\t") for line in tabbed) else None


def _count_rows(lines: Sequence[str], delimiter: str) -> int:
    widths = Counter(len(split_fields(line, delimiter)) for line in lines if is_row(line, delimiter))
    return max(widths.values(), default=0)


def _describe(lines: Sequence[str], delimiter: str) -> TextLayout:
    rows = [k for k, line in enumerate(lines) if is_row(line, delimiter)]
    header_at = _find_header(lines, rows[0], delimiter)
    preamble_end = rows[0] if header_at is None else header_at
    samples = tuple(tuple(split_fields(lines[k], delimiter)) for k in rows)
    header = None if header_at is None else lines[header_at]
    names = split_fields(header, delimiter) if header is not None else [""] * len(samples[0])
    if delimiter == ",":
        _refuse_split_decimals(names, samples, rows[0] + 1, has_header=header is not None)
    if Counter(map(len, samples)).most_common(1)[0][0] > len(names):
        raise UnknownColumns(list=", ".join(names)[:200], line=rows[0] + 1)
    has_comma = delimiter != "," and any(re.fullmatch(r"[-+]?\d*,\d+", f) for row in samples for f in row)
    return TextLayout(
        delimiter=delimiter,
        decimal="," if has_comma else ".",
        header=header,
        columns=tuple(understand_column(name) for name in names),
        first_line=rows[0] if header_at is None else header_at + 1,
        preamble=tuple(lines[:preamble_end]),
        sample_rows=samples,
    )


def _find_header(lines: Sequence[str], first_row: int, delimiter: str) -> int | None:
    width = len(split_fields(lines[first_row], delimiter))
    for k in range(first_row - 1, max(-1, first_row - 4), -1):
        fields = split_fields(lines[k], delimiter)
        named = sum(understand_column(field).channel != "other" for field in fields)
        is_foreign = named > 0 and len(fields) == width and not any(map(is_value, fields))
        if len(fields) >= 3 and (named >= 3 or is_foreign):
            return k
    return None


def _refuse_split_decimals(
    names: Sequence[str], samples: Sequence[Sequence[str]], line: int, *, has_header: bool
) -> None:
    """A row with about twice as many whole numbers as the header has names was split at its decimals."""
    width = len(samples[0])
    whole = all(re.fullmatch(r"[-+]?\d*", field) for row in samples[:20] for field in row)
    if has_header and whole and 2 * len(names) - 2 <= width <= 2 * len(names) and width > len(names):
        raise AmbiguousDecimal(line=line)


def vote_decimal(layout: TextLayout, lines: Sequence[str]) -> TextLayout:
    """Settle the decimal mark by lines from further on, where the head holds whole numbers only.

    Raises
    ------
    AmbiguousDecimal
        Further on, the comma that separates columns stands in numbers too.
    """
    if layout.decimal == "," or any(
        re.search(r"\d\.\d", field) for row in layout.sample_rows for field in row
    ):
        return layout
    rows = [split_fields(line, layout.delimiter) for line in lines]
    if layout.delimiter == ",":
        widths = [len(row) for row in rows if all(re.fullmatch(r"[-+]?\d*", field) for field in row)]
        if widths and min(widths) > layout.n_columns:
            raise AmbiguousDecimal(line=layout.first_line)
        return layout
    has_comma = any(re.fullmatch(r"[-+]?\d*,\d+", field) for row in rows for field in row)
    return replace(layout, decimal=",") if has_comma else layout
