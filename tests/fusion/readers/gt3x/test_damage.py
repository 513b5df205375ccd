"""Damaged logs and what the device says about itself: each costs what it must and no more."""

import struct
from datetime import datetime, timedelta, timezone

import pytest

from fusion.errors import (
    DamagedFile,
)
from fusion.readers import read_recording
from fusion.recording import Span
from tests.fusion.readers.gt3x.gt3x_builder import (
    INFO,
    T0,
    codes,
    log_of,
    pack,
    read_log,
    record,
    schema,
    second,
    spans_s,
)


def damage(log: bytes, at: int, value: int) -> bytes:
    return log[:at] + bytes([value]) + log[at + 1 :]


def start_of(log: bytes, second_number: int) -> int:
    return log.index(second(T0 + second_number))


def test_one_wrong_checksum_costs_its_own_second_only() -> None:
    log = log_of(range(40))
    at = start_of(log, 21) - 1

    recording = read_log(damage(log, at, log[at] ^ 0xFF))

    assert spans_s(recording) == [(0.0, 2000), (21.0, 1900)]
    assert codes(recording) == ["W-CHECKSUM", "W-GAP"]


@pytest.mark.parametrize(
    ("offset", "value"), [(0, 0x1F), (6, 0x60), (7, 0xEA)], ids=["separator", "size low", "size high"]
)
def test_broken_framing_costs_one_second_only(offset: int, value: int) -> None:
    log = log_of(range(40))

    recording = read_log(damage(log, start_of(log, 20) + offset, value))

    assert spans_s(recording) == [(0.0, 2000), (21.0, 1900)]
    assert codes(recording) == ["W-RESYNC", "W-GAP"]


def test_a_flash_block_of_zeros_costs_the_seconds_it_covers() -> None:
    log = log_of(range(120))
    at = start_of(log, 50) + 100

    recording = read_log(log[:at] + bytes(4096) + log[at + 4096 :])

    assert spans_s(recording) == [(0.0, 5000), (52.0, 6800)]
    assert codes(recording) == ["W-RESYNC", "W-GAP"]


def test_a_record_cut_at_the_end_is_said() -> None:
    recording = read_log(log_of(range(20))[:-700])

    assert spans_s(recording) == [(0.0, 1900)]
    assert codes(recording) == ["W-TRUNC-TAIL"]


def test_more_than_five_percent_of_damage_is_refused_with_its_clock() -> None:
    log = log_of(range(20))
    at = start_of(log, 5)

    # two records of 2111 bytes are gone, of 20 and a schema of 176: 10.0 %
    with pytest.raises(DamagedFile) as refusal:
        read_log(log[:at] + b"\xaa" * 4000 + log[at + 4000 :])

    assert refusal.value.facts == {"p": 10.0, "clock": "2026-03-02 08:00:04"}


def test_idle_sleep_is_excluded_not_missing() -> None:
    asleep = record(3, T0 + 20, b"\x08") + record(3, T0 + 50, b"\x09")
    log = log_of(range(20)) + asleep + b"".join(second(T0 + s) for s in range(50, 70))

    recording = read_log(log)

    assert recording.excluded == (Span(20_000_000, 30_000_000, "asleep"),)
    assert codes(recording) == ["W-SLEEP"]


def test_sleep_that_never_ends_lasts_to_the_last_stamp() -> None:
    log = log_of(range(20)) + record(3, T0 + 20, b"\x08") + record(2, T0 + 50, b"\x00\x10")

    recording = read_log(log)

    assert recording.excluded == (Span(20_000_000, 30_000_000, "asleep"),)
    assert recording.duration_us == 50_000_000


def test_leaving_sleep_without_entering_is_ignored() -> None:
    recording = read_log(record(3, T0, b"\x09") + log_of(range(20)))

    assert recording.excluded == ()


def test_a_forged_sleep_makes_no_time() -> None:
    log = log_of(range(20)) + record(3, T0 + 5, b"\x08") + record(3, T0 + 200_000, b"\x09")

    recording = read_log(log)

    assert sum(span.duration_us for span in recording.excluded) <= recording.duration_us - 20_000_000


def test_docked_seconds_are_excluded() -> None:
    docked = b"".join(record(26, T0 + s, b"\x00") for s in (5, 6, 7))

    recording = read_log(log_of(range(20)) + docked)

    assert recording.excluded == (Span(5_000_000, 3_000_000, "docked"),)
    assert codes(recording) == ["W-DOCKED"]


def test_a_centrepoint_file_counts_utc() -> None:
    log = record(6, T0, b'{"MetadataType":"Device","UsedUtc":true}') + log_of(range(20))

    recording = read_log(log)

    assert recording.start == datetime(2026, 3, 2, 3, 0, tzinfo=timezone(timedelta(hours=-5)))


def test_unknown_and_malformed_records_are_skipped() -> None:
    odd = (
        record(77, T0, b"?") + record(24, T0, b"\x01") + record(25, T0, b"") + record(25, T0, b"\x01\x00abc")
    )

    recording = read_log(odd + log_of(range(20)))

    assert spans_s(recording) == [(0.0, 2000)]


def test_a_second_schema_in_mid_file_starts_a_segment() -> None:
    log = log_of(range(10)) + record(24, T0, schema(acc_divisor=2000.0))
    log += b"".join(second(T0 + s) for s in range(10, 20))

    recording = read_log(log)

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

    recording = read_log(record(24, T0, struct.pack("<3H", 3, 6, 0) + columns) + data)

    assert recording.segments[0].acc_g[7].tolist() == [0.0, 0.0, 1.0]
    assert recording.segments[0].gyr_dps[7].tolist() == [-2.0, 0.5, 0.0]


@pytest.mark.parametrize(
    ("info", "expected"),
    [
        (INFO.replace("Sample Rate: 100", "Sample Rate: 100 Hz\r\nAcceleration Max: 8,0"), []),
        ("\ufeff" + INFO.replace("\r\n", "\n"), []),
        (INFO + "Subject Name: Renée\r\n", []),
        ((INFO + "Subject Name: Renée\r\n").encode("latin-1"), ["W-ENCODING"]),
        (INFO.replace("-05:00:00", "rubbish"), ["W-TZ"]),
        (INFO.replace("Resets: 0", "Resets: 3"), ["W-RESETS"]),
        (INFO.replace("Stop Date: 0", "Stop Date: 639080640000000000"), ["W-EARLY-END"]),
    ],
    ids=["decimal comma", "byte order mark", "utf-8", "latin-1", "no zone", "resets", "battery death"],
)
def test_info_txt_is_read_in_every_locale(info: str | bytes, expected: list[str]) -> None:
    recording = read_recording(pack(log_of(range(20)), info))

    assert recording.duration_us == 20_000_000
    assert codes(recording) == expected
