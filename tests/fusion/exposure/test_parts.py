"""Parts of the day: tasks pooled from the rows of a diary, and ranges of the differences between hours."""

import numpy as np
import pytest

from fusion.exposure import DayDivision, PartExposure, summarise_exposure
from fusion.exposure.intervals import describe_hours, draw_variation
from fusion.exposure.periods import Period, divide_day
from fusion.exposure.resampling import find_intervals
from tests.factories import elevate

SECOND_US = 1_000_000


def divide(*rows: tuple[int, int, str, str]) -> DayDivision:
    """Divide an hour by rows of (start_s, end_s, label, reason)."""
    periods = tuple(
        Period(start * SECOND_US, end * SECOND_US, "task", label, reason)
        for start, end, label, reason in rows
    )
    return DayDivision(periods, divide_day(periods, 3600 * SECOND_US))


def test_rows_of_one_label_are_one_task_of_their_pooled_time_and_what_no_row_names_is_work() -> None:
    angles = np.full(3600, 100.0)
    angles[:600], angles[1200:1500] = 10.0, 70.0
    division = divide((0, 600, "a", ""), (600, 900, "b", ""), (1200, 1500, "a", ""))

    tasks = summarise_exposure(elevate(angles, rate_hz=1.0), division=division).by_task

    told = [(part.kind, part.label, part.periods, part.recorded_s) for part in tasks]
    assert told == [("task", "a", 2, 900.0), ("task", "b", 1, 300.0), ("work", "", 1, 2400.0)]
    assert round(tasks[0].percentiles_deg[50]) == 10  # two thirds of the pooled time
    assert tasks[0].percent_above[60] == pytest.approx(100 / 3)


def test_a_row_that_is_left_out_is_not_pooled_with_those_that_are_analysed() -> None:
    division = divide((0, 600, "a", ""), (1200, 1500, "a", "task"))
    day = elevate(np.full(3600, 40.0), rate_hz=1.0)
    day.segments[0].valid[1200:1500] = False

    tasks = summarise_exposure(day, division=division).by_task

    told = [(part.label, part.reason, part.recorded_s, part.analysed_s) for part in tasks]
    assert told == [("a", "", 600.0, 600.0), ("a", "task", 300.0, 0.0), ("", "", 2700.0, 2700.0)]


def test_the_ranges_of_the_differences_between_hours_hold_them() -> None:
    # blocks that differ at random: hours drawn again differ more than the hours themselves
    blocks = np.random.default_rng(1).normal(50.0, 8.0, 48)
    exposure = summarise_exposure(elevate(np.repeat(blocks, 300), rate_hz=1.0), bias_sigma_deg=0.0)

    figure = exposure.hour_variation["elevation_p50_deg"]
    spread = exposure.intervals["by_hour_elevation_p50_deg_spread"]
    coefficient = exposure.intervals["by_hour_elevation_p50_deg_coefficient_percent"]
    assert spread.low < figure.spread < spread.high
    assert figure.coefficient_percent is not None
    assert coefficient.low < figure.coefficient_percent < coefficient.high


def test_the_draws_of_a_spread_are_moved_to_lie_about_it() -> None:
    # hours alike but for their sampling: drawn again, they differ more, all 200 times
    drawn = [{"elevation_p50_deg": 40.0 + k * np.linspace(4.0, 6.0, 200)} for k in range(2)]
    hours = [PartExposure("", 0.0, 3600.0, 3600.0, {50: 40.0 + 2 * k}, {60: 0.0}, 0.0) for k in range(2)]
    figures = {"elevation_p50_deg": describe_hours(hours)["elevation_p50_deg"]}

    spread = find_intervals(draw_variation(hours, drawn, figures))["by_hour_elevation_p50_deg_spread"]
    assert (spread.low + spread.high) / 2 == pytest.approx(2.0)
