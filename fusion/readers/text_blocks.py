"""Many numbers of one column at a time: the same steps for all, so that the compiler puts them side by side.

Most columns keep to one number of decimals. Where it is foreseen, a number of at most eight digits needs no
search for its decimal mark: the decimals and the digits before the mark are each loaded to where they belong
in one word. The words of a block are gathered first, then folded without a branch between; a block that holds
any other form is left to :func:`fusion.readers.text_words.take_plain`.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return, call-arg, operator"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import kernel_making_arrays
from fusion.readers.text_marks import Marks
from fusion.readers.text_words import (
    ALL_BITS,
    BYTE_PLACES,
    LAST_BYTE,
    MINUS_BYTE,
    SHIFT_BITS,
    THREE,
    WORD_DIGITS,
    ZERO_WORD,
    ZEROS,
    find_others,
    fold_digits,
    load_word,
)

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

    ``form``: the decimal mark as of :func:`fusion.readers.text_plain.spread_mark`, the power of ten that the
    decimals stand for, and the factor to be applied.
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
