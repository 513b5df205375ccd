"""Damaged logs and the device's own records: each costs its own seconds and no more.

`tests/badfiles` (rows 17 to 58) has the warnings of each damage and of info.txt.
"""

import struct
from datetime import datetime, timedelta, timezone

import pytest

from fusion.errors import DamagedFile
from fusion.recording import Span
from tests.fusion.readers.gt3x.gt3x_builder import T0, log_of, read_log, record, schema, second
from tests.fusion.readers.seen import codes, spans_s

LOG = log_of(range(120))
HALF_MINUTE = Span(20_000_000, 30_000_000, "asleep")


def spoil(number: int, offset: int, values: bytes) -> bytes:
    """Return the log with bytes overwritten, from an offset in the record of a second on."""
    at = LOG.index(second(T0 + number)) + offset
    return LOG[:at] + values + LOG[at + len(values) :]


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
    assert spans_s(read_log(LOG[:-700])) == [(0.0, 11_900)]


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
