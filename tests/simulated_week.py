"""A simulated week of one sensor: a short shift on each of five days, and the same days as single files.

Before and after each shift the sensor lies on a table; between the days it is off. On the third day no pose
was held: the recording of that day starts a minute late.
"""

import struct
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zipfile import ZIP_STORED, ZipFile

import numpy as np

from acromion.fusion.simulation.files import ROW, frame_record, write_shift
from acromion.fusion.simulation.shift import simulate_shift

DAYS = tuple(datetime(2026, 3, day, 7) for day in (2, 3, 4, 5, 6))  # noqa: DTZ001  the device's clock
MINUTES = 20
TABLE_S = 120
WITHOUT_POSE = 2
SENSOR_RECORDS = (25, 26)


@dataclass(frozen=True, slots=True)
class Week:
    """The whole file, and one file for each day."""

    path: Path
    days: tuple[Path, ...]


def write_week(folder: Path, days: int = 5, minutes: int = MINUTES, first: datetime = DAYS[0]) -> Week:
    """Write the first days of the week, each with a shift of some minutes; ``first``: its first start."""
    starts = [first + timedelta(days=place) for place in range(days)]
    logs = [_simulate_day(folder / f"{place}", place, minutes, start) for place, start in enumerate(starts)]
    info = ZipFile(folder / "0" / "shift_seed1.gt3x").read("info.txt")
    singles = tuple(_pack(folder / f"day{place + 1}.gt3x", log, info) for place, log in enumerate(logs))
    whole = b"".join(
        _lie_on_table(start - timedelta(seconds=TABLE_S))
        + log
        + _lie_on_table(start + timedelta(minutes=minutes))
        for start, log in zip(starts, logs, strict=True)
    )
    opening = logs[0][: _find_first_second(logs[0])]
    return Week(_pack(folder / "week.gt3x", opening + whole, info), singles)


def _simulate_day(folder: Path, place: int, minutes: int, start: datetime) -> bytes:
    shift = replace(simulate_shift("gt9x", minutes / 60.0, place + 1, 100.0), start=start)
    path = write_shift(folder, shift, actilife_csv=False)[0]
    log = ZipFile(path).read("log.bin")
    if place != WITHOUT_POSE:
        return log
    late_s = _unix_s(start + timedelta(minutes=1))
    return b"".join(
        log[at : at + size]
        for at, kind, unix_s, size in _walk(log)
        if kind not in SENSOR_RECORDS or unix_s >= late_s
    )


def _walk(log: bytes) -> list[tuple[int, int, int, int]]:
    """Return place, kind, time and size of each record."""
    records, at = [], 0
    while at < len(log):
        kind, unix_s, payload_bytes = struct.unpack_from("<BIH", log, at + 1)
        records.append((at, kind, unix_s, payload_bytes + 9))
        at += payload_bytes + 9
    return records


def _find_first_second(log: bytes) -> int:
    return next(at for at, kind, _, _ in _walk(log) if kind in SENSOR_RECORDS)


def _lie_on_table(start: datetime) -> bytes:
    chance = np.random.default_rng(int(start.timestamp()))
    seconds = []
    for second in range(TABLE_S):
        rows = np.zeros(100, ROW)
        rows["acc"] = np.array([0, 0, 2048]) + chance.integers(-3, 4, (100, 3))
        rows["gyr"] = chance.integers(-1, 2, (100, 3))
        seconds.append(frame_record(25, _unix_s(start) + second, b"\x01\x00" + rows.tobytes()))
    return b"".join(seconds)


def _unix_s(moment: datetime) -> int:
    return int(moment.replace(tzinfo=UTC).timestamp())


def _pack(path: Path, log: bytes, info: bytes) -> Path:
    with ZipFile(path, "w", ZIP_STORED) as archive:
        archive.writestr("log.bin", log)
        archive.writestr("info.txt", info)
    return path
