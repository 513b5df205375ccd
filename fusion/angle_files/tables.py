"""Read text tables of angles or orientations: MT Manager, Xsens DOT, and any CSV with a time column."""

import re
from array import array
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone

import numpy as np
import pyarrow as pa
from pyarrow import csv

from acromion.fusion.angle_files.angle_series import (
    AngleFile,
    AngleFileOptions,
    Up,
    build_orientation_file,
    compute_up_from_euler,
    compute_up_from_quaternion,
    compute_up_from_row,
)
from acromion.fusion.errors import (
    EmptyFile,
    MissingSegment,
    UnknownRate,
    UnreadableRows,
    UnusableTime,
    WrongAngle,
)
from acromion.fusion.readers.samples import check_rows
from acromion.fusion.readers.source import Source, hash_source
from acromion.fusion.recording import Float64Array

MISSING = ["", "NaN", "nan", "NAN", "NA", "N/A", "null", "-"]
DELIMITERS = ("\t", ";", ",", " ")
LINES_LOOKED_AT = 60
MOST_UNREADABLE = 0.05
NUMBER = r"^[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$"


@dataclass(frozen=True, slots=True)
class Layout:
    """The position of the header and the delimiter of its fields; ``before`` contains the lines above it."""

    header_line: int
    delimiter: str
    names: tuple[str, ...]
    before: str
    decimal: str = "."


def find_layout(source: Source, needed: Sequence[frozenset[str]]) -> Layout | None:
    """Return the layout whose header has at least one of each set of columns (lower case, without spaces)."""
    lines = source.head.decode("utf-8-sig", "replace").splitlines()[:LINES_LOOKED_AT]
    for number, line in enumerate(lines):
        for delimiter in DELIMITERS:
            fields = [field.strip().lower() for field in line.split(delimiter)]
            names = tuple("".join(sign for sign in name if sign.isalnum() or sign == "_") for name in fields)
            if len(names) > 1 and all(options & set(names) for options in needed):
                has_comma = delimiter in "\t;" and any("," in row for row in lines[number + 1 : number + 4])
                before = "\n".join(lines[:number])
                return Layout(number, delimiter, names, before, "," if has_comma else ".")
    return None


def _get_layout(source: Source, needed: Sequence[frozenset[str]]) -> Layout:
    layout = find_layout(source, needed)
    assert layout is not None, "a file is read only by the reader that recognised it"
    return layout


def read_columns(source: Source, layout: Layout, wanted: Sequence[str]) -> Mapping[str, Float64Array]:
    """Read columns as numbers, in batches; NaN if a field is empty or not a number.

    Raises
    ------
    UnreadableRows
        More than 5 % of the rows have too many or too few fields.
    EmptyFile
        A header without rows.
    acromion.fusion.errors.TooLong
    """
    broken: list[int | None] = []

    def skip_row(row: csv.InvalidRow) -> str:
        broken.append(row.number)
        return "skip"

    source.file.seek(0)
    # If a column name occurs twice, the first column keeps it.
    names = [
        name if layout.names.index(name) == at and name else f"{name}#{at}"
        for at, name in enumerate(layout.names)
    ]
    rows = csv.open_csv(
        source.file,
        csv.ReadOptions(column_names=names, skip_rows=layout.header_line + 1, use_threads=False),
        csv.ParseOptions(delimiter=layout.delimiter, invalid_row_handler=skip_row),
        csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, pa.string()), include_columns=list(wanted), null_values=MISSING
        ),
    )
    columns: dict[str, array[float]] = {name: array("d") for name in wanted}
    n_rows = 0
    for batch in rows:
        for name in wanted:
            columns[name].frombytes(_to_numbers(batch.column(name), layout.decimal).tobytes())
        n_rows += batch.num_rows
        check_rows(n_rows, source.read_bytes, source.size_bytes)
    if len(broken) > MOST_UNREADABLE * (n_rows + len(broken)):
        raise UnreadableRows(k=len(broken), line=broken[0] or layout.header_line + 2)
    if n_rows == 0:
        raise EmptyFile
    return {name: np.frombuffer(values) for name, values in columns.items()}


def _to_numbers(column: pa.Array, decimal: str) -> Float64Array:
    from pyarrow import compute as pc  # noqa: PLC0415  slow to load, and only this needs it

    text = pc.utf8_trim_whitespace(column)
    if decimal == ",":
        text = pc.replace_substring(text, ",", ".")
    readable = pc.match_substring_regex(text, NUMBER)
    numbers = pc.if_else(readable, text, None).cast(pa.float64())
    return np.asarray(numbers.to_numpy(zero_copy_only=False), np.float64)


# Columns that contain an orientation, by the names of Xsens and others.
#
# If an export has several equivalent forms, a matrix is used before a quaternion, and that before Euler
# angles.

ORIENTATIONS: Sequence[tuple[str, tuple[str, ...]]] = (
    ("matrix", ("mat31", "mat32", "mat33")),
    ("quaternion", ("quat_q0", "quat_q1", "quat_q2", "quat_q3")),
    ("quaternion", ("quat_w", "quat_x", "quat_y", "quat_z")),
    ("quaternion", ("quatw", "quatx", "quaty", "quatz")),
    ("quaternion", ("qw", "qx", "qy", "qz")),
    ("quaternion", ("q_w", "q_x", "q_y", "q_z")),
    ("quaternion", ("q0", "q1", "q2", "q3")),
    ("quaternion", ("q_0", "q_1", "q_2", "q_3")),
    ("quaternion", ("quaternion_w", "quaternion_x", "quaternion_y", "quaternion_z")),
    ("quaternion", ("w", "x", "y", "z")),
    ("euler", ("roll", "pitch")),
    ("euler", ("euler_x", "euler_y")),
)


def _find_orientation(layout: Layout) -> tuple[str, tuple[str, ...]] | None:
    """Return the form of the orientation and its columns."""
    return next((one for one in ORIENTATIONS if set(one[1]) <= set(layout.names)), None)


def _read_up(
    source: Source, layout: Layout, others: Sequence[str], lacking: str = ""
) -> tuple[Up, str, Mapping[str, Float64Array]]:
    """Read the zenith in the sensor's frame (n, 3), the form of the orientation, and the columns ``others``.

    Raises MissingSegment: an export without orientation; ``lacking`` names the possible columns.
    """
    orientation = _find_orientation(layout)
    if orientation is None:
        raise MissingSegment(segment=lacking)
    kind, columns = orientation
    values = read_columns(source, layout, [*columns, *others])
    numbers = [values[name] for name in columns]
    if kind == "euler":
        return compute_up_from_euler(numbers[0], numbers[1]), kind, values
    stacked = np.stack(numbers, axis=1)
    return (compute_up_from_row if kind == "matrix" else compute_up_from_quaternion)(stacked), kind, values


def _unwrap_counter(counter: Float64Array, span: float) -> Float64Array:
    """Undo the wraps of a counter that restarts at ``span``; a large step back is a wrap.

    Raises UnusableTime: the counter goes back without wrapping, or is missing.
    """
    if not np.isfinite(counter).all():
        raise UnusableTime(why="missing")
    steps = np.diff(counter)
    wrapped = counter + span * np.concatenate([[0], np.cumsum(steps < -span / 2)])
    backwards = np.flatnonzero(np.diff(wrapped) <= 0)
    if len(backwards):
        raise UnusableTime(why="backwards", line=int(backwards[0] + 2))
    return np.asarray(wrapped - wrapped[0])


# MT Manager's text export, 4.x and 2022: one tracker, fields separated by tab, comma, semicolon or space.
#
# The orientation is that of the sensor to the world (ENU, z up), as a matrix, a quaternion or Euler angles.
# Time: ``SampleTimeFine`` (0.1 ms) if it is filled; otherwise the packet counter over the update rate.
# Version 4.x writes this rate above the table; for 2022 the person has to enter it.
#
# Source: MT Manager User Manual, chapter on ASCII export; checked on exports of both versions.

PACKETS, FINE = "packetcounter", "sampletimefine"
PACKET_SPAN, FINE_SPAN = 2.0**16, 2.0**32
NEEDED_BY_MT_MANAGER = (frozenset({PACKETS}),)
MT_MANAGER_TICK_S = 1e-4
RATE = re.compile(r"Update Rate:\s*([\d.]+)\s*Hz")
VERSION = re.compile(r"MT Manager version:\s*([\w.]+)")


def recognise_mt_manager(source: Source) -> bool:
    """Return whether the file starts with // lines above a table with a packet counter."""
    return source.head.startswith(b"//") and find_layout(source, NEEDED_BY_MT_MANAGER) is not None


def read_mt_manager(source: Source, options: AngleFileOptions) -> AngleFile:
    """Read the tracker's orientation; the file does not state the arm axis.

    Raises
    ------
    MissingSegment
        An export without orientation.
    UnknownRate
        Neither time nor rate in the file, and no rate entered.
    """
    layout = _get_layout(source, NEEDED_BY_MT_MANAGER)
    others = [name for name in (PACKETS, FINE) if name in layout.names]
    up, kind, values = _read_up(source, layout, others, "Mat, Quat, Roll/Pitch")
    rate = ""
    if FINE in values and np.isfinite(values[FINE]).all():
        time_s = _unwrap_counter(values[FINE], FINE_SPAN) * MT_MANAGER_TICK_S
    else:
        stated = RATE.search(layout.before)
        rate_hz = float(stated[1]) if stated else options.rate_hz
        if not rate_hz:
            raise UnknownRate
        time_s, rate = _unwrap_counter(values[PACKETS], PACKET_SPAN) / rate_hz, f"{rate_hz:g}"
    version = VERSION.search(layout.before)
    understood = {
        "layout": "MT Manager",
        "version": version[1] if version else "4.x",
        "source": kind,
        "rate_hz": rate,
    }
    return build_orientation_file("other", source, time_s, up, understood)


# The CSV of Xsens (Movella) DOT with an orientation: metadata lines, then a table with ``SampleTimeFine`` in
# us.
#
# The orientation is that of the sensor to a local earth frame with z up. A DOT file with acceleration and
# angular rate is read as a recording and fused.
#
# Source: Xsens DOT User Manual, chapter on the CSV export; checked on an export of app 2021.0.

NEEDED_BY_DOT = (frozenset({PACKETS}), frozenset({FINE}))
DOT_TICK_S = 1e-6
DOT_START = re.compile(
    r"StartTime:\s*,?\s*(\d{4})-(\d\d)-(\d\d)_(\d\d):(\d\d):(\d\d)_(\d{1,3})(?:\s*GMT\s*([+-]\d{1,2}))?"
)


def recognise_dot(source: Source) -> bool:
    """Return whether it is a table with a packet counter, a fine time and an orientation."""
    layout = None if source.head.startswith(b"//") else find_layout(source, NEEDED_BY_DOT)
    return layout is not None and _find_orientation(layout) is not None


def read_dot(source: Source, _options: AngleFileOptions) -> AngleFile:
    """Read the sensor's orientation; the file does not state the arm axis."""
    layout = _get_layout(source, NEEDED_BY_DOT)
    up, kind, values = _read_up(source, layout, [FINE])
    time_s = _unwrap_counter(values[FINE], FINE_SPAN) * DOT_TICK_S
    understood = {"layout": "DOT", "source": kind}
    return build_orientation_file("dot", source, time_s, up, understood, _find_dot_start(layout.before))


def _find_dot_start(text: str) -> datetime | None:
    found = DOT_START.search(text)
    if not found:
        return None
    *clock, milliseconds, offset_h = found.groups()
    zone = timezone(timedelta(hours=int(offset_h))) if offset_h else None
    try:
        year, month, day, hour, minute, second = map(int, clock)
        return datetime(year, month, day, hour, minute, second, int(milliseconds) * 1000, zone)
    except ValueError:
        return None


# Any CSV of ``time, angle`` or ``time, quaternion``, recognised by its column names.
#
# Time is in seconds, or in the unit at the end of its name (``_ms``, ``_us``). The angle is in degrees, 0
# hanging; an empty cell is missing. A quaternion (w first) rotates the sensor's or segment's frame into one
# with z up.

TIMES = {
    **dict.fromkeys(("time_s", "time", "t", "t_s", "times", "seconds", "timestamp", "temps", "temps_s"), 1.0),
    **dict.fromkeys(("time_ms", "timems", "t_ms", "milliseconds", "timestamp_ms"), 1e-3),
    **dict.fromkeys(("time_us", "timeus", "t_us", "microseconds", "timestamp_us"), 1e-6),
}
ANGLES = ("elevation_deg", "angle_deg", "angledeg", "elevationdeg", "angle", "elevation", "theta_deg")
NEEDED_ANGLE = (frozenset(TIMES), frozenset(ANGLES))
NEEDED_TIME = (frozenset(TIMES),)
ANGLE_TOLERANCE_DEG = 0.5


def recognise_named(source: Source) -> bool:
    """Return whether a header has a time, and an angle or an orientation."""
    if find_layout(source, NEEDED_ANGLE) is not None:
        return True
    layout = find_layout(source, NEEDED_TIME)
    return layout is not None and _find_orientation(layout) is not None


def read_named(source: Source, _options: AngleFileOptions) -> AngleFile:
    """Read an angle or, if there is none, an orientation.

    Raises FusionError: unreadable rows, no usable time, an impossible angle.
    """
    layout = find_layout(source, NEEDED_ANGLE)
    if layout is not None:
        time_name, angle_name = _find_name(layout, TIMES), _find_name(layout, ANGLES)
        values = read_columns(source, layout, [time_name, angle_name])
        time_s = check_times(values[time_name] * TIMES[time_name])
        return build_angle_file(source, time_s, values[angle_name], {"layout": "CSV", "source": angle_name})
    layout = _get_layout(source, NEEDED_TIME)
    time_name = _find_name(layout, TIMES)
    up, kind, values = _read_up(source, layout, [time_name])
    time_s = check_times(values[time_name] * TIMES[time_name])
    return build_orientation_file("angles", source, time_s, up, {"layout": "CSV", "source": kind})


def _find_name(layout: Layout, names: Container[str]) -> str:
    return next(name for name in layout.names if name in names)


def build_angle_file(
    source: Source, time_s: Float64Array, elevation_deg: Float64Array, understood: Mapping[str, str]
) -> AngleFile:
    """Return the rows with an angle.

    Raises WrongAngle: more than 0.5 deg outside 0 to 180.
    """
    wrong = (elevation_deg < -ANGLE_TOLERANCE_DEG) | (elevation_deg > 180.0 + ANGLE_TOLERANCE_DEG)
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise WrongAngle(value=f"{elevation_deg[row]:g}", line=row + 2)
    present = np.isfinite(elevation_deg)
    return AngleFile(
        device="angles",
        sha256=hash_source(source),
        time_s=time_s[present],
        first_s=float(time_s[0]),
        last_s=float(time_s[-1]),
        elevation_deg=np.clip(elevation_deg[present], 0.0, 180.0).astype(np.float32),
        understood=understood,
    )


def check_times(time_s: Float64Array) -> Float64Array:
    """Return the times if they increase; raises UnusableTime otherwise."""
    if len(time_s) < 2:
        raise UnusableTime(why="rows")
    steps = np.diff(time_s)
    if not (steps > 0).all():
        raise UnusableTime(why="backwards", line=int(np.flatnonzero(~(steps > 0))[0] + 3))
    return time_s
