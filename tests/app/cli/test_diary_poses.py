"""A row of kind ``pose`` in a diary says when the calibration pose was held."""

import json
from datetime import datetime
from pathlib import Path

import pytest

from acromion.app.analysis.run import make_report
from acromion.app.request import ReportRequest
from acromion.fusion.diary import DiaryEntry, read_diary
from acromion.fusion.errors import UnusableDiary
from acromion.fusion.exposure.periods import find_diary_poses

START = datetime.fromisoformat("2026-03-02T07:00:00-05:00")
HOUR_US = 3_600_000_000


def find(rows: str) -> tuple[tuple[float, float], ...]:
    return find_diary_poses(read_diary(f"start,end,kind\n{rows}".encode()), START, HOUR_US)


def test_a_row_of_the_clock_is_a_window_in_seconds_that_lasts_until_the_next_row() -> None:
    assert find("07:00:05,07:00:15,pose\n07:10,07:20,break\n07:30,07:30:10,étalonnage\n") == (
        (5.0, 15.0),
        (1800.0, 1810.0),
    )
    assert find("07:00:05,,pose\n07:00:20,,task\n") == ((5.0, 20.0),)


def test_a_pose_outside_the_recording_is_refused() -> None:
    with pytest.raises(UnusableDiary) as refusal:
        find("07:00:05,07:00:15,pose\n09:00,09:01,pose\n")

    assert (refusal.value.facts["line"], refusal.value.facts["why"]) == (3, "outside recording")


def test_the_pose_of_a_diary_is_given_and_takes_no_time_out(shift_gt3x: Path, tmp_path: Path) -> None:
    diary = (DiaryEntry(2.0, 12.0, "pose", line=2), DiaryEntry(60.0, 120.0, "task", "Boxes", line=3))

    make_report(shift_gt3x, ReportRequest("a.gt3x", kinds=(), languages=("en",), diary=diary), tmp_path)

    results = json.loads((tmp_path / "results.json").read_text("utf-8"))
    pose = results["calibration"]
    assert (pose["state"], pose["start_s"], pose["duration_s"]) == ("given", 2.0, 10.0)
    assert results["time"]["excluded_s"] == 0.0
    assert {part["kind"] for part in results["exposure"]["by_period"]} == {"task", "work"}
