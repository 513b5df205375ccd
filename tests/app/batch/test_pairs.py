"""The pairs of a run: proposed by subject and side, matched by clocks or by shared movement."""

import json
import os
import signal
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from acromion.app.analysis import pair
from acromion.app.batch import pairs
from acromion.app.batch.folder import PAIRS, Task
from acromion.app.batch.inputs import read_participants
from acromion.app.batch.pairs import describe_pairs, propose_pairs, write_pairs
from acromion.app.cli.output import note_pairs
from acromion.app.report.export.angles import write_elevation
from acromion.app.report.export.results import encode_results
from acromion.app.report.export.tables import Row
from acromion.app.request import ReportRequest
from acromion.fusion.comparison.movement import ClockMatch
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.recording import Segment
from tests.app.analysis.test_both_arms import kept_of
from tests.fusion.comparison.test_movement import HZ, move

LONG_S = 700
MORNING, EVENING = datetime(2026, 3, 2, 7, 0), datetime(2026, 3, 2, 19, 0)  # noqa: DTZ001
Finished = tuple[Task, dict[str, Any]]


def ask(name: str, subject: str = "P01", side: Any = None, **more: Any) -> Task:
    return Task(Path(name), ReportRequest(name, subject, side, **more), Path("out") / name)


def finish(
    folder: Path, name: str, side: Any, start: datetime | None, *, body: int = 1, from_s: int = 0
) -> Finished:
    """Leave a finished analysis of a still arm on a body that moves; the recording begins at ``from_s``."""
    out = folder / name
    out.mkdir()
    kept = kept_of(side, start)
    findings = replace(kept.findings, exclusions=())
    (out / "results.json").write_bytes(encode_results(findings, kept.subject))
    rng = np.random.default_rng(sum(map(ord, name)))
    size_g = 1.0 + move(body, LONG_S)[from_s * HZ :]
    size_g += 0.05 * rng.standard_normal(len(size_g))
    acc_g = np.column_stack([size_g, np.zeros((len(size_g), 2))]).astype(np.float32)
    angles = np.full(len(acc_g), 70.0, np.float32)
    segment = ElevationSegment(0, 100.0, angles, np.ones(len(angles), np.bool_))
    samples = Segment(0, 100.0, acc_g, np.zeros_like(acc_g))
    write_elevation(Elevation((segment,), None), out / "elevation.parquet", samples=(samples,))
    task = Task(Path(name), ReportRequest(name, "S012", side), out)
    results = json.loads((out / "results.json").read_bytes())
    return task, results | {"time": {"recorded_s": float(LONG_S - from_s)}}


def kill_itself(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)


# ------------------------------------------------------------------ which are proposed


def test_only_a_subject_with_both_arms_is_proposed() -> None:
    tasks = [ask("a.csv", "P01", "left"), ask("b.csv", "P01", "right"), ask("c.csv", "P02", "left")]

    (proposal,) = propose_pairs(tasks)

    assert (proposal.subject, proposal.left, proposal.right) == ("P01", (tasks[0],), (tasks[1],))


def test_recordings_without_a_subject_or_a_side_are_not_proposed() -> None:
    assert not propose_pairs([ask("a.csv", "", "left"), ask("b.csv", "", "right"), ask("c.csv", "P01")])


def test_a_list_states_the_trunk_in_the_column_side() -> None:
    (row,), _ = read_participants(b"file,subject,side\nt.csv,P01,trunk\n", None)
    tasks = [ask("a.csv", side="left"), ask("b.csv", side="right"), ask("t.csv", side="trunk")]

    assert row.stated["side"] == "trunk"
    assert propose_pairs(tasks)[0].trunk == (tasks[2],)


# ------------------------------------------------------------------ which belong together


def test_clocks_that_overlap_make_a_pair_and_the_movement_confirms_it(tmp_path: Path) -> None:
    left = finish(tmp_path, "l", "left", MORNING)
    right = finish(tmp_path, "r", "right", MORNING.replace(second=30), from_s=30)

    (row,) = describe_pairs(tmp_path, [left, right])

    assert (row["certainty"], row["offset_s"], row["drift_ppm"]) == ("confirmed", 30.0, 0.0)
    assert row["movement_offset_s"] == pytest.approx(30.0, abs=0.05)
    assert row["both_above_60_percent"] == 100.0


def test_clocks_that_the_movement_contradicts_are_doubtful_and_not_corrected(tmp_path: Path) -> None:
    left = finish(tmp_path, "l", "left", MORNING)
    right = finish(tmp_path, "r", "right", MORNING, from_s=30)

    (row,) = describe_pairs(tmp_path, [left, right])

    assert (row["certainty"], row["offset_s"]) == ("doubtful", 0.0)
    assert row["movement_offset_s"] == pytest.approx(30.0, abs=0.05)


def test_without_clocks_a_certain_movement_makes_the_pair(tmp_path: Path) -> None:
    left = finish(tmp_path, "l", "left", None)
    right = finish(tmp_path, "r", "right", None, from_s=30)

    (row,) = describe_pairs(tmp_path, [left, right])

    assert row["certainty"] == "signals"
    assert row["offset_s"] == pytest.approx(30.0, abs=0.05)
    assert isinstance(row["offset_margin_s"], float)
    assert row["offset_margin_s"] <= 0.05


def test_two_shifts_are_paired_by_their_clocks(tmp_path: Path) -> None:
    done = [
        finish(tmp_path, "l1", "left", MORNING),
        finish(tmp_path, "l2", "left", EVENING, body=2),
        finish(tmp_path, "r2", "right", EVENING, body=2),
        finish(tmp_path, "r1", "right", MORNING),
    ]

    assert [(row["left"], row["right"]) for row in describe_pairs(tmp_path, done)] == [
        ("l1", "r1"),
        ("l2", "r2"),
    ]


def test_the_movement_of_others_makes_no_pair_and_the_reason_is_named(tmp_path: Path) -> None:
    left = finish(tmp_path, "l", "left", None)
    right = finish(tmp_path, "r", "right", None, body=9)

    (row,) = describe_pairs(tmp_path, [left, right])

    assert (row["error_code"], row["why"]) == ("E-PAIR", "little shared movement")
    assert "both_above_60_percent" not in row


def test_a_trunk_without_a_clock_joins_the_pair_by_its_movement(tmp_path: Path) -> None:
    done = [
        finish(tmp_path, "l", "left", None),
        finish(tmp_path, "r", "right", None, from_s=30),
        finish(tmp_path, "t", "trunk", None, from_s=12),
    ]

    (row,) = describe_pairs(tmp_path, done)

    assert (row["right"], row["trunk"], row["left_minus_trunk_p50_deg"]) == ("r", "t", 0.0)


def test_a_trunk_matched_by_its_movement_is_not_paired_by_a_clock_of_another_day(tmp_path: Path) -> None:
    done = [
        finish(tmp_path, "l", "left", MORNING),
        finish(tmp_path, "r", "right", MORNING.replace(second=30), from_s=30),
        finish(tmp_path, "t", "trunk", EVENING.replace(year=2020), from_s=12),
    ]

    (row,) = describe_pairs(tmp_path, done)

    assert (row["both_above_60_percent"], row["left_minus_trunk_p50_deg"]) == (100.0, 0.0)
    assert (row["certainty"], row["trunk_certainty"]) == ("confirmed", "signals")


def test_a_trunk_without_time_shared_with_both_arms_does_not_lose_the_pair(tmp_path: Path) -> None:
    done = [
        finish(tmp_path, "l", "left", MORNING),
        finish(tmp_path, "r", "right", MORNING.replace(minute=9), body=2),  # from the 540th to the 1,240th s
        finish(tmp_path, "t", "trunk", MORNING.replace(hour=6, minute=50), body=3),  # to the 100th s
    ]

    (row,) = describe_pairs(tmp_path, done)

    assert (row["trunk"], row["both_above_60_percent"], row["trunk_certainty"]) == ("t", 100.0, None)


def test_two_recordings_of_one_arm_at_the_same_time_are_named_and_not_paired(tmp_path: Path) -> None:
    done = [
        finish(tmp_path, "l1", "left", MORNING),
        finish(tmp_path, "l2", "left", MORNING.replace(minute=1), body=2),
        finish(tmp_path, "r", "right", MORNING),
    ]

    rows = describe_pairs(tmp_path, done)

    refused = ("E-PAIR", "several at once: l1, l2")
    assert [(row["left"], row["error_code"], row["why"]) for row in rows] == [
        ("l1", *refused),
        ("l2", *refused),
    ]


def test_a_left_arm_recorded_in_two_parts_makes_two_pairs(tmp_path: Path) -> None:
    done = [
        finish(tmp_path, "l1", "left", MORNING),
        finish(tmp_path, "l2", "left", MORNING.replace(minute=11, second=40), body=2),  # after the 700 s
        finish(tmp_path, "r", "right", MORNING.replace(minute=5), body=3),
    ]

    rows = describe_pairs(tmp_path, done)

    assert [(row["left"], row["shared_s"]) for row in rows] == [("l1", 400.0), ("l2", 300.0)]


# ------------------------------------------------------------------ what the run prints


def test_the_run_names_contradicted_clocks_and_rivals(capsys: pytest.CaptureFixture[str]) -> None:
    rows: list[Row] = [
        {"subject": "P1", "left": "l", "right": "r", "trunk": "t", "certainty": "doubtful"},
        {"subject": "P2", "left": "m", "right": "s", "trunk": "u", "trunk_certainty": "doubtful"},
        {"subject": "P3", "left": "n", "right": "w", "why": "several at once: n, o"},
        {"subject": "P4", "left": "q", "right": "x", "certainty": "confirmed"},
    ]

    note_pairs(rows, "en")

    doubtful, rivals = capsys.readouterr().err.splitlines()
    assert "contradicts the devices’ clocks in these pairs" in doubtful
    assert "P1 (l, r); P2 (m, u)." in doubtful
    assert "P3 (n, o)." in rivals


# ------------------------------------------------------------------ how often they are computed


def test_the_movement_of_a_pair_is_matched_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    matched = []
    real = pair.match_movement

    def match(left: Path, other: Path, place: Any = "right") -> ClockMatch:
        matched.append((left.name, other.name))
        return real(left, other, place)

    monkeypatch.setattr(pair, "match_movement", match)
    finish(tmp_path, "l", "left", None)
    finish(tmp_path, "r", "right", None, from_s=30)
    finish(tmp_path, "t", "trunk", None, from_s=12)
    sides = {"left": "l", "right": "r", "trunk": "t"}
    plan = {
        "key": {"subject": "S012"}
        | {
            side: [{"name": name, "folder": str(tmp_path / name), "start": None, "recorded_s": 700.0}]
            for side, name in sides.items()
        }
    }
    (tmp_path / "plan.json").write_text(json.dumps(plan), "utf-8")

    write_pairs(tmp_path / "plan.json", ReportRequest(""), tmp_path, lambda *_: None)

    (row,) = json.loads((tmp_path / "key.json").read_bytes())
    assert (row["certainty"], row["trunk_certainty"]) == ("signals", "signals")
    assert sorted(matched) == [("l", "r"), ("l", "t")]


def test_an_unchanged_pair_is_not_computed_again_and_a_changed_one_is(tmp_path: Path) -> None:
    done = [finish(tmp_path, "l", "left", MORNING), finish(tmp_path, "r", "right", MORNING)]
    (first,) = describe_pairs(tmp_path, done)
    kept = json.loads((tmp_path / PAIRS).read_bytes())
    (key,) = kept
    kept[key][0]["shared_s"] = 1.0
    (tmp_path / PAIRS).write_text(json.dumps(kept), "utf-8")

    (again,) = describe_pairs(tmp_path, done)
    results = tmp_path / "l" / "results.json"
    results.write_bytes(results.read_bytes() + b"\n")
    (changed,) = describe_pairs(tmp_path, done)

    assert (again["shared_s"], changed["shared_s"]) == (1.0, first["shared_s"])


def test_an_analysis_that_cannot_be_read_ends_its_pair_and_not_the_run(tmp_path: Path) -> None:
    left, right = finish(tmp_path, "l", "left", MORNING), finish(tmp_path, "r", "right", MORNING)
    (tmp_path / "r" / "elevation.parquet").write_bytes(b"cut")

    (row,) = describe_pairs(tmp_path, [left, right])

    assert (row["subject"], row["error_code"]) == ("S012", "E-UNREADABLE")


def test_pairs_whose_process_was_killed_are_computed_in_the_next_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = [finish(tmp_path, "l", "left", MORNING), finish(tmp_path, "r", "right", MORNING)]
    with monkeypatch.context() as killing:
        killing.setattr(pairs, "load_and_call", kill_itself)
        (killed,) = describe_pairs(tmp_path, done)

    (row,) = describe_pairs(tmp_path, done)

    assert killed == {"subject": "S012", "error_code": "E-CRASHED"}
    assert row["certainty"] == "confirmed"
