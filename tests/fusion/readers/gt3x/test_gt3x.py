"""The GT9X reader: every second of the log is used, or disclosed as missing."""

import struct
import zipfile
from collections.abc import Callable
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.errors import DamagedFile
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording, Span
from tests.fusion.readers.gt3x.gt3x_builder import T0, log_of, read_log, record, schema, second
from tests.fusion.readers.seen import codes, spans_s

SharedData = Callable[[str], Path]
REAL = "gt9x/link_imu_100hz_179s.gt3x"


@pytest.fixture(scope="module")
def real(shared_data: SharedData) -> Recording:
    return read_recording(shared_data(REAL))


@pytest.mark.real_recordings
def test_the_real_file_decodes_to_what_actilife_exported(shared_data: SharedData, real: Recording) -> None:
    table = np.loadtxt(
        shared_data("gt9x/link_imu_100hz_179s_actilife.csv"),
        delimiter=",",
        skiprows=11,
        usecols=(1, 2, 3, 5, 6, 7),
    )

    (segment,) = real.segments
    # float32 holds every 16-bit count exactly, so the counts come back whole
    acc_counts = np.round(segment.acc_g.astype(float) * 2048)
    gyr_counts = np.round(segment.gyr_dps.astype(float) * 16.384)
    seen = resample_as_actilife(
        np.hstack([acc_counts / 2048, gyr_counts / 16.383999]), rows_of_the_log(shared_data(REAL))
    )

    assert seen.shape == (17_900, 6)
    assert np.abs(seen - table).max() <= 1e-6


def rows_of_the_log(path: Path) -> list[int]:
    """Return the rows of each SENSOR_DATA record, walked independently of the reader."""
    log = zipfile.ZipFile(path).read("log.bin")
    at, counts = 0, []
    while at < len(log):
        _, kind, _, size = struct.unpack_from("<BBIH", log, at)
        if kind == 25:
            counts.append((size - 2) // 21)
        at += 9 + size
    return counts


def resample_as_actilife(values: NDArray[np.float64], counts: list[int]) -> NDArray[np.float64]:
    """Row k of a second is read at source index k n / 100, clamped at the last."""
    pieces, first = [], 0
    for n in counts:
        at = np.minimum(np.arange(100) * n / 100, n - 1)
        block = values[first : first + n]
        pieces.append(np.column_stack([np.interp(at, np.arange(n), column) for column in block.T]))
        first += n
    return np.vstack(pieces)


@pytest.mark.real_recordings
def test_the_real_file_has_one_segment_at_its_own_rate(real: Recording) -> None:
    assert real.duration_us == 179_000_000
    assert spans_s(real) == [(0.0, 17_916)]
    assert real.rate_hz == pytest.approx(17_916 / 179)
    assert real.start == datetime(2019, 2, 14, 8, 58, tzinfo=timezone(timedelta(hours=-5)))
    assert real.flags == ()


def test_seconds_of_100_and_101_rows_lie_on_one_even_grid() -> None:
    recording = read_log(record(24, T0, schema()) + b"".join(second(T0 + s, 100 + s % 2) for s in range(20)))

    assert spans_s(recording) == [(0.0, 2010)]
    assert recording.rate_hz == pytest.approx(100.5)
    assert codes(recording) == ["W-SEC-COUNT"]  # half of them have fewer rows than the median


def test_every_row_keeps_its_value() -> None:
    (segment,) = read_log(log_of(range(12))).segments

    assert segment.acc_g[:3, 2] == pytest.approx([1.0, 2049 / 2048, 2050 / 2048])
    assert segment.gyr_dps[100, 0] == pytest.approx(2 / 16.384, abs=1e-6)


def test_of_two_different_seconds_with_one_stamp_the_first_is_kept() -> None:
    other = record(25, T0 + 9, struct.pack("<H", 1) + bytes(2100))

    recording = read_log(log_of(range(10)) + other + b"".join(second(T0 + s) for s in range(10, 20)))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.segments[0].acc_g[950, 2] == pytest.approx(1.0, abs=0.002)


def test_a_second_that_lost_half_its_rows_is_missing() -> None:
    log = log_of(range(10)) + second(T0 + 10, 50) + b"".join(second(T0 + s) for s in range(11, 20))

    recording = read_log(log)

    assert spans_s(recording) == [(0.0, 1000), (11.0, 900)]
    assert codes(recording) == ["W-SEC-COUNT", "W-GAP"]


def test_samples_that_were_wiped_are_refused_as_damaged() -> None:
    wiped = b"".join(record(25, T0 + s, bytes(2102)) for s in range(20))

    with pytest.raises(DamagedFile):
        read_log(record(24, T0, schema()) + wiped)


# The device's own records. `tests/badfiles` (rows 1 to 58) has archives, damaged logs and info.txt.


def test_more_than_five_percent_of_damage_is_refused_with_its_clock() -> None:
    log = log_of(range(20))
    at = log.index(second(T0 + 5))

    # two records of 2111 bytes are gone, of 20 and a schema of 176: 10.0 %
    with pytest.raises(DamagedFile) as refusal:
        read_log(log[:at] + b"\xaa" * 4000 + log[at + 4000 :])

    assert refusal.value.facts == {"p": 10.0, "clock": "2026-03-02 08:00:04"}


def test_time_on_the_dock_is_excluded() -> None:
    docked = b"".join(record(26, T0 + s, b"\x00") for s in (5, 6, 7))

    recording = read_log(log_of(range(20)) + docked)

    assert recording.excluded == (Span(5_000_000, 3_000_000, "docked"),)
    assert recording.duration_us == 20_000_000


def test_a_centrepoint_file_counts_utc() -> None:
    recording = read_log(record(6, T0, b'{"MetadataType":"Device","UsedUtc":true}') + log_of(range(20)))

    assert recording.start == datetime(2026, 3, 2, 3, 0, tzinfo=timezone(timedelta(hours=-5)))


def test_malformed_records_are_skipped() -> None:
    odd = record(24, T0, b"\x01") + record(25, T0, b"") + record(25, T0, b"\x01\x00abc")

    assert spans_s(read_log(odd + log_of(range(20)))) == [(0.0, 2000)]


def test_a_second_schema_in_mid_file_starts_a_segment() -> None:
    log = log_of(range(10)) + record(24, T0, schema(acc_divisor=2000.0))

    recording = read_log(log + b"".join(second(T0 + s) for s in range(10, 20)))

    assert spans_s(recording) == [(0.0, 1000), (10.0, 1000)]
    assert recording.segments[1].acc_g[0, 2] == pytest.approx(1.024)


def test_any_bit_layout_is_decoded() -> None:
    columns = b""
    for channel, base in (("Accelerometer", 0), ("Gyroscope", 36)):
        for axis, letter in enumerate("XYZ"):
            label = f"{channel} {letter}".ljust(16).encode()
            columns += struct.pack("<3BI", 3, base + 12 * axis, 12, 0x08400000) + label  # divisor 128
    bits = int("".join(f"{value & 0xFFF:012b}" for value in (0, 0, 128, -256, 64, 0)), 2)
    row = bits.to_bytes(9, "big")
    data = b"".join(record(25, T0 + s, struct.pack("<H", 3) + row * 50) for s in range(9))

    (segment,) = read_log(record(24, T0, struct.pack("<3H", 3, 6, 0) + columns) + data).segments

    assert segment.acc_g[7].tolist() == [0.0, 0.0, 1.0]
    assert segment.gyr_dps[7].tolist() == [-2.0, 0.5, 0.0]
