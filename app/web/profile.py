"""The page of several days: of one person, of both arms, of a group, before and after a change."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import date
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Request, Response
from markupsafe import Markup
from pydantic import BaseModel, Field

from app.api.library.files import respond_with_file
from app.api.pairs import MOST_DAYS, build_pair_download_name
from app.errors import CannotProfile, RecordedProblem
from app.jobs.children.pairs import PairReport, ProfiledJobs
from app.jobs.job import Job
from app.jobs.library.listing import Entry, Library, LibraryFilter
from app.report.words.messages import Problem, describe_problem
from app.report.words.numbers import format_percent
from app.report.words.wording import Language, load_wording
from app.request import ProfileRequest
from app.services import Services, UsedLanguage, UsedServices
from app.web.rendering import find_base, render_page
from app.web.reports import find_way, lay_way

MOST_OFFERED = 60
"""Recordings of one person in the form."""
router = APIRouter(include_in_schema=False)


class DaysQuery(BaseModel):
    """The analyses of the days, those after a change apart, and what a person says of them.

    ``study`` stands for every report of a study; those from the day ``since`` on are after the change.
    """

    analysis: Annotated[list[str], Field(max_length=MOST_DAYS)] = []
    after: Annotated[list[str], Field(max_length=MOST_DAYS)] = []
    study: Annotated[str, Field(max_length=40)] = ""
    since: date | Literal[""] = ""
    same_subject: bool = False
    mixed_methods: bool = False


def find_days(services: UsedServices, query: Annotated[DaysQuery, Query()]) -> ProfiledJobs:
    """Find the analyses that an address names; one that stands on both sides is after the change."""
    first, after = _find_study(services, query) if query.study else _find_named(services, query)
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
    return ProfiledJobs(jobs, request)


Sides = tuple[tuple[Job, ...], tuple[Job, ...]]
"""Before, or all; and after a change."""


def _find_named(services: Services, query: DaysQuery) -> Sides:
    after = tuple(dict.fromkeys(query.after))
    first = tuple(each for each in dict.fromkeys(query.analysis) if each not in after)
    return tuple(map(services.store.get, first)), tuple(map(services.store.get, after))


def _find_study(services: Services, query: DaysQuery) -> Sides:
    """Find the reports of a study; of a change, those without a clock are on no side."""
    wanted = LibraryFilter(batch=services.batches.get(query.study).id)
    found = Library(services.store.reader).find_page(wanted, 2 * MOST_DAYS)
    placed = [
        (entry.job, entry.headline.start or "")
        for entry in found
        if entry.headline and entry.job.request.reference is None
    ]
    if not query.since:
        return tuple(job for job, _ in placed), ()
    since = query.since.isoformat()
    before = tuple(job for job, start in placed if start and start < since)
    return before, tuple(job for job, start in placed if start >= since)


Asked = Annotated[ProfiledJobs, Depends(find_days)]


@dataclass(frozen=True, slots=True)
class Choice:
    """A recording in the form: its analysis, what it is called, and on which side it stands."""

    id: str
    name: str
    when: str
    side: str
    above_60: str
    is_chosen: bool
    is_after: bool


@router.get("/days")
def show_days(asked: Asked, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Show several days laid over one another, with a form of the person's recordings to choose from."""
    values: dict[str, Any] = {
        **_show(_make(services, asked, language), language),
        "query": request.url.query,
        "choices": _list_choices(services, asked, language),
        "asked": asked.request,
        "one_person_ask": load_wording(language, "pair_pages")["one_person_ask"],
        "one_person_yes": load_wording(language, "pair_pages")["one_person_yes"],
        "d": load_wording(language, "days")["page"],
        "title": load_wording(language, "days")["title"],
    }
    return render_page(request, "days.html", language, values)


@router.get("/days/report.{form}", response_class=Response)
def get_days_report(
    form: Literal["html", "pdf"],
    asked: Asked,
    request: Request,
    services: UsedServices,
    language: UsedLanguage,
) -> Response:
    """Get the report of several days, to read or to file."""
    report = services.pairs.make(asked)
    body = report.read(report.find("report", form, language))
    if form == "html":
        way = find_way(f"{find_base(request)}/days", request)
        return lay_way(body.decode(), way, request, language)
    return respond_with_file(body, "application/pdf", build_pair_download_name(asked, f"{language}.pdf"))


@router.get("/days/{name}.csv", response_class=Response)
def get_days_table(name: Literal["profile", "overlay"], asked: Asked, services: UsedServices) -> Response:
    """Get a row for each day, or for each quarter hour of the clock."""
    body = services.pairs.make(asked).read(f"{name}.csv")
    return respond_with_file(body, "text/csv", build_pair_download_name(asked, f"{name}.csv"))


def find_days_address(services: Services, job: Job) -> str:
    """Give the address of the days of a person: all recordings with a report; empty where there is one.

    What states no arm, as a sensor on the trunk, is left out beside what does.
    """
    others = Library(services.store.reader).find_others(job, MOST_OFFERED - 1)
    ids = [other.job.id for other in others if other.job.request.side or not job.request.side]
    return "/days?" + "&".join(f"analysis={each}" for each in (job.id, *ids)) if ids else ""


def _make(services: Services, asked: ProfiledJobs, language: Language) -> PairReport | Problem:
    """Make the report, or say why these days cannot be set together."""
    try:
        return services.pairs.make(asked)
    except RecordedProblem as refused:
        if refused.code != CannotProfile.code:
            raise
        return describe_problem(refused.code, refused.facts, language)


def _show(made: PairReport | Problem, language: Language) -> dict[str, Any]:
    """Give answer and drawings, or the refusal in their place."""
    if isinstance(made, PairReport):
        return {
            "problem": None,
            "sentences": made.read_sentences(language),
            "drawings": [
                {**chart, "wide": Markup(chart["wide"]), "narrow": Markup(chart["narrow"])}  # noqa: S704  ours
                for chart in made.read_drawings(language)
            ],
            "figures": made.read_figures(),
        }
    return {"problem": made, "sentences": (), "drawings": (), "figures": {}}


def _list_choices(services: Services, asked: ProfiledJobs, language: Language) -> tuple[Choice, ...]:
    """List the chosen recordings and the others of the same people."""
    chosen = [job.id for job in asked.jobs]
    count = asked.request.before_count
    after = set(chosen[count:]) if count is not None else set()
    entries = _find_entries(services, asked.jobs)
    listed = [
        Choice(
            entry.job.id,
            entry.job.file_name,
            ((entry.headline.start if entry.headline else None) or "")[:16].replace("T", " "),
            load_wording(language)["side"][entry.job.request.side or "unknown"],
            format_percent(entry.headline.above_60_percent if entry.headline else None, language),
            entry.job.id in chosen and entry.job.id not in after,
            entry.job.id in after,
        )
        for entry in entries
    ]
    return tuple(sorted(listed, key=lambda choice: (choice.when, choice.side)))


def _find_entries(services: Services, jobs: Sequence[Job]) -> list[Entry]:
    """Find the entries of all recordings of the same people; what has no subject code stands by itself."""
    library = Library(services.store.reader)
    found: dict[str, Entry] = {}
    for job in {job.request.subject: job for job in jobs}.values():
        every = library.find_others(replace(job, recording_id=""), MOST_OFFERED)  # its own among them
        found |= {entry.job.recording_id: entry for entry in every}
    for job in jobs:
        known = found.get(job.recording_id)
        found[job.recording_id] = Entry(job, known.headline if known else None)
    return list(found.values())
