"""A clinician's conclusion: in the report as it was typed, with name and date; never in the figures."""

import json
import threading
import time
from dataclasses import replace
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import select

from acromion.app.errors import BadParameter, StaleVersion
from acromion.app.http.pages import rendering
from acromion.app.http.pages.recording.analysis import describe_draft, read_conclusion
from acromion.app.library import versions
from acromion.app.library.database.tables import audit_log
from acromion.app.library.jobs import JobStore
from acromion.app.library.listing import HeadlineFigures
from acromion.app.library.rows import Job, JobState
from acromion.app.library.side_files import read_side_rows
from acromion.app.report.export.results import build_results, identify_report
from acromion.app.report.findings import ReportSubject
from acromion.app.report.single.report import build_report
from acromion.app.request import Conclusion, ConclusionDraft, ReportRequest
from acromion.fusion.conventions import METHOD_VERSION
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.settings import DEFAULT_SETTINGS
from tests.app.analysis_factory import make_analysis, make_subject
from tests.app.conftest import AddJob
from tests.app.library.test_report_versions import fail_next, finish_next

TWO_LINES = Conclusion("Overhead work is the load.\nMeasure again in May.", "M. Tremblay", "2026-11-23")


def concluded() -> ReportSubject:
    return replace(make_subject(), conclusion=TWO_LINES)


def test_the_report_shows_each_paragraph_with_name_and_date() -> None:
    note = build_report(make_analysis(), concluded(), "en").conclusion

    assert note is not None
    assert note.title == "Conclusion: M. Tremblay, 23\u00a0November\u00a02026"
    typed = "Written by the person named; not computed."
    assert note.paragraphs == ("Overhead work is the load.", "Measure again in May.", typed)
    assert build_report(make_analysis(), make_subject(), "en").conclusion is None


def test_a_report_with_a_conclusion_has_an_id_of_its_own() -> None:
    findings = make_analysis()

    assert identify_report(DEFAULT_SETTINGS, findings, concluded()) != identify_report(
        DEFAULT_SETTINGS, findings, make_subject()
    )


def test_the_conclusion_moves_no_figure() -> None:
    findings = make_analysis()
    with_it, without = (build_results(findings, subject) for subject in (concluded(), make_subject()))

    assert with_it.pop("conclusion") == {
        "text": "Overhead work is the load.\nMeasure again in May.",
        "name": "M. Tremblay",
        "date": "2026-11-23",
    }
    assert without.pop("conclusion") is None
    assert json.dumps(with_it) == json.dumps(without)


@pytest.mark.parametrize(
    ("field", "typed"), [("text", " \u200b "), ("text", "x" * 1001), ("name", ""), ("date", "23/11/2026")]
)
def test_a_conclusion_lacks_nothing(field: str, typed: str) -> None:
    form = {"text": ["Raised."], "name": ["M. Tremblay"], "date": ["2026-11-23"]} | {field: [typed]}

    with pytest.raises(BadParameter) as refused:
        read_conclusion(form)

    assert refused.value.facts["name"] == field


# Drafts: a conclusion survives corrections, and no report prints it until a person confirms it.


SAID = Conclusion("Overhead work is the load.", "M. Tremblay", "2026-11-23")


@pytest.fixture
def first(store: JobStore, add_job: AddJob) -> Job:
    """Version 1: neither arm of S1, without a conclusion."""
    return finish(store, add_job(subject="S1"))


@pytest.fixture
def second(store: JobStore, first: Job) -> Job:
    """Version 2: the same figures, with a conclusion."""
    return finish(store, store.conclude(first, SAID))


def finish(store: JobStore, job: Job) -> Job:
    """Let the job that waits end well; returns it."""
    figures = HeadlineFigures("good", "2026-03-02T07:00:00", 60.0, 1.0, "smoothed", int(METHOD_VERSION))
    finished = finish_next(store, figures)
    assert finished.id == job.id
    return finished


def correct(store: JobStore, job: Job, **asked: object) -> Job:
    """Correct an analysis as the page does, and finish the new one."""
    return finish(store, store.add_correction(job, replace(job.request, **asked)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("steps", "changes"),
    [
        ([{"side": "left"}], ("side",)),
        ([{"subject": "S2"}], ("subject",)),
        (
            [{"side": "left"}, {"slip_times_s": (60.0,)}, {"subject": "S2"}],
            ("subject", "side", "slip_times_s"),
        ),
        ([{"side": "left", "slip_times_s": (60.0,)}, {"side": None}], ("slip_times_s",)),  # put back
    ],
)
def test_corrections_turn_the_conclusion_into_a_draft_with_all_that_changed(
    store: JobStore, second: Job, steps: list[dict[str, Any]], changes: tuple[str, ...]
) -> None:
    corrected = second
    for asked in steps:
        corrected = correct(store, corrected, **asked)

    request = corrected.request
    assert (request.version, request.conclusion) == (2 + len(steps), None)
    assert request.draft == ConclusionDraft(SAID, 2, changes)


def test_an_analysis_with_the_same_settings_keeps_the_conclusion(store: JobStore, second: Job) -> None:
    again = correct(store, second, paper="letter").request

    assert (again.version, again.conclusion, again.draft) == (2, SAID, None)


def test_a_newer_version_of_the_software_makes_a_draft_of_the_conclusion(
    store: JobStore, second: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(versions, "identify_engine", lambda: "of tomorrow")

    again = correct(store, second).request

    assert (again.version, again.conclusion) == (3, None)
    assert again.draft == ConclusionDraft(SAID, 2, ("engine",))


def test_a_subject_code_that_chooses_other_rows_of_the_diary_changes_the_diary(
    store: JobStore, second: Job
) -> None:
    rows = (DiaryEntry("07:00:00", "07:01:00", "break", file="S2"),)
    third = correct(store, second, diary=rows)
    fourth = finish(store, store.conclude(third, replace(SAID, text="A break was taken out.")))

    fifth = correct(store, fourth, subject="S2").request

    assert fifth.draft is not None
    assert fifth.draft.changes == ("subject", "diary")


def test_a_dismissed_draft_is_in_no_later_version(store: JobStore, second: Job) -> None:
    third = correct(store, second, side="left")

    store.dismiss_draft(third.id)

    assert store.get(third.id).request.draft is None
    assert correct(store, store.get(third.id), slip_times_s=(60.0,)).request.draft is None


def test_a_draft_that_is_dismissed_while_its_analysis_waits_stays_dismissed(
    store: JobStore, second: Job
) -> None:
    waiting = store.add_correction(second, replace(second.request, side="left"))

    store.dismiss_draft(waiting.id)

    assert finish(store, waiting).request.draft is None


def test_a_conclusion_for_a_version_that_is_not_the_current_one_is_refused(
    store: JobStore, first: Job, second: Job
) -> None:
    with pytest.raises(StaleVersion):
        store.conclude(first, replace(SAID, text="Of the version before."))
    with pytest.raises(StaleVersion):
        store.conclude(first, None)

    assert {job.id for job in store.find_newest()} == {first.id, second.id}


def test_the_same_conclusion_sent_twice_is_one_version(store: JobStore, first: Job, second: Job) -> None:
    assert store.conclude(first, SAID).id == second.id


def test_a_conclusion_that_is_taken_away_leaves_no_draft(store: JobStore, second: Job) -> None:
    removed = finish(store, store.conclude(second, None)).request

    assert (removed.version, removed.conclusion, removed.draft) == (1, None, None)


def test_a_correction_that_fails_does_not_lose_the_draft(store: JobStore, second: Job) -> None:
    failed = store.add_correction(second, replace(second.request, calibration_windows_s=((1.0, 9.0),)))
    fail_next(store)

    assert store.repeat(store.get(failed.id), "web").request.draft is not None


def test_a_change_of_many_recordings_and_an_analysis_by_a_script_have_the_draft(
    client: TestClient, store: JobStore, second: Job
) -> None:
    client.post("/library/acts/side", data={"recording": [second.recording_id], "side": "left"})
    many = store.find_newest()[0].request
    plain = replace(second.request, conclusion=None, side="left")
    script = store.add_analysis((second.recording_id, second.sha256), plain).request

    assert many.draft == script.draft == ConclusionDraft(SAID, 2, ("side",))


def test_a_side_file_holds_the_draft_which_makes_no_other_work(store: JobStore, second: Job) -> None:
    third = correct(store, second, side="left")

    with store.reader.connect() as connection:
        side = read_side_rows(connection, third.recording_id)

    assert side is not None
    asked = {row["id"]: row["request"] for row in side.rows["analyses"]}[third.id]
    assert ReportRequest.from_json(asked).draft == ConclusionDraft(SAID, 2, ("side",))
    (same,) = store.find_same(third.sha256, replace(third.request, draft=None))
    assert same.id == third.id


# The API.


def test_the_api_shows_conclusion_and_draft(client: TestClient, store: JobStore, second: Job) -> None:
    third = correct(store, second, side="left")

    before, after = (client.get(f"/api/v1/analyses/{job.id}").json() for job in (second, third))

    said = {"text": "Overhead work is the load.", "name": "M. Tremblay", "date": "2026-11-23"}
    assert (before["conclusion"], before["conclusion_draft"]) == (said, None)
    assert after["conclusion"] is None
    assert after["conclusion_draft"] == said | {"version": 2, "changes": ["side"]}


def test_a_script_confirms_a_draft_by_sending_it(client: TestClient, store: JobStore, second: Job) -> None:
    third = correct(store, second, side="left")
    draft = client.get(f"/api/v1/analyses/{third.id}").json()["conclusion_draft"]
    said = {name: draft[name] for name in ("text", "name")} | {"date": "2026-12-01"}
    wish = {"recording_ids": [third.recording_id], "settings": {"conclusion": said}}

    answer = client.post("/api/v1/analyses", json=wish).json()

    assert (answer["conclusion"], answer["conclusion_draft"]) == (said, None)


@pytest.mark.parametrize("way", ["script", "page"])
def test_a_draft_is_dismissed_once(client: TestClient, store: JobStore, second: Job, way: str) -> None:
    third = correct(store, second, side="left")

    for _ in range(2):
        if way == "script":
            answer = client.delete(f"/api/v1/analyses/{third.id}/conclusion-draft")
            assert answer.status_code == 204
        else:
            answer = client.post(f"/analyses/{third.id}/dismiss")
            assert answer.headers["location"] == f"/analyses/{third.id}"

    assert client.get(f"/api/v1/analyses/{third.id}").json()["conclusion_draft"] is None
    assert find_concluded(store, "conclusion.dismissed") == [third.id]
    assert client.delete("/api/v1/analyses/an_0000000000000000/conclusion-draft").status_code == 404


def test_the_page_after_a_conclusion_has_its_report(
    client: TestClient, store: JobStore, first: Job, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering, "SET_S", 60.0)

    def set_report() -> None:  # as a worker does while the request waits
        while store.count_waiting() == 0:
            time.sleep(0.01)
        finish_next(store, HeadlineFigures("good", None, 60.0, 1.0, "smoothed"))

    worker = threading.Thread(target=set_report)
    worker.start()
    form = {"text": "Fine.", "name": "M. Tremblay", "date": "2026-11-23"}
    answer = client.post(f"/analyses/{first.id}/conclude", data=form)

    made = answer.headers["location"].rpartition("/")[2]
    assert store.get(made).state is JobState.SUCCEEDED
    worker.join()


def find_concluded(store: JobStore, act: str) -> list[str]:
    lines = select(audit_log.c.analysis_id).where(audit_log.c.act == act)
    with store.reader.connect() as connection:
        return list(connection.execute(lines).scalars())


def test_a_kept_conclusion_is_not_written_again_in_the_audit_log(store: JobStore, second: Job) -> None:
    correct(store, second)

    assert find_concluded(store, "report.concluded") == [second.id]


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
