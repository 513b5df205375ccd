"""The list of participants of a study: subject, arm and calibration of each file.

A CSV with the column ``file`` and any of ``subject``, ``side`` (also ``trunk``), ``pose``, ``calibration``
(seconds, as ``5-15``; two windows as ``5-15 20-30``), ``pose_held`` (``start`` or ``no``), ``axis`` (``y``),
``slip_at`` and ``no_slip_at`` (seconds), ``time_zone`` (``Europe/Paris``), ``clock_offset`` (``-1h02m``,
added to the clock), ``job`` (its title), ``isco`` (its code of ISCO-08), ``diary`` (a CSV or .xlsx next to
the list) and ``posture`` (a file of postures next to it). Further columns (age, group, session) change
nothing and are carried into the tables of the run. A value in a row overrides the run's settings; an empty
cell does not. A row that matches two recordings, or a recording that matches two rows, is refused before
anything is analysed.
"""

import os
import re
import unicodedata
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, get_args

from acromion.app.batch.folder import Task
from acromion.app.errors import UnusableParticipants
from acromion.app.report.export.tables import BIDS_COLUMNS, REDCAP_COLUMNS, name_variables
from acromion.app.report.figures import TABLES
from acromion.app.request import (
    ISCO_HINT,
    SIDES,
    SLIP_HINT,
    SUBJECT_HINT,
    ReportRequest,
    check_isco,
    check_job_title,
    check_subject,
    find_window_hint,
    parse_slip_time,
)
from acromion.fusion.clocks import OFFSET_HINT, ZONE_HINT, parse_clock_offset, parse_time_zone
from acromion.fusion.conventions import AXIS_HINT, Pose, Side, parse_arm_axis
from acromion.fusion.diary import (
    DiaryEntry,
    OpenQuoteError,
    decode_text,
    is_diary,
    parse_pose_held,
    plain_word,
    read_rows,
    refuse_slips,
)
from acromion.fusion.errors import Fact, UnusableDiary, UnusablePostures, join_facts, split_facts

COLUMNS: Mapping[str, str] = {
    "file": "file", "file name": "file", "recording": "file", "fichier": "file", "enregistrement": "file",
    "subject": "subject", "participant": "subject", "id": "subject", "sujet": "subject",
    "side": "side", "arm": "side", "cote": "side", "bras": "side",
    "pose": "pose",
    "calibration": "calibration", "calibration s": "calibration", "etalonnage": "calibration",
    "pose held": "pose_held", "pose tenue": "pose_held",
    "axis": "axis", "axe": "axis",
    "slip at": "slip_at", "slip at s": "slip_at", "slip": "slip_at", "glissement": "slip_at",
    "no slip at": "no_slip_at", "no slip at s": "no_slip_at", "no slip": "no_slip_at",
    "sans glissement": "no_slip_at",
    "job": "job", "job title": "job", "occupation": "job", "metier": "job", "profession": "job",
    "isco": "isco", "isco code": "isco", "isco 08": "isco", "code isco": "isco", "citp": "isco",
    "diary": "diary", "journal": "diary",
    "posture": "posture",
    "time zone": "time_zone", "fuseau": "time_zone", "fuseau horaire": "time_zone",
    "clock offset": "clock_offset", "correction horloge": "clock_offset",
}  # fmt: skip
TRUNK: Mapping[str, Side] = dict.fromkeys(("trunk", "tronc", "torso", "back", "dos"), "trunk")
POSES: Mapping[str, Pose] = {pose: pose for pose in get_args(Pose)}
_WINDOW = re.compile(r"(?<!\d)(\d+(?:\.\d+)?)\s*-\s*(\d+(?:\.\d+)?)")


_Parts = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Participant:
    """One row: the file (a name, or the last parts of a path), and the request fields it sets."""

    file: str
    line: int
    stated: Mapping[str, Any] = field(default_factory=dict)
    further: Mapping[str, str] = field(default_factory=dict)

    def apply(self, request: ReportRequest) -> ReportRequest:
        """Return a request with what the row states; its postures are added to the diary."""
        stated = dict(self.stated)
        postures = stated.pop("posture", ())
        stated_request = replace(request, **stated)
        return replace(stated_request, diary=stated_request.diary + postures)


def assign_participants(
    tasks: Sequence[Task], content: bytes, folder: Path | None
) -> tuple[list[Task], list[Participant]]:
    """Return the tasks with their settings from the list, and the rows that match no recording.

    Raises UnusableParticipants with all errors of the list at once. Raises
    acromion.fusion.errors.UnusableDiary or OSError if a diary named in the list (the fact ``diary``) cannot
    be used or opened.
    """
    people, refusals = read_participants(content, folder)
    places = [_split_path(os.path.normpath(task.log.absolute())) for task in tasks]
    named: dict[_Parts, list[_Parts]] = {}
    for place in dict.fromkeys(places):
        named.setdefault(_fold(place[-1:]), []).append(place)
    owners: dict[_Parts, Participant] = {}
    for row in people:
        fitting = _find_fitting(named, row.file)
        if len(fitting) > 1:
            first, second = (_format_unique_end(fitting, place) for place in fitting[:2])
            refusals.append(_refuse(row, "several recordings", first=first, second=second, cure="path"))
            continue
        owner = owners.setdefault(fitting[0] if fitting else _split_path(row.file), row)
        if owner is not row:
            refusals.append(_refuse(row, "file twice", other=owner.line))
    assigned = [
        replace(
            task,
            request=owners[place].apply(task.request),
            line=owners[place].line,
            further=owners[place].further,
        )
        if place in owners
        else task
        for task, place in zip(tasks, places, strict=True)
    ]
    for place, asked in zip(places, (task.request for task in assigned), strict=True):
        hint = find_window_hint(asked.pose, len(asked.calibration_windows_s), asked.arm_axis)
        if hint and place in owners:
            refusals.append(_refuse(owners[place], "window count", allowed=hint))
    own = [refusal.facts for refusal in refusals if isinstance(refusal, UnusableParticipants)]
    if own:
        raise UnusableParticipants(**join_facts(sorted(own, key=lambda facts: int(facts["line"]))))
    if refusals:  # errors of diaries are reported once the list itself is valid
        kinds = {type(one) for one in refusals}
        kind = kinds.pop() if len(kinds) == 1 else UnusableDiary
        raise kind(**join_facts([facts for one in refusals for facts in split_facts(one.facts)]))
    known = set(places)
    return assigned, [row for place, row in owners.items() if place not in known]


def _refuse(row: Participant, why: str, **facts: Fact) -> UnusableParticipants:
    return UnusableParticipants(line=row.line, why=why, value=row.file[-60:], **facts)


def _find_fitting(named: Mapping[_Parts, Sequence[_Parts]], file: str) -> list[_Parts]:
    """Return the recordings whose path ends with the parts of a row, ignoring case.

    If there are several, exact case has precedence, then a match of the whole path.
    """
    wanted = _split_path(file)
    near = named.get(_fold(wanted[-1:]), ())
    ends = [place for place in near if _fold(place[-len(wanted) :]) == _fold(wanted)]
    exact = [place for place in ends if place[-len(wanted) :] == wanted]
    whole = [place for place in exact or ends if len(place) == len(wanted)]
    return whole or exact or ends


def _format_unique_end(places: Sequence[_Parts], place: _Parts) -> str:
    """Return the shortest end of a path that is unique among the paths."""
    lengths = range(1, len(place))
    alone = (n for n in lengths if sum(other[-n:] == place[-n:] for other in places) == 1)
    return "/".join(place[-next(alone, len(place)) :])


def _split_path(path: str) -> _Parts:
    """Split a path into parts, in Unicode NFC (macOS and Windows differ)."""
    whole = unicodedata.normalize("NFC", path)
    return tuple(part for part in re.split(r"[/\\]", whole) if part not in {"", "."})


def _fold(parts: _Parts) -> _Parts:
    return tuple(part.casefold() for part in parts)


def read_participants(
    content: bytes, folder: Path | None
) -> tuple[list[Participant], list[UnusableParticipants | UnusableDiary]]:
    """Return the rows of the list, and the errors in it.

    Diaries are read from ``folder``; without one they are refused.

    Raises UnusableParticipants if the header cannot be used. Raises OSError if a diary cannot be opened.
    """
    rows = _read_list(content)
    line, header = next(rows, (1, []))
    names, further = _map_columns(line, header, may_be_further=folder is not None)
    readers = _readers(folder)
    people: list[Participant] = []
    refusals: list[UnusableParticipants | UnusableDiary] = [*_refuse_taken(line, further)]
    for line, cells in rows:
        row, stated = dict(zip(names, cells, strict=False)), dict[str, Any]()
        if any(cells[len(names) :]):
            refusals.append(UnusableParticipants(line=line, why="more fields", value=cells[len(names)][:60]))
        for name, reader in readers.items():
            try:
                if text := row.get(name, ""):
                    stated[reader.field] = reader.read(text)
            except UnusableDiary as refusal:
                refusals.append(refusal)
            except (ValueError, FileNotFoundError) as error:
                is_absent = isinstance(error, FileNotFoundError)
                why, allowed = ("no such file", "") if is_absent else ("value", reader.allowed)
                refusals.append(UnusableParticipants(line=line, why=why, value=text[:60], allowed=allowed))
        if file := row.get("file", ""):
            people.append(Participant(file, line, stated, {name: row.get(name, "") for name in further}))
        else:
            refusals.append(UnusableParticipants(line=line, why="no file named"))
    return people, refusals


def list_diaries(content: bytes, folder: Path) -> list[Path]:
    """Return the diaries and files of postures that the list names. Raises UnusableParticipants."""
    rows = _read_list(content)
    names, _ = _map_columns(*next(rows, (1, [])), may_be_further=True)
    cells_by_name = [dict(zip(names, cells, strict=False)) for _, cells in rows]
    named = (cells.get(name, "") for name in ("diary", "posture") for cells in cells_by_name)
    return [folder / name for name in dict.fromkeys(named) if name]


def _read_list(content: bytes) -> Iterator[tuple[int, list[str]]]:
    """Return the rows of the list. Raises UnusableParticipants if a quotation mark is not closed."""
    try:
        return iter(list(read_rows(decode_text(content))))
    except OpenQuoteError as error:
        raise UnusableParticipants(**error.facts) from None


def _map_columns(line: int, cells: list[str], *, may_be_further: bool) -> tuple[list[str], list[str]]:
    """Return the name of every column, and the names of the columns to carry into the tables.

    Raises UnusableParticipants if a column is missing, named twice, or not known where it must be.
    """
    known = [COLUMNS.get(plain_word(cell), "") for cell in cells]
    further = [cell for cell, name in zip(cells, known, strict=True) if not name]
    names = [name or cell for cell, name in zip(cells, known, strict=True)]
    unknown = [cell for cell in further if not (may_be_further and cell)]
    alike = [cell for cell, name in zip(cells, names, strict=True) if names.count(name) > 1]
    if alike and not unknown and all(alike):
        raise UnusableParticipants(line=line, why="same column", value=", ".join(alike)[:60])
    if unknown or "file" not in names or len(set(names)) != len(names):
        raise UnusableParticipants(
            line=line,
            why="participant columns" if may_be_further or not unknown else "known columns",
            value=", ".join(unknown or cells)[:60],
            allowed=", ".join(dict.fromkeys(COLUMNS.values())),
        )
    return names, further


def _refuse_taken(line: int, further: Sequence[str]) -> Iterator[UnusableParticipants]:
    """Yield the refusals of further columns that are named as one of an exported table, or like one another.

    The names as variables of REDCap and BIDS also count
    (:func:`acromion.app.report.export.tables.name_variables`).
    """
    variables = name_variables(further)
    taken = {column.name for columns in (*TABLES.values(), REDCAP_COLUMNS) for column in columns}
    own = {cell for name, cell in variables.items() if {name, cell.casefold()} & {*taken, *BIDS_COLUMNS}}
    lost = set(further) - set(variables.values())
    for why, collisions in (("taken column", own), ("alike columns", lost)):
        if named := [cell for cell in further if cell in collisions]:
            yield UnusableParticipants(line=line, why=why, value=", ".join(named)[:60])


@dataclass(frozen=True, slots=True)
class Reader:
    """How to parse a cell: the request field it sets, the function, and a hint of allowed values."""

    field: str
    read: Callable[[str], Any]
    allowed: str


def _readers(folder: Path | None) -> Mapping[str, Reader]:
    return {
        "subject": Reader("subject", check_subject, SUBJECT_HINT),
        "side": Reader(
            "side",
            lambda text: _find_word({**SIDES, **TRUNK}, plain_word(text)),
            "|".join(get_args(Side)),
        ),
        "pose": Reader(
            "pose",
            lambda text: _find_word(POSES, plain_word(text).replace(" ", "-")),
            "|".join(get_args(Pose)),
        ),
        "calibration": Reader("calibration_windows_s", _read_windows, "5-15 / 5-15 20-30"),
        "pose_held": Reader("pose_held", parse_pose_held, "start|no"),
        "axis": Reader("arm_axis", parse_arm_axis, AXIS_HINT),
        "slip_at": Reader("slip_times_s", _read_slip_times, f"{SLIP_HINT} {SLIP_HINT}"),
        "no_slip_at": Reader("no_slip_times_s", _read_slip_times, f"{SLIP_HINT} {SLIP_HINT}"),
        "time_zone": Reader("time_zone", parse_time_zone, ZONE_HINT),
        "clock_offset": Reader("clock_offset_s", parse_clock_offset, OFFSET_HINT),
        "job": Reader("job_title", check_job_title, SUBJECT_HINT),
        "isco": Reader("isco_code", check_isco, ISCO_HINT),
        "diary": Reader("diary", partial(_read_beside, folder, _read_diary_file), "FILE.csv, FILE.xlsx"),
        "posture": Reader("posture", partial(_read_beside, folder, read_postures), "FILE"),
    }


def _find_word(words: Mapping[str, str], text: str) -> str:
    """Return the meaning of a word. Raises ValueError."""
    if text not in words:
        raise ValueError
    return words[text]


def _read_beside(
    folder: Path | None, read: Callable[[Path], tuple[DiaryEntry, ...]], name: str
) -> tuple[DiaryEntry, ...]:
    if folder is None:  # the list was uploaded without a folder
        raise ValueError
    try:
        return read(folder / name)
    except UnusableDiary as slip:
        rows = [facts | {"diary": name} for facts in split_facts(slip.facts)]
        raise type(slip)(**join_facts(rows)) from None


def _read_diary_file(path: Path) -> tuple[DiaryEntry, ...]:
    return read_checked_diary(path.read_bytes())


def read_postures(path: Path) -> tuple[DiaryEntry, ...]:
    """Return the rows of the kind "posture": of a table of activities, or of a recording of the thigh.

    Raises UnusablePostures if they cannot be found, or with every line that cannot be used or is of another
    kind. Raises FusionError if a recording cannot be read.
    """
    with path.open("rb") as file:
        if path.suffix.lower() != ".gt3x" and is_diary(file):
            try:
                entries = read_checked_diary(path.read_bytes())
            except UnusableDiary as error:
                raise UnusablePostures(**error.facts) from None
        else:
            from acromion.fusion.readers.thigh import find_postures  # noqa: PLC0415  slow import

            entries = find_postures(file, path.name)
    refuse_slips(
        [
            UnusablePostures(line=entry.line, why="no posture", cure="activity", value=entry.kind)
            for entry in entries
            if entry.kind != "posture"
        ]
    )
    return entries


def read_checked_diary(content: bytes) -> tuple[DiaryEntry, ...]:
    """Call :func:`acromion.fusion.exposure.periods.read_checked_diary`, which loads slowly, when needed."""
    from acromion.fusion.exposure import periods  # noqa: PLC0415  slow import

    return periods.read_checked_diary(content)


def _read_windows(text: str) -> tuple[tuple[float, float], ...]:
    windows = tuple((float(start), float(end)) for start, end in _WINDOW.findall(text.replace(",", ".")))
    rest = _WINDOW.sub("", text.replace(",", ".")).strip(" ;")
    if rest or any(start_s >= end_s for start_s, end_s in windows):
        raise ValueError
    return windows


def _read_slip_times(text: str) -> tuple[float, ...]:
    return tuple(parse_slip_time(part) for part in text.replace(",", ".").replace(";", " ").split())
