"""A watched folder: what has stopped growing is taken in once, with its subject, and moved aside."""

import logging
import os
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from acromion.app import intake
from acromion.app.intake import FolderWatch, Intake
from acromion.app.library.jobs import JobStore
from acromion.app.library.rows import Job
from acromion.app.request import ReportRequest
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage


@pytest.fixture
def watch(store: JobStore, storage: Storage, settings: Settings, tmp_path: Path) -> FolderWatch:
    folder = tmp_path / "watched"
    folder.mkdir()
    return FolderWatch(Intake(store, storage, settings), folder)


def put(watch: FolderWatch, name: str, content: bytes = b"recording") -> Path:
    path = watch.folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    return path


def test_a_file_is_taken_once_it_no_longer_grows(watch: FolderWatch) -> None:
    path = put(watch, "shift.gt3x")
    assert watch.scan() == []
    path.write_bytes(b"recording, longer")
    assert watch.scan() == []

    (job,) = watch.scan()

    assert job.file_name == "shift.gt3x"
    assert job.size_bytes == len(b"recording, longer")
    assert watch.scan() == []


def test_the_same_file_sent_five_times_at_once_is_analysed_once(
    store: JobStore, storage: Storage, settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "shift.gt3x").write_bytes(b"recording")
    look = JobStore.find_same

    def look_slowly(*asked: object) -> object:
        found = look(*asked)  # type: ignore[arg-type]
        time.sleep(0.05)  # without turns, all would have looked before the first adds
        return found

    monkeypatch.setattr(JobStore, "find_same", look_slowly)
    taken = Intake(store, storage, settings)
    with ThreadPoolExecutor(5) as pool:
        jobs = list(
            pool.map(
                lambda _: taken.add(tmp_path / "shift.gt3x", ReportRequest("shift.gt3x"), "api"), range(5)
            )
        )

    assert len({job.id for job in jobs}) == 1
    assert len(storage.find_recordings()) == 1


def take(watch: FolderWatch) -> list[Job]:
    """Scan twice, as a file is taken that has not grown since the scan before."""
    assert watch.scan() == []
    return watch.scan()


def test_a_file_is_taken_with_its_folder_as_subject_and_what_the_server_says_and_moved_aside(
    store: JobStore, storage: Storage, settings: Settings, tmp_path: Path
) -> None:
    letter = settings.model_copy(update={"paper": "letter", "appendix": True, "watch_pose_held": "start"})
    watch = FolderWatch(Intake(store, storage, letter), tmp_path)
    path = put(watch, "S012/shift.gt3x")

    (job,) = take(watch)

    request = job.request
    assert (request.subject, request.paper, request.appendix) == ("S012", "letter", True)
    assert request.pose_held == "start"
    assert not path.exists()
    (moved,) = (watch.folder / "taken").rglob(f"{job.id}_shift.gt3x")
    assert moved.read_bytes() == b"recording"


def test_the_same_bytes_are_analysed_once(watch: FolderWatch) -> None:
    put(watch, "shift.gt3x")
    (first,) = take(watch)
    put(watch, "shift.gt3x")

    assert [job.id for job in take(watch)] == [first.id]


def test_other_files_are_left_where_they_are(watch: FolderWatch) -> None:
    notes = put(watch, "notes.docx")
    hidden = put(watch, ".shift.gt3x.part")
    watch.scan()

    assert watch.scan() == []
    assert notes.exists()
    assert hidden.exists()


def test_a_photo_stays_where_it_is(watch: FolderWatch) -> None:
    photo = put(watch, "shift.csv", b"\xff\xd8\xff\xe0 a photo")
    watch.scan()

    assert watch.scan() == []
    assert photo.exists()


def test_a_file_that_is_too_large_stays_and_stops_nobody(watch: FolderWatch) -> None:
    large = put(watch, "large.csv", bytes(1_000_001))
    put(watch, "shift.csv")
    watch.scan()

    (job,) = watch.scan()

    assert job.file_name == "shift.csv"
    assert large.exists()


def test_no_line_of_the_log_names_the_subject_or_the_file(
    watch: FolderWatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    put(watch, "S012/Marie.gt3x")
    put(watch, "too long a code for a subject".ljust(200, "x") + "/Marie.gt3x")
    put(watch, "S013/Marie.gt3x", b"x" * 1_000_001)
    watch.scan()

    (job,) = watch.scan()

    assert f"imported a file from the watched folder as {job.id}" in caplog.text
    assert "could not be imported: E-BIG" in caplog.text
    assert "could not be imported: its name cannot be used" in caplog.text
    assert not any(word in caplog.text for word in ("S012", "S013", "Marie", "too long"))


def test_links_are_logged_once(watch: FolderWatch, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (watch.folder / "shift.csv").symlink_to(tmp_path / "secret.csv")

    for _ in range(3):
        watch.scan()

    assert [record.getMessage() for record in caplog.records] == [
        "1 links in the watched folder are left alone: links are not followed"
    ]


def test_nothing_is_moved_through_a_link(watch: FolderWatch, tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()
    (watch.folder / "taken").symlink_to(tmp_path / "outside")
    put(watch, "shift.csv")
    watch.scan()
    watch.scan()

    assert list((tmp_path / "outside").iterdir()) == []


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """A file outside the watched folder."""
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "shift.csv").write_bytes(b"not for the world")
    return tmp_path / "outside" / "shift.csv"


def test_links_and_pipes_are_left_alone(watch: FolderWatch, secret: Path) -> None:
    (watch.folder / "shift.csv").symlink_to(secret)
    (watch.folder / "S012").symlink_to(secret.parent)
    os.mkfifo(watch.folder / "pipe.csv")

    assert take(watch) == []
    assert (watch.folder / "shift.csv").is_symlink()
    assert secret.exists()


@pytest.mark.parametrize("name", ["shift.csv", "S012/shift.csv"], ids=["file", "folder"])
def test_what_becomes_a_link_between_two_looks_is_not_followed(
    watch: FolderWatch, secret: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    path = put(watch, name)
    watch.scan()
    held = intake._enter_folder

    def swap(folder: Path, *, is_watched: bool) -> AbstractContextManager[int | None]:
        path.unlink()
        if path.parent == watch.folder:
            path.symlink_to(secret)
        else:
            path.parent.rmdir()
            path.parent.symlink_to(secret.parent)
        return held(folder, is_watched=is_watched)

    monkeypatch.setattr(intake, "_enter_folder", swap)

    assert watch.scan() == []
    assert secret.exists()
