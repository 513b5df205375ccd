"""The careful reading of one line of a table: any number of digits, exponents, quotes, padding, damage."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import inner_making_arrays
from fusion.readers.text_numbers import (
    MISSING,
    NEWLINE,
    NUMBER,
    QUOTE,
    RETURN,
    SPACE,
    UNREADABLE,
    scale_decimal,
    scale_stamp,
    skip_field,
    skip_spaces,
    take_calendar,
    take_number,
)

IGNORED, STAMP = -1, 0
LARGEST_VALUE = 1e9
"""No sensor writes more in any unit: the line was damaged."""
COUNTER, NUMERIC_TIME, CALENDAR_TIME = 0, 1, 2
"""Where the stamps come from: the row's number, a number in some unit, a date with a time."""
LINES, BLANKS, BAD, ABSENT, HEADERS, FIRST_BAD_LINE, LAST_BAD_LINE, SAMPLES = range(8)
"""Places in the tally: lines; blank ones; unreadable ones; rows with a value that is absent; repeated
headers; where the first and last unreadable line stood; rows that were meant to be there."""
TALLY_PLACES = 8
PAUSE = 1 << 32
"""Added to the row number at a blank line or a new header where the layout has no time: a break of unknown
length."""
Rules = tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]
"""Header line; target of each column (-1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate);
column of each target, -1 for none; delimiter, decimal mark, kind of stamp, power of ten from stamps to
microseconds; factor of each target."""
Values = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.int64]]
"""Acceleration, angular rate, stamps."""


@inner_making_arrays
def take_stamp(
    buffer: NDArray[np.uint8], at: int, signs: NDArray[np.int64], stamps: NDArray[np.int64]
) -> tuple[int, int]:
    """Read the stamp column into ``stamps[0]``; return where it ends and what it is."""
    if signs[2] == CALENDAR_TIME:
        at, stamps[0], kind = take_calendar(buffer, at, signs[0])
        return at, kind
    at, mantissa, exponent, kind = take_number(buffer, at, signs[0], signs[1])
    stamps[0] = scale_stamp(mantissa, exponent + signs[3])
    return at, kind


@inner_making_arrays
def take_row(
    buffer: NDArray[np.uint8],
    at: int,
    columns: tuple[NDArray[np.int64], NDArray[np.int64]],
    fields: NDArray[np.float64],
    stamps: NDArray[np.int64],
) -> tuple[int, int]:
    """Read one line into ``fields`` and ``stamps[0]``; return its end and the worst of its fields.

    ``columns``: targets and signs, as in ``Rules``.
    """
    targets, signs = columns
    delimiter, decimal = signs[0], signs[1]
    worst = NUMBER
    for column in range(len(targets)):
        if column > 0:
            if buffer[at] != delimiter:
                return at, UNREADABLE
            at += 1
        if delimiter == SPACE:
            at = skip_spaces(buffer, at)
        target = targets[column]
        if target > STAMP:
            at, mantissa, exponent, kind = take_number(buffer, at, delimiter, decimal)
            fields[target] = scale_decimal(mantissa, exponent)
            worst = max(worst, kind if abs(fields[target]) < LARGEST_VALUE else UNREADABLE)
        elif target == STAMP:
            at, kind = take_stamp(buffer, at, signs, stamps)
            worst = max(worst, kind)
        else:
            at = skip_field(buffer, at, delimiter)
    return close_line(buffer, at, delimiter, worst)


@inner_making_arrays
def keep_row(
    fields: NDArray[np.float64],
    scales: NDArray[np.float64],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
    row: int,
) -> None:
    """Scale the fields of a line into its row."""
    for axis in range(3):
        acc[row, axis] = fields[1 + axis] * scales[1 + axis]
        gyr[row, axis] = fields[4 + axis] * scales[4 + axis]


@inner_making_arrays
def close_line(buffer: NDArray[np.uint8], at: int, delimiter: int, worst: int) -> tuple[int, int]:
    """Go to the line's end; further fields are unreadable unless they are empty."""
    while buffer[at] == delimiter or buffer[at] == SPACE or buffer[at] == RETURN:
        at += 1
    if buffer[at] != NEWLINE:
        worst = UNREADABLE
        while buffer[at] != NEWLINE:
            at += 1
    return at, worst


@inner_making_arrays
def is_blank(buffer: NDArray[np.uint8], at: int, delimiter: int) -> bool:
    """Whether nothing but padding stands on the line."""
    while buffer[at] == SPACE or buffer[at] == RETURN or buffer[at] == delimiter or buffer[at] == QUOTE:
        at += 1
    return buffer[at] == NEWLINE


@inner_making_arrays
def starts_with(buffer: NDArray[np.uint8], at: int, word: NDArray[np.uint8]) -> bool:
    """Whether the line begins with ``word``, which must hold no newline."""
    for k in range(len(word)):
        if buffer[at + k] != word[k]:
            return False
    return len(word) > 0


@inner_making_arrays
def note_loss(kind: int, tally: NDArray[np.int64]) -> None:
    """Count a row that was not kept."""
    if kind == MISSING:
        tally[ABSENT] += 1
        return
    tally[BAD] += 1
    tally[LAST_BAD_LINE] = tally[LINES]
    if tally[FIRST_BAD_LINE] == 0:
        tally[FIRST_BAD_LINE] = tally[LINES]


@inner_making_arrays
def next_line(buffer: NDArray[np.uint8], at: int) -> int:
    """First byte after the line's end."""
    while buffer[at] != NEWLINE:
        at += 1
    return at + 1
