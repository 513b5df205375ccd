"""Where the lines of a board come from: a serial port, UDP or TCP."""

import queue
import re
import socket
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Protocol
from urllib.parse import urlsplit

from app.errors import LiveSourceFailed

if TYPE_CHECKING:
    from serial import Serial

WAIT_S = 0.05
REOPEN_S = 0.5
BAUD = 115_200
SENDER_SILENCE_S = 5.0
"""A board that starts anew may send from another port: after so long another sender is heard."""
LINE_SILENCE_S = 10.0
"""A board that lost its power hangs up no line: after so long it is called again."""
PIECE_BYTES = 65_536
MOST_PIECES = 256
SERIAL_PORT = re.compile(r"^(COM\d+|/dev/(?!shm/)\S+)$", re.IGNORECASE)


class Port(Protocol):
    """Where bytes come from."""

    def read(self) -> bytes:
        """Wait at most :data:`WAIT_S`; b"" where nothing came."""

    def close(self) -> None:
        """Let go of it."""


class SerialPort:
    """A serial port; one that goes away is opened again when it comes back."""

    def __init__(self, name: str, baud: int = BAUD) -> None:
        """Open it. Raises LiveSourceFailed."""
        import serial  # noqa: PLC0415  of the extra "live"

        self._name, self._baud, self._serial = name, baud, serial
        self._failures = (serial.SerialException, OSError)
        try:
            self._port = self._open()
        except self._failures as error:
            raise LiveSourceFailed(name=name, why="port") from error

    def read(self) -> bytes:
        """Wait a moment for bytes."""
        if not self._port.is_open:
            self._reopen()
            return b""
        try:
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except self._failures:
            self._reopen()
            return b""

    def close(self) -> None:
        """Let go of the port."""
        with suppress(*self._failures):
            self._port.close()

    def _open(self) -> "Serial":
        return self._serial.Serial(self._name, self._baud, timeout=WAIT_S, exclusive=True)

    def _reopen(self) -> None:
        self.close()
        time.sleep(REOPEN_S)
        with suppress(*self._failures):
            self._port = self._open()


class UdpPort:
    """Datagrams of whole lines; one sender is heard, another one only after it has fallen silent."""

    def __init__(self, host: str, port: int, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Listen; raises OSError."""
        self._now_s, self._heard_s = now_s, now_s()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(WAIT_S)
        self._socket.bind((host, port))
        self._sender: object = None

    @property
    def port(self) -> int:
        """Where it listens."""
        return int(self._socket.getsockname()[1])

    def read(self) -> bytes:
        """Wait a moment for a datagram."""
        try:
            piece, sender = self._socket.recvfrom(PIECE_BYTES)
        except TimeoutError:
            return b""
        if self._sender is None or self._now_s() - self._heard_s > SENDER_SILENCE_S:
            self._sender = sender
        if sender != self._sender:
            return b""
        self._heard_s = self._now_s()
        return piece if piece.endswith(b"\n") else piece + b"\n"

    def close(self) -> None:
        """Stop listening."""
        self._socket.close()


class TcpPort:
    """A board that serves its lines over TCP; a connection that breaks, or brings nothing, is made again."""

    def __init__(self, host: str, port: int, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Connect; raises OSError."""
        self._now_s, self._heard_s = now_s, now_s()
        self._address = (host, port)
        self._socket = self._connect()

    def read(self) -> bytes:
        """Wait a moment for bytes."""
        try:
            piece = self._socket.recv(PIECE_BYTES)
        except TimeoutError:
            if self._now_s() - self._heard_s > LINE_SILENCE_S:
                self._reconnect()
            return b""
        except OSError:
            piece = b""
        if not piece:
            self._reconnect()
        self._heard_s = self._now_s()
        return piece

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def _connect(self) -> socket.socket:
        connected = socket.create_connection(self._address, timeout=5.0)
        connected.settimeout(WAIT_S)
        return connected

    def _reconnect(self) -> None:
        self.close()
        time.sleep(REOPEN_S)
        with suppress(OSError):
            self._socket = self._connect()
        self._heard_s = self._now_s()


class PushedPort:
    """Bytes that a page hands on, of a board or of its own sensors."""

    def __init__(self) -> None:
        self._pieces: queue.Queue[bytes] = queue.Queue(MOST_PIECES)
        self._is_open = True

    def push(self, piece: bytes) -> bool:
        """Add bytes; False while it is full. Those of a session that has ended are dropped."""
        if self._is_open:
            try:
                self._pieces.put_nowait(piece)
            except queue.Full:
                return False
        return True

    def read(self) -> bytes:
        """Wait a moment for bytes."""
        try:
            return self._pieces.get(timeout=WAIT_S)
        except queue.Empty:
            return b""

    def close(self) -> None:
        """Take no more."""
        self._is_open = False


def names_port(source: str) -> bool:
    """Whether a source is a port, not a file."""
    is_named = source.startswith(("udp://", "tcp://")) or SERIAL_PORT.match(source) is not None
    return is_named or Path(source).is_char_device()


def open_port(source: str, baud: int = BAUD) -> Port:
    """Open a port by its name. Raises LiveSourceFailed."""
    if not source.startswith(("udp://", "tcp://")):
        return SerialPort(source, baud)
    try:
        address = urlsplit(source)
        host, port = address.hostname or "", address.port
        if port is None or (address.scheme == "tcp" and not host):
            raise LiveSourceFailed(name=source, why="address")
        return UdpPort(host, port) if address.scheme == "udp" else TcpPort(host, port)
    except ValueError as error:
        raise LiveSourceFailed(name=source, why="address") from error
    except OSError as error:
        raise LiveSourceFailed(name=source, why="port") from error


def find_serial_ports() -> tuple[str, ...]:
    """Find the serial ports of this computer; none where the library is not installed."""
    if find_spec("serial") is None:
        return ()
    from serial.tools.list_ports import comports  # noqa: PLC0415  of the extra "live"

    return tuple(sorted(port.device for port in comports()))
