"""Writes a score while time passes, as a choreographer would: move this there, wait, meanwhile sway."""

from collections.abc import Mapping

import numpy as np

from fusion.simulation.motion import Channel, Motion

Pose = Mapping[Channel, float]


class Choreography:
    """The body's pose now, and the strokes and waves that led to it.

    ``time_s`` is where the writing stands; ``move`` starts a movement there, ``wait`` lets time pass.
    """

    def __init__(self) -> None:
        self.time_s = 0.0
        self._pose = dict.fromkeys(Channel, 0.0)
        self._strokes: list[tuple[float, ...]] = []
        self._waves: list[tuple[float, ...]] = []

    @property
    def facing_deg(self) -> float:
        """Where the body faces, or is turning to."""
        return self._pose[Channel.HEADING]

    def move(self, duration_s: float, pose: Pose, *, after_s: float = 0.0) -> None:
        """Begin a movement towards ``pose``; channels that are not named stay. Time does not pass."""
        for channel, value in pose.items():
            change = value - self._pose[channel]
            if change != 0.0:
                self._strokes.append((channel, self.time_s + after_s, duration_s, change))
                self._pose[channel] = value

    def wait(self, duration_s: float) -> None:
        """Let time pass."""
        self.time_s += duration_s

    def go(self, duration_s: float, pose: Pose) -> None:
        """Move and wait until there."""
        self.move(duration_s, pose)
        self.wait(duration_s)

    def sway(
        self, channel: Channel, duration_s: float, frequency_hz: float, amplitude: float, phase: float = 0.0
    ) -> None:
        """Begin a wave that swells over a second (or a third of its length) and fades likewise."""
        ramp_s = min(1.0, duration_s / 3)
        start_s = self.time_s
        self._waves.append((channel, start_s, start_s + duration_s, ramp_s, frequency_hz, amplitude, phase))

    def finish(self) -> Motion:
        """Give the score, in order of time."""
        strokes = np.array(sorted(self._strokes, key=lambda row: row[1:]), dtype=np.float64).reshape(-1, 4)
        waves = np.array(sorted(self._waves, key=lambda row: row[1:]), dtype=np.float64).reshape(-1, 7)
        return Motion(strokes, waves)
