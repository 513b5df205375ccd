"""What the command line says: one line for each outcome, one for each problem, and the exit code."""

import sys
from collections.abc import Iterable
from datetime import UTC, datetime
from enum import IntEnum
from pathlib import Path
from typing import Any

import typer

from app.batch.plan import Task
from app.batch.run import Outcome, run_tasks
from app.batch.tables import write_tables
from app.jobs.attempt import warm_up
from app.report.messages import describe_problem
from app.request import Language, ReportRequest


class Exit(IntEnum):
    """Exit codes, the same for every command."""

    ALL_GOOD = 0
    SOME_FAILED = 1
    USAGE = 2
    NOTHING_DONE = 3
    INTERRUPTED = 130


def report_progress(tasks: list[Task], workers: int) -> list[Outcome]:
    """Do the tasks, telling each outcome as it comes; give them in the order of the tasks."""
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
        print_problem(counter + name, outcome.code, outcome.facts, language)
        return
    typer.echo(f"{counter}{name} -> {outcome.task.folder}" + _tell_version(outcome))
    for line in outcome.answer:
        typer.echo(f"  {line}")


def _tell_version(outcome: Outcome) -> str:
    """Say what was not done again, and where the report is that a new one replaces."""
    if outcome.changes:
        changed, earlier = ", ".join(outcome.changes), outcome.version - 1
        return f" (version {outcome.version}, for {changed} changed; version {earlier} is kept in v{earlier})"
    return " (already done)" if outcome.repeated else ""


def print_problem(name: str, code: str, facts: Any, language: Language) -> None:
    """Tell on standard error what is wrong, and the cure."""
    problem = describe_problem(code, facts, language)
    typer.echo(f"{name}: {code} {problem.title}\n  {problem.detail}\n  {problem.fix}", err=True)


def finish(outcomes: list[Outcome], out: Path, request: ReportRequest) -> None:
    """Write the tables and leave with the exit code that says the same as they do."""
    if outcomes:
        try:
            write_tables(out, outcomes, request, datetime.now(UTC))
        except OSError as error:
            print_problem(str(out), "E-FILE", {"why": error.strerror or ""}, request.languages[0])
            raise typer.Exit(Exit.NOTHING_DONE) from None
    raise typer.Exit(_exit_code(outcomes))


def _exit_code(outcomes: Iterable[Outcome]) -> Exit:
    good = [outcome.code is None for outcome in outcomes]
    if not any(good):
        return Exit.NOTHING_DONE
    return Exit.ALL_GOOD if all(good) else Exit.SOME_FAILED
