"""A value that cannot be is refused with what would have been right."""

from typing import Any

import pytest
from fastapi.testclient import TestClient

API = "/api/v1"
ANALYZE = (
    "side, subject, method, pose, lang, paper, calibration, pose_held, axis, slip_at, no_slip_at, rate_hz, "
    "sensor, study, file_name, external_id, again"
)


@pytest.mark.parametrize(
    ("address", "allowed"),
    [
        ("/analyses/an_1?wait=abc", "0 … 60"),
        ("/analyses/an_1?wait=61", "0 … 60"),
        ("/analyses/an_1?wait=nan", "0 … 60"),
        ("/analyses?limit=x", "1 … 500"),
        ("/analyses?limit=0", "1 … 500"),
        ("/analyses?state=done", "queued, running, succeeded, failed, cancelled"),
        ("/analyses?sate=queued", "state, batch_id, recording_id, limit, cursor"),
        ("/analyses/an_1/report.pdf?lang=it", "en, fr"),
        ("/recordings/rec_1/inspection?rate_hz=abc", "1 … 10000"),
        ("/recordings?trashed=perhaps", "true, false"),
    ],
)
def test_a_question_with_a_value_that_cannot_be(client: TestClient, address: str, allowed: str) -> None:
    problem = client.get(API + address).json()

    assert (problem["code"], problem["status"]) == ("E-PARAMETER", 422)
    assert f"allowed: {allowed}" in problem["detail"]


@pytest.mark.parametrize(
    ("query", "allowed"),
    [
        ("rate_hz=abc", "1 … 10000"),
        ("rate_hz=0", "1 … 10000"),
        ("rate_hz=1e9", "1 … 10000"),
        ("again=x", "true, false"),
        ("side=up", "left, right"),
        ("sied=left", ANALYZE),
    ],
)
def test_a_recording_with_a_wish_that_cannot_be(client: TestClient, query: str, allowed: str) -> None:
    problem = client.post(f"{API}/analyze?{query}", content=b"x").json()

    assert problem["code"] == "E-PARAMETER"
    assert f"allowed: {allowed}" in problem["detail"]


@pytest.mark.parametrize(
    ("route", "body", "allowed"),
    [
        ("/analyses", {"recording_ids": "rec_1"}, '["…"]'),
        ("/analyses", {"recording_ids": ["rec_1"], "agian": True}, "recording_ids, settings, again"),
        ("/analyses", {"recording_ids": ["r"], "settings": {"rate_hz": "abc"}}, "1 … 10000"),
        ("/batches", {"items": [{"recording_id": 3}]}, '"…"'),
        ("/batches", {"items": 3}, "[recording_id, settings]"),
        ("/recordings", {"upload_id": "u", "sied": "left"}, "file_name, subject, side, external_id"),
    ],
)
def test_a_body_with_a_value_that_cannot_be(
    client: TestClient, route: str, body: dict[str, Any], allowed: str
) -> None:
    problem = client.post(API + route, json=body).json()

    assert problem["code"] == "E-PARAMETER"
    assert f"allowed: {allowed}" in problem["detail"]


def test_a_body_that_is_no_json(client: TestClient) -> None:
    answer = client.post(f"{API}/batches", content=b"{", headers={"content-type": "application/json"})

    assert "allowed: JSON" in answer.json()["detail"]
