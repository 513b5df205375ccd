"""Rows come to stand in the order in which they were measured, or nobody claims that they do."""

from collections.abc import Iterable
from datetime import datetime, timedelta

import numpy as np
import pytest

from fusion.errors import UnusableTime
from fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.badfiles.order_files import CALENDAR, MICROS, PASTED, ordered, stray, wall_clock
from tests.fusion.readers.tables.table_builder import HEADER, codes, line, read_text, table

ACC_G, GYR_DPS = minute()


def assert_is_the_minute(recording: Recording) -> None:
    """Every sample stands where it was measured, once."""
    (segment,) = recording.segments
    assert recording.duration_us == 60_000_000
    np.testing.assert_allclose(segment.acc_g, ACC_G, atol=1e-4)
    np.testing.assert_allclose(segment.gyr_dps, GYR_DPS, atol=1e-3)


@pytest.mark.parametrize(
    ("rows", "recorded_s"),
    [([*range(3000, 6000), *range(3000)], 60.0), (PASTED, 85.0)],
    ids=["halves", "two changed places"],
)
def test_pieces_in_the_wrong_order_read_like_a_clock_that_was_set(
    rows: Iterable[int], recorded_s: float
) -> None:
    recording = read_text(ordered(rows))

    assert "W-CLOCK-BACK" in codes(recording)
    assert recording.duration_us / 1e6 == pytest.approx(recorded_s, abs=0.1)


def test_rows_that_come_again_after_a_step_back_count_once() -> None:
    recording = read_text(ordered([*range(3000), *range(2900, 6000)]))

    assert_is_the_minute(recording)
    assert {flag.code: flag.count for flag in recording.flags} == {"W-DUP": 100}


def test_pieces_that_overlap_and_differ_are_a_clock_that_was_set() -> None:
    stamps = [*range(0, 20_000_000, 10_000), *range(10_000_000, 30_000_000, 10_000)]

    recording = read_text(table(stamps))

    assert codes(recording) == ["W-CLOCK-BACK"]
    assert recording.duration_us == 40_000_000


def test_a_clock_set_back_by_far_more_than_was_recorded_is_no_piece() -> None:
    stamps = [*range(3_600_000_000, 3_620_000_000, 10_000), *range(0, 20_000_000, 10_000)]

    recording = read_text(table(stamps))

    assert codes(recording) == ["W-CLOCK-BACK"]


def test_the_hour_that_comes_twice_in_fall_is_no_piece_that_goes_on() -> None:
    first = datetime(2026, 11, 1, 1, 30)  # noqa: DTZ001
    moments = [first + timedelta(seconds=k / 10, hours=-1 if k >= 18_000 else 0) for k in range(36_000)]
    rows = [f"{moment.isoformat(timespec='milliseconds')},{line(k)}" for k, moment in enumerate(moments)]

    recording = read_text(CALENDAR + "\n" + "\n".join(rows) + "\n")

    assert codes(recording) == ["W-DST"]
    assert recording.start == first


@pytest.mark.parametrize("digits", [23, 19], ids=["milliseconds", "whole seconds"])
def test_a_table_with_its_newest_row_first_is_refused_with_that_cause(digits: int) -> None:
    with pytest.raises(UnusableTime) as refusal:
        read_text(ordered(range(5999, -1, -1), wall_clock(digits=digits), CALENDAR))

    assert refusal.value.facts == {"why": "reversed"}


@pytest.mark.parametrize(
    "stamps",
    [[0] * 50, range(0, 500_000, 10_000), [9_000_000_000] * 50, range(7, 57)],
    ids=["at 0", "from 0", "far ahead", "nearly still"],
)
def test_stamps_that_their_neighbours_contradict_cost_nothing(stamps: Iterable[int]) -> None:
    recording = read_text(stray(list(stamps)))

    (flag,) = recording.flags
    assert_is_the_minute(recording)
    assert (flag.code, flag.count) == ("W-CLOCK-FWD", 50)


def test_stamps_at_the_epoch_on_a_clock_of_whole_seconds_make_no_hole_of_decades() -> None:
    stamps = wall_clock(digits=19)
    stamps[3020:3070] = ["1970-01-01T00:00:00"] * 50

    recording = read_text(ordered(range(6000), stamps, CALENDAR))

    assert recording.duration_us / 1e6 == pytest.approx(60.0, abs=1.5)


def test_rows_at_zero_follow_the_rows_before_them() -> None:
    recording = read_text(stray([0] * 50, [*range(3050), *range(3150, 6000)]))

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 3050), (31_500_000, 2850)]
    assert codes(recording) == ["W-CLOCK-FWD", "W-GAP"]


@pytest.mark.parametrize("place", [0, -1], ids=["first", "last"])
def test_a_lone_stamp_at_an_end_makes_no_hole_of_an_hour(place: int) -> None:
    stamps = [10_000_000_000 + us for us in MICROS]
    stamps[place] += 3_600_000_000 if place else -3_600_000_000

    recording = read_text(ordered(range(6000), stamps))

    assert (recording.duration_us, codes(recording)) == (59_990_000, ["W-ROWS-DROPPED"])


def test_a_counter_of_16_bits_reads_like_a_clock_that_was_set() -> None:
    stamps = [(2**16 - 5_000 + us // 1000) % 2**16 for us in MICROS]

    recording = read_text(ordered(range(6000), stamps, HEADER.replace("time_us", "time_ms")))

    assert codes(recording) == ["W-CLOCK-BACK"]
    assert recording.duration_us == 60_000_000
