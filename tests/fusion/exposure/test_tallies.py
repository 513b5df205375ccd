"""What is counted in blocks and at several errors of the angle, against slow, obvious counts."""

from collections.abc import Sequence
from itertools import groupby

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.resampling import draw_blocks, sum_below
from acromion.fusion.exposure.speeds import (
    CycleTally,
    FrequencyTally,
    count_crossings,
    find_mean_power_frequency,
    measure_inclination,
)
from acromion.fusion.exposure.stays import (
    ANGLE_EDGES_DEG,
    DURATION_EDGES_S,
    REST_S,
    RESTS,
    SLOW_DPS,
    EvaTally,
    RecoveryTally,
)
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.runs import add_time
from tests.factories import elevate

ANGLES = st.sampled_from([0.0, 12.0, 17.0, 19.5, 20.0, 21.0, 24.0, 30.0, 34.0, 60.0, 64.0, 90.0, 150.0])
SERIES = hnp.arrays(np.float64, st.integers(2, 90), elements=ANGLES)
GAPS = st.lists(st.integers(0, 89), max_size=3)
ERRORS_DEG = np.linspace(-7.5, 7.5, 11)
BLOCKS_US = np.array([0, 7_000_000, 30_000_000, 10**9])


def make_angle(series: NDArray[np.float64], gaps: Sequence[int] = ()) -> MetricAngle:
    """Make an angle at 2 Hz with rows that are not valid."""
    valid = np.ones(len(series), np.bool_)
    valid[[gap for gap in gaps if gap < len(series)]] = False
    return MetricAngle(0, 2.0, series, valid)


def block_of(row: int) -> int:
    return int(np.searchsorted(BLOCKS_US, row / 2.0 * 1e6, side="right")) - 1


def list_stays(states: Sequence[object]) -> list[tuple[object, int, int]]:
    """Return (state, first row, row after the last) of each unbroken run of equal states."""
    stays, row = [], 0
    for state, group in groupby(states):
        stays.append((state, row, row := row + len(list(group))))
    return stays


@given(SERIES, GAPS)
@settings(max_examples=50, deadline=None)
def test_variation_is_counted_where_it_lies_at_every_error(
    series: NDArray[np.float64], gaps: list[int]
) -> None:
    angle = make_angle(series, gaps)
    tally = EvaTally(ERRORS_DEG, BLOCKS_US)
    tally.add(angle)

    slow = np.zeros_like(tally.seconds)
    durations_s = [edge for edge in DURATION_EDGES_S if edge is not None]
    for error, error_deg in enumerate(ERRORS_DEG):
        inner = [round(edge - error_deg, 9) for edge in ANGLE_EDGES_DEG[1:-1]]
        classes = np.where(angle.valid, np.searchsorted(inner, series, side="right"), -1).tolist()
        for state, first, stop in list_stays(classes):
            if isinstance(state, int) and state >= 0:
                length = sum(edge <= (stop - first) / 2 for edge in durations_s) - 1
                for row in range(first, stop):
                    slow[error, block_of(row), state, length] += 0.5
    assert tally.seconds == pytest.approx(slow)


@given(SERIES, GAPS)
@settings(max_examples=50, deadline=None)
def test_rest_is_counted_where_it_lies_at_every_error(series: NDArray[np.float64], gaps: list[int]) -> None:
    angle = make_angle(series, gaps)
    speeds_dps = measure_inclination(series, angle.valid, 2.0)
    tally = RecoveryTally(ERRORS_DEG, BLOCKS_US)
    tally.add(angle, speeds_dps < SLOW_DPS)

    is_slow = speeds_dps < 5.0
    check_stays(is_slow, tally.slow)
    for error, error_deg in enumerate(ERRORS_DEG):
        without = np.where(angle.valid, 0, -1)
        for first, stop in check_stays(is_slow & (series < round(20.0 - error_deg, 9)), tally.rest[error]):
            without[first:stop] = 1
        lengths = [stop - first for state, first, stop in list_stays(without.tolist()) if state == 0]
        assert tally.longest_s[error] == pytest.approx(max(lengths, default=0) / 2)


def check_stays(states: NDArray[np.bool_], counted: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Compare the stays of 3 s or more with what was counted, and return them."""
    stays = [(a, b) for state, a, b in list_stays(states.tolist()) if state and b - a >= 6]
    slow = np.zeros_like(counted)
    for first, stop in stays:
        slow[block_of(first), RESTS] += 1
        for row in range(first, stop):
            slow[block_of(row), REST_S] += 0.5
    assert counted == pytest.approx(slow)
    return stays


@given(SERIES, GAPS)
@settings(max_examples=50, deadline=None)
def test_changes_of_direction_are_counted_one_by_one(series: NDArray[np.float64], gaps: list[int]) -> None:
    angle = make_angle(series, gaps)
    counts = np.zeros(1)
    count_crossings(series, angle.valid, 2.0, np.array([0, len(series)]), counts)

    slow, way = 0, 0
    for row in range(1, len(series)):
        if not (angle.valid[row] and angle.valid[row - 1]):
            way = 0
            continue
        speed_dps = 2.0 * (series[row] - series[row - 1])
        if abs(speed_dps) > 10.0:
            slow += np.sign(speed_dps) == -way
            way = int(np.sign(speed_dps))
    assert counts[0] == slow


def count_cycles(angle: MetricAngle, edges_us: NDArray[np.int64], *errors_deg: float) -> NDArray[np.float64]:
    tally = CycleTally(np.array(errors_deg or (0.0,)), edges_us)
    tally.add(angle)
    return tally.counts if errors_deg else tally.counts[0]


def test_a_cycle_belongs_to_the_block_in_which_it_ends() -> None:
    # 0 to 40 and back before the 7th second, then 0 to 80 up to the 10th: the first is whole there
    angle = make_angle(np.r_[np.linspace(0, 40, 6), np.linspace(40, 0, 6), np.linspace(0, 80, 8)])

    counts = count_cycles(angle, BLOCKS_US)
    assert counts[:, 1].tolist() == [1.0, 0.0, 0.0]
    assert counts[:, 2].tolist() == [0.0, 0.5, 0.0]


def test_an_error_of_the_angle_changes_a_range_only_at_an_end_of_the_scale() -> None:
    # 5 to 70 deg and back: read 10 deg too high it was 0 to 60; 10 too low, 15 to 80; 20 too high, 0 to 50
    angle = make_angle(np.r_[np.linspace(5, 70, 8), np.linspace(70, 5, 8)])

    counts = count_cycles(angle, np.array([0, 10**9]), -10.0, 0.0, 10.0, 20.0)[:, 0]
    assert counts.tolist() == [[0, 0, 1, 0], [0, 0, 1, 0], [0, 0, 1, 0], [0, 1, 0, 0]]


@given(SERIES, GAPS, st.floats(-15.0, 15.0))
@settings(max_examples=50, deadline=None)
def test_cycles_with_an_error_are_those_of_the_angle_without_it(
    series: NDArray[np.float64], gaps: list[int], error_deg: float
) -> None:
    error_deg = round(error_deg, 3)
    corrected = make_angle(np.asarray(np.round(np.clip(series - error_deg, 0.0, 180.0), 6), np.float64), gaps)

    counts = count_cycles(make_angle(series, gaps), BLOCKS_US, -error_deg, 0.0, error_deg)
    assert counts[2].sum(axis=0) == pytest.approx(count_cycles(corrected, BLOCKS_US).sum(axis=0))


def test_frequencies_of_a_run_lie_in_the_blocks_of_its_windows() -> None:
    time_s = np.arange(600 * 50) / 50
    swing = 45 + 30 * np.sin(2 * np.pi * np.where(time_s < 300, 0.3, 1.1) * time_s)
    tally = FrequencyTally(np.array([0, 300, 600]) * 1_000_000)
    tally.add(MetricAngle(0, 50.0, swing, np.ones(len(swing), np.bool_)))

    first_hz, second_hz = tally.moments[:, 0] / tally.moments[:, 1]
    assert first_hz == pytest.approx(0.3, abs=0.1)
    assert second_hz == pytest.approx(1.1, abs=0.1)


def test_frequencies_above_5_hz_are_left_out() -> None:
    time_s = np.arange(12_000) / 100
    fast = 45 + 10 * np.sin(2 * np.pi * 4.5 * time_s) + 20 * np.sin(2 * np.pi * 6 * time_s)

    assert find_mean_power_frequency(fast, 100.0) == pytest.approx(4.5, abs=0.01)


@given(
    hnp.arrays(np.int32, (4, 6), elements=st.integers(0, 900)), st.sampled_from([100.0, 99.97, 238.0, 33.3])
)
@settings(max_examples=50, deadline=None)
def test_time_adds_up_to_the_rounded_whole(counts: NDArray[np.int32], rate_hz: float) -> None:
    cell_us = np.zeros((4, 6), np.int64)
    add_time(counts, rate_hz, cell_us)

    assert cell_us.sum() == round(int(counts.sum()) * 1e6 / rate_hz)
    assert cell_us == pytest.approx(counts * 1e6 / rate_hz, abs=1.0)


@given(
    hnp.arrays(np.int64, (3, 1800), elements=st.integers(0, 50)).filter(lambda cells: bool(cells.sum() > 0)),
    st.sampled_from([0.0, 3.0]),
)
@settings(max_examples=50, deadline=None)
def test_drawn_shares_and_percentiles_are_those_of_the_days_added_up(
    cells: NDArray[np.int64], sigma_deg: float
) -> None:
    draws = draw_blocks(cells.sum(axis=1), sigma_deg)
    below = sum_below(cells, draws)
    shares, percentiles_deg = below.find_shares((60.0,)), below.find_percentiles((50,))

    kept = cells[draws.kept]
    for draw in (0, 77, 199):
        day = (draws.times[draw][:, np.newaxis] * kept).sum(axis=0)
        reached = np.concatenate([[0.0], np.cumsum(day)]) / day.sum()
        edges_deg, error_deg = np.arange(1801) / 10, draws.error_deg[draw]
        assert shares[draw, 0] == pytest.approx(np.interp(60.0 - error_deg, edges_deg, reached))
        middle_deg = np.clip(percentiles_deg[draw, 0] - error_deg, 0, 180)
        if 0 < percentiles_deg[draw, 0] < 180:
            assert np.interp(middle_deg, edges_deg, reached) == pytest.approx(0.5)


@given(SERIES, GAPS)
@settings(max_examples=50, deadline=None)
def test_speeds_are_those_of_the_steps_sorted(series: NDArray[np.float64], gaps: list[int]) -> None:
    elevation = elevate(series, rate_hz=2.0)
    elevation.segments[0].valid[[gap for gap in gaps if gap < len(series)]] = False
    valid = elevation.segments[0].valid
    moved = valid[1:] & valid[:-1]
    steps = (2.0 * np.abs(np.diff(series)))[moved]
    if len(steps) == 0:
        return

    velocity = summarise_exposure(elevation).velocity_dps["inclination"]
    assert velocity is not None
    assert velocity.mean_dps == pytest.approx(np.mean(steps))
    assert velocity.p50_dps == pytest.approx(np.percentile(steps, 50, method="inverted_cdf"), abs=0.011)
    assert velocity.p90_dps == pytest.approx(np.percentile(steps, 90, method="inverted_cdf"), abs=0.011)
