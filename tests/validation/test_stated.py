"""The goals of the days on which a person states the pose."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.validation.document import Goal
from benchmarks.validation.stated import KINDS, Scored, compare_on_stated, draw_undetected, judge_days

RIGHT = Scored(
    "pose", "skin", "gt9x", 0, state="given", verdict="good", rmse_deg=3.0, cut_s=2.0, is_held=True,
    inside=(True,) * 6, widths=(5.0,) * 6,
)  # fmt: skip
SLIPPED = replace(RIGHT, key="slip45", rmse_deg=20.0, inside=(False,) * 6)


def missed(*days: Scored) -> list[Goal]:
    every_kind = [replace(RIGHT, kind=kind, rmse_deg=1.0) for kind in KINDS]
    return [goal for goal in judge_days([*every_kind, *days]) if not goal.met]


def test_days_that_are_right_and_slips_without_a_sign_meet_every_goal() -> None:
    assert missed(RIGHT, SLIPPED) == []
    assert any("`good`" in goal.what for goal in missed(replace(SLIPPED, codes=("W-SLIP",))))
    assert len(missed(replace(RIGHT, kind="seated", rmse_deg=3.1))) == 1  # a rigid arm is allowed 3 deg


@pytest.mark.parametrize(
    ("day", "what", "reached"),
    [
        (replace(RIGHT, is_held=False), "the held pose is not the assumed one", "1 days"),
        (replace(RIGHT, rmse_deg=6.1), "`good` days that are further off than allowed", "1 days"),
        (replace(RIGHT, key="work20", inside=(False, *(True,) * 5)), "truth outside the ranges", "16.7 %"),
        (replace(RIGHT, cut_s=3600.0, codes=("W-REMOUNT",)), "time left out after a slip", "3600 s"),
        (replace(RIGHT, key="cut1", widths=(9.0, 41.0, 9.0, 9.0, 9.0, 9.0)), "median width", "41.0 points"),
    ],
)
def test_each_fault_misses_its_goal_alone(day: Scored, what: str, reached: str) -> None:
    (goal,) = missed(day)

    assert what in goal.what
    assert goal.what.startswith(KINDS["skin"])
    assert goal.reached == reached


def test_slips_without_a_sign_are_counted() -> None:
    table = draw_undetected(
        [SLIPPED, replace(SLIPPED, device="lsm9ds1", codes=("W-SLIP",), verdict="caution")]
    )

    assert "slip of 45 deg, window given | 2 | 1 | 1 | 20.0 |" in table


def test_motion_that_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "real_motion").mkdir()

    section = compare_on_stated(tmp_path, 1, None)

    assert section.shown == ("Skipped: missing: skin_motion.",)
