"""A zip with one table for the accelerometer and one for the gyroscope, as phone apps write it.

phyphox, Sensor Logger and MetaWear's app write such files. Both tables have the times of one clock; the
acceleration is interpolated linearly at the times of the gyroscope.
"""

import math
import re
import warnings
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import PurePath
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.devices import KnownDevice, find_known_device
from fusion.errors import (
    NoGravity,
    NoSamples,
    UnknownColumns,
    UnknownRate,
    UnreadableRows,
    UnsafeArchive,
    UnusableTime,
)
from fusion.readers.samples import SampleColumns
from fusion.readers.source import Source, open_archive, read_member, read_text
from fusion.readers.tables.columns import check_units, find_time_unit, parse_column_name, read_named_axis
from fusion.readers.tables.layout import CALENDAR, NUMBER, split_fields
from fusion.readers.tables.rows import (
    JUDGED_ROWS,
    MAX_BAD_PART,
    TimeColumn,
    build_clock,
    build_recording,
    holds_gravity,
    read_epoch,
)
from fusion.readers.time.bursts import find_bursts, spread_bursts
from fusion.readers.time.clock import datetime_at_us
from fusion.readers.time.grid import cut_stamped
from fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    Float64Array,
    QualityFlag,
    Recording,
    Stated,
    acc_scale_g,
    flag_counts,
    gyr_scale_dps,
)

MOST_BYTES = 1 << 29
"""Of one table: eight hours at 100 Hz take 250 MB."""
FEWEST_ROWS = 2
SLOWER = 1.2
"""Times the period of the gyroscope: from here on the accelerometer's slower rate is worth a caveat."""
LONGEST_STEPS = 2.5
"""Times the period of a table of gravity: a longer step is a hole."""
LATEST_US, LARGEST = 9e18, 1e30
PHYPHOX_CLOCK = "meta/time.csv"
MICROSECOND_STAMPS = TimeColumn("number")


@dataclass(frozen=True, slots=True, eq=False)
class ThreeAxes:
    """One of the tables: times in microseconds, (n,), values as written, (n, 3), and their unit.

    ``dropped``: rows that could not be read, or whose time does not advance. ``started``: the first row's
    time of a calendar, if another column holds the time. ``is_spread``: its rows came in bursts.
    """

    time_us: NDArray[np.int64]
    values: Float64Array
    unit: str
    device: KnownDevice | None
    dropped: int = 0
    started: datetime | None = None
    is_spread: bool = False

    @property
    def period_us(self) -> float:
        """The usual distance of two rows."""
        return float(np.median(np.diff(self.time_us))) if len(self.time_us) > 1 else 0.0


def recognise(source: Source) -> bool:
    """Return whether the file is an archive with one table of each sensor."""
    return source.pair is not None


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the times tell it)
    """Read both tables as one recording.

    Raises
    ------
    NoGravity
        The acceleration lacks gravity, and no table contains it.
    UnknownColumns
        A table lacks a named time or three named axes.
    NoSamples, UnreadableRows, UnusableTime, fusion.errors.UnknownRate
    """
    archive = open_archive(source)
    names = source.pair
    assert names is not None
    acc, gyr = _read_table(archive, names.acceleration), _read_table(archive, names.angular_rate, "gyr")
    device = acc.device or gyr.device
    if names.gravity:  # put back, on the times of the acceleration
        gravity = _read_table(archive, names.gravity)
        parts = [np.interp(acc.time_us, gravity.time_us, part) for part in gravity.values.T]
        if names.kind == "linear" or not holds_gravity(acc.values, np.stack(parts, axis=1)):
            longest_us = max(LONGEST_BRIDGE_US, LONGEST_STEPS * gravity.period_us)
            kept = _find_covered(acc.time_us, gravity, longest_us)
            values = (acc.values + np.stack(parts, axis=1))[kept]
            acc = replace(acc, time_us=acc.time_us[kept], values=values)
            if len(values) < FEWEST_ROWS:
                raise UnusableTime(why="rows")
    elif names.kind == "linear" or (  # Sensor Logger took gravity out of its "Accelerometer"
        device is not None and device.device == "sensorlogger" and names.kind != "total"
    ):
        raise NoGravity
    columns = _merge(acc, gyr)
    flags = flag_counts(
        {Caveat.ROWS_DROPPED: acc.dropped + gyr.dropped, Caveat.JITTER: int(acc.is_spread or gyr.is_spread)}
    )
    flags += MICROSECOND_STAMPS.repair(columns)
    if acc.period_us > SLOWER * gyr.period_us > 0.0:
        rates = {"acc_hz": MICROSECONDS / acc.period_us, "gyr_hz": MICROSECONDS / gyr.period_us}
        facts = {name: round(rate_hz, 2) for name, rate_hz in rates.items()}
        flags += (QualityFlag(Caveat.ACC_RATE, facts=facts),)
    first_us = int(columns.stamps[0])
    grid = cut_stamped(columns)
    return build_recording(
        grid,
        build_clock(read_epoch(first_us) or _read_start(archive, first_us) or gyr.started),
        (*flags, *grid.flags),
        {
            "layout": "two tables in a zip",
            "columns": f"{names.acceleration}, {names.angular_rate}",
            "acceleration_unit": acc.unit,
            "angular_rate_unit": gyr.unit,
            "time": MICROSECOND_STAMPS.describe(first_us),
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(columns.rows),
        },
        stated=Stated(acc.unit, gyr.unit),
        jitter_us=float(grid.jitter_us),
        device=device.device if device else "other",
    )


def _read_table(archive: zipfile.ZipFile, name: str, channel: Literal["acc", "gyr"] = "acc") -> ThreeAxes:
    lines = _read_lines(archive, name)
    header, first = (next(lines, "").strip("\ufeff\r\n") for _ in range(2))
    delimiter = max(",;\t", key=header.count)
    names, values = split_fields(header, delimiter), split_fields(first, delimiter)
    device = find_known_device(header)
    times = [k for k, field in enumerate(names) if parse_column_name(field).channel == "time"]
    axes = [read_named_axis(field) for field in names]
    places = [k for axis in "xyz" for k, found in enumerate(axes) if found and found[0] == axis]
    if not times or len(places) != len("xyz"):
        raise UnknownColumns(list=f"{PurePath(name).name}: {header}"[:200])
    calendar = next((k for k in times if k < len(values) and CALENDAR.fullmatch(values[k])), None)
    place = next((k for k in times if k < len(values) and NUMBER.fullmatch(values[k])), times[0])
    is_calendar = place == calendar
    table = _load(archive, name, delimiter, [place, *places], _read_moment_us if is_calendar else float)
    units = [axis[1] for place in places if (axis := axes[place])]
    check_units("gyroscope" if channel == "gyr" else "accelerometer", units)
    unit = units[0]
    if unit is None and device is not None:
        unit = device.gyr_unit if channel == "gyr" else device.acc_unit
    stamp, time_unit = table[:, 0], "us" if is_calendar else parse_column_name(names[place]).unit
    found = find_time_unit(stamp[:JUDGED_ROWS].tolist(), time_unit)
    if found is None:
        raise UnknownRate
    micros = np.clip(np.nan_to_num(stamp) * 10.0**found.exponent, -LATEST_US, LATEST_US)
    stamps = np.rint(micros).astype(np.int64)
    is_spread = find_bursts(stamps) is not None
    time_us, values_read = _spread_bursts(stamps, table[:, 1:]) if is_spread else (stamps, table[:, 1:])
    is_later = np.concatenate([[True], time_us[1:] > np.maximum.accumulate(time_us)[:-1]])
    kept = is_later & np.isfinite(values_read).all(axis=1)
    started = None
    if calendar is not None:
        with suppress(ValueError):  # a damaged row may have no such hour
            started = datetime_at_us(round(_read_moment_us(values[calendar])))
    dropped = len(table) - int(np.count_nonzero(kept))
    return ThreeAxes(time_us[kept], values_read[kept], unit or "", device, dropped, started, is_spread)


def _read_moment_us(text: str) -> float:
    """Parse a date and time as microseconds since 1970, without a time zone."""
    moment = datetime.fromisoformat(text.strip(' "').replace(",", ".")).replace(tzinfo=UTC)
    return moment.timestamp() * MICROSECONDS


def _spread_bursts(
    time_us: NDArray[np.int64], values: Float64Array
) -> tuple[NDArray[np.int64], Float64Array]:
    """Spread rows that arrived together, with one stamp, over time, as in a single table."""
    kept = np.isfinite(values).all(axis=1)
    if np.count_nonzero(kept) < FEWEST_ROWS:
        return time_us, values
    columns = SampleColumns()
    columns.extend(int(np.count_nonzero(kept)))
    columns.trim()
    columns.stamps[:], columns.acc[:], columns.gyr[:] = time_us[kept], values[kept], 0.0
    MICROSECOND_STAMPS.repair(columns)
    spread_bursts(columns.stamps)
    return columns.stamps, columns.acc.astype(np.float64)


def _read_lines(archive: zipfile.ZipFile, name: str) -> Iterator[str]:
    """Unpack and count the lines of a table."""
    if archive.getinfo(name).file_size > MOST_BYTES:
        raise UnsafeArchive(reason="size", limit=MOST_BYTES)
    carried = b""
    for piece in read_member(archive, name, MOST_BYTES):
        *lines, carried = (carried + piece).split(b"\n")
        yield from (line.decode("utf-8", "replace") for line in lines)
    if carried:
        yield carried.decode("utf-8", "replace")


def _load(
    archive: zipfile.ZipFile,
    name: str,
    delimiter: str,
    places: Sequence[int],
    read_time: Callable[[str], float],
) -> Float64Array:
    """Read the columns at ``places``; the first is the time.

    Unreadable lines become rows of NaN. Raises UnreadableRows if they are more than 5 %.
    """

    def read_points() -> Iterator[str]:
        lines = _read_lines(archive, name)
        next(lines, "")
        return lines if delimiter == "," else (line.replace(",", ".") for line in lines)

    converters: dict[int | str, Callable[[str], float]] | None
    converters = None if read_time is float else {places[0]: read_time}
    try:
        with warnings.catch_warnings(action="ignore", category=UserWarning):  # a table without rows
            table = np.loadtxt(
                read_points(),
                delimiter=delimiter,
                usecols=places,
                ndmin=2,
                quotechar='"',
                comments=None,
                converters=converters,
                encoding=None,
            )
    except (ValueError, IndexError):  # a torn last line, say: each line by itself
        lines = ((split_fields(line, delimiter), read_time) for line in read_points())
        table = np.array([_read_row(*line, places) for line in lines]).reshape(-1, 4)
        bad = np.flatnonzero(np.isnan(table).any(axis=1))
        if len(bad) > MAX_BAD_PART * len(table) and len(bad) > 1:
            raise UnreadableRows(k=len(bad), line=int(bad[0]) + 2) from None
    if len(table) < FEWEST_ROWS:
        raise NoSamples
    values = np.asarray(table, np.float64)
    values[np.abs(values) > LARGEST] = math.nan
    return values


def _read_row(fields: Sequence[str], read_time: Callable[[str], float], places: Sequence[int]) -> list[float]:
    try:
        return [read_time(fields[places[0]]), *(float(fields[place]) for place in places[1:])]
    except (ValueError, IndexError):
        return [math.nan] * len(places)


def _find_covered(time_us: NDArray[np.int64], table: ThreeAxes, longest_us: float) -> NDArray[np.bool_]:
    """Return for each time whether the step of the table around it is ``longest_us`` or shorter."""
    after = np.searchsorted(table.time_us, time_us)
    later_us = table.time_us[np.minimum(after, len(table.time_us) - 1)]
    earlier_us = table.time_us[np.maximum(after - 1, 0)]
    step_us = np.maximum(later_us, time_us) - np.minimum(earlier_us, time_us)
    return np.asarray((later_us == time_us) | (step_us <= longest_us))


def _merge(acc: ThreeAxes, gyr: ThreeAxes) -> SampleColumns:
    """Interpolate the acceleration at the gyroscope's times; no row in its holes and after its end."""
    is_within = (gyr.time_us >= acc.time_us[0]) & (gyr.time_us <= acc.time_us[-1])
    kept = is_within & _find_covered(gyr.time_us, acc, LONGEST_BRIDGE_US)
    if np.count_nonzero(kept) < FEWEST_ROWS:
        raise UnusableTime(why="rows")
    time_us = gyr.time_us[kept]
    columns = SampleColumns()
    columns.extend(len(time_us))
    columns.trim()
    columns.stamps[:] = time_us
    for axis in range(3):
        columns.acc[:, axis] = np.interp(time_us, acc.time_us, acc.values[:, axis])
    columns.gyr[:] = gyr.values[kept] * (gyr_scale_dps(gyr.unit) or 1.0)
    columns.acc[...] *= acc_scale_g(acc.unit) or 1.0
    return columns


def _read_start(archive: zipfile.ZipFile, first_us: int) -> datetime | None:
    """Read when phyphox was started, in its own table of events; None if there is none."""
    with suppress(KeyError, ValueError, IndexError):
        _, started = read_text(archive, PHYPHOX_CLOCK).decode("utf-8", "replace").splitlines()[:2]
        experiment_s, system_s = (float(field.strip('"')) for field in re.split(r"[,;\t]", started)[1:3])
        return read_epoch(round((system_s - experiment_s) * MICROSECONDS) + first_us)
    return None
