"""The GT9X reader: every second of the log is used, or disclosed as missing."""

import io
import struct
import zipfile
from collections.abc import Callable, Mapping
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.errors import DamagedFile, FusionError, UnsafeArchive, WrongExtension
from fusion.readers import read_recording
from fusion.recording import Recording, Span
from tests.badfiles.gt3x_files import archive
from tests.fusion.readers.gt3x.gt3x_builder import INFO, T0, log_of, pack, read_log, record, schema, second
from tests.fusion.readers.seen import codes, read_file, spans_s

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
    """FORMATS.md section 7: row k of a second is read at source index k n / 100, clamped at the last."""
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


def test_a_minute_of_absent_records_is_missing() -> None:
    recording = read_log(log_of([*range(20), *range(80, 100)]))

    (gap,) = recording.flags
    assert spans_s(recording) == [(0.0, 2000), (80.0, 2000)]
    assert (gap.code, gap.count, gap.seconds, gap.first_s, gap.last_s) == ("W-GAP", 1, 60.0, 20.0, 80.0)


def test_of_two_different_seconds_with_one_stamp_the_first_is_kept() -> None:
    other = record(25, T0 + 9, struct.pack("<H", 1) + bytes(2100))

    recording = read_log(log_of(range(10)) + other + b"".join(second(T0 + s) for s in range(10, 20)))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.segments[0].acc_g[950, 2] == pytest.approx(1.0, abs=0.002)


@pytest.mark.parametrize(
    ("place", "stamp"),
    [(0, 0), (10, T0 + 31_536_000), (10, 0), (19, 0)],
    ids=["first at 0", "a year ahead", "at 0", "last at 0"],
)
def test_one_wrong_stamp_is_mended(place: int, stamp: int) -> None:
    stamps = [T0 + s for s in range(20)]
    stamps[place] = stamp

    recording = read_log(record(24, T0, schema()) + b"".join(map(second, stamps)))

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == ["W-CLOCK-FWD"]
    assert recording.start == datetime(2026, 3, 2, 8, tzinfo=timezone(timedelta(hours=-5)))


def test_a_second_that_lost_half_its_rows_is_missing() -> None:
    log = log_of(range(10)) + second(T0 + 10, 50) + b"".join(second(T0 + s) for s in range(11, 20))

    recording = read_log(log)

    assert spans_s(recording) == [(0.0, 1000), (11.0, 900)]
    assert codes(recording) == ["W-SEC-COUNT", "W-GAP"]


# The archive around a `.gt3x`: judged before it is unpacked, refused with the cause.
#
# `tests/badfiles` (rows 1 to 16 and 41 to 42) has the other archives.

LOG = log_of(range(20))
WHOLE = pack(LOG).getvalue()
PACKED = pack(LOG, compression=zipfile.ZIP_DEFLATED).getvalue()
ENTRY = WHOLE.index(b"PK\x01\x02")
PARTS: Mapping[str, bytes | str] = {"log.bin": LOG, "info.txt": INFO}


def flip(content: bytes, at: int, bits: int = 0xFF) -> bytes:
    return content[:at] + bytes([content[at] ^ bits]) + content[at + 1 :]


def double_log() -> bytes:
    file = io.BytesIO(WHOLE)
    with zipfile.ZipFile(file, "a") as added, pytest.warns(UserWarning, match="Duplicate name"):
        added.writestr("log.bin", b"")
    return file.getvalue()


@pytest.mark.parametrize(
    ("content", "code", "facts"),
    [
        (WHOLE[: len(WHOLE) // 2], "E-ZIP-TRUNC", {"n": len(WHOLE) // 2}),
        (WHOLE[:-40], "E-ZIP-TRUNC", {"n": len(WHOLE) - 40}),
        (flip(PACKED, 200), "E-ZIP-CRC", {"member": "log.bin"}),
        (WHOLE[:5000] + WHOLE[5100:], "E-ZIP-CRC", {"member": "log.bin"}),
        (archive({"info.txt": INFO}), "E-GT3X-PART", {"member": "log.bin"}),
        (archive({"log.bin": LOG}), "E-GT3X-PART", {"member": "info.txt"}),
        (double_log(), "E-ZIP-UNSAFE", {"reason": "duplicate"}),
        (flip(WHOLE, ENTRY + 8, 1), "E-ZIP-UNSAFE", {"reason": "encrypted"}),
    ],
    ids=["half", "no index", "flipped", "bytes lost", "no log", "no info", "doubled", "encrypted"],
)
def test_a_damaged_archive_is_refused_with_its_cause(content: bytes, code: str, facts: object) -> None:
    with pytest.raises(FusionError) as refusal:
        read_file(content)

    assert (refusal.value.code, refusal.value.facts) == (code, facts)


@pytest.mark.parametrize("name", ["../../../tmp/evil.txt", "/etc/evil.txt", "a\\b.txt", "C:evil.txt"])
def test_an_unsafe_member_name_is_refused(name: str) -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_file(archive({**PARTS, name: b""}))

    assert refusal.value.facts == {"reason": "name"}


def test_too_many_members_are_refused() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_file(archive({f"m{k}": b"" for k in range(65)}))

    assert refusal.value.facts["reason"] == "members"


def test_a_zip_bomb_is_refused_before_it_is_unpacked() -> None:
    with pytest.raises(UnsafeArchive) as refusal:
        read_file(archive({"log.bin": bytes(30_000_000), "info.txt": INFO}, zipfile.ZIP_DEFLATED))

    assert refusal.value.facts["reason"] == "ratio"


def test_samples_without_a_schema_are_refused_as_a_part_that_is_missing() -> None:
    with pytest.raises(FusionError) as refusal:
        read_log(b"".join(second(T0 + s) for s in range(20)))

    assert (refusal.value.code, refusal.value.facts) == ("E-GT3X-PART", {"member": "SENSOR_SCHEMA"})


def test_samples_that_were_wiped_are_refused_as_damaged() -> None:
    wiped = b"".join(record(25, T0 + s, bytes(2102)) for s in range(20))

    with pytest.raises(DamagedFile):
        read_log(record(24, T0, schema()) + wiped)


def test_a_table_named_gt3x_is_refused_by_its_content() -> None:
    with pytest.raises(WrongExtension) as refusal:
        read_file(b"Timestamp,Accelerometer X\n1,2\n", "shift.gt3x")

    assert refusal.value.facts == {"ext": ".gt3x", "kind": "text", "right": ".csv"}


def test_a_gt3x_named_csv_is_refused_with_the_right_name() -> None:
    with pytest.raises(WrongExtension) as refusal:
        read_file(WHOLE, "shift.csv")

    assert refusal.value.facts["right"] == ".gt3x"


# Damaged logs and the device's own records: each costs its own seconds and no more.
#
# `tests/badfiles` (rows 17 to 58) has the warnings of each damage and of info.txt.

SOUND_LOG = log_of(range(120))
HALF_MINUTE = Span(20_000_000, 30_000_000, "asleep")


def spoil(number: int, offset: int, values: bytes) -> bytes:
    """Return the log with bytes overwritten, from an offset in the record of a second on."""
    at = SOUND_LOG.index(second(T0 + number)) + offset
    return SOUND_LOG[:at] + values + SOUND_LOG[at + len(values) :]


@pytest.mark.parametrize(
    ("log", "after", "code"),
    [
        (spoil(51, -1, bytes([second(T0 + 50)[-1] ^ 0xFF])), 51.0, "W-CHECKSUM"),
        (spoil(50, 0, b"\x1f"), 51.0, "W-RESYNC"),
        (spoil(50, 6, b"\x60"), 51.0, "W-RESYNC"),
        (spoil(50, 7, b"\xea"), 51.0, "W-RESYNC"),
        (spoil(50, 100, bytes(4096)), 52.0, "W-RESYNC"),
    ],
    ids=["checksum", "separator", "size low", "size high", "4 KiB of zeros"],
)
def test_damage_costs_the_seconds_that_it_covers(log: bytes, after: float, code: str) -> None:
    recording = read_log(log)

    assert spans_s(recording) == [(0.0, 5000), (after, round(100 * (120 - after)))]
    assert codes(recording) == [code, "W-GAP"]


def test_a_record_cut_at_the_end_costs_its_second() -> None:
    assert spans_s(read_log(SOUND_LOG[:-700])) == [(0.0, 11_900)]


def test_more_than_five_percent_of_damage_is_refused_with_its_clock() -> None:
    log = log_of(range(20))
    at = log.index(second(T0 + 5))

    # two records of 2111 bytes are gone, of 20 and a schema of 176: 10.0 %
    with pytest.raises(DamagedFile) as refusal:
        read_log(log[:at] + b"\xaa" * 4000 + log[at + 4000 :])

    assert refusal.value.facts == {"p": 10.0, "clock": "2026-03-02 08:00:04"}


@pytest.mark.parametrize(
    ("events", "excluded", "duration_s"),
    [
        (record(3, T0 + 20, b"\x08") + record(3, T0 + 50, b"\x09") + second(T0 + 50), (HALF_MINUTE,), 51),
        (record(3, T0 + 20, b"\x08") + record(2, T0 + 50, b"\x00\x10"), (HALF_MINUTE,), 50),
        (record(3, T0 + 5, b"\x08") + record(3, T0 + 200_000, b"\x09"), (), 20),
        (
            b"".join(record(26, T0 + s, b"\x00") for s in (5, 6, 7)),
            (Span(5_000_000, 3_000_000, "docked"),),
            20,
        ),
    ],
    ids=["sleep", "sleep that never ends", "forged sleep", "dock"],
)
def test_time_that_the_device_did_not_measure_is_excluded(
    events: bytes, excluded: tuple[Span, ...], duration_s: int
) -> None:
    recording = read_log(log_of(range(20)) + events)

    assert (recording.excluded, recording.duration_us) == (excluded, 1_000_000 * duration_s)


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
