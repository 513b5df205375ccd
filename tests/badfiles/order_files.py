"""Tables whose rows stand in another order than they were measured, or bear a strange stamp."""

from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta

import numpy as np

from tests.badfiles.table_files import ACTILIFE, ACTILIFE_COLUMNS, MICROS, NAMES, calendar, stamped, values
from tests.fusion.readers.tables.table_builder import HEADER

CALENDAR = "timestamp," + NAMES
BOOTED_US = 4_000_000_000
"""What a counter since power-on reads at the first row, when the logger has run for a while."""
PASTED = (*range(2000), *range(3000, 4500), *range(2000, 3000), *range(4500, 6000))
"""Twenty seconds, then two pieces that changed places, then the rest."""
STRAY = range(3000, 3050)
"""Half a second whose stamps are wrong."""


def ordered(rows: Iterable[int], stamps: Sequence[object] = MICROS, header: str = HEADER) -> str:
    """The minute with its rows in another order."""
    readings, rows = values(), list(rows)
    return stamped([stamps[k] for k in rows], [readings[k] for k in rows], header)


def wall_clock(pattern: str = "%Y-%m-%dT%H:%M:%S.%f", digits: int = 23) -> list[str]:
    return [stamp[:digits] for stamp in calendar(pattern)]


def pasted_actilife(rows: Iterable[int]) -> str:
    head = ACTILIFE.format(order="M/d/yyyy", date="3/14/2026", epoch="00:00:00")
    return head + ordered(rows, [stamp + "0000" for stamp in wall_clock()], "Timestamp," + ACTILIFE_COLUMNS)


def stray(stamps: Sequence[object], rows: Iterable[int] = range(6000)) -> str:
    """A counter since power-on that shows something else for half a second."""
    told: list[object] = [BOOTED_US + 10_000 * k for k in range(6000)]
    told[STRAY.start : STRAY.stop] = stamps
    return ordered(rows, told)


def stray_dates(first: datetime, step_ms: int) -> str:
    """A wall clock that shows another time for half a second."""
    told = wall_clock()
    for k in STRAY:
        moment = first + timedelta(milliseconds=step_ms * (k - STRAY.start))
        told[k] = moment.isoformat(timespec="milliseconds")
    return ordered(range(6000), told, CALENDAR)


def short_counter(bits: int, unit: str, tick_us: int, first_us: int = 1_000_000) -> str:
    """A counter of fewer than 32 bits, which starts over on the way."""
    stamps = [(first_us + 10_000 * k) // tick_us % 2**bits for k in range(6000)]
    return ordered(range(6000), stamps, f"time_{unit}," + NAMES)


def thinned(first: int, stop: int, keep_every: int) -> list[int]:
    """All rows but those between the kept ones of a stretch."""
    return [*range(first), *range(first, stop, keep_every), *range(stop, 6000)]


def thinned_at_random(first: int, stop: int) -> list[int]:
    """Two rows of five of a stretch are lost, nobody knows which."""
    lost = np.random.default_rng(3).random(stop - first) < 0.4
    return [*range(first), *(np.flatnonzero(~lost) + first).tolist(), *range(stop, 6000)]


def paused(hours: int) -> str:
    """Bare times of day, and a pause in the middle."""
    first = datetime(2026, 3, 14, 18, 0)  # noqa: DTZ001 - a device's own clock
    moments = [first + timedelta(milliseconds=10 * k, hours=hours if k >= 3000 else 0) for k in range(6000)]
    return ordered(range(6000), [f"{moment:%H:%M:%S.%f}"[:-3] for moment in moments], CALENDAR)


def lost_at_change(first: str, step_h: int, lost_s: int) -> str:
    """A wall clock that follows daylight saving, and some seconds without rows as it is changed."""
    begun = datetime.fromisoformat(first)
    later = timedelta(hours=step_h, seconds=lost_s)
    moments = [begun + timedelta(milliseconds=10 * k) + later * (k >= 3000) for k in range(6000)]
    return ordered(range(6000), [moment.isoformat(timespec="milliseconds") for moment in moments], CALENDAR)


def preambled(line: str) -> str:
    return f"# {line}\n" + ordered(range(6000), wall_clock(), CALENDAR)
