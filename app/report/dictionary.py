"""What every column and every field is called, holds and means, in English and French; made from the code."""

import sys
from collections.abc import Iterator, Mapping
from typing import Any

from app.report.summary import COLUMNS, PERIOD_FIELDS
from app.report.tables import Cell, Row, encode_table
from app.report.wording import load_wording

DICTIONARY_COLUMNS = ["file", "column", "kind", "unit", "english", "french"]
_DOCUMENT_HEAD = """# Dictionary / Dictionnaire

Made from the code: `python -m app.report.dictionary > docs/dictionary.md`. A star stands for any name. Empty
(in JSON: null) is "not computable". Vide (en JSON : null) veut dire « non calculable ».
"""
_UNITS = (
    ("_percent", "%"),
    ("_per_h", "1/h"),
    ("_dps", "deg/s"),
    ("_deg", "deg"),
    ("_hz", "Hz"),
    ("_s", "s"),
)


def encode_dictionary() -> bytes:
    """Write the dictionary of ``summary.csv``, ``periods.csv`` and ``results.json`` as CSV."""
    return encode_table(DICTIONARY_COLUMNS, list_dictionary())


def list_dictionary() -> list[Row]:
    """Give one row for each column of the tables and each field of ``results.json``."""
    summary = [
        _describe("summary.csv", column.name, column.kind, column.english, column.french)
        for column in COLUMNS
    ]
    return [
        *summary,
        *(_describe("periods.csv", *field) for field in PERIOD_FIELDS),
        *_describe_fields(),
    ]


def write_document() -> str:
    """Write the dictionary as a page for people: ``docs/dictionary.md``."""
    rows, parts = list_dictionary(), [_DOCUMENT_HEAD]
    for file in dict.fromkeys(row["file"] for row in rows):
        parts.append(f"\n## {file}\n\n| name | unit | meaning | sens |\n|---|---|---|---|\n")
        parts += [
            f"| `{row['column']}` | {row['unit']} | {row['english']} | {row['french']} |\n"
            for row in rows
            if row["file"] == file
        ]
    return "".join(parts)


def name_unit(name: str) -> str:
    """Read the unit off the end of a name, where it always stands; ends of ranges stand behind it."""
    stem = name.removesuffix("_low").removesuffix("_high").removesuffix("[]")
    return next((unit for ending, unit in _UNITS if stem.endswith(ending)), "")


def list_paths(value: Any, path: str = "") -> Iterator[str]:
    """Name every field of a results document: ``exposure.bins[].percent``."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from list_paths(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for key in dict.fromkeys(key for item in value for key in item):
            inner = next(item[key] for item in value if key in item)
            yield from list_paths(inner, f"{path}[].{key}")
    else:
        yield path


def _describe_fields() -> list[Row]:
    english, french = (load_wording(language, "fields")["field"] for language in ("en", "fr"))
    return [_describe("results.json", path, "", english[path], french[path]) for path in english]


def _describe(file: str, column: str, kind: str, english: str, french: str) -> dict[str, Cell]:
    row: dict[str, Cell] = {"file": file, "column": column, "kind": kind or None}
    return row | {"unit": name_unit(column), "english": english, "french": french}


if __name__ == "__main__":
    sys.stdout.write(write_document())
