"""Section (f): changes that must not affect the angle: mounting of the sensor, units, cuts, the rate."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from acromion.fusion.comparison.alignment import Run, interpolate
from acromion.fusion.elevation import estimate_elevation, group_rows
from acromion.fusion.pose.calibrate import CalibratedSamples, calibrate
from acromion.fusion.recording import MICROSECONDS, Recording, Segment
from acromion.fusion.sensor.model import view_segment
from acromion.fusion.sensor.stillness import find_still_moments, reduce_run
from acromion.fusion.simulation import simulate_shift
from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.worn import DEVICES, NAMES, find_rmse_deg, wear
from tests.simulated_shifts import make_perfect

HOURS, SEED = 0.5, 1
MOUNTINGS, CUTS = 5, 4
STANDARD_GRAVITY = np.float32(9.80665)
Angle = NDArray[np.float64]

PROSE = f"""\
Half a simulated hour of each device (seed {SEED}), `smoothed`, with changes that do not affect the motion;
the largest difference from the angle of the unchanged recording at any sample. *Strapped on another way*: all
samples rotated by {MOUNTINGS} random rotations, the worst of them; as recorded, and from a sensor without
errors. Rotating an imperfect sensor's samples also rotates its errors. Gain and offset are estimated
independently of the axes, so the result rotates with the samples. *Units*: acceleration in m/s2 and back, in
single precision. *Cut*: at {CUTS} still moments, each piece fused separately with the calibration of the
whole file. *Rate halved*: every second sample removed, no filter."""

LIMITS_DEG: Mapping[str, float] = {
    "strapped on another way": 0.01,
    "strapped on another way, no errors": 0.01,
    "units": 0.01,
    "cut at still moments": 0.1,
    "rate halved": 0.2,
}


def compare_changes() -> Section:
    rows, goals = [], list[Goal]()
    for device in DEVICES:
        recording = trim(wear(simulate_shift(device, HOURS, SEED)).recording)
        perfect = wear(make_perfect(simulate_shift(device, HOURS, SEED))).recording
        changed = change_all(recording) | {"strapped on another way, no errors": strap_on(perfect)}
        for what, difference_deg in changed.items():
            largest_deg = float(np.abs(difference_deg).max())
            rms_deg = find_rmse_deg(difference_deg)
            rows.append([f"{NAMES[device]}, {what}", f"{rms_deg:.4f}", f"{largest_deg:.4f}"])
            goals.append(
                judge(f"{NAMES[device]}, {what}: change of the angle", largest_deg, LIMITS_DEG[what])
            )
    table = draw_table(("change", "root mean square deg", "largest deg"), rows)
    return Section("What must not change the angle", (), tuple(goals), (PROSE, table))


def change_all(recording: Recording) -> dict[str, Angle]:
    """Return the difference from the unchanged recording, by change, at each remaining sample."""
    samples = calibrate(recording)
    whole = fuse(samples)
    return {
        "strapped on another way": strap_on(recording),
        "units": fuse(calibrate(convert(recording))) - whole,
        "cut at still moments": fuse(replace(samples, recording=cut(recording))) - whole,
        "rate halved": halve_rate(recording, whole),
    }


def strap_on(recording: Recording) -> Angle:
    """Return the difference caused by the worst of some random rotations."""
    whole = fuse(calibrate(recording))
    rotations = Rotation.random(MOUNTINGS, rng=np.random.default_rng(SEED)).as_matrix()
    turned = [fuse(calibrate(turn(recording, rotation))) - whole for rotation in rotations]
    return max(turned, key=lambda difference_deg: float(np.abs(difference_deg).max()))


def fuse(samples: CalibratedSamples) -> Angle:
    segments = estimate_elevation(samples).segments
    return np.concatenate([segment.elevation_deg for segment in segments]).astype(np.float64)


def turn(recording: Recording, rotation: NDArray[np.float64]) -> Recording:
    segment = recording.segments[0]
    acc_g = (segment.acc_g @ rotation.T).astype(np.float32)
    gyr_dps = (segment.gyr_dps @ rotation.T).astype(np.float32)
    return replace(recording, segments=(replace(segment, acc_g=acc_g, gyr_dps=gyr_dps),))


def convert(recording: Recording) -> Recording:
    segment = recording.segments[0]
    acc_g = (segment.acc_g * STANDARD_GRAVITY) / STANDARD_GRAVITY
    return replace(recording, segments=(replace(segment, acc_g=acc_g),))


def cut(recording: Recording) -> Recording:
    """Cut at still moments spread over the recording."""
    segment = recording.segments[0]
    middles_s = find_still_moments([reduce_run(view_segment(segment))]).middle_s
    chosen_s = middles_s[np.linspace(0, len(middles_s) - 1, CUTS + 2).astype(np.int64)[1:-1]]
    per_row = _count_per_row(segment)
    inner = (round(time_s * segment.rate_hz / per_row) * per_row for time_s in chosen_s)
    edges = [0, *inner, len(segment)]
    pieces = tuple(_take(segment, first, stop) for first, stop in pairwise(edges))
    return replace(recording, segments=pieces)


def _take(segment: Segment, first: int, stop: int) -> Segment:
    start_us = round(first * MICROSECONDS / segment.rate_hz)
    return Segment(start_us, segment.rate_hz, segment.acc_g[first:stop], segment.gyr_dps[first:stop])


def trim(recording: Recording) -> Recording:
    """Remove the samples after the last whole row of the angle, so that cuts do not move the rows."""
    segment = recording.segments[0]
    kept = _take(segment, 0, len(segment) // _count_per_row(segment) * _count_per_row(segment))
    return replace(recording, segments=(kept,), duration_us=kept.duration_us)


def _count_per_row(segment: Segment) -> int:
    return group_rows(segment).per_row


def halve_rate(recording: Recording, whole: Angle) -> Angle:
    """Return the difference caused by halving the rate, at its rows."""
    halved = fuse(calibrate(halve(recording)))
    time_s = np.arange(len(halved)) * (len(whole) / len(halved))
    return halved - interpolate(Run(0.0, 1.0, whole), np.minimum(time_s, len(whole) - 1.0))


def halve(recording: Recording) -> Recording:
    segment = recording.segments[0]
    acc_g, gyr_dps = (np.ascontiguousarray(table[::2]) for table in (segment.acc_g, segment.gyr_dps))
    half = Segment(0, segment.rate_hz / 2.0, acc_g, gyr_dps)
    return replace(recording, segments=(half,), duration_us=half.duration_us)
