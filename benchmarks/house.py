"""Count files, lines and folders, and the files that one recording uses.

    python -m benchmarks.house

The figures are for information; nothing fails on them. Static figures come from the source of ``app`` and
``fusion``. The files that one recording uses are traced: a file counts if one of its functions runs (an
import alone does not count), in any process that the command starts. The recordings are simulated.
"""

import ast
import inspect
import os
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from acromion.fusion.simulation import simulate_shift, write_shift
from tests.docs.test_plain_words import count_idioms, count_words

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("app", "fusion")
CAVEAT = re.compile(r"W-[A-Z][A-Z-]+")
FIGURE = "longest_without_s"
"""A figure in results.json and in a report; to add another, change the files that contain this name.
"""
TRACER = f"""
import os, sys, threading
seen, folder = set(), os.environ["HOUSE_TRACE"]
def note(frame, event, argument):
    code = frame.f_code
    name = code.co_filename
    if name not in seen and code.co_flags & {inspect.CO_OPTIMIZED}:
        seen.add(name)
        name = os.path.realpath(name)
        if name.startswith({str(ROOT)!r}):
            with open(os.path.join(folder, str(os.getpid())), "a") as file:
                file.write(name + chr(10))
def start():
    seen.clear()
    threading.setprofile(note)
    sys.setprofile(note)
os.register_at_fork(after_in_child=start)
start()
"""
"""Code that every Python process of a traced command runs first (``sitecustomize``)."""
ANALYSE = (
    "import sys; from acromion import analyse, read_recording;"
    "analyse(read_recording(open(sys.argv[1], 'rb')))"
)
CHILD = """
import sys; from pathlib import Path
from acromion.app.analysis.attempt import load_and_make_report
from acromion.app.request import ReportRequest
load_and_make_report(Path(sys.argv[1]), ReportRequest(file_name="x.gt3x"), Path(sys.argv[2]), lambda *_: True)
"""
UNITS = frozenset(
    [
        "s",
        "ms",
        "us",
        "ns",
        "min",
        "h",
        "hz",
        "khz",
        "deg",
        "dps",
        "rad",
        "rads",
        "g",
        "mg",
        "mps2",
        "mv",
        "bytes",
        "kib",
        "mib",
        "gib",
        "percent",
        "points",
    ]
)
COUNTED = UNITS | frozenset(
    [
        "row",
        "rows",
        "sample",
        "samples",
        "line",
        "lines",
        "byte",
        "bit",
        "bits",
        "px",
        "pt",
        "minute",
        "minutes",
        "hour",
        "hours",
        "ppm",
    ]
)
"""Units, and countable things: positions and lengths in rows, samples, lines or bytes, places on a sheet."""


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
        **trace_recordings(),
        "longest import chain between folders of fusion/": measure_chain(trees),
        "private functions used once": count_used_once(sources, trees),
        "Python files with a W-code as a literal": count_caveat_files(trees),
        "numbers with a unit in their name, percent": share_with_unit(trees),
        "of these that are float, percent": share_with_unit(trees, ("float",)),
        "numbers with a unit or what is counted in their name, percent": share_with_unit(
            trees, units=COUNTED
        ),
        f"files touched to add a figure (files that contain {FIGURE})": count_figure_files(),
        "written words in docs/": count_words(),
        "idioms in code, docs and wording": count_idioms(),
        "docstrings that begin with Give, Tell or Say": sum(
            len(re.findall(r'"""(?:Give|Tell|Say)s?\b', text)) for text in sources.values()
        ),
    }
    print("| | now |", "|---|---|", *(f"| {name} | {value:,} |" for name, value in rows.items()), sep="\n")


def trace_recordings() -> dict[str, int]:
    """Count the files that one recording uses: in the child, from the command line, from Python."""
    acromion = str(Path(sys.executable).with_name("acromion"))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        table = str(write_shift(folder / "table", simulate_shift("lsm9ds1", 0.02, seed=1))[0])
        binary = str(write_shift(folder / "binary", simulate_shift("gt9x", 0.1, seed=1))[0])
        (folder / "out").mkdir()
        return {
            "files one .gt3x passes in the child": trace(
                folder / "child", [sys.executable, "-c", CHILD, binary, str(folder / "out")]
            ),
            "files one .gt3x passes by acromion run": trace(
                folder / "run", [acromion, "run", binary, "--out", str(folder / "reports")]
            ),
            "files that analyse(read_recording(x.csv)) passes": trace(
                folder / "python", [sys.executable, "-c", ANALYSE, table]
            ),
        }


def trace(folder: Path, command: list[str]) -> int:
    """Count our files in which a function runs during a command, in all its processes."""
    notes = folder / "notes"
    notes.mkdir(parents=True)
    (folder / "sitecustomize.py").write_text(TRACER)
    paths = os.pathsep.join((str(folder), str(ROOT / ".ci" / "package")))
    environment = {**os.environ, "PYTHONPATH": paths, "HOUSE_TRACE": str(notes)}
    subprocess.run(command, env=environment, check=True, capture_output=True, cwd=folder)
    passed = {line for note in notes.iterdir() for line in note.read_text().splitlines()}
    return sum(name.startswith((f"{ROOT}/app/", f"{ROOT}/fusion/")) for name in passed)


def measure_chain(trees: dict[Path, ast.Module]) -> int:
    """Return the length of the longest import chain between the folders or single files of fusion/."""
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
            room = _name_room(tuple(node.module.removeprefix("acromion.").split(".")))
            if room is not None:
                yield room


def _name_room(parts: tuple[str, ...]) -> str | None:
    return parts[1] if parts[0] == "fusion" and len(parts) > 1 and parts[1] != "__init__" else None


def count_used_once(sources: dict[Path, str], trees: dict[Path, ast.Module]) -> int:
    """Count the private functions that are used once: their name occurs once besides the definition."""
    number = 0
    for path, tree in trees.items():
        names = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
        private = [name for name in names if name.startswith("_")]
        number += sum(len(re.findall(rf"\b{name}\b", sources[path])) == 2 for name in private)
    return number


def count_caveat_files(trees: dict[Path, ast.Module]) -> int:
    """Count the files, except caveats.py with its declarations, that contain a caveat's code as a literal."""
    others = (tree for path, tree in trees.items() if path.name != "caveats.py")
    return sum(any(_is_caveat(node) for node in ast.walk(tree)) for tree in others)


def _is_caveat(node: ast.AST) -> bool:
    return (
        isinstance(node, ast.Constant) and isinstance(node.value, str) and bool(CAVEAT.fullmatch(node.value))
    )


def share_with_unit(
    trees: dict[Path, ast.Module],
    types: tuple[str, ...] = ("float", "int"),
    units: frozenset[str] = UNITS,
) -> int:
    """Return the percentage of numbers (parameters and fields) whose name contains a unit."""
    names = [name for tree in trees.values() for name in _list_numbers(tree, types)]
    return round(100 * sum(not units.isdisjoint(name.lower().split("_")) for name in names) / len(names))


def _list_numbers(tree: ast.Module, types: tuple[str, ...]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.arg):
            name = node.arg
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            name = node.target.id
        else:
            continue
        if node.annotation is not None and ast.unparse(node.annotation).removesuffix(" | None") in types:
            yield name


def count_figure_files() -> int:
    """Count the files of code and words that contain one figure's name."""
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.*"))
    return sum(FIGURE in path.read_text() for path in files if path.suffix in {".py", ".toml"})


if __name__ == "__main__":
    main()
