"""A value that cannot be is refused with what would have been right."""

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
        ("/analyze?rate_hz=1e9", "x", "1 … 10000"),
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
