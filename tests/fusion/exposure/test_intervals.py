"""Intervals: an error of the angle shifts the day, and a day is a sample of its five-minute blocks."""

from collections.abc import Iterator
from dataclasses import asdict

import numpy as np
import pytest
from scipy.stats import norm

from fusion.elevation import Elevation
from fusion.exposure import Exposure, Interval, summarise_exposure, withhold_short
from fusion.exposure.bins import CELLS
from fusion.exposure.intervals import draw_shares
from fusion.exposure.resampling import DRAWS, Resampling, draw_blocks, find_intervals, sum_below
from fusion.exposure.speeds import SpeedTally
from fusion.exposure.types import Velocity
from tests.factories import elevate


def make_day(minutes: int = 240) -> Elevation:
    """Spread each minute over the same normal distribution: 25 deg, 22.5 deg. One row a second."""
    quantiles = norm.ppf((np.arange(60) + 0.5) / 60, 25.0, 22.5)
    return elevate(np.tile(np.clip(quantiles, 0, 180), minutes), rate_hz=1.0)


def summarise(elevation: Elevation, bias_sigma_deg: float) -> Exposure:
    return summarise_exposure(elevation, bias_sigma_deg=bias_sigma_deg)


def test_without_a_known_error_there_is_no_interval() -> None:
    exposure = summarise_exposure(make_day())

    assert exposure.intervals == {}
    assert all(above.interval is None for above in exposure.time_above)


def test_an_exact_angle_in_a_day_of_equal_blocks_has_no_width() -> None:
    exposure = summarise(make_day(), bias_sigma_deg=0.0)

    for above in exposure.time_above:
        assert above.interval is not None
        assert (above.interval.low, above.interval.high) == pytest.approx((above.percent, above.percent))


def test_in_a_day_of_equal_blocks_a_percentile_moves_by_two_sigma_each_way() -> None:
    exposure = summarise(make_day(), bias_sigma_deg=3.0)

    median, width_deg = exposure.intervals["elevation_p50_deg"], 1.96 * 3.0
    # 200 draws stop a little short of the 2.5 % tails
    assert median.low == pytest.approx(exposure.percentiles_deg[50] - width_deg, abs=0.15)
    assert median.high == pytest.approx(exposure.percentiles_deg[50] + width_deg, abs=0.15)


def test_an_even_spread_gains_time_above_in_proportion_to_the_error() -> None:
    spread = elevate(np.tile(np.arange(0.05, 180, 0.1), 6), rate_hz=6.0)  # each block is 0 to 180 deg, evenly
    exposure = summarise(spread, bias_sigma_deg=1.8)

    interval = exposure.time_above[1].interval
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((66.67 - 1.96, 66.67 + 1.96), abs=0.05)


def test_blocks_that_differ_widen_the_interval_of_an_exact_angle() -> None:
    exposure = summarise(elevate(np.repeat([10.0, 80.0], 7200), rate_hz=1.0), bias_sigma_deg=0.0)

    interval = exposure.time_above[1].interval
    # 48 blocks, half of them above: a binomial share of 50 % with a standard deviation of 7.2 %
    assert interval is not None
    assert (interval.low, interval.high) == pytest.approx((50 - 14.1, 50 + 14.1), abs=3.0)


def test_the_bins_of_every_draw_add_up() -> None:
    random = np.random.default_rng(4)
    blocks = random.integers(0, 40_000, (7, CELLS))
    shares = draw_shares(sum_below(blocks, draw_blocks(blocks.sum(axis=1), 4.0)))

    bins_percent = sum(drawn for name, drawn in shares.items() if name.startswith("bin_"))
    assert bins_percent == pytest.approx(np.full(DRAWS, 100.0))


def test_the_same_day_has_the_same_interval_again() -> None:
    random = np.random.default_rng(4)
    day = elevate(random.normal(45, 20, 14_400).clip(0, 180), rate_hz=1.0)

    assert summarise(day, 3.0).intervals == summarise(day, 3.0).intervals


def test_an_arm_that_hangs_all_day_has_an_interval_inside_the_scale() -> None:
    exposure = summarise(elevate(np.full(3600, 0.0), rate_hz=1.0), bias_sigma_deg=3.0)

    assert exposure.time_above[0].interval == Interval(0.0, 0.0)
    assert exposure.intervals["elevation_p1_deg"].low == 0.0


def test_where_the_error_is_not_known_the_extremes_of_a_day_have_no_interval() -> None:
    exposure = summarise(make_day(), bias_sigma_deg=0.0)

    without = {"worst_15_min_above_60_percent", "episodes_above_60_longest_s", "recovery_longest_without_s"}
    assert not without & set(exposure.intervals)
    assert without <= set(summarise(make_day(), bias_sigma_deg=3.0).intervals)


@pytest.mark.parametrize(("minutes", "has_interval"), [(25, False), (30, True)])
def test_where_the_error_is_not_known_half_an_hour_is_the_least_for_an_interval(
    minutes: int, has_interval: bool
) -> None:
    exposure = summarise(make_day(minutes), bias_sigma_deg=0.0)

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


def test_half_an_hour_keeps_its_ranges_and_rates() -> None:
    exposure = summarise(make_day(minutes=30), bias_sigma_deg=3.0)

    assert withhold_short(exposure) is exposure


def test_under_half_an_hour_no_range_and_no_rate_per_hour_is_left_in_day_or_part() -> None:
    exposure = withhold_short(summarise(make_day(minutes=29), bias_sigma_deg=3.0))

    told = asdict(exposure)
    rates = {name: value for name, value in find_all(told) if "per_hour" in name or "per_h" in name}
    ranges = [value for name, value in find_all(told) if name in {"interval", "intervals"} and value]
    assert set(rates) == {
        "per_hour", "entries_above_60_per_h", "neutral_slow_per_hour", "slow_per_hour", "crossings_per_hour",
    }  # fmt: skip
    assert (set(rates.values()), ranges) == ({None}, [])


def test_under_half_an_hour_every_other_figure_stays() -> None:
    exposure = summarise(make_day(minutes=29), bias_sigma_deg=3.0)

    kept = withhold_short(exposure)
    assert kept.percentiles_deg == exposure.percentiles_deg
    assert [entries.count for entries in kept.entries] == [entries.count for entries in exposure.entries]


def find_all(value: object) -> Iterator[tuple[str, object]]:
    """Give every name in nested values, with what stands under it."""
    if isinstance(value, dict):
        yield from ((str(name), inner) for name, inner in value.items())
        value = tuple(value.values())
    for inner in value if isinstance(value, list | tuple) else ():
        yield from find_all(inner)
