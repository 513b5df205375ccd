"""Compute the angle between the upper arm and gravity from calibrated samples."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from math import ceil, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.conventions import METHOD_VERSION, MethodName
from acromion.fusion.numba_kernels import kernel, njit
from acromion.fusion.orientation.live import LiveParameters, LiveVertical
from acromion.fusion.orientation.published import PublishedParameters, estimate_published
from acromion.fusion.orientation.smoothed import (
    SmoothedParameters,
    UncertaintySettings,
    estimate_sigma,
    smooth_nodes,
)
from acromion.fusion.pose.calibrate import CalibratedSamples
from acromion.fusion.pose.rules import AxisPart, Reading
from acromion.fusion.recording import MICROSECONDS, BoolArray, Float64Array, FloatArray, Segment
from acromion.fusion.sensor.gyroscope import BiasSettings, GyroScaleSettings
from acromion.fusion.sensor.model import Nodes, propagate_vertical, view_segment
from acromion.fusion.sensor.self_calibration import AccelerometerSettings
from acromion.fusion.sensor.stillness import StillRules

# Rows of the angle: at most 100 per second, averaged from the samples around them.
#
# At 500 Hz a row has five samples. A row starts at its timestamp and lasts until the next row. Its vertical
# is the mean over 10 ms centred on that timestamp, so it has no delay. Its duration is that of the five
# samples from the timestamp on.
#
# The rows of a segment share its time evenly. A segment may have up to 4 samples (at 500 Hz) after its last
# whole row. No time is lost: each row lasts a little longer, 0.8 percent in a segment of 1 s, 0.01 percent in
# one of a minute. A row may then start between two samples.

MOST_HZ = 100.5
"""A nominal 100 Hz sensor runs at 100 +- 0.1 Hz and keeps every sample."""


# The vertical at the samples, computed for the requested slice.
#
# Eight hours at 100 Hz are 33 MiB of unit vectors. They follow from the nodes and the gyroscope samples,
# which are kept anyway. Computing them again for the speeds takes no longer than allocating that memory. At
# 500 Hz it would take five times as long, so there the vectors of the rows are kept. The same samples always
# give the same bits, in any slice.


@dataclass(frozen=True, slots=True, eq=False)
class VerticalOnDemand:
    """An array-like (n, 3) of float32, read by slices of samples.

    ``up`` (j, 3) is the vertical at the nodes; ``gyr_dps`` (n, 3) propagates it to the samples between them.
    """

    gyr_dps: FloatArray
    rate_hz: float
    nodes: Nodes
    up: Float64Array

    def __len__(self) -> int:
        return len(self.gyr_dps)

    def __getitem__(self, samples: slice) -> NDArray[np.float32]:
        """Return the samples of a slice without a step."""
        first, stop, _ = samples.indices(len(self))
        if stop <= first:
            return np.zeros((0, 3), dtype=np.float32)
        per_node = self.nodes.rows_per_node
        node = min(first // per_node, len(self.up) - 1)
        end = len(self) if stop > len(self.up) * per_node else min(-(-stop // per_node) * per_node, len(self))
        out = np.empty((end - node * per_node, 3), dtype=np.float32)
        propagate_vertical(self.gyr_dps, self.rate_hz, self.nodes, self.up, out, node)
        return out[first - node * per_node : stop - node * per_node]


Vertical = FloatArray | VerticalOnDemand
"""The vertical at every sample, (n, 3): an array or an array-like."""


@dataclass(frozen=True, slots=True)
class AngleRows:
    """How the samples of a segment are grouped into rows; both have the same length to the microsecond.

    ``start_us``, ``rate_hz``: time of the first row, equal to that of the first sample; rows per second.
    ``count``, ``samples``: number of rows, and of the samples they are made from.
    ``per_row``: whole samples averaged per row; 1: each sample is a row.
    """

    start_us: int
    rate_hz: float
    count: int
    samples: int
    per_row: int

    def __len__(self) -> int:
        return self.count

    @property
    def period_us(self) -> float:
        """Duration of one row."""
        return MICROSECONDS / self.rate_hz

    def hold(self, first: int, stop: int) -> slice:
        """Return the rows that contain any of the samples [first, stop)."""
        if self.per_row == 1:
            return slice(first, stop)
        return slice(first * self.count // self.samples, -(-stop * self.count // self.samples))


def group_rows(run: Segment) -> AngleRows:
    """Group the fewest whole samples per row that keep at most 100 rows per second."""
    samples, per_row = len(run), ceil(run.rate_hz / MOST_HZ)
    if per_row == 1 or samples == 0:
        return AngleRows(run.start_us, run.rate_hz, samples, samples, 1)
    count = max(samples // per_row, 1)
    return AngleRows(run.start_us, run.rate_hz * count / samples, count, samples, per_row)


def read_rows(vertical: Vertical, rows: AngleRows, first: int, stop: int) -> FloatArray:
    """Return unit vectors of the rows [first, stop), shape (rows, 3), from those of all samples, (n, 3)."""
    if rows.per_row == 1:
        return vertical[first:stop]
    reach, pace = rows.per_row, rows.samples / rows.count
    start = max(int(first * pace) - reach, 0)
    around: NDArray[np.float32] = vertical[start : int(stop * pace) + reach].astype(np.float32, copy=False)
    out = np.empty((stop - first, 3), dtype=np.float32)
    places: Float64Array = np.arange(first, stop) * float(rows.samples) / rows.count - start
    _average(around, places, 0.5 * (rows.per_row + 1), out)
    return out


BLOCK_S, BLOCKS_AT_ONCE = 0.1, 16_384


def average_acceleration(segment: Segment, row_count: int) -> tuple[int, Float64Array]:
    """Return how many rows make a block of about 0.1 s, and the mean magnitude over each block, g.

    ``row_count``: rows of the angle over the segment, each of one or more samples.
    """
    per_row = max(len(segment) / max(row_count, 1), 1.0)
    block = max(1, round(segment.rate_hz / per_row * BLOCK_S))
    edges = np.rint(np.append(np.arange(0, row_count, block), row_count) * per_row).astype(np.int64)
    means = np.empty(len(edges) - 1)
    for first in range(0, len(means), BLOCKS_AT_ONCE):
        near = edges[first : first + BLOCKS_AT_ONCE + 1]
        size_g = np.linalg.norm(segment.acc_g[near[0] : near[-1]].astype(np.float64), axis=1)
        means[first : first + len(near) - 1] = np.add.reduceat(size_g, near[:-1] - near[0]) / np.diff(near)
    return block, means


@kernel
def _average(vertical: Any, places: Any, reach: float, out: Any) -> None:  # pragma: no cover
    """Compute the mean direction around each place, in samples.

    A sample covers half a period on each side. Its weight is the part of this period within the window.
    """
    for k in range(len(out)):
        place = places[k]
        low = int(place - reach) + 1 if place > reach else 0
        stop = int(place + reach) + 1
        x, y, z = 0.0, 0.0, 0.0
        for i in range(low, stop if stop < len(vertical) else len(vertical)):
            weight = reach - abs(i - place)
            weight = 1.0 if weight > 1.0 else weight
            x += weight * vertical[i, 0]
            y += weight * vertical[i, 1]
            z += weight * vertical[i, 2]
        scale = 1.0 / np.sqrt(x * x + y * y + z * z)
        out[k, 0], out[k, 1], out[k, 2] = scale * x, scale * y, scale * z


# The elevation and its estimators.


@dataclass(frozen=True, slots=True)
class Method:
    """A named estimator, as printed in the report.

    ``name``, ``version``: "smoothed", "published" or "live"; the version increases with every change that
    alters a result.
    ``parameters``: every number that it used, by name, with the unit in the name.
    """

    name: str
    version: str
    parameters: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class ElevationSegment:
    """Elevation over one unbroken run.

    ``start_us``, ``rate_hz``: time of the first row, microseconds from the recording's first sample; rows per
    second, at most about 100 if the angle was fused from samples (:mod:`acromion.fusion.elevation`).
    ``elevation_deg``: shape (n,), float32. 0 hanging, 90 level, 180 overhead. Before the metric filter.
    ``valid``: shape (n,). Whether every sample of the row is fused and trusted. The diary has no effect:
    breaks stay valid.
    ``vertical``: shape (n, 3), float32, read by slices of rows: unit vector to the zenith in the sensor
    frame; None for an angle series. Computed again on each read, except that it is stored if a row has
    several samples (:class:`acromion.fusion.elevation.VerticalOnDemand`).
    ``sigma_deg``: shape (seconds,), float32: standard deviation of the angle in each second of the segment,
    without the error of the pose (:mod:`acromion.fusion.orientation.smoothed`); None if the method does not
    estimate it.
    ``bridged``: as in :class:`acromion.fusion.recording.Segment`: row ranges [first, stop) without measured
    samples.
    """

    start_us: int
    rate_hz: float
    elevation_deg: NDArray[np.float32]
    valid: BoolArray
    vertical: Vertical | None = None
    sigma_deg: NDArray[np.float32] | None = None
    bridged: tuple[tuple[int, int], ...] = ()

    def __len__(self) -> int:
        return len(self.elevation_deg)

    def __repr__(self) -> str:
        start_s = self.start_us / MICROSECONDS
        return f"ElevationSegment({len(self)} rows at {self.rate_hz:g} Hz from {start_s:g} s)"

    @property
    def period_us(self) -> float:
        """Duration of one row."""
        return MICROSECONDS / self.rate_hz


@dataclass(frozen=True, slots=True, eq=False)
class Elevation:
    """Arm elevation through the recording, with gaps between the segments.

    ``segments``: in time order.
    ``method``: the estimator; None for an angle series and for an angle read from ``elevation.parquet``.
    ``bias_sigma_deg``: standard deviation of the angle over the whole recording, without the error of the
    pose. For `smoothed`, the root mean square over the seconds. Includes the uncertainty of the axis if the
    sensor turned on the arm. None for a precomputed angle series.
    """

    segments: tuple[ElevationSegment, ...]
    method: Method | None
    bias_sigma_deg: float | None = None

    def __repr__(self) -> str:
        name = self.method.name if self.method else "ready angles"
        valid_s = sum(int(segment.valid.sum()) / segment.rate_hz for segment in self.segments)
        return f"Elevation({name}, {valid_s / 3600.0:.2f} h valid, segments: {len(self.segments)})"


DEGREES = 180.0 / pi
STRETCH = 512
SAMPLES_AT_ONCE = 16_384
"""This many vectors are still in the processor cache when their angle is computed."""
UNCERTAIN_DEG = 5.0
SHORTEST_SEGMENT_S = 1.0

TYPICAL_SIGMA_DEG = {"published": 4.2, "live": 1.3}
"""For methods without an error estimate: RMSE on simulated arm tasks and shifts (docs/validation.md)."""


def estimate_elevation(samples: CalibratedSamples, method: MethodName = "smoothed") -> Elevation:
    """Fuse each segment and compute the angle between arm axis and vertical, at most 100 times a second.

    Invalid rows are: rows that bridge a gap, segments under 1 s and, for `smoothed`, seconds with an
    uncertainty over 5 deg (by their sigma, or by half the angle between the estimates from past and future).
    `published` has no such measure. `live` excludes the first 3 s of a segment, because it has few samples
    there.
    """
    fuse = {"smoothed": _fuse_smoothed, "published": _fuse_published, "live": _fuse_live}[method]
    segments = tuple(fuse(samples, segment) for segment in samples.recording.segments)
    own_deg = UNCERTAIN_DEG if method == "smoothed" else TYPICAL_SIGMA_DEG[method]
    by_second = [segment.sigma_deg for segment in segments if segment.sigma_deg is not None]
    if method == "smoothed" and any(len(one) > 0 for one in by_second):
        seconds_deg = np.minimum(np.concatenate(by_second).astype(np.float64), 2.0 * UNCERTAIN_DEG)
        own_deg = float(np.sqrt(np.mean(seconds_deg**2)))
    sigma_deg = sqrt(own_deg**2 + _average_axis_variance(samples, segments))
    widened = tuple(_widen_sigma(samples, segment) for segment in segments)
    return Elevation(widened, describe_method(method, samples), sigma_deg)


def _average_axis_variance(samples: CalibratedSamples, segments: tuple[ElevationSegment, ...]) -> float:
    """Return the variance of the arm axis after the sensor turned, deg^2, averaged over all valid rows."""
    squares = rows = 0.0
    for segment in segments:
        rows += np.count_nonzero(segment.valid)
        for part in samples.axis_parts:
            first, stop = _find_rows(part, segment)
            squares += part.sigma_deg**2 * np.count_nonzero(segment.valid[first:stop])
    return squares / rows if rows else 0.0


def describe_method(method: MethodName, samples: CalibratedSamples | None = None) -> Method:
    """Return the name, version and parameters of an estimator, and its self-calibration of these samples."""
    if method == "published":
        return Method(method, METHOD_VERSION, asdict(PublishedParameters()))
    if method == "live":
        return Method(method, METHOD_VERSION, asdict(LiveParameters()))
    own = {
        "bias": asdict(BiasSettings()),
        "still": asdict(StillRules()),
        "accelerometer": asdict(AccelerometerSettings()),
        "gyro_scale": asdict(GyroScaleSettings()),
        "uncertainty": asdict(UncertaintySettings()),
    }
    found = {f"{part}_{name}": float(value) for part, all_of in own.items() for name, value in all_of.items()}
    if samples is not None:
        self_calibration = {
            "found_accelerometer_offset_g": samples.accelerometer.mean_offset_g,
            "found_accelerometer_scale": np.diag(samples.accelerometer.gain),
            "found_gyro_scale": np.diag(samples.gyro_scale.gain),
        }
        for name, values in self_calibration.items():
            found |= {f"{name}_{axis}": float(value) for axis, value in zip("xyz", values, strict=True)}
    return Method(method, METHOD_VERSION, asdict(SmoothedParameters()) | found)


def measure_elevation(
    vertical: NDArray[np.float32] | Float64Array, arm_axis: Float64Array
) -> NDArray[np.float32]:
    """Return the angle between ``vertical`` (n, 3) and the arm axis, deg; also exact near 0 and 180."""
    elevation_deg = np.empty(len(vertical), dtype=np.float32)
    _measure_angles(vertical, np.asarray(arm_axis, dtype=np.float64), elevation_deg)
    return elevation_deg


@njit(cache=True, nogil=True, error_model="numpy")
def _measure_angles(vertical: Any, axis: Any, out: Any) -> None:  # pragma: no cover
    """Compute in short stretches: both loops stay simple enough for vector instructions."""
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
    """Compute ``atan2(across, along)`` for ``across >= 0``, to 1e-6 deg.

    The ratio is reduced below tan(pi/8), where the series of the arc tangent converges fast.
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
    calibrated, rows = samples.run_of(segment), group_rows(segment)
    nodes = calibrated.nodes
    smoothed = smooth_nodes(nodes)
    sigma_deg = estimate_sigma(smoothed, samples.accelerometer)
    per_value = smoothed.nodes_per_value * nodes.rows_per_node
    valid = _mark_valid_rows(samples, segment, rows)
    for value in np.flatnonzero(np.maximum(sigma_deg, smoothed.disagreement_deg) > UNCERTAIN_DEG).tolist():
        valid[rows.hold(value * per_value, (value + 1) * per_value)] = False
    vertical = VerticalOnDemand(calibrated.run.gyr_dps, segment.rate_hz, nodes, smoothed.up)
    seconds = int(np.ceil(len(segment) / segment.rate_hz))
    middle = (np.arange(seconds) + 0.5) * segment.rate_hz / per_value
    by_second = sigma_deg[np.minimum(middle.astype(np.int64), len(sigma_deg) - 1)].astype(np.float32)
    return _measure_segment(samples, segment, rows, vertical, valid, by_second)


def _find_rows(part: AxisPart, run: AngleRows | Segment | ElevationSegment) -> tuple[int, int]:
    """Return the first row of a run within a part, and the first row after the part."""
    start_s = run.start_us / MICROSECONDS
    first, stop = (
        int(np.clip((edge_s - start_s) * run.rate_hz, 0, len(run))) for edge_s in (part.start_s, part.end_s)
    )
    return first, stop


def _widen_sigma(samples: CalibratedSamples, segment: ElevationSegment) -> ElevationSegment:
    """Add, for each second, the uncertainty of the axis in the parts after the sensor turned."""
    if segment.sigma_deg is None:
        return segment
    sigma_deg = segment.sigma_deg.copy()
    seconds = segment.start_us / MICROSECONDS + np.arange(len(sigma_deg))
    for part in samples.axis_parts:
        inside = (seconds >= part.start_s) & (seconds < part.end_s)
        sigma_deg[inside] = np.hypot(sigma_deg[inside], part.sigma_deg)
    return replace(segment, sigma_deg=sigma_deg)


def _fuse_published(samples: CalibratedSamples, segment: Segment) -> ElevationSegment:
    bias_dps, rows = samples.calibration.gyro_bias_dps, group_rows(segment)
    up = estimate_published(view_segment(segment), bias_dps, dtype=np.float32)
    return _measure_segment(samples, segment, rows, up, _mark_valid_rows(samples, segment, rows))


def _fuse_live(samples: CalibratedSamples, segment: Segment) -> ElevationSegment:
    live, rows = LiveVertical(segment.rate_hz, samples.calibration.gyro_bias_dps), group_rows(segment)
    valid = _mark_valid_rows(samples, segment, rows)
    valid[rows.hold(0, round(LiveParameters().time_constant_s * segment.rate_hz))] = False
    return _measure_segment(samples, segment, rows, live.update(segment.acc_g, segment.gyr_dps), valid)


def _mark_valid_rows(samples: CalibratedSamples, segment: Segment, rows: AngleRows) -> BoolArray:
    """Mark rows as valid if no sample is bridged, the segment is long enough and the arm axis is known."""
    valid = np.full(len(rows), len(segment) / segment.rate_hz >= SHORTEST_SEGMENT_S)
    turned = (_find_rows(part, segment) for part in samples.axis_parts if part.arm_axis is None)
    for first, stop in (*segment.bridged, *turned):
        valid[rows.hold(first, stop)] = False
    return valid


def _measure_segment(
    samples: CalibratedSamples,
    segment: Segment,
    rows: AngleRows,
    vertical: Vertical,
    valid: BoolArray,
    sigma_deg: NDArray[np.float32] | None = None,
) -> ElevationSegment:
    """Group the vertical into rows and compute their angle, one block at a time."""
    is_kept = rows.per_row > 1 or (isinstance(vertical, np.ndarray) and vertical.dtype != np.float32)
    up = np.empty((len(rows) if is_kept else 0, 3), dtype=np.float32)
    elevation_deg = np.empty(len(rows), dtype=np.float32)
    axis = np.asarray(samples.calibration.arm_axis, dtype=np.float64)
    at_once = max(1, SAMPLES_AT_ONCE // rows.per_row)
    for first in range(0, len(rows), at_once):
        stop = min(first + at_once, len(rows))
        block = read_rows(vertical, rows, first, stop)
        _measure_angles(block, axis, elevation_deg[first:stop])
        if is_kept:
            up[first:stop] = block
    known = up if is_kept else vertical
    _measure_parts(samples.axis_parts, rows, known, elevation_deg)
    held = (rows.hold(first, stop) for first, stop in segment.bridged)
    bridged = tuple((each.start, each.stop) for each in held)
    return ElevationSegment(rows.start_us, rows.rate_hz, elevation_deg, valid, known, sigma_deg, bridged)


def _measure_parts(
    parts: tuple[AxisPart, ...],
    rows: AngleRows | ElevationSegment,
    up: Vertical,
    elevation_deg: NDArray[np.float32],
) -> None:
    """Compute the rows of each part with the axis of that part."""
    for part in parts:
        first, stop = _find_rows(part, rows)
        if part.arm_axis is not None and stop > first:
            elevation_deg[first:stop] = measure_elevation(up[first:stop], part.arm_axis)


def apply_reading(elevation: Elevation, reading: Reading) -> Elevation:
    """Return the same fused angle with the arm axis of another reading of the recording."""
    segments = []
    for segment in elevation.segments:
        assert segment.vertical is not None
        elevation_deg = np.empty(len(segment), dtype=np.float32)
        for first in range(0, len(segment), SAMPLES_AT_ONCE):
            rows = slice(first, first + SAMPLES_AT_ONCE)
            elevation_deg[rows] = measure_elevation(segment.vertical[rows], reading.arm_axis)
        _measure_parts(reading.parts, segment, segment.vertical, elevation_deg)
        segments.append(replace(segment, elevation_deg=elevation_deg))
    return replace(elevation, segments=tuple(segments))
