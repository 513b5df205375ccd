"""Joint motion: strokes, waves, and that any stretch can be played on its own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.simulation.activities import Choreography
from fusion.simulation.body import Channel, Motion, play
from fusion.simulation.shift import plan_day


def make_day() -> Motion:
    return plan_day(120.0, np.random.default_rng(2))[1]


def test_a_stroke_is_half_way_and_fastest_at_half_time_and_stays_at_its_end() -> None:
    body = Choreography()
    body.move(2.0, {Channel.ELEVATION: 90.0})

    motion = body.finish()

    value, rate, _ = play(motion, 0, 31, 10.0)[Channel.ELEVATION]
    assert value[10] == pytest.approx(45.0, abs=1e-12)
    assert rate[10] == pytest.approx(15 / 8 * 45.0)
    later = play(motion, 500, 10, 10.0)[Channel.ELEVATION]
    assert np.all(later == np.array([90.0, 0.0, 0.0])[:, None])


def test_strokes_add_up() -> None:
    body = Choreography()
    body.move(1.0, {Channel.PLANE: 30.0})
    body.wait(0.5)
    body.move(1.0, {Channel.PLANE: -10.0})

    value = play(body.finish(), 0, 40, 10.0)[Channel.PLANE, 0]

    assert value[-1] == pytest.approx(-10.0, abs=1e-12)


def test_a_wave_reaches_its_amplitude_between_swelling_and_fading_and_ends() -> None:
    body = Choreography()
    body.sway(Channel.AXIAL, 6.0, 2.0, 5.0)

    value = play(body.finish(), 0, 7000, 1000.0)[Channel.AXIAL, 0]

    assert value[1000:5000].max() == pytest.approx(5.0, abs=1e-4)
    assert np.all(value[6000:] == 0.0)


@pytest.mark.parametrize("order", [1, 2])
def test_each_derivative_is_the_slope_of_the_one_before(order: int) -> None:
    channels = play(make_day(), 0, 60_000, 1000.0)

    slope = np.gradient(channels[:, order - 1], 1e-3, axis=1)[:, 1:-1]

    scale = np.abs(channels[:, order]).max(axis=1, keepdims=True) + 1.0
    assert np.abs((slope - channels[:, order, 1:-1]) / scale).max() < 0.01


@settings(max_examples=20, deadline=None)
@given(first=st.integers(0, 9000), count=st.integers(1, 2000))
def test_a_stretch_played_alone_equals_the_same_stretch_of_the_whole(first: int, count: int) -> None:
    day = make_day()

    alone = play(day, first, count, 100.0)

    assert np.allclose(alone, play(day, 0, 12_000, 100.0)[:, :, first : first + count], rtol=0, atol=1e-9)
