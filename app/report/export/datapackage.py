"""The CSV tables described for programs: a Frictionless Data Package (version 1), ``datapackage.json``.

It says of each table how it is written, which columns it has, their kind, unit and meaning; empty is missing.
Shape: Frictionless Data Package and Table Schema.
"""

import json
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, Literal

from app.report.export.csv import FRENCH_EXCEL, INTERNATIONAL, PROBLEM_COLUMNS, Dialect
from app.report.figures import NOT_OF_ONE, PERIODS, SUMMARY, Column, find_unit

DATAPACKAGE = "datapackage.json"
_ALLOWED: Mapping[str, Sequence[str]] = {
    "side": ("left", "right"),
    "verdict": ("good", "caution", "poor"),
    "kind": ("hour", "period", "task"),
}
_DICTIONARY_COLUMNS = ("file", "column", "kind", "unit", "english", "french")


def encode_datapackage(tables: Collection[str]) -> bytes:
    """Describe those of the tables that we know; ``tables`` are names of files."""
    resources = [_describe_table(name, *_TABLES[name]) for name in sorted(tables) if name in _TABLES]
    package = {"profile": "tabular-data-package", "name": "acromion-results", "resources": resources}
    return (json.dumps(package, ensure_ascii=False, indent=1) + "\n").encode()


def _describe_table(name: str, dialect: Dialect, make: Callable[[Dialect], list[dict[str, Any]]]) -> Any:
    return {
        "profile": "tabular-data-resource",
        "name": name.removesuffix(".csv").replace("_", "-"),
        "path": name,
        "format": "csv",
        "mediatype": "text/csv",
        "encoding": "utf-8-sig" if dialect.mark else "utf-8",
        "dialect": {"delimiter": dialect.delimiter, "lineTerminator": dialect.line_end},
        "schema": {"fields": make(dialect), "missingValues": [""]},
    }


def _describe_column(
    column: Column, table: Literal["summary", "periods"], dialect: Dialect
) -> dict[str, Any]:
    field: dict[str, Any] = {"name": column.name, "title": column.explain("en", table)}
    unit = find_unit(column.name)
    if column.kind == "text":
        allowed = _ALLOWED.get(column.name)
        field |= {"type": "string"} | ({"constraints": {"enum": list(allowed)}} if allowed else {})
        return field
    field |= {"type": "number"} | ({"decimalChar": dialect.decimal} if dialect.decimal != "." else {})
    return field | ({"unit": unit} if unit else {})


def _describe_summary(dialect: Dialect) -> list[dict[str, Any]]:
    return [_describe_column(column, "summary", dialect) for column in SUMMARY]


def _describe_periods(dialect: Dialect) -> list[dict[str, Any]]:
    return [_describe_column(column, "periods", dialect) for column in PERIODS]


def _describe_redcap(dialect: Dialect) -> list[dict[str, Any]]:
    shown = [column for column in SUMMARY if column.name not in NOT_OF_ONE]
    first = {"name": "record_id", "type": "string"}
    last = {"name": "arm_elevation_complete", "type": "integer"}
    return [first, *(_describe_column(column, "summary", dialect) for column in shown), last]


def _describe_texts(names: Sequence[str]) -> Callable[[Dialect], list[dict[str, Any]]]:
    return lambda _dialect: [{"name": name, "type": "string"} for name in names]


_TABLES: Mapping[str, tuple[Dialect, Callable[[Dialect], list[dict[str, Any]]]]] = {
    "summary.csv": (INTERNATIONAL, _describe_summary),
    "summary_fr.csv": (FRENCH_EXCEL, _describe_summary),
    "periods.csv": (INTERNATIONAL, _describe_periods),
    "problems.csv": (INTERNATIONAL, _describe_texts(PROBLEM_COLUMNS)),
    "dictionary.csv": (INTERNATIONAL, _describe_texts(_DICTIONARY_COLUMNS)),
    "redcap_import.csv": (INTERNATIONAL, _describe_redcap),
}
