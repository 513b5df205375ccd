"""Two finished analyses side by side: made in a child process when first asked for, then kept as a cache."""

import hashlib
import importlib
import json
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

from app.api.results import borrow_file
from app.api.services import Services
from app.errors import Crashed, Interrupted, RecordedProblem
from app.jobs.attempt import Attempt, Finished, Refused, Unstarted, choose_limits, run_attempt
from app.jobs.job import Job
from app.report.wording import Language
from app.request import OnStage, ReportRequest
from app.storage import hash_file
from app.version import software_revision

Kind = Literal["pair", "compare"]
NEEDED = ("results.json", "findings.json", "elevation.parquet")
SEAL = "seal.json"
FIGURES: Mapping[Kind, str] = {"pair": "pair.json", "compare": "comparison.json"}


@dataclass(frozen=True, slots=True)
class BesideRequest:
    """Which two, in which order, and the trunk of a pair; offsets, seconds after the first, as a person
    corrected them, None as the clocks say.
    """

    kind: Kind
    first: Job
    second: Job
    offset_s: float | None = None
    trunk: Job | None = None
    trunk_offset_s: float | None = None

    @property
    def jobs(self) -> tuple[Job, ...]:
        """Every analysis that it is made of."""
        return tuple(filter(None, (self.first, self.second, self.trunk)))

    def key(self) -> str:
        """Name what comes of it: the same two attempts and the same software give the same report."""
        tokens = tuple(job.token for job in self.jobs)
        parts = (self.kind, tokens, self.offset_s, self.trunk_offset_s, software_revision())
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]


def load_and_set_beside(
    folders: tuple[Path, ...],
    offsets_s: tuple[float | None, float | None],
    kind: Kind,
    _log: Path,
    request: ReportRequest,
    out: Path,
    _on_stage: OnStage,
) -> None:
    """Be the child's part: both roads start from the folders of finished analyses."""
    pairing = importlib.import_module("app.pairing")
    make = pairing.make_pair_report if kind == "pair" else pairing.make_comparison_report
    first, second, *trunk = folders
    offset_s, trunk_offset_s = offsets_s
    body, paper = trunk[0] if trunk else None, request.paper
    asked = pairing.PairRequest(body, offset_s, trunk_offset_s, request.languages, paper=paper)
    make(first, second, asked, out)


def set_beside(services: Services, asked: BesideRequest) -> Path:
    """Give the folder of the report of two, made now if it is not there or no longer what was made.

    Raises
    ------
    RecordedProblem, NotFinished, NoSuchFile, ResultDamaged
    """
    kept = services.settings.data_dir / "cache" / "beside" / asked.key()
    if _is_whole(kept):
        return kept
    staging = kept.with_name(f"{kept.name}.{secrets.token_hex(4)}.part")
    staging.mkdir(parents=True)
    try:
        with ExitStack() as lent:
            folders = tuple(lent.enter_context(_borrow_folder(services, job)) for job in asked.jobs)
            _make(services, asked, folders, staging)
        if not _is_whole(kept):
            shutil.rmtree(kept, ignore_errors=True)
            staging.rename(kept)
    finally:
        shutil.rmtree(staging, ignore_errors=True)
    return kept


def read_figures(folder: Path, kind: Kind) -> dict[str, Any]:
    """Read what was computed."""
    figures: dict[str, Any] = json.loads((folder / FIGURES[kind]).read_bytes())
    return figures


def read_sentences(folder: Path, language: Language) -> list[str]:
    """Read the answer in plain words."""
    return (folder / f"answer.{language}.txt").read_text("utf-8").splitlines()


def _make(services: Services, asked: BesideRequest, folders: tuple[Path, ...], out: Path) -> None:
    make = partial(load_and_set_beside, folders, (asked.offset_s, asked.trunk_offset_s), asked.kind)
    limits = choose_limits(services.settings, sum(job.size_bytes for job in asked.jobs))
    request = ReportRequest("", paper=asked.first.request.paper)
    attempt = Attempt(folders[0], request, out, make, limits)
    outcome: Finished | Refused | Any = run_attempt(attempt, lambda *_: True)
    if isinstance(outcome, Refused):
        raise RecordedProblem(outcome.code, outcome.facts)
    if not isinstance(outcome, Finished):
        raise Interrupted if isinstance(outcome, Unstarted) else Crashed(attempts=1)
    (out / SEAL).write_text(json.dumps({file.name: file.sha256 for file in outcome.files}))


def _is_whole(kept: Path) -> bool:
    """Tell whether every file of a report of two is there and is what was made."""
    try:
        sealed: dict[str, str] = json.loads((kept / SEAL).read_bytes())
        return all(hash_file(kept / name) == sha256 for name, sha256 in sealed.items())
    except (OSError, ValueError):
        return False


@contextmanager
def _borrow_folder(services: Services, job: Job) -> Iterator[Path]:
    """Lend what a report of two is made from, as it stands in a folder that ``acromion run`` made."""
    with tempfile.TemporaryDirectory(dir=services.settings.data_dir / "cache") as folder:
        for name in NEEDED:
            with borrow_file(services, job, name) as path:
                shutil.copyfile(path, Path(folder) / name)
        yield Path(folder)
