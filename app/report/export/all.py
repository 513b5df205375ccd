"""Every file made from ``results.json`` for other programs."""

import io
from collections.abc import Callable, Iterable, Mapping
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from app.report.export.columns import encode_dictionary, encode_summary, summarise_results
from app.report.export.csv import FRENCH_EXCEL, Cell, Row, encode_table
from app.report.export.datapackage import DATAPACKAGE, encode_datapackage
from app.report.export.parquet import lay_some_numbers, lay_some_texts
from app.report.export.xlsx import encode_workbook
from app.report.figures import NOT_OF_ONE, SUMMARY, Column, Results, find_unit
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
_SHOWN = tuple(column for column in SUMMARY if column.name not in NOT_OF_ONE)


def encode_redcap_dictionary() -> bytes:
    """Write the data dictionary that makes the form in a REDCap project."""
    first = _describe("record_id", "text", "Record: the beginning of the file's SHA-256")
    return encode_table(DICTIONARY_COLUMNS, [first, *map(_describe_column, _SHOWN)])


def encode_redcap_import(every: Iterable[Results]) -> bytes:
    """Write one row for each recording, ready for REDCap's "Data Import Tool"."""
    names = ["record_id", *(column.name for column in _SHOWN), f"{FORM}_complete"]
    return encode_table(names, map(_make_record, every))


def _make_record(results: Results) -> Row:
    sha256 = str(results["recording"]["sha256"])
    return {"record_id": sha256[:16], **summarise_results(results), f"{FORM}_complete": 2}


def _describe_column(column: Column) -> Row:
    kind = "dropdown" if column.name in _CHOICES else "text"
    row = _describe(column.name, kind, " / ".join(map(column.explain, LANGUAGES)))
    row["Choices, Calculations, OR Slider Labels"] = _CHOICES.get(column.name)
    row["Field Note"] = find_unit(column.name) or None
    if column.kind == "number":
        row["Text Validation Type OR Show Slider Number"] = "number"
    if column.name in {"subject", "file_name"}:
        row["Identifier?"] = "y"
    return row


def _describe(name: str, kind: str, label: str) -> Row:
    row: dict[str, Cell] = dict.fromkeys(DICTIONARY_COLUMNS)
    return row | {
        "Variable / Field Name": name,
        "Form Name": FORM,
        "Field Type": kind,
        "Field Label": label,
    }


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
