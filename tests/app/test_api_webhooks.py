"""Webhooks: told once each thing that ends, signed, and again until heard."""

import base64
import hashlib
import hmac
import json
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from fastapi.testclient import TestClient
from starlette.requests import Request

from app.api.housekeeping import tell_webhooks
from app.api.services import Services, find_services
from app.jobs.worker import run_next
from app.main import create_app
from app.settings import Settings
from tests.app import stand_ins
from tests.app.conftest import OpenBench

URL = "/api/v1/webhooks"


@dataclass
class Listener:
    """A real server that hears, and answers as told."""

    heard: list[tuple[dict[str, str], bytes]] = field(default_factory=list)
    status: int = 200
    url: str = ""


@pytest.fixture
def listener() -> Iterator[Listener]:
    """Listen on a free port."""
    ears = Listener()

    class Ears(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["content-length"]))
            ears.heard.append(({k.lower(): v for k, v in self.headers.items()}, body))
            self.send_response(ears.status)
            self.send_header("Location", "http://127.0.0.1:9/")
            self.end_headers()

        def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
            """Be quiet."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Ears)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    ears.url = f"http://127.0.0.1:{server.server_address[1]}/hook?from=acromion"
    yield ears
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def open_client(settings: Settings) -> Iterator[TestClient]:
    """An application that may call this computer; nobody keeps house but the test."""
    application = create_app(settings.model_copy(update={"webhooks_may_be_private": True}))
    yield TestClient(application, base_url="http://localhost")
    services_of(application).store.close()


def services_of(application: Any) -> Services:
    return find_services(Request({"type": "http", "app": application}))


def subscribe(client: TestClient, url: str, **wish: Any) -> dict[str, Any]:
    answer = client.post(URL, json={"url": url} | wish)
    assert answer.status_code == 201, answer.text
    hook: dict[str, Any] = answer.json()
    return hook


def test_the_end_of_an_analysis_is_told_with_ids_only(
    open_client: TestClient, bench: OpenBench, listener: Listener
) -> None:
    subscribe(open_client, listener.url)
    job = open_client.post("/api/v1/analyze", content=b"x", params={"subject": "CANARY"}).json()
    run_next(bench(stand_ins.write_report))

    tell_webhooks(services_of(open_client.app), 1.0)

    ((_, body),) = listener.heard
    assert json.loads(body)["type"] == "analysis.finished"
    assert json.loads(body)["data"] == {"analysis_id": job["id"], "state": "succeeded"}
    assert b"CANARY" not in body


def test_what_is_told_is_signed(open_client: TestClient, bench: OpenBench, listener: Listener) -> None:
    secret = subscribe(open_client, listener.url)["secret"]
    open_client.post("/api/v1/analyze", content=b"x")
    run_next(bench(stand_ins.write_report))

    tell_webhooks(services_of(open_client.app), 1.0)

    ((headers, body),) = listener.heard
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    key = base64.b64decode(secret.removeprefix("whsec_"))
    expected = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
    assert headers["webhook-signature"] == f"v1,{expected}"


def test_what_was_not_heard_is_told_again_under_the_same_id(
    open_client: TestClient, bench: OpenBench, listener: Listener
) -> None:
    subscribe(open_client, listener.url)
    open_client.post("/api/v1/analyze", content=b"x")
    run_next(bench(stand_ins.write_report))
    services, listener.status = services_of(open_client.app), 503
    tell_webhooks(services, 1.0)
    listener.status = 204

    tell_webhooks(services, 1.0)
    assert len(listener.heard) == 1  # not yet: five seconds are to pass
    tell_webhooks(services, 5.0)
    tell_webhooks(services, 1e6)

    assert len(listener.heard) == 2
    assert listener.heard[0][0]["webhook-id"] == listener.heard[1][0]["webhook-id"]


def test_a_redirect_is_not_followed(open_client: TestClient, bench: OpenBench, listener: Listener) -> None:
    subscribe(open_client, listener.url)
    open_client.post("/api/v1/analyze", content=b"x")
    run_next(bench(stand_ins.write_report))
    listener.status = 307

    tell_webhooks(services_of(open_client.app), 1.0)

    assert len(listener.heard) == 1


def test_a_delivery_that_waits_outlives_the_server(
    settings: Settings, bench: OpenBench, listener: Listener
) -> None:
    allowed = settings.model_copy(update={"webhooks_may_be_private": True})
    with TestClient(create_app(settings), base_url="http://localhost") as before:
        services_of(before.app).webhooks.add(listener.url, ("analysis.finished",))
        before.post("/api/v1/analyze", content=b"x")
    run_next(bench(stand_ins.refuse))

    after = create_app(allowed)
    tell_webhooks(services_of(after), 1.0)

    services_of(after).store.close()
    assert json.loads(listener.heard[0][1])["data"]["state"] == "failed"


def test_a_batch_is_told_once_when_its_last_one_ends(
    open_client: TestClient, bench: OpenBench, listener: Listener
) -> None:
    subscribe(open_client, listener.url, events=["batch.finished"])
    recordings = [open_client.post("/api/v1/recordings", content=bytes([k])).json()["id"] for k in range(2)]
    items = [{"recording_id": recording} for recording in recordings]
    batch = open_client.post("/api/v1/batches", json={"items": items}).json()
    worker = bench(stand_ins.write_report)
    run_next(worker)
    tell_webhooks(services_of(open_client.app), 1.0)
    assert listener.heard == []

    run_next(worker)
    tell_webhooks(services_of(open_client.app), 1.0)

    assert [json.loads(body)["data"] for _, body in listener.heard] == [{"batch_id": batch["id"]}]


def test_a_batch_of_what_is_done_already_is_told_at_once(
    open_client: TestClient, bench: OpenBench, listener: Listener
) -> None:
    items = [{"recording_id": open_client.post("/api/v1/recordings", content=b"x").json()["id"]}]
    open_client.post("/api/v1/batches", json={"items": items})
    run_next(bench(stand_ins.write_report))
    subscribe(open_client, listener.url, events=["batch.finished"])

    again = open_client.post("/api/v1/batches", json={"items": items}).json()
    tell_webhooks(services_of(open_client.app), 1.0)

    assert [json.loads(body)["data"] for _, body in listener.heard] == [{"batch_id": again["id"]}]


def test_a_batch_that_ends_because_its_recording_is_thrown_away_is_told(
    open_client: TestClient, listener: Listener
) -> None:
    subscribe(open_client, listener.url, events=["batch.finished"])
    recording = open_client.post("/api/v1/recordings", content=b"x").json()
    items = [{"recording_id": recording["id"]}]
    batch = open_client.post("/api/v1/batches", json={"items": items}).json()

    open_client.delete(recording["links"]["self"])
    tell_webhooks(services_of(open_client.app), 1.0)

    assert [json.loads(body)["data"] for _, body in listener.heard] == [{"batch_id": batch["id"]}]


def test_an_address_that_does_not_hear_is_tried_once_in_a_round(
    open_client: TestClient, bench: OpenBench, listener: Listener
) -> None:
    listener.status = 500
    subscribe(open_client, listener.url, events=["analysis.finished"])
    worker = bench(stand_ins.write_report)
    for content in (b"x", b"y", b"z"):
        open_client.post("/api/v1/analyze", content=content)
        run_next(worker)

    tell_webhooks(services_of(open_client.app), 1.0)

    assert len(listener.heard) == 1


@pytest.mark.parametrize(
    "url",
    [
        "http://127.0.0.1/",
        "http://[::1]/",
        "http://localhost:8080/",
        "http://10.0.0.1/",
        "http://169.254.169.254/latest",
        "http://0.0.0.0/",
        "http://[::ffff:127.0.0.1]/",
        "ftp://1.1.1.1/",
        "file:///etc/passwd",
        "http://user@1.1.1.1/",
        "http:///",
        "http://1.1.1.1:99999/",
    ],
)
def test_an_address_inside_is_refused_unless_allowed(client: TestClient, url: str) -> None:
    answer = client.post(URL, json={"url": url})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-WEBHOOK")


def test_the_secret_is_shown_once(open_client: TestClient, listener: Listener) -> None:
    hook = subscribe(open_client, listener.url)

    (listed,) = open_client.get(URL).json()["items"]

    assert "secret" not in listed
    assert listed["id"] == hook["id"]


def test_a_webhook_that_is_gone_is_told_nothing(
    open_client: TestClient, bench: OpenBench, listener: Listener
) -> None:
    hook = subscribe(open_client, listener.url)
    open_client.post("/api/v1/analyze", content=b"x")
    run_next(bench(stand_ins.write_report))

    assert open_client.delete(f"{URL}/{hook['id']}").status_code == 204

    tell_webhooks(services_of(open_client.app), 1.0)
    assert listener.heard == []
    assert open_client.delete(f"{URL}/{hook['id']}").status_code == 404
