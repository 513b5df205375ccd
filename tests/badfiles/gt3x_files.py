"""Bad `.gt3x` files: container (A), records (B), info.txt and time (C)."""

import io
import struct
import warnings
import zipfile
from collections.abc import Callable, Iterable, Mapping
from functools import cache

import numpy as np

from tests.badfiles.arm import Matrix, minute
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, count_utc, record, schema, ssp

SECONDS = range(60)
YEAR_S = 366 * 86_400
ACC_DIVISOR, GYR_DIVISOR = 2048.0, 16.384


def rows_of(acc_g: Matrix, gyr_dps: Matrix) -> bytes:
    """Rows of 21 bytes as a Link writes them."""
    table = np.zeros(len(acc_g), np.dtype([("a", ">i2", 3), ("t", ">i2"), ("g", ">i2", 3), ("m", "V7")]))
    table["a"] = np.clip(np.rint(acc_g * ACC_DIVISOR), -32768, 32767)
    table["g"] = np.clip(np.rint(gyr_dps * GYR_DIVISOR), -32768, 32767)
    return table.tobytes()


@cache
def second(number: int, stamp: int | None = None, n_rows: int = 100, schema_id: int = 1) -> bytes:
    """The record of one second of the minute; ``n_rows`` other than 100 drops or repeats the last row."""
    acc_g, gyr_dps = minute()
    places = np.minimum(np.arange(n_rows), 99) + 100 * (number % 60)
    payload = struct.pack("<H", schema_id) + rows_of(acc_g[places], gyr_dps[places])
    return record(25, T0 + (number if stamp is None else stamp), payload)


def seconds(numbers: Iterable[int] = SECONDS) -> bytes:
    return b"".join(second(number) for number in numbers)


SCHEMA = record(24, T0, schema())
LOG = SCHEMA + seconds()


def pack(log: bytes, info: str | bytes = INFO, compression: int = zipfile.ZIP_STORED) -> bytes:
    return archive({"log.bin": log, "info.txt": info}, compression)


def damaged(number: int, offset: int, values: bytes) -> Callable[[], bytes]:
    """Bytes overwritten, from an offset in the record of a second on."""
    at = start_of(number) + offset
    return lambda: pack(LOG[:at] + values + LOG[at + len(values) :])


def later(first: int, shift_s: int) -> bytes:
    """Return the log with the stamps of a second and all after it moved."""
    return pack(
        SCHEMA + seconds(range(first)) + b"".join(second(k, stamp=k + shift_s) for k in range(first, 60))
    )


def archive(members: Mapping[str, bytes | str], compression: int = zipfile.ZIP_STORED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression, compresslevel=1) as zipped:
        for name, content in members.items():
            zipped.writestr(name, content)
    return file.getvalue()


def spoil(content: bytes, at: int, *values: int) -> bytes:
    return content[:at] + bytes(values) + content[at + len(values) :]


def start_of(number: int) -> int:
    return LOG.index(second(number))


def doubled_log() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as zipped, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name, content in (("log.bin", LOG), ("log.bin", b""), ("info.txt", INFO.encode())):
            zipped.writestr(name, content)
    return file.getvalue()


def with_member(name: str, link: bool = False) -> bytes:
    file = io.BytesIO(pack(LOG))
    member = zipfile.ZipInfo(name)
    member.filename = name
    member.external_attr = (0o120777 if link else 0o644) << 16
    with zipfile.ZipFile(file, "a") as zipped:
        zipped.writestr(member, b"x")
    return file.getvalue()


def lying_index() -> bytes:
    """The index says 1000 bytes where the member unpacks to many more."""
    content = bytearray(pack(LOG, compression=zipfile.ZIP_DEFLATED))
    index = content.index(b"PK\x01\x02")
    struct.pack_into("<I", content, index + 24, 1000)
    return bytes(content)


def encrypted() -> bytes:
    content = bytearray(pack(LOG))
    content[content.index(b"PK\x01\x02") + 8] |= 1
    content[6] |= 1
    return bytes(content)


def replaced(number: int, instead: bytes) -> Callable[[], bytes]:
    return lambda: pack(LOG.replace(second(number), instead))


def wrong_checksum_in_sleep() -> bytes:
    """The last record of an idle sleep is damaged and its stamp must not count."""
    asleep = record(3, T0 + 20, b"\x08") + spoil(record(2, T0 + 5000, b"\0\0"), 10, 0xEE)
    return pack(SCHEMA + seconds(range(20)) + asleep + record(3, T0 + 30, b"\x09") + seconds(range(30, 60)))


def three_days() -> bytes:
    """Twenty seconds, 22 hours of nothing, twenty seconds, and again."""
    return pack(SCHEMA + b"".join(second(k % 20, stamp=k + k // 20 * 22 * 3600) for k in SECONDS))


def never_set(first_unix_s: int) -> Callable[[], bytes]:
    stamps = {k: first_unix_s - T0 + k for k in SECONDS}
    return lambda: pack(SCHEMA + b"".join(second(k, stamp=stamps[k]) for k in SECONDS))


def over_a_change(change_unix_s: int) -> bytes:
    """A file that counts UTC, whose zone changes its clocks after thirty seconds."""
    return pack(count_utc(T0) + b"".join(second(k, stamp=change_unix_s - 30 - T0 + k) for k in SECONDS))


def asleep(first: int, stop: int, *, leaves: bool = True) -> Callable[[], bytes]:
    """Idle sleep from one second to another, with no samples in between."""

    def make() -> bytes:
        log = SCHEMA + seconds(range(first)) + record(3, T0 + first, b"\x08")
        if not leaves:
            return pack(log + record(2, T0 + stop, b"\x68\x10"))
        return pack(log + record(3, T0 + stop, b"\x09") + seconds(range(stop, 60)))

    return make


def many_records(kind: int, payload: bytes, count: int) -> bytes:
    return pack(SCHEMA + record(kind, T0, payload) * count + seconds(), compression=zipfile.ZIP_DEFLATED)


def schema_changed() -> bytes:
    """From second 30 on the same readings are written with another schema id."""
    later = b"".join(second(k, schema_id=2) for k in range(30, 60))
    return pack(SCHEMA + seconds(range(30)) + record(24, T0 + 30, schema(schema_id=2)) + later)


def strange_column() -> bytes:
    """A column of 8 bits that nobody knows stands where padding was."""
    content = bytearray(schema())
    content[-16:] = b"Barometer       "
    return pack(record(24, T0, bytes(content)) + seconds())


def primary(number: int, acc_g: float) -> bytes:
    """A second of the primary accelerometer, 100 rows of int16 at 256 per g."""
    turned, _ = minute()
    rows = turned[100 * number : 100 * number + 100] * acc_g
    return record(26, T0 + number, np.rint(rows * 256).astype("<i2").tobytes())


def with_primary(acc_g: float = 1.0) -> bytes:
    return SCHEMA + b"".join(primary(k, acc_g) + second(k) for k in SECONDS)


def with_info(info: str | bytes, log: bytes = LOG) -> Callable[[], bytes]:
    return lambda: pack(log, info)


def eight_bits() -> bytes:
    """The accelerometer in 8 bits of 1/16 g, the gyroscope in 16: read as the schema says."""
    columns = b""
    for channel, base, bits, divisor in (("Accelerometer", 0, 8, 16.0), ("Gyroscope", 24, 16, GYR_DIVISOR)):
        for axis, letter in enumerate("XYZ"):
            label = f"{channel} {letter}".ljust(16).encode()
            columns += struct.pack("<3BI", 3, base + bits * axis, bits, ssp(divisor)) + label
    acc_g, gyr_dps = minute()
    table = np.zeros(len(acc_g), np.dtype([("a", "i1", 3), ("g", ">i2", 3)]))
    table["a"], table["g"] = np.rint(acc_g * 16), np.rint(gyr_dps * GYR_DIVISOR)
    data = b"".join(
        record(25, T0 + k, struct.pack("<H", 1) + table[100 * k : 100 * k + 100].tobytes()) for k in SECONDS
    )
    return pack(record(24, T0, struct.pack("<3H", 1, 6, 0) + columns) + data)
