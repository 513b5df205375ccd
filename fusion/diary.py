"""The diary as a CSV: our own form (start, end, kind, label) and the sequential form (time, event).

In the sequential form, as in the diaries of Acti4 and ActiPASS, an event lasts until the next one. Both may
be mixed: an empty end lasts until the next row. Comma, semicolon or tab; a header line; English or French
names; clock times (``07:58``, ``2026-03-02 07:58:30``) or seconds from the first sample. Optional columns:
``left_out`` (yes or no: overrides what the kind says) and ``file`` (the row is for that recording only).
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, time
from typing import Literal, get_args

from fusion.errors import UnusableDiary
from fusion.small_tables import decode_text, list_rows, plain_word

Kind = Literal["shift", "work", "task", "seated", "supported", "break", "outside", "not_worn"]
KINDS: tuple[Kind, ...] = get_args(Kind)
"""In the order in which they are laid over one another: a break within a task cuts the task."""

COLUMNS = {
    "start": "start", "from": "start", "time": "start", "begin": "start", "start_s": "start",
    "debut": "start", "de": "start", "heure": "start",
    "end": "end", "to": "end", "stop": "end", "end_s": "end", "fin": "end", "a": "end",
    "kind": "kind", "type": "kind", "genre": "kind",
    "event": "event", "activity": "event", "evenement": "event", "activite": "event",
    "label": "label", "name": "label", "task": "label", "libelle": "label", "nom": "label", "tache": "label",
    "left_out": "left_out", "exclu": "left_out", "excluded": "left_out",
    "file": "file", "file_name": "file", "fichier": "file",
}  # fmt: skip
WORDS: dict[str, Kind] = {
    "shift": "shift", "quart": "shift", "poste": "shift",
    "work": "work", "travail": "work",
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
NUMBER = re.compile(r"\d+(?:[.,]\d+)?")
HOUR = re.compile(r"(\d{1,2})\s?[:hH]\s?(\d{2})(?::(\d{2}(?:\.\d{1,6})?))?")
DAY = re.compile(r"(\d{4}-\d{2}-\d{2})[ T](.+)")


@dataclass(frozen=True, slots=True)
class DiaryEntry:
    """A row of a diary before the recording is known.

    Attributes
    ----------
    start, end
        Seconds from the first sample, or the clock as ISO 8601 text: ``"07:58:00"``,
        ``"2026-03-02T07:58:00"``. An ``end`` of None lasts until the next row begins.
    left_out
        Whether its time leaves the denominator; None: as its kind says.
    line
        In the file, from 1; 0 where there is none.
    file
        Only for the recording of this name; empty: for any.
    """

    start: float | str
    end: float | str | None
    kind: Kind
    label: str = ""
    left_out: bool | None = None
    line: int = 0
    file: str = ""


def read_diary(content: bytes) -> tuple[DiaryEntry, ...]:
    """Read a diary.

    Raises
    ------
    UnusableDiary
        With the line, the reason and the cure.
    """
    rows = _list_rows(content)
    header = next(rows, None)
    if header is None:
        raise UnusableDiary(line=1, why="empty", cure="header", value="")
    columns = _name_columns(*header)
    entries = [_read_row(line, dict(zip(columns, cells, strict=False))) for line, cells in rows]
    if not entries:
        raise UnusableDiary(line=header[0], why="empty", cure="header", value="")
    return _drop_ends(entries)


def _list_rows(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Give so many rows and no more: each is laid over the whole recording."""
    for count, (line, cells) in enumerate(list_rows(decode_text(content))):
        if count >= MOST_ROWS:
            raise UnusableDiary(line=line, why="too many rows", cure="rows", value=str(MOST_ROWS))
        yield line, cells


def _name_columns(line: int, cells: list[str]) -> list[str]:
    names = [COLUMNS.get(plain_word(cell).replace(" ", "_"), "") for cell in cells]
    known = [name for name in names if name]
    if "start" not in known or not {"kind", "event", "label"} & set(known) or len(known) != len(set(known)):
        raise UnusableDiary(line=line, why="header", cure="header", value=", ".join(cells)[:LONGEST_LABEL])
    return names


def _read_row(line: int, row: Mapping[str, str]) -> DiaryEntry | tuple[int, float | str]:
    """Give the entry of a row, or the line and the moment of a row that only ends the one before."""
    start = read_moment(line, row.get("start", ""))
    event = row.get("event") or ("" if "kind" in row else row.get("label", ""))
    if "kind" not in row and plain_word(event) in ENDS:
        return line, start
    end = read_moment(line, row["end"]) if row.get("end") else None
    return DiaryEntry(
        start=start,
        end=end,
        kind=_read_kind(line, row["kind"]) if "kind" in row else WORDS.get(plain_word(event), "task"),
        label=(row.get("label") or event)[:LONGEST_LABEL],
        left_out=_read_yes_no(line, row.get("left_out", "")),
        line=line,
        file=row.get("file", ""),
    )


def _read_kind(line: int, word: str) -> Kind:
    kind = WORDS.get(plain_word(word))
    if kind is None:
        raise UnusableDiary(line=line, why="kind", cure="kind", value=word[:LONGEST_LABEL])
    return kind


def _read_yes_no(line: int, word: str) -> bool | None:
    if not word:
        return None
    if plain_word(word) not in YES_NO:
        raise UnusableDiary(line=line, why="yes or no", cure="yes or no", value=word[:LONGEST_LABEL])
    return YES_NO[plain_word(word)]


def read_moment(line: int, cell: str) -> float | str:
    """Read seconds, or a clock time as ISO 8601 text.

    Raises
    ------
    UnusableDiary
        Naming the line.
    """
    if NUMBER.fullmatch(cell):
        return float(cell.replace(",", "."))
    dated = DAY.fullmatch(cell)
    told = _read_hour(dated[2] if dated else cell)
    try:
        if dated:
            return datetime.fromisoformat(f"{dated[1]}T{told}").isoformat()
        return time.fromisoformat(told).isoformat()
    except ValueError:
        value = cell[:LONGEST_LABEL]
        raise UnusableDiary(line=line, why="time", cure="time", value=value) from None


def _read_hour(told: str) -> str:
    """Write ``7 h 58`` and ``7:58`` as ``07:58:00``; leave anything else (an offset) as it is."""
    hour = HOUR.fullmatch(told.strip())
    return f"{int(hour[1]):02d}:{hour[2]}:{hour[3] or '00'}" if hour else told.strip()


def _drop_ends(rows: list[DiaryEntry | tuple[int, float | str]]) -> tuple[DiaryEntry, ...]:
    """Let each row that only ends the one before give that one its end."""
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
