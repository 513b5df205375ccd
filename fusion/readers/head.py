"""What the first bytes of a recording tell while the rest is still on its way."""

import io
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime

from fusion.errors import EmptyFile, FusionError, NoGyroscope, UnknownFormat
from fusion.readers import gt3x, read_recording
from fusion.readers.gt3x_archive import MAX_TEXT_BYTES
from fusion.readers.gt3x_clock import order_seconds
from fusion.readers.gt3x_info import DeviceText, name_offset, parse_device_text, tell_start
from fusion.readers.unpacking import GZIP_MAGIC, ZIP_MAGIC
from fusion.recording import Recording

MAX_UNPACKED_BYTES = 8 << 20
_GZIP_WINDOW = 16 + zlib.MAX_WBITS
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")  # APPNOTE 4.3.7: one before each member of a zip


@dataclass(frozen=True, slots=True)
class HeadFacts:
    """What could be told so far; None: not yet."""

    device: str | None = None
    rate_hz: float | None = None
    start: datetime | None = None
    time_zone: str | None = None
    serial_hash: str | None = None


def inspect_head(head: bytes, file_name: str = "", rate_hz: float | None = None) -> HeadFacts:
    """Say what the first bytes of a file show.

    Raises
    ------
    UnknownFormat
        The file is something else than a recording; that it is cut is no reason.
    """
    if head.startswith(ZIP_MAGIC):
        return _inspect_zip(head, rate_hz)
    if head.startswith(GZIP_MAGIC):
        return _inspect_text(_inflate(head), file_name.removesuffix(".gz"), rate_hz)
    return _inspect_text(head, file_name, rate_hz)


def _inspect_text(head: bytes, file_name: str, rate_hz: float | None) -> HeadFacts:
    """Read the whole lines as if they were the file."""
    lines = head[: head.rfind(b"\n") + 1]
    try:
        return _tell(read_recording(io.BytesIO(lines), file_name=file_name, rate_hz=rate_hz, sha256="-"))
    except (EmptyFile, NoGyroscope):
        return HeadFacts()
    except UnknownFormat:
        raise
    except FusionError:  # too short, dead, without time: the rest may tell otherwise
        return HeadFacts()


def _inspect_zip(head: bytes, rate_hz: float | None) -> HeadFacts:
    members = dict(_list_members(head))
    if {"info.txt", "log.bin"} & set(members):
        return _inspect_gt3x(members)
    packed = next((name for name in members if name.lower().endswith((".csv", ".txt"))), None)
    return _inspect_text(members[packed], packed, rate_hz) if packed else HeadFacts()


def _inspect_gt3x(members: dict[str, bytes]) -> HeadFacts:
    """Read the log as far as it came (info.txt may be the last member); else what info.txt says."""
    text = parse_device_text(members.get("info.txt", b"")[:MAX_TEXT_BYTES])
    with suppress(FusionError):
        log = gt3x.decode_log([members.get("log.bin", b"")])
        log.refuse_unusable()
        timeline = order_seconds(log.seconds(), log.columns.acc, log.columns.gyr)
        return _tell(gt3x.build_recording(text, log, timeline))
    return _tell_device(text) if text.values else HeadFacts()


def _tell_device(text: DeviceText) -> HeadFacts:
    start_unix_s = text.unix_s("Start Date")
    start = None
    if start_unix_s is not None:
        start = tell_start(int(start_unix_s), text.offset_s, counts_utc=False)
    zone = None if text.offset_s is None else name_offset(text.offset_s)
    return HeadFacts("gt9x", None, start, zone, text.serial_hash)


def _tell(recording: Recording) -> HeadFacts:
    rate_hz = round(recording.rate_hz, 4)
    return HeadFacts(recording.device, rate_hz, recording.start, recording.time_zone, recording.serial_hash)


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
