"""``acromion pair`` and ``acromion compare``: from recordings or finished folders to one report of two."""

import json
from pathlib import Path

import pytest
from pypdf import PdfReader

from acromion.fusion.simulation import write_recordings
from tests.app.cli.typed import run


@pytest.fixture(scope="module")
def paired(shift_gt3x: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings set side by side."""
    out = tmp_path_factory.mktemp("pair")
    made = write_recordings(out / "other", "gt9x", 0.05, 5)
    other = next(path for path in made if path.suffix == ".gt3x")
    asked = ("-o", out, "--report", "html", "--offset-s", "0", "--same-subject", "--pose-held=start")
    result = run("pair", shift_gt3x, other, *asked)
    assert result.exit_code == 0, result.output
    return out


def test_recordings_are_analysed_first_each_as_its_arm_and_as_was_said_of_both(paired: Path) -> None:
    document = json.loads((paired / "both-arms" / "pair.json").read_text("utf-8"))
    read = [json.loads(path.read_text("utf-8")) for path in paired.glob("[lr]*/*/results.json")]

    assert (document["left"]["side"], document["right"]["side"]) == ("left", "right")
    assert [results["calibration"]["state"] for results in read] == ["held_at_start"] * 2


def test_finished_folders_are_compared_without_a_new_analysis(paired: Path) -> None:
    before, after = (next((paired / side).iterdir()) for side in ("left", "right"))

    result = run("compare", before, after, "-o", paired, "--report", "html", "--lang", "fr", "--same-subject")

    assert result.exit_code == 0, result.output
    assert "Le temps au-dessus de 60° est passé de" in result.output.replace("\u202f", " ")
    assert not (paired / "before").exists()


def test_another_pair_in_the_same_place_keeps_the_earlier_one(paired: Path) -> None:
    left, right = (next((paired / side).iterdir()) for side in ("left", "right"))

    asked = ("-o", paired, "--report", "html", "--offset-s", "20", "--same-subject")
    result = run("pair", left, right, *asked)

    assert "(version 2)" in result.output
    earlier = json.loads((paired / "both-arms" / "v1" / "pair.json").read_text("utf-8"))
    assert earlier["clock"]["offset_s"] == 0.0


@pytest.mark.parametrize(("command", "folder"), [("pair", "both-arms"), ("compare", "before-after")])
def test_a_missing_code_is_refused_until_somebody_says_that_it_is_one_person(
    paired: Path, tmp_path: Path, command: str, folder: str
) -> None:
    sides = [next((paired / side).iterdir()) for side in ("left", "right")]
    asked = ("-o", tmp_path, "--report", "pdf", "--paper", "letter")

    refused, said = (run(command, *sides, *asked, *more) for more in ((), ("--same-subject",)))

    assert (refused.exit_code, "use --same-subject" in refused.stderr, said.exit_code) == (3, True, 0)
    page = PdfReader(tmp_path / folder / "report.pdf").pages[0].mediabox
    assert (round(page.width), round(page.height)) == (612, 792)


@pytest.mark.parametrize("command", ["pair", "compare"])
def test_a_missing_code_is_refused_before_any_recording_is_analysed(tmp_path: Path, command: str) -> None:
    for name in ("left.csv", "right.csv"):
        (tmp_path / name).write_text("not looked at")

    result = run(command, tmp_path / "left.csv", tmp_path / "right.csv", "-o", tmp_path / "out")

    assert (result.exit_code, "use --same-subject" in result.stderr) == (3, True)
    assert not (tmp_path / "out").exists()
