"""The command ``acromion live``: the angle in real time, in the terminal."""

import signal
import sys
import time
from contextlib import ExitStack, suppress
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from acromion.app.batch.folder import plan_tasks
from acromion.app.cli.options import LanguageOption, SideOption, SubjectOption, parse_axis, parse_subject
from acromion.app.cli.output import (
    finish,
    handling_signals,
    print_problem,
    printing_refusals,
    report_progress,
)
from acromion.app.errors import UNREADABLE_PATH, AppError
from acromion.app.logs import escape_controls
from acromion.app.report.words.numbers import format_angle, format_duration, format_elapsed, format_number
from acromion.app.report.words.wording import fill, load_wording
from acromion.app.request import Language, ReportRequest
from acromion.fusion.errors import FusionError

if TYPE_CHECKING:
    from acromion.app.live.recorder import Recorder
    from acromion.app.live.sources import Source
    from acromion.fusion.live import LiveStatus
    from acromion.fusion.live.cues import Cue

BAR_WIDTH = 30
REDRAW_S, PRINT_S = 0.1, 1.0
SILENT_S = 2.0
"""After this time without a frame, the angle is no longer shown because it is outdated."""


def live(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="A recording (replayed), /dev/ttyACM0, COM3, udp://:5005, tcp://board:5005.",
        ),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the raw file and the report.")] = Path(
        "acromion-live"
    ),
    speed: Annotated[float, typer.Option(min=1, max=20, help="Replay speed of a recording.")] = 1.0,
    baud: Annotated[int, typer.Option(min=1200, help="Baud rate of a serial port.")] = 115_200,
    axis: Annotated[
        str | None, typer.Option(metavar="x|-x|y|-y|z|-z", help="Axis along the arm, instead of a pose.")
    ] = None,
    cue: Annotated[
        list[str] | None,
        typer.Option(metavar="RULE", help="hold:60:10, share:60:10, stays:60:30; can be repeated."),
    ] = None,
    countdown_s: Annotated[
        float, typer.Option("--countdown", min=0, max=60, help="Seconds before the pose.")
    ] = 5.0,
    side: SideOption = None,
    subject: SubjectOption = "",
    lang: LanguageOption = "en",
) -> None:
    """Show the angle in real time, save every sample, and write the report when stopped (Ctrl-C)."""
    from acromion.app.live.cue_log import CUE_HINT, parse_rule  # noqa: PLC0415  loads numpy
    from acromion.app.live.ports import EARLY, is_port  # noqa: PLC0415
    from acromion.app.live.raw_file import PREFIX, Wearer, build_session_options  # noqa: PLC0415
    from acromion.app.live.recorder import Recorder, describe_difference, measure_difference  # noqa: PLC0415
    from acromion.app.live.sources import open_lines, open_replay  # noqa: PLC0415

    arm_axis = parse_axis(axis)
    request = ReportRequest("", parse_subject(subject), side, languages=(lang,), arm_axis=arm_axis)
    _print_interrupted_sessions(out, lang)
    try:
        rules = tuple(parse_rule(text) for text in cue or ())
    except ValueError:
        raise typer.BadParameter(f"write {CUE_HINT}", param_hint="--cue") from None
    path = out / f"{PREFIX}{datetime.now().astimezone():%Y%m%d-%H%M%S}.csv"
    wearer = Wearer(request.subject, side, arm_axis)
    opened: Source
    with printing_refusals(source, lang):
        if is_port(source):
            out.mkdir(parents=True, exist_ok=True)
            about = build_session_options(source, wearer, rules)
            opened = open_lines(source, baud, path.with_suffix(EARLY), about)
        else:
            opened = open_replay(Path(source), speed)
    with printing_refusals(str(path), lang), ExitStack() as on_failure:
        on_failure.callback(opened.close)
        out.mkdir(parents=True, exist_ok=True)
        recorder = Recorder(path, opened.facts, wearer, rules)
        on_failure.pop_all()
    _run(opened, recorder, countdown_s, lang)
    tasks = plan_tasks([recorder.path], out, request, force=False)
    outcomes = report_progress(tasks, 1)
    if not outcomes[0].code:
        found = measure_difference(recorder.shown, tasks[0].folder / "elevation.parquet")
        typer.echo(describe_difference(found, lang))
    finish(outcomes, out, request)


def _run(source: "Source", recorder: "Recorder", countdown_s: float, language: Language) -> None:
    """Process frames until the source ends, or Ctrl-C or SIGTERM; then close the raw file.

    Data received before the end is also processed; if that fails, its file stays for the next start.
    """
    from acromion.app.live.cue_log import write_log  # noqa: PLC0415

    screen = _Screen(language)
    try:
        with handling_signals(signal.default_int_handler, signal.SIGTERM):
            _take_frames(source, recorder, countdown_s, screen)
    except KeyboardInterrupt:
        pass
    except (FusionError, AppError) as refusal:
        print_problem(source.facts.name, refusal.code, refusal.facts, language)
    except OSError as error:  # the disk is full
        print_problem(str(recorder.path), UNREADABLE_PATH, {"why": error.strerror or ""}, language)
    finally:
        early = source.early
        with suppress(FusionError, AppError, OSError):
            while early and not recorder.settle(early) and (frames := source.read()) is not None:
                recorder.take(frames)
        source.close()
    with printing_refusals(str(recorder.path), language):
        recorder.stop()
        if recorder.cues:
            write_log(recorder.path, recorder.cues)
    screen.show_last(recorder.status())


def _take_frames(source: "Source", recorder: "Recorder", countdown_s: float, screen: "_Screen") -> None:
    """Process frames until the source ends; the pose starts once buffered data is processed."""
    early, heard_s = source.early, time.monotonic()
    if early is None:
        _ask_pose(recorder, countdown_s)
    while (frames := source.read()) is not None:
        heard_s = time.monotonic() if len(frames) else heard_s
        screen.print_cues(recorder.take_cues(recorder.take(frames)))
        if early is not None and recorder.settle(early):
            early = None
            _ask_pose(recorder, countdown_s)
        status = recorder.status()
        if status.pose == "none" and early is None:
            screen.print_refusal(status)
            recorder.session.ask_pose(countdown_s)
        screen.show(status, time.monotonic() - heard_s)


def _ask_pose(recorder: "Recorder", countdown_s: float) -> None:
    if recorder.session.arm_axis is None:
        recorder.session.ask_pose(countdown_s)


class _Screen:
    """A status line that is updated on a terminal; otherwise a line every second."""

    def __init__(self, language: Language) -> None:
        self._language = language
        self._words = load_wording(language, "live")["terminal"]
        self._is_terminal = sys.stdout.isatty()
        self._due_s = 0.0

    def show(self, status: "LiveStatus", silent_s: float) -> None:
        """Show the status; ``silent_s`` is the time since the last frame."""
        if time.monotonic() >= self._due_s:
            self._due_s = time.monotonic() + (REDRAW_S if self._is_terminal else PRINT_S)
            self._print(self._describe(status, silent_s))

    def show_last(self, status: "LiveStatus") -> None:
        self._print(self._describe(status))
        if self._is_terminal:
            typer.echo()

    def print_refusal(self, status: "LiveStatus") -> None:
        self._end_line()
        typer.echo(load_wording(self._language, "live")["refused"][status.pose_refused])

    def print_cues(self, cues: "list[Cue]") -> None:
        """Ring the terminal bell, and print the rule."""
        words = load_wording(self._language, "live")["cue"]
        for cue in cues:
            self._end_line()
            limit = cue.rule.percent if cue.rule.kind == "share" else cue.rule.seconds
            facts = {"angle": f"{cue.rule.angle_deg:g}", "limit": f"{limit:g}"}
            typer.echo(f"\a{format_elapsed(cue.time_s)}  {fill(words[cue.rule.kind], facts)}")

    def _print(self, line: str) -> None:
        if self._is_terminal:
            typer.echo(f"\r\x1b[K{line}", nl=False)
        else:
            typer.echo(line)

    def _end_line(self) -> None:
        if self._is_terminal:
            typer.echo("\r\x1b[K", nl=False)

    def _describe(self, status: "LiveStatus", silent_s: float = 0.0) -> str:
        is_silent = silent_s > SILENT_S
        if status.pose in ("countdown", "holding") and not is_silent:
            left = format_number(status.pose_left_s, 0, self._language)
            return fill(self._words[status.pose], {"left": left})
        doubt = "" if status.has_rested else str(self._words["unrested"])
        if is_silent:
            doubt = fill(self._words["silent"], {"seconds": format_number(silent_s, 0, self._language)})
        elif status.is_frame_doubtful:
            doubt = str(self._words["frame"])
        angle_deg = None if is_silent else status.elevation_deg
        filled = round(BAR_WIDTH * min(angle_deg or 0.0, 180.0) / 180.0)
        facts = {
            "angle": format_angle(angle_deg, self._language).rjust(4),
            "bar": "█" * filled + "·" * (BAR_WIDTH - filled),
            "above": format_duration(status.above_s[1], self._language),
            "rises": str(status.rises),
            "lost": str(status.lost),
            "elapsed": format_elapsed(status.elapsed_s),
            "uncounted": format_duration(status.elapsed_s - status.counted_s, self._language),
            "doubt": doubt,
        }
        return fill(self._words["line"], facts)


def _print_interrupted_sessions(out: Path, language: Language) -> None:
    """Print the interrupted sessions of this folder, and how much of each was saved."""
    from acromion.app.live.raw_file import find_interrupted_sessions, recover_early_files  # noqa: PLC0415

    recover_early_files(out)
    words = load_wording(language, "live")["terminal"]
    for cut in find_interrupted_sessions(out):
        facts = {"name": cut.path.name, "elapsed": format_elapsed(cut.elapsed_s)}
        typer.echo(escape_controls(fill(words["cut"], facts)), err=True)
