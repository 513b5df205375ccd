"""The angle while the sensor is worn: samples in, angle out; a session of it, and the clock of a stream."""

from fusion.live.clock import StreamClock
from fusion.live.elevation import LiveElevation
from fusion.live.session import (
    HOLD_S,
    Frames,
    LiveRows,
    LiveSession,
    LiveStatus,
    PoseState,
    replay_frames,
)

__all__ = [
    "HOLD_S",
    "Frames",
    "LiveElevation",
    "LiveRows",
    "LiveSession",
    "LiveStatus",
    "PoseState",
    "StreamClock",
    "replay_frames",
]
