"""Axivity AX6 `.cwa`: accelerometer and gyroscope, in blocks with a stamp of the device's clock each.

Source: Open Movement, Docs/ax3/cwa.h and ax3-technical.md. Compared to the readers that were looked at
(openmovement, actipy, scikit-digital-health): a block whose checksum fails is missing time, never samples and
never closed up with its neighbours; the true rate is measured; nothing is resampled.
"""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import DamagedFile, NoGyroscope, NoSamples, UnknownColumns
from fusion.readers.cwa.blocks import (
    BAD_CHECKSUMS,
    BLOCK_BYTES,
    BLOCK_HEAD,
    DAMAGED_BYTES,
    FIRST_DAMAGE,
    HEAD_BYTES,
    LAST_DAMAGE,
    RESYNCS,
    SAMPLE_BYTES,
    TAIL_BYTES,
    TALLY_PLACES,
    is_block,
    scan_blocks,
    take_samples,
)
from fusion.readers.cwa.clock import Blocks, cut_blocks, nominal_hz, order_blocks
from fusion.readers.samples import SampleColumns
from fusion.readers.source import EARLY_END_S, MAX_DAMAGED_PERCENT, Source, read_chunks, scan_pieces
from fusion.readers.timebase.clock import datetime_at_us, flag_drift, hash_serial, trust_clock
from fusion.readers.timebase.grid import Grid
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Stated, flag_counts

# The header of a `.cwa`: the device, and its planned end. Names of people in it are not read.

HEADER_BYTES = 1024
MAGIC = b"MD\xfc\x03"
AX6 = 0x64
_FIELDS = struct.Struct("<4xBHIHII")  # hardware, device id, session, upper half of the id, start, stop
_UNSET = 0xFFFF
FIRST_YEAR = 2000


@dataclass(frozen=True, slots=True)
class DeviceHeader:
    """The facts of the header, if it is not lost. ``planned_end_s``: Unix seconds, None for no plan."""

    is_ax6: bool = False
    device_id: int = 0
    session: int = 0
    planned_end_s: int | None = None

    @property
    def serial_hash(self) -> str | None:
        """SHA-256 of the device's number, first 12 hexadecimal digits."""
        return hash_serial(str(self.device_id)) if self.device_id else None


def parse_header(head: bytes) -> DeviceHeader:
    """Read the header at the beginning of a file."""
    if not head.startswith(MAGIC) or len(head) < HEADER_BYTES:
        return DeviceHeader()
    hardware, lower, session, upper, _, stop = _FIELDS.unpack_from(head)
    device_id = lower | (0 if upper == _UNSET else upper << 16)
    planned_s = int(unpack_stamps(np.array([stop], np.uint32))[0])
    return DeviceHeader(hardware == AX6, device_id, session, planned_s if planned_s >= 0 else None)


def unpack_stamps(packed: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Unix seconds of the device's own clock from its packed dates; -1 where they are none.

    From the highest bit: six of years since 2000, four of the month, five of the day, five of the hour, six
    of the minute, six of the second.
    """
    fields = [(packed >> shift) & ((1 << bits) - 1) for shift, bits in _STAMP_FIELDS]
    years, months, days, hours, minutes, seconds = (field.astype(np.int64) for field in fields)
    month = ((years + FIRST_YEAR - 1970) * 12 + months - 1).astype("datetime64[M]")
    date = month.astype("datetime64[D]") + (days - 1)
    is_date = (months >= 1) & (months <= 12) & (days >= 1) & (date.astype("datetime64[M]") == month)
    is_time = (hours < 24) & (minutes < 60) & (seconds < 60)
    unix_s = date.astype(np.int64) * 86_400 + hours * 3600 + minutes * 60 + seconds
    return np.where(is_date & is_time, unix_s, -1)


_STAMP_FIELDS = ((26, 6), (22, 4), (17, 5), (12, 5), (6, 6), (0, 6))


INERTIAL_AXES = (6, 9)
"""Gyroscope and accelerometer; the same and a magnetometer."""
PLAIN_AXES = 3
WORDS = 2
"""The packing of samples in words of 16 bits."""
HAS_FRACTION, FRACTION_BITS = 0x8000, 0x7FFF
FULL_COUNT = 32_768.0
WIDEST_G = 16.0
USUAL_RANGE_CODE = 2
"""2000 deg/s, where a block does not tell the gyroscope's range."""


def recognise(source: Source) -> bool:
    """Whether the file begins with the header of a `.cwa`, or has a sound block where the first one lies."""
    return is_cwa(source.head)


def is_cwa(head: bytes) -> bool:
    """As :func:`recognise`, by the first bytes."""
    first = np.frombuffer(head[: HEADER_BYTES + BLOCK_BYTES], np.uint8)
    return head.startswith(MAGIC) or is_block(first, HEADER_BYTES)


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the blocks tell it)
    """Read accelerometer and gyroscope of an AX6.

    Raises
    ------
    fusion.errors.UnreadableFile
        The gyroscope was off (or it is an AX3), or more than 5 % of the file is damaged.
    NoSamples, fusion.errors.UnusableTime, fusion.errors.UnknownRate
    """
    log = decode_log(read_chunks(source, HEADER_BYTES), source.size_bytes, source)
    log.refuse_unusable()
    return build_recording(parse_header(source.head), log)


@dataclass(slots=True)
class BlockLog:
    """What the blocks hold, gathered piece by piece; ``heads`` of those with samples, shape (n,)."""

    columns: SampleColumns = field(default_factory=lambda: SampleColumns(has_stamps=False))
    tally: NDArray[np.int64] = field(default_factory=lambda: np.zeros(TALLY_PLACES, np.int64))
    parts: list[NDArray[np.void]] = field(default_factory=list)
    n_bytes: int = 0
    n_plain: int = 0
    n_unknown: int = 0

    @property
    def heads(self) -> NDArray[np.void]:
        """The heads of all blocks that were decoded, in the order of the file."""
        return np.concatenate(self.parts) if self.parts else np.empty(0, BLOCK_HEAD)

    def refuse_unusable(self) -> None:
        """Raise where no sample can be trusted."""
        damaged_percent = 100.0 * float(self.tally[DAMAGED_BYTES]) / max(1, self.n_bytes)
        if damaged_percent > MAX_DAMAGED_PERCENT:
            before = unpack_stamps(self.heads["stamp"][: int(self.tally[FIRST_DAMAGE])])
            clock = datetime_at_us(int(before[-1]) * MICROSECONDS) if len(before) else None
            known = {} if clock is None else {"clock": clock.strftime("%Y-%m-%d %H:%M:%S")}
            raise DamagedFile(p=round(damaged_percent, 1), **known)
        if self.columns.rows:
            return
        if self.n_plain:
            raise NoGyroscope(cure="AX6")
        if self.n_unknown:
            raise UnknownColumns(list="CWA")
        raise NoSamples


def decode_log(pieces: Iterable[bytes], size_bytes: int = 0, source: Source | None = None) -> BlockLog:
    """Find and decode the blocks in one pass over what follows the header.

    Parameters
    ----------
    pieces
        The bytes after the header.
    size_bytes
        Of the file, from which the room for the samples is estimated.
    source
        What the pieces come from, where too many rows are to be refused.
    """
    log = BlockLog(SampleColumns(source, has_stamps=False))
    to_come = size_bytes

    def scan(buffer: NDArray[np.uint8], is_last: bool) -> tuple[int, NDArray[np.int64]]:  # noqa: FBT001
        starts = np.empty(len(buffer) // BLOCK_BYTES + 1, np.int64)
        used, found = scan_blocks(buffer, is_last, starts, log.tally)
        log.n_bytes += len(buffer) if is_last else used
        return used, starts[:found]

    for buffer, starts in scan_pieces(pieces, scan):
        rows_of_bytes = buffer[starts[:, np.newaxis] + np.arange(HEAD_BYTES)]
        heads = np.ascontiguousarray(rows_of_bytes).reshape(-1).view(BLOCK_HEAD)
        axes, rows = (heads["axes"] >> 4).astype(np.int64), heads["count"].astype(np.int64)
        is_inertial = np.isin(axes, INERTIAL_AXES) & (heads["axes"] & 0xF == WORDS)
        fits = is_inertial & (rows > 0) & (rows * axes * 2 <= SAMPLE_BYTES)
        log.n_plain += int(np.count_nonzero(axes == PLAIN_AXES))
        log.n_unknown += int(np.count_nonzero(~fits & (rows > 0) & (axes != PLAIN_AXES)))
        columns = log.columns
        room = columns.extend(int(rows[fits].sum()))
        layouts = np.stack([rows[fits], axes[fits]], axis=1)
        scales = np.stack(find_ranges(heads[fits]), axis=1) / np.float32(FULL_COUNT)
        take_samples(buffer, starts[fits], layouts, scales, (columns.acc[room], columns.gyr[room]))
        log.parts.append(heads[fits])
        if columns.rows and to_come:
            columns.foresee(len(buffer), to_come)
            to_come = 0
    log.columns.trim()
    return log


def find_ranges(heads: NDArray[np.void]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """What 32,768 counts are in each block, g and deg/s.

    The upper three bits n beside the light sensor's: 2^(8 + n) counts are 1 g; the next three: 8000/2^n deg/s
    are the full scale.
    """
    acc_code, gyr_code = heads["scales"] >> 13, (heads["scales"] >> 10) & 7
    gyr_code = np.where(gyr_code == 0, USUAL_RANGE_CODE, gyr_code)
    acc_range_g = (FULL_COUNT / 2.0 ** (8.0 + acc_code)).astype(np.float32)
    return acc_range_g, (8000.0 / 2.0**gyr_code).astype(np.float32)


def build_blocks(heads: NDArray[np.void]) -> Blocks:
    """Give the numbers of decoded blocks, and the row at which each one's stamp holds.

    The stamp's fraction came later than its whole seconds: for older readers the row was moved to where the
    whole second would be at the nominal rate. That is undone.
    """
    rate_code = (heads["rate"] & 0xF).astype(np.int64)
    has_fraction = heads["fraction"] & HAS_FRACTION != 0
    fraction = np.where(has_fraction, heads["fraction"] & FRACTION_BITS, 0).astype(np.int64)
    moved = (2 * fraction * nominal_hz(rate_code).astype(np.int64)) >> 16
    stamp_s = unpack_stamps(heads["stamp"])
    anchor_us = stamp_s * MICROSECONDS + fraction * MICROSECONDS // HAS_FRACTION
    rows = heads["count"].astype(np.int64)
    return Blocks(
        first_row=np.cumsum(rows) - rows,
        n_rows=rows,
        session=heads["session"].astype(np.int64),
        sequence=heads["sequence"].astype(np.int64),
        rate_code=rate_code,
        anchor_us=np.where(stamp_s >= 0, anchor_us, -1),
        anchor_row=heads["offset"].astype(np.int64) + moved,
    )


def build_recording(header: DeviceHeader, log: BlockLog) -> Recording:
    """Put segments and caveats together."""
    heads = log.heads
    laid = build_blocks(heads)
    blocks, mended = order_blocks(laid, log.columns, header.session)
    grid, started_us = cut_blocks(blocks, log.columns)
    start, unset = trust_clock(None if started_us is None else datetime_at_us(started_us))
    if started_us is None:  # the time rests on the header's rate alone
        rate_hz = round(MICROSECONDS / grid.period_us, 3)
        rate = QualityFlag(Caveat.RATE, facts={"rate_hz": rate_hz, "rate_from": "header"})
        unset = (QualityFlag(Caveat.CLOCK_UNSET), rate)
    acc_ranges_g, gyr_ranges_dps = find_ranges(heads)
    rates_hz: list[float] = np.unique(nominal_hz(blocks.rate_code)).tolist()
    return Recording(
        device="ax6" if header.is_ax6 or not header.device_id else "other",
        sha256="",
        start=start,
        time_zone=None,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(
            *flag_damage(log, laid, grid),
            *mended,
            *flag_plan(header, blocks, grid, started_us),
            *unset,
            *grid.flags,
        ),
        understood={
            "layout": "Axivity AX6 .cwa",
            "columns": "gyroscope, accelerometer",
            "units": "g, deg/s",
            "units_from": "header",
            "nominal_rate_hz": f"{rates_hz[0]:g}" if len(rates_hz) == 1 else "",
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(int(blocks.n_rows.sum())),
            "records": str(len(blocks)),
            "clock": "local",
        },
        stated=Stated(is_known=True),
        serial_hash=header.serial_hash,
        acc_range_g=min(WIDEST_G, float(acc_ranges_g.min())),
        gyr_range_dps=float(gyr_ranges_dps.min()),
    )


def flag_damage(log: BlockLog, blocks: Blocks, grid: Grid) -> tuple[QualityFlag, ...]:
    """Blocks that do not verify, with the place of the first and the last, and a tail that is cut off."""
    end_s = grid.duration_us / MICROSECONDS
    places = [int(log.tally[place]) - 1 for place in (FIRST_DAMAGE, LAST_DAMAGE)]
    stamps_us = blocks.anchor_us[np.clip(places, 0, len(blocks) - 1)] - blocks.anchor_us[0]
    first_s, last_s = np.clip(stamps_us / MICROSECONDS, 0.0, end_s).tolist()
    counts = {
        Caveat.CHECKSUM: int(log.tally[BAD_CHECKSUMS]),
        Caveat.RESYNC: int(log.tally[RESYNCS]),
        Caveat.ROWS_DROPPED: log.n_plain + log.n_unknown,
    }
    flags = flag_counts(counts, first_s, last_s)
    tail_bytes = int(log.tally[TAIL_BYTES])
    if tail_bytes:
        flags += (QualityFlag(Caveat.TRUNC_TAIL, 1, 0.0, end_s, end_s, {"n": tail_bytes}),)
    return flags


def flag_plan(
    header: DeviceHeader, blocks: Blocks, grid: Grid, started_us: int | None
) -> tuple[QualityFlag, ...]:
    """Flag a recording that ends before its planned end, or has another rate than the one set."""
    flags: tuple[QualityFlag, ...] = ()
    if header.planned_end_s is not None and started_us is not None:
        early_s = header.planned_end_s - (started_us + grid.duration_us) / MICROSECONDS
        flags += (QualityFlag(Caveat.EARLY_END),) if early_s > EARLY_END_S else ()
    rate_hz = max(grid.segments, key=len).rate_hz
    rates_hz: list[float] = nominal_hz(np.unique(blocks.rate_code)).tolist()
    set_hz = min(rates_hz, key=lambda one_hz: abs(one_hz - rate_hz))
    return flags + flag_drift(set_hz, rate_hz)
