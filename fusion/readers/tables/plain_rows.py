"""The plain path over the pieces of a table, on two cores: each piece for itself, the rows in their order.

The kernels release the interpreter's lock. No piece needs what another holds, so that neither the number of
threads nor which of them is faster changes a row.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import cycle

import numpy as np

from fusion.readers.tables.careful_path import IGNORED, TALLY_PLACES, Destination, Rules
from fusion.readers.tables.fast_path import SPARE_MARKS, Marks, Piece, parse_plain_lines
from fusion.readers.tables.layout import LinePiece

THREADS = 2
AHEAD = 3
"""Pieces that are read before the one whose rows are taken."""
LARGE_BYTES = 1 << 14
SHORTEST_NUMBER_BYTES = 2


@dataclass(frozen=True, slots=True, eq=False)
class PlainRows:
    """What the plain path read of a piece, valid until the next piece is asked for.

    Attributes
    ----------
    piece
        The whole piece.
    found
        The rows that were read, with their tally; a row number counts from the piece's first.
    most_rows
        How many rows the piece can hold.
    next_byte
        The first that was not read.
    """

    piece: Piece
    found: Destination
    most_rows: int
    next_byte: int

    def __len__(self) -> int:
        return self.piece.stop_byte - self.piece.first_byte

    @property
    def rest(self) -> Piece | None:
        """The lines from the first that is not plain."""
        is_whole = self.next_byte == self.piece.stop_byte
        return None if is_whole else self.piece._replace(first_byte=self.next_byte)


class _Room:
    """Where a piece is read: the places of its marks, and its rows; used again for other pieces."""

    def __init__(self) -> None:
        self._marks: Marks = np.empty(0, np.int32)
        self._ends: Marks = np.empty(0, np.int32)
        self._rows = _make_rows(0)

    def read(self, lines: LinePiece, rules: Rules) -> PlainRows:
        """Read a piece up to its first line that is not plain."""
        most_rows = count_most_rows(lines, rules)
        if len(self._marks) < len(lines) + SPARE_MARKS:
            self._marks, self._ends = (np.empty(len(lines) + SPARE_MARKS, np.int32) for _ in range(2))
        if len(self._rows.stamps) < most_rows:
            self._rows = _make_rows(most_rows)
        self._rows.tally[:] = 0
        piece = Piece(lines.buffer, lines.first_byte, lines.stop_byte, self._marks, self._ends)
        rows, next_byte = parse_plain_lines(piece, rules, self._rows, 0)
        acc, gyr, stamps, tally = self._rows
        found = Destination(acc[:rows], gyr[:rows], stamps[:rows], tally)
        return PlainRows(piece, found, most_rows, next_byte)


def _make_rows(capacity: int) -> Destination:
    return Destination(
        np.empty((capacity, 3), np.float32),
        np.empty((capacity, 3), np.float32),
        np.empty(capacity, np.int64),
        np.zeros(TALLY_PLACES, np.int64),
    )


def count_most_rows(lines: LinePiece, rules: Rules) -> int:
    """Give how many rows a piece can hold, by the shortest numbers there are."""
    row_bytes = SHORTEST_NUMBER_BYTES * int(np.count_nonzero(rules.line.targets != IGNORED))
    return len(lines) // row_bytes + 1


def _begin(threads: ThreadPoolExecutor, read: Callable[[], PlainRows], size_bytes: int) -> Future[PlainRows]:
    """Have a piece read by a thread; a few lines take longer to hand over than to read."""
    if size_bytes >= LARGE_BYTES:
        return threads.submit(read)
    done: Future[PlainRows] = Future()
    done.set_result(read())
    return done


def read_plain_rows(pieces: Iterable[LinePiece], rules: Rules) -> Iterator[PlainRows]:
    """Read pieces by the plain path, some ahead of the one that is given."""
    rooms = cycle([_Room() for _ in range(AHEAD + 1)])
    running: deque[Future[PlainRows]] = deque()
    with ThreadPoolExecutor(THREADS) as threads:
        for lines in pieces:
            running.append(_begin(threads, partial(next(rooms).read, lines, rules), len(lines)))
            if len(running) > AHEAD:
                yield running.popleft().result()
        while running:
            yield running.popleft().result()
