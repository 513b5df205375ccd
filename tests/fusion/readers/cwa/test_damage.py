"""Damaged `.cwa` files: only what is damaged is lost, and every second is accounted for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import DamagedFile, UnknownColumns
from fusion.readers.cwa.read import DeviceHeader, build_recording, decode_log
from fusion.recording import MICROSECONDS
from tests.fusion.readers.cwa.cwa_builder import (
    START,
    START_US,
    block,
    blocks,
    codes,
    header,
    log_of,
    read_file,
    spans_s,
    still_rows,
)

BLOCK_S = 0.4
HEADER_BYTES, BLOCK_BYTES = 1024, 512


def spoilt(number: int, *, of: int = 50) -> bytes:
    """A file whose block of this number has one wrong bit among its samples."""
    content = bytearray(log_of(range(of)))
    content[HEADER_BYTES + number * BLOCK_BYTES + 100] ^= 1
    return bytes(content)


# ------------------------------------------------------------------ blocks that do not verify


def test_a_block_that_fails_its_checksum_is_missing_and_no_other() -> None:
    recording = read_file(spoilt(20))

    assert spans_s(recording) == [(0.0, 800), (8.4, 1160)]
    assert codes(recording) == ["W-CHECKSUM", "W-GAP"]


def test_the_place_of_the_damage_is_told() -> None:
    recording = read_file(spoilt(20))

    flag = recording.flags[0]
    assert flag.count == 1
    assert [flag.first_s, flag.last_s] == pytest.approx([7.6, 7.6], abs=1e-4)


def test_two_blocks_in_a_row_that_fail_are_both_missing() -> None:
    content = bytearray(spoilt(20))
    content[HEADER_BYTES + 21 * BLOCK_BYTES + 100] ^= 1

    recording = read_file(bytes(content))

    assert spans_s(recording) == [(0.0, 800), (8.8, 1120)]
    assert (codes(recording), recording.flags[0].count) == (["W-CHECKSUM", "W-GAP"], 2)


@pytest.mark.parametrize("filling", [b"\xff", b"\x00"])
def test_a_block_that_was_wiped_is_a_hole(filling: bytes) -> None:
    parts = blocks(range(50))
    parts[20] = filling * BLOCK_BYTES

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 800), (8.4, 1160)]
    assert codes(recording) == ["W-GAP"]


def test_room_that_was_never_written_ends_the_recording() -> None:
    recording = read_file(log_of(range(50)) + b"\xff" * 50_000)

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == []


def test_bytes_put_in_between_are_passed_over() -> None:
    parts = blocks(range(50))

    recording = read_file(header() + b"".join(parts[:20]) + b"AX garbage" * 7 + b"".join(parts[20:]))

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == ["W-RESYNC"]


def test_bytes_that_were_lost_cost_their_block_alone() -> None:
    content = log_of(range(50))
    at = HEADER_BYTES + 20 * BLOCK_BYTES + 100

    recording = read_file(content[:at] + content[at + 33 :])

    assert spans_s(recording) == [(0.0, 800), (8.4, 1160)]
    assert codes(recording) == ["W-RESYNC", "W-GAP"]


def test_a_block_cut_off_at_the_end_is_left_out() -> None:
    recording = read_file(log_of(range(50))[:-100])

    assert spans_s(recording) == [(0.0, 1960)]
    assert codes(recording) == ["W-TRUNC-TAIL"]
    assert recording.flags[0].facts == {"n": 412}


def test_more_than_five_percent_damaged_is_refused() -> None:
    content = bytearray(log_of(range(50)))
    for number in range(5, 45, 10):
        content[HEADER_BYTES + number * BLOCK_BYTES + 100] ^= 1

    with pytest.raises(DamagedFile) as refusal:
        read_file(bytes(content))

    assert refusal.value.facts == {"p": 8.0, "clock": "2026-03-02 08:00:01"}


@pytest.mark.parametrize("fields", [{"count": 41}, {"axes": 0x63}, {"axes": 0x52}])
def test_a_sound_block_of_no_known_layout_is_left_out(fields: dict[str, int]) -> None:
    parts = blocks(range(50))
    parts[20] = block(20, START_US + 8_000_000, **fields)  # type: ignore[arg-type]

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 800), (8.4, 1160)]
    assert codes(recording) == ["W-ROWS-DROPPED", "W-GAP"]


# ------------------------------------------------------------------ numbers and sessions


def test_a_missing_block_is_missing_time() -> None:
    recording = read_file(log_of([*range(20), *range(25, 50)]))

    assert spans_s(recording) == [(0.0, 800), (10.0, 1000)]
    assert recording.flags[0].seconds == pytest.approx(2.0, abs=1e-3)


def test_a_block_twice_is_counted_once() -> None:
    recording = read_file(log_of([*range(20), 19, *range(20, 50)]))

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == ["W-DUP"]


def test_the_whole_recording_after_itself_is_counted_once() -> None:
    recording = read_file(log_of([*range(50), *range(50)]))

    assert spans_s(recording) == [(0.0, 2000)]
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-ORDER", 49), ("W-DUP", 50)]


def test_of_two_blocks_with_one_number_and_stamp_the_first_is_kept() -> None:
    other = block(19, START_US + 7_600_000, still_rows(40, 700))
    parts = blocks(range(50))

    recording = read_file(header() + b"".join([*parts[:20], other, *parts[20:]]))

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == ["W-DUP-CONFLICT"]
    assert recording.segments[0].gyr_dps[19 * 40, 0] == pytest.approx(20 * 2000 / 32768)


def test_doubles_of_other_lengths_contradict_the_block_before() -> None:
    parts = blocks(range(50))
    shorter = [block(k, START_US + 400_000 * k, still_rows(30, k)) for k in (10, 20)]

    recording = read_file(
        header() + b"".join([*parts[:11], shorter[0], *parts[11:21], shorter[1], *parts[21:]])
    )

    assert spans_s(recording) == [(0.0, 2000)]
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-DUP-CONFLICT", 2)]


def test_blocks_that_went_back_in_number_and_not_in_time_stay_where_they_are() -> None:
    """Number 20 stands where 30 was, with a stamp of its own: nothing agrees on its place."""
    parts = blocks(range(50))
    parts[30] = block(20, START_US + 4_000_000, still_rows(40, 800))

    recording = read_file(header() + b"".join(parts))

    assert sum(rows for _, rows in spans_s(recording)) == 2000
    assert "W-ORDER" not in codes(recording)


def test_sound_blocks_of_no_known_layout_alone_are_refused() -> None:
    content = header() + b"".join(block(k, START_US + 400_000 * k, axes=0x52) for k in range(50))

    with pytest.raises(UnknownColumns):
        read_file(content)


@pytest.mark.parametrize("number", [1, 2])
def test_very_few_blocks_are_read(number: int) -> None:
    log = decode_log(blocks(range(number)))

    recording = build_recording(DeviceHeader(), log)

    assert spans_s(recording) == [(0.0, 40 * number)]


def test_a_block_that_came_late_is_put_into_its_place() -> None:
    recording = read_file(log_of([*range(20), 21, 22, 20, *range(23, 50)]))

    numbers = recording.segments[0].gyr_dps[::40, 0] * 32768 / 2000
    assert spans_s(recording) == [(0.0, 2000)]
    assert np.rint(numbers).astype(int).tolist() == list(range(1, 51))
    assert codes(recording) == ["W-ORDER"]


def test_a_device_that_started_again_goes_on_after_a_gap() -> None:
    again = [block(k, START_US + 30_000_000 + 400_000 * k) for k in range(25)]

    recording = read_file(header() + b"".join([*blocks(range(25)), *again]))

    assert spans_s(recording) == [(0.0, 1000), (30.0, 1000)]
    assert codes(recording) == ["W-GAP"]


def test_what_is_left_of_another_session_is_left_out() -> None:
    """It was recorded a week before, and may be another person's."""
    week_us = 7 * 86_400 * MICROSECONDS
    old = [block(50 + k, START_US - week_us + 400_000 * k, session=76) for k in range(10)]

    recording = read_file(header() + b"".join([*blocks(range(50)), *old]))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start == START
    assert [(flag.code, dict(flag.facts)) for flag in recording.flags] == [("W-SESSION", {"n": 400})]


def test_where_no_block_is_of_the_session_of_the_header_the_longer_one_is_kept() -> None:
    old = [block(50 + k, START_US + 60_000_000 + 400_000 * k, session=76) for k in range(10)]

    recording = read_file(header(session=5) + b"".join([*blocks(range(50)), *old]))

    assert spans_s(recording) == [(0.0, 2000)]


@settings(max_examples=50, deadline=None)
@given(lost=st.sets(st.integers(1, 98), max_size=20))
def test_whatever_blocks_are_lost_every_other_sample_is_where_it_was(lost: set[int]) -> None:
    left = [k for k in range(100) if k not in lost]

    recording = read_file(log_of(left))

    at_s = [
        segment.start_s + row / segment.rate_hz
        for segment in recording.segments
        for row in range(0, len(segment), 40)
    ]
    assert at_s == pytest.approx([BLOCK_S * k for k in left], abs=1e-3)
    assert recording.duration_us == pytest.approx(40_000_000, abs=1000)
