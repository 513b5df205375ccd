"""Turns too small to be told for sure: kept, with a range that holds them, and said."""

from dataclasses import replace

import numpy as np
import pytest

from fusion.elevation import estimate_elevation
from fusion.pipeline import analyse
from fusion.pose.calibrate import calibrate
from fusion.pose.doubts import PoseEvidence, find_doubted_parts, find_early_turn
from fusion.pose.postures import Moments
from fusion.pose.slips import Doubt
from fusion.pose.wear import Wear, WearPart
from fusion.recording import Recording
from fusion.simulation import simulate_shift
from tests.factories import record
from tests.fusion.test_reattachment import RATE_HZ
from tests.fusion.test_slips import TURNED_S, push_back

UP = np.array([0.0, 0.0, 1.0])


def make_day(turned_s: tuple[float, float] = (0.0, 0.0)) -> WearPart:
    """An hour: a moment of walking every 10 s, the arm along z; between two times 15 deg from it."""
    time_s = np.arange(5.0, 3600.0, 10.0)
    inside = (time_s >= turned_s[0]) & (time_s < turned_s[1])
    leaning = np.array([np.sin(np.radians(15.0)), 0.0, np.cos(np.radians(15.0))])
    moments = Moments(time_s, np.where(inside[:, None], leaning, UP))
    return WearPart(-np.inf, np.inf, 0, moments, moments, moments)


def doubt(first_s: float, end_s: float) -> Doubt:
    return Doubt(first_s, end_s, (0.0, 3600.0), 15.0)


def test_a_doubt_reaches_to_the_walking_before_and_after_it() -> None:
    worn = Wear((make_day((1000.0, 2000.0)),), (), (doubt(1000.0, 2000.0),))

    (part,) = find_doubted_parts(worn, UP, ())

    assert (part.start_s, part.end_s) == (995.0, 2005.0)


def test_it_concerns_the_side_that_the_axis_does_not_fit() -> None:
    # The axis is that of the half hour from the middle on: the first one is in doubt, up to its last walking.
    worn = Wear((make_day((0.0, 1800.0)),), (), (doubt(1800.0, 3600.0),))

    (part,) = find_doubted_parts(worn, UP, ())

    assert (part.start_s, part.end_s) == (-np.inf, 1805.0)


@pytest.mark.parametrize("span_s", [(4000.0, 5000.0), (-100.0, 5000.0)])
def test_one_that_lies_beside_what_is_left_of_its_part_concerns_nothing(span_s: tuple[float, float]) -> None:
    # A slip was found beside the part; its margin took the walking that the doubt rested on.
    worn = Wear((make_day((1000.0, 2000.0)),), (), (doubt(*span_s),))

    assert find_doubted_parts(worn, UP, ()) == ()


def test_one_that_reaches_beyond_its_part_ends_with_it() -> None:
    day = replace(make_day((3000.0, 3600.0)), end_s=3590.0)
    worn = Wear((day,), (), (Doubt(3000.0, 3900.0, (0.0, 4200.0), 15.0),))

    (part,) = find_doubted_parts(worn, UP, ())

    assert (part.start_s, part.end_s) == (2995.0, 3590.0)


def test_its_range_holds_the_turn() -> None:
    worn = Wear((make_day((1000.0, 2000.0)),), (), (doubt(1000.0, 2000.0),))

    (part,) = find_doubted_parts(worn, UP, ())

    assert 1.96 * part.sigma_deg == pytest.approx(15.0)


@pytest.mark.parametrize(
    ("first_deg", "first_s", "is_sure", "left_out"),
    [(16.0, 10.0, True, 1), (14.0, 10.0, True, 0), (16.0, 310.0, True, 0), (16.0, 10.0, False, 0)],
)
def test_the_first_five_minutes_are_left_out_where_the_arm_was_first_held_apart_from_walking(
    first_deg: float, first_s: float, is_sure: bool, left_out: int
) -> None:
    worn = Wear((make_day(),), ())
    evidence = PoseEvidence(5.0, 2.0, first_deg, first_s, is_sure)

    parts = find_early_turn(worn, 1200.0, evidence)

    assert [(part.end_s, part.arm_axis) for part in parts] == [(305.0, None)] * left_out


def turn_by_15_deg() -> Recording:
    return push_back(15.0, 20.0, "gt9x")[0]


def test_a_turn_of_15_deg_pushed_back_is_told_with_its_size_and_place() -> None:
    (flag,) = calibrate(turn_by_15_deg(), "n-pose").flags

    assert (flag.code, flag.facts) == ("W-SLIP-DOUBT", {"apart_deg": 15})
    assert flag.first_s is not None
    assert flag.last_s is not None
    assert flag.first_s <= TURNED_S
    assert flag.last_s >= TURNED_S + 20.0 * 60.0 - 10.0


def test_its_seconds_have_a_range_that_holds_it_and_stay_valid() -> None:
    recording, truth_deg = push_back(15.0, 20.0, "gt9x")

    segment = estimate_elevation(calibrate(recording, "n-pose")).segments[0]

    between = slice(round(TURNED_S * RATE_HZ), round((TURNED_S + 1190.0) * RATE_HZ))
    wrong_deg = np.abs(segment.elevation_deg - truth_deg)[between]
    seconds = slice(round(TURNED_S), round(TURNED_S + 1190.0))
    assert segment.valid[between].mean() > 0.99
    assert segment.sigma_deg is not None
    assert wrong_deg.max() > 10.0
    assert np.mean(wrong_deg < 1.96 * segment.sigma_deg[seconds].min()) > 0.95


def test_it_widens_the_ranges_of_the_day() -> None:
    # 15 / 1.96 = 7.7 deg for 20 minutes and more of 180.
    sigma_deg = analyse(turn_by_15_deg()).elevation.bias_sigma_deg

    assert sigma_deg is not None
    assert sigma_deg > 7.7 * np.sqrt(20.0 / 180.0)


@pytest.mark.parametrize("seed", [2, 8])
def test_loads_carried_between_walks_raise_no_doubt(seed: int) -> None:
    # Lifting for 20 minutes and more, its steps 25 deg from walking: told for a turn before purity was asked.
    made = simulate_shift("gt9x", 3.0, seed, RATE_HZ).in_arrays()

    samples = calibrate(record(made.acc_g.astype(float), made.gyr_dps.astype(float), RATE_HZ), "n-pose")

    assert (samples.doubted, samples.flags) == ((), ())
