"""Store the inputs of a run in ``inputs/`` of its results, and plan the same run again.

``inputs/recordings.json`` has every recording of the last run: its place relative to the results, its size,
and its request with all settings and the rows of its diary. ``inputs/`` also has copies of the list of
participants and the diaries as they were given; they are not read again.
"""

import json
import os
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from acromion.app.batch.folder import INPUTS, MARKER, Task, find_recordings
from acromion.app.errors import CannotRepeat
from acromion.app.request import ReportRequest
from acromion.app.store.folder import hash_file, write_durably
from acromion.fusion.errors import Fact, join_facts

RECORDINGS = "recordings.json"
DAMAGED = (ValueError, KeyError, TypeError, IndexError, AttributeError, RecursionError)
"""The errors that values of a wrong kind in a stored record cause."""
_OF_TASK = ("path", "line", "further", "double_of", "code", "facts")


def save_inputs(
    out: Path, tasks: Sequence[Task], request: ReportRequest, given: Mapping[str, Path], *, is_shared: bool
) -> None:
    """Write the inputs of a run; the shards of one run (``is_shared``) write the same.

    ``given``: the list of participants and the diaries, by their path in the folder.
    """
    folder = out / INPUTS
    copies = {name: path.read_bytes() for name, path in given.items()}
    if not is_shared:
        shutil.rmtree(folder, ignore_errors=True)
    recordings = [_describe(task, out) for task in tasks]
    record = {"request": json.loads(request.to_json()), "recordings": recordings}
    copies[RECORDINGS] = (json.dumps(record, indent=1) + "\n").encode()  # escapes names that are not UTF-8
    for name, content in copies.items():
        path = folder / name
        if not path.exists() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            write_durably(path, content)


def list_inputs(out: Path) -> dict[str, Path]:
    """Return the copies of the list of participants and the diaries, by their path in ``inputs/``."""
    folder = out / INPUTS
    root = folder.resolve()
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.name != RECORDINGS)
    return {  # the target of a link is not an input
        path.relative_to(folder).as_posix(): path
        for path in files
        if path.resolve() == root / path.relative_to(folder)
    }


def read_further(folders: Sequence[Path]) -> list[dict[str, str]]:
    """Return the further cells of the list of participants for each folder of a finished analysis.

    They are in the inputs of the run around the folder; a folder outside of a run has none.
    """
    kept: dict[Path, dict[Path, dict[str, str]]] = {}
    found = []
    for folder in folders:
        out = next((one for one in folder.absolute().parents if (one / INPUTS / RECORDINGS).exists()), None)
        if out is not None and out not in kept:
            recordings = json.loads((out / INPUTS / RECORDINGS).read_bytes())["recordings"]
            kept[out] = {out / one["folder"]: one["further"] for one in recordings if not one["double_of"]}
        found.append(kept[out].get(folder.absolute(), {}) if out else {})
    return found


def _describe(task: Task, out: Path) -> dict[str, Any]:
    logs = [task.log, *map(Path, task.request.joined)]
    return {
        "path": task.name,
        "folder": task.place,
        "files": [{"place": _relate(log, out), "size_bytes": _measure(log)} for log in logs],
        "request": json.loads(replace(task.request, joined=()).to_json()),
        "line": task.line,
        "further": dict(task.further),
        "double_of": task.double_of,
        "code": task.code,
        "facts": dict(task.facts),
    }


def _relate(log: Path, out: Path) -> str:
    """Return a path relative to the results; the whole path on another drive."""
    try:
        return os.path.relpath(log.absolute(), out.absolute())
    except ValueError:
        return str(log.absolute())


def _measure(log: Path) -> int | None:
    return log.stat().st_size if log.exists() else None


def plan_again(
    kept: Path, out: Path, paths: Sequence[Path], *, force: bool
) -> tuple[list[Task], ReportRequest]:
    """Return the tasks and the settings of the run whose results are in ``kept``, with ``out`` for results.

    Recordings are looked for in their earlier places, or among ``paths``, and checked by size and SHA-256.

    Raises CannotRepeat with every recording that is not there or has changed, or if ``kept`` has no inputs or
    they are damaged.
    """
    try:
        content = (kept / INPUTS / RECORDINGS).read_bytes()
    except OSError:
        raise CannotRepeat(why="no inputs", name=kept.name) from None
    try:
        record = json.loads(content)
        request = ReportRequest.from_json(json.dumps(record["request"]))
        return _plan(kept, out, paths, record["recordings"], force=force), request
    except DAMAGED:
        raise CannotRepeat(why="no inputs", name=kept.name) from None


def _plan(
    kept: Path, out: Path, paths: Sequence[Path], recordings: Sequence[Mapping[str, Any]], *, force: bool
) -> list[Task]:
    """Return the tasks of the record of a run. Raises CannotRepeat; one of DAMAGED if it is damaged."""
    found = find_recordings(paths, out).logs if paths else None
    missed: list[tuple[str, Path, str]] = []
    used: set[Path] = set()
    tasks = []
    for one in recordings:
        _check_below(one["folder"])
        digests = _read_digests(kept / one["folder"])
        logs = []
        for rank, file in enumerate(one["files"]):
            digest = digests[rank] if rank < len(digests) else ""
            free = None if found is None else [path for path in found if path not in used]
            log, why = _find(kept, file, digest, free)
            if not why:
                used.add(log)
            elif not one["double_of"]:
                missed.append((one["path"], log, why))
            logs.append(log)
        own = ReportRequest.from_json(json.dumps(one["request"]))
        own = replace(own, joined=tuple(str(log.resolve()) for log in logs[1:]))
        known = {name: one[name] for name in _OF_TASK if name in one}
        tasks.append(Task(logs[0], own, out / one["folder"], force, out=out, **known))
    if missed:  # a file of the same name that is no other recording of the run is the changed one
        left = {path.name for path in found or () if path not in used}
        refused: list[dict[str, Fact]] = [
            {"why": "changed" if why == "moved" and log.name in left else why, "name": path}
            for path, log, why in missed
        ]
        raise CannotRepeat(**join_facts(refused))
    return tasks


def _check_below(place: str) -> None:
    """Raise ValueError if a relative path leaves its folder, on any system."""
    parts = place.replace("\\", "/").split("/")
    if any(part in ("", ".", "..") or ":" in part for part in parts):
        raise ValueError(place)


def _read_digests(folder: Path) -> list[str]:
    """Return the SHA-256 of the files of a finished analysis; nothing if it has none."""
    try:
        return list(json.loads((folder / MARKER).read_bytes())["input"].split())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return []


def _find(kept: Path, file: Mapping[str, Any], digest: str, found: Sequence[Path] | None) -> tuple[Path, str]:
    """Return where a file is, and why it cannot be used: "moved", "changed" or "rivals"; "" if it can.

    ``found``: the files to search, by bytes, or by name and size if the recording was not analysed; of
    several, that in the same folders. None: it is in its earlier place.
    """
    place, size_bytes = Path(os.path.normpath(kept.absolute() / file["place"])), file["size_bytes"]
    is_same: Callable[[Path], bool] = lambda path: (  # noqa: E731
        _measure(path) == size_bytes and (not digest or hash_file(path) == digest)
    )
    if found is None:
        there = place.exists() or size_bytes is None
        return place, "" if there and is_same(place) else "changed" if there else "moved"
    wanted = found if digest else [path for path in found if path.name == place.name]
    near = sorted(wanted, key=lambda path: -_count_shared_parts(path, place))
    same = filter(is_same, near)  # lazy: the files after it are not hashed
    best, second = next(same, None), None if digest else next(same, None)
    if best is None:
        return place, "moved"
    is_tie = second and _count_shared_parts(second, place) == _count_shared_parts(best, place)
    return (place, "rivals") if is_tie else (best, "")


def _count_shared_parts(one: Path, other: Path) -> int:
    """Return how many of the last parts of two paths are alike."""
    pairs = zip(reversed(one.parts), reversed(other.parts), strict=False)
    return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
