"""The live sessions of a server: each runs in its own thread and continues without viewers.

A session is identified by its id. Viewers receive new data as numbered messages; a reloaded page first
receives the last minute. A viewer that is too slow loses the oldest messages, but the raw file loses no
frames. A session without viewers stops after a while.
"""

import itertools
import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextvars import copy_context
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
from sqlalchemy.exc import SQLAlchemyError

from app.errors import AppError, NotHere, TooManySessions
from app.live.cue_log import get_limit
from app.live.ports import PushedPort, SessionFiles
from app.live.raw_file import UNKNOWN, Wearer
from app.live.recorder import Recorder
from app.live.sources import LineSource, Source
from fusion.errors import FusionError
from fusion.live import LiveRows, LiveStatus
from fusion.live.cues import Cue, CueRule
from fusion.recording import MICROSECONDS

SHOWN_HZ = 50.0
HISTORY_S = 60.0
MAX_WAITING = 250
"""Messages that wait for a slow viewer: 10 s."""
MAX_SESSIONS = 50
ENDED_TERM_S = 3600.0
"""How long an ended session can be queried."""
STOP_LIMIT_S = 10.0
CLOSED_TERM_S = 60.0
"""A session continues for this time after its page was closed, because the page may only be reloading."""
LOST_TERM_S = 600.0
"""The same after a lost connection, because the viewer may not have left on purpose."""

State = Literal["running", "stopped", "failed"]
Message = Mapping[str, Any]
Watch = Callable[[Message], None]

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class SessionRequest:
    """The options of a session."""

    wearer: Wearer = UNKNOWN
    rules: tuple[CueRule, ...] = ()
    countdown_s: float = 5.0


@dataclass(frozen=True, slots=True)
class Ended:
    """The files, options and cues of an ended session."""

    files: SessionFiles
    request: SessionRequest
    cues: tuple[Cue, ...] = ()


class Library(Protocol):
    """Receives the results of sessions."""

    def keep(self, ended: Ended) -> str:
        """Store the raw file as a recording and return the id of its analysis."""

    def announce(self, session_id: str, cue: Cue) -> None:
        """Notify the webhooks that subscribed to cues."""


class RunningSession:
    """One session: its source, its recorder, its viewers."""

    def __init__(
        self, files: SessionFiles, source: Source, recorder: Recorder, request: SessionRequest
    ) -> None:
        self.id, self.files = files.session_id, files
        self.source, self.recorder, self.request = source, recorder, request
        self.state: State = "running"
        self.was_left = False
        self.analysis_id = ""
        self.ended_s = 0.0
        self._lock = threading.Lock()
        self._watchers: dict[int, Watch] = {}
        self._keys = itertools.count()
        self._history: deque[tuple[float, float | None]] = deque(maxlen=round(HISTORY_S * SHOWN_HZ))
        self._step = max(1, round(source.facts.rate_hz / SHOWN_HZ))
        self._row = self._sequence = 0
        self._is_stopping = threading.Event()
        self._ends_s: float | None = None
        self._early = source.early
        port = source.port if isinstance(source, LineSource) else None
        self._pushed = self._early.inner if self._early is not None else port
        self._asked_pose_s: float | None = request.countdown_s if recorder.session.arm_axis is None else None

    def describe(self) -> dict[str, Any]:
        """Return the first message for a viewer."""
        facts = self.source.facts
        return {
            "type": "session",
            "session": self.id,
            "source": facts.name,
            "device": facts.device,
            "rate_hz": round(facts.rate_hz, 3),
            "state": self.state,
            "analysis": self.analysis_id,
            "keeps": self.files.is_kept,
            "cues": [_describe_rule(rule) for rule in self.request.rules],
            "cues_paused": self.recorder.are_cues_paused,
        }

    def watch(self, watch: Watch) -> int:
        """Send the description, the last minute and all new data; return the key for :meth:`leave`."""
        with self._lock:
            key = next(self._keys)
            self._watchers[key] = watch
            self._ends_s = None
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

    def push(self, piece: bytes) -> bool:
        """Add bytes from a page to the session's source; return False while the source is full."""
        return self._pushed.push(piece) if isinstance(self._pushed, PushedPort) else True

    def ask_pose(self, countdown_s: float) -> None:
        """Ask for the calibration pose, for the first time or again."""
        with self._lock:
            self._asked_pose_s = countdown_s

    def pause_cues(self, *, paused: bool) -> None:
        """Pause or resume cues."""
        self.recorder.are_cues_paused = paused
        with self._lock:
            self._send({"type": "cues", "paused": paused})

    def stop(self) -> None:
        """Ask the session to end; it ends with or without further frames."""
        self._is_stopping.set()

    def run(self, library: Library) -> None:
        """Process frames until the source ends or the session is stopped."""
        state: State = "failed"
        try:
            while not self._is_over() and (frames := self.source.read()) is not None:
                self._start_pose()
                if len(frames):
                    rows = self.recorder.take(frames)
                    self._publish(rows)
                    self._send_cues(self.recorder.take_cues(rows), library)
                    if self._early is not None and self.recorder.settle(self._early):
                        self._early = None
            state = "stopped"
        except (AppError, FusionError, OSError):
            logger.exception("a live session failed; its raw file is kept")
        finally:
            self.source.close()
            self._end(state, library)

    def _is_over(self) -> bool:
        """Return whether the session was stopped or abandoned, and all earlier bytes are processed."""
        with self._lock:
            if self._ends_s is not None and time.monotonic() > self._ends_s:
                self.was_left = True
                self._is_stopping.set()
        return self._is_stopping.is_set() and (self._early is None or not self._early.is_behind)

    def _start_pose(self) -> None:
        """Start the pose, but not while buffered data is processed: the wearer could not react yet."""
        with self._lock:
            if self._asked_pose_s is not None and self._early is None:
                self.recorder.session.ask_pose(self._asked_pose_s)
                self._asked_pose_s = None

    def _publish(self, rows: LiveRows) -> None:
        shown = np.arange(-self._row % self._step, len(rows.time_us), self._step)
        self._row += len(rows.time_us)
        points = [
            (round(time_us / MICROSECONDS, 3), round(angle, 2) if is_valid else None)
            for time_us, angle, is_valid in zip(
                rows.time_us[shown].tolist(),
                rows.elevation_deg[shown].tolist(),
                rows.valid[shown].tolist(),
                strict=True,
            )
        ]
        with self._lock:
            self._history.extend(points)
            self._sequence += 1
            self._send(self._describe_update(points, "update"))

    def _send_cues(self, cues: list[Cue], library: Library) -> None:
        """Notify viewers and webhooks; a failing webhook does not end the session."""
        for cue in cues:
            with self._lock:
                self._send({"type": "cue", "time_s": round(cue.time_s, 3)} | _describe_rule(cue.rule))
            try:
                library.announce(self.id, cue)
            except SQLAlchemyError:
                logger.exception("a cue could not be announced")

    def _describe_update(self, points: list[tuple[float, float | None]], kind: str) -> dict[str, Any]:
        return {
            "type": kind,
            "sequence": self._sequence,
            "came_s": round(time.time(), 4),
            "points": points,
            "status": describe_status(self.recorder.status()),
        }

    def _describe_end(self) -> dict[str, Any]:
        count = len(self.recorder.cues)
        end = {"type": "ended", "state": self.state, "analysis": self.analysis_id}
        return end | {"cues": count, "was_left": self.was_left}

    def _send(self, message: Message) -> None:
        for watch in self._watchers.values():
            watch(message)

    def _end(self, state: State, library: Library) -> None:
        """Close the raw file and store it as a recording; if that fails, the next server start retries."""
        try:
            self.recorder.stop()
            if self._early is not None:
                self._early.release()
            ended = Ended(self.files, self.request, tuple(self.recorder.cues))
            analysis_id = library.keep(ended) if self.files.is_kept else ""
            self.files.remove()
        except (AppError, OSError, SQLAlchemyError):
            logger.exception("the raw file of a live session stays in its folder")
            state, analysis_id = "failed", ""
        with self._lock:
            self.state, self.analysis_id, self.ended_s = state, analysis_id, time.monotonic()
            self._send(self._describe_end())


def _describe_rule(rule: CueRule) -> dict[str, Any]:
    return {"kind": rule.kind, "angle_deg": rule.angle_deg, "limit": get_limit(rule)}


def describe_status(status: LiveStatus) -> dict[str, Any]:
    """Return the session state for the page."""
    return {
        "elapsed_s": round(status.elapsed_s, 3),
        "elevation_deg": None if status.elevation_deg is None else round(status.elevation_deg, 2),
        "above_s": [round(seconds, 2) for seconds in status.above_s],
        "counted_s": round(status.counted_s, 2),
        "rises": status.rises,
        "frames": status.frames,
        "lost": status.lost,
        "holes": status.holes,
        "missing_s": round(status.missing_s, 3),
        "has_rested": status.has_rested,
        "is_frame_doubtful": status.is_frame_doubtful,
        "pose": status.pose,
        "pose_left_s": round(status.pose_left_s, 2),
        "pose_refused": status.pose_refused,
        "still_g": round(status.still_g, 4),
    }


@dataclass(slots=True)
class LiveHub:
    """The sessions of this server."""

    library: Library
    _sessions: dict[str, RunningSession] = field(default_factory=dict)
    _threads: dict[str, threading.Thread] = field(default_factory=dict)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def start(self, source: Source, request: SessionRequest, files: SessionFiles) -> RunningSession:
        """Start a session. Raises TooManySessions or OSError."""
        try:
            with self._lock:
                for ended_id, ended in list(self._sessions.items()):
                    if ended.state != "running" and time.monotonic() - ended.ended_s > ENDED_TERM_S:
                        del self._sessions[ended_id], self._threads[ended_id]
                if sum(one.state == "running" for one in self._sessions.values()) >= MAX_SESSIONS:
                    raise TooManySessions(max=MAX_SESSIONS)
                recorder = Recorder(files.raw, source.facts, request.wearer, request.rules)
                session = RunningSession(files, source, recorder, request)
                run = (session.run, self.library)
                thread = threading.Thread(target=copy_context().run, args=run, name="live", daemon=True)
                self._sessions[session.id], self._threads[session.id] = session, thread
        except BaseException:
            source.close()
            raise
        thread.start()
        return session

    def get(self, session_id: str) -> RunningSession:
        """Return a session that is running or ended less than an hour ago. Raises NotHere."""
        session = self._sessions.get(session_id)
        if session is None:
            raise NotHere
        return session

    def close(self) -> None:
        """Stop all sessions when the server stops; their raw files become recordings."""
        for session in self._sessions.values():
            session.stop()
        for thread in self._threads.values():
            thread.join(STOP_LIMIT_S)
