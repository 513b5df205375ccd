"""The device's clock: whether it was set, its offset from UTC, its zone, the drift of its rate."""

import hashlib
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from functools import cache
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError, available_timezones

from acromion.fusion.caveats import Caveat
from acromion.fusion.clocks import (
    correct_start,
    find_time_zone,
    format_clock_offset,
    is_clock_set,
    list_zone_changes,
    measure_us,
    read_clock,
)
from acromion.fusion.recording import MICROSECONDS, QualityFlag, Recording

# Zones: the offset at the first sample, and whether it changes before the last.
#
# Without a stated zone, only a file that counts UTC and names its zone is converted to that zone; a device's
# own wall clock never is. For other files the zones of the world decide whether a step of the clock can be
# daylight saving.

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


def set_clock(
    recording: Recording, time_zone: str = "", clock_offset_s: float = 0.0, origin: datetime | None = None
) -> Recording:
    """Return the recording by the clock that a person states (:func:`acromion.fusion.clocks.correct_start`).

    ``origin``: the device's clock at the first sample of the recording that a shift was cut from. A device
    does not follow a change of the zone, so the statement is about its start.

    Samples and durations do not change. A second call with the same statements changes nothing. Adds
    W-CLOCK-SET for a correction, and W-DST for each change of the zone.
    """
    time_zone, shift_s = time_zone or recording.time_zone or "", clock_offset_s - recording.clock_offset_s
    if time_zone == (recording.time_zone or "") and not shift_s:
        return recording
    start = correct_start(origin or recording.start, time_zone, shift_s)
    if start is None:
        return recording
    if origin is not None and recording.start is not None:
        start = read_clock(start, measure_us(origin, recording.start))
    flags = recording.flags
    if find_time_zone(time_zone):
        flags = tuple(flag for flag in flags if flag.code not in {Caveat.TZ, Caveat.UTC})
    if all(flag.code != Caveat.DST for flag in flags):  # the reader has not found the change in the rows
        flags += flag_zone_changes(start, recording.duration_us, zone=time_zone)
    if clock_offset_s:
        flags += (QualityFlag(Caveat.CLOCK_SET, facts={"offset": format_clock_offset(clock_offset_s)}),)
    return replace(
        recording, start=start, time_zone=time_zone or None, flags=flags, clock_offset_s=clock_offset_s
    )


def flag_zone_changes(start: datetime, duration_us: int, **facts: str) -> tuple[QualityFlag, ...]:
    """Flag each change of the zone during the recording (W-DST)."""
    return tuple(
        QualityFlag(Caveat.DST, 1, 0.0, at_s, at_s, {"step_s": step_s, **facts})
        for at_s, step_s in list_zone_changes(start, duration_us)
    )


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


DAY_US = 86_400 * MICROSECONDS
LARGEST_DRIFT = 0.005
"""A rate further than this from the nominal one, as a share of it, is flagged."""


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


def flag_days(recording: Recording) -> Recording:
    """Flag a recording that spans more than a day, once (W-MULTIDAY, in days)."""
    flags = tuple(flag for flag in recording.flags if flag.code != Caveat.MULTIDAY)
    if recording.duration_us > DAY_US:
        flags += (QualityFlag(Caveat.MULTIDAY, -(-recording.duration_us // DAY_US)),)
    return replace(recording, flags=flags)
