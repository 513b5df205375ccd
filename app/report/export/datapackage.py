"""The CSV tables described for programs: a Frictionless Data Package (version 1), ``datapackage.json``.

It says of each table how it is written, which columns it has, their kind, unit and meaning; empty is missing.
Shape: Frictionless Data Package and Table Schema.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from app.report.export.columns import DICTIONARY_COLUMNS
from app.report.export.csv import FRENCH_EXCEL, INTERNATIONAL, PROBLEM_COLUMNS, Dialect
from app.report.figures import PERIODS, SUMMARY, SUMMARY_OF_ONE, Column, TableName, find_unit

DATAPACKAGE = "datapackage.json"
_ALLOWED: Mapping[str, Sequence[str]] = {
    "side": ("left", "right"),
    "verdict": ("good", "caution", "poor"),
    "kind": ("hour", "period", "task"),
}
_COMPLETE = "arm_elevation_complete"
_TABLES: Mapping[str, tuple[Dialect, Sequence[Column | str]]] = {
    "summary.csv": (INTERNATIONAL, SUMMARY),
    "summary_fr.csv": (FRENCH_EXCEL, SUMMARY),
    "periods.csv": (INTERNATIONAL, PERIODS),
    "problems.csv": (INTERNATIONAL, PROBLEM_COLUMNS),
    "dictionary.csv": (INTERNATIONAL, DICTIONARY_COLUMNS),
    "redcap_import.csv": (INTERNATIONAL, ("record_id", *SUMMARY_OF_ONE, _COMPLETE)),
}
"""How each table is written, and its columns; those without a declaration are text."""


def encode_datapackage(tables: Collection[str]) -> bytes:
    """Describe those of the tables that we know; ``tables`` are names of files."""
    resources = []
    for name in sorted(_TABLES.keys() & tables):
        dialect, columns = _TABLES[name]
        table: TableName = "periods" if columns is PERIODS else "summary"
        resource = {
            "profile": "tabular-data-resource",
            "name": name.removesuffix(".csv").replace("_", "-"),
            "path": name,
            "format": "csv",
            "mediatype": "text/csv",
            "encoding": "utf-8-sig" if dialect.mark else "utf-8",
            "dialect": {"delimiter": dialect.delimiter, "lineTerminator": dialect.line_end},
            "schema": {
                "fields": [_describe_column(column, table, dialect) for column in columns],
                "missingValues": [""],
            },
        }
        resources.append(resource)
    package = {"profile": "tabular-data-package", "name": "acromion-results", "resources": resources}
    return (json.dumps(package, ensure_ascii=False, indent=1) + "\n").encode()


def _describe_column(column: Column | str, table: TableName, dialect: Dialect) -> dict[str, Any]:
    if isinstance(column, str):
        return {"name": column, "type": "integer" if column == _COMPLETE else "string"}
    field: dict[str, Any] = {"name": column.name, "title": column.explain("en", table)}
    if column.kind == "text":
        allowed = _ALLOWED.get(column.name)
        return field | {"type": "string"} | ({"constraints": {"enum": list(allowed)}} if allowed else {})
    field |= {"type": "number"} | ({"decimalChar": dialect.decimal} if dialect.decimal != "." else {})
    unit = find_unit(column.name)
    return field | ({"unit": unit} if unit else {})
