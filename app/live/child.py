"""The child process of a live session: it parses the lines, writes the raw file and computes the angle.

The server passes bytes on and shows the messages, so that no line of a board can delay its pages. The child
answers in JSON, because a process that has read hostile bytes is not trusted: first the facts of the source
or a refusal, then updates, cues and, each second, the number of bytes that are on the disk; last the end.
"""

import json
import signal
import time
from collections.abc import Mapping
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

import numpy as np

from acromion.app.analysis.attempt import Limits, Refused, describe_failure, prepare_child
from acromion.app.live.cue_log import get_limit
from acromion.app.live.ports import SHOWN_HZ, PipePort, SessionFiles, SessionOptions
from acromion.app.live.raw_file import SYNC_S, Wearer, build_rule
from acromion.app.live.recorder import Recorder
from acromion.app.live.sources import (
    LineSource,
    ReplaySource,
    Source,
    build_demo,
    compile_kernels,
    open_replay,
)
from acromion.app.store.folder import translate_disk_full
from acromion.app.store.permissions import create_file
from acromion.fusion.live import LiveRows, LiveStatus
from acromion.fusion.recording import MICROSECONDS

SEND_S = 0.01
"""Shortest time between two updates, so that a board that sends row by row does not flood the server."""
REST_S = 0.02
"""The process rests when it worked this much longer than it rested; an ordinary board never causes that."""
FRESH_S = 0.5
"""The pose waits until data is at most this old: the wearer could not react to the pose in older data."""


def run(pipe: Connection, options: SessionOptions, files: SessionFiles, limits: Limits, level: int) -> None:
    """Run a session in this process until the source ends or the server stops it."""
    prepare_child(limits, level, gives_way=True)
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # a service manager sends it; the server stops its sessions
    port, end = PipePort(pipe), Refused("", {})
    with suppress(BrokenPipeError):
        try:
            with translate_disk_full():
                compile_kernels()
                source = _open_source(port, options)
                session = _Session(pipe, port, source, options, files)
        except Exception as error:  # noqa: BLE001 - the server shows the code
            refusal = describe_failure(error, limits)
            _send(pipe, {"code": refusal.code, "facts": dict(refusal.facts)})
            return
        try:
            with translate_disk_full():
                session.run()
        except Exception as error:  # noqa: BLE001
            end = describe_failure(error, limits)
        session.close()
        _send(pipe, {"end": end.code})


def _open_source(port: PipePort, options: SessionOptions) -> Source:
    if options.source == "lines":
        silence_s, learn_limit_s = options.silence_s, options.learn_limit_s
        return LineSource(
            port, options.name, silence_s=silence_s, learn_limit_s=learn_limit_s, now_s=port.now_s
        )
    if options.recording_path is None:
        return ReplaySource(build_demo(), options.name, options.speed)
    return open_replay(options.recording_path, options.speed, options.name)


class _Session:
    """A session with its source, its raw file and the updates that wait to be sent."""

    def __init__(
        self, pipe: Connection, port: PipePort, source: Source, options: SessionOptions, files: SessionFiles
    ) -> None:
        """Create the raw file and send the facts. Raises OSError."""
        wearer = Wearer(options.subject, options.side, options.axis)
        rules = tuple(build_rule(dict(rule)) for rule in options.cues)
        self._pipe, self._port, self._source, self._files = pipe, port, source, files
        self._recorder = Recorder(files.raw, source.facts, wearer, rules)
        self._pose_s = options.countdown_s if self._recorder.session.arm_axis is None else None
        self._step = max(1, round(source.facts.rate_hz / SHOWN_HZ))
        self._row = self._synced_bytes = 0
        self._points: list[tuple[float, float | None]] = []
        self._has_news = False
        self._sent_s = self._synced_s = 0.0
        facts = source.facts
        stated = {"name": facts.name, "device": facts.device, "rate_hz": round(facts.rate_hz, 3)}
        _send(pipe, {"source": stated, "status": describe_status(self._recorder.status())})

    def run(self) -> None:
        """Process frames until the source ends or a stop arrives, using at most half of a core."""
        worked_s, at_s, debt_s = time.thread_time(), time.monotonic(), 0.0
        while not self._port.is_stopped and (frames := self._source.read()) is not None:
            if isinstance(self._source, ReplaySource):
                self._port.read(0.0)
            self._start_pose()
            if len(frames):
                rows = self._recorder.take(frames)
                self._add_points(rows)
                for cue in self._recorder.take_cues(rows):
                    rule = {"kind": cue.rule.kind, "angle_deg": cue.rule.angle_deg}
                    facts = {"time_s": round(cue.time_s, 3), **rule, "limit": get_limit(cue.rule)}
                    _send(self._pipe, {"cue": facts})
            self._report(is_idle=not len(frames))
            work_s, passed_s = time.thread_time() - worked_s, time.monotonic() - at_s
            worked_s, at_s = worked_s + work_s, at_s + passed_s
            debt_s = max(0.0, debt_s + 2.0 * work_s - passed_s)
            if debt_s > REST_S:
                time.sleep(debt_s)

    def close(self) -> None:
        """Send the last update, and close the raw file as that of a stopped session."""
        self._sent_s = 0.0
        self._report(is_idle=True)
        self._recorder.stop()
        if self._files.is_kept:
            with create_file(self._files.shown) as file:
                self._recorder.shown.write(file)

    def _start_pose(self) -> None:
        if self._port.asked_pose_s is not None:
            self._pose_s, self._port.asked_pose_s = self._port.asked_pose_s, None
        if self._pose_s is not None and time.monotonic() - self._port.now_s() <= FRESH_S:
            self._recorder.session.ask_pose(self._pose_s)
            self._pose_s = None

    def _add_points(self, rows: LiveRows) -> None:
        shown = np.arange(-self._row % self._step, len(rows.time_us), self._step)
        self._row += len(rows.time_us)
        self._has_news = True
        self._points += [
            (round(time_us / MICROSECONDS, 3), round(angle, 2) if is_valid else None)
            for time_us, angle, is_valid in zip(
                rows.time_us[shown].tolist(),
                rows.elevation_deg[shown].tolist(),
                rows.valid[shown].tolist(),
                strict=True,
            )
        ]

    def _report(self, *, is_idle: bool) -> None:
        """Send the angles that wait; each second, sync the raw file and send that it contains the bytes."""
        now_s = time.monotonic()
        if self._has_news and (is_idle or now_s - self._sent_s >= SEND_S):
            status = describe_status(self._recorder.status())
            _send(self._pipe, {"points": self._points, "status": status, "came_s": round(time.time(), 4)})
            self._points, self._has_news, self._sent_s = [], False, now_s
        if now_s - self._synced_s >= SYNC_S:
            if self._synced_bytes != self._port.taken_bytes:
                self._recorder.sync()
            self._synced_bytes, self._synced_s = self._port.taken_bytes, now_s
            _send(self._pipe, {"synced_bytes": self._synced_bytes})


def _send(pipe: Connection, message: Mapping[str, Any]) -> None:
    pipe.send_bytes(json.dumps(message, separators=(",", ":")).encode())


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
