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
from app.report.export.columns import (
    PERIOD_COLUMNS,
    describe_periods,
    encode_dictionary,
    encode_summary,
    summarise_failure,
    summarise_results,
)
from app.report.export.crate import CRATE, Made, encode_crate
from app.report.export.csv import (
    FRENCH_EXCEL,
    PROBLEM_COLUMNS,
    Row,
    add_origin,
    encode_table,
    tell_problem,
)
from app.report.export.datapackage import DATAPACKAGE, encode_datapackage
from app.report.export.methods_text import write_methods
from app.report.export.xlsx import encode_workbook
from app.report.figures import load_results
from app.report.render.html import IndexRow, render_index
from app.report.words.messages import describe_problem
from app.report.words.wording import load_wording
from app.request import Language, ReportRequest
from app.storage.store import write_durably
from app.version import software_revision, software_version

CSV_TABLES = ("summary.csv", "summary_fr.csv", "periods.csv", "problems.csv", "dictionary.csv")
_PACKAGES = ("numpy", "scipy", "numba", "pandas", "pyarrow", "typst")


def write_tables(out: Path, outcomes: Sequence[Outcome], request: ReportRequest, made_at: datetime) -> None:
    """Write the files next to the recordings' folders: summary, problems, periods, dictionary, run.

    Each is the old one or the new one, whole, whatever ends us meanwhile.
    """
    out.mkdir(parents=True, exist_ok=True)
    sizes: dict[str, int] = {}
    for name, content in _encode_tables(outcomes, request, made_at):
        write_durably(out / name, content)
        sizes[name] = len(content)
    ended_at = made_at.isoformat(timespec="seconds")
    made = []
    for outcome in outcomes:
        if outcome.code:
            made.append(Made(code=outcome.code))
            continue
        folder = outcome.task.folder  # the files of earlier versions lie in folders inside
        files = sorted(path for path in folder.iterdir() if path.is_file())
        products = {f"{folder.name}/{path.name}": path.stat().st_size for path in files}
        made.append(Made(products, _read_results(outcome)))
    write_durably(out / CRATE, encode_crate(made, sizes, ended_at))


def _encode_tables(
    outcomes: Sequence[Outcome], request: ReportRequest, made_at: datetime
) -> Iterator[tuple[str, bytes]]:
    language = request.languages[0]
    rows = [_summarise(outcome) for outcome in outcomes]
    done = [_read_results(outcome) for outcome in outcomes if not outcome.code]
    problems = [tell_problem(o.task.origin, o.code, o.facts, language) for o in outcomes if o.code]
    periods = [row for results in done for row in describe_periods(results)]
    index = [_build_index_row(outcome, language) for outcome in outcomes]
    yield "summary.csv", encode_summary(rows)
    yield "summary_fr.csv", encode_summary(rows, FRENCH_EXCEL)
    yield "summary.xlsx", encode_workbook(done)
    yield "problems.csv", encode_table(PROBLEM_COLUMNS, problems)
    yield "periods.csv", encode_table(PERIOD_COLUMNS, periods)
    yield "dictionary.csv", encode_dictionary()
    yield DATAPACKAGE, encode_datapackage(CSV_TABLES)
    yield "index.html", render_index(index, request.method, language)
    yield "settings.yaml", encode_settings(request)
    yield "methods.md", write_methods(done, len(outcomes) - len(done), language)
    yield "run.json", _encode_run(outcomes, request, made_at)


def _encode_run(outcomes: Sequence[Outcome], request: ReportRequest, made_at: datetime) -> bytes:
    run = {
        "made_at": made_at.isoformat(timespec="seconds"),
        "software": {"version": software_version(), "revision": software_revision()},
        "machine": {
            "system": platform.platform(),
            "python": platform.python_version(),
            "packages": {name: version(name) for name in _PACKAGES},
        },
        "settings": asdict(replace(request, file_name="")),
        "recordings": [_record(outcome) for outcome in outcomes],
    }
    return (json.dumps(run, indent=1, ensure_ascii=False) + "\n").encode()


def _record(outcome: Outcome) -> dict[str, str | None]:
    task = outcome.task
    return {
        "file": task.request.file_name,
        "path": task.name,
        "folder": task.folder.name,
        "code": outcome.code,
        "sha256": None if outcome.code else _read_results(outcome)["recording"]["sha256"],
        "subject": task.request.subject,
        "side": task.request.side,
    }


def _summarise(outcome: Outcome) -> Row:
    if outcome.code:
        return summarise_failure(outcome.task.origin, outcome.code)
    return summarise_results(_read_results(outcome))


def _read_results(outcome: Outcome) -> dict[str, Any]:
    results = load_results((outcome.task.folder / "results.json").read_bytes())
    return add_origin(results, outcome.task.origin)


def _build_index_row(outcome: Outcome, language: Language) -> IndexRow:
    name = outcome.task.name
    if outcome.code:
        problem = describe_problem(outcome.code, outcome.facts, language)
        return IndexRow(name, None, None, None, f"{outcome.code}. {problem.title}. {problem.fix}")
    row = _summarise(outcome)
    verdict = load_wording(language)["verdict"][row["verdict"]]["label"]
    cells = (row["analysed_s"], row["time_above_60_percent"])
    analysed_s, above = (float(cell) if isinstance(cell, int | float) else None for cell in cells)
    return IndexRow(name, outcome.task.folder.name, analysed_s, above, verdict)
