"""Eight bytes of text at a time: machine words behind :mod:`fusion.readers.tables.fast_path`.

A field of decimal digits is loaded as two words, its decimal mark is taken out by shifting, all digits are
checked at once and then folded pairwise into an integer (the method of D. Lemire, "Quickly parsing eight
digits", 2018). Numba has no unaligned loads and no byte compare over 64 bytes: the intrinsics below add them.
They do not check bounds: see ``LEAD_BYTES`` and ``TRAIL_BYTES``.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return, misc, untyped-decorator"
# mypy: disable-error-code="call-arg, var-annotated, call-overload, import-untyped, operator"
# (numba infers the machine types of these functions; numpy's scalars are not Python's int to mypy)

import sys
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from fusion.numba_kernels import njit

LEAD_BYTES, TRAIL_BYTES = 16, 64
"""Bytes of the buffer that must lie before the first line and after the last one."""
NEWLINE, RETURN, MINUS = 10, 13, 45
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
LAST_BYTE, MINUS_BYTE, SHIFT_BITS = np.uint64(255), np.uint64(MINUS), np.uint64(63)
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
    """Return eight bytes as they lie in the text: the first is the least significant."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        word = _load(context, builder, signature, arguments, ir.IntType(64))
        return word if sys.byteorder == "little" else builder.bswap(word)

    return types.uint64(buffer, types.intp), generate


@intrinsic
def match_byte(typing_context, buffer, at, byte):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Return 64 bits, one for each of 64 bytes: set where it is ``byte``."""

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
    """Return the place of the lowest bit that is set; 64 where none is."""

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
def fold_digits(word: int) -> int:
    """Eight bytes of 0 to 9, the most significant first in the text, as one integer."""
    pairs = word * TEN + (word >> EIGHT)
    even, odd = pairs & PAIRS, (pairs >> SIXTEEN) & PAIRS
    return np.int64((even * FOLD_ODD + odd * FOLD_EVEN) >> THIRTY_TWO)


@njit(cache=True, nogil=True, forceinline=True)
def find_dot(word: int, dots: int) -> int:
    """Eight times the place of the decimal mark among the eight bytes; 64 for none.

    The classic test for a zero byte: only bytes above the first one can be wrongly reported.
    """
    apart = word ^ dots
    dot = (apart - EVERY_BYTE) & ~apart & TOP_BITS
    return WORD_BITS if dot == ZERO_WORD else lowest_bit(dot) & BYTE_PLACES


@njit(cache=True, nogil=True, forceinline=True)
def close_gap(word: int, place_bits: int, filling: int) -> int:
    """Take the byte at ``place_bits`` out: what is before it moves up, ``filling`` comes in behind."""
    below = (ONE << place_bits) - ONE
    return (word & (~below << EIGHT)) | ((word & below) << EIGHT) | filling


@njit(cache=True, nogil=True, forceinline=True)
def find_others(word: int) -> int:
    """A bit for each byte that is none of 0 to 9; 0 where all are."""
    return (((word & LOW_BITS) + ABOVE_NINE) | word) & TOP_BITS


@njit(cache=True, nogil=True, forceinline=True)
def take_plain(buffer: NDArray[np.uint8], first_byte: int, stop_byte: int, dots: int) -> tuple[int, int]:
    """Read `-12.345` between two marks: mantissa and decimals; decimals ``NOT_PLAIN`` for any other form.

    ``dots``: the decimal mark XOR `0`, in each of the eight bytes. At most 16 characters after the sign, so
    that with a decimal mark the mantissa has no more than 15 digits, which a double holds exactly.
    """
    is_negative = buffer[first_byte] == MINUS
    length = stop_byte - first_byte - np.int64(is_negative)
    if length < 1 or length > LONGEST_FIELD:
        return np.int64(0), NOT_PLAIN
    late = (load_word(buffer, stop_byte - 8) ^ ZEROS) & KEPT_BYTES[min(length, 8)]
    early = (load_word(buffer, stop_byte - 16) ^ ZEROS) & KEPT_BYTES[max(length - 8, 0)]
    decimals = np.int64(0)
    place = find_dot(late, dots)
    if place != WORD_BITS:
        late = close_gap(late, place, early >> BYTE_PLACES)
        early <<= EIGHT
        decimals = np.int64(7) - np.int64(place >> THREE)
        length -= 1
    elif length > WORD_DIGITS:
        place = find_dot(early, dots)
        if place != WORD_BITS:
            early = close_gap(early, place, ZERO_WORD)
            decimals = np.int64(15) - np.int64(place >> THREE)
            length -= 1
    if length < 1 or (find_others(late) | find_others(early)) != ZERO_WORD:
        return np.int64(0), NOT_PLAIN
    mantissa = fold_digits(early) * TEN_TO_EIGHT + fold_digits(late)
    return -mantissa if is_negative else mantissa, decimals
