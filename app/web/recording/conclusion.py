"""A clinician's conclusion: typed on the page of a recording, it makes the next version of its report."""

from dataclasses import dataclass, replace
from datetime import date

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse
from starlette.status import HTTP_303_SEE_OTHER

from app.api.middleware.access import UsedSubject
from app.api.names import find_person_name
from app.errors import BadParameter
from app.jobs.job import Job, JobState
from app.report.words.numbers import format_date
from app.report.words.subject import clean_paragraphs, clean_text
from app.report.words.wording import Language
from app.request import LONGEST_CONCLUSION, LONGEST_SUBJECT, Conclusion
from app.services import Services, UsedServices
from app.web.forms import Form, first, read_form
from app.web.rendering import find_base

router = APIRouter(prefix="/analyses/{analysis_id}", include_in_schema=False)


@dataclass(frozen=True, slots=True)
class ConclusionCard:
    """What the report says already, its date in words, and what the form holds.

    ``own_name``: of the person logged in, "" where a name is typed.
    ``is_open``: the figures are this engine's; those of an earlier one may move, and are analysed first.
    """

    said: Conclusion | None
    when: str
    today: str
    most: int
    is_open: bool
    own_name: str = ""


def build_conclusion(
    services: Services, job: Job, language: Language, own_name: str = ""
) -> ConclusionCard | None:
    """Give the card of a finished analysis; None for any other. ``own_name``: of the person logged in."""
    if job.state is not JobState.SUCCEEDED or job.replaced_by is not None:
        return None
    said = job.request.conclusion
    when = format_date(date.fromisoformat(said.date), language) if said else ""
    same = services.store.find_same(job.sha256, job.request)
    is_open = any(one.id == job.id for one in same)
    return ConclusionCard(said, when, date.today().isoformat(), LONGEST_CONCLUSION, is_open, own_name)  # noqa: DTZ011


def read_conclusion(form: Form) -> Conclusion:
    """Read what was typed.

    Raises
    ------
    BadParameter
    """
    text, name, typed_date = (first(form, field) for field in ("text", "name", "date"))
    if not clean_paragraphs(text) or len(text) > LONGEST_CONCLUSION:
        raise BadParameter(name="text", value=text[:60], allowed=f"1 … {LONGEST_CONCLUSION}")
    if not clean_text(name) or len(name) > LONGEST_SUBJECT:
        raise BadParameter(name="name", value=name[:60], allowed=f"1 … {LONGEST_SUBJECT}")
    try:
        day = date.fromisoformat(typed_date)
    except ValueError:
        raise BadParameter(name="date", value=typed_date[:60], allowed="2026-11-23") from None
    return Conclusion("\n".join(clean_paragraphs(text)), clean_text(name), day.isoformat())


@router.post("/conclude")
async def conclude(
    analysis_id: str, request: Request, services: UsedServices, subject: UsedSubject
) -> Response:
    """Make the next version of the report, with the conclusion; its figures are the same.

    The name is that of the person logged in; at the machine it is typed.
    """
    form = dict(await read_form(request))
    own_name = await run_in_threadpool(find_person_name, request, subject.id)
    concluded = read_conclusion(form | ({"name": [own_name]} if own_name else {}))
    job = await run_in_threadpool(services.store.get, analysis_id)
    asked = replace(job.request, conclusion=concluded, reason="")
    again = await run_in_threadpool(services.store.add_correction, (job.recording_id, job.sha256), asked)
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}", HTTP_303_SEE_OTHER)
