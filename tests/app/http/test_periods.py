"""``PUT /recordings/{id}/periods``: what cannot be on the day of the recording is refused by its row."""

from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

URL = "/api/v1/recordings"
OUTSIDE = {"start_s": 100_000, "end_s": 100_060, "kind": "task"}
REVERSED = {"start_s": 60, "end_s": 30, "kind": "task"}
INSIDE = {"start_s": 0, "end_s": 45, "kind": "task"}


@pytest.fixture
def address(shared: TestClient, shift_gt3x: Path) -> str:
    """The periods of a recording of six minutes, empty."""
    kept = shared.post(URL, content=shift_gt3x.read_bytes()).json()
    shared.put(f"{URL}/{kept['id']}/periods", json=[])
    return f"{URL}/{kept['id']}/periods"


@pytest.mark.parametrize(
    ("periods", "line", "why"),
    [
        ([INSIDE, REVERSED], 3, "before it begins"),
        ([OUTSIDE], 2, "outside of"),
        ([INSIDE, OUTSIDE], 3, "outside of"),
        ([INSIDE, INSIDE | {"start_s": 10}], 3, "overlap"),
    ],
)
def test_periods_that_cannot_be_are_refused_with_their_row(
    shared: TestClient, address: str, periods: list[dict[str, Any]], line: int, why: str
) -> None:
    answer = shared.put(address, json=periods)

    problem = answer.json()
    assert (answer.status_code, problem["code"], problem["where"]) == (422, "E-DIARY", {"line": line})
    assert why in problem["detail"]


@pytest.mark.parametrize(
    ("row", "value"),
    [({"start": 600}, "600"), ({"start": "07:00", "end": 10.2}, "10.2")],
    ids=["start", "end"],
)
def test_a_number_that_does_not_say_seconds_is_refused(
    shared: TestClient, address: str, row: dict[str, Any], value: str
) -> None:
    problem = shared.put(address, json=[INSIDE, row | {"kind": "break"}]).json()

    assert (problem["code"], problem["where"]) == ("E-DIARY", {"line": 3})
    assert f'"{value}"' in problem["detail"]
    assert "start_s" in problem["fix"]


@pytest.mark.parametrize("start", ["07:02", "07.02", "07,02", "0702", "7h02", "7 h 02"])
def test_a_clock_time_is_stored_alike_in_every_spelling(shared: TestClient, address: str, start: str) -> None:
    answer = shared.put(address, json=[{"start": start, "end": "0704", "kind": "break"}])

    assert [(row["start"], row["end"]) for row in answer.json()] == [("07:02:00", "07:04:00")]


def test_a_time_without_its_row_s_start_is_refused(shared: TestClient, address: str) -> None:
    assert shared.put(address, json=[{"end_s": 30, "kind": "task"}]).json()["code"] == "E-DIARY"


def test_what_is_refused_changes_nothing(shared: TestClient, address: str) -> None:
    shared.put(address, json=[INSIDE])

    shared.put(address, json=[REVERSED])

    assert [row["end_s"] for row in shared.get(address).json()] == [45.0]


def test_what_reaches_past_the_recording_is_taken_and_cut_later(shared: TestClient, address: str) -> None:
    assert shared.put(address, json=[INSIDE | {"end_s": 4000}]).status_code == 200


def test_rows_of_a_recording_that_cannot_be_read_yet_are_compared_with_one_another(
    shared: TestClient,
) -> None:
    address = f"{URL}/{shared.post(URL, content=b'no recording').json()['id']}/periods"

    assert shared.put(address, json=[REVERSED]).status_code == 422
    assert shared.put(address, json=[INSIDE]).status_code == 200


def test_periods_of_one_analysis_are_checked_when_it_is_asked_for(shared: TestClient, address: str) -> None:
    recording_id = address.split("/")[4]
    wish = {"recording_ids": [recording_id], "settings": {"periods": [REVERSED]}}

    assert shared.post("/api/v1/analyses", json=wish).json()["code"] == "E-DIARY"
