"""Pages of two: both arms of one shift, one visit beside another."""

import hashlib
import importlib
import json
import secrets
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import FileResponse, RedirectResponse
from pydantic import BaseModel, Field

from app.api.files import borrow_file
from app.api.guard import REPORT_POLICY
from app.errors import Crashed, Interrupted, RecordedProblem
from app.jobs.children.attempt import Attempt, Finished, Refused, Unstarted, choose_limits, run_attempt
from app.jobs.job import Job
from app.jobs.library import Entry, Library
from app.report.pairs import load_beside_words
from app.report.words.wording import Language, fill, load_wording
from app.request import OnStage, ReportRequest
from app.services import Services, UsedLanguage, UsedServices
from app.storage.store import hash_file
from app.version import software_revision
from app.web.rendering import find_base, show_page

# Two finished analyses side by side: made in a child process when first asked for, then kept as a cache.


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
    pairing = importlib.import_module("app.roads.pair")
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


# What an analysis may be set beside: the other arm of the same day, other days of the same person.


DAY = 10  # characters of an ISO date
MOST_TRUNKS = 50


@dataclass(frozen=True, slots=True)
class Offer:
    """A link to a page of two."""

    address: str
    words: str


def list_offers(services: Services, job: Job, start: str, language: Language) -> tuple[Offer, ...]:
    """Offer a pair where arm and day fit, else a comparison, the earlier first."""
    others = Library(services.store.reader).find_others(job)
    return tuple(_offer(job, start, other, language) for other in others)


def list_trunks(services: Services, first: Job, second: Job, start: str) -> tuple[Job, ...]:
    """Give the recordings that may be of the trunk: same person, same day, neither arm stated."""
    others = Library(services.store.reader).find_others(first, MOST_TRUNKS)
    return tuple(
        other.job
        for other in others
        if other.job.request.side is None
        and other.job.recording_id != second.recording_id
        and ((other.headline.start if other.headline else None) or "")[:DAY] == start[:DAY]
    )


def _offer(job: Job, start: str, other: Entry, language: Language) -> Offer:
    other_start = (other.headline.start if other.headline else None) or ""
    facts = {"name": other.job.file_name, "when": other_start[:16].replace("T", " ")}
    words = load_wording(language, "pair_pages")
    if _are_arms(job, start, other.job, other_start):
        first, second = (job, other.job) if job.request.side == "left" else (other.job, job)
        return Offer(f"/beside/pair?first={first.id}&second={second.id}", fill(words["with_pair"], facts))
    first, second = (job, other.job) if start <= other_start else (other.job, job)
    return Offer(f"/beside/compare?first={first.id}&second={second.id}", fill(words["with_compare"], facts))


def _are_arms(job: Job, start: str, other: Job, other_start: str) -> bool:
    sides = {job.request.side, other.request.side}
    return sides == {"left", "right"} and start[:DAY] == other_start[:DAY]


router = APIRouter(include_in_schema=False)
SETTINGS = frozenset({"method", "pose", "metric filter"})


class TrunkWish(BaseModel):
    """Offsets as people type them, and the analysis of the trunk."""

    offset_s: Annotated[str, Field(max_length=20)] = ""
    trunk: Annotated[str, Field(max_length=40)] = ""
    trunk_offset_s: Annotated[str, Field(max_length=20)] = ""


def read_asked(
    kind: Kind, first: str, second: str, services: UsedServices, wish: Annotated[TrunkWish, Query()]
) -> BesideRequest:
    """Read which are asked for; a comparison has neither trunk nor offset."""
    pair = services.store.get(first), services.store.get(second)
    if kind != "pair":
        return BesideRequest(kind, *pair)
    trunk = services.store.get(wish.trunk) if wish.trunk else None
    trunk_offset_s = read_offset(wish.trunk_offset_s) if trunk else None
    return BesideRequest(kind, *pair, read_offset(wish.offset_s), trunk, trunk_offset_s)


Asked = Annotated[BesideRequest, Depends(read_asked)]


@router.get("/beside/{kind}")
def show_beside(asked: Asked, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show two analyses side by side; for a pair, with the offset of the clocks to correct."""
    folder = set_beside(services, asked)
    figures, b = read_figures(folder, asked.kind), load_wording(language, "pair_pages")
    values: dict[str, Any] = {
        "kind": asked.kind,
        "first": asked.first,
        "second": asked.second,
        "trunk": asked.trunk,
        "trunks": _list_trunks(services, asked, figures),
        "figures": figures,
        "sentences": read_sentences(folder, language),
        "differences": [b["difference"][name] for name in figures.get("differences", ()) if name in SETTINGS],
        "offset": _write_offset(asked.offset_s),
        "trunk_offset": _write_offset(asked.trunk_offset_s),
        "trunk_limit": load_beside_words(language)["pair"]["trunk"]["limit"],
        "names": load_beside_words(language)["compare"]["table"]["figure"],
        "b": b,
    }
    return show_page(request, "beside.html", language, values)


@router.get("/beside/{kind}/report.{form}", response_class=FileResponse)
def get_report(
    form: Literal["html", "pdf"], asked: Asked, services: UsedServices, language: UsedLanguage
) -> Response:
    """Give the report of two, to read or to file."""
    path = set_beside(services, asked) / f"report.{language}.{form}"
    if form == "html":
        return FileResponse(path, media_type="text/html", headers={"Content-Security-Policy": REPORT_POLICY})
    return FileResponse(path, media_type="application/pdf", filename=_name(asked, language))


@router.post("/beside/compare/align")
def analyse_alike(first: str, second: str, request: Request, services: UsedServices) -> Response:
    """Analyse the earlier recording by the settings of the later, so that only the work differs."""
    before, after = services.store.get(first), services.store.get(second)
    wish = replace(before.request, method=after.request.method, pose=after.request.pose)
    if len(wish.calibration_windows_s) != len(after.request.calibration_windows_s):
        wish = replace(wish, calibration_windows_s=())
    again = services.store.add_analysis((before.recording_id, before.sha256), wish, "web")
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}?before={before.id}", status_code=303)


def read_offset(text: str) -> float | None:
    """Read seconds as people write them; nothing, and what is no number, leaves it to the clocks."""
    try:
        seconds = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return seconds if abs(seconds) <= 172_800 else None


def _list_trunks(services: Services, asked: BesideRequest, figures: Mapping[str, Any]) -> tuple[Job, ...]:
    """Offer what may be of the trunk; what was chosen is always among it."""
    if asked.kind != "pair":
        return ()
    found = list_trunks(services, asked.first, asked.second, figures["left"].get("start") or "")
    chosen = (asked.trunk,) if asked.trunk and asked.trunk.id not in {job.id for job in found} else ()
    return (*chosen, *found)


def _write_offset(seconds: float | None) -> str:
    return "" if seconds is None else f"{seconds:g}"


def _name(asked: BesideRequest, language: Language) -> str:
    subject = "".join(c for c in asked.first.request.subject if c.isalnum() or c in "-_") or "report"
    return f"{subject}_{asked.kind}.{language}.pdf"
