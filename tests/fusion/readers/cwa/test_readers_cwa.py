"""Axivity AX6 `.cwa`: what the bytes say is what is read."""

import struct
from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import NoGyroscope, UnknownRate
from fusion.pipeline import analyse
from fusion.readers.cwa import decode_log
from tests.badfiles import cwa_files
from tests.badfiles.gt3x_files import LOG, pack
from tests.fusion.readers.cwa.cwa_builder import (
    AX3,
    PACKED,
    RATE_50,
    ROWS,
    START,
    START_US,
    THREE_AXES,
    block,
    blocks,
    header,
    log_of,
    pack_time,
    seal,
    still_rows,
)
from tests.fusion.readers.seen import codes, read_file, spans_s


def by_hand() -> bytes:
    """One block, field by field: 2026-03-02 08:00:00.5, 8 g, 1000 deg/s, two rows.

    The date: 26 << 26 | 3 << 22 | 2 << 17 | 8 << 12 = 0x68C48000. Half a second: 0x8000 | 0x4000. The
    fraction is worth 50 rows of 100 Hz, so the offset -50 says that the stamp is that of row 0. The scales:
    4 << 13 (4096 counts for 1 g) | 3 << 10 (1000 deg/s) = 0x8C00.
    """
    head = bytes.fromhex(
        "4158 fc01 00c0 4d000000 00000000 0080c468 008c c800 00 c8 4a 62 ceff 0200".replace(" ", "")
    )
    rows = struct.pack("<12h", 1, -2, 16384, 4096, -4096, 2048, 3, -4, -32768, 0, 8192, -1)
    return seal((head + rows).ljust(512, b"\0"))


def test_a_block_worked_out_by_hand_is_read_as_it_was_meant() -> None:
    at_rest = still_rows(ROWS)
    at_rest[:, 5] *= 2  # 4096 counts are 1 g here
    rest = [block(1 + k, START_US + 520_000 + 400_000 * k, at_rest, scales=0x8C00) for k in range(6)]

    recording = read_file(header() + by_hand() + b"".join(rest))

    segment = recording.segments[0]
    count_dps = 1000 / 32768
    assert segment.acc_g[:2].tolist() == [[1.0, -1.0, 0.5], [0.0, 2.0, -1 / 4096]]
    assert segment.gyr_dps[:2] == pytest.approx(
        np.array([[1, -2, 16384], [3, -4, -32768]]) * count_dps, rel=1e-6
    )
    assert recording.start == datetime(2026, 3, 2, 8, 0, 0, 500_000)  # noqa: DTZ001 (the device knows no zone)
    assert recording.acc_range_g == 8.0
    assert recording.gyr_range_dps == 1000.0


def test_an_unbroken_recording_is_one_segment_at_the_true_rate() -> None:
    recording = read_file(log_of(range(50), period_us=9_920))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.rate_hz == pytest.approx(1e6 / 9_920, rel=1e-5)
    assert recording.duration_us == pytest.approx(2000 * 9_920, abs=100)
    assert codes(recording) == ["W-DRIFT"]


def test_the_recording_says_what_it_was_taken_for() -> None:
    recording = read_file(log_of(range(50)))

    assert recording.device == "ax6"
    assert recording.start == START
    assert recording.time_zone is None
    assert recording.serial_hash == "5994471abb01"  # of the text 12345
    assert (recording.acc_range_g, recording.gyr_range_dps) == (16.0, 2000.0)
    assert recording.understood["layout"] == "Axivity AX6 .cwa"
    assert recording.understood["nominal_rate_hz"] == "100"
    assert "Anne" not in repr(recording)  # a name in the notes of the header


def test_a_stamp_of_whole_seconds_at_a_row_of_the_block_is_understood() -> None:
    """Older firmware: no fraction; the offset is the row at which the second began."""
    content = header()
    for number in range(50):
        # the first row at 0.4 s times the number; the whole second that came last or comes next
        tenths = 4 * number
        second = -(-tenths // 10)
        row = (10 * second - tenths) * 10
        content += block(number, 0, stamp=(pack_time(START) + second, 0, row))

    recording = read_file(content)

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.duration_us == 20_000_000
    assert recording.start == START


def test_a_block_that_is_not_full_holds_as_many_rows_as_it_says() -> None:
    last = block(10, START_US + 4_000_000, still_rows(7))

    recording = read_file(header() + b"".join(blocks(range(10))) + last)

    assert spans_s(recording) == [(0.0, 407)]
    assert codes(recording) == []


def test_a_magnetometer_beside_the_two_sensors_is_passed_over() -> None:
    content = header()
    for number in range(60):
        nine = np.concatenate([still_rows(26, number), np.full((26, 3), 999, np.int16)], axis=1)
        content += block(number, START_US + 260_000 * number, nine, axes=0x92)

    recording = read_file(content)

    assert spans_s(recording) == [(0.0, 1560)]
    assert float(np.abs(recording.segments[0].acc_g).max()) < 1.01


@pytest.mark.parametrize(
    ("code", "range_dps"),
    [(0, 2000.0), (1, 4000.0), (2, 2000.0), (3, 1000.0), (4, 500.0), (5, 250.0), (6, 125.0)],
)
def test_the_range_of_the_gyroscope_stands_in_every_block(code: int, range_dps: float) -> None:
    recording = read_file(log_of(range(50), scales=3 << 13 | code << 10))

    assert recording.gyr_range_dps == range_dps
    assert recording.segments[0].gyr_dps[0, 0] == pytest.approx(range_dps / 32768)


def test_a_rate_changed_in_the_middle_begins_a_new_segment() -> None:
    slower = [
        block(25 + k, START_US + 10_000_000 + 800_000 * k, still_rows(ROWS, k), rate=RATE_50)
        for k in range(25)
    ]

    recording = read_file(header() + b"".join([*blocks(range(25)), *slower]))

    assert spans_s(recording) == [(0.0, 1000), (10.0, 1000)]
    assert [round(segment.rate_hz, 2) for segment in recording.segments] == [100.0, 50.0]
    assert recording.duration_us == pytest.approx(30_000_000, abs=100)
    assert codes(recording) == []


def test_a_plan_that_was_not_reached_is_said() -> None:
    stop = pack_time(datetime(2026, 3, 2, 16, 0, 0))  # noqa: DTZ001 (the device knows no zone)

    recording = read_file(header(stop=stop) + b"".join(blocks(range(50))))

    assert codes(recording) == ["W-EARLY-END"]


@pytest.mark.parametrize("axes", [THREE_AXES, PACKED])
def test_without_a_gyroscope_it_is_refused_with_the_cure(axes: int) -> None:
    plain = np.zeros((40, 6), np.int16)
    content = header(AX3) + b"".join(block(k, START_US + 400_000 * k, plain, axes=axes) for k in range(50))

    with pytest.raises(NoGyroscope) as refusal:
        read_file(content)

    assert refusal.value.facts == {"cure": "AX6"}


def test_a_rate_that_shows_no_arm_is_refused() -> None:
    content = header() + b"".join(
        block(k, START_US + 6_400_000 * k, still_rows(ROWS, k), rate=0x46) for k in range(50)
    )

    with pytest.raises(UnknownRate) as refusal:
        read_file(content)

    assert refusal.value.facts["m"] == pytest.approx(6.25, rel=1e-4)


@settings(max_examples=20)
@given(
    counts=st.lists(st.lists(st.integers(-32768, 32767), min_size=6, max_size=6), min_size=1, max_size=ROWS)
)
def test_what_is_written_is_read_to_the_count(counts: list[list[int]]) -> None:
    content = block(0, START_US, np.array(counts, np.int16))

    log = decode_log([content])

    acc = np.rint(log.columns.acc * 2048).astype(int).tolist()
    gyr = np.rint(log.columns.gyr * 32768 / 2000).astype(int).tolist()
    assert [[*turn, *pull] for turn, pull in zip(gyr, acc, strict=True)] == counts


def test_the_angle_of_the_arm_is_that_of_the_same_minute_in_a_gt3x() -> None:
    """The pose tells the arm's axis: no convention of the device's own axes is needed."""
    of_cwa, of_gt3x = (analyse(read_file(content)) for content in (cwa_files.whole(), pack(LOG)))

    elevations = [analysis.elevation.segments[0].elevation_deg for analysis in (of_cwa, of_gt3x)]
    n = min(map(len, elevations))
    assert np.median(np.abs(elevations[0][:n] - elevations[1][:n])) < 0.1
    assert {flag.code for flag in of_cwa.quality.flags} == {flag.code for flag in of_gt3x.quality.flags}
