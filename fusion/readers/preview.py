"""Facts about a recording before its analysis: from its first bytes, and from its samples as read."""

import io
import struct
import zlib
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.checks.physics import GyroModel, cut_windows, judge_frame, measure_miss, measure_scale
from acromion.fusion.checks.summary import find_rests
from acromion.fusion.clocks import format_offset
from acromion.fusion.conventions import is_sidecar
from acromion.fusion.errors import EmptyFile, FusionError, NoGyroscope, UnknownFormat
from acromion.fusion.readers import cwa, gt3x, read_recording
from acromion.fusion.readers.archive import PHYPHOX_FOLDER, TABLES, find_recordings
from acromion.fusion.readers.cwa import HEADER_BYTES, parse_header
from acromion.fusion.readers.gt3x import find_start, order_seconds, parse_device_text
from acromion.fusion.readers.source import GZIP_MAGIC, MAX_TEXT_BYTES, ZIP_MAGIC
from acromion.fusion.recording import MICROSECONDS, Recording, Span, find_missing

# Figures by which the maker of a logger sees whether axes, scales and clock of a recording are right.

Table = NDArray[np.float64]


def measure_sanity(recording: Recording) -> dict[str, object]:
    """Measure 1 g at rest, and the gyroscope's axes and scale, from the data.

    ``rest_g``: length of the acceleration at still moments, None without any. ``turns``: windows of 8 s in
    which gravity turned enough to tell something. ``handedness``: +1 wholly right-handed, -1 wholly
    left-handed, from how well the angular rate and its opposite explain the turns. ``axes``: the readings
    that explain them as rates about x, y and z, "+x +y +z" where all is right. ``gyro_scale``: the factor on
    the rates that explains slow ones best, 1 if it is right, give or take ``gyro_scale_margin`` (twice
    its standard error). Figures from turns are None if there are too few turns. The recording has already
    passed :mod:`acromion.fusion.checks.physics`; its corrections are among the warnings.
    """
    rests = find_rests(recording.segments)
    offset_dps = np.median(rests.gyr, axis=0) if len(rests) else np.zeros(3)
    return {
        "rest_g": round(rests.length, 4) if len(rests) else None,
        "gyro_offset_dps": [round(float(value), 3) for value in offset_dps],
        **_measure_turns(recording, offset_dps),
    }


def _measure_turns(recording: Recording, offset_dps: Table) -> dict[str, object]:
    windows = cut_windows(recording.segments)
    evidence = judge_frame(windows, offset_dps, (1.0,))
    if evidence is None:
        figures = ("handedness", "axes", "gyro_scale", "gyro_scale_margin", "unexplained_percent")
        return {"turns": 0, **dict.fromkeys(figures)}
    model = evidence.as_read.model
    turned = GyroModel(-model.gain, -model.drift_dps, model.offset_g)
    right, left = (float((measure_miss(windows, one) ** 2).sum()) for one in (model, turned))
    scale = measure_scale(windows, evidence.as_read, 1.0)
    return {
        "turns": evidence.lively,
        "handedness": round((left - right) / max(left + right, 1e-12), 3),
        "axes": None if evidence.is_doubtful else "+x +y +z" if evidence.chosen.factor > 0 else "-x -y -z",
        "gyro_scale": None if scale is None else round(scale.overall, 3),
        "gyro_scale_margin": None if scale is None else round(2.0 * scale.error, 3),
        "unexplained_percent": round(100.0 * evidence.as_read.score, 2),
    }


# The facts of `acromion inspect`: what the reader took the file for, and what is wrong with it.

MAX_GAPS = 100
"""The longest ones; the count is always given in full."""


def inspect_recording(recording: Recording, left_out: Sequence[Span] = ()) -> dict[str, object]:
    """A JSON-ready description of a recording, for the person and for the maker of a logger.

    ``recorded_s`` = ``present_s`` + ``missing_s``, to the microsecond; ``gaps`` are all holes, those of up
    to 50 ms too; ``samples`` counts the measured samples; ``excluded`` names time that the device itself
    says it did not measure, or not on the arm.

    ``left_out``: what an analysis will exclude; that is not missing, here as there.
    """
    holes = find_missing(recording.segments, recording.duration_us, (*recording.excluded, *left_out))
    gaps = sorted(holes, key=lambda gap: -gap.duration_us)
    bridged_rows = sum(stop - first for s in recording.segments for first, stop in s.bridged)
    missing_us = sum(gap.duration_us for gap in gaps)
    return {
        "device": recording.device,
        "sha256": recording.sha256,
        "serial_hash": recording.serial_hash,
        "start": recording.start.isoformat() if recording.start else None,
        "time_zone": recording.time_zone,
        "recorded_s": recording.duration_us / MICROSECONDS,
        "present_s": (recording.duration_us - missing_us) / MICROSECONDS,
        "missing_s": missing_us / MICROSECONDS,
        "rate_hz": round(recording.rate_hz, 4),
        "nominal_rate_hz": recording.stated.nominal_rate_hz,
        "jitter_us": None if recording.jitter_us is None else round(recording.jitter_us, 1),
        "samples": sum(len(segment) for segment in recording.segments) - bridged_rows,
        "segments": len(recording.segments),
        "gap_count": len(gaps),
        "gaps": [_describe_span(gap) for gap in gaps[:MAX_GAPS]],
        "excluded": [{**_describe_span(span), "reason": span.reason} for span in recording.excluded],
        "bridged_rows": bridged_rows,
        "counter_wraps": sum(flag.count for flag in recording.flags if flag.code == Caveat.WRAP),
        "sanity": measure_sanity(recording),
        "acc_range_g": recording.acc_range_g,
        "gyr_range_dps": recording.gyr_range_dps,
        "understood": dict(recording.understood),
        "warnings": [
            {
                "code": flag.code,
                "count": flag.count,
                "seconds": flag.seconds,
                "first_s": flag.first_s,
                "last_s": flag.last_s,
                "facts": dict(flag.facts),
            }
            for flag in recording.flags
        ],
    }


def _describe_span(span: Span) -> dict[str, object]:
    return {"start_s": span.start_us / MICROSECONDS, "length_s": span.duration_us / MICROSECONDS}


# The preview: what the first bytes of a file show while the rest is still being sent.

MAX_UNPACKED_BYTES = 8 << 20
_GZIP_WINDOW = 16 + zlib.MAX_WBITS
_LOCAL_HEADER = struct.Struct("<4s5H3I2H")  # APPNOTE 4.3.7: one before each member of a zip


@dataclass(frozen=True, slots=True)
class Preview:
    """Facts that the bytes received so far show; None for facts not known yet."""

    device: str | None = None
    rate_hz: float | None = None
    start: datetime | None = None
    time_zone: str | None = None
    serial_hash: str | None = None


def preview_head(head: bytes, file_name: str = "", rate_hz: float | None = None) -> Preview:
    """Preview a recording by the first bytes of its file.

    Raises UnknownFormat: the file is not a recording; a cut file is not refused.
    """
    if head.startswith(ZIP_MAGIC):
        return _preview_zip(head, rate_hz)
    if cwa.is_cwa(head):
        return _preview_cwa(head)
    if head.startswith(GZIP_MAGIC):
        content, _ = _inflate(head, _GZIP_WINDOW)
        return _preview_text(content, file_name.removesuffix(".gz"), rate_hz)
    return _preview_text(head, file_name, rate_hz)


def _preview_text(head: bytes, file_name: str, rate_hz: float | None) -> Preview:
    """Read the complete lines as if they were the whole file."""
    lines = head[: head.rfind(b"\n") + 1]
    try:
        recording = read_recording(io.BytesIO(lines), file_name=file_name, rate_hz=rate_hz, sha256="-")
    except (EmptyFile, NoGyroscope):
        return Preview()
    except UnknownFormat:
        raise
    except FusionError:  # too short, dead, without time: the rest may tell otherwise
        return Preview()
    return _summarise(recording)


def _preview_zip(head: bytes, rate_hz: float | None) -> Preview:
    every = dict(_unpack_members(head))
    members = {
        name: every[name] for name in every if not is_sidecar(name) and not name.startswith(PHYPHOX_FOLDER)
    }
    if {"info.txt", "log.bin"} & set(members):
        return _preview_gt3x(members)
    tables = [name for name in members if name.lower().endswith(TABLES)]
    heads = {name: members[name][:MAX_TEXT_BYTES].decode("utf-8", "replace") for name in tables}
    found = find_recordings(heads)
    packed = found[0].table if len(found) == 1 else "" if found else next(iter(tables), "")
    if not packed:
        return Preview()
    try:
        return _preview_text(members[packed], packed, rate_hz)
    except UnknownFormat:  # the first of several tables: the others are still on their way
        return Preview()


def _preview_cwa(head: bytes) -> Preview:
    """Read the blocks received; if the gyroscope is off in the first, it is off in all."""
    try:
        log = cwa.decode_log([head[HEADER_BYTES:]])
        if not log.columns.rows:
            log.refuse_unusable()
        return _summarise(cwa.build_recording(parse_header(head), log))
    except NoGyroscope:
        raise
    except FusionError:
        return Preview(device="ax6")


def _preview_gt3x(members: dict[str, bytes]) -> Preview:
    """Read the received part of the log; without it, read info.txt (it may be the last member)."""
    text = parse_device_text(members.get("info.txt", b"")[:MAX_TEXT_BYTES])
    with suppress(FusionError):
        log = gt3x.decode_log([members.get("log.bin", b"")])
        log.refuse_unusable()
        timeline = order_seconds(log.seconds(), log.columns.acc, log.columns.gyr)
        return _summarise(gt3x.build_recording(text, log, timeline))
    if not text.values:
        return Preview()
    unix_s, start = text.unix_s("Start Date"), None
    with suppress(OverflowError, ValueError):  # no time of the calendar
        start = None if unix_s is None else find_start(int(unix_s), text.offset_s, counts_utc=False)
    zone = None if text.offset_s is None else format_offset(text.offset_s)
    return Preview("gt9x", None, start, zone, text.serial_hash)


def _summarise(recording: Recording) -> Preview:
    return Preview(
        recording.device,
        round(recording.rate_hz, 4),
        recording.start,
        recording.time_zone,
        recording.serial_hash,
    )


def _unpack_members(head: bytes) -> Iterator[tuple[str, bytes]]:
    """Unpack the members in the head, and the received part of the last one."""
    at = 0
    while head[at : at + 4] == ZIP_MAGIC and at + _LOCAL_HEADER.size <= len(head):
        _, _, flags, method, _, _, _, packed, _, name_bytes, extra_bytes = _LOCAL_HEADER.unpack_from(head, at)
        name_at = at + _LOCAL_HEADER.size
        first = name_at + name_bytes + extra_bytes
        name = head[name_at : name_at + name_bytes].decode("utf-8", "replace")
        sizes_follow = bool(flags & 0x8)  # then only the packed stream itself says where it ends
        body = head[first:] if sizes_follow else head[first : first + packed]
        content, used = (body, len(body)) if method == 0 else _inflate(body, -zlib.MAX_WBITS)
        yield name, content
        at = first + (used + (16 if sizes_follow else 0))


def _inflate(body: bytes, window_bits: int) -> tuple[bytes, int]:
    """Unpack the received part; return it and the bytes used. A broken one is empty: it is judged later."""
    unpacker = zlib.decompressobj(window_bits)
    try:
        content = unpacker.decompress(body, MAX_UNPACKED_BYTES)
    except zlib.error:
        return b"", len(body)
    return content, len(body) - len(unpacker.unused_data)
