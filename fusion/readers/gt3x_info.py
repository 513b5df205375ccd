"""info.txt and the METADATA records of a `.gt3x`: what the device says about itself."""

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, timezone

from fusion.readers.timing import hash_serial

TICKS_PER_SECOND = 10_000_000
TICKS_AT_UNIX_EPOCH = 621_355_968_000_000_000
CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")
MAX_VALUE_CHARACTERS = 200


@dataclass(frozen=True, slots=True)
class DeviceText:
    """The lines of info.txt. Values are text, stripped of control characters and cut at 200 characters."""

    values: dict[str, str] = field(default_factory=dict)
    encoding: str = "utf-8"

    def number(self, key: str) -> float | None:
        """A number with decimal point or comma, or None: `8,0` and `100 Hz` are understood."""
        found = re.match(r"\s*([-+]?\d+(?:[.,]\d+)?)", self.values.get(key, ""))
        return float(found.group(1).replace(",", ".")) if found else None

    def unix_s(self, key: str) -> float | None:
        """A .NET tick count as Unix seconds of the device's own clock; None for 0 and nonsense."""
        text = self.values.get(key, "")
        if not re.fullmatch(r"\d{1,19}", text) or int(text) == 0:
            return None
        return (int(text) - TICKS_AT_UNIX_EPOCH) / TICKS_PER_SECOND

    @property
    def serial_hash(self) -> str | None:
        """SHA-256 of the serial, first 12 hexadecimal digits: tells devices apart, names none."""
        return hash_serial(self.values.get("Serial Number", ""))

    @property
    def offset_s(self) -> int | None:
        """Seconds east of UTC."""
        return parse_offset_s(self.values.get("TimeZone", ""))


def parse_device_text(content: bytes) -> DeviceText:
    """Read `Key: value` lines: CRLF or LF, with or without a byte order mark, UTF-8 or else Windows-1252."""
    try:
        text, encoding = content.decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:
        text, encoding = content.decode("cp1252", errors="replace"), "cp1252"
    values: dict[str, str] = {}
    for line in text.splitlines():
        key, separator, value = line.partition(":")
        if separator:
            values.setdefault(key.strip(), CONTROL.sub("", value).strip()[:MAX_VALUE_CHARACTERS])
    return DeviceText(values, encoding)


def parse_offset_s(text: str) -> int | None:
    """Seconds east of UTC from `-05:00:00` or `02:00:00`; None where it is no offset."""
    found = re.fullmatch(r"([-+]?)(\d{1,2}):(\d{2})(?::(\d{2}))?", text.strip())
    if found is None:
        return None
    sign, hours, minutes, seconds = found.groups()
    offset_s = int(hours) * 3600 + int(minutes) * 60 + int(seconds or 0)
    if offset_s > 14 * 3600:
        return None
    return -offset_s if sign == "-" else offset_s


def name_offset(offset_s: int) -> str:
    """`UTC-05:00`."""
    sign = "-" if offset_s < 0 else "+"
    hours, minutes = divmod(abs(offset_s) // 60, 60)
    return f"UTC{sign}{hours:02d}:{minutes:02d}"


def tell_start(first_unix_s: int, offset_s: int | None, *, counts_utc: bool) -> datetime:
    """Give the device's clock at the first sample.

    ActiLife encodes local wall-clock time as if it were UTC; CentrePoint files (`UsedUtc`) count UTC.
    The wall-clock reading is never shifted; the offset is attached where the file tells it.
    """
    moment = datetime.fromtimestamp(first_unix_s, UTC)
    if offset_s is None:
        return moment if counts_utc else moment.replace(tzinfo=None)
    zone = timezone(timedelta(seconds=offset_s))
    return moment.astimezone(zone) if counts_utc else moment.replace(tzinfo=zone)
