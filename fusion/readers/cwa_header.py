"""The header of a `.cwa`: which device it is, and when it was to stop. Names of people in it are not read."""

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fusion.readers.timing import hash_serial

HEADER_BYTES = 1024
MAGIC = b"MD\xfc\x03"
AX6 = 0x64
_FIELDS = struct.Struct("<4xBHIHII")  # hardware, device id, session, upper half of the id, start, stop
_UNSET = 0xFFFF
FIRST_YEAR = 2000


@dataclass(frozen=True, slots=True)
class DeviceHeader:
    """What the header tells; nothing where it is lost. ``planned_end_s``: Unix seconds, None for no plan."""

    is_ax6: bool = False
    device_id: int = 0
    session: int = 0
    planned_end_s: int | None = None

    @property
    def serial_hash(self) -> str | None:
        """SHA-256 of the device's number, first 12 hexadecimal digits."""
        return hash_serial(str(self.device_id)) if self.device_id else None


def parse_header(head: bytes) -> DeviceHeader:
    """Read the header at the beginning of a file."""
    if not head.startswith(MAGIC) or len(head) < HEADER_BYTES:
        return DeviceHeader()
    hardware, lower, session, upper, _, stop = _FIELDS.unpack_from(head)
    device_id = lower | (0 if upper == _UNSET else upper << 16)
    planned_s = int(unpack_stamps(np.array([stop], np.uint32))[0])
    return DeviceHeader(hardware == AX6, device_id, session, planned_s if planned_s >= 0 else None)


def unpack_stamps(packed: NDArray[np.uint32]) -> NDArray[np.int64]:
    """Unix seconds of the device's own clock from its packed dates; -1 where they are none.

    From the highest bit: six of years since 2000, four of the month, five of the day, five of the hour, six
    of the minute, six of the second.
    """
    fields = [(packed >> shift) & ((1 << bits) - 1) for shift, bits in _STAMP_FIELDS]
    years, months, days, hours, minutes, seconds = (field.astype(np.int64) for field in fields)
    month = ((years + FIRST_YEAR - 1970) * 12 + months - 1).astype("datetime64[M]")
    date = month.astype("datetime64[D]") + (days - 1)
    is_date = (months >= 1) & (months <= 12) & (days >= 1) & (date.astype("datetime64[M]") == month)
    is_time = (hours < 24) & (minutes < 60) & (seconds < 60)
    unix_s = date.astype(np.int64) * 86_400 + hours * 3600 + minutes * 60 + seconds
    return np.where(is_date & is_time, unix_s, -1)


_STAMP_FIELDS = ((26, 6), (22, 4), (17, 5), (12, 5), (6, 6), (0, 6))
