"""Sources of frames: the lines of a board, a replayed recording, or a simulated recording."""

import tempfile
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from math import inf
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from acromion.app.errors import LiveSourceFailed
from acromion.app.live.ports import LEARN_LIMIT_S, EarlyFile, EarlyPort, Port, open_port
from acromion.fusion.errors import FusionError, UnusableRecording
from acromion.fusion.live import Frames, LiveSession, replay_frames
from acromion.fusion.live.lines import LineReader
from acromion.fusion.pipeline import apply_file_settings
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import MICROSECONDS, Float64Array, Recording
from acromion.fusion.settings import AnalysisSettings

CHUNK_S = 0.04
MAX_SPEED = 20.0
DEMO_HOURS = 0.25


@dataclass(frozen=True, slots=True, eq=False)
class SourceFacts:
    """Facts about a source that are known after its first frames.

    ``device`` as in :mod:`acromion.fusion.devices`, or "other". ``name`` is for display. ``start`` is the
    clock time of the first frame. ``arm_axis``, shape (3,), is set if the source knows it, as for a recording
    with a pose.
    """

    device: str
    name: str
    rate_hz: float
    start: datetime | None = None
    arm_axis: Float64Array | None = None
    acc_range_g: float | None = None
    gyr_range_dps: float | None = None


class Source(Protocol):
    """Frames as they arrive."""

    @property
    def facts(self) -> SourceFacts:
        """The facts about this source."""

    @property
    def early(self) -> EarlyPort | None:
        """The port that buffers early bytes; None if the source has none."""

    def read(self) -> Frames | None:
        """Wait briefly and return the next frames, possibly none; None if the source has ended."""

    def close(self) -> None:
        """Close the port or file."""


class LineSource:
    """Frames from the lines of a port."""

    def __init__(
        self,
        port: Port,
        name: str,
        *,
        silence_s: float = inf,
        learn_limit_s: float = LEARN_LIMIT_S,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Read until header and rate are known; the source ends after ``silence_s`` without a byte.

        The port must send the header within ``learn_limit_s``.

        Raises LiveSourceFailed if no data or no header arrived; FusionError if the header does not state
        columns, units or rate.
        """
        self.port, self._reader, self._now_s = port, LineReader(), now_s
        self.early = port if isinstance(port, EarlyPort) else None
        self._silence_s, self._heard_s = silence_s, now_s()
        try:
            learned = self._read_header(name, learn_limit_s)
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
            start=datetime.now().astimezone() - ago,  # by this computer's clock, with its offset from UTC
            acc_range_g=found.acc_range_g,
            gyr_range_dps=found.gyr_range_dps,
        )

    def read(self) -> Frames | None:
        """Wait briefly for frames; a board never ends on its own."""
        frames, self._first = self._first, None
        if frames is not None:
            return frames
        piece, arrived_us = self._read_port()
        if not piece and self._now_s() - self._heard_s > self._silence_s:
            return None
        return self._reader.feed(piece, arrived_us)

    def close(self) -> None:
        """Close the port."""
        self.port.close()

    def _read_header(self, name: str, limit_s: float) -> Frames:
        began_s, heard = self._now_s(), False
        while self._now_s() - began_s < limit_s:
            piece, arrived_us = self._read_port()
            heard = heard or bool(piece)
            frames = self._reader.feed(piece, arrived_us)
            if frames is not None:
                return frames
        raise LiveSourceFailed(name=name, why="no header" if heard else "silent")

    def _read_port(self) -> tuple[bytes, int]:
        piece = self.port.read()
        self._heard_s = self._now_s() if piece else self._heard_s
        return piece, round(self._now_s() * MICROSECONDS)


def compile_kernels() -> None:
    """Compile the kernels of a session, which takes some seconds once per installation."""
    still = Frames(
        np.arange(10) * 10_000,
        np.arange(10),
        np.full((10, 3), (0, 0, 1), np.float32),
        np.zeros((10, 3), np.float32),
    )
    LiveSession(100.0, np.array([0.0, 0.0, 1.0])).take(still)  # compile the kernels


def open_lines(source: str, baud: int, early: Path, about: Mapping[str, Any]) -> LineSource:
    """Open a port: ``/dev/ttyACM0``, ``COM3``, ``udp://:5005``, ``tcp://board:5005``.

    Early bytes are stored in the file ``early``, with the session options ``about``
    (:mod:`acromion.app.live.ports`). If the lines of the port are not readable, the file is deleted.

    Raises LiveSourceFailed, FusionError, or OSError if the file cannot be written.
    """
    port = open_port(source, baud)
    try:
        kept = EarlyPort(port, EarlyFile(early, about))
    except OSError:
        port.close()
        raise
    compile_kernels()
    try:
        return LineSource(kept, source, now_s=kept.now_s)
    except (FusionError, LiveSourceFailed):
        early.unlink(missing_ok=True)
        raise


class ReplaySource:
    """Replays a recording at ``speed`` times real time.

    The arm's axis is that of an analysis of the file; None if the file has no usable pose.
    """

    early = None  # the recording is already on disk

    def __init__(
        self,
        recording: Recording,
        name: str,
        speed: float = 1.0,
        *,
        now_s: Callable[[], float] = time.monotonic,
        wait: Callable[[float], None] = time.sleep,
    ) -> None:
        self._frames = replay_frames(recording, CHUNK_S * min(max(speed, 1.0), MAX_SPEED))
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
        """Return the next frames when they are due."""
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
        """Do nothing: no file is open."""


def open_replay(path: Path, speed: float, name: str = "") -> ReplaySource:
    """Open a recording for replay; ``name`` is its original file name if the path has another one.

    Raises FusionError or OSError.
    """
    return ReplaySource(read_recording(path, file_name=name), name or path.name, speed)


def find_axis(recording: Recording) -> Float64Array | None:
    """Return the arm's axis as an analysis of the recording determines it; None without a usable pose."""
    try:
        return calibrate(recording, apply_file_settings(recording, AnalysisSettings())).calibration.arm_axis
    except UnusableRecording:
        return None


def build_demo() -> Recording:
    """Simulate 15 minutes of work.

    It imitates a GT9X Link at 100 Hz with the pose at the start, for trying the live page without a sensor.
    """
    from acromion.fusion.simulation import simulate_shift, write_shift  # noqa: PLC0415  slow import

    with tempfile.TemporaryDirectory() as folder:
        shift = simulate_shift("gt9x", DEMO_HOURS, seed=1)
        return read_recording(write_shift(Path(folder), shift, actilife_csv=False)[0])
