"""Text that cannot be kept is refused at the door, on every route that takes any."""

import pytest
from fastapi.testclient import TestClient

from app.api.middleware import guard
from app.settings import Settings

JSON = {"content-type": "application/json"}
UNFIT = [r"\ud800", r"\uDFFF", r"a\udc80b", r"\u0000"]


def post_recording(client: TestClient) -> str:
    recording: str = client.post("/api/v1/recordings", content=b"x").json()["id"]
    return recording


@pytest.mark.parametrize("unfit", UNFIT)
@pytest.mark.parametrize(
    ("method", "path", "body"),
    [
        ("PATCH", "/api/v1/recordings/{id}", '{"subject": "@"}'),
        ("PATCH", "/api/v1/recordings/{id}", '{"note": "@"}'),
        ("PUT", "/api/v1/recordings/{id}/periods", '[{"start": "@", "kind": "task"}]'),
        ("PUT", "/api/v1/recordings/{id}/periods", '[{"start_s": 0, "kind": "task", "label": "@"}]'),
        ("POST", "/api/v1/recordings", '{"upload_id": "@"}'),
        ("POST", "/api/v1/analyses", '{"recording_ids": ["@"]}'),
        ("POST", "/api/v1/analyses", '{"recording_ids": ["{id}"], "settings": {"profile": {"@": 1}}}'),
        ("POST", "/api/v1/batches", '{"items": [{"recording_id": "@"}]}'),
        ("POST", "/api/v1/batches", '{"name": "@", "items": [{"recording_id": "{id}"}]}'),
        ("POST", "/api/v1/batches", '{"items": [{"recording_id": "{id}", "settings": {"@": 1}}]}'),
        ("POST", "/api/v1/webhooks", '{"url": "http://8.8.8.8/@"}'),
    ],
)
def test_text_that_cannot_be_kept_is_refused(
    client: TestClient, method: str, path: str, body: str, unfit: str
) -> None:
    recording = post_recording(client)
    content = body.replace("{id}", recording).replace("@", unfit)

    answer = client.request(method, path.replace("{id}", recording), content=content, headers=JSON)

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")


def test_a_surrogate_in_bytes_is_refused_as_one_that_is_escaped(client: TestClient) -> None:
    body = b'{"items": [{"recording_id": "\xed\xa0\x80"}]}'

    assert client.post("/api/v1/batches", content=body, headers=JSON).status_code == 422


def test_json_under_another_name_is_no_way_around(client: TestClient) -> None:
    body = rb'[{"start": "\ud800", "kind": "task"}]'
    address = f"/api/v1/recordings/{post_recording(client)}/periods"

    assert client.put(address, content=body, headers={"content-type": "text/plain"}).status_code in (415, 422)


@pytest.mark.parametrize("text", [r"\ud83d\ude00", r"\\ud800", r"\\u0000", "é😀"])
def test_text_that_only_looks_like_it_is_taken(client: TestClient, text: str) -> None:
    address = f"/api/v1/recordings/{post_recording(client)}"

    answer = client.patch(address, content=f'{{"subject": "{text}"}}'.encode(), headers=JSON)

    assert answer.status_code == 200, answer.text


@pytest.mark.parametrize("address", ["/api/v1/recordings?query=%00", "/?query=a%00", "/api/v1/analyses/%00"])
def test_a_nul_in_an_address_is_refused(client: TestClient, address: str) -> None:
    assert client.get(address).status_code == 422


@pytest.mark.parametrize("name", ["query", "subject", "lang"])
def test_bytes_of_an_address_that_are_not_utf_8_break_nothing(client: TestClient, name: str) -> None:
    assert client.get(f"/api/v1/recordings?{name}=%ED%A0%80").status_code < 500


def test_a_body_of_json_that_is_too_large_is_still_refused(
    client: TestClient, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(guard, "DRAIN_LIMIT_S", 0.1)  # the test client sends no more, and does not hang up
    assert settings.max_upload_bytes < 9 << 20

    answer = client.post("/api/v1/batches", content=b" " * (9 << 20), headers=JSON)

    assert (answer.status_code, answer.json()["code"]) == (413, "E-BIG")
