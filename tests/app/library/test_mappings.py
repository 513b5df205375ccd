"""The columns of a table are named once for all files with its header; the first time a person is asked."""

import json
from typing import Any

import pytest
from fastapi.testclient import TestClient

from acromion.app.http.pages.recording.columns import name_columns, read_profile
from acromion.app.library.jobs import JobStore
from acromion.app.library.mappings import MappingStore
from acromion.app.library.rows import Job, JobState
from acromion.app.queue.worker import run_next
from acromion.app.report.words.messages import format_columns
from acromion.app.request import write_profile
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker

URL = "/api/v1/columns"
HEADER, OTHER, UNNAMED = "0123456789abcdef", "fedcba9876543210", "-0123456789abcdef"
PROFILE = write_profile({"acceleration": ["p", "q", "r"], "angular_rate": [5, 6, 7], "name": "ours"})
FORM = {
    "column": ["t", "p", "q", "r", "", "", ""],
    **{f"acceleration_{axis}": str(2 + k) for k, axis in enumerate("xyz")},
    **{f"angular_rate_{axis}": str(5 + k) for k, axis in enumerate("xyz")},
}

on_both_databases = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)


@pytest.fixture
def mappings(store: JobStore) -> MappingStore:
    return MappingStore(store.engine, store.reader)


def write_table(header: str, number: int = 0) -> bytes:
    return f"{header}\n{number}\n".encode()


def add_failed(add_job: AddJob, open_worker: OpenWorker, *headers: str) -> list[Job]:
    """Analyse a file with each of these headers, whose columns nobody has named."""
    jobs = [add_job(write_table(header, k), f"{k}.csv") for k, header in enumerate(headers)]
    run_all(open_worker)
    return jobs


def run_all(open_worker: OpenWorker) -> None:
    worker = open_worker(stand_ins.read_by_columns)
    while any(job.state is JobState.QUEUED for job in worker.store.find_newest()):
        run_next(worker)


def find_states(store: JobStore) -> list[str]:
    """Return the state of the last analysis of each recording, the oldest recording first."""
    last: dict[str, str] = {}
    for job in reversed(store.find_newest()):
        last[job.recording_id] = job.state.value
    return list(last.values())


@on_both_databases
def test_columns_named_anew_take_the_place_of_the_old_and_keep_its_name(mappings: MappingStore) -> None:
    mappings.put(HEADER, "ours.csv", PROFILE, is_confirmed=False)
    found = mappings.find(HEADER)
    mappings.change(HEADER, name="our logger")

    mappings.put(HEADER, "another.csv", "{}", is_confirmed=True)

    assert found is not None
    assert (found.name, found.profile, found.is_confirmed) == ("ours.csv", PROFILE, False)
    assert mappings.find(OTHER) is None
    assert [(one.name, one.profile) for one in mappings.find_all()] == [("our logger", "{}")]


def test_confirmed_columns_alone_are_applied_to_a_file_with_their_header(
    client: TestClient, add_job: AddJob, open_worker: OpenWorker, mappings: MappingStore, store: JobStore
) -> None:
    mappings.put(HEADER, "ours.csv", PROFILE, is_confirmed=True)
    mappings.put(OTHER, "theirs.csv", PROFILE, is_confirmed=False)

    mine, other = add_failed(add_job, open_worker, HEADER, OTHER)
    shown = client.get(f"/analyses/{mine.id}?lang=fr").text

    assert find_states(store) == ["succeeded", "failed"]
    assert store.get(mine.id).request.profile == PROFILE
    assert store.get(other.id).request.profile == ""
    assert "p, q, r" in shown
    assert "Nommer de nouveau les colonnes" in shown

    client.post(f"/analyses/{mine.id}/columns", data=FORM | {"header": HEADER, "acceleration_unit": "mg"})
    run_all(open_worker)

    newest = store.find_newest()[0]
    assert newest.state is JobState.SUCCEEDED
    assert (newest.request.version, newest.request.changes) == (2, ("profile",))


def test_a_table_whose_columns_no_line_names_is_always_asked_about(mappings: MappingStore) -> None:
    assert not mappings.put(UNNAMED, "ours.csv", PROFILE, is_confirmed=True).is_confirmed
    assert not mappings.change(UNNAMED, is_confirmed=1).is_confirmed


@on_both_databases
def test_one_answer_serves_every_file_with_the_header_that_waits(
    add_job: AddJob, open_worker: OpenWorker, mappings: MappingStore, store: JobStore
) -> None:
    jobs = add_failed(add_job, open_worker, HEADER, HEADER, OTHER, HEADER)

    assert mappings.count_waiting(HEADER) == 3
    again = mappings.analyse(store.get(jobs[1].id), PROFILE, HEADER)
    run_all(open_worker)

    assert store.get(again.id).recording_id == jobs[1].recording_id
    assert find_states(store) == ["succeeded", "succeeded", "failed", "succeeded"]
    assert mappings.count_waiting(HEADER) == 0


def test_a_file_that_was_analysed_otherwise_since_does_not_wait(
    add_job: AddJob, open_worker: OpenWorker, mappings: MappingStore, store: JobStore
) -> None:
    (job,) = add_failed(add_job, open_worker, HEADER)

    store.add_analysis((job.recording_id, job.sha256), job.request)

    assert mappings.count_waiting(HEADER) == 0


def test_the_page_keeps_the_columns_by_their_names_and_analyses_by_them(
    client: TestClient, add_job: AddJob, open_worker: OpenWorker, mappings: MappingStore, store: JobStore
) -> None:
    first, _ = add_failed(add_job, open_worker, HEADER, HEADER)

    client.post(f"/analyses/{first.id}/columns", data=FORM | {"header": HEADER})
    run_all(open_worker)

    (kept,) = mappings.find_all()
    assert (kept.name, kept.profile, kept.is_confirmed) == ("t, p, q, r", PROFILE, False)
    assert find_states(store) == ["succeeded", "failed"]


def test_columns_that_no_line_names_go_by_their_number() -> None:
    assert name_columns(["", "", ""]) == "(3)"


def test_the_page_offers_what_was_named_before_and_uses_it_when_told(
    client: TestClient, add_job: AddJob, open_worker: OpenWorker, mappings: MappingStore, store: JobStore
) -> None:
    mappings.put(HEADER, "ours.csv", PROFILE, is_confirmed=False)
    jobs = add_failed(add_job, open_worker, HEADER, HEADER)

    shown = client.get(f"/analyses/{jobs[0].id}?lang=en").text
    client.post(f"/analyses/{jobs[0].id}/columns/use", data={"header": HEADER})
    run_all(open_worker)

    assert "for files with this header" in shown
    assert "Acceleration: p, q, r · Angular rate (gyroscope): 5, 6, 7" in shown
    assert find_states(store) == ["succeeded", "succeeded"]
    assert mappings.get(HEADER).is_confirmed


def test_a_header_that_cannot_be_is_refused(
    client: TestClient, add_job: AddJob, open_worker: OpenWorker
) -> None:
    (job,) = add_failed(add_job, open_worker, HEADER)

    answer = client.post(f"/analyses/{job.id}/columns", data=FORM | {"header": "%"})

    assert (answer.status_code, "E-PARAMETER" in answer.text) == (422, True)


def test_a_batch_counts_what_was_cured_by_naming_the_columns(
    client: TestClient, open_worker: OpenWorker, store: JobStore
) -> None:
    stored = [
        client.post("/api/v1/recordings", content=write_table(HEADER, k), params={"file_name": f"{k}.csv"})
        for k in range(2)
    ]
    items = [{"recording_id": answer.json()["id"]} for answer in stored]
    batch = client.post("/api/v1/batches", json={"items": items}).json()
    run_all(open_worker)

    first = store.find_newest()[0]
    client.post(f"/analyses/{first.id}/columns", data=FORM | {"header": HEADER, "everywhere": "yes"})
    run_all(open_worker)

    counts = client.get(batch["links"]["self"]).json()["counts"]
    assert (counts["succeeded"], counts["failed"]) == (2, 0)


def test_mappings_are_listed_renamed_exported_and_forgotten(
    client: TestClient, mappings: MappingStore
) -> None:
    mappings.put(HEADER, "ours.csv", PROFILE, is_confirmed=False)

    renamed = client.patch(f"{URL}/{HEADER}", json={"name": "our logger", "is_confirmed": True}).json()
    exported = client.get(f"{URL}/{HEADER}/profile.json").json()

    assert client.get(URL).json()["items"] == [renamed]
    assert (renamed["name"], renamed["is_confirmed"]) == ("our logger", True)
    assert exported == {"name": "our logger", **json.loads(PROFILE)}
    assert client.delete(f"{URL}/{HEADER}").status_code == 204
    assert client.get(f"{URL}/{HEADER}").json()["code"] == "E-NOT-FOUND"


def test_the_page_lists_renames_and_forgets_them(client: TestClient, mappings: MappingStore) -> None:
    mappings.put(HEADER, "ours.csv", PROFILE, is_confirmed=True)

    client.post(f"/columns/{HEADER}", data={"name": "our logger"})
    shown: Any = client.get("/columns?lang=en").text
    client.post(f"/columns/{HEADER}/delete")

    assert "our logger" in shown
    assert "Acceleration: p, q, r" in shown
    assert not mappings.find_all()


# Which of several sensors is on the arm: on the page and by REST.


def test_the_form_gives_the_sensor_with_its_units_and_rate() -> None:
    form = {"sensor": ["right"], "acceleration_unit": ["g"], "rate_hz": ["204,8"]}

    assert read_profile(form) == {"sensor": "right", "acceleration_unit": "g", "rate_hz": 204.8}


@pytest.mark.parametrize(
    ("form", "profile"),
    [
        ({"sensor": ["right"], "date_order": ["dmy"]}, {"sensor": "right", "date_order": "dmy"}),
        ({"is_pair": ["yes"], "date_order": ["mdy"]}, {"date_order": "mdy"}),
    ],
    ids=["one of several sensors", "two tables"],
)
def test_the_form_gives_the_order_of_the_dates(form: dict[str, list[str]], profile: dict[str, str]) -> None:
    assert read_profile(form) == profile


def test_the_report_names_the_sensor() -> None:
    assert format_columns('{"sensor": "right"}', "en") == "Sensor on the upper arm: right"
