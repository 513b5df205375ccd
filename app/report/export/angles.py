"""The angle over time: as whole numbers, and as text for programs that do not read Parquet."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq

from acromion.app.report.export.all import build_flags, build_numbers
from acromion.fusion.angle_files.elevation_parquet import SCHEMA, STEPS_PER_DEG, STEPS_PER_G, read_rows
from acromion.fusion.elevation import average_acceleration
from acromion.fusion.quality.time_account import leave_out
from acromion.fusion.recording import BoolArray, FloatArray, Span

if TYPE_CHECKING:
    from acromion.fusion.elevation import Elevation, ElevationSegment
    from acromion.fusion.recording import Segment

_SCHEMA = pa.schema(
    [
        pa.field("time_us", pa.int64(), nullable=False),
        pa.field("elevation_cdeg", pa.int16()),
        pa.field("valid", pa.bool_(), nullable=False),
        pa.field("analysed", pa.bool_(), nullable=False),
        pa.field("acceleration_cg", pa.int16()),
    ],
    {"schema": SCHEMA},
)
_ENCODING = dict.fromkeys(("time_us", "elevation_cdeg", "acceleration_cg"), "DELTA_BINARY_PACKED")
_MOST_HZ = 100.5
"""A nominal 100 Hz sensor runs at 100 ± 0.1 Hz and keeps every sample."""

_ROWS_AT_ONCE = 1 << 20


def write_elevation(
    elevation: Elevation,
    path: Path,
    exclusions: tuple[Span, ...] = (),
    samples: Sequence[Segment] = (),
) -> None:
    """Write ``time_us`` (from the first sample), ``elevation_cdeg``, ``valid`` and ``analysed``.

    ``samples``: the recording's segments. The mean magnitude of their acceleration over each 0.1 s is
    ``acceleration_cg`` in the first row of that time, and null in its other rows; it matches the clocks of
    two sensors on one person (:mod:`acromion.fusion.comparison.movement`).

    The angle is the one before the metric filter, at most about 100 Hz; of a file with angles above 100 Hz
    every k-th angle is kept. It is null if no sample was measured: missing stays missing. A row is analysed
    if it is valid and outside the ``exclusions``, which are sorted and do not overlap.
    """
    counted = leave_out(elevation, exclusions)
    with pq.ParquetWriter(
        path,
        _SCHEMA,
        compression="zstd",
        use_dictionary=False,
        column_encoding=_ENCODING,
        write_statistics=["time_us"],
    ) as writer:
        both = zip(elevation.segments, counted.segments, strict=True)
        measured = {segment.start_us: segment for segment in samples}
        tables = (
            table for one, kept in both for table in _lay_segment(one, kept.valid, measured.get(one.start_us))
        )
        for table in _gather(tables):
            writer.write_table(table)


def _gather(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Join the tables of short segments, because a row group for each would take more space."""
    waiting: list[pa.Table] = []
    for table in tables:
        if waiting and sum(map(len, waiting)) + len(table) > _ROWS_AT_ONCE:
            yield pa.concat_tables(waiting)
            waiting = []
        waiting.append(table)
    if waiting:
        yield pa.concat_tables(waiting)


def _lay_segment(
    segment: ElevationSegment, analysed: BoolArray, samples: Segment | None
) -> Iterator[pa.Table]:
    step = max(1, math.ceil(segment.rate_hz / _MOST_HZ))
    angle_deg, valid, analysed = segment.elevation_deg[::step], segment.valid[::step], analysed[::step]
    known = np.isfinite(angle_deg)
    for first, stop in segment.bridged:
        known[math.ceil(first / step) : math.ceil(stop / step)] = False
    block, means_g = average_acceleration(samples, len(angle_deg)) if samples else (1, np.zeros(0))
    for first in range(0, len(angle_deg), _ROWS_AT_ONCE):
        rows = slice(first, min(first + _ROWS_AT_ONCE, len(angle_deg)))
        moves = (np.arange(rows.start, rows.stop) % block == 0) & (samples is not None)
        acceleration_cg = np.zeros(len(moves), np.int16)
        if samples:
            first_block, last_block = -(-rows.start // block), -(-rows.stop // block)
            acceleration_cg[moves] = np.rint(STEPS_PER_G * means_g[first_block:last_block])
        time_us = np.arange(rows.start, rows.stop) * (step * segment.period_us) + segment.start_us
        angle_cdeg = np.where(known[rows], angle_deg[rows], np.float32(0.0)) * np.float32(STEPS_PER_DEG)
        columns = [
            build_numbers(_round(time_us).astype(np.int64)),
            build_numbers(_round(angle_cdeg).astype(np.int16), known[rows]),
            build_flags(valid[rows] & known[rows]),
            build_flags(analysed[rows] & known[rows]),
            build_numbers(acceleration_cg, moves),
        ]
        yield pa.Table.from_arrays(columns, schema=_SCHEMA)


def _round(values: FloatArray) -> FloatArray:
    return np.rint(values, out=values)


def encode_elevation_csv(parquet: Path) -> bytes:
    """Encode ``elevation.parquet`` as gzipped CSV, in s and deg; the same file gives the same bytes."""
    rows = read_rows(parquet)
    angles = build_numbers(rows.elevation_deg, np.isfinite(rows.elevation_deg))
    columns = [build_numbers(rows.time_s), angles, build_flags(rows.valid)]
    names = ["time_s", "elevation_deg", "valid"]
    if rows.analysed is not None:
        columns, names = [*columns, build_flags(rows.analysed)], [*names, "analysed"]
    text = io.BytesIO()
    table = pa.Table.from_arrays(columns, names)
    pc.write_csv(table, text, pc.WriteOptions(quoting_style="none"))
    return gzip.compress(text.getvalue(), compresslevel=4, mtime=0)
