"""The plain path through a table: lines of exactly the usual fields, numbers of up to 16 characters.

It works column by column on runs of lines whose field ends are known, so that each loop is short and its
branches are foreseen. It either reads a line exactly as :mod:`fusion.readers.tables.careful_path` would, or
leaves it to that.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return, call-arg, misc, operator"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import inner_making_arrays, kernel_making_arrays, njit
from fusion.readers.samples import PAUSE
from fusion.readers.tables.careful_path import (
    BLANKS,
    CALENDAR_TIME,
    COUNTER,
    HEADERS,
    LARGEST_VALUE,
    LINES,
    MINUS,
    NINE,
    NUMBER,
    POWERS,
    SAMPLES,
    SPACE,
    STAMP,
    WHOLE_POWERS,
    ZERO,
    Destination,
    Rules,
    is_blank,
    keep_row,
    next_line,
    note_loss,
    scale_stamp,
    starts_with,
    take_calendar,
    take_row,
)
from fusion.readers.tables.machine_words import (
    ALL_BITS,
    BYTE_PLACES,
    EVERY_BYTE,
    LAST_BYTE,
    MINUS_BYTE,
    NEWLINE,
    NOT_PLAIN,
    ONE,
    RETURN,
    SHIFT_BITS,
    THREE,
    WORD_DIGITS,
    ZERO_WORD,
    ZEROS,
    count_bits,
    find_others,
    fold_digits,
    load_word,
    lowest_bit,
    match_byte,
    take_plain,
)

# Where fields and lines end, 64 bytes at a time.


Marks = NDArray[np.int32]
"""Places in the buffer, or in another array of places."""


class Piece(NamedTuple):
    """Whole lines, ``buffer[first:stop]``, and room for the ends of fields and of lines."""

    buffer: NDArray[np.uint8]
    first_byte: int
    stop_byte: int
    marks: Marks
    ends: Marks


class Lines(NamedTuple):
    """Marks and ends as of :func:`find_marks`, from some line on, and how many bytes end a line."""

    marks: Marks
    ends: Marks
    end_bytes: int


WORD_BYTES = 64
EIGHT_MARKS = 8
SPARE_MARKS = 16
"""Room that must be left behind the last mark."""


@njit(cache=True, nogil=True, forceinline=True)
def write_marks(marks: Marks, found: int, base_byte: int, word: int) -> None:
    """Write the places of the bits that are set, eight at a time: what is too much is written over later."""
    at = np.uintp(found)
    while word != ZERO_WORD:
        for k in range(EIGHT_MARKS):
            marks[at + np.uintp(k)] = base_byte + np.int64(lowest_bit(word))
            word &= word - ONE
        at += np.uintp(EIGHT_MARKS)


@njit(cache=True, nogil=True, forceinline=True)
def write_ends(ends: Marks, lines: int, found: int, word: int, newlines: int) -> int:
    """Write which of the marks in ``word`` are ends of lines; return the new number of lines."""
    while newlines != ZERO_WORD:
        rest = newlines & (newlines - ONE)
        before = word & ((newlines ^ rest) - ONE)
        lines += 1
        ends[np.uintp(lines)] = found + np.int64(count_bits(before))
        newlines = rest
    return lines


@inner_making_arrays
def find_marks(
    buffer: NDArray[np.uint8], span: tuple[int, int], delimiter_byte: int, marks: Marks, ends: Marks
) -> tuple[int, int]:
    """Find the ends of fields and lines in ``buffer[span[0]:span[1]]``, which ends with a newline.

    ``marks`` receives the byte before the span and all delimiters and newlines in it; ``ends`` receives the
    places in ``marks`` of the first and of all newlines. Both need ``SPARE_MARKS`` more room than there are
    bytes. Returns how many lines there are and how many bytes end each, 1 or 2 (CRLF); no lines where both
    kinds stand, or a return elsewhere.
    """
    first, stop = span
    marks[0], ends[0] = first - 1, 0
    found, lines, returns, pairs = np.int64(1), np.int64(0), np.int64(0), np.int64(0)
    carried = ZERO_WORD
    for base in range(first, stop, WORD_BYTES):
        kept = ~ZERO_WORD
        if stop - base < WORD_BYTES:
            kept = (ONE << np.uint64(stop - base)) - ONE
        newlines = match_byte(buffer, base, NEWLINE) & kept
        word = newlines | (match_byte(buffer, base, delimiter_byte) & kept)
        back = match_byte(buffer, base, RETURN) & kept
        write_marks(marks, found, base, word)
        lines = write_ends(ends, lines, found, word, newlines)
        found += np.int64(count_bits(word))
        returns += np.int64(count_bits(back))
        pairs += np.int64(count_bits(newlines & ((back << ONE) | carried)))
        carried = back >> SHIFT_BITS
    if returns == 0:
        return lines, 1
    return (lines, 2) if returns == pairs == lines else (0, 0)


# Many numbers of one column at a time: the same steps for all, so that the compiler puts them side by side.
#
# Most columns keep to one number of decimals. Where it is foreseen, a number of at most eight digits needs
# no search for its decimal mark: the decimals and the digits before the mark are each loaded to where they
# belong in one word. The words of a block are gathered first, then folded without a branch between; a block
# that holds any other form is left to :func:`fusion.readers.tables.machine_words.take_plain`.


BLOCK_ROWS = 256
WORDS_OF_A_FIELD = 4
MOST_DECIMALS = WORD_DIGITS - 1
SHIFT_OF_ALL = np.uint64(72)
"""Bits of the longest form, nine characters."""
Words = NDArray[np.uint64]
"""Shape (4, block): the first bytes of each field, its last eight, those before its decimals, its length."""


@kernel_making_arrays
def gather_words(
    buffer: NDArray[np.uint8], fields: Marks, step: tuple[int, int], decimals: int, words: Words
) -> None:
    """Load the words of as many fields as there is room for.

    ``step``: marks from a row to the next, and bytes between the field and the mark after it.
    """
    stride, tail = step
    lead, late, whole, length = words[0], words[1], words[2], words[3]
    at = np.uintp(0)
    for row in range(len(lead)):
        first = np.int64(fields[at]) + 1
        stop = np.int64(fields[at + np.uintp(1)]) - tail
        lead[row] = load_word(buffer, first)
        late[row] = load_word(buffer, stop - 8)
        whole[row] = load_word(buffer, stop - 9 - decimals)
        length[row] = stop - first
        at += np.uintp(stride)


@kernel_making_arrays
def fold_words(
    words: Words, decimals: int, form: tuple[int, float, float], values: NDArray[np.float64]
) -> bool:
    """Turn gathered words into numbers; False, and numbers that mean nothing, where one has another form.

    ``form``: the decimal mark as of :func:`fusion.readers.tables.fast_path.spread_mark`, the power of ten
    that the decimals stand for, and the factor to be applied.
    """
    dots, power, factor = form
    lead, late, whole, length = words[0], words[1], words[2], words[3]
    shift = np.uint64(8 * decimals)
    fraction = ~(ALL_BITS >> shift)
    mark_at = BYTE_PLACES - shift
    shortest, spread = np.uint64(decimals + 2), np.uint64(MOST_DECIMALS - decimals)
    others = ZERO_WORD
    for row in range(len(values)):
        minus = np.uint64(np.int64(lead[row] & LAST_BYTE == MINUS_BYTE))
        digits = length[row] - minus
        end = late[row] ^ ZEROS
        word = ((whole[row] ^ ZEROS) >> shift) | (end & fraction)
        word &= ALL_BITS << ((SHIFT_OF_ALL - (digits << THREE)) & SHIFT_BITS)
        others |= find_others(word) | (((end ^ dots) >> mark_at) & LAST_BYTE)
        others |= np.uint64(np.int64(digits - shortest > spread))
        mantissa = fold_digits(word)
        values[row] = ((mantissa ^ -np.int64(minus)) + np.int64(minus)) / power * factor
    return others == ZERO_WORD


POINT = 46
BYTE, SPACE_BYTE = np.uint64(255), np.uint64(SPACE)
MINUTE_BYTES = 17
"""Of `2019-02-14T08:58:`, what all stamps of a minute begin with."""
MARKS_OF_A_MINUTE = 1 << 4 | 1 << 7 | 1 << 10 | 1 << 13 | 1 << 16
"""A bit for each of them that is no digit."""
LONGEST_SECOND = 61


@kernel_making_arrays
def spread_mark(decimal_byte: int) -> int:
    """The decimal mark as :func:`fusion.readers.tables.machine_words.take_plain` wants it."""
    return np.uint64(decimal_byte ^ ZERO) * EVERY_BYTE


@inner_making_arrays
def count_regular(ends: Marks, n_columns: int, most_lines: int) -> int:
    """How many lines from here on have exactly ``n_columns`` fields."""
    rows = 0
    while rows < most_lines and ends[rows + 1] - ends[rows] == n_columns:
        rows += 1
    return rows


@njit(cache=True, nogil=True, forceinline=True)
def skip_padding(buffer: NDArray[np.uint8], at_byte: int) -> int:
    """Go over spaces before a number."""
    while load_word(buffer, at_byte) & BYTE == SPACE_BYTE:
        at_byte += 1
    return at_byte


@inner_making_arrays
def take_each(
    buffer: NDArray[np.uint8],
    fields: Marks,
    step: tuple[int, int],
    form: tuple[int, float],
    values: NDArray[np.float32],
) -> int:
    """Read a column of numbers one by one; return how many, up to the first that is not plain or too large.

    ``step``: marks from a row to the next, and bytes between the field and the mark after it; ``form``:
    decimal mark as of :func:`spread_mark`, factor.
    """
    stride, tail = step
    dots, factor = form
    for row in range(len(values)):
        first = skip_padding(buffer, np.int64(fields[row * stride]) + 1)
        mantissa, decimals = take_plain(buffer, first, np.int64(fields[row * stride + 1]) - tail, dots)
        value = mantissa / POWERS[decimals]
        if decimals == NOT_PLAIN or abs(value) >= LARGEST_VALUE:
            return row
        values[row] = value * factor
    return len(values)


@inner_making_arrays
def take_values(
    buffer: NDArray[np.uint8],
    fields: Marks,
    step: tuple[int, int],
    form: tuple[int, float],
    values: NDArray[np.float32],
) -> int:
    """Read a column of numbers as :func:`take_each`, in blocks that keep to the decimals of the first."""
    if len(values) == 0:
        return 0
    dots, factor = form
    words, folded = np.empty((WORDS_OF_A_FIELD, BLOCK_ROWS), np.uint64), np.empty(BLOCK_ROWS)
    _, usual = take_plain(buffer, np.int64(fields[0]) + 1, np.int64(fields[1]) - step[1], dots)
    for first in range(0, len(values), BLOCK_ROWS):
        block = values[first : first + BLOCK_ROWS]
        places = fields[first * step[0] :]
        if 1 <= usual <= MOST_DECIMALS and len(block) == BLOCK_ROWS:
            gather_words(buffer, places, step, usual, words)
            if fold_words(words, usual, (dots, POWERS[usual], factor), folded):
                for row in range(BLOCK_ROWS):
                    block[row] = folded[row]
                continue
        taken = take_each(buffer, places, step, form, block)
        if taken < len(block):
            return first + taken
    return len(values)


@kernel_making_arrays
def take_stamps(
    buffer: NDArray[np.uint8],
    fields: Marks,
    step: tuple[int, int],
    form: tuple[int, int],
    stamps: NDArray[np.int64],
) -> int:
    """Read a column of numbers that are times; ``form``: decimal mark, power of ten to microseconds."""
    stride, tail = step
    dots, exponent = form
    for row in range(len(stamps)):
        first = skip_padding(buffer, np.int64(fields[row * stride]) + 1)
        stop = np.int64(fields[row * stride + 1]) - tail
        mantissa, decimals = take_plain(buffer, first, stop, dots)
        if decimals == NOT_PLAIN:
            return row
        stamps[row] = scale_stamp(mantissa, exponent - decimals)
    return len(stamps)


@inner_making_arrays
def is_minute(buffer: NDArray[np.uint8], at_byte: int) -> bool:
    """Whether `2019-02-14T08:58:` stands here: digits, with one other byte after each number."""
    for k in range(MINUTE_BYTES):
        is_digit = ZERO <= buffer[at_byte + k] <= NINE
        if is_digit == bool(MARKS_OF_A_MINUTE >> k & 1):
            return False
    return True


@inner_making_arrays
def take_seconds(buffer: NDArray[np.uint8], at_byte: int, stop_byte: int) -> int:
    """Read `08.0100000` between ``at_byte`` and ``stop_byte`` as microseconds; -1 for any other form."""
    if (
        stop_byte < at_byte + 2
        or buffer[at_byte] == MINUS
        or (stop_byte > at_byte + 2 and buffer[at_byte + 2] != POINT)
    ):
        return -1
    mantissa, decimals = take_plain(buffer, at_byte, stop_byte, spread_mark(POINT))
    if decimals == NOT_PLAIN or mantissa >= LONGEST_SECOND * WHOLE_POWERS[decimals]:
        return -1
    return scale_stamp(mantissa, 6 - decimals)


@kernel_making_arrays
def take_calendars(
    buffer: NDArray[np.uint8],
    fields: Marks,
    step: tuple[int, int],
    delimiter_byte: int,
    stamps: NDArray[np.int64],
) -> int:
    """Read a column of dates with times; where the minute is that of the row before, by the seconds only."""
    early, late, minute_us = np.uint64(0), np.uint64(0), np.int64(0)
    for row in range(len(stamps)):
        first = np.int64(fields[row * step[0]]) + 1
        stop = np.int64(fields[row * step[0] + 1]) - step[1]
        at = first + MINUTE_BYTES
        seconds_us = take_seconds(buffer, at, stop) if stop > at else -1
        if seconds_us < 0:
            return row
        if load_word(buffer, first) != early or load_word(buffer, at - 8) != late:
            end, stamp, kind = take_calendar(buffer, first, delimiter_byte)
            if kind != NUMBER or end != stop or not is_minute(buffer, first):
                return row
            early, late, minute_us = load_word(buffer, first), load_word(buffer, at - 8), stamp - seconds_us
        stamps[row] = minute_us + seconds_us
    return len(stamps)


@inner_making_arrays
def take_plain_stamps(
    buffer: NDArray[np.uint8],
    fields: Marks,
    step: tuple[int, int],
    rules: Rules,
    stamps: NDArray[np.int64],
) -> int:
    """Read the stamps of a run of lines by the layout's kind of stamp."""
    if rules.line.stamp_kind == CALENDAR_TIME:
        return take_calendars(buffer, fields, step, rules.line.delimiter_byte, stamps)
    return take_stamps(
        buffer, fields, step, (spread_mark(rules.line.decimal_byte), rules.line.stamp_exponent), stamps
    )


@inner_making_arrays
def take_readings(
    buffer: NDArray[np.uint8], lines: Lines, rules: Rules, destination: Destination, reach: tuple[int, int]
) -> int:
    """Read the six readings of the plain lines at the first mark; return how many lines.

    ``reach``: first row to fill, how many lines at most.
    """
    row, most = reach
    n_columns = len(rules.line.targets)
    rows = count_regular(lines.ends, n_columns, most)
    dots = spread_mark(rules.line.decimal_byte)
    for target in range(1, 7):
        column = rules.columns[target]
        step = (n_columns, lines.end_bytes - 1 if column == n_columns - 1 else 0)
        taken = (destination.acc if target < 4 else destination.gyr)[row : row + rows, (target - 1) % 3]
        rows = take_values(buffer, lines.marks[column:], step, (dots, rules.scales[target]), taken)
    return rows


@inner_making_arrays
def take_plain_rows(
    buffer: NDArray[np.uint8], lines: Lines, rules: Rules, destination: Destination, reach: tuple[int, int]
) -> int:
    """Read the plain lines at the first mark as :func:`take_readings`, with their stamps; return how many."""
    row, _ = reach
    rows = take_readings(buffer, lines, rules, destination, reach)
    if rules.line.stamp_kind == COUNTER:
        for k in range(rows):
            destination.stamps[row + k] = destination.tally[SAMPLES] + k
        return rows
    n_columns, column = len(rules.line.targets), rules.columns[STAMP]
    step = (n_columns, lines.end_bytes - 1 if column == n_columns - 1 else 0)
    return take_plain_stamps(buffer, lines.marks[column:], step, rules, destination.stamps[row : row + rows])


# Whole lines of bytes to float32 columns: the plain path as far as it leads, the careful one for the rest.


SHORTEST_RUN, LONGEST_RUN = 1, 1024
"""Lines that are tried together on the plain path; few enough that they stay in the processor's cache."""


@inner_making_arrays
def parse_line(
    buffer: NDArray[np.uint8], at_byte: int, row: int, rules: Rules, destination: Destination
) -> tuple[int, int]:
    """Read the line at ``at_byte``, of any form; return the first byte after it and how many rows it gave.

    ``row``: where its values go.
    """
    tally, stamps = destination.tally, destination.stamps
    is_header = starts_with(buffer, at_byte, rules.header)
    if is_header or is_blank(buffer, at_byte, rules.line.delimiter_byte):
        tally[HEADERS if is_header else BLANKS] += 1
        tally[SAMPLES] += PAUSE
        return next_line(buffer, at_byte), 0
    fields = np.zeros(7)
    at_byte, kind = take_row(buffer, at_byte, rules.line, fields, stamps[row:])
    if rules.line.stamp_kind == COUNTER:
        stamps[row] = tally[SAMPLES]
    tally[SAMPLES] += 1
    if kind == NUMBER:
        keep_row(fields, rules.scales, destination.acc, destination.gyr, row)
    else:
        note_loss(kind, tally)
    return next_line(buffer, at_byte), int(kind == NUMBER)


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
    if rules.line.delimiter_byte == SPACE or not has_all_columns(rules.columns):
        return 0, 0
    return find_marks(
        piece.buffer, (piece.first_byte, piece.stop_byte), rules.line.delimiter_byte, piece.marks, piece.ends
    )


@kernel_making_arrays
def take_plain_readings(piece: Piece, rules: Rules, destination: Destination, row: int) -> tuple[int, int]:
    """Read the six readings of a piece's lines up to the first that is not plain.

    Returns how many lines, and how many bytes end each; ``marks`` and ``ends`` are filled for the stamps.
    """
    n_lines, end_bytes = find_lines(piece, rules)
    line = 0
    while line < n_lines:
        most = min(LONGEST_RUN, n_lines - line)
        lines = Lines(piece.marks[piece.ends[line] :], piece.ends[line:], end_bytes)
        rows = take_readings(piece.buffer, lines, rules, destination, (row + line, most))
        line += rows
        if rows < most:
            break
    return line, end_bytes


def parse_plain_lines(piece: Piece, rules: Rules, destination: Destination, row: int) -> tuple[int, int]:
    """Read lines up to the first that is not plain; return the first row not filled and first byte not read.

    Most files hold no other lines. The careful path, and the kind of stamps that a file does not have, are
    most of what there is to compile, and are left until they are needed.
    """
    rows, end_bytes = take_plain_readings(piece, rules, destination, row)
    if rows == 0:
        return row, piece.first_byte
    tally, stamps = destination.tally, destination.stamps[row : row + rows]
    if rules.line.stamp_kind == COUNTER:
        number = int(tally[SAMPLES])
        stamps[:] = np.arange(number, number + rows)
    else:
        column, n_columns = int(rules.columns[STAMP]), len(rules.line.targets)
        fields, step = piece.marks[column:], (n_columns, end_bytes - 1 if column == n_columns - 1 else 0)
        if rules.line.stamp_kind == CALENDAR_TIME:
            rows = take_calendars(piece.buffer, fields, step, rules.line.delimiter_byte, stamps)
        else:
            form = (np.uint64(spread_mark(rules.line.decimal_byte)), rules.line.stamp_exponent)
            rows = take_stamps(piece.buffer, fields, step, form, stamps)
    tally[LINES] += rows
    tally[SAMPLES] += rows
    return row + rows, int(piece.marks[piece.ends[rows]]) + 1


@kernel_making_arrays
def parse_lines(piece: Piece, rules: Rules, destination: Destination, row: int) -> int:
    """Read all lines of a piece into the columns from ``row`` on; return the first row not filled.

    Runs of lines are first tried on the plain path; the line at which it stops is read with care, so that
    the plain path decides nothing but the time it takes. Runs that succeed grow, so that the work stays
    linear where few lines are plain.
    """
    buffer, marks, ends, tally = piece.buffer, piece.marks, piece.ends, destination.tally
    n_lines, end_bytes = find_lines(piece, rules)
    at = piece.first_byte
    line = 0
    run = SHORTEST_RUN
    while at < piece.stop_byte:
        most = min(run, n_lines - line)
        lines = Lines(marks[ends[line] :], ends[line:], end_bytes)
        rows = take_plain_rows(buffer, lines, rules, destination, (row, most)) if most > 0 else 0
        if rows > 0:
            tally[LINES] += rows
            tally[SAMPLES] += rows
            row += rows
            line += rows
            at = np.int64(marks[ends[line]]) + 1
            run = min(2 * run, LONGEST_RUN)
            continue
        tally[LINES] += 1
        at, kept = parse_line(buffer, at, row, rules, destination)
        row += kept
        line += int(line < n_lines)
        run = SHORTEST_RUN
    return row
