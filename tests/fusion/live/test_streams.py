"""Real-time elevation: causal, the same however the samples are cut."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fusion.errors import UnusableArrays
from fusion.live import LiveElevation
from fusion.orientation.live import LiveVertical
from tests.factories import hold
from tests.fusion.made_motion import angle_between_deg, tumble

OFFSET = np.array([10.0, -20.0, 15.0])


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 999), max_size=6))
def test_the_result_does_not_depend_on_how_the_samples_are_cut(cuts: list[int]) -> None:
    motion = tumble(10.0, seed=1)
    bounds = [0, *sorted(set(cuts)), 1000]
    chunked = LiveElevation(100.0)

    pieces = [chunked.update(motion.acc_g[a:b], motion.gyr_dps[a:b]) for a, b in itertools.pairwise(bounds)]

    whole = LiveElevation(100.0).update(motion.acc_g, motion.gyr_dps)
    assert np.array_equal(np.concatenate(pieces), whole, equal_nan=True)


def test_what_comes_later_changes_nothing_before() -> None:
    motion = tumble(20.0, seed=2)
    other = motion.gyr_dps.copy()
    other[1200:] += 300.0

    first = LiveVertical(100.0).update(motion.acc_g, motion.gyr_dps)
    second = LiveVertical(100.0).update(motion.acc_g, other)

    assert np.array_equal(first[:1200], second[:1200])


def test_an_arm_raised_after_hanging_is_read_from_the_first_rest_on() -> None:
    # A still moment is 1.5 s: the 150th sample completes it.
    made = hold((0.0, 5.0), (95.0, 10.0)).recording.segments[0]

    elevation_deg = LiveElevation(100.0).update(made.acc_g, made.gyr_dps)

    assert np.isnan(elevation_deg[:149]).all()
    assert np.isfinite(elevation_deg[149:]).all()
    assert elevation_deg[-1] == pytest.approx(95.0, abs=0.5)


def test_with_a_known_arm_axis_it_starts_at_once_if_anything_is_felt() -> None:
    live = LiveElevation(100.0, arm_axis=np.array([0.0, 0.0, 1.0]))

    assert np.isnan(live.update([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])).all()
    assert live.update([1.0, 0.0, 0.0], [0.0, 0.0, 0.0]) == pytest.approx([90.0])


def test_an_offset_of_27_deg_per_s_is_taken_off_at_the_first_rest() -> None:
    motion = tumble(60.0, seed=3)
    live = LiveVertical(100.0)

    up = live.update(motion.acc_g, motion.gyr_dps + OFFSET)

    assert live.bias_dps == pytest.approx(OFFSET, abs=0.05)
    assert angle_between_deg(up[200:], motion.up[200:]).max() < 1.0


def test_the_turn_of_a_slow_even_movement_is_not_taken_for_bias() -> None:
    # At 2 deg/s gravity varies by 0.015 g in 1.5 s: still, by the limits.
    angle = np.radians(2.0 * np.arange(3000) / 100.0)
    acc_g = np.column_stack([np.zeros(3000), np.sin(angle), np.cos(angle)])
    live = LiveVertical(100.0)

    live.update(acc_g, np.tile([2.0, 0.0, 0.0], (3000, 1)))

    assert live.has_rested
    assert live.bias_dps == pytest.approx([0.0, 0.0, 0.0], abs=0.01)


def test_until_the_first_rest_gentle_movement_shows_the_offset() -> None:
    # An arm that swings by 5 deg in 3 s is never still.
    time_s = np.arange(6000) / 100.0
    angle = np.radians(5.0) * np.sin(2.0 * np.pi * time_s / 3.0)
    rate_dps = 5.0 * 2.0 * np.pi / 3.0 * np.cos(2.0 * np.pi * time_s / 3.0)
    acc_g = np.column_stack([np.zeros(6000), np.sin(angle), np.cos(angle)])
    gyr_dps = np.column_stack([rate_dps, np.zeros(6000), np.zeros(6000)])
    live = LiveVertical(100.0)

    live.update(acc_g, gyr_dps + OFFSET)

    assert not live.has_rested
    assert live.bias_dps == pytest.approx(OFFSET, abs=1.0)


def test_a_bias_given_beforehand_is_used_from_the_first_sample() -> None:
    motion = tumble(30.0, seed=4, still_s=0.0)

    up = LiveVertical(100.0, bias_dps=OFFSET).update(motion.acc_g, motion.gyr_dps + OFFSET)

    assert angle_between_deg(up, motion.up).max() < 1.0


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, np.nan, np.inf])
def test_a_rate_that_is_not_positive_is_refused_at_once(rate_hz: float) -> None:
    with pytest.raises(UnusableArrays) as refused:
        LiveElevation(rate_hz)

    assert refused.value.facts["why"] == "rate"


UNIT = np.tile([0.0, 0.0, 1.0], (300, 1))


@pytest.mark.parametrize(
    ("acc", "gyr_rows", "why"),
    [(UNIT[:3] * np.nan, 3, "finite"), (UNIT[:3], 4, "shape"), (9.80665 * UNIT, 300, "unit")],
    ids=["no numbers", "lengths that differ", "metres per second squared"],
)
def test_samples_that_cannot_be_fused_are_refused_while_waiting_too(
    acc: NDArray[np.float64], gyr_rows: int, why: str
) -> None:
    with pytest.raises(UnusableArrays) as refused:
        LiveElevation(100.0).update(acc, np.zeros((gyr_rows, 3)))

    assert refused.value.facts["why"] == why


@pytest.mark.parametrize("axis", [None, np.array([0.0, 0.0, 1.0])])
def test_an_empty_chunk_gives_no_row_and_changes_nothing(axis: NDArray[np.float64] | None) -> None:
    made = hold((0.0, 5.0), rate_hz=100.0).recording.segments[0]
    nothing = np.zeros((0, 3))
    live, other = LiveElevation(100.0, axis), LiveElevation(100.0, axis)

    empty = live.update(nothing, nothing)

    assert empty.shape == (0,)
    expected = other.update(made.acc_g, made.gyr_dps)
    assert np.array_equal(live.update(made.acc_g, made.gyr_dps), expected, equal_nan=True)


@pytest.mark.parametrize(
    "axis", [[1.0, 0.0], [np.nan, 0.0, 1.0], [0.0, 0.0, 0.0], ["a", "b", "c"], [0.0, 0.0, 9.81]]
)
def test_an_arm_axis_that_is_no_unit_vector_is_refused_at_once(axis: list[object]) -> None:
    with pytest.raises(UnusableArrays):
        LiveElevation(100.0, np.array(axis))


def test_a_chunk_that_is_refused_changes_nothing() -> None:
    acc, gyr = np.tile([0.0, 0.0, 1.0], (200, 1)), np.zeros((200, 3))
    broken = np.where(np.arange(200)[:, None] < 199, acc, np.nan)
    live = LiveElevation(100.0)

    with pytest.raises(UnusableArrays):
        live.update(broken, gyr)

    # As at the very first chunk: a moment of stillness is waited for again.
    assert np.isnan(live.update(acc[:1], gyr[:1])).all()
