"""A new label sets a report again from its figures: the recording is not read, and nothing is half-made."""

from dataclasses import replace
from typing import Any

import pytest
from sqlalchemy import select, update

from acromion.app.library.audit_log import acting
from acromion.app.library.database.tables import analyses, audit_log
from acromion.app.library.jobs import JobFilter, JobStore
from acromion.app.library.listing import HeadlineFigures
from acromion.app.library.rows import Job, JobState
from acromion.app.queue.worker import return_expired, run_next
from acromion.app.request import Conclusion
from acromion.app.store.folder import ResultFile, Storage, borrow_result, format_result_name
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenWorker, on_both_set_ups

LABELS: dict[str, dict[str, Any]] = {
    "subject": {"subject": "S013"},
    "side": {"side": "left"},
    "job": {"job_title": "Carpenter", "isco_code": "7115"},
    "conclusion": {"conclusion": Conclusion("Overhead work is the load.", "M. Tremblay", "2026-11-23")},
    "language": {"languages": ("fr-CA",)},
    "paper": {"paper": "letter"},
}
MEASURED: dict[str, dict[str, Any]] = {
    "pose": {"pose_held": "start"},
    "method": {"method": "published"},
    "window": {"calibration_windows_s": ((1.0, 4.0),)},
}


@pytest.fixture
def report(store: JobStore, add_job: AddJob, open_worker: OpenWorker, small_gt3x: bytes) -> Job:
    """A real report."""
    job = add_job(small_gt3x, subject="S012")
    assert run_next(open_worker(None))
    return store.get(job.id)


def label(store: JobStore, report: Job, **said: Any) -> Job:
    return store.add_correction(report, replace(report.request, **said))


def hash_files(store: JobStore, job: Job) -> dict[str, str]:
    return {file.name: file.sha256 for file in store.find_files(job.id)}


@on_both_set_ups
def test_a_label_set_again_has_the_files_of_a_full_analysis_without_those_made_on_request(
    store: JobStore, report: Job, open_worker: OpenWorker
) -> None:
    worker = open_worker(None)
    said = label(store, report, subject="S013", side="left")
    assert said.is_label
    run_next(worker)

    full = store.add_correction(store.get(said.id), said.request, is_fresh=True)
    assert not full.is_label
    run_next(worker)

    files = hash_files(store, full)
    assert [files.pop(name) for name in ("report.fr.pdf", "fhir.json")]
    assert hash_files(store, said) == files
    assert {"results.json", "elevation.parquet", "report.en.pdf", "report.fr.html"} < files.keys()


@on_both_set_ups
def test_a_new_label_does_not_read_the_recording(
    store: JobStore, storage: Storage, report: Job, open_worker: OpenWorker
) -> None:
    storage.drop_recording(report.recording_id)
    said = label(store, report, subject="S013")

    run_next(open_worker(None))

    assert store.get(said.id).state is JobState.SUCCEEDED
    for file in store.find_files(said.id):  # the angle and the day are also in the store
        with borrow_result(storage, said.id, str(store.get(said.id).token), file) as path:
            assert path.stat().st_size == file.size_bytes


@on_both_set_ups
def test_a_label_whose_figures_are_damaged_is_analysed(
    store: JobStore, storage: Storage, report: Job, open_worker: OpenWorker
) -> None:
    storage.write_small(format_result_name(report.id, str(report.token), "results.json"), b"{}")
    said, worker = label(store, report, subject="S013"), open_worker(None)

    run_next(worker)
    waiting = store.get(said.id)
    run_next(worker)

    assert (waiting.state, waiting.is_label, waiting.attempts) == (JobState.QUEUED, False, 0)
    assert store.get(said.id).state is JobState.SUCCEEDED


@on_both_set_ups
def test_a_worker_killed_while_it_sets_a_report_leaves_the_old_one_until_another_sets_it(
    store: JobStore, storage: Storage, report: Job, open_worker: OpenWorker
) -> None:
    said = label(store, report, subject="S013")
    claimed = store.claim(is_label=True)
    assert claimed is not None
    (storage.open_attempt(claimed.id, str(claimed.token)) / "results.json").write_bytes(b"half")
    store.run(update(analyses).where(analyses.c.id == said.id).values(lease_until_s=0.0, is_lease_missed=1))
    assert [job.id for job in store.find_reports(report)] == [report.id]

    worker = open_worker(None)
    return_expired(worker)
    run_next(worker, is_label=True)

    assert [job.id for job in store.find_reports(report)] == [said.id, report.id]
    assert storage.find_mark(format_result_name(said.id, str(claimed.token), "results.json")) is None


# Which changes are only said.


def finish(store: JobStore, job: Job, method: str) -> Job:
    """Finish a job with one file, as a worker would."""
    claimed = store.claim()
    assert claimed is not None
    file = ResultFile("results.json", "0" * 64, 2)
    store.finish(job.id, str(claimed.token), [file], HeadlineFigures("good", None, 60.0, 1.0, method))
    return store.get(job.id)


@pytest.fixture
def made(store: JobStore, add_job: AddJob) -> Job:
    """A report of a sensor."""
    return finish(store, add_job(subject="S012"), method="smoothed")


@pytest.mark.parametrize("name", LABELS)
def test_a_label_needs_no_analysis(store: JobStore, made: Job, name: str) -> None:
    assert label(store, made, **LABELS[name]).is_label


@pytest.mark.parametrize("name", MEASURED)
def test_a_setting_needs_an_analysis(store: JobStore, made: Job, name: str) -> None:
    assert not label(store, made, **MEASURED[name]).is_label


def test_a_label_returned_to_needs_no_analysis_after_another_setting(store: JobStore, made: Job) -> None:
    label(store, made, pose_held="start")

    assert label(store, made, subject="S013").is_label


def test_the_other_arm_of_a_motion_capture_needs_an_analysis(store: JobStore, add_job: AddJob) -> None:
    capture = finish(store, add_job(), method="")

    assert not label(store, capture, side="left").is_label
    assert label(store, capture, subject="S013").is_label


def test_a_label_given_during_the_analysis_waits_for_its_figures(
    store: JobStore, add_job: AddJob, open_worker: OpenWorker
) -> None:
    first = add_job(subject="S012")
    said = label(store, first, subject="S013")

    assert said.is_label
    assert store.claim(is_label=True) is None
    run_next(open_worker(stand_ins.write_report), is_label=False)
    claimed = store.claim(is_label=True)
    assert claimed is not None
    assert claimed.id == said.id


def test_a_label_goes_before_every_analysis(store: JobStore, made: Job, add_job: AddJob) -> None:
    add_job(b"another")
    said = label(store, made, subject="S013")

    claimed = store.claim()

    assert claimed is not None
    assert claimed.id == said.id


def test_an_analysis_asked_for_again_reads_the_recording(store: JobStore, made: Job) -> None:
    recording = (made.recording_id, made.sha256)

    assert not store.add_analysis(recording, made.request, is_fresh=True).is_label
    assert store.repeat_all([(made, made.request)], is_fresh=True) == 1
    assert all(not job.is_label for job in store.find_page(JobFilter(JobState.QUEUED)))


def test_a_study_keeps_the_report_until_the_new_label_is_set(
    store: JobStore, made: Job, open_worker: OpenWorker
) -> None:
    study = store.join_study("Shoulders", made.id)
    said = label(store, made, subject="S013")
    before = [job.id for job in store.find_page(JobFilter(batch_id=study))]

    run_next(open_worker(stand_ins.write_report))

    assert before == [made.id]
    assert [job.id for job in store.find_page(JobFilter(batch_id=study))] == [said.id]


def test_the_audit_log_has_who_changed_what_of_a_report(store: JobStore, made: Job) -> None:
    with acting("person:anna"):
        said = label(store, made, subject="S013", side="left", reason="the wrong arm")

    query = select(audit_log.c.who, audit_log.c.act, audit_log.c.other).where(
        audit_log.c.analysis_id == said.id
    )
    with store.reader.connect() as connection:
        (line,) = connection.execute(query).all()
    assert line == ("person:anna", "analysis.asked", '{"changes": "subject+side"}')
    assert store.get(said.id).request.reason == "the wrong arm"
