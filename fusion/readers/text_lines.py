"""The hot path of every text layout, in the large: whole lines of bytes to float32 columns."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import inner_making_arrays, kernel_making_arrays
from fusion.readers.text_kernel import (
    BLANKS,
    CALENDAR_TIME,
    COUNTER,
    HEADERS,
    LINES,
    PAUSE,
    SAMPLES,
    STAMP,
    Rules,
    Values,
    is_blank,
    keep_row,
    next_line,
    note_loss,
    starts_with,
    take_row,
)
from fusion.readers.text_marks import Marks, find_marks
from fusion.readers.text_numbers import NUMBER, SPACE
from fusion.readers.text_plain import spread_mark, take_calendars, take_plain_rows, take_readings, take_stamps

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
