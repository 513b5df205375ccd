"""Clock times: a stated time zone, a stated correction of the clock, and the changes of a zone.

A zone is used only to print a clock time and to place a stated one. Samples and durations never change.
"""

import re
from dataclasses import dataclass
from datetime import MAXYEAR, MINYEAR, UTC, datetime, timedelta, timezone, tzinfo
from difflib import get_close_matches
from functools import cache
from zoneinfo import ZoneInfo, available_timezones

from acromion.fusion.errors import UnusableClock, UnusableShift

ZONE_HINT = "Europe/Paris, America/Toronto, UTC-05:00"
OFFSET_HINT = "-1h02m, -1:02:00, -3720 (s), >= 100 h: 4d4h"
MOST_HOURS = 100
"""A correction of so many hours must be written in days: "1000:00:00" is a slip for "10:00:00"."""
FIRST_PLAUSIBLE_YEAR = 2008
LAST_PLAUSIBLE_YEAR = 2060
DAY_US = 86_400_000_000

_COLONS = re.compile(r"(\d+):([0-5]\d)(?::([0-5]\d(?:\.\d+)?))?")
_UNITS = re.compile(
    r"(?:(\d+) ?[dj])? ?(?:(\d+) ?h)? ?(?:(\d+)(?: ?(?:min|m)|(?(2)$|(?!))))? ?(?:(\d+(?:\.\d+)?) ?s)?",
    re.IGNORECASE,
)
"""Days, hours, minutes and seconds; after hours, minutes need no unit: ``1h02``."""
_UNIT_S = (86_400, 3600, 60, 1)
_HOURS_EAST = re.compile(r"(?:GMT|UTC)? ?([-+](?:0?[0-9]|1[0-4]))(?::?00)?", re.IGNORECASE)
"""``GMT+1`` as people write it; the database's ``Etc/GMT+1`` is an hour west."""


@cache
def _name_zones() -> dict[str, str]:
    """Return the zones that this machine knows, by their name in lower case.

    Abbreviations are not included: EST is a fixed offset in the database, and people mean Toronto by it.
    """
    return {name.casefold(): name for name in sorted(available_timezones()) if "/" in name}


@cache
def find_time_zone(name: str | None) -> tzinfo | None:
    """Return the zone of a place (``Europe/Paris``) or of an offset (``UTC-05:00``); None if unknown."""
    text = (name or "").strip()
    offset_s = parse_offset_s(text.removeprefix("UTC")) if text != "UTC" else 0
    if offset_s is not None and offset_s % 60 == 0:
        return timezone(timedelta(seconds=offset_s)) if offset_s else UTC
    known = _name_zones().get(text.casefold())
    return ZoneInfo(known) if known else None


def parse_time_zone(text: str) -> str:
    """Return the name of a stated zone as the database spells it; "" for an empty text.

    Raises ValueError with the nearest names, or with examples.
    """
    zone = find_time_zone(text)
    if not text.strip():
        return ""
    if zone is None:
        if found := _HOURS_EAST.fullmatch(text.strip()):
            raise ValueError(format_offset(int(found[1]) * 3600))
        word = text.strip().casefold().replace(" ", "_")
        names = {name: zone for name, zone in _name_zones().items() if not zone.startswith("Etc/")}
        cities = {name.rpartition("/")[2]: name for name in sorted(names, key=len, reverse=True)}
        near = [names[cities[one]] for one in get_close_matches(word, cities, 1, 0.8) if len(word) > 3]
        near = near or [names[one] for one in get_close_matches(word, names, 2, 0.75)]
        raise ValueError(", ".join(near) or ZONE_HINT)
    if isinstance(zone, ZoneInfo):
        return zone.key
    return format_offset(round((zone.utcoffset(None) or timedelta()).total_seconds()))


def parse_offset_s(text: str) -> int | None:
    """Seconds east of UTC from `-05:00:00` or `02:00:00`; None if it is not an offset."""
    found = re.fullmatch(r"([-+]?)(\d{1,2}):(\d{2})(?::(\d{2}))?", text.strip())
    if found is None:
        return None
    sign, hours, minutes, seconds = found.groups()
    offset_s = int(hours) * 3600 + int(minutes) * 60 + int(seconds or 0)
    if offset_s > 14 * 3600:
        return None
    return -offset_s if sign == "-" else offset_s


def format_offset(offset_s: int) -> str:
    """Seconds east of UTC as `UTC-05:00`."""
    sign = "-" if offset_s < 0 else "+"
    hours, minutes = divmod(abs(offset_s) // 60, 60)
    return f"UTC{sign}{hours:02d}:{minutes:02d}"


def parse_clock_offset(text: str) -> float:
    """Return the seconds to add to a device's clock: ``-1h02m``, ``-1:02:00``, ``-1:02`` (h:min), ``-3720``.

    From 100 h, days must be written (``4d4h``): a clock can be wrong by years, but "1000:00:00" is a slip.

    Raises ValueError.
    """
    plain = text.strip().replace("\u2212", "-").replace("\u202f", " ").replace("\u00a0", " ")
    sign = -1.0 if plain.startswith("-") else 1.0
    plain = plain[1:].strip() if plain[:1] in {"+", "-"} else plain
    parts: tuple[str | None, ...] = (None, None, None, plain)
    if not re.fullmatch(r"\d+(?:\.\d+)?", plain):
        found = _COLONS.fullmatch(plain)
        parts = (None, *found.groups()) if found else getattr(_UNITS.fullmatch(plain), "groups", tuple)()
    offset_s = sum(float(part or 0) * unit_s for part, unit_s in zip(parts, _UNIT_S, strict=False))
    if not any(parts) or (not parts[0] and offset_s >= MOST_HOURS * 3600):
        raise ValueError(OFFSET_HINT)
    return sign * offset_s


def format_clock_offset(offset_s: float) -> str:
    """Format a correction as ``-1:02:00`` (h:min:s), from 100 h with days; "" for none.

    :func:`parse_clock_offset` reads it.
    """
    if not offset_s:
        return ""
    minutes, seconds = divmod(round(abs(offset_s), 3), 60)
    fraction = f"{seconds % 1:.3f}".lstrip("0").rstrip("0").rstrip(".")
    sign = "-" if offset_s < 0 else "+"
    hours, rest = divmod(int(minutes), 60)
    if hours >= MOST_HOURS:
        return f"{sign}{hours // 24}d{hours % 24}h{rest}m{int(seconds)}{fraction}s"
    return f"{sign}{hours}:{rest:02d}:{int(seconds):02d}{fraction}"


def is_clock_set(start: datetime) -> bool:
    """Return whether the year is plausible for a recording, so the clock was set."""
    return FIRST_PLAUSIBLE_YEAR <= start.year <= LAST_PLAUSIBLE_YEAR


def read_clock(start: datetime, elapsed_us: int) -> datetime:
    """Return the clock time after a true elapsed time since ``start``, across the changes of its zone."""
    elapsed = timedelta(microseconds=elapsed_us)
    if start.tzinfo is None:
        return start + elapsed
    return (start.astimezone(UTC) + elapsed).astimezone(start.tzinfo)


def measure_us(first: datetime, second: datetime) -> int:
    """Return the true time from one clock time to another, in microseconds.

    Python subtracts two times of one zone by their readings, which a change of the zone makes wrong. If only
    one of them states its offset from UTC, both are taken as readings of the same clock.
    """
    if first.tzinfo is None or second.tzinfo is None:
        first, second = first.replace(tzinfo=None), second.replace(tzinfo=None)
    else:
        first, second = first.astimezone(UTC), second.astimezone(UTC)
    return (second - first) // timedelta(microseconds=1)


def find_instants(moment: datetime, zone: tzinfo) -> tuple[datetime, ...]:
    """Return when the clocks of a zone show a naive time: once, twice in autumn, never in spring."""
    instants = {moment.replace(tzinfo=zone, fold=fold).astimezone(UTC) for fold in (0, 1)}
    shown = (one.astimezone(zone) for one in sorted(instants))
    return tuple(one for one in shown if one.replace(tzinfo=None, fold=0) == moment.replace(fold=0))


def is_repeated(moment: datetime) -> bool:
    """Return whether the zone of a time shows it twice, because its clocks are set back."""
    zone = moment.tzinfo
    return zone is not None and len(find_instants(moment.replace(tzinfo=None), zone)) > 1


def in_zone(start: datetime | None, time_zone: str | None) -> datetime | None:
    """Return a stored start with its zone, so that times after it follow the changes of the zone.

    A start without an offset from UTC, or a zone without a known name, leaves it unchanged.
    """
    zone = find_time_zone(time_zone)
    return start.astimezone(zone) if start and start.tzinfo and zone else start


def correct_start(
    start: datetime | None, time_zone: str = "", clock_offset_s: float = 0.0
) -> datetime | None:
    """Return the start by the clock that a person states: first corrected, then in the zone.

    A start without an offset from UTC is local time of the zone; one with an offset is converted. A file
    without a clock stays without one.

    Raises UnusableClock: there is no clock to correct, or the corrected one shows an implausible year, or a
    time that the zone has twice or never.
    """
    if start is None:
        if clock_offset_s:
            raise UnusableClock(why="unset", cure="unset")
        return None
    shown = f"{start:%Y-%m-%d %H:%M:%S}"
    try:
        start = read_clock(start, round(clock_offset_s * 1e6))
    except OverflowError:
        raise UnusableClock(why="year", cure="year", value=shown) from None
    if clock_offset_s and not is_clock_set(start):
        raise UnusableClock(why="year", cure="year", value=shown)
    zone = find_time_zone(time_zone)
    if zone is None or start.tzinfo is not None:
        return in_zone(start, time_zone)
    instants = find_instants(start, zone)
    if len(instants) != 1:
        why = "twice" if instants else "never"
        raise UnusableClock(why=why, cure="offset zone", value=f"{start:%Y-%m-%d %H:%M:%S}", zone=time_zone)
    return instants[0]


def list_zone_changes(start: datetime | None, duration_us: int) -> list[tuple[float, int]]:
    """Return each change of the zone's offset from UTC: seconds from the first sample, and its step in s."""
    if start is None or start.tzinfo is None:
        return []

    def read_offset(at_us: int) -> timedelta:
        return read_clock(start, at_us).utcoffset() or timedelta()

    changes = []
    for first_us in range(0, duration_us, DAY_US):
        low_us, high_us = first_us, min(first_us + DAY_US, duration_us)
        before, after = read_offset(low_us), read_offset(high_us)
        if before == after:
            continue
        while high_us - low_us > 1:  # halve the day until the moment of the change is found
            middle_us = (low_us + high_us) // 2
            is_before = read_offset(middle_us) == before
            low_us, high_us = (middle_us, high_us) if is_before else (low_us, middle_us)
        changes.append((high_us / 1e6, round((after - before).total_seconds())))
    return changes


# A window of clock time, such as one shift of a week.

INTERVAL_HINT = "2026-03-02T07:00/2026-03-02T15:30"


@dataclass(frozen=True, slots=True)
class ShiftWindow:
    """A window of clock time.

    ``start``, ``end``: without an offset from UTC, they are on the recording's clock. Their years are within
    2 to 9998, so that any zone can be applied.
    """

    start: datetime
    end: datetime

    def __post_init__(self) -> None:
        """Raise ValueError if the window is empty, or outside of these years."""
        is_mixed = (self.start.tzinfo is None) is not (self.end.tzinfo is None)
        if is_mixed or not MINYEAR < self.start.year <= self.end.year < MAXYEAR:
            raise ValueError(INTERVAL_HINT)
        if measure_us(self.start, self.end) <= 0:
            raise ValueError(INTERVAL_HINT)

    def __str__(self) -> str:
        """Return the window as an interval of ISO 8601."""
        return f"{self.start.isoformat()}/{self.end.isoformat()}"

    def place(self, start: datetime) -> tuple[int, int]:
        """Return the window in microseconds from the first sample of a recording that starts at ``start``.

        Raises UnusableShift: the zone of the recording has its start or end twice or never.
        """
        first_us, stop_us = (self._place(moment, start) for moment in (self.start, self.end))
        return first_us, stop_us

    def _place(self, moment: datetime, start: datetime) -> int:
        if start.tzinfo is None or moment.tzinfo is not None:
            return measure_us(start, moment)
        instants = find_instants(moment, start.tzinfo)
        if len(instants) != 1:
            why, cure = ("twice", "shift offset") if instants else ("never", "shift never")
            raise UnusableShift(why=why, cure=cure, window=str(self), value=f"{moment:%Y-%m-%d %H:%M:%S}")
        return measure_us(start, instants[0])


def move_window(window: ShiftWindow, stated: datetime, device: datetime) -> ShiftWindow:
    """Return a window on the device's clock; ``stated``, ``device``: the first sample on both clocks."""
    return ShiftWindow(*(read_clock(device, at_us) for at_us in window.place(stated)))


def parse_interval(text: str) -> ShiftWindow:
    """Parse ``2026-03-02T07:00/2026-03-02T15:30``. Raises ValueError."""
    start, end = map(datetime.fromisoformat, text.split("/"))
    return ShiftWindow(start, end)
