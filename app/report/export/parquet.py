"""The angle series as Parquet and CSV, for further computation."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from fusion.angle_files.elevation_parquet import SCHEMA, STEPS_PER_DEG, read_rows
from fusion.recording import FloatArray

if TYPE_CHECKING:
    from fusion.elevation import Elevation, ElevationSegment


# Columns of a Parquet file, built from buffers: ``pyarrow.array`` and ``pyarrow.table`` load pandas to ask
# whether a list is one of its columns, which takes longer than writing the file.


def lay_numbers(values: NDArray[Any], known: NDArray[np.bool_] | None = None) -> pa.Array:
    """Return a column of numbers; shapes (n,). Absent are those that are not ``known``, else none."""
    close = pa.py_buffer(np.ascontiguousarray(values))
    marks = None if known is None or known.all() else _pack(known)
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [marks, close])


def lay_flags(flags: NDArray[np.bool_]) -> pa.Array:
    """Return a column of yes and no, none of them absent; shape (n,)."""
    return pa.Array.from_buffers(pa.bool_(), len(flags), [None, _pack(flags)])


def lay_some_numbers(values: Sequence[float | None]) -> pa.Array:
    """Return a column of numbers, None where there is none."""
    filled = np.array([0.0 if value is None else value for value in values], np.float64)
    return lay_numbers(filled, _find_known(values))


def lay_some_texts(texts: Sequence[str | None]) -> pa.Array:
    """Return a column of text, None where there is none."""
    encoded = [(text or "").encode("utf-8") for text in texts]
    edges = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    buffers = [_pack(_find_known(texts)), pa.py_buffer(edges), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(encoded), buffers)


def _find_known(values: Sequence[object]) -> NDArray[np.bool_]:
    return np.array([value is not None for value in values], np.bool_)


def _pack(flags: NDArray[np.bool_]) -> pa.Buffer:
    return pa.py_buffer(np.packbits(flags, bitorder="little"))


# The angle over time: as whole numbers, and as text for programs that do not read Parquet.


_SCHEMA = pa.schema(
    [
        pa.field("time_us", pa.int64(), nullable=False),
        pa.field("elevation_cdeg", pa.int16()),
        pa.field("valid", pa.bool_(), nullable=False),
    ],
    {"schema": SCHEMA},
)
_ENCODING = {"time_us": "DELTA_BINARY_PACKED", "elevation_cdeg": "DELTA_BINARY_PACKED"}
_MOST_HZ = 100.5
"""A nominal 100 Hz sensor runs at 100 +- 0.1 Hz and keeps every sample."""

_ROWS_AT_ONCE = 1 << 20


def write_elevation(elevation: Elevation, path: Path) -> None:
    """Write ``time_us`` (from the first sample), ``elevation_cdeg`` and ``valid``, at most about 100 Hz.

    The angle is that before the metric filter; of a ready series above 100 Hz every k-th angle is kept. It is
    null where no sample was measured: missing stays missing.
    """
    with pq.ParquetWriter(
        path,
        _SCHEMA,
        compression="zstd",
        use_dictionary=False,
        column_encoding=_ENCODING,
        write_statistics=["time_us"],
    ) as writer:
        for table in _gather(table for segment in elevation.segments for table in _lay_segment(segment)):
            writer.write_table(table)


def _gather(tables: Iterable[pa.Table]) -> Iterator[pa.Table]:
    """Join the tables of short segments: a group of rows of its own for each would take more room."""
    waiting: list[pa.Table] = []
    for table in tables:
        if waiting and sum(map(len, waiting)) + len(table) > _ROWS_AT_ONCE:
            yield pa.concat_tables(waiting)
            waiting = []
        waiting.append(table)
    if waiting:
        yield pa.concat_tables(waiting)


def _lay_segment(segment: ElevationSegment) -> Iterator[pa.Table]:
    step = max(1, math.ceil(segment.rate_hz / _MOST_HZ))
    angle_deg, valid = segment.elevation_deg[::step], segment.valid[::step]
    known = np.isfinite(angle_deg)
    for first, stop in segment.bridged:
        known[math.ceil(first / step) : math.ceil(stop / step)] = False
    for first in range(0, len(angle_deg), _ROWS_AT_ONCE):
        rows = slice(first, min(first + _ROWS_AT_ONCE, len(angle_deg)))
        time_us = np.arange(rows.start, rows.stop) * (step * segment.period_us) + segment.start_us
        angle_cdeg = np.where(known[rows], angle_deg[rows], np.float32(0.0)) * np.float32(STEPS_PER_DEG)
        columns = [
            lay_numbers(_round(time_us).astype(np.int64)),
            lay_numbers(_round(angle_cdeg).astype(np.int16), known[rows]),
            lay_flags(valid[rows] & known[rows]),
        ]
        yield pa.Table.from_arrays(columns, schema=_SCHEMA)


def _round(values: FloatArray) -> FloatArray:
    return np.rint(values, out=values)


def encode_elevation_csv(parquet: Path) -> bytes:
    """Write ``elevation.parquet`` as CSV in gzip, in s and deg; the same file gives the same bytes."""
    rows = read_rows(parquet)
    angles = lay_numbers(rows.elevation_deg, np.isfinite(rows.elevation_deg))
    columns = [lay_numbers(rows.time_s), angles, lay_flags(rows.valid)]
    text = io.BytesIO()
    table = pa.Table.from_arrays(columns, ["time_s", "elevation_deg", "valid"])
    pc.write_csv(table, text, pc.WriteOptions(quoting_style="none"))
    return gzip.compress(text.getvalue(), compresslevel=4, mtime=0)
