"""Single axes that stop for a moment while the arm moves, and readings that only look like it."""

import numpy as np
import pytest

from fusion.checks.faults import exclude_stuck
from fusion.checks.stopped import find_stopping
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


def stop(samples: Matrix, axis: int, rows: int, *, is_held: bool = False) -> None:
    """One axis at zero, or at its last value, for so many rows, twice a second."""
    for first in range(500, 1500, 50):
        samples[first : first + rows, axis] = samples[first - 1, axis] if is_held else 0.0


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("rows", [3, 20])
def test_an_axis_of_the_gyroscope_that_reads_zero_again_and_again_is_faulty(axis: int, rows: int) -> None:
    acc_g, gyr_dps = turning()
    stop(gyr_dps, axis, rows)

    with pytest.raises(DeadSensor) as refusal:
        exclude_stuck(record(acc_g, gyr_dps, 100.0))

    assert refusal.value.facts == {"sensor": "gyroscope", "axis": "xyz"[axis]}


def test_an_axis_that_holds_its_last_value_again_and_again_is_faulty() -> None:
    acc_g, gyr_dps = turning()
    stop(gyr_dps, 2, 20, is_held=True)

    with pytest.raises(DeadSensor) as refusal:
        exclude_stuck(record(acc_g, gyr_dps, 100.0))

    assert refusal.value.facts == {"sensor": "gyroscope", "axis": "z"}


def test_a_few_stops_are_no_fault() -> None:
    acc_g, gyr_dps = turning()
    gyr_dps[800:820, 1] = 0.0

    assert find_stopping(record(acc_g, gyr_dps, 100.0).segments) is None


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


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_a_gyroscope_slower_than_the_table_did_not_stop(rows: int) -> None:
    """A Shimmer at 102.4 Hz gives each reading of its gyroscope in three rows."""
    acc_g, gyr_dps = turning()

    held = np.repeat(gyr_dps[::rows], rows, axis=0)[: len(gyr_dps)]

    assert excluded(record(acc_g, held, 100.0)) == ()


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
