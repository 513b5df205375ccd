"""A sensor cut off below the range that its file states is told by its flat tops."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.checks.frame import cut_windows
from fusion.checks.physics import check_physics
from fusion.checks.summary import find_flat_range, summarise_sensor
from fusion.quality.time_account import find_exclusions
from fusion.recording import Recording, Segment
from tests.fusion.made_motion import rest_and_turn
from tests.validation.broad import load_trials


def swings(size: float, rows: int = 4000) -> NDArray[np.float32]:
    """About z, 0.5 Hz at 100 samples a second, on the steps of a part."""
    swing = size * np.sin(np.pi * np.arange(rows) / 100.0 + 0.3)
    return np.column_stack([0.0 * swing, 0.0 * swing, np.round(swing / 0.07) * 0.07]).astype(np.float32)


@pytest.mark.parametrize(
    ("samples", "top"),
    [
        (np.clip(swings(200.0), -100.0, 100.0), 100.0),
        (np.clip(swings(200.0), -100.0, 99.93), 100.0),
        (swings(300.0), None),
        (np.clip(swings(200.0, 350), -100.0, 100.0), None),
        (np.random.default_rng(0).integers(-1, 2, (5000, 3)).astype(np.float32), None),
    ],
    ids=["flat tops", "ends a count apart", "round tops", "four flat tops", "coarse noise at rest"],
)
def test_the_size_at_which_swings_are_cut_off_is_found(
    samples: NDArray[np.float32], top: float | None
) -> None:
    assert find_flat_range([summarise_sensor(samples)], 50.0) == top


def test_what_is_cut_off_below_the_stated_range_is_excluded() -> None:
    motion = rest_and_turn(80)
    cut = np.clip(motion.gyr_dps, -100.0, 100.0).astype(np.float32)
    segment = Segment(0, 100.0, motion.acc_g.astype(np.float32), cut)
    recording = Recording(
        "other", "", None, None, segment.duration_us, (segment,), acc_range_g=16.0, gyr_range_dps=2000.0
    )

    checked = check_physics(recording)

    assert (checked.acc_range_g, checked.gyr_range_dps) == (16.0, 100.0)
    assert {span.reason for span in find_exclusions(checked)} == {"clipped"}


def test_windows_of_a_gyroscope_that_reads_zero_throughout_are_kept() -> None:
    motion = rest_and_turn(9)
    segment = Segment(0, 100.0, motion.acc_g.astype(np.float32), np.zeros((len(motion.acc_g), 3), np.float32))

    assert find_flat_range([summarise_sensor(segment.gyr_dps)]) == 0.0
    assert len(cut_windows([segment])) > 0


@pytest.mark.real_recordings
def test_no_trial_of_broad_is_cut_off(shared_data: Callable[[str], Path]) -> None:
    trials = load_trials(shared_data("broad"))

    found = [find_flat_range([summarise_sensor(trial.gyr_dps.astype(np.float32))], 50.0) for trial in trials]

    assert found == [None] * len(trials)
