"""A recording that is played: at its pace, with its own axis, to the bit."""

import numpy as np
import pytest

from app.live.sources import ReplaySource, find_axis
from fusion.live import LiveElevation, LiveSession
from tests.app.live.made import FIRST_POSE, make_worn


class Clock:
    """Time that passes only while somebody waits."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now_s(self) -> float:
        return self.time_s

    def wait(self, seconds: float) -> None:
        self.time_s += seconds


def play(source: ReplaySource) -> list[np.ndarray[tuple[int, ...], np.dtype[np.float32]]]:
    session = LiveSession(source.facts.rate_hz, source.facts.arm_axis)
    shown = []
    while (frames := source.read()) is not None:
        shown.append(session.take(frames).elevation_deg)
    return shown


@pytest.mark.parametrize(("speed", "lasts_s"), [(1.0, 22.0), (20.0, 1.1)])
def test_it_lasts_as_long_as_the_recording_or_a_part_of_it(speed: float, lasts_s: float) -> None:
    clock = Clock()

    play(
        ReplaySource(make_worn(FIRST_POSE, (95.0, 10.0)), "a.csv", speed, now_s=clock.now_s, wait=clock.wait)
    )

    assert clock.time_s == pytest.approx(lasts_s, abs=0.02)


def test_the_angle_is_that_of_live_elevation_on_the_file_to_the_bit() -> None:
    recording = make_worn(FIRST_POSE, (95.0, 10.0), (20.0, 10.0))
    segment, axis, clock = recording.segments[0], find_axis(recording), Clock()
    assert axis is not None

    shown = play(ReplaySource(recording, "a.csv", 5.0, now_s=clock.now_s, wait=clock.wait))

    expected = LiveElevation(recording.rate_hz, axis).update(segment.acc_g, segment.gyr_dps)
    assert np.array_equal(np.concatenate(shown), expected)


def test_a_recording_without_a_usable_pose_has_no_axis() -> None:
    restless = make_worn(*((0.0, 0.6), (95.0, 0.6)) * 10)

    assert find_axis(restless) is None
