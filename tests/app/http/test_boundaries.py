"""Over a real socket: where one request ends and the next begins is never a matter of opinion (smuggling)."""

import socket
from contextlib import closing

import pytest

from tests.app.http.test_timeouts import read_all

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
