"""The scenarios of the pose: what a person does with it, what is made of it, and whether the goal is met.

Recorded motion (``real_motion``) and simulated days (``simulated_days``) run the same table.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.validation.document import draw_table
from benchmarks.validation.worn import DEVICES, NAMES, find_rmse_deg
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import FusionError
from fusion.exposure import Exposure, summarise_exposure
from fusion.exposure.bins import CELLS_PER_DEG
from fusion.numerics.rotations import find_angle_deg
from fusion.pipeline import Analysis, analyse
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, Recording, Segment
from fusion.settings import AnalysisSettings
from fusion.simulation.body import ArmState
from fusion.simulation.sensor import (
    PARTS,
    Device,
    SensorErrors,
    draw_errors,
    quantise,
    sense,
)
from fusion.simulation.shift import START, Course

Given = Literal["nothing", "window", "axis"]
Goal = Literal["as A", "inside", "found", "quiet", "two deg", "ranges of A", "none"]

AWAY_DEG, DESK_S, TABLE_S, AXIS_WITHIN_DEG = 8.0, 300.0, 30.0, 8.0
REPEAT_DEG, OWN_REPEAT_DEG = 1.0, 3.0
SLIP_AT, BETWEEN_AT, SLIP_S = 0.5, 0.3, 0.5
SLIPS_DEG = (20.0, 45.0, 90.0)
POSE_SLACK_S, BIN_DEG = 1.5, 30
FIGURE_PERCENTS = (10, 50, 90)
RMSE_DEG, BIN_POINTS, SLIPPED_DEG, REPEATED_DEG, SAME_RANGE = 1.0, 1.0, 3.0, 2.0, 0.5
DROPPED_S = 5.0
"""A second here and there is left out where a device clips or an angle is not trusted, whatever the pose."""
ASKED, NO_STILL, REMOUNTED = "W-WHICH-POSE", "W-NO-STILL", "W-REMOUNT"
ALARMS = frozenset({ASKED, NO_STILL, REMOUNTED, "W-POSE-DOUBT", "W-POSES-DIFFER"})


PLUMB = Course()


@dataclass(frozen=True, slots=True)
class Scenario:
    """One row of the table.

    Attributes
    ----------
    course
        What the pose is like.
    slip_deg, slip_at
        Turn of the sensor across the arm, at a share of the day; ``slip_deg`` None: drawn from ``SLIPS_DEG``.
    given
        What the person names: nothing, the window of the pose, or the axis.
    goal, caveat
        What is asked of it, and the caveat that must be there.
    some_walk
        Only a quarter of the days is without walking, whatever the course says of it.
    """

    name: str
    course: Course = PLUMB
    slip_deg: float | None = 0.0
    slip_at: float = SLIP_AT
    given: Given = "nothing"
    goal: Goal = "as A"
    caveat: str = ""
    some_walk: bool = False

    def find_course(self, seed: int) -> Course:
        """The course of one day of this scenario."""
        is_quarter = self.some_walk and seed % 8 in {1, 2}
        return replace(self.course, walks=False) if is_quarter else self.course


REPEATED = Course(is_repeated=True, repeat_deg=REPEAT_DEG)
SCENARIOS: Mapping[str, Scenario] = {
    "A": Scenario("A pose plumb at the start"),
    "B": Scenario("B pose 8 deg off", Course(tilt_deg=AWAY_DEG), goal="inside"),
    "C": Scenario("C nothing still in ten minutes", Course("none"), goal="inside", caveat=NO_STILL),
    "C2": Scenario("C2 only idle stances", Course("idle"), goal="none"),
    "D": Scenario("D two minutes first, pauses in the second", Course("late"), goal="inside", caveat=ASKED),
    "D1": Scenario("D with a pause in the first minute", Course("paused"), goal="none"),
    "D2": Scenario("D, the window given", Course("late"), given="window"),
    "E": Scenario("E five minutes on a table first", Course(table_s=DESK_S)),
    "E2": Scenario("E2 30 s on a table first", Course(table_s=TABLE_S), goal="none"),
    "E3": Scenario("E2 without walking", Course(table_s=TABLE_S, walks=False), goal="none"),
    "F20": Scenario("F slip of 20 deg", slip_deg=20.0, goal="none"),
    "F45": Scenario("F slip of 45 deg", slip_deg=45.0, goal="found"),
    "F90": Scenario("F slip of 90 deg", slip_deg=90.0, goal="found"),
    "G": Scenario("G no slip, a quarter without walking", some_walk=True, goal="quiet"),
    "H": Scenario("H pose repeated, a slip between", REPEATED, None, BETWEEN_AT, "window", "two deg"),
    "H2": Scenario(
        "H without walking", replace(REPEATED, walks=False), None, BETWEEN_AT, "window", "two deg"
    ),
    "H3": Scenario("H no slip", REPEATED, given="window", goal="two deg"),
    "H4": Scenario(
        "H as people repeat a stance", replace(REPEATED, repeat_deg=OWN_REPEAT_DEG), None, BETWEEN_AT,
        "window", "none",
    ),
    "I": Scenario("I the axis given, within 8 deg", Course("none"), given="axis", goal="inside"),
    "J": Scenario("J as A, the window given", given="window", goal="ranges of A"),
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Made:
    """A day's motion as an ideal sensor feels it.

    ``poses_s``: when poses are held; ``table_s``: until when the sensor lies on a table; ``is_seen``: whether
    the person walks as most people do, and not briskly.
    """

    rate_hz: float
    state: ArmState
    poses_s: tuple[tuple[float, float], ...]
    table_s: float = 0.0
    is_seen: bool = True


Maker = Callable[[Course, int], Made]


@dataclass(frozen=True, slots=True, eq=False)
class WornDay:
    """A recording, its truth and where it was worn, both (n,), and the arm's axis in the sensor, (3,)."""

    made: Made
    recording: Recording
    truth_deg: Float64Array
    worn: BoolArray
    arm_axis: Float64Array


@dataclass(frozen=True, slots=True)
class Scored:
    """One analysis against its truth; ``refused``: the error's code; ``is_held`` None: no pose is held."""

    key: str
    device: Device
    seed: int
    is_seen: bool = True
    refused: str = ""
    rmse_deg: float = np.nan
    bin_points: float = np.nan
    dropped_s: float = np.nan
    worn_s: float = np.nan
    is_held: bool | None = None
    axis_deg: float = np.nan
    sigma_deg: float = np.nan
    inside: tuple[bool, ...] = ()
    ranges: tuple[tuple[float, float], ...] = ()
    found: str = ""
    codes: tuple[str, ...] = ()


# Wearing


@dataclass(frozen=True, slots=True)
class Turn:
    """``angle_deg`` about ``axis`` (arm's frame), from ``start_s`` on, within ``SLIP_S``."""

    angle_deg: float
    axis: NDArray[np.float64]
    start_s: float

    def apply(self, state: ArmState, time_s: NDArray[np.float64]) -> ArmState:
        """What the sensor feels, seen from the frame in which it sat before."""
        first, last = (int(np.searchsorted(time_s, self.start_s + passed_s)) for passed_s in (0.0, SLIP_S))
        acc_g, gyr_dps = state.acc_g.copy(), state.gyr_dps.copy()
        turned = Rotation.from_rotvec(np.radians(self.angle_deg) * self.axis).as_matrix().T
        acc_g[last:], gyr_dps[last:] = acc_g[last:] @ turned, gyr_dps[last:] @ turned
        way = (time_s[first:last, None] - self.start_s) / SLIP_S
        turning = Rotation.from_rotvec(np.radians(self.angle_deg) * way * self.axis)
        acc_g[first:last] = turning.apply(acc_g[first:last])
        slip_dps = self.angle_deg / SLIP_S * self.axis
        gyr_dps[first:last] = turning.apply(gyr_dps[first:last]) - slip_dps
        return replace(state, acc_g=acc_g, gyr_dps=gyr_dps)


def draw_across(chance: np.random.Generator) -> NDArray[np.float64]:
    """A direction across the arm, in its own frame."""
    about = chance.uniform(0.0, 2.0 * np.pi)
    return np.array([np.cos(about), np.sin(about), 0.0])


def wear(made: Made, device: Device, seed: int, scenario: Scenario) -> WornDay:
    """Strap a specimen on and read the motion, rounded and clipped as the device does."""
    part, chance = PARTS[device], np.random.default_rng([seed, 2])
    state = made.state
    time_s = np.arange(len(state.elevation_deg)) / made.rate_hz
    errors = draw_errors(part, made.rate_hz, time_s[-1], chance)
    across = draw_across(chance)
    if scenario.given == "axis":
        errors = _strap_along(errors, chance)
    slip_deg = SLIPS_DEG[seed // 2 % 3] if scenario.slip_deg is None else scenario.slip_deg
    if slip_deg:
        state = Turn(slip_deg, across, time_s[-1] * scenario.slip_at).apply(state, time_s)
    readings = sense(state, errors, time_s, chance)
    acc = quantise(readings.acc_g, part.acc_g_per_lsb, part.acc_range_g).astype(np.float32)
    gyr = quantise(readings.gyr_dps, part.gyr_dps_per_lsb, part.gyr_range_dps).astype(np.float32)
    acc, gyr = acc * np.float32(part.acc_g_per_lsb), gyr * np.float32(part.gyr_dps_per_lsb)
    segment = Segment(0, made.rate_hz, acc, gyr)
    duration_us = round(len(time_s) / made.rate_hz * MICROSECONDS)
    recording = Recording(
        device, "0" * 64, START, None, duration_us, (segment,),
        acc_range_g=part.acc_range_g, gyr_range_dps=part.gyr_range_dps,
    )  # fmt: skip
    axis = errors.mounting @ np.array([0.0, 0.0, 1.0])
    return WornDay(made, recording, made.state.elevation_deg, time_s >= made.table_s, axis)


def _strap_along(errors: SensorErrors, chance: np.random.Generator) -> SensorErrors:
    """Strap the sensor on with its y axis along the arm, as well as its wearer knows it."""
    along = errors.mounting @ np.array([0.0, 0.0, 1.0])
    off_deg, about = chance.uniform(0.0, AXIS_WITHIN_DEG), chance.uniform(0.0, 2.0 * np.pi)
    wanted = np.array([0.0, 1.0, 0.0])
    wanted = Rotation.from_rotvec(np.radians(off_deg) * np.array([np.cos(about), 0.0, np.sin(about)])).apply(
        wanted
    )
    turn, _ = Rotation.align_vectors(wanted[None], along[None])
    return replace(errors, mounting=turn.as_matrix() @ errors.mounting)


# Scores


def score(worn: WornDay, key: str, device: Device, seed: int) -> Scored:
    """Analyse as an uploaded recording is, and compare."""
    scenario, poses_s = SCENARIOS[key], worn.made.poses_s
    begun = Scored(key, device, seed, worn.made.is_seen)
    try:
        analysis = analyse(worn.recording, _choose_settings(scenario.given, poses_s))
    except FusionError as error:
        return replace(begun, refused=error.code)
    (found,) = analysis.elevation.segments
    rows = found.valid & worn.worn
    codes = tuple(sorted({flag.code for flag in analysis.quality.flags}))
    dropped_s = float((worn.worn & ~found.valid).sum() / found.rate_hz)
    begun = replace(
        begun, dropped_s=dropped_s, worn_s=float(worn.worn.sum() / found.rate_hz), codes=codes,
        is_held=_is_held(analysis, poses_s), axis_deg=_find_axis_error(analysis, worn),
        sigma_deg=analysis.calibration.sigma_deg if analysis.calibration else np.nan,
        found=analysis.calibration.state if analysis.calibration else "",
    )  # fmt: skip
    if not rows.any():
        return replace(begun, refused="nothing valid")
    truth = ElevationSegment(0, found.rate_hz, worn.truth_deg.astype(np.float32), rows)
    true_exposure = summarise_exposure(Elevation((truth,), None))
    ours = summarise_exposure(Elevation((replace(found, valid=rows),), None))
    ranges = tuple(_list_ranges(analysis.exposure))
    figures = _list_figures(true_exposure)
    return replace(
        begun,
        rmse_deg=find_rmse_deg((found.elevation_deg - worn.truth_deg)[rows]),
        bin_points=float(np.abs(_share_bins(ours) - _share_bins(true_exposure)).max()),
        inside=tuple(low <= true <= high for (low, high), true in zip(ranges, figures, strict=True)),
        ranges=ranges,
    )


def _choose_settings(given: Given, poses_s: Sequence[tuple[float, float]]) -> AnalysisSettings:
    if given == "axis":
        return AnalysisSettings(arm_axis="+y")
    windows_s = tuple((start_s + 1.0, end_s - 1.0) for start_s, end_s in poses_s)
    return AnalysisSettings(calibration_windows_s=windows_s if given == "window" else ())


def _is_held(analysis: Analysis, poses_s: Sequence[tuple[float, float]]) -> bool | None:
    """Whether the window that was used lies in a held pose."""
    if analysis.calibration is None or not poses_s:
        return None
    if not analysis.calibration.windows:
        return False
    still = analysis.calibration.windows[0]
    end_s = still.start_s + still.duration_s
    return any(
        still.start_s >= pose_s[0] - POSE_SLACK_S and end_s <= pose_s[1] + POSE_SLACK_S for pose_s in poses_s
    )


def _find_axis_error(analysis: Analysis, worn: WornDay) -> float:
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


# Goals


def is_met(one: Scored, reference: Scored | None) -> bool | None:
    """Whether a day meets its scenario's goal; ``reference``: the day of A. None: there is no goal.

    The goal of truth inside the ranges is one of all days together: here, that the caveat is there.
    """
    scenario = SCENARIOS[one.key]
    if one.refused or scenario.goal == "none":
        return None if scenario.goal == "none" else False
    is_quiet = one.dropped_s <= DROPPED_S and not ALARMS & set(one.codes)
    is_exact = one.rmse_deg <= RMSE_DEG and one.bin_points <= BIN_POINTS and one.is_held is not False
    met: dict[Goal, bool] = {
        "as A": is_quiet and is_exact,
        "inside": not scenario.caveat or scenario.caveat in one.codes,
        "found": REMOUNTED in one.codes and one.rmse_deg <= SLIPPED_DEG,
        "quiet": is_quiet,
        "two deg": one.rmse_deg <= REPEATED_DEG,
        "ranges of A": reference is not None and _compare_ranges(one, reference) <= SAME_RANGE,
    }
    return met[scenario.goal]


def _compare_ranges(one: Scored, reference: Scored) -> float:
    """Largest difference between bounds, points or deg."""
    if not one.ranges or not reference.ranges:
        return np.inf
    return float(np.abs(np.array(one.ranges) - np.array(reference.ranges)).max())


# Running


def run(maker: Maker, keys: Sequence[str], seeds: Sequence[int], log: Path | None = None) -> Iterator[Scored]:
    """Every scenario of every seed on both devices; a day that stands in ``log`` is not run again.

    Scenarios of one course share its motion.
    """
    known = {(one.key, one.device, one.seed): one for one in (read_log(log) if log else ())}
    for seed in seeds:
        made: dict[Course, Made] = {}
        for key in keys:
            scenario = SCENARIOS[key]
            course = scenario.find_course(seed)
            for device in DEVICES:
                if (key, device, seed) in known:
                    yield known[key, device, seed]
                    continue
                if course not in made:
                    made[course] = maker(course, seed)
                one = score(wear(made[course], device, seed, scenario), key, device, seed)
                if log:
                    with log.open("a", encoding="utf-8") as lines:
                        lines.write(json.dumps(asdict(one)) + "\n")
                yield one
        print(f"seed {seed}", file=sys.stderr, flush=True)


def read_log(log: Path) -> list[Scored]:
    """The days that an earlier run has scored."""
    lines = log.read_text("utf-8").splitlines() if log.exists() else []
    return [_read_scored(json.loads(line)) for line in lines]


def _read_scored(fields: dict[str, object]) -> Scored:
    ranges = fields.pop("ranges")
    assert isinstance(ranges, list)
    pairs = tuple((float(low), float(high)) for low, high in ranges)
    listed = {name: tuple(value) for name, value in fields.items() if isinstance(value, list)}
    return Scored(**{**fields, **listed, "ranges": pairs})  # type: ignore[arg-type]


# Drawing


HEADER = (
    "scenario",
    "days meeting the goal",
    "in ranges %",
    "width, points",
    "RMSE deg, median (worst)",
    "bin, points, worst",
    "valid %, least",
    "held",
    "axis deg, worst",
    "caveats",
)


def draw(scores: Sequence[Scored]) -> str:
    """One row a scenario; GT9X / LSM9DS1 where a cell holds two."""
    reference = {(one.device, one.seed): one for one in scores if one.key == "A"}
    rows = []
    for key, scenario in SCENARIOS.items():
        days = [one for one in scores if one.key == key]
        if not days:
            continue
        if not scenario.slip_deg:
            rows.append(_draw(scenario.name, days, reference))
            continue
        for is_seen, name in ((True, scenario.name), (False, f"{scenario.name}, brisk walkers")):
            some = [one for one in days if one.is_seen == is_seen]
            if some:
                rows.append(_draw(name, some, reference))
    return draw_table(HEADER, rows)


def _draw(name: str, days: Sequence[Scored], reference: Mapping[tuple[Device, int], Scored]) -> list[str]:
    by_device = [[one for one in days if one.device == device] for device in DEVICES]
    cells = [_draw_device(every, reference) for every in by_device if every]
    joined = [" / ".join(dict.fromkeys(pair)) for pair in zip(*cells, strict=True)]
    codes = Counter(code for one in days for code in {*one.codes, one.refused} & {*ALARMS, one.refused})
    caveats = ", ".join(f"{code} {count}" for code, count in sorted(codes.items()) if code)
    return [name, *joined, f"{caveats} of {len(days)}" if caveats else "none"]


def _draw_device(every: Sequence[Scored], reference: Mapping[tuple[Device, int], Scored]) -> list[str]:
    met = [is_met(one, reference.get((one.device, one.seed))) for one in every]
    found = [one for one in every if not one.refused] or [Scored("A", "gt9x", 0)]
    inside = [kept for one in found for kept in one.inside]
    held = [one.is_held for one in found if one.is_held is not None]
    rmse_deg = [one.rmse_deg for one in found]
    widths = [one.ranges[1][1] - one.ranges[1][0] for one in found if one.ranges]
    return [
        "no goal" if met[0] is None else f"{met.count(True)}/{len(met)}",
        f"{100.0 * float(np.mean(inside)):.1f}" if inside else "-",
        f"{np.mean(widths):.1f}" if widths else "-",
        f"{np.median(rmse_deg):.2f} ({max(rmse_deg):.2f})",
        f"{max(one.bin_points for one in found):.2f}",
        f"{100.0 - max(100.0 * one.dropped_s / one.worn_s for one in found):.1f}",
        f"{held.count(True)}/{len(held)}" if held else "-",
        f"{max(one.axis_deg for one in found):.1f}",
    ]


def name_devices() -> str:
    """The devices in the order of the cells."""
    return " / ".join(NAMES[device] for device in DEVICES)
