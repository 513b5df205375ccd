"""A board on a serial port (a pseudo-terminal), over UDP and over TCP."""

import os
import pty
import socket
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from acromion.app.errors import LiveSourceFailed
from acromion.app.live.ports import MAX_PIECES, PushedPort, SerialPort, TcpPort, UdpPort, is_port, open_port
from acromion.app.live.sources import LineSource, open_lines
from acromion.fusion.live import LiveSession
from tests.fusion.live.test_lines import HEADER, PREAMBLE, write_rows

BOARD = PREAMBLE + HEADER


class Board:
    """A board at the other end of a pseudo-terminal; it can be unplugged and plugged in again."""

    def __init__(self, folder: Path) -> None:
        self.path = folder / "ttyBoard"
        self.plug_in()

    def plug_in(self) -> None:
        self._end, self._ours = pty.openpty()
        tty.setraw(self._ours)
        self.path.symlink_to(os.ttyname(self._ours))

    def unplug(self) -> None:
        self.path.unlink()
        os.close(self._end)
        os.close(self._ours)

    def write(self, text: str) -> None:
        """Write it all; a terminal takes a few kilobytes at a time, so somebody has to read meanwhile."""
        content = text.encode()
        while content:
            content = content[os.write(self._end, content[:1024]) :]

    def write_meanwhile(self, text: str) -> threading.Thread:
        thread = threading.Thread(target=self.write, args=(text,))
        thread.start()
        return thread


@pytest.fixture
def board(tmp_path: Path) -> Iterator[Board]:
    made = Board(tmp_path)
    yield made
    made.unplug()


def listen(board: Board, text: str) -> tuple[LineSource, threading.Thread]:
    """Open the port, which forgets what was written before, and have the board write."""
    port = SerialPort(str(board.path))
    writing = board.write_meanwhile(text)
    return LineSource(port, "board"), writing


def read_nothing(source: LineSource) -> None:
    """Have the source look whether its port is there."""
    found = source.read()
    assert found is not None
    assert len(found) == 0


def read_until(source: LineSource, session: LiveSession, frames: int) -> None:
    while session.status().frames < frames:
        found = source.read()
        assert found is not None
        session.take(found)


def test_a_serial_port_is_read_to_the_last_row(board: Board) -> None:
    source, writing = listen(board, BOARD + write_rows(0, 1000))
    session = LiveSession(source.facts.rate_hz)

    read_until(source, session, 1000)

    writing.join()
    source.close()
    assert (source.facts.device, source.facts.rate_hz) == ("lsm9ds1", 100.0)
    assert session.status().lost == 0


def test_a_board_that_is_unplugged_comes_back_into_the_same_session(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("acromion.app.live.ports.REOPEN_S", 0.01)
    source, writing = listen(board, BOARD + write_rows(0, 300))
    session = LiveSession(source.facts.rate_hz)
    read_until(source, session, 300)
    writing.join()

    board.unplug()
    read_nothing(source)
    board.plug_in()
    read_nothing(source)
    writing = board.write_meanwhile(BOARD + write_rows(0, 300))
    read_until(source, session, 600)
    writing.join()
    source.close()

    assert session.status().holes == 1


def test_a_port_that_is_not_there_or_serves_another_session_is_said(board: Board, tmp_path: Path) -> None:
    port = SerialPort(str(board.path))

    for name in (tmp_path / "none", board.path):
        with pytest.raises(LiveSourceFailed) as refusal:
            open_lines(str(name), 115_200, tmp_path / "live-a.early", {})
        assert refusal.value.facts["why"] == "port"

    port.close()


class Clock:
    """Nine seconds pass between two looks."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        self.time_s += 9.0
        return self.time_s


@pytest.mark.parametrize(("said", "why"), [("", "silent"), (write_rows(0, 20), "no header")])
def test_a_board_without_a_word_or_a_header_is_said(board: Board, said: str, why: str) -> None:
    port = SerialPort(str(board.path))
    board.write(said)

    with pytest.raises(LiveSourceFailed) as refusal:
        LineSource(port, "board", now_s=Clock().now_s)

    assert refusal.value.facts["why"] == why


def test_datagrams_are_read_and_a_second_sender_is_not_heard() -> None:
    port = UdpPort("127.0.0.1", 0)
    lines = (BOARD + write_rows(0, 400)).splitlines(keepends=True)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as board,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        for first in range(0, len(lines), 10):
            board.sendto("".join(lines[first : first + 10]).rstrip("\n").encode(), ("127.0.0.1", port.port))
            other.sendto(write_rows(0, 5).encode(), ("127.0.0.1", port.port))
        source = LineSource(port, "udp")
        session = LiveSession(source.facts.rate_hz)
        read_until(source, session, 400)
    source.close()

    assert session.status().lost == 0


def test_a_board_that_starts_anew_from_another_port_is_heard_after_a_silence() -> None:
    passed_s = [0.0]
    port = UdpPort("127.0.0.1", 0, now_s=lambda: passed_s[0])
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as before,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as after,
    ):
        before.sendto(b"1\n", ("127.0.0.1", port.port))
        port.read()
        passed_s[0] = 6.0
        after.sendto(b"2\n", ("127.0.0.1", port.port))

        assert port.read() == b"2\n"
    port.close()


def test_a_line_that_brings_nothing_is_called_again() -> None:
    passed_s = [0.0]
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = TcpPort("127.0.0.1", server.getsockname()[1], now_s=lambda: passed_s[0])
        silent, _ = server.accept()
        passed_s[0] = 11.0
        port.read()
        again, _ = server.accept()
        with silent, again:
            again.sendall(b"3\n")

            assert port.read() == b"3\n"
        port.close()


def test_bytes_that_a_full_port_cannot_take_are_not_lost() -> None:
    port = PushedPort()
    taken = sum(port.push(b"x") for _ in range(MAX_PIECES + 1))

    assert taken == MAX_PIECES
    assert port.read() == b"x"
    assert port.push(b"y")


def test_a_board_over_tcp_is_read_and_called_again() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = TcpPort("127.0.0.1", server.getsockname()[1])
        first, _ = server.accept()
        first.sendall((BOARD + write_rows(0, 300)).encode())
        source = LineSource(port, "tcp")
        session = LiveSession(source.facts.rate_hz)
        read_until(source, session, 300)
        first.close()
        calling = threading.Thread(target=lambda: answer_again(server))
        calling.start()
        read_until(source, session, 400)
        calling.join()
        source.close()

    assert session.status().frames == 400


def answer_again(server: socket.socket) -> None:
    again, _ = server.accept()
    with again:
        again.sendall((HEADER + write_rows(300, 400)).encode())


def test_ports_are_told_from_files(tmp_path: Path) -> None:
    (tmp_path / "shift.gt3x").touch()

    sources = ("/dev/ttyACM0", "COM3", "udp://:5005", "tcp://board:5005", str(tmp_path / "shift.gt3x"))
    assert [is_port(source) for source in sources] == [True] * 4 + [False]


@pytest.mark.parametrize("source", ["udp://", "tcp://:5005", "udp://:99999"])
def test_an_address_that_is_none_is_said(source: str) -> None:
    with pytest.raises(LiveSourceFailed):
        open_port(source)
