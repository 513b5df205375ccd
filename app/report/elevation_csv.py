"""The angle over time as text, for programs that read no Parquet."""

import gzip
import io
from pathlib import Path

import pyarrow.csv as pc
import pyarrow.parquet as pq


def encode_elevation_csv(parquet: Path) -> bytes:
    """Write ``elevation.parquet`` as CSV in gzip; the same file gives the same bytes."""
    text = io.BytesIO()
    pc.write_csv(pq.read_table(parquet), text, pc.WriteOptions(quoting_style="none"))
    return gzip.compress(text.getvalue(), compresslevel=4, mtime=0)
