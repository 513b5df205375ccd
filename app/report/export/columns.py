"""One row for each recording: the table researchers open first, and one for each hour and period."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

from app.report.export.csv import (
    INTERNATIONAL,
    Cell,
    CellKind,
    Dialect,
    Origin,
    Row,
    encode_table,
    find_place,
)
from app.report.words.wording import load_wording

Results = Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of ``summary.csv``: its name (with the unit), where its value stands, what it means."""

    name: str
    find: Callable[[Results], Cell]
    english: str
    french: str
    kind: CellKind = "number"


def _above(threshold_deg: int, key: str) -> Callable[[Results], Cell]:
    return lambda results: _at_threshold(results["exposure"]["time_above"], threshold_deg)[key]


def _entries(threshold_deg: int, key: str) -> Callable[[Results], Cell]:
    return lambda results: _at_threshold(results["exposure"]["entries"], threshold_deg)[key]


def _at_threshold(rows: list[dict[str, Any]], threshold_deg: int) -> dict[str, Any]:
    return next(row for row in rows if row["threshold_deg"] == threshold_deg)


def _percentile(p: str) -> Callable[[Results], Cell]:
    return lambda results: results["exposure"]["percentiles_deg"][p]


def _window(length_s: int) -> Callable[[Results], Cell]:
    def find(results: Results) -> Cell:
        windows = results["exposure"]["peak"]["windows"]
        share: Cell = next(w["percent_above_60"] for w in windows if w["length_s"] == length_s)
        return share

    return find


def _speed(kind: str, p: str) -> Callable[[Results], Cell]:
    def find(results: Results) -> Cell:
        speeds = results["exposure"]["velocity_dps"][kind]
        value: Cell = speeds[p] if speeds else None
        return value

    return find


def _bin_columns() -> tuple[Column, ...]:
    edges = (0, 20, 30, 45, 60, 80, 90, 120, 150, 180)
    return tuple(
        Column(
            f"time_{low}_{high}_percent",
            lambda results, i=i: results["exposure"]["bins"][i]["percent"],  # type: ignore[misc]
            f"share of analysed time from {low} to {high} deg",
            f"part du temps analysé de {low} à {high} degrés",
        )
        for i, (low, high) in enumerate(pairwise(edges))
    )


def _threshold_columns() -> tuple[Column, ...]:
    return tuple(
        column
        for c in (30, 60, 90)
        for column in (
            Column(
                f"time_above_{c}_percent",
                _above(c, "percent"),
                f"share of analysed time at or above {c} deg",
                f"part du temps analysé à {c} degrés ou plus",
            ),
            Column(
                f"time_above_{c}_s",
                _above(c, "duration_s"),
                f"time at or above {c} deg, seconds",
                f"temps à {c} degrés ou plus, en secondes",
            ),
            Column(
                f"entries_above_{c}_per_h",
                _entries(c, "per_hour"),
                f"rises above {c} deg per hour of analysed time (hysteresis 10 deg)",
                f"montées au-dessus de {c} degrés par heure analysée (hystérésis 10 degrés)",
            ),
        )
    )


def _percentile_columns() -> tuple[Column, ...]:
    return tuple(
        Column(
            f"elevation_p{p}_deg",
            _percentile(str(p)),
            f"{p}th percentile of elevation",
            f"{p}e centile de l'élévation",
        )
        for p in (1, 5, 10, 25, 50, 75, 90, 95, 99)
    )


def find_range(results: Results, name: str) -> tuple[float, ...]:
    """Give both ends of the 95 % range of a figure by its column's name; nothing where none is known."""
    exposure = results["exposure"]
    shares = {
        **{f"time_above_{t['threshold_deg']:g}_percent": t for t in exposure["time_above"]},
        **{f"time_{b['lower_deg']:g}_{b['upper_deg']:g}_percent": b for b in exposure["bins"]},
    }
    if name in shares:
        ends = (shares[name]["low"], shares[name]["high"])
        return () if None in ends else ends
    return tuple(exposure["intervals"].get(name, ()))


def _range_columns() -> tuple[Column, ...]:
    """Give the 95 % ranges of the main figures; they follow all others, as later columns must."""
    above = ((f"time_above_{c}_percent", _range_above(c)) for c in (30, 60, 90))
    percentiles = ((f"elevation_p{p}_deg", _range_named(f"elevation_p{p}_deg")) for p in (10, 50, 90, 99))
    return tuple(
        Column(
            f"{name}_{end}",
            lambda results, find=find, rank=rank: find(results)[rank],  # type: ignore[misc]
            f"{end} end of the 95 % range of {name}",
            f"{french} de l'intervalle à 95 % de {name}",
        )
        for name, find in (*above, *percentiles)
        for rank, (end, french) in enumerate((("low", "borne basse"), ("high", "borne haute")))
    )


def _range_above(threshold_deg: int) -> Callable[[Results], tuple[Cell, Cell]]:
    def find(results: Results) -> tuple[Cell, Cell]:
        row = _at_threshold(results["exposure"]["time_above"], threshold_deg)
        return row["low"], row["high"]

    return find


def _range_named(name: str) -> Callable[[Results], tuple[Cell, Cell]]:
    def find(results: Results) -> tuple[Cell, Cell]:
        low, high = results["exposure"]["intervals"].get(name, (None, None))
        return low, high

    return find


COLUMNS: tuple[Column, ...] = (
    Column("file_name", lambda r: r["recording"]["file_name"], "name of the file", "nom du fichier", "text"),
    Column("subject", lambda r: r["recording"]["subject"], "subject code", "code du sujet", "text"),
    Column("side", lambda r: r["recording"]["side"], "left or right arm", "bras gauche ou droit", "text"),
    Column("device", lambda r: r["recording"]["device"], "kind of sensor", "type de capteur", "text"),
    Column(
        "start",
        lambda r: r["recording"]["start"],
        "device clock at the first sample",
        "horloge de l'appareil au premier échantillon",
        "text",
    ),
    Column("rate_hz", lambda r: r["recording"]["rate_hz"], "true sampling rate", "fréquence réelle"),
    Column("recorded_s", lambda r: r["time"]["recorded_s"], "recorded time", "temps enregistré"),
    Column("analysed_s", lambda r: r["time"]["analysed_s"], "analysed time", "temps analysé"),
    Column("missing_s", lambda r: r["time"]["missing_s"], "missing time", "temps manquant"),
    Column("excluded_s", lambda r: r["time"]["excluded_s"], "excluded time", "temps exclu"),
    *_bin_columns(),
    *_threshold_columns(),
    *_percentile_columns(),
    Column(
        "inclination_velocity_p50_dps",
        _speed("inclination", "50"),
        "median speed of the elevation angle",
        "vitesse médiane de l'angle d'élévation",
    ),
    Column(
        "worst_15_min_above_60_percent",
        _window(900),
        "share of time above 60 deg in the most loaded 15 minutes",
        "part du temps au-dessus de 60 degrés dans les 15 minutes les plus sollicitantes",
    ),
    Column(
        "verdict",
        lambda r: r["quality"]["verdict"],
        "data quality: good, caution or poor",
        "qualité des données : good (bonne), caution (prudence) ou poor (faible)",
        "text",
    ),
    Column(
        "warnings",
        lambda r: " ".join(w["code"] for w in r["quality"]["warnings"]),
        "codes of the warnings",
        "codes des avertissements",
        "text",
    ),
    Column("sha256", lambda r: r["recording"]["sha256"], "SHA-256 of the file", "SHA-256 du fichier", "text"),
    Column(
        "error_code",
        lambda _r: None,
        "why there is no result; empty when there is one",
        "pourquoi il n'y a pas de résultat ; vide sinon",
        "text",
    ),
    *_range_columns(),
    Column(
        "path",
        lambda r: find_place(r, "path"),
        "where the recording is: from the folder that was named, or its address in the API",
        "emplacement de l'enregistrement : depuis le dossier indiqué, ou son adresse dans l'API",
        "text",
    ),
    Column(
        "folder",
        lambda r: find_place(r, "folder"),
        "where its results are: the folder in that of the run, or their address in the API",
        "emplacement de ses résultats : dossier dans celui du traitement, ou leur adresse dans l'API",
        "text",
    ),
)
NOT_OF_ONE = frozenset({"error_code", "path", "folder"})
"""Columns that say something only in a table of many recordings."""


def summarise_results(results: Results) -> Row:
    """Give the row of one analysed recording."""
    return {column.name: column.find(results) for column in COLUMNS}


def summarise_failure(origin: Origin, code: str) -> Row:
    """Give the row of a recording without result: only what is known."""
    empty: Row = dict.fromkeys(column.name for column in COLUMNS)
    return empty | asdict(origin) | {"folder": None, "error_code": code}


PERIOD_FIELDS: tuple[tuple[str, CellKind, str, str], ...] = (
    ("file_name", "text", "name of the file", "nom du fichier"),
    ("subject", "text", "subject code", "code du sujet"),
    (
        "kind",
        "text",
        "hour (of the clock), period (of the diary) or task (its periods of one name, pooled)",
        "hour (heure), period (période) ou task (périodes de même nom réunies)",
    ),
    ("label", "text", "the hour, or the diary's own word", "l'heure, ou le mot du journal"),
    ("start_s", "number", "begin, from the first sample", "début, depuis le premier échantillon"),
    ("end_s", "number", "end, from the first sample", "fin, depuis le premier échantillon"),
    ("analysed_s", "number", "analysed time", "temps analysé"),
    ("elevation_p10_deg", "number", "10th percentile of elevation", "10e centile de l'élévation"),
    ("elevation_p50_deg", "number", "median of elevation", "médiane de l'élévation"),
    ("elevation_p90_deg", "number", "90th percentile of elevation", "90e centile de l'élévation"),
    ("time_above_30_percent", "number", "share of time at or above 30 deg", "part à 30 degrés ou plus"),
    ("time_above_60_percent", "number", "share of time at or above 60 deg", "part à 60 degrés ou plus"),
    ("time_above_90_percent", "number", "share of time at or above 90 deg", "part à 90 degrés ou plus"),
    (
        "entries_above_60_per_h",
        "number",
        "rises above 60 deg per hour",
        "montées au-dessus de 60 degrés par h",
    ),
    ("period_kind", "text", "what the diary calls it: task, break ...", "genre au journal : task, break ..."),
    ("recorded_s", "number", "recorded time of the period", "temps enregistré de la période"),
    ("excluded_as", "text", "why it was left out; empty: analysed", "raison de l'exclusion ; vide : analysé"),
    ("periods", "number", "rows of the diary pooled into a task", "lignes du journal réunies en une tâche"),
    ("path", "text", "where the recording is, as in summary.csv", "emplacement, comme dans summary.csv"),
    ("side", "text", "left or right arm", "bras gauche ou droit"),
)
"""Of ``periods.csv``: a row for each clock hour, period and task of the diary; name, kind, both meanings."""

PERIOD_COLUMNS = [name for name, *_ in PERIOD_FIELDS]


def list_periods(results: Results) -> list[Row]:
    """Give the rows of ``periods.csv`` for one recording."""
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
    return encode_table([column.name for column in COLUMNS], rows, dialect)


# What every column and every field is called, holds and means, in English and French; made from the code.


DICTIONARY_COLUMNS = ["file", "column", "kind", "unit", "english", "french"]
_DOCUMENT_HEAD = """# Dictionary / Dictionnaire

Made from the code: `python -m app.report.export.columns > docs/dictionary.md`. A star stands for any name.
Empty (in JSON: null) is "not computable". Vide (en JSON : null) veut dire « non calculable ».
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
    english, french = (load_wording(language, "fields") for language in ("en", "fr"))
    return [_describe("results.json", path, "", english[path], french[path]) for path in english]


def _describe(file: str, column: str, kind: str, english: str, french: str) -> dict[str, Cell]:
    row: dict[str, Cell] = {"file": file, "column": column, "kind": kind or None}
    return row | {"unit": name_unit(column), "english": english, "french": french}


if __name__ == "__main__":
    sys.stdout.write(write_document())
