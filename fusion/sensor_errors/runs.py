"""Plain arrays of one unbroken run, as the estimators take them."""

from dataclasses import dataclass

from fusion.recording import FloatArray, Segment


@dataclass(frozen=True, slots=True, eq=False)
class SensorRun:
    """Evenly sampled acceleration (g) and angular rate (deg/s), (n, 3); ``start_s`` places it in the file."""

    start_s: float
    rate_hz: float
    acc_g: FloatArray
    gyr_dps: FloatArray

    def __len__(self) -> int:
        return len(self.acc_g)

    @property
    def duration_s(self) -> float:
        """Samples times the period."""
        return len(self) / self.rate_hz


def view_segment(segment: Segment) -> SensorRun:
    """Look at a segment as a run; nothing is copied."""
    return SensorRun(segment.start_s, segment.rate_hz, segment.acc_g, segment.gyr_dps)
