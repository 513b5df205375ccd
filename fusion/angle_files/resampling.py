"""From the rows of a file to an elevation on even grids; the arm's axis from the pose where it is unknown."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fusion.angle_files.types import AngleFile
from fusion.angle_files.vertical import measure_from_up
from fusion.angle_series import AngleRows, resample_angles
from fusion.caveats import Caveat
from fusion.conventions import NPOSE_ERROR_DEG
from fusion.elevation import Elevation
from fusion.errors import UnknownAxis
from fusion.recording import FloatArray, QualityFlag, Recording

STILL_S, STILL_DEG, LEAST_ROWS = 2.0, 3.0, 10
STEADY = 0.99
"""Length of the mean vertical over the calibration: below it the sensor turned by about 8 deg or more."""


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


def calibrate_alone(file: AngleFile, windows_s: tuple[tuple[float, float], ...]) -> AngleFile:
    """Give an orientation its arm axis: at the time asked for, else in its first still 2 s.

    Raises
    ------
    UnknownAxis
        The sensor did not hang still in the time asked for, or never.
    """
    if file.elevation_deg is not None:
        return file
    window_s = windows_s[0] if windows_s else _find_still(file)
    shifted_s = (window_s[0] + file.first_s, window_s[1] + file.first_s)
    calibrated = calibrate_file(file, shifted_s)
    flag = QualityFlag(Caveat.NPOSE, facts={"reads_low_by_up_to_deg": NPOSE_ERROR_DEG})
    understood = {"calibration_s": f"{window_s[0]:g} - {window_s[1]:g}"}
    return replace(calibrated, flags=(*file.flags, flag), understood={**file.understood, **understood})


def _find_still(file: AngleFile) -> tuple[float, float]:
    """Give the first 2 s in which the vertical stays within 3 deg of its mean; from the first row."""
    if file.up is None:
        raise UnknownAxis
    time_s = file.time_s - file.first_s
    for start_s in np.arange(0.0, float(time_s[-1]) - STILL_S + 1e-6, STILL_S / 4):
        rows = slice(*np.searchsorted(time_s, [start_s, start_s + STILL_S]).tolist())
        if _is_still(file.up[rows]):
            return float(start_s), float(start_s + STILL_S)
    raise UnknownAxis


def _is_still(up: NDArray[np.float32]) -> bool:
    if len(up) < LEAST_ROWS:
        return False
    mean = up.mean(axis=0)
    return bool((up @ (mean / np.linalg.norm(mean)) > np.cos(np.radians(STILL_DEG))).all())
