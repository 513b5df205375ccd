"""ActiLife "-IMU.csv": ten header lines, then one row for each hundredth of a second.

Header facts: GT9X exports of ActiLife 6.12 to 6.13.4, with and without the Timestamp column, and a copy that
Excel saved again (every header line then ends in commas).
Compared to ActiLife: nothing. ActiLife has already resampled each second to exactly 100 rows, and carries the
last value forward where records were missing; such runs of equal rows are taken as missing.
"""

import re
from datetime import datetime

from acromion.fusion.clocks import parse_offset_s
from acromion.fusion.errors import EpochFile, NoGyroscope, NoSamples, UnknownColumns
from acromion.fusion.readers.source import Source
from acromion.fusion.readers.tables.columns import choose_vector, name_missing
from acromion.fusion.readers.tables.csv_lines import IGNORED, STAMP
from acromion.fusion.readers.tables.layout import CALENDAR, TextLayout, decode_head, flag_text, read_layout
from acromion.fusion.readers.tables.rows import (
    TablePlan,
    build_clock,
    build_recording,
    choose_calendar,
    find_clock,
    read_table,
)
from acromion.fusion.readers.time.clock import flag_drift, hash_serial
from acromion.fusion.readers.time.grid import cut_counted, cut_stamped
from acromion.fusion.recording import MICROSECONDS, Recording, Stated

FIRST_LINE = re.compile(r"^\W*-{5,}\s*Data (Table )?File Created By ActiGraph", re.IGNORECASE)
HEADER_LINE = re.compile(r"(Serial Number|Start Time|Start Date|Epoch Period \(hh:mm:ss\)):?\s+(.*)")
DEVICE_RANGES = (16.0, 2000.0)
DATE_ORDERS = {"m": "%m %d %Y", "d": "%d %m %Y", "y": "%Y %m %d"}


def recognise(source: Source) -> bool:
    """Whether the first line is ActiLife's."""
    return bool(FIRST_LINE.match(decode_head(source)[:400]))


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the header tells it)
    """Read an ActiLife IMU export.

    Raises
    ------
    EpochFile, NoGyroscope, UnknownColumns
        An export of another kind.
    acromion.fusion.errors.UnreadableRows, acromion.fusion.errors.CutByExcel,
    acromion.fusion.errors.AmbiguousDecimal
        The table is damaged.
    """
    head = decode_head(source)
    header = parse_header(head)
    plan = _plan_table(read_layout(source), header, head, is_thigh=source.is_thigh)
    rows = read_table(source, plan)
    if rows.columns.rows == 0:
        raise NoSamples
    if 4 not in plan.targets:
        rows.columns.gyr[:] = 0.0
    # `at 100 Hz` of the first line: ActiLife's IMU exports are resampled to exactly that
    stated = re.search(r"at (\d{1,4}) Hz", header[""])
    stated_hz = float(stated.group(1)) if stated else 100.0
    if plan.time.has_times:
        changes = plan.time.repair(rows.columns, rows.changes)
        clock = find_clock(plan.layout, plan.time, int(rows.columns.stamps[0]))
        grid = cut_stamped(rows.columns)
        changes += flag_drift(stated_hz, MICROSECONDS / grid.period_us)
    else:
        clock, changes = build_clock(parse_start(header)), ()
        grid = cut_counted(rows.columns, stated_hz)
    version = re.search(r"ActiLife v([\d.]+)", header[""])
    has_time = any(column.channel == "time" for column in plan.layout.columns)
    return build_recording(
        grid,
        clock,
        (*rows.flags, *changes, *grid.flags, *flag_text(source, plan.layout)),
        {
            "layout": "ActiLife IMU CSV",
            "columns": ", ".join(column.name for column in plan.layout.columns),
            "units": "g, deg/s",
            "units_from": "header",
            "nominal_rate_hz": f"{stated_hz:g}",
            "samples": str(rows.columns.rows),
            "software": version.group(1) if version else "",
            "clock": "local",
            "time": "calendar" if has_time else "row number",
        },
        stated=Stated(is_known=True, is_counted=not has_time, units_from="header", nominal_rate_hz=stated_hz),
        device="gt9x",
        serial_hash=hash_serial(header.get("Serial Number", "")),
        acc_range_g=DEVICE_RANGES[0],
        gyr_range_dps=DEVICE_RANGES[1],
    )


def parse_header(head: str) -> dict[str, str]:
    """Return the ten lines before the table; the first under the key ""."""
    first, *lines = [line.rstrip("\r").strip(',;\t "') for line in head.split("\n")[:12]]
    found = [HEADER_LINE.match(line) for line in lines]
    return {"": first, **{one.group(1).split(" (")[0]: one.group(2) for one in found if one}}


def parse_start(header: dict[str, str]) -> datetime | None:
    """Return the start by the date format that the first line names; None if they contradict each other."""
    order = re.search(r"date format (\w)", header[""])
    parts = re.findall(r"\d+", header.get("Start Date", ""))
    if order is None or len(parts) != 3:
        return None
    pattern = DATE_ORDERS.get(order.group(1).lower(), "%Y %m %d")
    try:
        return datetime.strptime(  # noqa: DTZ007 (the header tells no zone)
            f"{' '.join(parts)} {header.get('Start Time', '')}", f"{pattern} %H:%M:%S"
        )
    except ValueError:
        return None


def _plan_table(layout: TextLayout | None, header: dict[str, str], head: str, *, is_thigh: bool) -> TablePlan:
    """Plan the table, or refuse an export of another kind."""
    epoch_s = parse_offset_s(header.get("Epoch Period", "")) or 0
    if epoch_s > 0:
        raise EpochFile(sec=epoch_s)
    columns = layout.columns if layout else ()
    acc, gyr = choose_vector(columns, "acc"), choose_vector(columns, "gyr")
    if layout is None or acc is None or (gyr is None and not is_thigh):
        if "Accelerometer X" in head and "Gyroscope" not in head:
            raise NoGyroscope(cure="GT9X")
        if layout is not None:
            raise UnknownColumns(list=(layout.header or "").strip()[:200], **name_missing(columns))
        raise NoSamples if "Accelerometer X" in head else UnknownColumns(why="no header")
    targets = [IGNORED] * layout.n_columns
    for axis in range(3):
        targets[acc[axis]] = 1 + axis
        if gyr is not None:
            targets[gyr[axis]] = 4 + axis
    stamps = [k for k, column in enumerate(layout.columns) if column.channel == "time"]
    if stamps and all(CALENDAR.fullmatch(row[stamps[0]]) for row in layout.sample_rows[:5]):
        targets[stamps[0]] = STAMP
        return TablePlan(layout, tuple(targets), choose_calendar(layout, stamps[0]))
    return TablePlan(layout, tuple(targets))
