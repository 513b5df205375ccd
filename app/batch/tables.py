"""The tables of a run; they agree with its messages and its exit code."""

import json
import platform
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Any

from acromion.app.batch.folder import INPUTS
from acromion.app.batch.folder import TABLES as TABLE_FILES
from acromion.app.batch.pairs import describe_pairs
from acromion.app.batch.run import Outcome, find_sha256
from acromion.app.batch.settings_file import encode_settings
from acromion.app.report.bibliography import write_methods
from acromion.app.report.export.crate import CRATE, Made, encode_crate
from acromion.app.report.export.tables import (
    DATAPACKAGE,
    FRENCH_EXCEL,
    Row,
    add_origin,
    build_problem_row,
    describe_tables,
    encode_datapackage,
    encode_dictionary,
    encode_rows,
    summarise_failure,
    type_further,
)
from acromion.app.report.export.xlsx import encode_workbook
from acromion.app.report.figures import load_results
from acromion.app.report.render.html import IndexRow, render_index
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.wording import load_wording
from acromion.app.request import Language, ReportRequest
from acromion.app.store.folder import write_durably
from acromion.app.version import software_version, source_fingerprint, source_revision
from acromion.fusion.errors import DOUBLE_RECORDING

PARTS = ("days", "hours", "periods", "tasks", "postures", "marks")
"""Tables with any number of rows for one recording, each a file next to ``summary.csv``."""
_KEPT = ("recording", "time", "method", "calibration", "software")
"""The parts of the results that methods, crate and pairs need; all of 1,000 recordings would need 150 MB."""
_PACKAGES = ("numpy", "scipy", "numba", "pandas", "pyarrow", "typst")


def write_tables(
    out: Path, outcomes: Sequence[Outcome], request: ReportRequest, made_at: datetime
) -> list[Row]:
    """Write the files next to the recordings' folders: tables, problems, dictionary, run.

    Each file is replaced atomically. Returns the rows of ``pairs.csv``, for the messages of the run.
    """
    out.mkdir(parents=True, exist_ok=True)
    found: list[dict[str, Any] | None] = []
    tables = describe_tables(_read_results(outcomes, found), request.min_hours)
    done = [(one.task, facts) for one, facts in zip(outcomes, found, strict=True) if facts is not None]
    pairs = tables["pairs"] = describe_pairs(out, done)
    sizes: dict[str, int] = {}
    encoded = _encode_tables(outcomes, found, tables, request, made_at)
    del tables  # freed with the last table, before the crate is encoded
    for name, content in encoded:
        write_durably(out / name, content)
        sizes[name] = len(content)
    rows = {outcome.task.name: row for row, outcome in enumerate(outcomes, 1)}
    made = list[Made]()
    for outcome, results in zip(outcomes, found, strict=True):
        if results is None:
            double_of = rows.get(outcome.task.double_of, 0)
            made.append(Made(code=outcome.code, sha256=find_sha256(outcome), double_of=double_of))
            continue
        folder = outcome.task.folder  # files of earlier versions are in subfolders
        files = sorted(path for path in folder.iterdir() if path.is_file())
        made.append(
            Made({f"{outcome.task.place}/{path.name}": path.stat().st_size for path in files}, results)
        )
    inputs = sorted(path for path in (out / INPUTS).rglob("*") if path.is_file())
    given = {path.relative_to(out).as_posix(): path.stat().st_size for path in inputs}
    write_durably(out / CRATE, encode_crate(made, sizes, made_at.isoformat(timespec="seconds"), given))
    return pairs


def _read_results(
    outcomes: Sequence[Outcome], found: list[dict[str, Any] | None]
) -> Iterator[dict[str, Any]]:
    """Yield the results of one recording after the other; add the few parts needed later to ``found``."""
    for outcome in outcomes:
        if outcome.code:
            found.append(None)
            continue
        results = load_results((outcome.task.folder / "results.json").read_bytes())
        found.append({name: results[name] for name in _KEPT})
        yield add_origin(results, outcome.task.origin)


def _encode_tables(
    outcomes: Sequence[Outcome],
    found: Sequence[dict[str, Any] | None],
    tables: dict[str, list[Row]],
    request: ReportRequest,
    made_at: datetime,
) -> Iterator[tuple[str, bytes]]:
    """Encode each table; ``found``: the kept results of each outcome, None for a failure."""
    from acromion.app.report.export.all import (  # noqa: PLC0415  slow import, not needed before the first analysis
        encode_parquet,
        encode_redcap_dictionary,
        encode_redcap_import,
    )

    language, every = request.languages[0], list(zip(outcomes, found, strict=True))
    done = [results for results in found if results is not None]
    finished = iter(tables["summary"])
    rows = [
        summarise_failure(one.task.origin, one.code or "") if results is None else next(finished)
        for one, results in every
    ]
    problems = [build_problem_row(o.task.origin, o.code, o.facts, language) for o in outcomes if o.code]
    tables |= {"summary": rows, "problems": problems}
    further, cells = type_further({one.task.name: one.task.further for one in outcomes})
    for row in chain.from_iterable(tables.values()):
        row.update(_find_further(cells, row))
    index = [_build_index_row(one, row, language) for one, row in zip(outcomes, rows, strict=True)]
    run = {
        "made_at": made_at.isoformat(timespec="seconds"),
        "software": {
            "version": software_version(),
            "revision": source_revision(),
            "sources": source_fingerprint(),
        },
        "machine": {
            "system": platform.platform(),
            "python": platform.python_version(),
            "packages": {name: version(name) for name in _PACKAGES},
        },
        "settings": asdict(replace(request, file_name="")),
        "recordings": [
            {
                "file": one.task.request.file_name,
                "path": one.task.name,
                "folder": one.task.place,
                "code": one.code,
                "sha256": results and results["recording"]["sha256"],
                "subject": one.task.request.subject,
                "side": one.task.request.side,
                "double_of": one.task.double_of or None,
            }
            for one, results in every
        ],
    }
    for name in ("summary", *PARTS, "pairs", "problems"):
        yield f"{name}.csv", encode_rows(name, tables[name], further=further)
    yield "summary_fr.csv", encode_rows("summary", tables["summary"], FRENCH_EXCEL, further)
    yield "summary.xlsx", encode_workbook(tables, further)
    for name in ("summary", *PARTS, "pairs"):
        yield f"{name}.parquet", encode_parquet(name, tables[name], further)
    yield "redcap_import.csv", encode_redcap_import(tables["summary"], further)
    yield "redcap_dictionary.csv", encode_redcap_dictionary(further)
    yield "dictionary.csv", encode_dictionary(further)
    yield DATAPACKAGE, encode_datapackage([name for name in TABLE_FILES if name.endswith(".csv")], further)
    yield "index.html", render_index(index, request.method, language)
    yield "settings.yaml", encode_settings(request)
    failed = sum(outcome.code not in (None, DOUBLE_RECORDING) for outcome in outcomes)
    yield "methods.md", write_methods(done, failed, language, request.min_hours)
    yield "run.json", (json.dumps(run, indent=1, ensure_ascii=False) + "\n").encode()


def _find_further(cells: Mapping[str, Row], row: Row) -> Row:
    """Return the further cells of a row; a cell in which both recordings of a pair differ is None."""
    names = (row.get(name) for name in ("path", "left", "right"))
    found = [cells.get(str(name), {}) for name in names if name]
    return {
        name: value if all(one.get(name) == value for one in found) else None
        for name, value in (found[0] if found else {}).items()
    }


def _build_index_row(outcome: Outcome, row: Row, language: Language) -> IndexRow:
    name = outcome.task.name
    if outcome.code:
        problem = describe_problem(outcome.code, outcome.facts, language)
        return IndexRow(name, None, None, None, f"{outcome.code}. {problem.title}. {problem.fix}")
    verdict = load_wording(language)["verdict"][row["verdict"]]["label"]
    cells = (row["analysed_s"], row["time_above_60_percent"])
    analysed_s, above = (float(cell) if isinstance(cell, int | float) else None for cell in cells)
    return IndexRow(name, outcome.task.place, analysed_s, above, verdict)
