"""ActiGraph GT9X Link `.gt3x` with IMU records.

Sources: actigraph/GT3X-File-Format (records, schema); the time rule was measured against ActiLife 6.13.3.
Compared to ActiLife: all n rows of a second are kept, at T + k/n, and lie on one even grid over unbroken
seconds; ActiLife resamples every second to exactly 100 rows. Nothing is filled where records are missing.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta, timezone
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import DamagedFile, MissingMember, NoGyroscope, NoSamples, UnknownColumns
from fusion.numerics.intervals import find_uncovered, join_overlapping
from fusion.readers.archives import check_parts, is_archive, open_archive, read_member, read_text
from fusion.readers.gt3x.clock import LONGEST_GAP_S, Run, Seconds, Timeline, order_seconds
from fusion.readers.gt3x.records import (
    ACTIVITY,
    ACTIVITY2,
    BATTERY,
    EVENT,
    FRAME_BYTES,
    METADATA,
    SCHEMA,
    SENSOR_DATA,
    TALLY_PLACES,
    DeviceEvents,
    RowDecoder,
    ScanTally,
    make_decoder,
    pair_sleep,
    parse_schema,
    scan_records,
    summarise_tally,
)
from fusion.readers.samples import SampleColumns
from fusion.readers.source import EARLY_END_S, MAX_DAMAGED_PERCENT, Source, scan_pieces
from fusion.readers.timebase.clock import (
    find_zone,
    flag_drift,
    follow_zone,
    format_offset,
    hash_serial,
    parse_offset_s,
    trust_clock,
)
from fusion.recording import (
    MICROSECONDS,
    QualityFlag,
    Recording,
    Segment,
    Span,
    Stated,
    flag_counts,
    flag_gaps,
    flag_spans,
)
from fusion.still_limits import BOTH_ACCELEROMETERS

WATCHED = (ACTIVITY, BATTERY, EVENT, METADATA, SCHEMA, SENSOR_DATA, ACTIVITY2)
MAX_HELD_RECORDS = 512
"""Samples that come before their schema are kept for it; more of them mean that it is missing, not late."""


def recognise(source: Source) -> bool:
    """Whether the bytes are a zip."""
    return is_archive(source.file, source.head)


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the log tells its rate)
    """Read the IMU of a GT9X Link.

    Raises
    ------
    fusion.errors.UnreadableFile
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
        log = decode_log(read_member(archive, "log.bin"), member.file_size, to_log_end)
    log.refuse_unusable()
    timeline = order_seconds(log.seconds(), log.columns.acc, log.columns.gyr)
    return build_recording(text, log, timeline)


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
        """A number with decimal point or comma, or None: `8,0` and `100 Hz` are understood."""
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
    """Give the device's clock at the first sample.

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
    """What log.bin holds, gathered piece by piece.

    ``columns``: the samples of all decoded records, in g and deg/s.
    ``decoded``: where the samples of each batch of records lie.
    ``decoder``: the schema in force; None before the first, and where it has no usable channels.
    ``labels``: of the columns of all schemas.
    ``n_undecoded``: SENSOR_DATA records that no schema fits.
    ``held``: Unix seconds and payloads of samples that came before the first schema.
    ``primary_seconds``: those of the primary accelerometer that were looked at.
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

    @property
    def scan(self) -> ScanTally:
        """What the scan met."""
        return summarise_tally(self.tally)

    def seconds(self) -> Seconds:
        """Join the decoded SENSOR_DATA records, in the order of the file."""
        names = Seconds.__slots__
        return Seconds(*(np.concatenate([getattr(part, name) for part in self.decoded]) for name in names))

    def refuse_unusable(self) -> None:
        """Raise where no sample can be trusted."""
        scan = self.scan
        damaged_percent = 100.0 * scan.damaged_bytes / max(1, self.n_bytes)
        if damaged_percent > MAX_DAMAGED_PERCENT:
            clock = datetime.fromtimestamp(scan.first_damage_unix_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
            raise DamagedFile(p=round(damaged_percent, 1), clock=clock)
        if self.columns.rows:
            return
        if self.n_undecoded and not self.labels:
            raise MissingMember(member="SENSOR_SCHEMA")
        if self.n_undecoded and self.decoder is not None:
            raise DamagedFile(p=100.0)
        if self.n_undecoded:
            raise UnknownColumns(list=", ".join(sorted(self.labels)))
        if scan.records == 0:
            raise NoSamples
        raise NoGyroscope(cure="GT9X")


def decode_log(pieces: Iterable[bytes], size_bytes: int = 0, source: Source | None = None) -> DeviceLog:
    """Scan and decode log.bin in one pass over its pieces.

    Parameters
    ----------
    pieces
        The bytes of log.bin.
    size_bytes
        Its size by the archive's directory, from which the room for the samples is estimated.
    source
        The file up to the end of log.bin, where too many rows are to be refused.
    """
    log = DeviceLog(SampleColumns(source, has_stamps=False))
    to_come = size_bytes

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
            log.columns.foresee(len(buffer), to_come)
            to_come = 0
    log.columns.trim()
    return log


def _take_records(log: DeviceLog, buffer: NDArray[np.uint8], records: NDArray[np.int64]) -> None:
    """Take records of which only the first may be a schema: then all samples are of one schema."""
    is_sample = records[:, 0] == SENSOR_DATA
    for kind, unix_s, first, size in records[~is_sample].tolist():
        payload = buffer[first : first + size].tobytes()
        if kind == SCHEMA:
            _take_schema(log, payload)
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
    """Decode the records that are of the decoder's schema and hold whole rows."""
    firsts, sizes = records[:, 2], records[:, 3]
    n_rows, odd_bytes = np.divmod(sizes - 2, decoder.schema.row_bytes)
    fits = (sizes >= 2) & (n_rows > 0) & (odd_bytes == 0)
    fits[fits] = decoder.find_own(buffer, firsts[fits])
    log.n_undecoded += int(np.count_nonzero(~fits))
    unix_s, firsts, n_rows = records[fits, 1], firsts[fits], n_rows[fits]
    columns = log.columns
    stops = columns.rows + np.cumsum(n_rows)
    rows = columns.extend(int(n_rows.sum()))
    decoder.decode(buffer, firsts + 2, n_rows, (columns.acc[rows], columns.gyr[rows]))
    log.decoded.append(Seconds(unix_s, stops - n_rows, n_rows, np.full(len(unix_s), log.n_schemas)))


# From the log to a recording: segments, exclusions, the clock.


def build_recording(text: DeviceText, log: DeviceLog, timeline: Timeline) -> Recording:
    """Put segments, exclusions and caveats together."""
    segments = tuple(_make_segment(log.columns, timeline.seconds, run) for run in timeline.runs)
    excluded, asides = find_exclusions(log, timeline)
    duration_us = max([segments[-1].end_us, *(span.end_us for span in excluded)])
    moment, changes = _find_clock(text, log, timeline)
    start, unset = trust_clock(moment)
    decoder = log.decoder
    return Recording(
        device="gt9x",
        sha256="",
        start=start,
        time_zone=None if text.offset_s is None else format_offset(text.offset_s),
        duration_us=duration_us,
        segments=segments,
        excluded=excluded,
        flags=(
            *flag_file(text, log, timeline, segments),
            *timeline.flags,
            *changes,
            *asides,
            *unset,
            *flag_spans(Caveat.SLEEP, [span for span in excluded if span.reason == "asleep"]),
            *flag_spans(Caveat.DOCKED, [span for span in excluded if span.reason == "docked"]),
            *flag_gaps(segments, duration_us, excluded),
        ),
        understood=_describe(text, log, timeline),
        stated=Stated(is_known=True),
        serial_hash=text.serial_hash,
        acc_range_g=_full_scale(decoder, 0),
        gyr_range_dps=_full_scale(decoder, 3),
    )


def _find_clock(
    text: DeviceText, log: DeviceLog, timeline: Timeline
) -> tuple[datetime, tuple[QualityFlag, ...]]:
    """Find the clock at the first sample, in the file's zone where it counts UTC and names one."""
    first_unix_s = int(timeline.seconds.unix_s[0])
    zone = find_zone(log.events.zone_name) if log.events.counts_utc else None
    if zone is None:
        return find_start(first_unix_s, text.offset_s, counts_utc=log.events.counts_utc), ()
    return follow_zone(first_unix_s, timeline.runs[-1].end_s, zone)


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
    """Idle sleep where nothing was measured, and seconds in the dock, from the first sample on.

    Also returns caveats without an exclusion: sleep before the first sample, and a stamp more than a day
    after the last sample, which is ignored.
    """
    covered = [(run.start_s, run.end_s) for run in timeline.runs]
    end_s = max(covered[-1][1], timeline.place_s(log.scan.last_unix_s))
    asides: tuple[QualityFlag, ...] = ()
    if end_s - covered[-1][1] > LONGEST_GAP_S:
        end_s = covered[-1][1]
        asides += (QualityFlag(Caveat.CLOCK_FWD, 1, 0.0, float(end_s), float(end_s)),)
    seconds = {place for place in map(timeline.place_s, log.events.docked_s) if 0 <= place < end_s}
    docked = join_overlapping((second, second + 1) for second in seconds)
    asleep: list[tuple[int, int]] = []
    for start_unix_s, end_unix_s in pair_sleep(log.events.sleep, log.scan.last_unix_s):
        early_s = -timeline.place_s(start_unix_s)
        if 0 < early_s <= LONGEST_GAP_S:
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
    planned_s, last_s = text.unix_s("Stop Date"), float(timeline.seconds.unix_s[-1] + 1)
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
    """Where header, nominal rate and the two accelerometers contradict each other."""
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
