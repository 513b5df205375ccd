"""Which recordings are to be done, and where the products of each go."""

import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.report.origin import Origin
from app.report.subject import clean_text
from app.request import ReportRequest, clean_file_name

MARKER = "done.json"
"""Written last into a recording's folder: the folder is ours, and complete."""

TABLES = (
    "summary.csv",
    "summary_fr.csv",
    "summary.xlsx",
    "periods.csv",
    "problems.csv",
    "dictionary.csv",
    "run.json",
    "settings.yaml",
    "methods.md",
    "index.html",
)
"""What stands beside the recordings' folders."""

_RESERVED = re.compile(r'[<>:"/\\|?*\x00-\x1f]|[. ]+$')


@dataclass(frozen=True, slots=True)
class Task:
    """One recording to do: where it is, what is asked of it, where its products go.

    ``path`` is where it lies, from the folder that was named.
    """

    log: Path
    request: ReportRequest
    folder: Path
    force: bool = False
    path: str = ""

    @property
    def name(self) -> str:
        """Tell it apart from every other of the run."""
        return self.path or show_path(Path(self.log.name))

    @property
    def origin(self) -> Origin:
        """Say in the tables which recording it is."""
        who = self.request
        return Origin(who.file_name, who.subject, who.side, self.name, self.folder.name)


TellPath = Callable[[Path], str]


def show_path(path: Path) -> str:
    """Write a path as text that any file takes: bytes of its name that are not UTF-8 become U+FFFD."""
    return os.fsencode(path).decode("utf-8", "replace")


def _tell_name(log: Path) -> str:
    return show_path(Path(log.name))


def plan_tasks(
    logs: Iterable[Path], out: Path, request: ReportRequest, tell_path: TellPath = _tell_name, *, force: bool
) -> list[Task]:
    """Give each recording a folder named after its stem; equal stems get a number."""
    taken = {name.casefold() for name in TABLES}
    return [
        Task(
            log,
            replace(request, file_name=clean_file_name(log.name)),
            out / _free_name(name_folder(log), taken),
            force,
            tell_path(log),
        )
        for log in logs
    ]


def plan_joined(
    logs: Sequence[Path], out: Path, request: ReportRequest, tell_path: TellPath = _tell_name, *, force: bool
) -> list[Task]:
    """Make one task of the files of one shift; its folder is named after the first."""
    others = tuple(str(log.resolve()) for log in logs[1:])
    return plan_tasks(logs[:1], out, replace(request, joined=others), tell_path, force=force)


def name_folder(log: Path) -> str:
    """Give the file's stem, as a name that can only be a folder directly below the results."""
    stem = log.name.removesuffix(".gz").rpartition(".")[0] or log.name
    safe = _RESERVED.sub("_", clean_text(stem)).lstrip(". ")
    return safe[:120] or "recording"


def _free_name(stem: str, taken: set[str]) -> str:
    name, number = stem, 2
    while name.casefold() in taken:
        name, number = f"{stem}-{number}", number + 1
    taken.add(name.casefold())
    return name
