"""Writing small `.gt3x` files byte by byte, independently of the simulator and of the reader."""

import io
import struct
import zipfile
from collections.abc import Sequence

import numpy as np

from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording

T0 = 1_772_438_400
"""2026-03-02 08:00:00, device clock."""
TORONTO = "(UTC-05:00) Eastern Time (US & Canada)"
INFO = (
    "Serial Number: TAS1E00000001\r\nDevice Type: Link\r\nFirmware: 1.7.2\r\nSample Rate: 100\r\n"
    "TimeZone: -05:00:00\r\nStop Date: 0\r\nUnexpected Resets: 0\r\n"
)


def record(kind: int, unix_s: int, payload: bytes) -> bytes:
    frame = struct.pack("<BBIH", 0x1E, kind, unix_s, len(payload)) + payload
    return frame + bytes([~np.bitwise_xor.reduce(np.frombuffer(frame, np.uint8))])


def ssp(value: float) -> int:
    mantissa, exponent = np.frexp(value)
    return (int(exponent) & 0xFF) << 24 | (round(float(mantissa) * 2**23) & 0xFFFFFF)


def schema(acc_divisor: float = 2048.0, schema_id: int = 1) -> bytes:
    columns = []
    for channel, offset, divisor in (("Accelerometer", 0, acc_divisor), ("Gyroscope", 64, 16.384)):
        for axis, letter in enumerate("XYZ"):
            label = f"{channel} {letter}".ljust(16).encode()
            columns.append(struct.pack("<3BI", 3, offset + 16 * axis, 16, ssp(divisor)) + label)
    columns.append(struct.pack("<3BI", 0, 160, 8, 0) + b" " * 16)
    return struct.pack("<3H", schema_id, len(columns), 0) + b"".join(columns)


def rows(n_rows: int, second: int = 0) -> bytes:
    """`n_rows` rows of 21 bytes: 1 g on z within two counts, and a rate that numbers the second.

    The other channels tremble by a count, as a living sensor's do.
    """
    table = np.zeros(n_rows, np.dtype([("acc", ">i2", 3), ("t", ">i2"), ("gyr", ">i2", 3), ("rest", "V7")]))
    table["acc"][:, 2] = 2048 + (np.arange(n_rows) % 3)
    table["acc"][:, 0], table["acc"][:, 1] = np.arange(n_rows) % 2, np.arange(n_rows) // 2 % 2
    table["gyr"][:, 0] = second % 1000 + 1
    table["gyr"][:, 1], table["gyr"][:, 2] = np.arange(n_rows) % 2, np.arange(n_rows) // 2 % 2
    return table.tobytes()


def second(unix_s: int, n_rows: int = 100, schema_id: int = 1) -> bytes:
    return record(25, unix_s, struct.pack("<H", schema_id) + rows(n_rows, unix_s - T0))


def log_of(seconds: Sequence[int], n_rows: int = 100) -> bytes:
    """A schema and one SENSOR_DATA record for each second."""
    return record(24, T0, schema()) + b"".join(second(T0 + s, n_rows) for s in seconds)


def count_utc(first_unix_s: int, zone: str = TORONTO) -> bytes:
    """The schema and the metadata of a CentrePoint file: its stamps count UTC, and it names its zone."""
    metadata = f'{{"MetadataType":"LocalTimeLog","UsedUtc":true,"UtcOffset":"-05:00:00","Name":"{zone}"}}'
    return record(24, first_unix_s, schema()) + record(6, first_unix_s, metadata.encode())


def pack(log: bytes, info: str | bytes = INFO, compression: int = zipfile.ZIP_STORED) -> io.BytesIO:
    """Pack a device's file, to the same bytes whenever: the members carry no time of day."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        archive.writestr(zipfile.ZipInfo("log.bin"), log, compression)
        archive.writestr(zipfile.ZipInfo("info.txt"), info, compression)
    file.seek(0)
    return file


def read_log(log: bytes) -> Recording:
    """Read a log.bin with an ordinary info.txt."""
    return read_recording(pack(log))
