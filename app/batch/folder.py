"""The folder of a finished recording: what it was made from, the version before it, its languages.

No report is overwritten. The newest stands in the folder under the plain names; the one before it moves into
``v1``, ``v2``, ... inside. A report in another language is the same report: it takes the plain names, and the
one there keeps its language in its name (``report.en.html``).
"""

import errno
import hashlib
import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

from app.batch.plan import MARKER, Task, identify_place
from app.request import Language, Paper, ReportRequest, compare_settings
from app.storage.store import hash_file
from app.version import identify_engine

if sys.platform != "win32":
    import fcntl

_FIGURES = ("results.json", "elevation.parquet", "pair.json", "comparison.json", "profile.json")
_REPORT_FILES = ("answer.txt", "report.html", "report.pdf")


@dataclass(frozen=True, slots=True)
class Marker:
    """What the products in a folder were made from; it is written last, so that they are complete."""

    fingerprint: str
    input: str = ""
    """SHA-256 of the log and of each file joined to it."""
    settings: str = "{}"
    version: int = 1
    changes: tuple[str, ...] = ()
    language: Language = "en"
    figures: Mapping[str, str] = field(default_factory=dict)
    """SHA-256 of each file of figures, by its name."""
    papers: Mapping[Language, Paper] = field(default_factory=dict)
    """The paper of each language's PDF; A4 where none is stated."""
    place: str = ""
    """Where the log lay (:func:`app.batch.plan.identify_place`)."""


def make_marker(task: Task, digest: str = "") -> Marker:
    """Build the marker of a task: the same input, settings and software give the same figures.

    ``digest``: SHA-256 of its one log, where it is known.
    """
    digest = digest or " ".join(hash_file(path) for path in (task.log, *map(Path, task.request.joined)))
    settings, fingerprint = _write_settings(task.request), take_fingerprint(digest, task.request)
    language, paper = task.request.languages[0], task.request.paper
    place = identify_place(task.log)
    return Marker(fingerprint, digest, settings, language=language, papers={language: paper}, place=place)


def take_fingerprint(digest: str, request: ReportRequest) -> str:
    """Hash what the figures depend on: the bytes (by their digest), what is asked, and the software."""
    parts = [digest, request.file_name, _write_settings(request), identify_engine()]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


def read_marker(folder: Path, figures: str = "results.json") -> Marker | None:
    """Read what a finished folder was made from; None where it is not finished, or no longer whole."""
    if not all((folder / name).exists() for name in (MARKER, figures, "answer.txt")):
        return None
    try:
        values = json.loads((folder / MARKER).read_text("utf-8"))
        marker = Marker(**{**values, "changes": tuple(values.get("changes", ()))})
    except (ValueError, TypeError):
        return None
    return marker if _hash_figures(folder) == marker.figures else None


def is_up_to_date(task: Task) -> bool:
    """Whether the report that is there holds the figures that the task would make."""
    before = read_marker(task.folder)
    if before is None or before.settings != _write_settings(task.request):  # the log need not be read
        return False
    return before.fingerprint == make_marker(task).fingerprint


def _write_settings(request: ReportRequest) -> str:
    return json.dumps(request.describe_settings(), sort_keys=True)


def write_marker(folder: Path, marker: Marker) -> None:
    """Declare the folder complete."""
    whole = replace(marker, figures=_hash_figures(folder))
    (folder / MARKER).write_text(json.dumps(asdict(whole)), "utf-8")


def _hash_figures(folder: Path) -> dict[str, str]:
    """Hash the files that a later run relies on to write reports again."""
    there = (folder / name for name in _FIGURES)
    return {path.name: hash_file(path) for path in there if path.exists()}


def find_changes(before: Marker, after: Marker) -> tuple[str, ...]:
    """Find what differs: "input", the settings, or else the "engine"."""
    old, new = json.loads(before.settings), json.loads(after.settings)
    other_input = ("input",) if before.input and before.input != after.input else ()
    return (*other_input, *compare_settings(old, new)) or ("engine",)


def refuse_foreign_folder(folder: Path) -> None:
    """Refuse to replace a folder that we did not make. Raises FileExistsError."""
    if folder.exists() and not (folder / MARKER).exists() and any(folder.iterdir()):
        raise FileExistsError(errno.EEXIST, "a folder of this name exists and was not made by acromion")


def use_plain_names(folder: Path, language: Language) -> None:
    """Rename the report in ``language`` to ``report.html``, its answer to ``answer.txt``."""
    for path in folder.glob(f"*.{language}.*"):
        path.rename(folder / f"{path.name.partition('.')[0]}{path.suffix}")


def has_report(folder: Path, marker: Marker, request: ReportRequest) -> bool:
    """Whether the report is there in the language, the kinds and for the paper asked."""
    language = request.languages[0]
    if "pdf" in request.kinds and marker.papers.get(language, "a4") != request.paper:
        return False
    mark = "" if language == marker.language else f".{language}"
    reports = (folder / f"report{mark}.{kind}" for kind in request.kinds)
    return all(path.exists() and path.stat().st_size > 0 for path in reports)


def switch_language(folder: Path, marker: Marker, language: Language) -> None:
    """Give the plain names to the files of another language, and note it in the marker."""
    if language == marker.language:
        return
    for name in _REPORT_FILES:
        plain = folder / name
        if plain.exists():
            plain.rename(plain.with_name(f"{plain.stem}.{marker.language}{plain.suffix}"))
    use_plain_names(folder, language)
    write_marker(folder, replace(marker, language=language))


def replace_folder(folder: Path, staging: Path, figures: str = "results.json") -> None:
    """Put the new products in place; what stood there moves to ``v<version>`` inside."""
    earlier = find_earlier(folder)
    if folder.exists():
        folder.rename(earlier)
    staging.rename(folder)
    restore_earlier(folder, figures)


def restore_earlier(folder: Path, figures: str = "results.json") -> None:
    """Move back what was set aside: to its own place where that is free (a run was cut), else inside."""
    earlier = find_earlier(folder)
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


def find_last_version(folder: Path) -> int:
    """Give the number of the last version kept inside; 0 for none."""
    return max((int(path.name[1:]) for path in _find_versions(folder)), default=0)


def _find_versions(folder: Path) -> list[Path]:
    return [path for path in folder.glob("v*/") if path.name[1:].isdigit()]


@contextmanager
def open_staging(folder: Path) -> Iterator[Path]:
    """Give an empty staging folder next to ``folder``; it is removed at the end.

    Raises
    ------
    BlockingIOError
        When another run makes the same products just now.
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
    """Lock a folder until the end of the block or of this process, unless it is on a drive without locks."""
    if sys.platform == "win32":
        yield
        return
    descriptor = os.open(staging, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        os.close(descriptor)
        raise BlockingIOError(errno.EAGAIN, "another run makes the same report just now") from None
    except OSError:
        pass
    try:
        yield
    finally:
        os.close(descriptor)


def write_version(folder: Path, figures: str, language: Language, make: Callable[[Path], None]) -> Marker:
    """Write a report of several analyses into its folder, as a new version where its figures changed."""
    restore_earlier(folder, figures)
    refuse_foreign_folder(folder)
    with open_staging(folder) as staging:
        make(staging)
        use_plain_names(staging, language)
        fingerprint, before = hash_file(staging / figures), read_marker(folder, figures)
        version = find_last_version(folder) + 1
        if before is not None:
            version = before.version + (before.fingerprint != fingerprint)
        marker = Marker(fingerprint, version=version, language=language)
        write_marker(staging, marker)
        replace_folder(folder, staging, figures)
    return marker


def find_earlier(folder: Path) -> Path:
    """Give the place next to a folder to which its former contents move."""
    return folder.with_name(f".{folder.name}.earlier")
