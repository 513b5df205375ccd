"""People and studies on their pages: subjects, the ranking, and short recordings."""

import io
import re
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from urllib.parse import unquote

import pytest
from fastapi.testclient import TestClient

from acromion.app.http.pages.ranking import Ranking, build_ranking
from acromion.app.library.batches import identify_study
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import Entry, HeadlineFigures, Library, LibraryFilter, find_other_arm
from acromion.app.library.recordings import Description, RecordingStore
from acromion.app.library.rows import Job
from acromion.app.request import ReportRequest
from acromion.app.store.folder import Storage
from acromion.fusion.conventions import Side
from tests.app.library.test_report_versions import finish_next
from tests.app.report.report_reading import plain

WHOLE_S, SHORT_S = 4 * 3600.0, 4 * 3600.0 - 1
STUDY = "Ligne d'été"
STUDY_ID = identify_study(STUDY)


class Shelf:
    """Recordings with reports of given figures, stored one after the other."""

    def __init__(self, store: JobStore, storage: Storage) -> None:
        self._store, self._storage = store, storage
        self.count = 0

    def put(
        self,
        file: str,
        above: float,
        *,
        subject: str = "",
        side: Side | None = None,
        start: str = "2026-03-02T07:00:00",
        recorded_s: float = WHOLE_S,
        verdict: str = "good",
        study: str = "",
        ends: tuple[float, float] | None = None,
    ) -> Job:
        """Store a recording with a report."""
        upload = self._storage.open_upload(1_000_000)
        self.count += 1
        upload.write(f"{self.count}".encode())
        self._store.add(upload.keep(), ReportRequest(file, subject, side), study=study)
        low, high = ends or (None, None)
        figures = HeadlineFigures(verdict, start, recorded_s, above, analysed_s=recorded_s)
        return finish_next(
            self._store, replace(figures, above_60_low_percent=low, above_60_high_percent=high)
        )


@pytest.fixture
def shelf(store: JobStore, storage: Storage) -> Shelf:
    return Shelf(store, storage)


@pytest.fixture
def library(store: JobStore) -> Library:
    return Library(store.reader)


def list_files(entries: Sequence[Entry]) -> list[str]:
    return [entry.job.file_name for entry in entries]


# Short recordings.


def test_a_short_recording_to_use_with_care_does_not_need_attention(library: Library, shelf: Shelf) -> None:
    shelf.put("short.gt3x", 5.0, recorded_s=SHORT_S, verdict="caution")
    shelf.put("short and poor.gt3x", 5.0, recorded_s=SHORT_S, verdict="poor")
    shelf.put("whole.gt3x", 5.0, verdict="caution")

    found = library.find_page(LibraryFilter(group="attention", order="name"), 10)

    assert list_files(found) == ["short and poor.gt3x", "whole.gt3x"]
    assert library.count(LibraryFilter())["attention"] == 2


@pytest.mark.parametrize(
    ("is_reversed", "files"), [(False, ["b", "a", "short"]), (True, ["a", "b", "short"])]
)
def test_the_order_by_time_above_60_ends_with_the_short_recordings(
    library: Library, shelf: Shelf, is_reversed: bool, files: list[str]
) -> None:
    shelf.put("a", 5.0)
    shelf.put("short", 90.0, recorded_s=SHORT_S)
    shelf.put("b", 9.0)

    found = library.find_page(LibraryFilter(order="above_60", is_reversed=is_reversed), 10)

    assert list_files(found) == files


# People.


def test_people_are_listed_once_each_and_nobody_without_a_code(library: Library, shelf: Shelf) -> None:
    shelf.put("1.gt3x", 5.0, subject="s2")
    shelf.put("2.gt3x", 5.0, subject="S10")
    shelf.put("3.gt3x", 5.0, subject="s2")
    shelf.put("4.gt3x", 5.0)

    people = library.find_people("", 10)

    assert [(person.subject, person.count) for person in people] == [("S10", 1), ("s2", 2)]
    assert library.count_people("") == 2
    assert [person.subject for person in library.find_people("1", 10)] == ["S10"]


@pytest.mark.parametrize(
    ("start", "is_found"),
    [
        ("2026-03-02T21:00:00", True),  # a night shift: the other arm began an hour earlier, the day before
        ("2026-03-03T01:59:59", True),
        ("2026-03-03T02:00:00", False),  # begins when the first ends
        ("2026-03-02T18:00:00", False),  # ends when the first begins
        (None, False),
    ],
)
def test_the_other_arm_of_a_shift_is_one_that_recorded_at_the_same_time(
    shelf: Shelf, library: Library, start: str | None, is_found: bool
) -> None:
    shelf.put("right.gt3x", 5.0, subject="S1", side="right", start="2026-03-02T22:00:00")
    shelf.put("left.gt3x", 5.0, subject="S1", side="left", start=start or "")
    left, right = library.find_of_people(["S1"])

    assert find_other_arm(right, [left, right]) == (left if is_found else None)


def test_of_two_recordings_of_the_other_arm_the_one_with_more_shared_time_is_the_pair(
    shelf: Shelf, library: Library
) -> None:
    shelf.put("right.gt3x", 5.0, subject="S1", side="right", start="2026-03-02T08:00:00")
    shelf.put("early.gt3x", 5.0, subject="S1", side="left", start="2026-03-02T05:00:00")
    shelf.put("same.gt3x", 5.0, subject="S1", side="left", start="2026-03-02T08:30:00")
    same, early, right = library.find_of_people(["S1"])

    assert find_other_arm(right, [early, same]) == same


def test_the_page_of_a_person_counts_the_days_and_offers_both_arms_of_a_shift_once(
    client: TestClient, shelf: Shelf
) -> None:
    right = shelf.put("right.gt3x", 5.0, subject="S1", side="right")
    shelf.put("left.gt3x", 5.0, subject="S1", side="left")
    for day in range(10, 20):
        shelf.put(f"{day}.gt3x", 5.0, subject="S1", side="right", start=f"2026-03-{day}T07:00:00")

    person = plain(client.get("/person?subject=S1&lang=en").text)

    assert f"second={right.id}" in person
    assert "Both arms on 2026-03-02" in person
    assert person.count('aria-label="Both arms on') == 1
    assert "12 recordings on 11 days, 2026-03-02 to 2026-03-19" in person


def test_the_page_of_a_person_without_recordings_is_not_there(client: TestClient, shelf: Shelf) -> None:
    shelf.put("1.gt3x", 5.0, subject="S10")

    assert [client.get(f"/person?subject={code}").status_code for code in ("S1", "", "S10")] == [
        404,
        404,
        200,
    ]


def test_people_who_do_not_fit_on_one_page_are_on_the_next(client: TestClient, shelf: Shelf) -> None:
    for number in range(51):
        shelf.put(f"{number}.gt3x", 5.0, subject=f"S{number:02d}")

    pages = {number: client.get(f"/persons?number={number}&lang=en").text for number in (1, 2)}
    assert {number: text.count("/person?subject=") for number, text in pages.items()} == {1: 50, 2: 1}
    assert ['rel="prev"' in pages[1], 'rel="next"' in pages[1]] == [False, True]
    assert ['rel="prev"' in pages[2], 'rel="next"' in pages[2]] == [True, False]


# Studies.


def rank(library: Library) -> Ranking:
    return build_ranking(library.find_page(LibraryFilter(batch=STUDY_ID), 100), "en")


def list_ranked(ranking: Ranking) -> list[tuple[str, str, str]]:
    return [(arm.name, arm.side, arm.above) for arm in ranking.arms]


def test_who_has_most_comes_first_by_the_mean_of_the_days_of_an_arm(library: Library, shelf: Shelf) -> None:
    shelf.put("1", 6.0, subject="S1", side="left", study=STUDY)
    shelf.put("2", 10.0, subject="S1", side="left", study=STUDY)  # mean of both days: 8 %
    shelf.put("3", 9.0, subject="S2", side="left", study=STUDY)
    shelf.put("4", 7.0, subject="S1", side="right", study=STUDY)
    shelf.put("5", 90.0, subject="S3", side="left", study=STUDY, recorded_s=SHORT_S)

    ranking = rank(library)

    ranked = [("S2", "left", "9.0\u202f%"), ("S1", "left", "8.0\u202f%"), ("S1", "right", "7.0\u202f%")]
    assert list_ranked(ranking) == ranked
    assert ranking.short == 1


def test_recordings_without_a_subject_are_never_one_person(library: Library, shelf: Shelf) -> None:
    shelf.put("a", 6.0, study=STUDY)
    shelf.put("b", 4.0, study=STUDY)

    assert list_ranked(rank(library)) == [("a", "–", "6.0\u202f%"), ("b", "–", "4.0\u202f%")]


def test_a_new_subject_and_arm_are_ranked_before_the_report_is_set_again(
    library: Library, shelf: Shelf
) -> None:
    shelf.put("P04_right.gt3x", 6.0, study=STUDY)
    (entry,) = library.find_page(LibraryFilter(batch=STUDY_ID), 100)

    ranking = build_ranking([replace(entry, subject="P04", side="right")], "en")

    assert list_ranked(ranking) == [("P04", "right", "6.0\u202f%")]
    assert ranking.arms[0].address == "/person?subject=P04"


def test_a_dot_and_its_range_are_placed_on_one_scale(library: Library, shelf: Shelf) -> None:
    shelf.put("1", 5.0, subject="S1", side="left", study=STUDY, ends=(2.0, 18.0))

    (arm,) = rank(library).arms

    # four steps of 5 % hold 18 %: 5 of 20 is a quarter
    assert rank(library).ticks[-1] == ("100.0%", "20\u202f%")
    assert (arm.at, arm.line, arm.detail) == ("25.0%", ("10.0%", "90.0%"), "2.0–18.0\u202f%")


def read_fields(page: str) -> list[tuple[str, str]]:
    subjects = re.findall(r'name="subject" value="([^"]*)"', page)
    sides = re.findall(r'<option value="(\w*)" selected', page)
    return list(zip(subjects, sides, strict=True))


def test_a_subject_and_an_arm_are_proposed_from_folders_and_names_and_count_once_saved(
    client: TestClient, shelf: Shelf, store: JobStore
) -> None:
    kept = RecordingStore(store.engine, store.reader)
    jobs = [shelf.put(file, 5.0, study=STUDY) for file in ("P01_right.gt3x", "shift.gt3x")]
    row = kept.get(jobs[1].recording_id)
    kept.describe(row, Description("shift.gt3x", folder="P02/left"))

    page = plain(client.get(f"/studies/{STUDY_ID}?lang=en").text)
    before = [kept.get(job.recording_id).about for job in jobs]
    form = {
        "recording": [job.recording_id for job in jobs],
        "subject": ["P01", "P02"],
        "side": ["right", "left"],
    }
    saved = client.post(f"/studies/{STUDY_ID}/whose", data=form)
    after = [kept.get(job.recording_id).about for job in jobs]

    assert read_fields(page) == [("P01", "right"), ("P02", "left")]
    assert "2 rows were filled in from the names of files and folders" in page
    assert [(about.subject, about.side) for about in before] == [("", None), ("", None)]
    assert saved.status_code == 303
    assert [(about.subject, about.side) for about in after] == [("P01", "right"), ("P02", "left")]
    assert after[1].folder == "P02/left"


def test_a_subject_saved_while_the_first_analysis_runs_stays_when_it_ends(
    client: TestClient, store: JobStore, storage: Storage
) -> None:
    upload = storage.open_upload(1_000_000)
    upload.write(b"1")
    job = store.add(upload.keep(), ReportRequest("1"), "web", study=STUDY)
    form = {"recording": [job.recording_id], "subject": ["S1"], "side": ["left"]}
    assert client.post(f"/studies/{STUDY_ID}/whose", data=form).status_code == 303

    finish_next(store, HeadlineFigures("good", "2026-03-02T07:00:00", WHOLE_S, 5.0, analysed_s=WHOLE_S))

    kept = client.get(f"/api/v1/recordings/{job.recording_id}").json()
    assert (kept["subject"], kept["side"]) == ("S1", "left")


def test_a_subject_that_cannot_be_used_changes_nothing(client: TestClient, shelf: Shelf) -> None:
    jobs = [shelf.put(file, 5.0, study=STUDY) for file in ("1", "2")]
    form = {"recording": [job.recording_id for job in jobs], "subject": ["S1", "x" * 101], "side": ["", ""]}

    assert client.post(f"/studies/{STUDY_ID}/whose", data=form).status_code == 422
    assert client.get("/persons?lang=en").text.count("/person?subject=") == 0


@pytest.mark.parametrize("name", ["reports", "recordings"])
def test_the_zip_of_a_study_bears_its_name(client: TestClient, shelf: Shelf, name: str) -> None:
    shelf.put("1", 5.0, study=STUDY)

    answer = client.get(f"/library/{name}.zip?batch={STUDY_ID}")

    assert unquote(answer.headers["content-disposition"]).endswith(f"''{STUDY}_{name}.zip")
    assert zipfile.ZipFile(io.BytesIO(answer.content)).testzip() is None


def test_the_list_names_the_studies_of_a_recording_and_its_study_is_found_by_name(
    client: TestClient, shelf: Shelf, library: Library
) -> None:
    job = shelf.put("1", 5.0, study=STUDY)

    (study,) = library.find_studies([job.recording_id])[job.recording_id]

    assert (study.id, study.name) == (STUDY_ID, STUDY)
    assert f'href="/studies/{STUDY_ID}"' in client.get("/").text
    assert client.get("/studies", params={"name": STUDY}).headers["location"] == f"/studies/{STUDY_ID}"
