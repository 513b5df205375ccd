"""Section (g): self-calibration must not degrade a good sensor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from acromion.fusion.pose.calibrate import CalibratedSamples, calibrate
from acromion.fusion.readers import read_recording
from acromion.fusion.recording import Recording, Segment
from acromion.fusion.sensor.gyroscope import build_identity_gyro_scale
from acromion.fusion.sensor.model import build_identity_accelerometer
from acromion.fusion.simulation import simulate_shift
from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.invariance import STANDARD_GRAVITY, Angle, fuse
from benchmarks.validation.worn import DEVICES, NAMES, at_rows, find_rmse_deg, wear
from tests.simulated_shifts import make_perfect

HOURS, SEEDS = 0.5, (1, 2)
WORSE_BY_DEG = 0.02
ARM = "full_body_example_data.mat"
REAL = "link_imu_100hz_179s.gt3x"

PROSE = f"""\
BROAD's trials are at rest in one direction and are not corrected, so they show little. This section compares
`smoothed` with and without the correction of accelerometer and gyroscope gain on recordings that are
corrected although nothing is wrong: half simulated hours of a sensor without errors (seeds {SEEDS[0]} and
{SEEDS[1]}), with the truth. The goal is that no file gets worse by more than {WORSE_BY_DEG:g} deg. Then a
real GT9X ({REAL}, no reference) and the right upper-arm recording of the project (another model, 100 s): the
difference between both, which shows the size of the correction, not whether it was right."""


def compare_good_sensors(folder: Path) -> Section:
    rows, goals = [], list[Goal]()
    for device in DEVICES:
        for seed in SEEDS:
            worn = wear(make_perfect(simulate_shift(device, HOURS, seed)))
            with_it, without = _fuse_both(calibrate(worn.recording))
            truth_deg = at_rows(worn.truth_deg, len(with_it))
            ours, left = find_rmse_deg(with_it - truth_deg), find_rmse_deg(without - truth_deg)
            what = f"{NAMES[device]} without errors, seed {seed}"
            rows.append([what, f"{ours:.4f}", f"{left:.4f}", f"{find_rmse_deg(with_it - without):.4f}"])
            goals.append(judge(f"{what}: worse by self-calibration", ours - left, WORSE_BY_DEG))
    for what, recording in (("real GT9X", _read_gt9x(folder)), ("real upper arm", _read_arm(folder))):
        with_it, without = _fuse_both(calibrate(recording))
        rows.append([what, "-", "-", f"{find_rmse_deg(with_it - without):.4f}"])
    header = ("recording", "RMSE with, deg", "RMSE without, deg", "apart, deg")
    return Section("A good sensor calibrating itself", (), tuple(goals), (PROSE, draw_table(header, rows)))


def _read_gt9x(folder: Path) -> Recording:
    with (folder / "gt9x" / REAL).open("rb") as file:
        return read_recording(file)


def _read_arm(folder: Path) -> Recording:
    """Read the arm at 100 Hz; acceleration in m/s2, angular rate in rad/s."""
    arm = loadmat(folder / "upper_arm" / ARM)["upper_arm_right"][0, 0]
    acc_g, gyr_dps = arm["acc"] / STANDARD_GRAVITY, np.degrees(arm["gyr"])
    segment = Segment(0, 100.0, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    return Recording("other", "0" * 64, None, None, segment.duration_us, (segment,))


def _fuse_both(samples: CalibratedSamples) -> tuple[Angle, Angle]:
    """Return the angle with the correction, and with the gyroscope's bias alone."""
    still = samples.calibration.windows[0]
    axis = still.gravity_g / np.linalg.norm(still.gravity_g)
    plain = replace(
        samples,
        accelerometer=build_identity_accelerometer(),
        gyro_scale=build_identity_gyro_scale(),
        runs=(),
        calibration=replace(samples.calibration, arm_axis=axis),
    )
    return fuse(samples), fuse(plain)
