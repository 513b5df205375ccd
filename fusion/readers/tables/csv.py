"""Tables of loggers built on the ST LSM9DS1, and of look-alikes: named columns, and dumps of registers."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC
from typing import Any, TypeVar

import numpy as np

from acromion.fusion.caveats import Caveat
from acromion.fusion.conventions import parse_arm_axis
from acromion.fusion.devices import find_device_name
from acromion.fusion.diary import parse_pose_held
from acromion.fusion.errors import NoSamples, UnknownColumns, UnknownRate, UnusableTime
from acromion.fusion.readers.samples import PAUSE, SampleColumns, drop_blank_rows
from acromion.fusion.readers.source import Source, read_chunks
from acromion.fusion.readers.tables.columns import DateOrder, TimeUnit
from acromion.fusion.readers.tables.csv_lines import IGNORED, STAMP
from acromion.fusion.readers.tables.layout import (
    ClockWriter,
    Place,
    TextLayout,
    flag_text,
    read_layout,
    sniff_layout,
)
from acromion.fusion.readers.tables.profile import ColumnProfile, apply_profile
from acromion.fusion.readers.tables.rows import (
    PACKET_NUMBERS,
    TableClock,
    TablePlan,
    TimeColumn,
    add_gravity,
    build_recording,
    find_clock,
    find_clock_place,
    find_unnamed_time,
    plan_table,
    read_table,
)
from acromion.fusion.readers.time.clock import datetime_at_us, flag_drift, hash_serial, trust_clock
from acromion.fusion.readers.time.grid import (
    FASTEST_HZ,
    SLOWEST_HZ,
    Grid,
    cut_counted,
    cut_stamped,
    leave_out_repeats,
)
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Recording, Stated, name_unit_source

# A header that names the columns.
#
# Units and time come from it if it states them, and from the samples if it does not
# (:mod:`acromion.fusion.checks.physics`). A preamble of `# key: value` lines may state device, start and
# ranges.

T = TypeVar("T")

ARDUINO_BURST_ROWS, ARDUINO_RATE_HZ = 119, 119.0
"""Arduino's example sketch for the Nano 33 BLE Sense writes bursts of one second of the library's fixed rate,
and a blank line after each."""
STATED_RATE = re.compile(
    r"\b(?:rate_hz|odr_hz|odr|(?:sampl\w{1,30}|data|update|output)[ _]?(?:rate|freq\w{0,30})(?:_hz)?|rate)"
    r"\W{1,4}(\d+(?:\.\d+)?)",
    re.IGNORECASE,
)
"""Stated above a table: `# rate_hz: 476`, `// Update Rate: 100.0Hz`, `data_rate = 2000.0 Hz`."""
CANONICAL_HEADER = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"


def recognise(source: Source) -> bool:
    """Whether the head is text with a header that names columns."""
    layout = sniff_layout(source)
    return layout is not None and bool(layout.header or layout.misfit_header)


def read(source: Source, rate_hz: float | None = None) -> Recording:
    """Read a table with a header.

    Raises
    ------
    acromion.fusion.errors.UnreadableFile
        Columns are missing or not understood, or the table is damaged.
    UnknownRate
        The layout has no time and no rate is given.
    acromion.fusion.errors.UnusableTime
        The stamps do not come from even sampling.
    """
    return _read_planned(source, plan_table(_read_layout(source), is_thigh=source.is_thigh), rate_hz)


def read_profiled(source: Source, profile: ColumnProfile, rate_hz: float | None = None) -> Recording:
    """Read a table whose columns a person has named; ``rate_hz`` overrides the profile's rate.

    Raises FusionError: as :func:`read`.
    """
    layout = _read_layout(source, profile.date_order, stated_time=profile.stated_time)
    plan = plan_table(apply_profile(layout, profile))
    if layout.doubt is not None and profile.time is not None and not plan.time.has_times:
        raise layout.doubt
    plan = replace(
        plan,
        acc_scale=profile.acceleration_factor or plan.acc_scale,
        gyr_scale=profile.angular_rate_factor or plan.gyr_scale,
    )
    return _read_planned(source, plan, rate_hz or profile.rate_hz)


def _read_layout(
    source: Source, order: DateOrder | None = None, *, stated_time: Place | None = None
) -> TextLayout:
    layout = read_layout(source, order, stated_time=stated_time)
    if layout is None:
        raise UnknownColumns(why="no header")
    return layout


def _read_planned(source: Source, plan: TablePlan, rate_hz: float | None) -> Recording:
    """Turn a plan into a recording: rows, their times, segments, caveats."""
    layout, time = plan.layout, plan.time
    rows = read_table(source, plan)
    columns = rows.columns
    if columns.rows == 0:
        raise NoSamples
    if 4 not in plan.targets:
        columns.gyr[:] = 0.0
    is_added = add_gravity(source, plan, columns)
    time.unit.refuse_doubtful(columns)
    repairs = time.repair(columns, rows.changes) if time.has_times else ()
    first_us = int(columns.stamps[0])
    grid = _cut_rows(plan, columns, choose_rate_hz(layout, rate_hz))
    stated, facts = _read_stated(plan, is_in_g=is_added), layout.facts()
    pose, unread = _read_pose(facts)
    device = facts.get("device", "")
    separator = " " if layout.is_single_spaced else layout.delimiter
    return build_recording(
        grid,
        find_clock(plan.layout, plan.time, first_us),
        (
            *rows.flags,
            *repairs,
            *grid.flags,
            *flag_text(source, layout),
            *unread,
            *_flag_rates(plan, grid, rate_hz),
        ),
        {
            **_describe_columns(plan, stated, first_us),
            "time": time.describe(first_us),
            "time_exponent": str(time.unit.exponent),
            "delimiter": {"\t": "tab", " ": "space"}.get(separator, separator),
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(columns.rows),
        },
        stated=stated,
        jitter_us=float(grid.jitter_us),
        device=layout.device.device if layout.device else device if find_device_name(device) else "other",
        serial_hash=hash_serial(facts.get("serial", "") or facts.get("serial_number", "")),
        acc_range_g=read_positive(facts.get("acc_range_g")),
        gyr_range_dps=read_positive(facts.get("gyr_range_dps")),
        **pose,
    )


def _cut_rows(plan: TablePlan, columns: SampleColumns, rate_hz: float | None) -> Grid:
    if plan.time.has_times:
        return cut_stamped(columns)
    if plan.time.kind == "row number":
        return cut_counted(columns, rate_hz or _find_burst_rate_hz(columns, plan.layout))
    # packets that were lost are missing time
    if not rate_hz or not SLOWEST_HZ <= rate_hz <= FASTEST_HZ:
        raise UnknownRate(**({"m": rate_hz} if rate_hz else {}))
    period_us = MICROSECONDS / rate_hz
    stamps = columns.stamps
    stamps[1:] += PACKET_NUMBERS * np.cumsum(np.diff(stamps) < -PACKET_NUMBERS // 2)
    stamps[:] = np.rint((stamps - stamps[0]) * period_us)
    repeats = leave_out_repeats(columns)
    grid = cut_stamped(columns)
    return replace(grid, flags=(*repeats, *grid.flags))


def choose_rate_hz(layout: TextLayout, rate_hz: float | None) -> float | None:
    """Return the rate that the preamble states, if plausible; else the rate that a person gives, in Hz."""
    stated_hz = _find_stated_hz(layout)
    return stated_hz if SLOWEST_HZ <= stated_hz <= FASTEST_HZ else rate_hz


def _find_burst_rate_hz(columns: SampleColumns, layout: TextLayout) -> float:
    """Find the rate of a layout without time by its form, in Hz; else a person has to give it.

    Raises UnknownRate, or UnusableTime if a column without a known name advances like a time.
    """
    ends = np.flatnonzero(np.diff(columns.stamps // PAUSE)) + 1
    bursts = np.diff(np.concatenate([[0], ends]))
    if len(bursts) >= 2 and np.all(bursts == ARDUINO_BURST_ROWS):
        return ARDUINO_RATE_HZ
    if unnamed := find_unnamed_time(layout, layout.columns):
        raise UnusableTime(column=layout.columns[unnamed[0]].name or str(unnamed[0] + 1))
    raise UnknownRate


def _flag_rates(plan: TablePlan, grid: Grid, rate_hz: float | None) -> tuple[QualityFlag, ...]:
    """Flag a rate that differs from the preamble, an impossible time unit, and a rate without times.

    W-DRIFT, W-UNITS and W-RATE; W-RATE names the source of the rate: preamble, person or layout.
    """
    stated_hz, used_hz = _find_stated_hz(plan.layout), MICROSECONDS / grid.period_us
    flags = flag_drift(stated_hz, used_hz) if stated_hz > 0.0 else ()
    flags += plan.time.unit.flag()
    if not plan.time.has_times:
        without_header = "told" if rate_hz else "layout"
        source = "header" if choose_rate_hz(plan.layout, None) else without_header
        flags += (QualityFlag(Caveat.RATE, facts={"rate_hz": round(used_hz, 3), "rate_from": source}),)
    return flags


def _find_stated_hz(layout: TextLayout) -> float:
    """Read the rate that the preamble states; 0 if it states none."""
    found = (STATED_RATE.search(line) for line in layout.preamble)
    return next((float(match.group(1)) for match in found if match), 0.0)


def read_positive(text: str | None) -> float | None:
    """Parse a positive number of a preamble; None if there is none or it cannot be a range."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if 0 < value < 1e6 else None


def _read_pose(facts: Mapping[str, str]) -> tuple[dict[str, Any], tuple[QualityFlag, ...]]:
    """Read the pose in the preamble, and flag its unreadable lines (W-HEADER)."""
    unread: list[str] = []

    def read(name: str, parse: Callable[[str], T]) -> T | None:
        try:
            return parse(facts[name]) if name in facts else None
        except ValueError:
            unread.append(f"{name}: {facts[name][:60]}")
            return None

    pose = {
        "pose_windows_s": read("pose_window_s", _read_pose_window) or (),
        "arm_axis": read("arm_axis", parse_arm_axis),
        "pose_held": read("pose_held", parse_pose_held),
    }
    flag = QualityFlag(Caveat.HEADER, len(unread), facts={"text": "; ".join(unread)})
    return pose, (flag,) if unread else ()


def _read_pose_window(text: str) -> tuple[tuple[float, float], ...]:
    """Read when the pose was held, ``START,END`` in seconds."""
    start_s, end_s = (float(part) for part in text.split(","))
    if not 0.0 <= start_s < end_s < math.inf:
        raise ValueError("START,END; 0 <= START < END")
    return ((start_s, end_s),)


def _read_stated(plan: TablePlan, *, is_in_g: bool) -> Stated:
    """Return the units and the time that the header states."""
    device = plan.layout.device
    acc_unit, gyr_unit = "g" if is_in_g else plan.acceleration.unit, plan.angular_rate.unit
    units_from = name_unit_source(acc_unit, gyr_unit, is_known=bool(device and device.frame == "right"))
    return Stated(
        acc_unit or "",
        gyr_unit or "",
        is_known=units_from == "header",
        left_gyr_factor=round(device.left_gyr_factor, 5) if device else 1.0,
        is_counted=not plan.time.has_times,
        units_from=units_from,
    )


def _describe_columns(plan: TablePlan, stated: Stated, first_us: int) -> dict[str, str]:
    columns, device = plan.layout.columns, plan.layout.device
    rows, used = plan.layout.sample_rows, {k for k, target in enumerate(plan.targets) if target >= STAMP}
    clock_place, writer = find_clock_place(plan.layout, plan.time, first_us), plan.layout.writer
    used |= {clock_place} if clock_place is not None else set()
    used |= {k + 1 for k in used if plan.layout.dates and rows and _is_empty(rows, k + 1)}
    if isinstance(writer, ClockWriter):
        used = used - set(writer.emptied) | set(writer.parts)
    ignored = (
        one.name
        for k, one in enumerate(columns)
        if one.name and k not in used and one.channel in ("other", "time")
    )
    described = {
        "layout": "table with header",
        "columns": ", ".join(column.name for column in columns)[:400],
        "ignored": ", ".join(ignored)[:400],
        "acceleration_unit": stated.acc_unit,
        "angular_rate_unit": stated.gyr_unit,
        "units_from": stated.units_from,
    }
    if device and device.left_gyr_factor != 1.0:
        described["left_gyr_factor"] = f"{device.left_gyr_factor:.5f}"
    return described


def _is_empty(rows: Sequence[Sequence[str]], place: int) -> bool:
    """Whether a column is empty: a time of day that was joined to the date before it."""
    return not any(row[place] for row in rows if len(row) > place)


# Register dumps of the LSM9DS1: 26-byte binary records and headerless text, gyroscope first.
#
# Both are those of Raspberry Pi loggers: `u32 s, u32 us, 9 x int16` little-endian, or the same as
# `epoch,gx,gy,gz,ax,ay,az,mx,my,mz`. The registers' frame is left-handed (measured: da/dt = -(a x w)), so the
# x axis of both sensors is turned round here; the ranges stand nowhere and are found in
# :mod:`acromion.fusion.checks.physics`.

RECORD = np.dtype([("s", "<u4"), ("us", "<u4"), ("gyr", "<i2", 3), ("acc", "<i2", 3), ("mag", "<i2", 3)])
MIN_RECORDS = 20
LONGEST_STEP_S = 3600
TEXT_TARGETS = (STAMP, 4, 5, 6, 1, 2, 3, IGNORED, IGNORED, IGNORED)
UNIX_SECONDS = TimeColumn("number", TimeUnit(6))


def recognise_binary(source: Source) -> bool:
    """Return whether the head contains records with plausible microseconds and seconds."""
    head = np.frombuffer(source.head[: len(source.head) // RECORD.itemsize * RECORD.itemsize], RECORD)
    if len(head) < MIN_RECORDS:
        return False
    steps = np.diff(head["s"].astype(np.int64))
    return bool(np.all(head["us"] < MICROSECONDS) and np.mean((steps >= 0) & (steps < LONGEST_STEP_S)) > 0.95)


def recognise_text(source: Source) -> bool:
    """Return whether the head has ten columns, a stamp and nine whole numbers, and no header."""
    layout = None if b"\0" in source.head else sniff_layout(source)
    if layout is None or layout.header or layout.misfit_header or layout.n_columns != len(TEXT_TARGETS):
        return False
    rows = layout.sample_rows[:50]
    is_whole = all(re.fullmatch(r"-?\d{1,5}", field) for row in rows for field in row[1:])
    return is_whole and all(re.fullmatch(r"\d{9,10}\.\d{3,9}", row[0]) for row in rows)


def read_binary(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (stamps tell it)
    """Read 26-byte records; raises NoSamples, UnusableTime or UnknownRate."""
    columns = SampleColumns(source)
    carried = b""
    for chunk in read_chunks(source):
        content = carried + chunk
        whole = len(content) // RECORD.itemsize * RECORD.itemsize
        block, carried = np.frombuffer(content[:whole], RECORD), content[whole:]
        rows = columns.extend(len(block))
        columns.acc[rows], columns.gyr[rows] = block["acc"], block["gyr"]
        columns.stamps[rows] = block["s"].astype(np.int64) * MICROSECONDS + block["us"]
    columns.trim()
    flags = drop_blank_rows(columns)
    if carried:
        flags += (QualityFlag(Caveat.TRUNC_TAIL, facts={"n": len(carried)}),)
    return _build(columns, flags, "LSM9DS1 registers, 26-byte records")


def read_text(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (stamps tell it)
    """Read headerless register text; raises NoSamples, UnreadableRows, UnusableTime or UnknownRate."""
    layout = sniff_layout(source)
    assert layout is not None
    rows = read_table(source, TablePlan(layout, TEXT_TARGETS, UNIX_SECONDS))
    return _build(rows.columns, rows.flags, "LSM9DS1 registers, text")


def _build(columns: SampleColumns, flags: tuple[QualityFlag, ...], layout: str) -> Recording:
    if columns.rows == 0:
        raise NoSamples
    columns.acc[:, 0] *= -1
    columns.gyr[:, 0] *= -1
    flags += UNIX_SECONDS.repair(columns)
    moment, n_rows = datetime_at_us(int(columns.stamps[0])), columns.rows
    grid = cut_stamped(columns)
    start, unset = trust_clock(moment.replace(tzinfo=UTC) if moment else None)
    mirrored = QualityFlag(Caveat.UNITS, facts={"what": "left-handed", "evidence": "layout", "turned": "x"})
    return build_recording(
        grid,
        TableClock(start, "UTC+00:00" if start else None, (*unset, mirrored)),
        (*flags, *grid.flags),
        {
            "layout": layout,
            "columns": "gyroscope, accelerometer, magnetometer",
            "acceleration_unit": "registers",
            "angular_rate_unit": "registers",
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(n_rows),
        },
        stated=Stated("registers", "registers"),
        jitter_us=float(grid.jitter_us),
        device="lsm9ds1",
    )
