"""Lines of a board over a serial port, UDP or TCP, as a source."""

import time
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from app.errors import LiveSourceFailed
from app.live.early import EarlyFile, EarlyPort
from app.live.ports import Port, open_port
from app.live.source import SourceFacts
from fusion.errors import FusionError
from fusion.live import Frames, LiveSession
from fusion.live.lines import LineReader
from fusion.recording import MICROSECONDS

LEARN_LIMIT_S = 20.0
"""A board that is heard has to repeat its header within this time."""


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

        Raises
        ------
        LiveSourceFailed
            Nothing came, or no header.
        fusion.errors.FusionError
            The header does not tell columns, units or rate.
        """
        self.port, self._reader, self._now_s = port, LineReader(), now_s
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
        self._facts = SourceFacts(
            device=found.device,
            name=name,
            rate_hz=found.rate_hz,
            start=datetime.now().astimezone() - ago,  # by the clock here, with its offset from UTC
            acc_range_g=found.acc_range_g,
            gyr_range_dps=found.gyr_range_dps,
        )

    @property
    def facts(self) -> SourceFacts:
        """What is known of it."""
        return self._facts

    @property
    def early(self) -> EarlyPort | None:
        """The port, where what it brings is kept until the raw file has it."""
        return self.port if isinstance(self.port, EarlyPort) else None

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
    (:mod:`app.live.early`); that of a port which cannot be understood is removed.

    Raises
    ------
    LiveSourceFailed
    fusion.errors.FusionError
    OSError
        The file cannot be written.
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
