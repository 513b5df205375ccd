"""The tables of figures: one row for each recording, one for each hour and period, and their dictionary."""

import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from app.report.export.csv import INTERNATIONAL, Dialect, Origin, Row, encode_table, find_place
from app.report.figures import (
    PERIODS,
    SUMMARY,
    Column,
    Results,
    TableName,
    find_unit,
    read_figures,
    read_ranges,
)
from app.report.words.wording import LANGUAGES, load_wording


def summarise_results(results: Results) -> Row:
    """Return the row of one analysed recording."""
    told = read_figures(results)
    for suffix in ("", "_pose"):
        for name, (low, high) in read_ranges(results, suffix).items():
            told |= {f"{name}_low{suffix}": low, f"{name}_high{suffix}": high}
    told["warnings"] = " ".join(warning["code"] for warning in results["quality"]["warnings"])
    told |= {place: find_place(results, place) for place in ("path", "folder")}
    return {column.name: told.get(column.name) for column in SUMMARY}


def summarise_failure(origin: Origin, code: str) -> Row:
    """Return the row of a recording without result: only what is known."""
    empty: Row = dict.fromkeys(column.name for column in SUMMARY)
    return empty | asdict(origin) | {"folder": None, "error_code": code}


PERIOD_COLUMNS = [column.name for column in PERIODS]


def describe_periods(results: Results) -> list[Row]:
    """Return the rows of ``periods.csv`` for one recording."""
    who = {name: results["recording"][name] for name in ("file_name", "subject", "side")}
    who["path"] = find_place(results, "path")
    kinds = (("hour", "by_hour"), ("period", "by_period"), ("task", "by_task"))
    return [
        {**part, **who, "kind": kind, "period_kind": part.get("kind")}
        for kind, key in kinds
        for part in results["exposure"][key]
    ]


def encode_summary(rows: Iterable[Row], dialect: Dialect = INTERNATIONAL) -> bytes:
    """Write rows as CSV; text cells cannot become formulas."""
    return encode_table([column.name for column in SUMMARY], rows, dialect)


# The dictionary: name, unit and meaning of every column and field, in English and French.


DICTIONARY_COLUMNS = ["file", "column", "kind", "unit", "english", "french"]
_DOCUMENT_HEAD = """# Dictionary / Dictionnaire

Made from the code: `python -m app.report.export.columns > docs/dictionary.md`. A star stands for any name.
Empty (in JSON: null) is "not computable". Vide (en JSON : null) veut dire « non calculable ».
"""


def encode_dictionary() -> bytes:
    """Write the dictionary of the tables, of ``elevation.parquet`` and of ``results.json`` as CSV."""
    return encode_table(DICTIONARY_COLUMNS, describe_dictionary())


def describe_dictionary() -> list[Row]:
    """Return one row for each column of the tables and of the angles, and each field of ``results.json``."""
    rows: list[Row] = []

    def add(file: str, name: str, kind: str | None, told: Iterable[str]) -> None:
        english, french = told
        words = {"unit": find_unit(name), "english": english, "french": french}
        rows.append({"file": file, "column": name, "kind": kind, **words})

    tables: tuple[tuple[TableName, Sequence[Column]], ...] = (
        ("summary", SUMMARY),
        ("periods", PERIODS),
    )
    for table, columns in tables:
        for column in columns:
            told = (column.explain(language, table) for language in LANGUAGES)
            add(f"{table}.csv", column.name, column.kind, told)
    angles = [load_wording(language, "tables")["elevation"] for language in LANGUAGES]
    fields = [load_wording(language, "fields") for language in LANGUAGES]
    for file, words in (("elevation.parquet", angles), ("results.json", fields)):
        for name in words[0]:
            add(file, name, None, (one[name] for one in words))
    return rows


def write_document() -> str:
    """Write the dictionary as a page for people: ``docs/dictionary.md``."""
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


if __name__ == "__main__":
    sys.stdout.write(write_document())
