"""Any CSV of ``time, angle`` or ``time, quaternion``, known by the names of its columns.

Time in seconds, or in the unit that its name ends in (``_ms``, ``_us``). The angle in degrees, 0 hanging; an
empty one is missing. A quaternion (w first) turns the sensor's or segment's frame into one whose z is up.
"""

from collections.abc import Container

import numpy as np

from fusion.angle_files.tables import Layout, find_layout, find_orientation, read_columns, read_up, require
from fusion.angle_files.types import AngleFile, AngleFileOptions
from fusion.errors import UnusableTime, WrongAngle
from fusion.readers.source import Source, hash_source
from fusion.recording import Float64Array

TIMES = {
    **dict.fromkeys(("time_s", "time", "t", "t_s", "times", "seconds", "timestamp", "temps", "temps_s"), 1.0),
    **dict.fromkeys(("time_ms", "timems", "t_ms", "milliseconds", "timestamp_ms"), 1e-3),
    **dict.fromkeys(("time_us", "timeus", "t_us", "microseconds", "timestamp_us"), 1e-6),
}
ANGLES = ("elevation_deg", "angle_deg", "angledeg", "elevationdeg", "angle", "elevation", "theta_deg")
NEEDED_ANGLE = (frozenset(TIMES), frozenset(ANGLES))
NEEDED_TIME = (frozenset(TIMES),)
ANGLE_TOLERANCE_DEG = 0.5


def recognise(source: Source) -> bool:
    """A header with a time, and an angle or an orientation."""
    if find_layout(source, NEEDED_ANGLE) is not None:
        return True
    layout = find_layout(source, NEEDED_TIME)
    return layout is not None and find_orientation(layout.names) is not None


def read(source: Source, _options: AngleFileOptions) -> AngleFile:
    """Read an angle or, where there is none, an orientation.

    Raises
    ------
    fusion.errors.FusionError
        Unreadable rows, no usable time, an angle that cannot be.
    """
    layout = find_layout(source, NEEDED_ANGLE)
    if layout is not None:
        return _read_angle(source, layout)
    layout = require(find_layout(source, NEEDED_TIME), source)
    orientation = find_orientation(layout.names)
    if orientation is None:
        raise UnusableTime(why="rows")
    time_name = _find(layout, TIMES)
    up, values = read_up(source, layout, orientation, [time_name])
    time_s = check_times(values[time_name] * TIMES[time_name])
    present = np.isfinite(up).all(axis=1)
    return AngleFile(
        device="angles",
        sha256=hash_source(source),
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        up=up[present],
        understood={"layout": "CSV", "source": orientation[0]},
    )


def _read_angle(source: Source, layout: Layout) -> AngleFile:
    time_name, angle_name = _find(layout, TIMES), _find(layout, ANGLES)
    values = read_columns(source, layout, [time_name, angle_name])
    time_s = check_times(values[time_name] * TIMES[time_name])
    understood = {"layout": "CSV", "source": angle_name}
    return keep_angles(time_s, values[angle_name], hash_source(source), understood)


def keep_angles(
    time_s: Float64Array, elevation_deg: Float64Array, sha256: str, understood: dict[str, str]
) -> AngleFile:
    """Keep the rows that hold an angle.

    Raises
    ------
    WrongAngle
        More than 0.5 deg outside 0 to 180.
    """
    wrong = (elevation_deg < -ANGLE_TOLERANCE_DEG) | (elevation_deg > 180.0 + ANGLE_TOLERANCE_DEG)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise WrongAngle(value=f"{elevation_deg[row]:g}", line=row + 2)
    present = np.isfinite(elevation_deg)
    return AngleFile(
        device="angles",
        sha256=sha256,
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        elevation_deg=np.clip(elevation_deg[present], 0.0, 180.0).astype(np.float32),
        understood=understood,
    )


def check_times(time_s: Float64Array) -> Float64Array:
    """Let only times through that rise.

    Raises
    ------
    UnusableTime
    """
    if len(time_s) < 2:
        raise UnusableTime(why="rows")
    steps = np.diff(time_s)
    if not (steps > 0).all():
        raise UnusableTime(why="backwards", line=int(np.flatnonzero(~(steps > 0))[0] + 3))
    return time_s


def _find(layout: Layout, names: Container[str]) -> str:
    return next(name for name in layout.names if name in names)
