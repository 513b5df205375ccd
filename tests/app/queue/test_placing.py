"""Which folder is whose: told by the marker in it, not by the order in which recordings are found."""

import hashlib
import json
from pathlib import Path

import pytest

from app.batch.folder import MARKER, identify_place, place_folders


@pytest.fixture
def logs(tmp_path: Path) -> tuple[Path, Path]:
    """Two recordings of one name and different bytes."""
    for place in ("p1", "p2"):
        (tmp_path / place).mkdir()
        (tmp_path / place / "arm.gt3x").write_text(place)
    return tmp_path / "p1" / "arm.gt3x", tmp_path / "p2" / "arm.gt3x"


def finish(folder: Path, log: Path, **others: str) -> None:
    """Leave the marker of a finished recording."""
    folder.mkdir(parents=True)
    digest = hashlib.sha256(log.read_bytes()).hexdigest()
    (folder / MARKER).write_text(json.dumps({"place": identify_place(log), "input": digest} | others))


def names(logs: tuple[Path, ...], out: Path) -> list[str]:
    return [folder.name for folder in place_folders(logs, out)]


def test_recordings_of_one_stem_are_numbered(logs: tuple[Path, Path], tmp_path: Path) -> None:
    assert names(logs, tmp_path / "out") == ["arm", "arm-2"]


def test_a_folder_stays_with_its_recording(logs: tuple[Path, Path], tmp_path: Path) -> None:
    finish(tmp_path / "out" / "arm", logs[1])

    assert names(logs, tmp_path / "out") == ["arm-2", "arm"]


def test_a_recording_of_another_run_keeps_its_folder(logs: tuple[Path, Path], tmp_path: Path) -> None:
    finish(tmp_path / "out" / "arm", logs[1])

    assert names(logs[:1], tmp_path / "out") == ["arm-2"]


def test_a_recording_that_changed_in_its_place_keeps_its_folder(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    finish(tmp_path / "out" / "arm", logs[0])
    logs[0].write_text("read from the device again")

    assert names(logs[:1], tmp_path / "out") == ["arm"]


def test_a_recording_that_was_moved_keeps_its_folder(logs: tuple[Path, Path], tmp_path: Path) -> None:
    finish(tmp_path / "out" / "arm", logs[1], place="where it lay before")

    assert names(logs, tmp_path / "out") == ["arm-2", "arm"]


def test_no_recording_is_named_as_a_table(tmp_path: Path) -> None:
    assert names((tmp_path / "Summary.csv.gt3x",), tmp_path / "out") == ["Summary.csv-2"]


def test_a_recording_keeps_its_folder_where_one_before_it_has_none(
    logs: tuple[Path, Path], tmp_path: Path
) -> None:
    finish(tmp_path / "out" / "arm-2", logs[1])

    assert names(logs, tmp_path / "out") == ["arm", "arm-2"]


def test_no_recording_is_named_as_a_folder_of_ours(tmp_path: Path) -> None:
    logs = (tmp_path / "shards.gt3x", tmp_path / "profiles.gt3x")

    assert names(logs, tmp_path / "out") == ["shards_", "profiles_"]
