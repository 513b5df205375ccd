"""The low-pass that is applied before every figure.

Zero-phase Butterworth, order 2 per pass, 5 Hz, as in ``scipy.signal.sosfiltfilt``.

Without it, 0.2 deg of white noise at 500 Hz turns a true median speed of 44 deg/s into 57 deg/s.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.elevation import ElevationSegment
from acromion.fusion.numba_kernels import inner, kernel, kernel_making_arrays
from acromion.fusion.recording import LONGEST_BRIDGE_US, BoolArray, Float64Array
from acromion.fusion.runs import find_runs

CORNER_HZ = 5.0
PADDING_ROWS = 9  # sosfiltfilt's default for one second-order section: three times its three taps


def filter_rows(rows: NDArray[np.float32] | Float64Array, rate_hz: float) -> Float64Array:
    """Low-pass a series, shape (n,), or vectors, shape (n, 3), without delay.

    A run of nine rows or fewer is padded with as many rows as it can mirror (all but one); ``sosfiltfilt``
    would fail.
    """
    padding = min(PADDING_ROWS, len(rows) - 1)
    padded = np.empty((len(rows) + 2 * padding, *rows.shape[1:]))
    section = design_filter(rate_hz)
    if rows.ndim == 1:
        _filter_series(rows, padding, section, padded)
    else:
        _filter_vectors(rows, padding, section, padded)
    return padded[padding : padding + len(rows)]


@cache
def design_filter(rate_hz: float) -> tuple[float, ...]:
    """Return the section (b0, b1, b2, a1, a2), with a gain of one at rest.

    Bit-identical to ``scipy.signal.butter(2, 5.0, fs=rate_hz, output="sos")``, with the same order of
    operations; loading that package takes longer than analysing an hour.
    """
    warped = 4.0 * np.tan(np.pi * (CORNER_HZ / (rate_hz / 2.0)) / 2.0)
    analog = warped * -np.exp(1j * np.pi * np.array([-1.0, 1.0]) / 4.0)
    pole, conjugate = (4.0 + analog) / (4.0 - analog)
    gain = float(warped**2 * np.real(1.0 / np.prod(4.0 - analog)))
    return gain, 2.0 * gain, gain, float(-(pole + conjugate).real), float((pole * conjugate).real)


@kernel_making_arrays
def _filter_series(series: Any, padding: int, section: Any, padded: Any) -> None:  # pragma: no cover
    _extend(series, padding, padded)
    _pass_series(padded, section)
    _pass_series(padded[::-1], section)


@kernel_making_arrays
def _filter_vectors(vectors: Any, padding: int, section: Any, padded: Any) -> None:  # pragma: no cover
    for c in range(3):
        _extend(vectors[:, c], padding, padded[:, c])
    _pass_vectors(padded, section)
    _pass_vectors(padded[::-1], section)


@inner
def _pass_series(series: Any, section: Any) -> None:  # pragma: no cover
    state = _start(series[0])
    for i in range(len(series)):
        state = _step(series[i], state, section)
        series[i] = state[2]


@inner
def _pass_vectors(vectors: Any, section: Any) -> None:  # pragma: no cover
    """Filter the three axes in one loop, because each only depends on its own previous row."""
    x, y, z = _start(vectors[0, 0]), _start(vectors[0, 1]), _start(vectors[0, 2])
    for i in range(len(vectors)):
        x = _step(vectors[i, 0], x, section)
        y = _step(vectors[i, 1], y, section)
        z = _step(vectors[i, 2], z, section)
        vectors[i, 0], vectors[i, 1], vectors[i, 2] = x[2], y[2], z[2]


@inner
def _extend(series: Any, padding: int, padded: Any) -> None:  # pragma: no cover
    """Write a series with its odd extension at both ends."""
    n = len(series)
    for i in range(n):
        padded[padding + i] = series[i]
    for i in range(1, padding + 1):
        padded[padding - i] = 2.0 * series[0] - series[i]
        padded[padding + n - 1 + i] = 2.0 * series[n - 1] - series[n - 1 - i]


@inner
def _start(x: float) -> tuple[float, float, float, float]:  # pragma: no cover
    """Return the state at rest at the first row: the last two inputs and the last two outputs."""
    return x, x, x, x


@inner
def _step(x: float, state: Any, section: Any) -> tuple[float, float, float, float]:  # pragma: no cover
    """Advance one row through a second-order section.

    Direct form I: a row depends on the previous one through one product and one difference only. This is
    twice as fast as scipy's transposed form II; both agree to rounding.
    """
    b0, b1, b2, a1, a2 = section
    before, earlier, out, out_before = state
    forward = b0 * x + b1 * before + b2 * earlier - a2 * out_before
    return x, before, forward - a1 * out, out


# The filter over the valid runs of a segment.

LOWEST_RATE_HZ = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class MetricAngle:
    """The filtered angle of one segment: shapes (n,); clipped to [0, 180], rounded to 1e-6 deg."""

    start_us: int
    rate_hz: float
    elevation_deg: Float64Array
    valid: BoolArray

    def __len__(self) -> int:
        return len(self.elevation_deg)


def is_filtered(rate_hz: float) -> bool:
    """Return whether a series of this rate is filtered: a 5 Hz corner needs at least 20 Hz."""
    return rate_hz >= LOWEST_RATE_HZ


def filter_elevation(segment: ElevationSegment) -> MetricAngle:
    """Return the filtered angle, the input of all figures.

    Rows that are not finite are not valid. A gap of up to 50 ms is bridged for the filter only; after a
    longer one the filter restarts.
    """
    if is_finite(segment.elevation_deg):
        angle_deg, valid = filter_angle(segment.elevation_deg, segment.rate_hz), segment.valid
    else:
        finite = np.isfinite(segment.elevation_deg)
        angle_deg, valid = _filter_runs(segment, finite), segment.valid & finite
    _clip_and_round(angle_deg)
    return MetricAngle(segment.start_us, segment.rate_hz, angle_deg, valid)


@kernel
def is_finite(angle):  # type: ignore[no-untyped-def]
    """Return whether all rows are finite, without a boolean array."""
    odd = 0
    for i in range(len(angle)):
        odd += not np.isfinite(angle[i])
    return odd == 0


def _filter_runs(segment: ElevationSegment, finite: BoolArray) -> Float64Array:
    angle_deg, bridged_deg = np.zeros(len(segment)), segment.elevation_deg.copy()
    joined = finite.copy()
    for first, stop in find_runs(~finite):
        if first > 0 and stop < len(segment) and (stop - first + 1) * segment.period_us <= LONGEST_BRIDGE_US:
            joined[first:stop] = True
            ends_deg = bridged_deg[[first - 1, stop]]
            bridged_deg[first:stop] = np.interp(np.arange(first, stop), [first - 1, stop], ends_deg)
    for first, stop in find_runs(joined):
        angle_deg[first:stop] = filter_angle(bridged_deg[first:stop], segment.rate_hz)
    return angle_deg


def filter_angle(angle: NDArray[np.float32] | Float64Array, rate_hz: float) -> Float64Array:
    """Low-pass a series, shape (n,), without delay; unchanged if the rate is under 20 Hz."""
    return filter_rows(angle, rate_hz) if is_filtered(rate_hz) else angle.astype(np.float64)


@kernel
def _clip_and_round(angle_deg):  # type: ignore[no-untyped-def]
    """Clip to [0, 180] and round to 1e-6 deg, in place."""
    for i in range(len(angle_deg)):
        angle_deg[i] = np.rint(min(max(angle_deg[i], 0.0), 180.0) * 1e6) / 1e6
