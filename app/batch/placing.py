"""Which folder holds the results of which recording: each keeps its own from run to run.

A folder is named after the file's stem; recordings of one stem are numbered. Which of them is whose is told
by the marker in the folder, not by the order in which they are found: a recording that joins the study later
must not take the folder of another, whose report would then stand as an earlier version of its own.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from itertools import count, takewhile
from pathlib import Path

from app.report.subject import clean_text
from app.storage import hash_file

MARKER = "done.json"
"""Written last into a recording's folder: the folder is ours, and complete."""

TABLES = (
    "summary.csv",
    "summary_fr.csv",
    "summary.xlsx",
    "periods.csv",
    "problems.csv",
    "dictionary.csv",
    "run.json",
    "settings.yaml",
    "methods.md",
    "index.html",
)
"""What stands beside the recordings' folders."""

_RESERVED = re.compile(r'[<>:"/\\|?*\x00-\x1f]|[. ]+$')

Known = Callable[[Path], Mapping[str, str]]


def place_folders(logs: Sequence[Path], out: Path) -> list[Path]:
    """Give each recording its folder: the one it was given before, or one that is nobody else's."""
    known, digest = cache(_read_marker), cache(hash_file)
    placed: dict[int, Path] = {}
    taken = {name.casefold() for name in TABLES}
    by_bytes = partial(_find_bytes, known, digest)
    for find in (partial(_find_place, known), by_bytes, partial(_find_free, known)):
        for k, log in enumerate(logs):
            free = (path for path in _list_names(log, out) if path.name.casefold() not in taken)
            folder = None if k in placed else find(log, free)
            if folder is not None:
                placed[k] = folder
                taken.add(folder.name.casefold())
    return [placed[k] for k in range(len(logs))]


def identify_place(log: Path) -> str:
    """Tell one place on the disk from another without saying which it is."""
    return hashlib.sha256(os.fsencode(os.path.normpath(log.absolute()))).hexdigest()[:16]


def name_folder(log: Path) -> str:
    """Give the file's stem, as a name that can only be a folder directly below the results."""
    stem = log.name.removesuffix(".gz").rpartition(".")[0] or log.name
    safe = _RESERVED.sub("_", clean_text(stem)).lstrip(". ")
    return safe[:120] or "recording"


def _list_names(log: Path, out: Path) -> Iterator[Path]:
    stem = name_folder(log)
    yield out / stem
    yield from (out / f"{stem}-{number}" for number in count(2))


def _find_place(known: Known, log: Path, folders: Iterable[Path]) -> Path | None:
    """Find the folder that was made of a recording in this very place."""
    place = identify_place(log)
    return next((path for path in takewhile(Path.exists, folders) if known(path).get("place") == place), None)


def _find_bytes(
    known: Known, digest: Callable[[Path], str], log: Path, folders: Iterable[Path]
) -> Path | None:
    """Find the folder that was made of these bytes while they lay elsewhere."""
    for path in takewhile(Path.exists, folders):
        first = known(path).get("input", "").split()[:1]
        with suppress(OSError):  # a log that cannot be read is told when its turn comes
            if known(path).get("place") and first == [digest(log)]:
                return path
    return None


def _find_free(known: Known, _log: Path, folders: Iterable[Path]) -> Path | None:
    """Find a folder that does not say whose it is: there is none yet, or it is of a release that did not."""
    return next(path for path in folders if not known(path).get("place"))


def _read_marker(folder: Path) -> Mapping[str, str]:
    """Read whose the folder is; nothing where it is nobody's, or of a release that did not say."""
    try:
        values = json.loads((folder / MARKER).read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return values if isinstance(values, dict) else {}
