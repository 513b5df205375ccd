"""The plain path through a table: lines of exactly the usual fields, numbers of up to 16 characters.

It works column by column on runs of lines whose field ends are known, so that each loop is short and its
branches are foreseen. It either reads a line exactly as :mod:`fusion.readers.text_kernel` would, or leaves
it to that.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return, call-arg"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.readers.text_kernel import CALENDAR_TIME, COUNTER, LARGEST_VALUE, STAMP, Rules, Values
from fusion.readers.text_numbers import (
    MINUS,
    NEWLINE,
    NINE,
    NUMBER,
    POWERS,
    RETURN,
    SPACE,
    WHOLE_POWERS,
    ZERO,
    scale_stamp,
    take_calendar,
)
from fusion.readers.text_words import (
    EVERY_BYTE,
    NOT_PLAIN,
    WORD_DIGITS,
    load_word,
    take_plain,
    take_short,
)

POINT = 46
BYTE, SPACE_BYTE = np.uint64(255), np.uint64(SPACE)
MINUTE_BYTES = 17
"""Of `2019-02-14T08:58:`, what all stamps of a minute begin with."""
LONGEST_SECOND = 61
Marks = NDArray[np.int32]
"""Where fields end, one after the other; the first is the end of the line before."""


@njit(cache=True, nogil=True)
def spread_mark(decimal: int) -> int:
    """The decimal mark as :func:`fusion.readers.text_words.take_plain` wants it."""
    return np.uint64(decimal ^ ZERO) * EVERY_BYTE


@njit(cache=True, nogil=True)
def count_regular(
    buffer: NDArray[np.uint8], marks: Marks, n_columns: int, delimiter: int, most: int
) -> tuple[int, int]:
    """How many lines from here on have exactly ``n_columns`` fields, and how many marks each has."""
    if len(marks) <= n_columns:
        return 0, n_columns
    extra = int(buffer[marks[n_columns]] == RETURN)
    stride = n_columns + extra
    rows = 0
    while rows < most and (rows + 1) * stride < len(marks):
        at = rows * stride
        for k in range(at + 1, at + n_columns):
            if buffer[marks[k]] != delimiter:
                return rows, stride
        end = np.int64(marks[at + n_columns])
        if buffer[end + extra] != NEWLINE or (extra == 1 and buffer[end] != RETURN):
            return rows, stride
        rows += 1
    return rows, stride


@njit(cache=True, nogil=True, forceinline=True)
def skip_padding(buffer: NDArray[np.uint8], at: int) -> int:
    """Go over spaces before a number."""
    while load_word(buffer, at) & BYTE == SPACE_BYTE:
        at += 1
    return at


@njit(cache=True, nogil=True, error_model="numpy")
def take_values(
    buffer: NDArray[np.uint8],
    fields: Marks,
    stride: int,
    form: tuple[int, float],
    values: NDArray[np.float32],
) -> int:
    """Read a column of numbers; return how many, up to the first that is not plain or no sensor's value.

    ``form``: decimal mark as of :func:`spread_mark`, factor. Most columns keep to one number of decimals:
    that of the first field is foreseen, and any other costs a little more time.
    """
    dots, factor = form
    usual = np.int64(0)
    power = 1.0
    for row in range(len(values)):
        first = skip_padding(buffer, np.int64(fields[row * stride]) + 1)
        stop = np.int64(fields[row * stride + 1])
        mantissa, is_short = take_short(buffer, first, stop, usual, dots)
        if is_short:
            values[row] = mantissa / power * factor
            continue
        mantissa, decimals = take_plain(buffer, first, stop, dots)
        value = mantissa / POWERS[decimals]
        if decimals == NOT_PLAIN or abs(value) >= LARGEST_VALUE:
            return row
        values[row] = value * factor
        if row == 0 and decimals < WORD_DIGITS:
            usual, power = decimals, POWERS[decimals]
    return len(values)


@njit(cache=True, nogil=True)
def take_stamps(
    buffer: NDArray[np.uint8],
    fields: Marks,
    stride: int,
    form: tuple[int, int],
    stamps: NDArray[np.int64],
) -> int:
    """Read a column of numbers that are times; ``form``: decimal mark, power of ten to microseconds."""
    dots, exponent = form
    for row in range(len(stamps)):
        first = skip_padding(buffer, np.int64(fields[row * stride]) + 1)
        mantissa, decimals = take_plain(buffer, first, np.int64(fields[row * stride + 1]), dots)
        if decimals == NOT_PLAIN:
            return row
        stamps[row] = scale_stamp(mantissa, exponent - decimals)
    return len(stamps)


@njit(cache=True, nogil=True)
def is_minute(buffer: NDArray[np.uint8], at: int) -> bool:
    """Whether `2019-02-14T08:58:` stands here: digits, with one other byte after each number."""
    for k in range(MINUTE_BYTES):
        is_digit = ZERO <= buffer[at + k] <= NINE
        if is_digit == (k in (4, 7, 10, 13, 16)):
            return False
    return True


@njit(cache=True, nogil=True)
def take_seconds(buffer: NDArray[np.uint8], at: int, stop: int) -> int:
    """Read `08.0100000` between ``at`` and ``stop`` as microseconds; -1 for any other form."""
    if stop < at + 2 or buffer[at] == MINUS or (stop > at + 2 and buffer[at + 2] != POINT):
        return -1
    mantissa, decimals = take_plain(buffer, at, stop, spread_mark(POINT))
    if decimals == NOT_PLAIN or mantissa >= LONGEST_SECOND * WHOLE_POWERS[decimals]:
        return -1
    return scale_stamp(mantissa, 6 - decimals)


@njit(cache=True, nogil=True)
def take_calendars(
    buffer: NDArray[np.uint8], fields: Marks, stride: int, delimiter: int, stamps: NDArray[np.int64]
) -> int:
    """Read a column of dates with times; where the minute is that of the row before, by the seconds only."""
    early, late, minute_us = np.uint64(0), np.uint64(0), np.int64(0)
    for row in range(len(stamps)):
        first = np.int64(fields[row * stride]) + 1
        stop = np.int64(fields[row * stride + 1])
        at = first + MINUTE_BYTES
        seconds_us = take_seconds(buffer, at, stop) if stop > at else -1
        if seconds_us < 0:
            return row
        if load_word(buffer, first) != early or load_word(buffer, at - 8) != late:
            end, stamp, kind = take_calendar(buffer, first, delimiter)
            if kind != NUMBER or end != stop or not is_minute(buffer, first):
                return row
            early, late, minute_us = load_word(buffer, first), load_word(buffer, at - 8), stamp - seconds_us
        stamps[row] = minute_us + seconds_us
    return len(stamps)


@njit(cache=True, nogil=True)
def take_plain_stamps(
    buffer: NDArray[np.uint8], marks: Marks, stride: int, rules: Rules, stamps: NDArray[np.int64]
) -> int:
    """Read the stamps of a run of lines by the layout's kind of stamp."""
    _, _, columns, signs, _ = rules
    fields = marks[columns[STAMP] :]
    if signs[2] == CALENDAR_TIME:
        return take_calendars(buffer, fields, stride, signs[0], stamps)
    return take_stamps(buffer, fields, stride, (spread_mark(signs[1]), signs[3]), stamps)


@njit(cache=True, nogil=True)
def take_plain_rows(
    buffer: NDArray[np.uint8], marks: Marks, rules: Rules, values: Values, reach: tuple[int, int, int]
) -> tuple[int, int]:
    """Read the plain lines at the first mark; return how many, and how many marks they have.

    ``reach``: first row to fill, how many lines at most, and the number of the first sample.
    """
    _, targets, columns, signs, scales = rules
    acc, gyr, stamps = values
    row, most, number = reach
    rows, stride = count_regular(buffer, marks, len(targets), signs[0], most)
    dots = spread_mark(signs[1])
    for axis in range(3):
        fields = marks[columns[1 + axis] :]
        rows = take_values(buffer, fields, stride, (dots, scales[1 + axis]), acc[row : row + rows, axis])
        fields = marks[columns[4 + axis] :]
        rows = take_values(buffer, fields, stride, (dots, scales[4 + axis]), gyr[row : row + rows, axis])
    if signs[2] == COUNTER:
        stamps[row : row + rows] = np.arange(number, number + rows)
    else:
        rows = take_plain_stamps(buffer, marks, stride, rules, stamps[row : row + rows])
    return rows, rows * stride
