"""Over a real socket: slow, oversized and ambiguous requests are ended, quick ones are not."""

import asyncio
import http.client
import socket
import time
from collections.abc import Callable
from contextlib import closing

import pytest

from acromion.app.main import listen
from acromion.app.settings import Settings
from acromion.app.store.folder import Storage
from tests.loops import run_coroutine

PATIENCE_S = 0.4
HALF = b"POST /api/v1/analyze HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000\r\n\r\nsome"


@pytest.fixture
def patience_s() -> float:
    return PATIENCE_S


def read_all(line: socket.socket) -> bytes:
    line.settimeout(5)
    parts = []
    try:
        while part := line.recv(65536):
            parts.append(part)
    except ConnectionResetError:
        pass
    return b"".join(parts)


@pytest.mark.parametrize("begun", [b"GET /healthz HTTP/1.1\r\nHost: local", b""], ids=["dribbles", "silent"])
def test_a_head_that_does_not_come_is_hung_up_on(address: tuple[str, int], begun: bytes) -> None:
    with closing(socket.create_connection(address)) as line:
        line.sendall(begun)
        began_s = time.monotonic()

        assert read_all(line) == b""
        assert time.monotonic() - began_s < 4 * PATIENCE_S


def test_a_body_that_stops_is_answered_with_408_and_hung_up_on(address: tuple[str, int]) -> None:
    with closing(socket.create_connection(address)) as line:
        line.sendall(HALF)

        answer = read_all(line)

    assert answer.startswith(b"HTTP/1.1 408")
    assert b"E-SLOW" in answer


def test_an_upload_that_is_broken_off_leaves_nothing_and_is_no_bug(
    address: tuple[str, int], storage: Storage, caplog: pytest.LogCaptureFixture
) -> None:
    line = socket.create_connection(address)
    line.sendall(HALF)
    uploads = storage.root / "uploads"
    wait_until(lambda: any(uploads.iterdir()))

    line.close()

    wait_until(lambda: not any(uploads.iterdir()))
    assert "bug" not in caplog.text


def wait_until(holds: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 5
    while not holds():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def test_a_huge_head_is_refused(address: tuple[str, int]) -> None:
    with closing(socket.create_connection(address)) as line:
        line.sendall(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * 200_000)

        assert b" 400 " in read_all(line)[:20]


def test_an_ordinary_caller_is_answered_twice_on_one_line(address: tuple[str, int]) -> None:
    with closing(http.client.HTTPConnection(*address)) as caller:
        states, lines = [], []
        for _ in range(2):
            caller.request("GET", "/healthz", headers={"Host": "localhost"})
            lines.append(caller.sock)
            answer = caller.getresponse()
            states.append(answer.status)
            answer.read()

        assert states == [200, 200]
        assert lines[0] is lines[1]


def test_what_came_of_a_patch_before_the_line_broke_is_kept(address: tuple[str, int]) -> None:
    with closing(http.client.HTTPConnection(*address)) as caller:
        tus = {"Host": "localhost", "Tus-Resumable": "1.0.0"}
        caller.request("POST", "/api/v1/uploads", headers=tus | {"Upload-Length": "1000"})
        made = caller.getresponse()
        made.read()
        place = made.headers["Location"]

        def ask_offset() -> str | None:
            caller.request("HEAD", place, headers=tus)
            answer = caller.getresponse()
            answer.read()
            return answer.headers["Upload-Offset"]

        head = (
            f"PATCH {place} HTTP/1.1\r\nHost: localhost\r\nTus-Resumable: 1.0.0\r\nUpload-Offset: 0\r\n"
            "Content-Type: application/offset+octet-stream\r\nContent-Length: 1000\r\n\r\n"
        )
        line = socket.create_connection(address)
        line.sendall(head.encode() + b"x" * 400)
        time.sleep(0.2)
        line.close()

        wait_until(lambda: ask_offset() == "400")


async def read_no_delay(listener: socket.socket) -> int:
    """Connect, and read on the server's side whether small pieces are sent at once."""
    told: asyncio.Future[int] = asyncio.get_running_loop().create_future()

    def tell(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        line: socket.socket = writer.get_extra_info("socket")
        told.set_result(line.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY))
        writer.close()

    async with await asyncio.start_server(tell, sock=listener):
        with closing(socket.create_connection(listener.getsockname())):
            return await told


def test_an_answer_is_not_held_back_until_the_caller_confirms_its_head(settings: Settings) -> None:
    with closing(listen(settings.model_copy(update={"host": "127.0.0.1", "port": 0}))) as listener:
        assert run_coroutine(read_no_delay(listener)) != 0


# Where one request ends and the next begins is never a matter of opinion (smuggling).


NEXT = b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"


def ask(address: tuple[str, int], *fields: bytes, body: bytes = b"") -> bytes:
    head = b"\r\n".join((b"POST /logout HTTP/1.1", b"Host: localhost", *fields))
    with closing(socket.create_connection(address)) as line:
        line.sendall(head + b"\r\n\r\n" + body)
        return read_all(line)


@pytest.mark.parametrize(
    "fields",
    [
        (b"Content-Length: 4", b"Content-Length: 5"),
        (b"Content-Length: 4, 5",),
        (b"Content-Length: +4",),
        (b"Content-Length: -4",),
        (b"Content-Length: 0x4",),
        (b"Content-Length : 4",),
        (b"Content-Length:\x0b4",),
        (b"Transfer-Encoding : chunked",),
        (b"X: y\rContent-Length: 4",),
        (b"Host: other",),
    ],
)
def test_a_head_that_can_be_read_in_two_ways_is_refused_and_the_line_closed(
    address: tuple[str, int], fields: tuple[bytes, ...]
) -> None:
    answer = ask(address, *fields, body=b"0\r\n\r\n" + NEXT)

    assert answer.startswith(b"HTTP/1.1 400")
    assert answer.count(b"HTTP/1.1 ") == 1


@pytest.mark.parametrize("coding", [b"xchunked", b"chunked, identity", b"gzip, chunked", b"\x0bchunked"])
def test_a_coding_that_is_not_spoken_is_refused_and_the_line_closed(
    address: tuple[str, int], coding: bytes
) -> None:
    answer = ask(address, b"Transfer-Encoding: " + coding, body=b"0\r\n\r\n" + NEXT)

    assert answer[9:12] in (b"400", b"501")
    assert answer.count(b"HTTP/1.1 ") == 1


def test_beside_chunks_a_length_counts_for_nothing(address: tuple[str, int]) -> None:
    fields = (b"Content-Length: %d" % (5 + len(NEXT)), b"Transfer-Encoding: chunked")

    answer = ask(address, *fields, body=b"0\r\n\r\n" + NEXT)

    assert answer.count(b"HTTP/1.1 ") == 2
    assert answer.count(b"HTTP/1.1 200") == 1


@pytest.mark.parametrize("size", [b"-1", b"0x1", b"1 1", b"g", b"1;\n"])
def test_a_piece_whose_size_is_none_ends_the_line(address: tuple[str, int], size: bytes) -> None:
    answer = ask(address, b"Transfer-Encoding: chunked", body=size + b"\r\nx\r\n0\r\n\r\n" + NEXT)

    assert b"HTTP/1.1 200" not in answer
