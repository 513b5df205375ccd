"""Parquet tables with columns named as in our CSV: `time_us` or `time_s`, `acc_x_g`, ..., `gyr_z_dps`."""

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import (
    DamagedFile,
    NoGravity,
    NoGyroscope,
    NoSamples,
    UnknownColumns,
    UnknownRate,
    UnsafeArchive,
)
from acromion.fusion.readers.samples import SampleColumns, check_rows, drop_blank_rows
from acromion.fusion.readers.source import Source
from acromion.fusion.readers.tables.columns import (
    Column,
    check_both_units,
    choose_acceleration,
    choose_vector,
    name_missing,
    parse_column_name,
)
from acromion.fusion.readers.tables.csv_lines import LARGEST_VALUE
from acromion.fusion.readers.tables.layout import TextLayout
from acromion.fusion.readers.tables.rows import (
    TableClock,
    TimeColumn,
    build_clock,
    build_recording,
    choose_stamp,
    put_back_gravity,
)
from acromion.fusion.readers.time.grid import cut_counted, cut_stamped
from acromion.fusion.recording import (
    QualityFlag,
    Recording,
    Stated,
    acc_scale_g,
    gyr_scale_dps,
    name_unit_source,
)

MAGIC = b"PAR1"
BATCH_ROWS = 65_536
LOOKED_AT_ROWS = 400
MAX_RATIO = 400
FREE_BYTES = 16 << 20
ROW_BYTES = 32
"""Decoded; a table of few distinct values packs well, but not without limit."""
FREE_PAGE_BYTES = 256 << 20
MAX_PAGE_RATIO = 60
"""Pages are unpacked whole: above 256 MiB in all they may not unpack to more than so many times their size
(those of an angle series of a week: 5)."""


@dataclass(frozen=True, slots=True)
class _Choice:
    """The columns to read: time, None if there is none, acceleration and angular rate x, y, z.

    ``gravity``: what the acceleration may lack, () if nothing.
    """

    stamp: Column | None
    acc: tuple[Column, ...]
    gyr: tuple[Column, ...]
    gravity: tuple[Column, ...]


def recognise(source: Source) -> bool:
    """Whether the bytes begin as Parquet does."""
    return source.head.startswith(MAGIC)


def read(source: Source, rate_hz: float | None = None) -> Recording:
    """Read a Parquet table.

    Raises
    ------
    DamagedFile
        Parquet's own reader refuses it.
    NoGyroscope, NoGravity, UnknownColumns, UnsafeArchive, NoSamples
    acromion.fusion.errors.UnusableTime, acromion.fusion.errors.UnknownRate
    """
    try:
        table = pq.ParquetFile(source.file)
        choice = _choose_columns(table.schema_arrow)
        check_pages(table.metadata, source.size_bytes)
        check_rows(table.metadata.num_rows, source.size_bytes, source.size_bytes)
        stamp, time = _find_time(table)
        choice = replace(choice, stamp=stamp)
        columns, absent_rows = _gather(table, choice, time, source.size_bytes)
        if choice.gravity:
            gravity, _ = _gather(table, replace(choice, acc=choice.gravity), time, source.size_bytes)
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        raise DamagedFile from error
    if columns.rows == 0:
        raise NoSamples
    acc_unit, gyr_unit = choice.acc[0].unit, choice.gyr[0].unit
    if choice.gravity:
        scale_g = acc_scale_g(choice.gravity[0].unit) or 1.0
        has_own_unit = acc_unit != choice.gravity[0].unit
        if put_back_gravity(
            columns, gravity, scale_g, choice.acc[0], choice.gyr[0], has_own_unit=has_own_unit
        ):
            acc_unit = "g"
    time.unit.refuse_doubtful(columns)
    flags = drop_blank_rows(columns) if time.has_times else ()
    if not time.has_times and rate_hz is None:
        raise UnknownRate
    flags += time.repair(columns) if time.has_times else ()
    n_rows, first_us = columns.rows, int(columns.stamps[0])
    grid = cut_stamped(columns) if time.has_times else cut_counted(columns, rate_hz or 0.0)
    absent = (QualityFlag(Caveat.NAN, absent_rows),) if absent_rows else ()
    clock = build_clock(time.read_start(first_us))
    units_from = name_unit_source(acc_unit, gyr_unit)
    return build_recording(
        grid,
        TableClock(clock.start, clock.time_zone, (*clock.flags, *time.unit.flag())),
        (*absent, *flags, *grid.flags),
        {
            "layout": "Parquet",
            "columns": ", ".join(one.name for one in (choice.stamp, *choice.acc, *choice.gyr) if one),
            "acceleration_unit": acc_unit or "",
            "angular_rate_unit": gyr_unit or "",
            "units_from": units_from,
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(n_rows),
            "time": "number" if time.has_times else "row number",
        },
        stated=Stated(acc_unit or "", gyr_unit or "", is_counted=not time.has_times, units_from=units_from),
        jitter_us=float(grid.jitter_us),
    )


def check_pages(metadata: pq.FileMetaData, size_bytes: int) -> None:
    """Refuse pages that unpack beyond anything a sensor writes, by the file's own index.

    The index of a single column is not asked: pyarrow 26 ends the process if it is damaged.

    Raises UnsafeArchive.
    """
    groups = (metadata.row_group(number) for number in range(metadata.num_row_groups))
    unpacked_bytes = sum(group.total_byte_size for group in groups)
    if unpacked_bytes > max(FREE_PAGE_BYTES, MAX_PAGE_RATIO * size_bytes):
        raise UnsafeArchive(reason="ratio", limit=MAX_PAGE_RATIO)


def _choose_columns(schema: pa.Schema) -> _Choice:
    columns = tuple(parse_column_name(name) for name in schema.names)
    (acc, gravity), gyr = choose_acceleration(columns), choose_vector(columns, "gyr")
    if acc is None or gyr is None:
        if acc is not None and not any(column.channel == "gyr" for column in columns):
            raise NoGyroscope
        if gyr is not None and choose_vector(columns, "linear"):
            raise NoGravity
        raise UnknownColumns(list=", ".join(schema.names)[:200], **name_missing(columns))
    check_both_units(columns, acc, gyr)
    return _Choice(
        None,
        tuple(columns[place] for place in acc),
        tuple(columns[place] for place in gyr),
        tuple(columns[place] for place in gravity or ()),
    )


def _find_time(table: pq.ParquetFile) -> tuple[Column | None, TimeColumn]:
    """Find the time by the first rows, as in a table of text; None if no column holds a time.

    Parquet keeps stamps with a zone in UTC, those without are a wall clock's.
    """
    schema = table.schema_arrow
    columns = [
        replace(column, unit="us") if pa.types.is_duration(kind) else column
        for name, kind in zip(schema.names, schema.types, strict=True)
        if (column := parse_column_name(name)).channel == "time" or pa.types.is_timestamp(kind)
    ]
    names = [column.name for column in columns]
    batch = next(table.iter_batches(LOOKED_AT_ROWS, columns=names), None) if names else None
    if batch is None:
        return None, TimeColumn()
    times = [_read_times(batch.column(name)) for name in names]
    rows = tuple(row for row in zip(*map(_write_stamps, times), strict=True) if any(row))
    place, time = choose_stamp(TextLayout(",", ".", ",".join(names), tuple(columns), 0, (), rows))
    if place is None or not time.has_times:
        return None, TimeColumn()
    kind = times[place].type
    is_zoned = pa.types.is_timestamp(kind) and kind.tz is not None
    return columns[place], replace(time, offset_s=0) if is_zoned else time


def _read_times(stamps: pa.Array) -> pa.Array:
    """Return durations as microseconds, and words as stamps if they are dates with times."""
    if pa.types.is_dictionary(stamps.type):
        stamps = stamps.dictionary_decode()
    if pa.types.is_duration(stamps.type):
        return stamps.cast(pa.duration("us"), safe=False).cast(pa.int64())
    if pa.types.is_string(stamps.type) or pa.types.is_large_string(stamps.type):
        for zone in (None, "UTC"):
            with suppress(pa.ArrowInvalid):
                return stamps.cast(pa.timestamp("us", zone))
    return stamps


def _write_stamps(stamps: pa.Array) -> list[str]:
    """Write times as a table of text does; "" for none."""
    if pa.types.is_timestamp(stamps.type):
        stamps = stamps.cast(pa.timestamp("us"), safe=False).cast(pa.string())
    return ["" if value is None else str(value) for value in stamps.to_pylist()]


def _gather(
    table: pq.ParquetFile, choice: _Choice, time: TimeColumn, size_bytes: int
) -> tuple[SampleColumns, int]:
    """Read batch by batch, in g and deg/s; rows with a value that is absent are left out and counted."""
    columns = SampleColumns()
    seen = absent = 0
    scales = [acc_scale_g(choice.acc[0].unit) or 1.0] * 3 + [gyr_scale_dps(choice.gyr[0].unit) or 1.0] * 3
    names = [one.name for one in (choice.stamp, *choice.acc, *choice.gyr) if one]
    for batch in table.iter_batches(BATCH_ROWS, columns=names):
        rows = len(batch)
        if (seen + rows) * ROW_BYTES > max(FREE_BYTES, MAX_RATIO * size_bytes):
            raise UnsafeArchive(reason="ratio", limit=MAX_RATIO)
        check_rows(seen, size_bytes, size_bytes)  # the index may not say how many there are
        vectors = [batch.column(one.name).cast(pa.float64()) for one in (*choice.acc, *choice.gyr)]
        values = np.stack([vector.to_numpy(zero_copy_only=False) for vector in vectors], axis=1) * scales
        stamps = np.arange(seen, seen + rows)
        if choice.stamp is not None:
            times = _read_times(batch.column(choice.stamp.name))
            values[~_have_times(times)] = np.nan
            stamps = _to_microseconds(times, time.unit.exponent)
        kept = (np.abs(values) < LARGEST_VALUE).all(axis=1)  # also false for NaN
        n_kept = int(kept.sum())
        place = columns.extend(n_kept)
        columns.acc[place], columns.gyr[place] = values[kept, :3], values[kept, 3:]
        columns.stamps[place] = stamps[kept]
        seen, absent = seen + rows, absent + rows - n_kept
    columns.trim()
    return columns, absent


def _have_times(stamps: pa.Array) -> NDArray[np.bool_]:
    """Which rows have a finite time, shape (n,)."""
    if pa.types.is_floating(stamps.type):  # what is absent is NaN
        return np.asarray(np.isfinite(stamps.to_numpy(zero_copy_only=False)))
    return np.asarray(stamps.is_valid().to_numpy(zero_copy_only=False))


def _to_microseconds(stamps: pa.Array, exponent: int) -> NDArray[np.int64]:
    """Stamps; an arbitrary value if there is none."""
    if pa.types.is_timestamp(stamps.type):
        micros = stamps.cast(pa.timestamp("us", tz=stamps.type.tz), safe=False)
        return np.asarray(micros.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False), np.int64)
    if pa.types.is_integer(stamps.type) and exponent >= 0:
        return np.asarray(stamps.cast(pa.int64()).fill_null(0).to_numpy() * np.int64(10**exponent))
    if pa.types.is_integer(stamps.type):  # since 1970 in nanoseconds, more digits than a float64 holds
        whole = np.asarray(stamps.cast(pa.int64()).fill_null(0).to_numpy(), np.int64)
        return np.asarray((whole + 10**-exponent // 2) // 10**-exponent)
    times = stamps.cast(pa.float64()).to_numpy(zero_copy_only=False)
    return np.asarray(np.rint(np.where(np.isfinite(times), times, 0.0) * 10.0**exponent), np.int64)
