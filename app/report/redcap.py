"""For REDCap: a data dictionary that makes the form, and the row to import into it.

Source of the columns of the dictionary: REDCap's "Data Dictionary" upload file (18 columns, in this order).
One record is one recording; its id is the beginning of the file's hash, so that importing the same recording
twice gives one record.
"""

from collections.abc import Iterable, Mapping

from app.report.dictionary import name_unit
from app.report.summary import COLUMNS, NOT_OF_ONE, Column, Results, summarise_results
from app.report.tables import Cell, Row, encode_table

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
_SHOWN = tuple(column for column in COLUMNS if column.name not in NOT_OF_ONE)


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
    row = _describe(column.name, kind, f"{column.english} / {column.french}")
    row["Choices, Calculations, OR Slider Labels"] = _CHOICES.get(column.name)
    row["Field Note"] = name_unit(column.name) or None
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
