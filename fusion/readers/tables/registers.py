"""Register dumps of the LSM9DS1: 26-byte binary records and headerless text, gyroscope first.

Both are those of Raspberry Pi loggers: `u32 s, u32 us, 9 x int16` little-endian, or the same as
`epoch,gx,gy,gz,ax,ay,az,mx,my,mz`. The registers' frame is left-handed (measured: da/dt = -(a x w)), so the
x axis of both sensors is turned round here; the ranges stand nowhere and are found in
:mod:`fusion.checks.physics`.
"""

import re
from collections.abc import Iterator
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from fusion.caveats import Caveat
from fusion.errors import NoSamples
from fusion.readers.samples import SampleColumns, drop_blank_rows
from fusion.readers.source import Source, read_chunks
from fusion.readers.tables.careful_path import IGNORED, NUMERIC_TIME, STAMP
from fusion.readers.tables.layout import TextLayout, sniff_layout
from fusion.readers.tables.rows import TablePlan, read_table
from fusion.readers.timebase.clock import trust_clock
from fusion.readers.timebase.grid import Grid, cut_stamped
from fusion.readers.timebase.row_times import repair_row_times
from fusion.recording import MICROSECONDS, QualityFlag, Recording

RECORD = np.dtype([("s", "<u4"), ("us", "<u4"), ("gyr", "<i2", 3), ("acc", "<i2", 3), ("mag", "<i2", 3)])
MIN_RECORDS = 20
LONGEST_STEP_S = 3600
TEXT_TARGETS = (STAMP, 4, 5, 6, 1, 2, 3, IGNORED, IGNORED, IGNORED)


def recognise_binary(source: Source) -> bool:
    """Whether the head holds records whose microseconds and seconds behave as such."""
    head = np.frombuffer(source.head[: len(source.head) // RECORD.itemsize * RECORD.itemsize], RECORD)
    if len(head) < MIN_RECORDS:
        return False
    steps = np.diff(head["s"].astype(np.int64))
    return bool(np.all(head["us"] < MICROSECONDS) and np.mean((steps >= 0) & (steps < LONGEST_STEP_S)) > 0.95)


def recognise_text(source: Source) -> bool:
    """Whether the head holds ten columns, a stamp and nine whole numbers, and no header."""
    if b"\0" in source.head:
        return False
    layout = sniff_layout(source)
    return layout is not None and layout.header is None and _is_register_table(layout)


def _is_register_table(layout: TextLayout) -> bool:
    rows = layout.sample_rows[:50]
    is_whole = all(re.fullmatch(r"-?\d{1,5}", field) for row in rows for field in row[1:])
    has_stamps = all(re.fullmatch(r"\d{9,10}\.\d{3,9}", row[0]) for row in rows)
    return layout.n_columns == len(TEXT_TARGETS) and is_whole and has_stamps


def read_binary(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (stamps tell it)
    """Read 26-byte records.

    Raises
    ------
    NoSamples, fusion.errors.UnusableTime, fusion.errors.UnknownRate
    """
    columns = SampleColumns(source)
    lost_bytes = 0
    for block, rest_bytes in _read_records(source):
        _take_block(columns, block)
        lost_bytes = rest_bytes
    columns.trim()
    flags = drop_blank_rows(columns)
    if lost_bytes:
        flags += (QualityFlag(Caveat.TRUNC_TAIL, facts={"n": lost_bytes}),)
    return _build(columns, flags, "LSM9DS1 registers, 26-byte records")


def read_text(source: Source, rate_hz: float | None = None) -> Recording:  # noqa: ARG001 (stamps tell it)
    """Read headerless register text.

    Raises
    ------
    NoSamples, fusion.errors.UnreadableRows, fusion.errors.UnusableTime, fusion.errors.UnknownRate
    """
    layout = sniff_layout(source)
    assert layout is not None
    rows = read_table(source, TablePlan(layout, TEXT_TARGETS, NUMERIC_TIME, 6))
    return _build(rows.columns, rows.flags, "LSM9DS1 registers, text")


def _read_records(source: Source) -> Iterator[tuple[NDArray[np.void], int]]:
    carried = b""
    for chunk in read_chunks(source):
        content = carried + chunk
        whole = len(content) // RECORD.itemsize * RECORD.itemsize
        carried = content[whole:]
        yield np.frombuffer(content[:whole], RECORD), len(carried)


def _take_block(columns: SampleColumns, block: NDArray[np.void]) -> None:
    columns.make_room(len(block))
    rows = slice(columns.rows, columns.rows + len(block))
    columns.acc[rows] = block["acc"]
    columns.gyr[rows] = block["gyr"]
    columns.stamps[rows] = block["s"].astype(np.int64) * MICROSECONDS + block["us"]
    columns.rows += len(block)


def _build(columns: SampleColumns, flags: tuple[QualityFlag, ...], layout: str) -> Recording:
    if columns.rows == 0:
        raise NoSamples
    columns.acc[:, 0] *= -1
    columns.gyr[:, 0] *= -1
    flags += repair_row_times(columns)
    first_us = int(columns.stamps[0])
    n_rows = columns.rows
    grid: Grid = cut_stamped(columns)
    start, unset = trust_clock(datetime.fromtimestamp(first_us / MICROSECONDS, UTC))
    mirrored = QualityFlag(Caveat.UNITS, facts={"what": "left-handed", "evidence": "layout", "turned": "x"})
    return Recording(
        device="lsm9ds1",
        sha256="",
        start=start,
        time_zone="UTC+00:00" if start else None,
        duration_us=grid.duration_us,
        segments=grid.segments,
        flags=(*flags, *grid.flags, *unset, mirrored),
        understood={
            "layout": layout,
            "columns": "gyroscope, accelerometer, magnetometer",
            "acceleration_unit": "registers",
            "angular_rate_unit": "registers",
            "jitter_us": f"{grid.jitter_us:.1f}",
            "samples": str(n_rows),
        },
    )
