"""Acceleration and angular rate under each other's names are refused as such."""

from typing import Any

import numpy as np
import pytest

from fusion.checks.physics import are_exchanged, check_physics
from fusion.errors import ExchangedSensors
from fusion.recording import Recording, Segment, Stated
from tests.badfiles.arm import Matrix
from tests.conftest import SHARED_DATA
from tests.fusion.made_motion import tumble


def turning() -> tuple[Matrix, Matrix]:
    """Two minutes of a sensor that is turned about all axes, with rests between."""
    parts = [tumble(10.0, seed=seed, still_s=2.0) for seed in range(12)]
    chance = np.random.default_rng(1)
    acc_g, gyr_dps = np.vstack([part.acc_g for part in parts]), np.vstack([part.gyr_dps for part in parts])
    return acc_g + chance.normal(0.0, 0.002, acc_g.shape), gyr_dps + chance.normal(0.0, 0.1, gyr_dps.shape)


def recording_of(acc: Matrix, gyr: Matrix, **stated: Any) -> Recording:
    segment = Segment(0, 100.0, acc.astype(np.float32), gyr.astype(np.float32))
    return Recording("other", "", None, None, segment.duration_us, (segment,), stated=Stated(**stated))


def test_exchanged_columns_are_refused_with_their_cause() -> None:
    acc_g, gyr_dps = turning()

    with pytest.raises(ExchangedSensors):
        check_physics(recording_of(gyr_dps, acc_g, acc_unit="g", gyr_unit="dps"))


@pytest.mark.real_recordings
def test_real_recordings_do_not_look_exchanged_until_they_are() -> None:
    paths = sorted((SHARED_DATA / "broad").glob("*.npz"))
    if not paths:
        pytest.skip("real recordings absent: broad")

    for path in paths:
        held = np.load(path)
        assert not are_exchanged(recording_of(held["acc_g"], held["gyr_dps"]).segments)
        assert are_exchanged(recording_of(held["gyr_dps"], held["acc_g"]).segments)
