"""Acts on many recordings of the list: what they change, of which recordings, and what stays."""

from collections.abc import Iterator
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
from app.main import create_app
from app.request import Conclusion
from app.settings import Settings
from app.storage.store import ResultFile, Storage
from fusion.conventions import METHOD_VERSION
from tests.app.conftest import AddJob, find_study


@pytest.fixture
def caller(settings: Settings, store: JobStore) -> Iterator[TestClient]:
    with TestClient(create_app(settings), "http://localhost:8080") as client:
        yield client


@pytest.fixture
def library(store: JobStore) -> Library:
    return Library(store.reader)


@pytest.fixture
def views(store: JobStore, storage: Storage) -> SavedViews:
    return SavedViews(store.engine, store.reader, storage)


def finish(store: JobStore, method_version: int = int(METHOD_VERSION)) -> None:
    """Let the job that waits end well, by a version of the method."""
    job = store.claim()
    assert job is not None
    figures = HeadlineFigures("good", "2026-03-02T07:00:00", 60.0, 1.0, "smoothed", method_version)
    assert store.finish(job.id, str(job.token), [ResultFile("results.json", "0" * 64, 2)], figures)


def do(caller: TestClient, act: str, *jobs: Job, **fields: str) -> str:
    """Do one thing to recordings; gives the page that says what was done."""
    form = {"recording": [job.recording_id for job in jobs], **fields}
    answer = caller.post(f"/library/acts/{act}?lang=en", data=form)
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
    caller: TestClient, library: Library, add_job: AddJob
) -> None:
    for name in ("a1.csv", "a2.csv", "b.csv"):
        add_job(name.encode(), file_name=name)

    told = do(caller, "tag", every="1", query="text=a", tag="line 2")

    assert "2 recordings have got the tag line 2." in told
    assert list_names(library, LibraryFilter(tag="line 2")) == {"a1.csv", "a2.csv"}
    assert list_names(library, LibraryFilter(tag="line")) == set()
    assert library.find_tags() == ("line 2",)


def test_a_tag_is_in_the_side_file_of_its_recording(
    caller: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_job()
    before = store.read_revision(job.recording_id)

    do(caller, "tag", job, tag="b, A, b")

    with store.reader.connect() as connection:
        side = read_side_rows(connection, job.recording_id)
    assert side is not None
    assert (side.recording["tags"], side.revision) == ('["A", "b"]', before + 1)


def test_a_tag_that_cannot_be_read_is_refused(caller: TestClient, add_job: AddJob) -> None:
    form = {"recording": add_job().recording_id}

    for tag in ("", " , ", "x" * 41, "a\x07b", ",".join(map(str, range(11)))):
        assert caller.post("/library/acts/tag", data=form | {"tag": tag}).status_code == 422, tag


def test_the_arm_of_a_report_is_changed_by_a_new_analysis_without_its_conclusion(
    caller: TestClient, store: JobStore, library: Library, add_job: AddJob
) -> None:
    job = add_asked(store, add_job(), conclusion=Conclusion("All is well.", "A. Doctor", "2026-03-03"))

    told = do(caller, "side", job, side="left")

    assert "1 recording is analysed again with this arm" in told
    (entry,) = library.find_page(LibraryFilter(), 10)
    assert entry.job.id == job.id
    assert entry.attempt is not None
    assert (entry.attempt.request.side, entry.attempt.request.conclusion) == ("left", None)
    assert RecordingStore(store.engine, store.reader).get(job.recording_id).about.side == "left"


def test_an_arm_that_is_so_already_makes_no_analysis(
    caller: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_asked(store, add_job(), side="left")

    assert "Nothing changed" in do(caller, "side", job, side="left")
    assert store.count_states()[JobState.QUEUED] == 0


def test_what_waits_is_not_asked_for_twice(caller: TestClient, store: JobStore, add_job: AddJob) -> None:
    assert "Nothing changed" in do(caller, "again", add_job())
    assert store.count_states()[JobState.QUEUED] == 1


def test_a_failed_analysis_is_replaced_by_its_repetition(
    caller: TestClient, store: JobStore, add_job: AddJob
) -> None:
    job = add_job()
    claimed = store.claim()
    assert claimed is not None
    store.fail(job.id, str(claimed.token), "E-SHORT", {})

    do(caller, "subject", job, subject="S7")

    again = store.get(str(store.get(job.id).replaced_by))
    assert (again.state, again.request.subject) == (JobState.QUEUED, "S7")


def test_reports_of_an_older_method_are_a_group_and_are_all_analysed_again(
    caller: TestClient, store: JobStore, library: Library, add_job: AddJob
) -> None:
    old = add_job(b"old", file_name="old.csv")
    finish(store, int(METHOD_VERSION) - 1)
    add_job(b"new", file_name="new.csv")
    finish(store)
    add_job(b"ready", file_name="angles.csv")
    finish(store, 0)

    assert library.count(LibraryFilter())["older"] == 1
    assert list_names(library, LibraryFilter(group="older")) == {"old.csv"}
    assert "1 report was made by an older method" in caller.get("/?group=older&lang=en").text.replace(
        "\xa0", " "
    )
    do(caller, "again", every="1", query="group=older")
    assert [job.recording_id for job in store.find_newest(1)] == [old.recording_id]
    finish(store)
    assert library.count(LibraryFilter())["older"] == 0


def test_what_is_deleted_is_taken_back(caller: TestClient, library: Library, add_job: AddJob) -> None:
    jobs = [add_job(name.encode(), file_name=name) for name in ("a", "b")]

    told = do(caller, "delete", *jobs)

    assert "2 recordings are in the trash." in told
    assert all(f'value="{job.recording_id}"' in told for job in jobs)
    assert list_names(library, LibraryFilter()) == set()
    do(caller, "restore", *jobs)
    assert list_names(library, LibraryFilter()) == {"a", "b"}


def test_an_arm_or_subject_that_cannot_be_is_refused(caller: TestClient, add_job: AddJob) -> None:
    form = {"recording": add_job().recording_id}

    assert caller.post("/library/acts/side", data=form | {"side": "both"}).status_code == 422
    assert caller.post("/library/acts/subject", data=form | {"subject": "x" * 101}).status_code == 422


def test_a_view_is_a_named_address_kept_on_the_server(caller: TestClient, add_job: AddJob) -> None:
    add_job()
    form = {"name": "Poor, most first", "query": "order=above_60&group=poor&page=3&nonsense=1"}

    answer = caller.post("/library/views", data=form, follow_redirects=False)

    assert answer.headers["location"] == "/?group=poor&order=above_60"
    assert "★ Poor, most first" in caller.get("/").text


def test_a_view_of_the_same_name_is_replaced_and_a_forgotten_one_is_gone(
    caller: TestClient, views: SavedViews
) -> None:
    for query in ("group=poor", "group=good"):
        caller.post("/library/views", data={"name": "mine", "query": query})

    (view,) = views.find_all()
    assert view.query == "group=good"
    caller.post(f"/library/views/{view.id}/drop")
    assert views.find_all() == ()


def test_a_view_without_a_name_is_refused(caller: TestClient) -> None:
    for name in (" ", "x" * 61, "a\x07b"):
        assert caller.post("/library/views", data={"name": name, "query": ""}).status_code == 422, name


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
    caller: TestClient, store: JobStore, library: Library, add_job: AddJob
) -> None:
    jobs = [add_job(name.encode(), file_name=name) for name in ("a", "b")]
    finish(store)
    finish(store)

    told = do(caller, "study", *jobs, study="spring")
    do(caller, "again", *jobs)

    study = LibraryFilter(batch=find_study(store, "spring"))
    assert "2 recordings are in the study spring." in told
    assert list_names(library, study) == {"a", "b"}
    assert {entry.job.state for entry in library.find_page(study, 10)} == {JobState.QUEUED}


def test_a_study_without_a_name_is_refused(caller: TestClient, add_job: AddJob) -> None:
    form = {"recording": add_job().recording_id, "study": " "}

    assert caller.post("/library/acts/study", data=form).status_code == 422
