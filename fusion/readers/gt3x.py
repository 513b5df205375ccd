"""ActiGraph GT9X Link `.gt3x` with IMU records.

Sources: actigraph/GT3X-File-Format (records, schema); the time rule was measured against ActiLife 6.13.3.
Compared to ActiLife: all n rows of a second are kept, at T + k/n, on one even grid over unbroken
seconds; ActiLife resamples every second to exactly 100 rows. Nothing is filled where records are missing.

The records come first, then the order of their seconds; :func:`read` follows.
"""

import re
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta, timezone
from functools import partial
from itertools import pairwise
from typing import Any
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import ShiftWindow, format_offset, parse_offset_s
from acromion.fusion.errors import (
    DamagedFile,
    MissingMember,
    NoGyroscope,
    NoSamples,
    UnknownColumns,
    UnusableShift,
)
from acromion.fusion.numba_kernels import njit
from acromion.fusion.readers.samples import SampleColumns
from acromion.fusion.readers.source import (
    EARLY_END_S,
    EMPTY_ZIP_MAGIC,
    MAX_DAMAGED_PERCENT,
    ZIP_MAGIC,
    Source,
    check_parts,
    open_archive,
    read_member,
    read_text,
    scan_pieces,
)
from acromion.fusion.readers.time.clock import (
    find_zone,
    flag_drift,
    flag_zone_changes,
    hash_serial,
    trust_clock,
)
from acromion.fusion.readers.time.grid import LONGEST_GAP_US
from acromion.fusion.recording import (
    MICROSECONDS,
    Extent,
    QualityFlag,
    Recording,
    Segment,
    Span,
    Stated,
    find_covered,
    find_uncovered,
    flag_counts,
    flag_gaps,
    flag_spans,
    join_overlapping,
)
from acromion.fusion.still_limits import BOTH_ACCELEROMETERS

# The records of log.bin, found by their checksums even in a damaged file, and their contents.
#
# Framing (actigraph/GT3X-File-Format, README): 0x1E, type, uint32 LE Unix seconds, uint16 LE payload size n,
# n bytes, checksum = complement of the XOR of all bytes before it. Zeros between records are legal.

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
"""Places in the tally: records that verify; framed records that do not; times the framing was lost; bytes
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
    return at_byte + FRAME_BYTES + (buffer[at_byte + 6] | (buffer[at_byte + 7] << 8))  # type: ignore[no-any-return]


@njit(cache=True, nogil=True)
def verify(
    buffer: Bytes,
    at_byte: int,
    end_byte: int,
    prefixes: Bytes,
    is_hunting: bool,  # noqa: FBT001 (numba kernels take their arguments by place)
) -> bool:
    """Whether a whole record with a correct checksum starts at ``at_byte``.

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
    """Step over bytes that are not a valid record; return the next place to read.

    If the damaged record's size leads to the next good record, only its content is lost. Otherwise the search
    continues at the next separator with a valid checksum.
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
    """The result of a scan, in counts and bytes. ``tail_bytes``: a last record that was cut off."""

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
        """Acceleration x, y, z and angular rate x, y, z; None if one is absent or cannot be scaled."""
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
    """Decode a SENSOR_SCHEMA payload; None if it contradicts itself."""
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
    """Prepare a schema; None if it has no usable acceleration and angular rate."""
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
"""More than any shift can hold; further ones are ignored."""


@dataclass(slots=True)
class DeviceEvents:
    """Gathered while the log is read. ``sleep``: (Unix seconds, entering); ``battery_mv``: the last."""

    sleep: list[tuple[int, bool]] = field(default_factory=list)
    docked_s: list[int] = field(default_factory=list)
    counts_utc: bool = False
    zone_name: str = ""
    battery_mv: int = 0

    def note(self, kind: int, unix_s: int, payload: bytes) -> None:
        """Take one record that is neither samples nor schema."""
        if len(self.sleep) + len(self.docked_s) >= MAX_EVENTS:
            return
        if kind == EVENT and payload[:1] in (bytes([SLEEP_ENTER]), bytes([SLEEP_LEAVE])):
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
    """Idle sleep as (from, to) in Unix seconds; a sleep that never ends lasts to the last stamp of the file.

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


# The seconds of a file in order, with runs, gaps, doubles and a clock that was set.
#
# Each SENSOR_DATA record carries one second of the device's clock and the rows of that second. The order of
# the file is the order of time; the stamps give the time missing between two records, and may be wrong.

LONGEST_GAP_S = LONGEST_GAP_US // MICROSECONDS
"""A longer step forward is a clock that was set, not a gap: it adds no time."""
LONGEST_ASIDE_S = 86_400
"""An event so far before the first sample or after the last one is ignored."""
LONGEST_ALONE_S = 60
"""A single first or last second, so far from the others, has a wrong stamp."""
MAX_CLOCK_ZEROS = 16
ROW_TOLERANCE = 0.04
"""A second whose row count is further from the usual one has lost rows, and it is not known which."""


@dataclass(frozen=True, slots=True, eq=False)
class Seconds:
    """The SENSOR_DATA records in the order of the file, one row each.

    ``unix_s``: device clock; ``first_row``, ``n_rows``: where its samples lie; ``schema``: counts the changes
    of the row layout.
    """

    unix_s: NDArray[np.int64]
    first_row: NDArray[np.int64]
    n_rows: NDArray[np.int64]
    schema: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.unix_s)

    def keep(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> "Seconds":
        """Return some of them."""
        return Seconds(self.unix_s[chosen], self.first_row[chosen], self.n_rows[chosen], self.schema[chosen])


@dataclass(frozen=True, slots=True)
class Run:
    """Seconds without a break. ``start_s``: from the first second, without steps of the device's clock."""

    start_s: int
    first: int
    stop: int

    @property
    def end_s(self) -> int:
        """First second after the run."""
        return self.start_s + self.stop - self.first


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """Runs in the order of the file; ``seconds`` are the seconds that were kept.

    ``clock_zeros_s``: what the device's clock read at the first sample, once for each time it was set.
    """

    seconds: Seconds
    runs: tuple[Run, ...]
    flags: tuple[QualityFlag, ...]
    clock_zeros_s: tuple[int, ...]

    def place_s(self, unix_s: int) -> int:
        """Where a stamp of the device lies, seconds from the first sample.

        A clock that was set in between has several readings of the file's time; the first that lies inside
        the recording is taken.
        """
        places = [unix_s - zero_s for zero_s in self.clock_zeros_s]
        inside = [place for place in places if 0 <= place <= self.runs[-1].end_s]
        return inside[0] if inside else min(places, key=abs)


def repair_outliers(unix_s: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Replace single stamps whose neighbours agree with each other but not with them.

    Returns the stamps, shape (n,), Unix seconds, and how many were replaced.
    """
    stamps = unix_s.copy()
    if len(stamps) < 3:
        return stamps, 0
    before, here, after = stamps[:-2], stamps[1:-1], stamps[2:]
    lonely = (after - before == 2) & (here != before + 1)
    stamps[1:-1][lonely] = before[lonely] + 1
    count = int(lonely.sum())
    if abs(stamps[1] - stamps[0]) > LONGEST_ALONE_S and stamps[2] - stamps[1] == 1:
        stamps[0] = stamps[1] - 1
        count += 1
    if abs(stamps[-1] - stamps[-2]) > LONGEST_ALONE_S and stamps[-2] - stamps[-3] == 1:
        stamps[-1] = stamps[-2] + 1
        count += 1
    return stamps, count


def find_doubles(
    seconds: Seconds, acc: NDArray[np.float32], gyr: NDArray[np.float32]
) -> tuple[NDArray[np.bool_], int, int]:
    """Mark seconds to leave out because the one before has the same stamp.

    Returns the mask of those kept, the count of identical doubles and of doubles that differ.
    """
    kept = np.ones(len(seconds), np.bool_)
    kept[1:] = np.diff(seconds.unix_s) != 0
    identical = 0
    for place in np.flatnonzero(~kept):
        rows = [
            slice(seconds.first_row[k], seconds.first_row[k] + seconds.n_rows[k]) for k in (place - 1, place)
        ]
        identical += int(
            np.array_equal(acc[rows[0]], acc[rows[1]]) and np.array_equal(gyr[rows[0]], gyr[rows[1]])
        )
    return kept, identical, int((~kept).sum()) - identical


def find_runs(seconds: Seconds) -> tuple[tuple[Run, ...], tuple[QualityFlag, ...]]:
    """Cut the seconds at each step of the clock other than one, and at each change of the row layout.

    A step back, or a step forward by more than 31 days, is a clock that was set: the next run follows at
    once, because the length of the break is unknown.
    """
    unix_s = seconds.unix_s
    breaks = np.flatnonzero((np.diff(unix_s) != 1) | (np.diff(seconds.schema) != 0)) + 1
    edges = [0, *breaks.tolist(), len(unix_s)]
    runs: list[Run] = []
    flags: list[QualityFlag] = []
    for first, stop in pairwise(edges):
        if not runs:
            runs.append(Run(0, first, stop))
            continue
        step_s = int(unix_s[first] - unix_s[first - 1])
        gap_s = step_s - 1 if 1 < step_s <= LONGEST_GAP_S else 0
        if gap_s == 0 and step_s != 1:
            code, at_s = Caveat.CLOCK_BACK if step_s < 0 else Caveat.CLOCK_FWD, float(runs[-1].end_s)
            flags.append(QualityFlag(code, 1, 0.0, at_s, at_s, {"step_s": step_s}))
        runs.append(Run(runs[-1].end_s + gap_s, first, stop))
    return tuple(runs), tuple(flags)


def order_seconds(seconds: Seconds, acc: NDArray[np.float32], gyr: NDArray[np.float32]) -> Timeline:
    """Repair single wrong stamps, drop duplicates and partial seconds, and find the runs."""
    stamps, repaired = repair_outliers(seconds.unix_s)
    stamped = replace(seconds, unix_s=stamps)
    kept, identical, differing = find_doubles(stamped, acc, gyr)
    single = stamped.keep(kept)
    usual = float(np.median(single.n_rows))
    whole = single.keep(np.abs(single.n_rows - usual) <= max(2.0, ROW_TOLERANCE * usual))
    runs, clock_flags = find_runs(whole)
    counts = {
        Caveat.CLOCK_FWD: repaired,
        Caveat.DUP: identical,
        Caveat.DUP_CONFLICT: differing,
        Caveat.SEC_COUNT: int((single.n_rows < usual).sum()),
    }
    zeros = dict.fromkeys(int(whole.unix_s[run.first]) - run.start_s for run in runs)
    return Timeline(whole, runs, flag_counts(counts) + clock_flags, tuple(zeros)[:MAX_CLOCK_ZEROS])


# From the archive to a recording.

WATCHED = (ACTIVITY, BATTERY, EVENT, METADATA, SCHEMA, SENSOR_DATA, ACTIVITY2)
MAX_HELD_RECORDS = 512
"""Samples that come before their schema are kept for it; more of them mean that it is missing, not late."""


def recognise(source: Source) -> bool:
    """Whether the bytes are a zip."""
    return source.file.seekable() and source.head.startswith((ZIP_MAGIC, EMPTY_ZIP_MAGIC))


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the log tells its rate)
    """Read the IMU of a GT9X Link.

    Raises
    ------
    acromion.fusion.errors.UnreadableFile
        The archive is cut, corrupt or unsafe, parts are missing, there is no gyroscope, or more than 5 % of
        the records are damaged.
    NoSamples
        No second of samples.
    """
    with open_archive(source) as archive:
        check_parts(archive)
        text = parse_device_text(read_text(archive, "info.txt"))
        member = archive.getinfo("log.bin")
        to_log_end = replace(source, size_bytes=member.header_offset + member.compress_size)
        find = partial(_find_window, text, source.window) if source.window else None
        log = decode_log(read_member(archive, "log.bin"), member.file_size, to_log_end, find)
    log.refuse_unusable()
    timeline = order_seconds(log.seconds(), log.columns.acc, log.columns.gyr)
    return build_recording(text, log, timeline)


def measure_extent(source: Source) -> Extent:
    """Return when a recording has samples, by the stamps of the device; its digest is not computed.

    Only the first second is decoded. Raises as :func:`read`.
    """
    with open_archive(source) as archive:
        check_parts(archive)
        text = parse_device_text(read_text(archive, "info.txt"))
        size_bytes = archive.getinfo("log.bin").file_size
        log = decode_log(
            read_member(archive, "log.bin"), size_bytes, find_window=lambda unix_s, _: (unix_s, unix_s + 1)
        )
    log.refuse_unusable()
    first_unix_s = int(log.seconds().unix_s[0])
    zone = find_zone(log.events.zone_name) if log.events.counts_utc else None
    start, _ = trust_clock(_find_clock(text, log.events, first_unix_s, zone))
    stamps = np.unique(repair_outliers(np.concatenate(log.stamps))[0]) - first_unix_s
    duration_s = max(log.scan.last_unix_s - first_unix_s, int(stamps[-1])) + 1  # a clock may be set back
    edges = np.flatnonzero(np.diff(stamps) > 1) + 1
    runs = zip(stamps[np.append(0, edges)], stamps[np.append(edges - 1, -1)] + 1, strict=True)
    covered_us = find_covered((int(a) * MICROSECONDS, int(b) * MICROSECONDS) for a, b in runs)
    return Extent(start, duration_s * MICROSECONDS, covered_us=covered_us)


# info.txt: what the device tells about itself.

TICKS_PER_SECOND = 10_000_000
TICKS_AT_UNIX_EPOCH = 621_355_968_000_000_000
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
MAX_VALUE_CHARACTERS = 200


@dataclass(frozen=True, slots=True)
class DeviceText:
    """The lines of info.txt. Values are text, stripped of control characters and cut at 200 characters."""

    values: dict[str, str] = field(default_factory=dict)
    encoding: str = "utf-8"

    def number(self, key: str) -> float | None:
        """Parse a number with decimal point or comma, such as `8,0` or `100 Hz`; None for anything else."""
        found = re.match(r"\s*([-+]?\d+(?:[.,]\d+)?)", self.values.get(key, ""))
        return float(found.group(1).replace(",", ".")) if found else None

    def unix_s(self, key: str) -> float | None:
        """A .NET tick count as Unix seconds of the device's own clock; None for 0 and nonsense."""
        text = self.values.get(key, "")
        if not re.fullmatch(r"\d{1,19}", text) or int(text) == 0:
            return None
        return (int(text) - TICKS_AT_UNIX_EPOCH) / TICKS_PER_SECOND

    @property
    def serial_hash(self) -> str | None:
        """SHA-256 of the serial, first 12 hexadecimal digits: tells devices apart, names none."""
        return hash_serial(self.values.get("Serial Number", ""))

    @property
    def offset_s(self) -> int | None:
        """Seconds east of UTC."""
        return parse_offset_s(self.values.get("TimeZone", ""))


def parse_device_text(content: bytes) -> DeviceText:
    """Read `Key: value` lines: CRLF or LF, with or without a byte order mark, UTF-8 or else Windows-1252."""
    try:
        text, encoding = content.decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:
        text, encoding = content.decode("cp1252", errors="replace"), "cp1252"
    values: dict[str, str] = {}
    for line in text.splitlines():
        key, separator, value = line.partition(":")
        if separator:
            values.setdefault(key.strip(), CONTROL.sub("", value).strip()[:MAX_VALUE_CHARACTERS])
    return DeviceText(values, encoding)


def find_start(first_unix_s: int, offset_s: int | None, *, counts_utc: bool) -> datetime:
    """Return the device's clock at the first sample.

    ActiLife encodes local wall-clock time as if it were UTC; CentrePoint files (`UsedUtc`) count UTC.
    The wall-clock reading is never shifted; the offset is attached where the file gives one.
    """
    moment = datetime.fromtimestamp(first_unix_s, UTC)
    if offset_s is None:
        return moment if counts_utc else moment.replace(tzinfo=None)
    zone = timezone(timedelta(seconds=offset_s))
    return moment.astimezone(zone) if counts_utc else moment.replace(tzinfo=zone)


# The primary accelerometer, read now and then to check the IMU and the header against it.

PROBED_EVERY_S = 16
"""One second in sixteen is enough evidence and costs nothing."""
DEFAULT_SCALE = 256.0
ROW_BYTES = 6
FEWEST_STILL = 2
LARGEST_DIFFERENCE_G = 0.2


Primary = tuple[int, NDArray[np.int16]]
"""One second of ACTIVITY2: its stamp, and its rows in counts, shape (rows, 3)."""
FindWindow = Callable[[int, DeviceEvents], tuple[int, int] | None]
"""Returns the stamps to decode from the stamp of the first sample, and the events before it."""


def measure_bias_g(
    seen: Sequence[Primary], text: DeviceText, timeline: Timeline, columns: SampleColumns
) -> float | None:
    """Measure how far the two accelerometers are apart at rest: median over still seconds, None without any.

    Both have the same axes (on a Link they differ by 0.04 g in every pose).
    """
    scale = text.number("Acceleration Scale") or DEFAULT_SCALE
    seconds, limit_g = timeline.seconds, BOTH_ACCELEROMETERS.acc_sd_g
    places = dict(zip(seconds.unix_s.tolist(), range(len(seconds.unix_s)), strict=True))
    alike: dict[tuple[int, int], list[tuple[NDArray[np.int16], int]]] = {}  # seconds of one length at a time
    for unix_s, counts in seen:
        if unix_s in places:
            k = places[unix_s]
            shape = (len(counts), int(seconds.n_rows[k]))
            alike.setdefault(shape, []).append((counts, int(seconds.first_row[k])))
    apart_g = [np.zeros(0)]
    for (_, rows), pairs in alike.items():
        mean, scatter = _measure_seconds(np.stack([counts for counts, _ in pairs]))
        is_still = scatter <= limit_g * scale
        firsts = np.array([first for _, first in pairs])[is_still]
        mean_g, scatter_g = _measure_seconds(columns.acc[firsts[:, None] + np.arange(rows)])
        far_g = np.linalg.norm(mean_g - mean[is_still] / scale, axis=1)
        apart_g.append(far_g[scatter_g <= limit_g])
    found_g = np.concatenate(apart_g)
    return float(np.median(found_g)) if len(found_g) >= FEWEST_STILL else None


def _measure_seconds(samples: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean (s, 3) and largest standard deviation (s,) of seconds of samples, shape (s, rows, 3)."""
    values = samples.astype(np.float64)
    return values.mean(axis=1), values.std(axis=1).max(axis=1)


# log.bin: its records, decoded piece by piece.


@dataclass(slots=True)
class DeviceLog:
    """The content of log.bin, gathered piece by piece.

    ``columns``: the samples of all decoded records, in g and deg/s.
    ``decoded``: the places of the samples of each batch of records.
    ``decoder``: decoder of the current schema; None before the first, or if it has no usable channels.
    ``labels``: names of the columns of all schemas.
    ``n_undecoded``: number of SENSOR_DATA records that fit no schema.
    ``held``: Unix seconds and payloads of samples before the first schema.
    ``primary_seconds``: checked seconds of the primary accelerometer.
    ``window_unix_s``: the stamps to decode (first, stop), which ``find_window`` returns at the first sample;
    None for all.
    ``stamps``: Unix seconds of all samples, also outside the window.
    """

    columns: SampleColumns = field(default_factory=lambda: SampleColumns(has_stamps=False))
    events: DeviceEvents = field(default_factory=DeviceEvents)
    tally: NDArray[np.int64] = field(default_factory=lambda: np.zeros(TALLY_PLACES, np.int64))
    decoded: list[Seconds] = field(default_factory=list)
    decoder: RowDecoder | None = None
    labels: set[str] = field(default_factory=set)
    n_bytes: int = 0
    n_schemas: int = 0
    n_undecoded: int = 0
    held: list[tuple[int, bytes]] = field(default_factory=list)
    primary_seconds: list[Primary] = field(default_factory=list)
    find_window: FindWindow | None = None
    window_unix_s: tuple[int, int] | None = None
    stamps: list[NDArray[np.int64]] = field(default_factory=list)

    def is_inside(self, unix_s: int) -> bool:
        """Return whether a stamp is in the window, if there is one."""
        return self.window_unix_s is None or self.window_unix_s[0] <= unix_s < self.window_unix_s[1]

    @property
    def last_unix_s(self) -> int:
        """The last stamp of the file, or of the window."""
        last_unix_s = self.scan.last_unix_s
        return last_unix_s if self.window_unix_s is None else min(last_unix_s, self.window_unix_s[1] - 1)

    @property
    def scan(self) -> ScanTally:
        """The result of the scan."""
        return summarise_tally(self.tally)

    def seconds(self) -> Seconds:
        """Join the decoded SENSOR_DATA records, in the order of the file."""
        names = Seconds.__slots__
        return Seconds(*(np.concatenate([getattr(part, name) for part in self.decoded]) for name in names))

    def refuse_unusable(self) -> None:
        """Raise if no sample can be trusted."""
        scan = self.scan
        damaged_percent = 100.0 * scan.damaged_bytes / max(1, self.n_bytes)
        if damaged_percent > MAX_DAMAGED_PERCENT:
            clock = datetime.fromtimestamp(scan.first_damage_unix_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
            raise DamagedFile(p=round(damaged_percent, 1), clock=clock)
        if self.columns.rows:
            return
        if self.window_unix_s is not None:
            first, stop = (
                datetime.fromtimestamp(unix_s, UTC).isoformat()[:19] for unix_s in self.window_unix_s
            )
            raise UnusableShift(why="no samples", window=f"{first}/{stop}")
        if self.n_undecoded and not self.labels:
            raise MissingMember(member="SENSOR_SCHEMA")
        if self.n_undecoded and self.decoder is not None:
            raise DamagedFile(p=100.0)
        if self.n_undecoded:
            raise UnknownColumns(list=", ".join(sorted(self.labels)))
        if scan.records == 0:
            raise NoSamples
        raise NoGyroscope(cure="GT9X")


def decode_log(
    pieces: Iterable[bytes],
    size_bytes: int = 0,
    source: Source | None = None,
    find_window: FindWindow | None = None,
) -> DeviceLog:
    """Scan and decode log.bin in one pass over its pieces.

    ``pieces``: the bytes of log.bin.
    ``size_bytes``: its size in the archive's directory, to estimate the room for the samples.
    ``source``: the file up to the end of log.bin, to refuse too many rows.
    ``find_window``: returns the stamps to decode; None for all.
    """
    log = DeviceLog(SampleColumns(source, has_stamps=False), find_window=find_window)
    to_come = 0 if find_window else size_bytes

    def scan(buffer: NDArray[np.uint8], is_last: bool) -> tuple[int, NDArray[np.int64]]:  # noqa: FBT001
        records = np.empty((len(buffer) // FRAME_BYTES + 1, 4), np.int64)
        used, found = scan_records(buffer, is_last, records, log.tally)
        log.n_bytes += len(buffer) if is_last else used
        return used, records[:found]

    for buffer, records in scan_pieces(pieces, scan):
        kinds, sizes = records[:, 0], records[:, 3]
        # of the primary accelerometer its one-byte dock events are read, and a second now and then
        is_activity = ((kinds == ACTIVITY) | (kinds == ACTIVITY2)) & (sizes != 1)
        is_probed = (kinds == ACTIVITY2) & (sizes >= ROW_BYTES) & (records[:, 1] % PROBED_EVERY_S == 0)
        watched = records[np.isin(kinds, WATCHED) & (~is_activity | is_probed)]
        schemas = np.flatnonzero(watched[:, 0] == SCHEMA)
        for part in np.split(watched, schemas):  # each but the first begins with a schema
            _take_records(log, buffer, part)
        if log.columns.rows and to_come:
            log.columns.reserve(len(buffer), to_come)
            to_come = 0
    log.columns.trim()
    log.events.sleep = [one for one in log.events.sleep if log.is_inside(one[0])]
    return log


def _take_records(log: DeviceLog, buffer: NDArray[np.uint8], records: NDArray[np.int64]) -> None:
    """Process records of one schema; only the first record may be a schema."""
    is_sample = records[:, 0] == SENSOR_DATA
    for kind, unix_s, first, size in records[~is_sample].tolist():
        payload = buffer[first : first + size].tobytes()
        if kind == SCHEMA:
            _take_schema(log, payload)
        elif kind != METADATA and not log.is_inside(unix_s):
            continue
        elif size > 1 and kind == ACTIVITY2:
            rows = len(payload) // ROW_BYTES
            log.primary_seconds.append((unix_s, np.frombuffer(payload, "<i2", 3 * rows).reshape(rows, 3)))
        else:
            log.events.note(kind, unix_s, payload)
    samples = records[is_sample]
    if log.decoder is not None:
        _take_samples(log, log.decoder, buffer, samples)
        return
    log.n_undecoded += len(samples)
    if log.n_schemas == 0:
        for _, unix_s, first, size in samples[: MAX_HELD_RECORDS - len(log.held)].tolist():
            log.held.append((unix_s, buffer[first : first + size].tobytes()))


def _take_schema(log: DeviceLog, payload: bytes) -> None:
    schema = parse_schema(payload)
    if schema is None or (log.decoder is not None and log.decoder.schema == schema):
        return
    log.labels |= {column.label for column in schema.columns if column.label}
    log.decoder = make_decoder(schema)
    log.n_schemas += 1
    waiting, log.held = log.held, []
    if log.decoder is not None:
        log.n_undecoded -= len(waiting)
        for unix_s, rows in waiting:
            record = np.array([[SENSOR_DATA, unix_s, 0, len(rows)]])
            _take_samples(log, log.decoder, np.frombuffer(rows, np.uint8), record)


def _take_samples(
    log: DeviceLog, decoder: RowDecoder, buffer: NDArray[np.uint8], records: NDArray[np.int64]
) -> None:
    """Decode the records with the decoder's schema and whole rows."""
    firsts, sizes = records[:, 2], records[:, 3]
    n_rows, odd_bytes = np.divmod(sizes - 2, decoder.schema.row_bytes)
    fits = (sizes >= 2) & (n_rows > 0) & (odd_bytes == 0)
    fits[fits] = decoder.find_own(buffer, firsts[fits])
    log.n_undecoded += int(np.count_nonzero(~fits))
    if log.find_window and log.window_unix_s is None and fits.any():
        log.window_unix_s = log.find_window(int(records[fits, 1][0]), log.events)
    log.stamps.append(records[fits, 1])
    if log.window_unix_s is not None:
        fits &= (records[:, 1] >= log.window_unix_s[0]) & (records[:, 1] < log.window_unix_s[1])
    unix_s, firsts, n_rows = records[fits, 1], firsts[fits], n_rows[fits]
    columns = log.columns
    stops = columns.rows + np.cumsum(n_rows)
    rows = columns.extend(int(n_rows.sum()))
    decoder.decode(buffer, firsts + 2, n_rows, (columns.acc[rows], columns.gyr[rows]))
    log.decoded.append(Seconds(unix_s, stops - n_rows, n_rows, np.full(len(unix_s), log.n_schemas)))


# From the log to a recording: segments, exclusions, the clock.


def flag_clock_set(log: DeviceLog) -> tuple[QualityFlag, ...]:
    """Flag a clock that was set outside the window: the date of the window may be wrong."""
    if log.window_unix_s is None:
        return ()
    stamps, _ = repair_outliers(np.concatenate(log.stamps))
    steps_s, is_before = np.diff(stamps), stamps[1:] < log.window_unix_s[1]
    found = (
        (Caveat.CLOCK_FWD, steps_s[is_before & (steps_s > LONGEST_GAP_S)]),
        (Caveat.CLOCK_BACK, steps_s[steps_s < 0]),
    )
    return tuple(
        QualityFlag(code, len(steps), 0.0, 0.0, 0.0, {"step_s": int(steps[0])})
        for code, steps in found
        if len(steps)
    )


def build_recording(text: DeviceText, log: DeviceLog, timeline: Timeline) -> Recording:
    """Put segments, exclusions and caveats together."""
    segments = tuple(_make_segment(log.columns, timeline.seconds, run) for run in timeline.runs)
    excluded, asides = find_exclusions(log, timeline)
    duration_us = max([segments[-1].end_us, *(span.end_us for span in excluded)])
    zone = find_zone(log.events.zone_name) if log.events.counts_utc else None
    start, unset = trust_clock(_find_clock(text, log.events, int(timeline.seconds.unix_s[0]), zone))
    changes = flag_zone_changes(start, duration_us) if zone and start else ()
    decoder = log.decoder
    return Recording(
        device="gt9x",
        sha256="",
        start=start,
        time_zone=zone.key if zone else None if text.offset_s is None else format_offset(text.offset_s),
        duration_us=duration_us,
        segments=segments,
        excluded=excluded,
        flags=(
            *flag_file(text, log, timeline, segments),
            *timeline.flags,
            *flag_clock_set(log),
            *changes,
            *asides,
            *unset,
            *flag_spans(Caveat.SLEEP, [span for span in excluded if span.reason == "asleep"]),
            *flag_spans(Caveat.DOCKED, [span for span in excluded if span.reason == "docked"]),
            *flag_gaps(segments, duration_us, excluded),
        ),
        understood=_describe(text, log, timeline),
        stated=Stated(is_known=True, units_from="header"),
        serial_hash=text.serial_hash,
        acc_range_g=_full_scale(decoder, 0),
        gyr_range_dps=_full_scale(decoder, 3),
    )


def _find_clock(text: DeviceText, events: DeviceEvents, first_unix_s: int, zone: ZoneInfo | None) -> datetime:
    """Find the clock at the first sample, in the zone that the file names if it counts UTC."""
    if zone is None:
        return find_start(first_unix_s, text.offset_s, counts_utc=events.counts_utc)
    return datetime.fromtimestamp(first_unix_s, zone)


def _find_window(
    text: DeviceText, window: ShiftWindow, first_unix_s: int, events: DeviceEvents
) -> tuple[int, int] | None:
    """Return the stamps of a window (first, stop); None if the clock was never set."""
    zone = find_zone(events.zone_name) if events.counts_utc else None
    start, _ = trust_clock(_find_clock(text, events, first_unix_s, zone))
    if start is None:
        return None
    first_us, stop_us = window.place(start)
    return first_unix_s - -first_us // MICROSECONDS, first_unix_s - -stop_us // MICROSECONDS


def _make_segment(columns: SampleColumns, seconds: Seconds, run: Run) -> Segment:
    first_rows = seconds.first_row[run.first : run.stop]
    stop_rows = first_rows + seconds.n_rows[run.first : run.stop]
    n_rows = int(seconds.n_rows[run.first : run.stop].sum())
    if stop_rows[-1] - first_rows[0] == n_rows:
        acc = columns.acc[first_rows[0] : stop_rows[-1]]
        gyr = columns.gyr[first_rows[0] : stop_rows[-1]]
    else:
        kept = np.concatenate([np.arange(a, b) for a, b in zip(first_rows, stop_rows, strict=True)])
        acc, gyr = columns.acc[kept], columns.gyr[kept]
    return Segment(run.start_s * MICROSECONDS, n_rows / (run.stop - run.first), acc, gyr)


def find_exclusions(log: DeviceLog, timeline: Timeline) -> tuple[tuple[Span, ...], tuple[QualityFlag, ...]]:
    """Idle sleep without measurements, and seconds in the dock, from the first sample on.

    Also returns caveats without an exclusion: sleep before the first sample, and a stamp more than a day
    after the last sample, which is ignored.
    """
    covered = [(run.start_s, run.end_s) for run in timeline.runs]
    end_s = max(covered[-1][1], timeline.place_s(log.last_unix_s))
    asides: tuple[QualityFlag, ...] = ()
    if end_s - covered[-1][1] > LONGEST_ASIDE_S:
        end_s = covered[-1][1]
        asides += (QualityFlag(Caveat.CLOCK_FWD, 1, 0.0, float(end_s), float(end_s)),)
    seconds = {place for place in map(timeline.place_s, log.events.docked_s) if 0 <= place < end_s}
    docked = join_overlapping((second, second + 1) for second in seconds)
    asleep: list[tuple[int, int]] = []
    for start_unix_s, end_unix_s in pair_sleep(log.events.sleep, log.last_unix_s):
        early_s = -timeline.place_s(start_unix_s)
        if 0 < early_s <= LONGEST_ASIDE_S:
            asides += (QualityFlag(Caveat.SLEEP, 1, float(early_s)),)
        start_s, stop_s = max(0, -early_s), min(end_s, timeline.place_s(end_unix_s))
        inside = [(first_s, last_s) for first_s, last_s in (*covered, *docked) if first_s < stop_s]
        asleep += find_uncovered(inside, start_s, stop_s, 0)
    spans = tuple(
        Span(first_s * MICROSECONDS, (stop_s - first_s) * MICROSECONDS, reason)
        for reason, found in (("docked", docked), ("asleep", asleep))
        for first_s, stop_s in found
    )
    return spans, asides


def _full_scale(decoder: RowDecoder | None, channel: int) -> float | None:
    channels = decoder.schema.channels() if decoder else None
    return float(2 ** (channels[channel].bit_size - 1) / channels[channel].divisor) if channels else None


def _describe(text: DeviceText, log: DeviceLog, timeline: Timeline) -> dict[str, str]:
    counts = timeline.seconds.n_rows
    usual = ", ".join(f"{n} x {k}" for n, k in zip(*np.unique(counts, return_counts=True), strict=True))
    steps = [second.start_s - first.end_s for first, second in pairwise(timeline.runs)]
    return {
        "layout": "ActiGraph GT9X Link .gt3x",
        "columns": ", ".join(sorted(log.labels)),
        "units": "g, deg/s",
        "units_from": "header",
        "rows_per_second": usual[:200],
        "samples": str(int(counts.sum())),
        "records": str(log.scan.records),
        "missing_seconds": str(sum(steps)),
        "firmware": text.values.get("Firmware", ""),
        "clock": "UTC" if log.events.counts_utc else "local",
    }


# Caveats that come from the records, from info.txt and from the clock.

LOW_BATTERY_MV = 3600
"""A lithium cell under this is about to switch the device off."""
IMU_RATE_HZ = 100.0
TURNED_SERIAL, TURNED_FIRMWARE = "MOS", "1.6.0"
"""ActiGraph documents axes turned by 90 degrees in the ACTIVITY records of these; see docs/decisions."""


def flag_file(
    text: DeviceText, log: DeviceLog, timeline: Timeline, segments: Sequence[Segment]
) -> tuple[QualityFlag, ...]:
    """Caveats that come from the records and from info.txt."""
    whole_s = log.scan.last_unix_s if log.window_unix_s else 0
    planned_s, last_s = text.unix_s("Stop Date"), float(max(timeline.seconds.unix_s[-1] + 1, whole_s))
    serial, firmware = text.values.get("Serial Number", ""), text.values.get("Firmware", "")
    counts = {
        Caveat.ROWS_DROPPED: log.n_undecoded,
        Caveat.RESETS: int(text.number("Unexpected Resets") or 0),
        Caveat.ENCODING: int(text.encoding != "utf-8"),
        Caveat.TZ: int(text.offset_s is None and ("TimeZone" in text.values or log.events.counts_utc)),
        Caveat.EARLY_END: int(planned_s is not None and planned_s - last_s > EARLY_END_S),
        Caveat.BATTERY: int(0 < log.events.battery_mv < LOW_BATTERY_MV),
        Caveat.FIRMWARE: int(serial.startswith(TURNED_SERIAL) and firmware == TURNED_FIRMWARE),
    }
    return flag_damage(log.scan, timeline) + flag_counts(counts) + flag_rates(text, log, timeline, segments)


def flag_damage(scan: ScanTally, timeline: Timeline) -> tuple[QualityFlag, ...]:
    """Records that do not verify, with the place of the first and the last, and a tail that is cut off."""
    places = [timeline.place_s(unix_s) for unix_s in (scan.first_damage_unix_s, scan.last_damage_unix_s)]
    first_s, last_s = (float(min(max(0, place), timeline.runs[-1].end_s)) for place in places)
    flags = flag_counts({Caveat.CHECKSUM: scan.bad_checksums, Caveat.RESYNC: scan.resyncs}, first_s, last_s)
    if scan.tail_bytes:
        end_s = float(timeline.runs[-1].end_s)
        flags += (QualityFlag(Caveat.TRUNC_TAIL, 1, 0.0, end_s, end_s, {"n": scan.tail_bytes}),)
    return flags


def flag_rates(
    text: DeviceText, log: DeviceLog, timeline: Timeline, segments: Sequence[Segment]
) -> tuple[QualityFlag, ...]:
    """Flag contradictions between header, nominal rate and the two accelerometers."""
    seen = log.primary_seconds
    rate_hz = round(max(segments, key=len).rate_hz, 3)
    flags: tuple[QualityFlag, ...] = ()
    header_hz = text.number("Sample Rate")
    primary_hz = float(np.median([len(counts) for _, counts in seen])) if seen else header_hz
    if not header_hz or not primary_hz or abs(primary_hz - header_hz) > 0.05 * header_hz:
        flags += (QualityFlag(Caveat.RATE, facts={"rate_hz": rate_hz, "rate_from": "measured"}),)
    flags += flag_drift(IMU_RATE_HZ, rate_hz)
    bias_g = measure_bias_g(seen, text, timeline, log.columns)
    if bias_g is not None and bias_g > LARGEST_DIFFERENCE_G:
        flags += (QualityFlag(Caveat.BIAS, facts={"g": round(bias_g, 3)}),)
    return flags
