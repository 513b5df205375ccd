"""Who did what: a line for each act, in its commit."""

import csv
import io
import json
import threading
from collections.abc import Callable

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import insert, text, update
from sqlalchemy.exc import IntegrityError

from acromion.app.http.api.housekeeping import write_side_files
from acromion.app.http.middleware.access import (
    MAX_COUNTED_CLIENTS,
    MAX_LINES,
    MAX_RECENT_READS,
    MAX_UNAUTHENTICATED_LINES,
    WINDOW_S,
    RecentReads,
    RefusedLines,
)
from acromion.app.library.audit_log import ACTS, AuditFilter, AuditLine, acting, find_lines, record
from acromion.app.library.database.tables import facts, sessions
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job
from acromion.app.logs import LineFormatter
from acromion.app.queue.worker import WorkerContext, open_worker_context, run_next
from acromion.app.report.words.wording import LANGUAGES, load_wording
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from tests.app import stand_ins
from tests.app.accounts.conftest import Clock, House
from tests.app.conftest import AddJob, do_next, on_both_databases
from tests.crash.program import write_digest

UNKNOWN = "an_00000000000000ff"
NAVIGATION = {"accept": "text/html", "sec-fetch-mode": "navigate"}


def read(store: JobStore, question: AuditFilter | None = None) -> list[AuditLine]:
    """Return lines, the oldest first."""
    return list(find_lines(store.reader, question or AuditFilter()))[::-1]


def list_acts(store: JobStore) -> list[str]:
    return [line.act for line in read(store)]


def do_one_job(open_worker: Callable[..., WorkerContext], add_job: AddJob) -> Job:
    job = add_job()
    assert do_next(open_worker(write_digest))
    return job


# A line in the commit of its act.


@on_both_databases
def test_a_rollback_drops_the_line_with_the_act_and_logs_nothing(
    store: JobStore, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level("INFO"), pytest.raises(IntegrityError):
        _break_off(store)
    with store.engine.begin() as connection:
        connection.execute(insert(facts).values(name="y", value="1"))

    assert list_acts(store) == []
    assert caplog.records == []


def test_a_worker_s_report_is_an_act_of_the_system(
    store: JobStore, open_worker: Callable[..., WorkerContext], add_job: AddJob
) -> None:
    job = do_one_job(open_worker, add_job)

    last = read(store)[-1]
    assert (last.who, last.act, last.analysis_id) == ("system", "analysis.succeeded", job.id)


def test_a_line_takes_no_act_that_is_not_on_the_list_and_no_sentence(store: JobStore) -> None:
    with store.engine.begin() as connection:
        with pytest.raises(ValueError, match=r"made\.up"):
            record(connection, "made.up")  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="refused"):
            record(connection, "refused", other={"why": "Jane Doe, born 1970"})


def test_no_line_holds_what_was_said_of_a_recording(client: TestClient, store: JobStore) -> None:
    words = {"file_name": "Zoe.csv", "subject": "CANARY-7", "external_id": "CANARY-8", "note": "CANARY-9"}
    row = client.post("/api/v1/recordings", params=words, content=b"bytes").json()
    client.patch(f"/api/v1/recordings/{row['id']}", json={"note": "CANARY-9 again"})
    client.get(f"/api/v1/recordings/{row['id']}")
    client.get("/api/v1/recordings", params={"subject": "CANARY-7"})

    written = json.dumps([line.other + line.act for line in read(store)])
    assert "recording.changed" in written
    assert "CANARY" not in written
    assert "Zoe" not in written


@on_both_databases
def test_lines_of_many_at_once_are_all_there(store: JobStore, settings: Settings) -> None:
    def work() -> None:
        own = JobStore(settings)
        for _ in range(10):
            with own.engine.begin() as connection:
                record(connection, "view.saved")
        own.close()

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert list_acts(store) == ["view.saved"] * 40


def test_each_line_is_logged_as_json(store: JobStore, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level("INFO"), acting("per_1"), store.engine.begin() as connection:
        record(connection, "token.added", other={"token": "tok_1"})

    (logged,) = (LineFormatter("%(asctime)s %(message)s").format(one) for one in caplog.records)
    (line,) = read(store)
    told = {"audit": "token.added", "act": "token.added", "at": line.at, "who": "per_1"}
    assert json.loads(logged) == told | {"recording_id": "", "analysis_id": "", "other": {"token": "tok_1"}}


def test_every_act_has_words_in_both_languages() -> None:
    for language in LANGUAGES:
        assert set(load_wording(language, "trail")["act"]) == {act.replace(".", "_") for act in ACTS}


# Readings, downloads, refusals.


def test_readings_of_a_report_are_one_line_for_each_reader_and_a_file_is_a_line_each_time(
    house: House, caller: TestClient
) -> None:
    job = _finish_job(house)
    page, api = f"/analyses/{job.id}", f"/api/v1/analyses/{job.id}"
    cases: dict[str, tuple[list[str], str, int]] = {
        "pieces": ([page, page, api], "report.read", 1),
        "another": ([page], "report.read", 1),
        "browser": ([f"{page}/report.html"] * 2, "report.read", 1),
        "downloads": ([f"{api}/report.pdf"] * 2, "file.exported", 2),
        "exports": ([f"{api}/results.json"] * 2, "file.exported", 2),
        "ranges": ([f"{api}/results.json {piece}" for piece in ("0-1", "2-3", "4-")], "file.exported", 1),
        "range": ([f"{api}/results.json 1-"], "file.exported", 1),
    }

    for name, (asked, act, count) in cases.items():
        house.add_person(name, "clinician")
        reader = dict(house.log_in(name))
        for address in asked:
            path, _, piece = address.partition(" ")
            headers = reader | ({"Range": f"bytes={piece}"} if piece else {})
            answer = caller.get(path, headers=headers)
            assert answer.status_code == (206 if piece else 200), name
            if path.endswith(".pdf"):
                assert answer.headers["content-disposition"].startswith("attachment")
        assert _find_read(house, name) == [(act, job.recording_id, job.id)] * count, name

    lines = _find_by(house, "exports", "file.exported")
    assert [json.loads(line.other)["name"] for line in lines] == ["results.json"] * 2


def test_a_file_that_a_page_sends_in_answer_to_a_form_is_a_download(house: House, caller: TestClient) -> None:
    _finish_job(house)
    clinician = dict(house.log_in("clinician"))

    for _ in range(2):
        answer = caller.post("/library/acts/reports.zip", data={"every": "1"}, headers=clinician)
        assert answer.status_code == 200

    assert len(_find_by(house, "clinician", "file.exported")) == 2


def test_a_file_that_is_not_given_before_the_password_is_no_export(house: House, caller: TestClient) -> None:
    _finish_job(house)
    clinician = dict(house.log_in("clinician"))
    with house.accounts.database.write() as connection:
        connection.execute(update(sessions).values(confirmed_s=0.0))

    answer = caller.get("/library/reports.zip", headers=clinician | NAVIGATION)

    assert (answer.status_code, answer.headers["location"].split("?")[0]) == (303, "/confirm")
    assert _find_by(house, "clinician", "file.exported") == []


def test_an_act_by_a_token_names_the_token(house: House, caller: TestClient) -> None:
    bearer = house.add_token("clinician", "upload")
    caller.post("/api/v1/analyze", content=b"bytes", headers={"Authorization": f"Bearer {bearer}"})

    stored = read(house.services.store, AuditFilter(act="recording.stored"))[-1]
    assert stored.who.startswith("tok_")


@pytest.mark.parametrize(
    ("path", "headers", "who", "status"),
    [
        ("/api/v1/analyses", {}, "nobody", 401),
        ("/api/v1/analyses", {}, "employer", 403),
        ("/analyses", NAVIGATION, "nobody", 303),  # is led to the login and has read nothing
    ],
)
def test_a_refusal_leaves_a_line_with_the_id_that_was_asked_for(
    house: House, caller: TestClient, path: str, headers: dict[str, str], who: str, status: int
) -> None:
    job = _store_job(house)
    session = dict(house.log_in(who)) if who in house.people else {}

    assert caller.get(f"{path}/{job.id}", headers=headers | session).status_code == status

    found = read(house.services.store, AuditFilter(who=house.people.get(who, who)))
    lines = [(line.act, line.analysis_id) for line in found if not line.act.startswith("login.")]
    assert lines == [("refused", job.id)]


def test_each_refused_id_is_a_line_once_wherever_it_stood(house: House, caller: TestClient) -> None:
    first, second = "an_0000000000000001", "an_0000000000000002"
    cases = {
        "path": [f"/api/v1/analyses/{one}" for one in (first, second, first)],
        "query": [f"/api/v1/compare/comparison.json?analysis={first}&analysis={second}"],
    }

    for name, addresses in cases.items():
        house.add_person(name, "employer")
        for address in addresses:
            assert caller.get(address, headers=dict(house.log_in(name))).status_code == 403
        assert [line.analysis_id for line in _find_by(house, name, "refused")] == [first, second], name

    for _ in range(2):  # may be read, but is not there
        caller.get("/api/v1/batches/ba_00000000000000ff", headers=dict(house.log_in("clinician")))
    (line,) = _find_by(house, "clinician", "refused")
    assert json.loads(line.other)["asked"] == "ba_00000000000000ff"


def test_what_is_no_id_is_in_no_line_of_a_refusal(house: House, caller: TestClient) -> None:
    employer = dict(house.log_in("employer"))

    for typed in ("CANARY-7", "an_CANARY", "CANARY-8"):
        caller.get(f"/api/v1/analyses/{typed}?subject={typed}", headers=employer)

    (line,) = _find_by(house, "employer", "refused")
    assert "CANARY" not in str(line)


def test_who_guesses_many_ids_leaves_so_many_lines_and_one_more_and_others_keep_theirs(
    house: House, caller: TestClient
) -> None:
    for number in range(MAX_LINES + 5):
        caller.get(f"/api/v1/analyses/an_{number:016x}")
    caller.get(f"/api/v1/analyses/{UNKNOWN}", headers=dict(house.log_in("clinician")))

    acts = [line.act for line in read(house.services.store, AuditFilter(who="nobody"))]
    assert (acts.count("refused"), acts.count("refused.more")) == (MAX_LINES, 1)
    assert [line.analysis_id for line in _find_by(house, "clinician", "refused")] == [UNKNOWN]


def test_a_response_does_not_go_out_without_its_line(house: House, caller: TestClient) -> None:
    job = _store_job(house)
    clinician = dict(house.log_in("clinician"))
    with house.services.store.engine.begin() as connection:
        connection.execute(text("ALTER TABLE audit_log RENAME TO audit_log_away"))
    refused = caller.get(f"/api/v1/analyses/{job.id}", headers=clinician)
    with house.services.store.engine.begin() as connection:
        connection.execute(text("ALTER TABLE audit_log_away RENAME TO audit_log"))

    assert refused.status_code >= 500
    assert "shift.gt3x" not in refused.text
    assert caller.get(f"/api/v1/analyses/{job.id}", headers=clinician).status_code == 200


def test_health_help_and_static_files_have_no_line(house: House, caller: TestClient) -> None:
    for address in ("/healthz", "/readyz", "/help", "/api/v1/version"):
        assert caller.get(address, headers=dict(house.log_in("auditor"))).status_code == 200

    assert _find_read(house, "auditor") == []


# Questions.


def test_who_touched_a_subject_between_two_moments_and_what_somebody_did(
    house: House, caller: TestClient
) -> None:
    job, other = _store_job(house, "W-1"), _store_job(house, "W-2", b"other")
    for one in (job, other):
        caller.get(f"/analyses/{one.id}", headers=dict(house.log_in("clinician")))
    auditor, clinician = dict(house.log_in("auditor")), house.people["clinician"]

    def find(**asked: str) -> list[dict[str, str]]:
        items: list[dict[str, str]] = caller.get("/api/v1/trail", params=asked, headers=auditor).json()[
            "items"
        ]
        return items

    found = find(subject="W-1", **{"from": "2020-01-01"}, to="2999-01-01")
    assert [line["act"] for line in found] == ["report.read", "analysis.asked", "recording.stored"]
    assert {line["recording_id"] for line in found} == {job.recording_id}
    assert find(subject="W-1", **{"from": "2020-01-01"}, to="2021-01-01") == []
    told = [(line["who"], line["act"]) for line in find(who=clinician)]
    assert [one for one in told if not one[1].startswith("login.")] == [(clinician, "report.read")] * 2


def test_an_erased_recording_is_asked_for_by_its_id(house: House, caller: TestClient) -> None:
    job = _store_job(house)
    clinician, auditor = dict(house.log_in("clinician")), dict(house.log_in("auditor"))
    erased = caller.delete(f"/api/v1/recordings/{job.recording_id}?purge=now", headers=clinician)
    assert erased.status_code == 200

    found = caller.get("/api/v1/trail", params={"recording": job.recording_id}, headers=auditor).json()
    acts = [line["act"] for line in found["items"]]

    assert acts[:3] == ["recording.purged", "recording.purging", "recording.trashed"]


def test_the_lines_are_exported_as_a_table_and_as_json_lines_with_a_line_each_time(
    house: House, caller: TestClient
) -> None:
    auditor = dict(house.log_in("auditor"))
    table, lines, _ = (
        caller.get(f"/api/v1/trail/trail.{form}", headers=auditor) for form in ("csv", "jsonl", "csv")
    )

    rows = list(csv.DictReader(io.StringIO(table.content.decode("utf-8-sig"))))
    assert rows[-1]["act"] == "person.added"
    assert json.loads(lines.text.splitlines()[-1])["act"] == "person.added"
    assert len(_find_by(house, "auditor", "trail.exported")) == 3


def test_the_page_shows_names_and_no_values(house: House, caller: TestClient) -> None:
    job = _store_job(house, "CANARY-7")
    caller.get(f"/analyses/{job.id}", headers=dict(house.log_in("clinician")))

    page = caller.get("/trail?lang=en", headers=dict(house.log_in("auditor"))).text

    assert "<h1>Audit log</h1>" in page
    assert "Clinician" in page
    assert "CANARY" not in page


# Who asked, concluded, released.


def test_a_version_names_who_asked_for_it(house: House, caller: TestClient) -> None:
    clinician = dict(house.log_in("clinician"))
    asked = caller.post("/api/v1/analyze", content=b"bytes", headers=clinician).json()

    shown = caller.get(f"/api/v1/analyses/{asked['id']}", headers=clinician).json()

    write_side_files(house.services)
    side = house.services.storage.read_small(f"recordings/{asked['recording_id']}.json")
    assert shown["asked_by"] == house.people["clinician"]
    assert house.people["clinician"].encode() in (side or b"")


def test_with_accounts_a_conclusion_bears_the_person_s_name(house: House, caller: TestClient) -> None:
    job = _store_job(house)
    form = {"text": "Fine.", "name": "Somebody Else", "date": "2026-11-24"}
    clinician = dict(house.log_in("clinician"))

    answer = caller.post(f"/analyses/{job.id}/conclude", data=form, headers=clinician)

    again = house.services.store.get(answer.headers["location"].rpartition("/")[2])
    assert again.request.conclusion is not None
    assert again.request.conclusion.name == "Clinician"


def test_at_the_machine_the_machine_asks_and_the_name_of_a_conclusion_is_typed(
    client: TestClient, store: JobStore
) -> None:
    job = client.post("/api/v1/analyze", content=b"bytes").json()
    form = {"text": "Fine.", "name": "Dr Typed", "date": "2026-11-24"}

    answer = client.post(f"/analyses/{job['id']}/conclude", data=form)

    again = store.get(answer.headers["location"].rpartition("/")[2])
    assert job["asked_by"] == "machine"
    assert again.request.conclusion is not None
    assert again.request.conclusion.name == "Dr Typed"


def _break_off(store: JobStore) -> None:
    """Do an act whose transaction fails."""
    with store.engine.begin() as connection:
        record(connection, "webhook.added")
        connection.execute(insert(facts).values(name="x", value="1"))
        connection.execute(insert(facts).values(name="x", value="2"))


def _store_job(house: House, subject: str = "", content: bytes = b"recording") -> Job:
    upload = house.services.storage.open_upload(1_000_000)
    upload.write(content)
    return house.services.store.add(upload.keep(), ReportRequest("shift.gt3x", subject))


def _finish_job(house: House) -> Job:
    """Store a recording whose report is made, by a stand-in for the science."""
    job = _store_job(house)
    worker = open_worker_context(house.services.settings, stand_ins.write_report)
    assert run_next(worker)
    worker.store.close()
    return job


def _find_by(house: House, name: str, act: str) -> list[AuditLine]:
    return read(house.services.store, AuditFilter(who=house.people[name], act=act))


def _find_read(house: House, name: str) -> list[tuple[str, str, str]]:
    """Return what somebody read or took, without the log-ins, which come into the log when they may."""
    lines = read(house.services.store, AuditFilter(who=house.people[name]))
    told = [(line.act, line.recording_id, line.analysis_id) for line in lines]
    return [one for one in told if not one[0].startswith("login.")]


def test_a_number_that_no_line_can_have_is_refused(house: House, caller: TestClient) -> None:
    auditor = dict(house.log_in("auditor"))

    answer = caller.get("/api/v1/trail", params={"before": 1 << 63}, headers=auditor)

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")


# How many lines refusals leave: guesses are seen, and the log does not grow by them without bound.


def take_many(lines: RefusedLines, asker: str, number: int, *, is_stranger: bool = False) -> list[str]:
    return [lines.take(asker, is_stranger=is_stranger) for _ in range(number)]


def test_after_the_most_one_line_says_that_there_were_more() -> None:
    taken = take_many(RefusedLines(), "per_1", MAX_LINES + 3)

    assert taken == ["line"] * MAX_LINES + ["more", "none", "none"]


def test_the_next_window_begins_anew(clock: Clock) -> None:
    lines = RefusedLines(clock)
    take_many(lines, "per_1", MAX_LINES + 3)

    clock.wait(WINDOW_S)

    assert lines.take("per_1", is_stranger=False) == "line"


def test_strangers_use_up_nothing_of_who_is_logged_in() -> None:
    lines = RefusedLines()
    for number in range(2 * MAX_UNAUTHENTICATED_LINES):
        lines.take(f"192.0.2.{number}", is_stranger=True)

    assert lines.take("per_1", is_stranger=False) == "line"


def test_many_addresses_take_no_memory_without_bound_and_free_no_stranger() -> None:
    lines = RefusedLines()

    taken = [lines.take(f"host{number}", is_stranger=True) for number in range(2 * MAX_COUNTED_CLIENTS)]

    assert len(lines._counts) <= MAX_COUNTED_CLIENTS
    assert taken.count("line") == MAX_UNAUTHENTICATED_LINES


def test_many_at_once_are_counted_one_by_one() -> None:
    lines, taken = RefusedLines(), []

    def ask() -> None:
        taken.extend(take_many(lines, "per_1", MAX_LINES))

    threads = [threading.Thread(target=ask) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()

    assert (taken.count("line"), taken.count("more")) == (MAX_LINES, 1)


def test_many_readings_take_no_memory_without_bound() -> None:
    known = RecentReads()

    for number in range(MAX_RECENT_READS + 10):
        known.begin((str(number),))

    assert len(known._at_s) == MAX_RECENT_READS
    assert not known.is_new((str(MAX_RECENT_READS),))
