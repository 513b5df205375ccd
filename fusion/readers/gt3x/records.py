"""The records of log.bin, found by their checksums also where the file is damaged, and their contents.

Framing (actigraph/GT3X-File-Format, README): 0x1E, type, uint32 LE Unix seconds, uint16 LE payload size n,
n bytes, checksum = complement of the XOR of all bytes before it. Zeros between records are legal.
"""
# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import njit

Bytes = NDArray[np.uint8]

SEPARATOR = 0x1E
FRAME_BYTES = 9
LONGEST_RECORD_BYTES = FRAME_BYTES + 65_535

(
    GOOD,
    BAD_CHECKSUMS,
    RESYNCS,
    LOST_BYTES,
    DAMAGED_BYTES,
    IS_LOST,
    HUNTED_BYTES,
    LAST_S,
    DAMAGE_S,
    LAST_DAMAGE_S,
) = range(10)
"""Places in the tally: records that verify; framed ones that do not; times the framing was lost; bytes
hunted over; bytes of framed records that do not verify; whether the scan is hunting now, and for how long;
the stamp of the last good record, and of the last one before the first and before the last damage."""
TALLY_PLACES = 10


@njit(cache=True, nogil=True)
def fold_prefixes(buffer: Bytes) -> Bytes:
    """XOR of the bytes before each place, so that any stretch is then folded in one step."""
    prefixes = np.empty(len(buffer) + 1, np.uint8)
    prefixes[0] = 0
    for k in range(len(buffer)):
        prefixes[k + 1] = prefixes[k] ^ buffer[k]
    return prefixes


@njit(cache=True, nogil=True)
def frame_end(buffer: Bytes, at_byte: int) -> int:
    """First byte after the record that would begin at ``at_byte``; -1 where its header is cut off."""
    if at_byte + FRAME_BYTES > len(buffer):
        return -1
    return at_byte + FRAME_BYTES + (buffer[at_byte + 6] | (buffer[at_byte + 7] << 8))


@njit(cache=True, nogil=True)
def verify(
    buffer: Bytes,
    at_byte: int,
    end_byte: int,
    prefixes: Bytes,
    is_hunting: bool,  # noqa: FBT001 (numba kernels take their arguments by place)
) -> bool:
    """Whether a whole record with a true checksum lies at ``at_byte``.

    One checksum byte alone is weak proof: while hunting, what follows must be able to follow a record.
    """
    if end_byte < 0 or end_byte > len(buffer) or buffer[at_byte] != SEPARATOR:
        return False
    folded = np.uint8(0)
    if len(prefixes) > 1:
        folded = prefixes[end_byte - 1] ^ prefixes[at_byte]
    else:
        for k in range(at_byte, end_byte - 1):
            folded ^= buffer[k]
    if (folded ^ 0xFF) != buffer[end_byte - 1]:
        return False
    follows = end_byte == len(buffer) or buffer[end_byte] == SEPARATOR or buffer[end_byte] == 0
    return follows or not is_hunting


@njit(cache=True, nogil=True)
def scan_records(
    buffer: Bytes,
    is_last: bool,  # noqa: FBT001 (numba kernels take their arguments by place)
    records: NDArray[np.int64],
    tally: NDArray[np.int64],
) -> tuple[int, int]:
    """Find the records of a piece of log.bin; return (bytes used, records found).

    Of each its type, time, first payload byte and payload size are written. A record that may go on in the
    next piece is left for it. Linear in the bytes: in sync each byte is folded once, and from the first
    damage on checksums come from prefixes.
    """
    prefixes = np.empty(1, np.uint8)
    at = 0
    found = 0
    while at < len(buffer):
        if buffer[at] == 0 and tally[IS_LOST] == 0:
            at += 1
            continue
        end = frame_end(buffer, at)
        if verify(buffer, at, end, prefixes, tally[IS_LOST] == 1):
            tally[LAST_S] = (
                buffer[at + 2]
                | (buffer[at + 3] << 8)
                | (buffer[at + 4] << 16)
                | (np.int64(buffer[at + 5]) << 24)
            )
            records[found, 0], records[found, 1] = buffer[at + 1], tally[LAST_S]
            records[found, 2], records[found, 3] = at + 8, end - at - FRAME_BYTES
            found += 1
            tally[GOOD] += 1
            tally[IS_LOST] = tally[HUNTED_BYTES] = 0
            at = end
            continue
        if not is_last and at + 2 * LONGEST_RECORD_BYTES > len(buffer):
            break
        if len(prefixes) == 1:
            prefixes = fold_prefixes(buffer)
        at = pass_damage(buffer, at, end, prefixes, tally)
    return at, found


@njit(cache=True, nogil=True)
def pass_damage(
    buffer: Bytes,
    at_byte: int,
    end_byte: int,
    prefixes: Bytes,
    tally: NDArray[np.int64],
) -> int:
    """Step over bytes that are no good record; return where to go on.

    Where the damaged record's own size leads to the next good record, its framing is trusted and only its
    content is lost. Else the framing is lost and the next separator whose checksum verifies is hunted.
    """
    if tally[RESYNCS] + tally[BAD_CHECKSUMS] == 0:
        tally[DAMAGE_S] = tally[LAST_S]
    tally[LAST_DAMAGE_S] = tally[LAST_S]
    if tally[IS_LOST] == 0 and buffer[at_byte] == SEPARATOR and 0 < end_byte <= len(buffer):
        next_end = frame_end(buffer, end_byte)
        is_framed = end_byte == len(buffer) or verify(buffer, end_byte, next_end, prefixes, is_hunting=True)
        if is_framed:
            tally[BAD_CHECKSUMS] += 1
            tally[DAMAGED_BYTES] += end_byte - at_byte
            return end_byte
    if tally[IS_LOST] == 0:
        tally[IS_LOST] = 1
        tally[RESYNCS] += 1
    tally[LOST_BYTES] += 1
    tally[HUNTED_BYTES] += 1
    return at_byte + 1


@dataclass(frozen=True, slots=True)
class ScanTally:
    """What a scan met, in counts and bytes. ``tail_bytes``: a last record that was cut off."""

    records: int
    bad_checksums: int
    resyncs: int
    damaged_bytes: int
    tail_bytes: int
    last_unix_s: int
    first_damage_unix_s: int
    last_damage_unix_s: int


def summarise_tally(tally: NDArray[np.int64]) -> ScanTally:
    """Separate a record cut off at the end of the file (a pulled battery) from damage inside it."""
    is_tail = tally[IS_LOST] == 1 and tally[HUNTED_BYTES] < LONGEST_RECORD_BYTES
    tail_bytes = int(tally[HUNTED_BYTES]) if is_tail else 0
    return ScanTally(
        records=int(tally[GOOD]),
        bad_checksums=int(tally[BAD_CHECKSUMS]),
        resyncs=int(tally[RESYNCS]) - int(is_tail),
        damaged_bytes=int(tally[DAMAGED_BYTES] + tally[LOST_BYTES]) - tail_bytes,
        tail_bytes=tail_bytes,
        last_unix_s=int(tally[LAST_S]),
        first_damage_unix_s=int(tally[DAMAGE_S]),
        last_damage_unix_s=int(tally[LAST_DAMAGE_S]),
    )


# SENSOR_SCHEMA: how a row of SENSOR_DATA is laid out, and how it is turned into g and deg/s.
#
# Source: actigraph/GT3X-File-Format, sample code of SensorSchema; checked against ActiLife's own export.

COLUMN_BYTES = 23
HEADER_BYTES = 6
PLAUSIBLE_DIVISORS = (1e-3, 1e9)
BIG_ENDIAN_FLAG, SIGNED_FLAG = 1, 2
LINK_ROW_BYTES = 21
CHANNELS = (
    "accelerometer x",
    "accelerometer y",
    "accelerometer z",
    "gyroscope x",
    "gyroscope y",
    "gyroscope z",
)


@dataclass(frozen=True, slots=True)
class SchemaColumn:
    """One field of a row. ``divisor`` is the file's scale: value = raw / divisor."""

    label: str
    is_big_endian: bool
    is_signed: bool
    bit_offset: int
    bit_size: int
    divisor: float


@dataclass(frozen=True, slots=True)
class SensorSchema:
    """The columns of one schema id; ``row_bytes`` covers padding too."""

    schema_id: int
    columns: tuple[SchemaColumn, ...]
    row_bytes: int

    def channels(self) -> tuple[SchemaColumn, ...] | None:
        """Acceleration x, y, z and angular rate x, y, z; None where one is absent or cannot be scaled."""
        by_label = {column.label.lower(): column for column in self.columns}
        found = tuple(by_label[label] for label in CHANNELS if label in by_label)
        low, high = PLAUSIBLE_DIVISORS
        usable = len(found) == 6 and all(low < c.divisor < high and 0 < c.bit_size <= 32 for c in found)
        return found if usable else None


def decode_ssp_float(value: int) -> float:
    """ActiGraph's 32-bit float: signed 8-bit exponent, signed 24-bit mantissa, value = m / 2^23 * 2^e."""
    exponent = (value >> 24) - 256 if value >> 31 else value >> 24
    mantissa = value & 0xFFFFFF
    if mantissa >= 1 << 23:
        mantissa -= 1 << 24
    return float(np.ldexp(mantissa, exponent - 23))


def parse_schema(payload: bytes) -> SensorSchema | None:
    """Decode a SENSOR_SCHEMA payload; None where it contradicts itself."""
    if len(payload) < HEADER_BYTES:
        return None
    schema_id, n_columns, _ = struct.unpack_from("<3H", payload)
    if n_columns == 0 or len(payload) < HEADER_BYTES + n_columns * COLUMN_BYTES:
        return None
    columns = tuple(_parse_column(payload[HEADER_BYTES + k * COLUMN_BYTES :]) for k in range(n_columns))
    row_bits = max(column.bit_offset + column.bit_size for column in columns)
    return SensorSchema(schema_id, columns, (row_bits + 7) // 8) if row_bits else None


def _parse_column(content: bytes) -> SchemaColumn:
    flags, bit_offset, bit_size, scale = struct.unpack_from("<3BI", content)
    label = content[7:COLUMN_BYTES].split(b"\0")[0].decode("latin-1").strip()
    return SchemaColumn(
        label,
        bool(flags & BIG_ENDIAN_FLAG),
        bool(flags & SIGNED_FLAG),
        bit_offset,
        bit_size,
        decode_ssp_float(scale),
    )


@njit(cache=True, nogil=True)
def take_field(buffer: Bytes, byte: int, field: NDArray[np.int64]) -> int:
    """Return one raw value. ``field``: big-endian, signed, bit offset, bit size.

    A field that fills whole bytes is read in its byte order; any other is read most significant bit first.
    """
    first_bit, bits = field[2], field[3]
    value = 0
    if first_bit % 8 == 0 and bits % 8 == 0:
        first, last = byte + first_bit // 8, byte + (first_bit + bits) // 8 - 1
        for k in range(last - first + 1):
            value = (value << 8) | buffer[first + k if field[0] == 1 else last - k]
    else:
        for k in range(bits):
            bit = first_bit + k
            value = (value << 1) | ((buffer[byte + bit // 8] >> (7 - bit % 8)) & 1)
    if field[1] == 1 and value >> (bits - 1):
        value -= 1 << bits
    return value


@njit(cache=True, nogil=True)
def decode_records(
    buffer: Bytes,
    records: tuple[NDArray[np.int64], NDArray[np.int64]],
    layout: tuple[int, NDArray[np.int64], NDArray[np.float64]],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
) -> None:
    """Decode records of any schema one after the other.

    ``records``: first byte, number of rows of each; ``layout``: bytes of a row, fields, divisors.
    """
    firsts, n_rows = records
    row_bytes, fields, divisors = layout
    row = 0
    for record in range(len(firsts)):
        for k in range(n_rows[record]):
            byte = firsts[record] + k * row_bytes
            for axis in range(3):
                acc[row, axis] = take_field(buffer, byte, fields[axis]) / divisors[axis]
                gyr[row, axis] = take_field(buffer, byte, fields[3 + axis]) / divisors[3 + axis]
            row += 1


@njit(cache=True, nogil=True)
def decode_link_records(
    buffer: Bytes,
    records: tuple[NDArray[np.int64], NDArray[np.int64]],
    divisors: NDArray[np.float64],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
) -> None:
    """The same for the GT9X Link's own 21-byte layout: big-endian int16 at 0 and at 8."""
    firsts, n_rows = records
    row = 0
    for record in range(len(firsts)):
        for k in range(n_rows[record]):
            byte = firsts[record] + k * LINK_ROW_BYTES
            for axis in range(3):
                at = byte + 2 * axis
                acc[row, axis] = np.int16((buffer[at] << 8) | buffer[at + 1]) / divisors[axis]
                gyr[row, axis] = np.int16((buffer[at + 8] << 8) | buffer[at + 9]) / divisors[3 + axis]
            row += 1


@dataclass(frozen=True, slots=True, eq=False)
class RowDecoder:
    """A schema made ready for the kernels."""

    schema: SensorSchema
    fields: NDArray[np.int64]
    divisors: NDArray[np.float64]
    is_link_layout: bool

    def find_own(self, buffer: Bytes, firsts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Mark the payloads, of two bytes or more, that begin with the number of this schema."""
        return np.asarray(buffer[firsts] + 256 * buffer[firsts + 1].astype(np.int64) == self.schema.schema_id)

    def decode(
        self,
        buffer: Bytes,
        firsts: NDArray[np.int64],
        n_rows: NDArray[np.int64],
        samples: tuple[NDArray[np.float32], NDArray[np.float32]],
    ) -> None:
        """Decode records one after the other: ``n_rows[k]`` rows that begin at ``firsts[k]``.

        ``samples``: acceleration and angular rate, with room for all rows.
        """
        if self.is_link_layout:
            decode_link_records(buffer, (firsts, n_rows), self.divisors, *samples)
        else:
            layout = (self.schema.row_bytes, self.fields, self.divisors)
            decode_records(buffer, (firsts, n_rows), layout, *samples)


LINK_FIELDS = np.array([[1, 1, offset, 16] for offset in (0, 16, 32, 64, 80, 96)], np.int64)


def make_decoder(schema: SensorSchema) -> RowDecoder | None:
    """Prepare a schema; None where it has no usable acceleration and angular rate."""
    channels = schema.channels()
    if channels is None:
        return None
    fields = np.array([[c.is_big_endian, c.is_signed, c.bit_offset, c.bit_size] for c in channels], np.int64)
    divisors = np.array([c.divisor for c in channels], np.float64)
    is_link_layout = schema.row_bytes == LINK_ROW_BYTES and bool(np.array_equal(fields, LINK_FIELDS))
    return RowDecoder(schema, fields, divisors, is_link_layout)


# The device's events besides sampling: idle sleep, the USB dock, how its clock counts.

ACTIVITY, BATTERY, EVENT, METADATA, SCHEMA, SENSOR_DATA, ACTIVITY2 = 0, 2, 3, 6, 24, 25, 26
SLEEP_ENTER, SLEEP_LEAVE = 0x08, 0x09
ZONE_NAME = re.compile(rb'"Name" ?: ?"(\(UTC[^"]{1,80})"')
MAX_EVENTS = 200_000
"""More than any shift can hold; further ones are counted only."""


@dataclass(slots=True)
class DeviceEvents:
    """Gathered while the log is read. ``sleep``: (Unix seconds, entering); ``battery_mv``: the last."""

    sleep: list[tuple[int, bool]] = field(default_factory=list)
    docked_s: list[int] = field(default_factory=list)
    counts_utc: bool = False
    zone_name: str = ""
    battery_mv: int = 0
    ignored: int = 0

    def note(self, kind: int, unix_s: int, payload: bytes) -> None:
        """Take one record that is neither samples nor schema."""
        if len(self.sleep) + len(self.docked_s) >= MAX_EVENTS:
            self.ignored += 1
        elif kind == EVENT and payload[:1] in (bytes([SLEEP_ENTER]), bytes([SLEEP_LEAVE])):
            self.sleep.append((unix_s, payload[0] == SLEEP_ENTER))
        elif kind in (ACTIVITY, ACTIVITY2) and len(payload) == 1:
            self.docked_s.append(unix_s)
        elif kind == METADATA:
            self._note_clock(payload.replace(b"\\", b""))
        elif kind == BATTERY and len(payload) == 2:
            self.battery_mv = int.from_bytes(payload, "little")

    def _note_clock(self, text: bytes) -> None:
        self.counts_utc = self.counts_utc or b'"UsedUtc":true' in text.replace(b" ", b"")
        found = ZONE_NAME.search(text)
        if found:
            self.zone_name = found.group(1).decode("latin-1")


def pair_sleep(sleep: Iterable[tuple[int, bool]], last_unix_s: int) -> list[tuple[int, int]]:
    """Idle sleep as (from, to) in Unix seconds; one that never ends lasts to the last stamp of the file.

    Leaving without having entered is ignored.
    """
    spans: list[tuple[int, int]] = []
    entered: int | None = None
    for unix_s, is_entering in sleep:
        if is_entering and entered is None:
            entered = unix_s
        elif not is_entering and entered is not None:
            spans.append((entered, unix_s))
            entered = None
    if entered is not None:
        spans.append((entered, last_unix_s))
    return [(start, end) for start, end in spans if end > start]
