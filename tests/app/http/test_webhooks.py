"""Webhooks: told once each thing that ends, signed, and again until heard."""

import asyncio
import base64
import hashlib
import hmac
import json
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import anyio
import pytest
from fastapi.testclient import TestClient

from acromion.app.errors import ForeignWebhook
from acromion.app.http.api import housekeeping
from acromion.app.http.api.webhooks import WebhookSender, check_address, is_public, send_message
from acromion.app.library.webhooks import Delivery
from acromion.app.main import create_app
from acromion.app.queue.worker import run_next
from acromion.app.services import Services
from acromion.app.settings import Settings
from acromion.app.store.server_secret import ServerSecret
from tests.app import stand_ins
from tests.app.conftest import OpenWorker, services_of, serving
from tests.loops import run_coroutine

URL = "/api/v1/webhooks"


@dataclass
class Listener:
    """A real server that hears, and answers as told."""

    heard: list[tuple[dict[str, str], bytes]] = field(default_factory=list)
    status: int = 200
    url: str = ""


@contextmanager
def open_listener(tls: ssl.SSLContext | None = None) -> Iterator[Listener]:
    """Listen on a free port of this computer."""
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
    if tls is not None:
        server.socket = tls.wrap_socket(server.socket, server_side=True)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    ears.url = f"{'https' if tls else 'http'}://127.0.0.1:{server.server_address[1]}/hook?from=acromion"
    yield ears
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def listener() -> Iterator[Listener]:
    with open_listener() as opened:
        yield opened


@pytest.fixture
def open_client(settings: Settings) -> Iterator[TestClient]:
    """An application that may call this computer; nobody keeps house but the test."""
    application = create_app(settings.model_copy(update={"webhooks_may_be_private": True}))
    client = TestClient(application, base_url="http://localhost")
    yield client
    services_of(client).store.close()


def tell_webhooks(services: Services, elapsed_s: float) -> None:
    """Let one round begin, and wait for what it delivers."""

    async def tell() -> None:
        sender = WebhookSender(services)
        await sender.start_due(elapsed_s)
        await sender.finish()

    run_coroutine(tell())


@contextmanager
def listening(answer: Callable[[socket.socket], None]) -> Iterator[str]:
    """A server that takes one connection and does with it as told; return its address."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            connection, _ = server.accept()
            with connection:
                answer(connection)

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}/"
        with suppress(OSError):  # so that a server that nobody has connected to ends, too
            socket.create_connection(server.getsockname()).close()
        thread.join()


def read_until_closed(connection: socket.socket) -> None:
    """Hear everything and answer nothing."""
    while connection.recv(4096):
        pass


def dribble(connection: socket.socket) -> None:
    """Send a byte of an endless head now and then, until the other side has gone."""
    try:
        connection.sendall(b"HTTP/1.1 200 OK\r\nX-Slow: ")
        while True:
            connection.sendall(b"x")
            threading.Event().wait(0.01)
    except OSError:
        return


def subscribe(client: TestClient, url: str, **wish: Any) -> dict[str, Any]:
    answer = client.post(URL, json={"url": url} | wish)
    assert answer.status_code == 201, answer.text
    hook: dict[str, Any] = answer.json()
    return hook


def finish_one(client: TestClient, open_worker: OpenWorker) -> str:
    """Let an analysis end; returns its id."""
    job = client.post("/api/v1/analyze", content=b"x", params={"subject": "CANARY"}).json()
    assert run_next(open_worker(stand_ins.write_report))
    return str(job["id"])


def ask_batch(client: TestClient, count: int = 1, name: str = "spring") -> dict[str, Any]:
    """Ask for a batch of recordings; returns it."""
    stored = [client.post("/api/v1/recordings", content=bytes([k])).json()["id"] for k in range(count)]
    items = [{"recording_id": recording} for recording in stored]
    batch: dict[str, Any] = client.post("/api/v1/batches", json={"name": name, "items": items}).json()
    return batch | {"recordings": stored}


def test_the_end_of_an_analysis_is_told_signed_and_with_ids_only(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener
) -> None:
    hook = subscribe(open_client, listener.url)
    job_id = finish_one(open_client, open_worker)

    tell_webhooks(services_of(open_client), 1.0)

    ((headers, body),) = listener.heard
    assert json.loads(body)["type"] == "analysis.finished"
    assert json.loads(body)["data"] == {"analysis_id": job_id, "state": "succeeded"}
    assert b"CANARY" not in body
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    key = base64.b64decode(hook["secret"].removeprefix("whsec_"))
    expected = base64.b64encode(hmac.new(key, signed, hashlib.sha256).digest()).decode()
    assert headers["webhook-signature"] == f"v1,{expected}"
    (listed,) = open_client.get(URL).json()["items"]
    assert (listed["id"], "secret" in listed) == (hook["id"], False)  # the secret was shown once


@pytest.mark.parametrize("status", [503, 307])  # no redirect is followed
def test_what_was_not_heard_is_told_again_under_the_same_id(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener, status: int
) -> None:
    subscribe(open_client, listener.url)
    finish_one(open_client, open_worker)
    services, listener.status = services_of(open_client), status
    tell_webhooks(services, 1.0)
    listener.status = 204

    tell_webhooks(services, 1.0)
    assert len(listener.heard) == 1  # not yet: five seconds are to pass
    tell_webhooks(services, 5.0)
    tell_webhooks(services, 1e6)

    assert len(listener.heard) == 2
    assert listener.heard[0][0]["webhook-id"] == listener.heard[1][0]["webhook-id"]


def test_a_delivery_that_waits_outlives_the_server(
    settings: Settings, open_worker: OpenWorker, listener: Listener
) -> None:
    with serving(settings) as before:
        hooks, secret = services_of(before).webhooks, ServerSecret(settings.data_dir)
        hooks.add(listener.url, ("analysis.finished",), secret)
        before.post("/api/v1/analyze", content=b"x")
    run_next(open_worker(stand_ins.refuse))

    after = TestClient(create_app(settings.model_copy(update={"webhooks_may_be_private": True})))
    tell_webhooks(services_of(after), 1.0)

    services_of(after).store.close()
    assert json.loads(listener.heard[0][1])["data"]["state"] == "failed"


def list_told(listener: Listener) -> list[dict[str, str]]:
    return [json.loads(body)["data"] for _, body in listener.heard]


def test_a_batch_is_told_once_when_its_last_one_ends(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener
) -> None:
    subscribe(open_client, listener.url, events=["batch.finished"])
    batch = ask_batch(open_client, 2)
    worker = open_worker(stand_ins.write_report)
    run_next(worker)
    tell_webhooks(services_of(open_client), 1.0)
    assert listener.heard == []

    run_next(worker)
    tell_webhooks(services_of(open_client), 1.0)

    assert list_told(listener) == [{"batch_id": batch["id"]}]


def test_a_batch_of_what_is_done_already_or_is_thrown_away_is_told_at_once(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener
) -> None:
    subscribe(open_client, listener.url, events=["batch.finished"])
    thrown = ask_batch(open_client)
    open_client.delete(f"/api/v1/recordings/{thrown['recordings'][0]}")
    tell_webhooks(services_of(open_client), 1.0)
    assert list_told(listener) == [{"batch_id": thrown["id"]}]
    open_client.post("/api/v1/analyze", content=b"done")
    run_next(open_worker(stand_ins.write_report))
    (done,) = open_client.get("/api/v1/recordings").json()["items"]

    batch = open_client.post("/api/v1/batches", json={"items": [{"recording_id": done["id"]}]}).json()
    tell_webhooks(services_of(open_client), 1.0)

    assert list_told(listener)[1:] == [{"batch_id": batch["id"]}]


def test_an_address_that_does_not_hear_is_tried_once_in_a_round(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener
) -> None:
    listener.status = 500
    subscribe(open_client, listener.url, events=["analysis.finished"])
    worker = open_worker(stand_ins.write_report)
    for content in (b"x", b"y", b"z"):
        open_client.post("/api/v1/analyze", content=content)
        run_next(worker)

    tell_webhooks(services_of(open_client), 1.0)

    assert len(listener.heard) == 1


def test_one_that_never_answers_keeps_no_other_waiting(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener
) -> None:
    services = services_of(open_client)

    async def keep_both() -> None:
        sender = WebhookSender(services, limit_s=600.0)
        await sender.start_due(1.0)
        while not listener.heard:
            await anyio.sleep(0.01)
        await sender.start_due(1.0)  # the next round begins while the silent one is still connected
        await sender.stop()

    with listening(read_until_closed) as silent:
        subscribe(open_client, silent)
        subscribe(open_client, listener.url)
        finish_one(open_client, open_worker)

        run_coroutine(keep_both())

    assert len(listener.heard) == 1


def test_terms_pass_while_one_never_answers(
    open_client: TestClient, open_worker: OpenWorker, monkeypatch: pytest.MonkeyPatch
) -> None:
    services, connected, aged = services_of(open_client), threading.Event(), threading.Event()
    monkeypatch.setattr(housekeeping, "CHECK_PERIOD_S", 0.01)
    monkeypatch.setattr(housekeeping, "AGE_S", 0.0)

    def apply_retention(*_: object) -> None:
        if connected.is_set():
            aged.set()

    monkeypatch.setattr(housekeeping, "apply_retention", apply_retention)

    async def run_housekeeping() -> None:
        house = asyncio.create_task(housekeeping.run_housekeeping(services))
        while not aged.is_set():
            await anyio.sleep(0.01)
        house.cancel()
        await asyncio.gather(house, return_exceptions=True)

    def stay_silent(connection: socket.socket) -> None:
        connected.set()
        read_until_closed(connection)

    with listening(stay_silent) as silent:
        subscribe(open_client, silent)
        finish_one(open_client, open_worker)

        run_coroutine(run_housekeeping())

    assert aged.is_set()


def deliver(url: str, limit_s: float) -> bool:
    message = Delivery("msg_1", url, "whsec_" + base64.b64encode(b"key").decode(), "{}", 0)
    return run_coroutine(send_message(message, allow_private=True, limit_s=limit_s))


@pytest.mark.parametrize("answer", [read_until_closed, dribble], ids=["silent", "dribbles"])
def test_one_that_never_ends_its_answer_is_given_up(answer: Callable[[socket.socket], None]) -> None:
    with listening(answer) as url:
        assert not deliver(url, 0.2)


def test_a_name_that_is_never_found_is_given_up(monkeypatch: pytest.MonkeyPatch) -> None:
    released = threading.Event()

    def never_find(*_: object, **__: object) -> None:
        released.wait()
        raise socket.gaierror

    monkeypatch.setattr(socket, "getaddrinfo", never_find)

    assert not deliver("http://receiver.example/", 0.2)
    released.set()


def test_a_continuation_is_no_answer_yet() -> None:
    def continue_first(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(b"HTTP/1.1 100 Continue\r\n\r\nHTTP/1.1 204 No Content\r\n\r\n")

    with listening(continue_first) as url:
        assert deliver(url, 60.0)


@pytest.mark.parametrize("path", ["caf\u00e9?q=\u00e9 b", "a\tb", "%20?x=[1]#part"])
def test_any_path_is_sent_or_refused_and_ends_nothing(listener: Listener, path: str) -> None:
    assert deliver(listener.url.replace("hook", path), 60.0)


@pytest.mark.parametrize("answer", [b"", b"\x00\x01\x02\r\n\r\n", b"HTTP/1.1 200 OK\r\nX: " + 70_000 * b"x"])
def test_an_answer_that_is_none_is_not_heard(answer: bytes) -> None:
    def reply(connection: socket.socket) -> None:
        connection.recv(4096)
        connection.sendall(answer)

    with listening(reply) as url:
        assert not deliver(url, 60.0)


REFUSED = (
    "0.0.0.0 10.1.2.3 100.64.0.1 100.127.255.255 127.0.0.1 127.255.0.1 169.254.169.254 172.16.0.1 "
    "172.31.255.255 192.0.0.1 192.0.0.9 192.0.2.1 192.88.99.1 192.168.1.1 198.18.0.1 198.19.255.255 "
    "198.51.100.7 203.0.113.9 224.0.0.1 239.255.255.250 240.0.0.1 255.255.255.255 :: ::1 ::8.8.8.8 ::7f00:1 "
    "::ffff:127.0.0.1 ::ffff:8.8.8.8 ::ffff:0:127.0.0.1 64:ff9b::7f00:1 64:ff9b::8.8.8.8 64:ff9b:1::a00:1 "
    "100::1 100:0:0:1::1 2001::1 2001:0:4136:e378:8000:63bf:3fff:fdd2 2001:2::1 2001:20::1 2001:db8::1 "
    "2002:7f00:1:: 2002:808:808::1 3fff::1 5f00::1 fc00::1 fd12:3456::1 fe80::1 fe80::1%eth0 fec0::1 "
    "ff02::1 ff0e::1"
)
PERMITTED = (
    "1.1.1.1 8.8.8.8 100.63.255.255 100.128.0.1 172.15.255.255 172.32.0.1 192.0.1.1 198.17.255.255 "
    "198.20.0.1 223.255.255.255 2001:200::1 2001:4860:4860::8888 2003::1 2606:4700:4700::1111 "
    "2a00:1450:4007::1"
)


def test_no_webhook_leads_into_a_refused_network() -> None:
    assert [address for address in REFUSED.split() if is_public(address)] == []
    assert [address for address in PERMITTED.split() if not is_public(address)] == []


def test_one_refused_address_of_a_name_refuses_it(monkeypatch: pytest.MonkeyPatch) -> None:
    found = [(0, 0, 0, "", (address, 80)) for address in ("8.8.8.8", "64:ff9b::a00:1")]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)

    with pytest.raises(ForeignWebhook):
        check_address("http://receiver.example/", allow_private=False)


@pytest.mark.parametrize(
    "url",
    [
        *("http://[64:ff9b::7f00:1]/", "http://[::1]/", "http://localhost:8080/", "http://10.0.0.1/"),
        *("http://169.254.169.254/latest", "ftp://1.1.1.1/", "file:///etc/passwd", "http://user@1.1.1.1/"),
        *("http:///", "http://1.1.1.1:99999/"),
    ],
)
def test_an_address_inside_is_refused_unless_allowed(url: str) -> None:
    with pytest.raises(ForeignWebhook):
        check_address(url, allow_private=False)


def test_the_api_refuses_an_address_inside(client: TestClient) -> None:
    answer = client.post(URL, json={"url": "http://10.0.0.1/"})

    assert (answer.status_code, answer.json()["code"]) == (422, "E-WEBHOOK")


def test_a_webhook_that_is_gone_is_told_nothing(
    open_client: TestClient, open_worker: OpenWorker, listener: Listener
) -> None:
    hook = subscribe(open_client, listener.url)
    finish_one(open_client, open_worker)

    assert open_client.delete(f"{URL}/{hook['id']}").status_code == 204

    tell_webhooks(services_of(open_client), 1.0)
    assert listener.heard == []
    assert open_client.delete(f"{URL}/{hook['id']}").status_code == 404
