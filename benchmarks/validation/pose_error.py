"""Test if the range of the N-pose includes the truth if the arm is measured too low.

    python -m benchmarks.validation.pose_error [--data DIR] [--seeds N]

A fused angle is lowered by 15 deg x min(1, true angle / 90 deg), and counted with the range of the N-pose.
The ranges assume an error that grows with the *measured* angle and has any size up to the limit. The error
here grows with the true angle and is the largest possible. The pose is held exactly, or as people hold it
(the axis is rotated in any direction by a normal deviate of its standard deviation). With 15 deg at every
angle it is reported without a goal. The days are those of ``stated`` with the window of the pose given.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path

import numpy as np

from acromion.fusion.conventions import NPOSE_ERROR_DEG
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.resampling import FULL_AT_DEG
from acromion.fusion.exposure.summary import LEAST_BIN_DEG, summarise_exposure
from acromion.fusion.exposure.types import Exposure, Interval
from acromion.fusion.pipeline import SOFT_TISSUE_SIGMA_DEG, Analysis, analyse
from acromion.fusion.pose.rules import HELD_SIGMA_DEG
from acromion.fusion.recording import Float64Array
from benchmarks.validation.document import Section, draw_table
from benchmarks.validation.stated import DATA, SCENARIOS, Subject, choose_settings, find_missing, wear_day
from benchmarks.validation.stated import KINDS as DAYS
from benchmarks.validation.worn import DEVICES, WornDay, name_devices

KINDS = ("time above", "bins", "entries", "percentiles")
GOAL_PERCENT = 90.0
PROSE = """\
A fused angle is lowered by 15 deg x min(1, true angle / 90 deg), the largest published error. *Truth in the
range*: figures whose range from `low_pose` to `high_pose` includes the truth, with the pose held exactly /
off by a normal deviate of {sigma:g} deg; the goal is {goal:g} %. *Without*: the same for the range from `low`
to `high`. The days are those of every kind above with the window given, seeds 0 to {last}, {devices}. 15 deg
at every angle has no goal, because the ranges assume that a hanging arm reads correctly."""

Lower = Callable[[Float64Array], Float64Array]
Ranged = tuple[str, Interval, float]


def lower_with_angle(true_deg: Float64Array) -> Float64Array:
    """Return an error that grows with the angle, deg."""
    return np.asarray(NPOSE_ERROR_DEG * np.minimum(1.0, true_deg / FULL_AT_DEG))


def lower_everywhere(true_deg: Float64Array) -> Float64Array:
    """Return an error that is the same at every angle, deg."""
    return np.full_like(true_deg, NPOSE_ERROR_DEG)


ERRORS: Mapping[str, Lower] = {"growing to 15 deg": lower_with_angle, "15 deg everywhere": lower_everywhere}


def list_ranged(measured: Exposure, true: Exposure) -> Iterator[Ranged]:
    """Yield kind, range and truth of each figure that has a range of the pose."""
    for above, exact in zip(measured.time_above, true.time_above, strict=True):
        if above.interval is not None:
            yield KINDS[0], above.interval, exact.percent
    for part, exact_part in zip(measured.bins, true.bins, strict=True):
        if part.interval is not None and part.lower_deg >= LEAST_BIN_DEG:
            yield KINDS[1], part.interval, exact_part.percent
    for entries in true.entries:
        interval = measured.intervals[f"entries_above_{entries.threshold_deg:g}_per_h"]
        yield KINDS[2], interval, entries.per_hour or 0.0
    for percent, angle_deg in true.percentiles_deg.items():
        yield KINDS[3], measured.intervals[f"elevation_p{percent}_deg"], angle_deg


def read_low(worn: WornDay, analysis: Analysis, lower: Lower, off_deg: float, seed: int) -> list[Ranged]:
    """Return a day's figures, read low and with its axis rotated by an angle."""
    lower_deg = lower(worn.truth_deg)
    return read_turned(
        worn, analysis, off_deg, seed, extra_sigma_deg=SOFT_TISSUE_SIGMA_DEG, lower_deg=lower_deg
    )


def read_turned(
    worn: WornDay,
    analysis: Analysis,
    off_deg: float,
    seed: int,
    *,
    extra_sigma_deg: float = 0.0,
    lower_deg: Float64Array | float = 0.0,
) -> list[Ranged]:
    """Return a day's figures with a rotated axis, with the truth over the same rows.

    ``extra_sigma_deg``: added in squares to the angle's standard deviation.
    """
    assert analysis.calibration is not None
    (fused,) = analysis.elevation.segments
    assert fused.vertical is not None
    random, axis = np.random.default_rng([seed, 9]), analysis.calibration.arm_axis
    aside = np.cross(axis, random.normal(size=3))
    off = np.radians(off_deg * random.normal())
    turned = np.cos(off) * axis + np.sin(off) * aside / np.linalg.norm(aside)
    angle_deg = np.degrees(np.arccos(np.clip(fused.vertical[0 : len(fused)] @ turned, -1.0, 1.0)))
    read_deg = np.clip(angle_deg - lower_deg, 0.0, 180.0)
    rows = fused.valid & worn.worn
    sigmas_deg = (analysis.calibration.sigma_deg, analysis.elevation.bias_sigma_deg or 0.0, extra_sigma_deg)
    read, truth = (
        Elevation((ElevationSegment(0, fused.rate_hz, some.astype(np.float32), rows),), None)
        for some in (read_deg, worn.truth_deg)
    )
    measured = summarise_exposure(read, bias_sigma_deg=float(np.linalg.norm(sigmas_deg)), is_npose=True)
    return list(list_ranged(measured, summarise_exposure(truth)))


def run(data: Path, seeds: int) -> dict[tuple[str, float], list[Ranged]]:
    """Return all figures of all days by error and standard deviation of the pose."""
    found: dict[tuple[str, float], list[Ranged]] = {}
    scenario = SCENARIOS["pose-window"]
    for seed, kind, device in product(range(seeds), DAYS, DEVICES):
        worn = wear_day(scenario, Subject(kind, seed, data), device)
        analysis = analyse(worn.recording, choose_settings(scenario, worn))
        for name, off_deg in product(ERRORS, (0.0, HELD_SIGMA_DEG)):
            read = read_low(worn, analysis, ERRORS[name], off_deg, seed)
            found.setdefault((name, off_deg), []).extend(read)
    return found


def draw_rows(found: Mapping[tuple[str, float], list[Ranged]]) -> Iterator[list[str]]:
    """Yield a row for each error and kind of figure."""
    for name, kind in product(ERRORS, KINDS):
        every = [[one for one in found[name, off] if one[0] == kind] for off in (0.0, HELD_SIGMA_DEG)]
        inside = [_share(some, _holds_with_pose) for some in every]
        met = "yes" if min(inside) >= GOAL_PERCENT else "**no**"
        without = [_share(some, holds) for some in every]
        yield [
            name,
            kind,
            " / ".join(f"{share:.1f}" for share in inside),
            " / ".join(f"{share:.1f}" for share in without),
            met if name == next(iter(ERRORS)) else "none asked",
        ]


def _share(some: Sequence[Ranged], is_inside: Callable[[Interval, float], bool]) -> float:
    return 100.0 * float(np.mean([is_inside(interval, true) for _, interval, true in some]))


def holds(interval: Interval, true: float) -> bool:
    return interval.low <= true <= interval.high


def _holds_with_pose(interval: Interval, true: float) -> bool:
    assert interval.low_pose is not None
    assert interval.high_pose is not None
    return interval.low_pose <= true <= interval.high_pose


HEADER = ("error", "figures", "truth in the range %", "without %", "goal met")


def compare_pose_error(data: Path, seeds: int) -> Section:
    """Return the section; without the data, it only names what is missing."""
    title = "The N-pose's error"
    if missing := find_missing(data):
        return Section(title, (missing,))
    prose = PROSE.format(goal=GOAL_PERCENT, last=seeds - 1, devices=name_devices(), sigma=HELD_SIGMA_DEG)
    return Section(title, (prose, draw_table(HEADER, list(draw_rows(run(data, seeds))))))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.pose_error")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    print("\n\n".join(compare_pose_error(given.data, given.seeds).shown))


if __name__ == "__main__":
    main()
