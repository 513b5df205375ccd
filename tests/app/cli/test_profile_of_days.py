"""``acromion profile``: from finished folders to one report of several days."""

import json
import shutil
from pathlib import Path

import pytest
from pypdf import PdfReader
from typer.testing import Result

from tests.app.analysis.days_factory import change_recording, finish_day, make_day
from tests.app.cli.typed import read_table, run
from tests.app.report.report_reading import plain

Profiled = tuple[Result, Path]


def finish(folder: Path, day: int, above_60_percent: float, *, subject: str = "S012") -> Path:
    """The folder of a finished day; its angle is 20 deg for an hour from 08:00 on."""
    folder.mkdir(parents=True)
    kept = make_day(day, above_60_percent, subject=subject).kept
    finish_day(folder, kept.findings, kept.subject)
    return folder


@pytest.fixture(scope="module")
def week(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five finished days in one folder."""
    folder = tmp_path_factory.mktemp("week")
    for day, percent in enumerate((4.0, 6.0, 6.0, 6.0, 8.0)):
        finish(folder / f"day{day}", day, percent)
    return folder


@pytest.fixture(scope="module")
def profiled(week: Path, tmp_path_factory: pytest.TempPathFactory) -> Profiled:
    """What was said of the week in French, and the folder of its report."""
    out = tmp_path_factory.mktemp("profiled")
    return run("profile", week, "-o", out, "--lang", "fr", "--paper", "letter"), out / "days"


def test_a_folder_of_days_becomes_one_report_whose_answer_is_printed(profiled: Profiled) -> None:
    result, folder = profiled

    assert result.exit_code == 0, result.output
    made = {path.name for path in folder.iterdir()}
    assert made >= {"profile.json", "profile.csv", "overlay.csv", "report.html", "report.pdf", "answer.txt"}
    assert "Bras droit, 5 jours" in plain(result.output)


def test_its_figures_are_those_of_the_days_and_are_attached_to_the_pdf(profiled: Profiled) -> None:
    figures = (profiled[1] / "profile.json").read_bytes()
    (arm,) = json.loads(figures)["arms"]
    rows, pdf = read_table(profiled[1] / "overlay.csv"), PdfReader(profiled[1] / "report.pdf")

    assert arm["figures"]["time_above_60_percent"]["mean"] == 6.0
    assert [(row["clock"], row["days"]) for row in rows] == [(f"08:{m:02d}", "5") for m in (0, 15, 30, 45)]
    assert float(rows[0]["p50_deg"]) == pytest.approx(20.05)
    assert [round(side) for side in pdf.pages[0].mediabox[2:]] == [612, 792]
    assert pdf.attachments["profile.json"] == [figures]


def test_results_may_be_named_one_by_one_and_more_days_make_a_new_version(week: Path, tmp_path: Path) -> None:
    named = [week / f"day{day}" / "results.json" for day in (0, 1)]
    asked = ("-o", tmp_path, "--report", "html")

    first = run("profile", *named, *asked)
    days = [len(read_table(tmp_path / "days" / "profile.csv"))]
    again = run("profile", week, week / "day0", *asked)  # one of them twice
    days.append(len(read_table(tmp_path / "days" / "profile.csv")))

    assert first.exit_code == 0, first.output
    assert days == [2, 5]
    assert "(version 2)" in again.output


@pytest.mark.parametrize(
    ("names", "told"),
    [
        (("day0",), "E-DAYS"),
        (("empty",), "E-DAYS"),
        (("day0", "day1", "old"), "E-DAYS"),
        (("day0", "absent"), "E-FILE"),
        (("day0", "day0"), "they are the same recording"),
    ],
)
def test_what_is_no_profile_is_refused(week: Path, tmp_path: Path, names: tuple[str, ...], told: str) -> None:
    shutil.copytree(week, tmp_path, dirs_exist_ok=True)
    (tmp_path / "empty").mkdir()
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "results.json").write_text("{}")

    result = run("profile", *(tmp_path / name for name in names), "-o", tmp_path / "out")

    assert result.exit_code == 3
    assert told in result.output
    assert "absent" not in names or "absent" in result.output


def test_an_earlier_version_inside_a_folder_is_left_aside(week: Path, tmp_path: Path) -> None:
    shutil.copytree(week, tmp_path / "in")
    shutil.copytree(week / "day0", tmp_path / "in" / "day0" / "v1")

    result = run("profile", tmp_path / "in", "-o", tmp_path / "out", "--report", "html")

    assert len(read_table(tmp_path / "out" / "days" / "profile.csv")) == 5, result.output


def test_days_after_a_change_are_named_by_themselves(week: Path, tmp_path: Path) -> None:
    later = finish(tmp_path / "later", 30, 16.0)

    result = run("profile", week, "--after", later, "-o", tmp_path / "out", "--report", "html")

    (change,) = json.loads((tmp_path / "out" / "days" / "profile.json").read_bytes())["change"]
    above = change["figures"]["time_above_60_percent"]
    assert (above["before"], above["after"], above["verdict"]) == (6.0, 16.0, "larger"), result.output


def test_a_missing_code_is_refused_until_somebody_says_that_it_is_one_person(
    week: Path, tmp_path: Path
) -> None:
    nobody = finish(tmp_path / "nobody", 9, 6.0, subject="")

    asked = run("profile", week, nobody, "-o", tmp_path / "asked", "--report", "html")
    told = run("profile", week, nobody, "-o", tmp_path / "told", "--report", "html", "--same-subject")

    assert (asked.exit_code, "--same-subject" in asked.output, told.exit_code) == (3, True, 0)


def test_a_day_without_a_clock_is_in_the_means_and_not_in_the_overlay(week: Path, tmp_path: Path) -> None:
    kept = change_recording(make_day(9, 6.0), start=None).kept
    (tmp_path / "clockless").mkdir()
    finish_day(tmp_path / "clockless", kept.findings, kept.subject)

    result = run("profile", week, tmp_path / "clockless", "-o", tmp_path / "out", "--report", "html")

    assert result.exit_code == 0, result.output
    (arm,) = json.loads((tmp_path / "out" / "days" / "profile.json").read_bytes())["arms"]
    assert (arm["figures"]["time_above_60_percent"]["days"], arm["overlay"][0]["days"]) == (6, 5)


@pytest.mark.parametrize(("hours", "counted"), [("2", 5), ("9.5", 0)])
def test_the_least_hours_of_a_day_that_counts_are_an_option(
    week: Path, tmp_path: Path, hours: str, counted: int
) -> None:
    run("profile", week, "-o", tmp_path, "--report", "html", "--min-hours", hours)

    described = json.loads((tmp_path / "days" / "profile.json").read_bytes())
    (arm,) = described["arms"]
    assert [day["left_out"] for day in arm["days"]].count(None) == counted
    assert described["rules"]["whole_day_s"] == float(hours) * 3600


def test_a_day_that_is_too_short_is_said_with_the_hours_that_were_asked_for(
    week: Path, tmp_path: Path
) -> None:
    result = run("profile", week, "-o", tmp_path, "--lang", "fr", "--report", "html", "--min-hours", "9.5")

    assert "aucun jour d'au moins 9,5 h" in plain(result.output)


def test_a_short_day_of_good_quality_stays_good(week: Path, tmp_path: Path) -> None:
    run("profile", week, "-o", tmp_path, "--report", "html", "--min-hours", "9.5")

    rows = read_table(tmp_path / "days" / "profile.csv")
    assert {(row["verdict"], row["left_out"]) for row in rows} == {("good", "short")}


def test_the_days_of_a_person_are_sessions_of_the_motion_dataset(week: Path, tmp_path: Path) -> None:
    run("export", week, "-o", tmp_path / "bids")

    person = tmp_path / "bids" / "sub-S012"
    stems = [path.name.partition("_task")[0] for path in sorted(person.rglob("*_motion.tsv"))]
    assert stems == [f"sub-S012_ses-{day:02d}" for day in range(1, 6)]
    assert (person / "ses-05" / "motion").is_dir()
    assert len((person / "sub-S012_sessions.tsv").read_text().splitlines()) == 6
