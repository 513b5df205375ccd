"""Where rows come at another rate for a while, the time around them stays what it was."""

import numpy as np
import pytest

from fusion.errors import UnusableTime
from fusion.recording import Recording
from tests.badfiles.order_files import ordered, thinned, thinned_at_random
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import read_text, table


def spans(recording: Recording) -> list[tuple[int, int, float]]:
    return [(s.start_us, s.end_us, round(s.rate_hz, 2)) for s in recording.segments]


def test_a_stretch_of_half_the_rate_is_a_segment_of_its_own() -> None:
    recording = read_text(ordered(thinned(2000, 4000, 2)))

    (flag,) = recording.flags
    assert spans(recording) == [
        (0, 20_000_000, 100.0),
        (20_000_000, 40_000_000, 50.0),
        (40_000_000, 60_000_000, 100.0),
    ]
    assert (flag.code, flag.count, flag.facts) == ("W-RATE-CHANGE", 1, {"rate_hz": 50.0})
    assert flag.spans_s == ((20.0, 40.0),)


@pytest.mark.parametrize("place_s", [1, 30, 49])
def test_a_rate_that_changes_for_good_changes_there(place_s: int) -> None:
    recording = read_text(ordered(thinned(100 * place_s, 6000, 2)))

    first, second = recording.segments
    assert (first.end_us, second.start_us) == pytest.approx((1e6 * place_s, 1e6 * place_s), abs=5000)
    assert (round(first.rate_hz), round(second.rate_hz)) == (100, 50)
    assert recording.duration_us == pytest.approx(60_000_000, abs=20_000)


@pytest.mark.parametrize(("hz", "other_hz"), [(100, 119), (104, 208), (476, 952), (119, 59.5)])
def test_uneven_stamps_hide_no_change_of_rate(hz: float, other_hz: float) -> None:
    random = np.random.default_rng(7)
    times_s = np.concatenate([np.arange(0, 30, 1 / hz), np.arange(30, 60, 1 / other_hz)])
    stamps = np.round(times_s * 1e6 + random.uniform(-100, 100, len(times_s))).astype(int)

    recording = read_text(table(stamps.tolist()))

    assert recording.duration_us == pytest.approx(60_000_000, abs=20_000)
    assert [round(s.rate_hz, 1) for s in recording.segments] == [hz, other_hz]
    assert codes(recording) == ["W-RATE-CHANGE"]


def test_for_a_short_while_lost_rows_are_bridged_as_ever() -> None:
    recording = read_text(ordered(thinned(2000, 2600, 2)))

    (segment,) = recording.segments
    assert (len(segment), len(segment.bridged)) == (6000, 300)
    assert codes(recording) == ["W-GAP"]


def test_a_table_of_nothing_but_uneven_steps_is_refused() -> None:
    with pytest.raises(UnusableTime) as refusal:
        read_text(ordered(thinned_at_random(0, 6000)))

    assert refusal.value.facts == {"why": "irregular"}


@pytest.mark.parametrize("slow_s", [60, 12])
def test_a_clock_of_whole_seconds_hides_no_change_of_rate(slow_s: int) -> None:
    """At 100 Hz, then at 50: before, half of each second was missing, and the rest went twice as fast."""
    fast = 100 - slow_s
    seconds = [s for s in range(100) for _ in range(100 if s < fast else 50)]

    recording = read_text(table(1_000_000 * s for s in seconds))

    assert spans(recording) == [(0, fast * 1_000_000, 100.0), (fast * 1_000_000, 100_000_000, 50.0)]
    assert codes(recording) == ["W-JITTER", "W-RATE-CHANGE"]


def test_a_second_with_fewer_rows_is_a_hole_and_no_change_of_rate() -> None:
    seconds = [s for s in range(30) for _ in range(60 if s == 15 else 100)]

    recording = read_text(table(1_000_000 * s for s in seconds))

    assert codes(recording) == ["W-JITTER", "W-GAP"]
    assert spans(recording) == [(0, 15_600_000, 100.0), (16_000_000, 30_000_000, 100.0)]
