"""The clocks of two sensors on one body, from the movement that both share.

A body is noise of 1 to 3 Hz, as when a person walks and turns; each sensor adds noise of its own.
"""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from acromion.fusion.comparison.alignment import Run
from acromion.fusion.comparison.movement import match_clocks
from acromion.fusion.errors import NotAligned, NothingInCommon
from acromion.fusion.recording import Float64Array

HZ = 100
LONG_S = 1800


def move(seed: int, lasts_s: float = LONG_S) -> Float64Array:
    band = butter(2, (1.0, 3.0), "bandpass", fs=HZ, output="sos")
    noise = np.random.default_rng(seed).standard_normal(int(lasts_s * HZ))
    moves = sosfiltfilt(band, noise)
    return np.asarray(0.1 * moves / moves.std())


def wear(body: Float64Array, seed: int, *, from_s: float = 0.0, drift_ppm: float = 0.0) -> tuple[Run, ...]:
    """Return the magnitude that a sensor measures, in blocks of 0.1 s of its clock, from ``from_s`` on."""
    last_s = len(body) / HZ - 1.0 - from_s
    time_s = np.arange(0.0, last_s, 1.0 / HZ)
    values = np.interp(from_s + time_s / (1.0 + drift_ppm / 1e6), np.arange(len(body)) / HZ, body)
    values = 1.0 + values + 0.05 * np.random.default_rng(seed).standard_normal(len(values))
    blocks = values[: len(values) // 10 * 10].reshape(-1, 10).mean(axis=1)
    return (Run(0.05, 10.0, blocks.astype(np.float32)),)


@pytest.mark.parametrize("from_s", [0.3, 2.0, 30.0, 300.0])
def test_offset_and_drift_are_found_to_50_ms_from_start_to_end(from_s: float) -> None:
    body = move(1)
    found = match_clocks(wear(body, 2), wear(body, 3, from_s=from_s, drift_ppm=50.0))

    drifted_s = (found.drift_ppm - 50.0) / 1e6 * LONG_S
    assert abs(found.offset_s - from_s) < 0.05
    assert abs(found.offset_s - from_s - drifted_s) < 0.05


def test_a_recording_that_began_earlier_has_a_negative_offset() -> None:
    body = move(1)

    assert match_clocks(wear(body, 2, from_s=30.0), wear(body, 3)).offset_s == pytest.approx(-30.0, abs=0.05)


def test_the_margin_covers_the_error() -> None:
    body = move(4)
    found = match_clocks(wear(body, 5), wear(body, 6, from_s=12.0))

    assert abs(found.offset_s - 12.0) <= found.margin_s <= 0.05


def test_the_movement_of_two_people_is_refused() -> None:
    with pytest.raises(NotAligned) as refusal:
        match_clocks(wear(move(1), 2), wear(move(7), 3))

    assert refusal.value.facts["least_s"] == 300.0


def test_less_than_five_minutes_of_shared_movement_are_refused() -> None:
    body = move(1, 250.0)

    with pytest.raises(NotAligned):
        match_clocks(wear(body, 2), wear(body, 3))


def test_movement_that_repeats_after_ten_minutes_is_refused_because_two_offsets_fit() -> None:
    body = np.tile(move(1, 600.0), 2)

    with pytest.raises(NotAligned) as refusal:
        match_clocks(wear(body[: 601 * HZ], 2), wear(body, 3))

    assert "rival" in refusal.value.facts


@pytest.mark.parametrize("step_s", [0.2, 1.5])
def test_a_clock_that_was_set_in_between_is_refused(step_s: float) -> None:
    """The error of one line would be the whole step for a third of the time."""
    body = move(1)
    cut = len(body) * 2 // 3
    later = np.concatenate([body[:cut], body[cut + round(step_s * HZ) :]])

    with pytest.raises(NotAligned) as refusal:
        match_clocks(wear(body, 2), wear(later, 3))

    assert {"margin_s", "rival"} & set(refusal.value.facts)


def test_sensors_that_lie_still_are_refused() -> None:
    still = np.zeros(LONG_S * HZ)

    with pytest.raises(NotAligned):
        match_clocks(wear(0.0 * still, 2), wear(0.0 * still, 3))


def test_a_side_without_acceleration_has_nothing_in_common() -> None:
    with pytest.raises(NothingInCommon):
        match_clocks((), wear(move(1, 60.0), 2))
