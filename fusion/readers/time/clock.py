"""The device's clock: whether it was set, its offset from UTC, its zone, the drift of its rate."""

import hashlib
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta, timezone
from functools import cache
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

from fusion.caveats import Caveat
from fusion.recording import MICROSECONDS, QualityFlag, Recording

# Zones: the offset at the first sample, and whether it changes before the last.
#
# Only a file that counts UTC and names its zone is converted to that zone; a device's own wall clock never
# is. For other files the zones of the world decide whether a step of the clock can be daylight saving.

WINDOWS_ZONES = {
    "Eastern Time (US": "America/Toronto",
    "Atlantic Time (Canada)": "America/Halifax",
    "Newfoundland": "America/St_Johns",
    "Central Time (US": "America/Winnipeg",
    "Mountain Time (US": "America/Edmonton",
    "Pacific Time (US": "America/Vancouver",
    "Dublin, Edinburgh, Lisbon, London": "Europe/London",
    "Brussels, Copenhagen, Madrid, Paris": "Europe/Paris",
    "Amsterdam, Berlin, Bern, Rome, Stockholm, Vienna": "Europe/Berlin",
}
"""Parts of Windows' display names, as ActiGraph's METADATA records hold them."""


DAY, NEAR = timedelta(days=1), timedelta(seconds=2)


def find_zone(display_name: str) -> ZoneInfo | None:
    """Return the zone of a Windows display name; None if ``WINDOWS_ZONES`` does not have it."""
    keys = [key for part, key in WINDOWS_ZONES.items() if part in display_name]
    try:
        return ZoneInfo(keys[0]) if keys else None
    except ZoneInfoNotFoundError:
        return None


def follow_zone(
    first_unix_s: int, duration_s: int, zone: ZoneInfo
) -> tuple[datetime, tuple[QualityFlag, ...]]:
    """Return the start with the zone's offset then; flag a change of the offset before the end (W-DST)."""

    def read_offset(at_s: int) -> timedelta:
        moment = datetime.fromtimestamp(first_unix_s + at_s, UTC).astimezone(zone)
        return moment.utcoffset() or timedelta()

    before, after = read_offset(0), read_offset(duration_s)
    start = datetime.fromtimestamp(first_unix_s, UTC).astimezone(timezone(before))
    if before == after:
        return start, ()
    low, high = 0, duration_s
    while high - low > 1:  # halve the recording until the second of the change is found
        middle = (low + high) // 2
        low, high = (middle, high) if read_offset(middle) == before else (low, middle)
    step_s = round((after - before).total_seconds())
    return start, (QualityFlag(Caveat.DST, 1, 0.0, float(high), float(high), {"step_s": step_s}),)


@cache
def load_zones() -> tuple[ZoneInfo, ...]:
    """Return all time zones that this machine knows."""
    return tuple(ZoneInfo(name) for name in sorted(available_timezones()))


def is_change_of_offset(moment: datetime, before_s: int, after_s: int) -> bool:
    """Return whether some time zone changed between these offsets within a day of an aware ``moment``.

    The tolerance is a day because loggers apply the change when they are next connected, or at midnight.
    """
    steps = ((moment - DAY, timedelta(seconds=before_s)), (moment + DAY, timedelta(seconds=after_s)))
    return any(
        all(one.astimezone(zone).utcoffset() == offset for one, offset in steps) for zone in load_zones()
    )


def is_change_of_wall_clock(reading: datetime, step_s: int) -> bool:
    """Return whether some zone's clocks step by ``step_s`` within two seconds of this naive reading."""

    def measure_step_s(zone: ZoneInfo) -> float:
        before = (reading - NEAR).replace(tzinfo=zone).astimezone(UTC)
        offsets = [one.astimezone(zone).utcoffset() or timedelta() for one in (before, before + 2 * NEAR)]
        return (offsets[1] - offsets[0]).total_seconds()

    return any(measure_step_s(zone) == step_s for zone in load_zones())


FIRST_PLAUSIBLE_YEAR = 2008
LAST_PLAUSIBLE_YEAR = 2060
DAY_US = 86_400 * MICROSECONDS
LARGEST_DRIFT = 0.005
"""A rate further than this from the nominal one, as a share of it, is flagged."""


def is_clock_set(start: datetime) -> bool:
    """Return whether the year is plausible for a recording, so the clock was set."""
    return FIRST_PLAUSIBLE_YEAR <= start.year <= LAST_PLAUSIBLE_YEAR


def trust_clock(start: datetime | None) -> tuple[datetime | None, tuple[QualityFlag, ...]]:
    """Return the start if its year is plausible; else None and a caveat (W-CLOCK-UNSET)."""
    if start is None or is_clock_set(start):
        return start, ()
    return None, (QualityFlag(Caveat.CLOCK_UNSET),)


def datetime_at_us(unix_us: int) -> datetime | None:
    """A naive reading of microseconds since 1970; None for an impossible date."""
    try:
        return datetime.fromtimestamp(unix_us // MICROSECONDS, UTC).replace(
            microsecond=unix_us % MICROSECONDS, tzinfo=None
        )
    except (ValueError, OverflowError, OSError):
        return None


def hash_serial(serial: str) -> str | None:
    """Return 12 hexadecimal digits of a serial's SHA-256: they distinguish devices without naming one."""
    return hashlib.sha256(serial.strip().encode()).hexdigest()[:12] if serial.strip() else None


def flag_drift(nominal_hz: float, true_hz: float) -> tuple[QualityFlag, ...]:
    """Flag a rate that is more than 0.5 % off the nominal one (W-DRIFT)."""
    if nominal_hz and abs(true_hz / nominal_hz - 1.0) <= LARGEST_DRIFT:
        return ()
    return (QualityFlag(Caveat.DRIFT, facts={"nominal_hz": nominal_hz, "rate_hz": round(true_hz, 3)}),)


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


def flag_days(recording: Recording) -> Recording:
    """Flag a recording that spans more than a day, once (W-MULTIDAY, in days)."""
    flags = tuple(flag for flag in recording.flags if flag.code != Caveat.MULTIDAY)
    if recording.duration_us > DAY_US:
        flags += (QualityFlag(Caveat.MULTIDAY, -(-recording.duration_us // DAY_US)),)
    return replace(recording, flags=flags)
