"""Pages of two finished analyses: both arms of one shift, or one day beside an earlier one."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response
from fastapi.responses import RedirectResponse
from pydantic import BaseModel, Field

from app.api.library.files import respond_with_file
from app.api.pairs import build_pair_download_name
from app.errors import RecordedProblem
from app.jobs.children.pairs import PairedJobs, PairReport
from app.jobs.job import Job
from app.jobs.library.listing import Entry, Library
from app.report.pairs import format_rows, load_pair_words
from app.report.words.wording import Language, fill, load_wording
from app.request import LONGEST_OFFSET_S, PairKind, PairRequest, ReportRequest
from app.services import Services, UsedLanguage, UsedServices
from app.web.recording.curves import CurveView, Laid, build_curves
from app.web.rendering import find_base, render_page
from app.web.reports import find_way, lay_way
from fusion.comparison import FigureChange

# Which analyses fit together: the other arm of the same day, other days of the same person.


DAY = 10  # characters of an ISO date
MOST_TRUNKS = 50


@dataclass(frozen=True, slots=True)
class Offer:
    """A link to a page of two."""

    address: str
    words: str


def find_offers(services: Services, job: Job, start: str, language: Language) -> tuple[Offer, ...]:
    """Offer a pair where arm and day fit, else a comparison, the earlier first."""
    words, offers = load_wording(language, "pair_pages"), []
    for other in Library(services.store.reader).find_others(job):
        other_start = _read_start(other)
        facts = {"name": other.job.file_name, "when": other_start[:16].replace("T", " ")}
        kind, first, second = "compare", *((job, other.job) if start <= other_start else (other.job, job))
        sides = {job.request.side, other.job.request.side}
        if sides == {"left", "right"} and start[:DAY] == other_start[:DAY]:
            kind = "pair"
            first, second = (job, other.job) if job.request.side == "left" else (other.job, job)
        address = f"/beside/{kind}?first={first.id}&second={second.id}"
        offers.append(Offer(address, fill(words[f"with_{kind}"], facts)))
    return tuple(offers)


def _read_start(entry: Entry) -> str:
    return (entry.headline.start if entry.headline else None) or ""


def find_trunks(services: Services, first: Job, second: Job, start: str) -> tuple[Job, ...]:
    """Give the recordings that may be of the trunk: same person, same day, neither arm stated."""
    others = Library(services.store.reader).find_others(first, MOST_TRUNKS)
    return tuple(
        other.job
        for other in others
        if other.job.request.side is None
        and other.job.recording_id != second.recording_id
        and _read_start(other)[:DAY] == start[:DAY]
    )


router = APIRouter(include_in_schema=False)
SETTINGS = frozenset({"method", "pose", "metric filter"})


class PairQuery(BaseModel):
    """Offsets as people type them, the analysis of the trunk, and whether all are of one person."""

    offset_s: Annotated[str, Field(max_length=20)] = ""
    trunk: Annotated[str, Field(max_length=40)] = ""
    trunk_offset_s: Annotated[str, Field(max_length=20)] = ""
    same_subject: bool = False


def find_asked(
    kind: PairKind, first: str, second: str, services: UsedServices, query: Annotated[PairQuery, Query()]
) -> PairedJobs:
    """Find the analyses that an address names; a comparison has neither trunk nor offset."""
    one, other = services.store.get(first), services.store.get(second)
    paper = one.request.paper
    if kind != "pair":
        request = PairRequest(kind, paper=paper, same_subject=query.same_subject)
        return PairedJobs(one, other, None, request)
    trunk = services.store.get(query.trunk) if query.trunk else None
    trunk_offset_s = parse_offset(query.trunk_offset_s) if trunk else None
    offsets_s = (parse_offset(query.offset_s), trunk_offset_s)
    request = PairRequest(kind, *offsets_s, paper=paper, same_subject=query.same_subject)
    return PairedJobs(one, other, trunk, request)


Asked = Annotated[PairedJobs, Depends(find_asked)]


@router.get("/beside/{kind}")
def show_pair(asked: Asked, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show two analyses side by side; for a pair, with the offset of the clocks to correct.

    Where a subject code is missing, only the question whether all are of one person is shown.
    """
    kind, b = asked.request.kind, load_wording(language, "pair_pages")
    values: dict[str, Any] = {
        "kind": kind,
        "first": asked.first,
        "second": asked.second,
        "trunk": asked.trunk,
        "offset": _format_offset(asked.request.offset_s),
        "trunk_offset": _format_offset(asked.request.trunk_offset_s),
        "same_subject": asked.request.same_subject,
        "days": ("", ""),
        "figures": None,
        "curves": None,
        "b": b,
    }
    try:
        report = _make(services, asked)
    except RecordedProblem as problem:
        if problem.facts.get("why") != "person":
            raise
        return render_page(request, "beside.html", language, values)
    figures = report.read_figures()
    values |= {
        "trunks": _offer_trunks(services, asked, figures),
        "figures": figures,
        "sentences": report.read_sentences(language),
        "differences": [b["difference"][name] for name in figures.get("differences", ()) if name in SETTINGS],
        "trunk_limit": load_pair_words(language)["pair"]["trunk"]["limit"],
        "days": _name_days(figures),
        "changes": format_rows((FigureChange(**row) for row in figures.get("figures", ())), language),
        "curves": _build_curves(services, asked, figures, language, find_base(request)),
        "d": load_wording(language, "day"),
    }
    return render_page(request, "beside.html", language, values)


def _build_curves(
    services: Services, asked: PairedJobs, figures: Mapping[str, Any], language: Language, base: str
) -> tuple[CurveView, ...]:
    """Build the curves: of a pair, and its trunk, on one clock; of two visits by the time of the day."""
    b = load_wording(language, "pair_pages")
    before, after = (
        f"{b[name]} · {day}" if day else b[name]
        for name, day in zip(("before", "after"), _name_days(figures), strict=True)
    )
    laid: tuple[Laid, ...] = ((asked.first, before, None), (asked.second, after, None))
    if asked.request.kind == "pair":
        laid = ((asked.first, b["left"], 0.0), (asked.second, b["right"], figures["clock"]["offset_s"]))
    if asked.trunk is not None:
        laid = (*laid, (asked.trunk, b["trunk"], figures["trunk_clock"]["offset_s"]))
    return build_curves(services, laid, base)


@router.get("/beside/{kind}/report.{form}", response_class=Response)
def get_report(
    form: Literal["html", "pdf"],
    asked: Asked,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
) -> Response:
    """Give the report of two, to read or to file."""
    report = _make(services, asked)
    body = report.read(report.find("report", form, language))
    if form == "html":
        place = f"{find_base(request)}/beside/{asked.request.kind}"
        return lay_way(body.decode(), find_way(place, request), request, language)
    return respond_with_file(body, "application/pdf", build_pair_download_name(asked, f"{language}.pdf"))


@router.post("/beside/compare/align")
def analyse_alike(first: str, second: str, request: Request, services: UsedServices) -> Response:
    """Analyse the earlier recording by the settings of the later, so that only the work differs."""
    before, after = services.store.get(first), services.store.get(second)
    asked = align_request(before.request, after.request)
    again = services.store.add_correction(before, asked)
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}?before={before.id}", status_code=303)


def align_request(before: ReportRequest, after: ReportRequest) -> ReportRequest:
    """Ask of the earlier recording what was asked of the later; windows that no longer fit are dropped."""
    asked = replace(before, method=after.method, pose=after.pose, arm_axis=after.arm_axis)
    is_other_pose = asked.pose != before.pose and "two-point" in {asked.pose, before.pose}
    return replace(asked, calibration_windows_s=()) if asked.arm_axis or is_other_pose else asked


def parse_offset(text: str) -> float | None:
    """Read seconds as people write them; None, where it is no number, leaves the offset to the clocks."""
    try:
        offset_s = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return offset_s if abs(offset_s) <= LONGEST_OFFSET_S else None


def _make(services: Services, asked: PairedJobs) -> PairReport:
    """Make the report of two; where methods differ, too, for the page says so and offers to analyse alike."""
    try:
        return services.pairs.make(asked)
    except RecordedProblem as problem:
        if problem.facts.get("why") != "methods":
            raise
    return services.pairs.make(replace(asked, request=replace(asked.request, mixed_methods=True)))


def _offer_trunks(services: Services, asked: PairedJobs, figures: Mapping[str, Any]) -> tuple[Job, ...]:
    """Offer the recordings that may be of the trunk; the chosen one is always among them."""
    if asked.request.kind != "pair":
        return ()
    found = find_trunks(services, asked.first, asked.second, figures["left"].get("start") or "")
    chosen = (asked.trunk,) if asked.trunk and asked.trunk.id not in {job.id for job in found} else ()
    return (*chosen, *found)


def _name_days(figures: Mapping[str, Any]) -> tuple[str, str]:
    """Name two visits by when they began; empty without a clock, and for a pair, which its arms name."""
    before, after = (
        str(figures.get(side, {}).get("start") or "")[:16].replace("T", " ") for side in ("before", "after")
    )
    return before, after


def _format_offset(offset_s: float | None) -> str:
    return "" if offset_s is None else f"{offset_s:g}"
