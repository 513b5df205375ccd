"""What every store of recordings promises, folder or bucket."""

import hashlib

import pytest

from app.errors import DiskFull, FileTooLarge, StoreAway
from app.storage.store import Storage
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


def test_what_is_fetched_is_what_was_kept(storage: Storage) -> None:
    upload = storage.open_upload(100)
    upload.write(b"abc")
    upload.write(b"def")

    stored = upload.keep()

    assert storage.fetch(f"recordings/{stored.id}").path.read_bytes() == b"abcdef"
    assert (stored.sha256, stored.size_bytes) == (hashlib.sha256(b"abcdef").hexdigest(), 6)


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
    assert [path for path in storage.root.rglob("*") if path.is_file()] == []


def test_more_than_allowed_is_refused(storage: Storage) -> None:
    upload = storage.open_upload(5)

    with pytest.raises(FileTooLarge):
        upload.write(b"abcdef")

    upload.discard()


def test_a_file_of_this_machine_becomes_a_recording(storage: Storage) -> None:
    ready = storage.root / "ready"
    ready.write_bytes(b"abc")

    stored = storage.adopt(ready, hashlib.sha256(b"abc").hexdigest(), 3)
    ready.unlink()

    assert storage.fetch(f"recordings/{stored.id}").path.read_bytes() == b"abc"


def test_a_recording_that_was_dropped_is_gone(storage: Storage) -> None:
    recording_id = keep(storage, b"abc")

    storage.drop_recording(recording_id)
    storage.drop_recording(recording_id)

    with pytest.raises(FileNotFoundError):
        storage.fetch(f"recordings/{recording_id}").path.read_bytes()


def test_a_kept_result_can_be_fetched_again_and_again(storage: Storage) -> None:
    keep_attempt(storage, "t", b"{}")

    for _ in range(2):
        path = storage.fetch("analyses/an_1/t/results.json").path
        assert path.read_bytes() == b"{}"
        storage.release(path)


def test_keeping_an_attempt_twice_does_no_harm(storage: Storage) -> None:
    keep_attempt(storage, "t", b"{}")

    storage.keep_attempt("an_1", "t")

    assert storage.fetch("analyses/an_1/t/results.json").path.read_bytes() == b"{}"


def test_dropping_an_attempt_leaves_the_others(storage: Storage) -> None:
    keep_attempt(storage, "good", b"good")
    keep_attempt(storage, "dead", b"dead")

    storage.drop_attempt("an_1", "dead")

    assert storage.fetch("analyses/an_1/good/results.json").path.read_bytes() == b"good"
    with pytest.raises(FileNotFoundError):
        storage.fetch("analyses/an_1/dead/results.json").path.read_bytes()


def test_dropping_an_analysis_drops_every_attempt(storage: Storage) -> None:
    keep_attempt(storage, "a", b"a")

    storage.drop_analysis("an_1")

    with pytest.raises(FileNotFoundError):
        storage.fetch("analyses/an_1/a/results.json").path.read_bytes()


def test_a_store_has_one_name_for_ever(storage: Storage) -> None:
    assert storage.identify() == storage.identify()


def test_a_full_disk_is_refused_before_the_first_byte(storage: Storage) -> None:
    with pytest.raises(DiskFull):
        storage.check_space(expected_bytes=0, min_free_bytes=1 << 60)


def test_fetched_copies_of_a_killed_server_are_swept(storage: Storage) -> None:
    keep_attempt(storage, "t", b"{}")
    storage.fetch("analyses/an_1/t/results.json")

    storage.drop_temporary(min_age_s=0)

    copies = storage.root / "fetched"
    assert not copies.exists() or list(copies.iterdir()) == []
    assert storage.fetch("analyses/an_1/t/results.json").path.read_bytes() == b"{}"


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
