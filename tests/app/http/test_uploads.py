"""``/api/v1/uploads``: tus 1.0.0, as its own text asks."""

import base64
import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from acromion.app.library.jobs import JobStore
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage, borrow_recording
from tests.app.conftest import services_of, serving

URL = "/api/v1/uploads"
TUS = {"tus-resumable": "1.0.0"}
BODY = TUS | {"content-type": "application/offset+octet-stream"}


def code(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


def announce(client: TestClient, length: int, **said: str) -> str:
    metadata = ",".join(f"{name} {code(value)}" for name, value in said.items())
    answer = client.post(URL, headers=TUS | {"upload-length": str(length), "upload-metadata": metadata})
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def digest(algorithm: str, content: bytes) -> str:
    return base64.b64encode(hashlib.new(algorithm, content).digest()).decode()


def append(client: TestClient, address: str, offset: int, content: bytes, **more: str) -> int:
    headers = BODY | {"upload-offset": str(offset)} | more
    return client.patch(address, content=content, headers=headers).status_code


def files_of(settings: Settings) -> list[Path]:
    return [p for name in ("incoming", "uploads", "recordings") for p in (settings.data_dir / name).iterdir()]


def test_the_server_says_what_it_speaks(shared: TestClient) -> None:
    headers = shared.options(URL).headers

    assert headers["tus-version"] == "1.0.0"
    assert headers["tus-max-size"] == "1000000"
    assert headers["tus-extension"] == "creation,creation-with-upload,termination,checksum,expiration"
    assert "sha1" in headers["tus-checksum-algorithm"].split(",")


def test_an_announced_upload_has_an_address_and_no_bytes(shared: TestClient) -> None:
    said = {"filename": "Équipe 1.csv", "filetype": "text/csv"}
    head = shared.head(announce(shared, 10, **said), headers=TUS)

    told = {name: head.headers[name] for name in ("upload-offset", "upload-length", "cache-control", *TUS)}
    assert head.status_code == 200
    assert told == {"upload-offset": "0", "upload-length": "10", "cache-control": "no-store"} | TUS
    assert head.headers["upload-expires"].endswith("GMT")
    assert head.headers["upload-metadata"] == ",".join(f"{name} {code(word)}" for name, word in said.items())


def test_bytes_in_two_pieces_become_one_recording(client: TestClient, storage: Storage) -> None:
    address = announce(client, 10, filename="shift.gt3x", subject="S012", side="left")

    assert append(client, address, 0, b"01234") == 204
    last = client.patch(address, content=b"56789", headers=BODY | {"upload-offset": "5"})

    recording = client.get(client.get(address).json()["links"]["recording"]).json()
    assert (last.status_code, last.headers["acromion-recording"]) == (204, recording["id"])
    with borrow_recording(storage, recording["id"], recording["sha256"]) as kept:
        assert kept.read_bytes() == b"0123456789"
    assert recording["sha256"] == hashlib.sha256(b"0123456789").hexdigest()
    assert (recording["file_name"], recording["subject"], recording["side"]) == ("shift.gt3x", "S012", "left")


def test_the_first_bytes_may_come_with_the_announcement(client: TestClient) -> None:
    answer = client.post(URL, content=b"0123", headers=BODY | {"upload-length": "10"})

    assert (answer.status_code, answer.headers["upload-offset"]) == (201, "4")


@pytest.mark.parametrize(
    ("version", "content", "headers", "status"),
    [
        ("1.0.0", b"x", {"upload-offset": "3"}, 409),
        ("1.0.0", b"x" * 11, {}, 400),
        ("1.0.0", gzip.compress(bytes(50_000_000)), {"content-encoding": "gzip"}, 400),
        ("1.0.0", b"x", {"content-encoding": "br"}, 415),
        ("1.0.0", b"x", {"content-type": "text/plain"}, 415),
        ("0.2.2", b"x", {}, 412),
        ("1.0.0", b"x", {"upload-checksum": f"sha1 {digest('sha1', b'other')}"}, 460),
        ("1.0.0", b"x", {"upload-checksum": "crc32 AAAA"}, 400),
        ("1.0.0", b"x", {"upload-checksum": "sha1 ???"}, 400),
        ("1.0.0", b"x", {"upload-checksum": "sha1"}, 460),
    ],
    ids=[
        *("another place", "more than announced", "unpacks to more", "another packing", "another kind"),
        *("another version", "wrong checksum", "unknown checksum", "broken checksum", "empty checksum"),
    ],
)
def test_bytes_that_cannot_be_taken_are_refused_and_do_not_count(
    shared: TestClient, version: str, content: bytes, headers: dict[str, str], status: int
) -> None:
    address = announce(shared, 10)
    asked = BODY | {"tus-resumable": version, "upload-offset": "0"} | headers

    answer = shared.patch(address, content=content, headers=asked)

    assert answer.status_code == status
    assert answer.headers["tus-resumable"] == "1.0.0"
    assert status != 409 or answer.json()["code"] == "E-OFFSET"
    assert status != 412 or (answer.json()["code"], answer.headers["tus-version"]) == ("E-PROTOCOL", "1.0.0")
    assert shared.head(address, headers=TUS).headers["upload-offset"] == "0"


@pytest.mark.parametrize(
    ("length", "status"), [("1000001", 413), ("0", 422), ("-1", 422), ("many", 422), (None, 400)]
)
def test_a_length_that_cannot_be_is_refused_before_the_first_byte(
    client: TestClient, settings: Settings, length: str | None, status: int
) -> None:
    headers = TUS if length is None else TUS | {"upload-length": length}

    assert client.post(URL, headers=headers).status_code == status
    assert files_of(settings) == []


@pytest.mark.parametrize("algorithm", ["sha1", "sha256", "sha512", "md5"])
def test_bytes_with_the_right_checksum_count_after_wrong_ones(shared: TestClient, algorithm: str) -> None:
    address, content = announce(shared, 5, filename=algorithm), algorithm.encode()[:4].ljust(5)
    checksum = {"upload-checksum": f"{algorithm} {digest(algorithm, content)}"}

    assert append(shared, address, 0, b"WRONG", **checksum) == 460
    assert append(shared, address, 0, content, **checksum) == 204

    recording = shared.get(shared.get(address).json()["links"]["recording"]).json()
    assert recording["sha256"] == hashlib.sha256(content).hexdigest()


def test_a_terminated_upload_is_gone_with_its_bytes(client: TestClient, settings: Settings) -> None:
    address = announce(client, 10)
    append(client, address, 0, b"01234")

    assert client.delete(address, headers=TUS).status_code == 204
    assert client.head(address, headers=TUS).status_code == 404
    assert files_of(settings) == []


def test_the_recording_of_a_finished_upload_outlives_its_termination(client: TestClient) -> None:
    address = announce(client, 1)
    append(client, address, 0, b"x")
    recording = client.get(address).json()["links"]["recording"]

    client.delete(address, headers=TUS)

    assert client.get(recording).status_code == 200


@pytest.mark.parametrize(
    "metadata",
    [
        "filename ???",
        "side dXA=",
        f"subject {code('a' * 101)}",
        f"filename {code('shift.csv')},settings {code(json.dumps({'pose': 'handstand'}))}",
    ],
)
def test_metadata_that_cannot_be_is_refused(shared: TestClient, metadata: str) -> None:
    answer = shared.post(URL, headers=TUS | {"upload-length": "3", "upload-metadata": metadata})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")


def test_a_server_started_anew_goes_on_where_the_bytes_ended(settings: Settings) -> None:
    with serving(settings) as before:
        address = announce(before, 10)
        append(before, address, 0, b"01234")

    with serving(settings) as after:
        assert after.head(address, headers=TUS).headers["upload-offset"] == "5"
        assert append(after, address, 5, b"56789") == 204
        recording = after.get(after.get(address).json()["links"]["recording"]).json()
        assert recording["sha256"] == hashlib.sha256(b"0123456789").hexdigest()


def test_bytes_that_were_written_but_never_counted_are_cut_off(
    client: TestClient, settings: Settings
) -> None:
    address = announce(client, 4)
    append(client, address, 0, b"01")
    with (settings.data_dir / "incoming" / address.rpartition("/")[2]).open("ab") as file:
        file.write(b"torn")

    append(client, address, 2, b"23")

    recording = client.get(client.get(address).json()["links"]["recording"]).json()
    assert recording["sha256"] == hashlib.sha256(b"0123").hexdigest()


def test_an_upload_that_was_whole_when_the_server_died_becomes_its_recording(
    client: TestClient, store: JobStore
) -> None:
    address = announce(client, 4)
    append(client, address, 0, b"01")
    upload_id = address.rpartition("/")[2]
    file = services_of(client).incoming.open(upload_id, 2)
    file.write(b"23")
    file.flush()
    file.close()
    with store.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE uploads SET offset_bytes = 4")

    recording = client.get(client.get(address).json()["links"]["recording"]).json()
    assert recording["sha256"] == hashlib.sha256(b"0123").hexdigest()


def test_the_same_file_again_is_the_recording_that_there_is(client: TestClient, settings: Settings) -> None:
    answers = []
    for _ in range(2):
        address = announce(client, 3, filename="a.csv", subject="S1")
        append(client, address, 0, b"abc")
        answers.append(client.get(address).json())

    assert answers[1]["recording_id"] == answers[0]["recording_id"]
    assert [answer["is_repeated"] for answer in answers] == [False, True]
    assert len([path for path in files_of(settings) if path.suffix != ".json"]) == 1


def test_the_upload_of_what_was_deleted_for_good_says_so(client: TestClient) -> None:
    address = announce(client, 3)
    append(client, address, 0, b"abc")
    recording_id = client.get(address).json()["recording_id"]
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": "now"})

    assert client.head(address, headers=TUS).status_code == 410
    assert append(client, address, 3, b"") == 410
    assert client.delete(address, headers=TUS).status_code == 204


def test_two_writers_at_once_are_not_let_in(shared: TestClient) -> None:
    address = announce(shared, 10)
    services_of(shared).incoming.acquire(address.rpartition("/")[2])

    assert append(shared, address, 0, b"x") == 423
    assert shared.delete(address, headers=TUS).status_code == 423


def test_an_upload_that_is_not_there_is_not_found(shared: TestClient) -> None:
    assert shared.head(f"{URL}/up_none", headers=TUS).status_code == 404
    assert append(shared, f"{URL}/..%2f..%2fserver.lock", 0, b"x") == 404


PACKED = {"content-encoding": "gzip"}


def test_packed_pieces_give_the_bytes_that_were_packed(client: TestClient) -> None:
    address = announce(client, 300_000)
    first, second = bytes(200_000), b"b" * 100_000

    assert append(client, address, 0, gzip.compress(first), **PACKED) == 204
    assert append(client, address, 200_000, gzip.compress(second), **PACKED) == 204

    recording_id = client.head(address, headers=TUS).headers["acromion-recording"]
    recording = client.get(f"/api/v1/recordings/{recording_id}").json()
    assert recording["sha256"] == hashlib.sha256(first + second).hexdigest()
    assert recording["size_bytes"] == 300_000


@pytest.mark.parametrize(
    "body",
    [
        gzip.compress(b"a" * 90_000)[:-9],
        gzip.compress(b"a" * 90_000)[:-8] + b"12345678",
        b"not packed at all",
    ],
    ids=["cut", "altered", "plain"],
)
def test_of_a_packed_piece_that_is_not_right_nothing_counts(shared: TestClient, body: bytes) -> None:
    address = announce(shared, 100_000)

    status = append(shared, address, 0, body, **PACKED)

    assert status == 460
    assert shared.head(address, headers=TUS).headers["upload-offset"] == "0"


@pytest.mark.parametrize("left", [None, b"", b"012"], ids=["missing", "emptied", "shorter"])
def test_bytes_that_the_disk_has_lost_are_asked_for_again(
    client: TestClient, settings: Settings, storage: Storage, left: bytes | None
) -> None:
    address = announce(client, 10)
    append(client, address, 0, b"01234")
    lose(settings, address, left)

    assert append(client, address, 5, b"56789") == 409
    kept_bytes = int(client.head(address, headers=TUS).headers["upload-offset"])
    assert kept_bytes == len(left or b"")
    assert append(client, address, kept_bytes, b"0123456789"[kept_bytes:]) == 204
    recording_id = client.get(address).json()["recording_id"]
    with borrow_recording(storage, recording_id, hashlib.sha256(b"0123456789").hexdigest()) as kept:
        assert kept.read_bytes() == b"0123456789"


def test_a_whole_upload_that_the_disk_has_lost_becomes_no_recording(
    client: TestClient, settings: Settings, store: JobStore
) -> None:
    address = announce(client, 10)
    append(client, address, 0, b"01234")
    lose(settings, address, b"")
    with store.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE uploads SET offset_bytes = 10")

    assert client.head(address, headers=TUS).headers["upload-offset"] == "0"
    assert client.get("/api/v1/recordings").json()["items"] == []


def lose(settings: Settings, address: str, left: bytes | None) -> None:
    """Let the disk lose the bytes of an upload but for those that are left."""
    path = settings.data_dir / "incoming" / address.rpartition("/")[2]
    path.unlink()
    if left is not None:
        path.write_bytes(left)


@pytest.mark.parametrize("database", ["postgresql"], indirect=True)
def test_an_upload_is_taken_on_postgresql_too(client: TestClient) -> None:
    address = announce(client, 5, filename="shift.csv")

    assert append(client, address, 0, b"01234") == 204
    assert list_analyses(client, client.get(address).json()["recording_id"]) == []  # none was declared


# The analysis that is declared when an upload begins.


def send_declared(client: TestClient, content: bytes) -> str:
    """Send a whole file that declares its analysis; return the id of its recording."""
    address = announce(client, len(content), filename="shift.csv", side="left", settings="{}")
    assert append(client, address, 0, content) == 204
    recording: str = client.get(address).json()["recording_id"]
    return recording


def list_analyses(client: TestClient, recording_id: str) -> list[dict[str, Any]]:
    listed: list[dict[str, Any]] = client.get(f"/api/v1/analyses?recording_id={recording_id}").json()["items"]
    return listed


def test_a_declared_analysis_begins_with_the_last_byte(client: TestClient) -> None:
    address = announce(client, 10, filename="shift.csv", side="left", settings='{"pose": "side-lean"}')
    append(client, address, 0, b"01234")
    before = client.get("/api/v1/analyses").json()["items"]
    append(client, address, 5, b"56789")

    (analysis,) = list_analyses(client, client.get(address).json()["recording_id"])
    request = client.get(f"/api/v1/analyses/{analysis['id']}").json()["settings"]
    assert (before, analysis["state"]) == ([], "queued")
    assert (request["pose"], request["side"]) == ("side-lean", "left")


def test_bytes_are_analysed_again_unasked_only_if_their_analysis_was_given_up(client: TestClient) -> None:
    (first,) = list_analyses(client, send_declared(client, b"0123456789"))
    assert len(list_analyses(client, send_declared(client, b"0123456789"))) == 1
    client.post(f"/api/v1/analyses/{first['id']}/cancel")

    analyses = list_analyses(client, send_declared(client, b"0123456789"))

    assert [analysis["state"] for analysis in analyses] == ["queued", "cancelled"]


def test_where_no_more_may_wait_the_upload_is_kept_and_nothing_begins(settings: Settings) -> None:
    with serving(settings, max_queued=0) as client:
        assert list_analyses(client, send_declared(client, b"0123456789")) == []


DOCUMENTS = {
    "PDF": b"%PDF-1.7 a letter",
    "JPEG": b"\xff\xd8\xff\xe0 a photo",
    "HEIC/MP4": b"\0\0\0\x18ftypheic a photo",
    "WebP": b"RIFF\x10\0\0\0WEBPVP8  a photo",
    "TIFF": b"II*\0 a photo",
    "BMP": b"BM\x36\0\1\0" + bytes(4) + b"\x36\0\0\0\x28\0\0\0 a photo",
    "RTF": b"{\\rtf1 a letter}",
    "Word (.doc)": b"\xd0\xcf\x11\xe0" + bytes(508) + b"\xec\xa5\xc1\0",
    "OpenDocument (.odt)": b"PK\x03\x04" + bytes(26) + b"mimetypeapplication/vnd.oasis.opendocument.text",
    "Word (.docx)": b"PK\x03\x04" + bytes(26) + b"word/document.xml",
}


@pytest.mark.parametrize("kind", DOCUMENTS)
def test_a_photo_or_a_document_is_refused_and_not_stored(
    client: TestClient, settings: Settings, kind: str
) -> None:
    content = DOCUMENTS[kind]
    address = announce(client, len(content), filename="shift.csv")

    last = client.patch(address, content=content, headers=BODY | {"upload-offset": "0"})
    whole = client.post("/api/v1/recordings", content=content, params={"file_name": "shift.csv"})

    for answer in (last, whole):
        assert answer.status_code in (415, 422), answer.text
        assert answer.json()["code"] == "E-TYPE"
    assert files_of(settings) == []
    assert client.get("/api/v1/recordings").json()["items"] == []
    assert client.head(address, headers=TUS).status_code == 404
