"""Which recordings are to be done, and where the products of each go."""

import os
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from app.batch.placing import place_folders
from app.report.origin import Origin
from app.request import ReportRequest, clean_file_name


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
    known = list(logs)
    return [
        Task(log, replace(request, file_name=clean_file_name(log.name)), folder, force, tell_path(log))
        for log, folder in zip(known, place_folders(known, out), strict=True)
    ]


def plan_joined(
    logs: Sequence[Path], out: Path, request: ReportRequest, tell_path: TellPath = _tell_name, *, force: bool
) -> list[Task]:
    """Make one task of the files of one shift; its folder is named after the first."""
    others = tuple(str(log.resolve()) for log in logs[1:])
    return plan_tasks(logs[:1], out, replace(request, joined=others), tell_path, force=force)
