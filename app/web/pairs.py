"""Pages of two finished analyses: both arms of one shift, or one day beside an earlier one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Response
from pydantic import BaseModel, Field

from app.api.library.files import respond_with_file
from app.api.pairs import build_pair_download_name
from app.errors import RecordedProblem
from app.jobs.children.pairs import PairedJobs, PairReport
from app.jobs.job import Job
from app.jobs.library.listing import Entry, Library
from app.report.pairs import format_rows, load_pair_words
from app.report.words.wording import fill
from app.request import LONGEST_OFFSET_S, PairKind, PairRequest, ReportRequest
from app.services import Services, UsedServices
from app.web.recording.curves import CurveView, Laid, build_curves
from app.web.rendering import Page, UsedPage
from app.web.reports import lay_way_of_query
from fusion.comparison import FigureChange

DAY = 10  # characters of an ISO date
MOST_TRUNKS = 50
SETTINGS = frozenset({"method", "pose", "metric filter"})

router = APIRouter(include_in_schema=False)

# Which analyses fit together: the other arm of the same day, other days of the same person.


@dataclass(frozen=True, slots=True)
class Offer:
    """A link to a page of two."""

    address: str
    words: str


def find_offers(page: Page, job: Job, start: str) -> tuple[Offer, ...]:
    """Offer a pair where arm and day fit, else a comparison, the earlier first."""
    words, offers = page.words("pair_pages"), []
    for other in Library(page.services.store.reader).find_others(job):
        other_start = _read_start(other)
        facts = {"name": other.job.file_name, "when": _format_start(other_start)}
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


def _format_start(start: str) -> str:
    return start[:16].replace("T", " ")


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


@dataclass(frozen=True, slots=True)
class PairView:
    """Two analyses and, of a pair, the trunk; ``figures`` is None while one person is asked for.

    ``days``: when two visits began; ``differences``: the settings in which they differ; ``changes``: the rows
    of a comparison.
    """

    kind: PairKind
    first: Job
    second: Job
    trunk: Job | None
    offset: str
    trunk_offset: str
    same_subject: bool
    days: tuple[str, str] = ("", "")
    trunks: tuple[Job, ...] = ()
    figures: Mapping[str, Any] | None = None
    sentences: Sequence[str] = ()
    differences: Sequence[str] = ()
    trunk_limit: str = ""
    changes: Sequence[Sequence[str]] = ()
    curves: Sequence[CurveView] = ()


@router.get("/beside/{kind}")
def show_pair(asked: Asked, page: UsedPage) -> Response:
    """Show two analyses side by side; for a pair, with the offset of the clocks to correct.

    Where a subject code is missing, only the question whether all are of one person is shown.
    """
    request, words = asked.request, page.words("pair_pages")
    offset, trunk_offset = (
        "" if offset_s is None else f"{offset_s:g}" for offset_s in (request.offset_s, request.trunk_offset_s)
    )
    ids = (request.kind, asked.first, asked.second, asked.trunk)
    view = PairView(*ids, offset, trunk_offset, request.same_subject)
    try:
        report = _make(page.services, asked)
    except RecordedProblem as problem:
        if problem.facts.get("why") != "person":
            raise
        return page.render("beside.html", view)
    figures = report.read_figures()
    before, after = (
        _format_start(str(figures.get(side, {}).get("start") or "")) for side in ("before", "after")
    )
    view = replace(
        view,
        days=(before, after),
        trunks=_offer_trunks(page.services, asked, figures),
        figures=figures,
        sentences=report.read_sentences(page.language),
        differences=[words["difference"][one] for one in figures.get("differences", ()) if one in SETTINGS],
        trunk_limit=load_pair_words(page.language)["pair"]["trunk"]["limit"],
        changes=format_rows((FigureChange(**row) for row in figures.get("figures", ())), page.language),
        curves=build_curves(page, _lay_curves(page, asked, figures, (before, after))),
    )
    return page.render("beside.html", view)


def _lay_curves(
    page: Page, asked: PairedJobs, figures: Mapping[str, Any], days: tuple[str, str]
) -> tuple[Laid, ...]:
    """Lay a pair, and its trunk, on one clock; two visits by the time of the day."""
    words = page.words("pair_pages")
    if asked.request.kind != "pair":
        before, after = (
            f"{words[name]} · {day}" if day else words[name]
            for name, day in zip(("before", "after"), days, strict=True)
        )
        return ((asked.first, before, None), (asked.second, after, None))
    right_s = figures["clock"]["offset_s"]
    laid: tuple[Laid, ...] = ((asked.first, words["left"], 0.0), (asked.second, words["right"], right_s))
    if asked.trunk is not None:
        laid = (*laid, (asked.trunk, words["trunk"], figures["trunk_clock"]["offset_s"]))
    return laid


@router.get("/beside/{kind}/report.{form}", response_class=Response)
def get_report(form: Literal["html", "pdf"], asked: Asked, page: UsedPage) -> Response:
    """Return the report of two, to read or to file."""
    report = _make(page.services, asked)
    body = report.read(report.find("report", form, page.language))
    if form == "html":
        return lay_way_of_query(page, body.decode(), f"/beside/{asked.request.kind}")
    return respond_with_file(body, "application/pdf", build_pair_download_name(asked, f"{page.language}.pdf"))


@router.post("/beside/compare/align")
def analyse_alike(first: str, second: str, page: UsedPage) -> Response:
    """Analyse the earlier recording by the settings of the later, so that only the work differs."""
    store = page.services.store
    before, after = store.get(first), store.get(second)
    again = store.add_correction(before, align_request(before.request, after.request))
    return page.go(f"/analyses/{again.id}?before={before.id}")


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
    """Offer the recordings that may be of the trunk: same person, same day, neither arm stated.

    The chosen one is always among them.
    """
    if asked.request.kind != "pair":
        return ()
    start = figures["left"].get("start") or ""
    found = [
        other.job
        for other in Library(services.store.reader).find_others(asked.first, MOST_TRUNKS)
        if other.job.request.side is None
        and other.job.recording_id != asked.second.recording_id
        and _read_start(other)[:DAY] == start[:DAY]
    ]
    chosen = (asked.trunk,) if asked.trunk and asked.trunk.id not in {job.id for job in found} else ()
    return (*chosen, *found)
