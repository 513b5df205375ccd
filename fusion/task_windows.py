"""The list of tasks: a CSV with the columns ``name,start_s,end_s``, and ``paper_task`` if there is one.

Times are seconds of the recording's clock or, with ``reference`` in a column ``clock``, of the reference's.
Rows with the same name are repetitions of one task and are pooled. ``paper_task`` (1 to 10) is the task of
the source paper's Table 1 that it repeats.
"""

import csv
import io
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite

from fusion.errors import UnusableTasks

NEEDED = ("name", "start_s", "end_s")
CLOCKS = ("recording", "reference")
MOST_TASKS = 10_000


@dataclass(frozen=True, slots=True)
class TaskWindow:
    """One repetition of a task, in seconds of one of the two clocks."""

    name: str
    start_s: float
    end_s: float
    paper_task: int | None = None
    clock: str = "recording"


def read_tasks(content: bytes) -> tuple[TaskWindow, ...]:
    """Read the list; commas or semicolons; raises UnusableTasks."""
    lines = io.StringIO(content.decode("utf-8-sig", "replace"), newline=None)
    delimiter = ";" if ";" in lines.readline() else ","
    lines.seek(0)
    csv.field_size_limit(max(csv.field_size_limit(), len(content)))
    rows = csv.DictReader(lines, delimiter=delimiter)
    names = [(name or "").strip().lower() for name in rows.fieldnames or ()]
    rows.fieldnames = names
    if not set(NEEDED) <= set(names):
        raise UnusableTasks(line=1, why="task-columns")
    tasks = tuple(_read_task(row, rows.line_num) for row in rows if any(row.values()))
    if not tasks or len(tasks) > MOST_TASKS:
        raise UnusableTasks(line=rows.line_num, why="task-count")
    return tasks


def _read_task(row: Mapping[str, str | None], line: int) -> TaskWindow:
    name = (row["name"] or "").strip()
    if not name:
        raise UnusableTasks(line=line, why="task-name")
    start_s, end_s = _read_seconds(row["start_s"], line), _read_seconds(row["end_s"], line)
    if not start_s < end_s:
        raise UnusableTasks(line=line, why="task-order")
    clock = (row.get("clock") or "").strip().lower() or CLOCKS[0]
    if clock not in CLOCKS:
        raise UnusableTasks(line=line, why="task-clock")
    return TaskWindow(name, start_s, end_s, _read_paper_task(row.get("paper_task"), line), clock)


def _read_seconds(text: str | None, line: int) -> float:
    try:
        seconds = float((text or "").strip().replace(",", "."))
    except ValueError:
        raise UnusableTasks(line=line, why="task-number") from None
    if not isfinite(seconds):
        raise UnusableTasks(line=line, why="task-number")
    return seconds


def _read_paper_task(text: str | None, line: int) -> int | None:
    if not (text or "").strip():
        return None
    if (text or "").strip() not in {str(number) for number in range(1, 11)}:
        raise UnusableTasks(line=line, why="paper-task")
    return int((text or "").strip())
