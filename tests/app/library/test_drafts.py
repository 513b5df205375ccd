"""Drafts of a conclusion: it survives corrections, and no report prints it until a person confirms it."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from app.errors import StaleVersion
from app.jobs import versions
from app.jobs.database.tables import audit_log
from app.jobs.job import Job
from app.jobs.library.figures import HeadlineFigures
from app.jobs.side_files import read_side_rows
from app.jobs.store import JobStore
from app.main import create_app
from app.request import Conclusion, ConclusionDraft, ReportRequest
from app.settings import Settings
from app.storage.store import ResultFile
from app.web.recording.conclusion import describe_draft
from fusion.conventions import METHOD_VERSION
from fusion.diary import DiaryEntry
from tests.app.conftest import AddJob

SAID = Conclusion("Overhead work is the load.", "M. Tremblay", "2026-11-23")


@pytest.fixture
def caller(settings: Settings, store: JobStore) -> Iterator[TestClient]:
    with TestClient(create_app(settings), "http://localhost:8080") as client:
        yield client


@pytest.fixture
def first(store: JobStore, add_job: AddJob) -> Job:
    """Version 1: neither arm of S1, without a conclusion."""
    return finish(store, add_job(subject="S1"))


@pytest.fixture
def concluded(store: JobStore, first: Job) -> Job:
    """Version 2: the same figures, with a conclusion."""
    return finish(store, store.conclude(first, SAID))


def finish(store: JobStore, job: Job) -> Job:
    """Let the job that waits end well; gives it."""
    claimed = store.claim()
    assert claimed is not None
    assert claimed.id == job.id
    figures = HeadlineFigures("good", "2026-03-02T07:00:00", 60.0, 1.0, "smoothed", int(METHOD_VERSION))
    assert store.finish(job.id, str(claimed.token), [ResultFile("results.json", "0" * 64, 2)], figures)
    return store.get(job.id)


def correct(store: JobStore, job: Job, **asked: object) -> Job:
    """Correct an analysis as the page does, and finish the new one."""
    return finish(store, store.add_correction(job, replace(job.request, **asked)))  # type: ignore[arg-type]


def test_a_correction_turns_the_conclusion_into_a_draft(store: JobStore, concluded: Job) -> None:
    corrected = correct(store, concluded, side="left").request

    assert corrected.version == 3
    assert corrected.conclusion is None
    assert corrected.draft == ConclusionDraft(SAID, 2, ("side",))


def test_a_draft_reaches_version_5_with_all_that_changed(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")
    fourth = correct(store, third, slip_times_s=(60.0,))
    fifth = correct(store, fourth, subject="S2").request

    assert fifth.version == 5
    assert fifth.draft == ConclusionDraft(SAID, 2, ("subject", "side", "slip_times_s"))


def test_a_setting_that_is_put_back_is_no_change(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left", slip_times_s=(60.0,))
    fourth = correct(store, third, side=None).request

    assert fourth.draft == ConclusionDraft(SAID, 2, ("slip_times_s",))


def test_an_analysis_with_the_same_settings_keeps_the_conclusion(store: JobStore, concluded: Job) -> None:
    again = correct(store, concluded, paper="letter").request

    assert (again.version, again.conclusion, again.draft) == (2, SAID, None)


def test_a_newer_version_of_the_software_makes_a_draft_of_the_conclusion(
    store: JobStore, concluded: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(versions, "identify_engine", lambda: "of tomorrow")

    again = correct(store, concluded).request

    assert (again.version, again.conclusion) == (3, None)
    assert again.draft == ConclusionDraft(SAID, 2, ("engine",))


def test_another_subject_code_makes_a_draft_too(store: JobStore, concluded: Job) -> None:
    assert correct(store, concluded, subject="S2").request.draft == ConclusionDraft(SAID, 2, ("subject",))


def test_a_subject_code_that_chooses_other_rows_of_the_diary_changes_the_diary(
    store: JobStore, concluded: Job
) -> None:
    rows = (DiaryEntry("07:00:00", "07:01:00", "break", file="S2"),)
    third = correct(store, concluded, diary=rows)
    fourth = finish(store, store.conclude(third, replace(SAID, text="A break was taken out.")))

    fifth = correct(store, fourth, subject="S2").request

    assert fifth.draft is not None
    assert fifth.draft.changes == ("subject", "diary")


def test_a_confirmed_conclusion_leaves_no_draft(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")
    fourth = finish(store, store.conclude(third, SAID)).request

    assert (fourth.version, fourth.conclusion, fourth.draft) == (4, SAID, None)


def test_a_dismissed_draft_is_in_no_later_version(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")

    store.dismiss_draft(third.id)

    assert store.get(third.id).request.draft is None
    assert correct(store, store.get(third.id), slip_times_s=(60.0,)).request.draft is None


def test_a_draft_that_is_dismissed_while_its_analysis_waits_stays_dismissed(
    store: JobStore, concluded: Job
) -> None:
    waiting = store.add_correction(concluded, replace(concluded.request, side="left"))

    store.dismiss_draft(waiting.id)

    assert finish(store, waiting).request.draft is None


def test_a_conclusion_for_a_version_that_is_not_the_current_one_is_refused(
    store: JobStore, first: Job, concluded: Job
) -> None:
    with pytest.raises(StaleVersion):
        store.conclude(first, replace(SAID, text="Of the version before."))
    with pytest.raises(StaleVersion):
        store.conclude(first, None)

    assert {job.id for job in store.find_newest()} == {first.id, concluded.id}


def test_the_same_conclusion_sent_twice_is_one_version(store: JobStore, first: Job, concluded: Job) -> None:
    assert store.conclude(first, SAID).id == concluded.id


def test_a_conclusion_that_is_taken_away_leaves_no_draft(store: JobStore, concluded: Job) -> None:
    removed = finish(store, store.conclude(concluded, None)).request

    assert (removed.version, removed.conclusion, removed.draft) == (1, None, None)


def test_a_correction_that_fails_does_not_lose_the_draft(store: JobStore, concluded: Job) -> None:
    failed = store.add_correction(concluded, replace(concluded.request, calibration_windows_s=((1.0, 9.0),)))
    claimed = store.claim()
    assert claimed is not None
    store.fail(failed.id, str(claimed.token), "E-CALIBRATION", {})

    assert store.repeat(store.get(failed.id), "web").request.draft is not None


def test_an_analysis_by_a_script_has_the_draft_too(store: JobStore, concluded: Job) -> None:
    plain = replace(concluded.request, conclusion=None, side="left")

    asked = store.add_analysis((concluded.recording_id, concluded.sha256), plain)

    assert asked.request.draft == ConclusionDraft(SAID, 2, ("side",))


def test_a_change_of_many_recordings_keeps_the_draft(
    caller: TestClient, store: JobStore, concluded: Job
) -> None:
    caller.post("/library/acts/side", data={"recording": [concluded.recording_id], "side": "left"})

    assert store.find_newest()[0].request.draft == ConclusionDraft(SAID, 2, ("side",))


def test_a_draft_does_not_make_other_work_of_the_same_settings(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")

    (same,) = store.find_same(third.sha256, replace(third.request, draft=None))

    assert same.id == third.id


def test_a_stored_request_holds_the_draft() -> None:
    request = ReportRequest("shift.gt3x", draft=ConclusionDraft(SAID, 2, ("side", "engine")))

    assert ReportRequest.from_json(request.to_json()) == request


def test_a_side_file_holds_the_draft(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")

    with store.reader.connect() as connection:
        side = read_side_rows(connection, third.recording_id)

    assert side is not None
    asked = {row["id"]: row["request"] for row in side.rows["analyses"]}[third.id]
    assert ReportRequest.from_json(asked).draft == ConclusionDraft(SAID, 2, ("side",))


# The API.


def test_the_api_shows_conclusion_and_draft(caller: TestClient, store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")

    before, after = (caller.get(f"/api/v1/analyses/{job.id}").json() for job in (concluded, third))

    said = {"text": "Overhead work is the load.", "name": "M. Tremblay", "date": "2026-11-23"}
    assert (before["conclusion"], before["conclusion_draft"]) == (said, None)
    assert after["conclusion"] is None
    assert after["conclusion_draft"] == said | {"version": 2, "changes": ["side"]}


def test_a_script_confirms_a_draft_by_sending_it(caller: TestClient, store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")
    draft = caller.get(f"/api/v1/analyses/{third.id}").json()["conclusion_draft"]
    said = {name: draft[name] for name in ("text", "name")} | {"date": "2026-12-01"}
    wish = {"recording_ids": [third.recording_id], "settings": {"conclusion": said}}

    answer = caller.post("/api/v1/analyses", json=wish).json()

    assert (answer["conclusion"], answer["conclusion_draft"]) == (said, None)


def test_a_script_dismisses_a_draft(caller: TestClient, store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")

    answers = [caller.delete(f"/api/v1/analyses/{third.id}/conclusion-draft").status_code for _ in range(2)]

    assert answers == [204, 204]
    assert caller.get(f"/api/v1/analyses/{third.id}").json()["conclusion_draft"] is None


def test_a_draft_of_an_unknown_analysis_is_a_404(caller: TestClient) -> None:
    assert caller.delete("/api/v1/analyses/an_0000000000000000/conclusion-draft").status_code == 404


def test_what_is_dismissed_is_one_line_of_the_audit_log(store: JobStore, concluded: Job) -> None:
    third = correct(store, concluded, side="left")

    store.dismiss_draft(third.id)
    store.dismiss_draft(third.id)

    lines = select(audit_log.c.analysis_id).where(audit_log.c.act == "conclusion.dismissed")
    with store.reader.connect() as connection:
        assert connection.execute(lines).scalars().all() == [third.id]


def test_a_kept_conclusion_is_not_written_again_in_the_audit_log(store: JobStore, concluded: Job) -> None:
    correct(store, concluded)

    lines = select(audit_log.c.analysis_id).where(audit_log.c.act == "report.concluded")
    with store.reader.connect() as connection:
        assert connection.execute(lines).scalars().all() == [concluded.id]


# The page.


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (("side", "diary"), "written for other figures (changed since: the arm, the diary)"),
        (("engine",), "written for other figures (changed since: the version of the software)"),
        (("subject",), "written for the same figures under another subject code"),
        ((), "written for the same figures."),
    ],
)
def test_the_page_says_what_a_draft_was_written_for(changes: tuple[str, ...], told: str) -> None:
    assert told in describe_draft(ConclusionDraft(SAID, 2, changes), "en")


def test_a_dismissed_draft_leads_back_to_its_page(
    caller: TestClient, store: JobStore, concluded: Job
) -> None:
    third = correct(store, concluded, side="left")

    answer = caller.post(f"/analyses/{third.id}/dismiss", follow_redirects=False)

    assert answer.headers["location"] == f"/analyses/{third.id}"
    assert store.get(third.id).request.draft is None
