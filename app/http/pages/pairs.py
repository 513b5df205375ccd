"""Pages of several analyses: both arms of one shift, two days compared, many days.

Many days can be of one person, of both arms or of a group, before and after a change.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import date
from typing import Annotated, Any, Literal
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query, Response
from markupsafe import Markup
from pydantic import BaseModel, Field

from acromion.app.errors import CannotProfile, RecordedProblem
from acromion.app.http.api.library.files import respond_with_file
from acromion.app.http.api.pairs import MAX_DAYS, build_pair_download_name, get_asked_jobs
from acromion.app.http.pages.recording.page_one import PlacedCurve, build_curves
from acromion.app.http.pages.rendering import Page, UsedPage, add_navigation_of_query
from acromion.app.library.listing import Entry, HeadlineFigures, Library, LibraryFilter, find_other_arm
from acromion.app.library.report_cache import AnyReportJobs, PairReport, ReportJobs
from acromion.app.library.rows import Job
from acromion.app.report.pairs import format_rounding_note, format_rows, load_pair_words
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.numbers import format_iso_moment, format_percent
from acromion.app.report.words.wording import fill, load_wording
from acromion.app.request import (
    LONGEST_OFFSET_S,
    LONGEST_SUBJECT,
    PairClockSource,
    PairKind,
    PairRequest,
    ProfileRequest,
    ReportRequest,
)
from acromion.app.services import Services, UsedServices
from acromion.fusion.comparison.change import FigureChange

DAY = 10  # characters of an ISO date
MAX_COMPARED = 5
SETTINGS = frozenset({"method", "pose", "metric filter"})
UNRELATED = frozenset(
    {"offset", "apart", "no movement stored", "little shared movement", "two shifts", "loose match"}
)
"""Reasons of E-PAIR that another source of the clocks can remove."""

router = APIRouter(include_in_schema=False)

# Related analyses: the other arm on the same day, other days of the same person.


@dataclass(frozen=True, slots=True)
class Offer:
    """A link to a page of two analyses."""

    address: str
    words: str


@dataclass(frozen=True, slots=True)
class Offers:
    """Links from a recording to its person: the other arm of its shift, other days, everything."""

    pair: Offer | None
    days: tuple[Offer, ...]
    person: str


def build_offers(page: Page, job: Job, results: Mapping[str, Any]) -> Offers | None:
    """Return the related analyses of a report; None if its person has no other.

    Comparisons put the earlier recording first.
    """
    words, start = page.words("pair_pages"), results.get("recording", {}).get("start") or ""
    headline = HeadlineFigures("", start, results["time"]["recorded_s"], None)
    others = Library(page.services.store.reader).find_others(job)
    twin, days = find_other_arm(Entry(job, headline), others), []
    for other in [other for other in others if other is not twin][:MAX_COMPARED]:
        earlier, later = (job, other.job) if start <= _read_start(other) else (other.job, job)
        address = f"/beside/compare?first={earlier.id}&second={later.id}"
        days.append(Offer(address, fill(words["with_compare"], _name_other(page, other))))
    pair = None
    if twin is not None:
        told = fill(words[f"with_{twin.job.request.side}"], _name_other(page, twin))
        pair = Offer(build_pair_address(job, twin.job), told)
    return (
        Offers(pair, tuple(days), f"/person?{urlencode({'subject': job.request.subject})}")
        if others
        else None
    )


def _name_other(page: Page, other: Entry) -> dict[str, str]:
    when = format_iso_moment(_read_start(other), page.language)
    return {"name": other.job.file_name, "when": when}


def build_pair_address(one: Job, other: Job) -> str:
    """Return the address of the page of both arms."""
    left, right = (one, other) if one.request.side == "left" else (other, one)
    return f"/beside/pair?first={left.id}&second={right.id}"


def _read_start(entry: Entry) -> str:
    return (entry.headline.start if entry.headline else None) or ""


class PairQuery(BaseModel):
    """Offsets as typed, the analysis of the trunk, and whether all are of one person."""

    offset_s: Annotated[str, Field(max_length=20)] = ""
    trunk: Annotated[str, Field(max_length=40)] = ""
    trunk_offset_s: Annotated[str, Field(max_length=20)] = ""
    clock: PairClockSource = "devices"
    same_subject: bool = False


def get_asked_pair(
    kind: PairKind, first: str, second: str, services: UsedServices, query: Annotated[PairQuery, Query()]
) -> ReportJobs[PairRequest]:
    """Return the analyses in an address; a comparison has neither trunk nor offset."""
    trunk = ""
    offsets_s: tuple[float | None, float | None] = (None, None)
    if kind == "pair":
        trunk, trunk_offset_s = query.trunk, parse_offset(query.trunk_offset_s) if query.trunk else None
        offsets_s = (parse_offset(query.offset_s), trunk_offset_s)
    clock = query.clock if kind == "pair" else "devices"
    request = PairRequest(kind, *offsets_s, same_subject=query.same_subject, clock=clock)
    return get_asked_jobs(services, (first, second, *filter(None, [trunk])), request)


AskedPair = Annotated[ReportJobs[PairRequest], Depends(get_asked_pair)]


@router.get("/beside/{kind}")
def show_pair(asked: AskedPair, page: UsedPage) -> Response:
    """Show two analyses side by side; for a pair, with a form to correct the clock offset.

    If a subject code is missing, only the question whether all are of one person is shown. If the clocks are
    not related, only the reason and the form are shown.
    """
    request, words = asked.request, page.words("pair_pages")
    offset, trunk_offset = (
        "" if offset_s is None else f"{offset_s:g}" for offset_s in (request.offset_s, request.trunk_offset_s)
    )
    first, second, *trunk = asked.jobs
    shown: dict[str, Any] = {"kind": request.kind, "first": first, "second": second}
    shown |= {"trunk": next(iter(trunk), None), "offset": offset, "trunk_offset": trunk_offset}
    shown |= {
        "same_subject": request.same_subject,
        "clock": request.clock,
        "problem": None,
        "days": ("", ""),
        "figures": None,
        "trunk_limit": "",
        "rounding": "",
    }
    shown |= dict.fromkeys(("trunks", "sentences", "differences", "changes", "curves"), ())
    try:
        report = _make(page.services, asked)
    except RecordedProblem as problem:
        why = problem.facts.get("why")
        if why in UNRELATED:
            shown["problem"] = describe_problem(problem.code, problem.facts, page.language)
        elif why != "person":
            raise
        return page.render("pairs/beside.html", **shown)
    figures = report.read_figures()
    before, after = (
        format_iso_moment(str(figures.get(side, {}).get("start") or ""), page.language)
        for side in ("before", "after")
    )
    changes = format_rows((FigureChange(**row) for row in figures.get("figures", ())), page.language)
    told = load_pair_words(page.language)["pair"]["trunk"]
    shown |= {
        "days": (before, after),
        "trunks": _offer_trunks(page.services, asked, figures),
        "figures": figures,
        "sentences": report.read_sentences(page.language),
        "differences": [
            words["difference"][one] for one in figures.get("differences", ()) if one in SETTINGS
        ],
        "trunk_limit": f"{told['limit']} {told['no_range']}",
        "changes": changes,
        "rounding": format_rounding_note(changes, page.language),
        "curves": build_curves(page, _place_curves(page, asked, figures, (before, after))),
    }
    return page.render("pairs/beside.html", **shown)


def _place_curves(
    page: Page, asked: ReportJobs[PairRequest], figures: Mapping[str, Any], days: tuple[str, str]
) -> tuple[PlacedCurve, ...]:
    """Place a pair and its trunk on one clock; place two visits by the time of day."""
    words = page.words("pair_pages")
    if asked.request.kind != "pair":
        before, after = (
            f"{words[name]} · {day}" if day else words[name]
            for name, day in zip(("before", "after"), days, strict=True)
        )
        return ((asked.jobs[0], before, None), (asked.jobs[1], after, None))
    names = (words["left"], words["right"], words["trunk"])
    clocks = ({"offset_s": 0.0}, figures["clock"], figures["trunk_clock"])
    return tuple(
        (job, name, clock["offset_s"]) for job, name, clock in zip(asked.jobs, names, clocks, strict=False)
    )


@router.get("/beside/{kind}/report.{form}", response_class=Response)
def get_report(form: Literal["html", "pdf"], asked: AskedPair, page: UsedPage) -> Response:
    """Return the report of two analyses, as a page or a PDF."""
    return _respond_with_report(page, asked, _make(page.services, asked), form)


def _respond_with_report(page: Page, asked: AnyReportJobs, report: PairReport, form: str) -> Response:
    body, kind = report.read(report.find("report", form, page.language)), asked.request.kind
    if form == "html":
        return add_navigation_of_query(
            page, body.decode(), "/days" if kind == "profile" else f"/beside/{kind}"
        )
    return respond_with_file(body, "application/pdf", build_pair_download_name(asked, f"{page.language}.pdf"))


@router.post("/beside/compare/align")
def analyse_alike(first: str, second: str, page: UsedPage) -> Response:
    """Analyse the earlier recording with the settings of the later, so that only the work differs."""
    store = page.services.store
    before, after = store.get(first), store.get(second)
    again = store.add_correction(before, align_request(before.request, after.request))
    return page.go(f"/analyses/{again.id}?before={before.id}")


def align_request(before: ReportRequest, after: ReportRequest) -> ReportRequest:
    """Copy the later request's settings to the earlier one; drop windows that no longer fit the pose."""
    asked = replace(before, method=after.method, pose=after.pose, arm_axis=after.arm_axis)
    is_other_pose = asked.pose != before.pose and "two-point" in {asked.pose, before.pose}
    return replace(asked, calibration_windows_s=()) if asked.arm_axis or is_other_pose else asked


def parse_offset(text: str) -> float | None:
    """Parse seconds as typed; None if it is not a number, so that the clocks determine the offset."""
    try:
        offset_s = float(text.strip().replace(",", "."))
    except ValueError:
        return None
    return offset_s if abs(offset_s) <= LONGEST_OFFSET_S else None


def _make(services: Services, asked: ReportJobs[PairRequest]) -> PairReport:
    """Build the report of two analyses, even if methods differ; the page then offers to use one method."""
    try:
        return services.pairs.make(asked)
    except RecordedProblem as problem:
        if problem.facts.get("why") != "methods":
            raise
    return services.pairs.make(replace(asked, request=replace(asked.request, mixed_methods=True)))


def _offer_trunks(
    services: Services, asked: ReportJobs[PairRequest], figures: Mapping[str, Any]
) -> tuple[Job, ...]:
    """Return recordings of the trunk: same person, same day.

    The selected one is always included.
    """
    if asked.request.kind != "pair":
        return ()
    start = figures["left"].get("start") or ""
    found = [
        other.job
        for other in Library(services.store.reader).find_others(asked.jobs[0])
        if other.job.request.side == "trunk"
        and other.job.recording_id != asked.jobs[1].recording_id
        and _read_start(other)[:DAY] == start[:DAY]
    ]
    known = {job.id for job in found}
    return (*(trunk for trunk in asked.jobs[2:] if trunk.id not in known), *found)


# Several days.


class DaysQuery(BaseModel):
    """The analyses of the days, those after a change separately, and the person's statements about them.

    ``study`` or ``subject`` selects every report of a study or a person; from the day ``since`` on they count
    as after the change.
    """

    analysis: Annotated[list[str], Field(max_length=MAX_DAYS)] = []
    after: Annotated[list[str], Field(max_length=MAX_DAYS)] = []
    study: Annotated[str, Field(max_length=40)] = ""
    subject: Annotated[str, Field(max_length=LONGEST_SUBJECT)] = ""
    since: date | Literal[""] = ""
    same_subject: bool = False
    mixed_methods: bool = False


def get_asked_days(
    services: UsedServices, query: Annotated[DaysQuery, Query()]
) -> ReportJobs[ProfileRequest]:
    """Return the analyses in an address; an analysis on both sides counts as after the change."""
    if query.study or query.subject:
        first, after = _find_placed(services, query)
    else:
        ids = dict.fromkeys(query.after)
        first = [services.store.get(one) for one in dict.fromkeys(query.analysis) if one not in ids]
        after = [services.store.get(one) for one in ids]
    jobs = (*first, *after)
    if not jobs:
        raise CannotProfile(why="one")
    request = ProfileRequest(
        len(first) if after and first else None,
        paper=jobs[0].request.paper,
        same_subject=query.same_subject,
        mixed_methods=query.mixed_methods,
        has_drawings=True,
    )
    return ReportJobs(jobs, request)


def _find_placed(services: Services, query: DaysQuery) -> tuple[list[Job], list[Job]]:
    """Return the reports of a study or person before and after a change.

    Those without a clock are on neither side. If an arm is stated for some reports of a person, those without
    one are left out.
    """
    study = services.batches.get(query.study).id if query.study else ""
    wanted = LibraryFilter(batch=study, subject=query.subject)
    placed = [
        (entry.job, entry.headline.start or "")
        for entry in Library(services.store.reader).find_page(wanted, 2 * MAX_DAYS)
        if entry.headline and entry.job.request.reference is None
    ]
    placed = [one for one in placed if one[0].request.side != "trunk"]
    if query.subject:
        placed = [one for one in placed if one[0].request.side] or placed
    if not query.since:
        return [job for job, _ in placed], []
    since = query.since.isoformat()
    before = [job for job, start in placed if start and start < since]
    return before, [job for job, start in placed if start >= since]


AskedDays = Annotated[ReportJobs[ProfileRequest], Depends(get_asked_days)]


@dataclass(frozen=True, slots=True)
class Choice:
    """A recording in the form; it may be chosen as a day, or as a day after the change."""

    id: str
    name: str
    when: str
    side: str
    above_60: str
    is_chosen: bool
    is_after: bool


@router.get("/days")
def show_days(asked: AskedDays, page: UsedPage) -> Response:
    """Show several days overlaid, with a form to select from the person's recordings."""
    try:
        made = page.services.pairs.make(asked)
    except RecordedProblem as refused:
        if refused.code != CannotProfile.code:
            raise
        problem = describe_problem(refused.code, refused.facts, page.language)
        shown: dict[str, Any] = {"problem": problem, "sentences": (), "drawings": (), "figures": {}}
    else:
        drawings = [
            {**chart, "wide": Markup(chart["wide"]), "narrow": Markup(chart["narrow"])}  # noqa: S704  our own SVG
            for chart in made.read_drawings(page.language)
        ]
        sentences, figures = made.read_sentences(page.language), made.read_figures()
        shown = {"problem": None, "sentences": sentences, "drawings": drawings, "figures": figures}
    choices, query = _list_choices(page, asked), page.request.url.query
    return page.render("pairs/days.html", query=query, asked=asked.request, choices=choices, **shown)


@router.get("/days/report.{form}", response_class=Response)
def get_days_report(form: Literal["html", "pdf"], asked: AskedDays, page: UsedPage) -> Response:
    """Return the report of several days, as a page or a PDF."""
    return _respond_with_report(page, asked, page.services.pairs.make(asked), form)


@router.get("/days/{name}.csv", response_class=Response)
def get_days_table(name: Literal["profile", "overlay"], asked: AskedDays, services: UsedServices) -> Response:
    """Return a row per day, or per quarter hour of the clock."""
    body = services.pairs.make(asked).read(f"{name}.csv")
    return respond_with_file(body, "text/csv", build_pair_download_name(asked, f"{name}.csv"))


def _list_choices(page: Page, asked: ReportJobs[ProfileRequest]) -> tuple[Choice, ...]:
    """List the selected recordings and the others of the same people.

    A recording without a subject code has no others.
    """
    library, sides = Library(page.services.store.reader), load_wording(page.language)["side"]
    found: dict[tuple[str, str], Entry] = {}
    for job in {job.request.subject: job for job in asked.jobs}.values():
        every = library.find_others(replace(job, recording_id=""))  # including its own
        found |= {(entry.job.recording_id, entry.job.request.shift): entry for entry in every}
    for job in asked.jobs:
        place = (job.recording_id, job.request.shift)
        known = found.get(place)
        found[place] = Entry(job, known.headline if known else None)
    chosen, count = [job.id for job in asked.jobs], asked.request.before_count
    after = set(chosen[count:]) if count is not None else set()
    listed = []
    for entry in sorted(
        found.values(), key=lambda entry: (_read_start(entry), sides[entry.job.request.side or "unknown"])
    ):
        job, above_60 = entry.job, entry.headline.above_60_percent if entry.headline else None
        listed.append(
            Choice(
                job.id,
                job.file_name,
                format_iso_moment(_read_start(entry), page.language),
                sides[job.request.side or "unknown"],
                format_percent(above_60, page.language),
                job.id in chosen and job.id not in after,
                job.id in after,
            )
        )
    return tuple(listed)
