"""Reports of several finished analyses: made in a child process when first asked for, then kept as a cache.

    folder/<key>/             the files of one report; digests.json holds the SHA-256 of each
    folder/<key>.<hex>.part/  what is being made, with copies of the files that it is made from

Page and API ask here, so that both give the same bytes. A damaged or missing entry is made again. The entries
hold subject codes: a purge removes them all, and a start removes what a crash left half made.
"""

import hashlib
import importlib
import json
import secrets
import shutil
import threading
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from app.errors import RecordedProblem
from app.jobs.children.attempt import Attempt, choose_limits, make_now
from app.jobs.job import Job
from app.jobs.results import ResultReader
from app.report.words.wording import find_nearest
from app.request import Language, OnStage, PairRequest, ProfileRequest, ReportRequest
from app.settings import Settings
from app.storage.permissions import make_folder
from app.storage.store import hash_file
from app.version import software_revision

AT_ONCE = 2
"""Reports of two made at the same time; each child may use the memory of an analysis."""
MOST_KEPT = 200
"""Entries in the cache, of about 1 MB each; the oldest go first."""
NEEDED = ("results.json", "elevation.parquet")
DIGESTS = "digests.json"


def load_and_make_pair(
    sources: tuple[Path, ...],
    asked: PairRequest | ProfileRequest,
    _log: Path,
    _request: ReportRequest,
    out: Path,
    _on_stage: OnStage,
) -> None:
    """Make a report of several in the child process, from the folders of finished analyses."""
    if isinstance(asked, ProfileRequest):
        importlib.import_module("app.roads.pair").make_profile(sources, asked, out)
    else:
        importlib.import_module("app.roads.pair").make_report_of_two(sources, asked, out)


@dataclass(frozen=True, slots=True)
class PairedJobs:
    """The finished analyses of a report of two, in order, and what is asked of them.

    ``trunk`` belongs to a pair only.
    """

    first: Job
    second: Job
    trunk: Job | None
    request: PairRequest

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Every analysis that the report is made from."""
        return tuple(filter(None, (self.first, self.second, self.trunk)))

    def identify(self) -> str:
        """Hash attempts, request and software: the same three give the same report."""
        asked = self.request
        stated = (asked.same_subject, asked.mixed_methods)
        return _identify(self, (asked.offset_s, asked.trunk_offset_s, asked.paper, *stated))


@dataclass(frozen=True, slots=True)
class ProfiledJobs:
    """The finished analyses of several days, those before a change first, and what is asked of them."""

    jobs: tuple[Job, ...]
    request: ProfileRequest

    def identify(self) -> str:
        """Hash attempts, request and software, as :meth:`PairedJobs.identify`."""
        asked = self.request
        return _identify(self, (asked.before_count, asked.paper, asked.same_subject, asked.mixed_methods))


AskedJobs = PairedJobs | ProfiledJobs


def _identify(asked: AskedJobs, choices: tuple[object, ...]) -> str:
    parts = (asked.request.kind, tuple(job.token for job in asked.jobs), *choices, software_revision())
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class PairReport:
    """The files of a report of several analyses, in their folder."""

    folder: Path
    request: PairRequest | ProfileRequest

    def read(self, name: str) -> bytes:
        """Read a file."""
        return (self.folder / name).read_bytes()

    def find(self, stem: str, kind: str, language: Language) -> str:
        """Give the name of the report or the answer: ``report.en.pdf``; in the nearest language made."""
        return f"{stem}.{find_nearest(language, self.request.languages)}.{kind}"

    def read_drawings(self, language: Language) -> list[dict[str, str]]:
        """Read the drawings of several days: title, alternative, note, and both SVGs of each."""
        drawings: list[dict[str, str]] = json.loads(self.read(self.find("drawings", "json", language)))
        return drawings

    def read_figures(self) -> dict[str, Any]:
        """Read the figures as ``pair.json``, ``comparison.json`` or ``profile.json`` holds them."""
        figures: dict[str, Any] = json.loads(self.read(self.request.figures_name))
        return figures

    def read_sentences(self, language: Language) -> list[str]:
        """Read the lines of the answer."""
        return self.read(self.find("answer", "txt", language)).decode("utf-8").splitlines()


@dataclass(frozen=True, slots=True)
class PairReports:
    """Makes reports of two, a few at once, and keeps them in a folder; whoever comes later waits."""

    settings: Settings
    results: ResultReader
    folder: Path
    _turns: threading.BoundedSemaphore = field(default_factory=lambda: threading.BoundedSemaphore(AT_ONCE))
    _publishing: threading.Lock = field(default_factory=threading.Lock)

    def sweep(self) -> None:
        """Remove what a crash left half made; only for the one server of this folder, before it serves."""
        for left in self.folder.glob("*.part"):
            shutil.rmtree(left, ignore_errors=True)

    def forget_all(self) -> None:
        """Remove every report of two; they are made again when asked for."""
        with self._publishing:
            shutil.rmtree(self.folder, ignore_errors=True)

    def make(self, asked: AskedJobs) -> PairReport:
        """Give a report of two, made now unless it is there and whole.

        Raises
        ------
        RecordedProblem, Crashed, Interrupted
            As the child process met them; among the first are E-PAIR and E-DAYS
            (:class:`app.errors.CannotPair`, :class:`app.errors.CannotProfile`).
        NotHere, NotFinished, NoSuchFile, ResultDamaged
            One of the analyses cannot be read.
        """
        report = PairReport(self.folder / asked.identify(), asked.request)
        if not _is_whole(report):
            with self._turns:
                if not _is_whole(report):  # another request may have made it meanwhile
                    self._make(asked, report)
        return report

    def _make(self, asked: AskedJobs, report: PairReport) -> None:
        kept = report.folder
        staging = kept.with_name(f"{kept.name}.{secrets.token_hex(4)}.part")
        out = staging / "out"
        make_folder(self.folder)
        make_folder(staging)
        make_folder(out)
        try:
            sources = tuple(staging / str(number) for number in range(len(asked.jobs)))
            for job, folder in zip(asked.jobs, sources, strict=True):  # as ``acromion run`` makes them
                folder.mkdir()
                for name in NEEDED:
                    with self.results.borrow(job, name) as path:
                        shutil.copyfile(path, folder / name)
            make = partial(load_and_make_pair, sources, asked.request)
            limits = choose_limits(self.settings, sum(job.size_bytes for job in asked.jobs))
            make_now(Attempt(sources[0], ReportRequest(""), out, make, limits))
            digests = {path.name: hash_file(path) for path in out.iterdir()}
            (out / DIGESTS).write_text(json.dumps(digests))
            self._publish(asked, out, kept)
        except (FileNotFoundError, RecordedProblem):  # a purge may have taken the folder away
            self._check_there(asked)
            raise
        finally:
            shutil.rmtree(staging, ignore_errors=True)

    def _publish(self, asked: AskedJobs, out: Path, kept: Path) -> None:
        """Keep what was made, unless one of the analyses was deleted meanwhile."""
        with self._publishing:
            self._check_there(asked)
            shutil.rmtree(kept, ignore_errors=True)
            out.rename(kept)
            entries = [path for path in self.folder.iterdir() if path.suffix != ".part"]
            entries.sort(key=lambda path: path.stat().st_mtime)
            for path in entries[:-MOST_KEPT]:
                shutil.rmtree(path, ignore_errors=True)

    def _check_there(self, asked: AskedJobs) -> None:
        """Raise NotHere where one of the analyses was deleted meanwhile."""
        for job in asked.jobs:
            self.results.store.get(job.id)


def _is_whole(report: PairReport) -> bool:
    """Tell whether every file of an entry is there and has the bytes that were made."""
    try:
        digests = json.loads((report.folder / DIGESTS).read_bytes())
        return all(hash_file(report.folder / name) == sha256 for name, sha256 in digests.items())
    except (OSError, ValueError, AttributeError):
        return False
