"""The diary as a CSV: our own form (start, end, kind, label) and the sequential form (time, event).

In the sequential form, as in the diaries of Acti4 and ActiPASS, an event lasts until the next one. Both may
be mixed: an empty end lasts until the next row. Comma, semicolon or tab; a header line; English or French
names; clock times (``07:58``, ``2026-03-02 07:58:30``) or seconds from the first sample. Optional columns:
``left_out`` (yes or no: overrides what the kind says) and ``file`` (the row is for that recording only).

The activity log of GGIR is read too: one row for each recording, its ID, then a column with the date (day
first, or ISO 8601) followed by columns named after activities that hold when each began; further dates follow
in the same way. An activity lasts until the next of its day, the last until midnight.
"""

import csv
import io
import re
import unicodedata
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, date, datetime, time, timedelta
from functools import partial
from itertools import pairwise
from typing import Literal, get_args

from fusion.caveats import Caveat
from fusion.errors import UnusableDiary
from fusion.recording import MICROSECONDS, QualityFlag, Span, flag_stretches

# Small tables that people type: diaries, lists of participants. Any delimiter, any of two encodings.


def decode_text(content: bytes) -> str:
    """Read UTF-8, or else what older spreadsheets write."""
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("cp1252", errors="replace")


def read_rows(text: str) -> Iterator[tuple[int, list[str]]]:
    """Read the rows that are not empty, with their line from 1; lines that begin with # are remarks.

    A line may end as on any system, also as on old Macs, and a cell may be as long as the table.
    """
    first = next((line for line in text.splitlines() if line.strip() and not line.startswith("#")), "")
    delimiter = max((";", "\t", ","), key=first.count)
    csv.field_size_limit(max(csv.field_size_limit(), len(text)))
    reader = csv.reader(io.StringIO(text, newline=None), delimiter=delimiter)
    for cells in reader:
        told = [cell.strip() for cell in cells]
        if any(told) and not told[0].startswith("#"):
            yield reader.line_num, told


def plain_word(word: str) -> str:
    """Give a word without case, accents, underscores and hyphens."""
    letters = unicodedata.normalize("NFKD", word.casefold())
    return re.sub(r"[\s_-]+", " ", "".join(c for c in letters if not unicodedata.combining(c))).strip()


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
MOST_NAMED = 20
MOST_ROWS = 10_000
LOG_IDS = ("id", "identifiant", "participant", "subject", "sujet")
LOG_DATE = re.compile(r"(\d{1,2})[-/.](\d{1,2})[-/.](\d{4})")
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
    kind
        "work", "break" and so on: one of :data:`fusion.diary.Kind`.
    label
        The person's own word for it.
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


Row = DiaryEntry | tuple[int, float | str]
"""An entry, or the line and the moment of a row that only ends the one before."""


def read_diary(content: bytes) -> tuple[DiaryEntry, ...]:
    """Read a diary.

    Raises
    ------
    UnusableDiary
        With the line, the reason and the cure.
    """
    rows = list(_read_few_rows(content))
    if len(rows) < 2:
        line = rows[0][0] if rows else 1
        raise UnusableDiary(line=line, why="empty", cure="header", value="")
    header, *told = rows
    if _is_activity_log(header[1]):
        told_log = _read_each(told, partial(_read_log_row, header[1], is_alone=len(told) == 1))
        return _drop_ends(told_log)
    columns = _read_header(*header)
    return _drop_ends(_read_each(told, partial(_read_rows, columns)))


def _read_each(
    rows: list[tuple[int, list[str]]], read: Callable[[int, list[str]], Iterable[Row]]
) -> tuple[Row, ...]:
    """Read every row, and refuse with all that cannot be read, each with the text of its line."""
    entries: list[Row] = []
    slips: list[UnusableDiary] = []
    for line, cells in rows:
        try:
            entries.extend(read(line, cells))
        except UnusableDiary as slip:
            text = ", ".join(cell for cell in cells if cell)[:LONGEST_LABEL]
            value = str(slip.facts.get("value", ""))[:LONGEST_LABEL]
            slips.append(UnusableDiary(**{**slip.facts, "value": value, "text": text}))
    refuse_slips(slips)
    return tuple(entries)


def refuse_slips(slips: Sequence[UnusableDiary]) -> None:
    """Refuse a diary for all its slips at once: the facts of the second end in ``_2``, and so on.

    Raises
    ------
    UnusableDiary
        Where there is any slip; beyond twenty, ``more`` counts the others.
    """
    if not slips:
        return
    facts = dict(slips[0].facts)
    for number, slip in enumerate(slips[1:MOST_NAMED], 2):
        facts |= {f"{name}_{number}": value for name, value in slip.facts.items()}
    if len(slips) > MOST_NAMED:
        facts["more"] = len(slips) - MOST_NAMED
    raise UnusableDiary(**facts)


def _read_few_rows(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Give so many rows and no more: each is laid over the whole recording."""
    for count, (line, cells) in enumerate(read_rows(decode_text(content))):
        if count >= MOST_ROWS:
            raise UnusableDiary(line=line, why="too many rows", cure="rows", value=str(MOST_ROWS))
        yield line, cells


def _read_header(line: int, cells: list[str]) -> list[str]:
    names = [COLUMNS.get(plain_word(cell).replace(" ", "_"), "") for cell in cells]
    known = [name for name in names if name]
    if "start" not in known or not {"kind", "event", "label"} & set(known) or len(known) != len(set(known)):
        raise UnusableDiary(line=line, why="header", cure="header", value=", ".join(cells)[:LONGEST_LABEL])
    return names


def _read_rows(columns: list[str], line: int, cells: list[str]) -> Iterable[Row]:
    return (_read_row(line, dict(zip(columns, cells, strict=False))),)


def _is_activity_log(header: list[str]) -> bool:
    """Whether it is GGIR's form, by its header: an ID, then a date."""
    names = [plain_word(cell) for cell in header]
    return len(names) > 2 and names[0] in LOG_IDS and "date" in names[1]


def _read_log_row(header: list[str], line: int, cells: list[str], *, is_alone: bool) -> Iterable[DiaryEntry]:
    """Give the activities of one recording; several recordings are told apart by the ID."""
    days: list[tuple[date, list[tuple[str, str]]]] = []
    for name, cell in zip(header[1:], cells[1:], strict=False):
        if "date" in plain_word(name):
            if cell:
                days.append((_read_date(line, cell), []))
        elif cell and days:
            days[-1][1].append((name, cell))
    file = "" if is_alone else cells[0]
    return tuple(entry for day, told in days for entry in _read_log_day(line, day, told, file))


def _read_log_day(line: int, day: date, told: list[tuple[str, str]], file: str) -> Iterable[DiaryEntry]:
    midnight = datetime.combine(day + timedelta(days=1), time()).isoformat()
    begins = [str(read_moment(line, f"{day.isoformat()} {cell}")) for _, cell in told]
    for (name, _), start, end in zip(told, begins, [*begins[1:], midnight], strict=True):
        yield DiaryEntry(start, end, WORDS.get(plain_word(name), "task"), name, line=line, file=file)


def _read_date(line: int, cell: str) -> date:
    """Read a date with the day first, as GGIR writes it, or as in ISO 8601."""
    found = LOG_DATE.fullmatch(cell)
    try:
        return date(int(found[3]), int(found[2]), int(found[1])) if found else date.fromisoformat(cell)
    except ValueError:
        raise UnusableDiary(line=line, why="time", cure="log date", value=cell[:LONGEST_LABEL]) from None


def _read_row(line: int, row: Mapping[str, str]) -> Row:
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


def _drop_ends(rows: Sequence[Row]) -> tuple[DiaryEntry, ...]:
    """Give each row the end that a row of its own states."""
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


# What the day consisted of: shift, tasks, breaks, not worn; placed on the recording, without overlap.
#
# A diary may give clock times or seconds. What its rows mean for the time account (CONTRACT.md §5 "Time"):
# breaks, time not worn and time outside the shift leave the denominator; everything else is analysed, under
# its own name. Arm supported and seated are analysed unless the row says otherwise (NFA 2018: a sensor
# cannot tell a supported arm from an unsupported one; EXPOSURE.md A10).


REASONS: dict[str, str] = {"break": "break", "outside": "outside", "not_worn": "not-worn"}
"""Kinds that leave the denominator, and the reason their time is excluded for."""

NAMED = ("task", "seated", "supported")
"""Kinds whose time is counted under a name of its own."""

OVERLAP_US = MICROSECONDS
"""Up to a second two rows of one kind may overlap, as they do when times are rounded; the later row wins."""


@dataclass(frozen=True, slots=True)
class Period:
    """A stretch of the day; integer microseconds from the first sample, inside the recording."""

    start_us: int
    end_us: int
    kind: Kind
    label: str = ""
    reason: str = ""
    """Why its time is excluded; empty where it is analysed."""
    line: int = 0


@dataclass(frozen=True, slots=True)
class Placed:
    """The periods of one recording in the order of the diary, and the caveats of placing them."""

    periods: tuple[Period, ...] = ()
    flags: tuple[QualityFlag, ...] = ()


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch that belongs to one period only, or to none (``period`` -1)."""

    start_us: int
    end_us: int
    period: int
    reason: str = ""


def place_diary(entries: Sequence[DiaryEntry], start: datetime | None, duration_us: int) -> Placed:
    """Place the rows of a diary on a recording that begins at ``start`` and lasts ``duration_us``.

    A clock time without a date is put on the day that brings it into the recording, or nearest to it. What
    reaches past the recording is cut; rows wholly outside are left aside with a flag, unless all are.

    Raises
    ------
    UnusableDiary
        With the line and the reason, when a row cannot be placed.
    """
    bounds = _bound_all(entries, start, duration_us)
    whole = [_make_period(entry, *bound) for entry, bound in zip(entries, bounds, strict=True)]
    inside = [period for period in whole if period.start_us < duration_us and period.end_us > 0]
    if whole and not inside:
        raise UnusableDiary(
            line=whole[0].line, why="outside recording", cure="clock", value=_format_times(entries[0])
        )
    _refuse_overlap(inside)
    cut = tuple(
        replace(period, start_us=max(period.start_us, 0), end_us=min(period.end_us, duration_us))
        for period in inside
    )
    outside = len(whole) - len(inside)
    left_aside = (QualityFlag(Caveat.DIARY, outside),) if outside else ()
    return Placed(cut, (*left_aside, *_flag_overlaps(cut)))


def _bound_all(
    entries: Sequence[DiaryEntry], start: datetime | None, duration_us: int
) -> list[tuple[int, int]]:
    """Bound every row, and refuse with all that cannot be placed."""
    bounds: list[tuple[int, int]] = []
    slips: list[UnusableDiary] = []
    for entry, following in _pair_up(entries):
        try:
            bounds.append(_bound(entry, following, start, duration_us))
        except UnusableDiary as slip:
            slips.append(slip)
    refuse_slips(slips)
    return bounds


def _flag_overlaps(periods: Sequence[Period]) -> tuple[QualityFlag, ...]:
    """Flag where time that is left out lies over time that is counted under a name: the former has it."""
    away = sorted((p for p in periods if p.reason), key=lambda p: p.start_us)
    named = sorted((p for p in periods if not p.reason and p.kind in NAMED), key=lambda p: p.start_us)
    shared = [span for kind in KINDS for span in _intersect(away, [p for p in named if p.kind == kind])]
    if not shared:
        return ()
    spans_s = tuple(sorted((a / MICROSECONDS, b / MICROSECONDS) for a, b in shared))
    return (flag_stretches(Caveat.OVERLAP, spans_s),)


def _intersect(away: Sequence[Period], named: Sequence[Period]) -> Iterator[tuple[int, int]]:
    """Give what two lists in order of time share, more than a second at a time."""
    first = 0
    for period in away:
        while first < len(named) and named[first].end_us <= period.start_us:
            first += 1
        for other in named[first:]:
            if other.start_us >= period.end_us:
                break
            start_us, end_us = max(period.start_us, other.start_us), min(period.end_us, other.end_us)
            if end_us - start_us > OVERLAP_US:
                yield start_us, end_us


def _pair_up(entries: Sequence[DiaryEntry]) -> Iterator[tuple[DiaryEntry, DiaryEntry | None]]:
    yield from pairwise([*entries, None])


def _make_period(entry: DiaryEntry, start_us: int, end_us: int) -> Period:
    reason = REASONS.get(entry.kind, "")
    if entry.left_out is not None:
        reason = (reason or entry.kind) if entry.left_out else ""
    return Period(start_us, end_us, entry.kind, entry.label, reason, entry.line)


def _bound(
    entry: DiaryEntry, following: DiaryEntry | None, start: datetime | None, duration_us: int
) -> tuple[int, int]:
    """Give the first microsecond of a row and the first after it, not yet cut to the recording."""
    start_us = _place_moment(entry.start, entry.line, start, duration_us)
    if entry.end is not None:
        end_us = _place_moment(entry.end, entry.line, start, duration_us)
    elif following is not None:
        end_us = _place_moment(following.start, following.line, start, duration_us)
    else:
        end_us = max(duration_us, start_us + 1)
    if end_us <= start_us:
        late, why = (entry, "end first") if entry.end is not None else (following or entry, "order")
        raise UnusableDiary(line=late.line, why=why, cure="order", value=_format_times(late))
    return start_us, end_us


def _format_times(entry: DiaryEntry) -> str:
    return f"{entry.start}" if entry.end is None else f"{entry.start} - {entry.end}"


def _place_moment(moment: float | str, line: int, start: datetime | None, duration_us: int) -> int:
    """Give a moment in microseconds from the first sample."""
    if not isinstance(moment, str):
        return round(moment * MICROSECONDS)
    if start is None:
        raise UnusableDiary(line=line, why="no clock", cure="seconds", value=moment)
    if "T" in moment:
        return _measure_from(start, _set_zone(datetime.fromisoformat(moment), start, line))
    hour = time.fromisoformat(moment)
    days = range(-1, duration_us // (86400 * MICROSECONDS) + 3)
    places = [_measure_from(start, _on_day(start, hour, day)) for day in days]
    nearest = sorted(places, key=lambda place_us: max(-place_us, place_us - duration_us, 0))
    if 0 <= nearest[0] < duration_us and 0 <= nearest[1] < duration_us:
        raise UnusableDiary(line=line, why="which day", cure="date", value=moment)
    return nearest[0]


def _on_day(start: datetime, hour: time, day: int) -> datetime:
    on: date = start.date() + timedelta(days=day)
    return datetime.combine(on, hour, tzinfo=start.tzinfo)


def _set_zone(moment: datetime, start: datetime, line: int) -> datetime:
    """Read a time without an offset as the recording's clock; one with an offset needs such a clock."""
    if moment.tzinfo is None:
        return moment.replace(tzinfo=start.tzinfo)
    if start.tzinfo is None:
        raise UnusableDiary(line=line, why="zone", cure="zone", value=moment.isoformat())
    return moment


def _measure_from(start: datetime, moment: datetime) -> int:
    """Give the true time from ``start``; where the clock has a zone, across its change of clocks."""
    if start.tzinfo is not None:
        start, moment = start.astimezone(UTC), moment.astimezone(UTC)
    return (moment - start) // timedelta(microseconds=1)


def _refuse_overlap(periods: Sequence[Period]) -> None:
    """Two rows of one kind cannot both own a moment."""
    slips = []
    for kind in KINDS:
        same = sorted((period for period in periods if period.kind == kind), key=lambda p: p.start_us)
        slips += [
            UnusableDiary(
                line=after.line, why="overlap", cure="overlap", other=before.line, value=after.label
            )
            for before, after in pairwise(same)
            if before.end_us - after.start_us > OVERLAP_US
        ]
    refuse_slips(slips)


def divide_day(periods: Sequence[Period], duration_us: int) -> tuple[Piece, ...]:
    """Cut the recording into pieces that follow one another, each with at most one owner.

    Where periods overlap, the kind that comes later in :data:`KINDS` owns the moment. With a shift in the
    diary, what no shift covers is outside, unless another row names it.
    """
    edges = sorted({0, duration_us, *(edge for p in periods for edge in (p.start_us, p.end_us))})
    ranked = sorted(range(len(periods)), key=lambda k: KINDS.index(periods[k].kind))
    has_shift = any(period.kind == "shift" for period in periods)
    pieces: list[Piece] = []
    for start_us, end_us in pairwise(edges):
        owners = [k for k in ranked if periods[k].start_us <= start_us < periods[k].end_us]
        piece = _own(start_us, end_us, owners, periods, has_shift=has_shift)
        if pieces and (pieces[-1].period, pieces[-1].reason) == (piece.period, piece.reason):
            piece = replace(piece, start_us=pieces.pop().start_us)
        pieces.append(piece)
    return tuple(pieces)


def _own(
    start_us: int, end_us: int, owners: list[int], periods: Sequence[Period], *, has_shift: bool
) -> Piece:
    if owners:
        return Piece(start_us, end_us, owners[-1], periods[owners[-1]].reason)
    return Piece(start_us, end_us, -1, REASONS["outside"] if has_shift else "")


def find_left_out(pieces: Sequence[Piece]) -> tuple[Span, ...]:
    """Give the stretches that the diary takes out of the analysed time."""
    return tuple(
        Span(piece.start_us, piece.end_us - piece.start_us, piece.reason) for piece in pieces if piece.reason
    )
