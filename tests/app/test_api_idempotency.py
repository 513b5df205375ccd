"""``Idempotency-Key``: asked twice, done once, answered alike."""

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from app.api.services import find_services
from app.jobs.kept_answers import AnswerStore
from app.jobs.store import JobStore
from app.main import create_app
from app.settings import Settings

URL = "/api/v1/analyze"
KEY = {"idempotency-key": "k-1"}


def test_the_same_request_twice_is_done_once_and_answered_alike(client: TestClient, store: JobStore) -> None:
    first = client.post(URL, params={"again": True}, content=b"x", headers=KEY)
    second = client.post(URL, params={"again": True}, content=b"x", headers=KEY)

    assert (second.status_code, second.content) == (first.status_code, first.content)
    assert second.headers["location"] == first.headers["location"]
    assert len(store.list_newest()) == 1


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

    services.answers.age(3600.0, 3600.0)

    assert client.post(URL, content=b"y", headers=KEY).status_code == 202


def test_a_server_that_starts_leaves_the_keys_of_its_peers(store: JobStore) -> None:
    one, other = (AnswerStore(store.engine, store.reader, name) for name in ("one", "other"))
    one.reserve("key of a request under way")

    other.free_unfinished()
    is_held = other.reserve("key of a request under way") is not None
    one.free_unfinished()

    assert is_held
    assert other.reserve("key of a request under way") is None


def test_the_key_of_a_server_that_did_not_come_back_is_free_after_an_hour(store: JobStore) -> None:
    one, other = (AnswerStore(store.engine, store.reader, name) for name in ("one", "other"))
    one.reserve("key")

    other.age(3600.0, 24 * 3600.0)

    assert other.reserve("key") is None
