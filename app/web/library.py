"""Tables of the library for download, and the trash: put in, take back, delete for good."""

import io
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from typing import Any, Literal
from urllib.parse import parse_qsl
from zipfile import ZIP_STORED, ZipFile

from fastapi import APIRouter, Request, Response
from fastapi.responses import RedirectResponse, StreamingResponse
from starlette.types import Receive, Scope, Send

from app.api.library.analyses import run_to_end
from app.api.library.files import build_download_name
from app.api.library.recordings import check_may_erase, has_trash, purge_recording
from app.api.trust import find_names
from app.errors import BadParameter, NoSuchFile, NotFinished, ResultDamaged, StoreDamaged
from app.jobs.audit_log import touch
from app.jobs.job import Job, JobState
from app.jobs.library.listing import Library
from app.jobs.recordings import HOLD_REASONS, RecordingFilter, StoredRow
from app.jobs.store import JobFilter
from app.report.export.columns import encode_summary, summarise_failure, summarise_results
from app.report.export.csv import FRENCH_EXCEL, INTERNATIONAL, Origin, Row, encode_table
from app.report.export.naming import make_safe_name
from app.report.words.messages import describe_problem
from app.report.words.wording import Language, fill, find_nearest, load_wording
from app.services import Services, UsedLanguage, UsedServices
from app.storage.store import COPY_BYTES, borrow_recording
from app.upkeep.backup_term import find_backup_term
from app.web.forms import first, read_form
from app.web.library_views import parse_filter, read_filter, write_filter
from app.web.recording.analysis import find_results
from app.web.rendering import find_base, render_page
from app.web.views import format_moment, format_size

MOST_ROWS = 10_000
SHOWN = 500
MOST_VIEWS = 50
LONGEST_VIEW = 60
DAY_S = 86400
ZIP64_FROM_BYTES = 1 << 30
PROBLEM_COLUMNS = ("file", "subject", "code", "title", "detail", "fix")

router = APIRouter(include_in_schema=False)


TableName = Literal["summary", "summary_fr", "problems"]


@router.get("/library/{name}.csv")
def take_table(name: TableName, request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Give the main figures, or the problems, of every recording that the list shows."""
    entries = Library(services.store.reader).find_page(read_filter(request), MOST_ROWS)
    dialect = FRENCH_EXCEL if name == "summary_fr" else INTERNATIONAL
    if name == "problems":
        rows: list[Row] = []
        for job in (entry.attempt or entry.job for entry in entries):
            if job.state is JobState.FAILED:
                code = job.problem_code or ""
                words = describe_problem(code, job.problem_facts, language)
                cells = (job.file_name, job.request.subject, code, words.title, words.detail, words.fix)
                rows.append(dict(zip(PROBLEM_COLUMNS, cells, strict=True)))
        body = encode_table(PROBLEM_COLUMNS, rows, dialect)
    else:
        body = encode_summary(list(summarise_jobs(services, [entry.job for entry in entries])), dialect)
    headers = {"Content-Disposition": f'attachment; filename="{name}.csv"'}
    return Response(body, media_type="text/csv; charset=utf-8", headers=headers)


@router.get("/library/reports.zip")
def take_reports(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Give the PDF of every report that the list shows; what has none is named in ``without-report.txt``."""
    entries = Library(services.store.reader).find_page(read_filter(request), MOST_ROWS)
    jobs = [entry.job for entry in entries]
    return PackedResponse(pack_reports(services, jobs, language), "reports.zip")


@router.get("/library/recordings.zip")
def take_recordings(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """Download the original files of a study, or of any list; ``without-recording.txt`` names lost ones."""
    entries = Library(services.store.reader).find_page(read_filter(request), MOST_ROWS)
    jobs = list({entry.job.recording_id: entry.job for entry in entries}.values())
    for job in jobs:
        touch(job.recording_id, job.id)
    return PackedResponse(pack_recordings(services, jobs, language), "recordings.zip")


@router.post("/library/views")
async def save_view(request: Request, services: UsedServices) -> Response:
    """Save the filter and order of the list under a name. Raises BadParameter."""
    form = await read_form(request)
    name, query = first(form, "name"), write_filter(parse_filter(dict(parse_qsl(first(form, "query")))))
    known = {view.name for view in services.views.find_all()}
    is_full = name not in known and len(known) >= MOST_VIEWS
    if not name or len(name) > LONGEST_VIEW or not name.isprintable() or is_full:
        raise BadParameter(name="name", value=name[:LONGEST_VIEW], allowed=f"<= {LONGEST_VIEW}")
    await run_to_end(services.views.add, name, query)
    return RedirectResponse(f"{find_base(request)}/?{query}", status_code=303)


@router.post("/library/views/{view_id}/drop")
def drop_view(view_id: str, request: Request, services: UsedServices) -> Response:
    """Forget a saved view."""
    services.views.drop(view_id)
    return RedirectResponse(f"{find_base(request)}/", status_code=303)


class _Outlet(io.RawIOBase):
    """Holds what a ZIP writes until it is sent, so that no more than one report, or piece, is in memory."""

    def __init__(self) -> None:
        self.held = bytearray()

    def writable(self) -> bool:
        return True

    def write(self, octets: Any) -> int:
        self.held += octets
        return len(octets)

    def take(self) -> bytes:
        taken, self.held = bytes(self.held), bytearray()
        return taken


class PackedResponse(StreamingResponse):
    """Sends a ZIP as it is written, and closes it: no borrowed file outlives a download that breaks off."""

    def __init__(self, packed: Generator[bytes, None, None], name: str) -> None:
        headers = {"Content-Disposition": f'attachment; filename="{name}"'}
        super().__init__(packed, media_type="application/zip", headers=headers)
        self._packed = packed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the ZIP, then close it."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._packed.close()


def pack_reports(services: Services, jobs: list[Job], language: Language) -> Generator[bytes, None, None]:
    """Write a ZIP piece by piece; a PDF is packed already, so it is stored as it is."""
    outlet, without, names = _Outlet(), [], set[str]()
    with ZipFile(outlet, "w", ZIP_STORED) as packed:
        for job in jobs:
            made = f"report.{find_nearest(language, job.request.languages)}.pdf"
            try:
                body = services.results.read(job, made)
            except (NotFinished, NoSuchFile, ResultDamaged) as refusal:
                why = describe_problem(refusal.code, refusal.facts, language).title
                without.append(f"{job.file_name}: {why}")
                continue
            name = build_download_name(services, job, made)
            packed.writestr(_name_once(name, job.id, names), body)
            yield outlet.take()
        if without:
            packed.writestr("without-report.txt", "\n".join(without) + "\n")
    yield outlet.take()


def pack_recordings(services: Services, jobs: list[Job], language: Language) -> Generator[bytes, None, None]:
    """Write a ZIP of original files, a piece at a time; it breaks off if a file changes meanwhile.

    Nothing is compressed: most originals are packed already, and a study has gigabytes.
    """
    missing = "without-recording.txt"
    outlet, without, names = _Outlet(), [], {missing}
    with ZipFile(outlet, "w", ZIP_STORED) as packed:
        for job in jobs:
            with ExitStack() as lent:
                try:
                    path = lent.enter_context(
                        borrow_recording(services.storage, job.recording_id, job.sha256)
                    )
                except StoreDamaged as refusal:
                    why = describe_problem(refusal.code, refusal.facts, language).title
                    without.append(f"{job.file_name} ({job.recording_id}): {why}")
                    continue
                name = _name_once(make_safe_name(job.file_name), job.recording_id, names)
                is_large = job.size_bytes >= ZIP64_FROM_BYTES
                with path.open("rb") as file, packed.open(name, "w", force_zip64=is_large) as entry:
                    while piece := file.read(COPY_BYTES):
                        entry.write(piece)
                        yield outlet.take()
        if without:
            packed.writestr(missing, "\n".join(without) + "\n")
    yield outlet.take()


def _name_once(name: str, identity: str, names: set[str]) -> str:
    """Return a name that differs from all before, in upper and lower case too: a second one has its id."""
    if name.casefold() in names:
        stem, _, ending = name.partition(".")
        name = f"{stem}_{identity}.{ending}" if ending else f"{stem}_{identity}"
    names.add(name.casefold())
    return name


@router.get("/recordings/{recording_id}/delete")
def ask_to_delete(
    recording_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> Response:
    """Say what goes before anything goes; without a trash, that it goes for good."""
    if not has_trash(services):
        return RedirectResponse(f"{find_base(request)}/recordings/{recording_id}/purge", status_code=303)
    row = services.recordings.get(recording_id, trashed=True)
    return _ask(request, services, row, language, for_good=row.state == "trashed")


@router.get("/recordings/{recording_id}/purge")
def ask_to_purge(
    recording_id: str, request: Request, services: UsedServices, language: UsedLanguage
) -> Response:
    """Ask once more before a recording is deleted for good."""
    row = services.recordings.get(recording_id, trashed=True)
    return _ask(request, services, row, language, for_good=True)


def _ask(
    request: Request, services: Services, row: StoredRow, language: Language, *, for_good: bool
) -> Response:
    values = {
        "recording": row,
        "size": format_size(row.size_bytes, language),
        "added": format_moment(row.created_at),
        "analyses": len(services.store.find_page(JobFilter(recording_id=row.id), SHOWN)),
        "for_good": for_good,
        "tr": load_wording(language, "trail"),
        "hold_reasons": HOLD_REASONS,
        "held_by": find_names(request, [row.hold_by], language)[row.hold_by],
        **_describe_trash(services, language),
    }
    if for_good:
        term = find_backup_term(services.storage)
        values["backups"] = fill(values["t"]["backups"][term.kind], {"until": term.until})
    return render_page(request, "delete.html", language, values)


@router.post("/recordings/{recording_id}/delete")
def throw_away(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Put a recording and all that was made of it into the trash; one that is there stays as it is.

    A trash that keeps nothing is emptied at the next look, so that erasing is what is asked for.
    """
    if not has_trash(services):
        check_may_erase(request)
    services.recordings.trash(recording_id)
    return RedirectResponse(f"{find_base(request)}/trash", status_code=303)


@router.post("/recordings/{recording_id}/purge")
def delete_for_good(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Delete a recording, its analyses and every file of them."""
    services.recordings.check_hold(recording_id)
    services.recordings.trash(recording_id)
    purge_recording(services, recording_id)
    return RedirectResponse(f"{find_base(request)}/trash", status_code=303)


@router.post("/recordings/{recording_id}/restore")
def take_back(recording_id: str, request: Request, services: UsedServices) -> Response:
    """Take a recording out of the trash."""
    services.recordings.restore(recording_id)
    return RedirectResponse(f"{find_base(request)}/", status_code=303)


@router.get("/trash")
def show_trash(request: Request, services: UsedServices, language: UsedLanguage) -> Response:
    """List what is in the trash."""
    rows = services.recordings.find_page(RecordingFilter(trashed=True), SHOWN)
    shown = [(row, format_size(row.size_bytes, language)) for row in rows]
    return render_page(request, "trash.html", language, {"rows": shown} | _describe_trash(services, language))


def _describe_trash(services: Services, language: Language) -> dict[str, Any]:
    words = load_wording(language, "page")["trash"]
    days = services.retention.find_trash_term_s(services.settings.trash_term_s) / DAY_S
    return {
        "term": fill(words["term"], {"days": f"{days:.0f}"}),
        "terms": load_wording(language, "trail")["terms"]["title"],
        "t": words,
    }


def summarise_jobs(services: Services, jobs: list[Job]) -> Iterator[Row]:
    """Give the row of each report; what has none is left out."""
    for job in jobs:
        try:
            results = find_results(services, job)
        except ResultDamaged as damaged:
            origin = Origin(job.file_name, job.request.subject, job.request.side)
            yield summarise_failure(origin, damaged.code)
            continue
        if results is not None:
            yield summarise_results(results)
