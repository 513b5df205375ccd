"""The vertical against optical motion capture: BROAD, at its own rate and at 100 Hz.

Limits in degrees, aligned by one lag for all trials. offlineVQF scores 0.308 and 0.404 on these 17 trials
(`python -m benchmarks.fusion` prints both side by side).
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from acromion.fusion.orientation import estimate_vertical
from acromion.fusion.orientation.live import LiveVertical
from tests.validation.broad import Table, Trial, add_offset, cut_rest, load_trials, resample_to_100_hz, score

pytestmark = [pytest.mark.real_recordings, pytest.mark.slow]

OFFLINE_VQF_286_DEG, OFFLINE_VQF_100_DEG = 0.308, 0.404


REAL_TIME_VQF_286_DEG = 0.597


def clip(trial: Trial) -> Trial:
    return replace(
        trial, acc_g=np.clip(trial.acc_g, -2.0, 2.0), gyr_dps=np.clip(trial.gyr_dps, -500.0, 500.0)
    )


def run_live(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    return LiveVertical(rate_hz).update(acc_g, gyr_dps)


@pytest.fixture(scope="module")
def trials(shared_data: Callable[[str], Path]) -> list[Trial]:
    return load_trials(shared_data("broad"))


@pytest.mark.xfail(strict=True, reason="the goal is missed by 0.002 deg: docs/validation.md")
def test_at_286_hz_it_is_not_worse_than_offline_vqf_by_more_than_0_02_deg(trials: list[Trial]) -> None:
    # 0.3296 is 0.0217 more. BROAD's gyroscope is about 1 ms late, half a sample, which VQF's rectangular rule
    # happens to undo; read 1 ms later, it scores 0.310 with ours.
    assert score(trials, estimate_vertical).aligned_deg <= OFFLINE_VQF_286_DEG + 0.02


def test_clipped_at_2_g_and_500_deg_per_s_it_is_twice_as_good_as_offline_vqf(trials: list[Trial]) -> None:
    # offlineVQF 4.74, VQF 6.88 on the same trials.
    assert score([clip(trial) for trial in trials], estimate_vertical).aligned_deg < 2.37


def test_at_100_hz_it_is_better_than_offline_vqf(trials: list[Trial]) -> None:
    assert (
        score([resample_to_100_hz(trial) for trial in trials], estimate_vertical).aligned_deg
        < OFFLINE_VQF_100_DEG
    )


def test_live_is_not_worse_than_real_time_vqf(trials: list[Trial]) -> None:
    assert score(trials, run_live).aligned_deg <= REAL_TIME_VQF_286_DEG


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
