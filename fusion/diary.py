"""Read a diary, in CSV or Excel: start, end, kind, label, or the sequential form (time, event).

In the sequential form, used by the diaries of ActiPASS, an event lasts until the next one. Both forms may be
mixed: an empty end lasts until the next row. The header has English or French names and is in one of the
first rows; CSV is separated by commas, semicolons or tabs. ``start``, ``end`` and ``time`` contain clock
times in any form that :func:`parse_clock` reads; ``start_s``, ``end_s`` and ``time_s`` contain seconds from
the first sample. Optional columns: ``left_out`` (yes or no; overrides the default of the kind), ``file`` or
``subject`` (the row applies to that recording only), ``date`` and ``end_date`` (of the clock times in the
row; without an end date, an end before its start is on the next day). A "mark" is one moment, such as the
time of a pain; its end is ignored.

These layouts of other programs are also read:

- GGIR's activity log: one row per recording with its ID, a column with the date (day first, or ISO 8601),
  then columns named after activities with the start time of each. More dates follow in the same way. An
  activity lasts until the next one of its day; the last one lasts until midnight. Of its advanced sleep log,
  the nonwear and nap columns are read, in pairs.
- ActiPASS's diary: ID, Date, Time, Event, Comment. "Stop" ends an event; "Start" and "Ref" are not read.
- Acti4's setup: a sheet for each ID, with Type, Weekday, Start, Stop. "E" is time not worn if the code says
  so of the arm; "F" (reference) and "G" (synchronization) are not read.
- ActiLife's log diary: Subject Name, On Date, On Time, Off Date, Off Time, Category.
- The activity per second of ActiPASS (DateTime, Activity, Steps, SVM, ...) and of acti-motus (datetime,
  activity) becomes rows of the kind "posture".
"""

import csv
import io
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import date, datetime, time, timedelta
from itertools import chain, islice, pairwise
from math import isfinite
from typing import BinaryIO, Literal, get_args

from acromion.fusion.conventions import PoseHeld, check_choice
from acromion.fusion.errors import (
    MOST_ROWS_NAMED,
    Fact,
    UnusableDiary,
    UnusablePostures,
    UnusableTasks,
    join_facts,
)
from acromion.fusion.workbook import is_workbook, read_workbook

# Small tables that people type, such as diaries and participant lists: any delimiter, two encodings.


def decode_text(content: bytes) -> str:
    """Decode UTF-8, or Windows-1252 as older spreadsheets write it."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


class OpenQuoteError(csv.Error):
    """A quotation mark without its second one: the next lines would be part of its cell."""

    def __init__(self, line: int, text: str) -> None:
        super().__init__(line, text)
        self.facts: dict[str, Fact] = {"line": line, "why": "open quote", "value": text[:LONGEST_LABEL]}


def read_rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the non-empty rows with their first line, from 1; skip comment lines that start with #.

    Lines may end as on any system, including old Macs. A cell may be as long as the file, and have several
    lines in quotation marks.

    Raises OpenQuoteError.
    """
    lines = io.StringIO(text, newline=None)
    first = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    delimiter = max((";", "\t", ","), key=first.count)
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))
    taken: list[str] = []

    def take() -> Iterator[str]:
        for line in io.StringIO(text, newline=None):
            taken.append(line)
            yield line

    reader = csv.reader(take(), delimiter=delimiter)
    for cells in reader:
        line = reader.line_num - len(taken) + 1
        if len(taken) > 1:
            _refuse_open_quote(taken, line, delimiter)
        taken.clear()
        stripped = [cell.strip() for cell in cells]
        if any(stripped) and not stripped[0].startswith("#"):
            yield line, stripped


def _refuse_open_quote(lines: Sequence[str], line: int, delimiter: str) -> None:
    """Refuse a row of several lines that does not end with the second quotation mark of its last cell."""
    try:
        next(csv.reader(lines, delimiter=delimiter, strict=True))
    except csv.Error:
        raise OpenQuoteError(line, lines[0].strip()) from None


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


Kind = Literal[
    "shift", "work", "pose", "task", "seated", "upright", "supported", "break", "outside", "not_worn",
    "posture", "mark",
]  # fmt: skip
KINDS: tuple[Kind, ...] = get_args(Kind)
"""In order of precedence, lowest first: a break within a task interrupts the task.

A "pose" is the time of the calibration pose, and a "mark" is one moment; neither divides the day. A "posture"
has one of :data:`POSTURES` as its label. It divides the figures by posture only, so that it leaves the tasks
whole.
"""
POSTURES: tuple[Kind, ...] = ("seated", "upright")
"""Kinds that state the posture, and the labels of a "posture"; lying counts as seated."""
NAMED: tuple[Kind, ...] = ("task", *POSTURES, "supported")
"""Kinds whose time is counted under a separate name."""

COLUMNS = {
    "start": "start", "from": "start", "time": "start", "begin": "start",
    "debut": "start", "de": "start", "heure": "start", "on_time": "start",
    "end": "end", "to": "end", "stop": "end", "fin": "end", "a": "end", "off_time": "end",
    "date": "date", "day": "date", "jour": "date", "on_date": "date", "start_date": "date",
    "end_date": "end_date", "off_date": "end_date", "date_fin": "end_date",
    "start_s": "start_s", "time_s": "start_s", "debut_s": "start_s", "end_s": "end_s", "fin_s": "end_s",
    "kind": "kind", "type": "kind", "genre": "kind",
    "event": "event", "activity": "event", "evenement": "event", "activite": "event", "category": "event",
    "label": "label", "name": "label", "task": "label", "libelle": "label", "nom": "label", "tache": "label",
    "left_out": "left_out", "exclu": "left_out", "excluded": "left_out",
    "file": "file", "file_name": "file", "fichier": "file",
    "subject": "subject", "subject_name": "subject", "participant": "subject", "id": "subject",
    "sujet": "subject", "identifiant": "subject",
}  # fmt: skip
WORDS: dict[str, Kind] = {
    "shift": "shift", "quart": "shift", "poste": "shift",
    "work": "work", "travail": "work",
    "pose": "pose", "calibration": "pose", "etalonnage": "pose",
    "task": "task", "tache": "task",
    "seated": "seated", "sitting": "seated", "assis": "seated", "assise": "seated",
    "lying": "seated", "couche": "seated", "couchee": "seated",
    "upright": "upright", "standing": "upright", "walking": "upright",
    "debout": "upright", "marche": "upright",
    "supported": "supported", "appuye": "supported", "soutenu": "supported",
    "break": "break", "lunch": "break", "pause": "break", "repas": "break", "diner": "break",
    "outside": "outside", "off": "outside", "hors poste": "outside", "hors": "outside",
    "leisure": "outside", "loisirs": "outside", "sleep": "outside", "sommeil": "outside",
    "bed": "outside", "bedtime": "outside", "night": "outside", "nuit": "outside",
    "not worn": "not_worn", "nonwear": "not_worn", "non porte": "not_worn", "retire": "not_worn",
    "nw": "not_worn", "mnw": "not_worn", "fnw": "not_worn", "forcednw": "not_worn",
    "posture": "posture",
    "mark": "mark", "marque": "mark", "repere": "mark", "symptom": "mark", "symptome": "mark",
    "pain": "mark", "douleur": "mark",
}  # fmt: skip
ENDS = ("end", "stop", "fin")
UNREAD = ("start", "ref")
"""Events of ActiPASS without a duration: the start of the data and its reference posture."""
YES_NO = {"yes": True, "y": True, "1": True, "true": True, "oui": True, "o": True,
          "no": False, "n": False, "0": False, "false": False, "non": False}  # fmt: skip
LONGEST_LABEL = 200
MOST_ROWS = 10_000
HEAD_BYTES = 1 << 16
HEADER_ROWS = 20
"""The header is in one of so many rows: above it may be a title, or Acti4's list of sensors."""
LONGEST_NIGHT_H = 16
"""The longest period over midnight without an end date; a longer one is taken for a slip in its times."""
DATE_FORMATS = ("%d-%m-%Y", "%d.%m.%Y", "%d-%b-%Y", "%Y/%m/%d")
"""Those of GGIR, of MATLAB (02-Mar-2026) and others in which day and month cannot be confused."""
SLASHED_DATE = re.compile(r"(\d{1,2})/(\d{1,2})/(\d{4})")
"""The day may be first or second; a date of the same table with a number above 12 decides."""
LOG_PAIR = re.compile(r"d\d+ (nap|nonwear)\d* (?:start|off)")
"""A column of GGIR's advanced sleep log whose period ends in the next column."""
LOG_EMPTY = ("", "na", "nan")
ACTI4_TYPE = re.compile(r"([A-G])\d*\.(\d*)\s*(.*)")
ACTI4_MOMENT = re.compile(r"(\d{2})/(\d{2})/(\d{4})/(.+)")
ARM_PLACE = 2
"""Place of the arm in Acti4's code of the sensors that are worn: thigh, hip, arm, trunk."""
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
OVER_A_DAY = re.compile(r"[1-9][0-9]?\.[0-9]+")
DAY = re.compile(r"(\d{4}-\d{2}-\d{2})[ T](.+)")


@dataclass(frozen=True, slots=True)
class DiaryEntry:
    """One row of a diary, not yet matched to a recording.

    ``start``, ``end``: a number is seconds from the first sample; text is a clock time, ``"07:58:00"`` or
    ``"2026-03-02T07:58:00"``. An ``end`` of None lasts until the next row begins.
    ``kind``: "work", "break" and so on: one of :data:`acromion.fusion.diary.Kind`. A "mark" is one moment,
    its start.
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
        if self.kind == "posture":
            check_choice("label", self.label, POSTURES)


Row = DiaryEntry | tuple[int, float | str, str]
"""An entry, or the line, time and recording of a row that only ends the previous one."""


def read_diary(
    content: bytes, find_contradictions: Callable[[Sequence[DiaryEntry]], list[UnusableDiary]] | None = None
) -> tuple[DiaryEntry, ...]:
    """Parse a diary, from CSV or from an Excel workbook.

    If several sheets of a workbook contain a diary, the name of each is the file or subject of its rows.
    ``find_contradictions`` compares the readable rows with one another.

    Raises UnusableDiary: with every line that cannot be used, the reasons and the remedies.
    """
    entries, row_errors = _read_sheets(content)
    refuse_slips([*row_errors, *(find_contradictions(entries) if find_contradictions else ())])
    return entries


Table = tuple[tuple[DiaryEntry, ...], list[UnusableDiary]]
"""The rows that can be read, and the errors of the others."""


def _read_sheets(content: bytes) -> Table:
    if not is_workbook(content):
        try:
            every = read_rows(decode_text(content))
            first = list(islice(every, HEADER_ROWS + MOST_ROWS))
            is_table = not _is_activities(first)
            return _read_table(first) if is_table else (_read_activities(chain(first, every)), [])
        except OpenQuoteError as error:
            raise UnusableDiary(**error.facts, cure="open quote") from None
    sheets = read_workbook(content)
    activities = next(filter(_is_activities, sheets.values()), None)
    if activities:
        return _read_activities(activities), []
    diaries = {name: rows for name, rows in sheets.items() if _find_header(rows) is not None}
    if len(diaries) < 2:
        found = *diaries.values(), *filter(None, sheets.values()), []
        return _read_table(found[0], is_sheet=True)
    entries: list[DiaryEntry] = []
    row_errors: list[UnusableDiary] = []
    for name, rows in diaries.items():
        read, errors = _read_table(rows, is_sheet=True)
        entries += (replace(entry, file=entry.file or name) for entry in read)
        row_errors += (UnusableDiary(**error.facts, sheet=name) for error in errors)
        if len(entries) > MOST_ROWS:
            raise _refuse_rows(entries[-1].line)
    return tuple(entries), row_errors


def is_diary(file: BinaryIO) -> bool:
    """Return whether a file begins as a diary or a table of activities; leaves it rewound."""
    head = file.read(HEAD_BYTES)
    file.seek(0)
    if is_workbook(head):
        return True
    rows: list[tuple[int, list[str]]] = []
    with suppress(csv.Error):  # also a quotation mark that is open because the head ends there
        rows.extend(islice(read_rows(decode_text(head)), HEADER_ROWS))
    return _is_activities(rows) or _find_header(rows) is not None


def _find_header(rows: Sequence[tuple[int, list[str]]]) -> int | None:
    """Return the place of the header among the first rows; None if there is none."""
    for place, (_, cells) in enumerate(rows[:HEADER_ROWS]):
        if _name_columns(cells) or _is_activity_log(cells):
            return place
    return None


def _read_table(rows: Sequence[tuple[int, list[str]]], *, is_sheet: bool = False) -> Table:
    """Parse the rows of one table; rows above its header are ignored."""
    place = _find_header(rows)
    if len(rows) < 2 or place is None or place == len(rows) - 1:
        line, cells = rows[place or 0] if rows else (1, [])
        why = "header" if len(rows) > 1 and place is None else "empty"
        value = ", ".join(filter(None, cells))[:LONGEST_LABEL] if why == "header" else ""
        raise UnusableDiary(line=line, why=why, cure="header", value=value)
    header, body = rows[place][1], rows[place + 1 :]
    if len(body) >= MOST_ROWS:  # each row is compared with the whole recording
        raise _refuse_rows(body[MOST_ROWS - 1][0])
    columns = _name_columns(header)
    is_date = ["date" in plain_word(name) for name in columns or header]
    order = _find_date_order(body)
    is_clock = [is_sheet and (not columns or name in {"start", "end"}) for name in columns or header]

    def read(line: int, cells: list[str]) -> Iterable[Row]:
        times = [cell for cell, is_time in zip(cells, is_clock, strict=False) if is_time]
        has_fraction = any(map(_is_day_fraction, times))
        for cell in times if has_fraction else ():  # then 1.25 is 06:00 on the next day, and not 01:25
            if OVER_A_DAY.fullmatch(cell):
                raise UnusableDiary(line=line, why="fraction", cure="fraction", value=cell)
        written = [
            _write_time(cell) if is_time else cell for cell, is_time in zip(cells, is_clock, strict=False)
        ]
        written = [
            _write_date(line, cell, order) if is_day else cell
            for cell, is_day in zip(written, is_date, strict=False)
        ]
        if not columns:
            return _read_log_row(header, line, written)
        return _read_row(line, dict(zip(columns, written, strict=False)))

    entries, row_errors = _read_each(body, read)
    ended, end_errors = _set_ends(entries)
    return ended, row_errors + end_errors


def _find_date_order(rows: Sequence[tuple[int, list[str]]]) -> Literal["", "day", "month"]:
    """Return whether the day or the month is first in the dates with slashes; "" if no date decides."""
    found = [match for _, cells in rows for match in map(SLASHED_DATE.fullmatch, cells) if match]
    is_day, is_month = (any(int(match[place]) > 12 for match in found) for place in (1, 2))
    if is_day is is_month:
        return ""
    return "day" if is_day else "month"


def _write_date(line: int, cell: str, order: Literal["", "day", "month"]) -> str:
    """Return a date with slashes with dashes and the day first, anything else unchanged.

    Raises UnusableDiary: it is not clear which number is the day.
    """
    found = SLASHED_DATE.fullmatch(cell)
    if not found:
        return cell
    first, second, year = found.groups()
    if int(first) == int(second) or order == "day":
        return f"{first}-{second}-{year}"
    if order == "month":
        return f"{second}-{first}-{year}"
    raise UnusableDiary(line=line, why="day or month", cure="log date", value=cell)


def _write_time(cell: str) -> str:
    """Return a spreadsheet's fraction of a day as a clock time, anything else unchanged."""
    if not _is_day_fraction(cell):
        return cell
    milliseconds = round(float(cell) * 86_400_000)
    midnight = datetime.combine(date.min, time())
    return (midnight + timedelta(milliseconds=milliseconds)).time().isoformat()


def _is_day_fraction(cell: str) -> bool:
    """Return whether a cell has a number under 1; with a comma it is text."""
    return DAY_FRACTION.fullmatch(cell) is not None and "," not in cell and float(cell) < 1


def _read_each(
    rows: Sequence[tuple[int, list[str]]], read: Callable[[int, list[str]], Iterable[Row]]
) -> tuple[list[Row], list[UnusableDiary]]:
    """Return the rows that can be read, and the errors of the others, each with its text."""
    entries: list[Row] = []
    row_errors: list[UnusableDiary] = []
    for line, cells in rows:
        if len(entries) > MOST_ROWS:  # a row of an activity log has many
            raise _refuse_rows(line)
        try:
            entries.extend(read(line, cells))
        except UnusableDiary as error:
            text = ", ".join(cell for cell in cells if cell)[:LONGEST_LABEL]
            value = str(error.facts.get("value", ""))[:LONGEST_LABEL]
            row_errors.append(UnusableDiary(**{**error.facts, "value": value, "text": text}))
    return entries, row_errors


def _refuse_rows(line: int) -> UnusableDiary:
    return UnusableDiary(line=line, why="too many rows", cure="rows", value=str(MOST_ROWS))


def refuse_slips(row_errors: Sequence[UnusableDiary]) -> None:
    """Raise one error for all rows that cannot be used, of the kind of the first.

    Raises UnusableDiary: if there is at least one such row.
    """
    if row_errors:
        raise type(row_errors[0])(**join_facts([error.facts for error in row_errors]))


def _name_columns(cells: Sequence[str]) -> list[str]:
    """Return the meaning of each column, "" if it is not read; an empty list for a line of data."""
    names = [COLUMNS.get(plain_word(cell).replace(" ", "_"), "") for cell in cells]
    known = [name for name in names if name]
    has_needed = {"start", "start_s"} & set(known) and {"kind", "event", "label"} & set(known)
    return names if has_needed and len(known) == len(set(known)) else []


def _is_activity_log(header: Sequence[str]) -> bool:
    """Return whether the header is that of a GGIR activity log: an ID, then a date."""
    names = [plain_word(cell) for cell in header]
    return len(names) > 2 and COLUMNS.get(names[0]) == "subject" and "date" in names[1]


def _read_log_row(header: list[str], line: int, cells: list[str]) -> Iterable[DiaryEntry]:
    """Return the activities of the recording with the ID of the row."""
    days: list[tuple[str, list[tuple[str, str]]]] = []
    for name, cell in zip(header[1:], cells[1:], strict=False):
        told = "" if cell.casefold() in LOG_EMPTY else cell
        if "date" in plain_word(name):
            days.append((_read_date(line, told) if told else "", []))
        elif days[-1][0]:
            days[-1][1].append((name, told))
    divide = _pair_naps if re.match(r"d\d+ date", plain_word(header[1])) else _chain_activities
    for day, activities in days:
        for name, start, end in divide(day, activities, line):
            kind = WORDS.get(plain_word(name), "task")
            yield DiaryEntry(start, end, kind, name, line=line, file=cells[0])


def _chain_activities(
    day: str, activities: Sequence[tuple[str, str]], line: int
) -> Iterator[tuple[str, str, str]]:
    """Yield the activities of a day: each lasts until the next one, the last until midnight."""
    begins = [(name, _date_clock(cell, day, line)) for name, cell in activities if cell]
    if begins:
        midnight = datetime.combine(date.fromisoformat(day) + timedelta(days=1), time()).isoformat()
        for (name, start), (_, end) in pairwise([*begins, ("", midnight)]):
            yield name, start, end


def _pair_naps(day: str, activities: Sequence[tuple[str, str]], line: int) -> Iterator[tuple[str, str, str]]:
    """Yield the naps and the time not worn of a day of GGIR's advanced sleep log."""
    for (name, start), (_, end) in pairwise(activities):
        found = LOG_PAIR.fullmatch(plain_word(name))
        if found and (start or end):
            begin = _date_clock(start, day, line)
            stop = _follow(begin, _date_clock(end, day, line), line)
            yield ("sleep" if found[1] == "nap" else "nonwear"), begin, stop


def _read_date(line: int, cell: str) -> str:
    """Parse a date in one of :data:`DATE_FORMATS` or ISO 8601; a spreadsheet adds 00:00:00."""
    for form in DATE_FORMATS:
        with suppress(ValueError):
            return datetime.strptime(cell, form).date().isoformat()  # noqa: DTZ007  a date only
    try:
        return datetime.fromisoformat(cell).date().isoformat()
    except ValueError:
        raise UnusableDiary(line=line, why="time", cure="log date", value=cell[:LONGEST_LABEL]) from None


def _date_clock(clock: str, day: str, line: int) -> str:
    """Parse a clock time on a day, if one is stated; a date in the time itself has precedence."""
    if found := ACTI4_MOMENT.fullmatch(clock):
        clock = f"{found[3]}-{found[2]}-{found[1]} {found[4]}"
    return parse_clock(f"{day} {clock}" if day and not DAY.fullmatch(clock) else clock, line)


def _follow(start: str, end: str, line: int) -> str:
    """Return the end of a period, on the next day if it is stated before its start."""
    begin, stop = (datetime.fromisoformat(moment).replace(tzinfo=None) for moment in (start, end))
    if stop >= begin:
        return end
    if stop + timedelta(days=1) - begin > timedelta(hours=LONGEST_NIGHT_H):
        raise UnusableDiary(line=line, why="end first", cure="order", value=f"{start} - {end}")
    return (datetime.fromisoformat(end) + timedelta(days=1)).isoformat()


def _read_row(line: int, row: Mapping[str, str]) -> Iterable[Row]:
    """Return the entry of a row, or the line and time of a row that only ends the previous one."""
    event = row.get("event") or ("" if "kind" in row else row.get("label", ""))
    code = ACTI4_TYPE.fullmatch(row.get("kind", ""))
    is_worn = code is not None and code[1] == "E" and code[2][ARM_PLACE : ARM_PLACE + 1] != "0"
    if is_worn or (code and code[1] in "FG") or ("kind" not in row and plain_word(event) in UNREAD):
        return ()
    day = _read_date(line, row["date"]) if row.get("date") else ""
    last_day = _read_date(line, row["end_date"]) if row.get("end_date") else day
    start = _read_dated(line, row.get("start", ""), row.get("start_s", ""), day)
    if start is None:
        raise UnusableDiary(line=line, why="time", cure="time", value="")
    file = row.get("file") or row.get("subject", "")
    if "kind" not in row and plain_word(event) in ENDS:
        return ((line, start, file),)
    word = plain_word(code[3] if code else row.get("kind", event))
    kind = WORDS.get(word, None if "kind" in row and not code else "task")
    if kind is None:
        raise UnusableDiary(line=line, why="kind", cure="kind", value=row["kind"][:LONGEST_LABEL])
    if code and code[1] == "E":
        kind = "not_worn"
    end = None
    if kind != "mark":
        end = _read_dated(line, row.get("end", ""), row.get("end_s", ""), last_day)
        if day and last_day == day and isinstance(start, str) and isinstance(end, str):
            end = _follow(start, end, line)
    left_out = row.get("left_out", "")
    if left_out and plain_word(left_out) not in YES_NO:
        raise UnusableDiary(line=line, why="yes or no", cure="yes or no", value=left_out[:LONGEST_LABEL])
    is_left_out = YES_NO[plain_word(left_out)] if left_out else None
    label = (row.get("label") or (code[3] if code else event))[:LONGEST_LABEL]
    if kind == "posture":
        label = WORDS.get(plain_word(label), "")
        if label not in POSTURES:
            raise UnusableDiary(line=line, why="kind", cure="posture", value=row.get("label", ""))
    return (DiaryEntry(start, end, kind, label, is_left_out, line, file),)


def _read_dated(line: int, clock: str, seconds: str, day: str) -> float | str | None:
    """Return a time of a row as :func:`read_moment`, on the day that the row states."""
    return _date_clock(clock, day, line) if clock and not seconds else read_moment(line, clock, seconds)


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


def _set_ends(rows: Sequence[Row]) -> Table:
    """Set the end of each row from the separate row of the same recording that states it."""
    entries: list[DiaryEntry] = []
    row_errors: list[UnusableDiary] = []
    last: dict[str, int] = {}
    for row in rows:
        if isinstance(row, DiaryEntry):
            if row.kind != "mark":
                last[row.file] = len(entries)
            entries.append(row)
            continue
        line, end, file = row
        place = last.get(file)
        if place is None or entries[place].end is not None:
            row_errors.append(UnusableDiary(line=line, why="end alone", cure="order", value=str(end)))
        else:
            entries[place] = replace(entries[place], end=end)
    return tuple(entries), row_errors


# The activity per second that ActiPASS and acti-motus derive from a sensor on the thigh.

ACTIVITY_CODES = ("nw", "lie", "sit", "stand", "move", "walk", "run", "stair", "cycle", "other", "slpibd",
                  "liestill", "kneel")  # fmt: skip
"""The activity by its number in ActiPASS, from 0."""
ACTIPASS_COLUMNS = {"svm", "timeinbed", "sleepinterval"}
"""Columns of ActiPASS only: acti-motus has other numbers for its activities."""
ACTIVITIES: Mapping[str, str] = {
    **dict.fromkeys(("lie", "sit", "slpibd", "liestill"), "seated"),
    **dict.fromkeys(("stand", "move", "walk", "run", "stair"), "upright"),
    **dict.fromkeys(("shuffle", "slow walk", "fast walk", "stairs", "squat"), "upright"),
    **dict.fromkeys(("nw", "non wear", "cycle", "bicycle", "row", "other", "kneel", ""), ""),
}
"""The posture in each activity: on the feet is upright (as in acti-motus); cycling and kneeling have none."""
DAY_NUMBER = re.compile(r"[67][0-9]{5}(?:[.,][0-9]+)?")
"""MATLAB's number of a day, in which ActiPASS writes the time: day 1 is 1 January of year 0."""
DAYS_BEFORE_YEAR_1 = 366
MATLAB_TIME = re.compile(r"[0-9]{2}-[A-Za-z]{3}-[0-9]{4} [0-9:]{8}")
EPOCH = timedelta(seconds=1)


def _is_activities(rows: Sequence[tuple[int, list[str]]]) -> bool:
    return bool(rows) and {"datetime", "activity"} <= set(map(plain_word, rows[0][1]))


def _read_activities(rows: Iterable[tuple[int, list[str]]]) -> tuple[DiaryEntry, ...]:
    """Return the postures of a table of activities; a second without a row, or not worn, has no posture.

    Raises UnusablePostures with every line whose time or activity cannot be read, or is not after the one
    before.
    """
    rows = iter(rows)
    names = [plain_word(cell) for cell in next(rows)[1]]
    place, is_numbered = (names.index("datetime"), names.index("activity")), ACTIPASS_COLUMNS & set(names)
    bouts: list[DiaryEntry] = []
    row_errors: list[UnusableDiary] = []
    begin = end = before = None
    posture, first_line, unnamed = "", 0, 0

    def finish() -> None:
        if posture and begin and end:
            bouts.append(DiaryEntry(begin.isoformat(), end.isoformat(), "posture", posture, line=first_line))

    for line, cells in rows:
        text, activity = (cells[k] if k < len(cells) else "" for k in place)
        word = plain_word(activity)
        if is_numbered and word.isdecimal() and int(word) < len(ACTIVITY_CODES):
            word = ACTIVITY_CODES[int(word)]
        try:
            if word not in ACTIVITIES:
                raise UnusablePostures(
                    line=line, why="activity", cure="activity", value=activity[:LONGEST_LABEL]
                )
            moment = _read_second(line, text)
            if before is not None and (moment.tzinfo is None) is not (before.tzinfo is None):
                raise UnusablePostures(
                    line=line, why="mixed offsets", cure="second", value=text[:LONGEST_LABEL]
                )
            if before is not None and moment <= before:
                raise UnusablePostures(
                    line=line, why="not later", cure="not later", value=text[:LONGEST_LABEL]
                )
        except UnusablePostures as error:
            if len(row_errors) < MOST_ROWS_NAMED:
                row_errors.append(error)
            else:
                unnamed += 1
            continue
        if before is None or end is None or ACTIVITIES[word] != posture or moment > end + EPOCH / 2:
            end = min(end, moment) if end else None
            finish()
            begin, posture, first_line = moment, ACTIVITIES[word], line
        before, end = moment, moment + EPOCH
    finish()
    if unnamed:
        row_errors[-1].facts["more"] = unnamed
    refuse_slips(row_errors)
    if not bouts or len(bouts) > MOST_ROWS:
        why = "too many rows" if bouts else "no postures"
        raise UnusablePostures(line=1, why=why, cure="activity", value=str(MOST_ROWS) if bouts else "")
    return tuple(bouts)


def _read_second(line: int, text: str) -> datetime:
    """Parse the time of an activity, to the millisecond. Raises UnusablePostures."""
    try:
        if DAY_NUMBER.fullmatch(text):
            days = float(text.replace(",", ".")) - DAYS_BEFORE_YEAR_1
            since = timedelta(milliseconds=round((days - 1) * 86_400_000))
            return datetime.combine(date.min, time()) + since
        if MATLAB_TIME.fullmatch(text):
            return datetime.strptime(text, "%d-%b-%Y %H:%M:%S")  # noqa: DTZ007  local time
        return datetime.fromisoformat(text)
    except (ValueError, OverflowError):
        raise UnusablePostures(line=line, why="time", cure="second", value=text[:LONGEST_LABEL]) from None


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
    """Parse the task list; raises UnusableTasks."""
    try:
        rows = list(read_rows(decode_text(content)))
    except OpenQuoteError as error:
        raise UnusableTasks(line=error.facts["line"], why="open quote") from None
    names = [cell.lower() for cell in rows[0][1]] if rows else []
    if not set(NEEDED_BY_TASKS) <= set(names):
        raise UnusableTasks(line=1, why="task-columns")
    tasks = tuple(_read_task(dict(zip(names, cells, strict=False)), line) for line, cells in rows[1:])
    if not tasks or len(tasks) > MOST_TASKS:
        raise UnusableTasks(line=rows[-1][0], why="task-count")
    return tasks


def _read_task(row: Mapping[str, str], line: int) -> TaskWindow:
    name = row.get("name", "")
    if not name:
        raise UnusableTasks(line=line, why="task-name")
    start_s, end_s = (_read_task_seconds(row.get(end, ""), line) for end in ("start_s", "end_s"))
    if not start_s < end_s:
        raise UnusableTasks(line=line, why="task-order")
    clock = row.get("clock", "").lower() or TASK_CLOCKS[0]
    if clock not in TASK_CLOCKS:
        raise UnusableTasks(line=line, why="task-clock")
    paper_task = row.get("paper_task", "")
    if paper_task and paper_task not in map(str, range(1, 11)):
        raise UnusableTasks(line=line, why="paper-task")
    return TaskWindow(name, start_s, end_s, int(paper_task) if paper_task else None, clock)


def _read_task_seconds(text: str, line: int) -> float:
    try:
        seconds = float(text.replace(",", "."))
    except ValueError:
        raise UnusableTasks(line=line, why="task-number") from None
    if not isfinite(seconds):
        raise UnusableTasks(line=line, why="task-number")
    return seconds
