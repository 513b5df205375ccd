"""What was put right gives the figures of the file that was right; what was right stays as it is."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.checks.physics import check_physics
from fusion.pipeline import analyse
from fusion.recording import Recording, Segment, Stated
from fusion.simulation import simulate_shift
from fusion.simulation.sensor import Device
from tests.simulated_shifts import play_shift
from tests.validation.broad import load_trials, resample_to_100_hz

Rows = NDArray[np.float32]
STATED = Stated("g", "dps")


def record(rate_hz: float, acc_g: NDArray[np.floating], gyr_dps: NDArray[np.floating]) -> Recording:
    segment = Segment(0, rate_hz, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    return Recording("other", "0" * 64, None, None, segment.duration_us, (segment,), stated=STATED)


def simulate(device: Device, hours: float, seed: int) -> Recording:
    made = play_shift(simulate_shift(device, hours, seed))
    return record(float(made.rate_hz), np.asarray(made.acc_g), np.asarray(made.gyr_dps))


def find_bins(recording: Recording) -> NDArray[np.float64]:
    """Time in each bin, percent."""
    return np.array([one.percent for one in analyse(recording).exposure.bins])


@pytest.fixture(scope="session")
def clean_shift() -> Recording:
    """Half an hour of simulated work; its parts are as far off as parts are."""
    return simulate("gt9x", 0.5, seed=4)


@pytest.fixture(scope="session")
def clean_bins(clean_shift: Recording) -> NDArray[np.float64]:
    return find_bins(clean_shift)


def scale(*factors: float) -> Callable[[Rows], Rows]:
    return lambda samples: samples * np.array(factors, np.float32)


RATES = {
    "all negated": scale(-1, -1, -1),
    **{f"x{factor:.3g}": scale(factor) for factor in (57.3, 1 / 57.3, 1000.0)},
}


def put_right(recording: Recording, gyr_dps: Rows) -> Recording:
    (segment,) = recording.segments
    changed = replace(segment, acc_g=segment.acc_g.copy(), gyr_dps=gyr_dps)
    return check_physics(replace(recording, segments=(changed,)))


@pytest.mark.parametrize("change", RATES.values(), ids=RATES)
def test_a_gyroscope_put_right_gives_the_bins_of_the_clean_file(
    clean_shift: Recording, clean_bins: NDArray[np.float64], change: Callable[[Rows], Rows]
) -> None:
    checked = put_right(clean_shift, change(clean_shift.segments[0].gyr_dps))

    assert [flag.code for flag in checked.flags][:1] == ["W-UNITS"]
    assert find_bins(checked) == pytest.approx(clean_bins, abs=0.3)


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
    assert_left_alone([simulate(device, 0.5, seed) for seed in range(1, 11)])


@pytest.mark.real_recordings
@pytest.mark.slow
def test_the_trials_of_broad_are_left_alone(shared_data: Callable[[str], Path]) -> None:
    trials = load_trials(shared_data("broad"))

    assert_left_alone([record(trial.rate_hz, trial.acc_g, trial.gyr_dps) for trial in trials])
    slower = [resample_to_100_hz(trial) for trial in trials]
    assert_left_alone([record(trial.rate_hz, trial.acc_g, trial.gyr_dps) for trial in slower])
