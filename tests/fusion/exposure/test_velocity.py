"""The speeds that need more than the angle: of the vertical, of the accelerometer, of the gyroscope."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from fusion.elevation import Elevation, ElevationSegment
from fusion.exposure import summarise_exposure
from fusion.exposure.speeds import BLOCK_ROWS, SpeedTally, filter_blocks
from fusion.exposure.types import Velocity
from fusion.recording import Recording, Segment

NOTHING = np.zeros(3)


def turn(rate_dps: float, seconds: float, rate_hz: float) -> tuple[Elevation, Recording]:
    """Lift the arm at an even rate, with what a sensor without error would read."""
    angle = 10.0 + rate_dps * np.arange(round(seconds * rate_hz)) / rate_hz
    radians = np.radians(angle)
    vertical = np.stack([np.sin(radians), np.zeros_like(radians), np.cos(radians)], axis=1).astype(np.float32)
    rates = np.tile(np.array([0.0, -rate_dps, 0.0], np.float32), (len(angle), 1))
    valid = np.ones(len(angle), np.bool_)
    elevation = Elevation((ElevationSegment(0, rate_hz, angle.astype(np.float32), valid, vertical),), None)
    segment = Segment(0, rate_hz, vertical, rates)
    return elevation, Recording("gt9x", "0" * 64, None, None, segment.duration_us, (segment,))


def speed(name: str, elevation: Elevation, recording: Recording, bias_dps: NDArray[np.float64]) -> Velocity:
    velocity = summarise_exposure(elevation, None, recording, bias_dps).velocity_dps[name]
    assert velocity is not None
    return velocity


@pytest.mark.parametrize("rate_hz", [99.87, 500.0])
@pytest.mark.parametrize("name", ["inclination", "generalised", "generalised_accelerometer", "gyroscope"])
def test_a_slow_lift_has_its_own_speed_in_all_four_kinds(name: str, rate_hz: float) -> None:
    elevation, recording = turn(9.0, 15.0, rate_hz)

    assert speed(name, elevation, recording, NOTHING).p50_dps == pytest.approx(9.0, abs=0.02)


def test_the_gyroscopes_offset_is_taken_off_and_without_it_there_is_no_speed() -> None:
    elevation, recording = turn(9.0, 15.0, 100.0)

    velocity = speed("gyroscope", elevation, recording, np.array([0.0, -2.0, 0.0]))

    assert velocity.p50_dps == pytest.approx(7.0, abs=0.02)
    assert summarise_exposure(elevation, None, recording).velocity_dps["gyroscope"] is None


def test_without_samples_and_vertical_only_the_inclination_has_a_speed() -> None:
    segment = ElevationSegment(0, 100.0, np.full(1000, 40.0, np.float32), np.ones(1000, np.bool_))

    velocity = summarise_exposure(Elevation((segment,), None)).velocity_dps
    assert {name for name, value in velocity.items() if value is not None} == {"inclination"}


@pytest.mark.parametrize("name", ["inclination", "generalised", "generalised_accelerometer", "gyroscope"])
def test_no_speed_is_taken_across_rows_that_are_not_trusted(name: str) -> None:
    elevation, recording = turn(9.0, 15.0, 100.0)
    elevation.segments[0].valid[500:1000] = False
    elevation.segments[0].elevation_deg[700:] += 40.0  # a jump while nobody trusts the angle
    elevation.segments[0].vertical[700:, 1] += 0.5  # type: ignore[index]

    assert speed(name, elevation, recording, NOTHING).p90_dps == pytest.approx(9.0, abs=0.6)


def test_filtering_in_blocks_is_filtering_the_whole() -> None:
    noise = np.random.default_rng(3).normal(0, 1, (2 * BLOCK_ROWS + 777, 3)).astype(np.float32)
    blocks = list(filter_blocks(noise, 500.0))

    whole = sosfiltfilt(butter(2, 5, fs=500, output="sos"), noise.astype(np.float64), axis=0)
    joined = np.concatenate([blocks[0][1], *(block[1:] for _, block in blocks[1:])])
    assert joined == pytest.approx(whole, abs=1e-10)


@pytest.mark.parametrize("rows", [1, BLOCK_ROWS, BLOCK_ROWS + 1])
def test_blocks_share_one_row_and_miss_none(rows: int) -> None:
    blocks = list(filter_blocks(np.ones((rows, 3), np.float32), 100.0))

    ends = [first + len(block) for first, block in blocks]
    assert ends[-1] == rows
    assert all(end - 1 == first for end, (first, _) in zip(ends, blocks[1:], strict=False))


def test_each_row_of_the_gyroscope_counts_once_however_many_blocks_there_are() -> None:
    elevation, recording = turn(0.001, (2 * BLOCK_ROWS + 777) / 100.0, 100.0)
    speeds = SpeedTally()
    speeds.add_gyroscope(recording.segments[0], NOTHING, elevation.segments[0].valid)

    assert speeds.cell_s.sum() == pytest.approx(len(recording.segments[0]) / 100.0, abs=1e-6)
