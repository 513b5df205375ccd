"""Recordings that are in a run twice: the same bytes, or a .gt3x beside ActiLife's export of it."""

import re
import zipfile
import zlib
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

from acromion.app.batch.folder import Task
from acromion.app.errors import UnusableParticipants
from acromion.app.store.folder import hash_file
from acromion.fusion.errors import Fact, join_facts

_HEAD_BYTES, _INFO_BYTES = 2048, 1 << 16
_CREATED_BY = re.compile(rb"[^\w-]*-{5,}\s*Data (Table )?File Created By ActiGraph", re.IGNORECASE)


def mark_doubles(tasks: Sequence[Task]) -> list[Task]:
    """Return the tasks; each double names the recording that is analysed instead of it.

    That is the one with a row in the list of participants, then the .gt3x, then the first. Only files of one
    size are compared byte by byte. Most files are therefore not read.

    Raises UnusableParticipants if the rows of two equal recordings state different people or arms.
    """
    if any(task.request.joined for task in tasks):
        return list(tasks)
    chosen: dict[Path, Task] = {}
    for same in (*_find_exports(tasks), *_find_same_bytes(tasks)):
        alike = sorted((chosen.get(one.log, one) for one in same), key=lambda one: not one.line)
        chosen |= {one.log: alike[0] for one in same}
    _check_rows([(task, chosen[task.log]) for task in tasks if task.log in chosen])
    first = [chosen.get(task.log, task) for task in tasks]
    return [
        task if one.log == task.log else replace(task, double_of=one.name)
        for task, one in zip(tasks, first, strict=True)
    ]


def _check_rows(pairs: Sequence[tuple[Task, Task]]) -> None:
    refused: list[dict[str, Fact]] = [
        {
            "line": one.line,
            "why": "double people",
            "first": first.name,
            "second": one.name,
            "other": first.line,
        }
        for one, first in pairs
        if one.line and (one.request.subject, one.request.side) != (first.request.subject, first.request.side)
    ]
    if refused:
        raise UnusableParticipants(**join_facts(sorted(refused, key=lambda facts: int(str(facts["line"])))))


def _find_same_bytes(tasks: Sequence[Task]) -> Iterator[list[Task]]:
    sizes: dict[int, list[Task]] = {}
    for task in tasks:
        with suppress(OSError):  # an unreadable recording is reported when it is analysed
            sizes.setdefault(task.log.stat().st_size, []).append(task)
    for size_bytes, alike in sizes.items():
        if size_bytes and len(alike) > 1:
            yield from _group(alike, lambda task: hash_file(task.log))


def _find_exports(tasks: Sequence[Task]) -> Iterator[list[Task]]:
    """Find ActiLife's exports in the folder of their .gt3x, by the serial number and start in both."""
    places: dict[Path, list[Task]] = {}
    for task in tasks:
        if task.log.suffix.lower() in {".gt3x", ".csv"}:
            places.setdefault(task.log.parent, []).append(task)
    for beside in places.values():
        beside.sort(key=lambda task: task.log.suffix.lower() != ".gt3x")
        if len({task.log.suffix.lower() for task in beside}) == 2:
            for same in _group(beside, lambda task: _identify(task.log)):
                if same[0].log.suffix.lower() == ".gt3x":
                    yield [same[0], *(one for one in same if one.log.suffix.lower() == ".csv")]


def _group(tasks: Sequence[Task], identify: Callable[[Task], Hashable]) -> list[list[Task]]:
    """Return the groups of two or more tasks with one identity; None identifies none."""
    found: dict[Hashable, list[Task]] = {}
    for task in tasks:
        with suppress(OSError):
            found.setdefault(identify(task), []).append(task)
    return [same for identity, same in found.items() if identity is not None and len(same) > 1]


def _identify(log: Path) -> tuple[str, datetime] | None:
    """Return serial number and start of a .gt3x or an ActiLife export; None for other or damaged files."""
    from acromion.fusion.readers.gt3x import parse_device_text  # noqa: PLC0415  slow import
    from acromion.fusion.readers.tables.actilife import parse_header, parse_start  # noqa: PLC0415

    if log.suffix.lower() == ".csv":
        with log.open("rb") as file:
            head = file.read(_HEAD_BYTES)
        if not _CREATED_BY.match(head):
            return None
        header = parse_header(head.decode("utf-8", "replace"))
        serial, start = header.get("Serial Number", ""), parse_start(header)
    else:
        try:
            with zipfile.ZipFile(log) as archive, archive.open("info.txt") as file:
                text = parse_device_text(file.read(_INFO_BYTES))
        except (zipfile.BadZipFile, KeyError, NotImplementedError, RuntimeError, zlib.error):
            return None
        unix_s, serial = text.unix_s("Start Date"), text.values.get("Serial Number", "")
        start = None if unix_s is None else datetime(1970, 1, 1) + timedelta(seconds=unix_s)  # noqa: DTZ001
    return (serial, start) if serial and start else None
