"""A zip with one table for the accelerometer and one for the gyroscope, as phone apps write it.

phyphox, Sensor Logger and MetaWear's app write such files. Each table is read as a table of both sensors is.
Both have the times of one clock; the acceleration is interpolated linearly at the times of the gyroscope.
"""

import re
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import PurePath
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.caveats import Caveat
from acromion.fusion.errors import FusionError, NoGravity, NoPair, NoSamples, UnknownRate, UnreadableRows
from acromion.fusion.readers.archive import open_member
from acromion.fusion.readers.samples import SampleColumns
from acromion.fusion.readers.source import Source, open_archive, read_text
from acromion.fusion.readers.tables.columns import (
    Column,
    DateOrder,
    check_units,
    find_own_axes,
    read_named_axis,
)
from acromion.fusion.readers.tables.csv_lines import IGNORED, STAMP
from acromion.fusion.readers.tables.layout import (
    COLUMNS_OF_ONE,
    DELIMITERS,
    FEWEST_HEADER_LINES,
    TextLayout,
    decode_head,
    flag_text,
    sniff_layout,
    split_fields,
)
from acromion.fusion.readers.tables.rows import (
    JUDGED_ROWS,
    TablePlan,
    TimeColumn,
    build_clock,
    build_recording,
    choose_stamp,
    find_clock,
    holds_gravity,
    read_epoch,
    read_table,
)
from acromion.fusion.readers.time.bursts import find_bursts, spread_bursts, spread_shared
from acromion.fusion.readers.time.clock import DAY_US
from acromion.fusion.readers.time.grid import LONGEST_DELAY_US, SLOWEST_HZ, cut_stamped
from acromion.fusion.recording import (
    LONGEST_BRIDGE_US,
    MICROSECONDS,
    QualityFlag,
    Recording,
    Stated,
    acc_scale_g,
    flag_counts,
    gyr_scale_dps,
)

FEWEST_ROWS = 2
SLOWER = 1.2
"""Times the period of the gyroscope: from here on the accelerometer's slower rate is worth a caveat."""
LONGEST_STEPS = 2.5
"""Times the period of a table of gravity: a longer step is a hole."""
LONGEST_SLOW_STEPS = 1.5
"""Times the period of an accelerometer whose usual step is as long as a hole of faster ones."""
COUNTS_OF_ROWS = (Caveat.ROWS_DROPPED, Caveat.NAN, Caveat.TRUNC_TAIL)
PHYPHOX_CLOCK = "meta/time.csv"


@dataclass(slots=True, eq=False)
class OneSensor:
    """One of the tables: its layout, the kind of its stamps, its unit and the caveats of its rows.

    ``time_us``: times in microseconds, (n,); ``values``: as written, (n, 3).
    """

    layout: TextLayout
    time: TimeColumn
    unit: str
    time_us: NDArray[np.int64]
    values: NDArray[np.float32]
    flags: tuple[QualityFlag, ...]

    @property
    def period_us(self) -> float:
        """The usual distance of two rows."""
        return float(np.median(np.diff(self.time_us))) if len(self.time_us) > 1 else 0.0

    @property
    def offset_s(self) -> int | None:
        """Seconds east of UTC of the clock that shows the times; None if unknown."""
        usual_us = int(np.median(self.time_us[:JUDGED_ROWS]))
        return 0 if self.time.counts_since_1970(usual_us) else self.time.offset_s

    def take(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> None:
        """Keep some of the rows, or change their order."""
        self.time_us, self.values = self.time_us[chosen], self.values[chosen]


def recognise(source: Source) -> bool:
    """Return whether the file is an archive with one table of each sensor."""
    return source.pair is not None


def read(
    source: Source,
    rate_hz: float | None = None,  # noqa: ARG001 (the times tell it)
    order: DateOrder | None = None,
) -> Recording:
    """Read both tables as one recording.

    ``order``: of day, month and year, as a person gives it.

    Raises
    ------
    NoGravity
        The acceleration lacks gravity, and no table contains it.
    NoPair
        A table lacks a named time or three named axes, or they have no time in common.
    NoSamples, UnknownRate
    acromion.fusion.errors.FusionError
        As for a table of both sensors.
    """
    archive = open_archive(source)
    names = source.pair
    assert names is not None
    acc = _read_table(source, archive, names.acceleration, "acc", order)
    gyr = _read_table(source, archive, names.angular_rate, "gyr", order)
    beside = [_read_table(source, archive, names.gravity, "gravity", order)] if names.gravity else []
    for table in (acc, *beside):
        _move_to_clock(table, gyr)
    set_back = _undo_set_backs([gyr, acc, *beside])
    is_spread = _spread_stamps([gyr, acc, *beside])
    for table in (acc, *beside):  # rows that came late
        table.take(np.argsort(table.time_us, kind="stable"))
    device = acc.layout.device or gyr.layout.device
    for gravity in beside:
        _put_back_gravity(acc, gravity, is_linear=names.kind == "linear")
    if not beside and (
        names.kind == "linear"  # Sensor Logger took gravity out of its "Accelerometer"
        or (device is not None and device.device == "sensorlogger" and names.kind != "total")
    ):
        raise NoGravity
    flags = _join_flags(acc, gyr) + set_back
    if is_spread:
        flags += (QualityFlag(Caveat.JITTER),)
    if acc.period_us > SLOWER * gyr.period_us > 0.0:
        rates = {"acc_hz": MICROSECONDS / acc.period_us, "gyr_hz": MICROSECONDS / gyr.period_us}
        facts = {name: round(rate_hz, 2) for name, rate_hz in rates.items()}
        flags += (QualityFlag(Caveat.ACC_RATE, facts=facts),)
    columns = _merge(acc, gyr)
    first_us = int(columns.stamps[0])
    clock = find_clock(gyr.layout, gyr.time, first_us)
    if clock.start is None and gyr.time.has_date:
        clock = build_clock(_read_start(archive, first_us))
    grid = cut_stamped(columns)
    return build_recording(
        grid,
        clock,
        (*flags, *gyr.time.unit.flag(), *grid.flags),
        {
            "layout": "two tables in a zip",
            "columns": f"{names.acceleration}, {names.angular_rate}",
            "acceleration_unit": acc.unit,
            "angular_rate_unit": gyr.unit,
            "time": gyr.time.describe(first_us),
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(columns.rows),
        },
        stated=Stated(acc.unit, gyr.unit),
        jitter_us=float(grid.jitter_us),
        device=device.device if device else "other",
    )


def _read_table(
    source: Source,
    archive: zipfile.ZipFile,
    name: str,
    channel: Literal["acc", "gyr", "gravity"],
    order: DateOrder | None,
) -> OneSensor:
    """Read a table of one sensor, its stamps repaired, in the units of the file."""
    member = open_member(archive, name, source)
    found = sniff_layout(member, order, fewest=COLUMNS_OF_ONE)
    axes = find_own_axes([one.name for one in found.columns]) if found else None
    if found is None or axes is None:
        lines = decode_head(member).split("\n")
        raise _explain_refusal(PurePath(name).name, lines, has_rows=found is not None)
    layout = _name_axes(found, axes, channel)
    place, time = choose_stamp(layout)
    if place is None or not time.has_times:
        if any(one.channel == "time" for one in layout.columns):
            raise UnknownRate
        raise NoPair(why="unnamed", list=f"{PurePath(name).name}: {layout.header}"[:200])
    targets = [IGNORED] * layout.n_columns
    targets[place] = STAMP
    for axis in range(3):
        targets[axes[axis]] = 1 + axis
    rows = read_table(member, TablePlan(layout, tuple(targets), time))
    columns = rows.columns
    if columns.rows < FEWEST_ROWS:
        raise NoSamples
    columns.gyr[:] = columns.acc
    time.unit.refuse_doubtful(columns)
    flags = (*rows.flags, *time.repair(columns, rows.changes), *flag_text(member, layout))
    unit = layout.columns[axes[0]].unit or ""
    return OneSensor(layout, time, unit, columns.stamps, columns.acc, flags)


def _explain_refusal(name: str, lines: Sequence[str], *, has_rows: bool) -> FusionError:
    """Return the error for a table whose axes are not named, or that has no readable row."""
    for k, line in enumerate(lines[:FEWEST_HEADER_LINES]):
        if not has_rows and any(find_own_axes(split_fields(line, mark)) for mark in DELIMITERS):
            rows = sum(bool(row.strip()) for row in lines[k + 1 :])
            return UnreadableRows(k=rows, line=k + 2) if rows >= FEWEST_ROWS else NoSamples()
    first = "".join(sign for sign in lines[0] if sign.isprintable())
    return NoPair(why="unnamed", list=f"{name}: {first}"[:200])


def _name_axes(
    layout: TextLayout, axes: tuple[int, int, int], channel: Literal["acc", "gyr", "gravity"]
) -> TextLayout:
    """Return the layout with its axes as columns of the sensor, and with their unit."""
    device, columns = layout.device, list(layout.columns)
    known = (device.gyr_unit if channel == "gyr" else device.acc_unit) if device else None
    stated = [(read_named_axis(columns[k].name) or ("", None))[1] or columns[k].unit for k in axes]
    check_units("gyroscope" if channel == "gyr" else "accelerometer", stated)
    for axis, place in enumerate(axes):
        columns[place] = Column(columns[place].name, channel, axis, stated[axis] or known or None)
    return replace(layout, columns=tuple(columns))


def _undo_set_backs(tables: Sequence[OneSensor]) -> tuple[QualityFlag, ...]:
    """Move the rows after a clock was set back behind those before it (W-CLOCK-BACK).

    Raises NoPair if the clock was not set back in all tables, at the same time.
    """
    backs = [np.flatnonzero(np.diff(table.time_us) < -LONGEST_DELAY_US) + 1 for table in tables]
    if len({len(rows) for rows in backs}) > 1:
        raise NoPair(why="set back")
    for rows in zip(*backs, strict=True):
        places = list(zip(tables, rows, strict=True))
        before_us, after_us = ([int(table.time_us[row + step]) for table, row in places] for step in (-1, 0))
        if max(map(np.ptp, (before_us, after_us))) > LONGEST_DELAY_US:
            raise NoPair(why="set back")
        for table, row in places:
            table.time_us[row:] += max(before_us) - min(after_us) + round(tables[0].period_us)
    return flag_counts({Caveat.CLOCK_BACK: len(backs[0])})


def _spread_stamps(tables: Sequence[OneSensor]) -> bool:
    """Spread rows that arrived together over time; return whether a table had bursts.

    A clock that is too coarse for the rows is coarse in each of the tables.
    """
    found = [find_bursts(table.time_us) for table in tables]
    steps = {one.step_us if one and one.is_floor else 0.0 for one in found}
    for table, bursts in zip(tables, found, strict=True):
        if bursts is None:
            spread_shared(table.time_us)
        else:
            spread_bursts(table.time_us, may_be_coarse=len(steps) == 1)
    return any(found)


def _move_to_clock(table: OneSensor, gyr: OneSensor) -> None:
    """Count a table's times as the gyroscope's, from its offset from UTC and its day.

    Raises NoPair if only one of them has an offset.
    """
    own_s, other_s = table.offset_s, gyr.offset_s
    if (own_s is None) != (other_s is None):
        raise NoPair(why="no common time")
    if own_s is not None and other_s is not None:
        table.time_us += (other_s - own_s) * MICROSECONDS
    if not (table.time.has_date and gyr.time.has_date):
        table.time_us += round(int(gyr.time_us[0] - table.time_us[0]) / DAY_US) * DAY_US


def _put_back_gravity(acc: OneSensor, gravity: OneSensor, *, is_linear: bool) -> None:
    """Add gravity, on the times of the acceleration, unless the acceleration includes it."""
    scale = (acc_scale_g(gravity.unit) or 1.0) / (acc_scale_g(acc.unit) or 1.0)
    parts = np.stack([np.interp(acc.time_us, gravity.time_us, part) for part in gravity.values.T], axis=1)
    parts *= scale if gravity.unit and acc.unit else 1.0
    if not is_linear and holds_gravity(acc.values, parts):
        return
    acc.values = (acc.values + parts).astype(np.float32)
    acc.take(_find_covered(acc.time_us, gravity, max(LONGEST_BRIDGE_US, LONGEST_STEPS * gravity.period_us)))
    if len(acc.values) < FEWEST_ROWS:
        raise NoPair(why="no common time")


def _join_flags(acc: OneSensor, gyr: OneSensor) -> tuple[QualityFlag, ...]:
    """Return the caveats of both tables, each once unless it counts rows."""
    own = {flag.code for flag in gyr.flags}
    return (*gyr.flags, *(flag for flag in acc.flags if flag.code in COUNTS_OF_ROWS or flag.code not in own))


def _find_covered(time_us: NDArray[np.int64], table: OneSensor, longest_us: float) -> NDArray[np.bool_]:
    """Return for each time whether the step of the table around it is ``longest_us`` or shorter."""
    after = np.searchsorted(table.time_us, time_us)
    later_us = table.time_us[np.minimum(after, len(table.time_us) - 1)]
    earlier_us = table.time_us[np.maximum(after - 1, 0)]
    step_us = np.maximum(later_us, time_us) - np.minimum(earlier_us, time_us)
    return np.asarray((later_us == time_us) | (step_us <= longest_us))


def _merge(acc: OneSensor, gyr: OneSensor) -> SampleColumns:
    """Interpolate the acceleration at the gyroscope's times; no row in its holes and after its end."""
    if acc.period_us * SLOWEST_HZ > MICROSECONDS:
        raise UnknownRate(m=round(MICROSECONDS / acc.period_us, 4))
    is_within = (gyr.time_us >= acc.time_us[0]) & (gyr.time_us <= acc.time_us[-1])
    longest_us = max(LONGEST_BRIDGE_US, LONGEST_SLOW_STEPS * acc.period_us)
    kept = is_within & _find_covered(gyr.time_us, acc, longest_us)
    if np.count_nonzero(kept) < FEWEST_ROWS:
        raise NoPair(why="no common time")
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
