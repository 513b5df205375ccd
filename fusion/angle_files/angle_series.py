"""Read a CSV of angles, and resample angles or orientations of any file on even grids."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import pairwise
from typing import BinaryIO

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv

from acromion.fusion.caveats import Caveat
from acromion.fusion.conventions import NPOSE_ERROR_DEG
from acromion.fusion.elevation import Elevation, ElevationSegment, measure_elevation
from acromion.fusion.errors import (
    EmptyFile,
    TooShort,
    UnknownAxis,
    UnknownColumns,
    UnknownFormat,
    UnreadableRows,
    UnusableTime,
    WrongAngle,
)
from acromion.fusion.readers.source import Source, hash_source
from acromion.fusion.recording import (
    MICROSECONDS,
    Float64Array,
    FloatArray,
    IntArray,
    QualityFlag,
    Recording,
    Segment,
)
from acromion.fusion.runs import find_runs

# An angle series: a CSV with the columns ``time_s`` and ``elevation_deg``; an empty cell is missing.
#
# Separated by commas, semicolons or tabs. With semicolons or tabs the decimal mark may be a comma (French
# Excel).
#
# Missing values are not filled. A step of more than 1.5 sample periods is a gap. A gap of up to 50 ms is
# interpolated for the filter only, and the interpolated rows are not valid. A longer gap ends the segment.

COLUMNS = ("time_s", "elevation_deg")
LONGEST_BRIDGE_S = 0.05
HOLE_PERIODS = 1.5
ANGLE_TOLERANCE_DEG = 0.5
LONGEST_S = 366 * 86400.0
BLOCK_BYTES = 1 << 20
MOST_UNREADABLE = 0.05
NUMBER = r"^\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*$"
MISSING = ["", "NaN", "nan", "NA", "null"]


@dataclass(frozen=True, slots=True, eq=False)
class _Rows:
    """The table, shape (n,): NaN if an angle is empty or not a number; ``line`` is the line in the file."""

    time_s: Float64Array
    elevation_deg: Float64Array
    line: IntArray
    dropped_rows: int = 0
    has_commas: bool = False


@dataclass(frozen=True, slots=True)
class _Layout:
    """The layout of the table."""

    names: tuple[str, ...]
    delimiter: str
    decimal_mark: str


@dataclass(frozen=True, slots=True, eq=False)
class AngleRows:
    """The rows with an angle, shape (n,), and the times of the first and last of all rows."""

    time_s: Float64Array
    elevation_deg: Float64Array
    first_s: float
    last_s: float


def read_angle_series(file: BinaryIO) -> tuple[Recording, Elevation]:
    """Read a precomputed angle series from an open binary file that can be rewound.

    The segments of the recording have a start and a rate, but no samples: their arrays have shape (0, 3).

    Raises
    ------
    UnknownFormat
        Not a text table, or without the two columns.
    UnreadableRows
        More than 5 % of the rows have no time or a value that is not a number.
    UnusableTime
        The times do not increase, or are too few for a rate.
    WrongAngle
        An elevation more than 0.5 deg outside 0 to 180.
    TooShort
        No angle at all.
    """
    digest = hashlib.sha256()
    while block := file.read(BLOCK_BYTES):
        digest.update(block)
    file.seek(0)
    rows = _read_rows(file)
    _check_rows(rows)
    present = np.isfinite(rows.elevation_deg)
    if not present.any():
        raise TooShort(s=0.0)
    angle_deg = np.clip(rows.elevation_deg[present], 0.0, 180.0)
    series = AngleRows(rows.time_s[present], angle_deg, float(rows.time_s[0]), float(rows.time_s[-1]))
    flags = (QualityFlag(Caveat.ROWS_DROPPED, rows.dropped_rows),) if rows.dropped_rows else ()
    if rows.has_commas:
        flags = (*flags, QualityFlag(Caveat.LOCALE))
    recording = Recording(
        device="angles",
        sha256=digest.hexdigest(),
        start=None,
        time_zone=None,
        duration_us=0,
        segments=(),
        flags=flags,
        understood={"layout": "angles", "columns": ", ".join(COLUMNS)},
    )
    return resample_angles(recording, series)


def resample_angles(recording: Recording, series: AngleRows) -> tuple[Recording, Elevation]:
    """Resample rows of angles on even grids, split at gaps, and set the recording's length, rate and gaps.

    Raises UnusableTime: too few rows for a rate.
    """
    steps_s = np.diff(series.time_s)
    if len(steps_s) == 0:
        raise UnusableTime(why="rows")
    # the mean of the steps within 1.5 medians, so that rounding of the times averages out
    period_s = float(steps_s[steps_s <= HOLE_PERIODS * np.median(steps_s)].mean())
    longest_s = max(HOLE_PERIODS * period_s, LONGEST_BRIDGE_S + 1e-9)
    edges = [0, *(np.flatnonzero(steps_s > longest_s) + 1).tolist(), len(series.time_s)]
    segments = tuple(_make_segment(series, slice(*rows), period_s) for rows in pairwise(edges))
    duration_us = round((series.last_s - series.first_s + period_s) * MICROSECONDS)
    nothing = np.empty((0, 3), np.float32)
    laid = replace(
        recording,
        duration_us=duration_us,
        segments=tuple(Segment(segment.start_us, segment.rate_hz, nothing, nothing) for segment in segments),
        flags=(*recording.flags, *_flag_missing(segments, duration_us)),
        understood={**recording.understood, "rate_hz": f"{1.0 / period_s:.6g}"},
    )
    return laid, Elevation(segments, None)


def _read_rows(file: BinaryIO) -> _Rows:
    """Return the rows that have a time."""
    start = file.read(4096)
    file.seek(0)
    if not start.strip():
        raise EmptyFile
    if b"\0" in start:
        raise UnknownFormat(kind="binary")
    header = start.decode("utf-8-sig", "replace").splitlines()[0]
    # if another delimiter is used, a comma is the decimal mark
    delimiter = max((",", ";", "\t"), key=header.count)
    names = tuple(name.strip().strip('"') for name in header.split(delimiter))
    layout = _Layout(names, delimiter, "," if delimiter != "," and b"," in start else ".")
    if not set(COLUMNS) <= set(layout.names):
        raise UnknownColumns(list=header[:200])
    return _parse(file, layout)


def _parse(file: BinaryIO, layout: _Layout) -> _Rows:
    """Read the columns as numbers; if that fails, read them as text and count unreadable cells.

    Rows without a time are skipped. Raises UnreadableRows if more than 5 % cannot be read.
    """
    from pyarrow import compute as pc  # noqa: PLC0415  slow to load, and only this needs it

    try:
        table, broken = _parse_columns(file, layout, pa.float64())
    except pa.ArrowInvalid:
        file.seek(0)
        table, broken = _parse_columns(file, layout, pa.string())
        if layout.decimal_mark == ",":
            table = pa.table({name: pc.replace_substring(table[name], ",", ".") for name in COLUMNS})
        unreadable = pc.invert(pc.match_substring_regex(table["elevation_deg"], NUMBER))
        broken += int(pc.sum(unreadable).as_py() or 0)
    time_s, elevation_deg = (_to_numbers(table[name]) for name in COLUMNS)
    line, timed = np.arange(2, table.num_rows + 2), np.isfinite(time_s)
    dropped = broken + int(np.count_nonzero(~timed))
    if dropped > MOST_UNREADABLE * (len(timed) + broken):
        raise UnreadableRows(k=dropped, line=2 if timed.all() else int(line[~timed][0]))
    has_commas = layout.decimal_mark == ","
    return _Rows(time_s[timed], elevation_deg[timed], line[timed], dropped, has_commas)


def _parse_columns(file: BinaryIO, layout: _Layout, kind: pa.DataType) -> tuple[pa.Table, int]:
    """Return the two columns and the number of lines with too many or too few values."""
    broken: list[int | None] = []

    def skip_row(row: csv.InvalidRow) -> str:
        broken.append(row.number)
        return "skip"

    table = csv.read_csv(
        file,
        csv.ReadOptions(column_names=list(layout.names), skip_rows=1, use_threads=False),
        csv.ParseOptions(delimiter=layout.delimiter, invalid_row_handler=skip_row),
        csv.ConvertOptions(
            column_types=dict.fromkeys(COLUMNS, kind),
            include_columns=list(COLUMNS),
            null_values=MISSING,
            strings_can_be_null=True,
            decimal_point=layout.decimal_mark,
        ),
    )
    return table, len(broken)


def _to_numbers(column: pa.ChunkedArray) -> Float64Array:
    if column.type == pa.string():
        from pyarrow import compute as pc  # noqa: PLC0415  slow to load, and only this needs it

        readable = pc.match_substring_regex(column, NUMBER)
        column = pc.if_else(readable, pc.utf8_trim_whitespace(column), None).cast(pa.float64())
    return np.asarray(column.to_numpy(), np.float64)


def _check_rows(rows: _Rows) -> None:
    if len(rows.time_s) < 2:
        raise UnusableTime(why="rows")
    backwards = np.flatnonzero(np.diff(rows.time_s) <= 0.0)
    if len(backwards):
        raise UnusableTime(why="backwards", line=int(rows.line[backwards[0] + 1]))
    if rows.time_s[-1] - rows.time_s[0] > LONGEST_S:
        raise UnusableTime(why="span")
    low, high = -ANGLE_TOLERANCE_DEG, 180.0 + ANGLE_TOLERANCE_DEG
    wrong = np.flatnonzero((rows.elevation_deg < low) | (rows.elevation_deg > high))
    if len(wrong):
        raise WrongAngle(value=f"{rows.elevation_deg[wrong[0]]:g}", line=int(rows.line[wrong[0]]))


def _make_segment(series: AngleRows, rows: slice, period_s: float) -> ElevationSegment:
    """Resample a run on an even grid; rows within a short gap are interpolated and marked as not valid."""
    time_s, elevation_deg = series.time_s[rows], series.elevation_deg[rows]
    steps = np.diff(time_s)
    periods = np.maximum(np.rint(steps / period_s).astype(np.int64), 2)
    places = np.concatenate([[0], np.cumsum(np.where(steps > HOLE_PERIODS * period_s, periods, 1))])
    count = int(places[-1]) + 1
    rate_hz = round((count - 1) / (time_s[-1] - time_s[0]), 9) if count > 1 else 1.0 / period_s
    valid = np.zeros(count, np.bool_)
    valid[places] = True
    bridged = tuple((int(first), int(stop)) for first, stop in find_runs(~valid))
    angle = elevation_deg if len(places) == count else np.interp(np.arange(count), places, elevation_deg)
    start_us = round((time_s[0] - series.first_s) * MICROSECONDS)
    return ElevationSegment(start_us, float(rate_hz), angle.astype(np.float32), valid, bridged=bridged)


def _flag_missing(segments: tuple[ElevationSegment, ...], duration_us: int) -> tuple[QualityFlag, ...]:
    """Return the flag of the time missing between the first and the last timestamp."""
    present_us = sum(int(segment.valid.sum()) * MICROSECONDS / segment.rate_hz for segment in segments)
    missing_s = (duration_us - present_us) / MICROSECONDS
    if missing_s < 0.5 / segments[0].rate_hz:
        return ()
    return (QualityFlag(Caveat.GAP, max(len(segments) - 1, 1), round(missing_s, 6)),)


# The content of a file with angles or orientations, and its elevation on even grids.
#
# An orientation R rotates the segment's frame into a world frame with z up, as Xsens exports it (MVN: global
# frame z up; MT Manager and DOT: ENU). The zenith in the segment's frame is the third row of R, for any
# heading. The elevation depends on no other part of the orientation.

Up = NDArray[np.float32]
"""The unit vector to the zenith in the frame of the segment or sensor, shape (n, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class AngleFile:
    """Rows in the file's own clock, without missing rows.

    ``device``: "mvn", "dot", "other" (MT Manager) or "angles".
    ``time_s``: shape (n,), increasing. The file's own time column; if it has none, seconds from its first
    row.
    ``first_s``, ``last_s``: the file's clock at its first and last row, including missing rows.
    ``elevation_deg``: shape (n,), float32: 0 hanging, 90 level, 180 overhead; None until the arm axis is
    known.
    ``up``: shape (n, 3), float32: the unit vector to the zenith in the frame of the segment or sensor; None
    if the file contains precomputed angles.
    ``axis``: shape (3,), unit vector along the upper arm towards the shoulder in that frame; None if unknown.
    ``understood``: the reader's interpretation of the file, for people.
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
    """The person's statements about a file.

    ``side``: which arm of an MVNX; the right one by default.
    ``rate_hz``: for files without time.
    """

    side: str | None = None
    rate_hz: float | None = None


def build_orientation_file(
    device: str,
    source: Source,
    time_s: Float64Array,
    up: Up,
    understood: Mapping[str, str],
    start: datetime | None = None,
) -> AngleFile:
    """Return the rows with an orientation, from times (n,) and zenith vectors (n, 3)."""
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


# From the rows of a file to an elevation; the arm axis comes from a still period if it is unknown.

SHORTEST_QUATERNION = 0.5
"""A shorter quaternion is not a rotation: the row is missing. Xsens writes unit quaternions to 1e-6."""
STILL_S, STILL_DEG, LEAST_ROWS = 2.0, 3.0, 10
STEADY = 0.99
"""Length of the mean vertical over the calibration; a lower value means that the sensor turned by about 8 deg
or more.
"""


def compute_up_from_quaternion(quaternion_wxyz: Float64Array) -> Up:
    """Return the third row of R for each quaternion (n, 4), segment to world; NaN if it is not a rotation."""
    w, x, y, z = _scale_to_unit(quaternion_wxyz).T
    up = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
    return up.astype(np.float32)


def compute_up_from_euler(roll_deg: Float64Array, pitch_deg: Float64Array) -> Up:
    """Return the third row of R = Rz(yaw) Ry(pitch) Rx(roll), Xsens's order (aerospace sequence)."""
    roll, pitch = np.radians(roll_deg), np.radians(pitch_deg)
    up = [-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)]
    return np.stack(up, axis=1).astype(np.float32)


def compute_up_from_row(third_row: Float64Array) -> Up:
    """Return the third row of R, (n, 3), at unit length; NaN if it is missing."""
    return _scale_to_unit(third_row).astype(np.float32)


def _scale_to_unit(rows: Float64Array) -> Float64Array:
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(rows / np.where(length < SHORTEST_QUATERNION, np.nan, length))


def measure_from_up(up: Up, axis: Float64Array) -> NDArray[np.float32]:
    """Return the elevation of an axis that points to the shoulder: 0 if it points to the zenith."""
    return measure_elevation(np.ascontiguousarray(up), axis)


def resample_file(file: AngleFile, values: FloatArray) -> tuple[Recording, Elevation]:
    """Resample values, one per row, on even grids, split at gaps, as a recording without samples."""
    rows = AngleRows(file.time_s, np.asarray(values, np.float64), file.first_s, file.last_s)
    zone = file.start.tzname() if file.start else None
    empty = Recording(
        file.device, file.sha256, file.start, zone, 0, (), flags=file.flags, understood=file.understood
    )
    return resample_angles(empty, rows)


def calibrate_file(file: AngleFile, window_s: tuple[float, float]) -> AngleFile:
    """Use the direction of the vertical while the arm hung (file's clock) as the arm axis.

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
    """Return an orientation with its arm axis, from the requested time or from its first still 2 s.

    Raises UnknownAxis: the sensor did not hang still in the requested time, or never did.
    """
    if file.elevation_deg is not None:
        return file
    start_s, end_s = windows_s[0] if windows_s else _find_still(file)
    calibrated = calibrate_file(file, (start_s + file.first_s, end_s + file.first_s))
    flag = QualityFlag(Caveat.NPOSE, facts={"reads_low_by_up_to_deg": NPOSE_ERROR_DEG})
    understood = {**file.understood, "calibration_s": f"{start_s:g} - {end_s:g}"}
    return replace(calibrated, flags=(*file.flags, flag), understood=understood)


def _find_still(file: AngleFile) -> tuple[float, float]:
    """Return the first 2 s with the vertical within 3 deg of its mean, in seconds from the first row."""
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
