"""A table of samples, read as its layout says."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.errors import CutByExcel, UnreadableRows
from fusion.numba_kernels import inner_making_arrays, kernel_making_arrays
from fusion.readers.samples import MOST_ROWS, PAUSE, SampleColumns, drop_blank_rows
from fusion.readers.source import Source
from fusion.readers.tables.careful_path import (
    ABSENT,
    BAD,
    BLANKS,
    CALENDAR_TIME,
    COUNTER,
    FIRST_BAD_LINE,
    HEADERS,
    IGNORED,
    LAST_BAD_LINE,
    LINES,
    NUMBER,
    SAMPLES,
    SPACE,
    STAMP,
    TALLY_PLACES,
    Rules,
    Values,
    is_blank,
    keep_row,
    next_line,
    note_loss,
    starts_with,
    take_row,
)
from fusion.readers.tables.columns import IN_MICROSECONDS, TimeUnit
from fusion.readers.tables.dates import OffsetChange, StampWriter, rewrite_pieces
from fusion.readers.tables.fast_path import (
    SPARE_MARKS,
    Marks,
    find_marks,
    spread_mark,
    take_calendars,
    take_plain_rows,
    take_readings,
    take_stamps,
)
from fusion.readers.tables.layout import TextForm, TextLayout, drop_lines, read_line_pieces, read_text_pieces
from fusion.recording import QualityFlag

# The hot path of every text layout, in the large: whole lines of bytes to float32 columns.


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)


Piece = tuple[NDArray[np.uint8], int, int, Marks, Marks]
"""Buffer; first byte of the first line; first byte after the last one; room for ends of fields, of lines."""
SHORTEST_RUN, LONGEST_RUN = 1, 1024
"""Lines that are tried together on the plain path; few enough that they stay in the processor's cache."""


@inner_making_arrays
def parse_line(
    line: tuple[NDArray[np.uint8], int], row: int, rules: Rules, values: Values, tally: NDArray[np.int64]
) -> tuple[int, int]:
    """Read one line of any form with care; return the first byte after it and how many rows it gave.

    ``line``: buffer and first byte of the line; ``row``: where its values go.
    """
    buffer, at = line
    header, targets, _, signs, scales = rules
    acc, gyr, stamps = values
    is_header = starts_with(buffer, at, header)
    if is_header or is_blank(buffer, at, signs[0]):
        tally[HEADERS if is_header else BLANKS] += 1
        tally[SAMPLES] += PAUSE
        return next_line(buffer, at), 0
    fields = np.zeros(7)
    at, kind = take_row(buffer, at, (targets, signs), fields, stamps[row:])
    if signs[2] == COUNTER:
        stamps[row] = tally[SAMPLES]
    tally[SAMPLES] += 1
    if kind == NUMBER:
        keep_row(fields, scales, acc, gyr, row)
    else:
        note_loss(kind, tally)
    return next_line(buffer, at), int(kind == NUMBER)


@inner_making_arrays
def has_all_columns(columns: NDArray[np.int64]) -> bool:
    """Whether the six readings have a column each."""
    for target in range(1, 7):  # noqa: SIM110 (numba compiles no generator expressions)
        if columns[target] < 0:
            return False
    return True


@inner_making_arrays
def find_lines(piece: Piece, rules: Rules) -> tuple[int, int]:
    """Find the ends of fields and lines where the plain path can be tried; no lines where it cannot."""
    buffer, first, stop, marks, ends = piece
    if rules[3][0] == SPACE or not has_all_columns(rules[2]):
        return 0, 0
    return find_marks(buffer, (first, stop), rules[3][0], marks, ends)


@kernel_making_arrays
def take_plain_readings(piece: Piece, rules: Rules, values: Values, row: int) -> tuple[int, int]:
    """Read the six readings of a piece's lines up to the first that is not plain.

    Returns how many lines, and how many bytes end each; ``marks`` and ``ends`` are filled for the stamps.
    """
    buffer, _, _, marks, ends = piece
    n_lines, end_bytes = find_lines(piece, rules)
    line = 0
    while line < n_lines:
        most = min(LONGEST_RUN, n_lines - line)
        lines = (marks[ends[line] :], ends[line:], end_bytes)
        rows = take_readings(buffer, lines, rules, values, (row + line, most))
        line += rows
        if rows < most:
            break
    return line, end_bytes


def parse_plain_lines(
    piece: Piece, rules: Rules, values: Values, row: int, tally: NDArray[np.int64]
) -> tuple[int, int]:
    """Read lines up to the first that is not plain; return the first row not filled and first byte not read.

    Most files hold no other lines. The careful path, and the kind of stamps that a file does not have, are
    most of what there is to compile, and are left until they are needed.
    """
    buffer, first, _, marks, ends = piece
    rows, end_bytes = take_plain_readings(piece, rules, values, row)
    if rows == 0:
        return row, first
    _, targets, columns, signs, _ = rules
    stamps, number = values[2][row : row + rows], int(tally[SAMPLES])
    if signs[2] == COUNTER:
        stamps[:] = np.arange(number, number + rows)
    else:
        column = int(columns[STAMP])
        step = (len(targets), end_bytes - 1 if column == len(targets) - 1 else 0)
        if signs[2] == CALENDAR_TIME:
            rows = take_calendars(buffer, marks[column:], step, int(signs[0]), stamps)
        else:
            form = (np.uint64(spread_mark(int(signs[1]))), int(signs[3]))
            rows = take_stamps(buffer, marks[column:], step, form, stamps)
    tally[LINES] += rows
    tally[SAMPLES] += rows
    return row + rows, int(marks[ends[rows]]) + 1


@kernel_making_arrays
def parse_lines(piece: Piece, rules: Rules, values: Values, row: int, tally: NDArray[np.int64]) -> int:
    """Read all lines of a piece into the columns from ``row`` on; return the first row not filled.

    Runs of lines are first tried on the plain path; the line at which it stops is read with care, so that
    the plain path decides nothing but the time it takes. Runs that succeed grow, so that the work stays
    linear where few lines are plain.
    """
    buffer, at, stop, marks, ends = piece
    n_lines, end_bytes = find_lines(piece, rules)
    line = 0
    run = SHORTEST_RUN
    while at < stop:
        most = min(run, n_lines - line)
        lines = (marks[ends[line] :], ends[line:], end_bytes)
        rows = take_plain_rows(buffer, lines, rules, values, (row, most, tally[SAMPLES])) if most > 0 else 0
        if rows > 0:
            tally[LINES] += rows
            tally[SAMPLES] += rows
            row += rows
            line += rows
            at = np.int64(marks[ends[line]]) + 1
            run = min(2 * run, LONGEST_RUN)
            continue
        tally[LINES] += 1
        at, kept = parse_line((buffer, at), row, rules, values, tally)
        row += kept
        line += int(line < n_lines)
        run = SHORTEST_RUN
    return row


EXCEL_ROWS = 1_048_576
MAX_BAD_PART = 0.05
SHORTEST_NUMBER_BYTES = 2
FORECAST_BYTES = 1 << 18
"""After so many bytes the number of rows in the file is foreseen."""


@dataclass(frozen=True, slots=True)
class TablePlan:
    """Which column goes where.

    ``targets``: for each column -1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate.
    ``stamp_kind``, ``stamp_exponent``: as in ``text_kernel``; ``scales``: factors to g and deg/s.
    ``counts_packets``: the stamp is the 16-bit number of a packet, not a time; ``unit``: that of a number,
    and whether the header has another.
    """

    targets: tuple[int, ...]
    stamp_kind: int = COUNTER
    stamp_exponent: int = 0
    acc_scale: float = 1.0
    gyr_scale: float = 1.0
    counts_packets: bool = False
    unit: TimeUnit = IN_MICROSECONDS


@dataclass(frozen=True, slots=True, eq=False)
class TableRows:
    """The rows that were read and what was met on the way.

    ``changes``: where the offset from UTC that the stamps carry changed; ``blank``: rows of zeros without a
    stamp, which are left out.
    """

    columns: SampleColumns
    tally: NDArray[np.int64]
    first_line: int
    is_cut: bool
    changes: tuple[OffsetChange, ...] = ()
    blank: tuple[QualityFlag, ...] = ()

    @property
    def flags(self) -> tuple[QualityFlag, ...]:
        """Rows that were left out and why."""
        bad = int(self.tally[BAD])
        tail = int(self.is_cut and bad > 0 and self.tally[LAST_BAD_LINE] == self.tally[LINES])
        flags = list(self.blank)
        if bad > tail:
            line = int(self.tally[FIRST_BAD_LINE]) + self.first_line
            flags.append(QualityFlag("W-ROWS-DROPPED", bad - tail, facts={"line": line}))
        for code, count in (
            ("W-TRUNC-TAIL", tail),
            ("W-NAN", self.tally[ABSENT]),
            ("W-HEADER-REPEAT", self.tally[HEADERS]),
        ):
            if count:
                flags.append(QualityFlag(code, int(count)))
        return tuple(flags)


def read_table(source: Source, form: TextForm, layout: TextLayout, plan: TablePlan) -> TableRows:
    """Read all rows, piece by piece.

    Raises
    ------
    UnreadableRows
        More than 5 % of the lines cannot be read.
    CutByExcel
        Exactly as many lines as Excel holds.
    """
    columns = SampleColumns(source)
    tally = np.zeros(TALLY_PLACES, np.int64)
    rules = make_rules(layout, plan)
    row_bytes = SHORTEST_NUMBER_BYTES * sum(target != IGNORED for target in plan.targets)
    marks = ends = np.empty(0, np.int32)
    done_bytes = 0
    has_reserved = False
    end = LastBytes()
    writer = StampWriter(layout.dates) if layout.dates and not layout.dates.is_iso else None
    pieces = rewrite_pieces(end.watch(read_text_pieces(source, form)), writer)
    if layout.is_single_spaced:
        pieces = (piece.replace(b" ", b"\t") for piece in pieces)
    for piece in drop_lines(read_line_pieces(pieces), layout.first_line):
        if len(marks) < len(piece) + SPARE_MARKS:
            marks, ends = (np.empty(len(piece) + SPARE_MARKS, np.int32) for _ in range(2))
        columns.make_room(len(piece) // row_bytes + 1)
        values = (columns.acc, columns.gyr, columns.stamps)
        lines = (piece.buffer, piece.first, piece.stop, marks, ends)
        columns.rows, at = parse_plain_lines(lines, rules, values, columns.rows, tally)
        if at < piece.stop:
            lines = (piece.buffer, at, piece.stop, marks, ends)
            columns.rows = parse_lines(lines, rules, values, columns.rows, tally)
        done_bytes += len(piece)
        if not has_reserved and done_bytes > FORECAST_BYTES:
            has_reserved = True
            columns.reserve(
                round(1.02 * min(columns.rows * source.size_bytes / done_bytes, MOST_ROWS))
                + len(piece) // row_bytes
            )
    columns.trim()
    changes = tuple(writer.changes) if writer else ()
    rows = TableRows(columns, tally, layout.first_line, not end.is_whole, changes)
    _refuse_rows(rows)
    return rows if plan.stamp_kind == COUNTER else replace(rows, blank=drop_blank_rows(columns))


def make_rules(layout: TextLayout, plan: TablePlan) -> Rules:
    """The layout and its plan as the kernel takes them."""
    header = np.frombuffer((layout.header or "").split("\0")[0].encode(), np.uint8)
    targets = np.array(plan.targets, np.int64)
    columns = np.full(7, -1, np.int64)
    for column, target in enumerate(plan.targets):
        if target != IGNORED:
            columns[target] = column
    signs = np.array([ord(layout.delimiter), ord(layout.decimal), plan.stamp_kind, plan.stamp_exponent])
    scales = np.array([1.0] + 3 * [plan.acc_scale] + 3 * [plan.gyr_scale])
    return header, targets, columns, signs, scales


class LastBytes:
    """Watches text go by, to tell whether its last line was ended."""

    def __init__(self) -> None:
        self.is_whole = False

    def watch(self, pieces: Iterable[bytes]) -> Iterator[bytes]:
        """Give the pieces on."""
        for piece in pieces:
            self.is_whole = piece.endswith((b"\n", b"\r"))
            yield piece


def _refuse_rows(rows: TableRows) -> None:
    lines = int(rows.tally[LINES] - rows.tally[BLANKS])
    bad = int(rows.tally[BAD])
    if bad > MAX_BAD_PART * lines and bad > 1:
        raise UnreadableRows(k=bad, line=int(rows.tally[FIRST_BAD_LINE]) + rows.first_line)
    if rows.first_line + int(rows.tally[LINES]) == EXCEL_ROWS:
        raise CutByExcel
