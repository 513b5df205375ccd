"""Oracles that start at the sensor or are properties: 18, 19, 21, 22, 24, 25 and 26."""

from collections.abc import Iterator
from itertools import pairwise, permutations, product

import numpy as np
from scipy.stats import norm

from acromion.fusion.elevation import estimate_elevation
from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.orientation.published import PublishedParameters, estimate_published
from acromion.fusion.pose.calibrate import calibrate
from acromion.fusion.recording import FloatArray
from acromion.fusion.sensor.model import SensorRun
from acromion.fusion.settings import AnalysisSettings
from benchmarks.exposure_oracles_table import Oracle, share_above
from tests.factories import elevate, hold, move_arm, record

CUBE = [
    np.eye(3)[list(order)] * np.array(signs)[:, np.newaxis]
    for order in permutations(range(3))
    for signs in product((1.0, -1.0), repeat=3)
    if np.linalg.det(np.eye(3)[list(order)] * np.array(signs)[:, np.newaxis]) > 0
]


def check_sensor() -> Iterator[Oracle]:
    made = move_arm(lambda t: 45 + 40 * np.sin(np.pi * t), 1.0, distance_m=0.25)
    acc_x, _, acc_z = made.recording.segments[0].acc_g[50].astype(float)
    alone_deg = float(np.degrees(np.arctan2(acc_x, acc_z)))
    yield Oracle("18", "top of a swing by acceleration, deg", 83.9374, alone_deg, 0.01)
    yield Oracle("19", "offset 0.5 deg/s, 2 s, deg", 1.0, find_steady_error(), 0.005)
    for raised_deg, read_deg in ((90.0, 74.1), (60.0, 44.1), (30.0, 14.1)):
        got = read_angle(-45.0, raised_deg)
        yield Oracle("22", f"abducted pose, abduction {raised_deg:g}", read_deg, got, 0.05)
    for raised_deg, read_deg in ((90.0, 90.0), (60.0, 61.2577), (30.0, 33.6030)):
        got = read_flexion(raised_deg)
        yield Oracle("22", f"abducted pose, flexion {raised_deg:g}", read_deg, got, 0.05)


def find_steady_error() -> float:
    """Run the published filter, without its high-pass, at rest with an offset about a level axis."""
    rows = 100 * 60
    acc_g, gyr_dps = np.tile([0.0, 0.0, 1.0], (rows, 1)), np.tile([0.0, 0.5, 0.0], (rows, 1))
    run = SensorRun(0.0, 100.0, acc_g.astype(np.float32), gyr_dps.astype(np.float32))
    parameters = PublishedParameters(highpass_gyr_hz=0.0, time_constant_s=2.0)
    up = estimate_published(run, np.zeros(3), parameters)[-1]
    return float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))))


def read_angle(plane_deg: float, raised_deg: float) -> float:
    """Calibrate with the arm abducted by 15.9 deg; raise it in the same plane."""
    made = hold((15.9, 10.0), (raised_deg, 10.0), plane_deg=plane_deg)
    samples = calibrate(made.recording, AnalysisSettings(calibration_windows_s=((1.0, 8.0),)))
    return float(estimate_elevation(samples).segments[0].elevation_deg[1500])


def read_flexion(raised_deg: float) -> float:
    """Calibrate with the arm abducted by 15.9 deg; let it hang straight, then flex it."""
    aside, raised = np.radians(15.9), np.radians(raised_deg)
    time_s = np.arange(3000) / 100.0
    abducted = aside * np.clip((12.0 - time_s) / 2.0, 0.0, 1.0)
    flexed = raised * np.clip((time_s - 12.0) / 4.0, 0.0, 1.0)
    up = np.stack(
        [np.sin(abducted), np.cos(abducted) * np.sin(flexed), np.cos(abducted) * np.cos(flexed)], axis=1
    )
    turned_dps = np.degrees(np.cross(np.gradient(up, 0.01, axis=0), up))
    samples = calibrate(record(up, turned_dps, 100.0), AnalysisSettings(calibration_windows_s=((1.0, 8.0),)))
    return float(estimate_elevation(samples).segments[0].elevation_deg[2500])


def check_properties() -> Iterator[Oracle]:
    for name, mean_deg, sd_deg, share in (
        ("Normal(25, 22.5)", 25.0, 22.5, 0.059907),
        ("with an error of +3 deg", 28.0, 22.5, 0.077481),
        ("with a noise of 5 deg", 25.0, float(np.hypot(22.5, 5.0)), 0.064443),
    ):
        quantiles = norm.ppf((np.arange(1_000_000) + 0.5) / 1_000_000, mean_deg, sd_deg)
        angle = MetricAngle(0, 100.0, np.clip(quantiles, 0, 180), np.ones(1_000_000, np.bool_))
        yield Oracle("21", f"{name}, above 60 deg", share, share_above(angle, 60), 2e-6)
    yield Oracle("24", "24 mountings, largest difference, deg", 0.0, compare_mountings(), 0.01)
    day = summarise_exposure(elevate(np.random.default_rng(0).uniform(0, 180, 30_000), rate_hz=1.0))
    left_s = day.analysed_s - sum(part.duration_s for part in day.bins)
    yield Oracle("25", "day less its bins, s", 0.0, left_s, 1e-9)
    left_s = day.analysed_s - sum(hour.analysed_s for hour in day.by_hour)
    yield Oracle("25", "day less its hours, s", 0.0, left_s, 1e-9)
    yield Oracle("26", "figures out of order", 0, count_disorder(day), 0)


def compare_mountings() -> float:
    """Return the largest difference between the angles of 24 mountings."""
    made = move_arm(lambda t: 40 - 40 * np.cos(np.clip(t - 10, 0, None)), 40.0)
    (segment,) = made.recording.segments
    angles = [mount(segment.acc_g, segment.gyr_dps, turn) for turn in CUBE]
    return float(np.ptp(np.stack(angles), axis=0).max())


def mount(acc_g: FloatArray, gyr_dps: FloatArray, turn: FloatArray) -> FloatArray:
    turned_g, turned_dps = (np.asarray(rows @ turn.T, np.float64) for rows in (acc_g, gyr_dps))
    recording = record(turned_g, turned_dps, 100.0)
    samples = calibrate(recording, AnalysisSettings(calibration_windows_s=((1.0, 8.0),)))
    return estimate_elevation(samples).segments[0].elevation_deg


def count_disorder(day: Exposure) -> int:
    """Count the contradictions.

    A contradiction is a higher threshold or a longer window with a larger share, or percentiles out of order.
    """
    above = [item.percent for item in day.time_above]
    percentiles = list(day.percentiles_deg.values())
    windows = [window.percent_above_60 or 0.0 for window in day.peak_windows]
    falling = sum(a < b - 1e-9 for row in (above, windows) for a, b in pairwise(row))
    return falling + sum(a > b for a, b in pairwise(percentiles))
