"""The layout of a table: encoding, preamble, header, delimiter, decimal mark, columns."""

import codecs
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.devices import KnownDevice, find_known_device
from fusion.errors import AmbiguousDecimal, EpochFile, UnknownColumns, UnknownFormat, UnusableTime
from fusion.readers.archives import UnpackedFile
from fusion.readers.source import Source, read_chunks
from fusion.readers.tables.columns import Column, choose_vector, names_epochs, parse_column_name
from fusion.readers.tables.dates import (
    DateDialect,
    DateOrder,
    StampWriter,
    find_dates,
    find_last_date,
    find_open_date,
    find_order_by_span,
)
from fusion.readers.tables.header import MIN_COLUMNS, find_header, is_row, is_value, split_fields
from fusion.readers.tables.labels import LabelWriter, find_labels, tabulate_head
from fusion.readers.tables.machine_words import LEAD_BYTES, NEWLINE, TRAIL_BYTES
from fusion.recording import QualityFlag
from fusion.units import acc_scale_g

DELIMITERS = (";", "\t", ",", "|", " ")
SNIFFED_LINES, FEWEST_HEADER_LINES = 400, 40


@dataclass(frozen=True, slots=True)
class TextLayout:
    """How a table is written.

    ``header`` is the header line as it stands, None where there is none; ``first_line`` counts lines before
    the first row of numbers; ``preamble`` holds the lines before the header; ``sample_rows`` some rows,
    split. ``dates``: how stamps are written, where they are not ISO without an offset. ``is_single_spaced``:
    each space of a row is a separator, with nothing between two of them where a value is absent; such rows
    are read with their spaces as tabs. ``device``: the known device whose header this is.
    ``labels``: how rows that name every value are rewritten.
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
    labels: LabelWriter | None = None

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
        The stamps cannot be understood, as in :func:`fusion.readers.tables.dates.find_dates` (``order``: of
        day, month and year, as a person gives it).
    """
    writer = find_labels(head)
    if writer is not None:
        layout = _find_table(tabulate_head(head, writer), order)
        return replace(layout, labels=writer, first_line=layout.first_line - 1) if layout else None
    return _find_table(head, order)


def _find_table(head: str, order: DateOrder | None) -> TextLayout | None:
    """Understand a head, where the rows do not name their values."""
    try:
        dates, doubt = find_dates(head, order), None
    except UnusableTime as error:  # another column may hold a time that can be read
        dates, doubt = None, error
    if dates is not None and not dates.is_iso:
        head = StampWriter(dates).rewrite(head)
    # only newlines count as line ends, as in the kernel: str.splitlines knows many more
    lines = [line.rstrip("\r") for line in head.split("\n")]
    lines = (lines[:-1] if len(lines) > 1 else lines)[:SNIFFED_LINES]
    _refuse_epochs(lines)
    votes = {delimiter: _count_rows(lines, delimiter) for delimiter in DELIMITERS}
    delimiter = max(DELIMITERS, key=lambda mark: votes[mark])
    if votes[delimiter] == 0:
        delimiter, lines = _hide_words(lines)
    if not lines:
        if doubt is not None:
            raise doubt
        return None
    if delimiter == " " and (tabbed := _tab_single_spaces(lines)):
        return replace(_describe(tabbed, "\t"), is_single_spaced=True)
    layout = replace(_describe(lines, delimiter), dates=dates)
    if doubt is not None and not any(c.channel == "time" and c.unit for c in layout.columns):
        raise doubt
    return layout


def _refuse_epochs(lines: Sequence[str]) -> None:
    """Refuse counts and epochs as such, before their times or columns are found wanting."""
    for line in lines[:FEWEST_HEADER_LINES]:
        if any(names_epochs(split_fields(line, mark)) for mark in DELIMITERS[:-1]):
            raise EpochFile


def _hide_words(lines: Sequence[str]) -> tuple[str, list[str]]:
    """Write 0 for the words of columns that hold no channel; no lines where no header names six channels.

    A label, the name of a device: such a column is left aside, and the rows are rows all the same.
    """
    for k, line in enumerate(lines):
        for delimiter in DELIMITERS[:-1]:
            columns = [parse_column_name(name) for name in split_fields(line, delimiter)]
            if sum(column.channel in ("acc", "gyr") for column in columns) >= MIN_COLUMNS:
                hidden = [_hide_fields(row, delimiter, columns) for row in lines[k + 1 :]]
                found = any(is_row(row, delimiter) for row in hidden)
                return delimiter, [*lines[: k + 1], *hidden] if found else []
    return "", []


HIDDEN = ("other", "time")
"""Columns in which words may stand: labels, and dates of a form that is not known."""


def _hide_fields(row: str, delimiter: str, columns: Sequence[Column]) -> str:
    fields = row.split(delimiter)
    if len(fields) < len(columns):
        return row
    names = [*columns, *[None] * (len(fields) - len(columns))]
    return delimiter.join(
        "0" if column is not None and column.channel in HIDDEN and not is_value(field.strip()) else field
        for field, column in zip(fields, names, strict=True)
    )


def _tab_single_spaces(lines: Sequence[str]) -> list[str] | None:
    """Write tabs for spaces where the header has a name for each space of a row, not for each run of them."""
    rows = [k for k, line in enumerate(lines) if is_row(line, " ")]
    header = find_header(lines, rows[0], " ")
    if header is None:
        return None
    header_at = header.first_line
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
    found = find_header(lines, rows[0], delimiter)
    samples = tuple(tuple(split_fields(lines[k], delimiter)) for k in rows)
    columns = found.columns if found else tuple(Column("", "other") for _ in samples[0])
    names = [column.name for column in columns]
    if delimiter == ",":
        _refuse_split_decimals(names, samples, rows[0] + 1, has_header=found is not None)
    if Counter(map(len, samples)).most_common(1)[0][0] > len(names):
        header = {"list": found.names.strip()[:200]} if found else {}
        raise UnknownColumns(**header, why="more fields", line=rows[0] + 1)
    has_comma = delimiter != "," and any(re.fullmatch(r"[-+]?\d*,\d+", f) for row in samples for f in row)
    preamble = tuple(lines[: found.first_line if found else rows[0]])
    device = find_known_device(found.names, preamble) if found else None
    return TextLayout(
        delimiter=delimiter,
        decimal="," if has_comma else ".",
        header=found.names if found else None,
        columns=tuple(_state_unit(column, device) for column in columns) if device else columns,
        first_line=found.stop_line if found else rows[0],
        preamble=preamble,
        sample_rows=samples,
        device=device,
    )


def _state_unit(column: Column, device: KnownDevice) -> Column:
    """Give a column without a unit the one that the device's own description states."""
    units = {"acc": device.acc_unit, "gyr": device.gyr_unit, "time": device.time_unit}
    unit = units.get(column.channel)
    return replace(column, unit=unit) if unit and column.unit is None else column


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


# Text as pieces of whole lines in bytes, whatever its encoding and line ends.


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


@dataclass(frozen=True, slots=True, eq=False)
class LinePiece:
    """Whole lines: ``buffer[first:stop]``, with room before and after as ``text_words`` needs it."""

    buffer: NDArray[np.uint8]
    first_byte: int
    stop_byte: int

    def __len__(self) -> int:
        return self.stop_byte - self.first_byte


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


def read_line_pieces(pieces: Iterable[bytes]) -> Iterator[LinePiece]:
    """Cut pieces at line ends; a last line without one is given one.

    Most lines are left where they lie. Only those at the seams are copied: a line that goes on in the next
    piece, and those too near the ends of the bytes for :mod:`fusion.readers.tables.machine_words`.

    Raises
    ------
    UnknownFormat
        A line is longer than 64 KiB: not a table of samples.
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
            yield copy_lines(carried + piece[:cut])
            if end > cut:
                yield LinePiece(np.frombuffer(piece, np.uint8), cut, end)
            carried = piece[end:]
        _refuse_long(carried)
    if carried:
        yield copy_lines(carried if carried.endswith(b"\n") else carried + b"\n")


def copy_lines(lines: bytes) -> LinePiece:
    """Give whole lines the room around them that the kernels need."""
    padded = bytes(LEAD_BYTES) + lines + bytes(TRAIL_BYTES)
    return LinePiece(np.frombuffer(padded, np.uint8), LEAD_BYTES, LEAD_BYTES + len(lines))


def _refuse_long(carried: bytes) -> None:
    if len(carried) - carried.rfind(b"\n") > MAX_LINE_BYTES:
        raise UnknownFormat(kind="text", line=1)


def drop_lines(pieces: Iterable[LinePiece], line_count: int) -> Iterator[LinePiece]:
    """Leave out the first ``line_count`` lines."""
    for piece in pieces:
        if line_count == 0:
            yield piece
            continue
        ends = (
            np.flatnonzero(piece.buffer[piece.first_byte : piece.stop_byte] == NEWLINE) + piece.first_byte + 1
        )
        first = int(ends[min(line_count, len(ends)) - 1])
        line_count -= min(line_count, len(ends))
        if first < piece.stop_byte:
            yield LinePiece(piece.buffer, first, piece.stop_byte)


# The layout by head, middle and tail of a file, and its caveats: encoding, locale, rounding.


SAMPLE_BYTES = 1 << 15
SAMPLED_PLACES = (0.5, 1.0)
"""Where to look besides the head: the middle and the tail."""
COARSEST_STEP_G = 0.009
"""Half a degree of tilt: an accelerometer's own step is a tenth of it."""


def read_layout(source: Source, order: DateOrder | None = None) -> TextLayout | None:
    """Understand a table by its head, its middle and its tail.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`fusion.readers.tables.layout.find_layout`.
    """
    layout = sniff_layout(source, order)
    if layout is None or find_form(source.head).encoding or isinstance(source.file, UnpackedFile):
        return layout
    return vote_decimal(layout, sample_lines(source))


def sniff_layout(source: Source, order: DateOrder | None = None) -> TextLayout | None:
    """Understand a table by its head and, where that leaves day and month open, by its last row.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`fusion.readers.tables.layout.find_layout`.
    """
    head = decode_head(source)
    first = find_open_date(head)
    if first and order is None:
        last = find_last_date(_read_tail(source))
        order = find_order_by_span(first, last) if last else None
    return find_layout(head, order)


def _read_tail(source: Source) -> str:
    """The last bytes as text; of a packed file by unpacking it, for nothing else leads there."""
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


def sample_lines(source: Source) -> list[str]:
    """Whole lines from the middle and the tail of a file longer than its head."""
    lines: list[str] = []
    if source.size_bytes <= len(source.head):
        return lines
    for place in SAMPLED_PLACES:
        source.file.seek(max(0, round(place * source.size_bytes) - SAMPLE_BYTES))
        lines += source.file.read(SAMPLE_BYTES).decode("latin-1").splitlines()[1:-1]
    return lines


def is_utf8(source: Source) -> bool:
    """Whether the head is UTF-8, a character cut at its end aside."""
    try:
        source.head.decode("utf-8")
    except UnicodeDecodeError as error:
        return error.start >= len(source.head) - 3
    return True


def flag_text(source: Source, layout: TextLayout) -> tuple[QualityFlag, ...]:
    """Flag the encoding, a decimal comma, and rounded values."""
    found = {
        Caveat.ENCODING: find_form(source.head).encoding is not None or not is_utf8(source),
        Caveat.LOCALE: layout.decimal == ",",
        Caveat.PRECISION: is_rounded(layout),
    }
    return tuple(QualityFlag(code) for code, is_found in found.items() if is_found)


def is_rounded(layout: TextLayout) -> bool:
    """Whether the acceleration has lost decimals: its steps are coarser than any sensor's."""
    places = choose_vector(layout.columns, "acc")
    scale_g = acc_scale_g(layout.columns[places[0]].unit) if places else None
    if places is None or scale_g is None:
        return False
    fields = [row[place] for row in layout.sample_rows for place in places if place < len(row)]
    decimals = count_decimals(fields)
    return decimals > 0 and scale_g * 10.0**-decimals > COARSEST_STEP_G


def count_decimals(fields: Sequence[str]) -> int:
    """The most decimals that any of the fields shows; 0 for whole numbers and exponents."""
    found = (re.fullmatch(r"[-+]?\d*[.,](\d+)", field) for field in fields)
    return max((len(match.group(1)) for match in found if match), default=0)
