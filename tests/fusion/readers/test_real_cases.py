"""Layouts that people meet, made from one simulated recording of a right arm."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fusion.errors import SeveralSensors
from fusion.readers import ColumnProfile, read_recording
from fusion.recording import Recording

pytestmark = pytest.mark.real_recordings

FIRST_ROW_G = (-0.082, 0.984, -0.023)
FIRST_ROW_DPS = (-0.427, 0.977, -0.854)
"""Of the recording that all these files were made from."""


@pytest.fixture
def read_case(shared_data: Callable[[str], Path]) -> Callable[..., Recording]:
    return lambda name, **asked: read_recording(shared_data(f"cases/{name}"), **asked)


def check_first_row(recording: Recording, gravity: float = 1.0) -> None:
    first = recording.segments[0]
    np.testing.assert_allclose(first.acc_g[0], gravity * np.array(FIRST_ROW_G), atol=0.003)
    np.testing.assert_allclose(first.gyr_dps[0], FIRST_ROW_DPS, atol=0.35)


def test_gravity_is_added_to_the_acceleration_of_a_watch(read_case: Callable[..., Recording]) -> None:
    recording = read_case("core_motion_watch.csv")

    check_first_row(recording)
    assert recording.duration_us == 360_000_000


@pytest.mark.parametrize("name", ["sim_2dec.csv", "sim_2dec_nounit.csv"])
def test_two_decimals_without_a_unit_lose_nothing(read_case: Callable[..., Recording], name: str) -> None:
    recording = read_case(name)

    assert recording.excluded == ()
    assert recording.duration_us == 360_000_000


def test_a_phone_and_a_watch_are_both_offered(read_case: Callable[..., Recording]) -> None:
    with pytest.raises(SeveralSensors) as refusal:
        read_case("phone_and_watch.zip")

    assert refusal.value.facts["list"] == "WristMotion, Accelerometer"
    check_first_row(read_case("phone_and_watch.zip", profile=ColumnProfile(sensor="WristMotion")))


@pytest.mark.parametrize(
    ("name", "rate_hz", "duration_s"),
    [
        ("mac_zip.zip", 100.0, 360.0),
        ("metawear.zip", 100.0, 360.0),
        ("metawear_triplets.zip", 100.0, 360.0),
        ("polar_sense.zip", 52.0, 360.0),
    ],
)
def test_archives_are_read(
    read_case: Callable[..., Recording], name: str, rate_hz: float, duration_s: float
) -> None:
    recording = read_case(name)

    check_first_row(recording)
    assert recording.rate_hz == pytest.approx(rate_hz, abs=0.001)
    assert recording.duration_us / 1e6 == pytest.approx(duration_s, abs=0.03)
    assert not {"W-ROWS-DROPPED", "W-GAP"} & {flag.code for flag in recording.flags}
