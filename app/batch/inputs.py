"""The list of participants of a study: whose arm is in which file, and what was done at its calibration.

A CSV with the column ``file`` and any of ``subject``, ``side``, ``pose``, ``calibration`` (seconds, as
``5-15``; two windows as ``5-15 20-30``) and ``diary`` (a CSV beside the list). What a row says goes before
the settings of the run; what it leaves empty does not.
"""

import json
import math
import os
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args

import yaml

from app.batch.plan import Task
from app.errors import UnusableParticipants, UnusableSettings
from app.request import (
    SUBJECT_ALLOWED,
    WINDOW_ALLOWED,
    Language,
    Paper,
    ReportKind,
    ReportRequest,
    check_subject,
)
from fusion.conventions import MethodName, Pose, Side
from fusion.diary import KINDS, DiaryEntry, decode_text, plain_word, read_diary, read_moment, read_rows
from fusion.errors import UnusableDiary

# The settings of a study as ``settings.yaml``: what a run used, and what ``--config`` takes back.
#
# The names are those of the command's options. Which file, whose arm and how many at once are not settings
# of a study: they stand in the participants' table and on the command line.


Read = Callable[[Any], Any]


class _PlainLoader(yaml.SafeLoader):
    """Takes ``10:30`` for text, as its reader does, and not for 630 (YAML 1.1 counts in sixties)."""


_PlainLoader.yaml_implicit_resolvers = {
    first: [
        (tag, pattern)
        for tag, pattern in resolvers
        if tag.rpartition(":")[2] not in {"int", "float", "timestamp"}
    ]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_PlainLoader.add_implicit_resolver("tag:yaml.org,2002:int", re.compile(r"[-+]?\d+$"), list("-+0123456789"))
_PlainLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\d+\.\d*|\.\d+)([eE][-+]?\d+)?$|[-+]?\d+[eE][-+]?\d+$"),
    list("-+.0123456789"),
)


@dataclass(frozen=True, slots=True)
class Setting:
    """A name in the file: the field of the request it fills, how its value is read, what is allowed."""

    name: str
    field: str
    read: Read
    allowed: str


def _choose(values: Iterable[str], *, may_be_empty: bool = False) -> tuple[Read, str]:
    allowed = tuple(values)

    def read(value: Any) -> Any:
        if (value is None and may_be_empty) or value in allowed:
            return value
        raise ValueError

    return read, "|".join(allowed)


def _read_window_list(value: Any) -> tuple[tuple[float, float], ...]:
    windows = tuple((float(start_s), float(end_s)) for start_s, end_s in value or ())
    if any(not 0 <= start_s < end_s < math.inf for start_s, end_s in windows):
        raise ValueError
    return windows


def _read_rate(value: Any) -> float | None:
    if value is None:
        return None
    if not 1 <= float(value) <= 10_000:
        raise ValueError
    return float(value)


def _read_kinds(value: Any) -> tuple[ReportKind, ...]:
    known = get_args(ReportKind)
    kinds = tuple(kind for kind in known if kind in value)
    if not kinds or set(value) - set(known):
        raise ValueError
    return kinds


def _read_diary(value: Any) -> tuple[DiaryEntry, ...]:
    return tuple(_read_entry(**row) for row in value or ())


def _read_entry(*, start: Any, end: Any = None, kind: Any, **others: Any) -> DiaryEntry:
    if kind not in KINDS:
        raise ValueError
    try:
        start, end = (None if moment is None else read_moment(0, str(moment)) for moment in (start, end))
    except UnusableDiary:
        raise ValueError from None
    return DiaryEntry(start, end, kind, **others)


def _read_profile(value: Any) -> str:
    return json.dumps(dict(value), sort_keys=True) if value else ""


SETTINGS: tuple[Setting, ...] = (
    Setting("method", "method", *_choose(get_args(MethodName))),
    Setting("pose", "pose", *_choose(get_args(Pose))),
    Setting("side", "side", *_choose(get_args(Side), may_be_empty=True)),
    Setting("calibration", "calibration_windows_s", _read_window_list, f"[[{WINDOW_ALLOWED}]]"),
    Setting("rate_hz", "rate_hz", _read_rate, "1 to 10000"),
    Setting("lang", "languages", lambda value: (_choose(get_args(Language))[0](value),), "en|fr"),
    Setting("report", "kinds", _read_kinds, "[html, pdf]"),
    Setting("paper", "paper", *_choose(get_args(Paper))),
    Setting("diary", "diary", _read_diary, "[{start, end, kind, label}]"),
    Setting("profile", "profile", _read_profile, "{acceleration, angular_rate, ...}"),
)
_BY_NAME = {setting.name: setting for setting in SETTINGS}


def encode_settings(request: ReportRequest) -> bytes:
    """Write the settings of a request as YAML, every one of them, in a fixed order."""
    values = {
        "method": request.method,
        "pose": request.pose,
        "side": request.side,
        "calibration": [list(window) for window in request.calibration_windows_s],
        "rate_hz": request.rate_hz,
        "lang": request.languages[0],
        "report": list(request.kinds),
        "paper": request.paper,
        "diary": [_describe_entry(entry) for entry in request.diary],
        "profile": json.loads(request.profile) if request.profile else None,
    }
    text: str = yaml.safe_dump(values, sort_keys=False, allow_unicode=True)
    return text.encode("utf-8")


def _describe_entry(entry: DiaryEntry) -> dict[str, Any]:
    """Give what was said in a row of the diary; its line in the file it came from is no setting."""
    return {
        name: value for name, value in asdict(entry).items() if value not in {None, ""} and name != "line"
    }


def read_settings(content: bytes) -> dict[str, Any]:
    """Read a settings file: fields of :class:`ReportRequest` and their values, only those it names.

    Raises
    ------
    UnusableSettings
        With the line or the name, what is allowed and, for a name that is not known, the nearest that is.
    """
    return {_find(name).field: _take(name, value) for name, value in _parse(content).items()}


def apply_settings(request: ReportRequest, values: Mapping[str, Any]) -> ReportRequest:
    """Give the request with these fields in place of its own."""
    return replace(request, **values)


def _parse(content: bytes) -> dict[str, Any]:
    try:
        values = yaml.load(content, _PlainLoader)  # noqa: S506  a SafeLoader
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        raise UnusableSettings(line=mark.line + 1 if mark else 1, why="yaml") from None
    if values is None:
        return {}
    if not isinstance(values, dict):
        raise UnusableSettings(line=1, why="yaml")
    return {str(name): value for name, value in values.items()}


def _find(name: str) -> Setting:
    if name not in _BY_NAME:
        nearest = get_close_matches(name, _BY_NAME, 1)
        raise UnusableSettings(
            name=name[:60], why="setting name", nearest="".join(nearest), allowed=", ".join(_BY_NAME)
        )
    return _BY_NAME[name]


def _take(name: str, value: Any) -> Any:
    setting = _find(name)
    try:
        return setting.read(value)
    except (TypeError, ValueError):
        shown = str(value)[:60]
        raise UnusableSettings(name=name, why="setting value", value=shown, allowed=setting.allowed) from None


COLUMNS: Mapping[str, str] = {
    "file": "file", "file name": "file", "recording": "file", "fichier": "file", "enregistrement": "file",
    "subject": "subject", "participant": "subject", "id": "subject", "sujet": "subject",
    "side": "side", "arm": "side", "cote": "side", "bras": "side",
    "pose": "pose",
    "calibration": "calibration", "calibration s": "calibration", "etalonnage": "calibration",
    "diary": "diary", "journal": "diary",
}  # fmt: skip
SIDES: Mapping[str, Side] = {
    "left": "left", "l": "left", "gauche": "left", "g": "left",
    "right": "right", "r": "right", "droit": "right", "droite": "right", "d": "right",
}  # fmt: skip
_WINDOW = re.compile(r"(\d+(?:\.\d+)?)\s*-\s*(\d+(?:\.\d+)?)")


@dataclass(frozen=True, slots=True)
class Participant:
    """One row: the file (a name, or a path's last parts), and the fields of the request it fills."""

    file: str
    line: int
    said: Mapping[str, Any] = field(default_factory=dict)


def read_participants(content: bytes, folder: Path) -> tuple[Participant, ...]:
    """Read the list; diaries it names are read from ``folder``.

    Raises
    ------
    UnusableParticipants
        With the line, the reason and what is allowed; also where a diary named in it is not there.
    fusion.errors.UnusableDiary, OSError
        When a diary named in it (the fact ``diary``) cannot be used, or opened.
    """
    rows = read_rows(decode_text(content))
    names = _name_columns(*next(rows, (1, [])))
    people = tuple(
        _read_row(line, dict(zip(names, cells, strict=False)), _readers(folder)) for line, cells in rows
    )
    _check_each_once(people)
    return people


def assign_participants(
    tasks: Sequence[Task], people: Iterable[Participant]
) -> tuple[list[Task], list[Participant]]:
    """Give the tasks with what the list says of each, and the rows that fit no recording."""
    rows = list(people)
    assigned: list[Task] = []
    used: set[int] = set()
    for task in tasks:
        fitting = [row for row in rows if _fits(task.log, row.file)]
        used.update(row.line for row in fitting)
        said = max(fitting, key=lambda row: len(row.file)).said if fitting else {}
        assigned.append(replace(task, request=replace(task.request, **said)))
    return assigned, [row for row in rows if row.line not in used]


def _fits(log: Path, file: str) -> bool:
    """Compare the last parts of the path, where the recording was named: a link is not followed."""
    wanted = _list_parts(file)
    return _list_parts(os.path.normpath(log.absolute()))[-len(wanted) :] == wanted


def _list_parts(path: str) -> list[str]:
    """Give the parts of a path without regard to case, and to how accents are written (macOS, Windows)."""
    whole = unicodedata.normalize("NFC", path).casefold()
    return [part for part in re.split(r"[/\\]", whole) if part not in {"", "."}]


def _name_columns(line: int, cells: list[str]) -> list[str]:
    names = [COLUMNS.get(plain_word(cell), "") for cell in cells]
    unknown = [cell for cell, name in zip(cells, names, strict=True) if not name]
    if unknown or "file" not in names or len(set(names)) != len(names):
        raise UnusableParticipants(
            line=line,
            why="participant columns",
            value=", ".join(unknown or cells)[:60],
            allowed=", ".join(dict.fromkeys(COLUMNS.values())),
        )
    return names


def _read_row(line: int, row: Mapping[str, str], readers: Mapping[str, "Reader"]) -> Participant:
    if not row["file"]:
        raise UnusableParticipants(line=line, why="no file named", value="", allowed="")
    told = {reader: text for name, reader in readers.items() if (text := row.get(name, ""))}
    return Participant(row["file"], line, {r.field: _read_cell(line, text, r) for r, text in told.items()})


def _read_cell(line: int, text: str, reader: "Reader") -> Any:
    try:
        return reader.read(text)
    except ValueError:
        raise UnusableParticipants(line=line, why="value", value=text[:60], allowed=reader.allowed) from None
    except FileNotFoundError:
        raise UnusableParticipants(line=line, why="no such file", value=text[:60], allowed="") from None


@dataclass(frozen=True, slots=True)
class Reader:
    """How a cell is read: the field of the request it fills, the function, what is allowed."""

    field: str
    read: Callable[[str], Any]
    allowed: str


def _readers(folder: Path) -> Mapping[str, Reader]:
    return {
        "subject": Reader("subject", check_subject, SUBJECT_ALLOWED),
        "side": Reader("side", _read_side, "|".join(get_args(Side))),
        "pose": Reader("pose", _read_pose, "|".join(get_args(Pose))),
        "calibration": Reader("calibration_windows_s", _read_windows, "5-15 / 5-15 20-30"),
        "diary": Reader("diary", lambda name: _read_diary_beside(folder, name), "FILE.csv"),
    }


def _read_diary_beside(folder: Path, name: str) -> tuple[DiaryEntry, ...]:
    try:
        return read_diary((folder / name).read_bytes())
    except UnusableDiary as slip:
        raise UnusableDiary(**slip.facts, diary=name) from None


def _read_side(text: str) -> Side:
    side = SIDES.get(plain_word(text))
    if side is None:
        raise ValueError
    return side


def _read_pose(text: str) -> str:
    pose = plain_word(text).replace(" ", "-")
    if pose not in get_args(Pose):
        raise ValueError
    return pose


def _read_windows(text: str) -> tuple[tuple[float, float], ...]:
    windows = tuple((float(start), float(end)) for start, end in _WINDOW.findall(text.replace(",", ".")))
    rest = _WINDOW.sub("", text.replace(",", ".")).strip(" ;")
    if rest or any(start_s >= end_s for start_s, end_s in windows):
        raise ValueError
    return windows


def _check_each_once(people: Iterable[Participant]) -> None:
    seen: set[tuple[str, ...]] = set()
    for person in people:
        parts = tuple(_list_parts(person.file))
        if parts in seen:
            raise UnusableParticipants(line=person.line, why="file twice", value=person.file[:60], allowed="")
        seen.add(parts)
