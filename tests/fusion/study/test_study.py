"""The results folder of a run as tables and figures."""

import shutil
import subprocess
import sys
from datetime import datetime, timedelta
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.patches import Rectangle

from acromion.app.report.export.tables import encode_datapackage, encode_rows
from acromion.app.report.figures import Column
from acromion.fusion import Study, compare_people, describe_group, list_days
from acromion.fusion.simulation import simulate_shift, write_shift
from tests.app.cli.typed import read_table, run

PEOPLE = """file,subject,side,diary,age,sensor
shift_seed1.csv,007,right,diary.csv,34,A
shift_seed2.csv,007,left,,34,B
shift_seed3.csv,NA1,right,,,A
broken.csv,S4,right,,61,A
"""
DIARY = """start,end,kind,label
07:00,07:02,task,Lifting
07:02,07:02:30,break,Coffee
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of three recordings of two people, and of a damaged one."""
    data = tmp_path_factory.mktemp("people")
    for seed in (1, 2, 3):
        write_shift(data, simulate_shift("lsm9ds1", 0.05, seed=seed))
    (data / "broken.csv").write_bytes((data / "shift_seed1.csv").read_bytes()[:40])
    (data / "people.csv").write_text(PEOPLE)
    (data / "diary.csv").write_text(DIARY)
    recordings = [*sorted(data.glob("*_seed?.csv")), data / "broken.csv"]
    options = ("--participants", data / "people.csv", "--report", "html", "-o", data / "out", "-j", "1")
    assert run("run", *recordings, *options).exit_code == 1
    return data / "out"


@pytest.fixture(scope="module")
def study(folder: Path) -> Study:
    mpl.use("Agg")
    return Study.read(folder)


def make_days(people: dict[str, list[float]], side: str = "right") -> pd.DataFrame:
    """Return a row for each day of each person."""
    rows = [
        {"subject": person, "side": side, "day": f"2026-03-{day:02d}", "time_above_60_percent": value}
        for person, values in people.items()
        for day, value in enumerate(values, 1)
    ]
    return pd.DataFrame(rows)


def test_a_study_prints_its_recordings_failures_and_people(study: Study) -> None:
    assert repr(study) == "Study(out: 4 recordings, 1 failed, 3 people)"


def test_a_study_of_one_person_says_so(folder: Path, tmp_path: Path) -> None:
    out = shutil.copytree(folder, tmp_path / "out")
    rows = (out / "summary.csv").read_text().splitlines(keepends=True)
    (out / "summary.csv").write_text("".join(rows[:2]))

    assert repr(Study.read(out)) == "Study(out: 1 recording, 0 failed, 1 person)"


def test_postures_pairs_and_marks_are_tables_of_a_study(study: Study) -> None:
    assert study.pairs["left"].tolist() == ["shift_seed2.csv"]
    assert {"kind", "time_above_60_percent"} <= set(study.postures.columns)
    assert {"mark_s", "time_above_60_percent"} <= set(study.marks.columns)


def test_codes_stay_text_figures_are_numbers_and_an_empty_cell_is_missing(study: Study) -> None:
    rows = study.summary.set_index("file_name")

    assert rows["subject"].to_dict() == {
        "shift_seed1.csv": "007",
        "shift_seed2.csv": "007",
        "shift_seed3.csv": "NA1",
        "broken.csv": "S4",
    }
    assert rows["time_above_60_percent"].dtype == np.float64
    assert rows["time_above_60_percent"].isna().tolist() == [name == "broken.csv" for name in rows.index]


def test_a_figure_of_the_summary_is_that_of_the_results_of_the_recording(study: Study) -> None:
    exposure = study.read_results("shift_seed3.csv")["exposure"]
    (above,) = (row["percent"] for row in exposure["time_above"] if row["threshold_deg"] == 60)

    row = study.summary.set_index("path").loc["shift_seed3.csv"]
    assert row["time_above_60_percent"] == pytest.approx(above, abs=1e-6)
    figures = {name: np.nan if value is None else value for name, value in exposure["figures"].items()}
    assert row[list(figures)].to_dict() == pytest.approx(figures, abs=1e-6, nan_ok=True)


def test_a_failed_recording_is_in_the_problems_and_not_in_the_days(study: Study) -> None:
    assert study.problems["file_name"].tolist() == ["broken.csv"]
    assert sorted(study.days["path"]) == ["shift_seed1.csv", "shift_seed2.csv", "shift_seed3.csv"]
    assert set(study.days["day"]) == {"2026-03-02"}
    assert set(study.days["left_out"]) == {"short"}


def test_the_least_hours_of_a_counted_day_are_an_option_of_the_run_and_kept_by_its_repetition(
    folder: Path, tmp_path: Path
) -> None:
    out = shutil.copytree(folder, tmp_path / "out")
    recordings = sorted(folder.parent.glob("*_seed?.csv"))
    options = ("--participants", folder.parent / "people.csv", "--report", "html", "-o", out)

    result = run("run", *recordings, *options, "--min-hours", "0")
    counted = Study.read(out).days["left_out"].isna().tolist()
    run("run", "--again", out)

    assert "already done before: 3" in result.stderr  # no figure changes
    assert counted == Study.read(out).days["left_out"].isna().tolist() == [True, True, True]
    assert "min_hours: 0.0\n" in (out / "settings.yaml").read_text()


def test_days_of_which_none_counts_are_not_drawn(study: Study) -> None:
    with pytest.raises(ValueError, match="no day counts"):
        study.plot_people()


def test_hours_periods_and_tasks_are_separate_tables(study: Study) -> None:
    assert len(study.hours) == 3
    assert "Coffee" in set(study.periods["label"])
    assert "Lifting" in set(study.tasks["label"])
    assert not {"Lifting", "Coffee"} & set(study.hours["label"])


def test_the_angle_of_a_recording_has_the_time_that_the_summary_states(study: Study) -> None:
    angle = study.read_elevation("shift_seed1.csv")

    recorded_s = study.summary.set_index("path").loc["shift_seed1.csv", "recorded_s"]
    assert sum(len(run) / run.rate_hz for run in angle.segments) == pytest.approx(recorded_s, abs=0.1)


def test_a_recording_that_failed_or_is_not_in_the_last_run_is_refused_by_name(study: Study) -> None:
    for name in ("broken.csv", "lost.csv"):
        with pytest.raises(LookupError, match=f"'{name}' is not one analysed recording"):
            study.read_results(name)


def test_a_pair_has_the_further_columns_that_are_equal_for_both_recordings(study: Study) -> None:
    (row,) = study.pairs.to_dict("records")

    assert (row["left"], row["right"], row["age"]) == ("shift_seed2.csv", "shift_seed1.csv", 34.0)
    assert pd.isna(row["sensor"])  # A and B


@pytest.mark.parametrize(
    "text", ["-x", "=1+1", "'=1+1", "a;-b", "a, =b", " '+", "-1.5", "it's", "''=", "|@|@"]
)
def test_text_and_headers_are_as_they_were_given_and_not_as_a_spreadsheet_needs_them(
    tmp_path: Path, text: str
) -> None:
    given = (Column("{header}", {"header": text}, "text"),)
    (tmp_path / "summary.csv").write_bytes(
        encode_rows("summary", [{"path": text, text: text}], further=given)
    )
    (tmp_path / "datapackage.json").write_bytes(encode_datapackage(["summary.csv"], given))

    (row,) = Study(tmp_path, {}).summary.to_dict("records")

    assert (row["path"], row[text]) == (text, text)


def test_a_folder_without_a_finished_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"run\.json"):
        Study.read(tmp_path)


def test_the_days_of_a_person_are_the_values_of_that_person() -> None:
    rows = make_days({"A": [4.0, 6.0], "B": [10.0, np.nan]})

    assert list_days(rows, "time_above_60_percent") == {"A": (4.0, 6.0), "B": (10.0,)}


def test_a_day_that_the_run_left_out_is_not_counted() -> None:
    rows = (
        make_days({"A": [4.0, 6.0], "B": [10.0, 12.0]})
        .assign(left_out=["", "short", "", ""])
        .replace("", pd.NA)
    )

    assert list_days(rows, "time_above_60_percent") == {"A": (4.0,), "B": (10.0, 12.0)}


def test_both_arms_of_a_day_are_refused_because_a_day_counts_once() -> None:
    rows = pd.concat([make_days({"A": [4.0]}), make_days({"A": [6.0]}, "left")])

    with pytest.raises(ValueError, match="A has two rows on 2026-03-01; select one arm"):
        list_days(rows, "time_above_60_percent")


def test_a_row_without_a_person_is_refused() -> None:
    rows = make_days({"A": [4.0]}).assign(subject=None)

    with pytest.raises(ValueError, match="no subject code"):
        list_days(rows, "time_above_60_percent")


def test_a_change_counts_each_person_once_however_many_days_they_have() -> None:
    before = list_days(make_days({"A": [10.0, 10.0, 10.0, 10.0], "B": [20.0]}), "time_above_60_percent")
    after = list_days(make_days({"A": [8.0], "B": [14.0]}), "time_above_60_percent")

    found = compare_people(before, after)

    assert found is not None
    assert (found.people, found.change) == (2, -4.0)  # -2 and -6, not by the five days
    assert describe_group(before).mean == 15.0


def test_the_day_of_a_study_is_drawn_on_the_clock_with_the_break_hatched(study: Study) -> None:
    (axes,) = study.plot_day("shift_seed1.csv").axes

    (hatched,) = axes.patches
    assert isinstance(hatched, Rectangle)
    left = datetime(1970, 1, 1) + timedelta(days=hatched.get_x())  # noqa: DTZ001  matplotlib counts days
    assert hatched.get_hatch() == "///"
    assert left.strftime("%H:%M:%S") == "07:02:00"
    assert hatched.get_width() * 86_400 == pytest.approx(30.0, abs=0.1)


def test_people_are_drawn_as_a_line_each_with_a_dot_for_each_day() -> None:
    days = make_days({"A": [4.0, 6.0], "B": [10.0, 12.0], "C": [1.0, 3.0]})

    (axes,) = Study(Path(), {}).plot_people(days=days).axes

    dots, means = axes.lines[:2]
    assert [label.get_text() for label in axes.get_yticklabels()] == ["C", "A", "B"]  # by their means
    assert np.sort(np.asarray(dots.get_xdata())).tolist() == [1.0, 3.0, 4.0, 6.0, 10.0, 12.0]
    assert np.sort(np.asarray(means.get_xdata())).tolist() == [2.0, 5.0, 11.0]


def test_without_matplotlib_the_error_names_what_to_install(study: Study) -> None:
    program = (
        "import sys; sys.modules['matplotlib'] = None; import fusion\n"
        f"try: fusion.Study.read({str(study.folder)!r}).plot_day('shift_seed1.csv')\n"
        "except ModuleNotFoundError as error: print(error)"
    )

    told = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)

    assert told.stdout == "matplotlib is not installed: it comes with the extra acromion[plots]\n"


def test_the_table_of_a_run_and_of_pandas_have_the_same_columns(study: Study) -> None:
    assert list(study.summary.columns) == list(read_table(study.folder / "summary.csv")[0])
