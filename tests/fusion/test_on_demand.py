"""The vertical that is worked out when it is looked at."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.elevation import estimate_elevation
from fusion.orientation.on_demand import VerticalOnDemand
from fusion.pose.calibrate import calibrate
from tests.factories import hold


def make(rate_hz: float = 100.0) -> VerticalOnDemand:
    recording = hold((0.0, 6.0), (70.0, 4.02), rate_hz=rate_hz).recording
    vertical = estimate_elevation(calibrate(recording, "n-pose")).segments[0].vertical
    assert isinstance(vertical, VerticalOnDemand)
    return vertical


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1002), st.integers(0, 1002))
def test_a_slice_is_the_same_however_it_is_cut(first: int, stop: int) -> None:
    vertical = VERTICAL

    assert np.array_equal(vertical[first:stop], WHOLE[first:stop])


def test_blocks_put_together_are_the_whole() -> None:
    blocks = [block for _, block in VERTICAL.blocks()]

    assert np.array_equal(np.concatenate(blocks), WHOLE)


def test_what_is_kept_is_much_less_than_the_vectors() -> None:
    vertical = make(rate_hz=500.0)

    assert vertical.nbytes < 0.25 * vertical[:].nbytes


VERTICAL = make()
WHOLE = VERTICAL[:]
