"""The tables of a run; they agree with its messages and its exit code."""

import json
import platform
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from app.batch.run import Outcome
from app.batch.settings_file import encode_settings
from app.report.bibliography import write_methods
from app.report.export.crate import CRATE, Made, encode_crate
from app.report.export.tables import (
    DATAPACKAGE,
    FRENCH_EXCEL,
    MARK_COLUMNS,
    PERIOD_COLUMNS,
    PROBLEM_COLUMNS,
    Row,
    add_origin,
    build_problem_row,
    describe_marks,
    describe_periods,
    encode_datapackage,
    encode_dictionary,
    encode_summary,
    encode_table,
    summarise_failure,
    summarise_results,
)
from app.report.export.xlsx import encode_workbook
from app.report.figures import load_results
from app.report.render.html import IndexRow, render_index
from app.report.words.messages import describe_problem
from app.report.words.wording import load_wording
from app.request import Language, ReportRequest
from app.store.folder import write_durably
from app.version import software_revision, software_version

CSV_TABLES = ("summary.csv", "summary_fr.csv", "periods.csv", "marks.csv", "problems.csv", "dictionary.csv")
_PACKAGES = ("numpy", "scipy", "numba", "pandas", "pyarrow", "typst")


def write_tables(out: Path, outcomes: Sequence[Outcome], request: ReportRequest, made_at: datetime) -> None:
    """Write the files next to the recordings' folders: summary, problems, periods, dictionary, run.

    Each file is replaced atomically.
    """
    out.mkdir(parents=True, exist_ok=True)
    found: list[dict[str, Any] | None] = []
    for outcome in outcomes:
        path = outcome.task.folder / "results.json"
        found.append(
            None if outcome.code else add_origin(load_results(path.read_bytes()), outcome.task.origin)
        )
    sizes: dict[str, int] = {}
    for name, content in _encode_tables(outcomes, found, request, made_at):
        write_durably(out / name, content)
        sizes[name] = len(content)
    made = []
    for outcome, results in zip(outcomes, found, strict=True):
        if results is None:
            made.append(Made(code=outcome.code))
            continue
        folder = outcome.task.folder  # files of earlier versions are in subfolders
        files = sorted(path for path in folder.iterdir() if path.is_file())
        made.append(Made({f"{folder.name}/{path.name}": path.stat().st_size for path in files}, results))
    write_durably(out / CRATE, encode_crate(made, sizes, made_at.isoformat(timespec="seconds")))


def _encode_tables(
    outcomes: Sequence[Outcome],
    found: Sequence[dict[str, Any] | None],
    request: ReportRequest,
    made_at: datetime,
) -> Iterator[tuple[str, bytes]]:
    """Encode each table; ``found``: the results of each outcome, None for a failure."""
    language, every = request.languages[0], list(zip(outcomes, found, strict=True))
    rows = [
        summarise_failure(one.task.origin, one.code or "") if results is None else summarise_results(results)
        for one, results in every
    ]
    done = [results for results in found if results is not None]
    problems = [build_problem_row(o.task.origin, o.code, o.facts, language) for o in outcomes if o.code]
    periods = [row for results in done for row in describe_periods(results)]
    index = [_build_index_row(one, row, language) for one, row in zip(outcomes, rows, strict=True)]
    run = {
        "made_at": made_at.isoformat(timespec="seconds"),
        "software": {"version": software_version(), "revision": software_revision()},
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
                "folder": one.task.folder.name,
                "code": one.code,
                "sha256": results and results["recording"]["sha256"],
                "subject": one.task.request.subject,
                "side": one.task.request.side,
            }
            for one, results in every
        ],
    }
    yield "summary.csv", encode_summary(rows)
    yield "summary_fr.csv", encode_summary(rows, FRENCH_EXCEL)
    yield "summary.xlsx", encode_workbook(done)
    yield "problems.csv", encode_table(PROBLEM_COLUMNS, problems)
    yield "periods.csv", encode_table(PERIOD_COLUMNS, periods)
    yield (
        "marks.csv",
        encode_table(MARK_COLUMNS, [row for results in done for row in describe_marks(results)]),
    )
    yield "dictionary.csv", encode_dictionary()
    yield DATAPACKAGE, encode_datapackage(CSV_TABLES)
    yield "index.html", render_index(index, request.method, language)
    yield "settings.yaml", encode_settings(request)
    yield "methods.md", write_methods(done, len(outcomes) - len(done), language)
    yield "run.json", (json.dumps(run, indent=1, ensure_ascii=False) + "\n").encode()


def _build_index_row(outcome: Outcome, row: Row, language: Language) -> IndexRow:
    name = outcome.task.name
    if outcome.code:
        problem = describe_problem(outcome.code, outcome.facts, language)
        return IndexRow(name, None, None, None, f"{outcome.code}. {problem.title}. {problem.fix}")
    verdict = load_wording(language)["verdict"][row["verdict"]]["label"]
    cells = (row["analysed_s"], row["time_above_60_percent"])
    analysed_s, above = (float(cell) if isinstance(cell, int | float) else None for cell in cells)
    return IndexRow(name, outcome.task.folder.name, analysed_s, above, verdict)
