"""What the first bytes of a recording tell while the rest is still on its way."""

import io
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime, timedelta

from fusion.errors import EmptyFile, FusionError, NoGyroscope, UnknownFormat
from fusion.readers import cwa, gt3x, read_recording
from fusion.readers.cwa_header import HEADER_BYTES, parse_header
from fusion.readers.gt3x_archive import MAX_TEXT_BYTES
from fusion.readers.gt3x_clock import order_seconds
from fusion.readers.gt3x_info import DeviceText, name_offset, parse_device_text, tell_start
from fusion.readers.unpacking import GZIP_MAGIC, ZIP_MAGIC
from fusion.recording import Recording

MAX_UNPACKED_BYTES = 8 << 20
LONGEST_RECORDING = timedelta(days=366)
_STAMPED = {"calendar", "number since 1970"}
_LONGEST_COUNT_US = 1 << 32  # a count of 32 bits, the usual one, begins anew after 72 minutes
_CLOCK_DOUBTS = {"W-CLOCK-BACK", "W-CLOCK-FWD", "W-CLOCK-UNSET"}
_GZIP_WINDOW = 16 + zlib.MAX_WBITS
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")  # APPNOTE 4.3.7: one before each member of a zip
_DEVICE_TEXT = re.compile(rb"PK\x03\x04.{22}\x08\x00..info\.txt", re.DOTALL)


@dataclass(frozen=True, slots=True)
class HeadFacts:
    """What could be told so far; None: not yet."""

    device: str | None = None
    rate_hz: float | None = None
    start: datetime | None = None
    end: datetime | None = None
    time_zone: str | None = None
    serial_hash: str | None = None


def inspect_head(
    head: bytes, file_name: str = "", rate_hz: float | None = None, tail: bytes | None = None
) -> HeadFacts:
    """Say what the first bytes of a file show and, with its last bytes, when the recording ends.

    ``tail``: the last bytes of the file, none of which is in ``head``; empty where the head is the whole
    file, None where they are not known. Whatever a tail holds, it only ever adds or leaves out the end and,
    for a `.gt3x`, what info.txt says; it refuses nothing.

    Raises
    ------
    UnknownFormat
        The file is something else than a recording; that it is cut is no reason.
    """
    if head.startswith(ZIP_MAGIC):
        return _inspect_zip(head, rate_hz, tail or b"")
    if cwa.is_cwa(head):
        return _inspect_cwa(head, tail)
    if head.startswith(GZIP_MAGIC):  # the tail of a packed table cannot be unpacked by itself
        return _inspect_text(_inflate(head), file_name.removesuffix(".gz"), rate_hz)
    return _inspect_text(head, file_name, rate_hz, tail)


def _inspect_text(head: bytes, file_name: str, rate_hz: float | None, tail: bytes | None = None) -> HeadFacts:
    """Read the whole lines as if they were the file."""
    lines = head[: head.rfind(b"\n") + 1]
    try:
        recording = _read_lines(lines, file_name, rate_hz)
    except (EmptyFile, NoGyroscope):
        return HeadFacts()
    except UnknownFormat:
        raise
    except FusionError:  # too short, dead, without time: the rest may tell otherwise
        return HeadFacts()
    if any(flag.code == "W-REVERSED" for flag in recording.flags):
        return replace(_tell(recording), start=None)  # it begins where the file ends
    end = None if tail is None else _find_last_row(recording, (lines, tail), file_name, rate_hz)
    return replace(_tell(recording), end=end)


def _find_last_row(
    first: Recording, ends: tuple[bytes, bytes], file_name: str, rate_hz: float | None
) -> datetime | None:
    """Read the first lines and the last as if they were the file: it ends where the file ends.

    ``first`` is what was read of the first lines alone. A bare count may have begun anew in between, unseen:
    it tells an end only where it goes further than a count of 32 bits of microseconds can.
    """
    lines, tail = ends
    if not tail:
        return _find_end(first)
    with suppress(FusionError):
        both = _read_lines(lines + _keep_whole_lines(tail), file_name, rate_hz)
        time = both.understood.get("time")
        least_us = first.duration_us if time in _STAMPED else max(first.duration_us, _LONGEST_COUNT_US)
        if time in (*_STAMPED, "number") and both.start == first.start and both.duration_us > least_us:
            return _find_end(both)
    return None


def _read_lines(lines: bytes, file_name: str, rate_hz: float | None) -> Recording:
    return read_recording(io.BytesIO(lines), file_name=file_name, rate_hz=rate_hz, sha256="-")


def _keep_whole_lines(tail: bytes) -> bytes:
    """Leave out the first line, whose beginning is not in the tail, and a last one that was broken off."""
    return tail[tail.find(b"\n") + 1 : tail.rfind(b"\n") + 1]


def _find_end(recording: Recording) -> datetime | None:
    """Give the device's clock at the end, where the recording is as long as one can be."""
    lasted = timedelta(microseconds=recording.duration_us)
    return recording.start + lasted if recording.start and lasted <= LONGEST_RECORDING else None


def _inspect_zip(head: bytes, rate_hz: float | None, tail: bytes) -> HeadFacts:
    members = dict(_list_members(head))
    if {"info.txt", "log.bin"} & set(members):
        return _inspect_gt3x(members, _find_device_text(tail))
    packed = next((name for name in members if name.lower().endswith((".csv", ".txt"))), None)
    return _inspect_text(members[packed], packed, rate_hz) if packed else HeadFacts()


def _inspect_cwa(head: bytes, tail: bytes | None) -> HeadFacts:
    """Read the blocks that came; a gyroscope that is off in the first of them is off in all."""
    try:
        first = _read_blocks(head, b"")
    except NoGyroscope:
        raise
    except FusionError:
        return HeadFacts(device="ax6")
    end = None
    if tail is not None:
        with suppress(FusionError):
            end = _find_last_block(first, _read_blocks(head, tail) if tail else first)
    return replace(_tell(first), end=end)


def _find_last_block(first: Recording, both: Recording) -> datetime | None:
    """Give the end of what begins with the head and ends with the tail, where one clock runs through both."""
    is_one_clock = _CLOCK_DOUBTS.isdisjoint(flag.code for flag in both.flags)
    goes_on = both is first or both.duration_us > first.duration_us
    return _find_end(both) if is_one_clock and goes_on and both.start == first.start else None


def _read_blocks(head: bytes, tail: bytes) -> Recording:
    log = cwa.decode_log([head[HEADER_BYTES:], tail])
    if not log.columns.rows:
        log.refuse_unusable()
    return cwa.build_recording(parse_header(head), log)


def _find_device_text(tail: bytes) -> bytes:
    """Unpack info.txt where the tail of a `.gt3x` holds it from its beginning; else nothing."""
    last = max(_DEVICE_TEXT.finditer(tail), key=re.Match.start, default=None)
    return next(_list_members(tail[last.start() :]))[1] if last else b""


def _inspect_gt3x(members: dict[str, bytes], last_text: bytes) -> HeadFacts:
    """Read the log as far as it came (info.txt may be the last member); else what info.txt says."""
    text = parse_device_text((last_text or members.get("info.txt", b""))[:MAX_TEXT_BYTES])
    with suppress(FusionError):
        log = gt3x.decode_log([members.get("log.bin", b"")])
        log.refuse_unusable()
        timeline = order_seconds(log.seconds(), log.columns.acc, log.columns.gyr)
        recording = gt3x.build_recording(text, log, timeline)
        # whether info.txt counts UTC where the log does is not known
        end = None if log.events.counts_utc else _tell_end(text, recording.start, recording.duration_us)
        return replace(_tell(recording), end=end)
    return _tell_device(text) if text.values else HeadFacts()


def _tell_device(text: DeviceText) -> HeadFacts:
    start = _tell_moment(text, "Start Date")
    zone = None if text.offset_s is None else name_offset(text.offset_s)
    return HeadFacts("gt9x", None, start, _tell_end(text, start, 0), zone, text.serial_hash)


def _tell_end(text: DeviceText, start: datetime | None, least_us: int) -> datetime | None:
    """Give the last sample time of info.txt; None where it is before what was read, or absurd."""
    end = _tell_moment(text, "Last Sample Time")
    if start is None or end is None:
        return None
    return end if timedelta(microseconds=least_us) <= end - start <= LONGEST_RECORDING else None


def _tell_moment(text: DeviceText, key: str) -> datetime | None:
    """Read a line of info.txt on the device's clock; None where it is no time of the calendar."""
    unix_s = text.unix_s(key)
    if unix_s is None:
        return None
    try:
        return tell_start(int(unix_s), text.offset_s, counts_utc=False)
    except (OverflowError, ValueError):
        return None


def _tell(recording: Recording) -> HeadFacts:
    return HeadFacts(
        recording.device,
        round(recording.rate_hz, 4),
        recording.start,
        None,
        recording.time_zone,
        recording.serial_hash,
    )


def _list_members(head: bytes) -> Iterator[tuple[str, bytes]]:
    """Unpack the members that the head holds, the last one as far as it came."""
    at = 0
    while head[at : at + 4] == ZIP_MAGIC and at + _LOCAL_HEADER.size <= len(head):
        _, _, flags, method, _, _, _, packed, _, name_bytes, extra_bytes = _LOCAL_HEADER.unpack_from(head, at)
        name_at = at + _LOCAL_HEADER.size
        first = name_at + name_bytes + extra_bytes
        name = head[name_at : name_at + name_bytes].decode("utf-8", "replace")
        sizes_follow = bool(flags & 0x8)  # then only the packed stream itself says where it ends
        body = head[first:] if sizes_follow else head[first : first + packed]
        content, used = _unpack(body, method)
        yield name, content
        at = first + (used + (16 if sizes_follow else 0))


def _unpack(body: bytes, method: int) -> tuple[bytes, int]:
    if method == 0:
        return body, len(body)
    unpacker = zlib.decompressobj(-zlib.MAX_WBITS)
    try:
        content = unpacker.decompress(body, MAX_UNPACKED_BYTES)
    except zlib.error:  # the whole file will be judged when it is here
        return b"", len(body)
    return content, len(body) - len(unpacker.unused_data)


def _inflate(body: bytes) -> bytes:
    try:
        return zlib.decompressobj(_GZIP_WINDOW).decompress(body, MAX_UNPACKED_BYTES)
    except zlib.error:
        return b""
