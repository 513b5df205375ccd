"""Register dumps of the LSM9DS1: 26-byte binary records and headerless text, gyroscope first.

Both are those of Raspberry Pi loggers: `u32 s, u32 us, 9 x int16` little-endian, or the same as
`epoch,gx,gy,gz,ax,ay,az,mx,my,mz`. The registers' frame is left-handed (measured: da/dt = -(a x w)), so the
x axis of both sensors is turned round here; the ranges stand nowhere and are found in
:mod:`fusion.checks.physics`.
"""

import re
from datetime import UTC

import numpy as np

from fusion.caveats import Caveat
from fusion.errors import NoSamples
from fusion.readers.samples import SampleColumns, drop_blank_rows
from fusion.readers.source import Source, read_chunks
from fusion.readers.tables.columns import TimeUnit
from fusion.readers.tables.csv_lines import IGNORED, STAMP
from fusion.readers.tables.layout import sniff_layout
from fusion.readers.tables.rows import TableClock, TablePlan, TimeColumn, build_recording, read_table
from fusion.readers.time.clock import datetime_at_us, trust_clock
from fusion.readers.time.grid import cut_stamped
from fusion.recording import MICROSECONDS, QualityFlag, Recording, Stated

RECORD = np.dtype([("s", "<u4"), ("us", "<u4"), ("gyr", "<i2", 3), ("acc", "<i2", 3), ("mag", "<i2", 3)])
MIN_RECORDS = 20
LONGEST_STEP_S = 3600
TEXT_TARGETS = (STAMP, 4, 5, 6, 1, 2, 3, IGNORED, IGNORED, IGNORED)
UNIX_SECONDS = TimeColumn("number", TimeUnit(6))


def recognise_binary(source: Source) -> bool:
    """Whether the head holds records whose microseconds and seconds behave as such."""
    head = np.frombuffer(source.head[: len(source.head) // RECORD.itemsize * RECORD.itemsize], RECORD)
    if len(head) < MIN_RECORDS:
        return False
    steps = np.diff(head["s"].astype(np.int64))
    return bool(np.all(head["us"] < MICROSECONDS) and np.mean((steps >= 0) & (steps < LONGEST_STEP_S)) > 0.95)


def recognise_text(source: Source) -> bool:
    """Whether the head holds ten columns, a stamp and nine whole numbers, and no header."""
    layout = None if b"\0" in source.head else sniff_layout(source)
    if layout is None or layout.header is not None or layout.n_columns != len(TEXT_TARGETS):
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
