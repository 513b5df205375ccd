"""What every store of recordings promises, folder or bucket."""

import hashlib

import pytest

from app.errors import DiskFull, FileTooLarge, KeyGone, StoreAway
from app.settings import Settings
from app.storage import opened
from app.storage.incoming import Incoming
from app.storage.open import open_storage
from app.storage.sealing import SealedStorage
from app.storage.store import Storage
from tests.swift import SwiftServer

pytestmark = pytest.mark.parametrize("objects", ["folder", "s3"], indirect=True)


OWNER = "rec_0123456789abcdef"


def keep(storage: Storage, content: bytes) -> str:
    upload = storage.open_upload(1 << 30)
    upload.write(content)
    return upload.keep().id


def keep_attempt(storage: Storage, token: str, content: bytes) -> None:
    folder = storage.open_attempt("an_1", token)
    (folder / "results.json").write_bytes(content)
    storage.keep_attempt("an_1", token, OWNER)


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
    assert list_files(storage) == []


def list_files(storage: Storage) -> list[str]:
    """Give every file of this machine, but for the organisation's key."""
    names = (path.relative_to(storage.root).as_posix() for path in storage.root.rglob("*") if path.is_file())
    return sorted(set(names) - {"organisation.key", "keys/organisation"})


def test_the_last_byte_allowed_is_taken_and_the_next_refused(storage: Storage) -> None:
    upload = storage.open_upload(5)
    upload.write(b"abcde")

    with pytest.raises(FileTooLarge):
        upload.write(b"f")

    upload.discard()


def test_an_upload_of_this_machine_becomes_a_recording(storage: SealedStorage) -> None:
    incoming = Incoming(storage.root / "incoming", storage.keys)
    incoming.prepare()
    file = incoming.open("up_1", 0, 3)
    file.write(b"abc")
    file.flush()
    file.close()

    twice = [storage.adopt(incoming.path("up_1"), "5a", 3) for _ in range(2)]
    incoming.forget("up_1")

    assert twice[0] == twice[1]
    assert storage.fetch(f"recordings/{twice[0].id}").path.read_bytes() == b"abc"


def test_nothing_is_stored_in_clear(storage: SealedStorage) -> None:
    canary = b"a canary of thirty-two bytes, so"
    recording_id = keep(storage, canary)
    keep_attempt(storage, "t", canary)
    storage.write_small(f"recordings/{recording_id}.json", canary)
    storage.write_small("views.json", canary)

    names = (f"recordings/{recording_id}", "analyses/an_1/t/results.json")
    stored = [storage.fetch_sealed(name).read_bytes() for name in names]
    small = [storage.inner.read_small(name) or b"" for name in (f"{names[0]}.json", "views.json")]
    assert [content.count(canary) for content in (*stored, *small)] == [0, 0, 0, 0]
    assert storage.read_small(f"recordings/{recording_id}.json") == canary


def test_a_part_of_a_recording_is_read_alone(storage: SealedStorage) -> None:
    name = f"recordings/{keep(storage, bytes(3 << 20) + b'end')}"

    assert storage.read_part(name, 3 << 20, 10) == b"end"
    assert storage.read_part(name, 0, 2) == b"\0\0"


def test_the_size_of_what_is_sealed_is_that_of_its_content(storage: SealedStorage) -> None:
    mark = storage.find_mark(f"recordings/{keep(storage, b'abc')}")

    assert mark is not None
    assert mark[0] == 3


def test_bytes_without_their_key_open_no_more(storage: SealedStorage) -> None:
    name = f"recordings/{keep(storage, b'abc')}"
    storage.keys.destroy(name.removeprefix("recordings/"))

    with pytest.raises(KeyGone):
        storage.fetch(name)
    with pytest.raises(KeyGone):  # and no new key takes its place
        storage.find_key(name.removeprefix("recordings/"))


def test_what_was_stored_in_clear_is_read_and_then_sealed(storage: SealedStorage) -> None:
    clear = storage.root / "clear"
    clear.write_bytes(b"abc")
    name = f"recordings/{OWNER}"
    storage.put(clear, name)
    sha256 = hashlib.sha256(b"abc").hexdigest()
    assert storage.fetch(name).path.read_bytes() == b"abc"
    in_use = storage.fetch(name).path

    assert not storage.seal(name, OWNER, sha256="ab" * 32)
    assert not storage.is_sealed(name)
    assert storage.seal(name, OWNER, sha256)
    assert storage.is_sealed(name)
    assert not storage.seal(name, OWNER, sha256)

    assert in_use.read_bytes() == b"abc"
    assert storage.fetch(name).path.read_bytes() == b"abc"


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

    storage.keep_attempt("an_1", "t", OWNER)

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


def test_copies_of_a_killed_process_are_swept_and_those_in_use_stay(
    storage: SealedStorage, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opened, "UNHELD_S", 0.0)
    keep_attempt(storage, "t", b"{}")
    in_use = storage.fetch("analyses/an_1/t/results.json").path
    left = storage.root / "opened" / "0123456789abcdef"
    left.write_bytes(b"{}")

    assert open_storage(settings).drop_temporary(min_age_s=0) == 1

    assert list((storage.root / "opened").iterdir()) == [in_use]
    storage.release(in_use)
    assert list((storage.root / "opened").iterdir()) == []


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
