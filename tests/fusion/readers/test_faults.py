"""Dead channels, stuck stretches and spikes: found where they are, and not where they are not."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from acromion.fusion.checks.faults import cut_rows, exclude_faults, refuse_dead
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Segment, Span
from tests.badfiles.arm import Matrix, minute
from tests.factories import record


def copies() -> tuple[Matrix, Matrix]:
    acc_g, gyr_dps = minute()
    return acc_g.copy(), gyr_dps.copy()


def test_a_healthy_minute_is_left_alone() -> None:
    recording = record(*copies(), 100.0)

    assert exclude_faults(refuse_dead(recording)) is recording


def test_a_spike_is_replaced_and_its_row_excluded() -> None:
    acc_g, gyr_dps = copies()
    gyr_dps[2000, 2] += 900.0

    recording = exclude_faults(record(acc_g, gyr_dps, 100.0))

    assert recording.excluded == (Span(20_000_000, 10_000, "spikes"),)
    assert abs(recording.segments[0].gyr_dps[2000, 2]) < 1.0
    assert [flag.code for flag in recording.flags] == ["W-SPIKE"]


def test_an_impact_with_its_ringing_is_no_spike() -> None:
    acc_g, gyr_dps = copies()
    acc_g[2000:2010, 0] += 8.0 * np.exp(-np.arange(10) / 3.0) * np.cos(np.arange(10) * 2.0)

    assert exclude_faults(record(acc_g, gyr_dps, 100.0)).flags == ()


def test_a_gyroscope_that_does_not_answer_while_the_arm_moves_is_stuck_after_half_a_second() -> None:
    acc_g, gyr_dps = copies()
    moving = int(np.argmax(np.ptp(acc_g.reshape(-1, 100, 3), axis=1).max(axis=1))) * 100
    gyr_dps[moving : moving + 100] = 0.0

    recording = exclude_faults(record(acc_g, gyr_dps, 100.0))

    assert recording.excluded == (Span(moving * 10_000, 1_000_000, "stuck"),)


def test_a_coarse_sensor_that_lies_still_is_not_stuck() -> None:
    acc_g, gyr_dps = copies()

    recording = record(np.round(acc_g, 1), np.round(gyr_dps, 1), 100.0)

    assert exclude_faults(recording).flags == ()


@pytest.mark.real_recordings
@pytest.mark.parametrize(
    ("trial", "stride"),
    [
        ("24_disturbed_tapping_A", 1),
        ("18_undisturbed_fast_translation_with_breaks_B", 3),
        ("26_disturbed_phone_vibration_A", 1),
        ("26_disturbed_phone_vibration_A", 3),
    ],
)
def test_real_motion_gives_no_alarm(shared_data: Callable[[str], Path], trial: str, stride: int) -> None:
    with np.load(shared_data(f"broad/{trial}.npz")) as file:
        held = dict(file)
    acc_g, gyr_dps = held["acc_g"][::stride], held["gyr_dps"][::stride]

    recording = exclude_faults(refuse_dead(record(acc_g, gyr_dps, float(held["rate_hz"]) / stride)))

    assert recording.flags == ()


def test_rounding_takes_no_piece_beyond_the_end_of_its_segment() -> None:
    """100.00027 Hz: the pieces' microseconds, each rounded by itself, would come to one too many."""
    rows = np.zeros((320, 3), np.float32)
    whole = Segment(19_999_997, 100.00027083406684, rows, rows)

    last = cut_rows(whole, [(75, 80)])[-1]

    assert last.end_us == whole.end_us


@pytest.mark.real_recordings
@pytest.mark.parametrize(("acc_step_g", "gyr_step_dps"), [(0.0, 0.573), (0.001, 0.573), (0.0078, 1.0)])
def test_a_flat_run_that_coarse_steps_explain_is_not_stuck(
    shared_data: Callable[[str], Path], acc_step_g: float, gyr_step_dps: float
) -> None:
    """0.01 rad/s are 0.573 deg/s; twelve bits of 16 g and 2000 deg/s are 7.8 mg and 1 deg/s."""
    (segment,) = read_recording(shared_data("gt9x/link_imu_100hz_179s.gt3x")).segments
    acc_g = segment.acc_g if not acc_step_g else acc_step_g * np.round(segment.acc_g / acc_step_g)
    gyr_dps = gyr_step_dps * np.round(segment.gyr_dps / gyr_step_dps)

    recording = exclude_faults(record(acc_g.astype(float), gyr_dps.astype(float), segment.rate_hz))

    assert recording.excluded == ()


def test_an_axis_that_stuck_among_coarse_ones_is_found() -> None:
    acc_g, gyr_dps = copies()
    swing_dps = 60.0 * np.sin(np.arange(len(gyr_dps)) / 20.0)[:, None]
    gyr_dps = 0.5 * np.round((gyr_dps + swing_dps) / 0.5)
    gyr_dps[2000:2300, 0] = 0.5

    recording = exclude_faults(record(acc_g, gyr_dps, 100.0))

    assert recording.excluded == (Span(20_000_000, 3_000_000, "stuck"),)


@pytest.mark.real_recordings
@pytest.mark.parametrize("axes", [(0,), (1,), (2,), (0, 1, 2)])
def test_a_coarse_gyroscope_that_stuck_for_a_minute_is_found(
    shared_data: Callable[[str], Path], axes: tuple[int, ...]
) -> None:
    """Two decimals of rad/s; the rows beside the minute may hold the same value."""
    (segment,) = read_recording(shared_data("cases/sim_2dec.csv")).segments
    gyr_dps = segment.gyr_dps.astype(float)
    gyr_dps[5000:8000, axes] = gyr_dps[5000, axes]

    (stuck,) = exclude_faults(record(segment.acc_g.astype(float), gyr_dps, segment.rate_hz)).excluded

    assert stuck.reason == "stuck"
    assert 99_000_000 < stuck.start_us <= 100_000_000
    assert 160_000_000 <= stuck.start_us + stuck.duration_us < 161_000_000
