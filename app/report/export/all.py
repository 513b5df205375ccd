"""Every table for other programs: those of ``results.json``, Parquet, and REDCap.

The angle over time is in :mod:`acromion.app.report.export.angles`.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from acromion.app.report.export.tables import (
    DATAPACKAGE,
    FOR_IMPORT,
    FRENCH_EXCEL,
    Row,
    describe_tables,
    encode_datapackage,
    encode_dictionary,
    encode_rows,
    encode_table,
    list_columns,
    list_redcap_columns,
    name_variables,
)
from acromion.app.report.export.xlsx import encode_workbook
from acromion.app.report.figures import Column
from acromion.app.report.words.wording import LANGUAGES

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


# REDCap: a data dictionary that creates the form, and the row to import into it.
#
# Source of the columns of the dictionary: REDCap's "Data Dictionary" upload file (18 columns, in this
# order). One record is one recording, or one shift of it; its id is the start of the file's hash, so that
# importing the same recording twice gives one record.


FORM = "arm_elevation"
DICTIONARY_COLUMNS = [
    "Variable / Field Name", "Form Name", "Section Header", "Field Type", "Field Label",
    "Choices, Calculations, OR Slider Labels", "Field Note", "Text Validation Type OR Show Slider Number",
    "Text Validation Min", "Text Validation Max", "Identifier?", "Branching Logic (Show field only if...)",
    "Required Field?", "Custom Alignment", "Question Number (surveys only)", "Matrix Group Name",
    "Matrix Ranking?", "Field Annotation",
]  # fmt: skip
_CHOICES: Mapping[str, str] = {
    "side": "left, Left | right, Right | trunk, Trunk",
    "verdict": "good, Good | caution, Use with care | poor, Poor",
}


def encode_redcap_dictionary(further: Sequence[Column] = ()) -> bytes:
    """Encode the data dictionary that creates the form in a REDCap project."""
    name, form, _, kind, label, choices, note, validation, _, _, identifier, *_ = DICTIONARY_COLUMNS
    rows: Iterable[Row] = (
        {
            name: column.name,
            form: FORM,
            kind: "dropdown" if column.name in _CHOICES else "text",
            label: " / ".join(map(column.explain, LANGUAGES)),
            choices: _CHOICES.get(column.name),
            note: column.unit or None,
            validation: "number" if column.kind == "number" else None,
            identifier: "y" if column.name in {"subject", "file_name"} else None,
        }
        for column in list_redcap_columns(further)[:-1]  # REDCap itself adds the last one
    )
    return encode_table(DICTIONARY_COLUMNS, rows)


def encode_redcap_import(rows: Iterable[Row], further: Sequence[Column] = ()) -> bytes:
    """Encode rows of the summary for REDCap's "Data Import Tool"; failed recordings have no record."""
    names = name_variables(column.name for column in further)
    records = (
        {
            **row,
            **{name: row.get(header) for name, header in names.items()},
            "record_id": _identify_record(row),
            f"{FORM}_complete": 2,
        }
        for row in rows
        if row["sha256"]
    )
    return encode_table([column.name for column in list_redcap_columns(further)], records, FOR_IMPORT)


def _identify_record(row: Row) -> str:
    """Return the start of the file's hash; for a shift, followed by its date and time."""
    begin = re.sub(r"\D", "", str(row["shift"] or "").partition("/")[0][:16])
    return str(row["sha256"])[:16] + (f"_{begin}" if begin else "")


def export_results(results: Mapping[str, Any]) -> dict[str, bytes]:
    """Return the tables of one recording by file name; every figure is the one in ``results.json``."""
    rows = describe_tables([results])
    tables = {
        "summary.csv": encode_rows("summary", rows["summary"]),
        "summary_fr.csv": encode_rows("summary", rows["summary"], FRENCH_EXCEL),
        "summary.xlsx": encode_workbook(rows),
        "summary.parquet": encode_parquet("summary", rows["summary"]),
        "dictionary.csv": encode_dictionary(),
        "redcap_import.csv": encode_redcap_import(rows["summary"]),
        "redcap_dictionary.csv": encode_redcap_dictionary(),
    }
    return tables | {DATAPACKAGE: encode_datapackage(tables)}


def encode_parquet(table: str, rows: Sequence[Row], further: Sequence[Column] = ()) -> bytes:
    """Encode a table with typed columns: text or float64, null if not computable."""
    lay: dict[str, Callable[..., pa.Array]] = {"text": build_nullable_texts, "number": build_nullable_numbers}
    columns = list_columns(table, further)
    values = [lay[column.kind]([row.get(column.name) for row in rows]) for column in columns]
    body = io.BytesIO()
    pq.write_table(
        pa.Table.from_arrays(values, [column.name for column in columns]), body, compression="zstd"
    )
    return body.getvalue()
