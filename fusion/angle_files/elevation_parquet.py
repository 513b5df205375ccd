"""Read ``elevation.parquet`` in both versions, and ``truth.parquet``, which has no ``valid``.

``acromion.elevation/2`` contains integers: ``time_us`` from the first sample, ``elevation_cdeg`` (0.01 deg,
so the rounding error is at most 0.005 deg; null if no angle was measured), ``valid`` and, in newer files,
``analysed`` and ``acceleration_cg``. Version 1 contained ``time_s``, ``elevation_deg`` and ``valid``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from acromion.fusion.angle_files.angle_series import HOLE_PERIODS, AngleFile, AngleFileOptions
from acromion.fusion.angle_files.tables import build_angle_file, check_times
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import UnknownColumns, UnreadableFile
from acromion.fusion.readers import RecordingFile
from acromion.fusion.readers.samples import check_rows
from acromion.fusion.readers.source import Source, open_source
from acromion.fusion.readers.tables.parquet import check_pages
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array

SCHEMA = "acromion.elevation/2"
STEPS_PER_DEG = 100
ACCELERATION, STEPS_PER_G = "acceleration_cg", 100


@dataclass(frozen=True, slots=True)
class Form:
    """Columns of a version, and how many of their units make 1 s and 1 deg."""

    time: str
    angle: str
    per_second: int
    per_deg: int


FORMS = (
    Form("time_us", "elevation_cdeg", MICROSECONDS, STEPS_PER_DEG),
    Form("time_s", "elevation_deg", 1, 1),
)
_FLAGS = ("valid", "analysed")
UNREADABLE = (pa.ArrowException, OSError, UnicodeDecodeError)
"""Exceptions that Parquet's reader raises for a damaged file; the last one if a name is not text."""
LEAST_ANGLE_BYTES = 0.1
"""Least bytes per row of a file with more than two days of rows; a row of a worn arm takes 0.5 to 1 byte."""


@dataclass(frozen=True, slots=True, eq=False)
class ElevationRows:
    """The rows of a file.

    ``time_s``: shape (n,), from the first sample.
    ``elevation_deg``: shape (n,), float32; NaN if not measured.
    ``valid``: shape (n,). Fused and trusted.
    ``analysed``: shape (n,). Also outside all excluded time; None in a file without this column.
    ``column``: the name of the angle column.
    """

    time_s: Float64Array
    elevation_deg: NDArray[np.float32]
    valid: BoolArray
    analysed: BoolArray | None
    column: str

    def __len__(self) -> int:
        return len(self.time_s)


def recognise(source: Source) -> bool:
    """Return whether it is Parquet with our two columns; Parquet with samples is read as a recording."""
    if not source.head.startswith(b"PAR1"):
        return False
    try:
        return _find_form(pq.read_schema(source.file).names) is not None
    except UNREADABLE:
        return False


def read(source: Source, _options: AngleFileOptions) -> AngleFile:
    """Read the angle; rows that are not valid are missing.

    Raises FusionError: as :func:`read_rows`; times that do not increase, or an impossible angle.
    """
    rows = _read_source(source)
    elevation_deg = np.where(rows.valid, rows.elevation_deg, np.nan).astype(np.float64)
    understood = {"layout": "Parquet", "source": rows.column}
    return build_angle_file(source, check_times(rows.time_s), elevation_deg, understood)


def read_elevation(file: RecordingFile) -> Elevation:
    """Read the angle series that an analysis saved as ``elevation.parquet``, in any version.

    Parameters
    ----------
    file
        A path, or a binary file that can be rewound.

    Returns
    -------
    Elevation
        Runs of even rows, a new run after each gap; NaN if a row has no angle. The file contains neither
        the method nor the uncertainty.

    Raises
    ------
    acromion.fusion.errors.FusionError
        As :func:`read_rows`; times that do not increase.
    OSError
        The path cannot be opened.
    """
    rows = read_rows(file)
    if len(rows) > 1:
        check_times(rows.time_s)
    steps_s = np.diff(rows.time_s)
    period_s = float(np.median(steps_s)) if len(steps_s) else 1.0
    cuts = [0, *(np.flatnonzero(steps_s > HOLE_PERIODS * period_s) + 1).tolist(), len(rows)]
    segments = [
        ElevationSegment(
            start_us=round(float(rows.time_s[a]) * MICROSECONDS),
            rate_hz=(b - a - 1) / float(rows.time_s[b - 1] - rows.time_s[a]) if b - a > 1 else 1 / period_s,
            elevation_deg=rows.elevation_deg[a:b],
            valid=rows.valid[a:b],
        )
        for a, b in pairwise(cuts)
        if b > a
    ]
    return Elevation(tuple(segments), None)


def read_rows(file: RecordingFile) -> ElevationRows:
    """Read the rows of an angle series without changes.

    Raises
    ------
    UnknownColumns, UnreadableFile
    acromion.fusion.errors.UnsafeArchive, acromion.fusion.errors.TooLong
        The compressed data is larger than any angle series.
    OSError
        The path cannot be opened.
    """
    if isinstance(file, str | PathLike):
        with Path(file).open("rb") as opened:
            return read_rows(opened)
    return _read_source(open_source(file, is_hashed=False))


def _read_source(source: Source) -> ElevationRows:
    source.file.seek(0)
    try:
        file = pq.ParquetFile(source.file)
        names = file.schema_arrow.names
        form = _find_form(names)
        if form is None:
            raise UnknownColumns(list=", ".join(names)[:200])
        check_pages(file.metadata, source.size_bytes)
        check_rows(file.metadata.num_rows, source.size_bytes, source.size_bytes, LEAST_ANGLE_BYTES)
        table = file.read([name for name in (form.time, form.angle, *_FLAGS) if name in names])
    except UNREADABLE as error:
        raise UnreadableFile from error
    time, angle = (table[name].to_numpy() for name in (form.time, form.angle))
    valid, analysed = (
        table[name].to_numpy().astype(np.bool_) if name in table.column_names else None for name in _FLAGS
    )
    return ElevationRows(
        time_s=np.asarray(_scale(time, form.per_second, np.float64), np.float64),
        elevation_deg=_scale(angle, form.per_deg, np.float32),
        valid=np.ones(len(time), np.bool_) if valid is None else valid,
        analysed=analysed,
        column=form.angle,
    )


def _find_form(names: Sequence[str]) -> Form | None:
    return next((form for form in FORMS if {form.time, form.angle} <= set(names)), None)


def _scale(values: NDArray[Any], per_unit: int, kind: type[np.floating[Any]]) -> NDArray[Any]:
    return values.astype(kind, copy=False) if per_unit == 1 else np.divide(values, kind(per_unit), dtype=kind)
