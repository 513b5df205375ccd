"""Values of a request: text that cannot be kept, secrets, and what would have been right."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

from acromion.app.http.middleware import guard

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


# What a request holds in a field of a secret's name is never in the answer.


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


# A value that cannot be is refused with what would have been right.


API = "/api/v1"
ANALYZE = (
    "side, subject, job_title, isco_code, method, pose, lang, paper, appendix, calibration, pose_held, axis, "
    "slip_at, no_slip_at, shift, rate_hz, time_zone, clock_offset, sensor, date_order, study, file_name, "
    "external_id, again"
)


@pytest.mark.parametrize(
    ("address", "allowed"),
    [
        ("/analyses/an_1?wait=61", "0 … 60"),
        ("/analyses/an_1?wait=nan", "0 … 60"),
        ("/analyses?limit=0", "1 … 500"),
        ("/analyses?state=done", "queued, running, succeeded, failed, cancelled"),
        ("/analyses?sate=queued", "state, batch_id, recording_id, limit, cursor"),
        ("/analyses/an_1/report.pdf?lang=it", "en, fr"),
        ("/recordings/rec_1/inspection?rate_hz=abc", "1 … 10000"),
        ("/recordings?trashed=perhaps", "true, false"),
    ],
)
def test_a_question_with_a_value_that_cannot_be(shared: TestClient, address: str, allowed: str) -> None:
    problem = shared.get(API + address).json()

    assert (problem["code"], problem["status"]) == ("E-PARAMETER", 422)
    assert f"allowed: {allowed}" in problem["detail"]


@pytest.mark.parametrize(
    ("route", "body", "allowed"),
    [
        ("/analyze?rate_hz=abc", "x", "1 … 10000"),
        ("/analyze?rate_hz=0", "x", "1 … 10000"),
        ("/analyze?again=x", "x", "true, false"),
        ("/analyze?side=up", "x", "left, right"),
        ("/analyze?sied=left", "x", ANALYZE),
        ("/analyses", '{"recording_ids": "rec_1"}', '["…"]'),
        ("/analyses", '{"recording_ids": ["rec_1"], "agian": true}', "recording_ids, settings, again"),
        ("/analyses", '{"recording_ids": ["r"], "settings": {"rate_hz": "abc"}}', "1 … 10000"),
        ("/batches", '{"items": [{"recording_id": 3}]}', '"…"'),
        ("/batches", '{"items": 3}', "[recording_id, settings]"),
        ("/recordings", '{"upload_id": "u", "sied": "left"}', "file_name, subject, side, external_id"),
        ("/batches", "{", "JSON"),
    ],
)
def test_a_wish_with_a_value_that_cannot_be(shared: TestClient, route: str, body: str, allowed: str) -> None:
    problem = shared.post(API + route, content=body, headers={"content-type": "application/json"}).json()

    assert problem["code"] == "E-PARAMETER"
    assert f"allowed: {allowed}" in problem["detail"]
