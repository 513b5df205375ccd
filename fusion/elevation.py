"""From calibrated samples to the angle between the upper arm and gravity."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import pi, sqrt
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from fusion.calibration import CalibratedSamples, Vector
from fusion.orientation import MethodName
from fusion.orientation.published import PublishedParameters, estimate_published
from fusion.orientation.smoothed import SmoothedParameters, smooth_vertical
from fusion.recording import MICROSECONDS, BoolArray, Segment
from fusion.sensor_errors.gyro_bias import BiasSettings
from fusion.sensor_errors.runs import view_segment


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


DEGREES = 180.0 / pi
STRETCH = 512
UNCERTAIN_DEG = 5.0
SHORTEST_SEGMENT_S = 1.0
VERSION = "1"


def estimate_elevation(samples: CalibratedSamples, method: MethodName = "smoothed") -> Elevation:
    """Fuse each segment and take the angle between the arm axis and the vertical.

    Not valid are rows that bridge a hole, segments under 1 s, and (`smoothed`) seconds in which past and
    future disagree so much that the direction is uncertain by more than 5 deg
    (:class:`fusion.orientation.smoothed.SmoothedVertical`). `published` has no such measure.
    """
    fuse = _fuse_published if method == "published" else _fuse_smoothed
    segments = tuple(fuse(samples, segment) for segment in samples.recording.segments)
    return Elevation(segments, describe_method(method))


def describe_method(method: MethodName) -> Method:
    """Name, version and every parameter of an estimator."""
    if method == "published":
        return Method(method, VERSION, asdict(PublishedParameters()))
    bias = {f"bias_{name}": float(value) for name, value in asdict(BiasSettings()).items()}
    return Method(method, VERSION, asdict(SmoothedParameters()) | bias)


def measure_elevation(
    vertical: NDArray[np.float32] | NDArray[np.float64], arm_axis: Vector
) -> NDArray[np.float32]:
    """Angle between ``vertical`` (n, 3) and the arm axis, deg; exact near 0 and 180 too."""
    elevation_deg = np.empty(len(vertical), dtype=np.float32)
    _measure_angles(vertical, np.asarray(arm_axis, dtype=np.float64), elevation_deg)
    return elevation_deg


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_angles(vertical: Any, axis: Any, out: Any) -> None:  # pragma: no cover
    """In stretches, so that both loops are simple enough to run several samples at a time."""
    x, y, z = axis
    across, along = np.empty(STRETCH), np.empty(STRETCH)
    for first in range(0, len(out), STRETCH):
        rows = min(STRETCH, len(out) - first)
        for i in range(rows):
            u, v, w = vertical[first + i, 0], vertical[first + i, 1], vertical[first + i, 2]
            a, b, c = y * w - z * v, z * u - x * w, x * v - y * u
            across[i], along[i] = sqrt(a * a + b * b + c * c), x * u + y * v + z * w
        _turn_to_degrees(across[:rows], along[:rows], out[first : first + rows])


@njit(cache=True, nogil=True, error_model="numpy")
def _turn_to_degrees(across: Any, along: Any, out: Any) -> None:  # pragma: no cover
    """``atan2(across, along)`` for ``across >= 0``, to 1e-6 deg.

    The ratio is brought below tan(pi/8), where the odd series of the arc tangent converges fast.
    """
    for k in range(len(out)):
        size = abs(along[k])
        steep = across[k] > size
        ratio = (size if steep else across[k]) / (across[k] if steep else size)
        large = ratio > 0.4142135623730951
        x = (ratio - 1.0) / (ratio + 1.0) if large else ratio
        s = x * x
        tail = 1.0 / 17.0 - s * (1.0 / 19.0 - s / 21.0)
        tail = 1.0 / 9.0 - s * (1.0 / 11.0 - s * (1.0 / 13.0 - s * (1.0 / 15.0 - s * tail)))
        angle = x * (1.0 - s * (1.0 / 3.0 - s * (1.0 / 5.0 - s * (1.0 / 7.0 - s * tail))))
        angle = angle + 0.7853981633974483 if large else angle
        angle = 1.5707963267948966 - angle if steep else angle
        out[k] = DEGREES * (angle if along[k] >= 0.0 else 3.141592653589793 - angle)


def _fuse_smoothed(samples: CalibratedSamples, segment: Segment) -> ElevationSegment:
    smoothed = smooth_vertical(view_segment(segment), samples.bias, samples.accelerometer, dtype=np.float32)
    valid = _start_valid(segment)
    for second in np.flatnonzero(smoothed.uncertainty_deg > UNCERTAIN_DEG):
        valid[second * smoothed.rows_per_value : (second + 1) * smoothed.rows_per_value] = False
    return _measure_segment(samples, segment, smoothed.up, valid)


def _fuse_published(samples: CalibratedSamples, segment: Segment) -> ElevationSegment:
    bias_dps = samples.calibration.still.gyro_bias_dps
    up = estimate_published(view_segment(segment), bias_dps, dtype=np.float32)
    return _measure_segment(samples, segment, up, _start_valid(segment))


def _start_valid(segment: Segment) -> BoolArray:
    valid = np.full(len(segment), len(segment) / segment.rate_hz >= SHORTEST_SEGMENT_S)
    for first, stop in segment.bridged:
        valid[first:stop] = False
    return valid


def _measure_segment(
    samples: CalibratedSamples,
    segment: Segment,
    up: NDArray[np.float32] | NDArray[np.float64],
    valid: BoolArray,
) -> ElevationSegment:
    elevation_deg = measure_elevation(up, samples.calibration.arm_axis)
    vertical = np.asarray(up, dtype=np.float32)
    return ElevationSegment(segment.start_us, segment.rate_hz, elevation_deg, valid, vertical)
