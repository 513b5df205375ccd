"""Parquet tables with columns named as in our CSV: `time_us` or `time_s`, `acc_x_g`, ..., `gyr_z_dps`."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from datetime import UTC

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import (
    DamagedFile,
    NoGravity,
    NoGyroscope,
    NoSamples,
    UnknownColumns,
    UnknownRate,
    UnsafeArchive,
)
from fusion.readers.samples import SampleColumns, check_rows, drop_blank_rows
from fusion.readers.source import Source
from fusion.readers.tables.careful_path import LARGEST_VALUE
from fusion.readers.tables.columns import (
    IN_MICROSECONDS,
    TIME_UNITS_EXPONENT,
    UNIT_NAMES,
    Column,
    TimeUnit,
    choose_acceleration,
    choose_vector,
    find_time_unit,
    name_missing,
    parse_column_name,
)
from fusion.readers.tables.gravity import put_back_gravity
from fusion.readers.tables.rows import TableClock, build_clock, read_epoch
from fusion.readers.timebase.clock import datetime_at_us
from fusion.readers.timebase.grid import cut_counted, cut_stamped
from fusion.readers.timebase.row_times import repair_row_times
from fusion.recording import QualityFlag, Recording
from fusion.units import acc_scale_g, gyr_scale_dps, name_unit_source

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
    fusion.errors.UnusableTime, fusion.errors.UnknownRate
    """
    try:
        table = pq.ParquetFile(source.file)
        choice, gravity = _choose_columns(table.schema_arrow)
        check_pages(table.metadata, source.size_bytes)
        check_rows(table.metadata.num_rows, source.size_bytes, source.size_bytes)
        chosen, unit = _find_time_unit(table, choice)
        columns, absent = _gather(table, chosen, source.size_bytes)
        beside = (*chosen[:-6], *gravity, *chosen[-3:])
        parts = _gather(table, beside, source.size_bytes)[0] if gravity else None
    except (pa.ArrowException, OSError, ValueError, OverflowError) as error:
        raise DamagedFile from error
    if columns.rows == 0:
        raise NoSamples
    if parts is not None:
        scale_g = acc_scale_g(gravity[0].unit) or 1.0
        if put_back_gravity(columns, parts, scale_g, chosen[-6], chosen[-3]):
            chosen = (*chosen[:-6], *(replace(one, unit="g") for one in chosen[-6:-3]), *chosen[-3:])
    unit.refuse_doubtful(columns)
    kinds = dict(zip(table.schema_arrow.names, table.schema_arrow.types, strict=True))
    stamp_kind = kinds[chosen[0].name] if len(chosen) == 7 else None
    recording = _build(columns, chosen, stamp_kind, absent, rate_hz)
    return replace(recording, flags=(*recording.flags, *unit.flag()))


def check_pages(metadata: pq.FileMetaData, size_bytes: int) -> None:
    """Refuse pages that unpack beyond anything a sensor writes, by the file's own index.

    The index of a single column is not asked: pyarrow 26 ends the process where it is damaged.

    Raises
    ------
    UnsafeArchive
    """
    groups = (metadata.row_group(number) for number in range(metadata.num_row_groups))
    unpacked_bytes = sum(group.total_byte_size for group in groups)
    if unpacked_bytes > max(FREE_PAGE_BYTES, MAX_PAGE_RATIO * size_bytes):
        raise UnsafeArchive(reason="ratio", limit=MAX_PAGE_RATIO)


def _choose_columns(schema: pa.Schema) -> tuple[tuple[Column, ...], tuple[Column, ...]]:
    """Time, if there is one, then acceleration and angular rate x, y, z; and gravity that may be lacking."""
    columns = tuple(parse_column_name(name) for name in schema.names)
    (acc, gravity), gyr = choose_acceleration(columns), choose_vector(columns, "gyr")
    if acc is None or gyr is None:
        if acc is not None and not any(column.channel == "gyr" for column in columns):
            raise NoGyroscope
        if gyr is not None and choose_vector(columns, "linear"):
            raise NoGravity
        raise UnknownColumns(list=", ".join(schema.names)[:200], missing=name_missing(columns))
    stamps = [
        column
        for column, kind in zip(columns, schema.types, strict=True)
        if column.channel == "time" and (column.unit in TIME_UNITS_EXPONENT or pa.types.is_timestamp(kind))
    ]
    unit = columns[acc[0]].unit
    beside = [replace(columns[place], unit=columns[place].unit or unit) for place in gravity or ()]
    return (*stamps[:1], *(columns[place] for place in (*acc, *gyr))), tuple(beside)


def _find_time_unit(table: pq.ParquetFile, chosen: tuple[Column, ...]) -> tuple[tuple[Column, ...], TimeUnit]:
    """Find the unit of the first times: it may not be that of the column's name."""
    kind = table.schema_arrow.field(chosen[0].name).type
    if len(chosen) < 7 or pa.types.is_timestamp(kind):
        return chosen, IN_MICROSECONDS
    batch = next(table.iter_batches(LOOKED_AT_ROWS, columns=[chosen[0].name]), None)
    values = (
        batch.column(0).filter(_have_times(batch.column(0))).cast(pa.float64()).to_pylist() if batch else []
    )
    unit = find_time_unit(values, chosen[0].unit) if values else None
    if unit is None:
        return chosen, IN_MICROSECONDS
    return (replace(chosen[0], unit=UNIT_NAMES[unit.exponent]), *chosen[1:]), unit


def _gather(table: pq.ParquetFile, chosen: Sequence[Column], size_bytes: int) -> tuple[SampleColumns, int]:
    """Read batch by batch; rows with a value that is absent or not finite are counted and left out."""
    columns = SampleColumns()
    seen = absent = 0
    for values, stamps in _read_batches(table, chosen):
        rows = len(values)
        if (seen + rows) * ROW_BYTES > max(FREE_BYTES, MAX_RATIO * size_bytes):
            raise UnsafeArchive(reason="ratio", limit=MAX_RATIO)
        check_rows(seen, size_bytes, size_bytes)  # the index may not say how many there are
        kept = (np.abs(values) < LARGEST_VALUE).all(axis=1)  # false for what is not a number, too
        columns.make_room(int(kept.sum()))
        place = slice(columns.rows, columns.rows + int(kept.sum()))
        columns.acc[place], columns.gyr[place] = values[kept, :3], values[kept, 3:]
        columns.stamps[place] = (np.arange(seen, seen + rows) if stamps is None else stamps)[kept]
        columns.rows = place.stop
        seen, absent = seen + rows, absent + rows - columns.rows + place.start
    columns.trim()
    return columns, absent


def _read_batches(
    table: pq.ParquetFile, chosen: Sequence[Column]
) -> Iterator[tuple[NDArray[np.float64], NDArray[np.int64] | None]]:
    """Values in g and deg/s, shape (n, 6), and stamps in microseconds where there are any."""
    for batch in table.iter_batches(BATCH_ROWS, columns=[column.name for column in chosen]):
        vectors = [batch.column(column.name).cast(pa.float64()) for column in chosen[-6:]]
        values = np.stack([vector.to_numpy(zero_copy_only=False) for vector in vectors], axis=1)
        values[:, :3] *= acc_scale_g(chosen[-6].unit) or 1.0
        values[:, 3:] *= gyr_scale_dps(chosen[-3].unit) or 1.0
        stamps = None
        if len(chosen) == 7:
            times = batch.column(chosen[0].name)
            values[~_have_times(times)] = np.nan
            stamps = _to_microseconds(times, chosen[0])
        yield values, stamps


def _have_times(stamps: pa.Array) -> NDArray[np.bool_]:
    """Which rows have a finite time, shape (n,)."""
    if pa.types.is_floating(stamps.type):  # what is absent is NaN
        timed: NDArray[np.bool_] = np.isfinite(stamps.to_numpy(zero_copy_only=False))
    else:
        timed = stamps.is_valid().to_numpy(zero_copy_only=False)
    return timed


def _to_microseconds(stamps: pa.Array, column: Column) -> NDArray[np.int64]:
    """Stamps; any value stands where there is none."""
    if pa.types.is_timestamp(stamps.type):
        micros = stamps.cast(pa.timestamp("us", tz=stamps.type.tz), safe=False)
        return np.asarray(micros.cast(pa.int64()).fill_null(0).to_numpy(zero_copy_only=False), np.int64)
    exponent = TIME_UNITS_EXPONENT[column.unit or "us"]
    if pa.types.is_integer(stamps.type) and exponent >= 0:
        whole: NDArray[np.int64] = stamps.cast(pa.int64()).fill_null(0).to_numpy() * np.int64(10**exponent)
        return whole
    times = stamps.cast(pa.float64()).to_numpy(zero_copy_only=False)
    seconds = np.where(np.isfinite(times), times, 0.0)
    rounded: NDArray[np.int64] = np.rint(seconds * 10.0**exponent).astype(np.int64)
    return rounded


def _find_clock(stamp_kind: pa.DataType | None, first_us: int) -> TableClock:
    """Read the first stamp: Parquet keeps stamps with a zone in UTC, those without are a wall clock's."""
    if stamp_kind is None or not pa.types.is_timestamp(stamp_kind):
        return build_clock(read_epoch(first_us) if stamp_kind is not None else None)
    moment = datetime_at_us(first_us)
    return build_clock(moment.replace(tzinfo=UTC) if moment and stamp_kind.tz else moment)


def _repair_row_times(
    columns: SampleColumns, stamp_kind: pa.DataType, column: Column
) -> tuple[QualityFlag, ...]:
    """Bring the rows into order; bare stamps are a wall clock's, whole numbers may be of a counter."""
    if pa.types.is_timestamp(stamp_kind):
        return repair_row_times(columns, is_wall_clock=not stamp_kind.tz)
    exponent = TIME_UNITS_EXPONENT[column.unit or "us"]
    is_count = exponent in (0, 3) and read_epoch(int(columns.stamps[0])) is None
    return repair_row_times(columns, tick_us=10**exponent if is_count else 0)


def _build(
    columns: SampleColumns,
    chosen: Sequence[Column],
    stamp_kind: pa.DataType | None,
    absent_rows: int,
    rate_hz: float | None,
) -> Recording:
    has_time = stamp_kind is not None
    blank = drop_blank_rows(columns) if has_time else ()
    if not has_time and rate_hz is None:
        raise UnknownRate
    changes = _repair_row_times(columns, stamp_kind, chosen[0]) if stamp_kind is not None else ()
    n_rows, first_us = columns.rows, int(columns.stamps[0])
    clock = _find_clock(stamp_kind, first_us)
    grid = cut_stamped(columns) if has_time else cut_counted(columns, rate_hz or 0.0)
    flags = (*blank, *changes, *grid.flags)
    if absent_rows:
        flags = (QualityFlag(Caveat.NAN, absent_rows), *flags)
    return Recording(
        device="other",
        sha256="",
        start=clock.start,
        time_zone=clock.time_zone,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(*flags, *clock.flags),
        understood={
            "layout": "Parquet",
            "columns": ", ".join(column.name for column in chosen),
            "acceleration_unit": chosen[-6].unit or "",
            "angular_rate_unit": chosen[-3].unit or "",
            "units_from": name_unit_source(chosen[-6].unit, chosen[-3].unit),
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(n_rows),
            "time": "number" if has_time else "row number",
        },
    )
