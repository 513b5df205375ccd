"""``/api/v1/uploads``: tus 1.0.0, as its own text asks."""

import base64
import gzip
import hashlib
import json
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from app.jobs.store import JobStore
from app.main import create_app
from app.services import find_services
from app.settings import Settings
from app.storage.store import Storage, borrow_recording

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


def append(client: TestClient, address: str, offset: int, content: bytes, **more: str) -> int:
    headers = BODY | {"upload-offset": str(offset)} | more
    return client.patch(address, content=content, headers=headers).status_code


def files_of(settings: Settings) -> list[Path]:
    return [p for name in ("incoming", "uploads", "recordings") for p in (settings.data_dir / name).iterdir()]


def test_the_server_says_what_it_speaks(client: TestClient) -> None:
    headers = client.options(URL).headers

    assert headers["tus-version"] == "1.0.0"
    assert headers["tus-max-size"] == "1000000"
    assert headers["tus-extension"] == "creation,creation-with-upload,termination,checksum,expiration"
    assert "sha1" in headers["tus-checksum-algorithm"].split(",")


def test_an_announced_upload_has_an_address_and_no_bytes(client: TestClient) -> None:
    head = client.head(announce(client, 10), headers=TUS)

    assert (head.status_code, head.headers["upload-offset"], head.headers["upload-length"]) == (
        200,
        "0",
        "10",
    )
    assert head.headers["cache-control"] == "no-store"
    assert head.headers["tus-resumable"] == "1.0.0"


def test_bytes_in_two_pieces_become_one_recording(client: TestClient, storage: Storage) -> None:
    address = announce(client, 10, filename="shift.gt3x", subject="S012", side="left")

    assert append(client, address, 0, b"01234") == 204
    assert append(client, address, 5, b"56789") == 204

    recording = client.get(client.get(address).json()["links"]["recording"]).json()
    with borrow_recording(storage, recording["id"], recording["sha256"]) as kept:
        assert kept.read_bytes() == b"0123456789"
    assert recording["sha256"] == hashlib.sha256(b"0123456789").hexdigest()
    assert (recording["file_name"], recording["subject"], recording["side"]) == ("shift.gt3x", "S012", "left")


def test_the_last_answer_names_the_recording(client: TestClient) -> None:
    address = announce(client, 1)

    answer = client.patch(address, content=b"x", headers=BODY | {"upload-offset": "0"})

    assert answer.headers["acromion-recording"].startswith("rec_")


def test_the_first_bytes_may_come_with_the_announcement(client: TestClient) -> None:
    answer = client.post(URL, content=b"0123", headers=BODY | {"upload-length": "10"})

    assert (answer.status_code, answer.headers["upload-offset"]) == (201, "4")


def test_bytes_beyond_what_is_taken_at_once_are_told_to_come_again(settings: Settings) -> None:
    application = create_app(settings.model_copy(update={"max_uploads_at_once": 0}))
    with TestClient(application, base_url="http://localhost") as client:
        address = announce(client, 3)

        assert append(client, address, 0, b"abc") == 429
        assert client.head(address, headers=TUS).headers["upload-offset"] == "0"


def test_bytes_for_another_place_are_refused(client: TestClient) -> None:
    address = announce(client, 10)

    answer = client.patch(address, content=b"x", headers=BODY | {"upload-offset": "3"})

    assert (answer.status_code, answer.json()["code"]) == (409, "E-OFFSET")
    assert answer.headers["tus-resumable"] == "1.0.0"


def test_more_bytes_than_announced_are_refused(client: TestClient) -> None:
    address = announce(client, 3)

    assert append(client, address, 0, b"0123") == 400
    assert client.head(address, headers=TUS).headers["upload-offset"] == "0"


def test_another_kind_of_body_is_refused(client: TestClient) -> None:
    address = announce(client, 3)

    answer = client.patch(address, content=b"x", headers=TUS | {"upload-offset": "0"})

    assert (answer.status_code, answer.json()["code"]) == (415, "E-MEDIA")


def test_another_version_of_the_protocol_is_refused(client: TestClient) -> None:
    answer = client.post(URL, headers={"tus-resumable": "0.2.2", "upload-length": "3"})

    assert (answer.status_code, answer.json()["code"]) == (412, "E-PROTOCOL")
    assert answer.headers["tus-version"] == "1.0.0"


@pytest.mark.parametrize(
    ("length", "status"), [("1000001", 413), ("0", 422), ("-1", 422), ("many", 422), (None, 400)]
)
def test_a_length_that_cannot_be_is_refused_before_the_first_byte(
    client: TestClient, settings: Settings, length: str | None, status: int
) -> None:
    headers = TUS if length is None else TUS | {"upload-length": length}

    assert client.post(URL, headers=headers).status_code == status
    assert files_of(settings) == []


def test_no_upload_is_begun_on_a_disk_that_is_nearly_full(settings: Settings) -> None:
    application = create_app(settings.model_copy(update={"min_free_bytes": 1 << 60}))

    with TestClient(application, base_url="http://localhost") as client:
        assert client.post(URL, headers=TUS | {"upload-length": "3"}).status_code == 507


@pytest.mark.parametrize("algorithm", ["sha1", "sha256", "sha512", "md5"])
def test_bytes_with_the_right_checksum_are_taken(client: TestClient, algorithm: str) -> None:
    address = announce(client, 10)
    digest = base64.b64encode(hashlib.new(algorithm, b"01234").digest()).decode()

    assert append(client, address, 0, b"01234", **{"upload-checksum": f"{algorithm} {digest}"}) == 204


def test_bytes_with_a_wrong_checksum_do_not_count(client: TestClient) -> None:
    address = announce(client, 10)
    digest = base64.b64encode(hashlib.sha1(b"other").digest()).decode()

    assert append(client, address, 0, b"01234", **{"upload-checksum": f"sha1 {digest}"}) == 460
    assert client.head(address, headers=TUS).headers["upload-offset"] == "0"


def test_the_recording_holds_the_right_bytes_after_wrong_ones(client: TestClient) -> None:
    address = announce(client, 10)
    digest = base64.b64encode(hashlib.sha1(b"01234").digest()).decode()
    append(client, address, 0, b"WRONG", **{"upload-checksum": f"sha1 {digest}"})

    append(client, address, 0, b"01234")
    append(client, address, 5, b"56789")

    recording = client.get(client.get(address).json()["links"]["recording"]).json()
    assert recording["sha256"] == hashlib.sha256(b"0123456789").hexdigest()


@pytest.mark.parametrize("checksum", ["crc32 AAAA", "sha1 ???", "sha1"])
def test_a_checksum_that_cannot_be_compared_is_a_400(client: TestClient, checksum: str) -> None:
    address = announce(client, 10)

    expected = 460 if checksum == "sha1" else 400
    assert append(client, address, 0, b"01234", **{"upload-checksum": checksum}) == expected


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


def test_an_upload_says_when_it_expires(client: TestClient) -> None:
    assert client.head(announce(client, 1), headers=TUS).headers["upload-expires"].endswith("GMT")


def test_the_metadata_comes_back_as_it_was_sent(client: TestClient) -> None:
    address = announce(client, 10, filename="Équipe 1.csv", filetype="text/csv")

    sent = client.head(address, headers=TUS).headers["upload-metadata"]

    assert sent == f"filename {code('Équipe 1.csv')},filetype {code('text/csv')}"


@pytest.mark.parametrize("metadata", ["filename ???", "side dXA=", f"subject {code('a' * 101)}"])
def test_metadata_that_cannot_be_is_refused(client: TestClient, metadata: str) -> None:
    answer = client.post(URL, headers=TUS | {"upload-length": "3", "upload-metadata": metadata})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")


def test_a_server_started_anew_goes_on_where_the_bytes_ended(settings: Settings) -> None:
    with TestClient(create_app(settings), base_url="http://localhost") as before:
        address = announce(before, 10)
        append(before, address, 0, b"01234")

    with TestClient(create_app(settings), base_url="http://localhost") as after:
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
    file = find_services(Request({"type": "http", "app": client.app})).incoming.open(upload_id, 2)
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
    client.delete(f"/api/v1/recordings/{recording_id}", params={"purge": True})

    assert client.head(address, headers=TUS).status_code == 410
    assert append(client, address, 3, b"") == 410
    assert client.delete(address, headers=TUS).status_code == 204


def test_two_writers_at_once_are_not_let_in(client: TestClient) -> None:
    address = announce(client, 10)
    find_services(Request({"type": "http", "app": client.app})).incoming.acquire(address.rpartition("/")[2])

    assert append(client, address, 0, b"x") == 423
    assert client.delete(address, headers=TUS).status_code == 423


def test_an_upload_that_is_not_there_is_not_found(client: TestClient) -> None:
    assert client.head(f"{URL}/up_none", headers=TUS).status_code == 404
    assert append(client, f"{URL}/..%2f..%2fserver.lock", 0, b"x") == 404


PACKED = {"content-encoding": "gzip"}


def test_packed_pieces_give_the_bytes_that_were_packed(
    client: TestClient, storage: Storage, store: JobStore
) -> None:
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
def test_of_a_packed_piece_that_is_not_right_nothing_counts(client: TestClient, body: bytes) -> None:
    address = announce(client, 100_000)

    status = append(client, address, 0, body, **PACKED)

    assert status == 460
    assert client.head(address, headers=TUS).headers["upload-offset"] == "0"


def test_a_piece_that_unpacks_to_more_than_was_announced_is_refused(client: TestClient) -> None:
    address = announce(client, 1000)

    status = append(client, address, 0, gzip.compress(bytes(50_000_000)), **PACKED)

    assert status == 400
    assert client.head(address, headers=TUS).headers["upload-offset"] == "0"


def test_another_packing_is_not_taken(client: TestClient) -> None:
    address = announce(client, 1000)

    assert append(client, address, 0, b"x", **{"content-encoding": "br"}) == 415


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
    address = announce(client, 5)

    assert append(client, address, 0, b"01234") == 204
    assert client.get(address).json()["recording_id"]


# The analysis that is declared when an upload begins.


def send_declared(client: TestClient, content: bytes, **settings: object) -> str:
    """Send a whole file that declares its analysis; gives the id of its recording."""
    said = {"filename": "shift.csv", "side": "left", "settings": json.dumps(settings)}
    address = announce(client, len(content), **said)
    assert append(client, address, 0, content) == 204
    recording: str = client.get(address).json()["recording_id"]
    return recording


def list_analyses(client: TestClient, recording_id: str) -> list[dict[str, Any]]:
    listed: list[dict[str, Any]] = client.get(f"/api/v1/analyses?recording_id={recording_id}").json()["items"]
    return listed


def test_a_declared_analysis_begins_with_the_last_byte(client: TestClient) -> None:
    (analysis,) = list_analyses(client, send_declared(client, b"0123456789", pose="side-lean"))

    assert analysis["state"] == "queued"
    request = client.get(f"/api/v1/analyses/{analysis['id']}").json()["settings"]
    assert (request["pose"], request["side"]) == ("side-lean", "left")


def test_before_its_last_byte_nothing_begins(client: TestClient) -> None:
    address = announce(client, 10, filename="shift.csv", settings="{}")
    append(client, address, 0, b"01234")

    assert client.get("/api/v1/analyses").json()["items"] == []


def test_an_upload_without_a_declaration_is_only_stored(client: TestClient) -> None:
    address = announce(client, 10, filename="shift.csv")
    append(client, address, 0, b"0123456789")

    assert list_analyses(client, client.get(address).json()["recording_id"]) == []


def test_a_declaration_that_cannot_be_kept_is_refused_before_the_first_byte(client: TestClient) -> None:
    metadata = f"filename {code('shift.csv')},settings {code(json.dumps({'pose': 'handstand'}))}"
    answer = client.post(URL, headers=TUS | {"upload-length": "10", "upload-metadata": metadata})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")


def test_what_is_said_while_the_file_comes_counts(client: TestClient) -> None:
    address = announce(client, 10, filename="shift.csv", side="left", settings="{}")
    append(client, address, 0, b"01234")
    words = {"file_name": "shift.csv", "subject": "S012", "side": "right", "settings": {"pose": "side-lean"}}
    assert client.put(f"{address}/words", json=words).status_code == 200
    append(client, address, 5, b"56789")

    recording = client.get(client.get(address).json()["links"]["recording"]).json()
    (analysis,) = list_analyses(client, recording["id"])
    request = client.get(f"/api/v1/analyses/{analysis['id']}").json()["settings"]
    assert (recording["subject"], recording["side"]) == ("S012", "right")
    assert (request["subject"], request["side"], request["pose"]) == ("S012", "right", "side-lean")


def test_what_is_said_too_late_changes_nothing_and_names_the_recording(client: TestClient) -> None:
    address = announce(client, 10, filename="shift.csv", subject="S012", settings="{}")
    append(client, address, 0, b"0123456789")

    late = client.put(f"{address}/words", json={"file_name": "shift.csv", "subject": "S013"}).json()

    recording = client.get(f"/api/v1/recordings/{late['recording_id']}").json()
    assert recording["subject"] == "S012"


def test_bytes_that_were_analysed_before_are_not_analysed_again_unasked(client: TestClient) -> None:
    send_declared(client, b"0123456789")

    assert len(list_analyses(client, send_declared(client, b"0123456789"))) == 1


def test_bytes_whose_analysis_was_given_up_are_analysed_again(client: TestClient) -> None:
    (first,) = list_analyses(client, send_declared(client, b"0123456789"))
    client.post(f"/api/v1/analyses/{first['id']}/cancel")

    analyses = list_analyses(client, send_declared(client, b"0123456789"))
    assert [analysis["state"] for analysis in analyses] == ["queued", "cancelled"]


def test_where_no_more_may_wait_the_upload_is_kept_and_nothing_begins(settings: Settings) -> None:
    full = settings.model_copy(update={"max_queued": 0})
    with TestClient(create_app(full), base_url="http://localhost") as client:
        assert list_analyses(client, send_declared(client, b"0123456789")) == []
