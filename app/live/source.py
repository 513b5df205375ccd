"""What every source of frames gives, whatever it is behind."""

from dataclasses import dataclass
from datetime import datetime
from typing import Protocol

from app.live.early import EarlyPort
from fusion.live import Frames
from fusion.recording import Float64Array


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
