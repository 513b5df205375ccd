"""Rest, frequency, variation, long stays: against values worked out by hand and slow, obvious counts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from acromion.fusion.exposure.bins import cut_day
from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.parts import ShiftedSeconds
from acromion.fusion.exposure.speeds import find_mean_power_frequency
from acromion.fusion.exposure.stays import LONGER_S, STAY_S, STAYS, ShiftedStays, find_stays
from acromion.fusion.exposure.summary import describe_hours, summarise_exposure
from acromion.fusion.exposure.types import Exposure, PartExposure, Recovery
from tests.factories import elevate


def summarise(*runs: NDArray[np.float64], rate_hz: float = 10.0) -> Exposure:
    return summarise_exposure(elevate(*runs, rate_hz=rate_hz))


def hold(*parts: tuple[float, float]) -> NDArray[np.float64]:
    """Return (angle, seconds) at 10 Hz."""
    return np.concatenate([np.full(round(seconds * 10), angle) for angle, seconds in parts])


def recover(*runs: NDArray[np.float64]) -> Recovery:
    recovery = summarise(*runs).recovery
    assert recovery is not None
    return recovery


def test_hanging_still_for_3_s_is_rest_and_shorter_is_not() -> None:
    recovery = recover(hold((50, 10), (10, 3.1), (50, 10), (10, 3.0), (50, 10)))

    # the step into a hold is fast: of 3.1 s three are slow
    assert recovery.neutral_slow_per_h == pytest.approx(3600 / 36.1)
    assert recovery.neutral_slow_percent == pytest.approx(100 * 3.0 / 36.1)


def test_the_longest_time_without_rest_lies_between_two_rests_which_a_hole_ends() -> None:
    between = recover(hold((10, 10), (50, 20), (10, 10), (50, 5), (10, 10)))

    assert between.longest_without_s == pytest.approx(20.1)  # and the step back down
    assert recover(hold((10, 2.5)), hold((10, 2.5))).neutral_slow_per_h == 0.0


@pytest.mark.parametrize(
    ("seconds", "swing_deg", "known"), [(60, 30, False), (61, 30, True), (120, 0, False)]
)
def test_a_frequency_needs_a_minute_without_a_hole_and_movement(
    seconds: int, swing_deg: float, known: bool
) -> None:
    angle = 60 + swing_deg * np.sin(2 * np.pi * 0.2 * np.arange(seconds * 100) / 100)

    assert (find_mean_power_frequency(angle, 100.0) is not None) is known


def test_time_in_long_stays_is_told_by_their_length() -> None:
    episodes = summarise(hold((10, 5), (80, 8), (10, 5), (80, 20), (10, 5), (80, 40))).episodes[1]

    assert episodes.longer_s == ((5.0, 68.0), (10.0, 60.0), (30.0, 40.0), (60.0, 0.0))
    assert episodes.total_s == 68.0
    assert episodes.p90_s == pytest.approx(36.0)
    assert episodes.per_hour == pytest.approx(3 * 3600 / 83)


@pytest.mark.parametrize("rate_hz", [24.96, 25.016])
def test_two_entries_make_a_minute_busy_at_any_rate(rate_hz: float) -> None:
    time_s = np.arange(round(600 * rate_hz)) / rate_hz
    angle = np.where(time_s % 30.0 < 15.0, 10.0, 80.0)  # raised at 15 and 45 s of each minute
    angle[(time_s >= 180) & (time_s < 210)] = 10.0  # but once in the fourth

    entries = summarise_exposure(elevate(angle, rate_hz=rate_hz)).entries[1]

    assert (entries.count, entries.busy_minutes_percent) == (19, 90.0)


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


def test_hours_of_less_than_half_or_without_anything_above_tell_no_coefficient() -> None:
    nothing = describe_hours([hour(0, 20, 0), hour(1, 20, 0)])["time_above_60_percent"]

    assert nothing.coefficient_percent is None
    assert describe_hours([hour(0, 20, 4), hour(1, 30, 12, analysed_s=1799)]) == {}


ANGLES = st.sampled_from([0.0, 20.0, 30.0, 45.0, 50.0, 55.5, 58.0, 62.0, 65.5, 70.0, 90.0])


@settings(max_examples=50, deadline=None)
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
    errors_deg, nothing = np.linspace(-7.3, 7.3, 11), np.zeros(0, np.int64)
    day = cut_day(np.array([0, 10_000_000, 120_000_000]), nothing, nothing, nothing)
    shifted = ShiftedStays(errors_deg, day)
    shifted.add(angle)

    for threshold_deg in (30, 60, 90):
        sums = shifted.pick(shifted.sums, threshold_deg).sum(axis=1)
        entries = shifted.pick(shifted.entries, threshold_deg).sum(axis=1)
        longest_s = shifted.pick(shifted.longest_s, threshold_deg)
        for k, error_deg in enumerate(errors_deg):
            stays = find_stays(angle, float(np.round(threshold_deg - error_deg, 9)))
            longer_s = stays.duration_s[stays.duration_s > 5.0].sum()
            assert entries[k] == len(stays.entry_us)
            assert sums[k, STAYS] == len(stays.duration_s)
            assert sums[k, STAY_S] == pytest.approx(stays.duration_s.sum())
            assert sums[k, LONGER_S] == pytest.approx(longer_s)
            assert longest_s[k] == pytest.approx(stays.duration_s.max(initial=0.0))


@settings(max_examples=40, deadline=None)
@given(hnp.arrays(np.float64, st.integers(2, 80), elements=ANGLES))
def test_seconds_are_counted_above_60_deg_less_each_error(series: NDArray[np.float64]) -> None:
    errors_deg = np.linspace(-7.3, 7.3, 11)
    shifted = ShiftedSeconds(errors_deg, 9)
    shifted.add(MetricAngle(0, 10.0, series, np.ones(len(series), np.bool_)))

    above_s = np.cumsum(shifted.seconds[:, ::-1], axis=1)[:, :-1].sum(axis=0)
    assert above_s == pytest.approx([np.sum(series + error >= 60) / 10 for error in errors_deg], abs=1e-4)
