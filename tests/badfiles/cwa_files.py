"""Bad `.cwa` files of an Axivity AX6."""

from collections.abc import Callable
from functools import cache

import numpy as np

from tests.badfiles.arm import minute
from tests.fusion.readers.cwa.cwa_builder import (
    RATE_50,
    ROWS,
    SESSION,
    START_US,
    Counts,
    block,
    header,
)

COUNTS_PER_G, COUNTS_PER_DPS = 2048.0, 32_768 / 2000
BLOCK_US = 400_000
NUMBERS = range(150)
YEAR_2000_US = 946_684_800_000_000
YEAR_US = 366 * 86_400_000_000


@cache
def counts() -> Counts:
    """The minute of an arm, gyroscope first, shape (6000, 6)."""
    acc_g, gyr_dps = minute()
    table = np.concatenate([gyr_dps * COUNTS_PER_DPS, acc_g * COUNTS_PER_G], axis=1)
    counted: Counts = np.clip(np.rint(table), -32_768, 32_767).astype(np.int16)
    return counted


def part(
    number: int,
    at_us: int | None = None,
    session: int = SESSION,
    stamp: tuple[int, int, int] | None = None,
) -> bytes:
    """Return one block of the minute, at its own time or another."""
    rows = counts()[ROWS * (number % 150) : ROWS * (number % 150 + 1)]
    start_us = START_US + BLOCK_US * number if at_us is None else at_us
    return block(number, start_us, rows, session=session, stamp=stamp)


@cache
def parts() -> tuple[bytes, ...]:
    return tuple(part(number) for number in NUMBERS)


def joined(*blocks: bytes) -> bytes:
    return header() + b"".join(blocks)


def whole() -> bytes:
    return joined(*parts())


def replaced(numbers: range, instead: Callable[[bytes], bytes]) -> Callable[[], bytes]:
    """Some blocks changed; those of the arm held still."""
    return lambda: joined(*(instead(one) if k in numbers else one for k, one in enumerate(parts())))


def spoil(one: bytes) -> bytes:
    return one[:100] + bytes([one[100] ^ 0xFF]) + one[101:]


def plain(hardware: int, axes: int) -> Callable[[], bytes]:
    """Acceleration alone."""
    rows = np.zeros((ROWS, 6), np.int16)
    return lambda: (
        header(hardware) + b"".join(block(k, START_US + BLOCK_US * k, rows, axes=axes) for k in NUMBERS)
    )


def other_session() -> bytes:
    """Twenty blocks of the week before are left behind the recording."""
    old = (part(k, START_US - 7 * 86_400_000_000 + BLOCK_US * k, session=SESSION - 1) for k in range(20))
    return joined(*parts(), *old)


def started_again() -> bytes:
    """From the middle on the numbers begin anew, after thirty seconds."""
    again = (
        block(k, START_US + 60_000_000 + BLOCK_US * k, counts()[ROWS * (75 + k) : ROWS * (76 + k)])
        for k in range(75)
    )
    return joined(*parts()[:75], *again)


def moved(numbers: range, shift_us: int) -> Callable[[], bytes]:
    """Some blocks bear another time."""
    return lambda: joined(
        *(part(k, START_US + BLOCK_US * k + shift_us) if k in numbers else parts()[k] for k in NUMBERS)
    )


def half_the_rate() -> bytes:
    """From the middle on every second sample, at 50 Hz."""
    rows = counts()[3000::2]
    later = (
        block(75 + k, START_US + 30_000_000 + 800_000 * k, rows[ROWS * k : ROWS * (k + 1)], rate=RATE_50)
        for k in range(38)
    )
    return joined(*parts()[:75], *later)
