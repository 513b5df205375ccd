"""The page of several days: of one person, of both arms, of a group, before and after a change."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Annotated, Any, Literal

from fastapi import APIRouter, Depends, Query, Response
from markupsafe import Markup
from pydantic import BaseModel, Field

from app.api.library.files import respond_with_file
from app.api.pairs import MOST_DAYS, build_pair_download_name
from app.errors import CannotProfile, RecordedProblem
from app.jobs.children.pairs import ProfiledJobs
from app.jobs.job import Job
from app.jobs.library.listing import Entry, Library, LibraryFilter
from app.report.words.messages import Problem, describe_problem
from app.report.words.numbers import format_percent
from app.report.words.wording import load_wording
from app.request import ProfileRequest
from app.services import Services, UsedServices
from app.web.rendering import Page, UsedPage
from app.web.reports import lay_way_of_query

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
    if query.study:
        first, after = _find_study(services, query)
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
    return ProfiledJobs(jobs, request)


def _find_study(services: Services, query: DaysQuery) -> tuple[list[Job], list[Job]]:
    """Find the reports of a study, and those after a change: what has no clock is on neither side."""
    wanted = LibraryFilter(batch=services.batches.get(query.study).id)
    placed = [
        (entry.job, entry.headline.start or "")
        for entry in Library(services.store.reader).find_page(wanted, 2 * MOST_DAYS)
        if entry.headline and entry.job.request.reference is None
    ]
    if not query.since:
        return [job for job, _ in placed], []
    since = query.since.isoformat()
    before = [job for job, start in placed if start and start < since]
    return before, [job for job, start in placed if start >= since]


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


@dataclass(frozen=True, slots=True)
class DaysView:
    """Answer and drawings, or the refusal in their place; then the form to choose other days."""

    query: str
    asked: ProfileRequest
    choices: Sequence[Choice]
    problem: Problem | None = None
    sentences: Sequence[str] = ()
    drawings: Sequence[Mapping[str, str]] = ()
    figures: Mapping[str, Any] = field(default_factory=dict)


@router.get("/days")
def show_days(asked: Asked, page: UsedPage) -> Response:
    """Show several days laid over one another, with a form of the person's recordings to choose from."""
    try:
        made = page.services.pairs.make(asked)
    except RecordedProblem as refused:
        if refused.code != CannotProfile.code:
            raise
        problem = describe_problem(refused.code, refused.facts, page.language)
        shown: dict[str, Any] = {"problem": problem}
    else:
        drawings = [
            {**chart, "wide": Markup(chart["wide"]), "narrow": Markup(chart["narrow"])}  # noqa: S704  ours
            for chart in made.read_drawings(page.language)
        ]
        sentences, figures = made.read_sentences(page.language), made.read_figures()
        shown = {"sentences": sentences, "drawings": drawings, "figures": figures}
    choices = _list_choices(page, asked)
    return page.render("days.html", DaysView(page.request.url.query, asked.request, choices, **shown))


@router.get("/days/report.{form}", response_class=Response)
def get_days_report(form: Literal["html", "pdf"], asked: Asked, page: UsedPage) -> Response:
    """Get the report of several days, to read or to file."""
    report = page.services.pairs.make(asked)
    body = report.read(report.find("report", form, page.language))
    if form == "html":
        return lay_way_of_query(page, body.decode(), "/days")
    return respond_with_file(body, "application/pdf", build_pair_download_name(asked, f"{page.language}.pdf"))


@router.get("/days/{name}.csv", response_class=Response)
def get_days_table(name: Literal["profile", "overlay"], asked: Asked, services: UsedServices) -> Response:
    """Get a row for each day, or for each quarter hour of the clock."""
    body = services.pairs.make(asked).read(f"{name}.csv")
    return respond_with_file(body, "text/csv", build_pair_download_name(asked, f"{name}.csv"))


def find_days_address(services: Services, job: Job) -> str:
    """Return the address of the days of a person: all recordings with a report; empty where there is one.

    What states no arm, as a sensor on the trunk, is left out beside what does.
    """
    others = Library(services.store.reader).find_others(job, MOST_OFFERED - 1)
    ids = [other.job.id for other in others if other.job.request.side or not job.request.side]
    return "/days?" + "&".join(f"analysis={each}" for each in (job.id, *ids)) if ids else ""


def _list_choices(page: Page, asked: ProfiledJobs) -> tuple[Choice, ...]:
    """List the chosen recordings and the others of the same people.

    What has no subject code stands by itself.
    """
    library, sides = Library(page.services.store.reader), load_wording(page.language)["side"]
    found: dict[str, Entry] = {}
    for job in {job.request.subject: job for job in asked.jobs}.values():
        every = library.find_others(replace(job, recording_id=""), MOST_OFFERED)  # its own among them
        found |= {entry.job.recording_id: entry for entry in every}
    for job in asked.jobs:
        known = found.get(job.recording_id)
        found[job.recording_id] = Entry(job, known.headline if known else None)
    chosen, count = [job.id for job in asked.jobs], asked.request.before_count
    after = set(chosen[count:]) if count is not None else set()
    listed = []
    for entry in found.values():
        job, headline = entry.job, entry.headline
        listed.append(
            Choice(
                job.id,
                job.file_name,
                ((headline.start if headline else None) or "")[:16].replace("T", " "),
                sides[job.request.side or "unknown"],
                format_percent(headline.above_60_percent if headline else None, page.language),
                job.id in chosen and job.id not in after,
                job.id in after,
            )
        )
    return tuple(sorted(listed, key=lambda choice: (choice.when, choice.side)))
