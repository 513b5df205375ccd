"""Compare a sensor on the skin with the humerus, with one pose and with two.

    python -m benchmarks.validation.soft_tissue [--data DIR] [--seeds N]

The recording is half an hour of one person's recorded tasks, once with the plate as it moved and once with a
rigid plate. The plate was not measured in the poses. Its orientation there comes from a line fitted to the
person's clips.
"""

import argparse
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from acromion.fusion.elevation import measure_elevation
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.pose.rules import HELD_SIGMA_DEG
from acromion.fusion.recording import Float64Array
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation.body import ArmState
from acromion.fusion.simulation.sensor import Device
from benchmarks.validation.document import Section, draw_table
from benchmarks.validation.peers import QUICK
from benchmarks.validation.pose_error import KINDS, Ranged, holds, read_turned
from benchmarks.validation.real_clips import CLIP_HZ, Clip, Track, compute_readings
from benchmarks.validation.skin_clips import Strap, load_skin_library
from benchmarks.validation.worn import (
    DEVICES,
    NAMES,
    WornDay,
    find_rmse_deg,
    name_devices,
    record_motion,
)

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "skin_motion"
RATE_HZ, DAY_S, POSE_S, PAUSE_SHARE, SEEDS = 100.0, 1800.0, 10.0, 0.5, 3
RAISED_DEG, LEVEL_DEG, LEAST_ROWS = 60.0, 90.0, 6000
BANDS_DEG = ((0, 30), (30, 60), (60, 90), (90, 180))
EXTRA_SIGMAS_DEG = (0.0, 3.0, 4.0, 5.0)
CARRIERS = {"rigid": True, "skin": False}
LIVE_S, LIVE_ESTIMATORS = 600.0, {name: QUICK[name] for name in ("live", "VQF")}
HANGING, TWO_POINT, SCALED = "hanging", "two-point", "scaled at level"
READINGS = (HANGING, TWO_POINT, SCALED)

PROSE = """\
Tasks of four seated people ({minutes:.0f} minutes, optical motion capture with a plate strapped to the upper
arm; UE_ADLdatabase, MIT License), in half-hour days: each person {seeds} times on each device ({devices}).
*Skin*: the sensor moves as the plate did. *Rigid*: the same days with the plate fixed. Errors are measured
minus true elevation of the humerus, deg, over both devices: mean ± standard deviation, for bands with at
least a minute. *Hanging*: the window of the N-pose is given. *Two-point*: hanging and level are given.
*Scaled at level*: hanging is given, and angles are multiplied so that the level pose reads 90 deg; the
software does not do this. Poses are held exactly; in them the plate is extrapolated from the tasks. The data
does not include axial rotation of the skin, because the rotation of its humerus comes from the plate."""
RANGES_PROSE = """\
The same days on skin with the hanging pose: the share of figures (time above, bins, entries, percentiles)
whose 95 % range includes the truth if a standard deviation is added in squares to that of the angle. The pose
is held exactly / off by a normal deviate of {sigma:g} deg. *Width*: of the ranges of time above 30, 60 and 90
deg, mean, points."""
LIVE_PROSE = """\
`live` and VQF's real-time filter, with the same tasks for ten minutes without a pause. RMSE over the days of
each device, deg (worst day). *After the poses*: both received the held poses first. *From the work on*: both
start after the poses, so only the work has still moments. The axis is gravity's mean in the hanging pose; the
accelerometer is not corrected. VQF limits the gyroscope bias to 2 deg/s."""


@dataclass(frozen=True, slots=True, eq=False)
class Read:
    """One day: ``error_deg`` and ``truth_deg``, (n,), of the valid rows after the poses."""

    person: str
    carrier: str
    reading: str
    error_deg: Float64Array
    truth_deg: Float64Array


Poses = tuple[tuple[float, float], ...]


def make_day(
    clips: Sequence[Clip], seed: int, day_s: float = DAY_S, pause_share: float = PAUSE_SHARE
) -> tuple[ArmState, Poses]:
    """Return a day: the arm hangs, then is level, then does the person's tasks with pauses."""
    track = Track(np.random.default_rng([seed, zlib.crc32(b"skin")]), Strap(clips))
    poses_s = (track.hold(Rotation.identity(), POSE_S), track.hold(_raise_level(clips), POSE_S))
    while track.length_s < day_s:
        track.append_nearest(clips)
        if track.chance.random() < pause_share:
            track.pause()
    return compute_readings(track.join(), RATE_HZ), poses_s


def _raise_level(clips: Sequence[Clip]) -> Rotation:
    """Return the arm level, raised on the side on which the person raised it highest."""
    up = np.vstack([clip.turn.inv().apply([0.0, 0.0, 1.0]) for clip in clips])
    highest = up[np.argmin(up[:, 2])] * [1.0, 1.0, 0.0]
    return Rotation.align_vectors([[0.0, 0.0, 1.0]], [highest])[0]


def wear_days(folder: Path, carrier: str, seeds: int) -> Iterator[tuple[str, int, WornDay]]:
    """Yield person, seed and day on each device."""
    for person, clips in load_skin_library(folder, is_rigid=CARRIERS[carrier]).items():
        for seed in range(1, seeds + 1):
            day = make_day(clips, seed)
            for device in DEVICES:
                yield person, seed, wear(*day, device, seed)


def wear(state: ArmState, poses_s: Poses, device: Device, seed: int) -> WornDay:
    """Record a day with a specimen of the device."""
    return record_motion(state, RATE_HZ, device, np.random.default_rng([seed, 2]), poses_s)


def read_day(person: str, carrier: str, worn: WornDay) -> tuple[list[Read], Analysis]:
    """Return the errors of each reading, and the analysis with the hanging pose."""
    windows_s = tuple((start_s + 1.0, end_s - 1.0) for start_s, end_s in worn.poses_s)
    hanging = analyse(worn.recording, AnalysisSettings(calibration_windows_s=windows_s[:1]))
    both = analyse(worn.recording, AnalysisSettings(pose="two-point", calibration_windows_s=windows_s))
    (one,), (two,) = hanging.elevation.segments, both.elevation.segments
    time_s = np.arange(len(one)) / one.rate_hz
    is_level = (time_s > windows_s[1][0]) & (time_s < windows_s[1][1])
    scale = LEVEL_DEG / one.elevation_deg[is_level].mean()
    readings = {HANGING: one.elevation_deg, TWO_POINT: two.elevation_deg, SCALED: scale * one.elevation_deg}
    rows = one.valid & two.valid & (time_s > worn.poses_s[1][1])
    truth_deg = worn.truth_deg[rows]
    return [
        Read(person, carrier, reading, read_deg[rows] - truth_deg, truth_deg)
        for reading, read_deg in readings.items()
    ], hanging


def draw_errors(days: Sequence[Read]) -> str:
    """Return mean and standard deviation by band, a row for each carrier and reading, then each person."""
    rows = []
    for carrier in CARRIERS:
        for reading in READINGS:
            some = [one for one in days if (one.carrier, one.reading) == (carrier, reading)]
            rows.append([f"{carrier}, {reading}", *_describe(some)])
    for person in dict.fromkeys(one.person for one in days):
        for reading in READINGS:
            some = [
                one for one in days if (one.carrier, one.person, one.reading) == ("skin", person, reading)
            ]
            rows.append([f"skin, {reading}, {person}", *_describe(some)])
    header = ("sensor, reading", "RMSE (worst day)", *(f"{low} to {high} deg" for low, high in BANDS_DEG))
    return draw_table((*header, f"RMSE above {RAISED_DEG:.0f} deg"), rows)


def _describe(some: Sequence[Read]) -> list[str]:
    error_deg, truth_deg = (
        np.concatenate([getattr(one, name) for one in some]) for name in ("error_deg", "truth_deg")
    )
    bands = [error_deg[(truth_deg >= low) & (truth_deg < high)] for low, high in BANDS_DEG]
    worst_deg = max(find_rmse_deg(one.error_deg) for one in some)
    return [
        f"{find_rmse_deg(error_deg):.1f} ({worst_deg:.1f})",
        *(f"{band.mean():+.1f} ± {band.std():.1f}" if len(band) >= LEAST_ROWS else "-" for band in bands),
        f"{find_rmse_deg(error_deg[truth_deg >= RAISED_DEG]):.1f}",
    ]


def draw_ranges(ranges: Mapping[tuple[float, float], list[Ranged]]) -> str:
    """Return how many ranges include the truth, a row for each added standard deviation."""
    rows = []
    for extra_deg in EXTRA_SIGMAS_DEG:
        every = [ranges[off_deg, extra_deg] for off_deg in (0.0, HELD_SIGMA_DEG)]
        inside = [100.0 * float(np.mean([holds(one, true) for _, one, true in some])) for some in every]
        widths = [one.high - one.low for kind, one, _ in every[0] if kind == KINDS[0]]
        rows.append(
            [f"{extra_deg:g}", " / ".join(f"{share:.1f}" for share in inside), f"{np.mean(widths):.1f}"]
        )
    return draw_table(("added deg", "truth in the range %", "width"), rows)


def draw_live(folder: Path, seeds: int) -> str:
    """Return the errors of `live` and real-time VQF on the same days, a row for each carrier and device."""
    found: dict[tuple[str, str], list[list[float]]] = {}
    for carrier, is_rigid in CARRIERS.items():
        for clips in load_skin_library(folder, is_rigid=is_rigid).values():
            for seed, device in product(range(1, seeds + 1), DEVICES):
                worn = wear(*make_day(clips, seed, LIVE_S, 0.0), device, seed)
                (samples,) = worn.recording.segments
                held, work = (round(end_s * RATE_HZ) for _, end_s in worn.poses_s)
                axis = samples.acc_g[held // 5 : held - held // 5].mean(axis=0)
                errors = []
                for begin, estimate in product((0, work), LIVE_ESTIMATORS.values()):
                    acc, gyr = (
                        values[begin:].astype(np.float64) for values in (samples.acc_g, samples.gyr_dps)
                    )
                    read_deg = measure_elevation(estimate(acc, gyr, RATE_HZ), axis / np.linalg.norm(axis))
                    errors.append(find_rmse_deg((read_deg - worn.truth_deg[begin:])[work - begin :]))
                found.setdefault((carrier, NAMES[device]), []).append(errors)
    header = [
        f"{name}, {begin}" for begin in ("after the poses", "from the work on") for name in LIVE_ESTIMATORS
    ]
    rows = [
        [
            ", ".join(key),
            *(f"{np.mean(column):.1f} ({max(column):.1f})" for column in zip(*errors, strict=True)),
        ]
        for key, errors in found.items()
    ]
    return draw_table(("sensor", *header), rows)


def compare_soft_tissue(folder: Path, seeds: int = SEEDS) -> Section:
    """Return the section; without the data, it only names what is missing."""
    title = "A sensor on the skin"
    if not folder.is_dir():
        return Section(title, (f"Skipped: {folder.name} is missing.",))
    days: list[Read] = []
    ranges: dict[tuple[float, float], list[Ranged]] = {}
    for carrier, is_rigid in CARRIERS.items():
        for person, seed, worn in wear_days(folder, carrier, seeds):
            read, hanging = read_day(person, carrier, worn)
            days += read
            if is_rigid:
                continue
            for off_deg, extra_deg in product((0.0, HELD_SIGMA_DEG), EXTRA_SIGMAS_DEG):
                some = read_turned(worn, hanging, off_deg, seed, extra_sigma_deg=extra_deg)
                ranges.setdefault((off_deg, extra_deg), []).extend(some)
    clips = [clip for person in load_skin_library(folder, is_rigid=True).values() for clip in person]
    minutes = sum(len(clip.velocity_mps) for clip in clips) / CLIP_HZ / 60.0
    prose = PROSE.format(minutes=minutes, seeds=seeds, devices=name_devices())
    held = RANGES_PROSE.format(sigma=HELD_SIGMA_DEG)
    return Section(
        title, (prose, draw_errors(days), held, draw_ranges(ranges), LIVE_PROSE, draw_live(folder, seeds))
    )


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.soft_tissue")
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    given = parser.parse_args()
    print("\n\n".join(compare_soft_tissue(given.data, given.seeds).shown))


if __name__ == "__main__":
    main()
