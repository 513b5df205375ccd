"""The command line: what outsiders' scripts rely on (names and exit codes are a contract)."""

import json
import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from app.batch.plan import Task, find_recordings, plan_joined, plan_tasks
from app.batch.run import Outcome, run_tasks
from app.batch.tables import write_tables
from app.cli_operations import register as register_operations
from app.errors import ServerRefused
from app.jobs.attempt import warm_up
from app.report.messages import describe_problem
from app.request import (
    SUBJECT_ALLOWED,
    WINDOW_ALLOWED,
    Language,
    ReportKind,
    ReportRequest,
    check_subject,
    list_window_counts,
    parse_window,
)
from app.version import software_revision, software_version
from fusion.choices import MethodName, Pose, Side
from fusion.diary import DiaryEntry, read_diary
from fusion.errors import FusionError

app = typer.Typer(
    name="acromion",
    help="From a full-shift upper-arm motion recording to a report a clinician can act on.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


register_operations(app)


class Exit(IntEnum):
    """Exit codes, the same for every command."""

    ALL_GOOD = 0
    SOME_FAILED = 1
    USAGE = 2
    NOTHING_DONE = 3
    INTERRUPTED = 130


Out = Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")]
SideOption = Annotated[Side | None, typer.Option(help="Which arm.")]
DiaryOption = Annotated[
    Path | None,
    typer.Option(metavar="FILE.csv", help="Shift, tasks, breaks, not worn: start,end,kind,label."),
]
ProfileOption = Annotated[
    Path | None,
    typer.Option(
        "--profile", metavar="FILE.json", help="What the columns of a table mean (docs/formats.md)."
    ),
]
LanguageOption = Annotated[Language, typer.Option("--lang", help="Language of the report.")]


@app.command()
def run(
    paths: Annotated[list[Path], typer.Argument(help="Recordings, or folders of recordings.")],
    out: Out,
    side: SideOption = None,
    subject: Annotated[str, typer.Option(help="Subject code; never a name.")] = "",
    method: Annotated[MethodName, typer.Option(help="How elevation is estimated.")] = "smoothed",
    pose: Annotated[Pose, typer.Option(help="The pose the wearer was calibrated in.")] = "n-pose",
    calibration: Annotated[
        list[str] | None,
        typer.Option(
            metavar="START_S,END_S", help="Calibration window; twice for two-point: hanging, level."
        ),
    ] = None,
    diary: DiaryOption = None,
    lang: LanguageOption = "en",
    rate_hz: Annotated[float | None, typer.Option(min=1, max=10_000, help="For logs without time.")] = None,
    profile: ProfileOption = None,
    report: Annotated[str, typer.Option(help="What to write: html, pdf or html,pdf.")] = "html,pdf",
    workers: Annotated[int, typer.Option("-j", "--jobs", min=1, help="Recordings at once.")] = 1,
    join: Annotated[bool, typer.Option("--join", help="The files are one shift, in one report.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Do finished recordings again.")] = False,
) -> None:
    """Analyse recordings and write a report for each."""
    request = ReportRequest(
        file_name="",
        subject=_check_subject(subject),
        side=side,
        method=method,
        pose=pose,
        calibration_windows_s=_parse_windows(calibration, pose),
        rate_hz=rate_hz,
        languages=(lang,),
        kinds=_parse_kinds(report),
        diary=_read_diary(diary, lang),
        profile=_read_profile(profile, lang),
    )
    logs = find_recordings(paths, out)
    if not logs:
        _print_problem(", ".join(map(str, paths)), "E-NO-RECORDING", {}, lang)
        raise typer.Exit(Exit.NOTHING_DONE)
    tasks = (plan_joined if join else plan_tasks)(logs, out, request, force=force)
    _finish(_report_progress(tasks, workers), out, request)


@app.command()
def exposure(
    path: Annotated[Path, typer.Argument(help="CSV with the columns time_s,elevation_deg.")],
    out: Out,
    side: SideOption = None,
    subject: Annotated[str, typer.Option(help="Subject code; never a name.")] = "",
    diary: DiaryOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Give the exposure of a ready angle series (an empty angle is missing)."""
    entries = _read_diary(diary, lang)
    request = ReportRequest(
        path.name, _check_subject(subject), side, languages=(lang,), source="angles", diary=entries
    )
    tasks = plan_tasks([path], out, request, force=True)
    _finish(_report_progress(tasks, 1), out, request)


@app.command()
def demo(
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")] = Path("acromion-demo"),
    hours: Annotated[float, typer.Option(min=0.1, max=24)] = 8.0,
    lang: LanguageOption = "en",
    open_: Annotated[bool, typer.Option("--open", help="Open the report in the browser.")] = False,
) -> None:
    """Simulate a shift, analyse it, write the report, say where."""
    from fusion.simulation import simulate_shift, write_shift  # noqa: PLC0415  heavy, and only this needs it

    typer.echo(f"Simulating {hours:g} h of work with a GT9X Link ...")
    shift = simulate_shift("gt9x", hours, seed=1)
    log = write_shift(out / "recording", shift, actilife_csv=False)[0]
    request = ReportRequest(log.name, "DEMO", "right", languages=(lang,))
    tasks = plan_tasks([log], out, request, force=False)
    outcomes = _report_progress(tasks, 1)
    page = (tasks[0].folder / "report.html").resolve()
    typer.echo(f"Report: {page}\n        {page.with_suffix('.pdf')}")
    if open_:
        typer.launch(page.as_uri())
    _finish(outcomes, out, request)


@app.command()
def simulate(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Where the recordings go.")],
    device: Annotated[Literal["gt9x", "lsm9ds1"], typer.Option()],
    hours: Annotated[float, typer.Option(min=0.01, max=48)] = 8.0,
    seed: Annotated[int, typer.Option(min=0)] = 1,
    rate_hz: Annotated[float | None, typer.Option(min=10, max=2000)] = None,
) -> None:
    """Write recordings as the devices write them, and the truth beside them."""
    from fusion.simulation import write_recordings  # noqa: PLC0415

    for path in write_recordings(folder, device, hours, seed, rate_hz):
        typer.echo(path)


@app.command()
def inspect(
    path: Annotated[Path, typer.Argument(metavar="FILE")],
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
    rate_hz: Annotated[float | None, typer.Option(min=1, max=10_000)] = None,
    profile: ProfileOption = None,
    lang: LanguageOption = "en",
) -> None:
    """Say what the file is: device, columns, units, rate, clock, gaps, warnings. Analyses nothing."""
    from app.inspection import describe_inspection, inspect_file  # noqa: PLC0415

    try:
        facts = inspect_file(path, rate_hz, _read_profile(profile, lang))
    except FusionError as refusal:
        _print_problem(path.name, refusal.code, refusal.facts, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    except OSError as error:
        _print_problem(path.name, "E-FILE", {"why": error.strerror or ""}, lang)
        raise typer.Exit(Exit.NOTHING_DONE) from None
    typer.echo(
        json.dumps(facts, indent=1, ensure_ascii=False) if as_json else describe_inspection(facts, lang)
    )


@app.command()
def serve(
    host: Annotated[str, typer.Option(help="Only this computer, until accounts exist.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535)] = 8080,
    data: Annotated[Path, typer.Option(metavar="DIR", help="Where recordings and reports are kept.")] = Path(
        "acromion-data"
    ),
    workers: Annotated[
        int, typer.Option("-j", "--jobs", min=0, help="Analyses at once; 0 leaves them to other workers.")
    ] = 2,
    open_: Annotated[bool, typer.Option("--open", help="Open the page in the browser.")] = False,
) -> None:
    """Serve the page and the API, with the workers that do the analyses."""
    from app.main import serve as serve_app  # noqa: PLC0415
    from app.settings import Settings  # noqa: PLC0415

    try:
        serve_app(Settings(host=host, port=port, data_dir=data, workers=workers), open_browser=open_)
    except ServerRefused as refusal:
        _print_problem("serve", refusal.code, refusal.facts, "en")
        raise typer.Exit(Exit.USAGE) from None


@app.command()
def worker(
    data: Annotated[Path, typer.Option(metavar="DIR", help="The data folder of the server.")] = Path(
        "acromion-data"
    ),
) -> None:
    """Do queued analyses until stopped; any number may run beside the server."""
    from app.jobs.worker import choose_engine  # noqa: PLC0415
    from app.settings import Settings  # noqa: PLC0415

    choose_engine(Settings(data_dir=data))()


@app.command()
def version() -> None:
    """Print the version and the fingerprint of the code."""
    typer.echo(f"acromion {software_version()} ({software_revision()})")


def _read_diary(path: Path | None, language: Language) -> tuple[DiaryEntry, ...]:
    """Read the diary before any recording, so that a slip in it is told at once."""
    if path is None:
        return ()
    try:
        return read_diary(path.read_bytes())
    except FusionError as refusal:
        _print_problem(path.name, refusal.code, refusal.facts, language)
    except OSError as error:
        _print_problem(path.name, "E-FILE", {"why": error.strerror or ""}, language)
    raise typer.Exit(Exit.USAGE)


def _read_profile(path: Path | None, language: Language) -> str:
    """Read the column profile before any recording, so that a slip in it is told at once."""
    if path is None:
        return ""
    from fusion.readers import parse_profile  # noqa: PLC0415  heavy, and only this needs it

    try:
        return parse_profile(path.read_text("utf-8", errors="replace")).to_json()
    except FusionError as refusal:
        _print_problem(path.name, refusal.code, refusal.facts, language)
    except OSError as error:
        _print_problem(path.name, "E-FILE", {"why": error.strerror or ""}, language)
    raise typer.Exit(Exit.USAGE)


def _check_subject(text: str) -> str:
    try:
        return check_subject(text)
    except ValueError:
        raise typer.BadParameter(f"write {SUBJECT_ALLOWED}", param_hint="--subject") from None


def _parse_windows(texts: list[str] | None, pose: Pose) -> tuple[tuple[float, float], ...]:
    try:
        windows = tuple(parse_window(text) for text in texts or ())
    except ValueError:
        raise typer.BadParameter(f"write {WINDOW_ALLOWED}, e.g. 5,15", param_hint="--calibration") from None
    if len(windows) not in list_window_counts(pose):
        needed = " or ".join(map(str, list_window_counts(pose)))
        raise typer.BadParameter(f"{pose} takes {needed} windows", param_hint="--calibration")
    return windows


def _parse_kinds(text: str) -> tuple[ReportKind, ...]:
    kinds = tuple(part.strip() for part in text.split(","))
    known: tuple[ReportKind, ...] = ("html", "pdf")
    if not kinds or any(kind not in known for kind in kinds):
        raise typer.BadParameter(f"{text!r}: write html, pdf or html,pdf")
    return tuple(kind for kind in known if kind in kinds)


def _report_progress(tasks: list[Task], workers: int) -> list[Outcome]:
    warm_up()
    outcomes: list[Outcome] = []
    for outcome in run_tasks(tasks, workers, _show_stage):
        outcomes.append(outcome)
        _print_outcome(outcome, f"[{len(outcomes)}/{len(tasks)}] " if len(tasks) > 1 else "")
    return sorted(outcomes, key=lambda outcome: tasks.index(outcome.task))


def _show_stage(task: Task, stage: str | None, fraction: float) -> None:
    """Keep one line on a terminal up to date; a log file gets none of it."""
    if sys.stderr.isatty():
        typer.echo(f"\r\x1b[K{task.log.name}: {stage or 'waiting'} {fraction:.0%}", nl=False, err=True)


def _print_outcome(outcome: Outcome, counter: str) -> None:
    name, language = outcome.task.log.name, outcome.task.request.languages[0]
    if sys.stderr.isatty():
        typer.echo("\r\x1b[K", nl=False, err=True)
    if outcome.code:
        _print_problem(counter + name, outcome.code, outcome.facts, language)
        return
    typer.echo(f"{counter}{name} -> {outcome.task.folder}" + (" (already done)" if outcome.repeated else ""))
    for line in outcome.answer:
        typer.echo(f"  {line}")


def _print_problem(name: str, code: str, facts: Any, language: Language) -> None:
    problem = describe_problem(code, facts, language)
    typer.echo(f"{name}: {code} {problem.title}\n  {problem.detail}\n  {problem.fix}", err=True)


def _finish(outcomes: list[Outcome], out: Path, request: ReportRequest) -> None:
    """Write the tables and leave with the exit code that says the same as they do."""
    if outcomes:
        try:
            write_tables(out, outcomes, request, datetime.now(UTC))
        except OSError as error:
            _print_problem(str(out), "E-FILE", {"why": error.strerror or ""}, request.languages[0])
            raise typer.Exit(Exit.NOTHING_DONE) from None
    raise typer.Exit(_exit_code(outcomes))


def _exit_code(outcomes: Iterable[Outcome]) -> Exit:
    good = [outcome.code is None for outcome in outcomes]
    if not any(good):
        return Exit.NOTHING_DONE
    return Exit.ALL_GOOD if all(good) else Exit.SOME_FAILED


def main() -> None:
    """Enter from the command ``acromion``."""
    app()
