"""The library: downloads, bulk actions, saved views, the trash, and studies."""

import io
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal, get_args
from urllib.parse import parse_qsl
from zipfile import ZIP_STORED, ZipFile

from fastapi import APIRouter, Depends, Response
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from acromion.app.batch.folder import Task
from acromion.app.batch.inputs import assign_participants
from acromion.app.errors import BadParameter, NoSuchFile, NotFinished, ResultDamaged, StoreDamaged
from acromion.app.http.api.library.analyses import check_queue, run_to_end
from acromion.app.http.api.library.batches import retry_failed
from acromion.app.http.api.library.files import (
    MEDIA_TYPES,
    build_download_name,
    format_disposition,
    respond_with_file,
)
from acromion.app.http.api.library.recordings import check_may_erase, has_trash, purge_recording
from acromion.app.http.api.library.released import read_report
from acromion.app.http.api.trust import get_names
from acromion.app.http.pages.ranking import build_ranking, build_study_row
from acromion.app.http.pages.recording.analysis import find_results
from acromion.app.http.pages.recording.day import update_description
from acromion.app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, read_body
from acromion.app.http.pages.validations import list_compared
from acromion.app.http.pages.views import (
    find_path,
    format_size,
    format_stored_time,
    parse_filter,
    read_filter,
    write_filter,
)
from acromion.app.library.audit_log import touch
from acromion.app.library.batches import Batch, identify_study
from acromion.app.library.jobs import JobFilter
from acromion.app.library.listing import Entry, Library, LibraryFilter
from acromion.app.library.recordings import DESCRIBED, HOLD_REASONS, RecordingFilter
from acromion.app.library.rows import Job, JobState
from acromion.app.ops.copies import find_backup_term
from acromion.app.report.export.naming import make_safe_name
from acromion.app.report.export.tables import (
    FRENCH_EXCEL,
    INTERNATIONAL,
    Origin,
    Row,
    encode_rows,
    encode_table,
    summarise_failure,
    summarise_results,
)
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.wording import Language, fill, find_nearest
from acromion.app.request import SUBJECT_HINT, ReportRequest, check_subject
from acromion.app.services import Services, UsedServices
from acromion.app.store.folder import COPY_BYTES, borrow_recording
from acromion.fusion.conventions import Side

MAX_ROWS = 10_000
MAX_BATCHES = 200
MAX_STUDY_ROWS = 1_000
MOST_NAMED = 12
MAX_SELECTED = 500
SHOWN = 500
MAX_VIEWS = 50
MAX_VIEW_NAME_LENGTH = 60
MAX_TAG_LENGTH = 40
MAX_TAGS = 10
DAY_S = 86400
ZIP64_FROM_BYTES = 1 << 30
CSV = MEDIA_TYPES["csv"]
PROBLEM_COLUMNS = ("file_name", "subject", "code", "title", "detail", "fix")

router = APIRouter(include_in_schema=False)


# Downloads of tables, reports and original files, for all listed or all selected recordings.


@router.get("/library/{name}.csv")
def download_table(name: Literal["summary", "summary_fr", "problems"], page: UsedPage) -> Response:
    """Return the main figures, or the problems, of every listed recording."""
    entries = _find_shown(page)
    if name != "problems":
        return _send_table(page.services, entries, name)
    rows: list[Row] = []
    for job in (entry.attempt or entry.job for entry in entries):
        if job.state is JobState.FAILED:
            code = job.problem_code or ""
            words = describe_problem(code, job.problem_facts, page.language)
            cells = (job.file_name, job.request.subject, code, words.title, words.detail, words.fix)
            rows.append(dict(zip(PROBLEM_COLUMNS, cells, strict=True)))
    return respond_with_file(encode_table(PROBLEM_COLUMNS, rows, INTERNATIONAL), CSV, f"{name}.csv")


@router.post("/library/acts/{name}.csv")
def download_selected_table(
    name: Literal["summary", "summary_fr"], services: UsedServices, form: UsedForm
) -> Response:
    """Return one table of the selected recordings."""
    return _send_table(services, _find_selected(services, form), name)


def _find_shown(page: Page) -> Sequence[Entry]:
    return Library(page.services.store.reader).find_page(read_filter(page.request), MAX_ROWS)


def _find_selected(services: Services, form: Form) -> Sequence[Entry]:
    """Return the selected recordings: by id, or all that match a filter."""
    library, wanted = Library(services.store.reader), parse_filter(dict(parse_qsl(first(form, "query"))))
    if first(form, "every"):
        return library.find_page(wanted, MAX_ROWS)
    return library.find_chosen(form.get("recording", [])[:MAX_SELECTED], wanted.batch)


def _send_table(services: Services, entries: Sequence[Entry], name: str) -> Response:
    """Return a table with a row per report; recordings without a report are left out."""
    rows: list[Row] = []
    for job in (entry.job for entry in entries):
        try:
            if (results := find_results(services, job)) is not None:
                rows.append(summarise_results(results))
        except ResultDamaged as damaged:
            origin = Origin(job.file_name, job.request.subject, job.request.side)
            rows.append(summarise_failure(origin, damaged.code))
    body = encode_rows("summary", rows, FRENCH_EXCEL if name == "summary_fr" else INTERNATIONAL)
    return respond_with_file(body, CSV, f"{name}.csv")


@router.get("/library/reports.zip")
def download_reports(page: UsedPage) -> Response:
    """Return the PDF of every listed report; ``without-report.txt`` names recordings without one."""
    return _send_reports(page, _find_shown(page), read_filter(page.request).batch)


@router.post("/library/acts/reports.zip")
def download_selected_reports(page: UsedPage, form: UsedForm) -> Response:
    """Return the PDFs of the selected recordings."""
    batch = parse_filter(dict(parse_qsl(first(form, "query")))).batch
    return _send_reports(page, _find_selected(page.services, form), batch)


def _send_reports(page: Page, entries: Sequence[Entry], batch: str) -> Response:
    packed = pack_reports(page, [entry.job for entry in entries])
    return PackedResponse(packed, _name_zip(page.services, batch, "reports.zip"))


def _name_zip(services: Services, batch: str, name: str) -> str:
    """Return the name of a ZIP, beginning with the name of the study if it is of one."""
    study = services.batches.get(batch).name if batch else ""
    return f"{make_safe_name(study)}_{name}" if study else name


@router.get("/library/recordings.zip")
def download_recordings(page: UsedPage) -> Response:
    """Download the original files of a list or study; ``without-recording.txt`` names lost files."""
    jobs = list({entry.job.recording_id: entry.job for entry in _find_shown(page)}.values())
    for job in jobs:
        touch(job.recording_id, job.id)
    name = _name_zip(page.services, read_filter(page.request).batch, "recordings.zip")
    return PackedResponse(pack_recordings(page.services, jobs, page.language), name)


class _ZipBuffer(io.RawIOBase):
    """Buffer for the output of a ZIP until it is sent, so that only one report or block is in memory."""

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
    """Sends a ZIP while it is written; closes it if the download breaks off, to return borrowed files."""

    def __init__(self, packed: Generator[bytes, None, None], name: str) -> None:
        headers = {"Content-Disposition": format_disposition(name)}
        super().__init__(packed, media_type="application/zip", headers=headers)
        self._packed = packed

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the ZIP, then close it."""
        try:
            await super().__call__(scope, receive, send)
        finally:
            self._packed.close()


def pack_reports(page: Page, jobs: list[Job]) -> Generator[bytes, None, None]:
    """Yield a ZIP of reports in parts; PDFs are stored uncompressed because they are already compressed."""
    outlet, without, names = _ZipBuffer(), [], set[str]()
    with ZipFile(outlet, "w", ZIP_STORED) as packed:
        for job in jobs:
            made = f"report.{find_nearest(page.language, job.request.languages)}.pdf"
            try:
                body = read_report(page.request, page.services, job, made)
            except (NotFinished, NoSuchFile, ResultDamaged) as refusal:
                why = describe_problem(refusal.code, refusal.facts, page.language).title
                without.append(f"{job.file_name}: {why}")
                continue
            name = build_download_name(page.services, job, made)
            packed.writestr(_make_unique_name(name, job.id, names), body)
            yield outlet.take()
        if without:
            packed.writestr("without-report.txt", "\n".join(without) + "\n")
    yield outlet.take()


def pack_recordings(services: Services, jobs: list[Job], language: Language) -> Generator[bytes, None, None]:
    """Yield a ZIP of original files in parts; it is aborted if a file changes meanwhile.

    Nothing is compressed: most originals already are, and a study has gigabytes.
    """
    missing = "without-recording.txt"
    outlet, without, names = _ZipBuffer(), [], {missing}
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
                name = _make_unique_name(make_safe_name(job.file_name), job.recording_id, names)
                is_large = job.size_bytes >= ZIP64_FROM_BYTES
                with path.open("rb") as file, packed.open(name, "w", force_zip64=is_large) as entry:
                    while piece := file.read(COPY_BYTES):
                        entry.write(piece)
                        yield outlet.take()
        if without:
            packed.writestr(missing, "\n".join(without) + "\n")
    yield outlet.take()


def _make_unique_name(name: str, identity: str, names: set[str]) -> str:
    """Return a unique name, ignoring case; a name that exists gets the id appended."""
    if name.casefold() in names:
        stem, _, ending = name.partition(".")
        name = f"{stem}_{identity}.{ending}" if ending else f"{stem}_{identity}"
    names.add(name.casefold())
    return name


# Saved views, and bulk actions.


@router.post("/library/views")
def save_view(page: UsedPage, form: UsedForm) -> Response:
    """Save the filter and order of the list under a name. Raises BadParameter."""
    name, query = first(form, "name"), write_filter(parse_filter(dict(parse_qsl(first(form, "query")))))
    known = {view.name for view in page.services.views.find_all()}
    is_full = name not in known and len(known) >= MAX_VIEWS
    if not name or len(name) > MAX_VIEW_NAME_LENGTH or not name.isprintable() or is_full:
        raise BadParameter(
            name="name", value=name[:MAX_VIEW_NAME_LENGTH], allowed=f"<= {MAX_VIEW_NAME_LENGTH}"
        )
    page.services.views.add(name, query)
    return page.go(f"/?{query}")


@router.post("/library/views/{view_id}/drop")
def drop_view(view_id: str, page: UsedPage) -> Response:
    """Delete a saved view."""
    page.services.views.drop(view_id)
    return page.go("/")


Act = Literal["side", "subject", "held", "tag", "untag", "study", "again", "delete", "restore"]


@dataclass(frozen=True, slots=True)
class ActionResult:
    """The result of a bulk action: the number of recordings, facts for the message, and the ids for undo."""

    number: int
    facts: Mapping[str, str] = field(default_factory=dict)
    undo: Sequence[str] = ()


@router.post("/library/acts/{act}")
async def run_bulk_action(act: Act, page: UsedPage, form: UsedForm) -> Response:
    """Apply one action to the selected recordings, and show the result."""
    done = await run_to_end(_run_action, act, page, form)
    words = page.words()["acted"]
    message = fill(words[act], {"n": str(done.number), **done.facts}) if done.number else words["none"]
    return page.render("library/acted.html", told=message, undo=done.undo, query=first(form, "query"))


def _run_action(act: Act, page: Page, form: Form) -> ActionResult:
    recordings, store = page.services.recordings, page.services.store
    if act == "restore":
        ids = form.get("recording", [])
        for recording_id in ids:
            recordings.restore(recording_id)
        return ActionResult(len(ids))
    if act == "delete" and not has_trash(page.services):
        check_may_erase(page.request)
    entries = _find_selected(page.services, form)
    ids = [entry.job.recording_id for entry in entries]
    if act == "delete":
        for recording_id in ids:
            recordings.trash(recording_id)
        return ActionResult(len(ids), undo=ids)
    if act == "untag":
        tag = first(form, "tag")
        return ActionResult(recordings.tag(ids, taken=tag), {"tag": tag})
    if act == "tag":
        tags = _read_tags(first(form, "tag"))
        return ActionResult(recordings.tag(ids, tags), {"tag": ", ".join(tags)})
    if act == "study":
        study = _read_code("study", first(form, "study"))
        if not study:
            raise BadParameter(name="study", value="", allowed=SUBJECT_HINT)
        for entry in entries:
            store.join_study(study, (entry.attempt or entry.job).id)
        return ActionResult(len(entries), {"study": study})
    return ActionResult(_analyse_again(page.services, entries, _read_change(act, form)))


def _read_tags(text: str) -> tuple[str, ...]:
    """Parse tags separated by commas. Raises BadParameter."""
    tags = tuple(dict.fromkeys(tag.strip() for tag in text.split(",") if tag.strip()))
    are_fit = all(len(tag) <= MAX_TAG_LENGTH and tag.isprintable() for tag in tags)
    if not 0 < len(tags) <= MAX_TAGS or not are_fit:
        raise BadParameter(name="tag", value=text[:MAX_TAG_LENGTH], allowed=f"<= {MAX_TAG_LENGTH}")
    return tags


def _read_code(name: str, text: str) -> str:
    try:
        return check_subject(text)
    except ValueError:
        raise BadParameter(name=name, value="", allowed=SUBJECT_HINT) from None


def _read_change(act: Act, form: Form) -> dict[str, Any]:
    """Parse the new description of the recordings; empty if they are analysed again unchanged.

    Raises BadParameter.
    """
    if act == "again":
        return {}
    if act == "held":
        return {"pose_held": "start"}
    value = first(form, act)
    if act == "subject":
        return {"subject": _read_code("subject", value)}
    return {"side": _read_side(value)}


def _read_side(text: str) -> Side | None:
    """Parse the arm of a form. Raises BadParameter."""
    known: Mapping[str, Side | None] = {"": None, **{side: side for side in get_args(Side)}}
    if text not in known:
        raise BadParameter(name="side", value=text[:20], allowed=", ".join(get_args(Side)))
    return known[text]


def _analyse_again(services: Services, entries: Sequence[Entry], change: Mapping[str, Any]) -> int:
    """Change the description of recordings, and analyse again if the report does not match it.

    An analysis in progress, a calibration set by hand, or a comparison does not change. Raises Busy.
    """
    asked = []
    for entry in entries:
        newest = entry.attempt or entry.job
        before = newest.request
        is_same = bool(change) and all(getattr(before, name) == value for name, value in change.items())
        is_waiting = not change and not newest.is_over
        is_given = "pose_held" in change and (before.calibration_windows_s or before.arm_axis)
        if not (is_same or is_given or is_waiting or before.reference):
            asked.append((newest, replace(before, **change, reason="")))
    check_queue(services, len(asked))
    for job, request in asked if change.keys() & {"side", "subject"} else ():
        update_description(services, job, request, tuple(change))
    return services.store.repeat_all(asked, is_fresh=not change)


# The trash: delete, restore, delete permanently.


def _describe_trash(page: Page) -> dict[str, Any]:
    """Return how long the trash keeps recordings, and the title of the retention page."""
    days = page.services.retention.find_trash_term_s(page.services.settings.trash_term_s) / DAY_S
    term = fill(page.words()["trash"]["term"], {"days": f"{days:.0f}"})
    return {"term": term, "terms": page.words("trail")["terms"]["title"]}


@router.get("/recordings/{recording_id}/delete")
def ask_to_delete(recording_id: str, page: UsedPage) -> Response:
    """Ask before a recording is deleted; if the trash is disabled, warn that this is permanent."""
    if not has_trash(page.services):
        return page.go(f"/recordings/{recording_id}/purge")
    return _render_delete_page(page, recording_id, for_good=False)


@router.get("/recordings/{recording_id}/purge")
def ask_to_purge(recording_id: str, page: UsedPage) -> Response:
    """Ask again before a recording is permanently deleted."""
    return _render_delete_page(page, recording_id, for_good=True)


def _render_delete_page(page: Page, recording_id: str, *, for_good: bool) -> Response:
    row = page.services.recordings.get(recording_id, trashed=True)
    is_for_good = for_good or row.state == "trashed"
    backups = ""
    if is_for_good:
        term = find_backup_term(page.services.storage)
        backups = fill(page.words()["trash"]["backups"][term.kind], {"until": term.until})
    return page.render(
        "library/delete.html",
        **_describe_trash(page),
        recording=row,
        size=format_size(row.size_bytes, page.language),
        added=format_stored_time(row.created_at, page.language),
        analyses=len(page.services.store.find_page(JobFilter(recording_id=row.id), SHOWN)),
        for_good=is_for_good,
        hold_reasons=HOLD_REASONS,
        held_by=get_names(page.request, [row.hold_by], page.language)[row.hold_by],
        backups=backups,
    )


@router.post("/recordings/{recording_id}/delete")
def trash_recording(recording_id: str, page: UsedPage) -> Response:
    """Move a recording and its analyses to the trash; nothing changes if it is already there.

    If the trash is disabled, housekeeping soon empties it, so this needs the permission to erase.
    """
    if not has_trash(page.services):
        check_may_erase(page.request)
    page.services.recordings.trash(recording_id)
    return page.go("/trash")


@router.post("/recordings/{recording_id}/purge")
def delete_permanently(recording_id: str, page: UsedPage) -> Response:
    """Permanently delete a recording, its analyses and their files."""
    page.services.recordings.check_hold(recording_id)
    page.services.recordings.trash(recording_id)
    purge_recording(page.services, recording_id)
    return page.go("/trash")


@router.post("/recordings/{recording_id}/restore")
def restore_from_trash(recording_id: str, page: UsedPage) -> Response:
    """Restore a recording from the trash."""
    page.services.recordings.restore(recording_id)
    return page.go("/")


@router.get("/trash")
def show_trash(page: UsedPage) -> Response:
    """List the recordings in the trash."""
    found = page.services.recordings.find_page(RecordingFilter(trashed=True), SHOWN)
    shown = [(row, format_size(row.size_bytes, page.language)) for row in found]
    return page.render("library/trash.html", **_describe_trash(page), rows=shown)


# Studies: the list, and each study with its ranking and its recordings. A batch of a script is also a study.


@router.get("/studies")
def show_studies(page: UsedPage, name: str = "") -> Response:
    """List the studies, newest first; with ``name``, go to the study of that name."""
    if name:
        return page.go(f"/studies/{identify_study(name)}")
    rows = [_describe_batch(page, batch) for batch in page.services.batches.find_page(MAX_BATCHES)]
    return page.render("library/studies.html", rows=rows)


@router.get("/studies/{batch_id}")
def show_study(batch_id: str, page: UsedPage) -> Response:
    """Show one study: its ranking, the subject and arm of each recording, its downloads."""
    batch = page.services.batches.get(batch_id)
    jobs = page.services.batches.find_jobs(batch_id)
    wanted = LibraryFilter(order="name", batch=batch.id)
    found = Library(page.services.store.reader).find_page(wanted, MAX_STUDY_ROWS)
    entries = [entry for entry in found if entry.job.request.reference is None]
    rows = [build_study_row(entry, page.language) for entry in entries]
    rows.sort(key=lambda row: (row.folder, row.file.casefold()))  # the order does not change on saving
    return page.render(
        "library/study.html",
        batch=batch,
        told=_describe_batch(page, batch),
        ranking=build_ranking(entries, page.language),
        rows=rows,
        proposed=sum(row.is_proposed for row in rows),
        compared=list_compared(page, jobs),
        failed=batch.counts[JobState.FAILED],
        count=len(jobs),
        may_correct=page.subject is None or page.subject.may("correct"),
    )


@router.post("/studies/{batch_id}/retry")
def retry_batch(batch_id: str, page: UsedPage) -> Response:
    """Repeat the failed analyses of a batch (a plain form, so that it works without scripts)."""
    retry_failed(batch_id, page.services)
    return page.go(f"/studies/{batch_id}")


@router.post("/studies/{batch_id}/participants")
def import_participants(
    batch_id: str, page: UsedPage, content: Annotated[bytes, Depends(read_body)], *, preview: bool = False
) -> dict[str, Any]:
    """Read a list of participants, and set the reports again that it changes; ``preview``: change nothing.

    Return how many change (``changed``), the listed files that the study does not contain (``unknown``), the
    recordings without a row (``unlisted``), and all of this in words (``told``).
    """
    services = page.services
    jobs = _find_newest(services, services.batches.get(batch_id).id)
    places = (Path(job.recording_id, find_path(services, job)) for job in jobs)  # the id makes each unique
    tasks = [Task(place, job.request, Path()) for place, job in zip(places, jobs, strict=True)]
    assigned, unknown = assign_participants(tasks, content, None)
    requests = [task.request for task in assigned]
    changed = sum(job.request != asked for job, asked in zip(jobs, requests, strict=True))
    if not preview:
        _describe_all(services, jobs, requests)
    pairs = zip(tasks, assigned, jobs, strict=True)
    unlisted = [job.file_name for task, after, job in pairs if after is task]
    names = [row.file for row in unknown]
    told = _describe_list(page, len(jobs) - len(unlisted), changed, names, unlisted)
    return {"changed": changed, "unknown": names, "unlisted": unlisted, "told": told}


def _describe_list(
    page: Page, matched: int, changed: int, unknown: Sequence[str], unlisted: Sequence[str]
) -> list[str]:
    """Return the numbers of matches and changes of a list in words, and the names without a match."""
    words = page.words()["studies"]["list"]
    told = [fill(words["matched"], {"n": str(matched), "changed": str(changed)})]
    for word, names in (("unknown", unknown), ("unlisted", unlisted)):
        if names:
            shown, rest = ", ".join(names[:MOST_NAMED]), len(names) - MOST_NAMED
            more = {"more": str(rest)} if rest > 0 else {}
            told.append(fill(words[word], {"n": str(len(names)), "names": shown} | more))
    return told


@router.post("/studies/{batch_id}/whose")
def change_whose(batch_id: str, page: UsedPage, form: UsedForm) -> Response:
    """Store the subject and arm of each recording of the table; proposals count once they are sent here.

    Raises BadParameter.
    """
    services = page.services
    columns = (form.get(name, []) for name in ("recording", "subject", "side"))
    stated = {recording: (subject, side) for recording, subject, side in zip(*columns, strict=False)}
    jobs = [job for job in _find_newest(services, batch_id) if job.recording_id in stated]
    asked = []
    for job in jobs:
        subject, side = stated[job.recording_id]
        asked.append(replace(job.request, subject=_read_code("subject", subject), side=_read_side(side)))
    _describe_all(services, jobs, asked)
    return page.go(f"/studies/{batch_id}")


def _find_newest(services: Services, batch_id: str) -> list[Job]:
    """Return the newest analysis of each recording of a study."""
    ids = {job.recording_id for job in services.batches.find_jobs(batch_id)}
    newest = (entry.attempt or entry.job for entry in Library(services.store.reader).find_chosen(ids))
    return [job for job in newest if job.request.reference is None]


def _describe_all(services: Services, jobs: Sequence[Job], requests: Sequence[ReportRequest]) -> None:
    """Store the people, arms and jobs that differ, and make those reports again.

    Raises Busy.
    """
    changed = [(job, asked) for job, asked in zip(jobs, requests, strict=True) if asked != job.request]
    check_queue(services, len(changed))
    for job, asked in changed:
        update_description(services, job, asked, DESCRIBED)
    services.store.repeat_all(changed)


def _describe_batch(page: Page, batch: Batch) -> dict[str, str]:
    """Return the id, name, creation time and counts by state of a study."""
    words = page.words()["studies"]
    counts = {state.value: str(number) for state, number in batch.counts.items() if number}
    text = fill(words["counts"], {"all": str(sum(batch.counts.values()))} | counts)
    name, when = batch.name or words["unnamed"], format_stored_time(batch.created_at, page.language)
    return {"id": batch.id, "name": name, "when": when, "counts": text}
