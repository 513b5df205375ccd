"""Acceleration and angular rate under each other's names: put right where the motion bears it out."""

import numpy as np
import pytest

from fusion.checks.physics import are_exchanged, check_physics
from fusion.errors import ExchangedSensors
from fusion.recording import Recording, Segment
from fusion.units import DEG_PER_RAD, STANDARD_GRAVITY
from tests.badfiles.arm import Matrix
from tests.conftest import SHARED_DATA
from tests.fusion.made_motion import tumble


def turning() -> tuple[Matrix, Matrix]:
    """Two minutes of a sensor that is turned about all axes, with rests between."""
    parts = [tumble(10.0, seed=seed, still_s=2.0) for seed in range(12)]
    chance = np.random.default_rng(1)
    acc_g, gyr_dps = np.vstack([part.acc_g for part in parts]), np.vstack([part.gyr_dps for part in parts])
    return acc_g + chance.normal(0.0, 0.002, acc_g.shape), gyr_dps + chance.normal(0.0, 0.1, gyr_dps.shape)


def recording_of(acc: Matrix, gyr: Matrix, **understood: str) -> Recording:
    segment = Segment(0, 100.0, acc.astype(np.float32), gyr.astype(np.float32))
    return Recording("other", "", None, None, segment.duration_us, (segment,), understood=understood)


def test_columns_under_their_own_names_do_not_look_exchanged() -> None:
    assert not are_exchanged(recording_of(*turning()).segments)


def test_exchanged_columns_are_put_right_and_it_is_said() -> None:
    acc_g, gyr_dps = turning()

    checked = check_physics(recording_of(gyr_dps, acc_g, acceleration_unit="g", angular_rate_unit="dps"))

    assert checked.segments[0].acc_g == pytest.approx(acc_g, abs=1e-6)
    assert checked.segments[0].gyr_dps == pytest.approx(gyr_dps, abs=1e-4)
    assert [flag.facts["what"] for flag in checked.flags] == ["exchanged sensors"]


def test_each_sensor_keeps_the_unit_that_the_header_names_for_it() -> None:
    """Read as m/s2, a column of rad/s was divided by gravity; read as rad/s, one of m/s2 was made degrees."""
    acc_g, gyr_dps = turning()
    read_as_acc = gyr_dps / DEG_PER_RAD / STANDARD_GRAVITY
    read_as_gyr = acc_g * STANDARD_GRAVITY * DEG_PER_RAD

    checked = check_physics(
        recording_of(read_as_acc, read_as_gyr, acceleration_unit="m/s2", angular_rate_unit="rad/s")
    )

    assert checked.segments[0].acc_g == pytest.approx(acc_g, abs=1e-5)
    assert checked.segments[0].gyr_dps == pytest.approx(gyr_dps, abs=1e-3)


def test_what_the_motion_does_not_bear_out_is_refused_with_its_cause() -> None:
    acc_g, gyr_dps = turning()
    late_dps = np.roll(gyr_dps, 50, axis=0)

    with pytest.raises(ExchangedSensors):
        check_physics(recording_of(late_dps, acc_g))


@pytest.mark.real_recordings
def test_real_recordings_do_not_look_exchanged_until_they_are() -> None:
    paths = sorted((SHARED_DATA / "broad").glob("*.npz"))
    if not paths:
        pytest.skip("real recordings absent: broad")

    for path in paths:
        held = np.load(path)
        assert not are_exchanged(recording_of(held["acc_g"], held["gyr_dps"]).segments)
        assert are_exchanged(recording_of(held["gyr_dps"], held["acc_g"]).segments)
