"""A clinician's conclusion: typed on the page of a recording, it makes the next version of its report.

After a correction it is shown as a draft, until a person confirms or dismisses it.
"""

from dataclasses import dataclass
from datetime import date

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse
from starlette.status import HTTP_303_SEE_OTHER

from app.api.middleware.access import UsedSubject
from app.api.trust import find_person_name
from app.errors import BadParameter
from app.jobs.job import Job, JobState
from app.report.words.numbers import format_date
from app.report.words.subject import clean_paragraphs, clean_text
from app.report.words.wording import Language, fill, load_wording
from app.request import LONGEST_CONCLUSION, LONGEST_SUBJECT, Conclusion, ConclusionDraft
from app.services import Services, UsedServices
from app.web.forms import Form, UsedForm, first
from app.web.rendering import find_base

router = APIRouter(prefix="/analyses/{analysis_id}", include_in_schema=False)


@dataclass(frozen=True, slots=True)
class ConclusionCard:
    """The conclusion of the report or the draft of one, its date in words, and what the form holds.

    ``draft``: where the draft comes from, in words; "" if ``said`` is in the report.
    ``own_name``: of the person logged in, "" where a name is typed.
    ``is_open``: the figures are this engine's; those of an earlier one may move, and are analysed first.
    """

    said: Conclusion | None
    draft: str
    when: str
    today: str
    most: int
    is_open: bool
    own_name: str = ""


def build_conclusion(
    services: Services, job: Job, language: Language, own_name: str = "", *, is_current: bool = True
) -> ConclusionCard | None:
    """Return the card of a finished analysis, with its draft if it is the current report; None for any other.

    ``own_name``: of the person logged in.
    """
    if job.state is not JobState.SUCCEEDED or job.replaced_by is not None:
        return None
    draft = job.request.draft if is_current else None
    said = draft.conclusion if draft else job.request.conclusion
    when = format_date(date.fromisoformat(said.date), language) if said else ""
    same = services.store.find_same(job.sha256, job.request)
    is_open = any(one.id == job.id for one in same)
    origin = describe_draft(draft, language) if draft else ""
    today = date.today().isoformat()  # noqa: DTZ011
    return ConclusionCard(said, origin, when, today, LONGEST_CONCLUSION, is_open, own_name)


def describe_draft(draft: ConclusionDraft, language: Language) -> str:
    """Write for which version a draft was written, and what has changed since."""
    words, names = load_wording(language, "page")["conclude"]["draft"], load_wording(language)["changed"]
    kind = "other" if set(draft.changes) - {"subject"} else "subject" if draft.changes else "same"
    changed = ", ".join(str(names.get(name, name)) for name in draft.changes)
    return fill(words[kind], {"n": str(draft.version), "changed": changed})


def read_conclusion(form: Form) -> Conclusion:
    """Read what was typed. Raises BadParameter."""
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
def conclude(
    analysis_id: str, request: Request, services: UsedServices, subject: UsedSubject, form: UsedForm
) -> Response:
    """Make the next version of the report, with the conclusion; its figures are the same.

    The name is that of the person logged in; at the machine it is typed.
    """
    own_name = find_person_name(request, subject.id)
    concluded = read_conclusion({**form, **({"name": [own_name]} if own_name else {})})
    again = services.store.conclude(services.store.get(analysis_id), concluded)
    return RedirectResponse(f"{find_base(request)}/analyses/{again.id}", HTTP_303_SEE_OTHER)


@router.post("/dismiss")
def dismiss(analysis_id: str, request: Request, services: UsedServices) -> Response:
    """Dismiss the draft of a conclusion, or make the next version without the conclusion of the report."""
    job = services.store.get(analysis_id)
    if job.request.conclusion is not None:
        job = services.store.conclude(job, None)
    else:
        services.store.dismiss_draft(job.id)
    return RedirectResponse(f"{find_base(request)}/analyses/{job.id}", HTTP_303_SEE_OTHER)
