"""From the rows of a file to an elevation like every other, and the arm's axis where only the pose tells it."""

from dataclasses import replace

import numpy as np

from fusion.angle_files.types import AngleFile
from fusion.angle_files.vertical import measure_from_up
from fusion.angle_series import AngleRows, lay_angles
from fusion.elevation import Elevation
from fusion.errors import UnknownAxis
from fusion.recording import FloatArray, Recording

STEADY = 0.99
"""Length of the mean vertical over the calibration: below it the sensor turned by about 8 deg or more."""


def lay_file(file: AngleFile, values: FloatArray) -> tuple[Recording, Elevation]:
    """Lay values, one for each row, on even grids, cut at holes; as a recording without samples."""
    rows = AngleRows(file.time_s, np.asarray(values, np.float64), file.first_s, file.last_s)
    zone = file.start.tzname() if file.start else None
    empty = Recording(
        file.device, file.sha256, file.start, zone, 0, (), flags=file.flags, understood=file.understood
    )
    return lay_angles(empty, rows)


def calibrate_file(file: AngleFile, window_s: tuple[float, float]) -> AngleFile:
    """Take the direction of the vertical while the arm hung (file's clock) as the arm's axis.

    Raises
    ------
    UnknownAxis
        No row in that time, or the sensor turned.
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
