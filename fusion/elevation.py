"""From calibrated samples to the angle between the upper arm and gravity."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.recording import MICROSECONDS, BoolArray


@dataclass(frozen=True, slots=True)
class Method:
    """A named estimator with its version and every parameter, as printed in the report."""

    name: str
    version: str
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class ElevationSegment:
    """Elevation over one unbroken run.

    Attributes
    ----------
    start_us, rate_hz
        As in :class:`fusion.recording.Segment`.
    elevation_deg
        Shape (n,), float32. 0 hanging, 90 level, 180 overhead. Before the metric filter.
    valid
        Shape (n,). Fused and trusted, whatever the diary says (breaks stay valid).
    vertical
        Shape (n, 3), float32: unit vector to the zenith in the sensor frame; None for a ready angle series.
    """

    start_us: int
    rate_hz: float
    elevation_deg: NDArray[np.float32]
    valid: BoolArray
    vertical: NDArray[np.float32] | None = None

    def __len__(self) -> int:
        return len(self.elevation_deg)

    @property
    def period_us(self) -> float:
        """How long one sample lasts."""
        return MICROSECONDS / self.rate_hz


@dataclass(frozen=True, slots=True, eq=False)
class Elevation:
    """Arm elevation through the recording; holes lie between the segments."""

    segments: tuple[ElevationSegment, ...]
    method: Method | None
