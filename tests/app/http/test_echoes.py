"""What a request holds in a field of a secret's name is never in the answer, whatever is wrong with it."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

CANARY = "canary-7f3a91"


NAMES = ("password", "token", "client_secret", "code", "api-key", "proof", "accessToken")


@pytest.mark.parametrize("name", NAMES)
def test_a_secret_in_a_query_is_not_said_back(shared: TestClient, name: str) -> None:
    answer = shared.get(f"/api/v1/analyses?{name}={CANARY}")

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")
    assert CANARY not in answer.text


@pytest.mark.parametrize(
    "body",
    [
        {"url": "https://example.org/", "secret": CANARY},
        {"url": {"token": CANARY}},
        {"url": ["x", CANARY]},
        {"password": CANARY},
        {"url": 3, "key": {"password": CANARY}},
        [CANARY],
        CANARY,
    ],
)
def test_a_secret_in_a_body_is_not_said_back(shared: TestClient, body: Any) -> None:
    answer = shared.post("/api/v1/webhooks", json=body)

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")
    assert CANARY not in answer.text


@pytest.mark.parametrize("kind", ["application/x-www-form-urlencoded", "application/json", "text/plain"])
@pytest.mark.parametrize("path", ["/api/v1/webhooks", "/api/v1/batches", "/api/v1/tokens"])
def test_a_body_of_another_kind_is_not_said_back(shared: TestClient, path: str, kind: str) -> None:
    answer = shared.post(path, content=f"password={CANARY}", headers={"content-type": kind})

    assert answer.status_code >= 400
    assert CANARY not in answer.text


def test_what_is_no_secret_is_said_back(shared: TestClient) -> None:
    assert "sideways" in shared.post("/api/v1/analyze?side=sideways", content=b"x").json()["detail"]


@pytest.mark.parametrize("path", ["/", "/trash", "/nowhere", "/help"])
def test_no_page_links_to_itself_with_a_secret(shared: TestClient, path: str) -> None:
    page = shared.get(f"{path}?token={CANARY}&page=1", headers={"accept": "text/html"}).text

    assert "page=1&amp;lang=fr" in page
    assert CANARY not in page
