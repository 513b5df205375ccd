"""Live sessions over a WebSocket; docs/it/live.md describes the messages."""

import asyncio
import itertools
import json
import logging
import re
import time
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import replace
from functools import partial
from math import inf
from typing import Annotated, Any, Literal, Self, get_args

from anyio import CapacityLimiter, to_thread
from anyio.lowlevel import RunVar
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from pydantic import BaseModel, ConfigDict, Field, FiniteFloat, TypeAdapter, ValidationError, model_validator

from acromion.app.analysis.attempt import choose_limits
from acromion.app.errors import AppError, BadParameter, LiveSourceFailed, LiveStopped, RecordedProblem
from acromion.app.http.middleware.problems import PROBLEM_RESPONSES, hide_tokens, show_input
from acromion.app.intake import Intake
from acromion.app.library.audit_log import record
from acromion.app.library.rows import Job
from acromion.app.live.hub import Ended, RunningSession
from acromion.app.live.ports import (
    KEPT,
    PLAYED,
    RAW,
    SHOWN,
    WAIT_S,
    EarlyFile,
    EarlyPort,
    Port,
    PushedPort,
    SessionFiles,
    SessionOptions,
    create_session_files,
    find_interrupted_files,
    find_serial_ports,
    open_port,
)
from acromion.app.report.words.messages import describe_problem
from acromion.app.report.words.wording import Language, clean_text
from acromion.app.request import LONGEST_SUBJECT, ReportRequest, check_subject
from acromion.app.services import Services, UsedLanguage, UsedServices, find_services
from acromion.app.store.folder import borrow_recording
from acromion.fusion.conventions import ArmAxis, Side
from acromion.fusion.diary import LONGEST_LABEL, DiaryEntry

# Storage of live sessions: the raw file of each kept session becomes a recording.


LIVE_FOLDER = "live"
HEAD_BYTES = 4096
MAX_NOTE_LENGTH = 1000
CUED = "cues"
"""The tag of a recording with cues, which distinguishes it from recordings without."""

logger = logging.getLogger(__name__)


class LiveLibrary:
    """Stores the raw files of sessions as recordings, queues their analysis, and announces cues."""

    def __init__(self, services: Services) -> None:
        self._services = services

    def keep(self, ended: Ended) -> str:
        """Store the file, queue its analysis and return the id of the analysis; "" if it has no row."""
        options = ended.options
        if not _write_raw(self._services, ended.files):
            return ""
        analysis = _store_session(self._services, ended.files, options.subject, options.side)
        if options.cues:  # the recording's note lists the cues, up to its length limit
            counts = Counter(_format_rule(cue) for cue in ended.cues)
            rules = [f"{rule}: {counts[rule]}" for rule in map(_format_rule, options.cues)]
            times = " ".join(f"{cue['time_s']:.0f}" for cue in ended.cues)
            row = self._services.recordings.get(analysis.recording_id)
            note = f"cues {', '.join(rules)}; s: {times}"[:MAX_NOTE_LENGTH]
            self._services.recordings.describe(row, replace(row.about, note=note))
            self._services.recordings.tag([row.id], [CUED])
        return analysis.id

    def announce(self, session_id: str, cue: Mapping[str, Any]) -> None:
        """Queue the webhook deliveries of a cue."""
        facts = {"session": session_id, "time_s": f"{cue['time_s']:.3f}", "kind": cue["kind"]}
        self._services.webhooks.announce_cue(facts | {"angle_deg": f"{cue['angle_deg']:g}"})


def _format_rule(cue: Mapping[str, Any]) -> str:
    return f"{cue['kind']}:{cue['angle_deg']:g}:{cue['limit']:g}"


def import_interrupted_sessions(services: Services) -> int:
    """Store the sessions that the last server stop interrupted as recordings; return their number."""
    folder = services.settings.data_dir / LIVE_FOLDER
    for path in (*folder.glob(f"{PLAYED}*{RAW}"), *folder.glob(f"{KEPT}*{SHOWN}")):
        path.unlink()  # a played recording is already stored
    count = 0
    for files in find_interrupted_files(folder):
        try:
            count += _store_interrupted_session(services, files)
        except (AppError, RecordedProblem, OSError):
            logger.exception("an interrupted live session stays in its folder: %s", files.session_id)
    return count


def _store_interrupted_session(services: Services, files: SessionFiles) -> bool:
    """Store the interrupted session as a recording; return False if it contains no row."""
    has_rows = _write_raw(services, files)
    if has_rows:
        with files.raw.open("rb") as file:
            head = file.read(HEAD_BYTES).decode("utf-8", "replace")
        header = dict(re.findall(r"^# (subject|side|cues): (.*)$", head, re.MULTILINE))
        side = next((one for one in get_args(Side) if one == header.get("side")), None)
        analysis = _store_session(services, files, header.get("subject", "")[:LONGEST_SUBJECT], side)
        if "cues" in header:
            services.recordings.tag([analysis.recording_id], [CUED])
    files.remove()
    return has_rows


def _write_raw(services: Services, files: SessionFiles) -> bool:
    """Write the raw file from the early bytes if they are still there; return whether it has content."""
    if files.early.exists():
        services.inspector.write_raw(files.early, files.raw)
    return files.raw.exists() and files.raw.stat().st_size > 0


def _store_session(services: Services, files: SessionFiles, subject: str, side: Side | None) -> Job:
    """Store the raw file of a session as a recording, and queue its analysis."""
    name, settings, marks = f"live-{files.session_id}.csv", services.settings, _read_marks(files)
    request = ReportRequest(
        name, subject, side, diary=marks, paper=settings.paper, appendix=settings.appendix
    )
    analysis = Intake(services.store, services.storage, services.settings).add(files.raw, request, "web")
    if marks:
        services.recordings.put_diary(services.recordings.get(analysis.recording_id), marks)
    with services.store.engine.begin() as connection:
        ended = {"session": files.session_id}
        record(connection, "live.ended", analysis.recording_id, analysis.id, other=ended)
    return analysis


def _read_marks(files: SessionFiles) -> tuple[DiaryEntry, ...]:
    """Return the marked moments as rows of a diary; a line that was not written to its end is ignored."""
    rows = []
    for line in files.marks.read_text("utf-8").splitlines() if files.marks.exists() else ():
        with suppress(ValueError):
            mark = json.loads(line)
            rows.append(DiaryEntry(mark["time_s"], None, "mark", mark["label"]))
    return tuple(rows)


SILENCE_S = 600.0
"""A session of lines ends if its page sends none for this time."""
MAX_WAITING = 250
"""Messages that wait for a slow page, about 10 s; beyond that the oldest are dropped."""
MAX_MESSAGES, MAX_MESSAGES_S = 200, 0.1
"""Most messages that are received from a page in this time; more delay only that page."""
FIRST_LIMIT_S = 30.0
"""Time limit for the first message of a page."""
MAX_STARTING = 50
"""Most sources that start at the same time, in separate threads, so that a silent board blocks no request."""
REFUSED, ENDED = 4400, 1000
GOODBYES = (1000, 1001, 1005)
"""Close codes of a program that ends and of a page that is closed or reloaded; not of a lost connection."""

router = APIRouter(prefix="/api/v1")


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Rule(_Message):
    """A cue rule; ``limit`` is in seconds, or in percent for a share."""

    kind: Literal["hold", "share", "stays"]
    angle_deg: float = Field(default=60.0, gt=0.0, lt=180.0)
    limit: float = Field(gt=0.0, lt=3600.0)

    @model_validator(mode="after")
    def check_share(self) -> Self:
        """Raise ValueError if a share is not below 100 percent."""
        if self.kind == "share" and self.limit >= 100.0:
            raise ValueError
        return self


class Start(_Message):
    """Start a session: play a recording, read a serial port of the server, or receive lines."""

    type: Literal["start"]
    source: Literal["demo", "recording", "port", "lines"]
    recording: str = ""
    port: str = ""
    name: str = Field(default="", max_length=60)
    speed: float = Field(default=1.0, ge=1.0, le=20.0)
    keeps: bool = False
    subject: str = Field(default="", max_length=LONGEST_SUBJECT)
    side: Side | None = None
    axis: ArmAxis | None = None
    cues: list[Rule] = Field(default_factory=list, max_length=10)
    countdown_s: float = Field(default=5.0, ge=0.0, le=60.0)
    lang: Language = "en"


class Resume(_Message):
    """Resume a session after a reload or a lost connection."""

    type: Literal["resume"]
    session: str
    lang: Language = "en"


class Pose(_Message):
    """Repeat the calibration pose."""

    type: Literal["pose"]
    countdown_s: float = Field(default=5.0, ge=0.0, le=60.0)


class Cues(_Message):
    """Pause or resume the cues."""

    type: Literal["cues"]
    paused: bool


class Mark(_Message):
    """Mark the present moment, such as the start of a pain."""

    type: Literal["mark"]
    label: str = Field(default="", max_length=LONGEST_LABEL)


class Stop(_Message):
    """End the session."""

    type: Literal["stop"]


class Ping(_Message):
    """Ask for the server's clock."""

    type: Literal["ping"]
    sent_ms: FiniteFloat


_FIRST: TypeAdapter[Start | Resume] = TypeAdapter(Annotated[Start | Resume, Field(discriminator="type")])
_LATER: TypeAdapter[Pose | Cues | Mark | Stop | Ping] = TypeAdapter(
    Annotated[Pose | Cues | Mark | Stop | Ping, Field(discriminator="type")]
)


@router.websocket("/live")
async def live(socket: WebSocket) -> None:
    """Start or resume a session; then send new data and handle the page's messages."""
    await socket.accept()
    language: Language = "en"
    try:
        first = _FIRST.validate_json(await asyncio.wait_for(socket.receive_text(), FIRST_LIMIT_S))
        language = first.lang
        async with _receiving(socket) as inbox:
            services, port = find_services(socket), PushedPort()
            if isinstance(first, Resume):
                session = services.live.get(first.session)
            else:
                inbox.push = port.push
                services.inspector.get_ready()
                start = partial(_start, services, first, port, lambda: not inbox.is_gone)
                session = await to_thread.run_sync(start, limiter=_find_limiter())
            inbox.push = session.push
            await _handle_messages(socket, session, inbox)
    except WebSocketDisconnect:
        return
    except (AppError, RecordedProblem, ValidationError, OSError, KeyError) as error:
        refusal = error if isinstance(error, AppError | RecordedProblem) else BadParameter(name="message")
        if isinstance(error, ValidationError):  # name the field and its value
            wrong = error.errors(include_url=False, include_context=False)[0]
            name = clean_text(hide_tokens(".".join(map(str, wrong["loc"])) or "message"))[:60]
            refusal = BadParameter(name=name, value=clean_text(show_input(wrong)))
        problem = describe_problem(refusal.code, refusal.facts, language)
        texts = {"title": problem.title, "detail": problem.detail, "fix": problem.fix}
        with suppress(RuntimeError, WebSocketDisconnect):  # the page may have disconnected
            await socket.send_text(json.dumps({"type": "problem", "code": refusal.code} | texts))
            await socket.close(REFUSED)


_STARTING: RunVar[CapacityLimiter] = RunVar("live sessions that start")


def _find_limiter() -> CapacityLimiter:
    if (limiter := _STARTING.get(None)) is None:
        limiter = CapacityLimiter(MAX_STARTING)
        _STARTING.set(limiter)
    return limiter


def _start(
    services: Services, asked: Start, pushed: PushedPort, is_wanted: Callable[[], bool]
) -> RunningSession:
    """Start a session. Bytes from a port are written to disk from now on, while its process starts."""
    try:
        subject = check_subject(asked.subject)
    except ValueError as error:
        raise BadParameter(name="subject", value=clean_text(asked.subject)[:60]) from error
    port: Port | None = pushed if asked.source == "lines" else None
    if asked.source == "port":
        if asked.port not in find_serial_ports():  # a page can open only serial ports
            raise LiveSourceFailed(name=clean_text(asked.port)[:60], why="port")
        port = open_port(asked.port)
    files = create_session_files(services.settings.data_dir / LIVE_FOLDER, keeps=asked.keeps)
    try:
        if port is not None and files.is_kept:
            about = asked.model_dump(include={"side", "axis", "cues"})
            about |= {"name": _name_source(asked), "subject": subject}
            port = EarlyPort(port, EarlyFile(files.early, about))
        session = _start_with(services, asked, subject, port, files, is_wanted)
    except BaseException as error:
        if port is not None:
            port.close()
        if not isinstance(error, LiveStopped):  # its bytes become a recording when the server starts again
            files.remove()
        raise
    played = asked.recording if asked.source == "recording" else ""
    with services.store.engine.begin() as connection:
        record(connection, "live.started", played, other={"session": session.id})
    return session


def _name_source(asked: Start) -> str:
    return asked.port if asked.source == "port" else clean_text(asked.name) or "browser"


def _start_with(
    services: Services,
    asked: Start,
    subject: str,
    port: Port | None,
    files: SessionFiles,
    is_wanted: Callable[[], bool],
) -> RunningSession:
    options = SessionOptions(
        "replay" if port is None else "lines",
        "demo" if asked.source == "demo" else _name_source(asked),
        subject,
        asked.side,
        asked.axis,
        cues=tuple(rule.model_dump() for rule in asked.cues),
        countdown_s=asked.countdown_s,
        speed=asked.speed,
        silence_s=SILENCE_S if asked.source == "lines" else inf,
    )
    if asked.source != "recording":
        return services.live.start(options, files, choose_limits(services.settings, 0), port, is_wanted)
    row = services.recordings.get(asked.recording)
    with borrow_recording(services.storage, row.id, row.sha256) as path:
        played = replace(options, name=row.about.file_name, recording_path=path)
        return services.live.start(played, files, choose_limits(services.settings, row.size_bytes))


class DifferenceView(BaseModel):
    """The difference between the displayed angle and the report's at the same moments.

    ``rmse_deg`` and ``bias_deg``: live minus report. The shares are of the time below 30 deg, and at 30, 60
    and 90 deg or more. All are null if no moment has both angles.
    """

    text: str
    compared_s: float | None = None
    rmse_deg: float | None = None
    bias_deg: float | None = None
    live_percent: list[float] | None = None
    report_percent: list[float] | None = None


@router.get("/live/{session_id}/difference", responses=PROBLEM_RESPONSES, tags=["live"])
def get_difference(session_id: str, services: UsedServices, language: UsedLanguage) -> DifferenceView:
    """Compare a session with its report; available for an hour after the session ends."""
    session = services.live.get(session_id)
    job = services.store.get(session.analysis_id)
    with services.results.borrow(job, "elevation.parquet") as parquet:
        found = services.inspector.compare_live(session.files.shown, parquet, language)
    return DifferenceView.model_validate(found)


async def _handle_messages(socket: WebSocket, session: RunningSession, inbox: "Inbox") -> None:
    outbox = Outbox(asyncio.get_running_loop())

    async def send_on() -> None:
        while True:
            await socket.send_text(json.dumps(await outbox.take(), separators=(",", ":")))

    key = session.watch(outbox.put)
    sender = asyncio.create_task(send_on())
    was_closed = False
    try:
        while True:
            asked = _LATER.validate_json(await inbox.take())
            if isinstance(asked, Pose):
                session.ask_pose(asked.countdown_s)
            elif isinstance(asked, Cues):
                session.pause_cues(paused=asked.paused)
            elif isinstance(asked, Mark):
                await to_thread.run_sync(session.mark, clean_text(asked.label))  # writes a file
            elif isinstance(asked, Stop):
                session.stop()
            else:
                clock_s = round(time.time(), 4)
                outbox.put({"type": "pong", "sent_ms": asked.sent_ms, "server_s": clock_s})
    except WebSocketDisconnect as end:
        was_closed = end.code in GOODBYES
        raise
    finally:
        session.leave(key, was_closed=was_closed)
        sender.cancel()
        with suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
            await sender


class Inbox:
    """Messages from one page: bytes go to the source at once, texts are queued."""

    def __init__(self) -> None:
        self.push: Callable[[bytes], bool] | None = None
        self.is_gone = False
        self._texts: asyncio.Queue[str | int] = asyncio.Queue(MAX_WAITING)

    async def fill(self, socket: WebSocket) -> None:
        """Receive until the page disconnects; stop receiving while the source accepts no more bytes."""
        began_s = time.monotonic()
        for number in itertools.count(1):
            if number % MAX_MESSAGES == 0:
                await asyncio.sleep(began_s + MAX_MESSAGES_S - time.monotonic())
                began_s = time.monotonic()
            message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                self.is_gone = True
                await self._texts.put(int(message.get("code") or GOODBYES[0]))
                return
            piece = message.get("bytes")
            if piece is not None and self.push is not None:
                while not self.push(piece):
                    await asyncio.sleep(WAIT_S)
            elif message.get("text") is not None:
                await self._texts.put(message["text"])

    async def take(self) -> str:
        """Wait for the next text. Raises WebSocketDisconnect."""
        text = await self._texts.get()
        if isinstance(text, int):
            raise WebSocketDisconnect(text)
        return text


@asynccontextmanager
async def _receiving(socket: WebSocket) -> AsyncIterator[Inbox]:
    inbox = Inbox()
    filling = asyncio.create_task(inbox.fill(socket))
    try:
        yield inbox
    finally:
        filling.cancel()
        with suppress(asyncio.CancelledError, RuntimeError):
            await filling


class Outbox:
    """Messages of a session's thread to one page; the oldest are dropped if there are too many."""

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        self._loop = loop
        self._waiting: deque[Mapping[str, Any]] = deque(maxlen=MAX_WAITING)
        self._has_any = asyncio.Event()

    def put(self, message: Mapping[str, Any]) -> None:
        """Add a message, from any thread."""
        self._waiting.append(message)
        with suppress(RuntimeError):  # the server is stopping
            self._loop.call_soon_threadsafe(self._has_any.set)

    async def take(self) -> Mapping[str, Any]:
        """Wait for the oldest message."""
        while not self._waiting:
            self._has_any.clear()
            if not self._waiting:
                await self._has_any.wait()
        return self._waiting.popleft()
