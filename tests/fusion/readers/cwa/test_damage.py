"""Damaged `.cwa` files: only what is damaged is lost, and every second is accounted for."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.errors import DamagedFile, UnknownColumns
from fusion.readers.cwa import DeviceHeader, build_recording, decode_log
from tests.fusion.readers.cwa.cwa_builder import START, START_US, block, blocks, header, log_of, still_rows
from tests.fusion.readers.seen import codes, counts, read_file, spans_s

BLOCK_US = 400_000
WEEK_US = 7 * 86_400_000_000
PARTS = tuple(blocks(range(50)))
WHOLE = header() + b"".join(PARTS)
INSIDE = 1024 + 20 * 512 + 100
"""A byte among the samples of block 20."""
UNBROKEN = [(0.0, 2000)]
WITHOUT_20 = [(0.0, 800), (8.4, 1160)]


def spoil(*numbers: int) -> bytes:
    """Return a file in which these blocks have one wrong bit among their samples."""
    content = bytearray(WHOLE)
    for number in numbers:
        content[1024 + number * 512 + 100] ^= 1
    return bytes(content)


def put(number: int, *instead: bytes) -> bytes:
    """Return a file with other bytes in the place of a block."""
    return header() + b"".join([*PARTS[:number], *instead, *PARTS[number + 1 :]])


@pytest.mark.parametrize(
    ("content", "spans", "caveats"),
    [
        (spoil(20), WITHOUT_20, ["W-CHECKSUM", "W-GAP"]),
        (put(20, b"\xff" * 512), WITHOUT_20, ["W-GAP"]),
        (put(20, b"\x00" * 512), WITHOUT_20, ["W-GAP"]),
        (WHOLE + b"\xff" * 50_000, UNBROKEN, []),
        (put(20, b"AX garbage" * 7, PARTS[20]), UNBROKEN, ["W-RESYNC"]),
        (WHOLE[:INSIDE] + WHOLE[INSIDE + 33 :], WITHOUT_20, ["W-RESYNC", "W-GAP"]),
        (put(20, block(20, START_US + 8_000_000, count=41)), WITHOUT_20, ["W-ROWS-DROPPED", "W-GAP"]),
        (put(20, block(20, START_US + 8_000_000, axes=0x63)), WITHOUT_20, ["W-ROWS-DROPPED", "W-GAP"]),
        (put(20, block(20, START_US + 8_000_000, axes=0x52)), WITHOUT_20, ["W-ROWS-DROPPED", "W-GAP"]),
        (log_of([*range(20), *range(25, 50)]), [(0.0, 800), (10.0, 1000)], ["W-GAP"]),
        (log_of([*range(20), 19, *range(20, 50)]), UNBROKEN, ["W-DUP"]),
    ],
    ids=[
        *("checksum", "wiped to ones", "wiped to zeros", "unwritten room at the end", "bytes put in"),
        *("bytes lost", "too many rows", "unknown axes", "unknown packing", "blocks absent", "block twice"),
    ],
)
def test_damage_costs_its_own_block_and_no_other(
    content: bytes, spans: list[tuple[float, int]], caveats: list[str]
) -> None:
    recording = read_file(content)

    assert (spans_s(recording), codes(recording)) == (spans, caveats)


def test_two_blocks_in_a_row_that_fail_are_both_missing_and_their_place_is_told() -> None:
    recording = read_file(spoil(20, 21))

    flag = recording.flags[0]
    assert spans_s(recording) == [(0.0, 800), (8.8, 1120)]
    assert (flag.code, flag.count) == ("W-CHECKSUM", 2)
    assert [flag.first_s, flag.last_s] == pytest.approx([7.6, 7.6], abs=1e-4)


def test_a_block_cut_off_at_the_end_is_left_out() -> None:
    recording = read_file(WHOLE[:-100])

    assert spans_s(recording) == [(0.0, 1960)]
    assert [(flag.code, flag.facts) for flag in recording.flags] == [("W-TRUNC-TAIL", {"n": 412})]


def test_more_than_five_percent_damaged_is_refused() -> None:
    with pytest.raises(DamagedFile) as refusal:
        read_file(spoil(5, 15, 25, 35))

    assert refusal.value.facts == {"p": 8.0, "clock": "2026-03-02 08:00:01"}


def test_the_whole_recording_after_itself_is_counted_once() -> None:
    recording = read_file(log_of([*range(50), *range(50)]))

    assert spans_s(recording) == UNBROKEN
    assert counts(recording) == [("W-ORDER", 49), ("W-DUP", 50)]


def test_of_two_blocks_with_one_number_and_stamp_the_first_is_kept() -> None:
    recording = read_file(put(19, PARTS[19], block(19, START_US + 7_600_000, still_rows(40, 700))))

    assert spans_s(recording) == UNBROKEN
    assert codes(recording) == ["W-DUP-CONFLICT"]
    assert recording.segments[0].gyr_dps[19 * 40, 0] == pytest.approx(20 * 2000 / 32768)


def test_doubles_of_other_lengths_contradict_the_block_before() -> None:
    shorter = [block(k, START_US + BLOCK_US * k, still_rows(30, k)) for k in (10, 20)]

    recording = read_file(
        header() + b"".join([*PARTS[:11], shorter[0], *PARTS[11:21], shorter[1], *PARTS[21:]])
    )

    assert spans_s(recording) == UNBROKEN
    assert counts(recording) == [("W-DUP-CONFLICT", 2)]


def test_blocks_of_one_number_and_different_stamps_are_no_doubles() -> None:
    recording = read_file(put(30, block(29, START_US + 30 * BLOCK_US, still_rows(40, 900))))

    assert sum(rows for _, rows in spans_s(recording)) == 2000
    assert "W-DUP-CONFLICT" not in codes(recording)


def test_blocks_that_went_back_in_number_and_not_in_time_stay_where_they_are() -> None:
    """Number 20 stands where 30 was, with a stamp of its own: nothing agrees on its place."""
    recording = read_file(put(30, block(20, START_US + 4_000_000, still_rows(40, 800))))

    assert sum(rows for _, rows in spans_s(recording)) == 2000
    assert "W-ORDER" not in codes(recording)


def test_sound_blocks_of_no_known_layout_alone_are_refused() -> None:
    with pytest.raises(UnknownColumns):
        read_file(header() + b"".join(block(k, START_US + BLOCK_US * k, axes=0x52) for k in range(50)))


@pytest.mark.parametrize("number", [1, 2])
def test_very_few_blocks_are_read(number: int) -> None:
    recording = build_recording(DeviceHeader(), decode_log(blocks(range(number))))

    assert spans_s(recording) == [(0.0, 40 * number)]


def test_a_block_that_came_late_is_put_into_its_place() -> None:
    recording = read_file(log_of([*range(20), 21, 22, 20, *range(23, 50)]))

    numbers = recording.segments[0].gyr_dps[::40, 0] * 32768 / 2000
    assert numbers.round().tolist() == list(range(1, 51))
    assert codes(recording) == ["W-ORDER"]


def test_what_is_left_of_another_session_is_left_out() -> None:
    """It was recorded a week before, and may be another person's."""
    old = (block(50 + k, START_US - WEEK_US + BLOCK_US * k, session=76) for k in range(10))

    recording = read_file(WHOLE + b"".join(old))

    assert (spans_s(recording), recording.start) == (UNBROKEN, START)
    assert [(flag.code, flag.facts) for flag in recording.flags] == [("W-SESSION", {"n": 400})]


def test_the_session_that_the_header_names_is_kept_though_it_is_the_shorter_one() -> None:
    old = (block(50 + k, START_US - WEEK_US + BLOCK_US * k, session=76) for k in range(10))

    recording = read_file(header(session=76) + b"".join([*PARTS, *old]))

    assert spans_s(recording) == [(0.0, 400)]


def test_where_no_block_is_of_the_session_of_the_header_the_longer_one_is_kept() -> None:
    old = (block(50 + k, START_US + 60_000_000 + BLOCK_US * k, session=76) for k in range(10))

    recording = read_file(header(session=5) + b"".join([*PARTS, *old]))

    assert spans_s(recording) == UNBROKEN


@settings(max_examples=30, deadline=None)
@given(lost=st.sets(st.integers(1, 98), max_size=20))
def test_whatever_blocks_are_lost_every_other_sample_is_where_it_was(lost: set[int]) -> None:
    left = [k for k in range(100) if k not in lost]

    recording = read_file(log_of(left))

    at_s = [one.start_s + row / one.rate_hz for one in recording.segments for row in range(0, len(one), 40)]
    assert at_s == pytest.approx([0.4 * k for k in left], abs=1e-3)
    assert recording.duration_us == pytest.approx(40_000_000, abs=1000)
