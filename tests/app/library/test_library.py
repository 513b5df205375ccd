"""The library: the newest analysis of each recording, searched, counted, paged; a path before it all."""

from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import delete

from acromion.app.http.pages.views import build_entry, draw_spark
from acromion.app.library.batches import identify_study
from acromion.app.library.database.tables import saved_views
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import (
    VIEWS_FILE,
    HeadlineFigures,
    Library,
    LibraryFilter,
    SavedViews,
    summarise_day,
)
from acromion.app.library.recordings import RecordingStore
from acromion.app.library.rows import Job, JobState
from acromion.app.library.side_files import read_side_rows
from acromion.app.main import create_app
from acromion.app.request import Conclusion, ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from acromion.fusion.conventions import METHOD_VERSION
from tests.app.conftest import AddJob
from tests.app.library.test_report_versions import fail_next, finish_next


@pytest.fixture
def library(store: JobStore) -> Library:
    return Library(store.reader)


@pytest.fixture
def add_report(store: JobStore, add_job: AddJob) -> AddJob:
    """Store a recording and let its analysis end well."""

    def add(
        content: bytes = b"recording",
        verdict: str = "good",
        start: str = "2026-03-02T07:00:00",
        above_60: float | None = 7.0,
        subject: str = "",
    ) -> Job:
        add_job(content, subject=subject)
        return finish_next(store, HeadlineFigures(verdict, start, 28800.0, above_60))

    return add


def list_ids(library: Library, wanted: LibraryFilter) -> list[str]:
    return [entry.job.id for entry in library.find_page(wanted, 10)]


def test_a_recording_is_short_by_what_was_analysed_as_in_its_report(
    library: Library, store: JobStore, add_job: AddJob
) -> None:
    add_job()
    finish_next(store, HeadlineFigures("good", "2026-03-02T07:00:00", 28800.0, 7.0, analysed_s=3.9 * 3600))

    (entry,) = library.find_page(LibraryFilter(), 10)
    figures = build_entry(entry, "en").figures
    assert figures is not None
    assert figures["quality"] == "good data, short"


def test_a_recording_shows_its_newest_analysis_alone(
    library: Library, store: JobStore, add_job: AddJob
) -> None:
    first = add_job()
    second = store.add_analysis((first.recording_id, first.sha256), ReportRequest("shift.gt3x"))

    assert list_ids(library, LibraryFilter()) == [second.id]


@pytest.mark.parametrize(("is_reversed", "order"), [(False, (2, 1, 0)), (True, (0, 1, 2))])
def test_pages_follow_one_another_the_newest_first_unless_reversed(
    library: Library, add_job: AddJob, is_reversed: bool, order: tuple[int, int, int]
) -> None:
    jobs = [add_job(str(number).encode()) for number in range(3)]
    wanted, (first, second, third) = LibraryFilter(is_reversed=is_reversed), (jobs[k] for k in order)

    pages = [[entry.job.id for entry in library.find_page(wanted, 2, skip)] for skip in (0, 2)]

    assert pages == [[first.id, second.id], [third.id]]
    assert library.find_neighbours(second, wanted) == (first.id, third.id)
    assert library.find_neighbours(first, wanted) == (None, second.id)


def test_recordings_are_found_by_their_own_day_or_today_while_they_wait(
    library: Library, add_job: AddJob, add_report: AddJob
) -> None:
    job, waiting = add_report(start="2026-03-02T07:00:00"), add_job(b"waits")

    assert list_ids(library, LibraryFilter(first_day="2026-03-02", last_day="2026-03-02")) == [job.id]
    assert list_ids(library, LibraryFilter(first_day="2026-03-03", last_day="2026-03-03")) == []
    today = datetime.now(UTC).date().isoformat()
    assert list_ids(library, LibraryFilter(first_day=today)) == [waiting.id]


def test_recordings_are_found_by_any_part_of_the_name(library: Library, add_job: AddJob) -> None:
    job = add_job(file_name="Shelf_100%_work.gt3x")
    add_job(b"other", file_name="other.gt3x")

    assert list_ids(library, LibraryFilter("shelf")) == [job.id]
    assert list_ids(library, LibraryFilter("100%_w")) == [job.id]


def test_groups_are_counted_as_they_are_listed(library: Library, add_job: AddJob, add_report: AddJob) -> None:
    poor, _, waiting = add_report(b"1", "poor"), add_report(b"2", "good"), add_job(b"3")

    counts = library.count(LibraryFilter())

    assert [counts[group] for group in ("all", "active", "attention", "poor", "good")] == [3, 1, 1, 1, 1]
    assert list_ids(library, LibraryFilter(group="attention")) == [poor.id]
    assert list_ids(library, LibraryFilter(group="active")) == [waiting.id]


def test_behind_a_path_every_address_begins_with_it(settings: Settings) -> None:
    with TestClient(create_app(settings), "http://localhost:8080", root_path="/acromion") as caller:
        page = caller.get("/?lang=en").text

    addresses = [part.split('"')[0] for part in page.replace("action=", "href=").split('href="')[1:]]
    assert all(a.startswith(("/acromion/", "#", "?", '/acromion"')) for a in addresses if a), addresses
    assert 'data-api="/acromion/api/v1"' in page


def fail_again(store: JobStore, job: Job) -> Job:
    """Analyse the same recording once more, in vain."""
    store.add_analysis((job.recording_id, job.sha256), ReportRequest("shift.gt3x", pose="side-lean"))
    return fail_next(store)


def test_a_failed_repetition_leaves_the_earlier_report_in_the_list_and_needs_attention(
    library: Library, store: JobStore, add_report: AddJob
) -> None:
    good = add_report()
    failed = fail_again(store, good)

    (entry,) = library.find_page(LibraryFilter(), 10)
    counts = library.count(LibraryFilter())

    assert (entry.job.id, entry.headline and entry.headline.verdict) == (good.id, "good")
    assert entry.attempt is not None
    assert (entry.attempt.id, entry.attempt.problem_code) == (failed.id, "E-CALIB")
    found = {group: number for group, number in counts.items() if number}
    assert found == {"all": 1, "attention": 1, "good": 1}
    assert list_ids(library, LibraryFilter(group="failed")) == []
    assert list_ids(library, LibraryFilter(group="attention")) == [good.id]


def test_neighbours_of_a_report_with_a_failed_repetition_are_those_of_its_row(
    library: Library, store: JobStore, add_report: AddJob
) -> None:
    good, second = add_report(b"1"), add_report(b"2")
    fail_again(store, good)

    assert library.find_neighbours(good, LibraryFilter()) == (second.id, None)
    assert library.find_neighbours(second, LibraryFilter()) == (None, good.id)


def test_a_report_whose_repetition_runs_is_offered_to_be_compared(
    library: Library, store: JobStore, add_report: AddJob
) -> None:
    first, second = (add_report(content, subject="S1") for content in (b"1", b"2"))
    wish = ReportRequest("shift.gt3x", "S1", pose="side-lean")
    store.add_analysis((second.recording_id, second.sha256), wish)

    (other,) = library.find_others(first)

    assert other.job.id == second.id


def test_recordings_are_sorted_by_name_whatever_the_case(library: Library, add_job: AddJob) -> None:
    jobs = [add_job(name.encode(), file_name=name) for name in ("b.csv", "A.csv", "c.csv")]

    wanted = LibraryFilter(order="name")

    assert list_ids(library, wanted) == [jobs[1].id, jobs[0].id, jobs[2].id]
    assert library.find_neighbours(jobs[0], wanted) == (jobs[1].id, jobs[2].id)


def test_a_column_sorts_either_way_and_what_has_no_value_stands_last(
    library: Library, add_report: AddJob
) -> None:
    figures = {"a": 3.0, "b": None, "c": 12.5}
    ids = {add_report(name.encode(), above_60=percent).id: name for name, percent in figures.items()}

    most = [ids[one] for one in list_ids(library, LibraryFilter(order="above_60"))]
    least = [ids[one] for one in list_ids(library, LibraryFilter(order="above_60", is_reversed=True))]

    assert (most, least) == (["c", "a", "b"], ["a", "c", "b"])


def test_the_poorest_quality_comes_first(library: Library, add_report: AddJob) -> None:
    for verdict in ("good", "poor", "caution"):
        add_report(verdict.encode(), verdict)

    found = library.find_page(LibraryFilter(order="quality"), 10)

    assert [entry.headline.verdict for entry in found if entry.headline] == ["poor", "caution", "good"]


def test_a_day_is_kept_in_60_steps_of_whole_minutes_and_a_gap_stays_a_gap() -> None:
    nothing = None

    assert summarise_day([10.0, nothing, 20.4]) == "10,,20"
    assert summarise_day([10.0, 30.0, nothing] * 40) == ",".join(["20", "10", "30"] * 20)


def test_a_day_in_short_is_drawn_from_0_to_120_deg_with_gaps_left_open() -> None:
    assert draw_spark("0,60,,150") == ("M0.0 20.0H25.0V10.0H50.0M75.0 0.0H100.0", "0", "150")
    assert draw_spark(",") == ("", "", "")


# Acts on many recordings of the list: what they change, of which recordings, and what stays.


def finish_by(store: JobStore, method_version: int = int(METHOD_VERSION)) -> None:
    """Let the job that waits end well, by a version of the method."""
    finish_next(store, HeadlineFigures("good", "2026-03-02T07:00:00", 60.0, 1.0, "smoothed", method_version))


@pytest.fixture
def views(store: JobStore, storage: Storage) -> SavedViews:
    return SavedViews(store.engine, store.reader, storage)


def do(client: TestClient, act: str, *jobs: Job, **fields: str) -> str:
    """Do one thing to recordings; return the page that says what was done."""
    form = {"recording": [job.recording_id for job in jobs], **fields}
    answer = client.post(f"/library/acts/{act}?lang=en", data=form)
    assert answer.status_code == 200, answer.text
    return str(answer.text).replace("\xa0", " ")


def add_asked(store: JobStore, job: Job, **asked: Any) -> Job:
    """Queue and finish_by an analysis of the same recording, asked for otherwise; return it."""
    again = store.add_analysis((job.recording_id, job.sha256), replace(job.request, **asked))
    finish_by(store)
    finish_by(store)
    return again


def list_names(library: Library, wanted: LibraryFilter) -> set[str]:
    return {entry.job.file_name for entry in library.find_page(wanted, 10)}


def test_all_that_a_filter_lets_through_are_tagged_and_no_other(
    client: TestClient, library: Library, add_job: AddJob
) -> None:
    for name in ("a1.csv", "a2.csv", "b.csv"):
        add_job(name.encode(), file_name=name)

    told = do(client, "tag", every="1", query="text=a", tag="line 2")

    assert "2 recordings now have the tag line 2." in told
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

    assert "The arm of 1 recording was changed." in told
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
    finish_by(store, int(METHOD_VERSION) - 1)
    add_job(b"new", file_name="new.csv")
    finish_by(store)
    add_job(b"ready", file_name="angles.csv")
    finish_by(store, 0)

    assert library.count(LibraryFilter())["older"] == 1
    assert list_names(library, LibraryFilter(group="older")) == {"old.csv"}
    assert "1 report was made with an older method" in client.get("/?group=older&lang=en").text.replace(
        "\xa0", " "
    )
    do(client, "again", every="1", query="group=older")
    assert [job.recording_id for job in store.find_newest(1)] == [old.recording_id]
    finish_by(store)
    assert library.count(LibraryFilter())["older"] == 0


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
    finish_by(store)
    finish_by(store)

    told = do(client, "study", *jobs, study="spring")
    do(client, "again", *jobs)

    study = LibraryFilter(batch=identify_study("spring"))
    assert "2 recordings are in the study spring." in told
    assert list_names(library, study) == {"a", "b"}
    assert {entry.job.state for entry in library.find_page(study, 10)} == {JobState.QUEUED}
