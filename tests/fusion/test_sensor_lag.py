"""A gyroscope that is later than the accelerometer is noticed, and a right one is left in peace."""

import numpy as np
import pytest

from fusion.checks.axes import SensorLag, measure_lag
from fusion.checks.gravity_windows import GyroModel, cut_windows
from fusion.checks.physics import check_physics
from fusion.errors import MixedColumns
from fusion.recording import Recording
from tests.badfiles.arm import Matrix
from tests.conftest import SHARED_DATA
from tests.factories import record
from tests.fusion.made_motion import tumble

AS_READ = GyroModel(np.eye(3), np.zeros(3), np.zeros(3))


def turning() -> tuple[Matrix, Matrix]:
    parts = [tumble(10.0, seed=seed, still_s=2.0) for seed in range(24)]
    chance = np.random.default_rng(1)
    acc_g, gyr_dps = np.vstack([part.acc_g for part in parts]), np.vstack([part.gyr_dps for part in parts])
    return acc_g + chance.normal(0.0, 0.01, acc_g.shape), gyr_dps + chance.normal(0.0, 0.1, gyr_dps.shape)


def late(rows: int) -> Recording:
    """A hundred rows a second; the gyroscope so many rows late."""
    acc_g, gyr_dps = turning()
    return record(acc_g, np.roll(gyr_dps, rows, axis=0), 100.0)


@pytest.mark.parametrize("rows", [-10, -4, 0, 4, 10])
def test_the_lag_is_found_to_the_windows_rows_of_20_ms(rows: int) -> None:
    lag = measure_lag(cut_windows(late(rows).segments), AS_READ)

    assert lag.lag_s == pytest.approx(rows / 100.0, abs=0.011)


def test_few_windows_tell_no_lag() -> None:
    acc_g, gyr_dps = turning()
    short = record(acc_g[:4000], np.roll(gyr_dps[:4000], 10, axis=0), 100.0)

    assert measure_lag(cut_windows(short.segments), AS_READ) == SensorLag(0.0, 0.0)


def test_sensors_that_were_surely_not_read_at_one_moment_are_refused() -> None:
    with pytest.raises(MixedColumns) as refusal:
        check_physics(late(10))

    assert refusal.value.facts == {"lag_ms": 100}


def test_a_likely_lag_is_told() -> None:
    flags = check_physics(late(4)).flags

    assert [(flag.code, flag.facts) for flag in flags] == [("W-LAG", {"lag_ms": 40})]


@pytest.mark.real_recordings
def test_no_real_recording_has_a_lag_until_it_is_given_one() -> None:
    paths = sorted((SHARED_DATA / "broad").glob("*rotation*.npz"))
    if not paths:
        pytest.skip("real recordings absent: broad")

    for path in paths:
        held = np.load(path)
        acc_g, gyr_dps, rate_hz = held["acc_g"], held["gyr_dps"], float(held["rate_hz"])
        right, wrong = (
            measure_lag(cut_windows(record(acc_g, rates, rate_hz).segments), AS_READ)
            for rates in (gyr_dps, np.roll(gyr_dps, round(0.1 * rate_hz), axis=0))
        )
        assert not right.is_likely
        assert wrong.is_certain
