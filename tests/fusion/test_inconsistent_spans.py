"""A part in which the sensors contradict each other, though in the rest they agree, is told with its time."""

from collections.abc import Callable

import numpy as np
import pytest

from fusion.checks.physics import check_physics
from fusion.recording import QualityFlag
from tests.badfiles.arm import Matrix
from tests.conftest import SHARED_DATA
from tests.factories import record
from tests.fusion.made_motion import tumble


def flags_of(change: Callable[[Matrix, Matrix], None]) -> dict[str, QualityFlag]:
    """Of four minutes of turning with noise, changed in place."""
    parts = [tumble(10.0, seed=seed, still_s=2.0) for seed in range(24)]
    chance = np.random.default_rng(1)
    acc_g, gyr_dps = np.vstack([part.acc_g for part in parts]), np.vstack([part.gyr_dps for part in parts])
    acc_g = acc_g + chance.normal(0.0, 0.002, acc_g.shape)
    gyr_dps = gyr_dps + chance.normal(0.0, 0.1, gyr_dps.shape)
    change(acc_g, gyr_dps)
    return {flag.code: flag for flag in check_physics(record(acc_g, gyr_dps, 100.0)).flags}


def test_sensors_that_agree_all_along_are_left_in_peace() -> None:
    assert flags_of(lambda _acc, _gyr: None) == {}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_of_the_gyroscope_that_is_turned_over_from_some_time_on_is_told(axis: int) -> None:
    def turn(_acc_g: Matrix, gyr_dps: Matrix) -> None:
        gyr_dps[19_000:, axis] *= -1.0

    flag = flags_of(turn)["W-MIXED-PART"]

    assert flag.first_s is not None
    assert flag.first_s > 180.0
    assert 20.0 < flag.seconds < 60.0


def test_a_gyroscope_in_another_range_for_a_time_is_told() -> None:
    def halve(_acc_g: Matrix, gyr_dps: Matrix) -> None:
        gyr_dps[8_000:13_000] *= 2.0

    flag = flags_of(halve)["W-MIXED-PART"]

    assert flag.first_s is not None
    assert flag.last_s is not None
    assert 70.0 < flag.first_s < flag.last_s < 140.0


@pytest.mark.real_recordings
def test_no_real_recording_contradicts_itself_in_a_part() -> None:
    paths = sorted((SHARED_DATA / "broad").glob("*.npz"))
    if not paths:
        pytest.skip("real recordings absent: broad")

    for path in paths:
        held = np.load(path)
        checked = check_physics(record(held["acc_g"], held["gyr_dps"], float(held["rate_hz"])))
        assert not {"W-MIXED-PART", "W-LAG"} & {flag.code for flag in checked.flags}
