"""A clinician's conclusion: typed on the page of a recording, it makes the next version of its report.

After a correction it is shown as a draft, until a person confirms or dismisses it.
"""

from datetime import date
from typing import Any

from fastapi import APIRouter, Response

from app.api.middleware.access import UsedSubject
from app.api.trust import find_person_name
from app.errors import BadParameter
from app.jobs.job import Job, JobState
from app.report.words.numbers import format_date
from app.report.words.subject import clean_paragraphs, clean_text
from app.report.words.wording import Language, fill, load_wording
from app.request import LONGEST_CONCLUSION, LONGEST_SUBJECT, Conclusion, ConclusionDraft
from app.web.forms import Form, UsedForm, first
from app.web.rendering import Page, UsedPage

router = APIRouter(prefix="/analyses/{analysis_id}", include_in_schema=False)


def build_conclusion(page: Page, job: Job, own_name: str, *, is_current: bool) -> dict[str, Any] | None:
    """Return the conclusion of a finished analysis or, if it is the current report, the draft of one.

    None for any other. ``draft``: where the draft comes from, in words; "" if ``said`` is in the report.
    ``own_name``: of the person logged in, "" where a name is typed. ``is_open``: the figures are this
    engine's; those of an earlier one may move, and are analysed first.
    """
    if job.state is not JobState.SUCCEEDED or job.replaced_by is not None:
        return None
    draft = job.request.draft if is_current else None
    said = draft.conclusion if draft else job.request.conclusion
    return {
        "said": said,
        "draft": describe_draft(draft, page.language) if draft else "",
        "when": format_date(date.fromisoformat(said.date), page.language) if said else "",
        "today": date.today().isoformat(),  # noqa: DTZ011
        "most": LONGEST_CONCLUSION,
        "is_open": any(one.id == job.id for one in page.services.store.find_same(job.sha256, job.request)),
        "own_name": own_name,
    }


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
def conclude(analysis_id: str, page: UsedPage, subject: UsedSubject, form: UsedForm) -> Response:
    """Make the next version of the report, with the conclusion; its figures are the same.

    The name is that of the person logged in; at the machine it is typed.
    """
    own_name, store = find_person_name(page.request, subject.id), page.services.store
    concluded = read_conclusion({**form, **({"name": [own_name]} if own_name else {})})
    again = store.conclude(store.get(analysis_id), concluded)
    return page.go(f"/analyses/{again.id}")


@router.post("/dismiss")
def dismiss(analysis_id: str, page: UsedPage) -> Response:
    """Dismiss the draft of a conclusion, or make the next version without the conclusion of the report."""
    store = page.services.store
    job = store.get(analysis_id)
    if job.request.conclusion is not None:
        job = store.conclude(job, None)
    else:
        store.dismiss_draft(job.id)
    return page.go(f"/analyses/{job.id}")
