"""At most 100 rows of angle a second: what is averaged, and whose time it is."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from acromion.fusion.conventions import MethodName
from acromion.fusion.elevation import Elevation, VerticalOnDemand, estimate_elevation, group_rows, read_rows
from acromion.fusion.orientation.smoothed import smooth_nodes
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.recording import Recording, Segment
from acromion.fusion.runs import find_valid_samples
from acromion.fusion.settings import AnalysisSettings
from tests.factories import hold, move_arm

LIFT_DPS = 90.0


def run(samples: int, rate_hz: float) -> Segment:
    nothing = np.zeros((samples, 3), np.float32)
    return Segment(0, rate_hz, nothing, nothing)


def lift(samples: int, rate_hz: float) -> NDArray[np.float64]:
    """The vertical of an arm that is raised at 90 deg/s from 0, at each sample."""
    angle = np.radians(LIFT_DPS * np.arange(samples) / rate_hz)
    return np.stack([np.sin(angle), np.zeros(samples), np.cos(angle)], axis=1)


def read_angle(vertical: NDArray[np.float64], rate_hz: float) -> NDArray[np.float64]:
    """The angle of each row, deg."""
    rows = group_rows(run(len(vertical), rate_hz))
    up = read_rows(vertical, rows, 0, len(rows))
    return np.degrees(np.arctan2(up[:, 0], up[:, 2]))


def bridge(recording: Recording, *holes: tuple[int, int]) -> Recording:
    return replace(recording, segments=(replace(recording.segments[0], bridged=holes),))


def fuse(recording: Recording, method: MethodName = "smoothed") -> Elevation:
    settings = AnalysisSettings(calibration_windows_s=((0.5, 4.5),))
    return estimate_elevation(calibrate(recording, settings), method)


def find_missing_us(analysis: Analysis) -> dict[str, int]:
    return {part.name: part.duration_us for part in analysis.time.parts if part.account == "missing"}


@pytest.mark.parametrize(
    ("rate_hz", "per_row", "row_hz"),
    [(50.0, 1, 50.0), (100.4, 1, 100.4), (101.0, 2, 50.5), (200.0, 2, 100.0), (500.0, 5, 100.0)],
)
def test_as_few_samples_make_a_row_as_come_to_100_hz(rate_hz: float, per_row: int, row_hz: float) -> None:
    rows = group_rows(run(3000, rate_hz))

    assert (rows.per_row, rows.rate_hz) == (per_row, row_hz)


@pytest.mark.parametrize(("samples", "rows"), [(5004, 1000), (3, 1), (0, 0)])
def test_samples_over_a_last_whole_row_lose_no_time_and_fewer_than_a_row_are_one(
    samples: int, rows: int
) -> None:
    laid = group_rows(run(samples, 500.0))

    assert len(laid) == rows
    assert len(laid) * laid.period_us == pytest.approx(2000 * samples, abs=1e-6)


@pytest.mark.parametrize(("samples", "rate_hz"), [(1000, 500.0), (1004, 500.0), (401, 200.0), (955, 476.03)])
def test_a_row_is_neither_early_nor_late(samples: int, rate_hz: float) -> None:
    found_deg = read_angle(lift(samples, rate_hz), rate_hz)

    true_deg = LIFT_DPS * np.arange(len(found_deg)) * (samples / rate_hz / len(found_deg))
    assert np.abs(found_deg - true_deg)[1:].max() < 1e-4


def test_the_first_row_has_only_the_samples_from_its_stamp_on() -> None:
    found_deg = read_angle(lift(1000, 500.0), 500.0)

    assert found_deg[0] == pytest.approx((0.0 + 0.18 + 0.36) / 3)


@pytest.mark.parametrize(
    ("rate_hz", "sample", "x", "rows"), [(500.0, 502, 0.05, [100]), (200.0, 201, 0.04, [100, 101])]
)
def test_each_of_five_samples_weighs_a_fifth_and_the_outer_two_of_an_even_number_half(
    rate_hz: float, sample: int, x: float, rows: list[int]
) -> None:
    vertical = np.tile([0.0, 0.0, 1.0], (1000, 1))
    vertical[sample, 0] = x

    found_deg = read_angle(vertical, rate_hz)

    assert np.flatnonzero(found_deg).tolist() == rows
    assert found_deg[rows] == pytest.approx(np.degrees(np.arctan(0.01)), abs=1e-5)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 200), st.integers(0, 200))
def test_rows_are_the_same_however_they_are_cut(first: int, stop: int) -> None:
    vertical, rows = lift(1003, 500.0), group_rows(run(1003, 500.0))

    whole = read_rows(vertical, rows, 0, len(rows))

    assert np.array_equal(read_rows(vertical, rows, first, max(first, stop)), whole[first : max(first, stop)])


def test_a_row_with_a_bridged_sample_is_not_valid_and_its_neighbours_are() -> None:
    made = bridge(hold((0.0, 10.0), rate_hz=500.0).recording, (2004, 2006))

    assert np.flatnonzero(~fuse(made).segments[0].valid).tolist() == [400, 401]


def test_samples_that_fall_with_a_bridged_one_are_missing_and_nothing_else_is() -> None:
    made = hold((0.0, 30.0), (80.0, 30.0), rate_hz=500.0).recording

    analysis = analyse(bridge(made, *((row, row + 1) for row in range(502, 30_000, 200))))

    time = analysis.time
    assert (time.recorded_us, time.missing_us) == (60_000_000, 148 * 10_000)
    assert find_missing_us(analysis) == {"missing": 148 * 10_000}
    assert "W-UNTRUSTED" not in {flag.code for flag in analysis.quality.flags}


@pytest.mark.parametrize("rate_hz", [119.0, 476.03, 500.0])
def test_every_microsecond_of_a_clean_recording_is_analysed(rate_hz: float) -> None:
    made = hold((0.0, 20.0), (80.0, 20.0), (5.0, 20.003), rate_hz=rate_hz).recording

    analysis = analyse(made)

    assert analysis.time.analysed_us == made.duration_us
    assert round(analysis.exposure.analysed_s * 1e6) == made.duration_us


@pytest.mark.parametrize(("method", "first"), [("smoothed", 0), ("published", 0), ("live", 300)])
def test_every_method_gives_a_hundred_rows_a_second_and_live_leaves_out_three(
    method: MethodName, first: int
) -> None:
    (segment,) = fuse(hold((0.0, 10.0), rate_hz=500.0).recording, method).segments

    assert isinstance(segment.vertical, np.ndarray)
    assert (len(segment), segment.rate_hz, segment.vertical.shape) == (1000, 100.0, (1000, 3))
    assert np.flatnonzero(segment.valid)[0] == first


def test_the_angle_of_a_fast_swing_is_that_at_its_stamps() -> None:
    def swing(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return 45.0 - 45.0 * np.cos(2 * np.pi * 0.5 * np.maximum(time_s - 10.0, 0.0))

    made = move_arm(swing, 30.0, rate_hz=500.0)
    (segment,) = fuse(made.recording).segments

    true_deg = made.elevation_deg[::5]
    speed_dps = np.gradient(true_deg, 0.01)[1500:2500]
    error_deg = (segment.elevation_deg - true_deg)[1500:2500]
    assert abs((error_deg * speed_dps).sum() / (speed_dps**2).sum()) < 1e-4  # s late


def test_a_sample_counts_where_all_rows_that_it_reaches_into_are_valid() -> None:
    valid = np.array([True, False, True, True])

    assert find_valid_samples(valid, 10).tolist() == [True] * 2 + [False] * 3 + [True] * 5


# The vertical at the samples, worked out for the slice that is asked for.


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
