"""The lines of a text table: whole lines of bytes to float32 columns.

Lines of exactly the usual fields are read on the plain path: column by column, on runs of lines whose field
ends are known, so that each loop is short and its branches are predictable. A number there has at most 16
characters: it is loaded as two machine words, its decimal mark is removed by shifting, all digits are
checked at once and folded pairwise into an integer (D. Lemire, "Quickly parsing eight digits", 2018). All
other lines are read on the careful path, byte by byte: any number of digits, exponents, quotes, padding,
damage. There a field becomes an integer mantissa and a power of ten: correctly rounded for up to 15 digits,
and within one unit in the last place of a double beyond, which is far below float32. Both paths give the same
numbers, so that the plain path only saves time.

Numba has no unaligned loads and no byte compare over 64 bytes; the intrinsics add them. They do not check
bounds: see ``LEAD_BYTES`` and ``TRAIL_BYTES``. Every piece ends with a newline, at which all loops stop.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return, misc, untyped-decorator"
# mypy: disable-error-code="call-arg, var-annotated, call-overload, import-untyped, operator"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import sys
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import cycle
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from acromion.fusion.numba_kernels import inner_making_arrays, kernel_making_arrays, njit
from acromion.fusion.readers.samples import PAUSE

Bytes = NDArray[np.uint8]
Marks = NDArray[np.int32]
"""Places in the buffer, or in another array of places."""
Stamps = NDArray[np.int64]

IGNORED, STAMP = -1, 0
"""Targets of columns, beside 1 to 3 for acceleration and 4 to 6 for angular rate."""
COUNTER, NUMERIC_TIME, CALENDAR_TIME = 0, 1, 2
"""Where the stamps come from: the row's number, a number in some unit, a date with a time."""
LINES, BLANKS, BAD, ABSENT, HEADERS, FIRST_BAD_LINE, LAST_BAD_LINE, SAMPLES = range(8)
"""Places in the tally: lines; blank ones; unreadable ones; rows with a value that is absent; repeated
headers; where the first and last unreadable line stood; rows that were meant to be there."""
TALLY_PLACES = 8
LARGEST_VALUE = 1e9
"""No sensor writes more in any unit: the line was damaged."""


class Rules(NamedTuple):
    """How the lines of a table are to be read.

    ``header``: bytes of the header line.
    ``targets``: for each column -1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate.
    ``fewest``: fields that a row has at least; the columns after them are ignored.
    ``columns``, ``scales``: shape (7,): the column of each target, -1 for none, and its factor.
    ``delimiter``, ``decimal``: codes of the characters.
    ``stamp_kind``, ``stamp_exponent``: where the stamps come from, and the power of ten to microseconds.
    """

    header: Bytes
    targets: NDArray[np.int64]
    fewest: int
    columns: NDArray[np.int64]
    scales: NDArray[np.float64]
    delimiter: int
    decimal: int
    stamp_kind: int
    stamp_exponent: int


class Rows(NamedTuple):
    """Rows as read: samples, shape (n, 3), stamps, shape (n,), and the tally, shape (8,)."""

    acc: NDArray[np.float32]
    gyr: NDArray[np.float32]
    stamps: Stamps
    tally: NDArray[np.int64]


# Eight bytes of text at a time.

LEAD_BYTES, TRAIL_BYTES = 16, 64
"""Bytes that the buffer must have before the first line and after the last one."""
NEWLINE, RETURN, SPACE, QUOTE, PLUS, MINUS, POINT, ZERO, NINE = 10, 13, 32, 34, 43, 45, 46, 48, 57
WORD_DIGITS = 8
LONGEST_FIELD = 16
NOT_PLAIN = -1
"""Returned for a field that needs the careful path."""

EVERY_BYTE = np.uint64(0x0101010101010101)
TOP_BITS = np.uint64(0x8080808080808080)
LOW_BITS = np.uint64(0x7F7F7F7F7F7F7F7F)
ABOVE_NINE = np.uint64(0x7676767676767676)
"""Added to a byte of 0 to 9 it leaves the top bit clear, to one of 10 to 127 it sets it."""
ZEROS = np.uint64(0x3030303030303030)
EIGHT, ONE, ZERO_WORD, BYTE_PLACES = np.uint64(8), np.uint64(1), np.uint64(0), np.uint64(56)
ALL_BITS = np.uint64(0xFFFFFFFFFFFFFFFF)
LAST_BYTE, MINUS_BYTE, SPACE_BYTE = np.uint64(255), np.uint64(MINUS), np.uint64(SPACE)
SHIFT_BITS = np.uint64(63)
PAIRS = np.uint64(0x000000FF000000FF)
FOLD_ODD, FOLD_EVEN = np.uint64(0x000F424000000064), np.uint64(0x0000271000000001)
THREE, TEN, SIXTEEN, THIRTY_TWO = np.uint64(3), np.uint64(10), np.uint64(16), np.uint64(32)
WORD_BITS = np.uint64(64)
TEN_TO_EIGHT = np.int64(100_000_000)
KEPT_BYTES = np.array(
    [0] + [(0xFFFFFFFFFFFFFFFF << (64 - 8 * n)) & 0xFFFFFFFFFFFFFFFF for n in range(1, 9)], np.uint64
)
"""Mask of the last n bytes of a word, in the order of the text."""


def _load(context: Any, builder: Any, signature: Any, arguments: Any, machine_type: Any) -> Any:
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    place = builder.gep(array.data, [arguments[1]])
    value = builder.load(builder.bitcast(place, machine_type.as_pointer()))
    value.align = 1
    return value


@intrinsic
def load_word(typing_context, buffer, at):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return eight bytes in the order of the text: the first is the least significant."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = _load(context, builder, signature, arguments, ir.IntType(64))
        return word if sys.byteorder == "little" else builder.bswap(word)

    return types.uint64(buffer, types.intp), generate


@intrinsic
def match_byte(typing_context, buffer, at, byte):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return 64 bits, one for each of 64 bytes: set if it is ``byte``."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        lanes = ir.VectorType(ir.IntType(8), 64)
        text = _load(context, builder, signature, arguments, lanes)
        wanted = builder.trunc(arguments[2], ir.IntType(8))
        nothing = ir.Constant(lanes, ir.Undefined)
        single = builder.insert_element(nothing, wanted, ir.IntType(32)(0))
        spread = builder.shuffle_vector(
            single, nothing, ir.Constant(ir.VectorType(ir.IntType(32), 64), [0] * 64)
        )
        return builder.bitcast(builder.icmp_unsigned("==", text, spread), ir.IntType(64))

    return types.uint64(buffer, types.intp, types.int64), generate


@intrinsic
def lowest_bit(typing_context, word):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return the place of the lowest bit that is set; 64 if none is."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
        return builder.cttz(arguments[0], ir.IntType(1)(0))

    return types.uint64(types.uint64), generate


@intrinsic
def count_bits(typing_context, word):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return how many bits are set."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ARG001
        return builder.ctpop(arguments[0])

    return types.uint64(types.uint64), generate


@njit(cache=True, nogil=True, forceinline=True)
def _fold_digits(word: int) -> int:
    """Eight bytes of 0 to 9, the most significant first in the text, as one integer."""
    pairs = word * TEN + (word >> EIGHT)
    even, odd = pairs & PAIRS, (pairs >> SIXTEEN) & PAIRS
    return np.int64((even * FOLD_ODD + odd * FOLD_EVEN) >> THIRTY_TWO)


@njit(cache=True, nogil=True, forceinline=True)
def _find_dot(word: int, dots: int) -> int:
    """Eight times the place of the decimal mark among the eight bytes; 64 for none.

    The classic test for a zero byte: only bytes above the first one can be wrongly reported.
    """
    apart = word ^ dots
    dot = (apart - EVERY_BYTE) & ~apart & TOP_BITS
    return WORD_BITS if dot == ZERO_WORD else lowest_bit(dot) & BYTE_PLACES


@njit(cache=True, nogil=True, forceinline=True)
def _close_gap(word: int, place_bits: int, filling: int) -> int:
    """Remove the byte at ``place_bits``: the bytes before it move up, and ``filling`` follows."""
    below = (ONE << place_bits) - ONE
    return (word & (~below << EIGHT)) | ((word & below) << EIGHT) | filling


@njit(cache=True, nogil=True, forceinline=True)
def _find_others(word: int) -> int:
    """Return a bit for each byte other than the digits 0 to 9; 0 if all are digits."""
    return (((word & LOW_BITS) + ABOVE_NINE) | word) & TOP_BITS


@kernel_making_arrays
def spread_mark(decimal_byte: int) -> int:
    """The decimal mark XOR `0`, in each of the eight bytes of a word."""
    return np.uint64(decimal_byte ^ ZERO) * EVERY_BYTE


@njit(cache=True, nogil=True, forceinline=True)
def take_plain(buffer: Bytes, first_byte: int, stop_byte: int, dots: int) -> tuple[int, int]:
    """Read `-12.345` between two marks: mantissa and decimals; decimals ``NOT_PLAIN`` for any other form.

    ``dots``: as of :func:`spread_mark`. At most 16 characters after the sign, so that with a decimal mark the
    mantissa has no more than 15 digits, which a double holds exactly.
    """
    is_negative = buffer[first_byte] == MINUS
    length = stop_byte - first_byte - np.int64(is_negative)
    if length < 1 or length > LONGEST_FIELD:
        return np.int64(0), NOT_PLAIN
    late = (load_word(buffer, stop_byte - 8) ^ ZEROS) & KEPT_BYTES[min(length, 8)]
    early = (load_word(buffer, stop_byte - 16) ^ ZEROS) & KEPT_BYTES[max(length - 8, 0)]
    decimals = np.int64(0)
    place = _find_dot(late, dots)
    if place != WORD_BITS:
        late = _close_gap(late, place, early >> BYTE_PLACES)
        early <<= EIGHT
        decimals = np.int64(7) - np.int64(place >> THREE)
        length -= 1
    elif length > WORD_DIGITS:
        place = _find_dot(early, dots)
        if place != WORD_BITS:
            early = _close_gap(early, place, ZERO_WORD)
            decimals = np.int64(15) - np.int64(place >> THREE)
            length -= 1
    if length < 1 or (_find_others(late) | _find_others(early)) != ZERO_WORD:
        return np.int64(0), NOT_PLAIN
    mantissa = _fold_digits(early) * TEN_TO_EIGHT + _fold_digits(late)
    return -mantissa if is_negative else mantissa, decimals


# Where fields and lines end, 64 bytes at a time.

WORD_BYTES = 64
EIGHT_MARKS = 8
SPARE_MARKS = 16
"""Room that must be left behind the last mark."""


@njit(cache=True, nogil=True, forceinline=True)
def _write_marks(marks: Marks, found: int, base_byte: int, word: int) -> None:
    """Write the places of the bits that are set, eight at a time: what is too much is written over later."""
    at = np.uintp(found)
    while word != ZERO_WORD:
        for k in range(EIGHT_MARKS):
            marks[at + np.uintp(k)] = base_byte + np.int64(lowest_bit(word))
            word &= word - ONE
        at += np.uintp(EIGHT_MARKS)


@njit(cache=True, nogil=True, forceinline=True)
def _write_ends(ends: Marks, lines: int, found: int, word: int, newlines: int) -> int:
    """Write which of the marks in ``word`` are ends of lines; return the new number of lines."""
    while newlines != ZERO_WORD:
        rest = newlines & (newlines - ONE)
        before = word & ((newlines ^ rest) - ONE)
        lines += 1
        ends[np.uintp(lines)] = found + np.int64(count_bits(before))
        newlines = rest
    return lines


@kernel_making_arrays
def find_marks(
    buffer: Bytes, span: tuple[int, int], delimiter_byte: int, marks: Marks, ends: Marks
) -> tuple[int, int]:
    """Find the ends of fields and lines in ``buffer[span[0]:span[1]]``, which ends with a newline.

    ``marks`` receives the byte before the span and all delimiters and newlines in it; ``ends`` receives the
    places in ``marks`` of the first and of all newlines. Both need ``SPARE_MARKS`` more room than there are
    bytes. Returns how many lines there are and how many bytes end each, 1 or 2 (CRLF); no lines if both
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
        _write_marks(marks, found, base, word)
        lines = _write_ends(ends, lines, found, word, newlines)
        found += np.int64(count_bits(word))
        returns += np.int64(count_bits(back))
        pairs += np.int64(count_bits(newlines & ((back << ONE) | carried)))
        carried = back >> SHIFT_BITS
    if returns == 0:
        return lines, 1
    return (lines, 2) if returns == pairs == lines else (0, 0)


# The plain path: many numbers of one column at a time, with the same steps for all, so that the compiler puts
# them side by side.
#
# Most columns keep to one number of decimals. Where it is foreseen, a number of at most eight digits needs
# no search for its decimal mark: the decimals and the digits before the mark are each loaded to where they
# belong in one word. The words of a block are gathered first, then folded without a branch between; a block
# that holds any other form is left to ``take_plain``.
#
# ``fields``: marks from the column's first on; ``step``: marks from a row to the next, and bytes between the
# field and the mark after it.

BLOCK_ROWS, RUN_ROWS = 256, 1024
"""Rows of one column, and of all columns, that are read together: a run stays in the processor's cache."""
WORDS_OF_A_FIELD = 4
MOST_DECIMALS = WORD_DIGITS - 1
SHIFT_OF_ALL = np.uint64(72)
"""Bits of the longest form, nine characters."""
POWERS = 10.0 ** np.arange(0, 320).clip(0, 308)
WHOLE_POWERS = 10 ** np.arange(0, 19, dtype=np.int64)
LARGEST_WHOLE = np.int64(9_000_000_000_000_000_000) // WHOLE_POWERS
Words = NDArray[np.uint64]
"""Shape (4, block): the first bytes of each field, its last eight, those before its decimals, its length."""


@kernel_making_arrays
def gather_words(buffer: Bytes, fields: Marks, step: tuple[int, int], decimals: int, words: Words) -> None:
    """Load the words of as many fields as there is room for."""
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

    ``form``: the decimal mark as of :func:`spread_mark`, the power of ten of the decimals, and
    the factor to be applied.
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
        others |= _find_others(word) | (((end ^ dots) >> mark_at) & LAST_BYTE)
        others |= np.uint64(np.int64(digits - shortest > spread))
        mantissa = _fold_digits(word)
        values[row] = ((mantissa ^ -np.int64(minus)) + np.int64(minus)) / power * factor
    return others == ZERO_WORD


@njit(cache=True, nogil=True, forceinline=True)
def _skip_word_spaces(buffer: Bytes, at_byte: int) -> int:
    while load_word(buffer, at_byte) & LAST_BYTE == SPACE_BYTE:
        at_byte += 1
    return at_byte


@inner_making_arrays
def _take_values(
    buffer: Bytes,
    fields: Marks,
    step: tuple[int, int],
    form: tuple[int, float],
    values: NDArray[np.float32],
) -> int:
    """Read a column of numbers; return how many, up to the first that is not plain or too large.

    ``form``: decimal mark as of :func:`spread_mark`, factor.
    """
    if len(values) == 0:
        return 0
    stride, tail = step
    dots, factor = form
    words, folded = np.empty((WORDS_OF_A_FIELD, BLOCK_ROWS), np.uint64), np.empty(BLOCK_ROWS)
    _, usual = take_plain(buffer, np.int64(fields[0]) + 1, np.int64(fields[1]) - tail, dots)
    for first in range(0, len(values), BLOCK_ROWS):
        block = values[first : first + BLOCK_ROWS]
        places = fields[first * stride :]
        if 1 <= usual <= MOST_DECIMALS and len(block) == BLOCK_ROWS:
            gather_words(buffer, places, step, usual, words)
            if fold_words(words, usual, (dots, POWERS[usual], factor), folded):
                for row in range(BLOCK_ROWS):
                    block[row] = folded[row]
                continue
        for row in range(len(block)):
            at = _skip_word_spaces(buffer, np.int64(places[row * stride]) + 1)
            mantissa, decimals = take_plain(buffer, at, np.int64(places[row * stride + 1]) - tail, dots)
            value = mantissa / POWERS[decimals]
            if decimals == NOT_PLAIN or abs(value) >= LARGEST_VALUE:
                return first + row
            block[row] = value * factor
    return len(values)


@kernel_making_arrays
def _take_plain_readings(
    buffer: Bytes, marks: Marks, ends: Marks, end_bytes: int, rules: Rules, rows: Rows
) -> int:
    """Read the six readings of the plain lines at the first mark; return how many lines."""
    n_columns, n_lines = len(rules.targets), len(ends) - 1
    dots = spread_mark(rules.decimal)
    line = 0
    while line < n_lines:
        most = min(RUN_ROWS, n_lines - line)
        taken = 0
        while taken < most and ends[line + taken + 1] - ends[line + taken] == n_columns:
            taken += 1
        for target in range(1, 7):
            column = rules.columns[target]
            step = (n_columns, end_bytes - 1 if column == n_columns - 1 else 0)
            values = (rows.acc if target < 4 else rows.gyr)[line : line + taken, (target - 1) % 3]
            fields = marks[ends[line] - ends[0] + column :]
            taken = _take_values(buffer, fields, step, (dots, rules.scales[target]), values)
        line += taken
        if taken < most:
            break
    return line


@kernel_making_arrays
def _take_plain_numbers(
    buffer: Bytes, fields: Marks, step: tuple[int, int], form: tuple[int, int], stamps: Stamps
) -> int:
    """Read a column of numbers that are times; ``form``: decimal mark, power of ten to microseconds."""
    stride, tail = step
    dots, exponent = form
    for row in range(len(stamps)):
        first = _skip_word_spaces(buffer, np.int64(fields[row * stride]) + 1)
        stop = np.int64(fields[row * stride + 1]) - tail
        mantissa, decimals = take_plain(buffer, first, stop, dots)
        if decimals == NOT_PLAIN:
            return row
        stamps[row] = _scale_stamp(mantissa, exponent - decimals)
    return len(stamps)


MINUTE_BYTES = 17
"""Of `2019-02-14T08:58:`, what all stamps of a minute begin with."""
MARKS_OF_A_MINUTE = 1 << 4 | 1 << 7 | 1 << 10 | 1 << 13 | 1 << 16
"""A bit for each byte that is not a digit."""
LONGEST_SECOND = 61


@inner_making_arrays
def _is_minute(buffer: Bytes, at_byte: int) -> bool:
    """Whether `2019-02-14T08:58:` stands here: digits, with one other byte after each number."""
    for k in range(MINUTE_BYTES):
        is_digit = ZERO <= buffer[at_byte + k] <= NINE
        if is_digit == bool(MARKS_OF_A_MINUTE >> k & 1):
            return False
    return True


@inner_making_arrays
def _take_seconds(buffer: Bytes, at_byte: int, stop_byte: int) -> int:
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
    return _scale_stamp(mantissa, 6 - decimals)


@kernel_making_arrays
def _take_plain_calendars(
    buffer: Bytes, fields: Marks, step: tuple[int, int], delimiter_byte: int, stamps: Stamps
) -> int:
    """Read a column of dates with times; where the minute is that of the row before, by the seconds only."""
    early, late, minute_us = np.uint64(0), np.uint64(0), np.int64(0)
    for row in range(len(stamps)):
        first = np.int64(fields[row * step[0]]) + 1
        stop = np.int64(fields[row * step[0] + 1]) - step[1]
        at = first + MINUTE_BYTES
        seconds_us = _take_seconds(buffer, at, stop) if stop > at else -1
        if seconds_us < 0:
            return row
        if load_word(buffer, first) != early or load_word(buffer, at - 8) != late:
            end, stamp, kind = _take_calendar(buffer, first, delimiter_byte)
            if kind != NUMBER or end != stop or not _is_minute(buffer, first):
                return row
            early, late, minute_us = load_word(buffer, first), load_word(buffer, at - 8), stamp - seconds_us
        stamps[row] = minute_us + seconds_us
    return len(stamps)


# The careful path: one field of bytes.

NUMBER, MISSING, UNREADABLE = 0, 1, 2
LONGEST_WORD = 4
ABSENT_WORDS = tuple(int.from_bytes(word, "big") for word in (b"na", b"nan", b"inf", b"null"))
LEAST_FULL = 10**17
"""A mantissa takes digits up to here, 18 in all; further ones only count."""
FOUR_DIGITS = 10_000


@inner_making_arrays
def _is_end(byte: int, delimiter_byte: int) -> bool:
    return byte == delimiter_byte or byte == NEWLINE or byte == RETURN  # noqa: PLR1714 (bare compares in the kernel)


@inner_making_arrays
def _skip_field(buffer: Bytes, at_byte: int, delimiter_byte: int) -> int:
    while not _is_end(buffer[at_byte], delimiter_byte):
        at_byte += 1
    return at_byte


@inner_making_arrays
def _skip_ignored(buffer: Bytes, at_byte: int, delimiter_byte: int, columns_after: int) -> int:
    """Skip a field whose value does not matter: between quotes it may contain the delimiter."""
    start = at_byte
    while buffer[at_byte] == SPACE and delimiter_byte != SPACE:
        at_byte += 1
    if buffer[at_byte] == QUOTE and delimiter_byte != SPACE:
        is_open = True
        at_byte += 1
        while buffer[at_byte] != NEWLINE and (is_open or buffer[at_byte] != delimiter_byte):
            is_open ^= buffer[at_byte] == QUOTE
            at_byte += 1
        if not is_open and (columns_after == 0 or buffer[at_byte] == delimiter_byte):
            return at_byte
    return _skip_field(buffer, start, delimiter_byte)


@inner_making_arrays
def _skip_padding(buffer: Bytes, at_byte: int, delimiter_byte: int) -> int:
    while (buffer[at_byte] == SPACE and delimiter_byte != SPACE) or buffer[at_byte] == QUOTE:
        at_byte += 1
    return at_byte


@inner_making_arrays
def _take_digits(buffer: Bytes, at_byte: int, mantissa: int) -> tuple[int, int, int]:
    """Append digits to the mantissa; return where they end, the new mantissa, and how many found no place."""
    left_out = 0
    digit = np.int64(buffer[at_byte]) - ZERO
    while 0 <= digit <= 9:
        if mantissa < LEAST_FULL:
            mantissa = mantissa * 10 + digit
        else:
            left_out += 1
        at_byte += 1
        digit = np.int64(buffer[at_byte]) - ZERO
    return at_byte, mantissa, left_out


@inner_making_arrays
def _take_exponent(buffer: Bytes, at_byte: int) -> tuple[int, int]:
    """Read `e-05`; return (where it began, 0) if no digit follows."""
    start = at_byte
    at_byte += 1
    is_negative = buffer[at_byte] == MINUS
    if is_negative or buffer[at_byte] == PLUS:
        at_byte += 1
    end, exponent, _ = _take_digits(buffer, at_byte, np.int64(0))
    if end == at_byte or end - at_byte > 4:
        return start, 0
    return end, -exponent if is_negative else exponent


@inner_making_arrays
def _classify_word(buffer: Bytes, at_byte: int, end_byte: int) -> int:
    """Whether a field is absent (empty, `-`, nan, inf, null, NA) or unreadable."""
    while at_byte < end_byte and (
        buffer[at_byte] == PLUS or buffer[at_byte] == MINUS or buffer[at_byte] == SPACE
    ):
        at_byte += 1
    while end_byte > at_byte and (buffer[end_byte - 1] == SPACE or buffer[end_byte - 1] == QUOTE):
        end_byte -= 1
    if at_byte == end_byte:
        return MISSING
    word = 0
    for k in range(at_byte, min(end_byte, at_byte + LONGEST_WORD)):
        word = word << 8 | (buffer[k] | 32)
    is_whole = end_byte - at_byte <= LONGEST_WORD
    return MISSING if is_whole and word in ABSENT_WORDS else UNREADABLE


@inner_making_arrays
def _take_number(
    buffer: Bytes, at_byte: int, delimiter_byte: int, decimal_byte: int
) -> tuple[int, int, int, int]:
    """Read one field; return where it ends, mantissa, power of ten, and its kind."""
    at_byte = _skip_padding(buffer, at_byte, delimiter_byte)
    start = at_byte
    is_negative = buffer[at_byte] == MINUS
    if is_negative or buffer[at_byte] == PLUS:
        at_byte += 1
    first_digit = at_byte
    at_byte, mantissa, exponent = _take_digits(buffer, at_byte, np.int64(0))
    digits = at_byte - first_digit
    if buffer[at_byte] == decimal_byte:
        point = at_byte + 1
        at_byte, mantissa, left_out = _take_digits(buffer, point, mantissa)
        digits += at_byte - point
        exponent -= at_byte - point - left_out
    if digits > 0 and (buffer[at_byte] | 32) == 101:
        at_byte, power = _take_exponent(buffer, at_byte)
        exponent += power
    after = _skip_padding(buffer, at_byte, delimiter_byte)
    if digits > 0 and _is_end(buffer[after], delimiter_byte):
        return after, -mantissa if is_negative else mantissa, exponent, NUMBER
    end = _skip_field(buffer, after, delimiter_byte)
    return end, np.int64(0), 0, _classify_word(buffer, start, end)


@inner_making_arrays
def _scale_decimal(mantissa: int, exponent: int) -> float:
    if exponent < 0:
        return mantissa / POWERS[min(-exponent, 308)]
    return mantissa * POWERS[min(exponent, 308)]


@inner_making_arrays
def _scale_stamp(mantissa: int, exponent: int) -> int:
    """Mantissa times a power of ten, as a whole number rounded to the nearest."""
    if 0 <= exponent <= 18 and abs(mantissa) <= LARGEST_WHOLE[exponent]:
        return mantissa * WHOLE_POWERS[exponent]
    if -18 <= exponent < 0:
        unit = WHOLE_POWERS[-exponent]
        return (mantissa + unit // 2) // unit
    value = _scale_decimal(mantissa, exponent)
    return np.int64(value) if abs(value) < 9e18 else np.int64(0)


@inner_making_arrays
def _count_days(year: int, month: int, day: int) -> int:
    """Days from 1970-01-01 in the Gregorian calendar (H. Hinnant, days_from_civil)."""
    year -= int(month <= 2)
    era = year // 400
    year_of_era = year - era * 400
    day_of_year = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146_097 + year_of_era * 365 + year_of_era // 4 - year_of_era // 100 + day_of_year - 719_468


@inner_making_arrays
def _take_calendar(buffer: Bytes, at_byte: int, delimiter_byte: int) -> tuple[int, int, int]:
    """Read `2019-02-14T08:58:00.0100000`; return where it ends, microseconds since 1970, and its kind."""
    at_byte = _skip_padding(buffer, at_byte, delimiter_byte)
    start = at_byte
    date, clock = np.int64(0), np.int64(0)  # three numbers of up to four digits each
    for k in range(6):
        end, part, _ = _take_digits(buffer, at_byte, np.int64(0))
        if end == at_byte or end - at_byte > 4:
            end = _skip_field(buffer, at_byte, delimiter_byte)
            return end, np.int64(0), _classify_word(buffer, start, end)
        if k < 3:
            date = date * FOUR_DIGITS + part
        else:
            clock = clock * FOUR_DIGITS + part
        at_byte = end + int(k < 5 and not _is_end(buffer[end], delimiter_byte))
    fraction_us = np.int64(0)
    if buffer[at_byte] == 46 or (buffer[at_byte] == 44 and delimiter_byte != 44):
        end, digits, left_out = _take_digits(buffer, at_byte + 1, np.int64(0))
        fraction_us = _scale_stamp(digits, 6 - (end - at_byte - 1 - left_out))
        at_byte = end
    at_byte = _skip_padding(buffer, at_byte, delimiter_byte)
    if buffer[at_byte] == 90:  # Z
        at_byte += 1
    year, month, day = date // FOUR_DIGITS**2, date // FOUR_DIGITS % FOUR_DIGITS, date % FOUR_DIGITS
    hour, minute, second = clock // FOUR_DIGITS**2, clock // FOUR_DIGITS % FOUR_DIGITS, clock % FOUR_DIGITS
    is_sane = 1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 61
    seconds = _count_days(year, month, day) * 86_400 + hour * 3600 + minute * 60 + second
    kind = NUMBER if is_sane and _is_end(buffer[at_byte], delimiter_byte) else UNREADABLE
    return _skip_field(buffer, at_byte, delimiter_byte), seconds * 1_000_000 + fraction_us, kind


# The careful path: one line.


@inner_making_arrays
def _take_row(
    buffer: Bytes, at_byte: int, rules: Rules, fields: NDArray[np.float64], stamps: Stamps
) -> tuple[int, int]:
    """Read one line into ``fields``, shape (7,), and ``stamps[0]``; return its end and its worst field.

    Fields after the last column are unreadable unless they are empty.
    """
    delimiter, decimal = rules.delimiter, rules.decimal
    worst = NUMBER
    for column in range(len(rules.targets)):
        if column > 0:
            if buffer[at_byte] != delimiter:
                if column >= rules.fewest:
                    break
                return at_byte, UNREADABLE
            at_byte += 1
        while delimiter == SPACE and buffer[at_byte] == SPACE:
            at_byte += 1
        target = rules.targets[column]
        if target == IGNORED:
            at_byte = _skip_ignored(buffer, at_byte, delimiter, len(rules.targets) - 1 - column)
            continue
        if target == STAMP and rules.stamp_kind == CALENDAR_TIME:
            at_byte, stamps[0], kind = _take_calendar(buffer, at_byte, delimiter)
        else:
            at_byte, mantissa, exponent, kind = _take_number(buffer, at_byte, delimiter, decimal)
            if target == STAMP:
                stamps[0] = _scale_stamp(mantissa, exponent + rules.stamp_exponent)
            else:
                fields[target] = _scale_decimal(mantissa, exponent)
                kind = kind if abs(fields[target]) < LARGEST_VALUE else UNREADABLE
        worst = max(worst, kind)
    while buffer[at_byte] == delimiter or buffer[at_byte] == SPACE or buffer[at_byte] == RETURN:
        at_byte += 1
    return at_byte, worst if buffer[at_byte] == NEWLINE else UNREADABLE


@inner_making_arrays
def _is_blank(buffer: Bytes, at_byte: int, delimiter_byte: int) -> bool:
    """Whether the line contains only padding."""
    while (
        buffer[at_byte] == SPACE
        or buffer[at_byte] == RETURN
        or buffer[at_byte] == delimiter_byte
        or buffer[at_byte] == QUOTE
    ):
        at_byte += 1
    return buffer[at_byte] == NEWLINE


@inner_making_arrays
def _starts_with(buffer: Bytes, at_byte: int, word: Bytes) -> bool:
    """Whether the line begins with ``word``, which must not contain a newline."""
    for k in range(len(word)):
        if buffer[at_byte + k] != word[k]:
            return False
    return len(word) > 0


@inner_making_arrays
def _note_loss(kind: int, tally: NDArray[np.int64]) -> None:
    """Count a row that was not kept."""
    if kind == MISSING:
        tally[ABSENT] += 1
        return
    tally[BAD] += 1
    tally[LAST_BAD_LINE] = tally[LINES]
    if tally[FIRST_BAD_LINE] == 0:
        tally[FIRST_BAD_LINE] = tally[LINES]


@kernel_making_arrays
def _take_careful_lines(
    buffer: Bytes, span: tuple[int, int], most_lines: int, rules: Rules, rows: Rows, row: int
) -> tuple[int, int]:
    """Read lines of any form into ``rows`` from ``row`` on; return first byte not read and row not filled."""
    tally, stamps = rows.tally, rows.stamps
    at, stop = span
    fields = np.zeros(7)
    last_line = tally[LINES] + most_lines
    while at < stop and tally[LINES] < last_line:
        tally[LINES] += 1
        is_header = _starts_with(buffer, at, rules.header)
        if is_header or _is_blank(buffer, at, rules.delimiter):
            tally[HEADERS if is_header else BLANKS] += 1
            tally[SAMPLES] += PAUSE
        else:
            at, kind = _take_row(buffer, at, rules, fields, stamps[row:])
            if rules.stamp_kind == COUNTER:
                stamps[row] = tally[SAMPLES]
            tally[SAMPLES] += 1
            if kind == NUMBER:
                for axis in range(3):
                    rows.acc[row, axis] = fields[1 + axis] * rules.scales[1 + axis]
                    rows.gyr[row, axis] = fields[4 + axis] * rules.scales[4 + axis]
                row += 1
            else:
                _note_loss(kind, tally)
        while buffer[at] != NEWLINE:
            at += 1
        at += 1
    return at, row


# The driver: pieces of whole lines, on two cores, the rows in their order.
#
# The kernels release the interpreter's lock. No piece needs what another holds, so that neither the number of
# threads nor which of them is faster changes a row.

THREADS = 2
AHEAD = 3
"""Pieces that are read ahead of the current one."""
LARGE_BYTES = 1 << 14
"""A few lines take longer to hand over to a thread than to read."""
SHORTEST_NUMBER_BYTES = 2
FEWEST_LINES = 64
"""So many lines are read at least before the path is changed again."""


@dataclass(frozen=True, slots=True, eq=False)
class LinePiece:
    """Whole lines: ``buffer[first:stop]``, with ``LEAD_BYTES`` before and ``TRAIL_BYTES`` after them."""

    buffer: Bytes
    first_byte: int
    stop_byte: int

    def __len__(self) -> int:
        return self.stop_byte - self.first_byte


class _Room:
    """Where a piece is read: the places of its marks, and its rows; used again for other pieces."""

    def __init__(self) -> None:
        self._marks: Marks = np.empty(0, np.int32)
        self._ends: Marks = np.empty(0, np.int32)
        self._rows = _make_rows(0)

    def read(self, piece: LinePiece, rules: Rules) -> Rows:
        """Read a piece; its rows are valid until the room is used again.

        The careful path, and the kind of stamps that a file does not have, are most of what there is to
        compile, and are left until they are needed. The lines that are tried on either path grow where it
        succeeds, so that the work stays linear in any file.
        """
        row_bytes = SHORTEST_NUMBER_BYTES * int(np.count_nonzero(rules.targets != IGNORED))
        if len(self._marks) < len(piece) + SPARE_MARKS:
            self._marks, self._ends = (np.empty(len(piece) + SPARE_MARKS, np.int32) for _ in range(2))
        if len(self._rows.stamps) < len(piece) // row_bytes + 1:
            self._rows = _make_rows(len(piece) // row_bytes + 1)
        rows, tally = self._rows, self._rows.tally
        tally[:] = 0
        n_lines, end_bytes = self._find_lines(piece, rules)
        at, row, plain, careful = piece.first_byte, 0, n_lines, FEWEST_LINES
        while at < piece.stop_byte:
            line = int(tally[LINES])
            stop = min(line + plain, n_lines)
            taken = self._take_plain(piece, (line, stop, end_bytes), rules, row) if line < stop else 0
            if taken:
                row += taken
                at = int(self._marks[self._ends[line + taken]]) + 1
            if at < piece.stop_byte and taken < max(stop - line, 1):
                span = (at, piece.stop_byte)
                at, row = _take_careful_lines(piece.buffer, span, careful, rules, rows, row)
            plain = max(2 * taken, FEWEST_LINES)
            careful = FEWEST_LINES if taken > careful else 2 * careful
        return Rows(rows.acc[:row], rows.gyr[:row], rows.stamps[:row], tally)

    def _find_lines(self, piece: LinePiece, rules: Rules) -> tuple[int, int]:
        """Find the ends of fields and lines where the plain path can be tried; no lines where it cannot."""
        if rules.delimiter == SPACE or np.any(rules.columns[1:] < 0):
            return 0, 0
        span = (piece.first_byte, piece.stop_byte)
        return find_marks(piece.buffer, span, rules.delimiter, self._marks, self._ends)

    def _take_plain(self, piece: LinePiece, lines: tuple[int, int, int], rules: Rules, row: int) -> int:
        """Read lines (first, stop, bytes that end each) up to a line that is not plain; return how many."""
        line, stop, end_bytes = lines
        ends, (acc, gyr, stamps, tally) = self._ends[line : stop + 1], self._rows
        marks = self._marks[ends[0] :]
        into = Rows(acc[row:], gyr[row:], stamps[row:], tally)
        taken = _take_plain_readings(piece.buffer, marks, ends, end_bytes, rules, into)
        if rules.stamp_kind == COUNTER:
            number = int(tally[SAMPLES])
            into.stamps[:taken] = np.arange(number, number + taken)
        else:
            column, n_columns = int(rules.columns[STAMP]), len(rules.targets)
            fields, step = marks[column:], (n_columns, end_bytes - 1 if column == n_columns - 1 else 0)
            if rules.stamp_kind == CALENDAR_TIME:
                taken = _take_plain_calendars(
                    piece.buffer, fields, step, rules.delimiter, into.stamps[:taken]
                )
            else:
                form = (np.uint64(spread_mark(rules.decimal)), rules.stamp_exponent)
                taken = _take_plain_numbers(piece.buffer, fields, step, form, into.stamps[:taken])
        tally[LINES] += taken
        tally[SAMPLES] += taken
        return taken


def _make_rows(capacity: int) -> Rows:
    values = (np.empty((capacity, 3), np.float32) for _ in range(2))
    return Rows(*values, np.empty(capacity, np.int64), np.zeros(TALLY_PLACES, np.int64))


def read_pieces(pieces: Iterable[LinePiece], rules: Rules) -> Iterator[tuple[int, Rows]]:
    """Read pieces, some of them ahead; yield the bytes and the rows of each, valid until the next.

    A row number and a line in the tally count from the piece's first.
    """
    rooms = cycle([_Room() for _ in range(AHEAD + 1)])
    running: deque[tuple[int, Future[Rows]]] = deque()
    with ThreadPoolExecutor(THREADS) as threads:
        for piece in pieces:
            room = next(rooms)
            if len(piece) >= LARGE_BYTES:
                reading = threads.submit(room.read, piece, rules)
            else:
                reading = Future()
                reading.set_result(room.read(piece, rules))
            running.append((len(piece), reading))
            if len(running) > AHEAD:
                size_bytes, reading = running.popleft()
                yield size_bytes, reading.result()
        while running:
            size_bytes, reading = running.popleft()
            yield size_bytes, reading.result()
