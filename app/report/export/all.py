"""Every file made from ``results.json`` for other programs."""

import io
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from app.report.export.columns import (
    DATAPACKAGE,
    encode_datapackage,
    encode_dictionary,
    encode_summary,
    summarise_results,
)
from app.report.export.csv import FRENCH_EXCEL, Row, encode_table
from app.report.export.parquet import lay_some_numbers, lay_some_texts
from app.report.export.xlsx import encode_workbook
from app.report.figures import SUMMARY, SUMMARY_OF_ONE, Results, find_unit
from app.report.words.wording import LANGUAGES

# REDCap: a data dictionary that creates the form, and the row to import into it.
#
# Source of the columns of the dictionary: REDCap's "Data Dictionary" upload file (18 columns, in this
# order). One record is one recording; its id is the beginning of the file's hash, so that importing the
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
    """Write the data dictionary that makes the form in a REDCap project."""
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
    """Write one row for each recording, ready for REDCap's "Data Import Tool"."""
    names = ["record_id", *(column.name for column in SUMMARY_OF_ONE), f"{FORM}_complete"]
    rows = (
        {"record_id": str(one["recording"]["sha256"])[:16], **summarise_results(one), f"{FORM}_complete": 2}
        for one in every
    )
    return encode_table(names, rows)


def export_results(results: Mapping[str, Any]) -> dict[str, bytes]:
    """Write the tables of one recording, by file name; every figure is the one of ``results.json``."""
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
    """Write one typed row for each recording: text or float64, null where it is not computable."""
    rows = [summarise_results(results) for results in every]
    lay: dict[str, Callable[..., pa.Array]] = {"text": lay_some_texts, "number": lay_some_numbers}
    columns = [lay[column.kind]([row[column.name] for row in rows]) for column in SUMMARY]
    body = io.BytesIO()
    table = pa.Table.from_arrays(columns, [column.name for column in SUMMARY])
    pq.write_table(table, body, compression="zstd")
    return body.getvalue()
