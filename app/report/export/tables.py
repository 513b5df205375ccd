"""The tables of figures: CSV, the rows of a recording, and the dictionary of their columns."""

import csv
import io
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any, Literal

from app.report.figures import (
    MARKS,
    PERIODS,
    SUMMARY,
    SUMMARY_OF_ONE,
    Column,
    Results,
    TableName,
    find_unit,
    read_figures,
    read_ranges,
)
from app.report.words.messages import describe_problem
from app.report.words.wording import LANGUAGES, Language, load_wording
from fusion.clocks import format_offset
from fusion.errors import Fact

# CSV, safe to open in a spreadsheet.

Cell = str | int | float | None
CellKind = Literal["text", "number"]
Row = dict[str, Cell]

# A sign that a spreadsheet reads as a formula, at the start of a cell, or of a cell in another dialect. The
# wide forms are on Japanese and Chinese keyboards.
_FORMULA = re.compile("(^|[;,\t\r\n\u007c])([\"' ]*)(?=[=+\\-@\t\r\x00\uff1d\uff0b\uff0d\uff20])")


@dataclass(frozen=True, slots=True)
class Dialect:
    """Format of a table: cell delimiter, decimal sign, encoding mark."""

    delimiter: str
    decimal: str
    mark: str
    line_end: str


INTERNATIONAL = Dialect(",", ".", "", "\n")
FRENCH_EXCEL = Dialect(";", ",", "\ufeff", "\r\n")
"""Opens in a French Excel by a double click, without reading 12.5 as the 12th of May."""


def encode_table(names: Sequence[str], rows: Iterable[Row], dialect: Dialect = INTERNATIONAL) -> bytes:
    """Encode a table as CSV (UTF-8); an empty cell is "not computable"."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter=dialect.delimiter, lineterminator=dialect.line_end)
    writer.writerow(names)
    for row in rows:
        writer.writerow([_write_cell(row.get(name), dialect) for name in names])
    return (dialect.mark + text.getvalue()).encode("utf-8")


def _write_cell(value: Cell, dialect: Dialect) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return guard_text(value)
    return str(value).replace(".", dialect.decimal)


def guard_text(text: str) -> str:
    """Put an apostrophe before any sign that a spreadsheet would read as a formula."""
    return _FORMULA.sub(r"\1\2'", text)


# The recording of a row: its path distinguishes two files with the same name.


@dataclass(frozen=True, slots=True)
class Origin:
    """Facts about a recording before it is read, and its location.

    ``path`` locates the recording: in a run relative to the given folder, in REST its address. ``folder``
    locates its results in the same way, and is empty if there are none.
    """

    file_name: str
    subject: str = ""
    side: str | None = None
    path: str = ""
    folder: str = ""


def add_origin(results: Mapping[str, Any], origin: Origin) -> dict[str, Any]:
    """Return the results with their origin, for the tables of many recordings.

    It is never in ``results.json``, which does not depend on the location of the file.
    """
    return {**results, "origin": {"path": origin.path, "folder": origin.folder}}


def find_place(results: Mapping[str, Any], name: str) -> str | None:
    """Return ``path`` or ``folder``; None for results without an origin."""
    place: str | None = results.get("origin", {}).get(name)
    return place or None


# Recordings without a result, as rows of ``problems.csv``.


PROBLEM_COLUMNS = ["file", "code", "title", "detail", "fix", "path", "subject", "side"]


def build_problem_row(origin: Origin, code: str, facts: Mapping[str, Fact], language: Language) -> Row:
    """Return the row of one recording."""
    problem = describe_problem(code, facts, language)
    words = {"title": problem.title, "detail": problem.detail, "fix": problem.fix}
    who = {"path": origin.path, "subject": origin.subject, "side": origin.side}
    return {"file": origin.file_name, "code": code, **words, **who}


# The rows of one recording.


def summarise_results(results: Results) -> Row:
    """Return the row of one analysed recording."""
    shown = read_figures(results)
    shown["start"], shown["utc_offset"] = split_offset(shown["start"])
    for suffix in ("", "_pose"):
        shown |= _name_ends(read_ranges(results, suffix), suffix)
    shown["warnings"] = " ".join(warning["code"] for warning in results["quality"]["warnings"])
    shown |= {place: find_place(results, place) for place in ("path", "folder")}
    return {column.name: shown.get(column.name) for column in SUMMARY}


def split_offset(moment: Cell) -> tuple[Cell, str | None]:
    """Return a time in ISO 8601 as local time without an offset, and "UTC-05:00", None if unknown.

    All rows of a table therefore have one form, whether or not their recordings state an offset.
    """
    if not isinstance(moment, str) or moment.startswith("P"):  # a time from the first sample: "PT90S"
        return moment, None
    found = datetime.fromisoformat(moment)
    offset = found.utcoffset()
    shown = None if offset is None else format_offset(round(offset.total_seconds()))
    return found.replace(tzinfo=None).isoformat(), shown


def summarise_failure(origin: Origin, code: str) -> Row:
    """Return the row of a recording without a result: only the known facts."""
    empty: Row = dict.fromkeys(column.name for column in SUMMARY)
    return empty | asdict(origin) | {"folder": None, "error_code": code}


PERIOD_COLUMNS = [column.name for column in PERIODS]


def describe_periods(results: Results) -> list[Row]:
    """Return the rows of ``periods.csv`` for one recording."""
    who = {name: results["recording"][name] for name in ("file_name", "subject", "side")}
    who["path"] = find_place(results, "path")
    kinds = (("hour", "by_hour"), ("period", "by_period"), ("task", "by_task"))
    return [
        {**part, **_name_ends(part["intervals"]), **who, "kind": kind, "period_kind": part.get("kind")}
        for kind, key in kinds
        for part in results["exposure"][key]
    ]


MARK_COLUMNS = [column.name for column in MARKS]


def describe_marks(results: Results) -> list[Row]:
    """Return the rows of ``marks.csv`` for one recording."""
    who = {name: results["recording"][name] for name in ("file_name", "subject", "side")}
    who["path"] = find_place(results, "path")
    parts = results["exposure"].get("by_mark") or [{}]
    rest = {f"rest_{name}": value for name, value in parts[-1].items()}
    return [{**part, **rest, **who, "mark_s": part["end_s"]} for part in parts[:-1]]


def _name_ends(ranges: Mapping[str, tuple[Cell, Cell]], suffix: str = "") -> Row:
    """Return both ends of each range as cells: ``<figure>_low``, ``<figure>_high``."""
    ends = (("low", 0), ("high", 1))
    return {f"{name}_{end}{suffix}": pair[k] for name, pair in ranges.items() for end, k in ends}


def encode_summary(rows: Iterable[Row], dialect: Dialect = INTERNATIONAL) -> bytes:
    """Encode rows as CSV; text cells cannot become formulas."""
    return encode_table([column.name for column in SUMMARY], rows, dialect)


# The dictionary: name, unit and meaning of every column and field, in English and French.


DICTIONARY_COLUMNS = ["file", "column", "kind", "unit", "english", "french"]
_DOCUMENT_HEAD = """Made from the code: `python -m benchmarks.reference`

# Dictionary / Dictionnaire

A star means any name. Empty (in JSON: null) means "not computable".
Vide (en JSON : null) veut dire « non calculable ».
"""


def encode_dictionary() -> bytes:
    """Encode the dictionary of the tables, of ``elevation.parquet`` and of ``results.json`` as CSV."""
    return encode_table(DICTIONARY_COLUMNS, describe_dictionary())


def describe_dictionary() -> list[Row]:
    """Return one row for each column of the tables and of the angles, and each field of ``results.json``."""
    rows: list[Row] = []

    def add(file: str, name: str, kind: str | None, shown: Iterable[str]) -> None:
        english, french = shown
        words = {"unit": find_unit(name), "english": english, "french": french}
        rows.append({"file": file, "column": name, "kind": kind, **words})

    tables: tuple[tuple[TableName, Sequence[Column]], ...] = (
        ("summary", SUMMARY),
        ("periods", PERIODS),
        ("marks", MARKS),
    )
    for table, columns in tables:
        for column in columns:
            shown = (column.explain(language, table) for language in LANGUAGES)
            add(f"{table}.csv", column.name, column.kind, shown)
    angles = [load_wording(language, "tables")["elevation"] for language in LANGUAGES]
    fields = [load_wording(language, "fields") for language in LANGUAGES]
    for file, words in (("elevation.parquet", angles), ("results.json", fields)):
        for name in words[0]:
            add(file, name, None, (one[name] for one in words))
    return rows


def write_document() -> str:
    """Return the dictionary as a page: ``docs/reference/dictionary.md``."""
    rows, parts = describe_dictionary(), [_DOCUMENT_HEAD]
    for file in dict.fromkeys(row["file"] for row in rows):
        parts.append(f"\n## {file}\n\n| name | unit | meaning | sens |\n|---|---|---|---|\n")
        parts += [
            f"| `{row['column']}` | {row['unit']} | {row['english']} | {row['french']} |\n"
            for row in rows
            if row["file"] == file
        ]
    return "".join(parts)


def find_paths(value: Any, path: str = "") -> Iterator[str]:
    """Return the path of every field of a results document: ``exposure.bins[].percent``."""
    if isinstance(value, Mapping):
        for key, inner in value.items():
            yield from find_paths(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and value and isinstance(value[0], Mapping):
        for key in dict.fromkeys(key for item in value for key in item):
            inner = next(item[key] for item in value if key in item)
            yield from find_paths(inner, f"{path}[].{key}")
    else:
        yield path


# The CSV tables described for programs: a Frictionless Data Package (version 1) with Table Schema. It states
# the format of each table and the kind, unit and meaning of its columns; empty is missing.


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
    "marks.csv": (INTERNATIONAL, MARKS),
    "problems.csv": (INTERNATIONAL, PROBLEM_COLUMNS),
    "dictionary.csv": (INTERNATIONAL, DICTIONARY_COLUMNS),
    "redcap_import.csv": (INTERNATIONAL, ("record_id", *SUMMARY_OF_ONE, _COMPLETE)),
}
"""Format and columns of each table; columns without a declaration are text."""


def encode_datapackage(tables: Collection[str]) -> bytes:
    """Describe the known ones among the tables; ``tables`` are file names."""
    resources = []
    for name in sorted(_TABLES.keys() & tables):
        dialect, columns = _TABLES[name]
        table: TableName = "periods" if columns is PERIODS else "marks" if columns is MARKS else "summary"
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
