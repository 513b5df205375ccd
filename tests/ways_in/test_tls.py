"""HTTPS and the WebSocket over TLS, with a certificate made for the test."""

import json
import ssl
from pathlib import Path

import httpx2
import pytest
from fastapi import FastAPI
from typer.testing import CliRunner
from websockets.sync.client import connect

from app.cli import app
from app.main import configure_server
from app.settings import Settings
from tests.ways_in.servers import RunningServer


def test_pages_and_sockets_are_served_over_tls(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    cert, key = certificate
    trust = ssl.create_default_context(cafile=str(cert))
    settings = {"ACROMION_TLS_CERT": str(cert), "ACROMION_TLS_KEY": str(key)}
    server = RunningServer(tmp_path / "data", tmp_path / "log", 0, **settings)
    try:
        answer = httpx2.get(f"{server.address}api/v1/version", verify=trust, timeout=60)
        with connect(f"{server.address.replace('https', 'wss')}api/v1/live", ssl=trust) as socket:
            socket.send(json.dumps({"type": "resume", "session": "none"}))
            heard = json.loads(socket.recv(timeout=60))
    finally:
        server.stop()

    assert server.address.startswith("https://127.0.0.1:")
    assert answer.status_code == 200
    assert heard["code"] == "E-NOT-FOUND"


@pytest.fixture
def offered(certificate: tuple[Path, Path], tmp_path: Path) -> ssl.SSLContext:
    """What the server offers to those who come by TLS."""
    cert, key = certificate
    settings = Settings(data_dir=tmp_path / "data", tls_cert=cert, tls_key=key)
    config = configure_server(FastAPI(), settings)
    config.load()
    assert config.ssl is not None
    return config.ssl


def test_nothing_older_than_tls_1_2_is_spoken(offered: ssl.SSLContext) -> None:
    assert offered.minimum_version >= ssl.TLSVersion.TLSv1_2


def test_every_cipher_keeps_what_was_said_secret_and_whole(offered: ssl.SSLContext) -> None:
    names = {cipher["name"] for cipher in offered.get_ciphers()}

    old = {name for name in names if not name.startswith("TLS_")}
    assert names > old > set()
    assert all(name.startswith("ECDHE-") for name in old)
    assert all("GCM" in name or "CHACHA20" in name for name in names)


def test_a_certificate_without_its_key_is_refused(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    result = CliRunner().invoke(
        app, ["serve", "--data", str(tmp_path / "data"), "--tls-cert", str(certificate[0])]
    )

    assert result.exit_code == 2
    assert "E-PARAMETER" in result.output


def test_a_file_that_is_no_certificate_is_refused(certificate: tuple[Path, Path], tmp_path: Path) -> None:
    wrong = tmp_path / "cert.pem"
    wrong.write_text("none")
    words = ["--tls-cert", str(wrong), "--tls-key", str(certificate[1])]

    assert CliRunner().invoke(app, ["serve", "--data", str(tmp_path / "data"), *words]).exit_code == 2
