"""Acts on many recordings of the list: what they change, of which recordings, and what stays."""

from dataclasses import replace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import delete

from app.jobs.database.tables import saved_views
from app.jobs.job import Job, JobState
from app.jobs.listing import VIEWS_FILE, HeadlineFigures, Library, LibraryFilter, SavedViews
from app.jobs.recordings import RecordingStore
from app.jobs.side_files import read_side_rows
from app.jobs.store import JobStore
from app.request import Conclusion
from app.storage.store import Storage
from fusion.conventions import METHOD_VERSION
from tests.app.conftest import AddJob, find_study
from tests.app.library.test_report_versions import fail_next, finish_next


@pytest.fixture
def library(store: JobStore) -> Library:
    return Library(store.reader)


def finish(store: JobStore, method_version: int = int(METHOD_VERSION)) -> None:
    """Let the job that waits end well, by a version of the method."""
    finish_next(store, HeadlineFigures("good", "2026-03-02T07:00:00", 60.0, 1.0, "smoothed", method_version))


@pytest.fixture
def views(store: JobStore, storage: Storage) -> SavedViews:
    return SavedViews(store.engine, store.reader, storage)


def do(client: TestClient, act: str, *jobs: Job, **fields: str) -> str:
    """Do one thing to recordings; gives the page that says what was done."""
    form = {"recording": [job.recording_id for job in jobs], **fields}
    answer = client.post(f"/library/acts/{act}?lang=en", data=form)
    assert answer.status_code == 200, answer.text
    return str(answer.text).replace("\xa0", " ")


def add_asked(store: JobStore, job: Job, **asked: Any) -> Job:
    """Queue and finish an analysis of the same recording, asked for otherwise; gives it."""
    again = store.add_analysis((job.recording_id, job.sha256), replace(job.request, **asked))
    finish(store)
    finish(store)
    return again


def list_names(library: Library, wanted: LibraryFilter) -> set[str]:
    return {entry.job.file_name for entry in library.find_page(wanted, 10)}


def test_all_that_a_filter_lets_through_are_tagged_and_no_other(
    client: TestClient, library: Library, add_job: AddJob
) -> None:
    for name in ("a1.csv", "a2.csv", "b.csv"):
        add_job(name.encode(), file_name=name)

    told = do(client, "tag", every="1", query="text=a", tag="line 2")

    assert "2 recordings have got the tag line 2." in told
    assert list_names(library, LibraryFilter(tag="line 2")) == {"a1.csv", "a2.csv"}
    assert list_names(library, LibraryFilter(tag="line")) == set()
    assert library.find_tags() == ("line 2",)


def test_a_tag_is_in_the_side_file_of_its_recording(
    client: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_job()
    before = store.read_revision(job.recording_id)

    do(client, "tag", job, tag="b, A, b")

    with store.reader.connect() as connection:
        side = read_side_rows(connection, job.recording_id)
    assert side is not None
    assert (side.recording["tags"], side.revision) == ('["A", "b"]', before + 1)


@pytest.mark.parametrize(
    ("address", "field", "values"),
    [
        ("acts/tag", "tag", ("", " , ", "x" * 41, "a\x07b", ",".join(map(str, range(11))))),
        ("acts/side", "side", ("both",)),
        ("acts/subject", "subject", ("x" * 101,)),
        ("acts/study", "study", (" ",)),
        ("views", "name", (" ", "x" * 61, "a\x07b")),
    ],
)
def test_a_value_that_cannot_be_is_refused(
    client: TestClient, add_job: AddJob, address: str, field: str, values: tuple[str, ...]
) -> None:
    form = {"query": ""} if address == "views" else {"recording": add_job().recording_id}

    for value in values:
        answer = client.post(f"/library/{address}", data=form | {field: value})
        assert answer.status_code == 422, value


def test_the_arm_of_a_report_is_changed_by_a_new_analysis_without_its_conclusion(
    client: TestClient, store: JobStore, library: Library, add_job: AddJob
) -> None:
    job = add_asked(store, add_job(), conclusion=Conclusion("All is well.", "A. Doctor", "2026-03-03"))

    told = do(client, "side", job, side="left")

    assert "1 recording is analysed again with this arm" in told
    (entry,) = library.find_page(LibraryFilter(), 10)
    assert entry.job.id == job.id
    assert entry.attempt is not None
    assert (entry.attempt.request.side, entry.attempt.request.conclusion) == ("left", None)
    assert RecordingStore(store.engine, store.reader).get(job.recording_id).about.side == "left"


def test_what_is_so_already_or_waits_is_not_asked_for(
    client: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_asked(store, add_job(), side="left")

    assert "Nothing changed" in do(client, "side", job, side="left")
    assert store.count_states()[JobState.QUEUED] == 0
    assert "Nothing changed" in do(client, "again", add_job(b"another"))
    assert store.count_states()[JobState.QUEUED] == 1


def test_a_failed_analysis_is_replaced_by_its_repetition(
    client: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_job()
    fail_next(store)

    do(client, "subject", job, subject="S7")

    again = store.get(str(store.get(job.id).replaced_by))
    assert (again.state, again.request.subject) == (JobState.QUEUED, "S7")


def test_reports_of_an_older_method_are_a_group_and_are_all_analysed_again(
    client: TestClient, store: JobStore, library: Library, add_job: AddJob
) -> None:
    old = add_job(b"old", file_name="old.csv")
    finish(store, int(METHOD_VERSION) - 1)
    add_job(b"new", file_name="new.csv")
    finish(store)
    add_job(b"ready", file_name="angles.csv")
    finish(store, 0)

    assert library.count(LibraryFilter())["older"] == 1
    assert list_names(library, LibraryFilter(group="older")) == {"old.csv"}
    assert "1 report was made by an older method" in client.get("/?group=older&lang=en").text.replace(
        "\xa0", " "
    )
    do(client, "again", every="1", query="group=older")
    assert [job.recording_id for job in store.find_newest(1)] == [old.recording_id]
    finish(store)
    assert library.count(LibraryFilter())["older"] == 0


def test_what_is_deleted_is_taken_back(client: TestClient, library: Library, add_job: AddJob) -> None:
    jobs = [add_job(name.encode(), file_name=name) for name in ("a", "b")]

    told = do(client, "delete", *jobs)

    assert "2 recordings are in the trash." in told
    assert all(f'value="{job.recording_id}"' in told for job in jobs)
    assert list_names(library, LibraryFilter()) == set()
    do(client, "restore", *jobs)
    assert list_names(library, LibraryFilter()) == {"a", "b"}


def test_a_view_is_a_named_address_kept_on_the_server(client: TestClient, add_job: AddJob) -> None:
    add_job()
    form = {"name": "Poor, most first", "query": "order=above_60&group=poor&page=3&nonsense=1"}

    answer = client.post("/library/views", data=form, follow_redirects=False)

    assert answer.headers["location"] == "/?group=poor&order=above_60"
    assert "★ Poor, most first" in client.get("/").text


def test_a_view_of_the_same_name_is_replaced_and_a_forgotten_one_is_gone(
    client: TestClient, views: SavedViews
) -> None:
    for query in ("group=poor", "group=good"):
        client.post("/library/views", data={"name": "mine", "query": query})

    (view,) = views.find_all()
    assert view.query == "group=good"
    client.post(f"/library/views/{view.id}/drop")
    assert views.find_all() == ()


def test_views_of_a_lost_database_come_back_from_their_file(views: SavedViews, store: JobStore) -> None:
    views.add("mine", "group=poor")
    kept = views.find_all()
    with store.engine.begin() as connection:
        connection.execute(delete(saved_views))

    assert (views.recover(), views.recover()) == (1, 0)
    assert views.find_all() == kept


def test_a_file_of_views_that_cannot_be_read_stops_nothing(views: SavedViews, storage: Storage) -> None:
    storage.write_small(VIEWS_FILE, b"{")

    assert views.recover() == 0


def test_the_chosen_join_a_study_that_goes_on_with_their_next_analyses(
    client: TestClient, store: JobStore, library: Library, add_job: AddJob
) -> None:
    jobs = [add_job(name.encode(), file_name=name) for name in ("a", "b")]
    finish(store)
    finish(store)

    told = do(client, "study", *jobs, study="spring")
    do(client, "again", *jobs)

    study = LibraryFilter(batch=find_study(store, "spring"))
    assert "2 recordings are in the study spring." in told
    assert list_names(library, study) == {"a", "b"}
    assert {entry.job.state for entry in library.find_page(study, 10)} == {JobState.QUEUED}
