"""Lines of a board over a serial port, UDP or TCP, as a source."""

import time
from collections.abc import Callable
from datetime import datetime, timedelta

from app.errors import LiveSourceFailed
from app.live.ports import BAUD, Port, open_port
from app.live.source import Source, SourceFacts
from fusion.live import Frames
from fusion.live.lines import LineReader
from fusion.recording import MICROSECONDS

LEARN_LIMIT_S = 20.0
"""A board that is heard has to repeat its header within this time."""


class LineSource:
    """Frames from the lines of a port."""

    def __init__(self, port: Port, name: str, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Listen until header and rate are known.

        Raises
        ------
        LiveSourceFailed
            Nothing came, or no header.
        fusion.errors.FusionError
            The header does not tell columns, units or rate.
        """
        self._port, self._reader, self._now_s = port, LineReader(), now_s
        try:
            learned = self._learn(name)
        except BaseException:
            port.close()
            raise
        self._first: Frames | None = learned
        found = self._reader.facts
        assert found is not None
        self._facts = SourceFacts(
            device=found.device,
            name=name,
            rate_hz=found.rate_hz,
            start=_find_start(learned),
            acc_range_g=found.acc_range_g,
            gyr_range_dps=found.gyr_range_dps,
        )

    @property
    def facts(self) -> SourceFacts:
        """What is known of it."""
        return self._facts

    @property
    def torn_lines(self) -> int:
        """Lines that held no whole row."""
        return self._reader.torn

    @property
    def restarts(self) -> int:
        """How often the board began anew."""
        return self._reader.restarts

    def read(self) -> Frames | None:
        """Wait a moment for frames; a board never ends by itself."""
        frames, self._first = self._first, None
        return frames if frames is not None else self._reader.feed(*self._hear())

    def close(self) -> None:
        """Let go of the port."""
        self._port.close()

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
        piece = self._port.read()
        return piece, round(self._now_s() * MICROSECONDS)


def _find_start(first: Frames) -> datetime:
    """Give the clock here when the first of these frames came, with its offset from UTC."""
    ago_s = float(first.time_us[-1] - first.time_us[0]) / MICROSECONDS
    return datetime.now().astimezone() - timedelta(seconds=ago_s)


def open_lines(source: str, baud: int = BAUD) -> Source:
    """Listen to a port: ``/dev/ttyACM0``, ``COM3``, ``udp://:5005``, ``tcp://board:5005``.

    Raises
    ------
    LiveSourceFailed
    fusion.errors.FusionError
    """
    return LineSource(open_port(source, baud), source)
