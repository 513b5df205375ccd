"""Every file for other programs: the tables of ``results.json``, REDCap, and the angle over time."""

from __future__ import annotations

import gzip
import io
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
from numpy.typing import NDArray

from app.report.export.tables import (
    DATAPACKAGE,
    FRENCH_EXCEL,
    Row,
    encode_datapackage,
    encode_dictionary,
    encode_summary,
    encode_table,
    summarise_results,
)
from app.report.export.xlsx import encode_workbook
from app.report.figures import SUMMARY, SUMMARY_OF_ONE, Results, find_unit
from app.report.words.wording import LANGUAGES
from fusion.angle_files.elevation_parquet import SCHEMA, STEPS_PER_DEG, read_rows
from fusion.quality.time_account import leave_out
from fusion.recording import BoolArray, FloatArray, Span

if TYPE_CHECKING:
    from fusion.elevation import Elevation, ElevationSegment


# Columns of a Parquet file, built from buffers: ``pyarrow.array`` and ``pyarrow.table`` load pandas to check
# whether a list is one of its columns, which takes longer than writing the file.


def build_numbers(values: NDArray[Any], known: NDArray[np.bool_] | None = None) -> pa.Array:
    """Return a column of numbers, shapes (n,); values that are not ``known`` are null."""
    close = pa.py_buffer(np.ascontiguousarray(values))
    marks = None if known is None or known.all() else _pack(known)
    return pa.Array.from_buffers(pa.from_numpy_dtype(values.dtype), len(values), [marks, close])


def build_flags(flags: NDArray[np.bool_]) -> pa.Array:
    """Return a column of booleans without nulls; shape (n,)."""
    return pa.Array.from_buffers(pa.bool_(), len(flags), [None, _pack(flags)])


def build_nullable_numbers(values: Sequence[float | None]) -> pa.Array:
    """Return a column of numbers; None becomes null."""
    filled = np.array([0.0 if value is None else value for value in values], np.float64)
    return build_numbers(filled, _find_known(values))


def build_nullable_texts(texts: Sequence[str | None]) -> pa.Array:
    """Return a column of text; None becomes null."""
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
        pa.field("analysed", pa.bool_(), nullable=False),
    ],
    {"schema": SCHEMA},
)
_ENCODING = {"time_us": "DELTA_BINARY_PACKED", "elevation_cdeg": "DELTA_BINARY_PACKED"}
_MOST_HZ = 100.5
"""A nominal 100 Hz sensor runs at 100 ± 0.1 Hz and keeps every sample."""

_ROWS_AT_ONCE = 1 << 20


def write_elevation(elevation: Elevation, path: Path, exclusions: tuple[Span, ...] = ()) -> None:
    """Write ``time_us`` (from the first sample), ``elevation_cdeg``, ``valid`` and ``analysed``.

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
        for table in _gather(table for one, kept in both for table in _lay_segment(one, kept.valid)):
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


def _lay_segment(segment: ElevationSegment, analysed: BoolArray) -> Iterator[pa.Table]:
    step = max(1, math.ceil(segment.rate_hz / _MOST_HZ))
    angle_deg, valid, analysed = segment.elevation_deg[::step], segment.valid[::step], analysed[::step]
    known = np.isfinite(angle_deg)
    for first, stop in segment.bridged:
        known[math.ceil(first / step) : math.ceil(stop / step)] = False
    for first in range(0, len(angle_deg), _ROWS_AT_ONCE):
        rows = slice(first, min(first + _ROWS_AT_ONCE, len(angle_deg)))
        time_us = np.arange(rows.start, rows.stop) * (step * segment.period_us) + segment.start_us
        angle_cdeg = np.where(known[rows], angle_deg[rows], np.float32(0.0)) * np.float32(STEPS_PER_DEG)
        columns = [
            build_numbers(_round(time_us).astype(np.int64)),
            build_numbers(_round(angle_cdeg).astype(np.int16), known[rows]),
            build_flags(valid[rows] & known[rows]),
            build_flags(analysed[rows] & known[rows]),
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


# REDCap: a data dictionary that creates the form, and the row to import into it.
#
# Source of the columns of the dictionary: REDCap's "Data Dictionary" upload file (18 columns, in this
# order). One record is one recording; its id is the start of the file's hash, so that importing the
# same recording twice gives one record.


FORM = "arm_elevation"
DICTIONARY_COLUMNS = [
    "Variable / Field Name", "Form Name", "Section Header", "Field Type", "Field Label",
    "Choices, Calculations, OR Slider Labels", "Field Note", "Text Validation Type OR Show Slider Number",
    "Text Validation Min", "Text Validation Max", "Identifier?", "Branching Logic (Show field only if...)",
    "Required Field?", "Custom Alignment", "Question Number (surveys only)", "Matrix Group Name",
    "Matrix Ranking?", "Field Annotation",
]  # fmt: skip
_CHOICES: Mapping[str, str] = {
    "side": "left, Left | right, Right",
    "verdict": "good, Good | caution, Use with care | poor, Poor",
}


def encode_redcap_dictionary() -> bytes:
    """Encode the data dictionary that creates the form in a REDCap project."""
    name, form, _, kind, label, choices, note, validation, _, _, identifier, *_ = DICTIONARY_COLUMNS
    first: Row = {name: "record_id", form: FORM, kind: "text"}
    first[label] = "Record: the beginning of the file's SHA-256"
    rows: Iterable[Row] = (
        {
            name: column.name,
            form: FORM,
            kind: "dropdown" if column.name in _CHOICES else "text",
            label: " / ".join(map(column.explain, LANGUAGES)),
            choices: _CHOICES.get(column.name),
            note: find_unit(column.name) or None,
            validation: "number" if column.kind == "number" else None,
            identifier: "y" if column.name in {"subject", "file_name"} else None,
        }
        for column in SUMMARY_OF_ONE
    )
    return encode_table(DICTIONARY_COLUMNS, (first, *rows))


def encode_redcap_import(every: Iterable[Results]) -> bytes:
    """Encode one row per recording for REDCap's "Data Import Tool"."""
    names = ["record_id", *(column.name for column in SUMMARY_OF_ONE), f"{FORM}_complete"]
    rows = (
        {"record_id": str(one["recording"]["sha256"])[:16], **summarise_results(one), f"{FORM}_complete": 2}
        for one in every
    )
    return encode_table(names, rows)


def export_results(results: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the tables of one recording by file name; every figure is the one in ``results.json``."""
    row = summarise_results(results)
    tables = {
        "summary.csv": encode_summary([row]),
        "summary_fr.csv": encode_summary([row], FRENCH_EXCEL),
        "summary.xlsx": encode_workbook([results]),
        "summary.parquet": encode_parquet([results]),
        "dictionary.csv": encode_dictionary(),
        "redcap_import.csv": encode_redcap_import([results]),
        "redcap_dictionary.csv": encode_redcap_dictionary(),
    }
    return tables | {DATAPACKAGE: encode_datapackage(tables)}


def encode_parquet(every: list[Mapping[str, Any]]) -> bytes:
    """Encode one typed row per recording: text or float64, null if not computable."""
    rows = [summarise_results(results) for results in every]
    lay: dict[str, Callable[..., pa.Array]] = {"text": build_nullable_texts, "number": build_nullable_numbers}
    columns = [lay[column.kind]([row[column.name] for row in rows]) for column in SUMMARY]
    body = io.BytesIO()
    table = pa.Table.from_arrays(columns, [column.name for column in SUMMARY])
    pq.write_table(table, body, compression="zstd")
    return body.getvalue()
