"""CSV of loggers built on the ST LSM9DS1, and of look-alikes whose header names the columns.

A header is needed. Units and time come from it where it states them, and from the samples where it does not
(:mod:`fusion.checks.physics`). A preamble of `# key: value` lines may state device, start and ranges.
"""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from fusion.caveats import Caveat
from fusion.conventions import ArmAxis, PoseHeld, parse_arm_axis
from fusion.devices import find_device_name
from fusion.diary import parse_pose_held
from fusion.errors import NoSamples, UnknownColumns, UnknownRate
from fusion.readers.samples import PAUSE
from fusion.readers.source import Source
from fusion.readers.tables.careful_path import CALENDAR_TIME, COUNTER, NUMERIC_TIME, STAMP
from fusion.readers.tables.dates import DateOrder
from fusion.readers.tables.gravity import put_back_gravity
from fusion.readers.tables.layout import TextLayout, flag_text, read_layout, sniff_layout
from fusion.readers.tables.profile import ColumnProfile, apply_profile
from fusion.readers.tables.rows import (
    PACKET_NUMBERS,
    TablePlan,
    TableRows,
    counts_since_1970,
    find_clock,
    plan_gravity,
    plan_table,
    read_table,
    repair_stamps,
)
from fusion.readers.timebase.clock import flag_drift, hash_serial
from fusion.readers.timebase.grid import FASTEST_HZ, SLOWEST_HZ, Grid, cut_counted, cut_stamped
from fusion.readers.timebase.row_times import leave_out_repeats
from fusion.recording import MICROSECONDS, QualityFlag, Recording
from fusion.units import LEFT_GYR_FACTOR, name_unit_source

T = TypeVar("T")

ARDUINO_BURST_ROWS = 119
ARDUINO_RATE_HZ = 119.0
STATED_RATE = re.compile(
    r"\b(?:rate_hz|odr_hz|odr|(?:sampl\w+|data|update|output)[ _]?(?:rate|freq\w*)(?:_hz)?|rate)"
    r"\W{1,4}(\d+(?:\.\d+)?)",
    re.IGNORECASE,
)
"""Stated above a table: `# rate_hz: 476`, `// Update Rate: 100.0Hz`, `data_rate = 2000.0 Hz`."""
CANONICAL_HEADER = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"


def recognise(source: Source) -> bool:
    """Whether the head is text with a header that names columns."""
    layout = sniff_layout(source)
    return layout is not None and layout.header is not None


def read(source: Source, rate_hz: float | None = None) -> Recording:
    """Read a table with a header.

    Raises
    ------
    fusion.errors.UnreadableFile
        Columns are missing or not understood, or the table is damaged.
    UnknownRate
        The layout holds no time and no rate is given.
    fusion.errors.UnusableTime
        The stamps are not those of an even sampling.
    """
    return _read_planned(source, plan_table(_read_layout(source)), rate_hz)


def read_profiled(source: Source, profile: ColumnProfile, rate_hz: float | None = None) -> Recording:
    """Read a table whose columns a person has named; ``rate_hz`` goes before the profile's.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`read`.
    """
    plan = plan_table(apply_profile(_read_layout(source, profile.date_order), profile))
    plan = replace(
        plan,
        acc_scale=profile.acceleration_factor or plan.acc_scale,
        gyr_scale=profile.angular_rate_factor or plan.gyr_scale,
    )
    return _read_planned(source, plan, rate_hz or profile.rate_hz)


def _read_layout(source: Source, order: DateOrder | None = None) -> TextLayout:
    layout = read_layout(source, order)
    if layout is None:
        raise UnknownColumns(why="no header")
    return layout


def _read_planned(source: Source, plan: TablePlan, rate_hz: float | None) -> Recording:
    """From a plan to a recording: rows, their times, the segments, the caveats."""
    layout = plan.layout
    rows = read_table(source, plan)
    if rows.columns.rows == 0:
        raise NoSamples
    is_added = _add_gravity(source, rows)
    plan.unit.refuse_doubtful(rows.columns)
    repairs = repair_stamps(rows) if plan.has_times else ()
    first_stamp_us = int(rows.columns.stamps[0])
    grid = _cut_rows(rows, choose_rate_hz(layout, rate_hz))
    facts = layout.facts()
    clock, pose = find_clock(plan, first_stamp_us), _read_pose(facts)
    return Recording(
        device=layout.device.device if layout.device else _name_stated(facts.get("device", "")),
        sha256="",
        start=clock.start,
        time_zone=clock.time_zone,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(
            *rows.flags,
            *repairs,
            *grid.flags,
            *flag_text(source, layout),
            *pose.flags,
            *_flag_stated_rate(layout, grid),
            *plan.unit.flag(),
            *_flag_given_rate(plan, grid, rate_hz),
            *clock.flags,
        ),
        understood={
            **_describe_columns(plan, is_in_g=is_added),
            "time": _describe_time(plan, first_stamp_us),
            "time_exponent": str(plan.stamp_exponent),
            "delimiter": _format_delimiter(layout),
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(rows.columns.rows),
        },
        serial_hash=hash_serial(facts.get("serial", "") or facts.get("serial_number", "")),
        acc_range_g=_positive(facts.get("acc_range_g")),
        gyr_range_dps=_positive(facts.get("gyr_range_dps")),
        pose_windows_s=pose.windows_s,
        arm_axis=pose.axis,
        pose_held=pose.held,
    )


def _add_gravity(source: Source, rows: TableRows) -> bool:
    """Read the table again for the gravity that its acceleration may lack, and add it; whether it was."""
    plan = plan_gravity(rows.plan)
    if plan is None:
        return False
    acc, gyr = rows.plan.acceleration, rows.plan.angular_rate
    return put_back_gravity(rows.columns, read_table(source, plan).columns, plan.acc_scale, acc, gyr)


def _cut_rows(rows: TableRows, rate_hz: float | None) -> Grid:
    if rows.plan.has_times:
        return cut_stamped(rows.columns)
    if rows.plan.counts_packets:
        return _cut_packets(rows, rate_hz)
    return cut_counted(rows.columns, rate_hz or find_burst_rate_hz(rows))


def _cut_packets(rows: TableRows, rate_hz: float | None) -> Grid:
    """Cut rows that a packet counter numbers: packets that were lost are missing time."""
    if not rate_hz or not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise UnknownRate(**({"m": rate_hz} if rate_hz else {}))
    period_us = MICROSECONDS / rate_hz
    stamps = rows.columns.stamps
    stamps[1:] += PACKET_NUMBERS * np.cumsum(np.diff(stamps) < -PACKET_NUMBERS // 2)
    stamps[:] = np.rint((stamps - stamps[0]) * period_us)
    repeats = leave_out_repeats(rows.columns)
    grid = cut_stamped(rows.columns)
    return replace(grid, flags=(*repeats, *grid.flags))


def choose_rate_hz(layout: TextLayout, rate_hz: float | None) -> float | None:
    """Give the rate that the preamble states, if plausible; else the one that a person gives, in Hz."""
    stated_hz = find_stated_hz(layout)
    return stated_hz if SLOWEST_HZ <= stated_hz <= FASTEST_HZ else rate_hz


def find_burst_rate_hz(rows: TableRows) -> float:
    """Find the rate of a layout without time by its form, in Hz.

    Arduino's example sketch for the Nano 33 BLE Sense writes bursts of 119 rows, one second of the library's
    fixed 119 Hz, and a blank line after each.

    Raises
    ------
    UnknownRate
        The form does not tell: a person has to give the rate.
    """
    numbers = rows.columns.stamps
    ends = np.flatnonzero(np.diff(numbers // PAUSE)) + 1
    bursts = np.diff(np.concatenate([[0], ends]))
    if len(bursts) >= 2 and np.all(bursts == ARDUINO_BURST_ROWS):
        return ARDUINO_RATE_HZ
    raise UnknownRate


def _flag_given_rate(plan: TablePlan, grid: Grid, rate_hz: float | None) -> tuple[QualityFlag, ...]:
    """Flag a rate that rests on no times, with its source: preamble, person or layout (W-RATE)."""
    if plan.has_times:
        return ()
    without_header = "told" if rate_hz else "layout"
    source = "header" if choose_rate_hz(plan.layout, None) else without_header
    used_hz = round(MICROSECONDS / grid.period_us, 3)
    return (QualityFlag(Caveat.RATE, facts={"rate_hz": used_hz, "rate_from": source}),)


def _flag_stated_rate(layout: TextLayout, grid: Grid) -> tuple[QualityFlag, ...]:
    """Flag a true rate that is off the one that the preamble states (W-DRIFT)."""
    stated_hz = find_stated_hz(layout)
    return flag_drift(stated_hz, MICROSECONDS / grid.period_us) if stated_hz > 0.0 else ()


def find_stated_hz(layout: TextLayout) -> float:
    """Read the rate that the preamble states; 0 where it states none."""
    found = (STATED_RATE.search(line) for line in layout.preamble)
    return next((float(match.group(1)) for match in found if match), 0.0)


def _positive(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if 0 < value < 1e6 else None


def _name_stated(device: str) -> str:
    """Give the device that the preamble calls by our own name for it, else "other"."""
    return device if find_device_name(device) else "other"


@dataclass(frozen=True, slots=True)
class _StatedPose:
    """What the preamble states of the pose, and the lines of it that cannot be read (W-HEADER)."""

    windows_s: tuple[tuple[float, float], ...] = ()
    axis: ArmAxis | None = None
    held: PoseHeld | None = None
    flags: tuple[QualityFlag, ...] = ()


def _read_pose(facts: Mapping[str, str]) -> _StatedPose:
    unread: list[str] = []

    def read(name: str, parse: Callable[[str], T]) -> T | None:
        try:
            return parse(facts[name]) if name in facts else None
        except ValueError:
            unread.append(f"{name}: {facts[name][:60]}")
            return None

    windows_s = read("pose_window_s", _read_pose_window) or ()
    axis, held = read("arm_axis", parse_arm_axis), read("pose_held", parse_pose_held)
    flag = QualityFlag(Caveat.HEADER, len(unread), facts={"text": "; ".join(unread)})
    return _StatedPose(windows_s, axis, held, (flag,) if unread else ())


def _read_pose_window(text: str) -> tuple[tuple[float, float], ...]:
    """Read when the pose was held, ``START,END`` in seconds."""
    start_s, end_s = (float(part) for part in text.split(","))
    if not 0.0 <= start_s < end_s < math.inf:
        raise ValueError("START,END; 0 <= START < END")
    return ((start_s, end_s),)


def _describe_columns(plan: TablePlan, *, is_in_g: bool) -> dict[str, str]:
    columns, device = plan.layout.columns, plan.layout.device
    acc_unit, gyr_unit = "g" if is_in_g else plan.acceleration.unit, plan.angular_rate.unit
    ignored = (
        column.name
        for column, target in zip(columns, plan.targets, strict=True)
        if target <= STAMP and column.channel == "other"
    )
    return {
        "layout": "table with header",
        "columns": ", ".join(column.name for column in columns)[:400],
        "ignored": ", ".join(ignored)[:400],
        "acceleration_unit": acc_unit or "",
        "angular_rate_unit": gyr_unit or "",
        "units_from": name_unit_source(acc_unit, gyr_unit, is_known=bool(device and device.frame == "right")),
        **(
            {LEFT_GYR_FACTOR: f"{device.left_gyr_factor:.5f}"}
            if device and device.left_gyr_factor != 1.0
            else {}
        ),
    }


def _describe_time(plan: TablePlan, first_stamp_us: int) -> str:
    """What the stamps are, in a word or two."""
    if plan.counts_packets:
        return "packet counter"
    if counts_since_1970(plan, first_stamp_us):
        return "number since 1970"
    if plan.unit.is_days:
        return "calendar"
    if plan.layout.dates is not None and not plan.layout.dates.has_date:
        return "time of day"
    return {COUNTER: "row number", NUMERIC_TIME: "number", CALENDAR_TIME: "calendar"}[plan.stamp_kind]


def _format_delimiter(layout: TextLayout) -> str:
    sign = " " if layout.is_single_spaced else layout.delimiter
    return {"\t": "tab", " ": "space"}.get(sign, sign)
