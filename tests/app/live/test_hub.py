"""Sessions that end otherwise than by Stop, and the process in which each runs."""

import os
import re
import signal
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError
from websockets.sync.client import connect

from acromion.app.analysis.attempt import Limits
from acromion.app.errors import TooManySessions
from acromion.app.live import hub as hubs
from acromion.app.live.hub import Ended, LiveHub, RunningSession
from acromion.app.live.ports import PushedPort, SessionFiles, SessionOptions, create_session_files
from acromion.fusion.readers import read_recording
from tests.fusion.live.test_lines import HEADER, PREAMBLE, write_rows
from tests.ways_in.servers import RunningServer, read_command, wait_for

LIMITS = Limits(6 << 30, 60.0)
OPTIONS = SessionOptions("lines", "board", axis="+z")
WORST = [b"a" * 300_000, b"ax: 0 " * 50_000, b"(" * 4000 + b"\n", b'"' * 4000 + b"\n", b"1,2,3\n" * 9000]


@dataclass
class Shelf:
    """A library that remembers, or refuses."""

    folder: Path
    error: Exception | None = None
    kept: list[int] = field(default_factory=list)

    def begin(self) -> SessionFiles:
        return create_session_files(self.folder / "live", keeps=True)

    def keep(self, ended: Ended) -> str:
        if self.error:
            raise self.error
        self.kept.append(count_rows(ended.files))
        return "an_1"

    def announce(self, session_id: str, cue: Mapping[str, Any]) -> None:
        raise AssertionError


def count_rows(files: SessionFiles) -> int:
    with files.raw.open("rb") as file:
        return sum(map(len, read_recording(file, file_name="live.csv").segments))


class Started:
    """A session of a board that has sent 300 rows, and its messages."""

    def __init__(self, shelf: Shelf, files: SessionFiles, hub: LiveHub | None = None) -> None:
        port = PushedPort()
        port.push((PREAMBLE + HEADER + write_rows(0, 300)).encode())
        self.hub, self.messages = hub or LiveHub(shelf), list[dict[str, Any]]()
        self.session = self.hub.start(OPTIONS, files, LIMITS, port)
        self.session.watch(lambda message: self.messages.append(dict(message)))
        wait_for(lambda: self.messages[-1].get("status", {}).get("frames") == 300)

    def wait_for_end(self) -> dict[str, Any]:
        for thread in self.hub._threads.values():
            thread.join()
        return self.messages[-1]


@pytest.mark.parametrize("died_by", [signal.SIGKILL, signal.SIGSTOP], ids=["dies", "does not respond"])
def test_a_process_that_ends_ends_its_session_with_a_code_and_every_shown_row_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, died_by: signal.Signals
) -> None:
    shelf = Shelf(tmp_path)
    started = Started(shelf, shelf.begin())

    monkeypatch.setattr(hubs, "STALL_S", 2.0)
    os.kill(started.session.pid, died_by)
    end = started.wait_for_end()

    assert (end["state"], end["code"], end["analysis"]) == ("failed", "E-LIVE-STOPPED", "an_1")
    assert shelf.kept == [300]
    assert list((tmp_path / "live").iterdir()) == []


def test_a_board_that_changes_its_rate_ends_the_session_with_the_code_and_what_came_is_kept(
    tmp_path: Path,
) -> None:
    shelf = Shelf(tmp_path)
    started = Started(shelf, shelf.begin())

    started.session.push(re.sub("(?m)^(\\d+)", lambda stamp: f"{stamp[0]}0", write_rows(300, 700)).encode())
    end = started.wait_for_end()

    assert (end["state"], end["code"], end["analysis"]) == ("failed", "E-TIME", "an_1")
    assert shelf.kept == [300]


def list_pipes() -> set[str]:
    return {link for link in map(read_link, Path("/proc/self/fd").iterdir()) if link.startswith("pipe:")}


def read_link(path: Path) -> str:
    try:
        return str(path.readlink())
    except FileNotFoundError:  # the folder itself was listed
        return ""


def test_an_ended_session_holds_no_open_file(tmp_path: Path) -> None:
    shelf = Shelf(tmp_path)
    first = Started(shelf, shelf.begin())  # starts the fork server
    first.session.stop()
    first.wait_for_end()
    before = list_pipes()
    started = Started(shelf, shelf.begin())
    during = list_pipes()

    started.session.stop()
    started.wait_for_end()

    assert during - before
    assert list_pipes() <= before


def test_the_hub_forgets_the_oldest_ended_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hubs, "MOST_ENDED", 1)
    shelf = Shelf(tmp_path)
    first = Started(shelf, shelf.begin())
    first.session.stop()
    first.wait_for_end()
    second = Started(shelf, shelf.begin(), first.hub)
    second.session.stop()
    second.wait_for_end()

    third = Started(shelf, shelf.begin(), first.hub)

    assert set(first.hub._sessions) == {second.session.id, third.session.id}
    third.session.stop()
    third.wait_for_end()


@pytest.mark.parametrize("error", [OSError("full"), OperationalError("", None, OSError("database away"))])
def test_a_raw_file_that_cannot_be_taken_in_stays_for_the_next_start(
    tmp_path: Path, error: Exception
) -> None:
    shelf = Shelf(tmp_path, error)
    files = shelf.begin()
    started = Started(shelf, files)

    started.session.stop()
    end = started.wait_for_end()

    assert (end["state"], end["analysis"]) == ("failed", "")
    assert count_rows(files) == 300


def test_more_sessions_than_the_server_runs_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hubs, "MAX_SESSIONS", 0)

    with pytest.raises(TooManySessions):
        LiveHub(Shelf(tmp_path)).start(OPTIONS, Shelf(tmp_path).begin(), LIMITS, PushedPort())


class NoProcess:
    """The process of a session that no test starts."""


def make_session(folder: Path) -> RunningSession:
    session = RunningSession(Shelf(folder).begin(), OPTIONS, None, NoProcess())  # type: ignore[arg-type]
    session._facts = {"name": "made", "device": "other", "rate_hz": 100.0}
    return session


@pytest.mark.parametrize("comes_back", [True, False], ids=["back", "link lost"])
def test_a_session_to_which_somebody_comes_back_or_whose_link_was_lost_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, comes_back: bool
) -> None:
    monkeypatch.setattr(hubs, "CLOSED_TERM_S", -1.0)
    session = make_session(tmp_path)

    session.leave(session.watch(lambda _: None), was_closed=comes_back)
    if comes_back:
        session.watch(lambda _: None)

    assert not session.is_left()


def test_a_watch_that_ends_ends_no_other(tmp_path: Path) -> None:
    session = make_session(tmp_path)
    seen: list[str] = []
    first = session.watch(lambda _: None)
    session.watch(lambda message: seen.append(f"second {message['type']}"))
    session.leave(first)
    session.watch(lambda message: seen.append(f"third {message['type']}"))

    session.pause_cues(paused=True)

    assert seen[-2:] == ["second cues", "third cues"]


# --- a real server and real sockets -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunningServer]:
    folder = tmp_path_factory.mktemp("server")
    running = RunningServer(folder / "data", folder / "log", 0, ACROMION_NO_SECRET="1")
    yield running
    running.stop()


def find_readers(server: RunningServer) -> set[int]:
    """Return the processes that have the raw file of a session open."""
    found = set()
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            name = str(link.readlink())
        except OSError:
            continue
        if name.startswith(str(server.data / "live")) and name.endswith(".raw"):
            found.add(int(link.parts[2]))
    return found


@pytest.mark.parametrize("lines", WORST, ids=lambda lines: repr(lines[:6]))
def test_hostile_lines_are_read_in_a_separate_process_while_the_server_answers(
    server: RunningServer, lines: bytes
) -> None:
    address = server.address.replace("http", "ws") + "api/v1/live"
    with connect(address, max_size=None) as socket:
        socket.send('{"type": "start", "source": "lines", "name": "board", "axis": "+z"}')
        socket.send((PREAMBLE + HEADER + write_rows(0, 300)).encode())
        socket.recv()
        for start in range(0, len(lines), 65_536):
            socket.send(lines[start : start + 65_536])
        readers = find_readers(server)
        health = server.client.get("/healthz").status_code
        socket.send('{"type": "stop"}')
        while '"ended"' not in (end := str(socket.recv())):
            pass

    assert health == 200
    assert len(readers) == 1
    assert server.process.pid not in readers
    assert '"state":"stopped"' in end
    loaded = Path(f"/proc/{server.process.pid}/maps").read_text()
    assert "llvmlite" not in loaded  # without it acromion.fusion.live cannot be imported


def test_a_killed_server_leaves_no_process_of_a_session(server: RunningServer) -> None:
    with connect(server.address.replace("http", "ws") + "api/v1/live") as socket:
        socket.send('{"type": "start", "source": "demo"}')
        socket.recv()
        (reader,) = find_readers(server)
        server.kill()

    wait_for(lambda: not read_command(reader))
