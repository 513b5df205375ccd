"""Studies: recordings under one name, each once, by its latest analysis; a list says whose arm each is."""

import pytest
from fastapi.testclient import TestClient

from acromion.app.library.batches import BatchStore, identify_study
from acromion.app.library.jobs import JobStore
from acromion.app.request import ReportRequest
from tests.app.conftest import AddJob

on_both = pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
NAME = "Packing line"
STUDY_ID = identify_study(NAME)


@pytest.fixture
def batches(store: JobStore) -> BatchStore:
    return BatchStore(store.engine, store.reader)


def hold(batches: BatchStore) -> list[str]:
    return [job.id for job in batches.find_jobs(STUDY_ID)]


def test_recordings_added_under_one_name_are_one_study(
    store: JobStore, batches: BatchStore, add_job: AddJob
) -> None:
    first, second = add_job(b"1"), add_job(b"2")

    assert {store.join_study(NAME, first.id), store.join_study(NAME, second.id)} == {STUDY_ID}
    assert hold(batches) == [first.id, second.id]
    assert (batches.get(STUDY_ID).name, batches.get(STUDY_ID).item_count) == (NAME, 2)


@on_both
def test_a_recording_added_again_is_there_once_by_its_latest_analysis(
    store: JobStore, batches: BatchStore, add_job: AddJob
) -> None:
    first = add_job(b"1")
    store.join_study(NAME, first.id)
    again = store.add_analysis((first.recording_id, first.sha256), ReportRequest("a.csv", side="left"))

    store.join_study(NAME, again.id)

    assert hold(batches) == [again.id]
    assert batches.get(STUDY_ID).item_count == 1


def test_a_study_goes_on_with_what_a_person_corrected(
    store: JobStore, batches: BatchStore, add_job: AddJob
) -> None:
    first = add_job(b"1")
    store.join_study(NAME, first.id)

    corrected = store.add_correction(first, ReportRequest("a.csv", side="left"))

    assert hold(batches) == [corrected.id]


def test_a_batch_of_a_script_keeps_the_analyses_it_asked_for(client: TestClient, store: JobStore) -> None:
    recording = client.post("/api/v1/recordings", content=b"1", params={"file_name": "a.csv"}).json()["id"]
    batch = client.post("/api/v1/batches", json={"name": "spring", "items": [{"recording_id": recording}]})
    (asked,) = store.find_newest()

    store.add_correction(asked, ReportRequest("a.csv", side="left"))

    kept = client.get("/api/v1/analyses", params={"batch_id": batch.json()["id"]}).json()["items"]
    assert [item["id"] for item in kept] == [asked.id]


def test_what_is_analysed_already_joins_too(client: TestClient) -> None:
    sent = client.put("/api/v1/analyze", params={"file_name": "a.csv"}, content=b"1").json()

    client.post("/api/v1/analyses", json={"recording_ids": [sent["recording_id"]], "study": NAME})

    held = client.get("/api/v1/analyses", params={"batch_id": STUDY_ID}).json()["items"]
    assert [item["recording_id"] for item in held] == [sent["recording_id"]]


# The list of participants.


@pytest.fixture
def study(client: TestClient) -> str:
    """A study of two recordings; return the address of its list of participants."""
    for k in range(2):
        client.put("/api/v1/analyze", params={"file_name": f"{k}.csv", "study": NAME}, content=bytes([k]))
    return f"/studies/{STUDY_ID}/participants"


def read_whose(client: TestClient, study: str) -> dict[str, tuple[str, str | None]]:
    held = client.get("/api/v1/analyses", params={"batch_id": study.split("/")[2]}).json()["items"]
    return {item["file_name"]: (item["settings"]["subject"], item["settings"]["side"]) for item in held}


def test_the_list_says_whose_arm_is_in_which_file_once(client: TestClient, study: str) -> None:
    listed = "fichier;sujet;côté\n0.csv;S01;gauche\n7.csv;S07;droit\n"
    told, again = (client.post(study, content=listed).json() for _ in range(2))

    whose = {"0.csv": ("S01", "left"), "1.csv": ("", None)}
    items = client.get("/api/v1/recordings").json()["items"]
    assert (told["changed"], again["changed"], told["unknown"]) == (1, 0, ["7.csv"])
    assert read_whose(client, study) == whose
    assert {item["file_name"]: (item["subject"], item["side"]) for item in items} == whose


def test_a_preview_of_the_list_names_what_does_not_fit_and_changes_nothing(
    client: TestClient, study: str
) -> None:
    told = client.post(f"{study}?preview=1&lang=en", content="file,subject\n0.csv,S01\n7.csv,S07\n").json()

    assert [line.replace("\u00a0", " ") for line in told["told"]] == [
        "1 recording of this study has a row in the list. It changes 1 of them.",
        "1 row fits no recording of this study: 7.csv.",
        "1 recording has no row and stays as it is: 1.csv.",
    ]
    assert read_whose(client, study) == {"0.csv": ("", None), "1.csv": ("", None)}


@pytest.mark.parametrize(
    "listed",
    [
        "file,subject,side\n0.csv,S01,left\n1.csv,S02,up\n",
        "file,subject,diary\n0.csv,S01,/etc/hostname\n",
        "file,subject,pose\n0.csv,S01,two-point\n",
        "name\n0.csv\n",
    ],
)
def test_a_list_with_a_fault_changes_nothing(client: TestClient, study: str, listed: str) -> None:
    assert client.post(study, content=listed).status_code == 422
    assert read_whose(client, study) == {"0.csv": ("", None), "1.csv": ("", None)}


def test_a_row_for_a_name_that_was_uploaded_twice_is_refused_until_it_names_the_recording(
    client: TestClient, study: str
) -> None:
    asked = {"file_name": "0.csv", "study": NAME}
    sent = client.put("/api/v1/analyze", params=asked, content=b"other").json()
    name = f"{sent['recording_id']}/0.csv"

    refused = client.post(study, content="file,subject\n0.csv,S01\n")
    told = client.post(study, content=f"file,subject\n{name},S01\n").json()

    assert (refused.status_code, name in refused.text) == (422, True)
    assert (told["changed"], told["unknown"]) == (1, [])


def test_the_pages_of_studies_show_no_address_of_the_api(client: TestClient, study: str) -> None:
    for page in (client.get("/studies").text, client.get(f"/studies/{STUDY_ID}").text):
        assert "POST /api" not in page


def test_without_any_study_the_page_says_how_one_begins(client: TestClient) -> None:
    assert "Drop a folder" in client.get("/studies?lang=en").text
    assert client.post("/studies/ba_none/participants", content="file\na.csv\n").status_code == 404
