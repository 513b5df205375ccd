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
import platform
import re
import shutil
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from itertools import chain, count
from pathlib import Path

from acromion.app.batch.stated import format_stated
from acromion.app.errors import UnusableList
from acromion.app.formats import ENDINGS
from acromion.app.report.export.tables import Origin
from acromion.app.report.words.wording import clean_text
from acromion.app.request import Language, ReportRequest, clean_file_name, compare_settings
from acromion.app.store.folder import hash_file
from acromion.app.version import identify_engine
from acromion.fusion.conventions import is_sidecar
from acromion.fusion.errors import Fact

# The plan of a run: which recordings are analysed, and where their products go.


# The folder of each recording stays the same from run to run.
#
# The folders mirror the input: study/siteA/p01.gt3x goes to siteA/p01. Further recordings with the same path
# and stem get a number. The marker in the folder identifies its recording, not the order of the files.
# Otherwise a recording that joins the study later could take another's folder, and the other's report would
# become an earlier version of the new one.


MARKER = "done.json"
"""Written last into a recording's folder: it marks the folder as complete and made by acromion."""

RUN = "run.json"
"""Describes the last run: which recordings it had, and their folders."""

PAIRS = "pairs.json"
"""The rows of pairs.csv by the hash of what determines them (:mod:`acromion.app.batch.pairs`)."""

LOCK = "run.lock"
"""Locked while a run writes into the results; its content names the last process that did."""

TABLES = (
    "summary.csv",
    "summary_fr.csv",
    "summary.xlsx",
    "days.csv",
    "hours.csv",
    "periods.csv",
    "tasks.csv",
    "postures.csv",
    "marks.csv",
    "pairs.csv",
    *("summary.parquet", "days.parquet", "hours.parquet", "periods.parquet", "tasks.parquet"),
    *("postures.parquet", "marks.parquet", "pairs.parquet"),
    *("redcap_import.csv", "redcap_dictionary.csv"),
    "problems.csv",
    "dictionary.csv",
    RUN,
    PAIRS,
    LOCK,
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
"""Folder for data that the processes of a sharded run exchange (:mod:`acromion.app.batch.run`)."""


TRUTH = "truth.parquet"
"""The true angles of a simulated recording, with ``truth.json`` next to it."""

INPUTS = "inputs"
"""Folder of the inputs of the last run (:mod:`acromion.app.batch.again`)."""

OWN_FOLDERS = (PROFILES, SHARDS, INPUTS)
_VERSION = re.compile(r"v\d+")
"""Name of the folder of an earlier version."""
_RESERVED = re.compile(r'[<>:"/\\|?*\x00-\x1f]|[. ]+$')


def assign_folders(logs: Sequence[Path], out: Path, places: Sequence[str] = ()) -> list[Path]:
    """Assign each recording a folder: its own from an earlier run, or a free one at the path of the input.

    ``places``: the recordings' paths below the input folder; without them every folder is directly in
    ``out``. The plan is the same however much of a study is already done. The results are read once, so
    folders that another process creates meanwhile do not change the plan. No folder is inside another.
    """
    markers = _read_markers(out)
    of_name: dict[str, list[Path]] = {}
    for path in markers:
        whole = path.name.casefold()
        stem, _, number = whole.rpartition("-")  # "arm-2": the second folder of arm, or the first of arm-2
        for name in {whole, stem if number.isdecimal() else whole}:
            of_name.setdefault(name, []).append(path)
    digest, taken = cache(hash_file), {out / name for name in TABLES}
    blocked = {_fold_path(path) for path in (*markers, *taken)}
    wanted = [
        _mirror(out, Path(place).parent, blocked) / format_folder_name(log)
        for log, place in zip(logs, places or [log.name for log in logs], strict=True)
    ]
    blocked |= {_fold_path(parent) for path in (*wanted, *markers) for parent in path.parents}

    def find_by_place(k: int) -> Path | None:
        place = identify_place(logs[k])
        return next((path for path in list_made(k) if markers[path]["place"] == place), None)

    def find_by_bytes(k: int) -> Path | None:
        """Return the folder made from the same bytes at another path."""
        for path in list_made(k):
            with suppress(OSError):  # an unreadable recording is reported when it is analysed
                if markers[path].get("input", "").split()[:1] == [digest(logs[k])]:
                    return path
        return None

    def list_made(k: int) -> Iterator[Path]:
        """Return the free folders of the recording's name, those at its path first, by their numbers."""
        found = of_name.get(wanted[k].name.casefold(), ())
        nearest = sorted(found, key=lambda path: (path.parent != wanted[k].parent, len(path.name), path))
        return (path for path in nearest if path not in taken)

    def find_free(k: int) -> Path:
        first = wanted[k]
        every = chain([first], (first.with_name(f"{first.name}-{number}") for number in count(2)))
        return next(path for path in every if _fold_path(path) not in blocked)

    placed: dict[int, Path] = {}
    for find in (find_by_place, find_by_bytes, find_free):
        for k in range(len(logs)):
            folder = None if k in placed else find(k)
            if folder is not None:
                placed[k] = folder
                taken.add(folder)
                blocked.add(_fold_path(folder))
    return [placed[k] for k in range(len(logs))]


def _read_markers(out: Path) -> dict[Path, dict[str, str]]:
    """Return the markers of finished recordings in the results by their folders, at any depth."""
    markers: dict[Path, dict[str, str]] = {}
    for folder, below, files in os.walk(out):
        if MARKER in files:
            below.clear()  # earlier versions are inside
            with suppress(OSError, ValueError):  # an unreadable marker identifies no recording
                values = json.loads((Path(folder) / MARKER).read_text("utf-8"))
                if isinstance(values, dict) and values.get("place"):
                    markers[Path(folder)] = values
        below[:] = [name for name in below if not name.startswith(".")]
    return markers


def _mirror(out: Path, below: Path, blocked: Collection[str]) -> Path:
    """Return the folder of the results for a folder of the input; never the folder of a recording."""
    folder = out
    for part in () if below.is_absolute() else below.parts:
        name = format_part_name(part)
        while _fold_path(folder / name) in blocked:
            name += "_"
        folder /= name
    return folder


def _fold_path(path: Path) -> str:
    return path.as_posix().casefold()


def identify_place(log: Path) -> str:
    """Hash a path, so that it can be recognised but not read back."""
    return hashlib.sha256(os.fsencode(os.path.normpath(log.absolute()))).hexdigest()[:16]


def format_folder_name(log: Path) -> str:
    """Return the file's stem as a name that is safe for a folder."""
    return format_part_name(log.name.removesuffix(".gz").rpartition(".")[0] or log.name)


def format_part_name(part: str) -> str:
    """Return a name that is safe for a folder and not used by acromion itself."""
    safe = _RESERVED.sub("_", clean_text(part)).lstrip(". ")
    return f"{safe}_" if safe in OWN_FOLDERS or _VERSION.fullmatch(safe) else safe[:120] or "recording"


def list_finished(path: Path) -> list[Path]:
    """Return the folders of finished analyses: the given one, those of the last run, or all at any depth.

    ``path``: the folder of an analysis, the results of a run, a folder that contains several, or a file in
    the folder of an analysis. Earlier versions and folders that the last run did not have are omitted.
    """
    if not path.is_dir():
        return [path.parent]
    if (path / "results.json").exists():
        return [path]
    try:
        recordings = json.loads((path / RUN).read_bytes())["recordings"]
        every = [path / one["folder"] for one in recordings if one["code"] is None]
    except (OSError, ValueError, KeyError, TypeError):  # not the folder of a whole run
        below = sorted(one for one in path.iterdir() if one.is_dir())
        inner = [one for one in below if not (one.name.startswith(".") or _VERSION.fullmatch(one.name))]
        return [folder for one in inner for folder in list_finished(one)]
    return [folder for folder in every if (folder / "results.json").exists()]


def find_orphans(out: Path, folders: Collection[Path]) -> list[str]:
    """Return the names of finished analyses in the results that are not among the folders of the run."""
    others = (folder for folder in _read_markers(out) if folder not in folders)
    return sorted(
        folder.relative_to(out).as_posix() for folder in others if (folder / "results.json").exists()
    )


@contextmanager
def hold_results(out: Path, *, is_shared: bool) -> Iterator[None]:
    """Keep other runs out of a results folder until the end of the block or of this process.

    The system releases the lock of a process that dies: a crash leaves nothing to clear away. Shards
    (``is_shared``) hold it together. A file system without locks, and Windows, do not keep other runs out.

    Raises BlockingIOError that states the process and its computer.
    """
    out.mkdir(parents=True, exist_ok=True)
    if sys.platform == "win32":
        yield
        return
    with (out / LOCK).open("a+", encoding="utf-8") as file:
        try:
            fcntl.lockf(file, fcntl.LOCK_NB | (fcntl.LOCK_SH if is_shared else fcntl.LOCK_EX))
        except (BlockingIOError, PermissionError):
            file.seek(0)
            raise BlockingIOError(errno.EAGAIN, file.read(200).strip()) from None
        except OSError:
            pass
        file.truncate(0)
        file.write(f"{os.getpid()} {platform.node()}\n")
        file.flush()
        yield


@dataclass(frozen=True, slots=True)
class Task:
    """One recording to analyse: its path, its request and its result folder.

    ``path`` is relative to the folder in the command; ``sha256``: of the recording, if it has been read;
    ``out``: the results folder, which contains ``folder``. ``line``: its row in the list of participants,
    0 for none; ``further``: the row's cells that change no setting, by column. ``double_of``: the same
    recording, which is analysed instead. ``code``, ``facts``: why no shift can be cut, known before the run.
    """

    log: Path
    request: ReportRequest
    folder: Path
    force: bool = False
    path: str = ""
    sha256: str = ""
    out: Path | None = None
    line: int = 0
    further: Mapping[str, str] = field(default_factory=dict, hash=False)
    double_of: str = ""
    code: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict, hash=False)

    @property
    def name(self) -> str:
        """A name that is unique in the run."""
        return self.path or format_path(Path(self.log.name))

    @property
    def place(self) -> str:
        """The result folder, relative to the results: ``siteA/p01``."""
        below = self.folder.relative_to(self.out) if self.out else Path(self.folder.name)
        return Path(format_path(below)).as_posix()

    @property
    def origin(self) -> Origin:
        """The identity of the recording in the tables."""
        who = self.request
        return Origin(who.file_name, who.subject, who.side, self.name, self.place, format_stated(who))


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
    """Build a task for each recording, with a folder at its path; equal paths get a number."""
    known = list(logs)
    places = [format_log(log) for log in known]
    return [
        Task(log, replace(request, file_name=clean_file_name(log.name)), folder, force, place, out=out)
        for log, folder, place in zip(known, assign_folders(known, out, places), places, strict=True)
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
    made = (path.parent for path in files if path.name in {RUN, MARKER})
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
