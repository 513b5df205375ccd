"""The plan of a run, and the result folder of each recording: its marker, versions and languages.

No report is overwritten. The newest report has the plain file names; the previous one moves to ``v1``,
``v2``, ... inside the folder. A report in another language is the same version: it gets the plain names, and
the existing one gets its language in its name (``report.en.html``).
"""

import errno
import glob
import hashlib
import json
import os
import re
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import chain, count
from pathlib import Path

from app.errors import UnusableList
from app.formats import ENDINGS
from app.report.export.tables import Origin
from app.report.words.wording import clean_text
from app.request import Language, ReportRequest, clean_file_name, compare_settings
from app.store.folder import hash_file
from app.version import identify_engine
from fusion.conventions import is_sidecar

# The plan of a run: which recordings are analysed, and where their products go.


# The folder of each recording stays the same from run to run.
#
# A folder is named after the file's stem; further recordings with the same stem get a number. The marker in
# the folder identifies its recording, not the order of the files. Otherwise a recording that joins the study
# later could take another's folder, and the other's report would become an earlier version of the new one.


MARKER = "done.json"
"""Written last into a recording's folder: it marks the folder as complete and made by acromion."""

TABLES = (
    "summary.csv",
    "summary_fr.csv",
    "summary.xlsx",
    "periods.csv",
    "marks.csv",
    "problems.csv",
    "dictionary.csv",
    "run.json",
    "settings.yaml",
    "methods.md",
    "index.html",
    "datapackage.json",
    "ro-crate-metadata.json",
)
"""Files next to the recordings' folders."""

PROFILES = "profiles"
"""Folder of the column profiles in use, next to the recordings' folders; no recording may use this name."""

SHARDS = "shards"
"""Folder for data that the processes of a sharded run exchange (:mod:`app.batch.run`)."""

TRUTH = "truth.parquet"
"""The true angles of a simulated recording, with ``truth.json`` next to it."""

OWN_FOLDERS = (PROFILES, SHARDS)
_RESERVED = re.compile(r'[<>:"/\\|?*\x00-\x1f]|[. ]+$')


def assign_folders(logs: Sequence[Path], out: Path) -> list[Path]:
    """Assign each recording a folder: its own from an earlier run, or a free one.

    The plan is the same however much of a study is already done. The results are read once, so folders that
    another process creates meanwhile do not change the plan.
    """
    folders: dict[str, list[tuple[int, Path]]] = {format_folder_name(log).casefold(): [] for log in logs}
    for path in out.iterdir() if out.is_dir() else ():
        whole = path.name.casefold()
        stem, _, number = whole.rpartition(
            "-"
        )  # "arm-2" may be the second folder of arm, or the first of arm-2
        numbered = (stem, int(number)) if stem and number.isdecimal() else (whole, 1)
        for name, place in {(whole, 1), numbered}:
            if name in folders:
                folders[name].append((place, path))
    markers: dict[Path, dict[str, str]] = {path: {} for found in folders.values() for _, path in found}
    for path in markers:  # a missing or unreadable marker identifies no recording
        with suppress(OSError, ValueError):
            values = json.loads((path / MARKER).read_text("utf-8"))
            markers[path] = values if isinstance(values, dict) else {}
    digest, taken = cache(hash_file), {name.casefold() for name in TABLES}

    def list_made(log: Path) -> Iterator[Path]:
        found = (path for _, path in sorted(folders[format_folder_name(log).casefold()]))
        return (path for path in found if path.name.casefold() not in taken and markers[path].get("place"))

    def find_by_place(log: Path) -> Path | None:
        place = identify_place(log)
        return next((path for path in list_made(log) if markers[path]["place"] == place), None)

    def find_by_bytes(log: Path) -> Path | None:
        """Return the folder made from the same bytes at another path."""
        for path in list_made(log):
            with suppress(OSError):  # an unreadable recording is reported when it is analysed
                if markers[path].get("input", "").split()[:1] == [digest(log)]:
                    return path
        return None

    def find_free(log: Path) -> Path | None:
        """Return a folder without a recording: named after the stem, then numbered."""
        stem = format_folder_name(log)
        every = chain([out / stem], (out / f"{stem}-{number}" for number in count(2)))
        free = (path for path in every if path.name.casefold() not in taken)
        return next(path for path in free if not markers.get(path, {}).get("place"))

    placed: dict[int, Path] = {}
    for find in (find_by_place, find_by_bytes, find_free):
        for k, log in enumerate(logs):
            folder = None if k in placed else find(log)
            if folder is not None:
                placed[k] = folder
                taken.add(folder.name.casefold())
    return [placed[k] for k in range(len(logs))]


def identify_place(log: Path) -> str:
    """Hash a path, so that it can be recognised but not read back."""
    return hashlib.sha256(os.fsencode(os.path.normpath(log.absolute()))).hexdigest()[:16]


def format_folder_name(log: Path) -> str:
    """Return the file's stem as a name that is safe for a folder."""
    stem = log.name.removesuffix(".gz").rpartition(".")[0] or log.name
    safe = _RESERVED.sub("_", clean_text(stem)).lstrip(". ")
    return f"{safe}_" if safe in OWN_FOLDERS else safe[:120] or "recording"


@dataclass(frozen=True, slots=True)
class Task:
    """One recording to analyse: its path, its request and its result folder.

    ``path`` is relative to the folder in the command; ``sha256``: of the recording, if it has been read.
    """

    log: Path
    request: ReportRequest
    folder: Path
    force: bool = False
    path: str = ""
    sha256: str = ""

    @property
    def name(self) -> str:
        """A name that is unique in the run."""
        return self.path or format_path(Path(self.log.name))

    @property
    def origin(self) -> Origin:
        """The identity of the recording in the tables."""
        who = self.request
        return Origin(who.file_name, who.subject, who.side, self.name, self.folder.name)


def format_path(path: Path) -> str:
    """Format a path as valid text: bytes that are not UTF-8 become U+FFFD."""
    return os.fsencode(path).decode("utf-8", "replace")


def plan_tasks(
    logs: Iterable[Path],
    out: Path,
    request: ReportRequest,
    format_log: Callable[[Path], str] = lambda log: format_path(Path(log.name)),
    *,
    force: bool,
) -> list[Task]:
    """Build a task for each recording, with a folder named after its stem; equal stems get a number."""
    known = list(logs)
    return [
        Task(log, replace(request, file_name=clean_file_name(log.name)), folder, force, format_log(log))
        for log, folder in zip(known, assign_folders(known, out), strict=True)
    ]


# Recordings can be given one by one, as folders, as patterns or in a list.


@dataclass(frozen=True, slots=True)
class Found:
    """The recordings without duplicates in a stable order, and the number of other files in the folders.

    ``base`` is the folder in the command, or the common parent of several.
    """

    logs: tuple[Path, ...]
    others: int = 0
    base: Path = Path()

    def format_place(self, log: Path) -> str:
        """Return the path of a recording relative to ``base``."""
        way = _get_absolute_path(log)
        below = way.relative_to(self.base) if way.is_relative_to(self.base) else way
        return Path(format_path(below)).as_posix()


def find_recordings(paths: Iterable[Path], out: Path, without: Collection[Path] = ()) -> Found:
    """Find the recordings among paths and in folders, recursively.

    The results folder is ignored, as are the files in ``without`` (diaries, lists) and sidecar files of the
    operating system.
    """
    logs: dict[Path, None] = {}
    others = 0
    bases: list[Path] = []
    for path in _expand(paths):
        bases.append(_get_absolute_path(path) if path.is_dir() else _get_absolute_path(path).parent)
        inside = _find_in_folder(path, out, {p.resolve() for p in without}) if path.is_dir() else [path]
        found = [
            p
            for p in inside
            if p is path
            or (p.name.lower().endswith(ENDINGS) and not is_sidecar(p.relative_to(path).as_posix()))
        ]
        logs.update(dict.fromkeys(found))
        others += len(inside) - len(found)
    try:
        base = Path(os.path.commonpath(bases))
    except ValueError:  # on several drives there is no common parent
        base = Path()
    return Found(tuple(logs), others, base)


def _get_absolute_path(path: Path) -> Path:
    """Return the absolute path without following links."""
    return Path(os.path.normpath(path.absolute()))


def _find_in_folder(folder: Path, out: Path, without: Collection[Path]) -> list[Path]:
    """List the files in a folder without results, of this run or others (a folder with ``run.json``).

    The true angles that ``acromion simulate`` writes next to a recording are also ignored.
    """
    files = [
        path
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not (path.name == TRUTH and path.with_suffix(".json").exists())
    ]
    made = (path.parent for path in files if path.name in {"run.json", MARKER})
    results = {place.resolve() for place in (out, *made)}
    return [
        path for path in files if path.resolve() not in without and results.isdisjoint(path.resolve().parents)
    ]


def read_list(content: str, folder: Path) -> list[Path]:
    """Parse a list of paths, one per line; relative paths start from ``folder``.

    Blank lines and lines that start with # are ignored.

    Raises UnusableList if a path does not exist.
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
    """Expand patterns that the shell did not (Windows, or within quotes)."""
    for path in paths:
        if set("*?[") & set(str(path)) and not path.exists():
            names = sorted(glob.glob(str(path), recursive=True))  # noqa: PTH207  the path may be absolute
            yield from map(Path, names or [str(path)])
        else:
            yield path


if sys.platform != "win32":
    import fcntl

_FIGURES = ("results.json", "elevation.parquet", "pair.json", "comparison.json", "profile.json")
_REPORT_FILES = ("answer.txt", "report.html", "report.pdf")


@dataclass(frozen=True, slots=True)
class Marker:
    """The origin of the products in a folder; it is written last, so that they are complete."""

    fingerprint: str
    input: str = ""
    """SHA-256 of the recording and of each file joined to it."""
    settings: str = "{}"
    version: int = 1
    changes: tuple[str, ...] = ()
    language: Language = "en"
    figures: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each result file, by name."""
    papers: Mapping[Language, str] = field(default_factory=dict)
    """The paper and appendix of the PDF in each language (:func:`describe_paper`); A4 if not stated."""
    place: str = ""
    """Hash of the recording's path (:func:`identify_place`)."""


def build_marker(task: Task, digest: str = "") -> Marker:
    """Build the marker of a task: the same input, settings and software give the same figures.

    ``digest``: SHA-256 of its single recording, if known.
    """
    digest = (
        digest
        or task.sha256
        or " ".join(hash_file(path) for path in (task.log, *map(Path, task.request.joined)))
    )
    settings, fingerprint = _write_settings(task.request), compute_fingerprint(digest, task.request)
    language, place = task.request.languages[0], identify_place(task.log)
    papers = {language: describe_paper(task.request)}
    return Marker(fingerprint, digest, settings, language=language, papers=papers, place=place)


def describe_paper(request: ReportRequest) -> str:
    """Return the paper of a PDF, and whether it has the appendix: ``a4``, ``a4+appendix``."""
    return request.paper + ("+appendix" if request.appendix else "")


def compute_fingerprint(digest: str, request: ReportRequest) -> str:
    """Hash everything that determines the figures: digest of the bytes, settings and software."""
    parts = [digest, request.file_name, _write_settings(request), identify_engine()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def read_marker(folder: Path, figures: str = "results.json") -> Marker | None:
    """Read the marker of a finished folder; None if it is unfinished or its files have changed."""
    if not all((folder / name).exists() for name in (MARKER, figures, "answer.txt")):
        return None
    try:
        values = json.loads((folder / MARKER).read_text("utf-8"))
        marker = Marker(**{**values, "changes": tuple(values.get("changes", ()))})
    except (ValueError, TypeError):
        return None
    return marker if _hash_figures(folder) == marker.figures else None


def is_up_to_date(task: Task) -> bool:
    """Return whether the existing report has the figures that the task would produce."""
    before = read_marker(task.folder)
    if before is None or before.settings != _write_settings(task.request):  # without reading the recording
        return False
    return before.fingerprint == build_marker(task).fingerprint


def _write_settings(request: ReportRequest) -> str:
    return json.dumps(request.describe_settings(), sort_keys=True)


def write_marker(folder: Path, marker: Marker) -> None:
    """Write the marker, which declares the folder complete."""
    whole = replace(marker, figures=_hash_figures(folder))
    (folder / MARKER).write_text(json.dumps(asdict(whole)), "utf-8")


def _hash_figures(folder: Path) -> dict[str, str]:
    """Hash the files from which a later run renders reports."""
    there = (folder / name for name in _FIGURES)
    return {path.name: hash_file(path) for path in there if path.exists()}


def find_changes(before: Marker, after: Marker) -> tuple[str, ...]:
    """Return what differs: "input", the settings, or else the "engine"."""
    old, new = json.loads(before.settings), json.loads(after.settings)
    other_input = ("input",) if before.input and before.input != after.input else ()
    return (*other_input, *compare_settings(old, new)) or ("engine",)


def check_own_folder(folder: Path) -> None:
    """Refuse to replace a folder that acromion did not make. Raises FileExistsError."""
    if folder.exists() and not (folder / MARKER).exists() and any(folder.iterdir()):
        raise FileExistsError(errno.EEXIST, "a folder of this name exists and was not made by acromion")


def use_plain_names(folder: Path, language: Language) -> None:
    """Rename the report in ``language`` to ``report.html`` and its answer to ``answer.txt``."""
    for path in folder.glob(f"*.{language}.*"):
        path.rename(folder / f"{path.name.partition('.')[0]}{path.suffix}")


def has_report(folder: Path, marker: Marker, request: ReportRequest) -> bool:
    """Return whether the report exists in the requested language, kinds, paper and appendix."""
    language = request.languages[0]
    if "pdf" in request.kinds and marker.papers.get(language, "a4") != describe_paper(request):
        return False
    mark = "" if language == marker.language else f".{language}"
    reports = (folder / f"report{mark}.{kind}" for kind in request.kinds)
    return all(path.exists() and path.stat().st_size > 0 for path in reports)


def switch_language(folder: Path, marker: Marker, language: Language) -> None:
    """Rename the files of another language to the plain names, and update the marker."""
    if language == marker.language:
        return
    for name in _REPORT_FILES:
        plain = folder / name
        if plain.exists():
            plain.rename(plain.with_name(f"{plain.stem}.{marker.language}{plain.suffix}"))
    use_plain_names(folder, language)
    write_marker(folder, replace(marker, language=language))


def replace_folder(folder: Path, staging: Path, figures: str = "results.json") -> None:
    """Replace the folder with new products; the old ones move to ``v<version>`` inside."""
    earlier = get_earlier_path(folder)
    if folder.exists():
        folder.rename(earlier)
    staging.rename(folder)
    restore_earlier(folder, figures)


def restore_earlier(folder: Path, figures: str = "results.json") -> None:
    """Move the earlier contents back if a run was interrupted, else into the new folder as a version."""
    earlier = get_earlier_path(folder)
    if not earlier.exists():
        return
    if not folder.exists():
        earlier.rename(folder)
        return
    for older in _find_versions(earlier):
        older.rename(folder / older.name)
    before, now = read_marker(earlier, figures), read_marker(folder, figures)
    if before is None or (now is not None and now.version == before.version):
        shutil.rmtree(earlier)
    else:
        earlier.rename(folder / f"v{before.version}")


def get_last_version(folder: Path) -> int:
    """Return the number of the last earlier version; 0 if there is none."""
    return max((int(path.name[1:]) for path in _find_versions(folder)), default=0)


def _find_versions(folder: Path) -> list[Path]:
    return [path for path in folder.glob("v*/") if path.name[1:].isdigit()]


@contextmanager
def open_staging(folder: Path) -> Iterator[Path]:
    """Provide an empty staging folder next to ``folder``; it is deleted at the end.

    Raises BlockingIOError if another run is making the same products.
    """
    staging = folder.with_name(f".{folder.name}.part")
    staging.mkdir(parents=True, exist_ok=True)
    with _hold_alone(staging):
        try:
            for left in staging.iterdir():
                shutil.rmtree(left) if left.is_dir() else left.unlink()
            yield staging
        finally:
            shutil.rmtree(staging, ignore_errors=True)


@contextmanager
def _hold_alone(staging: Path) -> Iterator[None]:
    """Lock a folder until the end of the block or of this process, if the file system supports locks."""
    if sys.platform == "win32":
        yield
        return
    descriptor = os.open(staging, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise BlockingIOError(errno.EAGAIN, "another run is making the same report") from None
    except OSError:
        pass
    try:
        yield
    finally:
        os.close(descriptor)


def write_version(folder: Path, figures: str, language: Language, make: Callable[[Path], None]) -> Marker:
    """Write a report of several analyses to its folder, as a new version if its figures changed."""
    restore_earlier(folder, figures)
    check_own_folder(folder)
    with open_staging(folder) as staging:
        make(staging)
        use_plain_names(staging, language)
        fingerprint, before = hash_file(staging / figures), read_marker(folder, figures)
        version = get_last_version(folder) + 1
        if before is not None:
            version = before.version + (before.fingerprint != fingerprint)
        marker = Marker(fingerprint, version=version, language=language)
        write_marker(staging, marker)
        replace_folder(folder, staging, figures)
    return marker


def get_earlier_path(folder: Path) -> Path:
    """Return the temporary path of a folder's earlier contents."""
    return folder.with_name(f".{folder.name}.earlier")
