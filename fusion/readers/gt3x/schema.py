"""SENSOR_SCHEMA: how a row of SENSOR_DATA is laid out, and how it is turned into g and deg/s.

Source: actigraph/GT3X-File-Format, sample code of SensorSchema; checked against ActiLife's own export.
"""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import njit

COLUMN_BYTES = 23
HEADER_BYTES = 6
PLAUSIBLE_DIVISORS = (1e-3, 1e9)
BIG_ENDIAN_FLAG = 1
SIGNED_FLAG = 2
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
def take_word(buffer: NDArray[np.uint8], byte: int, size_bytes: int, big_endian: bool) -> int:  # noqa: FBT001
    """Return an unsigned integer of whole bytes."""
    value = 0
    for k in range(size_bytes):
        position = k if big_endian else size_bytes - 1 - k
        value = (value << 8) | buffer[byte + position]
    return value


@njit(cache=True, nogil=True)
def take_field(buffer: NDArray[np.uint8], byte: int, field: NDArray[np.int64]) -> int:
    """Return one raw value. ``field``: big-endian, signed, bit offset, bit size.

    A field that fills whole bytes is read in its byte order; any other is read most significant bit first.
    """
    first_bit, bits = field[2], field[3]
    if first_bit % 8 == 0 and bits % 8 == 0:
        value = take_word(buffer, byte + first_bit // 8, bits // 8, field[0] == 1)
    else:
        value = 0
        for k in range(bits):
            bit = first_bit + k
            value = (value << 1) | ((buffer[byte + bit // 8] >> (7 - bit % 8)) & 1)
    if field[1] == 1 and value >> (bits - 1):
        value -= 1 << bits
    return value


@njit(cache=True, nogil=True)
def decode_rows(
    buffer: NDArray[np.uint8],
    byte: int,
    layout: tuple[int, NDArray[np.int64], NDArray[np.float64]],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
) -> None:
    """Decode ``len(acc)`` rows of any schema. ``layout``: bytes of a row, fields, divisors."""
    row_bytes, fields, divisors = layout
    for row in range(len(acc)):
        for axis in range(3):
            acc[row, axis] = take_field(buffer, byte, fields[axis]) / divisors[axis]
            gyr[row, axis] = take_field(buffer, byte, fields[3 + axis]) / divisors[3 + axis]
        byte += row_bytes


@njit(cache=True, nogil=True)
def decode_link_rows(
    buffer: NDArray[np.uint8],
    byte: int,
    divisors: NDArray[np.float64],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
) -> None:
    """Decode ``len(acc)`` rows of the GT9X Link's own 21-byte layout: big-endian int16 at 0 and at 8."""
    for row in range(len(acc)):
        for axis in range(3):
            at = byte + 2 * axis
            acc[row, axis] = np.int16((buffer[at] << 8) | buffer[at + 1]) / divisors[axis]
            gyr[row, axis] = np.int16((buffer[at + 8] << 8) | buffer[at + 9]) / divisors[3 + axis]
        byte += 21


@njit(cache=True, nogil=True)
def decode_records(
    buffer: NDArray[np.uint8],
    records: tuple[NDArray[np.int64], NDArray[np.int64]],
    layout: tuple[int, NDArray[np.int64], NDArray[np.float64]],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
) -> None:
    """Decode records of any schema one after the other. ``records``: first byte, number of rows of each."""
    firsts, n_rows = records
    row = 0
    for k in range(len(firsts)):
        stop = row + n_rows[k]
        decode_rows(buffer, firsts[k], layout, acc[row:stop], gyr[row:stop])
        row = stop


@njit(cache=True, nogil=True)
def decode_link_records(
    buffer: NDArray[np.uint8],
    records: tuple[NDArray[np.int64], NDArray[np.int64]],
    divisors: NDArray[np.float64],
    acc: NDArray[np.float32],
    gyr: NDArray[np.float32],
) -> None:
    """The same for the GT9X Link's own layout."""
    firsts, n_rows = records
    row = 0
    for k in range(len(firsts)):
        stop = row + n_rows[k]
        decode_link_rows(buffer, firsts[k], divisors, acc[row:stop], gyr[row:stop])
        row = stop


@dataclass(frozen=True, slots=True, eq=False)
class RowDecoder:
    """A schema made ready for the kernels."""

    schema: SensorSchema
    fields: NDArray[np.int64]
    divisors: NDArray[np.float64]
    is_link_layout: bool

    def find_own(self, buffer: NDArray[np.uint8], firsts: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Mark the payloads, of two bytes or more, that begin with the number of this schema."""
        return np.asarray(buffer[firsts] + 256 * buffer[firsts + 1].astype(np.int64) == self.schema.schema_id)

    def decode(
        self,
        buffer: NDArray[np.uint8],
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
    is_link_layout = schema.row_bytes == 21 and bool(np.array_equal(fields, LINK_FIELDS))
    return RowDecoder(schema, fields, divisors, is_link_layout)
