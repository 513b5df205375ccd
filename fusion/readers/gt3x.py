"""ActiGraph GT9X Link `.gt3x` with IMU records.

Sources: actigraph/GT3X-File-Format (records, schema); the time rule was measured against ActiLife 6.13.3.
Compared to ActiLife: all n rows of a second are kept, at T + k/n, and lie on one even grid over unbroken
seconds; ActiLife resamples every second to exactly 100 rows. Nothing is filled where records are missing.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fusion.errors import DamagedFile, NoGyroscope, TooShort, UnknownColumns
from fusion.readers import gt3x_archive, gt3x_events
from fusion.readers.gt3x_caveats import flag_file
from fusion.readers.gt3x_clock import LONGEST_GAP_S, Run, Seconds, Timeline, order_seconds
from fusion.readers.gt3x_events import (
    ACTIVITY,
    ACTIVITY2,
    BATTERY,
    EVENT,
    METADATA,
    SCHEMA,
    SENSOR_DATA,
    DeviceEvents,
)
from fusion.readers.gt3x_info import DeviceText, name_offset, parse_device_text, tell_start
from fusion.readers.gt3x_log import (
    TALLY_PLACES,
    ScannedPiece,
    ScanTally,
    scan_pieces,
    summarise_tally,
)
from fusion.readers.gt3x_primary import PROBED_EVERY_S, ROW_BYTES, PrimarySecond, PrimarySeconds
from fusion.readers.gt3x_schema import RowDecoder, make_decoder, parse_schema
from fusion.readers.samples import SampleColumns
from fusion.readers.source import Source
from fusion.readers.timing import flag_gaps, flag_spans, trust_clock
from fusion.readers.zones import find_zone, follow_zone
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Segment, Span

WATCHED = (ACTIVITY, BATTERY, EVENT, METADATA, SCHEMA, SENSOR_DATA, ACTIVITY2)
MAX_DAMAGED_PERCENT = 5.0
MAX_HELD_RECORDS = 512
"""Samples that come before their schema wait for it; more than that is no late schema but a missing one."""


def recognise(source: Source) -> bool:
    """Whether the bytes are a zip."""
    return gt3x_archive.is_archive(source.file, source.head)


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the log tells its rate)
    """Read the IMU of a GT9X Link.

    Raises
    ------
    fusion.errors.UnreadableFile
        The archive is cut, corrupt or unsafe, parts are missing, there is no gyroscope, or more than 5 % of
        the records are damaged.
    TooShort
        No second of samples.
    """
    with gt3x_archive.open_archive(source) as archive:
        gt3x_archive.check_parts(archive)
        text = parse_device_text(gt3x_archive.read_text(archive, "info.txt"))
        member = archive.getinfo("log.bin")
        told = replace(source, size_bytes=member.header_offset + member.compress_size)
        log = decode_log(gt3x_archive.read_member(archive, "log.bin"), member.file_size, told)
    log.refuse_unusable()
    timeline = order_seconds(log.seconds(), log.columns.acc, log.columns.gyr)
    return build_recording(text, log, timeline)


@dataclass(slots=True)
class DeviceLog:
    """What log.bin holds, gathered piece by piece."""

    columns: SampleColumns = field(default_factory=lambda: SampleColumns(has_stamps=False))
    events: DeviceEvents = field(default_factory=DeviceEvents)
    tally: NDArray[np.int64] = field(default_factory=lambda: np.zeros(TALLY_PLACES, np.int64))
    placed: list[tuple[int, int, int, int]] = field(default_factory=list)
    decoder: RowDecoder | None = None
    labels: set[str] = field(default_factory=set)
    n_bytes: int = 0
    n_schemas: int = 0
    n_undecoded: int = 0
    held: list[tuple[int, bytes]] = field(default_factory=list)
    primary: PrimarySeconds = field(default_factory=PrimarySeconds)

    @property
    def scan(self) -> ScanTally:
        """What the scan met."""
        return summarise_tally(self.tally)

    @property
    def primary_seconds(self) -> Sequence[PrimarySecond]:
        """Seconds of the primary accelerometer that were looked at."""
        return self.primary.seen

    def seconds(self) -> Seconds:
        """The decoded SENSOR_DATA records in the order of the file."""
        return Seconds(*np.array(self.placed, np.int64).reshape(-1, 4).T)

    def refuse_unusable(self) -> None:
        """Raise where no sample can be trusted."""
        scan = self.scan
        damaged_percent = 100.0 * scan.damaged_bytes / max(1, self.n_bytes)
        if damaged_percent > MAX_DAMAGED_PERCENT:
            clock = datetime.fromtimestamp(scan.first_damage_unix_s, UTC).strftime("%Y-%m-%d %H:%M:%S")
            raise DamagedFile(p=round(damaged_percent, 1), clock=clock)
        if self.placed:
            return
        if self.n_undecoded:
            raise UnknownColumns(list=", ".join(sorted(self.labels)) or "SENSOR_SCHEMA")
        if scan.records == 0:
            raise TooShort(s=0.0)
        raise NoGyroscope(cure="GT9X")


def decode_log(pieces: Iterable[bytes], size_bytes: int = 0, source: Source | None = None) -> DeviceLog:
    """Scan and decode log.bin in one pass over its pieces.

    ``size_bytes``: how long it says it is; the room that samples will take is foreseen from that.
    ``source``: the file up to the end of log.bin, where too many rows are to be refused.
    """
    log = DeviceLog(SampleColumns(source, has_stamps=False))
    to_come = size_bytes
    for piece in scan_pieces(_count_bytes(pieces, log), log.tally):
        records = _watched_records(piece)
        schemas = np.flatnonzero(records[:, 0] == SCHEMA)
        for part in np.split(records, schemas):  # each but the first begins with a schema
            _take_records(log, piece.buffer, part)
        if log.columns.rows and to_come:
            log.columns.foresee(len(piece.buffer), to_come)
            to_come = 0
    log.columns.trim()
    return log


def _count_bytes(pieces: Iterable[bytes], log: DeviceLog) -> Iterator[bytes]:
    for piece in pieces:
        log.n_bytes += len(piece)
        yield piece


def _watched_records(piece: ScannedPiece) -> NDArray[np.int64]:
    kinds, sizes = piece.records[:, 0], piece.records[:, 3]
    is_watched = np.isin(kinds, WATCHED)
    # of the primary accelerometer its one-byte dock events are read, and a second now and then
    is_activity = ((kinds == ACTIVITY) | (kinds == ACTIVITY2)) & (sizes != 1)
    is_probed = (kinds == ACTIVITY2) & (sizes >= ROW_BYTES) & (piece.records[:, 1] % PROBED_EVERY_S == 0)
    return np.asarray(piece.records[is_watched & (~is_activity | is_probed)])


def _take_records(log: DeviceLog, buffer: NDArray[np.uint8], records: NDArray[np.int64]) -> None:
    """Take records of which only the first may be a schema: then all samples are of one schema."""
    is_sample = records[:, 0] == SENSOR_DATA
    for kind, unix_s, first, size in records[~is_sample].tolist():
        payload = buffer[first : first + size].tobytes()
        if kind == SCHEMA:
            _take_schema(log, payload)
        elif size > 1 and kind == ACTIVITY2:
            log.primary.note(unix_s, payload)
        else:
            log.events.note(kind, unix_s, payload)
    if log.decoder is None:
        _hold_samples(log, buffer, records[is_sample])
    else:
        _take_samples(log, log.decoder, buffer, records[is_sample])


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


def _hold_samples(log: DeviceLog, buffer: NDArray[np.uint8], records: NDArray[np.int64]) -> None:
    """Keep samples that came before the first schema."""
    log.n_undecoded += len(records)
    if log.n_schemas == 0:
        for _, unix_s, first, size in records[: MAX_HELD_RECORDS - len(log.held)].tolist():
            log.held.append((unix_s, buffer[first : first + size].tobytes()))


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
    total = int(n_rows.sum())
    columns.make_room(total)
    rows = slice(columns.rows, columns.rows + total)
    decoder.decode(buffer, firsts + 2, n_rows, (columns.acc[rows], columns.gyr[rows]))
    places = zip(unix_s.tolist(), (stops - n_rows).tolist(), n_rows.tolist(), strict=True)
    log.placed += [(*place, log.n_schemas) for place in places]
    columns.rows += total


def build_recording(text: DeviceText, log: DeviceLog, timeline: Timeline) -> Recording:
    """Put segments, exclusions and caveats together."""
    segments = tuple(_make_segment(log.columns, timeline.seconds, run) for run in timeline.runs)
    excluded, asides = find_exclusions(log, timeline)
    duration_us = max([segments[-1].end_us, *(span.end_us for span in excluded)])
    told, changes = _tell_clock(text, log, timeline)
    start, unset = trust_clock(told)
    decoder = log.decoder
    return Recording(
        device="gt9x",
        sha256="",
        start=start,
        time_zone=None if text.offset_s is None else name_offset(text.offset_s),
        duration_us=duration_us,
        segments=segments,
        excluded=excluded,
        flags=(
            *flag_file(text, log, timeline, segments),
            *timeline.flags,
            *changes,
            *asides,
            *unset,
            *flag_spans("W-SLEEP", [span for span in excluded if span.reason == "asleep"]),
            *flag_spans("W-DOCKED", [span for span in excluded if span.reason == "docked"]),
            *flag_gaps(segments, duration_us, excluded),
        ),
        understood=_describe(text, log, timeline),
        serial_hash=text.serial_hash,
        acc_range_g=_full_scale(decoder, 0),
        gyr_range_dps=_full_scale(decoder, 3),
    )


def _tell_clock(
    text: DeviceText, log: DeviceLog, timeline: Timeline
) -> tuple[datetime, tuple[QualityFlag, ...]]:
    """The clock at the first sample; where the file counts UTC and names its zone, that zone is followed."""
    first_unix_s = int(timeline.seconds.unix_s[0])
    zone = find_zone(log.events.zone_name) if log.events.counts_utc else None
    if zone is None:
        return tell_start(first_unix_s, text.offset_s, counts_utc=log.events.counts_utc), ()
    followed = follow_zone(first_unix_s, timeline.runs[-1].end_s, zone)
    return followed.start, followed.flags


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

    Also returns what is only said: sleep before the first sample, and a stamp more than a day past the last
    one, which is not believed.
    """
    covered = [(run.start_s, run.end_s) for run in timeline.runs]
    end_s = max(covered[-1][1], timeline.place_s(log.scan.last_unix_s))
    asides: tuple[QualityFlag, ...] = ()
    if end_s - covered[-1][1] > LONGEST_GAP_S:
        end_s = covered[-1][1]
        asides += (QualityFlag("W-CLOCK-FWD", 1, 0.0, float(end_s), float(end_s)),)
    docked = gt3x_events.merge_seconds(
        second for second in map(timeline.place_s, log.events.docked_s) if 0 <= second < end_s
    )
    asleep: list[tuple[int, int]] = []
    for start_unix_s, end_unix_s in gt3x_events.pair_sleep(log.events.sleep, log.scan.last_unix_s):
        early_s = -timeline.place_s(start_unix_s)
        if 0 < early_s <= LONGEST_GAP_S:
            asides += (QualityFlag("W-SLEEP", 1, float(early_s)),)
        start_s = max(0, -early_s)
        stop_s = min(end_s, timeline.place_s(end_unix_s))
        asleep += gt3x_events.cut_out(start_s, stop_s, sorted([*covered, *docked]))
    spans = gt3x_events.make_spans(docked, "docked") + gt3x_events.make_spans(asleep, "asleep")
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
        "rows_per_second": usual[:200],
        "samples": str(int(counts.sum())),
        "records": str(log.scan.records),
        "missing_seconds": str(sum(steps)),
        "firmware": text.values.get("Firmware", ""),
        "clock": "UTC" if log.events.counts_utc else "local",
    }
