"""Our own ``elevation.parquet`` (``time_s``, ``elevation_deg``, ``valid``), and ``truth.parquet`` without
``valid``.
"""

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from fusion.angle_files.named_csv import check_times, keep_angles
from fusion.angle_files.types import AngleFile, AngleFileOptions
from fusion.errors import UnknownColumns, UnreadableFile
from fusion.readers.source import Source, hash_source

COLUMNS = ("time_s", "elevation_deg")


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
    """
    source.file.seek(0)
    try:
        table = pq.read_table(source.file)
    except (pa.ArrowException, OSError) as error:
        raise UnreadableFile from error
    if not set(COLUMNS) <= set(table.column_names):
        raise UnknownColumns(list=", ".join(table.column_names)[:200])
    time_s, elevation_deg = (np.asarray(table[name].to_numpy(), np.float64) for name in COLUMNS)
    if "valid" in table.column_names:
        elevation_deg = np.where(table["valid"].to_numpy(), elevation_deg, np.nan)
    understood = {"layout": "Parquet", "source": "elevation_deg"}
    return keep_angles(check_times(time_s), elevation_deg, hash_source(source), understood)
