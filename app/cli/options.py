"""Options that commands share, and how what was typed is read."""

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from app.batch.inputs import Participant, read_participants, read_settings
from app.batch.plan import read_list
from app.cli.output import Exit, print_problem
from app.errors import UNREADABLE_PATH, AppError, UnusableList
from app.request import (
    SUBJECT_ALLOWED,
    WINDOW_ALLOWED,
    Language,
    Paper,
    ReportKind,
    ReportRequest,
    check_subject,
    list_window_counts,
    parse_window,
)
from fusion.conventions import Side
from fusion.diary import DiaryEntry, read_diary
from fusion.errors import FusionError
from fusion.task_windows import TaskWindow, read_tasks

T = TypeVar("T")

Out = Annotated[Path, typer.Option("-o", "--out", help="Folder for the results.")]
SideOption = Annotated[Side | None, typer.Option(help="Which arm.")]
SubjectOption = Annotated[str, typer.Option("--subject", help="Subject code; never a name.")]
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
PaperOption = Annotated[Paper, typer.Option(help="Paper of the PDF.")]
LanguageOption = Annotated[Language, typer.Option("--lang", help="Language of the report.")]


def read_diary_file(path: Path | None, language: Language) -> tuple[DiaryEntry, ...]:
    """Read the diary before any recording, so that a slip in it is told at once."""
    return _take_file(path, language, (), lambda file: read_diary(file.read_bytes()))


def read_profile_file(path: Path | None, language: Language) -> str:
    """Read the column profile before any recording, so that a slip in it is told at once."""
    return _take_file(path, language, "", _parse_profile)


def read_settings_file(path: Path | None, language: Language) -> dict[str, Any]:
    """Read the settings of a study: fields of a request and their values."""
    return _take_file(path, language, {}, lambda file: read_settings(file.read_bytes()))


def read_participants_file(path: Path | None, language: Language) -> tuple[Participant, ...]:
    """Read the list of participants; the diaries it names lie beside it."""
    return _take_file(path, language, (), lambda file: read_participants(file.read_bytes(), file.parent))


def read_list_file(path: Path | None, language: Language) -> list[Path]:
    """Read a list of recordings; their paths start from the list, or from here for standard input."""
    if path == Path("-"):
        return _take_file(path, language, [], lambda _: read_list(sys.stdin.read(), Path()))
    return _take_file(path, language, [], lambda file: read_list(file.read_text("utf-8-sig"), file.parent))


def read_tasks_file(path: Path | None, language: Language) -> tuple[TaskWindow, ...]:
    """Read the tasks of a comparison."""
    return _take_file(path, language, (), lambda file: read_tasks(file.read_bytes()))


def _parse_profile(file: Path) -> str:
    from fusion.readers import parse_profile  # noqa: PLC0415  heavy, and only this needs it

    return parse_profile(file.read_text("utf-8", errors="replace")).to_json()


def _take_file(path: Path | None, language: Language, nothing: T, read: Callable[[Path], T]) -> T:
    """Read a file that steers the run; one that cannot be used is a usage error, told with its cure."""
    if path is None:
        return nothing
    try:
        return read(path)
    except (FusionError, AppError) as refusal:
        print_problem(str(refusal.facts.get("diary", path.name)), refusal.code, refusal.facts, language)
    except OSError as error:
        print_problem(path.name, UNREADABLE_PATH, {"why": error.strerror or ""}, language)
    except UnicodeDecodeError:
        print_problem(path.name, UnusableList.code, {"why": "not text"}, language)
    raise typer.Exit(Exit.USAGE)


def take_subject(text: str) -> str:
    """Check the subject code; a wrong one is a usage error."""
    try:
        return check_subject(text)
    except ValueError:
        raise typer.BadParameter(f"write {SUBJECT_ALLOWED}", param_hint="--subject") from None


def parse_windows(texts: list[str] | None) -> tuple[tuple[float, float], ...]:
    """Read the calibration windows."""
    try:
        return tuple(parse_window(text) for text in texts or ())
    except ValueError:
        raise typer.BadParameter(f"write {WINDOW_ALLOWED}, e.g. 5,15", param_hint="--calibration") from None


def check_windows(requests: Iterable[ReportRequest]) -> None:
    """Refuse before any analysis a number of windows that does not fit the pose."""
    for request in requests:
        allowed = list_window_counts(request.pose)
        if len(request.calibration_windows_s) not in allowed:
            needed = " or ".join(map(str, allowed))
            told = f"{request.file_name}: {request.pose} takes {needed} windows"
            raise typer.BadParameter(told, param_hint="--calibration")


def parse_kinds(text: str | None) -> tuple[ReportKind, ...]:
    """Read which kinds of report are wanted, in our order; nothing typed is no wish."""
    kinds = {part.strip() for part in text.split(",")} if text is not None else set()
    known: tuple[ReportKind, ...] = ("html", "pdf")
    if kinds - set(known):
        raise typer.BadParameter(f"{text!r}: write html, pdf or html,pdf")
    return tuple(kind for kind in known if kind in kinds)
