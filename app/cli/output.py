"""Output of the command line: outcomes, problems, and the exit code."""

import importlib
import io
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from enum import IntEnum
from functools import cache
from pathlib import Path
from typing import Any, Literal, NoReturn

import typer

from acromion.app.analysis.fork_server import warm_up
from acromion.app.batch.folder import Task, find_orphans, format_path, hold_results
from acromion.app.batch.run import Outcome, ShardRecord, find_finished, run_tasks
from acromion.app.errors import RESULTS_IN_USE, UNREADABLE_PATH, AppError, Interrupted
from acromion.app.logs import escape_controls
from acromion.app.report.export.tables import Row
from acromion.app.report.figures import load_results
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.numbers import Clock, format_duration, format_number
from acromion.app.report.words.wording import fill, load_wording
from acromion.app.request import Language, ReportRequest
from acromion.fusion.clocks import in_zone, read_clock
from acromion.fusion.errors import DOUBLE_RECORDING, FusionError

_TABLES = "acromion.app.batch.tables"
"""Needed only at the end of a run; loaded while the first recording is analysed."""


_NO_FAILURES = (Interrupted.code, DOUBLE_RECORDING)


class Exit(IntEnum):
    """Exit codes, the same for every command."""

    ALL_GOOD = 0
    SOME_FAILED = 1
    USAGE = 2
    NOTHING_DONE = 3
    INCOMPLETE = 4
    """A backup or a data folder could not be restored completely."""
    INTERRUPTED = 130
    NOBODY_READS = 141
    """The code of a program that SIGPIPE ends."""


class PipedOutput(io.TextIOWrapper):
    """Standard output whose reader may exit (``| head``); the command then exits without a message.

    It raises SystemExit and not an error, so that no handler reports it as a problem of a file or the disk.
    """

    def write(self, text: str) -> int:
        """Write, or exit."""
        try:
            return super().write(text)
        except BrokenPipeError:
            self._end()

    def flush(self) -> None:
        """Flush, or exit."""
        try:
            super().flush()
        except BrokenPipeError:
            self._end()

    def _end(self) -> NoReturn:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.fileno())  # buffered text is written at exit
        os.close(nowhere)
        raise SystemExit(Exit.NOBODY_READS)


@dataclass(frozen=True, slots=True)
class Progress:
    """Progress of a run; ``left_s`` is estimated from analysed recordings, None before the first."""

    done: int
    all: int
    left_s: float | None


OnOutcome = Callable[[Outcome, Progress], None]


def report_progress(
    tasks: Sequence[Task], workers: int, on_outcome: OnOutcome | None = None
) -> list[Outcome]:
    """Run the tasks and report each outcome when it is ready; return them in the order of the tasks.

    Ctrl-C and SIGTERM end the run. Recordings that are not analysed have the outcome E-INTERRUPTED, unless an
    earlier run has finished them.
    """
    on_outcome = on_outcome or print_outcome
    on_progress = _print_stage if on_outcome is print_outcome else lambda *_: None
    outcomes: list[Outcome] = []
    start_s = time.monotonic()
    try:
        with handling_signals(signal.default_int_handler, signal.SIGTERM):
            warm_up()
            threading.Thread(target=importlib.import_module, args=(_TABLES,), daemon=True).start()
            for outcome in run_tasks(tasks, workers, on_progress):
                outcomes.append(outcome)
                # earlier results took no time and predict nothing
                analysed = sum(not one.repeated for one in outcomes)
                elapsed_s, left = time.monotonic() - start_s, len(tasks) - len(outcomes)
                left_s = elapsed_s / analysed * left if analysed else None
                on_outcome(outcome, Progress(len(outcomes), len(tasks), left_s))
    except KeyboardInterrupt:
        reached = [outcome.task for outcome in outcomes]
        rest = [task for task in tasks if task not in reached]
        done: dict[str, Outcome | None] = {}
        with suppress(KeyboardInterrupt):  # a second Ctrl-C stops the search for earlier results
            for task in rest:
                done[task.name] = find_finished(task)
        outcomes += [done.get(task.name) or Outcome(task, code=Interrupted.code) for task in rest]
    return sorted(outcomes, key=lambda outcome: tasks.index(outcome.task))


@contextmanager
def handling_signals(how: Any, *numbers: int) -> Iterator[None]:
    """Handle signals with ``how`` until the end of the block."""
    before = {number: signal.signal(number, how) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _print_stage(task: Task, stage: str | None, fraction: float) -> None:
    """Update the status line on a terminal; in a log file, only note once that the first run takes longer."""
    language = task.request.languages[0]
    if sys.stderr.isatty():
        word = load_wording(language, "page")["stage"][stage or "starting"]
        line = f"{task.name}: {word}, {format_number(100.0 * fraction, 0, language)} %"
        typer.echo(f"\r\x1b[K{escape_controls(line)}", nl=False, err=True)
    elif stage == "preparing":
        _note_preparing(language)


@cache
def _note_preparing(language: Language) -> None:
    """Print once per run that the first one takes longer."""
    typer.echo(load_wording(language, "page")["stage"]["preparing"], err=True)


def print_outcome(outcome: Outcome, progress: Progress) -> None:
    """Print the report's path and its answer, or the problem and its fix."""
    task, language = outcome.task, outcome.task.request.languages[0]
    words, counter = load_wording(language, "run")["outcome"], ""
    if sys.stderr.isatty():
        typer.echo("\r\x1b[K", nl=False, err=True)
    if progress.all > 1:
        left = format_duration(progress.left_s, language) if progress.left_s else ""
        facts = {"done": str(progress.done), "all": str(progress.all), "time": left}
        counter = f"[{fill(words['counter'], facts)}] "
    if outcome.code:
        print_problem(counter + task.name, outcome.code, outcome.facts, language)
        return
    note = f" ({words['already']})" if outcome.repeated else ""
    if outcome.changes:
        n, old = str(outcome.version), str(outcome.version - 1)
        note = f" ({fill(words['version'], {'changes': ', '.join(outcome.changes), 'n': n, 'old': old})})"
    typer.echo(escape_controls(f"{counter}{task.name} -> {format_path(task.folder)}{note}"))
    for line in outcome.answer:
        typer.echo(f"  {line}")


def print_failure(outcome: Outcome, _progress: Progress) -> None:
    """Print only failures."""
    if outcome.code:
        language = outcome.task.request.languages[0]
        print_problem(outcome.task.name, outcome.code, outcome.facts, language)


def print_json(outcome: Outcome, progress: Progress) -> None:
    """Print one JSON line: file, folder, code of the failure or null, progress of the run."""
    line = {
        "file": format_path(outcome.task.log),
        "folder": format_path(outcome.task.folder),
        "code": outcome.code,
        "repeated": outcome.repeated,
        "done": progress.done,
        "all": progress.all,
        "left_s": None if progress.left_s is None else round(progress.left_s, 1),
    }
    typer.echo(escape_controls(json.dumps(line, ensure_ascii=False)))


def print_problem(name: str, code: str, facts: Any, language: Language) -> None:
    """Print the problem and its fix on standard error."""
    problem = describe_problem(code, facts, language)
    typer.echo(
        f"{escape_controls(name)}: {code} {problem.title}\n  {problem.detail}\n  {problem.fix}", err=True
    )


@contextmanager
def printing_refusals(name: str, language: Language, exit_code: Exit = Exit.NOTHING_DONE) -> Iterator[None]:
    """Print a refusal or an unusable path, and exit with ``exit_code``."""
    try:
        yield
    except (FusionError, AppError) as refusal:
        print_problem(name, refusal.code, refusal.facts, language)
    except OSError as error:
        print_problem(name, UNREADABLE_PATH, {"why": error.strerror or ""}, language)
    else:
        return
    raise typer.Exit(exit_code)


@contextmanager
def holding_results(out: Path, language: Language, *, is_shared: bool = False) -> Iterator[None]:
    """Keep other runs out of the results folder; if another run is active, print its process and exit."""
    with ExitStack() as stack:
        try:
            stack.enter_context(hold_results(out, is_shared=is_shared))
        except BlockingIOError as error:
            number, _, computer = str(error.strerror).partition(" ")
            print_problem(format_path(out), RESULTS_IN_USE, {"pid": number, "computer": computer}, language)
            raise typer.Exit(Exit.NOTHING_DONE) from None
        except OSError as error:
            print_problem(format_path(out), UNREADABLE_PATH, {"why": error.strerror or ""}, language)
            raise typer.Exit(Exit.NOTHING_DONE) from None
        yield


def finish(
    outcomes: Sequence[Outcome], out: Path, request: ReportRequest, *, goes_on: bool = True, asks: bool = True
) -> NoReturn:
    """Write the tables, and exit with the code that matches them.

    ``goes_on``: repeating the command continues the run. ``asks``: ask for the pose if it was assumed.
    """
    language = request.languages[0]
    if outcomes:
        try:
            with handling_signals(signal.SIG_IGN, signal.SIGINT, signal.SIGTERM):  # takes about a second
                pairs = importlib.import_module(_TABLES).write_tables(
                    out, outcomes, request, datetime.now(UTC)
                )
            note_pairs(pairs, language)
        except OSError as error:
            print_problem(str(out), UNREADABLE_PATH, {"why": error.strerror or ""}, language)
            is_any_good = any(outcome.code is None for outcome in outcomes)
            raise typer.Exit(Exit.SOME_FAILED if is_any_good else Exit.NOTHING_DONE) from None
    note_orphans([outcome.task for outcome in outcomes], out, language)
    for line in format_question(outcomes) if asks else ():
        typer.echo(escape_controls(line), err=True)
    if len(outcomes) > 1 or choose_exit(outcomes) is Exit.INTERRUPTED:
        typer.echo(_format_total(outcomes, language, "", goes_on=goes_on), err=True)
    raise typer.Exit(choose_exit(outcomes))


def note_orphans(tasks: Sequence[Task], out: Path, language: Language) -> None:
    """Print the folders of recordings that earlier runs had and this one does not."""
    if names := find_orphans(out, [task.folder for task in tasks if not task.double_of]):
        words = load_wording(language, "run")["outcome"]
        typer.echo(escape_controls(fill(words["orphans"], {"names": ", ".join(names)})), err=True)


def note_pairs(rows: Sequence[Row], language: Language) -> None:
    """Print the pairs whose clocks the shared movement contradicts, and the recordings that rival for one."""
    words = load_wording(language, "run")["outcome"]
    doubtful = [
        f"{row['subject']} ({row['left']}, {row[other]})"
        for row in rows
        for other, certainty in (("right", "certainty"), ("trunk", "trunk_certainty"))
        if row.get(certainty) == "doubtful"
    ]
    rivals = [
        f"{row['subject']} ({why.partition(': ')[2]})"
        for row in rows
        if (why := str(row.get("why") or "")).startswith("several at once")
    ]
    for name, found in (("doubtful_pairs", doubtful), ("several_at_once", rivals)):
        if names := "; ".join(dict.fromkeys(found)):
            typer.echo(escape_controls(fill(words[name], {"names": names})), err=True)


def finish_shard(outcomes: Sequence[Outcome], record: ShardRecord, out: Path, language: Language) -> NoReturn:
    """Write the failures of this slice for ``acromion collect``, and exit with the code of the slice."""
    with handling_signals(signal.SIG_IGN, signal.SIGINT, signal.SIGTERM):
        record.write(outcomes)
    typer.echo(_format_total(outcomes, language, "_shard"), err=True)
    words = load_wording(language, "run")["outcome"]
    typer.echo(fill(words["shard"], {"folder": format_path(out)}), err=True)
    raise typer.Exit(choose_exit(outcomes) if outcomes else Exit.ALL_GOOD)


def format_question(outcomes: Sequence[Outcome]) -> list[str]:
    """Return the question about an assumed pose; for one recording, with the answer for each candidate.

    The answer is an option, or the row of a diary for a shift that was cut out.
    """
    for outcome in outcomes:
        if not outcome.code and (len(outcomes) == 1 or outcome.task.request.pose_held is None):
            results = load_results((outcome.task.folder / "results.json").read_bytes())
            if (results["calibration"] or {}).get("state") == "assumed":
                break
    else:
        return []
    request = outcomes[0].task.request
    words = load_wording(request.languages[0], "run")["outcome"]
    if len(outcomes) > 1:
        return [words["all_held"]]
    recording, calibration = results["recording"], results["calibration"]
    start = datetime.fromisoformat(recording["start"]) if recording["start"] else None
    zoned = in_zone(start, recording["time_zone"])
    clock = Clock(zoned, request.languages[0], recording["duration_s"])
    lines = [] if request.pose_held else [words["which_start"]]
    for still in calibration["proposals"]:
        start_s, end_s = still["start_s"], still["start_s"] + still["duration_s"]
        facts = {
            "time": clock.format(start_s, with_seconds=True),
            "used": words["which_used"] if start_s == calibration["start_s"] else "",
            "window": f"{start_s:.2f},{end_s:.2f}",
        }
        if zoned and request.shift:  # seconds of --calibration count from the start of the file
            edges = (
                read_clock(zoned, round(at_s * 1e6)).isoformat(" ", "milliseconds")
                for at_s in (start_s, end_s)
            )
            facts["window"] = ",".join((*edges, "pose"))
        lines.append(fill(words["which_row" if request.shift else "which_choice"], facts))
    return [fill(words["which"], {"name": outcomes[0].task.name}), *(f"  {line}" for line in lines)]


def _format_total(
    outcomes: Sequence[Outcome], language: Language, part: Literal["", "_shard"], *, goes_on: bool = True
) -> str:
    """Format the counts of outcomes; a slice (``_shard``) has written no tables."""
    counts = {
        "all": len(outcomes),
        "good": sum(outcome.code is None for outcome in outcomes),
        "repeated": sum(outcome.repeated for outcome in outcomes),
        "failed": sum(outcome.code not in (None, *_NO_FAILURES) for outcome in outcomes),
        "double": sum(outcome.code == DOUBLE_RECORDING for outcome in outcomes),
        "left": sum(outcome.code == Interrupted.code for outcome in outcomes),
    }
    facts = {name: str(n) if n or name in {"all", "good"} else "" for name, n in counts.items()}
    words = load_wording(language, "run")["outcome"]
    facts["again"] = words["again"] if goes_on else ""
    return fill(words[("interrupted" if counts["left"] else "total") + part], facts)


def choose_exit(outcomes: Sequence[Outcome]) -> Exit:
    """Return the exit code from the outcomes that are also in the tables."""
    if any(outcome.code == Interrupted.code for outcome in outcomes):
        return Exit.INTERRUPTED
    good = [outcome.code is None for outcome in outcomes if outcome.code != DOUBLE_RECORDING]
    if not any(good) and (good or not outcomes):
        return Exit.NOTHING_DONE
    return Exit.ALL_GOOD if all(good) else Exit.SOME_FAILED
