"""Stored files that are damaged or missing: never served as good, and how a report comes back."""

import asyncio
import csv
import hashlib
import io
import os
import secrets
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
from fastapi import Request
from fastapi.responses import FileResponse
from fastapi.testclient import TestClient
from starlette.types import Message

from acromion.app.analysis.attempt import MakeReport
from acromion.app.errors import NotHere, ResultDamaged
from acromion.app.http.api.library.files import serve_file
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job, JobState
from acromion.app.services import Services
from acromion.app.settings import Settings
from acromion.app.store.folder import (
    VERIFIED_TERM_S,
    ResultFile,
    Storage,
    VerifiedFiles,
    borrow_recording,
    borrow_result,
)
from tests import ROOT
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker, do_next, on_both_set_ups
from tests.loops import run_coroutine

ALTERED = stand_ins.RESULTS.replace(b"12.34", b"92.34")
Finish = Callable[..., Job]
FinishedAnalysis = tuple[JobStore, Storage]
HTML = {"accept": "text/html,application/xhtml+xml"}


def format_result_name(store: JobStore, job: Job, name: str) -> str:
    return f"analyses/{job.id}/{store.get(job.id).token}/{name}"


def alter(storage: Storage, name: str, content: bytes = ALTERED) -> None:
    part = storage.root / f"altered-{secrets.token_hex(4)}"
    part.write_bytes(content)
    storage.put(part, name)
    part.unlink()


def remove(storage: Any, name: str) -> None:
    if storage.is_local:
        (storage.root / name).unlink()
    else:
        storage._delete([name])


def spoil(storage: Storage, name: str, how: str) -> None:
    """Do to a stored file what disks and people do."""
    if how == "missing":
        remove(storage, name)
    else:
        alter(storage, name, b"" if how == "emptied" else ALTERED)


@pytest.fixture
def finish(add_job: AddJob, open_worker: OpenWorker) -> Finish:
    """Store a recording and let a worker analyse it."""

    def make(make_report: MakeReport = stand_ins.write_report, **about: Any) -> Job:
        job = add_job(**about)
        do_next(open_worker(make_report))
        return job

    return make


@pytest.fixture
def kept(store: JobStore, storage: Storage) -> FinishedAnalysis:
    """Rows and files."""
    return store, storage


def ask(client: TestClient, job: Job, name: str, **wishes: Any) -> Any:
    return client.get(f"/api/v1/analyses/{job.id}/{name}", **wishes)


HOWS = pytest.mark.parametrize("how", ["altered", "missing"])


@on_both_set_ups
@pytest.mark.parametrize("how", ["altered", "emptied", "missing"])
def test_a_result_is_a_problem_and_never_served_from_when_it_is_damaged_until_it_is_put_right(
    client: TestClient, kept: FinishedAnalysis, finish: Finish, how: str
) -> None:
    store, storage = kept
    job = finish()
    name = format_result_name(store, job, "results.json")
    assert ask(client, job, "results.json").status_code == 200

    spoil(storage, name, how)

    whole, part = (ask(client, job, "results.json", headers=one) for one in ({}, {"range": "bytes=0-3"}))
    for answer in (whole, part):
        assert answer.status_code == 410
        assert answer.headers["content-type"] == "application/problem+json"
        assert (answer.json()["code"], answer.json()["retryable"]) == ("E-RESULT-DAMAGED", True)
        assert "results.json" in answer.json()["detail"]
        assert "etag" not in answer.headers
    assert ask(client, job, "report.pdf?lang=en").content == b"%PDF-en"

    alter(storage, name, stand_ins.RESULTS)
    assert ask(client, job, "results.json").content == stand_ins.RESULTS


@pytest.mark.parametrize(
    ("name", "asked"),
    [
        ("report.en.html", "report.html?lang=en"),
        ("report.en.pdf", "report.pdf?lang=en"),
        ("summary.csv", "bundle.zip"),
        ("results.json", "tasks.csv"),
        ("elevation.parquet", "elevation.csv.gz"),
    ],
)
def test_what_is_made_of_a_damaged_result_is_a_problem(
    client: TestClient, kept: FinishedAnalysis, finish: Finish, name: str, asked: str
) -> None:
    store, storage = kept
    job = finish()
    alter(storage, format_result_name(store, job, name))

    answer = ask(client, job, asked)

    assert (answer.status_code, answer.json()["code"]) == (410, "E-RESULT-DAMAGED")
    assert name in answer.json()["detail"]


def test_a_folder_in_the_place_of_a_result_is_a_problem(
    client: TestClient, store: JobStore, storage: Storage, finish: Finish
) -> None:
    job = finish()
    path = storage.root / format_result_name(store, job, "results.json")
    path.unlink()
    path.mkdir()

    assert ask(client, job, "results.json").status_code == 410


@HOWS
def test_a_retry_of_a_damaged_analysis_makes_the_same_version_again_once(
    client: TestClient, kept: FinishedAnalysis, open_worker: OpenWorker, finish: Finish, how: str
) -> None:
    store, storage = kept
    job = finish()
    retry = f"/api/v1/analyses/{job.id}/retry"
    whole = client.post(retry)
    spoil(storage, format_result_name(store, job, "report.fr.pdf"), how)

    answer, second = (client.post(retry) for _ in range(2))
    told = ask(client, job, "report.pdf?lang=fr").json()["detail"]
    do_next(open_worker(stand_ins.write_report))

    again = store.get(answer.json()["id"])
    assert (whole.status_code, whole.json()["id"]) == (200, job.id)
    assert (answer.status_code, second.json()["id"], again.id in told) == (202, again.id, True)
    assert (again.state, again.request.version) == (JobState.SUCCEEDED, job.request.version)
    assert store.get(job.id).replaced_by == again.id != job.id
    assert ask(client, again, "report.pdf?lang=fr").content == b"%PDF-fr"


@pytest.mark.parametrize("way", ["sent", "asked for"])
def test_damaged_work_that_is_sent_or_asked_for_again_is_done_again(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker, way: str
) -> None:
    first = client.post("/api/v1/analyze", content=b"recording").json()
    do_next(open_worker(stand_ins.write_report))
    alter(storage, format_result_name(store, store.get(first["id"]), "results.json"))

    if way == "sent":
        second, third = (client.post("/api/v1/analyze", content=b"recording").json() for _ in range(2))
        assert third["id"] == second["id"]
    else:
        second = client.post("/api/v1/analyses", json={"recording_ids": [first["recording_id"]]}).json()

    assert store.get(first["id"]).replaced_by == second["id"] != first["id"]


@HOWS
def test_the_original_sent_again_is_kept_where_the_stored_one_is_damaged(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker, how: str
) -> None:
    first = client.post("/api/v1/analyze", content=b"recording").json()
    do_next(open_worker(stand_ins.write_report))
    spoil(storage, f"recordings/{first['recording_id']}", how)

    second = client.post("/api/v1/analyze", content=b"recording").json()

    assert second["recording_id"] != first["recording_id"]
    with borrow_recording(storage, second["recording_id"], second["sha256"]) as log:
        assert log.read_bytes() == b"recording"


@HOWS
def test_a_damaged_analysis_of_a_damaged_recording_cannot_be_made_again(
    client: TestClient, store: JobStore, storage: Storage, finish: Finish, how: str
) -> None:
    job = finish()
    alter(storage, format_result_name(store, job, "results.json"))
    spoil(storage, f"recordings/{job.recording_id}", how)

    answer = client.post(f"/api/v1/analyses/{job.id}/retry")

    assert (answer.status_code, answer.json()["code"]) == (410, "E-STORE-DAMAGED")
    assert store.get(job.id).replaced_by is None


@HOWS
def test_the_inspection_of_a_damaged_recording_is_a_problem(
    client: TestClient, storage: Storage, add_job: AddJob, how: str
) -> None:
    job = add_job()
    spoil(storage, f"recordings/{job.recording_id}", how)

    answer = client.get(f"/api/v1/recordings/{job.recording_id}/inspection")

    assert (answer.status_code, answer.json()["code"]) == (410, "E-STORE-DAMAGED")


@HOWS
def test_a_damaged_reference_gives_no_comparison(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker, how: str
) -> None:
    files = {"recording": ("a.csv", b"a"), "reference": ("b.csv", b"b")}
    job = store.get(client.post("/api/v1/validations", files=files).json()["id"])
    assert job.request.reference is not None
    spoil(storage, f"recordings/{job.request.reference.path}", how)

    do_next(open_worker(stand_ins.write_report))

    assert store.get(job.id).problem_code == "E-STORE-DAMAGED"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("results.json", ("en", "A file of this analysis is damaged or missing", "Analyse again")),
        (
            "answer.{}.txt",
            ("fr", "Un fichier de cette analyse est endommagé ou absent", "Analyser de nouveau"),
        ),
    ],
)
def test_the_page_of_a_damaged_analysis_says_so_and_offers_to_analyse_again(
    client: TestClient, kept: FinishedAnalysis, finish: Finish, words: tuple[str, str, str], name: str
) -> None:
    store, storage = kept
    language, title, button = words
    job = finish()
    remove(storage, format_result_name(store, job, name.format(language)))

    page = client.get(f"/analyses/{job.id}?lang={language}")

    assert page.status_code == 200
    assert title in page.text
    assert f'action="/analyses/{job.id}/retry"><button type="submit" class="button">{button}' in page.text
    assert 'class="figures"' not in page.text


def test_the_button_leads_to_a_new_analysis_and_old_links_follow_it(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker, finish: Finish
) -> None:
    job = finish()
    alter(storage, format_result_name(store, job, "results.json"))

    pressed = client.post(f"/analyses/{job.id}/retry")
    do_next(open_worker(stand_ins.write_report))

    new = store.get(job.id).replaced_by
    assert (pressed.status_code, pressed.headers["location"]) == (303, f"/analyses/{new}")
    assert client.get(f"/analyses/{job.id}").headers["location"] == f"/analyses/{new}"
    assert "12.3" in client.get(f"/analyses/{new}?lang=en").text


def test_a_browser_that_opens_a_damaged_report_gets_a_page_with_the_button(
    client: TestClient, store: JobStore, storage: Storage, finish: Finish
) -> None:
    job = finish()
    alter(storage, format_result_name(store, job, "report.en.html"))

    page = ask(client, job, "report.html?lang=en", headers=HTML)

    assert page.status_code == 410
    assert page.headers["content-type"].startswith("text/html")
    assert f'action="/analyses/{job.id}/retry"' in page.text


def test_the_page_of_a_damaged_recording_names_no_cure_that_cannot_help(
    client: TestClient, store: JobStore, storage: Storage, finish: Finish
) -> None:
    job = finish()
    alter(storage, format_result_name(store, job, "results.json"))
    alter(storage, f"recordings/{job.recording_id}")

    page = client.get(f"/analyses/{job.id}?lang=en").text

    assert "Upload the original file again, or restore a backup" in page
    assert "Analyse again</button>" not in page


@HOWS
def test_the_page_of_a_whole_report_names_its_damaged_recording(
    client: TestClient, storage: Storage, finish: Finish, how: str
) -> None:
    job = finish()
    spoil(storage, f"recordings/{job.recording_id}", how)

    page = client.get(f"/analyses/{job.id}?lang=en").text

    assert "The stored recording is damaged" in page
    assert "12.3" in page


@HOWS
def test_lists_are_shown_with_a_damaged_analysis_in_them_which_the_table_names(
    client: TestClient, kept: FinishedAnalysis, finish: Finish, how: str
) -> None:
    store, storage = kept
    job = finish(file_name="a.csv")
    spoil(storage, format_result_name(store, job, "results.json"), how)

    for path in ("/", "/rows", "/trash", "/library/problems.csv", "/api/v1/analyses"):
        assert client.get(path).status_code == 200, path
    (row,) = csv.DictReader(io.StringIO(client.get("/library/summary.csv").content.decode("utf-8-sig")))
    assert (row["file_name"], row["error_code"]) == ("a.csv", "E-RESULT-DAMAGED")
    assert row["time_above_60_percent"] == ""


def test_the_tables_of_a_batch_name_a_damaged_result_and_it_can_be_retried(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker
) -> None:
    recording = client.post("/api/v1/recordings", content=b"recording").json()["id"]
    batch = client.post("/api/v1/batches", json={"items": [{"recording_id": recording}]}).json()["id"]
    do_next(open_worker(stand_ins.write_report))
    (job,) = store.find_newest()
    alter(storage, format_result_name(store, job, "results.json"))

    tables = [client.get(f"/api/v1/batches/{batch}/{name}.csv").text for name in ("summary", "problems")]
    counts = client.post(f"/api/v1/batches/{batch}/retry-failed").json()["counts"]

    assert all("E-RESULT-DAMAGED" in table for table in tables)
    assert (counts["queued"], counts["succeeded"]) == (1, 0)


def test_a_damaged_analysis_beside_another_is_a_problem_answer(
    client: TestClient, store: JobStore, storage: Storage, finish: Finish
) -> None:
    one, other = (finish(stand_ins.write_report, content=content) for content in (b"1", b"2"))
    alter(storage, format_result_name(store, other, "results.json"))

    for path in (
        "/api/v1/compare/report.pdf?analysis={0}&analysis={1}",
        "/api/v1/pair/pair.json?left={0}&right={1}",
        "/beside/pair?first={0}&second={1}",
    ):
        answer = client.get(path.format(one.id, other.id))
        assert (answer.status_code, "E-RESULT-DAMAGED" in answer.text) == (410, True), path


def test_a_damaged_report_of_two_is_made_again(
    client: TestClient, settings: Settings, finish: Finish, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.library.report_cache.load_and_make_pair", stand_ins.write_pair)
    one, other = (finish(stand_ins.write_report, content=content) for content in (b"1", b"2"))
    address = f"/beside/compare/report.pdf?first={one.id}&second={other.id}"
    assert client.get(address).content == b"%PDF-two"
    (kept,) = (settings.data_dir / "cache" / "pairs").glob("*/report.en.pdf")

    kept.write_bytes(b"%PDF-tw0")

    assert client.get(address).content == b"%PDF-two"


def test_a_replaced_report_is_not_what_counts_in_the_library(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker, finish: Finish
) -> None:
    job = finish()
    alter(storage, format_result_name(store, job, "results.json"))
    client.post(f"/analyses/{job.id}/retry")
    do_next(open_worker(stand_ins.refuse))

    page = client.get("/rows?lang=en").text

    assert "Report ready" not in page
    assert f"/analyses/{job.id}" not in page


def test_a_failed_repetition_cannot_be_withdrawn_for_the_damaged_report(
    client: TestClient, store: JobStore, storage: Storage, open_worker: OpenWorker, finish: Finish
) -> None:
    job = finish()
    alter(storage, format_result_name(store, job, "results.json"))
    again = store.repeat(job, "web")
    do_next(open_worker(stand_ins.refuse))

    with pytest.raises(NotHere):
        store.withdraw(again.id)


RESULT = ResultFile("a.txt", hashlib.sha256(b"whole").hexdigest(), 5)


class Hours:
    """A clock that is set by hand."""

    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def clock() -> Hours:
    return Hours()


def open_folder(root: Path, clock: Callable[[], float] = time.monotonic) -> Storage:
    return Storage(root, VerifiedFiles(clock))


@pytest.fixture
def folder(tmp_path: Path, clock: Hours) -> Storage:
    """A folder with one result, and a clock of the test's own."""
    kept = open_folder(tmp_path / "kept", clock)
    kept.prepare()
    (kept.open_attempt("an_1", "t") / "a.txt").write_bytes(b"whole")
    kept.keep_attempt("an_1", "t")
    return kept


def read(folder: Storage) -> bytes:
    with borrow_result(folder, "an_1", "t", RESULT) as path:
        return path.read_bytes()


def rot(folder: Storage) -> None:
    """Alter bytes as a disk does: neither size nor time nor inode tells."""
    path = folder.root / "analyses" / "an_1" / "t" / "a.txt"
    status = path.stat()
    with path.open("r+b") as file:
        file.write(bytes(5))
    os.utime(path, ns=(status.st_atime_ns, status.st_mtime_ns))


def test_a_verdict_spares_another_reading(folder: Storage, monkeypatch: pytest.MonkeyPatch) -> None:
    read(folder)
    monkeypatch.setattr("acromion.app.store.folder.hash_file", lambda _: pytest.fail("read again"))

    assert read(folder) == b"whole"


def test_what_rots_is_found_when_the_verdict_is_an_hour_old(folder: Storage, clock: Hours) -> None:
    read(folder)
    rot(folder)
    clock.now_s = VERIFIED_TERM_S

    with pytest.raises(ResultDamaged):
        read(folder)


def test_a_verdict_does_not_outlive_the_start(folder: Storage, monkeypatch: pytest.MonkeyPatch) -> None:
    read(folder)
    monkeypatch.setattr("acromion.app.store.folder.hash_file", lambda _: "0" * 64)

    with pytest.raises(ResultDamaged):
        read(open_folder(folder.root))


def test_a_verdict_is_of_one_digest(folder: Storage) -> None:
    read(folder)

    with pytest.raises(ResultDamaged), borrow_result(folder, "an_1", "t", ResultFile("a.txt", "0" * 64, 5)):
        pass


def test_a_file_that_is_altered_while_it_is_read_is_damaged(folder: Storage) -> None:
    with pytest.raises(ResultDamaged), borrow_result(folder, "an_1", "t", RESULT) as path:
        path.write_bytes(b"other")


def test_a_file_that_is_replaced_by_the_same_bytes_while_it_is_read_is_whole(folder: Storage) -> None:
    with borrow_result(folder, "an_1", "t", RESULT) as path:
        path.unlink()
        path.write_bytes(b"whole")


def test_a_recording_that_is_damaged_while_it_is_analysed_gives_no_report(
    store: JobStore, storage: Storage, add_job: AddJob, open_worker: OpenWorker
) -> None:
    job = add_job()

    do_next(open_worker(stand_ins.spoil_recording))

    assert store.get(job.id).problem_code == "E-STORE-DAMAGED"


def send_results(client: TestClient, job: Job, sent: list[bytes], spoil: Callable[[Path], object]) -> None:
    """Send the results of an analysis piece by piece; ``spoil`` is called with the answer's file at each."""
    services: Services = cast("Any", client.app).state.services
    scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": []}
    answer = cast("FileResponse", serve_file(Request(scope), services, job, "results.json"))

    async def receive() -> Message:
        await asyncio.Event().wait()  # nobody hangs up
        raise AssertionError

    async def send(message: Message) -> None:
        sent.append(message.get("body", b""))
        spoil(Path(answer.path))

    run_coroutine(answer(scope, receive, send))


def test_an_answer_breaks_off_where_its_file_is_altered_on_the_way(
    client: TestClient, store: JobStore, storage: Storage, finish: Finish
) -> None:
    job = store.get(finish().id)
    sent: list[bytes] = []

    with pytest.raises(ResultDamaged):
        send_results(client, job, sent, lambda path: path.write_bytes(ALTERED))

    assert b"".join(sent) == b""


def test_too_many_verdicts_forget_the_oldest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("acromion.app.store.folder.MOST_VERIFIED", 2)
    verdicts = VerifiedFiles()

    for name in ("a", "b", "c"):
        verdicts.remember(name, "0", (1,))

    assert [verdicts.is_known(name, "0", (1,)) for name in ("a", "b", "c")] == [False, True, True]


def test_only_the_store_itself_and_its_upkeep_fetch_without_comparing() -> None:
    app = ROOT / "app"
    callers = {
        path.relative_to(app).as_posix() for path in app.rglob("*.py") if ".fetch(" in path.read_text("utf-8")
    }

    assert callers <= {"store/folder.py", "ops/backup.py"}


def test_no_copy_of_health_data_stays_in_a_browser(client: TestClient, finish: Finish) -> None:
    job = finish()

    for name in ("results.json", "report.html", "report.pdf", "answer.txt", "bundle.zip"):
        answer = ask(client, job, name)
        known = ask(client, job, name, headers={"if-none-match": answer.headers["etag"]})
        assert (answer.headers["cache-control"], known.headers["cache-control"]) == ("no-store", "no-store")
        assert known.status_code == 304, name
