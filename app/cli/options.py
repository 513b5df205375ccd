"""Options that commands share, and how what was typed is read."""

from pathlib import Path
from typing import Annotated

import typer

from app.cli.said import Exit, print_problem
from app.request import (
    SUBJECT_ALLOWED,
    WINDOW_ALLOWED,
    Language,
    ReportKind,
    check_subject,
    list_window_counts,
    parse_window,
)
from fusion.choices import Pose, Side
from fusion.diary import DiaryEntry, read_diary
from fusion.errors import FusionError

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
LanguageOption = Annotated[Language, typer.Option("--lang", help="Language of the report.")]


def read_diary_file(path: Path | None, language: Language) -> tuple[DiaryEntry, ...]:
    """Read the diary before any recording, so that a slip in it is told at once."""
    if path is None:
        return ()
    try:
        return read_diary(path.read_bytes())
    except FusionError as refusal:
        print_problem(path.name, refusal.code, refusal.facts, language)
    except OSError as error:
        print_problem(path.name, "E-FILE", {"why": error.strerror or ""}, language)
    raise typer.Exit(Exit.USAGE)


def read_profile_file(path: Path | None, language: Language) -> str:
    """Read the column profile before any recording, so that a slip in it is told at once."""
    if path is None:
        return ""
    from fusion.readers import parse_profile  # noqa: PLC0415  heavy, and only this needs it

    try:
        return parse_profile(path.read_text("utf-8", errors="replace")).to_json()
    except FusionError as refusal:
        print_problem(path.name, refusal.code, refusal.facts, language)
    except OSError as error:
        print_problem(path.name, "E-FILE", {"why": error.strerror or ""}, language)
    raise typer.Exit(Exit.USAGE)


def take_subject(text: str) -> str:
    """Check the subject code; a wrong one is a usage error."""
    try:
        return check_subject(text)
    except ValueError:
        raise typer.BadParameter(f"write {SUBJECT_ALLOWED}", param_hint="--subject") from None


def parse_windows(texts: list[str] | None, pose: Pose) -> tuple[tuple[float, float], ...]:
    """Read the calibration windows; a number that does not fit the pose is a usage error."""
    try:
        windows = tuple(parse_window(text) for text in texts or ())
    except ValueError:
        raise typer.BadParameter(f"write {WINDOW_ALLOWED}, e.g. 5,15", param_hint="--calibration") from None
    if len(windows) not in list_window_counts(pose):
        needed = " or ".join(map(str, list_window_counts(pose)))
        raise typer.BadParameter(f"{pose} takes {needed} windows", param_hint="--calibration")
    return windows


def parse_kinds(text: str) -> tuple[ReportKind, ...]:
    """Read which kinds of report are wanted, in our order."""
    kinds = tuple(part.strip() for part in text.split(","))
    known: tuple[ReportKind, ...] = ("html", "pdf")
    if not kinds or any(kind not in known for kind in kinds):
        raise typer.BadParameter(f"{text!r}: write html, pdf or html,pdf")
    return tuple(kind for kind in known if kind in kinds)
