"""Read a diary in CSV: Acromion's form (start, end, kind, label) or the sequential form (time, event).

In the sequential form, used by the diaries of Acti4 and ActiPASS, an event lasts until the next one. Both
forms may be mixed: an empty end lasts until the next row. The file has a header line with English or French
names, and is separated by commas, semicolons or tabs. ``start``, ``end`` and ``time`` contain clock times in
any form that :func:`parse_clock` reads; ``start_s``, ``end_s`` and ``time_s`` contain seconds from the first
sample. Optional columns: ``left_out`` (yes or no; overrides the default of the kind) and ``file`` (the row
applies to that recording only).

The activity log of GGIR is also supported. It has one row per recording: its ID, a column with the date (day
first, or ISO 8601), then columns named after activities with the start time of each. More dates follow in the
same way. An activity lasts until the next one of its day; the last one lasts until midnight.
"""

import csv
import io
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta
from functools import partial
from itertools import islice
from math import isfinite
from typing import Literal, get_args

from fusion.conventions import PoseHeld, check_choice
from fusion.errors import UnusableDiary, UnusableTasks, join_facts

# Small tables that people type, such as diaries and participant lists: any delimiter, two encodings.


def decode_text(content: bytes) -> str:
    """Decode UTF-8, or Windows-1252 as older spreadsheets write it."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def read_rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the non-empty rows with their line number from 1; skip comment lines that start with #.

    Lines may end as on any system, including old Macs. A cell may be as long as the file.
    """
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    delimiter = max((";", "\t", ","), key=first.count)
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))
    reader = csv.reader(io.StringIO(text, newline=None), delimiter=delimiter)
    for cells in reader:
        stripped = [cell.strip() for cell in cells]
        if any(stripped) and not stripped[0].startswith("#"):
            yield reader.line_num, stripped


def plain_word(word: str) -> str:
    """Return a word in lower case without accents, underscores and hyphens."""
    letters = unicodedata.normalize("NFKD", word.casefold())
    return re.sub(r"[\s_-]+", " ", "".join(c for c in letters if not unicodedata.combining(c))).strip()


HELD: Mapping[str, PoseHeld] = {"start": "start", "debut": "start", "no": "no", "non": "no"}


def parse_pose_held(text: str) -> PoseHeld:
    """Parse ``start`` or ``no``, or the French ``début`` or ``non``; raises ValueError."""
    held = HELD.get(plain_word(text))
    if held is None:
        raise ValueError(", ".join(HELD))
    return held


Kind = Literal["shift", "work", "pose", "task", "seated", "supported", "break", "outside", "not_worn"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""In order of precedence, lowest first: a break within a task interrupts the task.

A "pose" is the time of the calibration pose; it does not divide the day.
"""

COLUMNS = {
    "start": "start", "from": "start", "time": "start", "begin": "start",
    "debut": "start", "de": "start", "heure": "start",
    "end": "end", "to": "end", "stop": "end", "fin": "end", "a": "end",
    "start_s": "start_s", "time_s": "start_s", "debut_s": "start_s", "end_s": "end_s", "fin_s": "end_s",
    "kind": "kind", "type": "kind", "genre": "kind",
    "event": "event", "activity": "event", "evenement": "event", "activite": "event",
    "label": "label", "name": "label", "task": "label", "libelle": "label", "nom": "label", "tache": "label",
    "left_out": "left_out", "exclu": "left_out", "excluded": "left_out",
    "file": "file", "file_name": "file", "fichier": "file",
}  # fmt: skip
WORDS: dict[str, Kind] = {
    "shift": "shift", "quart": "shift", "poste": "shift",
    "work": "work", "travail": "work",
    "pose": "pose", "calibration": "pose", "etalonnage": "pose",
    "task": "task", "tache": "task",
    "seated": "seated", "sitting": "seated", "assis": "seated", "assise": "seated",
    "supported": "supported", "appuye": "supported", "soutenu": "supported",
    "break": "break", "lunch": "break", "pause": "break", "repas": "break", "diner": "break",
    "outside": "outside", "off": "outside", "hors poste": "outside", "hors": "outside",
    "not worn": "not_worn", "nonwear": "not_worn", "non porte": "not_worn", "retire": "not_worn",
}  # fmt: skip
ENDS = ("end", "stop", "fin")
YES_NO = {"yes": True, "y": True, "1": True, "true": True, "oui": True, "o": True,
          "no": False, "n": False, "0": False, "false": False, "non": False}  # fmt: skip
LONGEST_LABEL = 200
MOST_ROWS = 10_000
LOG_IDS = ("id", "identifiant", "participant", "subject", "sujet")
LOG_DATE = re.compile(r"(\d{1,2})[-/.](\d{1,2})[-/.](\d{4})")
NUMBER = re.compile(r"[0-9]+(?:[.,][0-9]+)?")
HOUR, MINUTE = r"(?P<hour>[0-9]{1,2})", r"(?P<minute>[0-9]{2})"
SECOND = r"(?P<second>[0-9]{2}(?:[.,][0-9]{1,6})?)"
SPELLINGS = tuple(
    re.compile(spelling, re.IGNORECASE)
    for spelling in (
        rf"{HOUR}\s?:\s?{MINUTE}(?:\s?:\s?{SECOND})?",
        rf"{HOUR}\s?h(?:\s?{MINUTE}(?:\s?(?:m|mn|min|:)\s?{SECOND}\s?s?|\s?(?:m|mn|min))?)?",
        rf"{HOUR}(?P<dot>[.,]){MINUTE}(?:(?P=dot){SECOND})?",
        rf"(?P<hour>[0-9]{{2}}){MINUTE}(?:{SECOND})?",
    )
)
"""``10:20``, ``10h20``, ``10.20``, ``1020``; ``app/http/pages/static/day/clock.js`` reads the same forms."""
DAY_FRACTION = re.compile(r"(?:0?|[0-9]{5})[.,][0-9]+")
"""A spreadsheet's number for a time: 0.4306 is 10:20, 46083.4306 includes a date. ``0.43`` may be either."""
DAY = re.compile(r"(\d{4}-\d{2}-\d{2})[ T](.+)")


@dataclass(frozen=True, slots=True)
class DiaryEntry:
    """One row of a diary, not yet matched to a recording.

    ``start``, ``end``: a number is seconds from the first sample; text is a clock time, ``"07:58:00"`` or
    ``"2026-03-02T07:58:00"``. An ``end`` of None lasts until the next row begins.
    ``kind``: "work", "break" and so on: one of :data:`fusion.diary.Kind`.
    ``label``: the person's own name for it.
    ``left_out``: whether its time is excluded from the denominator; None: the default of its kind.
    ``line``: line number in the file, from 1; 0 if the row is not from a file.
    ``file``: name of the only recording it applies to; empty: any recording.
    """

    start: float | str
    end: float | str | None
    kind: Kind
    label: str = ""
    left_out: bool | None = None
    line: int = 0
    file: str = ""

    def __post_init__(self) -> None:
        """Raise ValueError with the allowed values if the kind is unknown."""
        check_choice("kind", self.kind, KINDS)


Row = DiaryEntry | tuple[int, float | str]
"""An entry, or the line and time of a row that only ends the previous one."""


def read_diary(content: bytes) -> tuple[DiaryEntry, ...]:
    """Parse a diary.

    Raises UnusableDiary: with the line, the reason and the remedy.
    """
    rows = list(islice(read_rows(decode_text(content)), MOST_ROWS + 1))
    if len(rows) > MOST_ROWS:  # each row is compared with the whole recording
        raise UnusableDiary(line=rows[-1][0], why="too many rows", cure="rows", value=str(MOST_ROWS))
    if len(rows) < 2:
        line = rows[0][0] if rows else 1
        raise UnusableDiary(line=line, why="empty", cure="header", value="")
    header, *body = rows
    if _is_activity_log(header[1]):
        told_log = _read_each(body, partial(_read_log_row, header[1], is_alone=len(body) == 1))
        return _set_ends(told_log)
    columns = _read_header(*header)
    return _set_ends(
        _read_each(body, lambda line, cells: (_read_row(line, dict(zip(columns, cells, strict=False))),))
    )


def _read_each(
    rows: list[tuple[int, list[str]]], read: Callable[[int, list[str]], Iterable[Row]]
) -> tuple[Row, ...]:
    """Read every row; raise one error with all rows that cannot be read, each with its text."""
    entries: list[Row] = []
    row_errors: list[UnusableDiary] = []
    for line, cells in rows:
        try:
            entries.extend(read(line, cells))
        except UnusableDiary as error:
            text = ", ".join(cell for cell in cells if cell)[:LONGEST_LABEL]
            value = str(error.facts.get("value", ""))[:LONGEST_LABEL]
            row_errors.append(UnusableDiary(**{**error.facts, "value": value, "text": text}))
    refuse_slips(row_errors)
    return tuple(entries)


def refuse_slips(row_errors: Sequence[UnusableDiary]) -> None:
    """Raise one error for all rows that cannot be used.

    Raises UnusableDiary: if there is at least one such row.
    """
    if row_errors:
        raise UnusableDiary(**join_facts([error.facts for error in row_errors]))


def _read_header(line: int, cells: list[str]) -> list[str]:
    names = [COLUMNS.get(plain_word(cell).replace(" ", "_"), "") for cell in cells]
    known = [name for name in names if name]
    has_needed = {"start", "start_s"} & set(known) and {"kind", "event", "label"} & set(known)
    if not has_needed or len(known) != len(set(known)):
        raise UnusableDiary(line=line, why="header", cure="header", value=", ".join(cells)[:LONGEST_LABEL])
    return names


def _is_activity_log(header: list[str]) -> bool:
    """Return whether the header is that of a GGIR activity log: an ID, then a date."""
    names = [plain_word(cell) for cell in header]
    return len(names) > 2 and names[0] in LOG_IDS and "date" in names[1]


def _read_log_row(header: list[str], line: int, cells: list[str], *, is_alone: bool) -> Iterable[DiaryEntry]:
    """Return the activities of one recording; the ID tells several recordings apart."""
    days: list[tuple[date, list[tuple[str, str]]]] = []
    for name, cell in zip(header[1:], cells[1:], strict=False):
        if "date" in plain_word(name):
            if cell:
                days.append((_read_date(line, cell), []))
        elif cell and days:
            days[-1][1].append((name, cell))
    file = "" if is_alone else cells[0]
    for day, activities in days:
        midnight = datetime.combine(day + timedelta(days=1), time()).isoformat()
        begins = [parse_clock(f"{day.isoformat()} {cell}", line) for _, cell in activities]
        for (name, _), start, end in zip(activities, begins, [*begins[1:], midnight], strict=True):
            yield DiaryEntry(start, end, WORDS.get(plain_word(name), "task"), name, line=line, file=file)


def _read_date(line: int, cell: str) -> date:
    """Parse a date with the day first, as GGIR writes it, or in ISO 8601."""
    found = LOG_DATE.fullmatch(cell)
    try:
        return date(int(found[3]), int(found[2]), int(found[1])) if found else date.fromisoformat(cell)
    except ValueError:
        raise UnusableDiary(line=line, why="time", cure="log date", value=cell[:LONGEST_LABEL]) from None


def _read_row(line: int, row: Mapping[str, str]) -> Row:
    """Return the entry of a row, or the line and time of a row that only ends the previous one."""
    start = read_moment(line, row.get("start", ""), row.get("start_s", ""))
    if start is None:
        raise UnusableDiary(line=line, why="time", cure="time", value="")
    event = row.get("event") or ("" if "kind" in row else row.get("label", ""))
    if "kind" not in row and plain_word(event) in ENDS:
        return line, start
    end = read_moment(line, row.get("end", ""), row.get("end_s", ""))
    kind = WORDS.get(plain_word(row.get("kind", event)), None if "kind" in row else "task")
    if kind is None:
        raise UnusableDiary(line=line, why="kind", cure="kind", value=row["kind"][:LONGEST_LABEL])
    left_out = row.get("left_out", "")
    if left_out and plain_word(left_out) not in YES_NO:
        raise UnusableDiary(line=line, why="yes or no", cure="yes or no", value=left_out[:LONGEST_LABEL])
    return DiaryEntry(
        start=start,
        end=end,
        kind=kind,
        label=(row.get("label") or event)[:LONGEST_LABEL],
        left_out=YES_NO[plain_word(left_out)] if left_out else None,
        line=line,
        file=row.get("file", ""),
    )


def read_moment(line: int, clock: str, seconds: str) -> float | str | None:
    """Return the start or the end of a row from its two columns; None if both are empty.

    Raises UnusableDiary.
    """
    if clock and seconds:
        value = f"{clock}, {seconds}"[:LONGEST_LABEL]
        raise UnusableDiary(line=line, why="two times", cure="two times", value=value)
    if not seconds:
        return parse_clock(clock, line) if clock else None
    if not NUMBER.fullmatch(seconds):
        raise UnusableDiary(line=line, why="in seconds", cure="seconds", value=seconds[:LONGEST_LABEL])
    return float(seconds.replace(",", "."))


def parse_clock(text: str, line: int = 0) -> str:
    """Return a clock time as ISO 8601 text, with its date if it has one.

    Reads ``10:20``, ``10.20``, ``10,20``, ``1020``, ``10h20``, ``10 h 20`` and ``10h`` on the 24-hour clock,
    also with seconds (``10:20:30``, ``10h20m30``, ``102030``). Never reads a number as seconds.

    Raises UnusableDiary: with ``line`` and the accepted forms.
    """
    dated = DAY.fullmatch(text.strip())
    clock = (dated[2] if dated else text).strip()
    hour = next(filter(None, (spelling.fullmatch(clock) for spelling in SPELLINGS)), None)
    why = "fraction" if DAY_FRACTION.fullmatch(clock) else "time"
    try:
        if why == "fraction" or not (hour or dated):
            raise ValueError
        if hour:
            parts = hour.groupdict()
            second = parts["second"] or "00"
            clock = time.fromisoformat(
                f"{int(parts['hour']):02d}:{parts['minute'] or '00'}:{second}"
            ).isoformat()
        return datetime.fromisoformat(f"{dated[1]}T{clock}").isoformat() if dated else clock
    except ValueError:
        raise UnusableDiary(line=line, why=why, cure=why, value=text[:LONGEST_LABEL]) from None


def split_times(entry: DiaryEntry) -> dict[str, float | str | None]:
    """Return the times of a row by column name: the clock time, or seconds (``_s``)."""
    return {
        f"{name}{suffix}": moment if isinstance(moment, str) is not bool(suffix) else None
        for suffix in ("", "_s")
        for name, moment in (("start", entry.start), ("end", entry.end))
    }


def _set_ends(rows: Sequence[Row]) -> tuple[DiaryEntry, ...]:
    """Set the end of each row from the separate row that states it."""
    entries: list[DiaryEntry] = []
    for row in rows:
        if isinstance(row, DiaryEntry):
            entries.append(row)
        elif not entries or entries[-1].end is not None:
            raise UnusableDiary(line=row[0], why="end alone", cure="order", value=str(row[1]))
        else:
            last = entries.pop()
            entries.append(
                DiaryEntry(last.start, row[1], last.kind, last.label, last.left_out, last.line, last.file)
            )
    return tuple(entries)


# The task list: a CSV with the columns ``name,start_s,end_s`` and optionally ``paper_task``.
#
# Times are seconds of the recording's clock, or of the reference's clock if the column ``clock`` contains
# ``reference``. Rows with the same name are repetitions of one task and are pooled. ``paper_task`` (1 to 10)
# is the matching task in Table 1 of the source paper.

NEEDED_BY_TASKS = ("name", "start_s", "end_s")
TASK_CLOCKS = ("recording", "reference")
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
    """Parse the task list, separated by commas or semicolons; raises UnusableTasks."""
    lines = io.StringIO(content.decode("utf-8-sig", "replace"), newline=None)
    delimiter = ";" if ";" in lines.readline() else ","
    lines.seek(0)
    csv.field_size_limit(max(csv.field_size_limit(), len(content)))
    rows = csv.DictReader(lines, delimiter=delimiter)
    names = [(name or "").strip().lower() for name in rows.fieldnames or ()]
    rows.fieldnames = names
    if not set(NEEDED_BY_TASKS) <= set(names):
        raise UnusableTasks(line=1, why="task-columns")
    tasks = tuple(_read_task(row, rows.line_num) for row in rows if any(row.values()))
    if not tasks or len(tasks) > MOST_TASKS:
        raise UnusableTasks(line=rows.line_num, why="task-count")
    return tasks


def _read_task(row: Mapping[str, str | None], line: int) -> TaskWindow:
    name = (row["name"] or "").strip()
    if not name:
        raise UnusableTasks(line=line, why="task-name")
    start_s, end_s = _read_task_seconds(row["start_s"], line), _read_task_seconds(row["end_s"], line)
    if not start_s < end_s:
        raise UnusableTasks(line=line, why="task-order")
    clock = (row.get("clock") or "").strip().lower() or TASK_CLOCKS[0]
    if clock not in TASK_CLOCKS:
        raise UnusableTasks(line=line, why="task-clock")
    paper_task = (row.get("paper_task") or "").strip()
    if paper_task and paper_task not in map(str, range(1, 11)):
        raise UnusableTasks(line=line, why="paper-task")
    return TaskWindow(name, start_s, end_s, int(paper_task) if paper_task else None, clock)


def _read_task_seconds(text: str | None, line: int) -> float:
    try:
        seconds = float((text or "").strip().replace(",", "."))
    except ValueError:
        raise UnusableTasks(line=line, why="task-number") from None
    if not isfinite(seconds):
        raise UnusableTasks(line=line, why="task-number")
    return seconds
