"""log.bin: its records, found by their checksums also where the file is damaged, and the device's events.

Framing (actigraph/GT3X-File-Format, README): 0x1E, type, uint32 LE Unix seconds, uint16 LE payload size n,
n bytes, checksum = complement of the XOR of all bytes before it. Zeros between records are legal.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.numba_kernels import njit
from fusion.numerics.intervals import join_overlapping
from fusion.readers.source import mark_last
from fusion.recording import MICROSECONDS, Span

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


def merge_seconds(seconds: Iterable[int]) -> list[tuple[int, int]]:
    """Join single seconds into (from, to)."""
    return join_overlapping((second, second + 1) for second in set(seconds))


def cut_out(start_s: int, end_s: int, covered: Iterable[tuple[int, int]]) -> list[tuple[int, int]]:
    """What of [start, end) is not covered; ``covered`` in order and without overlap."""
    left: list[tuple[int, int]] = []
    for first, stop in covered:
        if stop <= start_s or first >= end_s:
            continue
        if first > start_s:
            left.append((start_s, first))
        start_s = max(start_s, stop)
    if start_s < end_s:
        left.append((start_s, end_s))
    return left


def make_spans(spans_s: Iterable[tuple[int, int]], reason: str) -> tuple[Span, ...]:
    """Seconds to exact microseconds."""
    return tuple(Span(start * MICROSECONDS, (end - start) * MICROSECONDS, reason) for start, end in spans_s)


# mypy: disable-error-code="assignment, return-value, arg-type, no-any-return"
# (numba infers the machine types of the kernels; numpy's scalars are not Python's int to mypy)


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
def fold_bytes(buffer: NDArray[np.uint8], first_byte: int, stop_byte: int) -> int:
    """XOR of the bytes first to stop."""
    folded = np.uint8(0)
    for k in range(first_byte, stop_byte):
        folded ^= buffer[k]
    return folded


@njit(cache=True, nogil=True)
def fold_prefixes(buffer: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """XOR of the bytes before each place, so that any stretch is then folded in one step."""
    prefixes = np.empty(len(buffer) + 1, np.uint8)
    prefixes[0] = 0
    for k in range(len(buffer)):
        prefixes[k + 1] = prefixes[k] ^ buffer[k]
    return prefixes


@njit(cache=True, nogil=True)
def frame_end(buffer: NDArray[np.uint8], at_byte: int) -> int:
    """First byte after the record that would begin at ``at_byte``; -1 where its header is cut off."""
    if at_byte + FRAME_BYTES > len(buffer):
        return -1
    return at_byte + FRAME_BYTES + (buffer[at_byte + 6] | (buffer[at_byte + 7] << 8))


@njit(cache=True, nogil=True)
def verify(buffer: NDArray[np.uint8], at_byte: int, end_byte: int, prefixes: NDArray[np.uint8]) -> bool:
    """Whether a whole record with a true checksum lies at ``at_byte``."""
    if end_byte < 0 or end_byte > len(buffer) or buffer[at_byte] != SEPARATOR:
        return False
    is_folded = len(prefixes) > 1
    folded = (
        prefixes[end_byte - 1] ^ prefixes[at_byte] if is_folded else fold_bytes(buffer, at_byte, end_byte - 1)
    )
    return (folded ^ 0xFF) == buffer[end_byte - 1]


@njit(cache=True, nogil=True)
def verify_hunted(
    buffer: NDArray[np.uint8], at_byte: int, end_byte: int, prefixes: NDArray[np.uint8]
) -> bool:
    """As ``verify``, and what follows can follow a record: one checksum byte alone is weak proof."""
    if not verify(buffer, at_byte, end_byte, prefixes):
        return False
    return end_byte == len(buffer) or buffer[end_byte] == SEPARATOR or buffer[end_byte] == 0


@njit(cache=True, nogil=True)
def note_record(buffer: NDArray[np.uint8], at_byte: int, end_byte: int, record: NDArray[np.int64]) -> None:
    """Write type, time, first payload byte and payload size."""
    record[0] = buffer[at_byte + 1]
    record[1] = (
        buffer[at_byte + 2]
        | (buffer[at_byte + 3] << 8)
        | (buffer[at_byte + 4] << 16)
        | (np.int64(buffer[at_byte + 5]) << 24)
    )
    record[2] = at_byte + 8
    record[3] = end_byte - at_byte - FRAME_BYTES


@njit(cache=True, nogil=True)
def scan_records(
    buffer: NDArray[np.uint8],
    is_last: bool,  # noqa: FBT001 (numba kernels take their arguments by place)
    records: NDArray[np.int64],
    tally: NDArray[np.int64],
) -> tuple[int, int]:
    """Find the records of a piece of log.bin; return (bytes used, records found).

    A record that may go on in the next piece is left for it. Linear in the bytes: in sync each byte is
    folded once, and from the first damage on checksums come from prefixes.
    """
    prefixes = np.empty(1, np.uint8)
    at = 0
    found = 0
    while at < len(buffer):
        if buffer[at] == 0 and tally[IS_LOST] == 0:
            at += 1
            continue
        end = frame_end(buffer, at)
        if is_record(buffer, at, end, prefixes, tally):
            note_record(buffer, at, end, records[found])
            found += 1
            tally[GOOD] += 1
            tally[IS_LOST] = tally[HUNTED_BYTES] = 0
            tally[LAST_S] = records[found - 1, 1]
            at = end
            continue
        if not is_last and at + 2 * LONGEST_RECORD_BYTES > len(buffer):
            break
        if len(prefixes) == 1:
            prefixes = fold_prefixes(buffer)
        at = pass_damage(buffer, at, end, prefixes, tally)
    return at, found


@njit(cache=True, nogil=True)
def is_record(
    buffer: NDArray[np.uint8],
    at_byte: int,
    end_byte: int,
    prefixes: NDArray[np.uint8],
    tally: NDArray[np.int64],
) -> bool:
    """Whether a record is accepted at ``at_byte``: more proof is asked while hunting."""
    if tally[IS_LOST] == 1:
        return verify_hunted(buffer, at_byte, end_byte, prefixes)
    return verify(buffer, at_byte, end_byte, prefixes)


@njit(cache=True, nogil=True)
def pass_damage(
    buffer: NDArray[np.uint8],
    at_byte: int,
    end_byte: int,
    prefixes: NDArray[np.uint8],
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
        is_framed = end_byte == len(buffer) or verify_hunted(
            buffer, end_byte, frame_end(buffer, end_byte), prefixes
        )
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


@dataclass(frozen=True, slots=True, eq=False)
class ScannedPiece:
    """A piece of log.bin and its records: type, Unix seconds, first payload byte, payload size."""

    buffer: NDArray[np.uint8]
    records: NDArray[np.int64]


def scan_pieces(pieces: Iterable[bytes], tally: NDArray[np.int64]) -> Iterator[ScannedPiece]:
    """Scan log.bin piece by piece; what a piece does not finish is carried into the next."""
    carried = b""
    for piece, is_last in mark_last(pieces):
        buffer = np.frombuffer(carried + piece if carried else piece, np.uint8)
        records = np.empty((len(buffer) // FRAME_BYTES + 1, 4), np.int64)
        used, found = scan_records(buffer, is_last, records, tally)
        yield ScannedPiece(buffer, records[:found])
        carried = buffer[used:].tobytes()
