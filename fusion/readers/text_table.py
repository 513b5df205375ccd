"""A table of samples, read as its layout says."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.errors import CutByExcel, UnreadableRows
from fusion.readers.samples import SampleColumns
from fusion.readers.source import Source
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
    parse_lines,
)
from fusion.readers.text_layout import TextLayout
from fusion.readers.text_stream import TextForm, read_line_pieces, read_text_pieces
from fusion.recording import QualityFlag

EXCEL_ROWS = 1_048_576
MAX_BAD_PART = 0.05
SHORTEST_NUMBER_BYTES = 2


@dataclass(frozen=True, slots=True)
class TablePlan:
    """Which column goes where.

    ``targets``: for each column -1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate.
    ``stamp_kind``, ``stamp_exponent``: as in ``text_kernel``; ``scales``: factors to g and deg/s.
    """

    targets: tuple[int, ...]
    stamp_kind: int = COUNTER
    stamp_exponent: int = 0
    acc_scale: float = 1.0
    gyr_scale: float = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class TableRows:
    """The rows that were read and what was met on the way."""

    columns: SampleColumns
    tally: NDArray[np.int64]
    first_line: int
    is_cut: bool

    @property
    def flags(self) -> tuple[QualityFlag, ...]:
        """Rows that were left out and why."""
        bad = int(self.tally[BAD])
        tail = int(self.is_cut and bad > 0 and self.tally[LAST_BAD_LINE] == self.tally[LINES])
        flags = []
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
    columns = SampleColumns()
    tally = np.zeros(TALLY_PLACES, np.int64)
    header = np.frombuffer((layout.header or "").split("\0")[0].encode(), np.uint8)
    signs = np.array([ord(layout.delimiter), ord(layout.decimal), plan.stamp_kind, plan.stamp_exponent])
    scales = np.array([1.0] + 3 * [plan.acc_scale] + 3 * [plan.gyr_scale])
    targets = np.array(plan.targets, np.int64)
    rules = (header, targets, signs, scales)
    row_bytes = SHORTEST_NUMBER_BYTES * int(np.count_nonzero(targets != IGNORED))
    done_bytes = 0
    for piece in drop_lines(read_line_pieces(read_text_pieces(source, form)), layout.first_line):
        columns.make_room(len(piece) // row_bytes + 1)
        values = (columns.acc, columns.gyr, columns.stamps)
        buffer = np.frombuffer(piece, np.uint8)
        columns.rows = parse_lines(buffer, rules, values, columns.rows, tally)
        if done_bytes == 0:
            columns.reserve(
                round(1.02 * columns.rows * source.size_bytes / len(piece)) + len(piece) // row_bytes
            )
        done_bytes += len(piece)
    columns.trim()
    rows = TableRows(columns, tally, layout.first_line, not _ends_whole(source))
    _refuse_rows(rows)
    return rows


def drop_lines(pieces: Iterable[bytes], count: int) -> Iterator[bytes]:
    """Leave out the first ``count`` lines."""
    for piece in pieces:
        at = 0
        while count and at < len(piece):
            at = piece.index(b"\n", at) + 1
            count -= 1
        if at < len(piece):
            yield piece[at:] if at else piece


def _ends_whole(source: Source) -> bool:
    source.file.seek(max(0, source.size_bytes - 2))
    return any(mark in source.file.read(2) for mark in (b"\n", b"\r"))


def _refuse_rows(rows: TableRows) -> None:
    lines = int(rows.tally[LINES] - rows.tally[BLANKS])
    bad = int(rows.tally[BAD])
    if bad > MAX_BAD_PART * lines and bad > 1:
        raise UnreadableRows(k=bad, line=int(rows.tally[FIRST_BAD_LINE]) + rows.first_line)
    if rows.first_line + int(rows.tally[LINES]) == EXCEL_ROWS:
        raise CutByExcel
