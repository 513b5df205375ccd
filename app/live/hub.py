"""The live sessions of a server: each runs in its own process and continues without viewers.

A session is identified by its id. The server passes bytes on to the process (:mod:`acromion.app.live.child`)
and receives its messages; it reads no line itself. Viewers receive new data as numbered messages; a reloaded
page first receives the last minute. A viewer that is too slow loses the oldest messages, but the raw file
loses no frames. A session without viewers stops after a while; a process that dies or does not respond ends
only its session.
"""

import importlib
import itertools
import json
import logging
import queue
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import suppress
from contextvars import copy_context
from dataclasses import dataclass, field
from math import inf
from multiprocessing.connection import Connection
from typing import Any, Literal, Protocol

from sqlalchemy.exc import SQLAlchemyError

from acromion.app.analysis.attempt import MESSAGE_BYTES, Limits
from acromion.app.analysis.fork_server import NotStarted, choose_context, end_child, start_child
from acromion.app.errors import (
    AppError,
    LiveSourceFailed,
    LiveStopped,
    NotHere,
    RecordedProblem,
    TooManySessions,
)
from acromion.app.live import ports
from acromion.app.live.ports import (
    SHOWN_HZ,
    STOP,
    WAIT_S,
    EarlyPort,
    Port,
    PushedPort,
    SessionFiles,
    SessionOptions,
    pack_piece,
)

HISTORY_S = 60.0
MAX_SESSIONS = 50
ENDED_TERM_S = 3600.0
"""How long an ended session can be queried, if it is among the last :data:`MOST_ENDED`."""
MOST_ENDED = 200
TICK_S = 0.2
SENDER_LIMIT_S = 5.0
STALL_S = 60.0
"""The process of a session sends a message every second; after this silence it is killed."""
CLOSE_LIMIT_S = 10.0
"""When the server stops, a session has this time to read the bytes received before; otherwise any time."""
CLOSED_TERM_S = 60.0
"""A session continues for this time after its page was closed, because the page may only be reloading."""
LOST_TERM_S = 600.0
"""The same after a lost connection, because the viewer may not have left on purpose."""

MOST_MARKS = 1000
"""Further marks are ignored."""

State = Literal["running", "stopped", "failed"]
Message = Mapping[str, Any]
Watch = Callable[[Message], None]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Ended:
    """The files, options and cues of an ended session."""

    files: SessionFiles
    options: SessionOptions
    cues: tuple[Message, ...] = ()


class Library(Protocol):
    """Receives the results of sessions."""

    def keep(self, ended: Ended) -> str:
        """Store the raw file as a recording and return the id of its analysis; "" if it has no row."""

    def announce(self, session_id: str, cue: Message) -> None:
        """Notify the webhooks that subscribed to cues."""


def load_and_run(
    pipe: Connection, options: SessionOptions, files: SessionFiles, limits: Limits, level: int
) -> None:
    """Run a session; only the child process loads ``fusion``."""
    importlib.import_module("acromion.app.live.child").run(pipe, options, files, limits, level)


class SessionProcess:
    """The process of a session, and the pipe to it. One thread sends, another receives."""

    def __init__(self, options: SessionOptions, files: SessionFiles, limits: Limits) -> None:
        """Start the process. Raises LiveStopped."""
        context = choose_context()
        self._pipe, theirs = context.Pipe()
        arguments = (theirs, options, files, limits, logging.getLogger().level)
        self._child = context.Process(target=load_and_run, args=arguments, daemon=True)
        try:
            start_child(self._child)
        except NotStarted as error:
            self._pipe.close()
            raise LiveStopped from error
        finally:
            theirs.close()

    @property
    def pid(self) -> int:
        """The id of the process."""
        return int(self._child.pid or 0)

    def send(self, message: bytes) -> None:
        """Send bytes; waits while the process is busy. Raises OSError."""
        self._pipe.send_bytes(message)

    def receive(self, limit_s: float) -> dict[str, Any] | None:
        """Wait for a message; return None if none comes. Raises LiveStopped if the process has died."""
        try:
            if not self._pipe.poll(limit_s):
                return None
            message: dict[str, Any] = json.loads(self._pipe.recv_bytes(MESSAGE_BYTES))
        except (EOFError, OSError, ValueError) as error:
            raise LiveStopped from error
        return message

    def end(self, sender: threading.Thread) -> None:
        """Kill the process if it runs; close the pipe when the thread that sends has noticed."""
        end_child(self._child)
        with suppress(ValueError):  # its end is not reported
            self._child.close()  # otherwise an ended session holds two open files
        sender.join(SENDER_LIMIT_S)
        if not sender.is_alive():  # else it could send into a file that reuses the number of the pipe
            self._pipe.close()


class RunningSession:
    """One session: its port, its process, its viewers."""

    def __init__(
        self, files: SessionFiles, options: SessionOptions, port: Port | None, process: SessionProcess
    ) -> None:
        self.id, self.files, self.options = files.session_id, files, options
        self.state: State = "running"
        self.code = self.analysis_id = ""
        self.was_left = self.are_cues_paused = False
        self.cues: list[Message] = []
        self.ended_s = 0.0
        self._port, self._process = port, process
        self._facts: Message = {}
        self._status: Message = {}
        self._lock = threading.Lock()
        self._watchers: dict[int, Watch] = {}
        self._keys = itertools.count()
        self._history: deque[tuple[float, float | None]] = deque(maxlen=round(HISTORY_S * SHOWN_HZ))
        self._sequence = self._passed_bytes = self._marked = 0
        self._came_s = 0.0
        self._commands: queue.SimpleQueue[Message] = queue.SimpleQueue()
        self._closes_s, self._ends_s = inf, inf
        self._is_stopping = threading.Event()
        self._is_over = threading.Event()
        self._feeding: threading.Thread

    @property
    def pid(self) -> int:
        """The id of the process that reads the lines."""
        return self._process.pid

    def describe(self) -> dict[str, Any]:
        """Return the first message for a viewer."""
        return {
            "type": "session",
            "session": self.id,
            "source": self._facts["name"],
            "device": self._facts["device"],
            "rate_hz": self._facts["rate_hz"],
            "state": self.state,
            "analysis": self.analysis_id,
            "keeps": self.files.is_kept,
            "cues": self.options.cues,
            "cues_paused": self.are_cues_paused,
        }

    def watch(self, watch: Watch) -> int:
        """Send the description, the last minute and all new data; return the key for :meth:`leave`."""
        with self._lock:
            key = next(self._keys)
            self._watchers[key] = watch
            self._ends_s = inf
            watch(self.describe())
            watch(self._describe_update(list(self._history), "history"))
            if self.state != "running":
                watch(self._describe_end())
        return key

    def leave(self, key: int, *, was_closed: bool = True) -> None:
        """Remove a viewer; after the last one the session ends, unless a viewer returns in time."""
        with self._lock:
            self._watchers.pop(key, None)
            if not self._watchers:
                self._ends_s = time.monotonic() + (CLOSED_TERM_S if was_closed else LOST_TERM_S)

    def is_left(self) -> bool:
        """Return whether the last viewer left and none returned in time."""
        return time.monotonic() > self._ends_s

    def push(self, piece: bytes) -> bool:
        """Add bytes from a page to the session's source; return False while the source is full."""
        pushed = self._port.inner if isinstance(self._port, EarlyPort) else self._port
        is_taken = isinstance(pushed, PushedPort) and not self._is_stopping.is_set()
        return pushed.push(piece) if is_taken and isinstance(pushed, PushedPort) else True

    def ask_pose(self, countdown_s: float) -> None:
        """Ask for the calibration pose, for the first time or again."""
        self._commands.put({"type": "pose", "countdown_s": countdown_s})

    def pause_cues(self, *, paused: bool) -> None:
        """Pause or resume cues."""
        with self._lock:
            self.are_cues_paused = paused
            self._send({"type": "cues", "paused": paused})

    def mark(self, label: str) -> None:
        """Note the newest sample as a moment that a person marks. Raises OSError."""
        with self._lock:
            if not self.files.is_kept or self.state != "running" or self._marked >= MOST_MARKS:
                return
            self._marked += 1
            mark = {"time_s": self._status["elapsed_s"], "label": label}
            with self.files.marks.open("a", encoding="utf-8") as file:
                file.write(json.dumps(mark) + "\n")
            self._send({"type": "mark", "count": self._marked, **mark})

    def stop(self, limit_s: float = inf) -> None:
        """Ask the session to end after the bytes received so far, at the latest after this time."""
        self._closes_s = min(self._closes_s, time.monotonic() + limit_s)
        self._is_stopping.set()

    def open(self, piece: bytes, limit_s: float) -> None:
        """Pass the first bytes on and wait for the facts of the source.

        Raises LiveStopped, or RecordedProblem with the code of a refusal.
        """
        self._feeding = threading.Thread(target=self._feed, args=(piece,), name="live-feed", daemon=True)
        self._feeding.start()
        try:
            end_s, first = time.monotonic() + limit_s, None
            while first is None:
                if time.monotonic() > end_s:
                    raise LiveStopped
                first = self._process.receive(TICK_S)
            if "code" in first:
                raise RecordedProblem(first["code"], first["facts"])
            self._facts, self._status = first["source"], first["status"]
        except BaseException:
            self._is_over.set()
            self._process.end(self._feeding)
            raise

    def _feed(self, piece: bytes) -> None:
        """Pass this piece, then the bytes of the port and the commands on to the process until it ends."""
        port = self._port
        with suppress(OSError):  # the process has ended; the other thread handles it
            while not self._is_over.is_set():
                if piece:
                    came_s = port.now_s() if isinstance(port, EarlyPort) else time.monotonic()
                    self._process.send(pack_piece(piece, came_s))
                    self._passed_bytes += len(piece)
                while not self._commands.empty():
                    self._process.send(json.dumps(self._commands.get()).encode())
                is_behind = isinstance(port, EarlyPort | PushedPort) and port.is_behind
                if self._is_stopping.is_set() and not is_behind:
                    self._process.send(json.dumps(STOP).encode())
                    return
                if port is None:
                    self._is_over.wait(WAIT_S)
                else:
                    piece = port.read()

    def run(self, library: Library) -> None:
        """Handle the messages of the process until it ends; then store the raw file."""
        state: State = "failed"
        try:
            self.code = self._follow(library)
            state = "failed" if self.code else "stopped"
        except LiveStopped as error:
            self.code = error.code
        finally:
            if self.code:
                logger.error("live session %s ended with %s; its raw file is kept", self.id, self.code)
            self._end(state, library)

    def _follow(self, library: Library) -> str:
        """Return the code of the end, "" if the session was stopped. Raises LiveStopped."""
        heard_s = time.monotonic()
        while True:
            message, now_s = self._process.receive(TICK_S), time.monotonic()
            if self.is_left():
                self.was_left = True
                self.stop()
            heard_s = heard_s if message is None else now_s
            if message is not None and "end" in message:
                return str(message["end"])
            if now_s > min(heard_s + STALL_S, self._closes_s):
                raise LiveStopped
            if message is None:
                continue
            if "cue" in message:
                self._send_cue(message["cue"], library)
            elif "points" in message:
                with self._lock:
                    self._history.extend(message["points"])
                    self._sequence += 1
                    self._status, self._came_s = message["status"], message["came_s"]
                    self._send(self._describe_update(message["points"], "update"))
            elif message["synced_bytes"] == self._passed_bytes:
                self._release()

    def _release(self) -> None:
        """Delete the file of early bytes if the process has received all of them."""
        if isinstance(self._port, EarlyPort) and not self._port.is_behind:
            self._port.release()

    def _send_cue(self, cue: Message, library: Library) -> None:
        """Notify viewers and webhooks; a failing webhook does not end the session."""
        with self._lock:
            if self.are_cues_paused:
                return
            self.cues.append(cue)
            self._send({"type": "cue", **cue})
        try:
            library.announce(self.id, cue)
        except SQLAlchemyError:
            logger.exception("a cue could not be announced")

    def _describe_update(self, points: list[tuple[float, float | None]], kind: str) -> dict[str, Any]:
        return {
            "type": kind,
            "sequence": self._sequence,
            "came_s": self._came_s,
            "points": points,
            "status": self._status,
        }

    def _describe_end(self) -> dict[str, Any]:
        end = {"type": "ended", "state": self.state, "code": self.code, "analysis": self.analysis_id}
        return end | {"cues": len(self.cues), "was_left": self.was_left}

    def _send(self, message: Message) -> None:
        for watch in self._watchers.values():
            watch(message)

    def _end(self, state: State, library: Library) -> None:
        """End the process and store the raw file; if that fails, the next server start retries."""
        self._is_over.set()
        self._process.end(self._feeding)
        analysis_id = ""
        try:
            if self._port is not None:
                self._port.close()
            if state == "stopped":
                self._release()
            ended = Ended(self.files, self.options, tuple(self.cues))
            analysis_id = library.keep(ended) if self.files.is_kept else ""
            self.files.remove()
        except (AppError, RecordedProblem, OSError, SQLAlchemyError):
            logger.exception("the raw file of a live session stays in its folder")
            state = "failed"
        with self._lock:
            self.state, self.analysis_id, self.ended_s = state, analysis_id, time.monotonic()
            self._send(self._describe_end())
            self._port = None  # an ended session is kept for an hour, but not its bytes and points
            self._history.clear()


@dataclass(slots=True)
class LiveHub:
    """The sessions of this server."""

    library: Library
    _sessions: dict[str, RunningSession] = field(default_factory=dict)
    _threads: dict[str, threading.Thread] = field(default_factory=dict)
    _starting: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def start(
        self,
        options: SessionOptions,
        files: SessionFiles,
        limits: Limits,
        port: Port | None = None,
        is_wanted: Callable[[], bool] = lambda: True,
    ) -> RunningSession:
        """Start a session; ``port`` sends the lines. A silent port gets no process.

        Raises TooManySessions, LiveSourceFailed, LiveStopped, or RecordedProblem with the code of a refusal.
        """
        with self._lock:
            self._drop_ended()
            running = sum(one.state == "running" for one in self._sessions.values())
            if running + self._starting >= MAX_SESSIONS:
                raise TooManySessions(max=MAX_SESSIONS)
            self._starting += 1
        try:
            piece = b"" if port is None else _wait_for_bytes(port, options.name, is_wanted)
            session = RunningSession(files, options, port, SessionProcess(options, files, limits))
            session.open(piece, limits.wall_s)
            run = (session.run, self.library)
            thread = threading.Thread(target=copy_context().run, args=run, name="live", daemon=True)
            self._sessions[session.id], self._threads[session.id] = session, thread
            thread.start()
        finally:
            with self._lock:
                self._starting -= 1
        return session

    def _drop_ended(self) -> None:
        ended = [session for session in self._sessions.values() if session.state != "running"]
        ended.sort(key=lambda session: session.ended_s, reverse=True)
        for rank, session in enumerate(ended):
            if rank >= MOST_ENDED or time.monotonic() - session.ended_s > ENDED_TERM_S:
                del self._sessions[session.id], self._threads[session.id]
                session.files.shown.unlink(missing_ok=True)

    def get(self, session_id: str) -> RunningSession:
        """Return a session that is running or ended less than an hour ago. Raises NotHere."""
        session = self._sessions.get(session_id)
        if session is None:
            raise NotHere
        return session

    def close(self) -> None:
        """Stop all sessions when the server stops; their raw files become recordings."""
        for session in self._sessions.values():
            session.stop(CLOSE_LIMIT_S)
        for thread in self._threads.values():
            thread.join(2 * CLOSE_LIMIT_S)
        for session in self._sessions.values():
            session.files.shown.unlink(missing_ok=True)


def _wait_for_bytes(port: Port, name: str, is_wanted: Callable[[], bool]) -> bytes:
    """Return the first bytes of a port. Raises LiveSourceFailed."""
    began_s = time.monotonic()
    while is_wanted() and time.monotonic() - began_s < ports.LEARN_LIMIT_S:
        if piece := port.read():
            return piece
    raise LiveSourceFailed(name=name, why="silent")
