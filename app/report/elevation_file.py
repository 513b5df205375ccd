"""The angle series as a Parquet file, for those who want to compute on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from app.report.arrow_columns import lay_flags, lay_numbers
from fusion.recording import MICROSECONDS

if TYPE_CHECKING:
    from fusion.elevation import Elevation, ElevationSegment

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
