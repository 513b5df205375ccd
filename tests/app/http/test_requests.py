"""Analyses of stored recordings: their settings, doubles, retries, and progress as it happens."""

import csv
import io
import json
import threading
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from sqlalchemy import delete

from acromion.app.analysis.attempt import load_and_make_report
from acromion.app.library.database.tables import batch_items
from acromion.app.library.jobs import JobStore
from acromion.app.queue.worker import run_next
from acromion.app.settings import Settings
from tests.app import stand_ins
from tests.app.conftest import OpenWorker, serving

URL = "/api/v1/analyses"


def keep(client: TestClient, content: bytes = b"recording", **words: str) -> str:
    return str(client.post("/api/v1/recordings", content=content, params=words).json()["id"])


def ask(client: TestClient, *recordings: str, **wish: Any) -> dict[str, Any]:
    answer = client.post(URL, json={"recording_ids": recordings, **wish})
    assert answer.status_code in (200, 202), answer.text
    view: dict[str, Any] = answer.json()
    return view


def test_a_stored_recording_can_be_analysed(client: TestClient) -> None:
    recording = keep(client)

    answer = client.post(URL, json={"recording_ids": [recording]})

    assert answer.status_code == 202
    assert answer.headers["location"] == f"{URL}/{answer.json()['id']}"
    assert answer.json()["recording_id"] == recording


def test_the_analysis_knows_what_the_recording_says(client: TestClient, store: JobStore) -> None:
    recording = keep(client, file_name="a.csv", subject="S1", side="left")
    client.put(f"/api/v1/recordings/{recording}/periods", json=[{"start_s": 0, "end_s": 9, "kind": "task"}])

    job = ask(client, recording, settings={"reason": "the strap had slipped"})

    request = store.get(job["id"]).request
    assert (request.file_name, request.subject, request.side) == ("a.csv", "S1", "left")
    assert (request.diary[0].end, request.reason) == (9, "the strap had slipped")


@pytest.mark.parametrize("other", [{"settings": {"method": "live"}}, {"again": True}])
def test_another_setting_and_asking_again_on_purpose_make_another_analysis(
    client: TestClient, other: dict[str, Any]
) -> None:
    recording = keep(client)

    assert ask(client, recording)["id"] != ask(client, recording, **other)["id"]


def test_settings_win_over_what_the_recording_says(client: TestClient, store: JobStore) -> None:
    recording = keep(client, subject="S1", side="left")
    settings = {
        "side": "right",
        "method": "published",
        "pose": "two-point",
        "calibration": ["1,2", "3,4"],
        "lang": "fr",
        "rate_hz": 100,
        "source": "samples",
        "periods": [{"start_s": 5, "end_s": 6, "kind": "break"}],
    }

    request = store.get(ask(client, recording, settings=settings)["id"]).request

    assert (request.side, request.subject, request.method) == ("right", "S1", "published")
    assert request.calibration_windows_s == ((1.0, 2.0), (3.0, 4.0))
    assert (request.languages[0], request.rate_hz, request.diary[0].kind) == ("fr", 100.0, "break")


@pytest.mark.parametrize(
    "wished",
    [
        {"method": "magic"},
        {"calibration": ["2,1"]},
        {"sied": "left"},
        {"pose": "two-point"},
        {"periods": [{"start": "x"}]},
    ],
)
def test_settings_that_cannot_be_are_refused(shared: TestClient, wished: dict[str, Any]) -> None:
    answer = shared.post(URL, json={"recording_ids": [keep(shared)], "settings": wished})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER")


def test_the_same_question_twice_gives_the_same_analysis(client: TestClient, open_worker: OpenWorker) -> None:
    recording = keep(client)
    first = ask(client, recording)
    run_next(open_worker(stand_ins.write_report))

    answer = client.post(URL, json={"recording_ids": [recording]})

    assert (answer.status_code, answer.json()["id"]) == (200, first["id"])
    assert answer.json()["duplicate_of"] == first["id"]


def test_the_same_file_sent_twice_gives_the_same_analysis(client: TestClient, settings: Settings) -> None:
    first = client.post("/api/v1/analyze", content=b"x").json()

    second = client.post("/api/v1/analyze", content=b"x")

    assert (second.status_code, second.json()["id"]) == (202, first["id"])
    assert second.json()["duplicate_of"] == first["id"]
    assert len([path for path in (settings.data_dir / "recordings").iterdir() if not path.suffix]) == 1


def test_the_paper_and_appendix_asked_for_go_before_the_server_s(settings: Settings) -> None:
    wish = {"paper": "a4", "appendix": False}
    with serving(settings, paper="letter", appendix=True) as client:
        recording = keep(client)

        views = [ask(client, recording), ask(client, recording, settings=wish)]
        batch = {"items": [{"recording_id": recording}], "settings": wish}
        batched = client.post("/api/v1/batches", json=batch).json()["links"]["analyses"]

        views.append(client.get(batched).json()["items"][0])
        told = [(view["settings"]["paper"], view["settings"]["appendix"]) for view in views]
        assert told == [("letter", True), ("a4", False), ("a4", False)]


def test_another_paper_language_or_appendix_is_the_same_version(client: TestClient, store: JobStore) -> None:
    recording = keep(client)
    ask(client, recording, settings={"lang": "en"})

    wishes: tuple[dict[str, object], ...] = ({"paper": "letter"}, {"lang": "fr"}, {"appendix": True})
    told = [ask(client, recording, settings=wish)["id"] for wish in wishes]

    assert [store.get(job).request.version for job in told] == [1, 1, 1]


def test_a_failed_analysis_can_be_tried_again_once(client: TestClient, open_worker: OpenWorker) -> None:
    recording = keep(client)
    first = ask(client, recording)
    run_next(open_worker(stand_ins.refuse))

    again = client.post(f"{URL}/{first['id']}/retry")
    asked = ask(client, recording)  # a failed analysis answers no question

    assert (again.status_code, again.json()["state"]) == (202, "queued")
    assert client.post(f"{URL}/{first['id']}/retry").json()["id"] == again.json()["id"]
    assert asked["id"] == again.json()["id"]
    assert client.get(f"{URL}/{first['id']}").json()["replaced_by"] == again.json()["id"]


def test_an_analysis_that_succeeded_is_not_tried_again(client: TestClient, open_worker: OpenWorker) -> None:
    first = ask(client, keep(client))
    run_next(open_worker(stand_ins.write_report))

    again = client.post(f"{URL}/{first['id']}/retry")

    assert (again.status_code, again.json()["id"]) == (200, first["id"])


def test_analyses_are_found_by_state_and_recording(client: TestClient, open_worker: OpenWorker) -> None:
    recordings = [keep(client, bytes([k])) for k in range(3)]
    first, second, _ = ask(client, *recordings)["items"]
    run_next(open_worker(stand_ins.write_report))

    def found(**filters: str) -> list[str]:
        return [item["id"] for item in client.get(URL, params=filters).json()["items"]]

    assert found(state="succeeded") == [first["id"]]
    assert found(recording_id=recordings[1]) == [second["id"]]


def test_a_full_queue_refuses_more(settings: Settings) -> None:
    with serving(settings, max_queued=1) as client:
        client.post("/api/v1/analyze", content=b"x")

        answer = client.post("/api/v1/analyze", content=b"y")

    assert (answer.status_code, answer.json()["code"]) == (503, "E-BUSY")
    assert answer.headers["retry-after"] == "5"


def test_more_uploads_at_once_than_are_taken_are_told_to_come_again(settings: Settings) -> None:
    tus = {"tus-resumable": "1.0.0"}
    piece = tus | {"upload-offset": "0", "content-type": "application/offset+octet-stream"}
    with serving(settings, max_uploads_at_once=0) as client:
        begun = client.post("/api/v1/uploads", headers=tus | {"upload-length": "3"}).headers["location"]
        answers = [client.post(f"/api/v1/{place}", content=b"x") for place in ("analyze", "recordings")]
        answers.append(client.patch(begun, content=b"abc", headers=piece))

        assert client.get("/api/v1/recordings").json()["items"] == []
        assert client.head(begun, headers=tus).headers["upload-offset"] == "0"

    told = [(one.status_code, one.json()["code"], one.headers["retry-after"]) for one in answers]
    assert told == [(429, "E-TOO-MANY", "5")] * 3


def test_the_turn_of_an_upload_that_ended_badly_is_free_again(settings: Settings) -> None:
    with serving(settings, max_uploads_at_once=1) as client:
        client.post("/api/v1/analyze", content=b"")

        assert client.post("/api/v1/analyze", content=b"x").status_code == 202


def test_of_several_recordings_none_is_analysed_where_one_is_not_there(
    client: TestClient, store: JobStore
) -> None:
    wish = {"recording_ids": [keep(client), "rec_none"]}

    refused = client.post(URL, json=wish)

    assert (refused.status_code, "rec_none" in refused.json()["detail"]) == (404, True)
    assert store.find_newest() == ()


def test_a_person_goes_before_a_hundred_scripts(client: TestClient, store: JobStore) -> None:
    for k in range(100):
        client.post("/api/v1/analyze", content=bytes([k]))
    origin = {"origin": "http://localhost:8080"}

    person = client.post("/api/v1/analyze", content=b"person", headers=origin).json()

    claimed = store.claim()
    assert claimed is not None
    assert claimed.id == person["id"]


def test_progress_is_told_as_events_until_the_end(client: TestClient, open_worker: OpenWorker) -> None:
    analysis = ask(client, keep(client))
    worker = threading.Timer(0.5, run_next, (open_worker(stand_ins.write_report),))
    worker.start()

    with client.stream("GET", analysis["links"]["events"]) as stream:
        lines = [line for line in stream.iter_lines() if line.startswith("data: ")]

    worker.join()
    states = [json.loads(line[6:])["state"] for line in lines]
    assert (states[0], states[-1]) == ("queued", "succeeded")


# ``/api/v1/batches``: many recordings, one set of settings, one table.


BATCHES = "/api/v1/batches"


def keep_number(client: TestClient, k: int) -> str:
    answer = client.post("/api/v1/recordings", content=bytes([k]), params={"file_name": f"{k}.csv"})
    return str(answer.json()["id"])


def start(client: TestClient, count: int = 2, first: int = 0, **wish: Any) -> dict[str, Any]:
    items = [{"recording_id": keep_number(client, first + k)} for k in range(count)]
    answer = client.post(BATCHES, json={"name": "spring", "items": items} | wish)
    assert answer.status_code == 202, answer.text
    batch: dict[str, Any] = answer.json()
    return batch


def read(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def test_a_batch_counts_its_analyses_by_state_and_gives_no_half_a_table(
    client: TestClient, open_worker: OpenWorker
) -> None:
    batch = start(client, 3)
    run_next(open_worker(stand_ins.refuse))

    seen = client.get(batch["links"]["self"]).json()
    table = client.get(batch["links"]["summary_csv"])

    assert (seen["name"], seen["item_count"], seen["is_over"]) == ("spring", 3, False)
    assert seen["counts"] == {"queued": 2, "running": 0, "succeeded": 0, "failed": 1, "cancelled": 0}
    assert (table.status_code, table.json()["code"]) == (409, "E-NOT-FINISHED")
    assert table.headers["retry-after"] == "5"


def test_the_settings_of_an_item_win_over_those_of_the_batch(client: TestClient, store: JobStore) -> None:
    items = [
        {"recording_id": keep_number(client, 0)},
        {"recording_id": keep_number(client, 1), "settings": {"side": "left"}},
    ]
    client.post(BATCHES, json={"items": items, "settings": {"side": "right", "method": "live"}})

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
    whole = {"recording_id": keep_number(client, 0)}

    problem = client.post(BATCHES, json={"items": [whole, whole | wrong]}).json()

    assert (problem["code"], told in problem["detail"]) == (code, True)
    assert store.find_newest() == ()


def test_failed_recordings_stand_in_both_tables(client: TestClient, open_worker: OpenWorker) -> None:
    links = start(client, 2)["links"]
    worker = open_worker(stand_ins.refuse)
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


def test_failed_ones_can_be_tried_again_and_count_once(client: TestClient, open_worker: OpenWorker) -> None:
    links = start(client, 2)["links"]
    worker = open_worker(stand_ins.refuse)
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


def test_the_same_item_twice_is_analysed_once(client: TestClient, open_worker: OpenWorker) -> None:
    one, other = {"recording_id": keep_number(client, 0)}, {"recording_id": keep_number(client, 1)}
    batch = client.post(BATCHES, json={"items": [one, other, one]}).json()
    worker = open_worker(stand_ins.refuse)
    while run_next(worker):
        pass

    rows = read(client.get(batch["links"]["summary_csv"]).text)

    assert (batch["item_count"], batch["duplicate_count"], batch["counts"]["queued"]) == (2, 1, 2)
    assert [row["file_name"] for row in rows] == ["0.csv", "1.csv"]


def test_what_was_analysed_before_is_taken_as_it_is_unless_asked_for_anew(
    client: TestClient, open_worker: OpenWorker
) -> None:
    items = [{"recording_id": keep_number(client, 0)}]
    client.post(BATCHES, json={"items": items})
    run_next(open_worker(stand_ins.write_report))

    again = client.post(BATCHES, json={"items": items, "name": "another"}).json()
    anew = client.post(BATCHES, json={"items": items, "again": True}).json()

    assert (again["is_over"], again["duplicate_count"], again["counts"]["succeeded"]) == (True, 1, 1)
    listed = client.get(again["links"]["analyses"]).json()["items"]
    assert [analysis["recording_id"] for analysis in listed] == [items[0]["recording_id"]]
    assert (anew["duplicate_count"], anew["counts"]["queued"]) == (0, 1)


def test_the_same_batch_again_is_the_batch_that_there_is(client: TestClient, store: JobStore) -> None:
    items = [{"recording_id": keep_number(client, k)} for k in range(2)]
    wish = {"name": "May", "items": items}

    first = client.post(BATCHES, json=wish).json()
    others = (
        wish | {"name": "June"},
        wish | {"items": items[::-1]},
        wish | {"settings": {"side": "left"}},
        wish | {"again": True},
    )

    assert client.post(BATCHES, json=wish).json()["id"] == first["id"]
    assert first["id"] not in {client.post(BATCHES, json=other).json()["id"] for other in others}


def test_a_batch_that_lost_an_analysis_is_made_again(client: TestClient, store: JobStore) -> None:
    wish = {"items": [{"recording_id": keep_number(client, k)} for k in range(2)]}
    first = client.post(BATCHES, json=wish).json()
    store.run(delete(batch_items).where(batch_items.c.place == 1))

    again = client.post(BATCHES, json=wish).json()

    assert (again["id"] != first["id"], again["item_count"]) == (True, 2)


def test_a_repetition_takes_its_place_in_every_batch_that_asked(
    client: TestClient, open_worker: OpenWorker
) -> None:
    items = [{"recording_id": keep_number(client, 0)}]
    first, second = (client.post(BATCHES, json={"items": items, "name": name}).json() for name in "ab")
    run_next(open_worker(stand_ins.refuse))

    client.post(first["links"]["retry_failed"])
    run_next(open_worker(stand_ins.write_report))

    assert client.get(second["links"]["self"]).json()["counts"]["succeeded"] == 1


def test_each_shift_of_a_recording_has_its_own_versions(client: TestClient, store: JobStore) -> None:
    recording = keep(client)
    monday, tuesday = (f"2026-03-0{day}T07:00/2026-03-0{day}T15:30" for day in (2, 3))
    wishes: tuple[dict[str, object], ...] = (
        {"shift": monday},
        {"shift": tuesday},
        {"shift": tuesday, "method": "live"},
    )

    views = [ask(client, recording, settings=wish) for wish in wishes]

    versions = [store.get(view["id"]).request.version for view in views]
    assert versions == [1, 1, 2]
    assert views[1]["settings"]["shift"] == "2026-03-03T07:00:00/2026-03-03T15:30:00"


def test_the_hours_of_a_shift_are_analysed_and_nothing_else(
    client: TestClient, open_worker: OpenWorker, shift_gt3x: Path
) -> None:
    wish = {"file_name": "week.gt3x", "shift": "2026-03-02T07:01/2026-03-02T07:05"}
    job = client.post("/api/v1/analyze", params=wish, content=shift_gt3x.read_bytes()).json()
    run_next(open_worker(load_and_make_report))

    results = client.get(f"/api/v1/analyses/{job['id']}/results.json").json()

    recording = results["recording"]
    assert (recording["start"][:19], recording["duration_s"]) == ("2026-03-02T07:01:00", 240.0)
    assert recording["shift"] == "2026-03-02T07:01:00/2026-03-02T07:05:00"


def start_shifts(client: TestClient, shift_gt3x: Path, shift: str, **asked: Any) -> Any:
    """Ask for the shifts of six minutes from 07:00 on 2 March."""
    recording = keep(client, shift_gt3x.read_bytes(), file_name="week.gt3x")
    not_removed = asked.pop("not_removed", False)
    wish = {"recording_ids": [recording], "settings": {"shift": shift, **asked}, "not_removed": not_removed}
    return client.post(URL, json=wish)


def test_hours_of_each_day_give_an_analysis_of_each_shift(client: TestClient, shift_gt3x: Path) -> None:
    items = start_shifts(client, shift_gt3x, "07:01-07:05").json()["items"]

    shifts = [item["settings"]["shift"] for item in items]
    assert shifts == ["2026-03-02T07:01:00-05:00/2026-03-02T07:05:00-05:00"]


def test_the_shifts_of_a_diary_are_analysed_separately_and_a_confirmed_pose_is_carried(
    client: TestClient, store: JobStore, shift_gt3x: Path
) -> None:
    rows = [
        {"start": f"2026-03-02T07:0{a}:00", "end": f"2026-03-02T07:0{b}:00", "kind": "shift"}
        for a, b in ((0, 2), (3, 5))
    ]
    asked = {"periods": rows, "calibration": ["5,15"], "not_removed": True}

    items = start_shifts(client, shift_gt3x, "diary", **asked).json()["items"]

    first, second = (store.get(item["id"]).request for item in items)
    assert (first.shift[11:19], second.shift[11:19]) == ("07:00:00", "07:03:00")
    assert (first.pose_from, second.pose_from) == ("", first.shift)


def test_a_shift_of_a_diary_at_a_time_that_the_clocks_skip_is_refused(
    client: TestClient, shift_gt3x: Path
) -> None:
    rows = [{"start": "2026-03-29T02:30:00", "end": "2026-03-29T08:00:00", "kind": "shift"}]

    refused = start_shifts(client, shift_gt3x, "diary", periods=rows, time_zone="Europe/Paris")

    assert (refused.status_code, refused.json()["code"]) == (422, "E-DIARY")
    assert "never show this time" in refused.json()["detail"]


def test_only_one_recording_is_cut_at_a_time(client: TestClient) -> None:
    recordings = [keep_number(client, 0), keep_number(client, 1)]
    settings = {"shift": "07:00-15:30"}
    items = [{"recording_id": one} for one in recordings]

    refused = [
        client.post(URL, json={"recording_ids": recordings, "settings": settings}),
        client.post(BATCHES, json={"items": items, "settings": settings}),
    ]

    assert [(answer.status_code, answer.json()["code"]) for answer in refused] == [(422, "E-PARAMETER")] * 2
    assert "recording_ids" in refused[0].text
    assert "shift" in refused[1].text


def test_a_shift_outside_the_recording_fails_with_its_code(
    client: TestClient, open_worker: OpenWorker, shift_gt3x: Path
) -> None:
    wish = {"file_name": "week.gt3x", "shift": "2026-03-05T07:00/2026-03-05T15:30"}
    job = client.post("/api/v1/analyze", params=wish, content=shift_gt3x.read_bytes()).json()
    run_next(open_worker(load_and_make_report))

    view = client.get(f"/api/v1/analyses/{job['id']}").json()

    assert (view["state"], view["problem"]["code"]) == ("failed", "E-SHIFT")


def test_a_shift_at_a_time_that_the_clocks_skip_fails_with_the_time_and_its_cure(
    client: TestClient, open_worker: OpenWorker, shift_gt3x: Path
) -> None:
    wish = {"shift": "2026-03-29T02:30/2026-03-29T08:00", "time_zone": "Europe/Paris"}
    job = client.post("/api/v1/analyze", params=wish, content=shift_gt3x.read_bytes()).json()
    run_next(open_worker(load_and_make_report))

    problem = client.get(f"/api/v1/analyses/{job['id']}").json()["problem"]

    assert problem["code"] == "E-SHIFT"
    assert "never show this time (2026-03-29 02:30:00)" in problem["detail"]
    assert problem["fix"].startswith("Choose other hours for this day")


def test_batches_are_listed_newest_first_and_page_by_page(client: TestClient) -> None:
    made = [start(client, 1, first=k, name=f"study {k}")["id"] for k in range(3)]

    newest = client.get(BATCHES, params={"limit": 2}).json()
    oldest = client.get(BATCHES, params={"limit": 2, "cursor": newest["next_cursor"]}).json()

    assert [batch["id"] for batch in (*newest["items"], *oldest["items"])] == made[::-1]
    assert oldest["next_cursor"] is None
    assert newest["items"][0]["counts"]["queued"] == 1


REFUSED: list[tuple[str, dict[str, Any]]] = [
    (BATCHES, {"items": []}),
    (BATCHES, {"items": [{"recording_id": "KEPT"}, {"recording_id": "rec_none"}]}),
    (BATCHES, {"items": [{"recording_id": "KEPT"}, {"recording_id": "KEPT", "settings": {"pose": "lying"}}]}),
    (BATCHES, {"items": [{"recording_id": "KEPT"}], "settings": {"side": "both"}}),
    (BATCHES, {"items": [{"recording_id": "KEPT"}], "unknown": 1}),
    (URL, {"recording_ids": ["KEPT", "rec_none"]}),
    (URL, {"recording_ids": ["KEPT"], "settings": {"periods": [{"start_s": 5, "end_s": 1, "kind": "task"}]}}),
]


@pytest.mark.parametrize(("url", "body"), REFUSED)
def test_a_refused_request_changes_nothing(client: TestClient, url: str, body: dict[str, Any]) -> None:
    def look() -> list[Any]:
        return [client.get(f"/api/v1/{name}").json() for name in ("recordings", "analyses", "batches")]

    kept = keep(client)
    before = look()

    refused = client.post(url, json=json.loads(json.dumps(body).replace("KEPT", kept)))

    assert refused.status_code in (404, 422)
    assert look() == before


def test_a_batch_that_does_not_fit_into_the_queue_changes_nothing(settings: Settings) -> None:
    with serving(settings, max_queued=2) as client:
        items = [{"recording_id": keep_number(client, k)} for k in range(3)]

        assert client.post(BATCHES, json={"items": items}).status_code == 503
        assert client.get(BATCHES).json()["items"] == client.get(URL).json()["items"] == []


@pytest.mark.parametrize(
    "query", ["pose=lying", "side=both", "calibration=9,1", "pose=two-point&calibration=5,15"]
)
def test_a_recording_sent_with_settings_that_are_refused_is_not_stored(
    client: TestClient, query: str
) -> None:
    assert client.post(f"/api/v1/analyze?{query}", content=b"1").status_code == 422

    assert client.get("/api/v1/recordings").json()["items"] == []
