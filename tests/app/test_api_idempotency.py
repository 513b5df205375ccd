"""``Idempotency-Key``: asked twice, done once, answered alike."""

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from app.jobs.idempotency import KeptResponse, ResponseStore
from app.jobs.store import JobStore
from app.main import create_app
from app.services import find_services
from app.settings import Settings

URL = "/api/v1/analyze"
KEY = {"idempotency-key": "k-1"}


def list_kept(store: JobStore) -> list[tuple[int, str, bytes]]:
    """Give status, headers and body of every kept answer."""
    with store.reader.connect() as connection:
        rows = connection.exec_driver_sql("SELECT status, headers, body FROM kept_answers").all()
    return [(row.status, row.headers, bytes(row.body)) for row in rows]


def test_the_same_request_twice_is_done_once_and_answered_alike(client: TestClient, store: JobStore) -> None:
    first = client.post(URL, params={"again": True}, content=b"x", headers=KEY)
    second = client.post(URL, params={"again": True}, content=b"x", headers=KEY)

    assert (second.status_code, second.content) == (first.status_code, first.content)
    assert second.headers["location"] == first.headers["location"]
    assert len(store.find_newest()) == 1


@pytest.mark.parametrize("change", [{"content": b"y"}, {"params": {"side": "left"}}])
def test_the_same_key_for_another_request_is_refused(client: TestClient, change: dict[str, object]) -> None:
    client.post(URL, content=b"x", headers=KEY)

    answer = client.post(URL, **({"content": b"x", "headers": KEY} | change))  # type: ignore[arg-type]

    assert (answer.status_code, answer.json()["code"]) == (422, "E-KEY-REUSED")


def test_a_request_that_is_under_way_is_a_409(client: TestClient) -> None:
    services = find_services(Request({"type": "http", "app": client.app}))
    client.post(URL, content=b"x", headers=KEY)
    with services.store.engine.begin() as connection:
        connection.exec_driver_sql("UPDATE kept_answers SET status = NULL")

    answer = client.post(URL, content=b"x", headers=KEY)

    assert (answer.status_code, answer.json()["code"]) == (409, "E-KEY-IN-USE")
    assert answer.headers["retry-after"] == "5"


def test_a_refusal_is_kept_too(client: TestClient) -> None:
    first = client.post("/api/v1/analyses", json={"recording_ids": ["rec_none"]}, headers=KEY)

    second = client.post("/api/v1/analyses", json={"recording_ids": ["rec_none"]}, headers=KEY)

    assert first.status_code == second.status_code == 404
    assert second.headers["content-type"] == "application/problem+json"


def test_a_refusal_that_may_pass_is_not_kept(settings: Settings) -> None:
    with TestClient(
        create_app(settings.model_copy(update={"max_queued": 0})), base_url="http://localhost"
    ) as full:
        assert full.post(URL, content=b"x", headers=KEY).status_code == 503

    with TestClient(create_app(settings), base_url="http://localhost") as free:
        assert free.post(URL, content=b"x", headers=KEY).status_code == 202


def test_a_kept_answer_outlives_the_server(settings: Settings) -> None:
    with TestClient(create_app(settings), base_url="http://localhost") as before:
        first = before.post(URL, content=b"x", headers=KEY).json()

    with TestClient(create_app(settings), base_url="http://localhost") as after:
        assert after.post(URL, content=b"x", headers=KEY).json() == first


def test_a_key_is_forgotten_after_its_term(client: TestClient) -> None:
    services = find_services(Request({"type": "http", "app": client.app}))
    client.post(URL, content=b"x", headers=KEY)

    services.responses.age(3600.0, 3600.0)

    assert client.post(URL, content=b"y", headers=KEY).status_code == 202


def test_a_server_that_starts_leaves_the_keys_of_its_peers(store: JobStore) -> None:
    one, other = (ResponseStore(store.engine, store.reader, name) for name in ("one", "other"))
    one.reserve("key of a request under way")

    other.free_unfinished()
    is_held = other.reserve("key of a request under way") is not None
    one.free_unfinished()

    assert is_held
    assert other.reserve("key of a request under way") is None


def test_the_key_of_a_server_that_did_not_come_back_is_free_after_an_hour(store: JobStore) -> None:
    one, other = (ResponseStore(store.engine, store.reader, name) for name in ("one", "other"))
    one.reserve("key")

    other.age(3600.0, 24 * 3600.0)

    assert other.reserve("key") is None


def test_a_purge_empties_the_answers_that_spoke_of_the_recording(client: TestClient, store: JobStore) -> None:
    job = client.post(URL, params={"subject": "S1"}, content=b"x", headers=KEY).json()

    client.delete(f"/api/v1/recordings/{job['recording_id']}", params={"purge": True})

    assert list_kept(store) == [(410, "[]", b"")]


def test_a_repetition_after_a_purge_makes_nothing_anew(client: TestClient, store: JobStore) -> None:
    job = client.post(URL, content=b"x", headers=KEY).json()
    client.delete(f"/api/v1/recordings/{job['recording_id']}", params={"purge": True})

    answer = client.post(URL, content=b"x", headers=KEY)

    assert (answer.status_code, answer.json()["code"]) == (410, "E-PURGED")
    assert store.find_newest() == ()


def test_after_a_purge_the_key_still_belongs_to_its_request(client: TestClient) -> None:
    job = client.post(URL, content=b"x", headers=KEY).json()
    client.delete(f"/api/v1/recordings/{job['recording_id']}", params={"purge": True})

    assert client.post(URL, content=b"y", headers=KEY).json()["code"] == "E-KEY-REUSED"


def test_a_purge_leaves_the_answers_of_other_recordings(client: TestClient) -> None:
    first = client.post("/api/v1/recordings", content=b"x").json()
    second = client.post("/api/v1/recordings", content=b"x", headers=KEY).json()
    assert second["duplicate_of"] == first["id"]

    client.delete(f"/api/v1/recordings/{first['id']}", params={"purge": True})

    assert client.post("/api/v1/recordings", content=b"x", headers=KEY).json() == second


def test_a_purge_forgets_refusals_for_they_may_repeat_a_subject_code(
    client: TestClient, store: JobStore
) -> None:
    refused = client.post("/api/v1/recordings", json={"upload_id": "u", "side": "S1"}, headers=KEY)
    assert "S1" in refused.json()["detail"]
    kept = client.post("/api/v1/recordings", content=b"x").json()

    client.delete(f"/api/v1/recordings/{kept['id']}", params={"purge": True})

    assert list_kept(store) == []


def test_a_purge_takes_a_batch_along_of_which_nothing_is_left(client: TestClient, store: JobStore) -> None:
    kept = client.post("/api/v1/recordings", content=b"x").json()
    wish = {"name": "visit of S1", "items": [{"recording_id": kept["id"]}]}
    batch = client.post("/api/v1/batches", json=wish, headers=KEY).json()

    client.delete(f"/api/v1/recordings/{kept['id']}", params={"purge": True})

    assert client.get(f"/api/v1/batches/{batch['id']}").status_code == 404
    assert list_kept(store) == [(410, "[]", b"")]


def test_a_batch_with_other_recordings_outlives_a_purge(client: TestClient) -> None:
    kept = [client.post("/api/v1/recordings", content=body).json()["id"] for body in (b"x", b"y")]
    wish = {"name": "spring", "items": [{"recording_id": one} for one in kept]}
    batch = client.post("/api/v1/batches", json=wish).json()

    client.delete(f"/api/v1/recordings/{kept[0]}", params={"purge": True})

    assert client.get(f"/api/v1/batches/{batch['id']}").json()["name"] == "spring"


@pytest.mark.parametrize("database", ["sqlite", "postgresql"], indirect=True)
def test_an_answer_whose_recording_was_purged_meanwhile_is_kept_empty(store: JobStore) -> None:
    answers = ResponseStore(store.engine, store.reader, "one")
    answers.reserve("key")

    answers.keep("key", KeptResponse("f", 201, (), b'{"id":"rec_0123456789abcdef","subject":"S1"}'))

    assert list_kept(store) == [(410, "[]", b"")]
