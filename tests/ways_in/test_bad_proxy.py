"""An upload through a proxy that cuts, repeats and reorders connections in the middle of a PATCH."""

import base64
import hashlib
import random
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx2
import pytest

from tests.ways_in.bad_proxy import WAYS, BadProxy
from tests.ways_in.servers import RunningServer

PIECE_BYTES = 9_000
TUS = {"tus-resumable": "1.0.0", "connection": "close"}
BODY = TUS | {"content-type": "application/offset+octet-stream"}


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("proxied")
    running = RunningServer(folder / "data", folder / "server.log")
    yield running
    running.stop()


def find_address(server: RunningServer) -> tuple[str, int]:
    url = httpx2.URL(server.address)
    return url.host, url.port or 80


class PatientClient:
    """Sends on from where the server says it is, as tus clients do, whatever happens on the way."""

    def __init__(self, proxy: BadProxy, content: bytes, checksum: bool) -> None:
        host, port = proxy.address
        self._caller = httpx2.Client(base_url=f"http://{host}:{port}", timeout=120, trust_env=False)
        self._content, self._checksum = content, checksum
        self.offsets = [0]

    def send(self) -> str:
        """Return the recording's id."""
        head = TUS | {"upload-length": str(len(self._content))}
        address = self._caller.post("/api/v1/uploads", headers=head).headers["location"]
        while True:
            known = self._caller.head(address, headers=TUS).headers
            self.offsets.append(int(known["upload-offset"]))
            if "acromion-recording" in known:
                return str(known["acromion-recording"])
            self._append(address, self.offsets[-1])

    def _append(self, address: str, offset: int) -> None:
        piece = self._content[offset : offset + PIECE_BYTES]
        headers = BODY | {"upload-offset": str(offset)}
        if self._checksum:
            digest = base64.b64encode(hashlib.sha256(piece).digest()).decode()
            headers |= {"upload-checksum": f"sha256 {digest}"}
        try:
            answer = self._caller.patch(address, content=piece, headers=headers)
        except httpx2.TransportError:
            return
        if answer.status_code == 204:
            self.offsets.append(int(answer.headers["upload-offset"]))


@pytest.mark.parametrize(("seed", "checksum"), [(1, False), (2, True), (3, False)])
def test_an_upload_arrives_whole_and_once_through_a_bad_proxy(
    server: RunningServer, seed: int, checksum: bool
) -> None:
    content = random.Random(f"{seed} {checksum}").randbytes(150_000)
    with closing(BadProxy(find_address(server), seed)) as proxy:
        client = PatientClient(proxy, content, checksum)

        recording = client.send()

    sha256 = hashlib.sha256(content).hexdigest()
    kept = server.client.get("/api/v1/recordings", params={"sha256": sha256}).json()["items"]
    assert [row["id"] for row in kept] == [recording]
    assert client.offsets == sorted(client.offsets)
    assert set(proxy.done) == set(WAYS)


def test_nothing_is_left_of_what_a_bad_proxy_did(server: RunningServer) -> None:
    log = server._log

    assert "Traceback" not in log.read_text()
    assert list(Path(log.parent / "data" / "incoming").iterdir()) == []
