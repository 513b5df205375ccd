"""``/api/v1/batches``: many recordings, one set of settings, one table."""

import csv
import io
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import delete

from app.jobs.database.tables import batch_items
from app.jobs.store import JobStore
from app.jobs.worker import run_next
from tests.app import stand_ins
from tests.app.conftest import OpenBench

URL = "/api/v1/batches"


def keep(client: TestClient, k: int) -> str:
    answer = client.post("/api/v1/recordings", content=bytes([k]), params={"file_name": f"{k}.csv"})
    return str(answer.json()["id"])


def start(client: TestClient, count: int = 2, first: int = 0, **wish: Any) -> dict[str, Any]:
    items = [{"recording_id": keep(client, first + k)} for k in range(count)]
    answer = client.post(URL, json={"name": "spring", "items": items} | wish)
    assert answer.status_code == 202, answer.text
    batch: dict[str, Any] = answer.json()
    return batch


def read(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_a_batch_counts_its_analyses_by_state_and_gives_no_half_a_table(
    client: TestClient, bench: OpenBench
) -> None:
    batch = start(client, 3)
    run_next(bench(stand_ins.refuse))

    seen = client.get(batch["links"]["self"]).json()
    table = client.get(batch["links"]["summary_csv"])

    assert (seen["name"], seen["item_count"], seen["is_over"]) == ("spring", 3, False)
    assert seen["counts"] == {"queued": 2, "running": 0, "succeeded": 0, "failed": 1, "cancelled": 0}
    assert (table.status_code, table.json()["code"]) == (409, "E-NOT-FINISHED")
    assert table.headers["retry-after"] == "5"


def test_the_settings_of_an_item_win_over_those_of_the_batch(client: TestClient, store: JobStore) -> None:
    items = [
        {"recording_id": keep(client, 0)},
        {"recording_id": keep(client, 1), "settings": {"side": "left"}},
    ]
    client.post(URL, json={"items": items, "settings": {"side": "right", "method": "live"}})

    requests = {job.file_name: job.request for job in store.find_newest()}
    assert (requests["0.csv"].side, requests["1.csv"].side) == ("right", "left")
    assert requests["1.csv"].method == "live"


@pytest.mark.parametrize(
    ("wrong", "code", "told"),
    [
        ({"settings": {"side": "up"}}, "E-PARAMETER", "side"),
        ({"settings": {"sied": "left"}}, "E-PARAMETER", "sied"),
        ({"settings": {"calibration": ["5,1"]}}, "E-PARAMETER", "calibration"),
        ({"recording_id": "rec_none"}, "E-NOT-FOUND", "rec_none"),
    ],
)
def test_of_items_of_which_one_cannot_be_none_is_started(
    client: TestClient, store: JobStore, wrong: dict[str, Any], code: str, told: str
) -> None:
    whole = {"recording_id": keep(client, 0)}

    problem = client.post(URL, json={"items": [whole, whole | wrong]}).json()

    assert (problem["code"], told in problem["detail"]) == (code, True)
    assert store.find_newest() == ()


def test_failed_recordings_stand_in_both_tables(client: TestClient, bench: OpenBench) -> None:
    links = start(client, 2)["links"]
    worker = bench(stand_ins.refuse)
    run_next(worker)
    run_next(worker)

    summary = read(client.get(links["summary_csv"]).text)
    problems = read(client.get(links["problems_csv"], headers={"accept-language": "fr"}).text)

    assert [(row["file_name"], row["error_code"]) for row in summary] == [
        ("0.csv", "E-SHORT"),
        ("1.csv", "E-SHORT"),
    ]
    assert [row["code"] for row in problems] == ["E-SHORT", "E-SHORT"]
    assert problems[0]["title"] == "Trop court"


def test_failed_ones_can_be_tried_again_and_count_once(client: TestClient, bench: OpenBench) -> None:
    links = start(client, 2)["links"]
    worker = bench(stand_ins.refuse)
    run_next(worker)
    run_next(worker)

    counts = client.post(links["retry_failed"]).json()["counts"]

    assert (counts["queued"], counts["failed"]) == (2, 0)
    assert client.post(links["retry_failed"]).json()["counts"]["queued"] == 2


def test_batches_take_turns(client: TestClient, store: JobStore) -> None:
    first, second = start(client, 3)["id"], start(client, 3, first=3)["id"]

    order = []
    while job := store.claim():
        order.append(job.batch_id)

    assert order == [first, second] * 3


def test_a_single_request_waits_for_one_round_only(client: TestClient, store: JobStore) -> None:
    start(client, 50)
    single = client.post("/api/v1/analyze", content=b"single").json()["id"]

    first_two = [store.claim() for _ in range(2)]

    assert single in [job.id for job in first_two if job]


def test_a_batch_that_is_not_there_is_not_found(shared: TestClient) -> None:
    assert shared.get(f"{URL}/ba_none").status_code == 404
    assert shared.get(f"{URL}/ba_none/summary.csv").status_code == 404


def test_the_same_item_twice_is_analysed_once(client: TestClient, bench: OpenBench) -> None:
    one, other = {"recording_id": keep(client, 0)}, {"recording_id": keep(client, 1)}
    batch = client.post(URL, json={"items": [one, other, one]}).json()
    worker = bench(stand_ins.refuse)
    while run_next(worker):
        pass

    rows = read(client.get(batch["links"]["summary_csv"]).text)

    assert (batch["item_count"], batch["duplicate_count"], batch["counts"]["queued"]) == (2, 1, 2)
    assert [row["file_name"] for row in rows] == ["0.csv", "1.csv"]


def test_what_was_analysed_before_is_taken_as_it_is_unless_asked_for_anew(
    client: TestClient, bench: OpenBench
) -> None:
    items = [{"recording_id": keep(client, 0)}]
    client.post(URL, json={"items": items})
    run_next(bench(stand_ins.write_report))

    again = client.post(URL, json={"items": items, "name": "another"}).json()
    anew = client.post(URL, json={"items": items, "again": True}).json()

    assert (again["is_over"], again["duplicate_count"], again["counts"]["succeeded"]) == (True, 1, 1)
    listed = client.get(again["links"]["analyses"]).json()["items"]
    assert [analysis["recording_id"] for analysis in listed] == [items[0]["recording_id"]]
    assert (anew["duplicate_count"], anew["counts"]["queued"]) == (0, 1)


def test_the_same_batch_again_is_the_batch_that_there_is(client: TestClient, store: JobStore) -> None:
    items = [{"recording_id": keep(client, k)} for k in range(2)]
    wish = {"name": "May", "items": items}

    first = client.post(URL, json=wish).json()
    others = (
        wish | {"name": "June"},
        wish | {"items": items[::-1]},
        wish | {"settings": {"side": "left"}},
        wish | {"again": True},
    )

    assert client.post(URL, json=wish).json()["id"] == first["id"]
    assert first["id"] not in {client.post(URL, json=other).json()["id"] for other in others}


def test_a_batch_that_lost_an_analysis_is_made_again(client: TestClient, store: JobStore) -> None:
    wish = {"items": [{"recording_id": keep(client, k)} for k in range(2)]}
    first = client.post(URL, json=wish).json()
    store.run(delete(batch_items).where(batch_items.c.place == 1))

    again = client.post(URL, json=wish).json()

    assert (again["id"] != first["id"], again["item_count"]) == (True, 2)


def test_a_repetition_takes_its_place_in_every_batch_that_asked(client: TestClient, bench: OpenBench) -> None:
    items = [{"recording_id": keep(client, 0)}]
    first, second = (client.post(URL, json={"items": items, "name": name}).json() for name in "ab")
    run_next(bench(stand_ins.refuse))

    client.post(first["links"]["retry_failed"])
    run_next(bench(stand_ins.write_report))

    assert client.get(second["links"]["self"]).json()["counts"]["succeeded"] == 1
