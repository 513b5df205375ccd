"""How the clock of the reference runs beside that of the recording."""

from dataclasses import dataclass
from math import nan

from fusion.agreement.runs import Vector

TIMING_S = 0.01
"""What a time base of whole-second stamps (GT9X) leaves open between two moments of a recording."""


@dataclass(frozen=True, slots=True)
class WindowLag:
    """What one stretch alone says: how far the reference is from where the clocks put it, and how alike."""

    start_s: float
    lag_s: float
    r: float


@dataclass(frozen=True, slots=True)
class Alignment:
    """reference clock = ``offset_s`` + recording clock x (1 + ``drift_ppm`` / 1e6).

    ``r`` is the correlation of the speeds under this alignment. ``is_offset_given`` and ``is_drift_given``
    say what a person set by hand; ``is_drift_fitted`` is False where the motion does not tell a drift,
    which is then 0.
    """

    offset_s: float
    drift_ppm: float
    r: float = nan
    is_offset_given: bool = False
    is_drift_given: bool = False
    is_drift_fitted: bool = False
    windows: tuple[WindowLag, ...] = ()

    @property
    def drift_margin_ppm(self) -> float:
        """How far a fitted drift may be off: 10 ms over the span of the stretches; nan where none is."""
        if not self.is_drift_fitted:
            return nan
        starts_s = [window.start_s for window in self.windows]
        return TIMING_S / (max(starts_s) - min(starts_s)) * 1e6

    @property
    def pace(self) -> float:
        """Seconds of the reference's clock in one second of the recording's."""
        return 1.0 + self.drift_ppm / 1e6

    def to_reference(self, time_s: Vector) -> Vector:
        """Seconds of the recording's clock to the reference's."""
        return self.offset_s + time_s * self.pace

    def to_recording(self, time_s: Vector) -> Vector:
        """Seconds of the reference's clock to the recording's."""
        return (time_s - self.offset_s) / self.pace
