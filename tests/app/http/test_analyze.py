"""``POST /api/v1/analyze``: what is taken, what is refused, and in which words."""

import hashlib
import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient
from hypothesis import HealthCheck, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from acromion.app.library.jobs import JobStore
from acromion.app.queue.worker import run_next
from acromion.app.request import clean_file_name
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.app import stand_ins
from tests.app.conftest import OpenWorker, serving

URL = "/api/v1/analyze"


def files_in(data: Path) -> list[Path]:
    return [path for name in ("uploads", "recordings") for path in (data / name).iterdir()]


def test_a_recording_is_taken_with_202_and_its_address(client: TestClient) -> None:
    answer = client.post(URL, content=b"recording", params={"file_name": "shift.gt3x"})

    assert answer.status_code == 202
    assert answer.headers["location"] == f"/api/v1/analyses/{answer.json()['id']}"
    assert answer.headers["retry-after"] == "2"


@pytest.mark.parametrize("method", ["POST", "PUT"])  # curl --upload-file sends PUT
def test_what_is_kept_is_what_was_sent(client: TestClient, storage: Storage, method: str) -> None:
    content = b"0123456789" * 30_000

    job = client.request(method, URL, content=content).json()

    assert storage.read_part(f"recordings/{job['recording_id']}", 0, 1 << 30) == content
    assert job["sha256"] == hashlib.sha256(content).hexdigest()


def test_every_wish_reaches_the_job(client: TestClient, store: JobStore) -> None:
    wishes = {
        "file_name": "shift.gt3x",
        "side": "left",
        "subject": "S012",
        "job_title": "Carpenter",
        "isco_code": "7115",
        "method": "published",
        "pose": "two-point",
        "calibration": ["5,15", "20.5,30"],
        "pose_held": "no",
        "slip_at": "3600",
        "no_slip_at": ["60", "7200"],
        "shift": "2026-03-02T07:00/2026-03-02T15:30",
        "rate_hz": "100",
        "lang": "fr",
        "sensor": "arm",
        "time_zone": "europe/paris",
        "clock_offset": "-1h02m",
    }

    request = store.get(client.post(URL, content=b"x", params=wishes).json()["id"]).request

    assert (request.file_name, request.side, request.subject) == ("shift.gt3x", "left", "S012")
    assert (request.job_title, request.isco_code) == ("Carpenter", "7115")
    assert (request.method, request.pose, request.rate_hz) == ("published", "two-point", 100.0)
    assert request.calibration_windows_s == ((5.0, 15.0), (20.5, 30.0))
    assert request.languages == ("fr", "en")
    assert json.loads(request.profile) == {"sensor": "arm"}
    assert (request.pose_held, request.slip_times_s) == ("no", (3600.0,))
    assert request.no_slip_times_s == (60.0, 7200.0)
    assert request.shift == "2026-03-02T07:00:00/2026-03-02T15:30:00"
    assert (request.time_zone, request.clock_offset_s) == ("Europe/Paris", -3720.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("method", "magic"),
        ("pose", "handstand"),
        ("calibration", "15,5"),
        ("calibration", "nan,5"),
        ("axis", "up"),
        ("slip_at", "noon"),
        ("no_slip_at", "noon"),
        ("pose_held", "end"),
        ("shift", "07:00-15:30"),
        ("shift", "2026-03-02T15:30/2026-03-02T07:00"),
        ("time_zone", "Paris"),
        ("clock_offset", "an hour"),
        ("lang", "it"),
        ("subject", "x" * 101),
        ("subject", "a\nb"),
        ("isco_code", "71a"),
    ],
)
def test_a_value_that_cannot_be_is_refused_by_name(
    shared: TestClient, shared_settings: Settings, name: str, value: str
) -> None:
    problem = shared.post(URL, content=b"x", params={name: value})

    assert problem.status_code == 422
    assert problem.headers["content-type"] == "application/problem+json"
    assert problem.json()["code"] == "E-PARAMETER"
    assert name in problem.json()["detail"]
    assert files_in(shared_settings.data_dir) == []


@pytest.mark.parametrize(("written", "axis"), [("y", "+y"), ("%2By", "+y"), ("+y", "+y"), ("-z", "-z")])
def test_an_axis_is_read_however_an_address_carries_its_sign(
    client: TestClient, store: JobStore, written: str, axis: str
) -> None:
    job = client.post(f"{URL}?axis={written}", content=b"x").json()["id"]

    assert store.get(job).request.arm_axis == axis


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        (lambda: b"", 422, "E-EMPTY"),
        (lambda: b"x" * 1_000_001, 413, "E-BIG"),
        (lambda: iter([b"x" * 600_000] * 2), 413, "E-BIG"),
    ],
    ids=["empty", "announced too large", "grows too large"],
)
def test_a_body_of_a_size_that_cannot_be_is_refused_and_leaves_nothing(
    shared: TestClient, shared_settings: Settings, body: Callable[[], Any], status: int, code: str
) -> None:
    problem = shared.post(URL, content=body())

    assert (problem.status_code, problem.json()["code"]) == (status, code)
    assert files_in(shared_settings.data_dir) == []


@pytest.mark.parametrize(
    ("address", "headers"),
    [(URL, {}), ("/api/v1/uploads", {"tus-resumable": "1.0.0", "upload-length": "3"})],
)
def test_a_disk_that_is_nearly_full_is_a_507(
    settings: Settings, address: str, headers: dict[str, str]
) -> None:
    with serving(settings, min_free_bytes=1 << 60) as client:
        problem = client.post(address, content=b"" if headers else b"x", headers=headers)

    assert (problem.status_code, problem.json()["code"]) == (507, "E-DISK")
    assert problem.headers["retry-after"] == "5"


def test_a_form_is_not_taken_for_a_recording(shared: TestClient) -> None:
    headers = {"content-type": "multipart/form-data; boundary=x"}

    assert shared.post(URL, content=b"--x", headers=headers).json()["code"] == "E-PARAMETER"


def test_a_row_that_cannot_be_written_leaves_no_recording(
    client: TestClient, storage: Storage, store: JobStore
) -> None:
    with store._engine.begin() as connection:
        connection.exec_driver_sql("DROP TABLE analyses")

    answer = client.post(URL, content=b"x")

    assert answer.status_code == 500
    assert files_in(storage.root) == []


@pytest.mark.parametrize(
    ("params", "browser", "language", "title"),
    [
        ({}, "fr-CA,fr;q=0.9,en;q=0.5", "fr-CA", "Le fichier est vide"),
        ({}, "de, en;q=0.5, fr;q=0.2", "en", "The file is empty"),
        ({"lang": "fr"}, "en", "fr", "Le fichier est vide"),
    ],
)
def test_the_words_of_a_refusal_follow_the_language_asked_for_then_the_browsers(
    shared: TestClient, params: dict[str, str], browser: str, language: str, title: str
) -> None:
    problem = shared.post(URL, content=b"", params=params, headers={"accept-language": browser})

    assert (problem.json()["title"], problem.json()["code"]) == (title, "E-EMPTY")
    assert problem.headers["content-language"] == language


def test_a_caller_who_prefers_to_wait_gets_the_end(client: TestClient, open_worker: OpenWorker) -> None:
    worker = threading.Thread(target=run_when_queued, args=(open_worker(stand_ins.write_report),))
    worker.start()

    answer = client.post(URL, content=b"x", headers={"prefer": "respond-async, wait=20"})
    worker.join()

    assert (answer.status_code, answer.json()["state"]) == (200, "succeeded")


def test_waiting_ends_with_202_when_the_time_is_up(client: TestClient) -> None:
    assert client.post(URL, content=b"x", headers={"prefer": "wait=1"}).status_code == 202


def test_the_long_poll_answers_as_soon_as_the_job_ends(client: TestClient, store: JobStore) -> None:
    job_id = client.post(URL, content=b"x").json()["id"]
    canceller = threading.Timer(0.3, store.cancel, (job_id,))
    canceller.start()
    began_s = time.monotonic()

    answer = client.get(f"/api/v1/analyses/{job_id}", params={"wait": 30})

    canceller.join()
    assert answer.json()["state"] == "cancelled"
    assert time.monotonic() - began_s < 5


def test_others_are_answered_during_a_long_poll(client: TestClient, store: JobStore) -> None:
    job_id = client.post(URL, content=b"x").json()["id"]
    poll = threading.Thread(target=client.get, args=(f"/api/v1/analyses/{job_id}?wait=30",))
    poll.start()

    client.get("/healthz")

    is_waiting = poll.is_alive()
    store.cancel(job_id)
    poll.join()
    assert is_waiting


@pytest.mark.parametrize(
    ("sent", "shown"),
    [
        ("../../etc/passwd", "passwd"),
        ("C:\\Users\\Renée\\quart 1.gt3x", "quart 1.gt3x"),
        ("a\x00b\r\nc.csv", "abc.csv"),
        ("\u202egpj.gt3x", "gpj.gt3x"),
        ("", "recording"),
        ("..", ".."),
        ("x" * 4000 + ".gt3x", "x" * 195 + ".gt3x"),
        ("<img src=x onerror=alert(1)>.csv", "<img src=x onerror=alert(1)>.csv"),
    ],
)
def test_a_file_name_is_one_printable_line_without_a_path(sent: str, shown: str) -> None:
    assert clean_file_name(sent) == shown


@given(st.text(max_size=300))
@hypothesis_settings(max_examples=100, suppress_health_check=[HealthCheck.too_slow])
def test_no_name_keeps_a_separator_or_a_control_character(name: str) -> None:
    shown = clean_file_name(name)

    assert 0 < len(shown) <= 200
    assert not set("/\\\r\n\t\x00") & set(shown)


def run_when_queued(worker: Any) -> None:
    end_s = time.monotonic() + 10
    while not run_next(worker) and time.monotonic() < end_s:
        time.sleep(0.05)
