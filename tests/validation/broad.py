"""The BROAD recordings (Laidig, Caruso, Cereatti, Seel 2021): loading, stressing, scoring.

The score of a trial is the root mean square angle between the estimated and the optical vertical over the
moving phase. Estimator and optical system have different delays; `aligned` shifts the truth by one constant
lag for all trials, the best for that estimator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.signal import resample_poly

Table = NDArray[np.float64]
Estimator = Callable[[Table, Table, float], Table]
LAGS_S = np.arange(-8.0, 4.1, 0.5) * 1e-3
OFFSET_DPS = np.array([10.0, -20.0, 15.0])


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One recording with its optical reference; ``up`` (n, 3) is NaN where the markers were lost."""

    name: str
    rate_hz: float
    acc_g: Table
    gyr_dps: Table
    up: Table
    moving: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Degrees; ``trials_deg`` (t,) at the best lag. Even: the half used for tuning; odd: the other half."""

    raw_deg: float
    aligned_deg: float
    lag_s: float
    trials_deg: Table

    @property
    def even_deg(self) -> float:
        return float(self.trials_deg[::2].mean())

    @property
    def odd_deg(self) -> float:
        return float(self.trials_deg[1::2].mean())


def load_trials(folder: Path) -> list[Trial]:
    """All trials, sorted by name."""
    return [_load(path) for path in sorted(folder.glob("*.npz"))]


def _load(path: Path) -> Trial:
    with np.load(path) as file:
        w, x, y, z = file["quat_wxyz_sensor_to_enu"].astype(np.float64).T
        up = np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)
        acc_g, gyr_dps = file["acc_g"].astype(np.float64), file["gyr_dps"].astype(np.float64)
        return Trial(path.stem, float(file["rate_hz"]), acc_g, gyr_dps, up, file["movement"])


def resample_to_100_hz(trial: Trial) -> Trial:
    """7/20 of 285.7 Hz, with the anti-alias filter that a device would have."""
    acc_g = resample_poly(trial.acc_g, 7, 20, axis=0, padtype="line")
    gyr_dps = resample_poly(trial.gyr_dps, 7, 20, axis=0, padtype="line")
    old_s, new_s = np.arange(len(trial.up)) / trial.rate_hz, np.arange(len(acc_g)) / 100.0
    up = _at(new_s, old_s, trial.up)
    moving = np.interp(new_s, old_s, trial.moving.astype(np.float64)) > 0.99
    return Trial(trial.name, 100.0, acc_g, gyr_dps, up, moving)


def add_offset(trial: Trial) -> Trial:
    """A gyroscope as it may leave the factory."""
    return replace(trial, gyr_dps=trial.gyr_dps + OFFSET_DPS)


def cut_rest(trial: Trial) -> Trial:
    """Only from the first movement to the last."""
    moving = np.flatnonzero(trial.moving)
    rows = slice(moving[0], moving[-1])
    return Trial(
        trial.name,
        trial.rate_hz,
        trial.acc_g[rows],
        trial.gyr_dps[rows],
        trial.up[rows],
        trial.moving[rows],
    )


def score(trials: Sequence[Trial], estimate: Estimator) -> Score:
    """Run the estimator on each trial and compare at every lag."""
    errors = np.array(
        [_errors(trial, estimate(trial.acc_g, trial.gyr_dps, trial.rate_hz)) for trial in trials]
    )
    best = int(errors.mean(axis=0).argmin())
    raw = int(np.abs(LAGS_S).argmin())
    means = errors.mean(axis=0)
    return Score(float(means[raw]), float(means[best]), float(LAGS_S[best]), errors[:, best])


def _errors(trial: Trial, up: Table) -> Table:
    time_s = np.arange(len(up)) / trial.rate_hz
    return np.array([_error_deg(trial.moving, up, _at(time_s + lag_s, time_s, trial.up)) for lag_s in LAGS_S])


def _at(new_s: Table, old_s: Table, vectors: Table) -> Table:
    return np.stack([np.interp(new_s, old_s, vectors[:, axis]) for axis in range(3)], axis=1)


def _error_deg(moving: NDArray[np.bool_], up: Table, truth: Table) -> float:
    rows = moving & np.isfinite(truth).all(axis=1)
    across = np.linalg.norm(np.cross(up[rows], truth[rows]), axis=1)
    angle = np.arctan2(across, np.sum(up[rows] * truth[rows], axis=1))
    return float(np.degrees(np.sqrt(np.mean(angle**2))))
