"""Section (d): simulated shifts through the whole chain, compared with their truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.elevation import Elevation, ElevationSegment, estimate_elevation
from acromion.fusion.exposure.bins import BIN_EDGES_DEG, CELLS_PER_DEG
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.pipeline import analyse
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.simulation import simulate_shift
from acromion.fusion.simulation.sensor import Device
from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.worn import DEVICES, NAMES, Worn, at_rows, find_rmse_deg, wear

COARSE_EDGES_DEG = (0, 30, 60, 90, 120, 150, 180)
LIMITS_DEG: Mapping[Device, float] = {"gt9x": 0.40, "lsm9ds1": 0.50}
BIN_LIMIT_POINTS = 0.3
BAND = 1.96

PROSE = """\
A simulated day of work with the sensor on the right upper arm, rounded and clipped as by the device, and
analysed with `analyse` and its default settings: the software proposes the calibration pose. The result is
compared with the exact elevation at every valid row; bins and entries with those of the exact elevation after
the same metric filter. Not simulated: skin and muscle, an error of the pose, gaps. The seed determines the
day, the specimen of the sensor and its noise.

The 95 % band is 1.96 times the standard deviation that the software reports for each second
(`ElevationSegment.sigma_deg`, without the pose). The column is the share of the valid time in which the band
includes the truth. The weights of the band and the random walk of the accelerometer's offset were fitted on
days with even seeds (2 to 10 for one hour, 2 and 4 for eight), without the form of the simulated warming. The
goal is judged on odd seeds.

A small error of the angle can move much time: if an arm rests for a minute at 29.9 deg and reads 30.1, that
minute moves to the next bin, 1.7 points of an hour. The bins are therefore reported for the hours and for the
whole shift."""


@dataclass(frozen=True, slots=True, eq=False)
class ShiftResult:
    """One shift compared with its truth.

    ``fine`` (9,), ``coarse`` (6,): errors of the bins in percentage points.
    ``entries``: counted and true entries at 30, 60 and 90 deg.
    ``covered_percent``: share of valid rows within the band.
    """

    seed: int
    rmse_deg: float
    bias_deg: float
    valid_percent: float
    fine: NDArray[np.float64]
    coarse: NDArray[np.float64]
    entries: tuple[tuple[int, int], ...]
    published_deg: float
    covered_percent: float | None


def compare_on_shifts(seeds: Sequence[int], hours: float, long_hours: float) -> Section:
    results = {device: [run_shift(device, hours, seed) for seed in seeds] for device in DEVICES}
    long = {device: [run_shift(device, long_hours, seeds[0])] for device in DEVICES}
    paragraphs = [PROSE]
    for device in DEVICES:
        name = NAMES[device]
        paragraphs += [f"### {name}, {hours:g} h for each seed", draw_seeds(results[device])]
        paragraphs += [f"Every bin over these seeds, {name}:", draw_bins(results[device])]
    paragraphs.append(f"### {long_hours:g} h, seed {seeds[0]}")
    for device in DEVICES:
        paragraphs += [f"{NAMES[device]}:", draw_seeds(long[device]), draw_bins(long[device])]
    lengths = [(f"{hours:g} h", results), *([(f"{long_hours:g} h", long)] if long_hours != hours else [])]
    goals = [goal for label, by_device in lengths for goal in judge_shifts(label, by_device)]
    return Section("Simulated shifts", (), tuple(goals), tuple(paragraphs))


def run_shift(device: Device, hours: float, seed: int) -> ShiftResult:
    worn = wear(simulate_shift(device, hours, seed))
    analysis = analyse(worn.recording)
    found = analysis.elevation.segments[0]
    truth_deg = at_rows(worn.truth_deg, len(found))
    truth = ElevationSegment(0, found.rate_hz, truth_deg.astype(np.float32), found.valid)
    true_exposure = summarise_exposure(Elevation((truth,), None))
    error_deg = (found.elevation_deg - truth_deg)[found.valid]
    return ShiftResult(
        seed,
        find_rmse_deg(error_deg),
        float(error_deg.mean()),
        100.0 * float(found.valid.mean()),
        _share_fine(analysis.exposure) - _share_fine(true_exposure),
        _share_coarse(analysis.exposure) - _share_coarse(true_exposure),
        tuple(
            (ours.count, true.count)
            for ours, true in zip(analysis.exposure.entries, true_exposure.entries, strict=True)
        ),
        _publish(worn, found.valid),
        _cover(found, error_deg),
    )


def _publish(worn: Worn, valid: NDArray[np.bool_]) -> float:
    """Return the RMSE of `published` on the same shift."""
    samples = calibrate(worn.recording)
    found_deg = estimate_elevation(samples, "published").segments[0].elevation_deg
    return find_rmse_deg((found_deg - at_rows(worn.truth_deg, len(valid)))[valid])


def _cover(found: ElevationSegment, error_deg: NDArray[np.float64]) -> float | None:
    """Return the share of the valid rows whose error is within 1.96 sigma; None without a sigma."""
    sigma_deg = found.sigma_deg
    if sigma_deg is None:
        return None
    second = (np.arange(len(found)) / found.rate_hz).astype(np.int64)
    return 100.0 * float(np.mean(np.abs(error_deg) <= BAND * sigma_deg[second[found.valid]]))


def _share_fine(exposure: Exposure) -> NDArray[np.float64]:
    return np.array([part.percent for part in exposure.bins])


def _share_coarse(exposure: Exposure) -> NDArray[np.float64]:
    starts = np.array(COARSE_EDGES_DEG[:-1]) * CELLS_PER_DEG
    return np.asarray(np.add.reduceat(exposure.histogram_s, starts) * (100.0 / exposure.analysed_s))


def draw_seeds(results: Sequence[ShiftResult]) -> str:
    header = (
        "seed",
        "RMSE deg",
        "mean error deg",
        "valid %",
        "worst 30 deg bin, points",
        "worst fine bin, points",
        "entries 30, found/true",
        "60",
        "90",
        "`published` RMSE deg",
        "in 95 % band, %",
    )
    return draw_table(header, [_draw_shift(result) for result in results])


def _draw_shift(result: ShiftResult) -> list[str]:
    covered = "-" if result.covered_percent is None else f"{result.covered_percent:.1f}"
    return [
        str(result.seed),
        f"{result.rmse_deg:.3f}",
        f"{result.bias_deg:+.3f}",
        f"{result.valid_percent:.2f}",
        f"{_largest(result.coarse):+.3f}",
        f"{_largest(result.fine):+.3f}",
        *(f"{ours}/{true}" for ours, true in result.entries),
        f"{result.published_deg:.2f}",
        covered,
    ]


def _largest(errors: NDArray[np.float64]) -> float:
    return float(errors[np.abs(errors).argmax()])


def draw_bins(results: Sequence[ShiftResult]) -> str:
    fine, coarse = np.array([r.fine for r in results]), np.array([r.coarse for r in results])
    named = [
        *zip(pairwise(COARSE_EDGES_DEG), coarse.T, strict=True),
        *zip(pairwise(BIN_EDGES_DEG), fine.T, strict=True),
    ]
    rows = [
        [f"{low:g}-{high:g} deg", f"{errors.mean():+.3f}", f"{_largest(errors):+.3f}"]
        for (low, high), errors in named
    ]
    return draw_table(("bin", "mean error, points", "largest, points"), rows)


def judge_shifts(label: str, results: Mapping[Device, Sequence[ShiftResult]]) -> list[Goal]:
    goals = []
    for device, shifts in results.items():
        head = f"simulated shift, {NAMES[device]}, {label}, {len(shifts)} seed(s)"
        mean_deg, worst_deg = np.mean([s.rmse_deg for s in shifts]), max(s.rmse_deg for s in shifts)
        goals.append(judge(f"{head}: RMSE, mean", float(mean_deg), LIMITS_DEG[device]))
        goals.append(judge(f"{head}: RMSE, worst seed", worst_deg, LIMITS_DEG[device]))
        worst = max(abs(_largest(s.coarse)) for s in shifts)
        goals.append(judge(f"{head}: any 30 deg bin, worst seed", worst, BIN_LIMIT_POINTS, "points"))
        goals += _judge_band(head, shifts)
    return goals


def _judge_band(head: str, shifts: Sequence[ShiftResult]) -> list[Goal]:
    """Return the goal for odd seeds only, because the weights of the uncertainty were fitted on even ones."""
    covered = [s.covered_percent for s in shifts if s.covered_percent is not None and s.seed % 2]
    if not covered:
        return []
    mean = float(np.mean(covered))
    reached = f"{mean:.1f} % ({min(covered):.1f} to {max(covered):.1f})"
    what = f"{head}, the odd ones: truth within the 95 % band, mean"
    return [Goal(what, "93 to 97 %", reached, 93.0 <= round(mean, 1) <= 97.0)]
