"""``/api/v1/recordings``: stored, listed, described, divided into periods, thrown away."""

import base64
import hashlib
from datetime import time
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from sqlalchemy import update

from acromion.app.http.api.library.recordings import XLSX
from acromion.app.library.database.tables import purged_uploads, recordings
from acromion.app.library.jobs import JobStore
from acromion.app.library.recordings import RecordingStore
from acromion.app.queue.worker import run_next
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app import stand_ins
from tests.app.conftest import OpenWorker, serving
from tests.workbooks import write

URL = "/api/v1/recordings"


def keep(client: TestClient, content: bytes = b"recording", **words: str) -> dict[str, Any]:
    answer = client.post(URL, content=content, params=words)
    assert answer.status_code == 201, answer.text
    kept: dict[str, Any] = answer.json()
    return kept


def list_ids(client: TestClient, **filters: Any) -> list[str]:
    return [item["id"] for item in client.get(URL, params=filters).json()["items"]]


def files_of(settings: Settings) -> list[Path]:
    folders = ("incoming", "uploads", "recordings", "analyses", "inspections")
    return [p for name in folders for p in (settings.data_dir / name).rglob("*") if p.is_file()]


def test_a_raw_body_becomes_a_recording(client: TestClient) -> None:
    answer = client.post(URL, content=b"abc", params={"file_name": "a.csv", "subject": "S1", "side": "left"})

    kept = answer.json()
    assert answer.status_code == 201
    assert answer.headers["location"] == f"{URL}/{kept['id']}"
    assert answer.headers["etag"] == '"1"'
    assert kept["sha256"] == hashlib.sha256(b"abc").hexdigest()
    assert (kept["file_name"], kept["subject"], kept["side"], kept["duplicate_of"]) == (
        "a.csv",
        "S1",
        "left",
        None,
    )


def test_the_same_bytes_with_other_words_are_flagged_as_a_duplicate(client: TestClient) -> None:
    first, second = keep(client), keep(client, note="again")

    assert (first["warnings"], second["warnings"]) == ([], ["W-DUP-UPLOAD"])
    assert second["duplicate_of"] == first["id"]
    assert second["id"] != first["id"]


@pytest.mark.parametrize("way", ["raw", "form"])
def test_the_same_upload_again_is_the_recording_that_there_is(
    client: TestClient, settings: Settings, way: str
) -> None:
    words = {"subject": "S1", "file_name": "a.csv"}
    sent: dict[str, Any] = (
        {"content": b"abc", "params": words}
        if way == "raw"
        else {"files": {"file": ("a.csv", b"abc")}, "data": {"subject": "S1"}}
    )

    answers = [client.post(URL, **sent) for _ in range(2)]

    assert [answer.status_code for answer in answers] == [201, 200]
    assert len({answer.json()["id"] for answer in answers}) == 1
    assert len([path for path in files_of(settings) if path.suffix != ".json"]) == 1


@pytest.mark.parametrize("before", [{"since_s": -25 * 3600.0}, {"stored_by": "usr_other"}])
def test_the_same_upload_after_a_day_or_of_somebody_else_is_another_recording(
    client: TestClient, store: JobStore, before: dict[str, Any]
) -> None:
    first = keep(client)
    store.run(update(recordings).values(before))

    assert keep(client)["id"] != first["id"]


def test_an_upload_can_be_described_when_it_is_whole(client: TestClient) -> None:
    tus = {"tus-resumable": "1.0.0", "upload-length": "3"}
    address = client.post("/api/v1/uploads", headers=tus).headers["location"]
    told = {"upload_id": address.rpartition("/")[2], "subject": "S2"}
    half = client.post(URL, json=told)
    more = {"tus-resumable": "1.0.0", "upload-offset": "0", "content-type": "application/offset+octet-stream"}
    client.patch(address, content=b"abc", headers=more)

    whole, again = (client.post(URL, json=told) for _ in range(2))

    assert half.status_code == 409
    assert (whole.status_code, whole.json()["subject"]) == (201, "S2")
    assert again.json()["id"] == whole.json()["id"]


@pytest.mark.parametrize("address", [URL, "/api/v1/analyze"])
def test_a_repeated_request_never_brings_back_what_was_deleted_for_good(
    client: TestClient, settings: Settings, address: str
) -> None:
    sent = {"content": b"abc", "params": {"subject": "S1"}}
    answer = client.post(address, **sent).json()  # type: ignore[arg-type]
    recording_id = answer.get("recording_id", answer["id"])
    client.delete(f"{URL}/{recording_id}", params={"purge": "now"})

    again = client.post(address, **sent)  # type: ignore[arg-type]

    assert (again.status_code, again.json()["code"]) == (410, "E-PURGED")
    assert files_of(settings) == []
    assert client.post(address, content=b"abc", params={"subject": "S2"}).is_success


def test_what_was_deleted_for_good_can_be_sent_again_after_a_day(client: TestClient, store: JobStore) -> None:
    client.delete(f"{URL}/{keep(client)['id']}", params={"purge": "now"})
    store.run(update(purged_uploads).values(since_s=-25 * 3600.0))
    RecordingStore(store.engine, store.reader).forget_purged()

    assert keep(client)["sha256"]


@pytest.mark.parametrize("body", ["{", "[]", "{}", '{"upload_id": 3}', '{"upload_id": "x", "sied": "left"}'])
def test_a_wish_that_is_not_understood_is_a_problem(shared: TestClient, body: str) -> None:
    answer = shared.post(URL, content=body, headers={"content-type": "application/json"})

    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")


def test_recordings_are_found_by_what_they_are(client: TestClient) -> None:
    keep(client, b"other", subject="S0", external_id="visit-0")
    wanted = keep(client, b"wanted", subject="S1", external_id="visit-1")

    for name in ("subject", "external_id", "sha256"):
        assert list_ids(client, **{name: wanted[name]}) == [wanted["id"]], name


def test_recordings_are_found_by_their_start(client: TestClient, store: JobStore) -> None:
    early, late = keep(client, b"early"), keep(client, b"late")
    with store.engine.begin() as connection:
        for recording, start in ((early, "2026-03-02T07:00:00"), (late, "2026-03-03T07:00:00")):
            connection.exec_driver_sql(
                f"UPDATE recordings SET start = '{start}' WHERE id = '{recording['id']}'"
            )

    assert list_ids(client, **{"from": "2026-03-03"}) == [late["id"]]
    assert list_ids(client, to="2026-03-03") == [early["id"]]


@pytest.mark.parametrize("name", ["from", "to"])
@pytest.mark.parametrize("value", ["02/03/2026", "2026-03-02T12:00:00Z", "2026-03-02T07:00-05:00", "7"])
def test_a_bound_that_is_no_time_of_the_device_s_clock_is_refused(
    shared: TestClient, name: str, value: str
) -> None:
    problem = shared.get(URL, params={name: value}).json()

    assert (problem["status"], problem["code"]) == (422, "E-PARAMETER")
    assert "allowed: 2026-03-02, 2026-03-02T07:58" in problem["detail"]


def test_pages_follow_one_another_without_gap_or_repeat(client: TestClient) -> None:
    kept = [keep(client, bytes([k]))["id"] for k in range(5)]
    seen, address = [], f"{URL}?limit=2"

    while address:
        answer = client.get(address)
        seen += [item["id"] for item in answer.json()["items"]]
        address = answer.links.get("next", {}).get("url", "")

    assert seen == kept[::-1]


@pytest.mark.parametrize("cursor", ["x", "AAAA", "////", "é"])
def test_a_cursor_of_nobodys_is_refused(shared: TestClient, cursor: str) -> None:
    assert shared.get(URL, params={"cursor": cursor}).json()["code"] == "E-PARAMETER"


def test_a_merge_patch_changes_only_what_it_names(client: TestClient) -> None:
    kept = keep(client, subject="S1", side="left")

    changed = client.patch(f"{URL}/{kept['id']}", json={"side": None, "note": "after lunch"}).json()

    assert (changed["subject"], changed["side"], changed["note"]) == ("S1", None, "after lunch")


def test_a_change_is_taken_on_top_of_what_was_read_alone(client: TestClient) -> None:
    address = f"{URL}/{keep(client)['id']}"
    tag = {"if-match": client.get(address).headers["etag"]}

    first, second = (client.patch(address, json={"subject": name}, headers=tag) for name in ("S2", "S3"))
    periods = client.put(f"{address}/periods", json=[], headers=tag)

    assert (first.status_code, first.headers["etag"]) == (200, '"2"')
    assert (second.status_code, second.json()["code"], periods.status_code) == (409, "E-STALE", 409)


def test_a_recording_thrown_away_is_in_no_list_and_can_be_brought_back(client: TestClient) -> None:
    kept = keep(client)

    assert client.delete(f"{URL}/{kept['id']}").status_code == 204
    assert list_ids(client) == []
    assert client.get(f"{URL}/{kept['id']}").status_code == 404
    assert list_ids(client, trashed=True) == [kept["id"]]

    client.post(f"{URL}/{kept['id']}/restore")
    assert list_ids(client) == [kept["id"]]


def test_the_analyses_of_a_recording_thrown_away_stop_and_hide(client: TestClient, store: JobStore) -> None:
    job = client.post("/api/v1/analyze", content=b"x").json()

    client.delete(f"{URL}/{job['recording_id']}")

    assert client.get(f"/api/v1/analyses/{job['id']}").status_code == 404
    client.post(f"{URL}/{job['recording_id']}/restore")
    assert client.get(f"/api/v1/analyses/{job['id']}").json()["state"] == "cancelled"


def test_a_second_delete_leaves_the_trash_as_it_is_and_a_purge_empties_it(
    client: TestClient, settings: Settings
) -> None:
    kept = keep(client)
    client.delete(f"{URL}/{kept['id']}")
    before = client.get(URL, params={"trashed": True}).json()["items"]

    assert client.delete(f"{URL}/{kept['id']}").status_code == 204
    assert client.get(URL, params={"trashed": True}).json()["items"] == before
    assert [path.name for path in files_of(settings) if path.suffix != ".json"] == [kept["id"]]

    assert client.delete(f"{URL}/{kept['id']}", params={"purge": "now"}).status_code == 200
    assert files_of(settings) == []


def test_a_second_delete_does_not_begin_the_term_of_the_trash_anew(
    client: TestClient, store: JobStore
) -> None:
    rows, kept = RecordingStore(store.engine, store.reader), keep(client)
    client.delete(f"{URL}/{kept['id']}")
    rows.advance_trash(60.0, term_s=100.0)

    client.delete(f"{URL}/{kept['id']}")

    assert rows.advance_trash(60.0, term_s=100.0) == (kept["id"],)


def test_a_delete_of_the_reference_of_a_comparison_changes_nothing(
    client: TestClient, store: JobStore, storage: Storage
) -> None:
    upload = storage.open_upload(100)
    upload.write(b"angles")
    reference = upload.keep()
    RecordingStore(store.engine, store.reader).add_reference(reference, "angles.csv")

    client.delete(f"{URL}/{reference.id}")

    assert list_ids(client, trashed=True) == []


@pytest.mark.parametrize("way", ["purge", "no term"])
def test_deleting_for_good_leaves_nothing(settings: Settings, open_worker: OpenWorker, way: str) -> None:
    term_s = 0.0 if way == "no term" else 1e6
    with serving(settings, trash_term_s=term_s) as client:
        job = client.post("/api/v1/analyze", content=b"PATIENT-BYTES", params={"subject": "CANARY"}).json()
        run_next(open_worker(stand_ins.write_report))
        address = f"{URL}/{job['recording_id']}"

        client.delete(address, params={"purge": "now" if way == "purge" else False})

        assert files_of(settings) == []
        assert client.get(address).status_code == 404
        left = b"".join(path.read_bytes() for path in settings.data_dir.glob("acromion.sqlite3*"))
        assert b"CANARY" not in left


def test_periods_are_given_back_as_they_were_put(client: TestClient) -> None:
    address = f"{URL}/{keep(client)['id']}/periods"
    periods: list[dict[str, Any]] = [
        {"start_s": 0, "end_s": 60.5, "kind": "task", "label": "sorting", "left_out": None},
        {"start": "7h58", "kind": "not_worn", "label": "", "left_out": False},
    ]
    no_times = dict.fromkeys(("start", "end", "start_s", "end_s"))

    assert client.put(address, json=periods).status_code == 200
    given = client.get(address).json()
    assert given == [no_times | periods[0], no_times | periods[1] | {"start": "07:58:00"}]
    assert client.put(address, json=given).json() == given


def test_a_diary_file_is_taken_and_given_as_csv(client: TestClient) -> None:
    address = f"{URL}/{keep(client)['id']}/periods"
    diary = "start;end;kind;label\n07:00;08:00;tâche;tri\n08:00;08:15;pause;\n"

    client.put(address, content=diary.encode(), headers={"content-type": "text/csv"})

    assert [row["kind"] for row in client.get(address).json()] == ["task", "break"]
    text = client.get(address, headers={"accept": "text/csv"}).text
    assert text.splitlines()[1] == "07:00:00,08:00:00,task,tri,,"
    again = client.put(address, content=text.encode(), headers={"content-type": "text/csv"})
    assert again.json() == client.get(address).json()


def test_a_file_of_postures_is_added_to_the_other_rows_and_replaces_earlier_postures(
    client: TestClient,
) -> None:
    address, kind = f"{URL}/{keep(client)['id']}/periods", {"content-type": "text/csv"}
    head, morning = "datetime,activity\n", "2026-03-03 07:59:00,sit\n"
    client.put(address, json=[{"start": "07:58", "end": "08:10", "kind": "task", "label": "tri"}])

    client.put(address, content=(head + morning).encode(), headers=kind)
    taken = client.put(address, content=(head + morning.replace("sit", "walk")).encode(), headers=kind)

    assert [(row["kind"], row["label"]) for row in taken.json()] == [("task", "tri"), ("posture", "upright")]
    text = client.get(address, headers={"accept": "text/csv"}).text
    assert client.put(address, content=text.encode(), headers=kind).json() == taken.json()


def test_of_a_workbook_for_many_recordings_the_rows_of_this_one_are_taken(client: TestClient) -> None:
    kept = keep(client)
    head, kind = ("file", "start", "end", "kind"), {"content-type": XLSX}
    rows = [(kept["file_name"], time(7), time(8), "task"), ("another.gt3x", time(9), time(10), "task")]
    address = f"{URL}/{kept['id']}/periods"

    taken = client.put(address, content=write(head, *rows), headers=kind)
    refused = client.put(address, content=write(head, rows[1]), headers=kind)

    assert [row["start"] for row in taken.json()] == ["07:00:00"]
    assert (refused.status_code, refused.json()["code"]) == (422, "E-DIARY")


def test_clock_times_and_seconds_are_given_as_csv_that_is_read_again(client: TestClient) -> None:
    address = f"{URL}/{keep(client)['id']}/periods"
    seconds = {"start_s": 0, "end_s": 60.5, "kind": "task"}
    given = client.put(address, json=[seconds, {"start": "10.20", "end": "1050", "kind": "break"}]).json()

    text = client.get(address, headers={"accept": "text/csv"}).text

    assert text.splitlines()[0] == "start,end,start_s,end_s,kind,label,left_out,file"
    assert client.put(address, content=text.encode(), headers={"content-type": "text/csv"}).json() == given


@pytest.mark.parametrize(
    ("body", "code"),
    [
        ('[{"start": "25:00", "end": 3, "kind": "task"}]', "E-DIARY"),
        ('[{"start_s": 0, "end_s": 3, "kind": "party"}]', "E-PARAMETER"),
        ('{"start_s": 0}', "E-PARAMETER"),
        ("x", "E-PARAMETER"),
        ("[" * 100_000, "E-PARAMETER"),
        (f"[{','.join(['{}'] * 10_001)}]", "E-PARAMETER"),
    ],
    ids=["time", "kind", "no list", "no JSON", "deep", "many"],
)
def test_periods_that_cannot_be_are_refused(client: TestClient, body: str, code: str) -> None:
    answer = client.put(f"{URL}/{keep(client)['id']}/periods", content=body)

    assert (answer.status_code, answer.json()["code"]) == (422, code)


def test_a_list_of_too_many_periods_is_refused_with_the_limit(client: TestClient) -> None:
    answer = client.put(f"{URL}/{keep(client)['id']}/periods", json=[{}] * 10_001)

    assert answer.json()["detail"].startswith("The value of body is not allowed")
    assert "10000" in answer.json()["detail"]


def test_the_head_of_an_upload_tells_the_device_before_the_rest_is_there(
    client: TestClient, shift_gt3x: Path
) -> None:
    content = shift_gt3x.read_bytes()
    tus = {"tus-resumable": "1.0.0", "content-type": "application/offset+octet-stream"}
    headers = tus | {"upload-length": "900000"}
    address = client.post("/api/v1/uploads", content=content[:200_000], headers=headers).headers["location"]

    found = client.get(f"{address}/inspection").json()

    assert (found["device"], round(found["rate_hz"])) == ("gt9x", 100)
    assert found["start"].startswith("20")


def test_an_inspection_is_made_once_and_gives_the_start(client: TestClient, small_gt3x: bytes) -> None:
    kept = keep(client, small_gt3x, file_name="shift.gt3x")
    address = f"{URL}/{kept['id']}"

    found = client.get(f"{address}/inspection").json()

    assert (found["file"], found["device"], round(found["rate_hz"])) == ("shift.gt3x", "gt9x", 100)
    assert client.get(address).json()["start"] == found["start"]
    assert client.get(f"{address}/inspection").json() == found


def test_an_inspection_that_cannot_be_read_is_made_again(
    client: TestClient, store: JobStore, small_gt3x: bytes
) -> None:
    address = f"{URL}/{keep(client, small_gt3x, file_name='shift.gt3x')['id']}"
    found = client.get(f"{address}/inspection").json()

    for damaged in ("z{", "", "[]"):
        store.run(update(recordings).values(inspection=damaged))
        assert client.get(address).status_code == 200, damaged
        assert client.get(f"{address}/inspection").json() == found, damaged


def test_an_inspection_of_something_else_says_what_it_is(client: TestClient) -> None:
    kept = keep(client, b"Dear diary,\ntoday I lifted boxes.\n", file_name="notes.csv")

    answer = client.get(f"{URL}/{kept['id']}/inspection")

    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")


def test_what_is_not_a_persons_to_say_cannot_be_set(client: TestClient) -> None:
    address = client.post(URL, content=b"x").json()["links"]["self"]

    for field in ("id", "sha256", "size_bytes", "organisation", "duplicate_of", "who"):
        answer = client.patch(address, json={"subject": "S1", field: "y"})
        assert (answer.status_code, answer.json()["code"]) == (422, "E-PARAMETER"), field
    assert client.get(address).json()["subject"] == ""


# A recording in a form, as browsers and ``curl -F`` send it, and the digest a client may tell.


FORM = {"content-type": "multipart/form-data; boundary=cut"}
DIGESTS = ("content-digest", "repr-digest")


def tell_digest(content: bytes) -> str:
    return f"sha-256=:{base64.b64encode(hashlib.sha256(content).digest()).decode()}:"


def test_a_form_brings_the_file_and_what_is_said_about_it(client: TestClient) -> None:
    words = {"subject": "S7", "side": "left", "note": "", "external_id": "visit 2"}

    kept = client.post(URL, files={"file": ("arm.gt3x", b"recording")}, data=words).json()

    assert kept["sha256"] == hashlib.sha256(b"recording").hexdigest()
    told = [kept[name] for name in ("file_name", "subject", "side", "external_id")]
    assert told == ["arm.gt3x", "S7", "left", "visit 2"]


@hypothesis_settings(
    suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None
)
@given(
    content=st.binary(min_size=1, max_size=300)
    .map(lambda octets: b"0" + octets + b"\r\n--cu" + octets)  # bytes that begin as a PDF are refused at once
    .filter(lambda octets: b"\r\n--cut" not in octets)  # that is the mark itself, as the sender must see to
)
def test_every_byte_of_the_file_arrives_whatever_it_is(client: TestClient, content: bytes) -> None:
    kept = client.post(URL, files={"file": ("a", content)}, headers=FORM).json()

    assert (kept["size_bytes"], kept["sha256"]) == (len(content), hashlib.sha256(content).hexdigest())


def part(name: str, content: bytes = b"") -> bytes:
    return f"--cut\r\nContent-Disposition: form-data; name={name}\r\n\r\n".encode() + content


WHOLE_FORM = part('"f"; filename="a"', b"recording\r\n--cut--\r\n")


@pytest.mark.parametrize(
    ("body", "code", "told"),
    [
        (b"", "E-CUT-UPLOAD", ""),
        (b"no form at all", "E-PARAMETER", ""),
        (part('"f"; filename="a"', b"half"), "E-CUT-UPLOAD", ""),
        (part('"f"; filename="a"', b"\r\n--cut--\r\n"), "E-EMPTY", ""),
        (part('"subject"', b"S1\r\n--cut--\r\n"), "E-PARAMETER", "allowed: file."),
        (part('"sied"', b"left\r\n") + WHOLE_FORM, "E-PARAMETER", "allowed: file_name, subject, side"),
        (part('"note"', b"x" * 5000), "E-PARAMETER", ""),
        (b"".join(part(f'"n{k}"', b"x\r\n") for k in range(30)), "E-PARAMETER", ""),
        (
            b"".join(part(f'"f"; filename="{name}"', b"x\r\n") for name in "ab") + b"--cut--\r\n",
            "E-PARAMETER",
            "",
        ),
    ],
)
def test_a_form_that_cannot_be_is_refused_and_leaves_nothing(
    shared: TestClient, shared_settings: Settings, body: bytes, code: str, told: str
) -> None:
    answer = shared.post(URL, content=body, headers=FORM)

    assert answer.json()["code"] == code
    assert told in answer.json()["detail"]
    assert files_of(shared_settings) == []


@pytest.mark.parametrize("name", DIGESTS)
@pytest.mark.parametrize(
    ("address", "body", "headers"),
    [(URL, b"damaged", {}), ("/api/v1/analyze", b"damaged", {}), (URL, WHOLE_FORM, FORM)],
    ids=["raw", "analyze", "form"],
)
@pytest.mark.parametrize(
    ("digest", "code"), [(tell_digest(b"as it was"), "E-DIGEST"), ("sha-256=:xyz:", "E-CHECKSUM")]
)
def test_what_is_not_what_was_sent_is_refused(
    shared: TestClient, shared_settings: Settings, address: str, body: bytes, headers: dict[str, str],
    name: str, digest: str, code: str,
) -> None:  # fmt: skip
    answer = shared.post(address, content=body, headers=headers | {name: digest})

    assert answer.json()["code"] == code
    assert files_of(shared_settings) == []


@pytest.mark.parametrize(("body", "headers"), [(b"recording", {}), (WHOLE_FORM, FORM)], ids=["raw", "form"])
@pytest.mark.parametrize("name", DIGESTS)
def test_what_is_as_it_was_sent_is_taken(
    client: TestClient, name: str, body: bytes, headers: dict[str, str]
) -> None:
    digest = f"md5=:1B2M2Y8AsgTpgAmY7PhCfg==:, {tell_digest(body)}"

    answer = client.post(URL, content=body, headers=headers | {name: digest})

    assert answer.json()["sha256"] == hashlib.sha256(b"recording").hexdigest()


# ``PUT /recordings/{id}/periods``: what cannot be on the day of the recording is refused by its row.


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
        ([OUTSIDE], 2, "outside"),
        ([INSIDE, OUTSIDE], 3, "outside"),
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


# The job is a detail of the recording, as its subject and arm are.


def test_a_job_that_was_stated_once_is_used_by_the_next_analysis_of_the_recording(shared: TestClient) -> None:
    wishes = {"job_title": "Painter", "isco_code": "7131"}
    first = shared.post("/api/v1/analyze", content=b"a shift of a painter", params=wishes).json()

    wish = {"recording_ids": [first["recording_id"]], "settings": {"method": "published"}}
    second = shared.post("/api/v1/analyses", json=wish).json()

    found = shared.get(f"{URL}/{first['recording_id']}").json()
    assert (found["job_title"], found["isco_code"]) == ("Painter", "7131")
    assert second["settings"]["job_title"] == "Painter"


def test_a_batch_stores_person_arm_and_job_on_recordings_without_them(shared: TestClient) -> None:
    recording = shared.post(URL, content=b"a shift of a plasterer").json()["id"]
    settings = {"subject": "P7", "side": "left", "job_title": "Plasterer", "isco_code": "7123"}

    shared.post("/api/v1/batches", json={"items": [{"recording_id": recording}], "settings": settings})

    found = shared.get(f"{URL}/{recording}").json()
    assert {name: found[name] for name in settings} == settings
