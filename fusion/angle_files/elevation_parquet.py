"""Our own ``elevation.parquet`` (``time_s``, ``elevation_deg``, ``valid``), and ``truth.parquet`` without
``valid``.
"""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from fusion.angle_files.named_csv import check_times, keep_angles
from fusion.angle_files.types import AngleFile, AngleFileOptions
from fusion.errors import UnknownColumns, UnreadableFile
from fusion.readers.samples import check_rows
from fusion.readers.source import Source, hash_source
from fusion.readers.tables.parquet import check_pages

COLUMNS = ("time_s", "elevation_deg")
LEAST_ANGLE_BYTES = 1.0
"""What a row takes of the file at least; one of a week of work takes 2.5."""


def recognise(source: Source) -> bool:
    """Parquet with our two columns; a Parquet of samples is for the readers of recordings."""
    if not source.head.startswith(b"PAR1"):
        return False
    try:
        return set(COLUMNS) <= set(pq.read_schema(source.file).names)
    except (pa.ArrowException, OSError):
        return False


def read(source: Source, _options: AngleFileOptions) -> AngleFile:
    """Read the angle; what is not valid is missing.

    Raises
    ------
    UnknownColumns, UnreadableFile
    fusion.errors.UnsafeArchive, fusion.errors.TooLong
        More is packed in it than any angle series holds.
    """
    source.file.seek(0)
    try:
        file = pq.ParquetFile(source.file)
        names = [name for name in (*COLUMNS, "valid") if name in file.schema_arrow.names]
        check_pages(file.metadata, names)
        check_rows(file.metadata.num_rows, source.size_bytes, source.size_bytes, LEAST_ANGLE_BYTES)
        table = file.read(names)
    except (pa.ArrowException, OSError) as error:
        raise UnreadableFile from error
    if not set(COLUMNS) <= set(table.column_names):
        raise UnknownColumns(list=", ".join(file.schema_arrow.names)[:200])
    time_s, elevation_deg = (np.asarray(table[name].to_numpy(), np.float64) for name in COLUMNS)
    if "valid" in table.column_names:
        elevation_deg = np.where(table["valid"].to_numpy(), elevation_deg, np.nan)
    understood = {"layout": "Parquet", "source": "elevation_deg"}
    return keep_angles(check_times(time_s), elevation_deg, hash_source(source), understood)
