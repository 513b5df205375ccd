"""Rows come to stand in the order in which they were measured, or nobody claims that they do."""

from collections.abc import Iterable
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.badfiles.order_files import CALENDAR, MICROS, PASTED, ordered, stray, wall_clock
from tests.fusion.table_builder import HEADER, codes, line, read_text, table

ACC_G, GYR_DPS = minute()


def assert_is_the_minute(recording: Recording) -> None:
    """Every sample stands where it was measured, once."""
    (segment,) = recording.segments
    assert recording.duration_us == 60_000_000
    np.testing.assert_allclose(segment.acc_g, ACC_G, atol=1e-4)
    np.testing.assert_allclose(segment.gyr_dps, GYR_DPS, atol=1e-3)


@pytest.mark.parametrize(
    "rows",
    [
        PASTED,
        [*range(3000, 6000), *range(3000)],
        [*range(4500, 6000), *range(3000, 4500), *range(1500, 3000), *range(1500)],
        [*range(2000), *range(2030, 6000), *range(2000, 2030)],
    ],
    ids=["two changed places", "halves", "four from the last", "0.3 s put last"],
)
def test_pieces_are_put_in_the_order_of_their_stamps(rows: Iterable[int]) -> None:
    recording = read_text(ordered(rows))

    assert_is_the_minute(recording)
    assert codes(recording) == ["W-PIECES"]


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.integers(1, 58), min_size=1, max_size=5, unique=True),
    st.randoms(use_true_random=False),
)
def test_pieces_in_any_order_are_all_there_once(cuts_s: list[int], random: object) -> None:
    edges = [0, *sorted(100 * cut_s for cut_s in cuts_s), 6000]
    pieces = [range(first, stop) for first, stop in pairwise(edges)]
    random.shuffle(pieces)  # type: ignore[attr-defined]

    recording = read_text(ordered([k for piece in pieces for k in piece]))

    assert_is_the_minute(recording)


def test_rows_that_two_pieces_share_count_once() -> None:
    rows = [*range(2000), *range(2900, 4500), *range(2000, 3000), *range(4500, 6000)]

    recording = read_text(ordered(rows))

    flags = {flag.code: flag.count for flag in recording.flags}
    assert_is_the_minute(recording)
    assert flags == {"W-PIECES": 2, "W-DUP": 100}


def test_late_rows_inside_a_piece_are_put_right_too() -> None:
    rows = list(PASTED)
    rows[500], rows[501] = rows[501], rows[500]

    recording = read_text(ordered(rows))

    assert_is_the_minute(recording)
    assert codes(recording) == ["W-PIECES", "W-ORDER"]


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
def test_a_table_with_its_newest_row_first_is_read_from_its_end(digits: int) -> None:
    recording = read_text(ordered(range(5999, -1, -1), wall_clock(digits=digits), CALENDAR))

    assert_is_the_minute(recording)
    assert recording.start == datetime(2026, 3, 14, 8)  # noqa: DTZ001
    assert "W-REVERSED" in codes(recording)


def test_a_change_of_the_offset_is_told_as_it_was_in_a_table_turned_round() -> None:
    stamps = [stamp + ("-05:00" if k >= 3000 else "-04:00") for k, stamp in enumerate(wall_clock())]
    stamps[3000:] = [stamp.replace("T08", "T07") for stamp in stamps[3000:]]

    recording = read_text(ordered(range(5999, -1, -1), stamps, CALENDAR))

    flag = next(flag for flag in recording.flags if flag.code == "W-OFFSET")
    assert_is_the_minute(recording)
    assert flag.facts == {"step_s": -3600}


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


@pytest.mark.parametrize("first", [3000, 3020, 2980], ids=["a whole second", "inside one", "across two"])
def test_stamps_at_the_epoch_among_whole_seconds_cost_nothing(first: int) -> None:
    stamps = wall_clock(digits=19)
    stamps[first : first + 50] = ["1970-01-01T00:00:00"] * 50

    recording = read_text(ordered(range(6000), stamps, CALENDAR))

    assert_is_the_minute(recording)
    assert codes(recording) == ["W-CLOCK-FWD", "W-JITTER"]


def test_rows_at_zero_between_lost_ones_are_left_out() -> None:
    recording = read_text(stray([0] * 50, [*range(3050), *range(3150, 6000)]))

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 3000), (31_500_000, 2850)]
    assert codes(recording) == ["W-ROWS-DROPPED", "W-GAP"]


@pytest.mark.parametrize("place", [0, -1], ids=["first", "last"])
def test_a_lone_stamp_at_an_end_makes_no_hole_of_an_hour(place: int) -> None:
    stamps = [10_000_000_000 + us for us in MICROS]
    stamps[place] += 3_600_000_000 if place else -3_600_000_000

    recording = read_text(ordered(range(6000), stamps))

    assert (recording.duration_us, codes(recording)) == (59_990_000, ["W-ROWS-DROPPED"])


@pytest.mark.parametrize(
    ("bits", "tick_us", "name"),
    [(16, 1000, "time_ms"), (24, 1, "time_us"), (24, 1000, "time_ms"), (16, 1, "time_us")],
)
def test_short_counters_are_carried_on_across_their_end(bits: int, tick_us: int, name: str) -> None:
    stamps = [(2**bits * tick_us - 5_000_000 + us) // tick_us % 2**bits for us in MICROS]

    recording = read_text(ordered(range(6000), stamps, HEADER.replace("time_us", name)))

    assert_is_the_minute(recording)
    assert codes(recording) == ["W-WRAP"]


def test_a_counter_with_a_sign_goes_on_below_zero() -> None:
    stamps = [(2**31 - 20_000_000 + us + 2**31) % 2**32 - 2**31 for us in MICROS]

    recording = read_text(ordered(range(6000), stamps))

    assert_is_the_minute(recording)
    assert codes(recording) == ["W-WRAP"]


def test_a_hole_at_the_end_of_a_short_counter_is_missing() -> None:
    times_us = [us for us in range(30_000_000, 250_000_000, 10_000) if not 64_000_000 <= us < 68_000_000]

    recording = read_text(
        table([us // 1000 % 2**16 for us in times_us], HEADER.replace("time_us", "time_ms"))
    )

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 3400), (38_000_000, 18_200)]
