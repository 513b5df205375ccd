"""A table of samples, read as its layout says."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fusion.errors import CutByExcel, UnreadableRows
from fusion.readers.samples import MOST_ROWS, SampleColumns
from fusion.readers.source import Source
from fusion.readers.stamp_writing import OffsetChange, StampWriter, rewrite_pieces
from fusion.readers.text_kernel import (
    ABSENT,
    BAD,
    BLANKS,
    COUNTER,
    FIRST_BAD_LINE,
    HEADERS,
    IGNORED,
    LAST_BAD_LINE,
    LINES,
    TALLY_PLACES,
    Rules,
)
from fusion.readers.text_layout import TextLayout
from fusion.readers.text_lines import parse_lines, parse_plain_lines
from fusion.readers.text_marks import SPARE_MARKS
from fusion.readers.text_stream import TextForm, drop_lines, read_line_pieces, read_text_pieces
from fusion.readers.time_unit import IN_MICROSECONDS, TimeUnit
from fusion.readers.unmeasured import drop_blank_rows
from fusion.recording import QualityFlag

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
