"""ActiLife "-IMU.csv": ten header lines, then one row for each hundredth of a second.

Header facts: GT9X exports of ActiLife 6.12 to 6.13.4, with and without the Timestamp column, and a copy that
Excel saved again (every header line then ends in commas).
Compared to ActiLife: nothing. ActiLife has already resampled each second to exactly 100 rows, and carries the
last value forward where records were missing; such runs of equal rows are taken as missing.
"""

import re
from datetime import datetime

from fusion.errors import EpochFile, NoGyroscope, NoSamples, UnknownColumns
from fusion.readers.source import Source
from fusion.readers.tables.careful_path import CALENDAR_TIME, IGNORED, STAMP
from fusion.readers.tables.columns import choose_vector, name_missing
from fusion.readers.tables.header import CALENDAR
from fusion.readers.tables.layout import TextLayout, decode_head, flag_text, read_layout
from fusion.readers.tables.rows import TablePlan, build_clock, find_clock, read_table, repair_stamps
from fusion.readers.timebase.clock import flag_drift, hash_serial, parse_offset_s
from fusion.readers.timebase.grid import cut_counted, cut_stamped
from fusion.recording import MICROSECONDS, Recording

FIRST_LINE = re.compile(r"^\W*-{5,}\s*Data (Table )?File Created By ActiGraph", re.IGNORECASE)
DEVICE_RANGES = (16.0, 2000.0)
DATE_ORDERS = {"m": "%m %d %Y", "d": "%d %m %Y", "y": "%Y %m %d"}


def recognise(source: Source) -> bool:
    """Whether the first line is ActiLife's."""
    head = decode_head(source)
    return bool(FIRST_LINE.match(head[:400]))


def read(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (the header tells it)
    """Read an ActiLife IMU export.

    Raises
    ------
    EpochFile, NoGyroscope, UnknownColumns
        An export of another kind.
    fusion.errors.UnreadableRows, fusion.errors.CutByExcel, fusion.errors.AmbiguousDecimal
        The table is damaged.
    """
    head = decode_head(source)
    header = parse_header(head)
    layout = read_layout(source)
    _refuse_other_exports(header, layout, head)
    assert layout is not None
    rows = read_table(source, _plan_table(layout))
    if rows.columns.rows == 0:
        raise NoSamples
    if rows.plan.has_times:
        changes = repair_stamps(rows)
        clock = find_clock(rows.plan, int(rows.columns.stamps[0]))
        grid = cut_stamped(rows.columns)
        changes += flag_drift(header_rate_hz(header), MICROSECONDS / grid.period_us)
    else:
        clock, changes = build_clock(parse_start(header)), ()
        grid = cut_counted(rows.columns, header_rate_hz(header))
    flags = (*rows.flags, *changes, *grid.flags, *flag_text(source, layout))
    return Recording(
        device="gt9x",
        sha256="",
        start=clock.start,
        time_zone=clock.time_zone,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(*flags, *clock.flags),
        understood=_describe(header, layout, rows.columns.rows),
        serial_hash=hash_serial(header.get("Serial Number", "")),
        acc_range_g=DEVICE_RANGES[0],
        gyr_range_dps=DEVICE_RANGES[1],
    )


def parse_header(head: str) -> dict[str, str]:
    """The ten lines before the table; the first under the key "" ."""
    lines = [line.rstrip("\r").strip(',;\t "') for line in head.split("\n")[:12]]
    values = {"": lines[0]}
    for line in lines[1:]:
        found = re.match(r"(Serial Number|Start Time|Start Date|Epoch Period \(hh:mm:ss\)):?\s+(.*)", line)
        if found:
            values[found.group(1).split(" (")[0]] = found.group(2)
    return values


def header_rate_hz(header: dict[str, str]) -> float:
    """`at 100 Hz` of the first line; ActiLife's IMU exports are resampled to exactly that."""
    found = re.search(r"at (\d{1,4}) Hz", header[""])
    return float(found.group(1)) if found else 100.0


def parse_start(header: dict[str, str]) -> datetime | None:
    """Start Date and Time by the date format that the first line names; None where they contradict it."""
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


def _refuse_other_exports(header: dict[str, str], layout: TextLayout | None, head: str) -> None:
    epoch_s = parse_offset_s(header.get("Epoch Period", "")) or 0
    if epoch_s > 0:
        raise EpochFile(sec=epoch_s)
    if layout is not None and choose_vector(layout.columns, "gyr") and choose_vector(layout.columns, "acc"):
        return
    if "Accelerometer X" in head and "Gyroscope" not in head:
        raise NoGyroscope(cure="GT9X")
    if "Accelerometer X" in head and layout is None:
        raise NoSamples
    if layout is None:
        raise UnknownColumns(why="no header")
    raise UnknownColumns(list=(layout.header or "").strip()[:200], missing=name_missing(layout.columns))


def _plan_table(layout: TextLayout) -> TablePlan:
    targets = [IGNORED] * layout.n_columns
    for first, vector in (
        (1, choose_vector(layout.columns, "acc")),
        (4, choose_vector(layout.columns, "gyr")),
    ):
        for axis, place in enumerate(vector or ()):
            targets[place] = first + axis
    stamps = [k for k, column in enumerate(layout.columns) if column.channel == "time"]
    if stamps and all(CALENDAR.fullmatch(row[stamps[0]]) for row in layout.sample_rows[:5]):
        targets[stamps[0]] = STAMP
        return TablePlan(layout, tuple(targets), CALENDAR_TIME)
    return TablePlan(layout, tuple(targets))


def _describe(header: dict[str, str], layout: TextLayout, n_rows: int) -> dict[str, str]:
    version = re.search(r"ActiLife v([\d.]+)", header[""])
    return {
        "layout": "ActiLife IMU CSV",
        "columns": ", ".join(column.name for column in layout.columns),
        "units": "g, deg/s",
        "units_from": "header",
        "nominal_rate_hz": f"{header_rate_hz(header):g}",
        "samples": str(n_rows),
        "software": version.group(1) if version else "",
        "clock": "local",
        "time": "calendar" if any(column.channel == "time" for column in layout.columns) else "row number",
    }
