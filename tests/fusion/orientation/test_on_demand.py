"""The vertical at the samples, worked out for the slice that is asked for."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.orientation.angle_rows import VerticalOnDemand
from fusion.orientation.smoothed import smooth_nodes
from fusion.pose.calibrate import calibrate
from tests.factories import hold


def make() -> VerticalOnDemand:
    samples = calibrate(hold((0.0, 6.0), (70.0, 4.02)).recording)
    calibrated = samples.run_of(samples.recording.segments[0])
    nodes = calibrated.nodes
    return VerticalOnDemand(calibrated.run.gyr_dps, calibrated.run.rate_hz, nodes, smooth_nodes(nodes).up)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1002), st.integers(0, 1002))
def test_a_slice_is_the_same_however_it_is_cut(first: int, stop: int) -> None:
    assert np.array_equal(VERTICAL[first:stop], WHOLE[first:stop])


VERTICAL = make()
WHOLE = VERTICAL[:]
