"""A diary beside the recording: what it does to the report, and what a slip in it brings."""

import csv
from datetime import date, time
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from app.cli import app
from app.request import ReportRequest
from fusion.diary import DiaryEntry
from tests.workbooks import write

DIARY = "start_s,end_s,kind,label\n0,60,task,Boxes\n60,90,break,Coffee\n"


def expose(folder: Path, diary: str) -> Result:
    """Two minutes at 70 deg, ten samples a second."""
    lines = "".join(f"{i / 10:.1f},70\n" for i in range(1200))
    (folder / "angles.csv").write_text("time_s,elevation_deg\n" + lines)
    (folder / "diary.csv").write_text(diary)
    arguments = ["exposure", folder / "angles.csv", "-o", folder / "out", "--diary", folder / "diary.csv"]
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_each_row_of_the_diary_is_a_row_of_the_tables(tmp_path: Path) -> None:
    assert expose(tmp_path, DIARY).exit_code == 0

    with (tmp_path / "out" / "periods.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["kind"] == "period"]
    told = [(row["period_kind"], row["label"], row["analysed_s"], row["excluded_as"]) for row in rows]
    assert told == [
        ("task", "Boxes", "60.0", ""),
        ("break", "Coffee", "0.0", "break"),
        ("work", "", "30.0", ""),
    ]


def test_a_slip_in_the_diary_is_told_before_anything_is_read(tmp_path: Path) -> None:
    result = expose(tmp_path, "start_s,end_s,kind\n0,60,brake\n")

    assert result.exit_code == 2
    assert "E-DIARY" in result.output
    assert "Write one of: shift, work, pose, task" in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("end", [None, 60.5, "07:59:00"], ids=["until the next", "seconds", "clock"])
def test_a_diary_survives_the_way_through_the_queue(end: float | str | None) -> None:
    request = ReportRequest("a.csv", diary=(DiaryEntry(0.0, end, "task", "Boxes", line=2),))

    assert ReportRequest.from_json(request.to_json()) == request


def test_a_row_may_name_its_recording_by_file_stem_or_subject_and_is_for_no_other() -> None:
    names = ("shift 3.gt3x", "shift 3", "S012", "S013", "b.csv")
    rows = tuple(DiaryEntry(0.0, None, "task", file=name) for name in names)

    assert ReportRequest("shift 3.gt3x", "S012", diary=rows).select_diary() == rows[:3]


def test_the_dry_run_names_every_wrong_row_of_a_workbook_and_the_names_without_a_recording(
    tmp_path: Path,
) -> None:
    (tmp_path / "S01.csv").write_text("acc_x\n")
    head = ("subject", "date", "start", "end", "kind")
    right = ("S01", date(2026, 3, 2), time(8), time(16), "work")
    wrong = ("S01", date(2026, 3, 2), time(12), time(11), "break"), ("S02", "soon", time(8), time(16), "wrok")

    def plan(*rows: tuple[object, ...]) -> Result:
        (tmp_path / "week.xlsx").write_bytes(write(head, *rows))
        options = ["-o", tmp_path / "out", "--diary", tmp_path / "week.xlsx", "--dry-run"]
        return CliRunner().invoke(app, [str(one) for one in ("run", tmp_path / "S01.csv", *options)])

    refused, planned = plan(right, *wrong), plan(right, ("S02", *right[1:]))

    assert refused.exit_code == 2
    assert "Line 3" in refused.output
    assert "Line 4" in refused.output
    assert planned.exit_code == 0
    assert "no recording for S02" in planned.output
