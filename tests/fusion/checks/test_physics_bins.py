"""Recordings that are right stay as they are."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.checks.physics import check_physics
from fusion.recording import Recording, Segment, Stated
from fusion.simulation import simulate_shift
from fusion.simulation.sensor import Device
from tests.simulated_shifts import play_shift
from tests.validation.broad import load_trials, resample_to_100_hz

STATED = Stated("g", "dps")


def record(rate_hz: float, acc_g: NDArray[np.floating], gyr_dps: NDArray[np.floating]) -> Recording:
    segment = Segment(0, rate_hz, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    return Recording("other", "0" * 64, None, None, segment.duration_us, (segment,), stated=STATED)


def simulate(device: Device, seed: int) -> Recording:
    made = play_shift(simulate_shift(device, 0.5, seed))
    return record(float(made.rate_hz), made.acc_g, made.gyr_dps)


def assert_left_alone(recordings: Sequence[Recording]) -> None:
    for recording in recordings:
        before = [(segment.acc_g.copy(), segment.gyr_dps.copy()) for segment in recording.segments]
        checked = check_physics(recording)
        assert (checked.flags, checked.gyr_range_dps, checked.acc_range_g) == ((), None, None)
        assert np.array_equal(checked.segments[0].acc_g, before[0][0])
        assert np.array_equal(checked.segments[0].gyr_dps, before[0][1])


@pytest.mark.slow
@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
def test_simulated_half_hours_are_left_alone(device: Device) -> None:
    assert_left_alone([simulate(device, seed) for seed in range(1, 11)])


@pytest.mark.real_recordings
@pytest.mark.slow
def test_the_trials_of_broad_are_left_alone(shared_data: Callable[[str], Path]) -> None:
    trials = load_trials(shared_data("broad"))

    assert_left_alone([record(trial.rate_hz, trial.acc_g, trial.gyr_dps) for trial in trials])
    slower = [resample_to_100_hz(trial) for trial in trials]
    assert_left_alone([record(trial.rate_hz, trial.acc_g, trial.gyr_dps) for trial in slower])
