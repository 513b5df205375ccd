"""A proxy between client and server that cuts, repeats and holds back what it is given."""

import random
import socket
import threading
from contextlib import closing, suppress

Address = tuple[str, int]
WAYS = ("pass", "cut", "deaf", "late", "twice")


class BadProxy:
    """Relays one request for each connection; only to PATCH it does harm, by a seed.

    ``cut`` ends both connections in the middle of the body; ``deaf`` loses the answer; ``twice`` sends the
    request on two connections at once; ``late`` drops the client and delivers its request behind the next.
    """

    def __init__(self, server: Address, seed: int) -> None:
        self._server, self._random = server, random.Random(seed)
        self._late: list[bytes] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._thread = threading.Thread(target=self._relay_all, daemon=True)
        self.address: Address = self._listener.getsockname()
        self.done: list[str] = []
        self._thread.start()

    def close(self) -> None:
        """Deliver what was held back, and end."""
        self._deliver_late()
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join()

    def _relay_all(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            with closing(client), suppress(OSError):
                self._relay(client, read_message(client))

    def _relay(self, client: socket.socket, request: bytes) -> None:
        way = self._random.choice(WAYS) if request.startswith(b"PATCH") else "pass"
        held, self._late = self._late, []
        if way == "late":
            self._late = [*held, request]
        elif way == "cut":
            self._cut(request[: self._random.randrange(len(request))])
        elif way == "twice":
            twin = threading.Thread(target=self._send, args=(request,))
            twin.start()
            client.sendall(self._send(request))
            twin.join()
        else:
            answer = self._send(request)
            client.sendall(b"" if way == "deaf" else answer)
        if way != "late":
            self._late = held
            self._deliver_late()
        self.done.append(way)

    def _deliver_late(self) -> None:
        held, self._late = self._late, []
        for request in held:
            self._send(request)

    def _cut(self, begun: bytes) -> None:
        with closing(socket.create_connection(self._server)) as line:
            line.sendall(begun)

    def _send(self, request: bytes) -> bytes:
        with closing(socket.create_connection(self._server)) as line, suppress(OSError):
            line.sendall(request)
            return b"".join(iter(lambda: line.recv(65536), b""))
        return b""


def read_message(line: socket.socket) -> bytes:
    """Read a request to the end that its head announces."""
    message = b""
    while b"\r\n\r\n" not in message:
        message += _read_some(line)
    head, _, _ = message.partition(b"\r\n\r\n")
    fields = dict(row.lower().split(b": ", 1) for row in head.split(b"\r\n")[1:])
    length = len(head) + 4 + int(fields.get(b"content-length", 0))
    while len(message) < length:
        message += _read_some(line)
    return message


def _read_some(line: socket.socket) -> bytes:
    piece = line.recv(65536)
    if not piece:
        raise ConnectionResetError
    return piece
