"""Periods of the day (shift, tasks, breaks, not worn), placed on the recording without overlap.

A diary may contain clock times or seconds. Breaks, time not worn and time outside the shift are excluded from
the denominator; everything else is analysed under its own name. Supported and seated time is analysed unless
the row says otherwise (Palm et al. 2018: a sensor cannot distinguish a supported arm from an unsupported
one).
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime, time, timedelta
from itertools import pairwise

from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import find_instants, measure_us
from acromion.fusion.diary import (
    KINDS,
    NAMED,
    POSTURES,
    WORDS,
    DiaryEntry,
    Kind,
    parse_clock,
    plain_word,
    read_diary,
    refuse_slips,
)
from acromion.fusion.errors import MOST_ROWS_NAMED, UnusableDiary, UnusablePostures, split_facts
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Span, flag_stretches

REASONS: dict[str, str] = {"break": "break", "outside": "outside", "not_worn": "not-worn"}
"""Kinds that are excluded from the denominator, and the reason for each."""

OVERLAP_US = MICROSECONDS
"""Two rows of one kind may overlap by up to a second, because times are rounded; the later row wins."""


@dataclass(frozen=True, slots=True)
class Period:
    """A stretch of the day; integer microseconds from the first sample, within the recording."""

    start_us: int
    end_us: int
    kind: Kind
    label: str = ""
    reason: str = ""
    """Why its time is excluded; empty if it is analysed."""
    line: int = 0

    @property
    def is_posture_only(self) -> bool:
        """Whether it states a posture and no task: seated or upright time with a label is also a task."""
        is_named = self.label and WORDS.get(plain_word(self.label)) != self.kind
        return self.kind == "posture" or (self.kind in POSTURES and not (is_named or self.reason))


@dataclass(frozen=True, slots=True)
class Mark:
    """A moment of the day, such as the time of a pain; it divides and excludes nothing."""

    time_us: int
    label: str = ""


@dataclass(frozen=True, slots=True)
class Placed:
    """The periods and marks of one recording in the order of the diary, and the caveats of placing them.

    ``shift_us``: length of the shift by its stated start and end, also beyond the recording; None if unknown.
    """

    periods: tuple[Period, ...] = ()
    flags: tuple[QualityFlag, ...] = ()
    shift_us: int | None = None
    marks: tuple[Mark, ...] = ()
    measured: tuple[Period, ...] = ()
    """Rows that state a posture and no task; they divide only the figures by posture."""

    @property
    def postures(self) -> tuple[Period, ...]:
        """Every stretch with a posture as its kind; of two that overlap, the later in the list applies."""
        stated = (period for period in (*self.periods, *self.measured) if period.kind in POSTURES)
        named = (replace(p, kind=kind) for p in self.measured for kind in POSTURES if kind == p.label)
        return *sorted(stated, key=lambda period: POSTURES.index(period.kind)), *named


@dataclass(frozen=True, slots=True)
class Piece:
    """A stretch that belongs to one period only, or to none (``period`` -1)."""

    start_us: int
    end_us: int
    period: int
    reason: str = ""


def place_diary(entries: Sequence[DiaryEntry], start: datetime | None, duration_us: int) -> Placed:
    """Place the rows of a diary on a recording that starts at ``start`` and lasts ``duration_us``.

    A clock time without a date gets the day that puts it within the recording, or nearest to it. A time that
    the zone has twice or never that day is refused, unless the row states its offset. Rows are cut at the
    ends of the recording. Rows wholly outside are ignored with a flag, unless all rows are.

    Raises UnusableDiary: with the line and the reason of every row that cannot be placed or overlaps another.
    """
    whole: list[tuple[DiaryEntry, Period]] = []
    shifts_us: list[int] = []
    row_errors: list[UnusableDiary] = []
    for entry, following in pair_with_next(entries):
        reason = REASONS.get(entry.kind, "")
        if entry.left_out is not None:
            reason = (reason or entry.kind) if entry.left_out else ""
        try:
            bounds_us = _bound(entry, following, start, duration_us)
        except UnusableDiary as error:
            row_errors.append(UnusablePostures(**error.facts) if entry.kind == "posture" else error)
        else:
            whole.append((entry, Period(*bounds_us, entry.kind, entry.label, reason, entry.line)))
            is_here = bounds_us[0] < duration_us and bounds_us[1] > 0
            if entry.kind == "shift" and entry.end is not None and is_here:
                shifts_us.append(bounds_us[1] - bounds_us[0])
    marks: list[tuple[DiaryEntry, Mark]] = []
    for entry in (entry for entry in entries if entry.kind == "mark"):
        try:
            place_us = place_moment(entry.start, entry.line, start, duration_us)
        except UnusableDiary as error:
            row_errors.append(error)
        else:
            marks.append((entry, Mark(place_us, entry.label)))
    inside = [period for _, period in whole if period.start_us < duration_us and period.end_us > 0]
    outside = [entry for entry, period in whole if period.start_us >= duration_us or period.end_us <= 0]
    outside += (entry for entry, mark in marks if not 0 <= mark.time_us <= duration_us)
    shown = tuple(mark for _, mark in marks if 0 <= mark.time_us <= duration_us)
    has_posture = any(period.kind == "posture" for period in inside)
    if has_posture:  # a sensor on the thigh is often worn for longer
        outside = [entry for entry in outside if entry.kind != "posture"]
    unused = [entry for entry in outside if not _is_of_other_day(entry, start, duration_us)]
    is_elsewhere = not has_posture and any(entry.kind == "posture" for entry in unused)
    if unused and ((not inside and not shown) or is_elsewhere):
        named = [entry for entry in unused if entry.kind == "posture" or not is_elsewhere]
        row_errors += (
            (UnusablePostures if entry.kind == "posture" else UnusableDiary)(
                line=entry.line, why="outside recording", cure="clock", value=_format_times(entry)
            )
            for entry in (named[:1] if is_elsewhere else named)  # the file is wrong as a whole
        )
    refuse_slips([*row_errors, *_find_overlaps(inside)])
    every = tuple(
        replace(period, start_us=max(period.start_us, 0), end_us=min(period.end_us, duration_us))
        for period in inside
    )
    measured = tuple(period for period in every if period.is_posture_only)
    cut = tuple(period for period in every if not period.is_posture_only)
    ignored = unused if inside or shown else outside
    lines = ", ".join(str(entry.line) for entry in ignored[:MOST_ROWS_NAMED] if entry.line)
    facts = {"lines": lines} if lines else {}
    left_aside = (QualityFlag(Caveat.DIARY, len(ignored), facts=facts),) if ignored else ()
    return Placed(cut, (*left_aside, *_flag_overlaps(cut)), sum(shifts_us) or None, shown, measured)


def _is_of_other_day(entry: DiaryEntry, start: datetime | None, duration_us: int) -> bool:
    """Return whether a row of a diary of many recordings is for another day of the same person."""
    if start is None or not entry.file or not isinstance(entry.start, str) or "T" not in entry.start:
        return False
    last = start + timedelta(microseconds=duration_us)
    return not start.date() <= datetime.fromisoformat(entry.start).date() <= last.date()


LOCAL_MOMENT = re.compile(r"\d{4}-\d{2}-\d{2}T[0-9:.]+")
"""A date and a clock time, without an offset from UTC."""
CLOCK_TIME = re.compile(r"\d{2}:\d{2}:\d{2}(?:\.\d+)?")
LONGEST_US = 366 * 86_400 * MICROSECONDS


def read_checked_diary(content: bytes) -> tuple[DiaryEntry, ...]:
    """Parse a diary, and compare its rows with one another as far as no recording is needed.

    Raises UnusableDiary with every line that cannot be used.
    """
    return read_diary(content, find_contradictions)


def find_contradictions(entries: Sequence[DiaryEntry]) -> list[UnusableDiary]:
    """Compare the rows with one another before a recording is read.

    Return an error for each row that overlaps another of its kind. A row in seconds or with dates is also
    refused if it ends before it starts; a clock time without a date may be on the next day.
    """
    row_errors: list[UnusableDiary] = []
    for file in dict.fromkeys(entry.file for entry in entries):
        own = [entry for entry in entries if entry.file == file and entry.end is not None]
        numbered = [e for e in own if not isinstance(e.start, str) and not isinstance(e.end, str)]
        dated = [e for e in own if all(LOCAL_MOMENT.fullmatch(str(moment)) for moment in (e.start, e.end))]
        first = min((datetime.fromisoformat(str(e.start)) for e in dated), default=None)
        for rows, start in ((numbered, None), (dated, first)):
            try:
                place_diary(rows, start, LONGEST_US)
            except UnusableDiary as error:
                row_errors += (UnusableDiary(**facts) for facts in split_facts(error.facts))
        row_errors += _find_overlaps(_place_on_one_day(own))
    return row_errors


def _place_on_one_day(entries: Sequence[DiaryEntry]) -> list[Period]:
    """Place the rows with bare clock times on one day; a row over midnight is placed twice."""
    day_us, periods = 86_400 * MICROSECONDS, list[Period]()
    for entry in entries:
        clocks = (str(entry.start), str(entry.end))
        if all(CLOCK_TIME.fullmatch(clock) for clock in clocks):
            start_us, end_us = map(_measure_clock_us, clocks)
            is_over_midnight = end_us < start_us
            for moved_us in (0, -day_us) if is_over_midnight else (0,):
                bounds_us = start_us + moved_us, end_us + moved_us + day_us * is_over_midnight
                periods.append(Period(*bounds_us, entry.kind, entry.label, "", entry.line))
    return periods


def _measure_clock_us(clock: str) -> int:
    """Return a clock time in microseconds since midnight."""
    shown = time.fromisoformat(clock)
    return ((shown.hour * 60 + shown.minute) * 60 + shown.second) * MICROSECONDS + shown.microsecond


def find_diary_poses(
    diary: Sequence[DiaryEntry], start: datetime | None, duration_us: int
) -> tuple[tuple[float, float], ...]:
    """Return when the pose was held according to the diary, seconds from the first sample.

    Raises UnusableDiary: a pose is outside the recording.
    """
    poses = (entry for entry in close_rows(diary) if entry.kind == "pose")
    placed = (place_diary([pose], start, duration_us).periods[0] for pose in poses)
    return tuple((held.start_us / MICROSECONDS, held.end_us / MICROSECONDS) for held in placed)


def drop_poses(diary: Sequence[DiaryEntry]) -> tuple[DiaryEntry, ...]:
    """Return the rows that divide the day."""
    return tuple(entry for entry in diary if entry.kind != "pose")


def _flag_overlaps(periods: Sequence[Period]) -> tuple[QualityFlag, ...]:
    """Return the flag of excluded time that overlaps time with a name: the exclusion applies."""
    away = sorted((p for p in periods if p.reason), key=lambda p: p.start_us)
    named = sorted((p for p in periods if not p.reason and p.kind in NAMED), key=lambda p: p.start_us)
    shared = [span for kind in KINDS for span in _intersect(away, [p for p in named if p.kind == kind])]
    if not shared:
        return ()
    spans_s = tuple(sorted((a / MICROSECONDS, b / MICROSECONDS) for a, b in shared))
    return (flag_stretches(Caveat.OVERLAP, spans_s),)


def _intersect(away: Sequence[Period], named: Sequence[Period]) -> Iterator[tuple[int, int]]:
    """Yield the common stretches of two lists in time order, if longer than a second."""
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


def pair_with_next(entries: Sequence[DiaryEntry]) -> Iterator[tuple[DiaryEntry, DiaryEntry | None]]:
    """Yield each row with the next one, at which it ends if it states no end; marks end nothing.

    Rows of the kind "posture" follow one another only.
    """
    for is_posture in (False, True):
        own = [e for e in entries if e.kind != "mark" and (e.kind == "posture") is is_posture]
        yield from zip(own, [*own[1:], None], strict=False)


def close_rows(entries: Sequence[DiaryEntry]) -> Iterator[DiaryEntry]:
    """Yield each row but the marks; one without an end ends where the next begins."""
    for entry, following in pair_with_next(entries):
        yield replace(entry, end=following.start) if entry.end is None and following else entry


def _bound(
    entry: DiaryEntry, following: DiaryEntry | None, start: datetime | None, duration_us: int
) -> tuple[int, int]:
    """Return the start of a row and the first microsecond after it, not yet cut to the recording."""
    start_us = place_moment(entry.start, entry.line, start, duration_us)
    if entry.end is not None:
        end_us = place_moment(entry.end, entry.line, start, duration_us)
    elif following is not None:
        end_us = place_moment(following.start, following.line, start, duration_us)
    else:
        end_us = max(duration_us, start_us + 1)
    if end_us <= start_us:
        late, why = (entry, "end first") if entry.end is not None else (following or entry, "order")
        raise UnusableDiary(line=late.line, why=why, cure="order", value=_format_times(late))
    return start_us, end_us


def _format_times(entry: DiaryEntry) -> str:
    return f"{entry.start}" if entry.end is None else f"{entry.start} - {entry.end}"


def place_moment(moment: float | str, line: int, start: datetime | None, duration_us: int) -> int:
    """Return a time in microseconds from the first sample: a number is seconds, text is a clock time.

    Raises UnusableDiary.
    """
    if not isinstance(moment, str):
        return round(moment * MICROSECONDS)
    if start is None:
        raise UnusableDiary(line=line, why="no clock", cure="seconds", value=moment)
    moment = parse_clock(moment, line)
    # without an offset it is in the recording's clock; with one, that clock needs an offset
    if "T" in moment:
        dated = datetime.fromisoformat(moment)
        if dated.tzinfo is not None and start.tzinfo is None:
            raise UnusableDiary(line=line, why="zone", cure="zone", value=dated.isoformat())
        return _measure_from(start, dated, line)
    hour = time.fromisoformat(moment)
    days = range(-1, duration_us // (86400 * MICROSECONDS) + 3)
    dates = [datetime.combine(start.date() + timedelta(days=day), hour) for day in days]

    def measure_outside_us(on: datetime) -> int:
        places = _list_places(start, on) or [measure_us(start.replace(tzinfo=None), on)]
        return min(max(-place_us, place_us - duration_us, 0) for place_us in places)

    first, second = sorted(dates, key=measure_outside_us)[:2]
    place_us = _measure_from(start, first, line)
    if 0 <= place_us < duration_us and any(0 <= one < duration_us for one in _list_places(start, second)):
        raise UnusableDiary(line=line, why="which day", cure="date", value=moment)
    return place_us


def _measure_from(start: datetime, moment: datetime, line: int) -> int:
    """Return the true time since ``start``, across clock changes if the clock has a zone.

    Raises UnusableDiary: the zone has this time twice or never that day.
    """
    places = _list_places(start, moment)
    if len(places) != 1:
        why, cure = ("twice", "offset") if places else ("never", "never")
        raise UnusableDiary(line=line, why=why, cure=cure, value=f"{moment:%Y-%m-%d %H:%M:%S}")
    return places[0]


def _list_places(start: datetime, moment: datetime) -> list[int]:
    """Return when a clock shows a time, in microseconds since ``start``: in a zone also twice or never."""
    instants: Sequence[datetime] = (moment,)
    if start.tzinfo is not None and moment.tzinfo is None:
        instants = find_instants(moment, start.tzinfo)
    return [measure_us(start, one) for one in instants]


def _find_overlaps(periods: Sequence[Period]) -> list[UnusableDiary]:
    """Return an error for each two rows of one kind that overlap, or two with a posture as their kind."""
    row_errors: list[UnusableDiary] = []
    for kinds in (*((kind,) for kind in KINDS if kind not in POSTURES), POSTURES):
        same = sorted((period for period in periods if period.kind in kinds), key=lambda p: p.start_us)
        row_errors += [
            UnusableDiary(
                line=after.line, why="overlap", cure="overlap", other=before.line, value=after.label
            )
            for before, after in pairwise(same)
            if before.end_us - after.start_us > OVERLAP_US
        ]
    return row_errors


def divide_day(periods: Sequence[Period], duration_us: int) -> tuple[Piece, ...]:
    """Split the recording into consecutive pieces, each with at most one owner.

    If periods overlap, the kind later in :data:`KINDS` owns the time. If the diary has a shift, time outside
    every shift is "outside", unless another row covers it.
    """
    edges = sorted({0, duration_us, *(edge for p in periods for edge in (p.start_us, p.end_us))})
    ranked = sorted(range(len(periods)), key=lambda k: KINDS.index(periods[k].kind))
    has_shift = any(period.kind == "shift" for period in periods)
    pieces: list[Piece] = []
    for start_us, end_us in pairwise(edges):
        owners = [k for k in ranked if periods[k].start_us <= start_us < periods[k].end_us]
        piece = Piece(start_us, end_us, -1, REASONS["outside"] if has_shift else "")
        if owners:
            piece = replace(piece, period=owners[-1], reason=periods[owners[-1]].reason)
        if pieces and (pieces[-1].period, pieces[-1].reason) == (piece.period, piece.reason):
            piece = replace(piece, start_us=pieces.pop().start_us)
        pieces.append(piece)
    return tuple(pieces)


def find_left_out(pieces: Sequence[Piece]) -> tuple[Span, ...]:
    """Return the stretches that the diary excludes from the analysed time."""
    return tuple(
        Span(piece.start_us, piece.end_us - piece.start_us, piece.reason) for piece in pieces if piece.reason
    )
