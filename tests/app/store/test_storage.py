"""Recordings on the disk: durable when kept, gone when not."""

import errno
import hashlib
import os
import time
from pathlib import Path

import pytest

from acromion.app.errors import DiskFull, FolderTaken
from acromion.app.settings import Settings
from acromion.app.store.folder import LEDGER_FILE, FolderLock, FolderUpload, Storage, describe_files


@pytest.fixture
def storage(settings: Settings) -> Storage:
    folder = Storage(settings.data_dir)
    folder.prepare()
    return folder


def list_files(storage: Storage) -> list[Path]:
    return [path for path in storage.root.rglob("*") if path.is_file()]


def test_a_disk_that_fills_up_while_writing_is_named_as_that(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full on this system")
    writer = FolderUpload("rec_1", 1 << 20, tmp_path / "a.part", tmp_path / "a")
    writer._file.close()
    writer._file = full.open("wb", buffering=0)

    with pytest.raises(DiskFull) as refusal:
        writer.write(b"abc")

    assert isinstance(refusal.value.__cause__, OSError)
    assert refusal.value.__cause__.errno == errno.ENOSPC
    writer.discard()


OWN_PART = "rec_0123456789abcdef.part"


def make_old(path: Path) -> Path:
    """Let a file look as if nobody had written to it for two hours."""
    then_s = time.time() - 7200
    os.utime(path, (then_s, then_s))
    return path


def test_of_the_uploads_only_an_old_half_one_of_ours_is_removed(storage: Storage) -> None:
    uploads = storage.root / "uploads"
    strangers = [
        uploads / name for name in ("notes.part", "rec_1.part", "rec_0123456789abcdef", "upload.txt")
    ]
    for path in strangers:
        path.write_bytes(b"mine")
        make_old(path)
    (uploads / "rec_fedcba9876543210.part").mkdir()
    make_old(uploads / "rec_fedcba9876543210.part")
    part = uploads / OWN_PART
    part.write_bytes(b"half")

    assert storage.drop_temporary(3600) == 0  # it may still grow
    make_old(part)
    assert storage.drop_temporary(3600) == 1
    assert sorted(list_files(storage)) == sorted(strangers)
    assert (uploads / "rec_fedcba9876543210.part").is_dir()


def test_what_is_set_aside_keeps_its_name_and_its_bytes(storage: Storage) -> None:
    storage.recording("holiday.jpg").write_bytes(b"picture")

    storage.quarantine("holiday.jpg")

    assert (storage.root / "quarantine" / "holiday.jpg").read_bytes() == b"picture"
    assert not storage.recording("holiday.jpg").exists()


def test_what_is_set_aside_replaces_nothing_in_quarantine(storage: Storage) -> None:
    for content in (b"first", b"second"):
        storage.recording("holiday.jpg").write_bytes(content)
        storage.quarantine("holiday.jpg")

    kept = [(storage.root / "quarantine" / name).read_bytes() for name in storage.find_quarantined()]
    assert sorted(kept) == [b"first", b"second"]


def test_a_folder_is_described_by_every_file_with_its_hash(storage: Storage) -> None:
    folder = storage.open_attempt("an_1", "t")
    (folder / "b.csv").write_bytes(b"xy")
    (folder / "a.json").write_bytes(b"")

    files = describe_files(folder)

    assert [(file.name, file.size_bytes) for file in files] == [("a.json", 0), ("b.csv", 2)]
    assert files[1].sha256 == hashlib.sha256(b"xy").hexdigest()


def test_a_folder_has_one_server_at_a_time(storage: Storage) -> None:
    first = FolderLock(storage.root)

    with pytest.raises(FolderTaken):
        FolderLock(storage.root)

    first.release()
    FolderLock(storage.root).release()


def test_a_line_that_a_power_cut_tore_swallows_no_later_erasure(storage: Storage) -> None:
    storage.add_erased(["rec_1"])
    ledger = storage.root / LEDGER_FILE
    ledger.write_bytes(ledger.read_bytes() + b'{"id": "rec_')

    storage.add_erased(["rec_2"])

    assert storage.find_erased() == {"rec_1", "rec_2"}
