"""Figures worked out by hand that the table of oracles does not list.

`test_exposure_check.py` checks the table (`benchmarks.exposure_oracles`). The last figures go through the
metric filter and stay within 0.15 percentage points and 0.1 s of the closed form.
"""

from dataclasses import astuple
from datetime import datetime

import numpy as np
import pytest

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.bins import summarise_bins
from acromion.fusion.exposure.parts import split_hours
from acromion.fusion.exposure.speeds import CycleTally
from acromion.fusion.exposure.stays import find_stays, summarise_entries, summarise_episodes
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Velocity
from acromion.fusion.recording import FloatArray
from benchmarks.exposure_oracles import square, swing
from benchmarks.exposure_oracles_sensor import CUBE
from benchmarks.exposure_oracles_table import ALL_DAY, sample, tally
from tests.factories import elevate


def test_5_each_swing_is_one_entry_above_60_deg() -> None:
    entries = summarise_entries(60, [find_stays(sample(swing, 600), 60)], analysed_s=600.0)

    assert (entries.count, entries.per_hour) == (150, 900.0)


def test_8_the_first_and_the_last_quarter_swing_are_half_cycles_of_40_deg() -> None:
    cycles = CycleTally(np.zeros(1), ALL_DAY)
    cycles.add(sample(swing, 600))

    assert [cycle.count for cycle in cycles.summarise()] == [0.0, 1.0, 149.5, 0.0]


def test_10_a_ramp_from_hanging_to_overhead_fills_the_bins_in_proportion_to_their_width() -> None:
    percents = [part.percent for part in summarise_bins(tally(sample(lambda time_s: time_s, 180, 100.0)))]

    assert percents == pytest.approx([100 * width / 180 for width in (20, 10, 15, 15, 20, 10, 30, 30, 30)])


def test_11_holds_of_30_s_are_20_episodes_and_fill_two_cells_of_the_variation_matrix() -> None:
    episodes = summarise_episodes(60, [find_stays(sample(square, 1800, 100.0), 60)])
    eva = summarise_exposure(elevate(square(np.arange(18_000) / 10.0), rate_hz=10.0)).eva

    assert (episodes.count, episodes.median_s) == (20, 30.0)
    assert eva.percent[3, 4] == pytest.approx(100 / 3)  # 60 to 90 deg, 15 to 31 s


def test_17_an_arm_that_turns_with_the_body_or_about_the_vertical_has_no_speed_of_inclination() -> None:
    turned = np.radians(90.0) * np.arange(2000) / 100.0
    up = np.stack([0.866 * np.cos(turned), 0.866 * np.sin(turned), np.full(2000, 0.5)], axis=1)
    segment = ElevationSegment(
        0, 100.0, np.full(2000, 60.0, np.float32), np.arange(2000) % 1700 >= 300, up.astype(np.float32)
    )

    velocity = summarise_exposure(Elevation((segment,), None)).velocity_dps

    inclination, generalised = velocity["inclination"], velocity["generalised"]
    assert inclination is not None
    assert generalised is not None
    assert inclination.p50_dps == 0.0
    assert generalised.p50_dps == pytest.approx(77.94, abs=0.05)  # 90 deg/s times the sine of 60 deg


def test_24_no_speed_depends_on_how_the_sensor_is_mounted() -> None:
    time_s = np.arange(6000) / 50.0
    polar, plane = np.radians(50 + 30 * np.sin(0.7 * time_s)), np.radians(40 * np.sin(0.4 * time_s))
    up = np.stack([np.sin(polar) * np.cos(plane), np.sin(polar) * np.sin(plane), np.cos(polar)], axis=1)

    def move(turn: FloatArray) -> Velocity | None:
        seen, valid = (up @ turn.T).astype(np.float32), np.ones(6000, np.bool_)
        segment = ElevationSegment(0, 50.0, np.degrees(polar).astype(np.float32), valid, seen)
        return summarise_exposure(Elevation((segment,), None)).velocity_dps["generalised"]

    speeds = [astuple(velocity) for turn in CUBE if (velocity := move(turn)) is not None]

    assert len(speeds) == 24
    assert np.ptp(speeds, axis=0).max() < 1e-3


def test_27_an_arm_held_at_50_deg_has_all_percentiles_there_and_never_moves() -> None:
    exposure = summarise_exposure(elevate(np.full(360_000, 50.0)))

    inclination = exposure.velocity_dps["inclination"]
    assert inclination is not None
    assert (inclination.p99_dps, inclination.mean_dps) == (0.0, 0.0)
    assert (exposure.episodes[0].count, exposure.episodes[0].censored) == (1, 1)
    assert list(exposure.percentiles_deg.values()) == pytest.approx([50.0] * 9, abs=0.1)


def test_28_a_device_clock_runs_through_the_change_of_clocks() -> None:
    start = datetime(2027, 3, 13, 22, 0)  # noqa: DTZ001 - a device's own clock has no zone

    labels = split_hours(start, 8 * 3600 * 1_000_000).labels

    assert [label[11:13] for label in labels] == ["22", "23", "00", "01", "02", "03", "04", "05"]


def test_the_metric_filter_moves_no_share_of_a_swing_by_more_than_0_15_points() -> None:
    exposure = summarise_exposure(elevate(swing(np.arange(300_000) / 499.3), rate_hz=499.3))

    assert [above.percent for above in exposure.time_above] == pytest.approx(
        [62.2357, 37.7643, 0.0], abs=0.15
    )


def test_the_metric_filter_moves_no_hold_by_more_than_a_tenth_of_a_second() -> None:
    exposure = summarise_exposure(elevate(square(np.arange(180_000) / 100.0)))

    assert exposure.episodes[1].longest_s == pytest.approx(30.0, abs=0.1)
    assert exposure.time_above[1].percent == pytest.approx(100 / 3, abs=0.15)
