"""Rows come to stand in the order in which they were measured, or nobody claims that they do."""

from collections.abc import Iterable
from datetime import datetime, timedelta

import numpy as np
import pytest

from fusion.errors import UnusableTime
from fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.badfiles.order_files import CALENDAR, ordered, stray, wall_clock
from tests.badfiles.table_files import MICROS
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import line, read_text, table

ACC_G, GYR_DPS = minute()


def assert_is_the_minute(recording: Recording) -> None:
    """Every sample stands where it was measured, once."""
    (segment,) = recording.segments
    assert recording.duration_us == 60_000_000
    np.testing.assert_allclose(segment.acc_g, ACC_G, atol=1e-4)
    np.testing.assert_allclose(segment.gyr_dps, GYR_DPS, atol=1e-3)


def test_pieces_that_overlap_and_differ_are_a_clock_that_was_set() -> None:
    stamps = [*range(0, 20_000_000, 10_000), *range(10_000_000, 30_000_000, 10_000)]

    recording = read_text(table(stamps))

    assert codes(recording) == ["W-CLOCK-BACK"]
    assert recording.duration_us == 40_000_000


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


@pytest.mark.parametrize("place", [0, -1], ids=["first", "last"])
def test_a_lone_stamp_at_an_end_makes_no_hole_of_an_hour(place: int) -> None:
    stamps = [10_000_000_000 + us for us in MICROS]
    stamps[place] += 3_600_000_000 if place else -3_600_000_000

    recording = read_text(ordered(range(6000), stamps))

    assert (recording.duration_us, codes(recording)) == (59_990_000, ["W-ROWS-DROPPED"])
