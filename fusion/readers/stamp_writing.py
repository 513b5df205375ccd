"""Stamps of any dialect rewritten to the ISO form of the kernels, on the clock of the first row.

A stamp that carries an offset from UTC is an instant: where the offset changes on the way, the later stamps
are told by the first one's, so that an hour is neither lost nor won, and the change is noted.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta

from fusion.readers.date_dialects import DateDialect, parse_zone_s
from fusion.readers.date_order import DateOrder, complete_year
from fusion.readers.timing import datetime_at_us
from fusion.readers.zones import is_change_of_offset
from fusion.recording import MICROSECONDS, QualityFlag

NOON = 12
DAY_S = 86_400
LONGEST_SET_BACK_S = 3 * 3600
"""A clock is set back by no more than this (daylight saving, a zone): what goes back further is a new day."""
LATEST_S = 600
"""Rows come late by no more than this."""
FIRST_DAY = datetime(1970, 1, 2)  # noqa: DTZ001 - stands for a date that is not told
EPOCH = datetime(1970, 1, 1)  # noqa: DTZ001 - as the kernels count
MOST_CHANGES = 20


@dataclass(frozen=True, slots=True)
class OffsetChange:
    """The first stamp with another offset, microseconds since 1970 on the first row's clock, and the offsets.

    ``first_s``: that of the first row; seconds east of UTC.
    """

    at_us: int
    before_s: int
    after_s: int
    first_s: int

    @property
    def is_daylight_saving(self) -> bool:
        """Whether the clocks of some zone were changed so about then."""
        moment = datetime_at_us(self.at_us - self.first_s * MICROSECONDS)
        return moment is not None and is_change_of_offset(
            moment.replace(tzinfo=UTC), self.before_s, self.after_s
        )

    def turn_round(self) -> "OffsetChange":
        """The change as it was, in a table that stands with its newest row first."""
        return replace(self, before_s=self.after_s, after_s=self.before_s)


class StampWriter:
    """Rewrites the stamps of one table, from its first row on.

    Attributes
    ----------
    changes
        Where the offset from UTC changed.
    """

    def __init__(self, dialect: DateDialect) -> None:
        self.changes: list[OffsetChange] = []
        self._dialect = dialect
        self._offset_s = dialect.offset_s
        self._day = FIRST_DAY
        self._last_s: float | None = None
        self._way = 1

    def rewrite(self, text: str) -> str:
        """Write every stamp as `2026-03-14T08:00:00.010`; a time column of its own is left empty."""
        write = self._write if self._dialect.has_date else self._write_undated
        return self._dialect.pattern.sub(write, text)

    def _write(self, found: re.Match[str]) -> str:
        year, month, day = _sort_date(found.group("first", "second", "third"), self._dialect.order)
        clock = f"{_count_hour(found):02d}:{found['minute']}:{found['seconds']}"
        stamp = f"{year}-{month:0>2}-{day:0>2}T{clock}"
        moved = self._move(stamp, found["zone"])
        return found.group() if moved is None else moved + re.sub(r"[T \"]", "", found["between"])

    def _move(self, stamp: str, zone: str | None) -> str | None:
        """Tell a stamp by the first row's clock; None for one that no calendar has.

        A stamp without a zone among others goes by the last that was told.
        """
        offset_s = parse_zone_s(zone) if zone else self._offset_s
        if offset_s is None or self._dialect.offset_s is None:
            return None if zone else stamp
        step_s = offset_s - self._dialect.offset_s
        if step_s == 0 and offset_s == self._offset_s:
            return stamp
        try:
            moment = datetime.fromisoformat(stamp.replace(",", ".")) - timedelta(seconds=step_s)
        except (ValueError, OverflowError):
            return None
        if offset_s != self._offset_s and self._offset_s is not None:
            at_us = (moment - EPOCH) // timedelta(microseconds=1)
            self.changes.append(OffsetChange(at_us, self._offset_s, offset_s, self._dialect.offset_s))
        self._offset_s = offset_s
        return moment.isoformat(timespec="microseconds")

    def _write_undated(self, found: re.Match[str]) -> str:
        """Give a time of day the date that follows on: a step back of more than a few hours is midnight.

        A step forward is a pause, however long, unless it leads back over midnight to a row that came late.
        In a table that stands with its newest row first it is the other way round.
        """
        hour = _count_hour(found)
        time_s = 3600.0 * hour + 60.0 * int(found["minute"]) + float(found["seconds"].replace(",", "."))
        step_s = 0.0 if self._last_s is None else time_s - self._last_s
        if self._way * step_s < -LONGEST_SET_BACK_S:
            self._day += timedelta(days=self._way)
        elif self._way * step_s > DAY_S - LATEST_S:
            self._day -= timedelta(days=self._way)
        elif step_s:
            self._way = 1 if step_s > 0 else -1
        self._last_s = time_s
        stamp = f"{self._day:%Y-%m-%d}T{hour:02d}:{found['minute']}:{found['seconds']}"
        moved = self._move(stamp, found["zone"])
        return found.group() if moved is None else found["before"] + moved


def _sort_date(parts: tuple[str, ...], order: DateOrder) -> tuple[str, str, str]:
    year, month, day = (parts[order.index(letter)] for letter in "ymd")
    return str(complete_year(int(year))), month, day


def _count_hour(found: re.Match[str]) -> int:
    hour, half = int(found["hour"]), found["half"]
    if half is None:
        return hour
    return hour % NOON + (NOON if half.strip()[0] in "Pp" else 0)


def rewrite_pieces(pieces: Iterable[bytes], writer: StampWriter | None) -> Iterator[bytes]:
    """Rewrite the stamps of pieces of any length, whole lines at a time."""
    if writer is None:
        yield from pieces
        return
    carried = b""
    for piece in pieces:
        cut = piece.rfind(b"\n") + 1
        if cut:
            yield writer.rewrite((carried + piece[:cut]).decode("latin-1")).encode("latin-1")
            carried = b""
        carried += piece[cut:]
    yield writer.rewrite(carried.decode("latin-1")).encode("latin-1")


def flag_changes(changes: Iterable[OffsetChange], first_stamp_us: int) -> tuple[QualityFlag, ...]:
    """Say where the offset from UTC changed; of a clock that changes all the time, the first places.

    W-DST where the clocks of some zone were changed so about then, W-OFFSET elsewhere.
    """
    return tuple(
        QualityFlag(code, 1, 0.0, at_s, at_s, {"step_s": change.after_s - change.before_s})
        for change in list(changes)[:MOST_CHANGES]
        for code in ["W-DST" if change.is_daylight_saving else "W-OFFSET"]
        for at_s in [(change.at_us - first_stamp_us) / MICROSECONDS]
    )
