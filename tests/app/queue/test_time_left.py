"""The time left of an analysis, by those before it: what is judged, what is not, where it is told."""

import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
from fastapi.testclient import TestClient

from app.jobs.job import Job, JobState
from app.jobs.listing import Library, Took
from app.jobs.store import JobStore
from app.jobs.worker import run_next
from app.web.views import estimate_left_s
from tests.app import stand_ins
from tests.app.conftest import AddJob, OpenBench

NOW = datetime(2026, 3, 2, 8, 0, 10, tzinfo=UTC)
BEGAN = NOW - timedelta(seconds=4)


@pytest.fixture
def running(add_job: AddJob) -> Job:
    """An analysis of a file of 100 bytes, begun 4 s ago."""
    return replace(add_job(), file_name="day.GT3X", size_bytes=100, state=JobState.RUNNING, started_at=BEGAN)


def test_a_file_twice_as_large_takes_twice_as_long(running: Job) -> None:
    took = [Took("a.gt3x", 50, 3.0), Took("b.gt3x", 100, 10.0), Took("c.gt3x", 200, 14.0)]

    assert estimate_left_s(running, took, NOW) == 3.0  # 6, 10 and 7 s: the middle one, less 4


@pytest.mark.parametrize(
    "took",
    [
        [],
        [Took("a.csv", 100, 10.0)],  # another kind
        [Took("a.gt3x", 49, 10.0)],  # less than half as large
        [Took("a.gt3x", 201, 10.0)],  # more than twice
        [Took("a.gt3x", 100, 4.0)],  # should be over
    ],
)
def test_without_a_file_like_it_no_time_is_told(running: Job, took: list[Took]) -> None:
    assert estimate_left_s(running, took, NOW) is None


def test_only_what_runs_has_time_left(running: Job) -> None:
    waiting = replace(running, state=JobState.QUEUED, started_at=None)

    assert estimate_left_s(waiting, [Took("a.gt3x", 100, 10.0)], NOW) is None


def test_finished_analyses_are_what_time_is_judged_by(
    store: JobStore, add_job: AddJob, bench: OpenBench
) -> None:
    add_job(b"1")
    run_next(bench(stand_ins.write_report))
    add_job(b"2")

    (took,) = Library(store.reader).find_took()

    assert took.size_bytes == 1
    assert took.took_s >= 0


def test_the_list_tells_about_how_long_it_still_takes(
    client: TestClient, store: JobStore, add_job: AddJob, monkeypatch: pytest.MonkeyPatch
) -> None:
    add_job(b"123")
    store.claim()
    monkeypatch.setattr(Library, "find_took", lambda _: (Took("a.gt3x", 3, 3600.0),))

    assert re.search(r"about (1\s+h|59\s+min.{0,8}) left", client.get("/").text)
