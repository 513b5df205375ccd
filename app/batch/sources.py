"""Where the recordings of a run are named: one by one, by a folder, by a pattern, in a list."""

import glob
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.batch.placing import MARKER
from app.batch.plan import show_path
from app.errors import UnusableList
from app.formats import ENDINGS

_UNUSUAL = frozenset("*?[")


@dataclass(frozen=True, slots=True)
class Found:
    """The recordings, each once, in a stable order, and how many other files lay in the folders named.

    ``base`` is the folder that was named; of several the one that holds them all.
    """

    logs: tuple[Path, ...]
    others: int = 0
    base: Path = Path()

    def tell_path(self, log: Path) -> str:
        """Say where a recording lies, from the folder that was named; with no part of the way to that."""
        way = _lay_out(log)
        below = way.relative_to(self.base) if way.is_relative_to(self.base) else way
        return Path(show_path(below)).as_posix()


def find_recordings(paths: Iterable[Path], out: Path, without: Collection[Path] = ()) -> Found:
    """List the recordings named, and those in and below the folders named.

    What lies in the folder for the results is no recording, nor are the files ``without``: diaries, lists.
    """
    logs: dict[Path, None] = {}
    others = 0
    bases: list[Path] = []
    for path in _expand(paths):
        bases.append(_lay_out(path) if path.is_dir() else _lay_out(path).parent)
        inside = _list_folder(path, out, {p.resolve() for p in without}) if path.is_dir() else [path]
        found = [p for p in inside if p is path or p.name.lower().endswith(ENDINGS)]
        logs.update(dict.fromkeys(found))
        others += len(inside) - len(found)
    return Found(tuple(logs), others, _find_base(bases))


def _lay_out(path: Path) -> Path:
    """Give the whole path without following links: a recording is where it was named."""
    return Path(os.path.normpath(path.absolute()))


def _find_base(folders: Sequence[Path]) -> Path:
    """Give the folder that holds all; the root of nothing where they lie on several drives."""
    try:
        return Path(os.path.commonpath(folders))
    except ValueError:
        return Path()


def _list_folder(folder: Path, out: Path, without: Collection[Path]) -> list[Path]:
    """List the files, but for results: those of this run, and of any other (it holds ``run.json``)."""
    files = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    results = (out, *(path.parent for path in files if path.name in {"run.json", MARKER}))
    return [
        path
        for path in files
        if path.resolve() not in without and not any(_lies_in(path, place) for place in results)
    ]


def read_list(content: str, folder: Path) -> list[Path]:
    """Read a list of paths, one a line; a relative one starts from ``folder``.

    Blank lines and lines that begin with # are left out.

    Raises
    ------
    UnusableList
        When a line names nothing that is there.
    """
    paths = []
    for number, line in enumerate(content.splitlines(), 1):
        name = line.strip().strip('"')
        if name and not name.startswith("#"):
            paths.append(folder / name)
            if not paths[-1].exists():
                raise UnusableList(line=number, why="no such file", value=name[:200])
    return paths


def _expand(paths: Iterable[Path]) -> Iterator[Path]:
    """Expand patterns ourselves where the shell did not (Windows, or within quotes)."""
    for path in paths:
        if _UNUSUAL & set(str(path)) and not path.exists():
            names = sorted(glob.glob(str(path), recursive=True))  # noqa: PTH207  a path may be absolute
            yield from map(Path, names or [str(path)])
        else:
            yield path


def _lies_in(path: Path, folder: Path) -> bool:
    return folder.resolve() in path.resolve().parents
