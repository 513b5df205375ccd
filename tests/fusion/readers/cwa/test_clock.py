"""The clock of a `.cwa`: stamps that jump, are missing, scatter or drift, and what the durations are then."""

from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import UnusableTime
from fusion.readers import read_recording
from fusion.recording import MICROSECONDS
from tests.fusion.readers.cwa.cwa_builder import (
    START,
    START_US,
    block,
    blocks,
    codes,
    header,
    pack_time,
    read_file,
    spans_s,
    stamp_fields,
)

NEVER = (0, 0, 0)
"""A stamp that is no date."""
YEAR_2000_US = 946_684_800 * MICROSECONDS


def stamped(times_us: dict[int, int], *, of: int = 50) -> bytes:
    """Blocks in a row, some of which bear another time than their own."""
    parts = blocks(range(of))
    for number, time_us in times_us.items():
        parts[number] = block(number, time_us)
    return header() + b"".join(parts)


def test_a_stamp_alone_a_year_ahead_is_not_believed() -> None:
    year_us = 365 * 86_400 * MICROSECONDS

    recording = read_file(stamped({20: START_US + year_us}))

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == ["W-CLOCK-FWD"]


@pytest.mark.parametrize("number", [0, 49])
def test_a_first_or_last_stamp_far_from_all_others_is_not_believed(number: int) -> None:
    recording = read_file(stamped({number: START_US - 400 * 86_400 * MICROSECONDS}))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is not None
    assert abs(recording.start - START) < timedelta(milliseconds=1)
    assert codes(recording) == ["W-CLOCK-FWD"]


@pytest.mark.parametrize("numbers", [[20], [0], [0, 1], [48, 49], [10, 20, 30]])
def test_blocks_without_a_stamp_lie_where_their_numbers_say(numbers: list[int]) -> None:
    parts = blocks(range(50))
    for number in numbers:
        parts[number] = block(number, 0, stamp=NEVER)

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is not None
    assert abs(recording.start - START) < timedelta(milliseconds=1)
    assert codes(recording) == ["W-CLOCK-FWD"]


def test_without_any_stamp_the_rate_of_the_setting_is_used_and_said() -> None:
    parts = [block(k, 0, stamp=NEVER) for k in [*range(25), *range(30, 55)]]

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 1000), (12.0, 1000)]
    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET", "W-RATE", "W-GAP"]


def test_a_clock_that_was_never_set_gives_durations_and_no_hour() -> None:
    parts = [block(k, YEAR_2000_US + 400_000 * k) for k in range(50)]

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET"]


def test_a_clock_set_back_costs_no_time() -> None:
    later = {k: START_US - 3_600_000_000 + 400_000 * k for k in range(25, 50)}

    recording = read_file(stamped(later))

    assert [rows for _, rows in spans_s(recording)] == [1000, 1000]
    assert recording.duration_us == pytest.approx(20_000_000, abs=100)
    assert codes(recording) == ["W-CLOCK-BACK"]


def test_a_clock_days_ahead_makes_no_gap_of_days() -> None:
    later = {k: START_US + 3 * 86_400_000_000 + 400_000 * k for k in range(25, 50)}

    recording = read_file(stamped(later))

    assert recording.duration_us == pytest.approx(20_000_000, abs=100)
    assert codes(recording) == ["W-CLOCK-FWD"]


def test_stamps_that_scatter_by_some_milliseconds_make_no_holes() -> None:
    scatter_us = np.random.default_rng(3).normal(0.0, 2000.0, 500)
    parts = [block(k, START_US + 400_000 * k + round(scatter_us[k])) for k in range(500)]

    recording = read_file(header() + b"".join(parts))

    assert [rows for _, rows in spans_s(recording)] == [20_000]
    assert recording.rate_hz == pytest.approx(100.0, rel=1e-4)
    assert float(recording.understood["jitter_us"]) == pytest.approx(2000.0, rel=0.15)


def test_a_sample_that_was_lost_between_two_blocks_is_bridged_and_missing() -> None:
    late = {k: START_US + 10_000 + 400_000 * k for k in range(25, 50)}

    recording = read_file(stamped(late))

    (segment,) = recording.segments
    assert segment.bridged == ((1000, 1001),)
    assert len(segment) == 2001
    assert recording.flags[0].seconds == pytest.approx(0.010, abs=1e-4)


def test_a_block_whose_number_is_missing_is_a_hole_however_the_stamps_scatter() -> None:
    """At 1600 Hz a block is 25 ms, and eight times a scatter of 4 ms are more than that."""
    scatter_us = np.random.default_rng(4).normal(0.0, 4000.0, 2000)
    numbers = [*range(1000), *range(1001, 2000)]
    parts = [block(k, START_US + 25_000 * k + round(scatter_us[k]), rate=0x4E) for k in numbers]

    recording = read_file(header() + b"".join(parts))

    (gap,) = (flag for flag in recording.flags if flag.code == "W-GAP")
    assert gap.count == 1
    assert gap.seconds == pytest.approx(0.025, abs=0.02)


def test_a_clock_that_wanders_with_the_temperature_gives_the_true_duration() -> None:
    """The rate falls by 0.4 % over the recording: every block's stamp is true, none is a hole."""
    periods_us = 10_000 * (1 + 0.004 * np.linspace(0, 1, 2000))
    starts_us = START_US + np.concatenate([[0], np.cumsum(40 * periods_us)])
    parts = [block(k, round(starts_us[k])) for k in range(2000)]

    recording = read_file(header() + b"".join(parts))

    assert [rows for _, rows in spans_s(recording)] == [80_000]
    assert recording.duration_us == pytest.approx(starts_us[-1] - START_US, abs=20_000)


def test_stamps_of_no_use_are_refused() -> None:
    times_us = np.random.default_rng(5).uniform(0, 3e9, 2000)
    parts = [block(k, START_US + round(times_us[k])) for k in range(2000)]

    with pytest.raises(UnusableTime):
        read_file(header() + b"".join(parts))


def test_holes_before_every_other_block_are_no_sampling() -> None:
    parts = [block(k, START_US + 400_000 * k + 50_000 * (k // 3)) for k in range(1000)]

    with pytest.raises(UnusableTime):
        read_file(header() + b"".join(parts))


def test_a_date_that_is_none_is_no_stamp() -> None:
    packed, fraction, offset = stamp_fields(START_US + 8_000_000, 100.0)
    parts = blocks(range(50))
    thirtieth_of_february = (packed & ~(0x3FF << 17)) | 2 << 22 | 30 << 17
    parts[20] = block(20, 0, stamp=(thirtieth_of_february, fraction, offset))

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 2000)]


def test_packing_a_time_is_what_the_documentation_says() -> None:
    assert pack_time(START) == 0x68C48000


@pytest.mark.parametrize("moved", [-1, 1])
def test_the_row_of_a_stamp_may_move_by_one_while_the_stamps_go_on_evenly(moved: int) -> None:
    """As in a real AX6: from the fourth block on the row is 41 in place of 40, and nothing is missing."""
    parts = []
    for number in range(50):
        packed, fraction, row = stamp_fields(START_US + 400_000 * number, 100.0)
        parts.append(block(number, 0, stamp=(packed, fraction, row if number < 3 else row + moved)))

    recording = read_file(header() + b"".join(parts))

    assert spans_s(recording) == [(0.0, 2000)]
    assert codes(recording) == []


@pytest.mark.real_recordings
def test_a_real_ax6_is_one_unbroken_run(shared_data: Callable[[str], Path]) -> None:
    recording = read_recording(shared_data("other_layouts") / "ax6_sample.cwa")

    assert [len(segment) for segment in recording.segments] == [10_360]
    assert recording.rate_hz == pytest.approx(98.394, abs=0.001)
    assert codes(recording) == ["W-DRIFT"]
