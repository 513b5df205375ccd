"""Every figure without a low and high of its own has an interval that holds it, and says what it covers."""

import numpy as np
import pytest

from fusion.exposure import Exposure, summarise_exposure
from tests.factories import elevate


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
