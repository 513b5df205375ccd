"""Where frames come from: the lines of a board, a recording that is played, or a simulated one."""

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from functools import cache
from math import inf
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from app.errors import LiveSourceFailed
from app.live.ports import EarlyFile, EarlyPort, Port, open_port
from fusion.errors import FusionError, UnusableRecording
from fusion.live import Frames, LiveSession, replay_frames
from fusion.live.lines import LineReader
from fusion.pipeline import apply_file_settings
from fusion.pose.calibrate import calibrate
from fusion.readers import read_recording
from fusion.recording import MICROSECONDS, Float64Array, Recording
from fusion.settings import AnalysisSettings
from fusion.simulation import simulate_shift, write_shift

LEARN_LIMIT_S = 20.0
"""A board that is heard has to repeat its header within this time."""
CHUNK_S = 0.04
FASTEST = 20.0
DEMO_HOURS = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class SourceFacts:
    """What is known of a source once its first frames came.

    ``device`` as in :mod:`fusion.devices`, or "other"; ``name`` in words for people; ``start``: the clock of
    the first frame; ``arm_axis``, shape (3,), if the source knows it, as a recording with its pose does.
    """

    device: str
    name: str
    rate_hz: float
    start: datetime | None = None
    arm_axis: Float64Array | None = None
    acc_range_g: float | None = None
    gyr_range_dps: float | None = None


class Source(Protocol):
    """Frames as they come."""

    @property
    def facts(self) -> SourceFacts:
        """What is known of it."""

    @property
    def early(self) -> EarlyPort | None:
        """Its port, where what that brings is kept until the raw file has it."""

    def read(self) -> Frames | None:
        """Wait a moment for the next frames and give them, none if none came; None when it has ended."""

    def close(self) -> None:
        """Let go of the port or file."""


class LineSource:
    """Frames from the lines of a port."""

    def __init__(
        self,
        port: Port,
        name: str,
        *,
        silence_s: float = inf,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Listen until header and rate are known; after ``silence_s`` without a byte the source has ended.

        Raises LiveSourceFailed if nothing came, or no header; FusionError if the header does not tell
        columns, units or rate.
        """
        self.port, self._reader, self._now_s = port, LineReader(), now_s
        self.early = port if isinstance(port, EarlyPort) else None
        self._silence_s, self._heard_s = silence_s, now_s()
        try:
            learned = self._learn(name)
        except BaseException:
            port.close()
            raise
        self._first: Frames | None = learned
        found = self._reader.facts
        assert found is not None
        lasted_s = float(learned.time_us[-1] - learned.time_us[0]) / MICROSECONDS
        ago = timedelta(seconds=lasted_s + time.monotonic() - self._heard_s)
        self.facts = SourceFacts(
            device=found.device,
            name=name,
            rate_hz=found.rate_hz,
            start=datetime.now().astimezone() - ago,  # by the clock here, with its offset from UTC
            acc_range_g=found.acc_range_g,
            gyr_range_dps=found.gyr_range_dps,
        )

    def read(self) -> Frames | None:
        """Wait a moment for frames; a board does not end by itself."""
        frames, self._first = self._first, None
        if frames is not None:
            return frames
        piece, arrived_us = self._hear()
        if not piece and self._now_s() - self._heard_s > self._silence_s:
            return None
        return self._reader.feed(piece, arrived_us)

    def close(self) -> None:
        """Let go of the port."""
        self.port.close()

    def _learn(self, name: str) -> Frames:
        began_s, heard = self._now_s(), False
        while self._now_s() - began_s < LEARN_LIMIT_S:
            piece, arrived_us = self._hear()
            heard = heard or bool(piece)
            frames = self._reader.feed(piece, arrived_us)
            if frames is not None:
                return frames
        raise LiveSourceFailed(name=name, why="no header" if heard else "silent")

    def _hear(self) -> tuple[bytes, int]:
        piece = self.port.read()
        self._heard_s = self._now_s() if piece else self._heard_s
        return piece, round(self._now_s() * MICROSECONDS)


def open_lines(source: str, baud: int, early: Path, about: Mapping[str, Any]) -> LineSource:
    """Listen to a port: ``/dev/ttyACM0``, ``COM3``, ``udp://:5005``, ``tcp://board:5005``.

    What comes before a raw file can be written is in the file ``early``, with ``about``
    (:mod:`app.live.ports`); that of a port which cannot be understood is removed.

    Raises LiveSourceFailed, FusionError, or OSError if the file cannot be written.
    """
    port = open_port(source, baud)
    try:
        kept = EarlyPort(port, EarlyFile(early, about))
    except OSError:
        port.close()
        raise
    still = Frames(
        np.arange(10) * 10_000,
        np.arange(10),
        np.full((10, 3), (0, 0, 1), np.float32),
        np.zeros((10, 3), np.float32),
    )
    LiveSession(100.0, np.array([0.0, 0.0, 1.0])).take(still)  # compiles the kernels
    try:
        return LineSource(kept, source, now_s=kept.now_s)
    except (FusionError, LiveSourceFailed):
        early.unlink(missing_ok=True)
        raise


class ReplaySource:
    """Plays a recording at ``speed`` times its own pace.

    Its arm's axis is that of an analysis of the file; None where the file has no pose that can be used.
    """

    early = None  # the recording is on the disk already

    def __init__(
        self,
        recording: Recording,
        name: str,
        speed: float = 1.0,
        *,
        now_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._frames = replay_frames(recording, CHUNK_S * min(max(speed, 1.0), FASTEST))
        self._speed, self._now_s, self._wait = speed, now_s, wait
        self._began_s: float | None = None
        self.facts = SourceFacts(
            device=recording.device,
            name=name,
            rate_hz=recording.rate_hz,
            start=recording.start,
            arm_axis=find_axis(recording),
            acc_range_g=recording.acc_range_g,
            gyr_range_dps=recording.gyr_range_dps,
        )

    def read(self) -> Frames | None:
        """Return the next frames when their time has come."""
        frames = next(self._frames, None)
        if frames is None or len(frames) == 0:
            return frames
        if self._began_s is None:
            self._began_s = self._now_s()
        due_s = self._began_s + float(frames.time_us[-1]) / MICROSECONDS / self._speed
        left_s = due_s - self._now_s()
        if left_s > 0.0:
            self._wait(left_s)
        return frames

    def close(self) -> None:
        """Nothing is held open."""


def open_replay(path: Path, speed: float, name: str = "") -> ReplaySource:
    """Read a recording and play it; ``name``: of the file, where the path bears another.

    Raises FusionError or OSError.
    """
    return ReplaySource(read_recording(path, file_name=name), name or path.name, speed)


def find_axis(recording: Recording) -> Float64Array | None:
    """Find the arm's axis as an analysis of the recording does."""
    try:
        return calibrate(recording, apply_file_settings(recording, AnalysisSettings())).calibration.arm_axis
    except UnusableRecording:
        return None


@cache
def make_demo() -> Recording:
    """Simulate a quarter of an hour of work, once for each server.

    It is of a GT9X Link, 100 Hz, with the pose held at the start: to try the live page without a sensor.
    """
    with tempfile.TemporaryDirectory() as folder:
        shift = simulate_shift("gt9x", DEMO_HOURS, seed=1)
        return read_recording(write_shift(Path(folder), shift, actilife_csv=False)[0])
