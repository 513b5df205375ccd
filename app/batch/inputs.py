"""The list of participants of a study: whose arm is in which file, and what was done at its calibration.

A CSV with the column ``file`` and any of ``subject``, ``side``, ``pose``, ``calibration`` (seconds, as
``5-15``; two windows as ``5-15 20-30``), ``pose_held`` (``start`` or ``no``), ``axis`` (``y``), ``slip_at`` and
``no_slip_at`` (seconds) and ``diary`` (a CSV beside the list). A row goes before the settings of the run; what
it leaves empty does not.
"""

import os
import re
import unicodedata
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, get_args

from app.batch.plan import Task
from app.errors import UnusableParticipants
from app.request import SLIP_HINT, SUBJECT_HINT, check_subject, parse_slip_time
from fusion.conventions import AXIS_HINT, Pose, PoseHeld, Side, parse_arm_axis
from fusion.diary import DiaryEntry, decode_text, plain_word, read_diary, read_rows
from fusion.errors import UnusableDiary

COLUMNS: Mapping[str, str] = {
    "file": "file", "file name": "file", "recording": "file", "fichier": "file", "enregistrement": "file",
    "subject": "subject", "participant": "subject", "id": "subject", "sujet": "subject",
    "side": "side", "arm": "side", "cote": "side", "bras": "side",
    "pose": "pose",
    "calibration": "calibration", "calibration s": "calibration", "etalonnage": "calibration",
    "pose held": "pose_held", "pose tenue": "pose_held",
    "axis": "axis", "axe": "axis", "slip at": "slip_at", "slip": "slip_at", "glissement": "slip_at",
    "no slip at": "no_slip_at", "no slip": "no_slip_at", "sans glissement": "no_slip_at",
    "diary": "diary", "journal": "diary",
}  # fmt: skip
SIDES: Mapping[str, Side] = {
    "left": "left", "l": "left", "gauche": "left", "g": "left",
    "right": "right", "r": "right", "droit": "right", "droite": "right", "d": "right",
}  # fmt: skip
HELD: Mapping[str, PoseHeld | None] = {
    "start": "start", "debut": "start", "no": None, "non": None,
}  # fmt: skip
_WINDOW = re.compile(r"(\d+(?:\.\d+)?)\s*-\s*(\d+(?:\.\d+)?)")


@dataclass(frozen=True, slots=True)
class Participant:
    """One row: the file (a name, or a path's last parts), and the fields of the request it fills."""

    file: str
    line: int
    stated: Mapping[str, Any] = field(default_factory=dict)


def read_participants(content: bytes, folder: Path | None) -> tuple[Participant, ...]:
    """Read the list; diaries it names are read from ``folder``, and refused without one.

    Raises
    ------
    UnusableParticipants
        With the line, the reason and what is allowed; also where a diary named in it is not there.
    fusion.errors.UnusableDiary, OSError
        When a diary named in it (the fact ``diary``) cannot be used, or opened.
    """
    rows = read_rows(decode_text(content))
    names = _map_columns(*next(rows, (1, [])))
    people = tuple(
        _read_row(line, dict(zip(names, cells, strict=False)), _readers(folder)) for line, cells in rows
    )
    _check_each_once(people)
    return people


def assign_participants(
    tasks: Sequence[Task], people: Iterable[Participant]
) -> tuple[list[Task], list[Participant]]:
    """Give the tasks with their settings from the list, and the rows that fit no recording."""
    rows = list(people)
    assigned: list[Task] = []
    used: set[int] = set()
    for task in tasks:
        fitting = [row for row in rows if _fits(task.log, row.file)]
        used.update(row.line for row in fitting)
        stated = max(fitting, key=lambda row: len(row.file)).stated if fitting else {}
        assigned.append(replace(task, request=replace(task.request, **stated)))
    return assigned, [row for row in rows if row.line not in used]


def _fits(log: Path, file: str) -> bool:
    """Compare the last parts of the path, where the recording was named: a link is not followed."""
    wanted = _split_path(file)
    return _split_path(os.path.normpath(log.absolute()))[-len(wanted) :] == wanted


def _split_path(path: str) -> list[str]:
    """Give the parts of a path without regard to case, and to how accents are written (macOS, Windows)."""
    whole = unicodedata.normalize("NFC", path).casefold()
    return [part for part in re.split(r"[/\\]", whole) if part not in {"", "."}]


def _map_columns(line: int, cells: list[str]) -> list[str]:
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
    texts = {reader: text for name, reader in readers.items() if (text := row.get(name, ""))}
    return Participant(row["file"], line, {r.field: _read_cell(line, text, r) for r, text in texts.items()})


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


def _readers(folder: Path | None) -> Mapping[str, Reader]:
    return {
        "subject": Reader("subject", check_subject, SUBJECT_HINT),
        "side": Reader("side", _read_side, "|".join(get_args(Side))),
        "pose": Reader("pose", _read_pose, "|".join(get_args(Pose))),
        "calibration": Reader("calibration_windows_s", _read_windows, "5-15 / 5-15 20-30"),
        "pose_held": Reader("pose_held", _read_held, "start|no"),
        "axis": Reader("arm_axis", parse_arm_axis, AXIS_HINT),
        "slip_at": Reader("slip_times_s", _read_slip_times, f"{SLIP_HINT} {SLIP_HINT}"),
        "no_slip_at": Reader("no_slip_times_s", _read_slip_times, f"{SLIP_HINT} {SLIP_HINT}"),
        "diary": Reader("diary", lambda name: _read_diary_beside(folder, name), "FILE.csv"),
    }


def _read_diary_beside(folder: Path | None, name: str) -> tuple[DiaryEntry, ...]:
    if folder is None:  # the list came by itself
        raise ValueError
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


def _read_held(text: str) -> PoseHeld | None:
    word = plain_word(text)
    if word not in HELD:
        raise ValueError
    return HELD[word]


def _read_windows(text: str) -> tuple[tuple[float, float], ...]:
    windows = tuple((float(start), float(end)) for start, end in _WINDOW.findall(text.replace(",", ".")))
    rest = _WINDOW.sub("", text.replace(",", ".")).strip(" ;")
    if rest or any(start_s >= end_s for start_s, end_s in windows):
        raise ValueError
    return windows


def _read_slip_times(text: str) -> tuple[float, ...]:
    return tuple(parse_slip_time(part) for part in text.replace(",", ".").replace(";", " ").split())


def _check_each_once(people: Iterable[Participant]) -> None:
    seen: set[tuple[str, ...]] = set()
    for person in people:
        parts = tuple(_split_path(person.file))
        if parts in seen:
            raise UnusableParticipants(line=person.line, why="file twice", value=person.file[:60], allowed="")
        seen.add(parts)
