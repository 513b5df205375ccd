"""Section (i): shifts made of recorded human motion, read by the rules for the pose as they are.

    python -m benchmarks.validation.real_motion [--shifts N] [--minutes M] [--arm l] [--only A B] [--data DIR]

prints the section in Markdown. Right arms (``--arm r``) are to settle on, left arms to score on.
"""

import argparse
import sys
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.validation.document import Section, draw_table
from benchmarks.validation.real_clips import STRIDE_TURN_S, Clip, Library, Side, Track, feel, load_library
from benchmarks.validation.turned_days import ABRUPT_S, Turn, draw_across
from benchmarks.validation.worn import DEVICES, NAMES, find_rmse_deg
from fusion.elevation import Elevation, ElevationSegment, estimate_elevation
from fusion.errors import FusionError
from fusion.exposure import Exposure, summarise_exposure
from fusion.exposure.bins import CELLS_PER_DEG
from fusion.pipeline import Analysis, AnalysisSettings, analyse
from fusion.pose.calibrate import calibrate
from fusion.pose.postures import find_angle_deg
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, Recording, Segment
from fusion.simulation.sensor import (
    PARTS,
    Device,
    Part,
    Readings,
    draw_errors,
    draw_perfect,
    quantise,
    sense,
)
from fusion.simulation.shift import START

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "real_motion"
POSE_S, SEED = 10.0, 1
PAUSE_S, WALK_S, WALK_SHARE, PAUSE_SHARE = (6.0, 20.0), (30.0, 90.0), 0.35, 0.6
EARLY_S, DESK_S, LATE_S = 600.0, 300.0, 120.0
AWAY_DEG, POSE_SLACK_S, BIN_DEG = 8.0, 1.5, 30
ALONE_EVERY = 4
FIGURE_PERCENTS = (10, 50, 90)

PROSE = """\
{shifts} shifts a row, of {minutes:g} min (seeds {first} to {last}), from {clips} clips of CMU Graphics Lab
(subjects 01 to 03, 11 minutes, {arms} arms; the others are kept to settle rules on). Each clip comes many
times, plain walking as one stride on end. Order, turns, pauses and poses are made up, the device's errors
simulated.

Errors are over valid worn rows. *Dropped*: for each shift. *Held*: the window lies in the held pose. *Axis*:
its error, worst. *In ranges*: time above 30, 60, 90 deg, P10, P50, P90, truth of the same rows (E's ranges
hold the desk). *Width*: of the range of time above 60 deg, mean. Caveats but W-NPOSE and W-FEW-HOURS."""
EXPECTED = frozenset({"W-NPOSE", "W-FEW-HOURS"})


@dataclass(frozen=True, slots=True)
class Scenario:
    """One row of the table of the issue.

    ``opening``: "pose", "none", "late" (motion and pauses first) or "desk". ``tilt_deg``: how far the pose is
    from plumb. ``slip_deg``: half way. ``is_asked``: the window is given. ``skips_walks``: every fourth shift
    has no walking, its work that of subject 01 and then that of 02.
    """

    name: str
    opening: str = "pose"
    tilt_deg: float = 0.0
    slip_deg: float = 0.0
    is_asked: bool = False
    skips_walks: bool = False


SCENARIOS: Mapping[str, Scenario] = {
    "A": Scenario("A pose plumb, pauses soon after"),
    "B": Scenario("B pose 8 deg off", tilt_deg=AWAY_DEG),
    "C": Scenario("C nothing still in ten minutes", "none"),
    "D": Scenario("D two minutes with pauses first", "late"),
    "D2": Scenario("D, the window given", "late", is_asked=True),
    "E": Scenario("E five minutes on a desk first", "desk"),
    "F20": Scenario("F slip of 20 deg", slip_deg=20.0),
    "F45": Scenario("F slip of 45 deg", slip_deg=45.0),
    "F90": Scenario("F slip of 90 deg", slip_deg=90.0),
    "G": Scenario("G no slip, every fourth shift without walking", skips_walks=True),
    "J": Scenario("J as A, the window given", is_asked=True),
}


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A shift of recorded motion.

    ``pose_s``: when the pose is held, None where none is; ``desk_s``: until when the sensor lies on a desk.
    """

    motion: Clip
    pose_s: tuple[float, float] | None
    desk_s: float


@dataclass(frozen=True, slots=True, eq=False)
class WornShift:
    """A recording, its truth and where it was worn, both (n,), and the arm's axis in the sensor, (3,)."""

    made: Made
    recording: Recording
    truth_deg: Float64Array
    worn: BoolArray
    arm_axis: Float64Array


@dataclass(frozen=True, slots=True)
class Scored:
    """One analysis against its truth; ``refused``: the error's code; ``is_held`` None: no pose is held."""

    refused: str = ""
    rmse_deg: float = np.nan
    bin_points: float = np.nan
    dropped_s: float = np.nan
    is_held: bool | None = None
    axis_deg: float = np.nan
    within: int = 0
    figures: int = 0
    width_points: float = np.nan
    codes: tuple[str, ...] = ()


# Shifts


def make_shift(library: Library, scenario: Scenario, minutes: float, seed: int) -> Made:
    """Draw the course of a shift; scenarios that differ in pose or slip alone share it."""
    chance = np.random.default_rng([seed, zlib.crc32(scenario.opening.encode()), scenario.skips_walks])
    track = Track(chance)
    stride = library.strides[str(chance.choice(sorted(library.strides)))]
    work = [clip for name in sorted(library.work) for clip in library.work[name]]
    pose_s, desk_s = _open(track, scenario, (work, stride))
    no_pause_s = EARLY_S + 60.0 if scenario.opening == "none" else 0.0
    alone = scenario.skips_walks and seed % ALONE_EVERY == SEED
    while track.length_s < 60.0 * minutes:
        if alone:
            is_first = track.length_s < 30.0 * minutes
            _work(track, library.work["01" if is_first else "02"], no_pause_s)
        elif chance.random() < WALK_SHARE:
            _walk(track, stride)
        else:
            _work(track, work, no_pause_s)
    return Made(track.join(), pose_s, desk_s)


def _open(
    track: Track, scenario: Scenario, clips: tuple[list[Clip], list[Clip]]
) -> tuple[tuple[float, float] | None, float]:
    """What comes before the work: when the pose is held, and until when the sensor lies on a desk."""
    work, stride = clips
    desk_s = 0.0
    if scenario.opening == "none":
        track.go_on(work[0])
        return None, desk_s
    if scenario.opening == "desk":
        track.hold(_hang(track.chance, 90.0), DESK_S, sway_deg=0.0)
        desk_s = DESK_S + 3.0
    if scenario.opening == "late":
        track.go_on(stride[0])
        while track.length_s < LATE_S:
            _work(track, work, 0.0)
            track.hold(None, float(track.chance.uniform(*PAUSE_S)))
    return track.hold(_hang(track.chance, scenario.tilt_deg), POSE_S), desk_s


def _hang(chance: np.random.Generator, tilt_deg: float) -> Rotation:
    """An arm ``tilt_deg`` from plumb, turned any way about itself."""
    about, spin = chance.uniform(0.0, 2.0 * np.pi, 2)
    tilt = np.radians(tilt_deg) * np.array([np.cos(about), np.sin(about), 0.0])
    return Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0.0, 0.0, spin])


def _walk(track: Track, stride: Sequence[Clip]) -> None:
    until_s = track.length_s + track.chance.uniform(*WALK_S)
    track.go_on_with_nearest(stride)
    while track.length_s < until_s:
        step = stride[int(track.chance.integers(len(stride)))]
        track.go_on(step, STRIDE_TURN_S)


def _work(track: Track, clips: Sequence[Clip], no_pause_s: float) -> None:
    track.go_on_with_nearest(clips)
    if track.length_s > no_pause_s and track.chance.random() < PAUSE_SHARE:
        track.hold(None, float(track.chance.uniform(*PAUSE_S)))


def wear(made: Made, device: Device, seed: int, *, slip_deg: float = 0.0, perfect: bool = False) -> WornShift:
    """Strap a specimen on and read the motion, rounded and clipped as the device does."""
    part, chance = PARTS[device], np.random.default_rng([seed, 2])
    rate_hz = part.nominal_rate_hz * (1.0 + chance.uniform(*part.rate_error))
    state = feel(made.motion, rate_hz)
    time_s = np.arange(len(state.elevation_deg)) / rate_hz
    errors = draw_perfect(time_s[-1], chance) if perfect else draw_errors(part, rate_hz, time_s[-1], chance)
    if slip_deg:
        state = Turn(slip_deg, draw_across(chance), time_s[-1] / 2.0, ABRUPT_S).apply(state, time_s)
    readings = sense(state, errors, time_s, chance)
    if not perfect:
        readings = _count(readings, part)
    segment = Segment(0, rate_hz, readings.acc_g.astype(np.float32), readings.gyr_dps.astype(np.float32))
    duration_us = round(len(time_s) / rate_hz * MICROSECONDS)
    recording = Recording(
        device,
        "0" * 64,
        START,
        None,
        duration_us,
        (segment,),
        acc_range_g=part.acc_range_g,
        gyr_range_dps=part.gyr_range_dps,
    )
    axis = errors.mounting @ np.array([0.0, 0.0, 1.0])
    return WornShift(made, recording, state.elevation_deg, time_s >= made.desk_s, axis)


def _count(readings: Readings, part: Part) -> Readings:
    """Round and clip as the part does."""
    acc = quantise(readings.acc_g, part.acc_g_per_lsb, part.acc_range_g).astype(np.float64)
    gyr = quantise(readings.gyr_dps, part.gyr_dps_per_lsb, part.gyr_range_dps).astype(np.float64)
    return Readings(acc * part.acc_g_per_lsb, gyr * part.gyr_dps_per_lsb)


# Scores


def score(worn: WornShift, *, is_asked: bool) -> Scored:
    """Analyse as an uploaded recording is, and compare."""
    pose_s = worn.made.pose_s
    windows_s = ((pose_s[0] + 1.0, pose_s[1] - 1.0),) if is_asked and pose_s else ()
    try:
        analysis = analyse(worn.recording, AnalysisSettings(calibration_windows_s=windows_s))
    except FusionError as error:
        return Scored(refused=error.code)
    (found,) = analysis.elevation.segments
    rows = found.valid & worn.worn
    truth = ElevationSegment(0, found.rate_hz, worn.truth_deg.astype(np.float32), rows)
    true_exposure = summarise_exposure(Elevation((truth,), None))
    ours = summarise_exposure(Elevation((replace(found, valid=rows),), None))
    ranges = _list_ranges(analysis.exposure)
    inside = [
        low <= true <= high for (low, high), true in zip(ranges, _list_figures(true_exposure), strict=True)
    ]
    return Scored(
        rmse_deg=find_rmse_deg((found.elevation_deg - worn.truth_deg)[rows]),
        bin_points=float(np.abs(_share_bins(ours) - _share_bins(true_exposure)).max()),
        dropped_s=float((worn.worn & ~found.valid).sum() / found.rate_hz),
        is_held=_is_held(analysis, pose_s),
        axis_deg=_find_axis_error(analysis, worn),
        within=sum(inside),
        figures=len(inside),
        width_points=ranges[1][1] - ranges[1][0],
        codes=tuple(sorted({flag.code for flag in analysis.quality.flags})),
    )


def _is_held(analysis: Analysis, pose_s: tuple[float, float] | None) -> bool | None:
    if analysis.calibration is None or pose_s is None:
        return None
    still = analysis.calibration.still
    starts_in = still.start_s >= pose_s[0] - POSE_SLACK_S
    return starts_in and still.start_s + still.duration_s <= pose_s[1] + POSE_SLACK_S


def _find_axis_error(analysis: Analysis, worn: WornShift) -> float:
    if analysis.calibration is None:
        return np.nan
    return find_angle_deg(analysis.calibration.arm_axis, worn.arm_axis)


def _share_bins(exposure: Exposure) -> NDArray[np.float64]:
    starts = np.arange(0, 180, BIN_DEG) * CELLS_PER_DEG
    return np.asarray(np.add.reduceat(exposure.histogram_s, starts) * (100.0 / exposure.analysed_s))


def _list_figures(exposure: Exposure) -> list[float]:
    above = [part.percent for part in exposure.time_above]
    return [*above, *(exposure.percentiles_deg[percent] for percent in FIGURE_PERCENTS)]


def _list_ranges(exposure: Exposure) -> list[tuple[float, float]]:
    """The ranges of the same figures; one without a range holds itself alone."""
    found = [part.interval for part in exposure.time_above]
    found += [exposure.intervals.get(f"elevation_p{percent}_deg") for percent in FIGURE_PERCENTS]
    pairs = zip(found, _list_figures(exposure), strict=True)
    return [(own, own) if one is None else (one.low, one.high) for one, own in pairs]


@dataclass(frozen=True, slots=True)
class Checked:
    """A perfect sensor with the known axis: what the generator itself is worth."""

    device: Device
    rmse_deg: float
    rest_g: float


def check_generator(library: Library, device: Device, minutes: float) -> Checked:
    """Read a shift of A with no sensor error and the exact axis."""
    made = make_shift(library, SCENARIOS["A"], minutes, SEED)
    worn = wear(made, device, SEED, perfect=True)
    samples = calibrate(worn.recording, "n-pose", ((1.0, POSE_S - 1.0),))
    calibration = replace(samples.calibration, arm_axis=worn.arm_axis)
    (found,) = estimate_elevation(replace(samples, calibration=calibration, remounts=())).segments
    rest = worn.recording.segments[0].acc_g[: round((POSE_S - 1.0) * found.rate_hz)].mean(axis=0)
    rmse_deg = find_rmse_deg((found.elevation_deg - worn.truth_deg)[found.valid])
    return Checked(device, rmse_deg, float(np.linalg.norm(rest)))


# The section


@dataclass(frozen=True, slots=True)
class Options:
    """What is run."""

    folder: Path = DATA
    shifts: int = 4
    minutes: float = 40.0
    arm: Side = "l"
    only: tuple[str, ...] = tuple(SCENARIOS)


def compare_on_real_motion(options: Options) -> Section:
    """Make the section; where the data is absent, it only names what is missing."""
    title = "(i) Recorded motion (rules of today)"
    if not options.folder.is_dir():
        return Section(title, (f"Skipped: {options.folder.name} is not there.",))
    library = load_library(options.folder, options.arm)
    checks = [check_generator(library, device, options.minutes) for device in DEVICES]
    rows = []
    for key in options.only:
        print(f"{SCENARIOS[key].name} ...", file=sys.stderr, flush=True)
        found = run_scenario(library, SCENARIOS[key], options)
        rows += [_draw(SCENARIOS[key].name, device, scores) for device, scores in found.items()]
    clips = len(list(options.folder.glob("cmu_*.npz")))
    prose = PROSE.format(
        minutes=options.minutes,
        clips=clips,
        arms={"l": "left", "r": "right"}[options.arm],
        shifts=options.shifts,
        first=SEED,
        last=SEED + options.shifts - 1,
    )
    return Section(title, (prose, draw_table(HEADER, rows), _draw_checks(checks)))


def run_scenario(library: Library, scenario: Scenario, options: Options) -> dict[Device, list[Scored]]:
    """Every shift of a scenario on both devices."""
    found: dict[Device, list[Scored]] = {device: [] for device in DEVICES}
    for seed in range(SEED, SEED + options.shifts):
        made = make_shift(library, scenario, options.minutes, seed)
        for device in DEVICES:
            worn = wear(made, device, seed, slip_deg=scenario.slip_deg)
            found[device].append(score(worn, is_asked=scenario.is_asked))
    return found


HEADER = (
    "scenario",
    "device",
    "RMSE deg, median (worst)",
    "30 deg bin, points, worst",
    "dropped s",
    "held",
    "axis deg",
    "in ranges",
    "width, points",
    "caveats",
)


def _draw(name: str, device: Device, every: Sequence[Scored]) -> list[str]:
    codes = Counter(
        code for one in every for code in (*one.codes, one.refused) if code not in {"", *EXPECTED}
    )
    scores = [one for one in every if not one.refused] or [Scored()]
    rmse_deg = [one.rmse_deg for one in scores]
    held = [one.is_held for one in scores if one.is_held is not None]
    return [
        name,
        NAMES[device],
        f"{np.median(rmse_deg):.2f} ({max(rmse_deg):.2f})",
        f"{max(one.bin_points for one in scores):.2f}",
        ", ".join(f"{one.dropped_s:.0f}" for one in scores),
        f"{held.count(True)}/{len(held)}" if held else "-",
        f"{max(one.axis_deg for one in scores):.1f}",
        f"{sum(one.within for one in scores)}/{sum(one.figures for one in scores)}",
        f"{np.mean([one.width_points for one in scores]):.1f}",
        ", ".join(f"{code} {count}" for code, count in sorted(codes.items())) or "none",
    ]


def _draw_checks(checks: Sequence[Checked]) -> str:
    rows = [[NAMES[one.device], f"{one.rmse_deg:.3f}", f"{one.rest_g:.4f}"] for one in checks]
    return draw_table(("perfect sensor, known axis", "RMSE deg", "g at rest"), rows)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.real_motion")
    parser.add_argument("--shifts", type=int, default=4)
    parser.add_argument("--minutes", type=float, default=40.0)
    parser.add_argument("--arm", choices=("l", "r"), default="l")
    parser.add_argument("--only", nargs="+", choices=tuple(SCENARIOS), default=tuple(SCENARIOS))
    parser.add_argument("--data", type=Path, default=DATA)
    given = parser.parse_args()
    options = Options(given.data, given.shifts, given.minutes, given.arm, tuple(given.only))
    section = compare_on_real_motion(options)
    print("\n\n".join([f"## {section.title}", *section.paragraphs]))


if __name__ == "__main__":
    main()
