"""What a person states about the pose, and what is made of it, on recorded motion.

    python -m benchmarks.validation.stated --log FILE [--only KEY ...] [--seeds N]

Days of eight hours: an opening, an hour of work that is repeated, and what happens at noon. Three kinds of
day: seated work without walking (the skin plates of ``skin_motion``, as measured and fixed to the arm), work
with walking, and work in which loads are carried with the arm raised (CMU, rigid). Both devices, 25 Hz.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.validation.document import draw_table
from benchmarks.validation.real_clips import STRIDE_TURN_S, Clip, Track, feel, load_library
from benchmarks.validation.skin_clips import Strap, load_skin_library
from benchmarks.validation.worn import DEVICES, find_rmse_deg
from fusion.conventions import CalibrationState
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import FusionError
from fusion.exposure import Exposure, summarise_exposure
from fusion.numerics.rotations import find_angle_deg
from fusion.pipeline import Analysis, analyse
from fusion.quality import Verdict
from fusion.recording import MICROSECONDS, Float64Array, Recording, Segment
from fusion.settings import AnalysisSettings
from fusion.simulation.body import ArmState
from fusion.simulation.sensor import PARTS, Device, draw_errors, quantise, sense
from fusion.simulation.shift import START

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
Kind = Literal["skin", "seated", "walking", "carrying"]
KINDS: Mapping[Kind, str] = {
    "skin": "seated, sensor on the skin",
    "seated": "seated, rigid",
    "walking": "with walking, rigid",
    "carrying": "loads carried with the arm raised, rigid",
}
Stated = Literal["nothing", "held", "window"]

RATE_HZ, HOUR_S, HOURS = 25.0, 3600.0, 8
POSE_S, NEW_POSE_S, STRAP_ON_S, OFF_S, SEAM_S = 10.0, 20.0, 12.0, 1200.0, 0.6
CARRIED_DEG = 50.0
PAUSE_S, PAUSE_SHARE, PAUSE_SD_DEG = (6.0, 20.0), 0.15, 5.0
WALK_S, WALK_SHARE = (30.0, 90.0), 0.35
SLIP_S, TURNED_DEG = 0.5, (50.0, 120.0)
FIGURE_PERCENTS = (10, 50, 90)
LARGEST_DEG: Mapping[Kind, float] = {"skin": 6.0, "seated": 3.0, "walking": 3.0, "carrying": 3.0}
"""A result that is called good is not further from the truth than this, root mean square."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One row: ``table_s`` on a table, ``work_s`` of work before the pose, or no pose at all.

    ``slip_deg``: the sensor slips at noon; ``is_off``: it lies off at noon and is put back turned, with a new
    pose; ``names_new``: the person names that pose too.
    """

    name: str
    kinds: tuple[Kind, ...] = ("skin", "seated", "walking", "carrying")
    stated: Stated = "nothing"
    table_s: float = 0.0
    work_s: float = 0.0
    has_pose: bool = True
    slip_deg: float = 0.0
    is_off: bool = False
    names_new: bool = False


SCENARIOS: Mapping[str, Scenario] = {
    "pose": Scenario("pose held in the first 10 s, nothing said"),
    "pose-held": Scenario("the same, held at the start said", stated="held"),
    "pose-window": Scenario("the same, window given", stated="window"),
    **{
        f"table{table_s}": Scenario(
            f"{table_s} s on a table, then the pose", ("skin", "walking"), table_s=table_s
        )
        for table_s in (8, 20, 40, 120)
    },
    **{
        f"table{table_s}-held": Scenario(
            f"{table_s} s on a table, then the pose, held said", ("skin", "walking"), "held", table_s
        )
        for table_s in (8, 20, 40, 120)
    },
    **{
        f"work{work_s}": Scenario(f"{work_s} s of work, then the pose", ("skin", "walking"), work_s=work_s)
        for work_s in (20, 60, 120, 300)
    },
    **{
        f"cut{place}": Scenario(f"no pose, cut at place {place}", ("skin", "walking"), has_pose=False)
        for place in range(1, 7)
    },
    "slip20": Scenario("slip of 20 deg, window given", stated="window", slip_deg=20.0),
    "slip45": Scenario("slip of 45 deg, window given", stated="window", slip_deg=45.0),
    "slip45-nothing": Scenario("slip of 45 deg, nothing said", slip_deg=45.0),
    "lunch": Scenario("off at noon, put back turned, new pose, nothing said", is_off=True),
    "lunch-held": Scenario("the same, held at the start said", stated="held", is_off=True),
    "lunch-window": Scenario("the same, both windows given", stated="window", is_off=True, names_new=True),
}  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A stretch of motion that begins and ends with the arm hanging at rest; its poses, s from its start."""

    state: ArmState
    poses_s: tuple[tuple[float, float], ...] = ()
    worn_from_s: float = 0.0

    @property
    def length_s(self) -> float:
        """How long it lasts."""
        return len(self.state.elevation_deg) / RATE_HZ


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """What one person does: work, steps, and how a plate lies on the skin, if one was measured."""

    work: list[Clip]
    strides: list[Clip]
    strap: Strap | None


@lru_cache(maxsize=16)
def load_person(kind: Kind, seed: int) -> Person:
    """Return the person of a seed: four seated ones, or one of the walkers with everybody's work."""
    if kind in {"skin", "seated"}:
        people = load_skin_library(DATA / "skin_motion", is_rigid=kind == "seated")
        clips = people[sorted(people)[seed % len(people)]]
        return Person(clips, [], Strap(clips))
    library = load_library(DATA / "real_motion", "l")
    strides = library.strides[sorted(library.strides)[seed % len(library.strides)]]
    return Person([clip for name in sorted(library.work) for clip in library.work[name]], strides, None)


def raise_arm(clip: Clip) -> Clip:
    """Return a walk in which the arm carries a load before the body."""
    return replace(clip, turn=clip.turn * Rotation.from_rotvec([np.radians(CARRIED_DEG), 0.0, 0.0]))


class Choreography:
    """A track that begins and ends with the arm hanging."""

    def __init__(self, person: Person, chance: np.random.Generator) -> None:
        self.person, self.chance = person, chance
        self.track = Track(chance, strap=person.strap)
        self.poses_s: list[tuple[float, float]] = []

    def hang(self, seconds: float) -> tuple[float, float]:
        """Hold the arm plumb."""
        return self.track.hold(Rotation.identity(), seconds)

    def pose(self, seconds: float = POSE_S) -> None:
        """Hold the pose."""
        self.poses_s.append(self.hang(seconds))

    def strap_on(self) -> None:
        """Move without a pause while the sensor is strapped on."""
        until_s = self.track.length_s + STRAP_ON_S
        while self.track.length_s < until_s:
            self.track.go_on_with_nearest(self.person.work)

    def work(self, until_s: float, *, is_carrying: bool = False) -> None:
        """Work, walk and pause."""
        while self.track.length_s < until_s:
            if self.person.strides and self.chance.random() < WALK_SHARE:
                self._walk(min(until_s, self.track.length_s + self.chance.uniform(*WALK_S)), is_carrying)
                continue
            self.track.go_on_with_nearest(self.person.work)
            if self.chance.random() < PAUSE_SHARE:
                spread = np.radians(PAUSE_SD_DEG) * self.chance.standard_normal(2)
                turn = Rotation.from_rotvec([*spread, 0.0]) * self.track.now
                self.track.hold(turn, float(self.chance.uniform(*PAUSE_S)))

    def _walk(self, until_s: float, is_carrying: bool) -> None:  # noqa: FBT001
        steps = [raise_arm(clip) for clip in self.person.strides] if is_carrying else self.person.strides
        self.track.go_on_with_nearest(steps)
        while self.track.length_s < until_s:
            self.track.go_on(steps[int(self.chance.integers(len(steps)))], STRIDE_TURN_S)

    def finish(self, worn_from_s: float = 0.0) -> Piece:
        """End with the arm hanging, and feel what a sensor does."""
        self.hang(SEAM_S)
        return Piece(feel(self.track.join(), RATE_HZ), tuple(self.poses_s), worn_from_s)


@lru_cache(maxsize=12)
def work_an_hour(kind: Kind, seed: int, *, is_late: bool = False) -> Piece:
    """Return an hour of work, which a day repeats; of carriers, loads are carried after noon."""
    choreography = Choreography(load_person(kind, seed), np.random.default_rng([seed, 1, is_late]))
    choreography.hang(SEAM_S)
    choreography.work(HOUR_S, is_carrying=kind == "carrying" and is_late)
    return choreography.finish()


def open_day(scenario: Scenario, kind: Kind, seed: int) -> Piece:
    """Return what comes before the first hour."""
    chance = np.random.default_rng([seed, 2, round(scenario.table_s), round(scenario.work_s)])
    choreography = Choreography(load_person(kind, seed), chance)
    worn_from_s = 0.0
    if scenario.table_s:
        choreography.track.hold(Rotation.from_rotvec([np.radians(90.0), 0.0, 0.0]), scenario.table_s, 0.0)
        choreography.strap_on()
        worn_from_s = choreography.track.length_s
    if scenario.work_s:
        choreography.hang(SEAM_S)
        choreography.work(scenario.work_s)
    choreography.pose()
    return choreography.finish(worn_from_s)


def put_back(kind: Kind, seed: int) -> tuple[Piece, Piece]:
    """Return the sensor on a table at noon, and the new pose after it."""
    off = Choreography(load_person(kind, seed), np.random.default_rng([seed, 3]))
    off.track.hold(Rotation.from_rotvec([np.radians(90.0), 0.0, 0.0]), OFF_S, 0.0)
    again = Choreography(load_person(kind, seed), np.random.default_rng([seed, 4]))
    again.hang(SEAM_S)
    again.strap_on()
    again.pose(NEW_POSE_S)
    return off.finish(), again.finish()


@dataclass(frozen=True, slots=True, eq=False)
class WornDay:
    """A recording, the truth and where it was worn, both (n,), the pose windows, and the first axis (3,)."""

    recording: Recording
    truth_deg: Float64Array
    worn: NDArray[np.bool_]
    poses_s: tuple[tuple[float, float], ...]
    arm_axis: Float64Array


def wear_day(scenario: Scenario, kind: Kind, device: Device, seed: int, place: int = 0) -> WornDay:
    """Put a day together and read it with a specimen of the device."""
    early, late = work_an_hour(kind, seed), work_an_hour(kind, seed, is_late=True)
    morning = [early] * (HOURS // 2)
    if scenario.has_pose:
        morning.insert(0, open_day(scenario, kind, seed))
    noon = list(put_back(kind, seed)) if scenario.is_off else []
    pieces = [*morning, *noon, *[late] * (HOURS // 2)]
    starts_s = np.concatenate([[0.0], np.cumsum([piece.length_s for piece in pieces])])
    state = ArmState(
        np.concatenate([piece.state.acc_g for piece in pieces]),
        np.concatenate([piece.state.gyr_dps for piece in pieces]),
        np.zeros((1, 3)),
        np.concatenate([piece.state.elevation_deg for piece in pieces]),
    )
    time_s = np.arange(len(state.elevation_deg)) / RATE_HZ
    worn = time_s >= pieces[0].worn_from_s
    chance = np.random.default_rng([seed, 5])
    turn_deg, noon_s = scenario.slip_deg, float(starts_s[len(morning)])
    if scenario.is_off:
        turn_deg = chance.uniform(*TURNED_DEG)
        worn &= (time_s < noon_s) | (time_s >= starts_s[len(morning) + 1] + STRAP_ON_S)
    state = _turn_sensor(state, time_s, noon_s, turn_deg, chance)
    poses_s = [
        (float(start_s + first), float(start_s + last))
        for piece, start_s in zip(pieces, starts_s, strict=False)
        for first, last in piece.poses_s
    ]
    first = 0 if scenario.has_pose else round((0.1 + 0.15 * place) * HOUR_S * RATE_HZ)
    return _read(state, time_s, first, device, seed, worn, tuple(poses_s))


def _turn_sensor(
    state: ArmState, time_s: Float64Array, at_s: float, angle_deg: float, chance: np.random.Generator
) -> ArmState:
    """Turn the sensor about a direction across the arm, within half a second."""
    about = chance.uniform(0.0, 2.0 * np.pi)
    across = np.array([np.cos(about), np.sin(about), 0.0])
    way = np.clip((time_s - at_s) / SLIP_S, 0.0, 1.0)
    turning = Rotation.from_rotvec(np.radians(angle_deg) * way[:, None] * across)
    slip_dps = np.where((way > 0.0) & (way < 1.0), angle_deg / SLIP_S, 0.0)[:, None] * across
    return replace(state, acc_g=turning.apply(state.acc_g), gyr_dps=turning.apply(state.gyr_dps) - slip_dps)


def _read(  # noqa: PLR0917
    state: ArmState,
    time_s: Float64Array,
    first: int,
    device: Device,
    seed: int,
    worn: NDArray[np.bool_],
    poses_s: tuple[tuple[float, float], ...],
) -> WornDay:
    part, chance = PARTS[device], np.random.default_rng([seed, 6])
    errors = draw_errors(part, RATE_HZ, time_s[-1], chance)
    readings = sense(state, errors, time_s, chance)
    acc = quantise(readings.acc_g, part.acc_g_per_lsb, part.acc_range_g)[first:] * np.float32(
        part.acc_g_per_lsb
    )
    gyr = quantise(readings.gyr_dps, part.gyr_dps_per_lsb, part.gyr_range_dps)[first:] * np.float32(
        part.gyr_dps_per_lsb
    )
    segment = Segment(0, RATE_HZ, acc.astype(np.float32), gyr.astype(np.float32))
    duration_us = round(len(segment) / RATE_HZ * MICROSECONDS)
    recording = Recording(
        device, "0" * 64, START, None, duration_us, (segment,),
        acc_range_g=part.acc_range_g, gyr_range_dps=part.gyr_range_dps,
    )  # fmt: skip
    axis = errors.mounting @ np.array([0.0, 0.0, 1.0])
    return WornDay(recording, state.elevation_deg[first:], worn[first:], poses_s, axis)


# Scores


@dataclass(frozen=True, slots=True)
class Scored:
    """One analysis against its truth; ``refused``: the code of the error."""

    key: str
    kind: Kind
    device: Device
    seed: int
    refused: str = ""
    state: CalibrationState = "none"
    verdict: Verdict = "poor"
    rmse_deg: float = np.nan
    cut_s: float = np.nan
    axis_deg: float = np.nan
    is_held: bool = False
    inside: tuple[bool, ...] = ()
    widths: tuple[float, ...] = ()
    codes: tuple[str, ...] = ()


def choose_settings(scenario: Scenario, day: WornDay) -> AnalysisSettings:
    """Return what the person says."""
    if scenario.stated == "held":
        return AnalysisSettings(pose_held="start")
    if scenario.stated == "nothing":
        return AnalysisSettings()
    poses_s = day.poses_s if scenario.names_new else day.poses_s[:1]
    return AnalysisSettings(calibration_windows_s=tuple((a + 1.0, b - 1.0) for a, b in poses_s))


def score(scenario: Scenario, key: str, kind: Kind, device: Device, seed: int) -> Scored:
    """Analyse one day as an uploaded recording is, and compare."""
    place = int(key.removeprefix("cut")) if key.startswith("cut") else 0
    day = wear_day(scenario, kind, device, seed, place)
    begun = Scored(key, kind, device, seed)
    try:
        analysis = analyse(day.recording, choose_settings(scenario, day))
    except FusionError as error:
        return replace(begun, refused=error.code)
    (found,) = analysis.elevation.segments
    rows = found.valid & day.worn
    calibration = analysis.calibration
    assert calibration is not None
    truth = ElevationSegment(0, found.rate_hz, day.truth_deg.astype(np.float32), found.valid)
    true = (
        summarise_exposure(Elevation((truth,), None))
        if key.startswith("lunch")
        else summarise_exposure(Elevation((replace(truth, valid=rows),), None))
    )
    return replace(
        begun,
        state=calibration.state,
        verdict=analysis.quality.verdict,
        rmse_deg=find_rmse_deg((found.elevation_deg - day.truth_deg)[rows]),
        cut_s=float((day.worn & ~found.valid).sum() / found.rate_hz),
        axis_deg=find_angle_deg(calibration.arm_axis, day.arm_axis),
        is_held=_is_held(analysis, day.poses_s[:1]),
        inside=tuple(_list_inside(analysis.exposure, true)),
        widths=tuple(high - low for low, high in list_ranges(analysis.exposure)),
        codes=tuple(sorted({str(flag.code) for flag in analysis.quality.flags})),
    )


def _is_held(analysis: Analysis, poses_s: Sequence[tuple[float, float]]) -> bool:
    windows = analysis.calibration.windows if analysis.calibration else ()
    return any(
        still.start_s >= start_s - 1.5 and still.end_s <= end_s + 1.5
        for still in windows[:1]
        for start_s, end_s in poses_s
    )


def list_figures(exposure: Exposure) -> list[float]:
    """Return time above 30, 60, 90 deg, P10, P50 and P90."""
    above = [part.percent for part in exposure.time_above]
    return [*above, *(exposure.percentiles_deg[percent] for percent in FIGURE_PERCENTS)]


def list_ranges(exposure: Exposure) -> list[tuple[float, float]]:
    """Return the ranges of the same figures; one without a range holds itself alone."""
    found = [part.interval for part in exposure.time_above]
    found += [exposure.intervals.get(f"elevation_p{percent}_deg") for percent in FIGURE_PERCENTS]
    pairs = zip(found, list_figures(exposure), strict=True)
    return [(own, own) if one is None else (one.low, one.high) for one, own in pairs]


def _list_inside(exposure: Exposure, true: Exposure) -> Iterator[bool]:
    for (low, high), figure in zip(list_ranges(exposure), list_figures(true), strict=True):
        yield low <= figure <= high


# Running and drawing


def run(keys: Sequence[str], seeds: Sequence[int], log: Path | None = None) -> Iterator[Scored]:
    """Yield every scenario of every seed, kind and device; a day that stands in ``log`` is not run again."""
    lines = log.read_text("utf-8").splitlines() if log and log.exists() else []
    known = {(one.key, one.kind, one.device, one.seed): one for one in map(_read_scored, lines)}
    for seed in seeds:
        for kind in KINDS:
            for key in keys:
                scenario = SCENARIOS[key]
                if kind not in scenario.kinds:
                    continue
                for device in DEVICES:
                    one = known.get((key, kind, device, seed)) or score(scenario, key, kind, device, seed)
                    if log and (key, kind, device, seed) not in known:
                        with log.open("a", encoding="utf-8") as file:
                            file.write(json.dumps(asdict(one)) + "\n")
                    yield one
        print(f"seed {seed}", file=sys.stderr, flush=True)


def _read_scored(line: str) -> Scored:
    stored = json.loads(line)
    listed = {name: tuple(value) for name, value in stored.items() if isinstance(value, list)}
    return Scored(**{**stored, **listed})


HEADER = (
    "scenario", "days", "state", "held pose used", "verdict good / care / poor", "good but wrong",
    "RMSE deg, median (worst)", "truth in ranges %", "width above 60, points", "cut s, most", "asked",
)  # fmt: skip


def draw(scores: Sequence[Scored]) -> list[str]:
    """Return a table for each kind of day."""
    tables = []
    for kind, name in KINDS.items():
        rows = [
            _draw(key, [one for one in scores if (one.key, one.kind) == (key, kind)]) for key in SCENARIOS
        ]
        tables.append(f"#### Days {name}\n\n" + draw_table(HEADER, [row for row in rows if row]))
    return tables


def _draw(key: str, days: Sequence[Scored]) -> list[str]:
    found = [day for day in days if not day.refused]
    if not found:
        return []
    states = Counter(day.state for day in found)
    verdicts = Counter(day.verdict for day in found)
    wrong = sum(day.verdict == "good" and day.rmse_deg > LARGEST_DEG[day.kind] for day in found)
    asked = Counter(code for day in found for code in day.codes if code in ASKING)
    refused = Counter(day.refused for day in days if day.refused)
    return [
        SCENARIOS[key].name,
        str(len(days)),
        ", ".join(f"{state} {count}" for state, count in states.items()),
        f"{sum(day.is_held for day in found)}",
        f"{verdicts['good']} / {verdicts['caution']} / {verdicts['poor']}",
        str(wrong),
        f"{np.median([day.rmse_deg for day in found]):.2f} ({max(day.rmse_deg for day in found):.2f})",
        f"{100.0 * np.mean([each for day in found for each in day.inside]):.1f}",
        f"{np.median([day.widths[1] for day in found]):.1f}",
        f"{max(day.cut_s for day in found):.0f}",
        ", ".join(f"{code} {count}" for code, count in [*asked.items(), *refused.items()]) or "none",
    ]


ASKING = frozenset({
    "W-POSE-ASSUMED", "W-WHICH-POSE", "W-NOT-HELD", "W-POSE-UNSTEADY", "W-POSE-DOUBT", "W-NO-STILL", "W-SLIP",
    "W-PUT-BACK", "W-POSES-DIFFER", "W-REMOUNT",
})  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.stated")
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--only", nargs="+", default=tuple(SCENARIOS))
    parser.add_argument("--log", type=Path)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    print("\n\n".join(draw(list(run(given.only, seeds, given.log)))))


if __name__ == "__main__":
    main()
