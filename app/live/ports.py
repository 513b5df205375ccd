"""Sources of a board's lines (serial port, UDP, TCP, a page, a pipe), and a buffer for their early bytes."""

import json
import os
import queue
import re
import secrets
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.util import find_spec
from math import inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Protocol
from urllib.parse import urlsplit

from acromion.app.errors import LiveSourceFailed
from acromion.app.store.permissions import create_file, make_folder
from acromion.fusion.conventions import ArmAxis, Side

if TYPE_CHECKING:
    from serial import Serial

WAIT_S = 0.05
SHOWN_HZ = 50.0
"""Rate of the shown angles."""
LEARN_LIMIT_S = 20.0
"""A board must send data within this time, and after that its header."""
REOPEN_S = 0.5
BAUD = 115_200
SENDER_SILENCE_S = 5.0
"""A restarted board may send from another port; after this silence another sender is accepted."""
LINE_SILENCE_S = 10.0
"""A board that lost power does not close its connection; after this silence the client reconnects."""
PIECE_BYTES = 65_536
MAX_PIECES, MAX_PUSHED_BYTES = 256, 1 << 20
"""Most that a page may send before the session takes it; then the socket is not read."""
SERIAL_PORT = re.compile(r"^(COM\d+|/dev/(?!shm/)\S+)$", re.IGNORECASE)


class Port(Protocol):
    """A source of bytes."""

    def read(self) -> bytes:
        """Wait at most :data:`WAIT_S` and return the bytes received; b"" if there are none."""

    def close(self) -> None:
        """Close the port."""


class SerialPort:
    """A serial port; it is reopened if it disappears and comes back."""

    def __init__(self, name: str, baud: int = BAUD) -> None:
        """Open the port. Raises LiveSourceFailed."""
        import serial  # noqa: PLC0415  in the extra "live"

        self._name, self._baud, self._serial = name, baud, serial
        self._failures = (serial.SerialException, OSError)
        try:
            self._port = self._open()
        except self._failures as error:
            raise LiveSourceFailed(name=name, why="port") from error

    def read(self) -> bytes:
        """Wait briefly for bytes."""
        if not self._port.is_open:
            self._reopen()
            return b""
        try:
            return bytes(self._port.read(max(1, self._port.in_waiting)))
        except self._failures:
            self._reopen()
            return b""

    def close(self) -> None:
        """Close the port."""
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
    """Datagrams of whole lines from one sender; another sender is accepted only after this one is silent."""

    def __init__(self, host: str, port: int, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Bind the socket. Raises OSError."""
        self._now_s, self._heard_s = now_s, now_s()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(WAIT_S)
        self._socket.bind((host, port))
        self._sender: object = None

    @property
    def port(self) -> int:
        """The port number."""
        return int(self._socket.getsockname()[1])

    def read(self) -> bytes:
        """Wait briefly for a datagram."""
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
        """Close the socket."""
        self._socket.close()


class TcpPort:
    """A board that serves its lines over TCP; a broken or silent connection is reopened."""

    def __init__(self, host: str, port: int, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Connect. Raises OSError."""
        self._now_s, self._heard_s = now_s, now_s()
        self._address = (host, port)
        self._socket = self._connect()

    def read(self) -> bytes:
        """Wait briefly for bytes."""
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
        """Close the connection."""
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
    """Bytes that a page sends, from a board or from the phone's own sensors."""

    def __init__(self) -> None:
        self._pieces: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._pushed_bytes = self._read_bytes = 0
        self._is_open = True

    @property
    def is_behind(self) -> bool:
        """Whether there are bytes that were not read yet."""
        return not self._pieces.empty()

    def push(self, piece: bytes) -> bool:
        """Add bytes, from one thread; return False while the queue is full.

        Bytes for an ended session are dropped.
        """
        if not self._is_open:
            return True
        if self._pieces.qsize() >= MAX_PIECES or self._pushed_bytes - self._read_bytes >= MAX_PUSHED_BYTES:
            return False
        self._pushed_bytes += len(piece)
        self._pieces.put(piece)
        return True

    def read(self) -> bytes:
        """Wait briefly for bytes; only one thread reads."""
        try:
            piece = self._pieces.get(timeout=WAIT_S)
        except queue.Empty:
            return b""
        self._read_bytes += len(piece)
        return piece

    def close(self) -> None:
        """Accept no more bytes."""
        self._is_open = False


class PipePort:
    """The bytes that a server passes on to the process of a session, and the server's commands."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self._came_s: float | None = None
        self.taken_bytes = 0
        self.is_stopped = False
        self.asked_pose_s: float | None = None

    def read(self, wait_s: float = WAIT_S) -> bytes:
        """Wait briefly for bytes; apply a command if one comes first, and stop if the server is gone."""
        self._came_s = None
        if self.is_stopped:
            time.sleep(wait_s)
            return b""
        try:
            message = self._pipe.recv_bytes() if self._pipe.poll(wait_s) else DATA
        except (EOFError, OSError):
            message = json.dumps(STOP).encode()
        if not message.startswith(DATA):
            command = json.loads(message)
            self.is_stopped = command == STOP
            self.asked_pose_s = command.get("countdown_s", self.asked_pose_s)
            return b""
        if message == DATA:
            return b""
        (self._came_s,) = _CAME.unpack_from(message, len(DATA))
        piece = message[len(DATA) + _CAME.size :]
        self.taken_bytes += len(piece)
        return piece

    def now_s(self) -> float:
        """Return when the last bytes arrived, by ``time.monotonic``; the current time if there were none."""
        return time.monotonic() if self._came_s is None else self._came_s

    def close(self) -> None:
        """Do nothing: the end of the process closes the pipe."""


DATA = b"\0"
"""The first byte of a message of bytes; a command is JSON."""
STOP = {"type": "stop"}
_CAME = struct.Struct("<d")


def pack_piece(piece: bytes, came_s: float) -> bytes:
    """Return the message that passes bytes on, with the moment of their arrival."""
    return DATA + _CAME.pack(came_s) + piece


def is_port(source: str) -> bool:
    """Return whether a source is a port and not a file."""
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
    """Return the serial ports of this computer; none if pyserial is not installed."""
    if find_spec("serial") is None:
        return ()
    from serial.tools.list_ports import comports  # noqa: PLC0415  in the extra "live"

    return tuple(sorted(port.device for port in comports()))


# Early bytes: the bytes that a port sends before the session can process frames. They are on disk within a
# second.
#
# A session cannot process frames until numpy is loaded, the rate is known and the kernels are compiled; on a
# new server this takes many seconds. Meanwhile a thread reads the port, writes each piece with its timestamp
# to a file, and queues it for the session. Once the session has caught up and its raw file contains
# everything, the file of early bytes is deleted and the port is read directly.
#
# A server keeps the files of its sessions in its folder ``live``:
#
#  live-<session>.raw      the raw file (:mod:`acromion.app.live.raw_file`), until it is a recording
#  live-<session>.early    the early bytes, for some seconds
#  live-<session>.shown    the displayed angles of an ended session, for an hour
#  replay-<session>.raw    the raw file of a session that is not kept


KEPT, PLAYED = "live-", "replay-"
RAW, EARLY, SHOWN, MARKS = ".raw", ".early", ".shown", ".marks"
SYNC_S = 1.0
MAX_BYTES = 8 << 20
"""Most early bytes; a port that sends more is not read until the session has caught up."""
CLOSE_LIMIT_S = 5.0
_ABOUT = struct.Struct("<I")
_PIECE = struct.Struct("<dI")
"""When a piece arrived, in seconds since 1970, and its length."""


class EarlyFile:
    """A file of received bytes; it starts with the session options as JSON."""

    def __init__(self, path: Path, about: Mapping[str, Any]) -> None:
        """Create the file. Raises FileExistsError, OSError."""
        self._path, self._file = path, create_file(path)
        asked = json.dumps(about).encode()
        self.size_bytes = 0
        self._add(_ABOUT.pack(len(asked)) + asked)
        self._synced_s, self._is_synced = 0.0, False
        self.sync()

    def write(self, piece: bytes, came_s: float) -> None:
        """Write a piece with its time of arrival; :meth:`sync` makes it durable."""
        self._add(_PIECE.pack(came_s, len(piece)) + piece)
        self._file.flush()
        self._is_synced = False

    def sync(self) -> None:
        """Flush new data to disk, at most once a second."""
        if not self._is_synced and time.monotonic() - self._synced_s >= SYNC_S:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._synced_s, self._is_synced = time.monotonic(), True

    def close(self) -> None:
        """Close the file without deleting it."""
        self._file.close()

    def drop(self) -> None:
        """Close and delete the file."""
        self.close()
        self._path.unlink(missing_ok=True)

    def _add(self, content: bytes) -> None:
        self._file.write(content)
        self.size_bytes += len(content)


class EarlyPort:
    """A port that a separate thread reads; its bytes are stored in a file until :meth:`release`."""

    def __init__(self, port: Port, file: EarlyFile) -> None:
        self.inner = port
        self._file: EarlyFile | None = file
        self._pieces: queue.SimpleQueue[tuple[bytes, float]] = queue.SimpleQueue()
        self._came_s: float | None = None
        self._error: Exception | None = None
        self._is_open = True
        self._guard = threading.Lock()
        self._thread = threading.Thread(target=self._pump, name="early", daemon=True)
        self._thread.start()

    @property
    def is_behind(self) -> bool:
        """Whether there are bytes that were not read yet."""
        is_inner_behind = isinstance(self.inner, PushedPort) and self.inner.is_behind
        return is_inner_behind or not self._pieces.empty()

    def read(self) -> bytes:
        """Wait briefly for bytes. Raises OSError if the disk is full."""
        self._came_s = None
        if not self._thread.is_alive() and self._pieces.empty():
            if self._error is not None:
                raise self._error
            return self.inner.read()
        try:
            piece, self._came_s = self._pieces.get(timeout=WAIT_S)
        except queue.Empty:
            return b""
        return piece

    def now_s(self) -> float:
        """Return when the last bytes arrived, by ``time.monotonic``; the current time if there were none."""
        return time.monotonic() if self._came_s is None else self._came_s

    def release(self) -> None:
        """Delete the file of early bytes; the raw file has them."""
        self._is_open = False
        with self._guard:
            if self._file is not None:
                self._file.drop()
            self._file = None

    def close(self) -> None:
        """Close the port; the file stays, because its bytes may not be in the raw file yet."""
        self._is_open = False
        self._thread.join(CLOSE_LIMIT_S)
        self.inner.close()
        with self._guard:
            if self._file is not None:
                self._file.close()

    def _pump(self) -> None:
        try:
            while self._is_open:
                with self._guard:
                    has_room = self._file is None or self._file.size_bytes < MAX_BYTES
                if has_room:
                    self._take(self.inner.read())
                else:
                    time.sleep(WAIT_S)
                    self._take(b"")
        except Exception as error:  # noqa: BLE001 - read() raises it
            self._error = error

    def _take(self, piece: bytes) -> None:
        with self._guard:
            if piece and self._file is not None:
                self._file.write(piece, time.time())
            if self._file is not None:
                self._file.sync()
        if piece:
            self._pieces.put((piece, time.monotonic()))


def read_session_options(content: bytes) -> dict[str, Any]:
    """Read the session options from the content of a file. Raises ValueError if they are incomplete."""
    if len(content) < _ABOUT.size:
        raise ValueError
    found: dict[str, Any] = json.loads(content[_ABOUT.size : _find_end_of_about(content)])
    return found


def read_pieces(content: bytes) -> Iterator[tuple[bytes, float]]:
    """Yield each piece with its time of arrival; the last may be truncated."""
    place = _find_end_of_about(content) if len(content) >= _ABOUT.size else len(content)
    while place + _PIECE.size <= len(content):
        came_s, size_bytes = _PIECE.unpack_from(content, place)
        place += _PIECE.size
        yield content[place : place + size_bytes], came_s
        place += size_bytes


def _find_end_of_about(content: bytes) -> int:
    return _ABOUT.size + int(_ABOUT.unpack_from(content)[0])


@dataclass(frozen=True, slots=True)
class SessionOptions:
    """The options of a session.

    ``source``: lines of a board, or a replay of ``recording_path`` (None: the demonstration) at ``speed``.
    ``name``: of the source, for display. ``cues``: kind, angle_deg and limit of each rule. ``silence_s``: the
    session ends after this time without a byte.
    """

    source: Literal["lines", "replay"]
    name: str
    subject: str = ""
    side: Side | None = None
    axis: ArmAxis | None = None
    cues: tuple[Mapping[str, Any], ...] = ()
    countdown_s: float = 5.0
    recording_path: Path | None = None
    speed: float = 1.0
    silence_s: float = inf
    learn_limit_s: float = field(default_factory=lambda: LEARN_LIMIT_S)


@dataclass(frozen=True, slots=True)
class SessionFiles:
    """The id of a session and the paths of its files."""

    folder: Path
    session_id: str
    is_kept: bool

    @property
    def raw(self) -> Path:
        """The raw file."""
        return self.folder / f"{KEPT if self.is_kept else PLAYED}{self.session_id}{RAW}"

    @property
    def early(self) -> Path:
        """The file of early bytes."""
        return self.folder / f"{KEPT}{self.session_id}{EARLY}"

    @property
    def shown(self) -> Path:
        """The displayed angles."""
        return self.folder / f"{KEPT}{self.session_id}{SHOWN}"

    @property
    def marks(self) -> Path:
        """The marked moments, a line of JSON each: seconds from the first sample, and a label."""
        return self.folder / f"{KEPT}{self.session_id}{MARKS}"

    def remove(self) -> None:
        """Delete the files, except the displayed angles."""
        self.marks.unlink(missing_ok=True)
        self.early.unlink(missing_ok=True)
        self.raw.unlink(missing_ok=True)


def create_session_files(folder: Path, *, keeps: bool) -> SessionFiles:
    """Create the folder, and choose the id of a session."""
    make_folder(folder)
    return SessionFiles(folder, secrets.token_urlsafe(12), keeps)


def find_interrupted_files(folder: Path) -> tuple[SessionFiles, ...]:
    """Return the files of interrupted sessions that are to be kept."""
    names = {path.stem for ending in (RAW, EARLY) for path in folder.glob(f"{KEPT}*{ending}")}
    return tuple(SessionFiles(folder, name.removeprefix(KEPT), is_kept=True) for name in sorted(names))
