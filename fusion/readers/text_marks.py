"""Where fields and lines end, 64 bytes at a time."""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return, call-arg, misc"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.numba_kernels import inner_making_arrays
from fusion.readers.text_words import (
    NEWLINE,
    ONE,
    RETURN,
    SHIFT_BITS,
    ZERO_WORD,
    count_bits,
    lowest_bit,
    match_byte,
)

Marks = NDArray[np.int32]
"""Places in the buffer, or in another array of places."""
WORD_BYTES = 64
EIGHT_MARKS = 8
SPARE_MARKS = 16
"""Room that must be left behind the last mark."""


@njit(cache=True, nogil=True, forceinline=True)
def write_marks(marks: Marks, found: int, base: int, word: int) -> None:
    """Write the places of the bits that are set, eight at a time: what is too much is written over later."""
    at = np.uintp(found)
    while word != ZERO_WORD:
        for k in range(EIGHT_MARKS):
            marks[at + np.uintp(k)] = base + np.int64(lowest_bit(word))
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
    buffer: NDArray[np.uint8], span: tuple[int, int], delimiter: int, marks: Marks, ends: Marks
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
        word = newlines | (match_byte(buffer, base, delimiter) & kept)
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
