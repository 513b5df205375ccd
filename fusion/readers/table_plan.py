"""From a table's column names to a plan for reading it: channels, units, stamps."""

from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from fusion.errors import NoGyroscope, UnknownColumns
from fusion.readers.columns import Column, choose_vector
from fusion.readers.text_kernel import CALENDAR_TIME, COUNTER, IGNORED, NUMERIC_TIME, STAMP
from fusion.readers.text_layout import CALENDAR, TextLayout
from fusion.readers.text_table import TablePlan
from fusion.readers.time_unit import IN_MICROSECONDS, TimeUnit, settle_unit
from fusion.units import acc_scale_g, gyr_scale_dps

PACKET_NUMBERS = 65_536
"""Xsens' packet counter starts over here (MT Manager and DOT user manuals)."""
COUNTER_WORDS = ("micros", "millis", "time_us", "time_ms", "timestamp (us)")


def plan_table(layout: TextLayout) -> TablePlan:
    """Decide which column goes where, and with which factor.

    A unit that the header does not state is left to :mod:`fusion.physics`: the factor is then 1.

    Raises
    ------
    NoGyroscope, UnknownColumns
    """
    acc, gyr = choose_vector(layout.columns, "acc"), choose_vector(layout.columns, "gyr")
    if acc is None or gyr is None:
        _refuse_columns(layout.columns)
    assert acc is not None
    assert gyr is not None
    targets = [IGNORED] * layout.n_columns
    for axis in range(3):
        targets[acc[axis]], targets[gyr[axis]] = 1 + axis, 4 + axis
    stamp, kind, unit = _choose_stamp(layout)
    packets = _find_packet_counter(layout) if stamp is None else None
    if packets is not None:
        stamp, kind = packets, NUMERIC_TIME
    if stamp is not None:
        targets[stamp] = STAMP
    return TablePlan(
        tuple(targets),
        kind,
        unit.exponent,
        acc_scale_g(layout.columns[acc[0]].unit) or 1.0,
        gyr_scale_dps(layout.columns[gyr[0]].unit) or 1.0,
        counts_packets=packets is not None,
        unit=unit,
    )


def _refuse_columns(columns: Sequence[Column]) -> None:
    has_acc = any(column.channel == "acc" for column in columns)
    has_gyr = any(column.channel == "gyr" for column in columns)
    if has_acc and not has_gyr:
        raise NoGyroscope
    raise UnknownColumns(list=", ".join(column.name for column in columns)[:200])


def _choose_stamp(layout: TextLayout) -> tuple[int | None, int, TimeUnit]:
    """Place, kind and unit of the stamp column."""
    places = [k for k, column in enumerate(layout.columns) if column.channel == "time"]
    places.sort(key=lambda k: layout.columns[k].unit is None)
    for place in places:
        fields = [row[place] for row in layout.sample_rows if len(row) > place]
        if all(CALENDAR.fullmatch(field) for field in fields):
            return place, CALENDAR_TIME, IN_MICROSECONDS
        times = read_times(fields, layout.decimal)
        unit = settle_unit(times, layout.columns[place].unit) if times else None
        if unit is not None:
            return place, NUMERIC_TIME, unit
    return None, COUNTER, IN_MICROSECONDS


def _find_packet_counter(layout: TextLayout) -> int | None:
    """Place of Xsens' packet counter where it counts up: in a table without time it tells of lost packets."""
    for place, column in enumerate(layout.columns):
        if column.channel == "counter" and column.name.strip().lower() == "packetcounter":
            fields = [row[place] for row in layout.sample_rows if len(row) > place]
            steps = (
                [(int(b) - int(a)) % PACKET_NUMBERS for a, b in pairwise(fields)]
                if _are_whole(fields)
                else []
            )
            return place if steps and median(steps) == 1 else None
    return None


def _are_whole(fields: Sequence[str]) -> bool:
    return all(field.isascii() and field.isdigit() for field in fields)


def read_times(fields: Sequence[str], decimal: str) -> list[float]:
    """The fields as numbers; none where one of them is none."""
    try:
        return [float(field.replace(decimal, ".")) for field in fields if field]
    except ValueError:
        return []


def find_tick_us(plan: TablePlan) -> int:
    """Microseconds in a count of micros() or millis(), which start over; 0 for other stamps."""
    if plan.stamp_kind != NUMERIC_TIME or plan.counts_packets or plan.stamp_exponent not in (0, 3):
        return 0
    return int(10**plan.stamp_exponent)
