"""A stated zone and a stated correction on the command line: in the tables, the results and the report."""

import json
from pathlib import Path

import pytest
from typer.testing import Result

from acromion.fusion.simulation import simulate_shift, write_shift
from tests.app.cli.typed import read_table, run

PREAMBLE = "# start: "


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Six minutes of work as a table whose preamble states the start."""
    folder = tmp_path_factory.mktemp("table")
    return write_shift(folder, simulate_shift("lsm9ds1", 0.1, seed=1))[0].read_text()


def put(folder: Path, table: str, name: str, start: str) -> Path:
    lines = [f"{PREAMBLE}{start}" if line.startswith(PREAMBLE) else line for line in table.splitlines()]
    path = folder / name
    path.write_text("\n".join(lines) + "\n")
    return path


def analyse(path: Path, out: Path, *options: str) -> Result:
    return run("run", path, "-o", out, "--report", "html", *options)


def test_the_report_follows_the_zone_over_a_change_and_notes_the_correction(
    tmp_path: Path, table: str
) -> None:
    """The device is 62 minutes fast. Its 02:59 is 01:57 CET; three minutes later the clocks show 03:00."""
    path = put(tmp_path, table, "arm.csv", "2026-03-29T02:59:00")
    out = tmp_path / "out"

    result = analyse(path, out, "--time-zone", "europe/paris", "--clock-offset", "-1h02m")

    assert result.exit_code == 0, result.output
    results = json.loads((out / "arm" / "results.json").read_bytes())
    recording = results["recording"]
    assert recording["start"] == "2026-03-29T01:57:00+01:00"
    assert (recording["time_zone"], recording["clock_offset_s"]) == ("Europe/Paris", -3720.0)
    assert [hour["label"] for hour in results["exposure"]["by_hour"]] == [
        "2026-03-29T01:00",
        "2026-03-29T03:00",
    ]
    flags = {flag["code"]: flag for flag in results["quality"]["warnings"]}
    assert flags["W-CLOCK-SET"]["facts"] == {"offset": "-1:02:00"}
    assert flags["W-DST"]["first"] == "2026-03-29T03:00:00+02:00"
    page = (out / "arm" / "report.html").read_text("utf-8")
    assert "Clock corrected" in page
    assert "-1:02:00" in page


def test_the_settings_of_a_run_repeat_its_clock(tmp_path: Path, table: str) -> None:
    path = put(tmp_path, table, "arm.csv", "2026-07-01T09:00:00")
    assert (
        analyse(path, tmp_path / "one", "--time-zone", "Europe/Paris", "--clock-offset", "-3720").exit_code
        == 0
    )

    again = analyse(path, tmp_path / "two", "--config", str(tmp_path / "one" / "settings.yaml"))

    assert again.exit_code == 0
    starts = [read_table(tmp_path / name / "summary.csv")[0]["start"] for name in ("one", "two")]
    assert starts == ["2026-07-01T07:58:00", "2026-07-01T07:58:00"]


def test_starts_with_and_without_an_offset_have_one_form_in_a_table(tmp_path: Path, table: str) -> None:
    put(tmp_path, table, "a.csv", "2026-07-01T08:00:00")
    put(tmp_path, table, "b.csv", "2026-07-01T08:00:00-04:00")

    assert analyse(tmp_path, tmp_path / "out").exit_code == 0

    rows = read_table(tmp_path / "out" / "summary.csv")
    assert [(row["start"], row["utc_offset"]) for row in rows] == [
        ("2026-07-01T08:00:00", ""),
        ("2026-07-01T08:00:00", "UTC-04:00"),
    ]


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--time-zone", "Paris"), "Europe/Paris"),
        (("--time-zone", "EST"), "UTC-05:00"),
        (("--clock-offset", "an hour"), "-1h02m"),
    ],
)
def test_a_clock_that_cannot_be_stated_is_a_usage_error_with_its_cure(
    tmp_path: Path, options: tuple[str, str], told: str
) -> None:
    (tmp_path / "arm.csv").touch()

    result = analyse(tmp_path / "arm.csv", tmp_path / "out", *options)

    assert result.exit_code == 2
    assert told in result.output
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("start", "options", "told"),
    [
        ("2026-10-25T02:30:00", ("--time-zone", "Europe/Paris"), "show this time twice"),
        ("2026-03-29T02:30:00", ("--time-zone", "Europe/Paris"), "never show this time"),
        ("2026-07-01T08:00:00", ("--clock-offset", "-20000d"), "an impossible year"),
    ],
)
def test_a_clock_that_cannot_be_right_is_told_with_its_code(
    tmp_path: Path, table: str, start: str, options: tuple[str, str], told: str
) -> None:
    path = put(tmp_path, table, "arm.csv", start)

    result = analyse(path, tmp_path / "out", *options)

    assert result.exit_code == 3
    assert "E-CLOCK" in result.output
    assert told in result.output


def test_an_inspection_shows_the_stated_clock(tmp_path: Path, table: str) -> None:
    path = put(tmp_path, table, "arm.csv", "2026-03-29T02:59:00")
    clock = ("--time-zone", "Europe/Paris", "--clock-offset", "-1h02m")

    result = run("inspect", path, *clock)

    assert "2026-03-29T01:57:00+01:00" in result.output


def test_a_correction_of_a_thousand_hours_must_be_written_in_days(tmp_path: Path, table: str) -> None:
    path = put(tmp_path, table, "arm.csv", "2026-03-29T02:59:00")

    refused, read = (run("inspect", path, "--clock-offset", text) for text in ("1000:00:00", "41d16h"))

    assert (refused.exit_code, "4d4h" in refused.output) == (2, True)
    assert "2026-05-09T18:59:00" in read.output


def test_an_ambiguous_row_of_a_diary_is_told_with_its_line_and_its_cure(tmp_path: Path, table: str) -> None:
    path = put(tmp_path, table, "arm.csv", "2026-10-25T01:58:00")
    (tmp_path / "diary.csv").write_text("start,end,kind,label\n01:59,02:01,task,Boxes\n")

    result = analyse(
        path, tmp_path / "out", "--time-zone", "Europe/Paris", "--diary", str(tmp_path / "diary.csv")
    )

    assert "E-DIARY" in result.output
    assert "Line 2: the clocks of the time zone change that day and show this time twice" in result.output
    assert "2026-10-25 02:30+02:00 before the change" in result.output
