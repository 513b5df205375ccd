"""The angle while the sensor is worn: samples in, angle out; and a live session."""

from acromion.fusion.live.session import (
    HOLD_S,
    THRESHOLDS_DEG,
    Frames,
    LiveDifference,
    LiveElevation,
    LiveRows,
    LiveSession,
    LiveStatus,
    PoseState,
    ShownAngles,
    compare_shown,
    replay_frames,
)

__all__ = [
    "HOLD_S",
    "THRESHOLDS_DEG",
    "Frames",
    "LiveDifference",
    "LiveElevation",
    "LiveRows",
    "LiveSession",
    "LiveStatus",
    "PoseState",
    "ShownAngles",
    "compare_shown",
    "replay_frames",
]
