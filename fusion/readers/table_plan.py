"""From a table's column names to a plan for reading it: channels, units, stamps."""

from collections.abc import Sequence
from itertools import pairwise
from statistics import median

from fusion.errors import NoGyroscope, UnknownColumns
from fusion.readers.columns import TIME_UNITS_EXPONENT, Column, choose_vector
from fusion.readers.text_kernel import CALENDAR_TIME, COUNTER, IGNORED, NUMERIC_TIME, STAMP
from fusion.readers.text_layout import CALENDAR, TextLayout
from fusion.readers.text_table import TablePlan
from fusion.units import acc_scale_g, gyr_scale_dps

PLAUSIBLE_RATE_HZ = (8.0, 2000.0)
COUNTER_BITS = 32
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
    stamp, kind, exponent = _choose_stamp(layout)
    packets = _find_packet_counter(layout) if stamp is None else None
    if packets is not None:
        stamp, kind = packets, NUMERIC_TIME
    if stamp is not None:
        targets[stamp] = STAMP
    return TablePlan(
        tuple(targets),
        kind,
        exponent,
        acc_scale_g(layout.columns[acc[0]].unit) or 1.0,
        gyr_scale_dps(layout.columns[gyr[0]].unit) or 1.0,
        counts_packets=packets is not None,
    )


def _refuse_columns(columns: Sequence[Column]) -> None:
    has_acc = any(column.channel == "acc" for column in columns)
    has_gyr = any(column.channel == "gyr" for column in columns)
    if has_acc and not has_gyr:
        raise NoGyroscope
    raise UnknownColumns(list=", ".join(column.name for column in columns)[:200])


def _choose_stamp(layout: TextLayout) -> tuple[int | None, int, int]:
    """Place, kind and power of ten to microseconds of the stamp column."""
    places = [k for k, column in enumerate(layout.columns) if column.channel == "time"]
    places.sort(key=lambda k: layout.columns[k].unit is None)
    for place in places:
        fields = [row[place] for row in layout.sample_rows if len(row) > place]
        if all(CALENDAR.fullmatch(field) for field in fields):
            return place, CALENDAR_TIME, 0
        unit = layout.columns[place].unit
        exponent = TIME_UNITS_EXPONENT[unit] if unit else guess_time_exponent(fields, layout.decimal)
        if exponent is not None and _are_numbers(fields, layout.decimal):
            return place, NUMERIC_TIME, exponent
    return None, COUNTER, 0


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


def _are_numbers(fields: Sequence[str], decimal: str) -> bool:
    try:
        [float(field.replace(decimal, ".")) for field in fields if field]
    except ValueError:
        return False
    return any(fields)


def guess_time_exponent(fields: Sequence[str], decimal: str) -> int | None:
    """The unit by which the rows would come at 8 to 2000 Hz; None where none does.

    The candidates (s, ms, us, ns) lie a factor of 1000 apart and the rates span 250: at most one fits.
    """
    if not _are_numbers(fields, decimal):
        return None
    values = [float(field.replace(decimal, ".")) for field in fields if field]
    steps = [after - before for before, after in pairwise(values)]
    if not steps:
        return None
    # mean of the advancing steps: coarse stamps repeat
    step = median(steps) or sum(max(0.0, s) for s in steps) / len(steps)
    for exponent in (6, 3, 0, -3):
        if step > 0 and PLAUSIBLE_RATE_HZ[0] <= 1e6 / (step * 10.0**exponent) <= PLAUSIBLE_RATE_HZ[1]:
            return exponent
    return None


def wrap_us(plan: TablePlan) -> int:
    """Where a 32-bit counter of micros() or millis() starts over, in microseconds; 0 for other stamps."""
    if plan.stamp_kind != NUMERIC_TIME or plan.stamp_exponent not in (0, 3):
        return 0
    return int(2**COUNTER_BITS * 10**plan.stamp_exponent)
