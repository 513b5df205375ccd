"""Reports on several finished analyses: made in a child process at the first request, then cached.

 folder/<key>/             the files of one report; digests.json contains the SHA-256 of each
 folder/<key>.<hex>.part/  a report in progress, with copies of its source files

Page and API both use this module, so that they return the same bytes. A damaged or missing entry is made
again. The entries contain subject codes: a purge removes them all, and a start removes incomplete ones.
"""

import hashlib
import importlib
import json
import secrets
import shutil
import threading
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Generic, TypeVar

from acromion.app.analysis.attempt import Attempt, choose_limits, run_and_wait
from acromion.app.errors import RecordedProblem
from acromion.app.library.results import ResultReader
from acromion.app.library.rows import Job
from acromion.app.report.words.wording import find_nearest
from acromion.app.request import Language, OnStage, PairRequest, ProfileRequest, ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import hash_file
from acromion.app.store.permissions import make_folder
from acromion.app.version import source_fingerprint

AT_ONCE = 2
"""Maximum number of simultaneous child processes; each may use the memory of an analysis."""
MOST_KEPT = 200
"""Maximum number of cache entries, of about 1 MB each; the oldest are removed first."""
NEEDED = ("results.json", "elevation.parquet")
DIGESTS = "digests.json"


def load_and_make_pair(
    sources: tuple[Path, ...],
    asked: PairRequest | ProfileRequest,
    _recording_path: Path,
    _request: ReportRequest,
    out: Path,
    _on_stage: OnStage,
) -> None:
    """Make a report on several analyses in the child process, from the folders of finished analyses."""
    pair = importlib.import_module("acromion.app.analysis.pair")
    make = pair.make_profile if isinstance(asked, ProfileRequest) else pair.make_report_of_two
    make(sources, asked, out)


Asked_co = TypeVar("Asked_co", bound=PairRequest | ProfileRequest, covariant=True)


@dataclass(frozen=True, slots=True)
class ReportJobs(Generic[Asked_co]):
    """The finished analyses of a report on several, in order, and the request.

    For a pair: left, right and optionally trunk. For several days: those before a change first.
    """

    jobs: tuple[Job, ...]
    request: Asked_co

    def identify(self) -> str:
        """Return a hash of attempts, request and software: the same three give the same report."""
        tokens = [job.token for job in self.jobs]
        parts = (self.request.kind, asdict(self.request), tokens, source_fingerprint())
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]


AnyReportJobs = ReportJobs[PairRequest | ProfileRequest]


@dataclass(frozen=True, slots=True)
class PairReport:
    """The files of a report on several analyses, in their folder."""

    folder: Path
    request: PairRequest | ProfileRequest

    def read(self, name: str) -> bytes:
        """Return the content of a file."""
        return (self.folder / name).read_bytes()

    def find(self, stem: str, kind: str, language: Language) -> str:
        """Return the file name of report or answer in the nearest available language: ``report.en.pdf``."""
        return f"{stem}.{find_nearest(language, self.request.languages)}.{kind}"

    def read_drawings(self, language: Language) -> list[dict[str, str]]:
        """Return the charts of several days: title, alternative, note, and both SVGs of each."""
        drawings: list[dict[str, str]] = json.loads(self.read(self.find("drawings", "json", language)))
        return drawings

    def read_figures(self) -> dict[str, Any]:
        """Return the figures from ``pair.json``, ``comparison.json`` or ``profile.json``."""
        figures: dict[str, Any] = json.loads(self.read(self.request.figures_name))
        return figures

    def read_sentences(self, language: Language) -> list[str]:
        """Return the lines of the answer."""
        return self.read(self.find("answer", "txt", language)).decode("utf-8").splitlines()


@dataclass(frozen=True, slots=True)
class PairReports:
    """Makes reports on several analyses, a few at once, and caches them; further callers wait."""

    settings: Settings
    results: ResultReader
    folder: Path
    _turns: threading.BoundedSemaphore = field(default_factory=lambda: threading.BoundedSemaphore(AT_ONCE))
    _publishing: threading.Lock = field(default_factory=threading.Lock)

    def sweep(self) -> None:
        """Remove what a crash left incomplete; only for the one server of this folder, before it serves."""
        for left in self.folder.glob("*.part"):
            shutil.rmtree(left, ignore_errors=True)

    def forget_all(self) -> None:
        """Remove every cached report; they are made again on request."""
        with self._publishing:
            shutil.rmtree(self.folder, ignore_errors=True)

    def make(self, asked: AnyReportJobs) -> PairReport:
        """Return a report on several analyses, from the cache if it is intact.

        Raises RecordedProblem (E-PAIR, E-COMPARE, E-DAYS), Crashed or Interrupted from the child process.
        Raises NotHere, NotFinished, NoSuchFile or ResultDamaged if one of the analyses cannot be read.
        """
        report = PairReport(self.folder / asked.identify(), asked.request)
        if not _is_whole(report):
            with self._turns:
                if not _is_whole(report):  # another request may have made it meanwhile
                    self._make(asked, report)
        return report

    def _make(self, asked: AnyReportJobs, report: PairReport) -> None:
        kept = report.folder
        staging = kept.with_name(f"{kept.name}.{secrets.token_hex(4)}.part")
        out = staging / "out"
        make_folder(self.folder)
        make_folder(staging)
        make_folder(out)
        try:
            sources = tuple(staging / str(number) for number in range(len(asked.jobs)))
            for job, folder in zip(asked.jobs, sources, strict=True):  # named as ``acromion run`` names them
                folder.mkdir()
                for name in NEEDED:
                    with self.results.borrow(job, name) as path:
                        shutil.copyfile(path, folder / name)
            make = partial(load_and_make_pair, sources, asked.request)
            limits = choose_limits(self.settings, sum(job.size_bytes for job in asked.jobs))
            run_and_wait(Attempt(sources[0], ReportRequest(""), out, make, limits))
            digests = {path.name: hash_file(path) for path in out.iterdir()}
            (out / DIGESTS).write_text(json.dumps(digests))
            self._publish(asked, out, kept)
        except (FileNotFoundError, RecordedProblem):  # a purge may have removed the folder
            self._check_there(asked)
            raise
        finally:
            shutil.rmtree(staging, ignore_errors=True)

    def _publish(self, asked: AnyReportJobs, out: Path, kept: Path) -> None:
        """Keep the new report, unless one of the analyses was deleted meanwhile."""
        with self._publishing:
            self._check_there(asked)
            shutil.rmtree(kept, ignore_errors=True)
            out.rename(kept)
            entries = [path for path in self.folder.iterdir() if path.suffix != ".part"]
            entries.sort(key=lambda path: path.stat().st_mtime)
            for path in entries[:-MOST_KEPT]:
                shutil.rmtree(path, ignore_errors=True)

    def _check_there(self, asked: AnyReportJobs) -> None:
        """Raise NotHere if one of the analyses was deleted meanwhile."""
        for job in asked.jobs:
            self.results.store.get(job.id)


def _is_whole(report: PairReport) -> bool:
    """Return whether every file of an entry exists and is unchanged."""
    try:
        digests = json.loads((report.folder / DIGESTS).read_bytes())
        return all(hash_file(report.folder / name) == sha256 for name, sha256 in digests.items())
    except (OSError, ValueError, AttributeError):
        return False
