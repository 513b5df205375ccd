"""The angle series as Parquet and CSV, for further computation."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from fusion.recording import MICROSECONDS

if TYPE_CHECKING:
    from fusion.elevation import Elevation, ElevationSegment


# Columns of a Parquet file, built from buffers: ``pyarrow.array`` and ``pyarrow.table`` load pandas to ask
# whether a list is one of its columns, which takes longer than writing the file.


def lay_numbers(values: NDArray[np.float64] | NDArray[np.float32]) -> pa.Array:
    """Give a column of numbers, none of them absent; shape (n,)."""
    close = pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [None, close])


def lay_flags(flags: NDArray[np.bool_]) -> pa.Array:
    """Give a column of yes and no, none of them absent; shape (n,)."""
    return pa.Array.from_buffers(pa.bool_(), len(flags), [None, _pack(flags)])


def lay_some_numbers(values: Sequence[float | None]) -> pa.Array:
    """Give a column of numbers, None where there is none."""
    filled = np.array([0.0 if value is None else value for value in values], np.float64)
    return pa.Array.from_buffers(pa.float64(), len(filled), [_mark_known(values), pa.py_buffer(filled)])


def lay_some_texts(texts: Sequence[str | None]) -> pa.Array:
    """Give a column of text, None where there is none."""
    encoded = [(text or "").encode("utf-8") for text in texts]
    edges = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    buffers = [_mark_known(texts), pa.py_buffer(edges), pa.py_buffer(b"".join(encoded))]
    return pa.Array.from_buffers(pa.string(), len(encoded), buffers)


def _mark_known(values: Sequence[object]) -> pa.Buffer:
    return _pack(np.array([value is not None for value in values], np.bool_))


def _pack(flags: NDArray[np.bool_]) -> pa.Buffer:
    return pa.py_buffer(np.packbits(flags, bitorder="little"))


# The angle over time as text, for programs that do not read Parquet.


def encode_elevation_csv(parquet: Path) -> bytes:
    """Write ``elevation.parquet`` as CSV in gzip; the same file gives the same bytes."""
    text = io.BytesIO()
    pc.write_csv(pq.read_table(parquet), text, pc.WriteOptions(quoting_style="none"))
    return gzip.compress(text.getvalue(), compresslevel=4, mtime=0)


_SCHEMA = pa.schema(
    [
        pa.field("time_s", pa.float64(), nullable=False),
        pa.field("elevation_deg", pa.float32(), nullable=False),
        pa.field("valid", pa.bool_(), nullable=False),
    ]
)
_MOST_HZ = 100.5
"""A nominal 100 Hz sensor runs at 100 +- 0.1 Hz and keeps every sample."""

_ROWS_AT_ONCE = 1_000_000


def write_elevation(elevation: Elevation, path: Path) -> None:
    """Write ``time_s`` (from the first sample), ``elevation_deg`` and ``valid``, at most about 100 Hz.

    The angle is that before the metric filter; above 100 Hz every k-th sample of each segment is kept.
    """
    with pq.ParquetWriter(
        path,
        _SCHEMA,
        compression="zstd",
        use_dictionary=False,
        column_encoding={"time_s": "BYTE_STREAM_SPLIT", "elevation_deg": "BYTE_STREAM_SPLIT"},
    ) as writer:
        for segment in elevation.segments:
            for table in _thin_tables(segment):
                writer.write_table(table)


def _thin_tables(segment: ElevationSegment) -> Iterator[pa.Table]:
    step = max(1, math.ceil(segment.rate_hz / _MOST_HZ))
    rows = np.arange(0, len(segment), step)
    for first in range(0, len(rows), _ROWS_AT_ONCE):
        taken = rows[first : first + _ROWS_AT_ONCE]
        time_s = segment.start_us / MICROSECONDS + taken / segment.rate_hz
        angle, valid = segment.elevation_deg[taken], segment.valid[taken]
        columns = [lay_numbers(time_s), lay_numbers(angle), lay_flags(valid)]
        yield pa.Table.from_arrays(columns, schema=_SCHEMA)
