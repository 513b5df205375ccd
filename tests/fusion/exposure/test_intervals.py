"""Intervals: an error of the angle shifts the day, and a day is a sample of its five-minute blocks."""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pytest
from scipy.stats import norm

from acromion.fusion.elevation import Elevation
from acromion.fusion.exposure.resampling import DRAWS, Resampling, find_intervals
from acromion.fusion.exposure.speeds import SpeedTally
from acromion.fusion.exposure.summary import remove_short_ranges, summarise_exposure
from acromion.fusion.exposure.types import Exposure, Interval, Velocity
from tests.factories import elevate


def make_day(minutes: int = 240) -> Elevation:
    """Spread each minute over the same normal distribution: 25 deg, 22.5 deg. One row a second."""
    quantiles = norm.ppf((np.arange(60) + 0.5) / 60, 25.0, 22.5)
    return elevate(np.tile(np.clip(quantiles, 0, 180), minutes), rate_hz=1.0)


def range_above_60(elevation: Elevation, sigma_deg: float) -> tuple[float, float]:
    interval = summarise_exposure(elevation, bias_sigma_deg=sigma_deg).time_above[1].interval
    assert interval is not None
    return interval.low, interval.high


def test_without_a_known_error_there_is_no_interval() -> None:
    exposure = summarise_exposure(make_day())

    assert exposure.intervals == {}
    assert all(above.interval is None for above in exposure.time_above)


# 0 to 180 deg, evenly, in each block
EVEN = elevate(np.tile(np.arange(0.05, 180, 0.1), 6), rate_hz=6.0)
# 48 blocks, half of them above: a binomial share of 50 % with a standard deviation of 7.2 %
TWO_HALVES = elevate(np.repeat([10.0, 80.0], 7200), rate_hz=1.0)


@pytest.mark.parametrize(
    ("elevation", "sigma_deg", "middle", "half_width", "within"),
    [(EVEN, 0.0, 66.67, 0.0, 0.01), (EVEN, 1.8, 66.67, 1.96, 0.05), (TWO_HALVES, 0.0, 50.0, 14.1, 3.0)],
    ids=["exact angle, equal blocks", "in proportion to the error", "exact angle, blocks that differ"],
)
def test_the_range_of_time_above_60_deg(
    elevation: Elevation, sigma_deg: float, middle: float, half_width: float, within: float
) -> None:
    ends = (middle - half_width, middle + half_width)

    assert range_above_60(elevation, sigma_deg) == pytest.approx(ends, abs=within)


def test_in_a_day_of_equal_blocks_a_percentile_moves_by_two_sigma_each_way() -> None:
    exposure = summarise_exposure(make_day(), bias_sigma_deg=3.0)

    # 200 draws stop a little short of the 2.5 % tails
    interval, median_deg = exposure.intervals["elevation_p50_deg"], exposure.percentiles_deg[50]
    assert interval.low == pytest.approx(median_deg - 1.96 * 3.0, abs=0.15)
    assert interval.high == pytest.approx(median_deg + 1.96 * 3.0, abs=0.15)


def test_an_arm_that_hangs_all_day_has_an_interval_inside_the_scale() -> None:
    exposure = summarise_exposure(elevate(np.full(3600, 0.0), rate_hz=1.0), bias_sigma_deg=3.0)

    assert exposure.time_above[0].interval == Interval(0.0, 0.0)
    assert exposure.intervals["elevation_p1_deg"].low == 0.0


def test_where_the_error_is_not_known_the_extremes_of_a_day_have_no_interval() -> None:
    exposure = summarise_exposure(make_day(), bias_sigma_deg=0.0)

    without = {"worst_15_min_above_60_percent", "episodes_above_60_longest_s", "recovery_longest_without_s"}
    assert not without & set(exposure.intervals)
    assert without <= set(summarise_exposure(make_day(), bias_sigma_deg=3.0).intervals)


@pytest.mark.parametrize(("minutes", "has_interval"), [(25, False), (30, True)])
def test_where_the_error_is_not_known_half_an_hour_is_the_least_for_an_interval(
    minutes: int, has_interval: bool
) -> None:
    exposure = summarise_exposure(make_day(minutes), bias_sigma_deg=0.0)

    assert bool(exposure.intervals) is has_interval
    assert all((above.interval is not None) is has_interval for above in exposure.time_above)
    assert bool(exposure.by_hour[0].intervals) is has_interval


@pytest.mark.parametrize(("minutes", "has_interval"), [(20, False), (30, True)])
def test_a_speed_has_no_interval_from_less_than_half_an_hour(minutes: int, has_interval: bool) -> None:
    angle = 45 + 40 * np.sin(2 * np.pi * 0.25 * np.arange(minutes * 60 * 25) / 25)
    intervals = summarise_exposure(elevate(angle, rate_hz=25.0), bias_sigma_deg=3.0).intervals

    assert ("inclination_velocity_p50_dps" in intervals) is has_interval
    assert ("recovery_slow_percent" in intervals) is has_interval
    assert "elevation_p50_deg" in intervals


@pytest.mark.parametrize(
    ("up_deg", "down_deg", "entries"), [(64.9, 50.0, 0), (65.1, 54.9, 3), (65.1, 55.1, 1), (64.1, 30.0, 0)]
)
def test_a_rise_enters_5_deg_above_the_threshold_and_ends_5_deg_below(
    up_deg: float, down_deg: float, entries: int
) -> None:
    angle = np.concatenate([np.full(30, 20.0), np.tile(np.repeat([up_deg, down_deg], 30), 3)])

    assert summarise_exposure(elevate(angle, rate_hz=1.0)).entries[1].count == entries


def test_draws_of_nothing_but_short_pieces_have_no_speed_and_divide_nothing_by_zero() -> None:
    """The second block has angles, in pieces too short for a speed; before, numpy warned on the screen."""
    tally = SpeedTally(np.array([0, 300_000_000, 600_000_000], np.int64))
    tally.block_s[0, 300] = 300.0
    tally.way_deg[0] = 3000.0
    few = np.array([[1.0, 1.0]] * (DRAWS - 4) + [[0.0, 2.0]] * 4)
    draws = Resampling(np.ones(2, np.bool_), few, np.zeros(DRAWS))

    found = find_intervals(tally.draw("arm", Velocity(10.0, 10.0, 10.0, 10.0, 10.0), draws))

    assert found["arm_velocity_mean_dps"] == Interval(10.0, 10.0)


def test_under_half_an_hour_no_range_and_no_rate_per_hour_is_left_in_day_or_part() -> None:
    whole, exposure = (summarise_exposure(make_day(minutes), bias_sigma_deg=3.0) for minutes in (30, 29))

    kept = remove_short_ranges(exposure)
    told = list(find_all(asdict(kept)))
    rates = {name: value for name, value in told if "per_hour" in name or "per_h" in name}
    assert remove_short_ranges(whole) is whole
    assert set(rates) == {
        "per_hour", "entries_above_60_per_h", "neutral_slow_per_h", "slow_per_h",
        "inclination_velocity_zero_crossings_per_h",
    }  # fmt: skip
    assert set(rates.values()) == {None}
    assert [value for name, value in told if name in {"interval", "intervals"} and value] == []
    assert kept.percentiles_deg == exposure.percentiles_deg
    assert [entries.count for entries in kept.entries] == [entries.count for entries in exposure.entries]


def find_all(value: object) -> Iterator[tuple[str, object]]:
    """Return every name in nested values, with what stands under it."""
    if isinstance(value, dict):
        yield from ((str(name), inner) for name, inner in value.items())
        value = tuple(value.values())
    for inner in value if isinstance(value, list | tuple) else ():
        yield from find_all(inner)


# Every figure without a low and high of its own has an interval that holds it, and says what it covers.


@pytest.fixture(scope="module")
def day() -> Exposure:
    """Two hours of lifts that become more frequent, 25 rows a second."""
    time_s = np.arange(2 * 3600 * 25) / 25
    angle = 45 + 40 * np.sin(2 * np.pi * (0.05 * time_s + 0.00001 * time_s**2))
    return summarise_exposure(elevate(angle, rate_hz=25.0), bias_sigma_deg=3.0)


def test_the_intervals_hold_their_figures(day: Exposure) -> None:
    inclination = day.velocity_dps["inclination"]
    assert inclination is not None
    figures = {
        **{f"elevation_p{p}_deg": value for p, value in day.percentiles_deg.items()},
        **{f"entries_above_{e.threshold_deg:g}_per_h": e.per_hour for e in day.entries[:2]},
        **{f"episodes_above_{e.threshold_deg:g}_median_s": e.median_s for e in day.episodes[:2]},
        **{f"episodes_above_{e.threshold_deg:g}_longest_s": e.longest_s for e in day.episodes[:2]},
        "inclination_velocity_p50_dps": inclination.p50_dps,
        "inclination_velocity_mean_dps": inclination.mean_dps,
        **{f"worst_{w.length_s // 60}_min_above_60_percent": w.percent_above_60 for w in day.peak_windows},
    }

    outside = {
        name: (value, day.intervals[name])
        for name, value in figures.items()
        if value is None or not day.intervals[name].low <= value <= day.intervals[name].high
    }
    assert outside == {}


def test_the_intervals_have_a_width(day: Exposure) -> None:
    narrow = {name: i.low for name, i in day.intervals.items() if not i.high > i.low}

    # what never happens in any draw, and what always does
    always = {"entries_above_30_busy_minutes_percent", "entries_above_60_busy_minutes_percent"}
    assert {name for name, value in narrow.items() if value} == {*always, "recovery_longest_without_s"}


def test_an_error_of_the_angle_does_not_widen_speeds() -> None:
    angle = 45 + 40 * np.sin(2 * np.pi * 0.25 * np.arange(7200 * 25) / 25)
    exposures = [summarise_exposure(elevate(angle, rate_hz=25.0), bias_sigma_deg=s) for s in (0.0, 5.0)]

    first, second = (exposure.intervals["inclination_velocity_p50_dps"] for exposure in exposures)
    assert first == second
