"""The library: tables for download, acts on many recordings, the trash, and the studies."""

import io
from collections.abc import Generator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import parse_qsl
from zipfile import ZIP_STORED, ZipFile

from fastapi import APIRouter, Depends, Response
from fastapi.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from app.batch.folder import Task
from app.batch.inputs import assign_participants
from app.errors import BadParameter, NoSuchFile, NotFinished, ResultDamaged, StoreDamaged
from app.http.api.library.analyses import check_queue, run_to_end
from app.http.api.library.batches import retry_failed
from app.http.api.library.files import MEDIA_TYPES, build_download_name, respond_with_file
from app.http.api.library.recordings import check_may_erase, has_trash, purge_recording
from app.http.api.trust import find_names
from app.http.pages.recording.analysis import find_results
from app.http.pages.recording.day import say_whose
from app.http.pages.rendering import Form, Page, UsedForm, UsedPage, first, read_body
from app.http.pages.validations import list_compared
from app.http.pages.views import (
    build_library,
    format_compared,
    format_moment,
    format_size,
    parse_filter,
    read_filter,
    write_filter,
)
from app.library.audit_log import touch
from app.library.batches import Batch
from app.library.jobs import JobFilter
from app.library.listing import Entry, Library
from app.library.recordings import HOLD_REASONS, RecordingFilter
from app.library.rows import Job, JobState
from app.ops.copies import find_backup_term
from app.report.export.naming import make_safe_name
from app.report.export.tables import (
    FRENCH_EXCEL,
    INTERNATIONAL,
    Origin,
    Row,
    encode_summary,
    encode_table,
    summarise_failure,
    summarise_results,
)
from app.report.words.messages import describe_problem
from app.report.words.wording import Language, fill, find_nearest
from app.request import SUBJECT_HINT, check_subject
from app.services import Services, UsedServices
from app.store.folder import COPY_BYTES, borrow_recording

MOST_ROWS = 10_000
MOST_BATCHES = 200
MOST_SQUARES = 2_000
MOST_CHOSEN = 500
SHOWN = 500
MOST_VIEWS = 50
LONGEST_VIEW = 60
LONGEST_TAG = 40
MOST_TAGS = 10
DAY_S = 86400
ZIP64_FROM_BYTES = 1 << 30
CSV = MEDIA_TYPES["csv"]
PROBLEM_COLUMNS = ("file", "subject", "code", "title", "detail", "fix")

router = APIRouter(include_in_schema=False)


# Tables, reports and original files of all that the list shows, or of what was chosen in it.


@router.get("/library/{name}.csv")
def take_table(name: Literal["summary", "summary_fr", "problems"], page: UsedPage) -> Response:
    """Return the main figures, or the problems, of every recording that the list shows."""
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
def take_chosen_table(
    name: Literal["summary", "summary_fr"], services: UsedServices, form: UsedForm
) -> Response:
    """Return one table of the chosen recordings."""
    return _send_table(services, _find_chosen(services, form), name)


def _find_shown(page: Page) -> Sequence[Entry]:
    return Library(page.services.store.reader).find_page(read_filter(page.request), MOST_ROWS)


def _find_chosen(services: Services, form: Form) -> Sequence[Entry]:
    """Find the recordings that are chosen: by name, or all that a filter lets through."""
    library, wanted = Library(services.store.reader), parse_filter(dict(parse_qsl(first(form, "query"))))
    if first(form, "every"):
        return library.find_page(wanted, MOST_ROWS)
    return library.find_chosen(form.get("recording", [])[:MOST_CHOSEN], wanted.batch)


def _send_table(services: Services, entries: Sequence[Entry], name: str) -> Response:
    """Return a row for each report; what has none is left out."""
    rows: list[Row] = []
    for job in (entry.job for entry in entries):
        try:
            if (results := find_results(services, job)) is not None:
                rows.append(summarise_results(results))
        except ResultDamaged as damaged:
            origin = Origin(job.file_name, job.request.subject, job.request.side)
            rows.append(summarise_failure(origin, damaged.code))
    body = encode_summary(rows, FRENCH_EXCEL if name == "summary_fr" else INTERNATIONAL)
    return respond_with_file(body, CSV, f"{name}.csv")


@router.get("/library/reports.zip")
def take_reports(page: UsedPage) -> Response:
    """Return the PDF of every report that the list shows; ``without-report.txt`` names what has none."""
    return _send_reports(page, _find_shown(page))


@router.post("/library/acts/reports.zip")
def take_chosen_reports(page: UsedPage, form: UsedForm) -> Response:
    """Return the PDFs of the chosen recordings."""
    return _send_reports(page, _find_chosen(page.services, form))


def _send_reports(page: Page, entries: Sequence[Entry]) -> Response:
    packed = pack_reports(page.services, [entry.job for entry in entries], page.language)
    return PackedResponse(packed, "reports.zip")


@router.get("/library/recordings.zip")
def take_recordings(page: UsedPage) -> Response:
    """Download the original files of a study, or of any list; ``without-recording.txt`` names lost ones."""
    jobs = list({entry.job.recording_id: entry.job for entry in _find_shown(page)}.values())
    for job in jobs:
        touch(job.recording_id, job.id)
    return PackedResponse(pack_recordings(page.services, jobs, page.language), "recordings.zip")


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


# Saved views, and acts on many recordings.


@router.post("/library/views")
def save_view(page: UsedPage, form: UsedForm) -> Response:
    """Save the filter and order of the list under a name. Raises BadParameter."""
    name, query = first(form, "name"), write_filter(parse_filter(dict(parse_qsl(first(form, "query")))))
    known = {view.name for view in page.services.views.find_all()}
    is_full = name not in known and len(known) >= MOST_VIEWS
    if not name or len(name) > LONGEST_VIEW or not name.isprintable() or is_full:
        raise BadParameter(name="name", value=name[:LONGEST_VIEW], allowed=f"<= {LONGEST_VIEW}")
    page.services.views.add(name, query)
    return page.go(f"/?{query}")


@router.post("/library/views/{view_id}/drop")
def drop_view(view_id: str, page: UsedPage) -> Response:
    """Forget a saved view."""
    page.services.views.drop(view_id)
    return page.go("/")


Act = Literal["side", "subject", "held", "tag", "untag", "study", "again", "delete", "restore"]


@dataclass(frozen=True, slots=True)
class Done:
    """What an act has done: to how many recordings, with facts for its sentence, and what undoes it."""

    number: int
    facts: Mapping[str, str] = field(default_factory=dict)
    undo: Sequence[str] = ()


@router.post("/library/acts/{act}")
async def do(act: Act, page: UsedPage, form: UsedForm) -> Response:
    """Do one thing to the chosen recordings, and say what was done."""
    done = await run_to_end(_act, act, page, form)
    words = page.words()["acted"]
    told = fill(words[act], {"n": str(done.number), **done.facts}) if done.number else words["none"]
    return page.render("library/acted.html", told=told, undo=done.undo, query=first(form, "query"))


def _act(act: Act, page: Page, form: Form) -> Done:
    recordings, store = page.services.recordings, page.services.store
    if act == "restore":
        ids = form.get("recording", [])
        for recording_id in ids:
            recordings.restore(recording_id)
        return Done(len(ids))
    if act == "delete" and not has_trash(page.services):
        check_may_erase(page.request)
    entries = _find_chosen(page.services, form)
    ids = [entry.job.recording_id for entry in entries]
    if act == "delete":
        for recording_id in ids:
            recordings.trash(recording_id)
        return Done(len(ids), undo=ids)
    if act == "untag":
        tag = first(form, "tag")
        return Done(recordings.tag(ids, taken=tag), {"tag": tag})
    if act == "tag":
        tags = _read_tags(first(form, "tag"))
        return Done(recordings.tag(ids, tags), {"tag": ", ".join(tags)})
    if act == "study":
        study = _read_code("study", first(form, "study"))
        if not study:
            raise BadParameter(name="study", value="", allowed=SUBJECT_HINT)
        for entry in entries:
            store.join_study(study, (entry.attempt or entry.job).id)
        return Done(len(entries), {"study": study})
    return Done(_analyse_again(page.services, entries, _read_change(act, form)))


def _read_tags(text: str) -> tuple[str, ...]:
    """Read tags with commas between. Raises BadParameter."""
    tags = tuple(dict.fromkeys(tag.strip() for tag in text.split(",") if tag.strip()))
    are_fit = all(len(tag) <= LONGEST_TAG and tag.isprintable() for tag in tags)
    if not 0 < len(tags) <= MOST_TAGS or not are_fit:
        raise BadParameter(name="tag", value=text[:LONGEST_TAG], allowed=f"<= {LONGEST_TAG}")
    return tags


def _read_code(name: str, text: str) -> str:
    try:
        return check_subject(text)
    except ValueError:
        raise BadParameter(name=name, value="", allowed=SUBJECT_HINT) from None


def _read_change(act: Act, form: Form) -> dict[str, Any]:
    """Read what is to be said of the recordings from now on; nothing if they are analysed as before.

    Raises BadParameter.
    """
    if act == "again":
        return {}
    if act == "held":
        return {"pose_held": "start"}
    value = first(form, act)
    if act == "subject":
        return {"subject": _read_code("subject", value)}
    if value not in ("", "left", "right"):
        raise BadParameter(name="side", value=value[:20], allowed="left, right")
    return {"side": value or None}


def _analyse_again(services: Services, entries: Sequence[Entry], change: Mapping[str, Any]) -> int:
    """State something else of recordings, and analyse again where that is not what the report says.

    What is under way, given by hand, or a comparison stays as it is. Raises Busy.
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
        say_whose(services, job, request, tuple(change))
    return services.store.repeat_all(asked)


# The trash: put in, take back, delete for good.


def _describe_trash(page: Page) -> dict[str, Any]:
    """Return how long the trash keeps what is in it, and the title of the page of terms."""
    days = page.services.retention.find_trash_term_s(page.services.settings.trash_term_s) / DAY_S
    term = fill(page.words()["trash"]["term"], {"days": f"{days:.0f}"})
    return {"term": term, "terms": page.words("trail")["terms"]["title"]}


@router.get("/recordings/{recording_id}/delete")
def ask_to_delete(recording_id: str, page: UsedPage) -> Response:
    """Say what goes before anything goes; without a trash, that it goes for good."""
    if not has_trash(page.services):
        return page.go(f"/recordings/{recording_id}/purge")
    return _ask(page, recording_id, for_good=False)


@router.get("/recordings/{recording_id}/purge")
def ask_to_purge(recording_id: str, page: UsedPage) -> Response:
    """Ask once more before a recording is deleted for good."""
    return _ask(page, recording_id, for_good=True)


def _ask(page: Page, recording_id: str, *, for_good: bool) -> Response:
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
        added=format_moment(row.created_at),
        analyses=len(page.services.store.find_page(JobFilter(recording_id=row.id), SHOWN)),
        for_good=is_for_good,
        hold_reasons=HOLD_REASONS,
        held_by=find_names(page.request, [row.hold_by], page.language)[row.hold_by],
        backups=backups,
    )


@router.post("/recordings/{recording_id}/delete")
def throw_away(recording_id: str, page: UsedPage) -> Response:
    """Put a recording and all that was made of it into the trash; one that is there stays as it is.

    A trash that keeps nothing is emptied at the next look, so that erasing is what is asked for.
    """
    if not has_trash(page.services):
        check_may_erase(page.request)
    page.services.recordings.trash(recording_id)
    return page.go("/trash")


@router.post("/recordings/{recording_id}/purge")
def delete_for_good(recording_id: str, page: UsedPage) -> Response:
    """Delete a recording, its analyses and every file of them."""
    page.services.recordings.check_hold(recording_id)
    page.services.recordings.trash(recording_id)
    purge_recording(page.services, recording_id)
    return page.go("/trash")


@router.post("/recordings/{recording_id}/restore")
def withdraw(recording_id: str, page: UsedPage) -> Response:
    """Take a recording out of the trash."""
    page.services.recordings.restore(recording_id)
    return page.go("/")


@router.get("/trash")
def show_trash(page: UsedPage) -> Response:
    """List what is in the trash."""
    found = page.services.recordings.find_page(RecordingFilter(trashed=True), SHOWN)
    shown = [(row, format_size(row.size_bytes, page.language)) for row in found]
    return page.render("library/trash.html", **_describe_trash(page), rows=shown)


# Studies: all of them, and each with its recordings. A script's batch is one, too.


@router.get("/batches")
def show_batches(page: UsedPage) -> Response:
    """List the batches, the newest first."""
    rows = [_describe_batch(page, batch) for batch in page.services.batches.find_newest(MOST_BATCHES)]
    return page.render("library/batches.html", rows=rows)


@router.get("/batches/{batch_id}")
def show_batch(batch_id: str, page: UsedPage) -> Response:
    """Show one batch: counts by state, every analysis, its tables."""
    batch = page.services.batches.get(batch_id)
    jobs = page.services.batches.find_jobs(batch_id)
    return page.render(
        "library/batch.html",
        **build_library(page, replace(read_filter(page.request), batch=batch.id)),
        batch=batch,
        told=_describe_batch(page, batch),
        squares=_draw_squares(page, batch_id, jobs),
        compared=list_compared(page, jobs),
        has_reports=any(j.state is JobState.SUCCEEDED and j.request.reference is None for j in jobs),
        failed=batch.counts[JobState.FAILED],
    )


@router.post("/batches/{batch_id}/retry")
def retry_batch(batch_id: str, page: UsedPage) -> Response:
    """Analyse again what failed (a plain form, so that it needs no script)."""
    retry_failed(batch_id, page.services)
    return page.go(f"/batches/{batch_id}")


@router.post("/batches/{batch_id}/participants")
def take_participants(
    batch_id: str, services: UsedServices, content: Annotated[bytes, Depends(read_body)]
) -> dict[str, Any]:
    """Read a list of participants, and analyse again every recording of which it says something else.

    Gives how many are analysed again (``changed``) and the files of the list that the study does not have.
    """
    every = services.batches.find_jobs(services.batches.get(batch_id).id)
    jobs = [job for job in every if job.request.reference is None]
    tasks = [Task(Path(job.recording_id, job.file_name), job.request, Path()) for job in jobs]
    assigned, unknown = assign_participants(tasks, content, None)
    changed = [
        (job, task.request) for job, task in zip(jobs, assigned, strict=True) if task.request != job.request
    ]
    check_queue(services, len(changed))
    for job, asked in changed:
        say_whose(services, job, asked, ("subject", "side"))
    return {"changed": services.store.repeat_all(changed), "unknown": [row.file for row in unknown]}


@dataclass(frozen=True, slots=True)
class Square:
    """A recording at a glance: its state, or the verdict on its data, and that in words."""

    id: str
    state: str
    title: str


def _draw_squares(page: Page, batch_id: str, jobs: Sequence[Job]) -> list[Square]:
    words, verdicts = page.words(), page.services.batches.find_verdicts(batch_id)
    squares = []
    for job in jobs[:MOST_SQUARES]:
        name = format_compared(job, words) or job.request.subject or job.file_name
        state, told = job.state.value, words["state"][job.state.value]
        if job.state is JobState.SUCCEEDED and (verdict := verdicts.get(job.id, "")):
            state, told = verdict, words["verdict_short"][verdict]
        title = fill(words["row"]["announce"], {"name": name, "state": told})
        squares.append(Square(job.id, state, title))
    return squares


def _describe_batch(page: Page, batch: Batch) -> dict[str, str]:
    """Return the id of a study, its name, when it was made, and how many analyses are in each state."""
    words = page.words()["batches"]
    counts = {state.value: str(number) for state, number in batch.counts.items() if number}
    told = fill(words["counts"], {"all": str(sum(batch.counts.values()))} | counts)
    name, when = batch.name or words["unnamed"], format_moment(batch.created_at)
    return {"id": batch.id, "name": name, "when": when, "counts": told}
