"""The clock of a `.cwa`: stamps that jump, are missing, scatter or drift, and the durations that result."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import UnusableTime
from fusion.readers import read_recording
from fusion.recording import Recording
from tests.fusion.readers.cwa.cwa_builder import START, START_US, block, header, pack_time, stamp_fields
from tests.fusion.readers.seen import codes, read_file, spans_s

BLOCK_US = 400_000
DAY_US = 86_400_000_000
NEVER = (0, 0, 0)
"""A stamp that is no date."""


def read_stamped(times_us: Mapping[int, int], n_blocks: int = 50) -> Recording:
    """Read blocks in a row, some of which bear another time than their own."""
    return read_blocks(block(k, times_us.get(k, START_US + BLOCK_US * k)) for k in range(n_blocks))


def read_blocks(parts: Iterable[bytes]) -> Recording:
    return read_file(header() + b"".join(parts))


@pytest.mark.parametrize(
    ("number", "time_us"),
    [(20, START_US + 365 * DAY_US), (0, START_US - 400 * DAY_US), (49, START_US - 400 * DAY_US)],
    ids=["a year ahead", "first", "last"],
)
def test_a_stamp_alone_far_from_all_others_is_not_believed(number: int, time_us: int) -> None:
    recording = read_stamped({number: time_us})

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is not None
    assert abs((recording.start - START).total_seconds()) < 0.001
    assert codes(recording) == ["W-CLOCK-FWD"]


@pytest.mark.parametrize("numbers", [[20], [0, 1], [48, 49], [10, 20, 30]])
def test_blocks_without_a_stamp_lie_where_their_numbers_say(numbers: list[int]) -> None:
    recording = read_blocks(
        block(k, START_US + BLOCK_US * k, stamp=NEVER if k in numbers else None) for k in range(50)
    )

    assert spans_s(recording) == [(0.0, 2000)]
    assert recording.start is not None
    assert abs((recording.start - START).total_seconds()) < 0.001
    assert codes(recording) == ["W-CLOCK-FWD"]


def test_without_any_stamp_the_rate_of_the_setting_is_used_and_said() -> None:
    recording = read_blocks(block(k, 0, stamp=NEVER) for k in [*range(25), *range(30, 55)])

    assert spans_s(recording) == [(0.0, 1000), (12.0, 1000)]
    assert recording.start is None
    assert codes(recording) == ["W-CLOCK-UNSET", "W-RATE", "W-GAP"]


@pytest.mark.parametrize(("step_us", "code"), [(-3_600_000_000, "W-CLOCK-BACK"), (3 * DAY_US, "W-CLOCK-FWD")])
def test_a_clock_that_was_set_costs_no_time(step_us: int, code: str) -> None:
    recording = read_stamped({k: START_US + step_us + BLOCK_US * k for k in range(25, 50)})

    assert [len(segment) for segment in recording.segments] == [1000, 1000]
    assert recording.duration_us == pytest.approx(20_000_000, abs=100)
    assert codes(recording) == [code]


def test_stamps_that_scatter_by_some_milliseconds_make_no_holes() -> None:
    scatter_us = np.random.default_rng(3).normal(0.0, 2000.0, 500)

    recording = read_blocks(block(k, START_US + BLOCK_US * k + round(scatter_us[k])) for k in range(500))

    assert [len(segment) for segment in recording.segments] == [20_000]
    assert recording.rate_hz == pytest.approx(100.0, rel=1e-4)
    assert float(recording.understood["jitter_us"]) == pytest.approx(2000.0, rel=0.15)


def test_a_sample_that_was_lost_between_two_blocks_is_bridged_and_missing() -> None:
    recording = read_stamped({k: START_US + 10_000 + BLOCK_US * k for k in range(25, 50)})

    (segment,) = recording.segments
    assert (len(segment), segment.bridged) == (2001, ((1000, 1001),))
    assert recording.flags[0].seconds == pytest.approx(0.010, abs=1e-4)


def test_a_block_whose_number_is_missing_is_a_hole_however_the_stamps_scatter() -> None:
    """At 1600 Hz a block is 25 ms, and eight times a scatter of 4 ms are more than that."""
    scatter_us = np.random.default_rng(4).normal(0.0, 4000.0, 2000)
    numbers = [*range(1000), *range(1001, 2000)]

    recording = read_blocks(
        block(k, START_US + 25_000 * k + round(scatter_us[k]), rate=0x4E) for k in numbers
    )

    (gap,) = (flag for flag in recording.flags if flag.code == "W-GAP")
    assert gap.count == 1
    assert gap.seconds == pytest.approx(0.025, abs=0.02)


def test_a_clock_that_wanders_with_the_temperature_gives_the_true_duration() -> None:
    """The rate falls by 0.4 % over the recording: every block's stamp is true, none is a hole."""
    periods_us = 10_000 * (1 + 0.004 * np.linspace(0, 1, 2000))
    starts_us = START_US + np.concatenate([[0], np.cumsum(40 * periods_us)])

    recording = read_blocks(block(k, round(starts_us[k])) for k in range(2000))

    assert [len(segment) for segment in recording.segments] == [80_000]
    assert recording.duration_us == pytest.approx(starts_us[-1] - START_US, abs=20_000)


@pytest.mark.parametrize(
    "times_us",
    [
        np.random.default_rng(5).uniform(0, 3e9, 2000).round().astype(int).tolist(),
        [BLOCK_US * k + 50_000 * (k // 3) for k in range(1000)],
    ],
    ids=["at random", "a hole before every third block"],
)
def test_stamps_of_no_even_sampling_are_refused(times_us: list[int]) -> None:
    with pytest.raises(UnusableTime):
        read_blocks(block(k, START_US + us) for k, us in enumerate(times_us))


def test_a_date_that_is_none_is_no_stamp() -> None:
    packed, fraction, offset = stamp_fields(START_US + 8_000_000, 100.0)
    thirtieth_of_february = ((packed & ~(0x3FF << 17)) | 2 << 22 | 30 << 17, fraction, offset)

    recording = read_blocks(
        block(k, START_US + BLOCK_US * k, stamp=thirtieth_of_february if k == 20 else None) for k in range(50)
    )

    assert spans_s(recording) == [(0.0, 2000)]


def test_packing_a_time_is_what_the_documentation_says() -> None:
    assert pack_time(START) == 0x68C48000


@pytest.mark.parametrize("moved", [-1, 1])
def test_the_row_of_a_stamp_may_move_by_one_while_the_stamps_go_on_evenly(moved: int) -> None:
    """As in a real AX6: from the fourth block on the row is 41 in place of 40, and nothing is missing."""
    parts = []
    for number in range(50):
        packed, fraction, row = stamp_fields(START_US + BLOCK_US * number, 100.0)
        parts.append(block(number, 0, stamp=(packed, fraction, row if number < 3 else row + moved)))

    recording = read_blocks(parts)

    assert (spans_s(recording), codes(recording)) == ([(0.0, 2000)], [])


@pytest.mark.real_recordings
def test_a_real_ax6_is_one_unbroken_run(shared_data: Callable[[str], Path]) -> None:
    recording = read_recording(shared_data("other_layouts") / "ax6_sample.cwa")

    assert [len(segment) for segment in recording.segments] == [10_360]
    assert recording.rate_hz == pytest.approx(98.394, abs=0.001)
    assert codes(recording) == ["W-DRIFT"]
