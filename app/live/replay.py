"""A recording, played as if it came now."""

import time
from collections.abc import Callable
from pathlib import Path

from app.live.source import SourceFacts
from fusion.errors import UnusableRecording
from fusion.live import Frames, replay_frames
from fusion.pipeline import adopt_stated
from fusion.pose.calibrate import calibrate
from fusion.readers import read_recording
from fusion.recording import MICROSECONDS, Float64Array, Recording
from fusion.settings import AnalysisSettings

CHUNK_S = 0.04
FASTEST = 20.0


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
        self._facts = SourceFacts(
            device=recording.device,
            name=name,
            rate_hz=recording.rate_hz,
            start=recording.start,
            arm_axis=find_axis(recording),
            acc_range_g=recording.acc_range_g,
            gyr_range_dps=recording.gyr_range_dps,
        )

    @property
    def facts(self) -> SourceFacts:
        """What is known of it."""
        return self._facts

    def read(self) -> Frames | None:
        """Give the next frames when their time has come."""
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
    settings = adopt_stated(recording, AnalysisSettings())
    try:
        found = calibrate(recording, settings)
    except UnusableRecording:
        return None
    return found.calibration.arm_axis
