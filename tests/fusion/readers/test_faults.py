"""Dead channels, stuck stretches and spikes: found where they are, and not where they are not."""

from pathlib import Path

import numpy as np
import pytest

from fusion.checks.faults import cut_rows, exclude_faults, refuse_dead
from fusion.errors import DeadSensor
from fusion.readers import read_recording
from fusion.recording import Recording, Segment, Span
from fusion.simulation import simulate_shift, write_shift
from tests.badfiles.arm import Matrix, minute
from tests.conftest import SHARED_DATA
from tests.factories import record


def made(acc_g: Matrix, gyr_dps: Matrix) -> Recording:
    return record(acc_g, gyr_dps, 100.0)


def copies() -> tuple[Matrix, Matrix]:
    acc_g, gyr_dps = minute()
    return acc_g.copy(), gyr_dps.copy()


def test_a_healthy_minute_is_left_alone() -> None:
    recording = made(*copies())

    assert exclude_faults(refuse_dead(recording)) is recording


def test_a_dead_axis_is_named() -> None:
    acc_g, gyr_dps = copies()
    gyr_dps[:, 1] = 0.25

    with pytest.raises(DeadSensor) as refusal:
        refuse_dead(made(acc_g, gyr_dps))

    assert refusal.value.facts == {"sensor": "gyroscope", "axis": "y"}


def test_a_spike_is_replaced_and_its_row_excluded() -> None:
    acc_g, gyr_dps = copies()
    gyr_dps[2000, 2] += 900.0

    recording = exclude_faults(made(acc_g, gyr_dps))

    assert recording.excluded == (Span(20_000_000, 10_000, "spikes"),)
    assert abs(recording.segments[0].gyr_dps[2000, 2]) < 1.0
    assert [flag.code for flag in recording.flags] == ["W-SPIKE"]


def test_an_impact_with_its_ringing_is_no_spike() -> None:
    acc_g, gyr_dps = copies()
    acc_g[2000:2010, 0] += 8.0 * np.exp(-np.arange(10) / 3.0) * np.cos(np.arange(10) * 2.0)

    assert exclude_faults(made(acc_g, gyr_dps)).flags == ()


def test_an_axis_that_stuck_while_the_arm_moved_ends_the_segment() -> None:
    acc_g, gyr_dps = copies()
    acc_g[3000:4000, 0] = acc_g[3000, 0]

    recording = exclude_faults(made(acc_g, gyr_dps))

    assert [(s.start_us, len(s)) for s in recording.segments] == [(0, 3000), (40_000_000, 2000)]
    assert recording.excluded == (Span(30_000_000, 10_000_000, "stuck"),)


def test_a_gyroscope_that_does_not_answer_while_the_arm_moves_is_stuck_after_half_a_second() -> None:
    acc_g, gyr_dps = copies()
    moving = int(np.argmax(np.ptp(acc_g.reshape(-1, 100, 3), axis=1).max(axis=1))) * 100
    gyr_dps[moving : moving + 100] = 0.0

    recording = exclude_faults(made(acc_g, gyr_dps))

    assert recording.excluded == (Span(moving * 10_000, 1_000_000, "stuck"),)


def test_a_coarse_sensor_that_lies_still_is_not_stuck() -> None:
    acc_g, gyr_dps = copies()

    recording = made(np.round(acc_g, 1), np.round(gyr_dps, 1))

    assert exclude_faults(recording).flags == ()


@pytest.mark.parametrize("device", ["gt9x", "lsm9ds1"])
def test_a_clean_simulated_shift_gives_no_alarm(device: str, tmp_path: Path) -> None:
    shift = simulate_shift("gt9x" if device == "gt9x" else "lsm9ds1", 0.2, seed=5)
    path = write_shift(tmp_path, shift, actilife_csv=False)[0]

    with path.open("rb") as file:
        recording = read_recording(file)

    assert not {"W-SPIKE", "W-STUCK-PART", "W-UNITS"} & {flag.code for flag in recording.flags}


@pytest.mark.real_recordings
@pytest.mark.parametrize(
    "trial",
    [
        "24_disturbed_tapping_A",
        "18_undisturbed_fast_translation_with_breaks_B",
        "26_disturbed_phone_vibration_A",
    ],
)
@pytest.mark.parametrize("stride", [1, 3])
def test_real_motion_gives_no_alarm(trial: str, stride: int) -> None:
    path = SHARED_DATA / "broad" / f"{trial}.npz"
    if not path.exists():
        pytest.skip(f"real recording absent: {trial}")
    held = np.load(path)
    acc_g, gyr_dps = held["acc_g"][::stride], held["gyr_dps"][::stride]

    recording = exclude_faults(refuse_dead(record(acc_g, gyr_dps, float(held["rate_hz"]) / stride)))

    assert recording.flags == ()


def test_rounding_takes_no_piece_beyond_the_end_of_its_segment() -> None:
    """100.00027 Hz: the pieces' microseconds, each rounded by itself, would come to one too many."""
    rows = np.zeros((320, 3), np.float32)
    whole = Segment(19_999_997, 100.00027083406684, rows, rows)

    last = cut_rows(whole, [(75, 80)])[-1]

    assert last.end_us == whole.end_us
