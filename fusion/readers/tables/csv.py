"""CSV of loggers built on the ST LSM9DS1, and of look-alikes whose header names the columns.

A header is needed; units and time are read from it where it states them, and found from the samples where it
does not (:mod:`fusion.checks.physics`). A preamble of `# key: value` lines may tell device, start and ranges.
"""

import re
from dataclasses import replace

import numpy as np

from fusion.errors import TooShort, UnknownColumns, UnknownRate
from fusion.readers.samples import PAUSE
from fusion.readers.source import Source
from fusion.readers.tables.careful_path import COUNTER
from fusion.readers.tables.columns import choose_vector
from fusion.readers.tables.layout import TextForm, TextLayout, find_form, flag_text, read_layout, sniff_layout
from fusion.readers.tables.plan import (
    PACKET_NUMBERS,
    counts_since_1970,
    plan_table,
    settle_stamps,
    tell_clock,
)
from fusion.readers.tables.profile import ColumnProfile, apply_profile
from fusion.readers.tables.rows import TablePlan, TableRows, read_table
from fusion.readers.timebase.clock import LARGEST_DRIFT, hash_serial
from fusion.readers.timebase.grid import FASTEST_HZ, SLOWEST_HZ, Grid, cut_counted, cut_stamped
from fusion.readers.timebase.row_times import leave_out_repeats
from fusion.recording import MICROSECONDS, QualityFlag, Recording

ARDUINO_BURST_ROWS = 119
ARDUINO_RATE_HZ = 119.0
RATE_FACTS = ("rate_hz", "rate", "sample_rate", "sampling_rate", "sample_rate_hz", "update_rate", "odr_hz")
CANONICAL_HEADER = "time_us,acc_x_g,acc_y_g,acc_z_g,gyr_x_dps,gyr_y_dps,gyr_z_dps"


def recognise(source: Source) -> bool:
    """Whether the head is text with a header that names columns."""
    layout = sniff_layout(source, find_form(source.head))
    return layout is not None and layout.header is not None


def read(source: Source, rate_hz: float | None = None) -> Recording:
    """Read a table with a header.

    Raises
    ------
    fusion.errors.UnreadableFile
        Columns are missing or not understood, or the table is damaged.
    UnknownRate
        The layout holds no time and nobody told the rate.
    fusion.errors.UnusableTime
        The stamps are not those of an even sampling.
    """
    form = find_form(source.head)
    layout = read_layout(source, form)
    if layout is None:
        raise UnknownColumns(list="-")
    return _read_planned(source, form, (layout, plan_table(layout)), rate_hz)


def read_profiled(source: Source, profile: ColumnProfile, rate_hz: float | None = None) -> Recording:
    """Read a table whose columns a person has named; ``rate_hz`` goes before the profile's.

    Raises
    ------
    fusion.errors.FusionError
        As :func:`read`.
    """
    form = find_form(source.head)
    layout = read_layout(source, form, profile.date_order)
    if layout is None:
        raise UnknownColumns(list="-")
    named = apply_profile(layout, profile)
    plan = plan_table(named)
    plan = replace(
        plan,
        acc_scale=profile.acceleration_factor or plan.acc_scale,
        gyr_scale=profile.angular_rate_factor or plan.gyr_scale,
    )
    return _read_planned(source, form, (named, plan), rate_hz or profile.rate_hz)


def _read_planned(
    source: Source, form: TextForm, table: tuple[TextLayout, TablePlan], rate_hz: float | None
) -> Recording:
    layout, plan = table
    rows = read_table(source, form, layout, plan)
    if rows.columns.rows == 0:
        raise TooShort(s=0.0)
    plan.unit.refuse_doubtful(rows.columns)
    is_stamped = plan.stamp_kind != COUNTER and not plan.counts_packets
    changes = settle_stamps(rows, layout, plan) if is_stamped else ()
    first_stamp = int(rows.columns.stamps[0])
    grid = _cut_rows(rows, plan, choose_rate_hz(layout, rate_hz))
    flags = (*changes, *grid.flags, *flag_text(source, form, layout), *flag_drift(layout, grid))
    flags += plan.unit.flag() + flag_told_rate(layout, plan, grid, rate_hz)
    return _build(layout, plan, rows, (grid, flags), first_stamp)


def _cut_rows(rows: TableRows, plan: TablePlan, rate_hz: float | None) -> Grid:
    if plan.counts_packets:
        return _cut_packets(rows, rate_hz)
    if plan.stamp_kind != COUNTER:
        return cut_stamped(rows.columns)
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
    """Give the rate that the preamble states, where it can be one; else what a person says."""
    stated_hz = find_stated_hz(layout)
    return stated_hz if SLOWEST_HZ <= stated_hz <= FASTEST_HZ else rate_hz


def find_burst_rate_hz(rows: TableRows) -> float:
    """The rate of a layout without time, where its form gives it away.

    Arduino's example sketch for the Nano 33 BLE Sense writes bursts of 119 rows, one second of the library's
    fixed 119 Hz, and a blank line after each.

    Raises
    ------
    UnknownRate
        Nothing gives it away: the person has to tell.
    """
    numbers = rows.columns.stamps
    ends = np.flatnonzero(np.diff(numbers // PAUSE)) + 1
    bursts = np.diff(np.concatenate([[0], ends]))
    if len(bursts) >= 2 and np.all(bursts == ARDUINO_BURST_ROWS):
        return ARDUINO_RATE_HZ
    raise UnknownRate


def _build(
    layout: TextLayout,
    plan: TablePlan,
    rows: TableRows,
    timed: tuple[Grid, tuple[QualityFlag, ...]],
    first_stamp: int,
) -> Recording:
    grid, caveats = timed
    facts = layout.facts()
    clock = tell_clock(layout, plan, first_stamp)
    flags = (*rows.flags, *caveats, *clock.flags)
    return Recording(
        device=find_device(facts, layout),
        sha256="",
        start=clock.start,
        time_zone=clock.time_zone,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=flags,
        understood=_describe(layout, plan, (grid, rows.columns.rows), first_stamp),
        serial_hash=hash_serial(facts.get("serial", "") or facts.get("serial_number", "")),
        acc_range_g=_positive(facts.get("acc_range_g")),
        gyr_range_dps=_positive(facts.get("gyr_range_dps")),
    )


def flag_told_rate(
    layout: TextLayout, plan: TablePlan, grid: Grid, rate_hz: float | None
) -> tuple[QualityFlag, ...]:
    """Say that no time tells the rate, and what did (W-RATE)."""
    if plan.stamp_kind != COUNTER and not plan.counts_packets:
        return ()
    told = "told" if rate_hz else "layout"
    source = "header" if choose_rate_hz(layout, None) else told
    used_hz = round(MICROSECONDS / grid.period_us, 3)
    return (QualityFlag("W-RATE", facts={"rate_hz": used_hz, "rate_from": source}),)


def flag_drift(layout: TextLayout, grid: Grid) -> tuple[QualityFlag, ...]:
    """Say where the true rate is more than 0.5 % off the one that the preamble states."""
    nominal_hz = find_stated_hz(layout)
    true_hz = MICROSECONDS / grid.period_us
    if nominal_hz <= 0.0 or abs(true_hz / nominal_hz - 1.0) <= LARGEST_DRIFT:
        return ()
    return (QualityFlag("W-DRIFT", facts={"nominal_hz": nominal_hz, "rate_hz": round(true_hz, 3)}),)


def find_stated_hz(layout: TextLayout) -> float:
    """Read the rate that the preamble states; 0 where it states none."""
    facts = layout.facts()
    stated = next((facts[name] for name in RATE_FACTS if name in facts), "")
    found = re.match(r"\d+(?:\.\d+)?", stated)
    return float(found.group()) if found else 0.0


def find_device(facts: dict[str, str], layout: TextLayout) -> str:
    """Give "lsm9ds1" where the file says so or is in our own form for such loggers, "dot" for a Xsens DOT."""
    named = facts.get("device", "").lower()
    if "lsm9ds1" in named or (not named and layout.header == CANONICAL_HEADER):
        return "lsm9ds1"
    is_dot = "devicetag" in facts and "sampletimefine" in (layout.header or "").lower()
    return "dot" if is_dot else "other"


def _positive(text: str | None) -> float | None:
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if 0 < value < 1e6 else None


def _describe(
    layout: TextLayout, plan: TablePlan, timed: tuple[Grid, int], first_stamp: int
) -> dict[str, str]:
    grid, n_rows = timed
    acc, gyr = choose_vector(layout.columns, "acc"), choose_vector(layout.columns, "gyr")
    assert acc is not None
    assert gyr is not None
    used = {*acc, *gyr}
    return {
        "layout": "table with header",
        "columns": ", ".join(column.name for column in layout.columns)[:400],
        "ignored": ", ".join(
            column.name
            for k, column in enumerate(layout.columns)
            if k not in used and column.channel == "other"
        )[:400],
        "acceleration_unit": layout.columns[acc[0]].unit or "",
        "angular_rate_unit": layout.columns[gyr[0]].unit or "",
        "time": _name_time(layout, plan, first_stamp),
        "time_exponent": str(plan.stamp_exponent),
        "delimiter": _name_delimiter(layout),
        "jitter_us": f"{grid.jitter_us:.1f}",
        "samples": str(n_rows),
    }


def _name_time(layout: TextLayout, plan: TablePlan, first_stamp: int) -> str:
    """What the stamps are, in a word or two."""
    if plan.counts_packets:
        return "packet counter"
    if counts_since_1970(plan, first_stamp):
        return "number since 1970"
    if layout.dates is not None and not layout.dates.has_date:
        return "time of day"
    return {0: "row number", 1: "number", 2: "calendar"}[plan.stamp_kind]


def _name_delimiter(layout: TextLayout) -> str:
    sign = " " if layout.is_single_spaced else layout.delimiter
    return {"\t": "tab", " ": "space"}.get(sign, sign)
