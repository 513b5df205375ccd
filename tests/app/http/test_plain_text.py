"""Text that cannot be kept is refused at the door, on every route that takes any."""

import pytest
from fastapi.testclient import TestClient

from app.api.middleware import guard

JSON = {"content-type": "application/json"}
UNFIT = [r"\ud800", r"\uDFFF", r"a\udc80b", r"\u0000"]


def post_recording(client: TestClient) -> str:
    recording: str = client.post("/api/v1/recordings", content=b"x").json()["id"]
    return recording


@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("PATCH", "/api/v1/recordings/{id}", '{"subject": "@"}'),
        ("PUT", "/api/v1/recordings/{id}/periods", '[{"start_s": 0, "kind": "task", "label": "@"}]'),
        ("POST", "/api/v1/recordings", '{"upload_id": "@"}'),
        ("POST", "/api/v1/analyses", '{"recording_ids": ["{id}"], "settings": {"profile": {"@": 1}}}'),
        ("POST", "/api/v1/batches", '{"name": "@", "items": [{"recording_id": "{id}"}]}'),
        ("POST", "/api/v1/batches", '{"items": [{"recording_id": "{id}", "settings": {"@": 1}}]}'),
        ("POST", "/api/v1/webhooks", '{"url": "http://8.8.8.8/@"}'),
    ],
)
def test_text_that_cannot_be_kept_is_refused(shared: TestClient, method: str, path: str, body: str) -> None:
    recording = post_recording(shared)

    for unfit in UNFIT:
        content = body.replace("{id}", recording).replace("@", unfit)
        answer = shared.request(method, path.replace("{id}", recording), content=content, headers=JSON)
        assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER"), unfit


def test_a_surrogate_in_bytes_is_refused_as_one_that_is_escaped(shared: TestClient) -> None:
    body = b'{"items": [{"recording_id": "\xed\xa0\x80"}]}'

    assert shared.post("/api/v1/batches", content=body, headers=JSON).status_code == 422


def test_json_under_another_name_is_no_way_around(shared: TestClient) -> None:
    body = rb'[{"start": "\ud800", "kind": "task"}]'
    address = f"/api/v1/recordings/{post_recording(shared)}/periods"

    assert shared.put(address, content=body, headers={"content-type": "text/plain"}).status_code in (415, 422)


@pytest.mark.parametrize("text", [r"\ud83d\ude00", r"\\ud800", r"\\u0000", "é😀"])
def test_text_that_only_looks_like_it_is_taken(shared: TestClient, text: str) -> None:
    address = f"/api/v1/recordings/{post_recording(shared)}"

    answer = shared.patch(address, content=f'{{"subject": "{text}"}}'.encode(), headers=JSON)

    assert answer.status_code == 200, answer.text


@pytest.mark.parametrize("address", ["/api/v1/recordings?query=%00", "/?query=a%00", "/api/v1/analyses/%00"])
def test_a_nul_in_an_address_is_refused(shared: TestClient, address: str) -> None:
    assert shared.get(address).status_code == 422


@pytest.mark.parametrize("name", ["query", "subject", "lang"])
def test_bytes_of_an_address_that_are_not_utf_8_break_nothing(shared: TestClient, name: str) -> None:
    assert shared.get(f"/api/v1/recordings?{name}=%ED%A0%80").status_code < 500


@pytest.mark.parametrize("length", [9 << 20, 40 << 20])
def test_a_body_of_json_that_is_too_large_is_refused(
    shared: TestClient, monkeypatch: pytest.MonkeyPatch, length: int
) -> None:
    monkeypatch.setattr(guard, "DRAIN_LIMIT_S", 0.1)  # the test client sends no more, and does not hang up

    answer = shared.post("/api/v1/batches", content=b" " * length, headers=JSON)

    assert (answer.status_code, answer.json()["code"]) == (413, "E-BIG")
