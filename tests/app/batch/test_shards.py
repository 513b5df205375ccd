"""Slices of a run: which recordings each does, and what the tables are made of."""

from pathlib import Path

import pytest

from app.batch.folder import plan_tasks
from app.batch.run import Outcome, Shard, ShardRecord, collect_outcomes, parse_shard
from app.request import ReportRequest

ASKED = ReportRequest("", languages=("en",))


def plan(tmp_path: Path, *names: str) -> list:  # type: ignore[type-arg]
    logs = [tmp_path / name for name in names]
    return plan_tasks(logs, tmp_path / "out", ASKED, lambda log: log.name, force=False)


def test_the_slices_hold_every_recording_once_and_differ_by_one_at_most(tmp_path: Path) -> None:
    tasks = plan(tmp_path, "d.csv", "a.csv", "e.csv", "c.csv", "b.csv")

    slices = [[task.name for task in Shard(k, 2).select(tasks)] for k in (1, 2)]

    assert slices == [["a.csv", "c.csv", "e.csv"], ["b.csv", "d.csv"]]
    assert Shard(3, 3).select(tasks[:2]) == []


@pytest.mark.parametrize("text", ["0/3", "4/3", "3", "a/b", "1/2/3", "-1/2"])
def test_what_names_no_slice_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r".*"):
        parse_shard(text)


def test_a_recording_without_report_or_failure_is_not_done(tmp_path: Path) -> None:
    ShardRecord(tmp_path / "out", Shard(1, 2), plan(tmp_path, "a.csv", "b.csv"), ASKED).begin()

    collected = collect_outcomes(tmp_path / "out")

    assert [(o.task.name, o.code) for o in collected.outcomes] == [
        ("a.csv", "E-INTERRUPTED"),
        ("b.csv", "E-INTERRUPTED"),
    ]
    assert collected.request == ASKED


def report_failure(tmp_path: Path, shard: Shard, tasks: list) -> None:  # type: ignore[type-arg]
    """Leave what a slice writes whose first recording failed."""
    record = ShardRecord(tmp_path / "out", shard, tasks, ASKED)
    record.begin()
    record.write([Outcome(tasks[0], code="E-SHORT", facts={"seconds": 4})])


def test_a_failure_is_collected_with_its_facts(tmp_path: Path) -> None:
    report_failure(tmp_path, Shard(1, 1), plan(tmp_path, "a.csv"))

    (outcome,) = collect_outcomes(tmp_path / "out").outcomes

    assert (outcome.code, outcome.facts) == ("E-SHORT", {"seconds": 4})


def test_a_slice_of_another_plan_is_named_even_if_nothing_is_left_to_do(tmp_path: Path) -> None:
    ShardRecord(tmp_path / "out", Shard(2, 2), plan(tmp_path, "a.csv"), ASKED).begin()
    report_failure(tmp_path, Shard(1, 2), plan(tmp_path, "b.csv"))

    collected = collect_outcomes(tmp_path / "out")

    assert (collected.undone, collected.differing) == ((), ("2/2",))


@pytest.mark.parametrize(("before", "planned"), [(Shard(1, 1), 2), (Shard(1, 2), 1)], ids=["number", "plan"])
def test_reports_of_slices_of_another_number_or_plan_do_not_count(
    tmp_path: Path, before: Shard, planned: int
) -> None:
    tasks = plan(tmp_path, "a.csv", "b.csv")
    report_failure(tmp_path, before, tasks[:planned])

    ShardRecord(tmp_path / "out", Shard(2, 2), tasks, ASKED).begin()

    assert [o.code for o in collect_outcomes(tmp_path / "out").outcomes] == ["E-INTERRUPTED"] * 2
