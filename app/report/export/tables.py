"""The tables of figures: CSV, the rows of a recording, and the dictionary of their columns."""

import csv
import io
import json
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from typing import Any, Literal, get_args

from acromion.app.report.figures import (
    SUMMARY,
    SUMMARY_OF_ONE,
    TABLES,
    Column,
    Results,
    find_unit,
    names_task,
    read_figures,
    read_ranges,
)
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.wording import LANGUAGES, Language, load_wording
from acromion.app.request import MIN_HOURS, find_code
from acromion.fusion.clocks import format_offset, in_zone, read_clock
from acromion.fusion.conventions import FORMULA_SIGN, FORMULA_START, HOUR_S, Side, judge_length
from acromion.fusion.diary import plain_word
from acromion.fusion.errors import Fact

# CSV, safe to open in a spreadsheet.

Cell = str | int | float | None
CellKind = Literal["text", "number"]
Row = dict[str, Cell]

_FORMULA = re.compile(FORMULA_START + FORMULA_SIGN)
_NUMBER = re.compile(r"[+-]?(?:0|[1-9]\d{0,14})(?:\.\d{1,15}|,(?!\d{3}$)\d{1,15})?", re.ASCII)
"""A plain number; not a code with a leading zero ("007"), nor "1,500", whose comma has two meanings."""


@dataclass(frozen=True, slots=True)
class Dialect:
    """Format of a table: cell delimiter, decimal sign, encoding mark.

    ``is_guarded``: text is safe to open in a spreadsheet (:func:`guard_text`); a program that imports the
    table would keep the apostrophe as data.
    """

    delimiter: str
    decimal: str
    mark: str
    line_end: str
    is_guarded: bool = True


INTERNATIONAL = Dialect(",", ".", "", "\n")
FOR_IMPORT = replace(INTERNATIONAL, is_guarded=False)
FRENCH_EXCEL = Dialect(";", ",", "\ufeff", "\r\n")
"""Opens in a French Excel by a double click, without reading 12.5 as the 12th of May."""


def encode_table(names: Sequence[str], rows: Iterable[Row], dialect: Dialect = INTERNATIONAL) -> bytes:
    """Encode a table as CSV (UTF-8); an empty cell is "not computable"."""
    text = io.StringIO()
    writer = csv.writer(text, delimiter=dialect.delimiter, lineterminator=dialect.line_end)
    writer.writerow([_write_cell(name, dialect) for name in names])
    for row in rows:
        writer.writerow([_write_cell(row.get(name), dialect) for name in names])
    return (dialect.mark + text.getvalue()).encode("utf-8")


def _write_cell(value: Cell, dialect: Dialect) -> str:
    if value is None:
        return ""
    if isinstance(value, str):
        return guard_text(value) if dialect.is_guarded else value
    return str(value).replace(".", dialect.decimal)


def guard_text(text: str) -> str:
    """Put an apostrophe before any sign that a spreadsheet would read as a formula; numbers stay."""
    return text if _NUMBER.fullmatch(text) else _FORMULA.sub(r"\1\2'", text)


# The recording of a row: its path distinguishes two files with the same name.


@dataclass(frozen=True, slots=True)
class Origin:
    """Facts about a recording before it is read, and its location.

    ``path`` locates the recording: in a run relative to the given folder, in REST its address. ``folder``
    locates its results in the same way, and is empty if there are none. ``settings``: what a person stated
    for it, as JSON.
    """

    file_name: str
    subject: str = ""
    side: str | None = None
    path: str = ""
    folder: str = ""
    settings: str = ""


def add_origin(results: Mapping[str, Any], origin: Origin) -> dict[str, Any]:
    """Return the results with their origin, for the tables of many recordings.

    It is never in ``results.json``, which does not depend on the location of the file.
    """
    places = {"path": origin.path, "folder": origin.folder, "settings": origin.settings}
    return {**results, "origin": places}


def find_place(results: Mapping[str, Any], name: str) -> str | None:
    """Return ``path``, ``folder`` or ``settings``; None for results without an origin."""
    place: str | None = results.get("origin", {}).get(name)
    return place or None


# Recordings without a result, as rows of ``problems.csv``.


def build_problem_row(origin: Origin, code: str, facts: Mapping[str, Fact], language: Language) -> Row:
    """Return the row of one recording."""
    problem = describe_problem(code, facts, language)
    words = {"title": problem.title, "detail": problem.detail, "fix": problem.fix}
    who = {"path": origin.path, "subject": origin.subject, "side": origin.side}
    return {"file_name": origin.file_name, "code": code, **words, **who}


# The rows of one recording.


_SUMMARY_NAMES = tuple(column.name for column in SUMMARY)
_OF_RECORDING = {"rate_hz", "recorded_s", "analysed_s", "missing_s", "excluded_s", "pose_sigma_deg"}


def summarise_results(results: Results) -> Row:
    """Return the row of one analysed recording."""
    shown = read_figures(results)
    shown["start"], shown["utc_offset"] = split_offset(shown["start"])
    for suffix in ("", "_pose"):
        shown |= _name_ends(read_ranges(results, suffix), suffix)
    shown["warnings"] = " ".join(warning["code"] for warning in results["quality"]["warnings"])
    shown |= {place: find_place(results, place) for place in ("path", "folder", "settings")}
    if shown["side"] == "trunk":  # it has no figure of an arm
        numbers = (column.name for column in SUMMARY if column.kind == "number")
        shown |= dict.fromkeys(name for name in numbers if name not in _OF_RECORDING)
    return {name: shown.get(name) for name in _SUMMARY_NAMES}


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


def describe_tables(every: Iterable[Results], min_hours: float = MIN_HOURS) -> dict[str, list[Row]]:
    """Return the rows of every table of analysed recordings, by the table's name.

    A recording of the trunk is only in the summary and the warnings.
    ``min_hours``: the least analysed time of a day that counts.
    """
    tables: dict[str, list[Row]] = {name: [] for name in ("summary", "days", *_DESCRIBE)}
    for results in every:
        summary = summarise_results(results)
        tables["summary"].append(summary)
        if results["recording"]["side"] == "trunk":
            tables["warnings"] += _describe_warnings(results)
            continue
        if results["recording"]["subject"]:  # a day belongs to a known person
            tables["days"].append(_describe_day(results, summary, min_hours))
        for name, describe in _DESCRIBE.items():
            tables[name] += describe(results)
    tables["days"].sort(key=_place_day)
    return tables


def _describe_hours(results: Results) -> list[Row]:
    return [_describe_part(results, part) for part in results["exposure"]["by_hour"]]


def _describe_periods(results: Results) -> list[Row]:
    return [_describe_part(results, part) for part in results["exposure"]["by_period"]]


def _describe_tasks(results: Results) -> list[Row]:
    """Return the tasks of the diary: rows of one kind and name pooled; breaks are not tasks."""
    return [
        _describe_part(results, part)
        for part in results["exposure"]["by_task"]
        if names_task(part["kind"], part["label"], part["excluded_as"])
    ]


def _describe_postures(results: Results) -> list[Row]:
    """Return the postures; results of older versions have none."""
    return [_describe_part(results, part) for part in results["exposure"].get("by_posture", ())]


def _describe_part(results: Results, part: Mapping[str, Any]) -> Row:
    return {
        **part,
        **_name_ends(part["intervals"]),
        **_name_recording(results),
        **_describe_clock(results, part["start_s"], part["end_s"]),
    }


def _describe_day(results: Results, summary: Row, min_hours: float) -> Row:
    duration_s = results["recording"]["duration_s"]
    left_out = judge_length(duration_s, results["time"]["analysed_s"], min_hours * HOUR_S)
    return summary | _describe_clock(results, 0.0, duration_s) | {"left_out": left_out}


def _place_day(row: Row) -> tuple[str, ...]:
    return tuple(str(row[name] or "") for name in ("subject", "side", "start", "path"))


def _describe_marks(results: Results) -> list[Row]:
    parts = results["exposure"].get("by_mark") or [{}]
    rest = {f"rest_{name}": value for name, value in parts[-1].items()}
    who = _name_recording(results)
    rows = [{**part, **rest, **who, "mark_s": part["end_s"]} for part in parts[:-1]]
    clocks = [_describe_clock(results, row["mark_s"], row["mark_s"]) for row in rows]
    return [{**row, **clock, "at": clock["start"]} for row, clock in zip(rows, clocks, strict=True)]


def _describe_bins(results: Results) -> list[Row]:
    return [_name_recording(results) | part for part in results["exposure"]["bins"]]


def _describe_warnings(results: Results) -> list[Row]:
    return [
        flag | _name_recording(results) | {place: split_offset(flag[place])[0] for place in ("first", "last")}
        for flag in results["quality"]["warnings"]
    ]


_DESCRIBE: Mapping[str, Callable[[Results], list[Row]]] = {
    "hours": _describe_hours,
    "periods": _describe_periods,
    "tasks": _describe_tasks,
    "postures": _describe_postures,
    "marks": _describe_marks,
    "bins": _describe_bins,
    "warnings": _describe_warnings,
}


def _name_recording(results: Results) -> Row:
    who = {name: results["recording"][name] for name in ("file_name", "subject", "side")}
    return {**who, "path": find_place(results, "path")}


def _describe_clock(results: Results, start_s: float, end_s: float) -> Row:
    """Return date, start and end of a part by the recording's local clock, and the offset at its start."""
    recording = results["recording"]
    start = in_zone(
        datetime.fromisoformat(recording["start"]) if recording["start"] else None, recording["time_zone"]
    )
    if start is None:
        return {"day": None, "start": None, "end": None, "utc_offset": None}
    (first, offset), (last, _) = (
        split_offset(read_clock(start, round(at_s * 1_000_000)).isoformat(timespec="seconds"))
        for at_s in (start_s, end_s)
    )
    return {"day": str(first)[:10], "start": first, "end": last, "utc_offset": offset}


def _name_ends(ranges: Mapping[str, tuple[Cell, Cell]], suffix: str = "") -> Row:
    """Return both ends of each range as cells: ``<figure>_low``, ``<figure>_high``."""
    ends = (("low", 0), ("high", 1))
    return {f"{name}_{end}{suffix}": pair[k] for name, pair in ranges.items() for end, k in ends}


def type_further(
    cells: Mapping[str, Mapping[str, str]],
) -> tuple[tuple[Column, ...], dict[str, Row]]:
    """Return the further columns of a list of participants, and their typed cells by recording.

    ``cells``: the cells of each recording as text. A column is a number if all its values are plain numbers;
    an empty cell becomes None, and so does a word for a missing value (:func:`find_code`) among numbers.
    """
    columns = []
    for name in dict.fromkeys(name for row in cells.values() for name in row):
        values = [text for row in cells.values() if find_code(text := row.get(name, ""))]
        is_number = bool(values) and all(map(_NUMBER.fullmatch, values))
        columns.append(Column("{header}", {"header": name}, "number" if is_number else "text"))
    numbers = {column.name for column in columns if column.kind == "number"}
    typed = {
        key: {
            name: (_read_number(text) if find_code(text) else None) if name in numbers else text or None
            for name, text in row.items()
        }
        for key, row in cells.items()
    }
    return tuple(columns), typed


def _read_number(text: str) -> float:
    number = float(text.replace(",", "."))
    return int(number) if number.is_integer() else number


def name_variables(headers: Iterable[str]) -> dict[str, str]:
    """Return headers by the names that REDCap and BIDS accept: "Age (years)" by ``age_years``.

    A name starts with a letter and contains lower-case letters, digits and underscores. A header without
    such letters is numbered. Of several headers with one name, only the last is returned.
    """
    names: dict[str, str] = {}
    for rank, header in enumerate(headers, 1):
        plain = re.sub(r"[^a-z0-9]+", "_", plain_word(header)).strip("_")
        names[plain if plain[:1].isalpha() else f"further_{plain or rank}"] = header
    return names


def list_columns(table: str, further: Iterable[Column] = ()) -> tuple[Column, ...]:
    """Return the columns of one of :data:`acromion.app.report.figures.TABLES`.

    ``further``: columns of the list of participants (:func:`type_further`); a table about recordings ends
    with them.
    """
    columns = TABLES[table]
    is_about_recordings = table == "pairs" or any(column.name == "path" for column in columns)
    return (*columns, *(further if is_about_recordings else ()))


def list_redcap_columns(further: Iterable[Column] = ()) -> tuple[Column, ...]:
    """Return the fields of the form in REDCap; it adds the last one itself."""
    of_header = {column.name: column for column in further}
    renamed = (
        replace(of_header[header], facts={"header": name})
        for name, header in name_variables(of_header).items()
    )
    return (*REDCAP_COLUMNS[:-1], *renamed, REDCAP_COLUMNS[-1])


def encode_rows(
    table: str, rows: Iterable[Row], dialect: Dialect = INTERNATIONAL, further: Iterable[Column] = ()
) -> bytes:
    """Encode the rows of a table (:func:`list_columns`) as CSV."""
    return encode_table([column.name for column in list_columns(table, further)], rows, dialect)


# The dictionary: name, unit and meaning of every column and field, in English and French.


SHEETS_ONLY = ("bins", "warnings")
"""Tables that are only in the workbook."""
REDCAP_COLUMNS = (
    Column("record_id", kind="text"),
    *SUMMARY_OF_ONE,
    Column("arm_elevation_complete"),
)
BIDS_COLUMNS = ("participant_id", "session_id", "filename", "acq_time", "code")
"""Columns of the tables of a BIDS dataset (:mod:`acromion.app.report.export.bids`)."""
_DOCUMENT_HEAD = """Made from the code: `python -m benchmarks.reference`

# Dictionary / Dictionnaire

A star means any name. Empty (in JSON: null) means "not computable".
Vide (en JSON : null) veut dire « non calculable ».
"""


def encode_dictionary(further: Sequence[Column] = ()) -> bytes:
    """Encode the dictionary of the tables, of ``elevation.parquet`` and of ``results.json`` as CSV."""
    return encode_rows("dictionary", describe_dictionary(further))


def describe_dictionary(further: Sequence[Column] = ()) -> list[Row]:
    """Return one row for each column of the tables and of the angles, and each field of ``results.json``.

    ``further``: columns of the list of participants (:func:`type_further`).
    """
    rows: list[Row] = []

    def add(file: str, name: str, kind: str | None, unit: str, shown: Iterable[str]) -> None:
        english, french = shown
        words = {"unit": unit, "english": english, "french": french}
        rows.append({"file": file, "column": name, "kind": kind, **words})

    for table in TABLES:
        file = f"summary.xlsx, {table}" if table in SHEETS_ONLY else f"{table}.csv"
        for column in list_columns(table, further):
            shown = (column.explain(language, table) for language in LANGUAGES)
            add(file, column.name, column.kind, column.unit, shown)
    for column in list_redcap_columns(further):
        add("redcap_import.csv", column.name, column.kind, column.unit, map(column.explain, LANGUAGES))
    angles = [load_wording(language, "tables")["elevation"] for language in LANGUAGES]
    fields = [load_wording(language, "fields") for language in LANGUAGES]
    for file, words in (("elevation.parquet", angles), ("results.json", fields)):
        for name in words[0]:
            add(file, name, None, find_unit(name), (one[name] for one in words))
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
    "side": get_args(Side),
    "verdict": ("good", "caution", "poor"),
    "left_out": ("short", "long"),
}
_FILES: Mapping[str, tuple[str, Dialect, Sequence[Column]]] = {
    **{f"{name}.csv": (name, INTERNATIONAL, columns) for name, columns in TABLES.items()},
    "summary_fr.csv": ("summary", FRENCH_EXCEL, SUMMARY),
    "redcap_import.csv": ("summary", FOR_IMPORT, REDCAP_COLUMNS),
}
"""Table, format and columns of each CSV file."""


def encode_datapackage(tables: Collection[str], further: Sequence[Column] = ()) -> bytes:
    """Describe the known ones among the tables; ``tables`` are file names.

    ``further``: columns of the list of participants (:func:`type_further`).
    """
    resources = []
    for name in sorted(_FILES.keys() & tables):
        table, dialect, columns = _FILES[name]
        is_form = columns is REDCAP_COLUMNS
        columns = list_redcap_columns(further) if is_form else list_columns(table, further)
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


def _describe_column(column: Column, table: str, dialect: Dialect) -> dict[str, Any]:
    field: dict[str, Any] = {"name": column.name, "title": column.explain("en", table)}
    if column.kind == "text":
        allowed = _ALLOWED.get(column.name)
        return field | {"type": "string"} | ({"constraints": {"enum": list(allowed)}} if allowed else {})
    field |= {"type": "number"} | ({"decimalChar": dialect.decimal} if dialect.decimal != "." else {})
    return field | ({"unit": column.unit} if column.unit else {})
