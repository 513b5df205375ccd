"""Room that grows: what was filled stays, in memory and in a file, and nothing is left behind on the disk."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.readers import samples
from acromion.fusion.readers.samples import Room

SMALL_BYTES = 4096


@pytest.fixture(autouse=True)
def small_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(samples, "LEAST_FILE_BYTES", SMALL_BYTES)
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setattr("tempfile.tempdir", None)


def fill(rows: int) -> Room[np.int64]:
    made = Room(np.int64, rows)
    made.values[:] = np.arange(rows)
    return made


def refuse_room(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", refuse)


@pytest.mark.parametrize("is_known", [True, False], ids=["disk full", "no such files"])
def test_without_room_on_the_disk_they_stay_in_memory(
    monkeypatch: pytest.MonkeyPatch, is_known: bool
) -> None:
    if is_known:
        refuse_room(monkeypatch)
    else:
        monkeypatch.delattr(os, "posix_fallocate")
    made = fill(700)
    made.resize(SMALL_BYTES)

    assert made.values.base is None
    assert made.values[:700].tolist() == list(range(700))


@settings(max_examples=50)
@given(st.lists(st.integers(1, 5000), min_size=1, max_size=8))
def test_the_rows_that_were_there_all_along_keep_their_values(sizes: list[int]) -> None:
    made, least = fill(700), 700
    for rows in sizes:
        made.resize(rows)
        least = min(least, rows)

        assert len(made.values) == rows
        assert made.values[:least].tolist() == list(range(least))


def test_rows_of_three_keep_their_places_when_they_move_to_a_file() -> None:
    made = Room(np.float32, 2, 3)
    made.values[:] = [[1, 2, 3], [4, 5, 6]]

    made.resize(SMALL_BYTES)

    assert made.values.shape == (SMALL_BYTES, 3)
    assert made.values[:2].tolist() == [[1, 2, 3], [4, 5, 6]]


def test_the_file_has_no_name(tmp_path: Path) -> None:
    made = fill(10)
    made.resize(SMALL_BYTES)

    assert isinstance(made.values.base, np.ndarray)  # it is not the array's own memory
    assert list(tmp_path.iterdir()) == []


def test_they_go_back_to_memory_when_the_disk_fills_up(monkeypatch: pytest.MonkeyPatch) -> None:
    made = fill(700)
    made.resize(SMALL_BYTES)
    refuse_room(monkeypatch)
    made.resize(2 * SMALL_BYTES)

    assert made.values.base is None
    assert made.values[:700].tolist() == list(range(700))


def test_a_disk_with_little_room_is_not_filled(monkeypatch: pytest.MonkeyPatch) -> None:
    free = os.statvfs_result((1, 1, 100, 100, 63_999, 10, 10, 10, 0, 255))  # 63,999 bytes free
    monkeypatch.setattr(os, "fstatvfs", lambda _: free)
    made = fill(700)

    made.resize(4000)  # 32,000 bytes: more than half

    assert made.values.base is None


def test_what_takes_their_place_grows_in_its_turn() -> None:
    made = fill(10)
    made.resize(SMALL_BYTES)
    made.replace(made.values[[3, 1, 2]])
    made.resize(2 * SMALL_BYTES)

    assert made.values[:3].tolist() == [3, 1, 2]
