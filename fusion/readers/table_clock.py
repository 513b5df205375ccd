"""What the stamps of a table say of the clock: when it began, by which offset, and whether that changed."""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta, timezone

import numpy as np

from fusion.readers.gt3x_info import name_offset
from fusion.readers.row_settling import settle_rows
from fusion.readers.stamp_writing import flag_changes
from fusion.readers.table_plan import find_tick_us
from fusion.readers.text_kernel import CALENDAR_TIME, NUMERIC_TIME
from fusion.readers.text_layout import TextLayout
from fusion.readers.text_table import TablePlan, TableRows
from fusion.readers.timing import datetime_at_us, is_clock_set, trust_clock
from fusion.recording import QualityFlag

START_TOLERANCE = timedelta(minutes=1)
SETTLED_ROWS = 1001
"""So many first stamps tell what kind of number they are, though some be strange."""


@dataclass(frozen=True, slots=True)
class TableClock:
    """The clock at the first row, its zone as the file tells it, and what is to be said of them."""

    start: datetime | None
    time_zone: str | None
    flags: tuple[QualityFlag, ...]


def settle_stamps(rows: TableRows, layout: TextLayout, plan: TablePlan) -> tuple[QualityFlag, ...]:
    """Bring the rows into order and take changes of the clock out of their stamps, in place; say what was.

    Stamps with an offset were told by that of the first row as they were read; only of a bare wall clock has
    an hour's step to be judged.
    """
    stamps = rows.columns.stamps
    is_calendar = plan.stamp_kind == CALENDAR_TIME
    has_offset = layout.dates is not None and layout.dates.offset_s is not None
    is_epoch = counts_since_1970(plan, int(np.median(stamps[:SETTLED_ROWS])))
    flags = settle_rows(
        rows.columns,
        tick_us=0 if is_calendar or is_epoch else find_tick_us(plan),
        is_wall_clock=is_calendar and not has_offset,
    )
    if is_calendar and has_offset:
        turned = any(flag.code == "W-REVERSED" for flag in flags)
        changes = [change.turn_round() for change in reversed(rows.changes)] if turned else rows.changes
        flags += flag_changes(changes, int(rows.columns.stamps[0]))
    return flags


def read_epoch(first_stamp_us: int) -> datetime | None:
    """Take a number for the time since 1970, in UTC, where no counter from power-on comes as far."""
    moment = datetime_at_us(first_stamp_us)
    return moment.replace(tzinfo=UTC) if moment is not None and is_clock_set(moment) else None


def counts_since_1970(plan: TablePlan, first_stamp_us: int) -> bool:
    """Whether the stamps of a table are numbers of that kind."""
    is_number = plan.stamp_kind == NUMERIC_TIME and not plan.counts_packets
    return is_number and read_epoch(first_stamp_us) is not None


def tell_clock(layout: TextLayout, plan: TablePlan, first_stamp_us: int) -> TableClock:
    """Read the clock at the first row: from the preamble, from a calendar column, or from an epoch.

    An epoch (seconds, milli-, micro- or nanoseconds since 1970) counts UTC.
    """
    start = read_preamble_start(layout)
    flags: tuple[QualityFlag, ...] = ()
    if start is not None and plan.stamp_kind == CALENDAR_TIME:
        start, flags = _compare_starts(start, layout, first_stamp_us)
    elif start is None and plan.stamp_kind == CALENDAR_TIME:
        start = _read_stamp(layout, first_stamp_us)
        if layout.dates is not None and not layout.dates.has_date and start is not None:
            flags = (QualityFlag("W-NO-DATE", facts={"time_of_day": f"{start:%H:%M:%S}"}),)
            start = None
        elif layout.dates is not None and layout.dates.is_doubtful and start is not None:
            flags = (QualityFlag("W-DATE-ORDER", facts={"date": f"{start:%Y-%m-%d}"}),)
    elif start is None and counts_since_1970(plan, first_stamp_us):
        start = read_epoch(first_stamp_us)
    return judge_clock(start, flags)


def _compare_starts(
    told: datetime, layout: TextLayout, first_stamp_us: int
) -> tuple[datetime, tuple[QualityFlag, ...]]:
    """Take the rows' own time where the preamble's start is another; its offset is the preamble's to tell."""
    stamp = _read_stamp(layout, first_stamp_us)
    if stamp is None or (layout.dates is not None and not layout.dates.has_date):
        return told, ()
    if stamp.tzinfo is None or told.tzinfo is None:
        stamp = stamp.replace(tzinfo=stamp.tzinfo or told.tzinfo)
        told = told.replace(tzinfo=stamp.tzinfo)
    if abs(told - stamp) <= START_TOLERANCE:
        return told, ()
    facts = {"header": f"{told:%Y-%m-%d %H:%M:%S}", "first": f"{stamp:%Y-%m-%d %H:%M:%S}"}
    return stamp, (QualityFlag("W-START", facts=facts),)


def judge_clock(start: datetime | None, flags: tuple[QualityFlag, ...] = ()) -> TableClock:
    """Keep a clock that can have been set; name its zone; say where it is UTC."""
    start, unset = trust_clock(start)
    offset = start.utcoffset() if start else None
    if offset is None:
        return TableClock(start, None, (*flags, *unset))
    if not offset:
        flags = (*flags, QualityFlag("W-UTC"))
    return TableClock(start, name_offset(round(offset.total_seconds())), (*flags, *unset))


def read_preamble_start(layout: TextLayout) -> datetime | None:
    """`# start: 2026-03-02T07:58:00-05:00`; None where there is none that can be read."""
    try:
        return datetime.fromisoformat(layout.facts().get("start", ""))
    except ValueError:
        return None


def _read_stamp(layout: TextLayout, stamp_us: int) -> datetime | None:
    moment = datetime_at_us(stamp_us)
    if moment is None or layout.dates is None or layout.dates.offset_s is None:
        return moment
    return moment.replace(tzinfo=timezone(timedelta(seconds=layout.dates.offset_s)))
