"""Writing small `.cwa` files byte by byte (Open Movement, cwa.h), independently of the reader."""

import struct
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

START = datetime(2026, 3, 2, 8, 0, 0)  # noqa: DTZ001 (the device's own clock has no zone)
START_US = 1_772_438_400_000_000
"""START, counted from 1970 as if it were UTC."""
SESSION = 77
DEVICE = 12_345
ROWS = 40
AX6, AX3 = 0x64, 0x17
SIX_AXES, THREE_AXES, PACKED = 0x62, 0x32, 0x30
SCALES = 3 << 13 | 2 << 10 | 300
"""2048 counts for 1 g (16 g), 2000 deg/s; a light sensor that reads 300."""
RATE_100, RATE_50 = 0x4A, 0x49
Counts = NDArray[np.int16]


def pack_time(moment: datetime) -> int:
    return (
        (moment.year - 2000) << 26
        | moment.month << 22
        | moment.day << 17
        | moment.hour << 12
        | moment.minute << 6
        | moment.second
    )


def header(hardware: int = AX6, session: int = SESSION, stop: int = 0, device: int = DEVICE) -> bytes:
    """1024 bytes: "MD", what the device is, its plan, and a person's name among the notes."""
    fields = struct.pack("<2sHBHIHII", b"MD", 1020, hardware, device & 0xFFFF, session, device >> 16, 0, stop)
    config = struct.pack("<4xx9xBBIBh", 0x02, RATE_100, 0, 45, -1)
    notes = b"_s=Study&_v=Anne+Person"
    return (fields + config).ljust(64, b"\xff") + notes.ljust(448, b" ") + b"\xff" * 512


def still_rows(n_rows: int, number: int = 0) -> Counts:
    """Gyroscope and accelerometer in counts, shape (n, 6): 1 g on z within two counts, a rate that numbers
    the block; the others tremble by a count."""
    k = np.arange(n_rows)
    table = np.zeros((n_rows, 6), np.int16)
    table[:, 0] = number % 1000 + 1
    table[:, 1], table[:, 2], table[:, 3], table[:, 4] = k % 2, k // 2 % 2, k % 2, k // 2 % 2
    table[:, 5] = 2048 + k % 3
    return table


def stamp_fields(start_us: int, rate_hz: float) -> tuple[int, int, int]:
    """Packed whole seconds, fraction with its mark, and offset, of a block that begins at ``start_us``.

    The device says the time of the row that comes next, and moves the row back by as many as the fraction
    is worth at the nominal rate.
    """
    second, rest_us = divmod(start_us, 1_000_000)
    fraction = rest_us * 32_768 // 1_000_000
    moment = datetime.fromtimestamp(second, UTC)
    return pack_time(moment), 0x8000 | fraction, -((2 * fraction * int(rate_hz)) >> 16)


def seal(block: bytes) -> bytes:
    """Put the word at the end that makes all words add up to zero."""
    total = sum(struct.unpack("<255H", block[:510]))
    return block[:510] + struct.pack("<H", -total & 0xFFFF)


def block(
    sequence: int,
    start_us: int,
    counts: Counts | None = None,
    *,
    session: int = SESSION,
    scales: int = SCALES,
    rate: int = RATE_100,
    axes: int = SIX_AXES,
    stamp: tuple[int, int, int] | None = None,
    count: int | None = None,
) -> bytes:
    """512 bytes whose first row is at ``start_us``."""
    rows = still_rows(ROWS, sequence) if counts is None else counts
    packed, fraction, offset = stamp or stamp_fields(start_us, 3200 / 2 ** (15 - (rate & 15)))
    told = len(rows) if count is None else count
    head = struct.pack(
        "<2sHHIIIHHBBBBhH", b"AX", 508, fraction, session, sequence, packed, scales, 200, 0, 200, rate, axes,
        offset, told,
    )  # fmt: skip
    return seal((head + rows.astype("<i2").tobytes()).ljust(512, b"\0"))


def blocks(numbers: Sequence[int], period_us: float = 10_000.0, **fields: int) -> list[bytes]:
    """Blocks of 40 rows whose numbers say when they were taken."""
    return [
        block(number, START_US + round(number * ROWS * period_us), **fields)  # type: ignore[arg-type]
        for number in numbers
    ]


def log_of(numbers: Sequence[int], **fields: int) -> bytes:
    """A file of these blocks."""
    return header() + b"".join(blocks(numbers, **fields))
