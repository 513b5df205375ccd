"""Compare the fusion with its peers: `python -m benchmarks.fusion [broad|sweep|shift|speed|band]`.

broad: inclination error on BROAD, interleaved trial by trial, with vqf's VQF and offlineVQF (`pip install
vqf`); sweep: the slerp weight that the published algorithm leaves open; shift: simulated hours and their
truth; band: how often the stated uncertainty covers the truth; speed: eight hours at 100 and 500 Hz, warm,
one core.
"""

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import vqf
from numpy.typing import NDArray

from acromion.fusion.conventions import MethodName
from acromion.fusion.elevation import estimate_elevation, measure_elevation
from acromion.fusion.orientation import estimate_vertical
from acromion.fusion.orientation.live import LiveVertical
from acromion.fusion.orientation.published import PublishedParameters, estimate_published
from acromion.fusion.pose.calibrate import CalibratedSamples, calibrate
from acromion.fusion.recording import MICROSECONDS, Recording, Segment
from acromion.fusion.sensor.model import SensorRun, view_segment
from acromion.fusion.sensor.stillness import find_quietest_rate
from acromion.fusion.simulation import simulate_shift
from acromion.fusion.simulation.sensor import Device
from benchmarks.validation.worn import at_rows
from tests.simulated_shifts import play_shift
from tests.validation.broad import (
    Estimator,
    Table,
    Trial,
    add_offset,
    cut_rest,
    load_trials,
    resample_to_100_hz,
    score,
)

BROAD = Path(__file__).resolve().parents[2] / "shared" / "data" / "broad"
DEVICES: tuple[Device, ...] = ("gt9x", "lsm9ds1")
METHODS: tuple[MethodName, ...] = ("smoothed", "published", "live")
GRAVITY = 9.80665
TIME_CONSTANTS_S = (0.1, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0)


def run_offline_vqf(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    gyr, acc = np.ascontiguousarray(np.radians(gyr_dps)), np.ascontiguousarray(acc_g * GRAVITY)
    return vertical_of(vqf.offlineVQF(gyr, acc, None, 1.0 / rate_hz)["quat6D"])


def run_vqf(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    gyr, acc = np.ascontiguousarray(np.radians(gyr_dps)), np.ascontiguousarray(acc_g * GRAVITY)
    return vertical_of(vqf.VQF(1.0 / rate_hz).updateBatch(gyr, acc)["quat6D"])


def vertical_of(quaternion: Table) -> Table:
    w, x, y, z = quaternion.T
    return np.stack([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)], axis=1)


def run_live(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
    return LiveVertical(rate_hz).update(acc_g, gyr_dps)


def run_published(parameters: PublishedParameters) -> Estimator:
    def estimate(acc_g: Table, gyr_dps: Table, rate_hz: float) -> Table:
        run = SensorRun(0.0, rate_hz, acc_g, gyr_dps)
        return np.asarray(estimate_published(run, find_quietest_rate(run), parameters), dtype=np.float64)

    return estimate


def compare_on_broad() -> None:
    trials = load_trials(BROAD)
    cases: dict[str, Callable[[Trial], Trial]] = {
        "untouched": lambda trial: trial,
        "gyro offset 27 deg/s": add_offset,
        "no rest": cut_rest,
        "offset, no rest": lambda trial: add_offset(cut_rest(trial)),
    }
    print("degrees; even: the half used for tuning, odd: the other half; aligned by one lag for all trials")
    print(
        f"{'case':22s}{'rate':>5s}  {'estimator':12s}{'raw':>7s}{'aligned':>9s}"
        f"{'lag ms':>8s}{'even':>7s}{'odd':>7s}{'worst':>7s}"
    )
    for rate, chosen in (("286", trials), ("100", [resample_to_100_hz(trial) for trial in trials])):
        for case, change in cases.items():
            print_scores(case, rate, [change(trial) for trial in chosen])


def print_scores(case: str, rate: str, trials: Sequence[Trial]) -> None:
    peers: dict[str, Estimator] = {
        "smoothed": estimate_vertical,
        "offlineVQF": run_offline_vqf,
        "VQF": run_vqf,
        "live": run_live,
        "published": run_published(PublishedParameters()),
    }
    for name, estimate in peers.items():
        result = score(trials, estimate)
        print(
            f"{case:22s}{rate:>5s}  {name:12s}{result.raw_deg:7.3f}{result.aligned_deg:9.3f}"
            f"{1e3 * result.lag_s:8.1f}{result.even_deg:7.3f}{result.odd_deg:7.3f}"
            f"{result.trials_deg.max():7.2f}"
        )


def sweep_weight() -> None:
    trials = load_trials(BROAD)
    shifts = [(samples, truth) for device in DEVICES for samples, truth in [simulate(device, 0.5, 1)]]
    print("published: RMSE in degrees by slerp weight, with the 0.002 Hz high-pass and without")
    print(
        f"{'time constant s':>16s}{'weight 100 Hz':>15s}{'high-pass':>11s}"
        f"{'BROAD':>8s}{'gt9x':>8s}{'lsm9ds1':>9s}"
    )
    for highpass_hz in (0.002, 0.0):
        for constant_s in TIME_CONSTANTS_S:
            how = PublishedParameters(time_constant_s=constant_s, highpass_gyr_hz=highpass_hz)
            on_broad = score(trials, run_published(how)).raw_deg
            gt9x_deg, lsm_deg = (publish_error_deg(samples, truth, how) for samples, truth in shifts)
            print(
                f"{constant_s:16.1f}{how.accelerometer_weight(100.0):15.4f}{highpass_hz:11.3f}{on_broad:8.2f}"
                f"{gt9x_deg:8.2f}{lsm_deg:9.2f}"
            )


def simulate(device: Device, hours: float, seed: int) -> tuple[CalibratedSamples, Table]:
    arrays = play_shift(simulate_shift(device, hours, seed))
    recording = record(device, arrays.rate_hz, arrays.acc_g, arrays.gyr_dps)
    return calibrate(recording), arrays.elevation_deg


def record(
    device: str, rate_hz: float, acc_g: NDArray[np.float32], gyr_dps: NDArray[np.float32]
) -> Recording:
    segment = Segment(0, rate_hz, acc_g, gyr_dps)
    return Recording(device, "0" * 64, None, None, round(len(acc_g) / rate_hz * MICROSECONDS), (segment,))


def publish_error_deg(samples: CalibratedSamples, truth: Table, how: PublishedParameters) -> float:
    run = view_segment(samples.recording.segments[0])
    up = estimate_published(run, samples.calibration.gyro_bias_dps, how)
    return float(np.sqrt(np.mean((measure_elevation(up, samples.calibration.arm_axis) - truth) ** 2)))


def compare_on_shifts(hours: float = 1.0, seeds: Sequence[int] = (1, 2, 3)) -> None:
    print(f"simulated shifts of {hours} h: RMSE deg, mean error deg, largest error of a 30 deg bin (points)")
    for device in DEVICES:
        for seed in seeds:
            samples, truth = simulate(device, hours, seed)
            for method in METHODS:
                found = estimate_elevation(samples, method).segments[0].elevation_deg
                true_deg = at_rows(truth, len(found))
                error = found - true_deg
                bins = np.abs(share_bins(found) - share_bins(true_deg)).max()
                rmse = float(np.sqrt(np.mean(error**2)))
                print(f"{device:9s} seed {seed}  {method:10s}{rmse:7.2f}{error.mean():7.2f}{bins:7.2f}")


def share_bins(elevation_deg: NDArray[np.floating]) -> Table:
    return np.histogram(elevation_deg, np.arange(0.0, 181.0, 30.0))[0] * (100.0 / len(elevation_deg))


def measure_speed() -> None:
    print("eight hours, warm, best of three, seconds: calibrate (bias, still periods) and estimate_elevation")
    for device, rate_hz in zip(DEVICES, (100.0, 500.0), strict=True):
        hour = play_shift(simulate_shift(device, 0.25, 1, rate_hz))
        copies = round(8 * 3600 * rate_hz) // len(hour.acc_g) + 1
        recording = record(
            device, rate_hz, np.tile(hour.acc_g, (copies, 1)), np.tile(hour.gyr_dps, (copies, 1))
        )
        times = [time_once(recording) for _ in range(4)][1:]
        calibrating, fusing = np.min(times, axis=0)
        print(f"{rate_hz:5.0f} Hz  {calibrating:6.3f} + {fusing:6.3f} = {calibrating + fusing:6.3f}")


def time_once(recording: Recording) -> tuple[float, float]:
    start = time.perf_counter()
    samples = calibrate(recording)
    middle = time.perf_counter()
    estimate_elevation(samples)
    return middle - start, time.perf_counter() - middle


def measure_band(hours: float = 8.0, seeds: Sequence[int] = range(1, 11)) -> None:
    print(f"simulated shifts of {hours} h at 100 Hz: share of the time in which 1.96 sigma covers the truth")
    for device in DEVICES:
        shares = [print_band(device, hours, seed) for seed in seeds]
        even, odd = np.mean(shares[1::2]), np.mean(shares[::2])
        print(f"{device:9s} all {np.mean(shares):.3f}; even (fitted) {even:.3f}, odd {odd:.3f}")


def print_band(device: Device, hours: float, seed: int) -> float:
    arrays = play_shift(simulate_shift(device, hours, seed, 100.0))
    samples = calibrate(record(device, arrays.rate_hz, arrays.acc_g, arrays.gyr_dps))
    elevation = estimate_elevation(samples)
    segment = elevation.segments[0]
    if segment.sigma_deg is None:
        raise SystemExit("smoothed has no sigma")
    sigma_deg = segment.sigma_deg[(np.arange(len(segment)) / segment.rate_hz).astype(np.int64)]
    error = segment.elevation_deg - arrays.elevation_deg
    share = float((np.abs(error) < 1.96 * sigma_deg).mean())
    rmse, bins = (
        float(np.sqrt(np.mean(error**2))),
        np.abs(share_bins(segment.elevation_deg) - share_bins(arrays.elevation_deg)),
    )
    print(
        f"{device:9s} seed {seed:2d}  covered {share:.3f}  sigma {elevation.bias_sigma_deg:.3f}  "
        f"rmse {rmse:.3f}  mean {error.mean():+.3f}  30 deg bins {bins.max():.3f}",
        flush=True,
    )
    return share


PARTS = {
    "broad": compare_on_broad,
    "sweep": sweep_weight,
    "shift": compare_on_shifts,
    "speed": measure_speed,
    "band": measure_band,
}

if __name__ == "__main__":
    for part in sys.argv[1:] or PARTS:
        PARTS[part]()
