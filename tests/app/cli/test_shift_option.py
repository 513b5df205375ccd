"""``acromion run --shift``: one folder, calibration and report for each shift of a recording."""

import json
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import pytest

from acromion.app.analysis.inspect import propose_shifts
from acromion.fusion.recording import Recording, Segment
from tests.app.cli.typed import read_table, run
from tests.simulated_week import Week, write_week

HOURS = ("--shift", "07:00-07:20", "--pose-held", "start", "--report", "html")


@pytest.fixture(scope="module")
def week(tmp_path_factory: pytest.TempPathFactory) -> Week:
    """Return three days; on the last no pose was held."""
    return write_week(tmp_path_factory.mktemp("week"), days=3)


@pytest.fixture(scope="module")
def out(week: Week, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out")
    ended = run("run", week.path, "-o", out, *HOURS)
    assert ended.exit_code == 0, ended.output
    return out


def results_of(out: Path, date: str) -> dict[str, Any]:
    results: dict[str, Any] = json.loads((out / f"week_{date}" / "results.json").read_bytes())
    return results


def test_each_shift_has_its_folder_named_by_its_date(out: Path) -> None:
    folders = sorted(path.name for path in out.glob("week*"))

    assert folders == ["week_2026-03-02", "week_2026-03-03", "week_2026-03-04"]
    assert [row["path"] for row in read_table(out / "summary.csv")] == [
        f"week.gt3x 2026-03-0{day}" for day in (2, 3, 4)
    ]


def test_each_shift_has_its_own_pose_and_the_day_without_one_is_not_good(out: Path) -> None:
    every = [results_of(out, f"2026-03-0{day}") for day in (2, 3, 4)]

    states = [results["calibration"]["state"] for results in every]
    assert states[:2] == ["held_at_start", "held_at_start"]
    assert states[2] in {"assumed", "none"}
    assert every[2]["quality"]["verdict"] != "good"
    assert len({results["report"]["id"] for results in every}) == 3


def test_the_report_states_which_hours_were_cut(out: Path) -> None:
    assert results_of(out, "2026-03-03")["recording"]["shift"].startswith("2026-03-03T07:00:00")
    page = (out / "week_2026-03-03" / "report.html").read_text("utf-8")
    assert "Cut from a longer recording" in page


def test_the_shifts_are_days_of_one_person(out: Path, tmp_path: Path) -> None:
    ended = run("profile", out, "-o", tmp_path, "--report", "html")

    assert ended.exit_code == 0, ended.output


def test_finished_shifts_are_not_repeated(week: Week, out: Path) -> None:
    ended = run("run", week.path, "-o", out, *HOURS, "--dry-run")

    assert ended.output.count("done already") == 3


def test_the_pose_of_the_first_shift_applies_to_the_later_ones_only_if_the_sensor_stayed(
    week: Week, out: Path, tmp_path: Path
) -> None:
    ended = run("run", week.path, "-o", tmp_path, *HOURS, "--not-removed")

    assert ended.exit_code == 0, ended.output
    first, second, last = (results_of(tmp_path, f"2026-03-0{day}")["calibration"] for day in (2, 3, 4))
    assert (first["state"], last["state"]) == ("held_at_start", "carried")
    assert second == results_of(out, "2026-03-03")["calibration"]  # its own pose takes precedence
    assert last["sigma_deg"] == first["sigma_deg"]
    assert results_of(out, "2026-03-04")["calibration"]["state"] != "carried"


def test_a_carried_pose_is_never_called_good(week: Week, tmp_path: Path) -> None:
    """Nobody looked at the time between the shifts."""
    run("run", week.path, "-o", tmp_path, *HOURS, "--not-removed")

    quality = results_of(tmp_path, "2026-03-04")["quality"]
    assert quality["verdict"] != "good"
    assert "W-CARRIED" in {flag["code"] for flag in quality["warnings"]}


LATE = ("--shift", "07:05-07:20", *HOURS[2:])


def test_a_pose_at_the_start_of_wear_is_not_sought_in_a_shift_that_begins_later(
    week: Week, tmp_path: Path
) -> None:
    run("run", week.path, "-o", tmp_path, *LATE)

    results = results_of(tmp_path, "2026-03-02")
    assert results["calibration"]["state"] in {"assumed", "none"}
    assert results["quality"]["verdict"] != "good"
    assert "W-NOT-HELD" in {flag["code"] for flag in results["quality"]["warnings"]}


def test_a_pose_that_the_diary_states_shortly_before_a_shift_calibrates_it(
    week: Week, tmp_path: Path
) -> None:
    """The figures are those of a cut at the pose, with the time until the shift as outside of it."""
    pose, outside = "2026-03-02 07:00:00,07:00:10,pose\n", "2026-03-02 07:00:00,07:05:00,outside\n"
    walk = "2026-03-02 07:00:30,07:04:00,outside\n"
    every = []
    for name, hours, rows in (
        ("late", LATE, pose),
        ("whole", HOURS, pose + outside),
        ("walk", LATE, pose + walk),
    ):
        diary = tmp_path / f"{name}.csv"
        diary.write_text("start,end,kind\n" + rows)
        run("run", week.path, "-o", tmp_path / name, *hours, "--diary", diary)
        every.append(results_of(tmp_path / name, "2026-03-02"))

    late, whole, with_walk = every
    assert with_walk["exposure"]["time_above"] == whole["exposure"]["time_above"]
    assert late["calibration"]["state"] == "given"
    assert late["time"]["analysed_s"] == pytest.approx(15 * 60, abs=1.0)
    assert late["exposure"] == whole["exposure"]


def test_a_calibration_window_in_no_shift_is_refused_and_not_ignored(week: Week, tmp_path: Path) -> None:
    """Seconds count from the start of the file; the first shift ends after 1320 s."""
    ended = run("run", week.path, "-o", tmp_path, *HOURS[:2], "--calibration", "1400,1410")

    assert "E-CALIBRATION" in ended.output
    assert "it is in no shift" in ended.output


def test_rows_without_a_date_are_refused_with_their_lines_if_there_are_several_shifts(
    week: Week, tmp_path: Path
) -> None:
    diary = tmp_path / "diary.csv"
    diary.write_text("start,end,kind\n2026-03-02 07:02,07:03,task\n07:00,07:00:10,pose\n07:05,07:06,break\n")

    ended = run("run", week.path, "-o", tmp_path / "out", *HOURS, "--diary", diary)

    assert "E-DIARY" in ended.output
    assert "Line 3: the recording lasts more than a day and has this time twice" in ended.output
    assert "Line 4" in ended.output
    assert not list((tmp_path / "out").glob("*/results.json"))


def test_a_stated_slip_ends_the_carrying_of_a_pose(week: Week, tmp_path: Path) -> None:
    ended = run("run", week.path, "-o", tmp_path, *HOURS, "--not-removed", "--slip-at", "900")

    assert ended.exit_code == 0, ended.output
    last = results_of(tmp_path, "2026-03-04")
    assert last["calibration"]["state"] in {"assumed", "none"}
    assert last["quality"]["verdict"] != "good"


def test_a_pose_that_nobody_stated_applies_to_no_other_shift(week: Week, tmp_path: Path) -> None:
    ended = run("run", week.path, "-o", tmp_path, *HOURS[:2], *HOURS[4:], "--not-removed")

    assert ended.exit_code == 0, ended.output
    every = [results_of(tmp_path, f"2026-03-0{day}") for day in (2, 3, 4)]
    assert {results["calibration"]["state"] for results in every} <= {"assumed", "none"}
    assert "good" not in {results["quality"]["verdict"] for results in every}


@pytest.mark.parametrize(
    ("stated", "hours"),
    [(("--clock-offset", "-1:02:00"), "05:58-06:18"), (("--time-zone", "Europe/Paris"), "13:00-13:20")],
    ids=["offset", "zone"],
)
def test_a_shift_is_cut_by_the_clock_that_a_person_states(
    week: Week, out: Path, tmp_path: Path, stated: tuple[str, str], hours: str
) -> None:
    ended = run("run", week.path, "-o", tmp_path, "--shift", hours, *HOURS[2:], *stated)

    assert ended.exit_code == 0, ended.output
    for date in ("2026-03-02", "2026-03-03"):
        cut, given = results_of(tmp_path, date), results_of(out, date)
        assert cut["exposure"]["time_above"] == given["exposure"]["time_above"]
        assert cut["exposure"]["percentiles_deg"] == pytest.approx(given["exposure"]["percentiles_deg"])
        assert cut["recording"]["start"][11:16] == hours[:5]


def test_the_hours_after_a_change_of_the_zone_are_those_of_the_stated_zone(tmp_path: Path) -> None:
    """The device ran on winter time: its 07:00 on 29 March is 08:00 in Paris."""
    week = write_week(tmp_path, days=2, first=datetime(2026, 3, 28, 7))  # noqa: DTZ001
    path = leave_out_zone(week.path, tmp_path / "naive.gt3x")

    hours = ("--shift", "07:00-08:20", *HOURS[2:], "--time-zone", "Europe/Paris")
    ended = run("run", path, "-o", tmp_path / "out", *hours)

    assert ended.exit_code == 0, ended.output
    before, after = (
        json.loads((tmp_path / f"out/naive_2026-03-{day}/results.json").read_bytes())["recording"]["start"]
        for day in (28, 29)
    )
    assert before == "2026-03-28T07:00:00+01:00"
    assert after == "2026-03-29T07:58:00+02:00"


def leave_out_zone(path: Path, out: Path) -> Path:
    with ZipFile(path) as source, ZipFile(out, "w") as archive:
        text = source.read("info.txt").decode("utf-8-sig")
        lines = [line for line in text.splitlines() if not line.startswith("TimeZone")]
        archive.writestr("info.txt", "\n".join(lines))
        archive.writestr("log.bin", source.read("log.bin"))
    return out


@pytest.fixture(scope="module")
def night(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short shifts from 02:00 of the device; in the second night the clocks of Paris change."""
    folder = tmp_path_factory.mktemp("night")
    week = write_week(folder, days=2, minutes=2, first=datetime(2026, 3, 28, 2))  # noqa: DTZ001
    return leave_out_zone(week.path, folder / "naive.gt3x")


def run_beside_another(
    night: Path, week: Week, out: Path, *options: str | Path
) -> tuple[Any, dict[str, str]]:
    """Return what a run of a recording and another one prints, and the code of each in the tables."""
    ended = run("run", night, week.days[0], "-o", out, *HOURS[4:], "--time-zone", "Europe/Paris", *options)
    return ended, {Path(row["path"]).name: row["code"] for row in read_table(out / "problems.csv")}


def test_a_diary_at_a_time_that_the_clocks_skip_is_a_problem_of_its_recording_only(
    night: Path, week: Week, tmp_path: Path
) -> None:
    diary = tmp_path / "diary.csv"
    rows = ("naive,2026-03-29 02:30,2026-03-29 08:00,shift", "day1,2026-03-02 13:00,2026-03-02 13:20,shift")
    diary.write_text("\n".join(("file,start,end,kind", *rows)))

    ended, codes = run_beside_another(night, week, tmp_path, "--shift", "diary", "--diary", diary)

    assert codes == {"naive.gt3x": "E-DIARY"}
    assert "Line 2: the clocks of the time zone change that day and never show this time" in ended.output
    assert len(list(tmp_path.glob("*/day1_2026-03-02/results.json"))) == 1


def test_only_the_shift_at_a_time_that_the_clocks_skip_is_refused(
    night: Path, week: Week, tmp_path: Path
) -> None:
    ended, codes = run_beside_another(night, week, tmp_path, "--shift", "01:30-02:30")

    assert codes == {"naive.gt3x 2026-03-29": "E-SHIFT", "day1.gt3x": "E-SHIFT"}
    assert "never show this time (2026-03-29 02:30:00)" in ended.output
    again = run("run", "--again", tmp_path)
    assert "never show this time (2026-03-29 02:30:00)" in again.output


def test_the_days_of_a_diary_cut_a_recording(week: Week, tmp_path: Path) -> None:
    diary = tmp_path / "diary.csv"
    diary.write_text("start,end,kind\n2026-03-03 07:00,2026-03-03 07:15,shift\n")

    ended = run("run", week.path, "-o", tmp_path / "out", "--shift", "diary", "--diary", diary, "--dry-run")

    assert "week_2026-03-03" in ended.output
    assert ended.output.count("would do") == 1


@pytest.mark.parametrize(
    ("shift", "said"),
    [("22:00-23:00", "no samples"), ("diary", "no row of the diary")],
    ids=["hours", "diary"],
)
def test_a_recording_without_such_a_shift_is_refused_with_the_reason(
    week: Week, tmp_path: Path, shift: str, said: str
) -> None:
    ended = run("run", week.days[0], "-o", tmp_path, "--shift", shift)

    assert ended.exit_code != 0
    assert said in " ".join(ended.output.split())


def test_hours_that_are_none_are_refused_before_anything_is_read(tmp_path: Path) -> None:
    ended = run("run", tmp_path / "absent.gt3x", "-o", tmp_path, "--shift", "morning")

    assert ended.exit_code == 2


def test_a_recording_of_more_than_a_day_has_a_proposed_shift_for_each_stretch_of_wear() -> None:
    chance = np.random.default_rng(1)
    start = datetime.fromisoformat("2026-03-02T07:00:00")
    segments = tuple(
        Segment(
            first_h * 3_600_000_000,
            10.0,
            chance.normal(0.0, 0.5, (72_000, 3)).astype(np.float32),
            chance.normal(0.0, 50.0, (72_000, 3)).astype(np.float32),
        )
        for first_h in (0, 24)
    )
    recording = Recording("other", "", start, None, 26 * 3_600_000_000, segments)

    assert propose_shifts(recording) == [
        "2026-03-02T07:00:00/2026-03-02T09:00:00",
        "2026-03-03T07:00:00/2026-03-03T09:00:00",
    ]
    assert propose_shifts(replace(recording, start=None)) == []


@pytest.mark.parametrize(
    ("options", "rows", "said"),
    [
        ((), "2026-03-01 07:01,2026-03-01 07:02,task", "E-DIARY"),
        ((), "07:01,07:02,task\n2026-03-01 07:01,2026-03-01 07:02,task", "entirely outside the recording"),
        ((), "2026-03-01 07:01,2026-03-01 07:02,pose", "E-DIARY"),
        ((), "2026-03-01T07:01:00,2026-03-01T07:02:00,posture,seated", "E-POSTURE"),
        (("--calibration", "5000,5010"), "", "E-CALIBRATION"),
        (("--slip-at", "5000"), "", "E-PARAMETER"),
        (
            ("--shift", "diary"),
            "",
            "no row of the diary for a shift, work or a task has a date in the recording",
        ),
        (("--shift", "22:00-23:00"), "", "it has no samples in these hours"),
        (("--time-zone", "Europe/Paris"), "2026-03-29 02:30,2026-03-29 03:30,task", "never show this time"),
    ],
)
def test_a_dry_run_names_what_the_run_will_refuse_or_ignore_in_the_same_words(
    week: Week, tmp_path: Path, options: tuple[str, ...], rows: str, said: str
) -> None:
    if rows:
        (tmp_path / "diary.csv").write_text(f"start,end,kind,label\n{rows}\n")
        options += ("--diary", str(tmp_path / "diary.csv"))
    arguments: list[str | Path] = ["run", week.days[0], "-o", tmp_path / "out", *HOURS[4:], *options]

    dry = run(*arguments, "--dry-run")

    assert said in " ".join(dry.stderr.split())
    assert not (tmp_path / "out").exists()
    real = run(*arguments)
    assert dry.exit_code == real.exit_code
    planned, told = (
        {line.partition(" … ")[0] for line in ended.stderr.splitlines() if line.startswith("  ")}
        for ended in (dry, real)
    )
    assert planned <= told  # without the end of a .gt3x, which is known to the second before it is read
