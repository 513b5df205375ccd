"""A diary beside the recording: what it does to the report, and what a slip in it brings."""

import csv
from datetime import date, time
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from acromion.app.cli import app
from acromion.app.request import ReportRequest
from acromion.fusion.diary import DiaryEntry, read_diary
from tests.fusion.readers.test_thigh import RATE_HZ, simulate_thigh, write_table
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
        rows = list(csv.DictReader(file))
    told = [(row["kind"], row["label"], row["analysed_s"], row["excluded_as"]) for row in rows]
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


POSTURE = "datetime,activity\n2026-03-02 08:00:00,sit\n2026-03-02 08:00:01,sit\n"


def plan(folder: Path, *options: str) -> Result:
    (folder / "S01.csv").write_text("acc_x\n")
    (folder / "S01 thigh.csv").write_text(POSTURE)
    arguments = ["run", folder / "S01.csv", "-o", folder / "out", *options, "--dry-run"]
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_file_of_postures_is_given_beside_the_diary(tmp_path: Path) -> None:
    planned = plan(tmp_path, "--posture", str(tmp_path / "S01 thigh.csv"))

    assert "diary: 1" in planned.output
    assert "E-DIARY" not in planned.output


def test_printed_postures_are_a_diary_that_can_be_read(tmp_path: Path) -> None:
    (tmp_path / "thigh.csv").write_text(POSTURE)

    printed = CliRunner().invoke(app, ["posture", str(tmp_path / "thigh.csv")])

    assert printed.exit_code == 0
    (row,) = read_diary(printed.output.encode())
    assert (row.start, row.end, row.kind, row.label) == (
        "2026-03-02T08:00:00", "2026-03-02T08:00:02", "posture", "seated",
    )  # fmt: skip


def test_a_recording_of_the_arm_without_a_gyroscope_is_refused_although_one_of_the_thigh_is_not(
    tmp_path: Path,
) -> None:
    (tmp_path / "thigh.csv").write_bytes(write_table(simulate_thigh()))

    printed = CliRunner().invoke(app, ["posture", str(tmp_path / "thigh.csv")])
    refused = CliRunner().invoke(app, ["run", str(tmp_path / "thigh.csv"), "-o", str(tmp_path / "out")])

    assert [line.split(",")[-1] for line in printed.output.splitlines()[1:]] == ["seated", "upright"]
    assert refused.exit_code != 0
    assert "E-NO-GYRO" in refused.output


def test_a_diary_is_no_file_of_postures(tmp_path: Path) -> None:
    (tmp_path / "diary.csv").write_text(DIARY)

    refused = plan(tmp_path, "--posture", str(tmp_path / "diary.csv"))

    assert refused.exit_code == 2
    assert "E-POSTURE" in refused.output
    assert "diary cannot" not in refused.output


def test_every_wrong_line_of_a_file_of_postures_is_named_as_one_of_that_file(tmp_path: Path) -> None:
    rows = ("2026-03-02 08:00:00,dance", "soon,sit", "2026-03-02 08:00:02,sit", "2026-03-02 08:00:01,sit")
    (tmp_path / "thigh.csv").write_text("\n".join(("datetime,activity", *rows)))

    refused = plan(tmp_path, "--posture", str(tmp_path / "thigh.csv"))

    assert "E-POSTURE The file of postures cannot be used" in refused.output
    assert [f"Line {line}" in refused.output for line in (2, 3, 4, 5)] == [True, True, False, True]
    assert "diary" not in refused.output


def test_a_recording_of_the_thigh_without_a_clock_has_no_line(tmp_path: Path) -> None:
    rows = write_table(simulate_thigh()).decode().splitlines()[1:]
    lines = (f"{k / RATE_HZ},{row.partition(',')[2]}" for k, row in enumerate(rows))
    (tmp_path / "thigh.csv").write_text("\n".join(("time_s,acc_x,acc_y,acc_z", *lines)))

    refused = CliRunner().invoke(app, ["posture", str(tmp_path / "thigh.csv")])

    assert "E-POSTURE" in refused.output
    assert "Line 0" not in refused.output


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
    assert "E-DIARY" not in planned.output
    assert "no recording for S02" in planned.output
