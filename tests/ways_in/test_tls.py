"""HTTPS and the WebSocket over TLS, with a certificate made for the test."""

import json
import ssl
from pathlib import Path

import httpx2
from fastapi import FastAPI
from websockets.sync.client import connect

from acromion.app.main import configure_server
from acromion.app.settings import Settings
from tests.app.cli.typed import run
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


def test_nothing_older_than_tls_1_2_and_only_ciphers_with_forward_secrecy_are_offered(
    certificate: tuple[Path, Path], tmp_path: Path
) -> None:
    settings = Settings(data_dir=tmp_path / "data", tls_cert=certificate[0], tls_key=certificate[1])
    config = configure_server(FastAPI(), settings)
    config.load()
    assert config.ssl is not None
    names = {cipher["name"] for cipher in config.ssl.get_ciphers()}
    old = {name for name in names if not name.startswith("TLS_")}

    assert config.ssl.minimum_version >= ssl.TLSVersion.TLSv1_2
    assert names > old > set()
    assert all(name.startswith("ECDHE-") for name in old)
    assert all("GCM" in name or "CHACHA20" in name for name in names)


def test_a_certificate_without_its_key_and_a_file_that_is_none_are_refused(
    certificate: tuple[Path, Path], tmp_path: Path
) -> None:
    wrong = tmp_path / "cert.pem"
    wrong.write_text("none")

    for cert, more in ((certificate[0], ()), (wrong, ("--tls-key", str(certificate[1])))):
        result = run("serve", "--data", tmp_path / "data", "--tls-cert", cert, *more)
        assert (result.exit_code, "E-PARAMETER" in result.output) == (2, True)
