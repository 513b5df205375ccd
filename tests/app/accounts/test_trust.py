"""Releases, holds, terms, group figures."""

import base64
import io
import json
import re
from collections.abc import Callable
from dataclasses import dataclass

import pytest
from fastapi.testclient import TestClient
from pypdf import PdfReader
from sqlalchemy import insert, update

from acromion.app.http.api.housekeeping import apply_retention, write_side_files
from acromion.app.http.api.library import released
from acromion.app.library.audit_log import AuditFilter, find_lines
from acromion.app.library.batches import identify_study
from acromion.app.library.database.tables import analyses, answers
from acromion.app.library.governance import DAY_S, AggregateStore, ReleaseStore, RetentionStore, StudyGroup
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingStore
from acromion.app.library.rows import Job
from acromion.app.queue.worker import WorkerContext
from acromion.app.request import ReportRequest
from acromion.app.services import Services
from acromion.app.store.folder import Storage
from tests.app.accounts.conftest import House
from tests.app.conftest import AddJob, do_next, on_both_databases
from tests.crash.program import write_digest


def find_acts(services: Services, act: str) -> list[tuple[str, str, str]]:
    """Return who, recording and analysis of each line of an act, the oldest first."""
    lines = list(find_lines(services.store.reader, AuditFilter(act=act)))[::-1]
    return [(line.who, line.recording_id, line.analysis_id) for line in lines]


def finish(job: Job, open_worker: Callable[..., WorkerContext]) -> None:
    assert do_next(open_worker(write_digest)), job.id


# Releases.


def test_a_report_is_released_and_taken_back_by_further_rows(
    store: JobStore, add_job: AddJob, open_worker: Callable[..., WorkerContext]
) -> None:
    job = add_job()
    finish(job, open_worker)
    releases = ReleaseStore(store.engine, store.reader)

    done = releases.release(store.get(job.id), "per_1")
    again = releases.release(store.get(job.id), "per_2")
    back = releases.withdraw(store.get(job.id), "per_1")

    assert done is not None
    assert again is not None
    assert (done.who, again.who, back) == ("per_1", "per_1", None)
    assert done.report_id == next(
        file.sha256 for file in store.find_files(job.id) if file.name == "results.json"
    )


def test_a_later_version_is_not_released_by_it(
    house: House, caller: TestClient, open_worker: Callable[..., WorkerContext]
) -> None:
    clinician = dict(house.log_in("clinician"))
    first = ask(caller, clinician)
    early = caller.post(f"/api/v1/analyses/{first['id']}/release", headers=clinician)
    do_next(open_worker(write_digest))
    released = caller.post(f"/api/v1/analyses/{first['id']}/release", headers=clinician)
    form = {"text": "Fine.", "name": "-", "date": "2026-11-24"}
    later = caller.post(f"/analyses/{first['id']}/conclude", data=form, headers=clinician)
    second = later.headers["location"].rpartition("/")[2]
    do_next(open_worker(write_digest))

    assert early.status_code == 404  # there is no report yet
    assert released.json()["released_by"] == house.people["clinician"]
    shown = caller.get(f"/api/v1/analyses/{second}/release", headers=clinician).json()
    assert shown["released_by"] is None


@pytest.fixture
def own_report(
    house: House, caller: TestClient, open_worker: Callable[..., WorkerContext], small_gt3x: bytes
) -> tuple[str, str]:
    """The address of a clinician's finished analysis, and its recording."""
    clinician = dict(house.log_in("clinician"))
    asked = caller.post("/api/v1/analyze", content=small_gt3x, headers=clinician).json()
    do_next(open_worker(None))
    return f"/api/v1/analyses/{asked['id']}", asked["recording_id"]


def test_the_reports_of_a_released_analysis_have_the_stamp_until_it_is_withdrawn(
    house: House, caller: TestClient, own_report: tuple[str, str]
) -> None:
    clinician, (place, _) = dict(house.log_in("clinician")), own_report
    before = read_reports(caller, place, clinician)

    caller.post(f"{place}/release", headers=clinician)
    released = read_reports(caller, place, clinician)
    caller.delete(f"{place}/release", headers=clinician)

    stamps = (
        "Released by Clinician,",
        "Validé par Clinician,",
        "Released by Clinician,",
        "Released by Clinician,",
    )
    assert not any(stamp in text for stamp, text in zip(stamps, before, strict=True))
    assert all(stamp in text for stamp, text in zip(stamps, released, strict=True)), released
    assert read_reports(caller, place, clinician) == before


def test_a_purge_removes_the_stamped_reports_from_memory(
    house: House, caller: TestClient, own_report: tuple[str, str]
) -> None:
    clinician, (place, recording_id) = dict(house.log_in("clinician")), own_report
    caller.post(f"{place}/release", headers=clinician)
    assert caller.get(f"{place}/report.html", headers=clinician).status_code == 200
    kept = len(released._kept)

    purged = caller.delete(f"/api/v1/recordings/{recording_id}?purge=now", headers=clinician)

    assert purged.status_code == 200
    assert kept > 0
    assert len(released._kept) == 0


def read_reports(caller: TestClient, place: str, headers: dict[str, str]) -> list[str]:
    """Return page 1 of the PDF in both languages, the HTML report, and the first PDF of the FHIR bundle."""
    files = (f"{place}/report.pdf?lang=en", f"{place}/report.pdf?lang=fr", f"{place}/report.html")
    english, french, page = (caller.get(file, headers=headers).content for file in files)
    bundle = caller.get(f"{place}/fhir.json", headers=headers).json()
    attached = base64.b64decode(bundle["entry"][0]["resource"]["presentedForm"][0]["data"])
    first_pages = (read_first_page(pdf) for pdf in (english, french, attached))
    return [*first_pages, page.decode()]


def read_first_page(pdf: bytes) -> str:
    return " ".join(PdfReader(io.BytesIO(pdf)).pages[0].extract_text().split())


# Holds.


def ask(caller: TestClient, headers: dict[str, str]) -> dict[str, str]:
    """Send a recording; returns its analysis."""
    job: dict[str, str] = caller.post("/api/v1/analyze", content=b"bytes", headers=headers).json()
    return job


@pytest.fixture
def held(house: House, caller: TestClient) -> tuple[str, dict[str, str]]:
    """A recording on hold, and the headers of the clinician who put it there."""
    clinician = dict(house.log_in("clinician"))
    recording_id = ask(caller, clinician)["recording_id"]
    address = f"/api/v1/recordings/{recording_id}/hold"
    assert caller.put(address, json={"reason": "legal"}, headers=clinician).status_code == 200
    return recording_id, clinician


def test_neither_a_person_nor_the_trash_nor_retention_purges_what_is_on_hold(
    house: House, caller: TestClient, held: tuple[str, dict[str, str]]
) -> None:
    recording_id, clinician = held
    house.services.retention.put("recordings", 1, now=True)

    by_api = caller.delete(f"/api/v1/recordings/{recording_id}?purge=now", headers=clinician)
    by_page = caller.post(f"/recordings/{recording_id}/purge", headers=clinician)
    apply_retention(house.services, 400 * DAY_S)

    assert (by_api.status_code, by_api.json()["code"], by_page.status_code) == (409, "E-HOLD", 409)
    assert house.services.recordings.get(recording_id).hold == "legal"
    write_side_files(house.services)
    side = house.services.storage.read_small(f"recordings/{recording_id}.json")
    assert json.loads(side or b"")["rows"]["recordings"][0]["hold"] == "legal"

    caller.delete(f"/api/v1/recordings/{recording_id}", headers=clinician)
    apply_retention(house.services, 400 * DAY_S)
    assert house.services.recordings.get(recording_id, trashed=True).state == "trashed"


def test_once_let_go_it_can_be_purged(
    house: House, caller: TestClient, held: tuple[str, dict[str, str]]
) -> None:
    recording_id, clinician = held
    caller.delete(f"/api/v1/recordings/{recording_id}/hold", headers=clinician)

    purged = caller.delete(f"/api/v1/recordings/{recording_id}?purge=now", headers=clinician)

    assert purged.status_code == 200
    who = house.people["clinician"]
    assert find_acts(house.services, "recording.held") == [(who, recording_id, "")]
    assert find_acts(house.services, "recording.let_go") == [(who, recording_id, "")]


@pytest.fixture
def trash_keeps_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is deleted is gone at once, by the settings of the server."""
    monkeypatch.setenv("ACROMION_TRASH_TERM_S", "0")


def delete_by_every_way(caller: TestClient, recording_id: str, headers: dict[str, str]) -> list[int]:
    """Delete a recording by the API, its page, and the list; return the statuses."""
    form = {"recording": recording_id}
    return [
        caller.post("/library/acts/delete", data=form, headers=headers).status_code,
        caller.post(f"/recordings/{recording_id}/delete", headers=headers).status_code,
        caller.delete(f"/api/v1/recordings/{recording_id}", headers=headers).status_code,
    ]


def test_to_purge_by_a_script_asks_for_the_permission_to_erase(house: House, caller: TestClient) -> None:
    clinician, assistant = dict(house.log_in("clinician")), dict(house.log_in("assistant"))
    address = f"/api/v1/recordings/{ask(caller, clinician)['recording_id']}"

    assert caller.delete(f"{address}?purge=now", headers=assistant).status_code == 403
    assert caller.delete(address, headers=assistant).status_code == 204


@pytest.mark.usefixtures("trash_keeps_nothing")
def test_without_a_trash_to_delete_asks_for_the_permission_to_erase_and_ends_no_hold(
    house: House, caller: TestClient, held: tuple[str, dict[str, str]]
) -> None:
    (recording_id, clinician), assistant = held, dict(house.log_in("assistant"))
    address = f"/recordings/{recording_id}"

    assert delete_by_every_way(caller, recording_id, assistant) == [403, 403, 403]
    assert caller.get(f"{address}/delete", headers=clinician).headers["location"] == f"{address}/purge"
    assert caller.delete(f"/api/v1{address}", headers=clinician).status_code == 409
    assert house.services.recordings.get(recording_id).state == "stored"
    caller.delete(f"/api/v1{address}/hold", headers=clinician)
    assert delete_by_every_way(caller, recording_id, clinician) == [200, 303, 200]


@pytest.mark.usefixtures("trash_keeps_nothing")
def test_a_term_makes_a_trash_where_the_server_has_none(house: House, caller: TestClient) -> None:
    assistant = dict(house.log_in("assistant"))
    job = ask(caller, assistant)
    house.services.retention.put("trash", 10, now=True)

    deleted = caller.delete(f"/api/v1/recordings/{job['recording_id']}", headers=assistant)

    assert deleted.status_code == 204
    assert house.services.recordings.get(job["recording_id"], trashed=True).state == "trashed"


# Terms.


def test_a_recording_goes_when_the_server_has_run_for_its_term(house: House, caller: TestClient) -> None:
    clinician = dict(house.log_in("clinician"))
    old = ask(caller, clinician)["recording_id"]
    apply_retention(house.services, 29 * DAY_S)
    is_there = house.services.store.may_have_row(old)
    house.services.retention.put("recordings", 30, now=True)
    new = caller.post("/api/v1/recordings", content=b"newer", headers=clinician).json()["id"]

    apply_retention(house.services, 1 * DAY_S)

    assert is_there
    assert [house.services.store.may_have_row(one) for one in (old, new)] == [False, True]
    assert find_acts(house.services, "recording.purged") == [("system", old, "")]


def test_the_trash_has_a_term(house: House, caller: TestClient) -> None:
    clinician = dict(house.log_in("clinician"))
    recording_id = ask(caller, clinician)["recording_id"]
    caller.delete(f"/api/v1/recordings/{recording_id}", headers=clinician)
    house.services.retention.put("trash", 2, now=True)

    apply_retention(house.services, 2 * DAY_S)

    assert not house.services.store.may_have_row(recording_id)


def test_a_result_goes_by_its_term_and_the_recording_stays(
    house: House, caller: TestClient, open_worker: Callable[..., WorkerContext]
) -> None:
    clinician = dict(house.log_in("clinician"))
    job = ask(caller, clinician)
    do_next(open_worker(write_digest))
    house.services.retention.put("results", 10, now=True)

    apply_retention(house.services, 10 * DAY_S)

    assert caller.get(f"/api/v1/analyses/{job['id']}", headers=clinician).status_code == 404
    assert caller.get(f"/api/v1/recordings/{job['recording_id']}", headers=clinician).status_code == 200
    assert not (house.services.settings.data_dir / "analyses" / job["id"]).exists()
    assert find_acts(house.services, "analysis.purged") == [("system", job["recording_id"], job["id"])]


def test_the_lines_that_have_reached_their_term_go_and_a_line_says_so(
    store: JobStore, add_job: AddJob
) -> None:
    terms = RetentionStore(store.engine, store.reader)
    add_job()
    terms.add_running_time(3 * DAY_S)
    assert terms.shorten_audit_log() == 0  # without a term
    terms.put("trail", 7, now=True)
    add_job(b"another")
    terms.add_running_time(4 * DAY_S)

    gone = terms.shorten_audit_log()

    acts = [line.act for line in find_lines(store.reader, AuditFilter())]
    assert gone == 2
    assert acts == ["trail.shortened", "analysis.asked", "recording.stored", "retention.changed"]


def test_the_terms_are_changed_on_their_page_by_who_may_erase(house: House, caller: TestClient) -> None:
    clinician, assistant = dict(house.log_in("clinician")), dict(house.log_in("assistant"))

    caller.post("/retention", data={"recordings": "90", "trail": ""}, headers=clinician)
    refused = caller.put("/api/v1/retention/trash", json={"days": True}, headers=clinician)

    page = caller.get("/retention", headers=clinician).text
    terms = {"recordings": 90, "results": None, "trash": None, "trail": None}
    assert dict(house.services.retention.find_all()) == terms
    assert 'name="recordings"' in page
    assert 'value="90"' in page
    assert 'days <span class="hint">(30 days, as set on the server)' in page
    assert 'type="submit" class="button"' in page
    assert 'type="submit" class="button"' not in caller.get("/retention", headers=assistant).text
    assert (refused.status_code, refused.json()["code"]) == (422, "E-PARAMETER")


@pytest.mark.parametrize("kind", ["recordings", "trash"])
def test_a_shorter_term_deletes_nothing_for_seven_days(house: House, caller: TestClient, kind: str) -> None:
    clinician = dict(house.log_in("clinician"))
    recording_id = ask(caller, clinician)["recording_id"]
    if kind == "trash":
        caller.delete(f"/api/v1/recordings/{recording_id}", headers=clinician)
    apply_retention(house.services, 20 * DAY_S)
    due = caller.get(f"/api/v1/retention/{kind}/due?days=10", headers=clinician).json()
    for days in (10, 10, 12):  # neither the same term again nor a longer one ends the seven days
        caller.put(f"/api/v1/retention/{kind}", json={"days": days}, headers=clinician)

    apply_retention(house.services, 6.9 * DAY_S)
    is_there = house.services.store.may_have_row(recording_id)
    apply_retention(house.services, 0.2 * DAY_S)

    assert (due, is_there) == ({"count": 1}, True)
    assert not house.services.store.may_have_row(recording_id)


def test_a_term_that_a_script_applies_now_deletes_at_once(house: House, caller: TestClient) -> None:
    clinician = dict(house.log_in("clinician"))
    recording_id = ask(caller, clinician)["recording_id"]
    apply_retention(house.services, 20 * DAY_S)

    caller.put("/api/v1/retention/recordings", json={"days": 10, "now": True}, headers=clinician)
    apply_retention(house.services, 1.0)

    assert not house.services.store.may_have_row(recording_id)


def test_the_page_asks_with_the_number_before_a_term_that_deletes(house: House, caller: TestClient) -> None:
    clinician = dict(house.log_in("clinician"))
    ask(caller, clinician)
    apply_retention(house.services, 20 * DAY_S)

    asked = caller.post("/retention", data={"recordings": "10"}, headers=clinician)
    before = house.services.retention.find_all()["recordings"]
    caller.post("/retention", data={"recordings": "10", "confirmed": "yes"}, headers=clinician)

    assert re.search(r"Recordings, and [^<]*: 1<", asked.text)
    assert before is None
    assert house.services.retention.find_all()["recordings"] == 10


def test_a_purge_by_a_script_waits_seven_days_in_the_trash(house: House, caller: TestClient) -> None:
    clinician = dict(house.log_in("clinician"))
    recording_id = ask(caller, clinician)["recording_id"]

    answer = caller.delete(f"/api/v1/recordings/{recording_id}?purge=true", headers=clinician)
    apply_retention(house.services, 6.9 * DAY_S)
    is_there = house.services.store.may_have_row(recording_id)
    apply_retention(house.services, 0.2 * DAY_S)

    scheduled = {"recording_id": recording_id, "purged_in_days": 7}
    assert (answer.status_code, answer.json(), is_there) == (202, scheduled, True)
    assert not house.services.store.may_have_row(recording_id)


# Group figures.


@dataclass
class Studies:
    """Studies of reports of which only the time above 60 deg is known."""

    store: JobStore
    storage: Storage

    def put(self, study: str, people: dict[str, float], content: str = "") -> None:
        """Add a report to a study for each subject code."""
        for subject, above_percent in people.items():
            upload = self.storage.open_upload(1_000_000)
            upload.write(f"{study} {subject} {content}".encode())
            job = self.store.add(upload.keep(), ReportRequest("shift.gt3x", subject), study=study)
            row = {"analysis_id": job.id, "verdict": "good", "recorded_s": 8 * 3600.0}
            with self.store.engine.begin() as connection:
                connection.execute(update(analyses).where(analyses.c.id == job.id).values(state="succeeded"))
                connection.execute(insert(answers).values(row | {"above_60_percent": above_percent}))

    def publish(self, study: str) -> StudyGroup:
        return AggregateStore(self.store.engine, self.store.reader).publish(identify_study(study))


@pytest.fixture
def studies(store: JobStore, storage: Storage) -> Studies:
    return Studies(store, storage)


FIVE = {"W-1": 10.0, "W-2": 12.0, "W-3": 14.0, "W-4": 16.0, "W-5": 20.0}
FOUR = dict(list(FIVE.items())[:4])


@on_both_databases
def test_five_people_have_a_rounded_mean(studies: Studies) -> None:
    studies.put("spring", FIVE)

    (block,) = studies.publish("spring").blocks

    assert (block.people, block.time_above_60_percent, block.recorded_h) == (5, 14.0, 8.0)


@pytest.mark.parametrize("others", [("w-1",), ("", "NA", "?", "unknown")], ids=["again", "without code"])
def test_four_people_have_none_whose_code_comes_twice_or_beside_recordings_without_one(
    studies: Studies, others: tuple[str, ...]
) -> None:
    studies.put("spring", FOUR)
    studies.put("spring", dict.fromkeys(others, 1.0), "second shift")

    group = studies.publish("spring")

    assert (group.blocks, group.name) == ((), "")


def test_a_sixth_person_does_not_show_by_the_difference_nor_in_a_second_study(studies: Studies) -> None:
    studies.put("spring", FIVE)
    before = studies.publish("spring")
    studies.put("spring", {"W-6": 90.0})
    studies.put("summer", FIVE | {"W-6": 90.0})

    assert studies.publish("spring") == before
    assert studies.publish("summer").blocks == ()


def test_five_new_people_are_a_group_of_their_own(studies: Studies) -> None:
    studies.put("spring", FIVE)
    studies.publish("spring")
    studies.put("spring", {f"X-{number}": 30.0 for number in range(5)})

    blocks = studies.publish("spring").blocks

    assert [block.time_above_60_percent for block in blocks] == [14.0, 30.0]


def test_an_erasure_moves_no_published_figure(studies: Studies, store: JobStore) -> None:
    studies.put("spring", FIVE)
    before = studies.publish("spring")
    rows = RecordingStore(store.engine, store.reader)
    (recording_id,) = rows.find_of_subject("W-1")
    rows.begin_purge(recording_id)
    rows.end_purge(recording_id)

    assert studies.publish("spring") == before


def test_the_employer_sees_group_figures_and_nothing_else(house: House, caller: TestClient) -> None:
    Studies(house.services.store, house.services.storage).put("spring", FIVE)
    employer, study = dict(house.log_in("employer")), identify_study("spring")

    shown = caller.get(f"/api/v1/studies/{study}/aggregate.json", headers=employer)
    page = caller.get("/aggregate", headers=employer)

    assert shown.json()["blocks"][0]["time_above_60_percent"] == 14.0
    assert "14 %" in page.text
    assert page.text.count('aria-label="spring"') == 1  # two landmarks of one name are not told apart
    assert "W-1" not in page.text + shown.text
    for address in (
        "/",
        "/studies",
        f"/studies/{study}",
        "/persons",
        "/person?subject=W-1",
        "/api/v1/recordings",
        "/trash",
        "/trail",
    ):
        assert caller.get(address, headers=employer).status_code == 403


# The menu.


def list_menu(page: str) -> list[str]:
    """Return the addresses of the bar of pages, its folded part included."""
    bar = page.partition("<nav")[2].partition("</nav>")[0]
    return re.findall(r'href="([^"]+)"', bar)


def test_the_menu_names_what_a_person_may_open(house: House, caller: TestClient) -> None:
    places = {
        "clinician": ["/", "/persons", "/studies", "/help", "/aggregate", "/retention"],
        "assistant": ["/", "/persons", "/studies", "/help", "/retention"],
        "employer": ["/aggregate", "/help"],
        "auditor": ["/trail", "/help"],
        "manager": ["/people", "/help"],
    }

    for role, expected in places.items():
        page = caller.get("/help", headers=dict(house.log_in(role))).text
        assert list_menu(page) == expected, role


def test_the_menu_at_the_machine_names_every_page(client: TestClient) -> None:
    measured = ["/", "/persons", "/studies"]
    assert list_menu(client.get("/help").text) == [*measured, "/help", "/aggregate", "/retention", "/trail"]
