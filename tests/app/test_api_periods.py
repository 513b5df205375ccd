"""``PUT /recordings/{id}/periods``: what cannot be on the day of the recording is refused by its row."""

from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

URL = "/api/v1/recordings"
OUTSIDE = {"start": 100_000, "end": 100_060, "kind": "task"}
REVERSED = {"start": 60, "end": 30, "kind": "task"}
INSIDE = {"start": 0, "end": 45, "kind": "task"}


@pytest.fixture
def address(client: TestClient, shift_gt3x: Path) -> str:
    """The periods of a recording of six minutes."""
    kept = client.post(URL, content=shift_gt3x.read_bytes()).json()
    return f"{URL}/{kept['id']}/periods"


@pytest.mark.parametrize(
    ("periods", "line", "why"),
    [
        ([INSIDE, REVERSED], 3, "before it begins"),
        ([OUTSIDE], 2, "outside of"),
        ([INSIDE, OUTSIDE], 3, "outside of"),
        ([INSIDE, INSIDE | {"start": 10}], 3, "overlap"),
    ],
)
def test_periods_that_cannot_be_are_refused_with_their_row(
    client: TestClient, address: str, periods: list[dict[str, Any]], line: int, why: str
) -> None:
    answer = client.put(address, json=periods)

    problem = answer.json()
    assert (answer.status_code, problem["code"], problem["where"]) == (422, "E-DIARY", {"line": line})
    assert why in problem["detail"]


def test_a_diary_file_is_checked_like_rows(client: TestClient, address: str) -> None:
    answer = client.put(
        address, content=b"start,end,kind\n60,30,task\n", headers={"content-type": "text/csv"}
    )

    assert answer.json()["code"] == "E-DIARY"


def test_what_is_refused_changes_nothing(client: TestClient, address: str) -> None:
    client.put(address, json=[INSIDE])

    client.put(address, json=[REVERSED])

    assert [row["end"] for row in client.get(address).json()] == [45.0]


def test_what_reaches_past_the_recording_is_taken_and_cut_later(client: TestClient, address: str) -> None:
    assert client.put(address, json=[INSIDE | {"end": 4000}]).status_code == 200


def test_rows_of_a_recording_that_cannot_be_read_yet_are_compared_with_one_another(
    client: TestClient,
) -> None:
    address = f"{URL}/{client.post(URL, content=b'no recording').json()['id']}/periods"

    assert client.put(address, json=[REVERSED]).status_code == 422
    assert client.put(address, json=[INSIDE]).status_code == 200


def test_periods_of_one_analysis_are_checked_when_it_is_asked_for(client: TestClient, address: str) -> None:
    recording_id = address.split("/")[4]
    wish = {"recording_ids": [recording_id], "settings": {"periods": [REVERSED]}}

    assert client.post("/api/v1/analyses", json=wish).json()["code"] == "E-DIARY"
