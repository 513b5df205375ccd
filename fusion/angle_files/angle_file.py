"""What a file holds that gives angles without a fusion of ours, and its elevation on even grids.

An orientation R turns the segment's frame into a world frame whose z points to the zenith, as Xsens exports
it (MVN: global frame z up; MT Manager and DOT: ENU). The zenith in the segment's frame is then the third row
of R, whatever the heading: elevation needs no more of an orientation than that.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from fusion.angle_series import AngleRows, resample_angles
from fusion.caveats import Caveat
from fusion.conventions import NPOSE_ERROR_DEG
from fusion.elevation import Elevation, measure_elevation
from fusion.errors import UnknownAxis
from fusion.readers.source import Source, hash_source
from fusion.recording import Float64Array, FloatArray, QualityFlag, Recording

Up = NDArray[np.float32]
"""The unit vector to the zenith in the frame of the segment or sensor, shape (n, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class AngleFile:
    """Rows in the file's own clock, missing ones absent.

    ``device``: "mvn", "dot", "other" (MT Manager) or "angles".
    ``time_s``: shape (n,), rising. The file's own time column; where it has none, seconds from its first row.
    ``first_s``, ``last_s``: the file's clock at its first and its last row, missing ones counted.
    ``elevation_deg``: shape (n,), float32: 0 hanging, 90 level, 180 overhead; None as long as the arm's axis
    is not known.
    ``up``: shape (n, 3), float32: the unit vector to the zenith in the frame of the segment or sensor; None
    where the file holds ready angles.
    ``axis``: shape (3,), unit: along the upper arm towards the shoulder in that frame; None where it is not
    known.
    ``understood``: what the reader took the file for, for people.
    """

    device: str
    sha256: str
    time_s: Float64Array
    first_s: float
    last_s: float
    elevation_deg: NDArray[np.float32] | None = None
    up: Up | None = None
    axis: Float64Array | None = None
    start: datetime | None = None
    flags: tuple[QualityFlag, ...] = ()
    understood: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class AngleFileOptions:
    """What the person says about a file.

    ``side``: which arm of an MVNX, the right one where nothing is said; ``rate_hz``: for files without time.
    """

    side: str | None = None
    rate_hz: float | None = None


def keep_orientation(
    device: str,
    source: Source,
    time_s: Float64Array,
    up: Up,
    understood: Mapping[str, str],
    start: datetime | None = None,
) -> AngleFile:
    """Keep the rows, times (n,) and zenith (n, 3), that hold an orientation."""
    present = np.isfinite(up).all(axis=1)
    return AngleFile(
        device=device,
        sha256=hash_source(source),
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        up=up[present],
        start=start,
        understood=understood,
    )


# From the rows of a file to an elevation; the arm's axis from the pose where it is unknown.

SHORTEST_QUATERNION = 0.5
"""Quaternions shorter than this are no rotation: the row is missing. Xsens writes unit ones to 1e-6."""
STILL_S, STILL_DEG, LEAST_ROWS = 2.0, 3.0, 10
STEADY = 0.99
"""Length of the mean vertical over the calibration: below it the sensor turned by about 8 deg or more."""


def take_up_of_quaternion(quaternion_wxyz: Float64Array) -> Up:
    """Return the third row of R for each quaternion (n, 4), segment to world; NaN where it is none."""
    w, x, y, z = _scale_to_unit(quaternion_wxyz).T
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    return up.astype(np.float32)


def take_up_of_euler(roll_deg: Float64Array, pitch_deg: Float64Array) -> Up:
    """Return the third row of R = Rz(yaw) Ry(pitch) Rx(roll), Xsens's order (aerospace sequence)."""
    roll, pitch = np.radians(roll_deg), np.radians(pitch_deg)
    up = [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    return np.stack(up, axis=1).astype(np.float32)


def take_up_of_row(third_row: Float64Array) -> Up:
    """Return the third row of R, (n, 3), at length one; NaN where it has none."""
    return _scale_to_unit(third_row).astype(np.float32)


def _scale_to_unit(rows: Float64Array) -> Float64Array:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(rows / np.where(length < SHORTEST_QUATERNION, np.nan, length))


def measure_from_up(up: Up, axis: Float64Array) -> NDArray[np.float32]:
    """Return the elevation of an axis that points to the shoulder: 0 where it points to the zenith."""
    return measure_elevation(np.ascontiguousarray(up), axis)


def resample_file(file: AngleFile, values: FloatArray) -> tuple[Recording, Elevation]:
    """Resample values, one for each row, on even grids, cut at holes; as a recording without samples."""
    rows = AngleRows(file.time_s, np.asarray(values, np.float64), file.first_s, file.last_s)
    zone = file.start.tzname() if file.start else None
    empty = Recording(
        file.device, file.sha256, file.start, zone, 0, (), flags=file.flags, understood=file.understood
    )
    return resample_angles(empty, rows)


def calibrate_file(file: AngleFile, window_s: tuple[float, float]) -> AngleFile:
    """Take the direction of the vertical while the arm hung (file's clock) as the arm's axis.

    Raises UnknownAxis: no row in that time, or the sensor turned.
    """
    if file.up is None:
        return file
    inside = (file.time_s >= window_s[0]) & (file.time_s <= window_s[1])
    mean = file.up[inside].mean(axis=0).astype(np.float64) if inside.any() else np.zeros(3)
    length = float(np.linalg.norm(mean))
    if not length >= STEADY:
        raise UnknownAxis
    axis = mean / length
    return replace(file, axis=axis, elevation_deg=measure_from_up(file.up, axis))


def calibrate_alone(file: AngleFile, windows_s: tuple[tuple[float, float], ...]) -> AngleFile:
    """Return an orientation with its arm axis: at the time asked for, else in its first still 2 s.

    Raises UnknownAxis: the sensor did not hang still in the time asked for, or never.
    """
    if file.elevation_deg is not None:
        return file
    start_s, end_s = windows_s[0] if windows_s else _find_still(file)
    calibrated = calibrate_file(file, (start_s + file.first_s, end_s + file.first_s))
    flag = QualityFlag(Caveat.NPOSE, facts={"reads_low_by_up_to_deg": NPOSE_ERROR_DEG})
    understood = {**file.understood, "calibration_s": f"{start_s:g} - {end_s:g}"}
    return replace(calibrated, flags=(*file.flags, flag), understood=understood)


def _find_still(file: AngleFile) -> tuple[float, float]:
    """Find the first 2 s in which the vertical stays within 3 deg of its mean; from the first row."""
    if file.up is None:
        raise UnknownAxis
    time_s = file.time_s - file.first_s
    for start_s in np.arange(0.0, float(time_s[-1]) - STILL_S + 1e-6, STILL_S / 4):
        first, stop = np.searchsorted(time_s, [start_s, start_s + STILL_S]).tolist()
        up = file.up[first:stop]
        if len(up) < LEAST_ROWS:
            continue
        mean = up.mean(axis=0)
        if (up @ (mean / np.linalg.norm(mean)) > np.cos(np.radians(STILL_DEG))).all():
            return float(start_s), float(start_s + STILL_S)
    raise UnknownAxis
