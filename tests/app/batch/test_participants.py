"""The list of participants: whose arm is in which file."""

from dataclasses import replace
from pathlib import Path

import pytest

from acromion.app.batch.folder import Task
from acromion.app.batch.inputs import assign_participants, read_participants
from acromion.app.errors import UnusableParticipants
from acromion.app.report.words.messages import describe_problem
from acromion.app.request import Proposal, ReportRequest, propose_description
from acromion.fusion.conventions import Side
from acromion.fusion.diary import DiaryEntry
from acromion.fusion.errors import UnusableDiary, split_facts
from tests.workbooks import write


def test_postures_are_added_to_the_diary_of_the_row_or_else_of_the_run(tmp_path: Path) -> None:
    (tmp_path / "diary.csv").write_text("start,end,kind\n08:00,09:00,task\n")
    (tmp_path / "thigh.csv").write_text("datetime,activity\n2026-03-02 08:00:00,sit\n")
    work = DiaryEntry("08:00", "16:00", "work")
    tasks = [replace(make_task(name), request=ReportRequest(name, diary=(work,))) for name in ("a", "b")]
    text = b"file,diary,posture\na,diary.csv,thigh.csv\nb,,thigh.csv\n"

    assigned, _ = assign_participants(tasks, text, tmp_path)

    kinds = [[entry.kind for entry in task.request.diary] for task in assigned]
    assert kinds == [["task", "posture"], ["work", "posture"]]


def read_one(text: str, folder: Path = Path()) -> dict[str, object]:
    (row,), refusals = read_participants(text.encode(), folder)
    assert not refusals
    return dict(row.stated)


def refusal(text: str, *paths: str) -> UnusableParticipants:
    with pytest.raises(UnusableParticipants) as caught:
        assign_participants([make_task(path) for path in paths], text.encode(), Path())
    return caught.value


def assign(text: str, *paths: str) -> list[str]:
    """Return the subject of each recording."""
    tasks, _ = assign_participants([make_task(path) for path in paths], text.encode(), Path())
    return [task.request.subject for task in tasks]


def make_task(path: str) -> Task:
    return Task(Path(path), ReportRequest(Path(path).name, subject="default"), Path("out"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (
            "file,subject,side,pose,calibration\na.gt3x,S01,left,side-lean,5-15\n",
            {"subject": "S01", "side": "left", "pose": "side-lean", "calibration_windows_s": ((5.0, 15.0),)},
        ),
        ("file,calibration\na,5-15 20.5-30\n", {"calibration_windows_s": ((5.0, 15.0), (20.5, 30.0))}),
        (
            "file,axis,slip_at,no_slip_at\na,-y,3600 7200.5,60\n",
            {"arm_axis": "-y", "slip_times_s": (3600.0, 7200.5), "no_slip_times_s": (60.0,)},
        ),
        (
            "file,job,isco\na,House painter,7131\n",
            {"job_title": "House painter", "isco_code": "7131"},
        ),
        ("file,pose_held\na,start\n", {"pose_held": "start"}),
        (
            "file,time_zone,clock_offset\na,Europe/Paris,-1h02m\n",
            {"time_zone": "Europe/Paris", "clock_offset_s": -3720.0},
        ),
        ("fichier;pose tenue\na;début\n", {"pose_held": "start"}),
        ("file,subject,side\na.gt3x,,\n", {}),
        *(  # words for a missing value are no codes
            (f"file,subject\na.gt3x,{nobody}\n", {"subject": ""})
            for nobody in ("NA", "N/A", "NaN", "null", "None", "unknown", "Inconnu", "-", "?", "\u200b")
        ),
        *(
            (f"file,subject\na.gt3x,{code}\n", {"subject": code})
            for code in ("na", "N1", "0", "unknown-3", "É")
        ),
    ],
)
def test_a_row_is_read_into_the_settings_of_its_recording(text: str, said: dict[str, object]) -> None:
    assert read_one(text) == said


def test_french_headers_semicolons_and_a_spreadsheet_encoding_are_read() -> None:
    text = "fichier;sujet;côté\né.gt3x;S01;gauche\n"

    (row,), _ = read_participants(text.encode("cp1252"), Path())

    assert (row.file, row.stated) == ("é.gt3x", {"subject": "S01", "side": "left"})


def test_a_diary_is_read_from_the_folder_of_the_list(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("start,end,kind\n10:00,10:15,break\n")

    said = read_one("file,diary\na.gt3x,d.csv\n", tmp_path)

    assert [entry.kind for entry in said["diary"]] == ["break"]  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("text", "line", "why"),
    [
        ("", 1, "participant columns"),
        ("subject,side\nS01,left\n", 1, "participant columns"),
        ("file,,subject\na,red,S01\n", 1, "participant columns"),
        ("file,subject,id\na,S01,7\n", 1, "same column"),
        ("file,subject\n,S01\n", 2, "no file named"),
        ("file,pose\na,sitting\n", 2, "value"),
        ("file,calibration\na,15-5\n", 2, "value"),
        ("file,axis\na,up\n", 2, "value"),
        ("file,slip_at\na,noon\n", 2, "value"),
        ("file,isco\na,71150\n", 2, "value"),
        ("file,subject\na,S01\na,S02\n", 3, "file twice"),
        ("subject,file\nS01\n", 2, "no file named"),
        ("file,calibration\na,5,5-15\n", 2, "more fields"),
        ("file,pose_held\na,end\n", 2, "value"),
    ],
)
def test_a_slip_is_named_with_its_line(text: str, line: int, why: str) -> None:
    facts = refusal(text).facts

    assert (facts["line"], facts["why"]) == (line, why)


@pytest.mark.parametrize(
    ("rows", "paths", "subjects"),
    [
        ("A.gt3x,S01\n", ("in/a.gt3x", "in/b.gt3x"), ["S01", "default"]),
        ("p1/arm.csv,S01\np2\\arm.csv,S02\n", ("in/p2/arm.csv", "in/p1/arm.csv"), ["S02", "S01"]),
        ("a.csv,S01\nA.csv,S02\n", ("in/A.csv", "in/a.csv"), ["S02", "S01"]),
        ("a.csv,S01\n", ("in/a.csv", "in/p1/../a.csv"), ["S01", "S01"]),
        ("Zoé.gt3x,S01\n", ("in/Zoe\u0301.gt3x",), ["S01"]),
    ],
    ids=["before the settings", "path", "case", "named twice", "accents in one sign or two"],
)
def test_a_row_is_for_the_recording_that_it_names(
    rows: str, paths: tuple[str, ...], subjects: list[str]
) -> None:
    assert assign(f"file,subject\n{rows}", *paths) == subjects


def test_a_row_that_fits_two_files_is_refused_with_both_as_they_can_be_written() -> None:
    refused = refusal("file,subject\narm.csv,S01\n", "in/p1/arm.csv", "in/p2/ARM.csv", "in/p2/arm.csv")

    assert refused.facts == {
        "line": 2,
        "why": "several recordings",
        "value": "arm.csv",
        "first": "p1/arm.csv",
        "second": "p2/arm.csv",
        "cure": "path",
    }


def test_every_name_that_a_refusal_shows_fits_one_file_alone() -> None:
    paths = ("in/arm.csv", "in/p2/in/arm.csv", "in/x/p2/in/arm.csv")
    facts = refusal("file,subject\narm.csv,S01\n", *paths).facts
    shown = [str(facts["first"]), str(facts["second"])]

    assert [assign(f"file,subject\n{name},S01\n", *paths).count("S01") for name in shown] == [1, 1]


def test_two_rows_that_fit_one_file_are_refused() -> None:
    refused = refusal("file,subject\narm.csv,S01\np1/arm.csv,S02\n", "in/p1/arm.csv")

    assert refused.facts == {"line": 3, "why": "file twice", "value": "p1/arm.csv", "other": 2}


def test_a_row_that_fits_two_files_takes_neither_from_another_row() -> None:
    refused = refusal("file\narm.csv\np1/arm.csv\n", "p1/arm.csv", "p2/arm.csv")

    assert refused.facts["line"] == 2
    assert "line_2" not in refused.facts


def test_windows_of_the_list_that_do_not_fit_its_pose_are_refused() -> None:
    refused = refusal("file,pose,calibration\na.csv,two-point,5-15\n", "a.csv")

    assert (refused.facts["line"], refused.facts["why"]) == (2, "window count")


def test_all_faults_of_a_list_are_told_at_once() -> None:
    list_ = "file,side\narm.csv,left\nb.csv,up\nc.csv,left\nc.csv,right\n"
    refused = refusal(list_, "p1/arm.csv", "p2/arm.csv", "b.csv", "c.csv")

    english = describe_problem(refused.code, refused.facts, "en")

    assert english.detail == (
        'Line 2: the row matches several recordings ("arm.csv"): p1/arm.csv and p2/arm.csv. '
        "Write enough of the file’s path to match only one recording, as named here. "
        'Line 3: an impossible value ("up"). Allowed: left|right|trunk. '
        'Line 5: two rows match the same recording ("c.csv"); the other row is line 4.'
    )
    assert english.fix == "Correct the list and send it again. Nothing was changed or analysed."


def test_beyond_twenty_faults_the_others_are_counted() -> None:
    refused = refusal("file,side\n" + "a,up\n" * 23)

    assert describe_problem(refused.code, refused.facts, "en").detail.endswith("And 25 more.")


def test_a_row_for_no_recording_is_given_back() -> None:
    _, unmatched = assign_participants([make_task("a.gt3x")], b"file,subject\nlost.gt3x,S01\n", Path())

    assert [row.line for row in unmatched] == [2]


def test_a_link_is_known_by_where_it_was_named(tmp_path: Path) -> None:
    (tmp_path / "S01.gt3x").symlink_to(tmp_path / "archive.gt3x")

    assert assign("file,subject\nS01.gt3x,S01\n", str(tmp_path / "S01.gt3x")) == ["S01"]


def test_a_diary_that_is_not_there_is_named_with_its_line() -> None:
    facts = refusal("file,diary\na.gt3x,lost.csv\n").facts

    assert (facts["line"], facts["why"], facts["value"]) == (2, "no such file", "lost.csv")


def test_a_slip_in_a_diary_names_the_diary(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("start,end,kind\nten,10:15,break\n")

    with pytest.raises(UnusableDiary) as caught:
        assign_participants([], b"file,diary\na.gt3x,d.csv\n", tmp_path)

    assert caught.value.facts["diary"] == "d.csv"


@pytest.mark.parametrize(
    ("path", "subject", "side"),
    [
        ("P01_right.gt3x", "P01", "right"),
        ("P01R.gt3x", "P01", "right"),
        ("P01/right/shift.gt3x", "P01", "right"),
        ("P01/L.csv", "P01", "left"),
        ("S012 gauche.csv", "S012", "left"),
        ("sub-01_hand-left.csv", "sub-01", "left"),
        ("AX6_day2_P3-R.cwa", "P3", "right"),
    ],
)
def test_a_file_name_and_its_folders_suggest_a_subject_and_an_arm(
    path: str, subject: str, side: Side | None
) -> None:
    assert propose_description(path) == Proposal(subject, side)


@pytest.mark.parametrize(
    "path",
    [
        "TAS1E31150028.gt3x",  # the serial number of a sensor
        "ax6_day2.cwa",  # a device and a day
        "xio_seconds_dps_g.csv",  # units
        "left_right.csv",
        "P01/P02.csv",
        "shift.gt3x",
    ],
)
def test_an_unclear_file_name_suggests_nobody_and_no_arm(path: str) -> None:
    assert propose_description(path) == Proposal()


def test_the_wrong_lines_of_all_diaries_are_named_at_once_with_their_diary(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("start,end,kind\nnoon,9:00,work\n8:00,9:00,wrok\n")
    (tmp_path / "b.xlsx").write_bytes(write(("start_s", "end_s", "kind"), (60, 50, "break")))

    with pytest.raises(UnusableDiary) as caught:
        assign_participants([], b"file,diary\na.gt3x,a.csv\nb.gt3x,b.xlsx\n", tmp_path)

    rows = split_facts(caught.value.facts)
    assert [(row["diary"], row["line"], row["why"]) for row in rows] == [
        ("a.csv", 2, "time"),
        ("a.csv", 3, "kind"),
        ("b.xlsx", 2, "end first"),
    ]


def test_an_open_quotation_mark_in_the_list_is_named_with_its_line() -> None:
    refused = refusal('file,subject\na.gt3x,"S01\nb.gt3x,S02\n', "a.gt3x", "b.gt3x")

    assert (refused.facts["line"], refused.facts["why"]) == (2, "open quote")


def test_a_column_with_a_name_of_the_tables_hides_no_wrong_row() -> None:
    refused = refusal("file,side,verdict\na.gt3x,up,good\nb.gt3x,left,good\n", "a.gt3x", "b.gt3x")

    assert [(row["line"], row["why"]) for row in split_facts(refused.facts)] == [
        (1, "taken column"),
        (2, "value"),
    ]


def test_an_unknown_column_is_refused_only_without_a_folder() -> None:
    text = b"file,age\na.gt3x,34\n"

    (row,), _ = read_participants(text, Path())
    with pytest.raises(UnusableParticipants) as refused:
        read_participants(text, None)

    assert row.further == {"age": "34"}
    assert refused.value.facts["why"] == "known columns"
