"""Rest, frequency, variation, long stays: against values worked out by hand and slow, obvious counts."""

from itertools import groupby

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from fusion.exposure import Exposure, PartExposure, summarise_exposure
from fusion.exposure.bins import cut_day
from fusion.exposure.episodes import LONGER_S, STAY_S, STAYS, ShiftedStays, find_stays
from fusion.exposure.intervals import describe_hours
from fusion.exposure.metric_filter import MetricAngle
from fusion.exposure.peaks import ShiftedSeconds
from fusion.exposure.speeds import count_crossings, find_mean_power_frequency
from tests.factories import elevate


def summarise(*runs: NDArray[np.float64], rate_hz: float = 10.0) -> Exposure:
    return summarise_exposure(elevate(*runs, rate_hz=rate_hz))


def hold(*parts: tuple[float, float]) -> NDArray[np.float64]:
    """Give (angle, seconds) at 10 Hz."""
    return np.concatenate([np.full(round(seconds * 10), angle) for angle, seconds in parts])


def test_hanging_still_for_3_s_is_rest_and_shorter_is_not() -> None:
    recovery = summarise(hold((50, 10), (10, 3.1), (50, 10), (10, 3.0), (50, 10))).recovery

    assert recovery is not None  # the step into a hold is fast: of 3.1 s three are slow
    assert recovery.neutral_slow_per_hour is not None
    assert recovery.neutral_slow_per_hour * 36.1 / 3600 == pytest.approx(1.0)
    assert recovery.neutral_slow_percent == pytest.approx(100 * 3.0 / 36.1)


def test_an_arm_held_high_is_slow_but_not_at_rest() -> None:
    recovery = summarise(hold((50, 60))).recovery

    assert recovery is not None
    assert (recovery.neutral_slow_percent, recovery.longest_without_s) == (0.0, 60.0)
    assert recovery.slow_percent == pytest.approx(100 * 59.9 / 60)


def test_the_longest_time_without_rest_lies_between_two_rests() -> None:
    recovery = summarise(hold((10, 10), (50, 20), (10, 10), (50, 5), (10, 10))).recovery

    assert recovery is not None
    assert recovery.longest_without_s == pytest.approx(20.1)  # and the step back down


def test_a_hole_ends_rest() -> None:
    recovery = summarise(hold((10, 2.5)), hold((10, 2.5))).recovery

    assert recovery is not None
    assert recovery.neutral_slow_per_hour == 0.0


@given(
    hnp.arrays(np.float64, st.integers(2, 60), elements=st.sampled_from([0.0, 10.0, 10.4, 19.9, 20.0, 45.0])),
    st.lists(st.integers(0, 59), max_size=3),
)
def test_rest_agrees_with_a_slow_count(angle: NDArray[np.float64], gaps: list[int]) -> None:
    elevation = elevate(angle, rate_hz=1.0)
    valid = elevation.segments[0].valid
    valid[[gap for gap in gaps if gap < len(angle)]] = False
    if not valid.any():
        return
    recovery = summarise_exposure(elevation).recovery

    series = elevation.segments[0].elevation_deg.astype(np.float64)
    steps = [
        bool(valid[i] and i > 0 and valid[i - 1] and abs(series[i] - series[i - 1]) < 5)
        for i in range(len(angle))
    ]
    rests = [slow and series[i] < 20 for i, slow in enumerate(steps)]
    lengths = [len(list(group)) for rest, group in groupby(rests) if rest]
    assert recovery is not None
    told_s = recovery.neutral_slow_percent / 100 * valid.sum()
    assert told_s == pytest.approx(sum(length for length in lengths if length >= 3))


def two_tones(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    angle = 60 + 30 * np.sin(2 * np.pi * 0.2 * time_s) + 5 * np.sin(2 * np.pi * 1.5 * time_s)
    return np.asarray(angle, np.float64)


def test_14_the_mean_power_frequency_of_the_speed_of_two_tones() -> None:
    angle = two_tones(np.arange(60_000) / 100)

    assert find_mean_power_frequency(angle, 100.0) == pytest.approx(0.992683, abs=0.002)


def test_7_a_swing_has_the_frequency_of_the_swing() -> None:
    angle = 45 + 40 * np.sin(2 * np.pi * 0.25 * np.arange(60_000) / 100)

    assert find_mean_power_frequency(angle, 100.0) == pytest.approx(0.25, abs=0.002)


@pytest.mark.parametrize(("seconds", "known"), [(60, False), (61, True)])
def test_a_frequency_needs_a_minute_without_a_hole(seconds: int, known: bool) -> None:
    found = find_mean_power_frequency(two_tones(np.arange(seconds * 100) / 100), 100.0)

    assert (found is not None) == known


def test_an_arm_that_does_not_move_has_no_frequency() -> None:
    assert find_mean_power_frequency(np.full(12_000, 50.0), 100.0) is None


def count_all_crossings(angle: NDArray[np.float64]) -> float:
    counts = np.zeros(1)
    count_crossings(angle, np.ones(len(angle), np.bool_), 100.0, np.array([0, len(angle)]), counts)
    return float(counts[0])


def test_a_swing_changes_direction_twice() -> None:
    angle = 45 + 40 * np.sin(2 * np.pi * 0.25 * np.arange(60_000) / 100)

    assert count_all_crossings(angle) == 300  # 150 peaks, 150 valleys


def test_a_tremor_slower_than_the_dead_band_is_no_change_of_direction() -> None:
    angle = 45 + 0.5 * np.sin(2 * np.pi * 3 * np.arange(6000) / 100)  # at most 9.4 deg/s

    assert count_all_crossings(angle) == 0


def test_time_in_long_stays_is_told_by_their_length() -> None:
    episodes = summarise(hold((10, 5), (80, 8), (10, 5), (80, 20), (10, 5), (80, 40))).episodes[1]

    assert episodes.longer_s == ((5.0, 68.0), (10.0, 60.0), (30.0, 40.0), (60.0, 0.0))
    assert episodes.total_s == 68.0
    assert episodes.p90_s == pytest.approx(36.0)
    assert episodes.per_hour == pytest.approx(3 * 3600 / 83)


def test_minutes_with_two_entries_are_told() -> None:
    lift = [(10.0, 5.0), (80.0, 5.0)]
    entries = summarise(hold(*lift, *lift, (10, 40), *lift, (10, 50), (10, 60))).entries[1]  # 2, 1 and none

    assert entries.busy_minutes_percent == pytest.approx(100 / 3)


@pytest.mark.parametrize("rate_hz", [25.0, 24.96, 25.016])
def test_two_entries_make_a_minute_busy_at_any_rate(rate_hz: float) -> None:
    time_s = np.arange(round(600 * rate_hz)) / rate_hz
    angle = np.where(time_s % 30.0 < 15.0, 10.0, 80.0)  # raised at 15 and 45 s of each minute

    entries = summarise_exposure(elevate(angle, rate_hz=rate_hz)).entries[1]

    assert (entries.count, entries.busy_minutes_percent) == (20, 100.0)


def test_the_eva_matrix_in_a_few_figures() -> None:
    summary = summarise(np.tile(hold((10, 60), (70, 30)), 20)).eva_summary

    assert summary is not None
    assert summary.by_angle_percent == pytest.approx((200 / 3, 0, 0, 100 / 3, 0))
    assert summary.by_duration_percent[4:6] == pytest.approx((100 / 3, 200 / 3))
    assert summary.centroid_deg == pytest.approx((2 * 10 + 75) / 3)
    assert summary.centroid_s == pytest.approx((2 * 47 + 23) / 3)


def hour(start: int, p50: float, above: float, analysed_s: float = 3600.0) -> PartExposure:
    return PartExposure("", start * 3600.0, 0.0, analysed_s, {50: p50}, {60: above}, 10.0)


def test_hours_are_compared_with_one_another() -> None:
    figures = describe_hours([hour(0, 20, 4), hour(1, 30, 12), hour(2, 25, 8)])["time_above_60_percent"]

    assert (figures.hours, figures.spread, figures.last_less_first) == (3, 8, 4)
    assert figures.coefficient_percent == pytest.approx(50.0)


def test_an_hour_of_which_little_was_analysed_is_left_aside() -> None:
    assert describe_hours([hour(0, 20, 4), hour(1, 30, 12, analysed_s=1799)]) == {}


def test_where_nothing_happens_there_is_no_coefficient() -> None:
    assert (
        describe_hours([hour(0, 20, 0), hour(1, 20, 0)])["time_above_60_percent"].coefficient_percent is None
    )


ANGLES = st.sampled_from([0.0, 20.0, 30.0, 45.0, 50.0, 55.5, 58.0, 62.0, 65.5, 70.0, 90.0])


@given(
    hnp.arrays(np.float64, st.integers(2, 80), elements=ANGLES),
    st.lists(st.integers(0, 79), max_size=3),
    st.sampled_from([0.9, 3.0, 10.0]),
)
def test_the_triggers_at_all_errors_count_what_one_trigger_counts_at_each(
    series: NDArray[np.float64], gaps: list[int], rate_hz: float
) -> None:
    valid = np.ones(len(series), np.bool_)
    valid[[gap for gap in gaps if gap < len(series)]] = False
    angle = MetricAngle(0, rate_hz, series, valid)
    errors_deg = np.linspace(-7.3, 7.3, 11)
    nothing = np.zeros(0, np.int64)
    shifted = ShiftedStays(errors_deg, cut_day(np.array([0, 10_000_000, 120_000_000]), nothing, nothing))
    shifted.add(angle)

    for threshold_deg in (30, 60, 90):
        sums = shifted.pick(shifted.sums, threshold_deg).sum(axis=1)
        entries = shifted.pick(shifted.entries, threshold_deg).sum(axis=1)
        longest_s = shifted.pick(shifted.longest_s, threshold_deg)
        for k, error_deg in enumerate(errors_deg):
            stays = find_stays(angle, float(np.round(threshold_deg - error_deg, 9)))
            assert entries[k] == len(stays.entry_us)
            assert sums[k, STAYS] == len(stays.duration_s)
            assert sums[k, STAY_S] == pytest.approx(stays.duration_s.sum())
            longer_s = stays.duration_s[stays.duration_s > 5.0].sum()
            assert sums[k, LONGER_S] == pytest.approx(longer_s)
            assert longest_s[k] == pytest.approx(stays.duration_s.max(initial=0.0))


@given(hnp.arrays(np.float64, st.integers(2, 80), elements=ANGLES))
def test_seconds_are_counted_above_60_deg_less_each_error(series: NDArray[np.float64]) -> None:
    angle = MetricAngle(0, 10.0, series, np.ones(len(series), np.bool_))
    errors_deg = np.linspace(-7.3, 7.3, 11)
    shifted = ShiftedSeconds(errors_deg, 9)
    shifted.add(angle)

    above_s = np.cumsum(shifted.seconds[:, ::-1], axis=1)[:, :-1].sum(axis=0)
    assert above_s == pytest.approx([np.sum(series + error >= 60) / 10 for error in errors_deg], abs=1e-4)
