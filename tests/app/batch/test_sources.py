"""Where the recordings of a run are named."""

from pathlib import Path

import pytest

from app.batch.folder import find_recordings, read_list
from app.batch.run import NEED_BYTES, Capacity, choose_workers
from app.errors import UnusableList


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("b.gt3x", "a.csv", "notes.docx", "deep/c.csv.gz", "out/summary.csv", "diary.csv"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    return tmp_path


def test_a_folder_gives_the_recordings_in_and_below_it_but_not_the_results(folder: Path) -> None:
    found = find_recordings([folder], folder / "out", [folder / "diary.csv"])

    assert [path.name for path in found.logs] == ["a.csv", "b.gt3x", "c.csv.gz"]
    assert found.others == 1


@pytest.mark.parametrize(
    ("named", "logs"),
    [
        (["notes.docx"], ["notes.docx"]),
        (["b.gt3x", "b.gt3x"], ["b.gt3x"]),
        (["*.gt3x"], ["b.gt3x"]),
        (["*.cwa"], ["*.cwa"]),  # fits nothing and is reported
        (["run[1].csv"], ["run[1].csv"]),  # a file whose name looks like a pattern
    ],
)
def test_what_is_named_is_taken_once_whatever_its_name_and_a_pattern_is_expanded(
    folder: Path, named: list[str], logs: list[str]
) -> None:
    (folder / "run[1].csv").touch()

    found = find_recordings([folder / name for name in named], folder / "out")

    assert found.logs == tuple(folder / name for name in logs)


@pytest.mark.parametrize(
    ("named", "places"),
    [
        ([""], ["a.csv", "b.gt3x", "deep/c.csv.gz", "diary.csv"]),
        (["b.gt3x", "deep"], ["b.gt3x", "deep/c.csv.gz"]),
    ],
)
def test_a_recording_is_told_from_the_folder_that_holds_all_that_was_named(
    folder: Path, named: list[str], places: list[str]
) -> None:
    found = find_recordings([folder / name for name in named], folder / "out")

    assert sorted(found.format_place(log) for log in found.logs) == places


def test_what_is_known_of_a_simulated_recording_is_no_recording(tmp_path: Path) -> None:
    for name in ("shift.gt3x", "truth.parquet", "truth.json"):
        (tmp_path / name).write_bytes(b"x")

    assert find_recordings([tmp_path], tmp_path / "out").logs == (tmp_path / "shift.gt3x",)


def test_a_link_is_told_by_where_it_was_named(folder: Path) -> None:
    (folder / "deep" / "link.gt3x").symlink_to(folder / "b.gt3x")

    found = find_recordings([folder / "deep"], folder / "out")

    assert "link.gt3x" in [found.format_place(log) for log in found.logs]


def test_the_paths_of_a_list_start_from_its_folder(folder: Path) -> None:
    assert read_list('# two\n\nb.gt3x\n"deep/c.csv.gz"\n', folder) == [
        folder / "b.gt3x",
        folder / "deep/c.csv.gz",
    ]


def test_a_line_that_names_nothing_is_refused_with_its_number(folder: Path) -> None:
    with pytest.raises(UnusableList) as caught:
        read_list("b.gt3x\nlost.gt3x\n", folder)

    assert (caught.value.facts["line"], caught.value.facts["value"]) == (2, "lost.gt3x")


@pytest.mark.parametrize(
    ("recordings", "cores", "analyses_in_memory", "expected"),
    [(300, 8, 100, 7), (3, 8, 100, 3), (300, 8, 2, 2), (300, 1, 100, 1), (300, 8, 0, 1)],
)
def test_workers_are_as_many_as_recordings_spare_cores_and_memory_allow(
    recordings: int, cores: int, analyses_in_memory: int, expected: int
) -> None:
    assert choose_workers(recordings, Capacity(cores, analyses_in_memory * NEED_BYTES)) == expected
