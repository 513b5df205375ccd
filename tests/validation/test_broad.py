"""The vertical against optical motion capture: BROAD, at its own rate and at 100 Hz.

Limits in degrees, aligned by one lag for all trials. offlineVQF scores 0.308 and 0.404 on these 17 trials
(`python -m benchmarks.fusion` prints both side by side).
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from fusion.orientation import estimate_vertical
from tests.validation.broad import Trial, add_offset, cut_rest, load_trials, resample_to_100_hz, score

pytestmark = [pytest.mark.real_recordings, pytest.mark.slow]

OFFLINE_VQF_286_DEG, OFFLINE_VQF_100_DEG = 0.308, 0.404


@pytest.fixture(scope="module")
def trials(shared_data: Callable[[str], Path]) -> list[Trial]:
    return load_trials(shared_data("broad"))


def test_at_286_hz_it_is_not_worse_than_offline_vqf_by_more_than_two_hundredths(trials: list[Trial]) -> None:
    assert score(trials, estimate_vertical).aligned_deg <= OFFLINE_VQF_286_DEG + 0.02


def test_at_100_hz_it_is_better_than_offline_vqf(trials: list[Trial]) -> None:
    assert (
        score([resample_to_100_hz(trial) for trial in trials], estimate_vertical).aligned_deg
        < OFFLINE_VQF_100_DEG
    )


@pytest.mark.parametrize(
    "stress",
    [add_offset, cut_rest, lambda trial: add_offset(cut_rest(trial))],
    ids=["gyroscope offset", "no rest", "offset and no rest"],
)
def test_under_stress_it_stays_near_offline_vqf_on_untouched_trials(
    trials: list[Trial], stress: Callable[[Trial], Trial]
) -> None:
    assert (
        score([stress(trial) for trial in trials], estimate_vertical).aligned_deg
        <= OFFLINE_VQF_286_DEG + 0.03
    )
