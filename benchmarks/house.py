"""Count the house: files, lines, folders, what one recording passes.

    python -m benchmarks.house

The figures are mirrors, not gates. Static ones are read from the source of ``app`` and ``fusion``; what one
recording passes is traced in this process (``analyse(read_recording(...))``, a simulated LSM9DS1 table).
"""

import ast
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

from fusion import analyse, read_recording
from fusion.simulation import simulate_shift, write_shift

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("app", "fusion")
CAVEAT = re.compile(r"W-[A-Z][A-Z-]+")


def main() -> None:
    """Print the table."""
    sources = {path: path.read_text() for package in PACKAGES for path in (ROOT / package).rglob("*.py")}
    trees = {path: ast.parse(text) for path, text in sources.items()}
    folders = Counter(path.parent for path in sources)
    largest, most = folders.most_common(1)[0]
    rows = {
        "Python files in app/ + fusion/": len(sources),
        "lines": sum(text.count("\n") for text in sources.values()),
        f"largest folder, files ({largest.relative_to(ROOT)})": most,
        "files over 600 lines": sum(text.count("\n") > 600 for text in sources.values()),
        "files that analyse(read_recording(x.csv)) passes": len(trace_files()),
        "longest import chain between rooms of fusion/": measure_chain(trees),
        "private functions used once": count_used_once(sources, trees),
        "Python files with a W-code as a literal": count_caveat_files(trees),
        "words in docs/ outside tables": count_words(),
    }
    print("| | now |", "|---|---|", *(f"| {name} | {value:,} |" for name, value in rows.items()), sep="\n")


def trace_files() -> set[str]:
    """Give the files of ours in which a function runs while one recording is read and analysed."""
    passed: set[str] = set()

    def note(frame: FrameType, _event: str, _argument: object) -> None:
        passed.add(frame.f_code.co_filename)

    with tempfile.TemporaryDirectory() as folder:
        path = write_shift(Path(folder), simulate_shift("lsm9ds1", 0.02, seed=1))[0]
        sys.setprofile(note)
        try:
            with path.open("rb") as file:
                analyse(read_recording(file))
        finally:
            sys.setprofile(None)
    return {name for name in passed if name.startswith(str(ROOT / "fusion"))}


def measure_chain(trees: dict[Path, ast.Module]) -> int:
    """Give the length of the longest chain of imports between rooms: folders, or loose files, of fusion/."""
    imports: dict[str, set[str]] = {}
    for path, tree in trees.items():
        room = _name_room(path.relative_to(ROOT).with_suffix("").parts)
        if room is not None:
            imports.setdefault(room, set()).update(_list_rooms(tree))
    depths: dict[str, int] = {}

    def measure(room: str, above: tuple[str, ...]) -> int:
        if room not in depths:
            below = imports.get(room, set()) - {room, *above}
            depths[room] = 1 + max((measure(other, (*above, room)) for other in below), default=0)
        return depths[room]

    return max(measure(room, ()) for room in sorted(imports))


def _list_rooms(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            room = _name_room(tuple(node.module.split(".")))
            if room is not None:
                yield room


def _name_room(parts: tuple[str, ...]) -> str | None:
    return parts[1] if parts[0] == "fusion" and len(parts) > 1 and parts[1] != "__init__" else None


def count_used_once(sources: dict[Path, str], trees: dict[Path, ast.Module]) -> int:
    """Count the private functions whose name stands once beside their definition."""
    number = 0
    for path, tree in trees.items():
        names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
        private = [name for name in names if name.startswith("_")]
        number += sum(len(re.findall(rf"\b{name}\b", sources[path])) == 2 for name in private)
    return number


def count_caveat_files(trees: dict[Path, ast.Module]) -> int:
    """Count the files in which a caveat's code is a literal."""
    return sum(any(_is_caveat(node) for node in ast.walk(tree)) for tree in trees.values())


def _is_caveat(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant) and isinstance(node.value, str) and bool(CAVEAT.fullmatch(node.value))
    )


def count_words() -> int:
    """Count the words of the documents that stand in no table."""
    lines = (line for path in (ROOT / "docs").rglob("*.md") for line in path.read_text().splitlines())
    return sum(len(line.split()) for line in lines if not line.startswith("|"))


if __name__ == "__main__":
    main()
