"""What every store of recordings promises, folder or bucket."""

import hashlib

import pytest

from acromion.app.errors import DiskFull, FileTooLarge, StoreAway
from acromion.app.store.folder import Storage
from acromion.app.store.incoming import Incoming
from tests.swift import SwiftServer

pytestmark = pytest.mark.parametrize("objects", ["folder", "s3"], indirect=True)


def keep(storage: Storage, content: bytes) -> str:
    upload = storage.open_upload(1 << 30)
    upload.write(content)
    return upload.keep().id


def keep_attempt(storage: Storage, token: str, content: bytes) -> None:
    folder = storage.open_attempt("an_1", token)
    (folder / "results.json").write_bytes(content)
    storage.keep_attempt("an_1", token)


def test_what_is_fetched_is_what_was_kept_as_it_came(storage: Storage, objects: str) -> None:
    upload = storage.open_upload(100)
    upload.write(b"abc")
    upload.write(b"def")

    stored = upload.keep()

    name = f"recordings/{stored.id}"
    assert storage.fetch(name).path.read_bytes() == storage.read_small(name) == b"abcdef"
    assert (stored.sha256, stored.size_bytes) == (hashlib.sha256(b"abcdef").hexdigest(), 6)
    if not objects:
        assert (storage.root / name).stat().st_mode & 0o777 == 0o600


def test_a_recording_of_several_parts_is_whole(storage: Storage) -> None:
    content = bytes(range(256)) * (20 << 12)  # 20 MiB; a part has 8

    recording_id = keep(storage, content)

    assert storage.fetch(f"recordings/{recording_id}").path.read_bytes() == content


def test_an_upload_that_is_discarded_cannot_be_fetched(storage: Storage) -> None:
    upload = storage.open_upload(1 << 30)
    upload.write(bytes(10 << 20))

    upload.discard()

    with pytest.raises(FileNotFoundError):
        storage.fetch("recordings/rec_0").path.read_bytes()
    assert list_files(storage) == []


def list_files(storage: Storage) -> list[str]:
    """Return every file of this machine."""
    return sorted(path.name for path in storage.root.rglob("*") if path.is_file())


def test_the_last_byte_allowed_is_taken_and_the_next_refused(storage: Storage) -> None:
    upload = storage.open_upload(5)
    upload.write(b"abcde")

    with pytest.raises(FileTooLarge):
        upload.write(b"f")

    upload.discard()


def test_an_upload_of_this_machine_becomes_a_recording(storage: Storage) -> None:
    incoming = Incoming(storage.root / "incoming")
    incoming.prepare()
    file = incoming.open("up_1", 0)
    file.write(b"abc")
    file.flush()
    file.close()

    for _ in range(2):
        storage.adopt(incoming.path("up_1"), "rec_1")
    incoming.forget("up_1")

    assert storage.fetch("recordings/rec_1").path.read_bytes() == b"abc"


def test_a_part_of_a_recording_is_read_alone(storage: Storage) -> None:
    name = f"recordings/{keep(storage, bytes(3 << 20) + b'end')}"

    assert storage.read_part(name, 3 << 20, 10) == b"end"
    assert storage.read_part(name, 0, 2) == b"\0\0"


def test_the_mark_of_a_file_begins_with_its_size(storage: Storage) -> None:
    mark = storage.find_mark(f"recordings/{keep(storage, b'abc')}")

    assert mark is not None
    assert mark[0] == 3


def test_a_recording_that_was_dropped_is_gone(storage: Storage) -> None:
    recording_id = keep(storage, b"abc")

    storage.drop_recording(recording_id)
    storage.drop_recording(recording_id)

    with pytest.raises(FileNotFoundError):
        storage.fetch(f"recordings/{recording_id}").path.read_bytes()


def test_a_kept_result_can_be_fetched_again_and_again_and_kept_twice(storage: Storage) -> None:
    keep_attempt(storage, "t", b"{}")

    for _ in range(2):
        path = storage.fetch("analyses/an_1/t/results.json").path
        assert path.read_bytes() == b"{}"
        storage.release(path)
        storage.keep_attempt("an_1", "t")


def test_dropping_an_attempt_leaves_the_others_and_dropping_the_analysis_none(storage: Storage) -> None:
    keep_attempt(storage, "good", b"good")
    keep_attempt(storage, "dead", b"dead")

    storage.drop_attempt("an_1", "dead")

    assert storage.fetch("analyses/an_1/good/results.json").path.read_bytes() == b"good"
    with pytest.raises(FileNotFoundError):
        storage.fetch("analyses/an_1/dead/results.json").path.read_bytes()
    storage.drop_analysis("an_1")
    with pytest.raises(FileNotFoundError):
        storage.fetch("analyses/an_1/good/results.json").path.read_bytes()


def test_a_store_has_one_name_for_ever(storage: Storage) -> None:
    assert storage.identify() == storage.identify()


def test_a_full_disk_is_refused_before_the_first_byte(storage: Storage, objects: str) -> None:
    spaces = [(0, 1 << 60)] if objects else [(0, 1 << 60), (1 << 60, 0)]  # a bucket takes what is expected
    for expected_bytes, min_free_bytes in spaces:
        with pytest.raises(DiskFull):
            storage.check_space(expected_bytes=expected_bytes, min_free_bytes=min_free_bytes)


def test_a_bucket_that_does_not_answer_is_named_as_that(
    storage: Storage, objects: str, request: pytest.FixtureRequest
) -> None:
    if not objects:
        return  # a folder is always there
    server: SwiftServer = request.getfixturevalue("swift")
    server.pause()
    try:
        upload = storage.open_upload(100)
        upload.write(b"abc")
        with pytest.raises(StoreAway):
            upload.keep()
    finally:
        server.resume()


def test_what_was_entered_in_the_ledger_of_erasures_stays_in_it(storage: Storage) -> None:
    storage.add_erased(["rec_1", "rec_2"])
    storage.add_erased(["rec_2", "rec_3"])

    assert storage.find_erased() == {"rec_1", "rec_2", "rec_3"}
