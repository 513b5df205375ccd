"""One small, valid recording of each format, from which mutations start."""

import gzip
import io
import struct
import zipfile

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from acromion.fusion.recording import STANDARD_GRAVITY
from tests.fusion.made_motion import rest_and_turn
from tests.fusion.readers.cwa.cwa_builder import START_US as CWA_START_US
from tests.fusion.readers.cwa.cwa_builder import block as cwa_block
from tests.fusion.readers.cwa.cwa_builder import blocks as cwa_blocks
from tests.fusion.readers.cwa.cwa_builder import header as cwa_header
from tests.fusion.readers.device_layouts import TABLES
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, log_of, pack, record
from tests.fusion.readers.tables.table_builder import HEADER, PREAMBLE

ROWS, LAYOUT_LINES = 90, 150
TURNS, SLOW_HZ = 12, 16.0
LEFT_HANDED = np.array([-1.0, 1.0, 1.0])
LONG_ROWS = 1100
"""More rows than the readers process at a time."""
ACTILIFE_HEADER = (
    "------------ Data File Created By ActiGraph Link IMU 9DOF Sensor ActiLife v6.13.3 Firmware v1.7.2 "
    "date format M/d/yyyy at 100 Hz  -----------\nSerial Number: TAS1E00000001\nStart Time 07:00:00\n"
    "Start Date 3/2/2026\nEpoch Period (hh:mm:ss) 00:00:00\nDownload Time 15:05:01\nDownload Date 3/2/2026\n"
    "Current Memory Address: 0\nCurrent Battery Voltage: 4.12     Mode = 12\n" + 50 * "-" + "\n"
)
CHANNELS = "".join(
    f",{sensor} {axis}" for sensor in ("Accelerometer", "Gyroscope", "Magnetometer") for axis in "XYZ"
).replace(",Gyroscope X", ",Temperature,Gyroscope X")


def motion(rows: int = ROWS) -> list[list[float]]:
    """Return six channels that differ in every row, near 1 g."""
    noise = np.random.default_rng(1).normal(0.0, 0.02, (rows, 6))
    values: list[list[float]] = (noise + np.array([0.1, 0.97, 0.1, 1.0, -2.0, 3.0])).tolist()
    return values


def canonical(rows: int = ROWS) -> bytes:
    lines = (
        f"{9_990_000 + 10_000 * k}," + ",".join(f"{v:.6f}" for v in row) for k, row in enumerate(motion(rows))
    )
    return (PREAMBLE + HEADER + "\n" + "\n".join(lines) + "\n").encode()


def semicolon() -> bytes:
    rows = (f"{10 * k};" + ";".join(f"{v:.4f}" for v in row) for k, row in enumerate(motion()))
    header = "time_ms;acc_x_g;acc_y_g;acc_z_g;gyr_x_dps;gyr_y_dps;gyr_z_dps"
    return (header + "\r\n" + "\r\n".join(rows).replace(".", ",") + "\r\n").encode()


def actilife(*, has_stamps: bool) -> bytes:
    lines = []
    for k, row in enumerate(motion()):
        stamp = f"2026-03-02T07:00:{k // 100:02d}.{k % 100:02d}00000," if has_stamps else ""
        acc, gyr = (",".join(f"{v:.6f}" for v in row[a : a + 3]) for a in (0, 3))
        lines.append(f"{stamp}{acc},23.369186,{gyr},-20.800780,-48.632810,-4.394531")
    names = ("Timestamp" if has_stamps else "") + CHANNELS
    return (ACTILIFE_HEADER + names.lstrip(",") + "\n" + "\n".join(lines) + "\n").encode()


def registers() -> list[tuple[int, int, list[int]]]:
    """Return seconds, microseconds and counts of a turning LSM9DS1 (8 g, 2000 deg/s), without a unit."""
    turned = rest_and_turn(TURNS, rate_hz=SLOW_HZ)
    acc, gyr = turned.acc_g * LEFT_HANDED / 0.000244, turned.gyr_dps * LEFT_HANDED / 0.07
    counts = np.rint(np.hstack([gyr, acc])).astype(int).tolist()
    steps_us = round(1e6 / SLOW_HZ)
    return [(T0 + k * steps_us // 10**6, k * steps_us % 10**6, row) for k, row in enumerate(counts)]


def registers_binary() -> bytes:
    return b"".join(struct.pack("<2I9h", s, us, *row, 1, 2, 3) for s, us, row in registers())


def registers_text() -> bytes:
    lines = (f"{s}.{us:06d}," + ",".join(map(str, [*row, 1, 2, 3])) for s, us, row in registers())
    return ("\n".join(lines) + "\n").encode()


SI = (*[STANDARD_GRAVITY] * 3, *[np.pi / 180.0] * 3)


def packets() -> bytes:
    """Return MT Manager's export: packets are numbered, the number restarts, there is no time."""
    names = "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\n"
    rows = (
        f"{(65_500 + k) % 65_536:05d}\t\t"
        + "\t".join(f"{v * unit:.6f}" for v, unit in zip(row, SI, strict=True))
        for k, row in enumerate(motion())
    )
    return ("// Update Rate: 100.0Hz\n" + names + "\n".join(rows) + "\n").encode()


def device_log() -> bytes:
    """Return a log.bin with a sleep of three seconds and a dock event."""
    awake = log_of([*range(8), *range(11, 15)])
    return record(3, T0, b"\x08") + awake + record(26, T0 + 3, b"\0") + record(3, T0 + 12, b"\x09")


def ax6_log() -> bytes:
    """Return two sessions of the device, the second restarted after a pause, and unused space."""
    again = [cwa_block(k, CWA_START_US + 30_000_000 + 400_000 * k) for k in range(20)]
    older = [cwa_block(k, CWA_START_US - 90_000_000 + 400_000 * k, session=5) for k in range(3)]
    return cwa_header() + b"".join([*cwa_blocks(range(40)), *again, *older]) + b"\xff" * 1024


def zipped(content: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as packed:
        packed.writestr(zipfile.ZipInfo("shift.csv"), content)
    return file.getvalue()


def parquet() -> bytes:
    columns = np.array(motion(), np.float32).T
    table = {"time_us": np.arange(ROWS) * 10_000, **dict(zip(HEADER.split(",")[1:], columns, strict=True))}
    file = io.BytesIO()
    pq.write_table(pa.table(table), file, row_group_size=40)
    return file.getvalue()


def archive(log: bytes, info: bytes = INFO.encode()) -> bytes:
    return pack(log, info).getvalue()


def cut(text: str) -> str:
    return "".join(text.splitlines(keepends=True)[:LAYOUT_LINES])


def unpack(content: bytes) -> dict[str, str]:
    """Return the members of a zip of tables, each shortened."""
    with zipfile.ZipFile(io.BytesIO(content)) as packed:
        return {name: cut(packed.read(name).decode()) for name in packed.namelist()}


def pack_again(members: dict[str, str], damaged: bytes = b"", table: str = "") -> bytes:
    """Return a zip of the members, with damaged bytes in place of one table."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as packed:
        for name, text in members.items():
            packed.writestr(zipfile.ZipInfo(name), damaged if name == table else text)
    return file.getvalue()


LAYOUTS = {name: make() for name, make in TABLES.items() if name != "serial monitor"}
"""A serial monitor without units needs half a minute of motion, which is too long to damage 10,000 times."""
ARCHIVES = {name: unpack(made) for name, made in LAYOUTS.items() if isinstance(made, bytes)}
PAIRED_TABLES = {
    f"{name}, {word} in zip": (members, next(table for table in members if word in table.lower()))
    for name, members in ARCHIVES.items()
    for word in ("acc", "gyro")
}
SEEDS = {
    "gt3x": archive(device_log()),
    "gt3x log": device_log(),
    "gt3x log, checksums mended": device_log(),
    "gt3x info.txt": INFO.encode(),
    "cwa": ax6_log(),
    "cwa, checksums mended": ax6_log(),
    "ActiLife CSV with stamps": actilife(has_stamps=True),
    "ActiLife CSV without stamps": actilife(has_stamps=False),
    "LSM9DS1 CSV": canonical(),
    "LSM9DS1 CSV of several blocks": canonical(LONG_ROWS),
    "CSV with ; and decimal comma": semicolon(),
    "LSM9DS1 registers, binary": registers_binary(),
    "LSM9DS1 registers, text": registers_text(),
    "MT Manager, numbered packets": packets(),
    "CSV, gzip": canonical(),
    "CSV, gzip, packed bytes": gzip.compress(canonical(), 6, mtime=0),
    "CSV in zip": canonical(),
    "CSV in zip, packed bytes": zipped(canonical()),
    "Parquet": parquet(),
    **{name: cut(made).encode() for name, made in LAYOUTS.items() if isinstance(made, str)},
    **{name: members[table].encode() for name, (members, table) in PAIRED_TABLES.items()},
    **{f"{name}, whole zip": pack_again(members) for name, members in ARCHIVES.items()},
}


def wrap(name: str, content: bytes) -> bytes:
    """Put a mutated part back into a whole file."""
    if name.startswith("gt3x log"):
        return archive(content)
    if name == "gt3x info.txt":
        return archive(SEEDS["gt3x log"], content)
    if name in PAIRED_TABLES:
        members, table = PAIRED_TABLES[name]
        return pack_again(members, content, table)
    if name == "CSV in zip":
        return zipped(content)
    return gzip.compress(content, 1, mtime=0) if name == "CSV, gzip" else content
