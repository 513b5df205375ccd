"""Acts on many recordings of the list: arm, subject, tags, analyse again, tables, the trash and back."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal
from urllib.parse import parse_qsl

from fastapi import APIRouter, Request, Response

from app.api.library.analyses import check_queue, run_to_end
from app.api.library.recordings import check_may_erase, has_trash
from app.errors import BadParameter
from app.jobs.job import Job
from app.jobs.library.listing import Entry, Library
from app.report.export.columns import encode_summary
from app.report.export.csv import FRENCH_EXCEL, INTERNATIONAL
from app.report.words.wording import fill, load_wording
from app.request import SUBJECT_HINT, ReportRequest, check_subject
from app.services import Services, UsedLanguage, UsedServices
from app.web.forms import Form, first, read_form
from app.web.library import MOST_ROWS, PackedResponse, pack_reports, summarise_jobs
from app.web.library_views import parse_filter
from app.web.recording.day import say_whose
from app.web.rendering import render_page

MOST_CHOSEN = 500
LONGEST_TAG = 40
MOST_TAGS = 10

Act = Literal["side", "subject", "held", "tag", "untag", "study", "again", "delete", "restore"]

router = APIRouter(include_in_schema=False, prefix="/library/acts")


@router.post("/reports.zip")
async def take_chosen_reports(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Give the PDFs of the chosen recordings."""
    entries = await _find_entries(request, services)
    return PackedResponse(pack_reports(services, [entry.job for entry in entries], language), "reports.zip")


@router.post("/{name}.csv")
async def take_chosen_table(
    name: Literal["summary", "summary_fr"], request: Request, services: UsedServices
) -> Response:
    """Give one table of the chosen recordings."""
    jobs = [entry.job for entry in await _find_entries(request, services)]
    dialect = FRENCH_EXCEL if name == "summary_fr" else INTERNATIONAL
    body = await run_to_end(lambda: encode_summary(list(summarise_jobs(services, jobs)), dialect))
    headers = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return Response(body, media_type="text/csv; charset=utf-8", headers=headers)


@router.post("/{act}")
async def do(act: Act, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Do one thing to the chosen recordings, and say what was done."""
    form = await read_form(request)
    if act == "restore":
        ids = form.get("recording", [])
        done: Mapping[str, Any] = await run_to_end(_restore, services, ids)
    else:
        if act == "delete":
            await run_to_end(_check_may_delete, request, services)
        done = await run_to_end(_act, act, form, services)
    words = load_wording(language, "page")["acted"]
    values = {
        "told": fill(words[act], {"n": str(done["number"]), **done["facts"]})
        if done["number"]
        else words["none"],
        "undo": done["undo"],
        "w": words,
        "query": first(form, "query"),
    }
    return render_page(request, "acted.html", language, values)


def _check_may_delete(request: Request, services: Services) -> None:
    """Check the permission to erase where the trash keeps nothing."""
    if not has_trash(services):
        check_may_erase(request)


async def _find_entries(request: Request, services: Services) -> Sequence[Entry]:
    return await run_to_end(_find_chosen, await read_form(request), services)


def _find_chosen(form: Form, services: Services) -> Sequence[Entry]:
    """Find the recordings that are chosen: by name, or all that a filter lets through."""
    library = Library(services.store.reader)
    wanted = parse_filter(dict(parse_qsl(first(form, "query"))))
    if first(form, "every"):
        return library.find_page(wanted, MOST_ROWS)
    return library.find_chosen(form.get("recording", [])[:MOST_CHOSEN], wanted.batch)


def _act(act: Act, form: Form, services: Services) -> dict[str, Any]:
    entries = _find_chosen(form, services)
    ids = [entry.job.recording_id for entry in entries]
    facts: dict[str, str] = {}
    undo: list[str] = []
    if act == "delete":
        for recording_id in ids:
            services.recordings.trash(recording_id)
        number, undo = len(ids), ids
    elif act == "untag":
        facts = {"tag": first(form, "tag")}
        number = services.recordings.tag(ids, taken=facts["tag"])
    elif act == "study":
        facts = {"study": _read_study(first(form, "study"))}
        for entry in entries:
            services.store.join_study(facts["study"], (entry.attempt or entry.job).id)
        number = len(entries)
    elif act == "tag":
        tags = _read_tags(first(form, "tag"))
        facts = {"tag": ", ".join(tags)}
        number = services.recordings.tag(ids, tags)
    else:
        number = _analyse_again(services, entries, _read_change(act, form))
    return {"number": number, "facts": facts, "undo": undo}


def _restore(services: Services, ids: Sequence[str]) -> dict[str, Any]:
    for recording_id in ids:
        services.recordings.restore(recording_id)
    return {"number": len(ids), "facts": {}, "undo": ()}


def _read_tags(text: str) -> tuple[str, ...]:
    """Read tags with commas between.

    Raises
    ------
    BadParameter
    """
    tags = tuple(dict.fromkeys(tag.strip() for tag in text.split(",") if tag.strip()))
    if (
        not tags
        or len(tags) > MOST_TAGS
        or any(len(tag) > LONGEST_TAG or not tag.isprintable() for tag in tags)
    ):
        raise BadParameter(name="tag", value=text[:LONGEST_TAG], allowed=f"<= {LONGEST_TAG}")
    return tags


def _read_study(text: str) -> str:
    """Read the name of a study.

    Raises
    ------
    BadParameter
    """
    name = _read_code("study", text)
    if not name:
        raise BadParameter(name="study", value="", allowed=SUBJECT_HINT)
    return name


def _read_code(field: str, text: str) -> str:
    try:
        return check_subject(text)
    except ValueError:
        raise BadParameter(name=field, value="", allowed=SUBJECT_HINT) from None


def _read_change(act: Act, form: Form) -> dict[str, Any]:
    """Read what is to be said of the recordings from now on; nothing where they are analysed as before.

    Raises
    ------
    BadParameter
    """
    if act == "again":
        return {}
    if act == "held":
        return {"pose_held": "start"}
    value = first(form, act)
    if act == "side":
        if value not in ("", "left", "right"):
            raise BadParameter(name="side", value=value[:20], allowed="left, right")
        return {"side": value or None}
    return {"subject": _read_code("subject", value)}


def _analyse_again(services: Services, entries: Sequence[Entry], change: Mapping[str, Any]) -> int:
    """Say something else of recordings, and analyse again where that is not what the report says.

    Raises
    ------
    Busy
    """
    asked = [(job, asked) for job, asked in (_ask_again(entry, change) for entry in entries) if asked]
    check_queue(services, len(asked))
    for job, request in asked if change.keys() & {"side", "subject"} else ():
        say_whose(services, job, request, tuple(change))
    return services.store.repeat_all(asked)


def _ask_again(entry: Entry, change: Mapping[str, Any]) -> tuple[Job, ReportRequest | None]:
    """Build the request of the next analysis; None where it would change nothing or one is under way."""
    newest = entry.attempt or entry.job
    said = replace(newest.request, **change, reason="")
    is_same = bool(change) and all(getattr(newest.request, name) == value for name, value in change.items())
    is_waiting = not change and not newest.is_over
    is_given = "pose_held" in change and (newest.request.calibration_windows_s or newest.request.arm_axis)
    return newest, None if is_same or is_given or is_waiting or newest.request.reference else said
