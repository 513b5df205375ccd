"""Writes a `.gt3x` as a GT9X Link and ActiLife do (FORMATS.md, part 1, sections 1 to 7)."""

import itertools
import json
import struct
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import IO, Self
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np

from fusion.simulation.imu_rows import ImuSeconds, Rows
from fusion.simulation.shift import SimulatedShift

PRIMARY_RATE_HZ = 90
"""Rate of the primary accelerometer, the one that info.txt speaks of; not that of the inertial unit."""

ARCHIVE_TIME = (2026, 3, 2, 18, 0, 0)

_BATTERY, _EVENT, _METADATA, _CAPSENSE, _PARAMETERS, _SCHEMA, _SENSOR, _ACTIVITY2 = (
    2,
    3,
    6,
    13,
    21,
    24,
    25,
    26,
)

_PARAMETER_VALUES = (
    (0, 49, 0x0C400000),  # acceleration: 2048 per g
    (0, 50, 0x05418937),  # angular rate: 16.384 per deg/s
    (0, 51, 0x036D3A07),  # magnetic field: 6.8267 per uT
    (0, 57, 0x095377AE),  # temperature: 333.87 per K
    (0, 58, 0x05540000),  # temperature at zero: 21 deg C
    (1, 2, 0),  # no sleep mode
    (1, 10, PRIMARY_RATE_HZ),
    (1, 40, 0xFFFFB9B0),  # UTC offset: -18000 s
    (1, 44, 15),  # acceleration, angular rate, field and temperature are on
)

_COLUMNS = (
    *(("Accelerometer " + axis, 3, 16 * k, 16, 0x0C400000) for k, axis in enumerate("XYZ")),
    ("Temperature", 3, 48, 16, 0x095377AE),
    *(("Gyroscope " + axis, 3, 64 + 16 * k, 16, 0x05418937) for k, axis in enumerate("XYZ")),
    *(("Magnetometer " + axis, 2, 112 + 16 * k, 16, 0x036D3A07) for k, axis in enumerate("XYZ")),
    ("", 0, 160, 8, 0),
)
"""Label, flags (1 big-endian, 2 signed), first bit, bits, scale."""


class Gt3xWriter:
    """Takes seconds of rows and writes them on at once; a context manager."""

    def __init__(self, path: Path, shift: SimulatedShift) -> None:
        self._shift = shift
        self._archive = ZipFile(path, "w", ZIP_STORED)
        self._log: IO[bytes] = self._archive.open(ZipInfo("log.bin", ARCHIVE_TIME), "w", force_zip64=False)
        self._start = count_unix_s(shift.start)
        self._second = 0

    def __enter__(self) -> Self:
        self._log.write(_open_log(self._start, self._start))
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close with a second of which the inertial unit's rows are missing, as in real files."""
        if error is None and self._second:
            self._log.write(self._frame(_ACTIVITY2, self._primary))
        self._log.close()
        info = describe_device(self._shift, self._second)
        self._archive.writestr(ZipInfo("info.txt", ARCHIVE_TIME), info)
        self._archive.close()

    def write(self, seconds: ImuSeconds) -> None:
        """Write the records of each second: primary acceleration, then the inertial unit's rows."""
        for begin, end in itertools.pairwise(seconds.starts()):
            self._write_second(seconds.rows[begin:end])

    def _write_second(self, rows: Rows) -> None:
        if self._second % 60 == 0:
            self._write_state()
        self._primary = _resample_primary(rows)
        self._log.write(self._frame(_ACTIVITY2, self._primary))
        self._log.write(self._frame(_SENSOR, b"\x01\x00" + rows.tobytes()))
        self._second += 1

    def _write_state(self) -> None:
        """Battery (falls by 3 mV an hour) and wear, once a minute."""
        self._log.write(self._frame(_BATTERY, struct.pack("<H", 4150 - self._second // 1200)))
        self._log.write(self._frame(_CAPSENSE, bytes((0x3F, 0x18, 0x56, 0x18, 0x00, 0xC8))))

    def _frame(self, kind: int, payload: bytes) -> bytes:
        return frame_record(kind, self._start + self._second, payload)


def frame_record(kind: int, unix_s: int, payload: bytes) -> bytes:
    """Frame a payload: separator, type, time, size, payload, checksum."""
    body = struct.pack("<BBIH", 0x1E, kind, unix_s, len(payload)) + payload
    checksum = ~int(np.bitwise_xor.reduce(np.frombuffer(body, np.uint8))) & 0xFF
    return body + bytes((checksum,))


def describe_schema() -> bytes:
    """Payload of SENSOR_SCHEMA: id 1, 11 columns, 0 samples a record (as the device writes)."""
    columns = (
        struct.pack("<BBBI", flags, offset, bits, scale) + label.ljust(16).encode()
        for label, flags, offset, bits, scale in _COLUMNS
    )
    return struct.pack("<HHH", 1, len(_COLUMNS), 0) + b"".join(columns)


def describe_device(shift: SimulatedShift, duration_s: int) -> bytes:
    """Text of info.txt; dates are .NET ticks of the device's own clock."""
    start = count_unix_s(shift.start)
    lines = (
        f"Serial Number: {format_serial(shift.seed)}",
        "Device Type: Link",
        "Firmware: 1.7.2",
        "Battery Voltage: 4.12",
        f"Sample Rate: {PRIMARY_RATE_HZ}",
        f"Start Date: {_count_ticks(start)}",
        f"Stop Date: {_count_ticks(start + duration_s + 1)}",
        f"Last Sample Time: {_count_ticks(start + duration_s + 1)}",
        "TimeZone: -05:00:00",
        f"Download Date: {_count_ticks(start + duration_s + 301)}",
        "Board Revision: 5",
        "Unexpected Resets: 0",
        "Acceleration Scale: 256.0",
        "Acceleration Min: -8.0",
        "Acceleration Max: 8.0",
        f"Subject Name: SIM{shift.seed}",
    )
    return "".join(line + "\r\n" for line in lines).encode()


def format_serial(seed: int) -> str:
    """Give a serial number of the right form: TAS, the prefix of the GT9X Link."""
    return f"TAS1E{seed % 100_000_000:08d}"


def count_unix_s(clock: datetime) -> int:
    """Seconds since 1970 of the device's clock, taken as if it were UTC (ActiLife's habit)."""
    return int(clock.replace(tzinfo=UTC).timestamp())


def _count_ticks(unix_s: int) -> int:
    """.NET ticks: 100 ns since the year 1."""
    return unix_s * 10_000_000 + 621_355_968_000_000_000


def _open_log(start_s: int, initialised_s: int) -> bytes:
    """Give the records before the first sample."""
    zone = {
        "MetadataType": "LocalTimeLog",
        "UtcOffset": "-05:00:00",
        "Name": "(UTC-05:00) Eastern Time (US & Canada)",
    }
    owner = {"MetadataType": "InitOwner", "System": "ActiLife", "Parsed": True}
    parameters = b"".join(struct.pack("<HHI", *value) for value in _PARAMETER_VALUES)
    return b"".join(
        (
            frame_record(_EVENT, initialised_s, b"\x05\x01\x03"),
            frame_record(_METADATA, initialised_s, json.dumps(owner, separators=(",", ":")).encode()),
            frame_record(_METADATA, initialised_s, json.dumps(zone, separators=(",", ":")).encode()),
            frame_record(_PARAMETERS, initialised_s, parameters),
            frame_record(_EVENT, initialised_s, b"\x05\x01\x01"),
            frame_record(_SCHEMA, start_s, describe_schema()),
        )
    )


def _resample_primary(rows: Rows) -> bytes:
    """Give the primary accelerometer's second: 90 samples at 256 counts per g, cut at 8 g."""
    picked = rows["acc"][np.arange(PRIMARY_RATE_HZ) * len(rows) // PRIMARY_RATE_HZ]
    return np.clip(np.rint(picked / 8), -2048, 2047).astype("<i2").tobytes()
