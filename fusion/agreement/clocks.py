"""How the clock of the reference runs beside that of the recording."""

from dataclasses import dataclass

from fusion.agreement.runs import Vector


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
    say what a person set by hand; ``is_drift_fitted`` is False where the common time is too short to tell a
    drift, which is then 0.
    """

    offset_s: float
    drift_ppm: float
    r: float = float("nan")
    is_offset_given: bool = False
    is_drift_given: bool = False
    is_drift_fitted: bool = False
    windows: tuple[WindowLag, ...] = ()

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
