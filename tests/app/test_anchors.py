"""The head of the trail goes to an https address: what is sent, and what a receiver that is away stops."""

import base64
import hashlib
import hmac
import json
import ssl
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from app.jobs.store import JobStore
from app.jobs.trail import read_head
from app.main import create_app
from app.settings import Settings
from app.upkeep.anchors import anchor_trail
from tests.app.conftest import AddJob
from tests.app.test_api_webhooks import Listener, open_listener
from tests.loops import run_coroutine

NOBODY = "https://127.0.0.1:9/heads"


@pytest.fixture
def tls(certificate: tuple[Path, Path]) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(*certificate)
    return context


@pytest.fixture
def receiver(
    tls: ssl.SSLContext, certificate: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Listener]:
    """Somebody who keeps heads, behind a certificate that this machine trusts."""
    monkeypatch.setenv("SSL_CERT_FILE", str(certificate[0]))
    with open_listener(tls) as opened:
        yield opened


def anchor(settings: Settings, store: JobStore, address: str) -> bool:
    """Write the head down at an address; tells whether that was taken."""
    return run_coroutine(anchor_trail(settings.model_copy(update={"trail_anchor": address}), store.reader))


def test_an_address_is_sent_the_head_of_the_trail(
    settings: Settings, store: JobStore, add_job: AddJob, receiver: Listener
) -> None:
    add_job()
    head = read_head(store.reader)

    assert anchor(settings, store, receiver.url)

    ((_, body),) = receiver.heard
    line = {"at": head.at, "seq": head.seq, "hash": head.hash}
    assert json.loads(body) == {"type": "trail.head", "timestamp": head.at, "data": line}


def test_a_head_is_signed_with_the_digest_of_the_address(
    settings: Settings, store: JobStore, add_job: AddJob, receiver: Listener
) -> None:
    add_job()

    anchor(settings, store, receiver.url)

    ((headers, body),) = receiver.heard
    signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
    digest = hmac.new(hashlib.sha256(receiver.url.encode()).digest(), signed, hashlib.sha256).digest()
    assert headers["webhook-signature"] == f"v1,{base64.b64encode(digest).decode()}"


def test_a_receiver_with_a_certificate_that_nobody_vouches_for_is_sent_nothing(
    settings: Settings, store: JobStore, add_job: AddJob, tls: ssl.SSLContext
) -> None:
    add_job()

    with open_listener(tls) as stranger:
        assert not anchor(settings, store, stranger.url)

    assert stranger.heard == []


def test_a_receiver_that_is_away_is_logged(
    settings: Settings, store: JobStore, add_job: AddJob, caplog: pytest.LogCaptureFixture
) -> None:
    add_job()

    assert not anchor(settings, store, NOBODY)

    assert "the head of the trail is not written to 127.0.0.1" in caplog.text


def test_a_receiver_that_refuses_is_logged(
    settings: Settings,
    store: JobStore,
    add_job: AddJob,
    receiver: Listener,
    caplog: pytest.LogCaptureFixture,
) -> None:
    add_job()
    receiver.status = 403

    assert not anchor(settings, store, receiver.url)

    assert "the head of the trail is not written to 127.0.0.1" in caplog.text


def test_a_server_starts_and_stops_while_the_receiver_is_away(settings: Settings) -> None:
    application = create_app(settings.model_copy(update={"trail_anchor": NOBODY}))
    with TestClient(application, base_url="http://localhost") as client:
        assert client.get("/readyz").status_code == 200
