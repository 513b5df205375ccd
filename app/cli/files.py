"""Commands about files: demonstration, simulation, inspection, export, conformance."""

import csv
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from acromion.app.batch.again import read_further
from acromion.app.batch.folder import list_finished, plan_tasks
from acromion.app.cli.options import (
    ClockOffsetOption,
    DateOrderOption,
    LanguageOption,
    ProfileOption,
    SensorOption,
    TimeZoneOption,
    complete_profile,
    parse_offset,
    parse_zone,
    read_posture_file,
    read_profile_file,
)
from acromion.app.cli.output import (
    Exit,
    choose_exit,
    finish,
    holding_results,
    print_problem,
    printing_refusals,
    report_progress,
)
from acromion.app.errors import NO_RESULTS
from acromion.app.report.figures import load_results
from acromion.app.report.words.wording import fill, load_wording
from acromion.app.request import Language, ReportRequest
from acromion.app.store.folder import write_durably
from acromion.app.version import software_version, source_fingerprint, source_revision
from acromion.fusion.errors import FusionError

if TYPE_CHECKING:
    from acromion.fusion.simulation.conformance import Expected, TestSignal


def demo(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")] = Path("acromion-demo"),
    hours: Annotated[float, typer.Option(min=0.1, max=24)] = 8.0,
    lang: LanguageOption = "en",
    open_: Annotated[bool, typer.Option("--open", help="Open the report in the browser.")] = False,
) -> None:
    """Simulate a shift, analyse it, write the report and print its path."""
    from acromion.fusion.simulation import simulate_shift, write_shift  # noqa: PLC0415  slow import

    typer.echo(f"Simulating {hours:g} h of work with a GT9X Link ...")
    shift = simulate_shift("gt9x", hours, seed=1)
    log = write_shift(out / "recording", shift, actilife_csv=False)[0]
    request = ReportRequest(log.name, "DEMO", "right", languages=(lang,), pose_held="start")
    with holding_results(out, lang):
        tasks = plan_tasks([log], out, request, force=False)
        outcomes = report_progress(tasks, 1)
        if not choose_exit(outcomes):
            page = (tasks[0].folder / "report.html").resolve()
            typer.echo(f"Report: {page}\n        {page.with_suffix('.pdf')}")
            if open_:
                typer.launch(page.as_uri())
        finish(outcomes, out, request)


def simulate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the recordings.")],
    device: Annotated[Literal["gt9x", "lsm9ds1"], typer.Option()],
    hours: Annotated[float, typer.Option(min=0.01, max=48)] = 8.0,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    rate_hz: Annotated[float | None, typer.Option(min=10, max=2000)] = None,
) -> None:
    """Write simulated recordings in the formats of the devices, and their true angles."""
    from acromion.fusion.simulation import write_recordings  # noqa: PLC0415

    for path in write_recordings(folder, device, hours, seed, rate_hz):
        typer.echo(path)


# Inspection and version.


def inspect(
    path: Annotated[Path, typer.Argument(metavar="FILE")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    rate_hz: Annotated[float | None, typer.Option(min=1, max=10_000)] = None,
    profile: ProfileOption = None,
    sensor: SensorOption = "",
    date_order: DateOrderOption = None,
    time_zone: TimeZoneOption = "",
    clock_offset: ClockOffsetOption = "",
    lang: LanguageOption = "en",
) -> None:
    """Describe a file without analysing it: device, columns, units, rate, clock, gaps, warnings."""
    from acromion.app.analysis.inspect import inspect_file  # noqa: PLC0415
    from acromion.app.report.inspection import describe_inspection  # noqa: PLC0415

    with printing_refusals(path.name, lang):
        try:
            columns = complete_profile(read_profile_file(profile, lang), sensor, date_order)
            zone, offset_s = parse_zone(time_zone), parse_offset(clock_offset)
            facts = inspect_file(path, rate_hz, columns, time_zone=zone, clock_offset_s=offset_s)
        except FusionError as refusal:
            if as_json:
                problem = {"file": path.name, "code": refusal.code, "facts": dict(refusal.facts)}
                typer.echo(json.dumps(problem, indent=1))
            raise
    typer.echo(
        json.dumps(facts, indent=1, ensure_ascii=False) if as_json else describe_inspection(facts, lang)
    )


def posture(
    path: Annotated[Path, typer.Argument(metavar="FILE")],
    lang: LanguageOption = "en",
) -> None:
    """Print sitting and standing from a recording of the thigh, as rows of a diary."""
    rows = read_posture_file(path, lang)
    typer.echo("start,end,kind,label")
    for row in rows:
        typer.echo(f"{row.start},{row.end},{row.kind},{row.label}")


def version() -> None:
    """Print the version, the git commit or release, and the fingerprint of the code."""
    typer.echo(f"acromion {software_version()} ({source_fingerprint()}, {source_revision()})")


# Export to a standard dataset format.


def export(
    results: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULTS...", help="Result folders of acromion run, or folders that contain them."
        ),
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder for the Motion-BIDS dataset; new or empty.")
    ],
    lang: Annotated[Language, typer.Option("--lang", help="Language of messages.")] = "en",
) -> None:
    """Write the angles of finished recordings as a Motion-BIDS dataset (docs/conventions.md)."""
    from acromion.app.report.export.bids import Angles, list_bids  # noqa: PLC0415  loads Parquet

    found = (folder for path in results if path.exists() for folder in list_finished(path))
    folders = [folder for folder in found if (folder / "elevation.parquet").exists()]
    if not folders:
        print_problem(", ".join(map(str, results)), NO_RESULTS, {}, lang)
        raise typer.Exit(Exit.NOTHING_DONE)
    if out.exists() and any(out.iterdir()):
        raise typer.BadParameter(f"{out} is not empty", param_hint="-o")
    every = [
        Angles(load_results((folder / "results.json").read_bytes()), folder / "elevation.parquet", further)
        for folder, further in zip(folders, read_further(folders), strict=True)
    ]
    for name, content in list_bids(every):
        path = out / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_durably(path, content)
    words = load_wording(lang, "run")["outcome"]
    typer.echo(fill(words["exported"], {"n": str(len(folders)), "folder": str(out)}))


# Check whether another program computes the figures of page 1 (docs/profile.md).


RESULTS = "results.csv"


def conformance(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder for the signals and results.csv.")],
) -> None:
    """Write test signals with expected values; check another program's figures in DIR/results.csv."""
    from acromion.fusion.simulation.conformance import SIGNALS  # noqa: PLC0415  slow import

    folder.mkdir(parents=True, exist_ok=True)
    for path in _write_signals(folder, SIGNALS):
        typer.echo(path)
    if not (folder / RESULTS).exists():
        typer.echo(f"No {RESULTS} yet: write signal,figure,value, with a row for each row of expected.csv.")
        return
    given = {}
    with (folder / RESULTS).open(encoding="utf-8-sig", newline="") as file:
        for row in csv.DictReader(file):
            with suppress(ValueError):  # an invalid number counts as missing
                given[row.get("signal") or "", row.get("figure") or ""] = float(row.get("value") or "")
    lines = [
        _check(one.name, item, given.get((one.name, item.figure))) for one in SIGNALS for item in one.expected
    ]
    for line in lines:
        typer.echo(line)
    wrong = sum(not line.startswith("ok") for line in lines)
    typer.echo(f"{len(lines) - wrong} of {len(lines)} figures within their tolerances")
    if wrong:
        raise typer.Exit(Exit.SOME_FAILED)


def _write_signals(folder: Path, signals: "Sequence[TestSignal]") -> Iterator[Path]:
    """Write each signal (time_s,elevation_deg; empty if missing) and its expected values."""
    for signal in signals:
        lines = (
            f"{time_s:.3f},{'' if isnan(angle_deg) else f'{angle_deg:.6f}'}\n"
            for time_s, angle_deg in zip(*(column.tolist() for column in signal.sample()), strict=True)
        )
        path = folder / f"{signal.name}.csv"
        path.write_text("time_s,elevation_deg\n" + "".join(lines), encoding="utf-8")
        yield path
    path = folder / "expected.csv"
    with path.open("w", encoding="utf-8", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("signal", "figure", "unit", "value", "tolerance"))
        for signal in signals:
            for item in signal.expected:
                rows.writerow((signal.name, item.figure, item.unit, f"{item.value:.6g}", item.tolerance))
    yield path


def _check(signal: str, item: "Expected", value: float | None) -> str:
    """Format whether a value is within the tolerance of the expected one."""
    wanted = f"{signal} {item.figure}: expected {item.value:.6g} ± {item.tolerance:g} {item.unit}"
    if value is None:
        return f"MISSING {wanted}"
    within = abs(value - item.value) <= item.tolerance + 1e-9
    return f"{'ok' if within else 'OUTSIDE'} {wanted}, given {value:g}"
