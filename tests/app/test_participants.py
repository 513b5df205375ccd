"""The list of participants: whose arm is in which file."""

from pathlib import Path

import pytest

from app.batch.inputs import assign_participants, read_participants
from app.batch.plan import Task
from app.errors import UnusableParticipants
from app.request import ReportRequest
from fusion.errors import UnusableDiary


def read_one(text: str, folder: Path = Path()) -> dict[str, object]:
    (row,) = read_participants(text.encode(), folder)
    return dict(row.stated)


def refusal(text: str) -> UnusableParticipants:
    with pytest.raises(UnusableParticipants) as caught:
        read_participants(text.encode(), Path())
    return caught.value


def make_task(path: str) -> Task:
    return Task(Path(path), ReportRequest(Path(path).name, subject="default"), Path("out"))


def test_a_row_fills_subject_side_pose_and_window() -> None:
    said = read_one("file,subject,side,pose,calibration\na.gt3x,S01,left,side-lean,5-15\n")

    assert said == {
        "subject": "S01",
        "side": "left",
        "pose": "side-lean",
        "calibration_windows_s": ((5.0, 15.0),),
    }


def test_two_windows_are_read_in_their_order() -> None:
    assert read_one("file,calibration\na,5-15 20.5-30\n") == {
        "calibration_windows_s": ((5.0, 15.0), (20.5, 30.0))
    }


def test_an_axis_and_the_moments_of_slips_are_read() -> None:
    assert read_one("file,axis,slip_at,no_slip_at\na,-y,3600 7200.5,60\n") == {
        "arm_axis": "-y",
        "slip_times_s": (3600.0, 7200.5),
        "no_slip_times_s": (60.0,),
    }


@pytest.mark.parametrize(
    ("text", "held"),
    [
        ("file,pose_held\na,start\n", "start"),
        ("fichier;pose tenue\na;début\n", "start"),
        ("file,pose_held\na,no\n", None),
    ],
)
def test_a_row_says_whether_the_pose_was_held_at_the_start(text: str, held: str | None) -> None:
    assert read_one(text) == {"pose_held": held}


def test_an_empty_cell_says_nothing() -> None:
    assert read_one("file,subject,side\na.gt3x,,\n") == {}


def test_french_headers_semicolons_and_a_spreadsheet_encoding_are_read() -> None:
    text = "fichier;sujet;côté\né.gt3x;S01;gauche\n"

    (row,) = read_participants(text.encode("cp1252"), Path())

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
        ("file,colour\na,red\n", 1, "participant columns"),
        ("file,subject\n,S01\n", 2, "no file named"),
        ("file,side\na,up\n", 2, "value"),
        ("file,pose\na,sitting\n", 2, "value"),
        ("file,calibration\na,15-5\n", 2, "value"),
        ("file,calibration\na,early\n", 2, "value"),
        ("file,axis\na,up\n", 2, "value"),
        ("file,slip_at\na,noon\n", 2, "value"),
        ("file,no_slip_at\na,noon\n", 2, "value"),
        ("file,pose_held\na,end\n", 2, "value"),
        ("file,subject\na,S01\nA,S02\n", 3, "file twice"),
    ],
)
def test_a_slip_is_named_with_its_line(text: str, line: int, why: str) -> None:
    facts = refusal(text).facts

    assert (facts["line"], facts["why"]) == (line, why)


def test_a_row_goes_before_the_settings_of_the_run() -> None:
    people = read_participants(b"file,subject\nA.gt3x,S01\n", Path())

    tasks, _ = assign_participants([make_task("in/a.gt3x"), make_task("in/b.gt3x")], people)

    assert [task.request.subject for task in tasks] == ["S01", "default"]


def test_a_path_tells_files_of_one_name_apart() -> None:
    people = read_participants(b"file,subject\np1/arm.csv,S01\np2\\arm.csv,S02\n", Path())

    tasks, _ = assign_participants([make_task("in/p2/arm.csv"), make_task("in/p1/arm.csv")], people)

    assert [task.request.subject for task in tasks] == ["S02", "S01"]


def test_a_row_for_no_recording_is_given_back() -> None:
    people = read_participants(b"file,subject\nlost.gt3x,S01\n", Path())

    _, unmatched = assign_participants([make_task("a.gt3x")], people)

    assert [row.line for row in unmatched] == [2]


def test_accents_may_be_written_in_one_sign_or_in_two() -> None:
    people = read_participants("file,subject\nZoé.gt3x,S01\n".encode(), Path())

    tasks, _ = assign_participants([make_task("in/Zoe\u0301.gt3x")], people)

    assert tasks[0].request.subject == "S01"


def test_a_link_is_known_by_where_it_was_named(tmp_path: Path) -> None:
    (tmp_path / "S01.gt3x").symlink_to(tmp_path / "archive.gt3x")
    people = read_participants(b"file,subject\nS01.gt3x,S01\n", Path())

    tasks, _ = assign_participants([make_task(str(tmp_path / "S01.gt3x"))], people)

    assert tasks[0].request.subject == "S01"


def test_a_diary_that_is_not_there_is_named_with_its_line() -> None:
    facts = refusal("file,diary\na.gt3x,lost.csv\n").facts

    assert (facts["line"], facts["why"], facts["value"]) == (2, "no such file", "lost.csv")


def test_a_slip_in_a_diary_names_the_diary(tmp_path: Path) -> None:
    (tmp_path / "d.csv").write_text("start,end,kind\nten,10:15,break\n")

    with pytest.raises(UnusableDiary) as caught:
        read_participants(b"file,diary\na.gt3x,d.csv\n", tmp_path)

    assert caught.value.facts["diary"] == "d.csv"
