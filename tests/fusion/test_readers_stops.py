"""Single axes that stop for a moment while the arm moves, and readings that only look like it."""

from dataclasses import replace

import numpy as np
import pytest

from fusion.checks.faults import exclude_stuck
from fusion.checks.stopped import find_stops
from fusion.errors import DeadSensor
from fusion.recording import Recording, Span
from tests.badfiles.arm import Matrix, minute
from tests.conftest import SHARED_DATA
from tests.factories import record
from tests.fusion.made_motion import tumble


def turning(seconds: float = 20.0) -> tuple[Matrix, Matrix]:
    """Acceleration and angular rate of a sensor that is turned about all axes, with noise."""
    motion, chance = tumble(seconds, still_s=2.0), np.random.default_rng(3)
    acc_g = motion.acc_g + chance.normal(0.0, 0.002, motion.acc_g.shape)
    gyr_dps = motion.gyr_dps + chance.normal(0.0, 0.1, motion.gyr_dps.shape)
    return acc_g, np.round(gyr_dps * 16.384) / 16.384


def excluded(recording: Recording) -> tuple[Span, ...]:
    return exclude_stuck(recording).excluded


def test_what_turns_and_was_measured_is_left_alone() -> None:
    recording = record(*turning(), 100.0)

    assert exclude_stuck(recording) is recording


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_of_the_gyroscope_at_zero_while_it_turns_ends_the_segment(axis: int) -> None:
    acc_g, gyr_dps = turning()
    gyr_dps[800:820, axis] = 0.0

    recording = exclude_stuck(record(acc_g, gyr_dps, 100.0))

    assert recording.excluded == (Span(8_000_000, 200_000, "stuck"),)
    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 800), (8_200_000, 1180)]


def test_up_to_50_ms_of_it_are_bridged_on_the_axis_that_stopped() -> None:
    acc_g, gyr_dps = turning()
    before, after = gyr_dps[799, 1], gyr_dps[803, 1]
    gyr_dps[800:803, 1] = 0.0

    recording = exclude_stuck(record(acc_g, gyr_dps, 100.0))

    (segment,) = recording.segments
    assert recording.excluded == (Span(8_000_000, 30_000, "stuck"),)
    assert segment.gyr_dps[800:803, 1] == pytest.approx(
        before + (after - before) * np.array([0.25, 0.5, 0.75])
    )
    assert segment.gyr_dps[800:803, 0] == pytest.approx(gyr_dps[800:803, 0], abs=1e-4)


def test_what_was_missing_before_an_axis_stopped_stays_missing() -> None:
    acc_g, gyr_dps = turning()
    gyr_dps[800:820, 1] = 0.0
    whole = record(acc_g, gyr_dps, 100.0)
    bridged = replace(whole.segments[0], bridged=((805, 808),))

    recording = exclude_stuck(replace(whole, segments=(bridged,)))

    assert recording.excluded == (Span(8_000_000, 50_000, "stuck"), Span(8_080_000, 120_000, "stuck"))


def test_one_zero_of_an_axis_that_turns_is_no_reading() -> None:
    acc_g, gyr_dps = turning()
    row = 700 + int(np.argmax(np.abs(gyr_dps[700:900, 0])))
    gyr_dps[row, 0] = 0.0

    assert excluded(record(acc_g, gyr_dps, 100.0)) == (Span(row * 10_000, 10_000, "stuck"),)


def test_an_axis_that_holds_its_last_value_is_no_reading() -> None:
    acc_g, gyr_dps = turning()
    gyr_dps[801:820, 2] = gyr_dps[800, 2]

    assert excluded(record(acc_g, gyr_dps, 100.0)) == (Span(8_000_000, 200_000, "stuck"),)


def test_an_axis_of_the_accelerometer_at_zero_is_no_reading_even_at_rest() -> None:
    acc_g, gyr_dps = (samples.copy() for samples in minute())
    acc_g[500:508, 2] = 0.0

    assert excluded(record(acc_g, gyr_dps, 100.0)) == (Span(5_000_000, 80_000, "stuck"),)


def test_of_an_axis_that_stops_often_each_rest_at_that_value_in_movement_is_a_stop() -> None:
    """The last begins and ends where the axis hardly turns, so that nothing leaps."""
    acc_g, gyr_dps = turning()
    fast = [first + int(np.argmax(np.abs(gyr_dps[first : first + 300, 0]))) for first in (500, 900, 1300)]
    slow = int(np.flatnonzero(np.diff(np.sign(gyr_dps[600:1400, 0])))[0]) + 600
    for first in (*fast, slow - 3):
        gyr_dps[first : first + 7, 0] = 0.0

    stops = find_stops(record(acc_g, gyr_dps, 100.0).segments)

    assert stops == [sorted((3, first, first + 7) for first in (*fast, slow - 3))]


def test_an_axis_at_the_end_of_its_range_did_not_stop() -> None:
    acc_g, gyr_dps = turning()
    top = 0.9 * float(np.abs(gyr_dps[:, 0]).max())

    gyr_dps[:, 0] = np.clip(gyr_dps[:, 0], -top, top)

    assert excluded(record(acc_g, gyr_dps, 100.0)) == ()


@pytest.mark.parametrize("step_dps", [0.1, 0.5, 1.0, 5.0])
def test_coarse_readings_of_a_turning_arm_did_not_stop(step_dps: float) -> None:
    acc_g, gyr_dps = turning()

    coarse = np.round(gyr_dps / step_dps) * step_dps

    assert excluded(record(acc_g, coarse, 100.0)) == ()


def test_an_axis_that_stops_at_one_row_in_ten_is_faulty() -> None:
    acc_g, gyr_dps = (np.tile(samples, (5, 1)) for samples in turning())
    acc_g[3::6, 2] = 0.0

    with pytest.raises(DeadSensor) as refusal:
        exclude_stuck(record(acc_g, gyr_dps, 100.0))

    assert refusal.value.facts == {"sensor": "accelerometer", "axis": "z"}


def test_a_knock_after_a_rest_is_no_stop() -> None:
    acc_g, gyr_dps = (np.round(samples, 1) for samples in minute())
    gyr_dps[500:512, 1] += 60.0 * np.exp(-np.arange(12) / 3.0) * np.cos(np.arange(12) * 2.0)

    assert excluded(record(acc_g, gyr_dps, 100.0)) == ()


@pytest.mark.real_recordings
@pytest.mark.parametrize("stride", [1, 3])
def test_no_real_motion_stops(stride: int) -> None:
    paths = sorted((SHARED_DATA / "broad").glob("*.npz"))
    if not paths:
        pytest.skip("real recordings absent: broad")
    found = {}

    for path in paths:
        held = np.load(path)
        samples = (held["acc_g"][::stride], held["gyr_dps"][::stride])
        found[path.stem] = excluded(record(*samples, float(held["rate_hz"]) / stride))

    assert not any(found.values()), found
