"""Recordings on the disk: durable when kept, gone when not."""

import errno
import hashlib
from pathlib import Path

import pytest

from app.errors import DiskFull, FileTooLarge, FolderTaken
from app.folder import FolderStorage, FolderUpload
from app.storage import FolderLock, seal_folder


def list_files(storage: FolderStorage) -> list[Path]:
    return [path for path in storage.root.rglob("*") if path.is_file()]


def test_a_kept_upload_is_one_file_with_the_bytes_that_came(storage: FolderStorage) -> None:
    upload = storage.open_upload(100)

    upload.write(b"abc")
    upload.write(b"def")
    stored = upload.keep()

    assert list_files(storage) == [storage.recording(stored.id)]
    assert storage.recording(stored.id).read_bytes() == b"abcdef"


def test_the_hash_is_that_of_the_whole_upload(storage: FolderStorage) -> None:
    upload = storage.open_upload(100)

    upload.write(b"abc")
    upload.write(b"def")

    assert upload.keep().sha256 == hashlib.sha256(b"abcdef").hexdigest()


def test_a_discarded_upload_leaves_nothing(storage: FolderStorage) -> None:
    upload = storage.open_upload(100)
    upload.write(b"abc")

    upload.discard()

    assert list_files(storage) == []


def test_discarding_after_keeping_does_no_harm(storage: FolderStorage) -> None:
    upload = storage.open_upload(100)
    upload.write(b"abc")
    stored = upload.keep()

    upload.discard()

    assert storage.recording(stored.id).read_bytes() == b"abc"


def test_the_last_byte_allowed_is_taken_and_the_next_refused(storage: FolderStorage) -> None:
    upload = storage.open_upload(6)
    upload.write(b"abcdef")

    with pytest.raises(FileTooLarge):
        upload.write(b"g")

    upload.discard()


def test_a_disk_that_is_too_full_is_refused_before_the_first_byte(storage: FolderStorage) -> None:
    with pytest.raises(DiskFull):
        storage.check_space(expected_bytes=1 << 60, min_free_bytes=0)


def test_a_disk_with_too_little_reserve_is_refused(storage: FolderStorage) -> None:
    with pytest.raises(DiskFull):
        storage.check_space(expected_bytes=0, min_free_bytes=1 << 60)


def test_a_disk_that_fills_up_while_writing_is_named_as_that(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full on this system")
    upload = FolderUpload(tmp_path / "a.part", tmp_path / "a", max_bytes=1 << 30)
    upload._file.close()
    upload._file = full.open("wb", buffering=0)

    with pytest.raises(DiskFull) as refusal:
        upload.write(b"abc")

    assert isinstance(refusal.value.__cause__, OSError)
    assert refusal.value.__cause__.errno == errno.ENOSPC
    upload.discard()


def test_the_sweep_removes_half_uploads(storage: FolderStorage) -> None:
    (storage.root / "uploads" / "rec_1.part").write_bytes(b"half")

    assert storage.sweep(recordings=(), attempts=()) == 1
    assert list_files(storage) == []


def test_the_sweep_removes_recordings_without_a_row_and_keeps_the_others(storage: FolderStorage) -> None:
    storage.recording("rec_known").write_bytes(b"kept")
    storage.recording("rec_orphan").write_bytes(b"orphan")

    storage.sweep(recordings={"rec_known"}, attempts=())

    assert list_files(storage) == [storage.recording("rec_known")]


def test_the_sweep_removes_attempts_that_do_not_count(storage: FolderStorage) -> None:
    counting = storage.open_attempt("an_1", "good") / "results.json"
    stale = storage.open_attempt("an_1", "dead") / "results.json"
    for file in (counting, stale):
        file.write_bytes(b"{}")

    storage.sweep(recordings=(), attempts={("an_1", "good")})

    assert list_files(storage) == [counting]


def test_sealing_a_folder_tells_every_file_with_its_hash(storage: FolderStorage) -> None:
    folder = storage.open_attempt("an_1", "t")
    (folder / "b.csv").write_bytes(b"xy")
    (folder / "a.json").write_bytes(b"")

    files = seal_folder(folder)

    assert [(file.name, file.size_bytes) for file in files] == [("a.json", 0), ("b.csv", 2)]
    assert files[1].sha256 == hashlib.sha256(b"xy").hexdigest()


def test_a_folder_has_one_server_at_a_time(storage: FolderStorage) -> None:
    first = FolderLock(storage.root)

    with pytest.raises(FolderTaken):
        FolderLock(storage.root)

    first.release()
    FolderLock(storage.root).release()
