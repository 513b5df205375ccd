"""The careful path through a table, line by line: any number of digits, exponents, quotes, padding, damage.

One field of bytes becomes a number without a string between: an integer mantissa and a power of ten. It is
correctly rounded for up to 15 digits, and within one unit in the last place of a double beyond, which is far
below float32. Every piece ends with a newline, at which all loops stop, so that none checks bounds.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import inner_making_arrays

NEWLINE, RETURN, SPACE, QUOTE, PLUS, MINUS, ZERO, NINE = 10, 13, 32, 34, 43, 45, 48, 57
NUMBER, MISSING, UNREADABLE = 0, 1, 2
LONGEST_MANTISSA = 18
FOUR_DIGITS = 10_000

POWERS = 10.0 ** np.arange(0, 320).clip(0, 308)
WHOLE_POWERS = 10 ** np.arange(0, 19, dtype=np.int64)
LARGEST_WHOLE = np.int64(9_000_000_000_000_000_000) // WHOLE_POWERS


@inner_making_arrays
def is_end(byte: int, delimiter_byte: int) -> bool:
    """Whether a field ends here."""
    return byte == delimiter_byte or byte == NEWLINE or byte == RETURN  # noqa: PLR1714 (bare compares in the kernel)


@inner_making_arrays
def skip_field(buffer: NDArray[np.uint8], at_byte: int, delimiter_byte: int) -> int:
    """Go to the end of the field."""
    while not is_end(buffer[at_byte], delimiter_byte):
        at_byte += 1
    return at_byte


@inner_making_arrays
def skip_spaces(buffer: NDArray[np.uint8], at_byte: int) -> int:
    """Go over spaces."""
    while buffer[at_byte] == SPACE:
        at_byte += 1
    return at_byte


@inner_making_arrays
def skip_padding(buffer: NDArray[np.uint8], at_byte: int, delimiter_byte: int) -> int:
    """Go over spaces and quotes."""
    while (buffer[at_byte] == SPACE and delimiter_byte != SPACE) or buffer[at_byte] == QUOTE:
        at_byte += 1
    return at_byte


@inner_making_arrays
def take_digits(buffer: NDArray[np.uint8], at_byte: int, mantissa: int) -> tuple[int, int]:
    """Append the digits at ``at_byte`` to the mantissa; return where they end and the new mantissa."""
    digit = np.int64(buffer[at_byte]) - ZERO
    while 0 <= digit <= 9:
        mantissa = mantissa * 10 + digit
        at_byte += 1
        digit = np.int64(buffer[at_byte]) - ZERO
    return at_byte, mantissa


@inner_making_arrays
def take_long_digits(
    buffer: NDArray[np.uint8], at_byte: int, stop_byte: int, decimal_byte: int
) -> tuple[int, int]:
    """Mantissa and exponent of more digits than an int64 holds: the first 18 count."""
    mantissa = np.int64(0)
    exponent = 0
    digits = 0
    is_fraction = False
    for k in range(at_byte, stop_byte):
        if buffer[k] == decimal_byte:
            is_fraction = True
            continue
        if digits < LONGEST_MANTISSA:
            mantissa = mantissa * 10 + (np.int64(buffer[k]) - ZERO)
            digits += int(mantissa != 0)
            exponent -= int(is_fraction)
        else:
            exponent += int(not is_fraction)
    return mantissa, exponent


@inner_making_arrays
def take_exponent(buffer: NDArray[np.uint8], at_byte: int) -> tuple[int, int]:
    """Read `e-05`; return (where it began, 0) where no digit follows."""
    start = at_byte
    at_byte += 1
    is_negative = buffer[at_byte] == MINUS
    if is_negative or buffer[at_byte] == PLUS:
        at_byte += 1
    end, exponent = take_digits(buffer, at_byte, np.int64(0))
    if end == at_byte or end - at_byte > 4:
        return start, 0
    return end, -exponent if is_negative else exponent


@inner_making_arrays
def classify_word(buffer: NDArray[np.uint8], at_byte: int, end_byte: int) -> int:
    """Whether a field is absent (empty, `-`, nan, inf, null, NA) or unreadable."""
    while at_byte < end_byte and (
        buffer[at_byte] == PLUS or buffer[at_byte] == MINUS or buffer[at_byte] == SPACE
    ):
        at_byte += 1
    while end_byte > at_byte and (buffer[end_byte - 1] == SPACE or buffer[end_byte - 1] == QUOTE):
        end_byte -= 1
    if at_byte == end_byte:
        return MISSING
    first = buffer[at_byte] | 32
    last = buffer[end_byte - 1] | 32
    if end_byte - at_byte == 2 and first == 110 and last == 97:  # na
        return MISSING
    if end_byte - at_byte == 3 and (
        (first == 110 and last == 110) or (first == 105 and last == 102)
    ):  # nan, inf
        return MISSING
    if end_byte - at_byte == 4 and first == 110 and last == 108:  # null
        return MISSING
    return UNREADABLE


@inner_making_arrays
def take_number(
    buffer: NDArray[np.uint8], at_byte: int, delimiter_byte: int, decimal_byte: int
) -> tuple[int, int, int, int]:
    """Read one field; return where it ends, mantissa, power of ten, and what it is."""
    at_byte = skip_padding(buffer, at_byte, delimiter_byte)
    start = at_byte
    is_negative = buffer[at_byte] == MINUS
    if is_negative or buffer[at_byte] == PLUS:
        at_byte += 1
    first_digit = at_byte
    at_byte, mantissa = take_digits(buffer, at_byte, np.int64(0))
    digits = at_byte - first_digit
    exponent = 0
    if buffer[at_byte] == decimal_byte:
        point = at_byte + 1
        at_byte, mantissa = take_digits(buffer, point, mantissa)
        exponent = point - at_byte
        digits -= exponent
    if digits > LONGEST_MANTISSA:
        mantissa, exponent = take_long_digits(buffer, first_digit, at_byte, decimal_byte)
    if digits > 0 and (buffer[at_byte] | 32) == 101:
        at_byte, power = take_exponent(buffer, at_byte)
        exponent += power
    after = skip_padding(buffer, at_byte, delimiter_byte)
    if digits > 0 and is_end(buffer[after], delimiter_byte):
        return after, -mantissa if is_negative else mantissa, exponent, NUMBER
    end = skip_field(buffer, after, delimiter_byte)
    return end, np.int64(0), 0, classify_word(buffer, start, end)


@inner_making_arrays
def scale_decimal(mantissa: int, exponent: int) -> float:
    """Mantissa times a power of ten."""
    if exponent < 0:
        return mantissa / POWERS[min(-exponent, 308)]
    return mantissa * POWERS[min(exponent, 308)]


@inner_making_arrays
def scale_stamp(mantissa: int, exponent: int) -> int:
    """Mantissa times a power of ten, as a whole number rounded to the nearest."""
    if 0 <= exponent <= 18 and abs(mantissa) <= LARGEST_WHOLE[exponent]:
        return mantissa * WHOLE_POWERS[exponent]
    if -18 <= exponent < 0:
        unit = WHOLE_POWERS[-exponent]
        return (mantissa + unit // 2) // unit
    value = scale_decimal(mantissa, exponent)
    return np.int64(value) if abs(value) < 9e18 else np.int64(0)


@inner_making_arrays
def count_days(year: int, month: int, day: int) -> int:
    """Days from 1970-01-01 in the Gregorian calendar (H. Hinnant, days_from_civil)."""
    year -= int(month <= 2)
    era = year // 400
    year_of_era = year - era * 400
    day_of_year = (153 * (month + (-3 if month > 2 else 9)) + 2) // 5 + day - 1
    return era * 146_097 + year_of_era * 365 + year_of_era // 4 - year_of_era // 100 + day_of_year - 719_468


@inner_making_arrays
def take_calendar(buffer: NDArray[np.uint8], at_byte: int, delimiter_byte: int) -> tuple[int, int, int]:
    """Read `2019-02-14T08:58:00.0100000`; return where it ends, microseconds since 1970, what it is."""
    at_byte = skip_padding(buffer, at_byte, delimiter_byte)
    start = at_byte
    date, clock = np.int64(0), np.int64(0)  # three numbers of up to four digits each
    for k in range(6):
        end, part = take_digits(buffer, at_byte, np.int64(0))
        if end == at_byte or end - at_byte > 4:
            end = skip_field(buffer, at_byte, delimiter_byte)
            return end, np.int64(0), classify_word(buffer, start, end)
        if k < 3:
            date = date * FOUR_DIGITS + part
        else:
            clock = clock * FOUR_DIGITS + part
        at_byte = end + int(k < 5 and not is_end(buffer[end], delimiter_byte))
    fraction_us = np.int64(0)
    if buffer[at_byte] == 46 or (buffer[at_byte] == 44 and delimiter_byte != 44):
        end, digits = take_digits(buffer, at_byte + 1, np.int64(0))
        fraction_us = scale_stamp(digits, 6 - (end - at_byte - 1))
        at_byte = end
    at_byte = skip_padding(buffer, at_byte, delimiter_byte)
    if buffer[at_byte] == 90:  # Z
        at_byte += 1
    year, month, day = date // FOUR_DIGITS**2, date // FOUR_DIGITS % FOUR_DIGITS, date % FOUR_DIGITS
    hour, minute, second = clock // FOUR_DIGITS**2, clock // FOUR_DIGITS % FOUR_DIGITS, clock % FOUR_DIGITS
    is_sane = 1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 61
    seconds = count_days(year, month, day) * 86_400 + hour * 3600 + minute * 60 + second
    kind = NUMBER if is_sane and is_end(buffer[at_byte], delimiter_byte) else UNREADABLE
    return skip_field(buffer, at_byte, delimiter_byte), seconds * 1_000_000 + fraction_us, kind


# One line of a table: where its fields go, and what becomes of a line that cannot be read.


IGNORED, STAMP = -1, 0
LARGEST_VALUE = 1e9
"""No sensor writes more in any unit: the line was damaged."""
COUNTER, NUMERIC_TIME, CALENDAR_TIME = 0, 1, 2
"""Where the stamps come from: the row's number, a number in some unit, a date with a time."""
LINES, BLANKS, BAD, ABSENT, HEADERS, FIRST_BAD_LINE, LAST_BAD_LINE, SAMPLES = range(8)
"""Places in the tally: lines; blank ones; unreadable ones; rows with a value that is absent; repeated
headers; where the first and last unreadable line stood; rows that were meant to be there."""
TALLY_PLACES = 8


class LineForm(NamedTuple):
    """What stands on a line.

    Attributes
    ----------
    targets
        For each column -1 ignored, 0 the stamp, 1 to 3 acceleration, 4 to 6 angular rate.
    delimiter, decimal
        Codes of the characters.
    stamp_kind, stamp_exponent
        Where the stamps come from, and the power of ten to microseconds.
    """

    targets: NDArray[np.int64]
    delimiter_byte: int
    decimal_byte: int
    stamp_kind: int
    stamp_exponent: int


class Rules(NamedTuple):
    """How the lines of a table are to be read.

    Attributes
    ----------
    header
        Bytes of the header line.
    line
        The form of a line: few values, because every line is read with it.
    columns, scales
        Shape (7,): the column of each target, -1 for none, and its factor.
    """

    header: NDArray[np.uint8]
    line: LineForm
    columns: NDArray[np.int64]
    scales: NDArray[np.float64]


class Destination(NamedTuple):
    """Where the kernels write: samples, shape (n, 3), stamps, shape (n,), and the tally, shape (8,)."""

    acc: NDArray[np.float32]
    gyr: NDArray[np.float32]
    stamps: NDArray[np.int64]
    tally: NDArray[np.int64]


@inner_making_arrays
def take_stamp(
    buffer: NDArray[np.uint8], at_byte: int, form: LineForm, stamps: NDArray[np.int64]
) -> tuple[int, int]:
    """Read the stamp column into ``stamps[0]``; return where it ends and what it is."""
    if form.stamp_kind == CALENDAR_TIME:
        at_byte, stamps[0], kind = take_calendar(buffer, at_byte, form.delimiter_byte)
        return at_byte, kind
    at_byte, mantissa, exponent, kind = take_number(buffer, at_byte, form.delimiter_byte, form.decimal_byte)
    stamps[0] = scale_stamp(mantissa, exponent + form.stamp_exponent)
    return at_byte, kind


@inner_making_arrays
def take_row(
    buffer: NDArray[np.uint8],
    at_byte: int,
    form: LineForm,
    fields: NDArray[np.float64],
    stamps: NDArray[np.int64],
) -> tuple[int, int]:
    """Read one line into ``fields``, shape (7,), and ``stamps[0]``; return its end and its worst field."""
    targets, delimiter, decimal = form.targets, form.delimiter_byte, form.decimal_byte
    worst = NUMBER
    for column in range(len(targets)):
        if column > 0:
            if buffer[at_byte] != delimiter:
                return at_byte, UNREADABLE
            at_byte += 1
        if delimiter == SPACE:
            at_byte = skip_spaces(buffer, at_byte)
        target = targets[column]
        if target > STAMP:
            at_byte, mantissa, exponent, kind = take_number(buffer, at_byte, delimiter, decimal)
            fields[target] = scale_decimal(mantissa, exponent)
            worst = max(worst, kind if abs(fields[target]) < LARGEST_VALUE else UNREADABLE)
        elif target == STAMP:
            at_byte, kind = take_stamp(buffer, at_byte, form, stamps)
            worst = max(worst, kind)
        else:
            at_byte = skip_field(buffer, at_byte, delimiter)
    return close_line(buffer, at_byte, delimiter, worst)


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
def close_line(buffer: NDArray[np.uint8], at_byte: int, delimiter_byte: int, worst: int) -> tuple[int, int]:
    """Go to the line's end; further fields are unreadable unless they are empty."""
    while buffer[at_byte] == delimiter_byte or buffer[at_byte] == SPACE or buffer[at_byte] == RETURN:
        at_byte += 1
    if buffer[at_byte] != NEWLINE:
        worst = UNREADABLE
        while buffer[at_byte] != NEWLINE:
            at_byte += 1
    return at_byte, worst


@inner_making_arrays
def is_blank(buffer: NDArray[np.uint8], at_byte: int, delimiter_byte: int) -> bool:
    """Whether nothing but padding stands on the line."""
    while (
        buffer[at_byte] == SPACE
        or buffer[at_byte] == RETURN
        or buffer[at_byte] == delimiter_byte
        or buffer[at_byte] == QUOTE
    ):
        at_byte += 1
    return buffer[at_byte] == NEWLINE


@inner_making_arrays
def starts_with(buffer: NDArray[np.uint8], at_byte: int, word: NDArray[np.uint8]) -> bool:
    """Whether the line begins with ``word``, which must hold no newline."""
    for k in range(len(word)):
        if buffer[at_byte + k] != word[k]:
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
def next_line(buffer: NDArray[np.uint8], at_byte: int) -> int:
    """First byte after the line's end."""
    while buffer[at_byte] != NEWLINE:
        at_byte += 1
    return at_byte + 1
