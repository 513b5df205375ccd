"""Write the table of bad inputs: the expected and the actual outcome of each file, by each way in.

    python -m benchmarks.bad_inputs > docs/reference/bad-inputs.md

Takes some minutes: every file goes through `fusion`, the command line and the API, each analysis in its
own process. (This is a folder with a `__main__.py`, not a module: the processes would import a module again
for each file.) Exit code 1 if an outcome differs from the expected one.
"""

import csv
import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from fastapi.testclient import TestClient
from typer.testing import CliRunner

from acromion.app.cli import app
from acromion.app.main import create_app
from acromion.app.settings import Settings
from acromion.fusion.errors import FusionError
from tests.badfiles.expected import ALWAYS, BAD_FILES, PARTS
from tests.badfiles.outcomes import BadFile
from tests.badfiles.ways_in import Server, analyse_by_fusion, codes_in, content_of

HEAD = """Made from the code: `python -m benchmarks.bad_inputs > docs/reference/bad-inputs.md`

# Bad inputs: expected and actual outcomes

A generator in `tests/badfiles` makes each file; the row numbers are those of `tests/badfiles/expected.py`. An
outcome is a refusal (`E-`), or a report with its caveats and its seconds: analysed + missing + excluded =
recorded. W-FEW-HOURS and W-NPOSE, which every short recording with a proposed N-pose has, are left out.
"same" means exactly the expected outcome.
"""
Outcomes = dict[BadFile, str]


def describe(warnings: frozenset[str] | set[str], times_s: tuple[float, float, float]) -> str:
    times = " + ".join(f"{round(seconds, 2):g}" for seconds in times_s)
    return f"{' '.join(sorted(warnings)) or 'clean'}; {times} s"


def expect(bad: BadFile) -> str:
    times_s = (bad.analysed_s, bad.missing_s, bad.excluded_s)
    return bad.code or describe(bad.warnings, times_s)


def run_by_fusion(bad: BadFile) -> str:
    try:
        analysis = analyse_by_fusion(bad)
    except FusionError as error:
        return error.code
    time = analysis.time
    assert time.analysed_us + time.missing_us + time.excluded_us == time.recorded_us
    warnings = {flag.code for flag in analysis.quality.flags} - ALWAYS
    return describe(warnings, (time.analysed_us / 1e6, time.missing_us / 1e6, time.excluded_us / 1e6))


def describe_results(text: str | bytes) -> str:
    results = json.loads(text)
    time = results["time"]
    return describe(codes_in(results), (time["analysed_s"], time["missing_s"], time["excluded_s"]))


def run_by_command_line(bad: BadFile, folder: Path) -> str:
    folder.mkdir()
    path = folder / bad.name
    path.write_bytes(content_of(bad))
    ended = CliRunner().invoke(app, ["run", str(path), "-o", str(folder / "out"), "--report", "html"])
    found = list((folder / "out").glob("*/results.json"))
    if found and ended.exit_code == 0:
        return describe_results(found[0].read_text("utf-8"))
    problems = folder / "out" / "problems.csv"
    if ended.exit_code != 3 or not problems.exists():
        return f"exit code {ended.exit_code}"
    return " ".join(row["code"] for row in csv.DictReader(problems.open(encoding="utf-8")))


def run_by_api(bad: BadFile, server: Server) -> str:
    if not content_of(bad):
        answer = server.client.post("/api/v1/analyze", content=b"", params={"file_name": bad.name})
        return str(answer.json()["code"])
    address = server.send(bad)
    analysis = server.client.get(address).json()
    if analysis["state"] == "succeeded":
        return describe_results(server.client.get(f"{address}/results.json").content)
    return str((analysis.get("problem") or {}).get("code", analysis["state"]))


def run_every_route(folder: Path) -> dict[str, Outcomes]:
    settings = Settings(data_dir=folder / "data", min_free_bytes=0)
    with TestClient(create_app(settings), base_url="http://localhost:8080") as client:
        server = Server(client, settings)
        ways: dict[str, Callable[[int, BadFile], str]] = {
            "fusion": lambda _, bad: run_by_fusion(bad),
            "command line": lambda number, bad: run_by_command_line(bad, folder / f"{number:03d}"),
            "API": lambda _, bad: run_by_api(bad, server),
        }
        return {
            name: {bad: way(number, bad) for number, bad in enumerate(BAD_FILES)}
            for name, way in ways.items()
        }


def write_table(seen: dict[str, Outcomes]) -> int:
    """Print the page; return how many outcomes differ from the expected ones."""
    wrong = 0
    print(HEAD)
    for part, files in PARTS.items():
        print(
            f"## {part}\n\n| row | file | expected | {' | '.join(seen)} |\n|---|---|---|{'---|' * len(seen)}"
        )
        for bad in files:
            cells = ["same" if one[bad] == expect(bad) else f"**{one[bad]}**" for one in seen.values()]
            wrong += sum(text != "same" for text in cells)
            print(f"| {bad.row} | {bad.name} | {expect(bad)} | {' | '.join(cells)} |")
        print()
    print(f"{len(BAD_FILES)} files, {len(seen)} ways in, {wrong} outcomes other than expected.")
    return wrong


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        wrong = write_table(run_every_route(Path(folder)))
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
