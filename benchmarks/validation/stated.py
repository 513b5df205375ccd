"""Test the statements that a person can make about the pose, on recorded motion.

    python -m benchmarks.validation.stated --log FILE [--only KEY ...] [--seeds N]

Days of eight hours: an opening, an hour of work that is repeated, and an event at noon. Three kinds of day:
seated work without walking (the skin plates of ``skin_motion``, as measured and fixed to the arm), work with
walking, and work in which loads are carried with the arm raised (CMU, rigid). Both devices, 25 Hz.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from acromion.fusion.conventions import CalibrationState
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import FusionError
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure
from acromion.fusion.numerics import compute_angle_deg
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.quality import Verdict
from acromion.fusion.recording import Float64Array
from acromion.fusion.settings import AnalysisSettings
from acromion.fusion.simulation.body import ArmState
from acromion.fusion.simulation.sensor import Device
from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.real_clips import STRIDE_TURN_S, Clip, Track, compute_readings, load_library
from benchmarks.validation.skin_clips import Strap, load_skin_library
from benchmarks.validation.worn import DEVICES, WornDay, find_rmse_deg, name_devices, record_motion

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
PAUSE_SHARE, WALK_S, WALK_SHARE = 0.15, (30.0, 90.0), 0.35
SLIP_S, TURNED_DEG = 0.5, (50.0, 120.0)
FIGURE_PERCENTS, ABOVE_60 = (10, 50, 90), 1
LARGEST_DEG: Mapping[Kind, float] = {"skin": 6.0, "seated": 3.0, "walking": 3.0, "carrying": 3.0}
"""Largest root mean square error of a result with the verdict "good"."""


PROSE = """\
Eight-hour days of recorded motion, seeds 0 to {last}, {devices} at 25 Hz. A day is an opening, one hour of
work four times, an event at noon (a slip, or lunch), and another hour four times. Seated days are daily tasks
of four people without walking (UE_ADLdatabase, MIT License); on the skin the sensor moves as a plate on the
upper arm did. The other days are the work of two people and the steps of one of two walkers (CMU Graphics
Lab, subjects 01 to 03, left arms; mocap.cs.cmu.edu, free for any use). On days with loads, the arm is raised
by 50 deg in every walk after noon. The pose is held plumb.

*State*: how the pose is known. *Held pose used*: days on which the first held pose is the one in use. *Good
but wrong*: `good` with a root mean square error above 6 deg on the skin, 3 deg on a rigid arm. Errors are
over valid rows while the sensor was worn. *Truth in ranges*: of time above 30, 60, 90 deg, P10, P50 and P90,
the share whose 95 % range includes the truth. *Width*: of the range of time above 60 deg, median. *Cut*: time
worn and left out, most of one day; a device that clips leaves out seconds. *Asked*: days with a question or a
caveat about the pose or a slip.

The limits of the slip question (12 deg, shares of 0.8 and 0.5) and of the sway of a table (0.08 deg/s) were
set on the same motion and on recordings of real sensors. These days are not a blind test of them."""
UNDETECTED_PROSE = """\
A slip has no sign if no question is asked (no `W-SLIP`): no motion before and after it looks like walking. On
seated days, fast work looks like walking. The goals exclude slips without a sign."""


@dataclass(frozen=True, slots=True)
class Scenario:
    """One row. Before the pose: ``table_s`` on a table, ``work_s`` of work; or no pose at all.

    ``slip_deg``: the sensor slips at noon.
    ``is_off``: it is taken off at noon and put back rotated, with a new pose.
    ``names_new``: the person also states that pose.
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
    """A stretch of motion that starts and ends with the arm hanging at rest; its poses, s from its start."""

    state: ArmState
    poses_s: tuple[tuple[float, float], ...] = ()
    worn_from_s: float = 0.0

    @property
    def length_s(self) -> float:
        """Its duration."""
        return len(self.state.elevation_deg) / RATE_HZ


@dataclass(frozen=True, slots=True, eq=False)
class Person:
    """The data of one person: work, steps, and the plate on the skin, if measured."""

    work: list[Clip]
    strides: list[Clip]
    strap: Strap | None


@dataclass(frozen=True, slots=True)
class Subject:
    """The person and kind of a day; ``data``: the folder of the recorded motion."""

    kind: Kind
    seed: int
    data: Path = DATA


@lru_cache(maxsize=16)
def load_person(subject: Subject) -> Person:
    """Return the person of a seed: one of four seated people, or one of the walkers with everybody's work."""
    if subject.kind in {"skin", "seated"}:
        people = load_skin_library(subject.data / "skin_motion", is_rigid=subject.kind == "seated")
        clips = people[sorted(people)[subject.seed % len(people)]]
        return Person(clips, [], Strap(clips))
    library = load_library(subject.data / "real_motion", "l")
    strides = library.strides[sorted(library.strides)[subject.seed % len(library.strides)]]
    return Person([clip for name in sorted(library.work) for clip in library.work[name]], strides, None)


def raise_arm(clip: Clip) -> Clip:
    """Return a walk in which the arm carries a load in front of the body."""
    return replace(clip, turn=clip.turn * Rotation.from_rotvec([np.radians(CARRIED_DEG), 0.0, 0.0]))


class Choreography:
    """A track that starts and ends with the arm hanging."""

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
            self.track.append_nearest(self.person.work)

    def work(self, until_s: float, *, is_carrying: bool = False) -> None:
        """Work, walk and pause."""
        while self.track.length_s < until_s:
            if self.person.strides and self.chance.random() < WALK_SHARE:
                self._walk(min(until_s, self.track.length_s + self.chance.uniform(*WALK_S)), is_carrying)
                continue
            self.track.append_nearest(self.person.work)
            if self.chance.random() < PAUSE_SHARE:
                self.track.pause()

    def _walk(self, until_s: float, is_carrying: bool) -> None:  # noqa: FBT001
        steps = [raise_arm(clip) for clip in self.person.strides] if is_carrying else self.person.strides
        self.track.append_nearest(steps)
        while self.track.length_s < until_s:
            self.track.append(steps[int(self.chance.integers(len(steps)))], STRIDE_TURN_S)

    def finish(self, worn_from_s: float = 0.0) -> Piece:
        """End with the arm hanging, and return the readings of an ideal sensor."""
        self.hang(SEAM_S)
        return Piece(compute_readings(self.track.join(), RATE_HZ), tuple(self.poses_s), worn_from_s)


@lru_cache(maxsize=12)
def work_an_hour(subject: Subject, *, is_late: bool = False) -> Piece:
    """Return an hour of work, which a day repeats; for "carrying", loads are carried in the afternoon."""
    choreography = Choreography(load_person(subject), np.random.default_rng([subject.seed, 1, is_late]))
    choreography.hang(SEAM_S)
    choreography.work(HOUR_S, is_carrying=subject.kind == "carrying" and is_late)
    return choreography.finish()


def open_day(scenario: Scenario, subject: Subject) -> Piece:
    """Return the part before the first hour."""
    chance = np.random.default_rng([subject.seed, 2, round(scenario.table_s), round(scenario.work_s)])
    choreography = Choreography(load_person(subject), chance)
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


def put_back(subject: Subject) -> tuple[Piece, Piece]:
    """Return the sensor on a table at noon, and the new pose after it."""
    off = Choreography(load_person(subject), np.random.default_rng([subject.seed, 3]))
    off.track.hold(Rotation.from_rotvec([np.radians(90.0), 0.0, 0.0]), OFF_S, 0.0)
    again = Choreography(load_person(subject), np.random.default_rng([subject.seed, 4]))
    again.hang(SEAM_S)
    again.strap_on()
    again.pose(NEW_POSE_S)
    return off.finish(), again.finish()


def wear_day(scenario: Scenario, subject: Subject, device: Device, place: int = 0) -> WornDay:
    """Assemble a day and record it with a specimen of the device."""
    early, late = work_an_hour(subject), work_an_hour(subject, is_late=True)
    morning = [early] * (HOURS // 2)
    if scenario.has_pose:
        morning.insert(0, open_day(scenario, subject))
    noon = list(put_back(subject)) if scenario.is_off else []
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
    chance = np.random.default_rng([subject.seed, 5])
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
    chance = np.random.default_rng([subject.seed, 6])
    return record_motion(state, RATE_HZ, device, chance, tuple(poses_s), worn=worn, first=first)


def _turn_sensor(
    state: ArmState, time_s: Float64Array, at_s: float, angle_deg: float, chance: np.random.Generator
) -> ArmState:
    """Rotate the sensor about a direction across the arm, within half a second."""
    about = chance.uniform(0.0, 2.0 * np.pi)
    across = np.array([np.cos(about), np.sin(about), 0.0])
    way = np.clip((time_s - at_s) / SLIP_S, 0.0, 1.0)
    turning = Rotation.from_rotvec(np.radians(angle_deg) * way[:, None] * across)
    slip_dps = np.where((way > 0.0) & (way < 1.0), angle_deg / SLIP_S, 0.0)[:, None] * across
    return replace(state, acc_g=turning.apply(state.acc_g), gyr_dps=turning.apply(state.gyr_dps) - slip_dps)


# Scores


@dataclass(frozen=True, slots=True)
class Scored:
    """One analysis compared with its truth; ``refused``: the code of the error."""

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
    """Return the settings for the person's statement."""
    if scenario.stated == "held":
        return AnalysisSettings(pose_held="start")
    if scenario.stated == "nothing":
        return AnalysisSettings()
    poses_s = day.poses_s if scenario.names_new else day.poses_s[:1]
    return AnalysisSettings(calibration_windows_s=tuple((a + 1.0, b - 1.0) for a, b in poses_s))


def score(key: str, subject: Subject, device: Device) -> Scored:
    """Analyse one day like an uploaded recording, and compare."""
    scenario, place = SCENARIOS[key], int(key.removeprefix("cut")) if key.startswith("cut") else 0
    day = wear_day(scenario, subject, device, place)
    begun = Scored(key, subject.kind, device, subject.seed)
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
        axis_deg=compute_angle_deg(calibration.arm_axis, day.arm_axis),
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
    """Return the ranges of the same figures; without a range, the figure itself twice."""
    found = [part.interval for part in exposure.time_above]
    found += [exposure.intervals.get(f"elevation_p{percent}_deg") for percent in FIGURE_PERCENTS]
    pairs = zip(found, list_figures(exposure), strict=True)
    return [(own, own) if one is None else (one.low, one.high) for one, own in pairs]


def _list_inside(exposure: Exposure, true: Exposure) -> Iterator[bool]:
    for (low, high), figure in zip(list_ranges(exposure), list_figures(true), strict=True):
        yield low <= figure <= high


# Running and drawing


def run(
    keys: Sequence[str], seeds: Sequence[int], log: Path | None = None, data: Path = DATA
) -> Iterator[Scored]:
    """Yield every scenario of every seed, kind and device; a day in ``log`` is not run again."""
    lines = log.read_text("utf-8").splitlines() if log and log.exists() else []
    known = {(one.key, one.kind, one.device, one.seed): one for one in map(_read_scored, lines)}
    for seed in seeds:
        for kind, key, device in product(KINDS, keys, DEVICES):
            if kind not in SCENARIOS[key].kinds:
                continue
            one = known.get((key, kind, device, seed)) or score(key, Subject(kind, seed, data), device)
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
    asked = Counter(code for day in found for code in day.codes if code in ASKING)
    refused = Counter(day.refused for day in days if day.refused)
    return [
        SCENARIOS[key].name,
        str(len(days)),
        ", ".join(f"{state} {count}" for state, count in states.items()),
        f"{sum(day.is_held for day in found)}",
        f"{verdicts['good']} / {verdicts['caution']} / {verdicts['poor']}",
        str(sum(map(is_wrong, found))),
        f"{np.median([day.rmse_deg for day in found]):.2f} ({max(day.rmse_deg for day in found):.2f})",
        f"{100.0 * np.mean([each for day in found for each in day.inside]):.1f}",
        f"{np.median([day.widths[ABOVE_60] for day in found]):.1f}",
        f"{max(day.cut_s for day in found):.0f}",
        ", ".join(f"{code} {count}" for code, count in [*asked.items(), *refused.items()]) or "none",
    ]


ASKING = frozenset({
    "W-POSE-ASSUMED", "W-WHICH-POSE", "W-NOT-HELD", "W-POSE-UNSTEADY", "W-POSE-DOUBT", "W-NO-STILL", "W-SLIP",
    "W-PUT-BACK", "W-POSES-DIFFER", "W-REMOUNT",
})  # fmt: skip


def is_undetected(day: Scored) -> bool:
    """Return whether the sensor slipped and no question was asked."""
    return SCENARIOS[day.key].slip_deg > 0.0 and not day.refused and "W-SLIP" not in day.codes


def is_wrong(day: Scored) -> bool:
    """Return whether a day has the verdict "good" but an error above its limit."""
    return day.verdict == "good" and day.rmse_deg > LARGEST_DEG[day.kind]


def draw_undetected(scores: Sequence[Scored]) -> str:
    """Return a table of the slips that raised no question, a row for each kind of day and slip."""
    rows = []
    for kind, key in product(KINDS, SCENARIOS):
        days = [day for day in scores if (day.kind, day.key) == (kind, key) and SCENARIOS[key].slip_deg]
        unseen = [day for day in days if is_undetected(day)]
        if days:
            good = sum(day.verdict == "good" for day in unseen)
            worst = f"{max(day.rmse_deg for day in unseen):.1f}" if unseen else "-"
            rows.append(
                [f"{KINDS[kind]}: {SCENARIOS[key].name}", str(len(days)), str(len(unseen)), str(good), worst]
            )
    return draw_table(("days", "slips", "without a sign", "of these good", "of these RMSE deg, worst"), rows)


def judge_days(scores: Sequence[Scored]) -> Iterator[Goal]:
    """Yield the goals of each kind of day; slips without a sign are excluded."""
    for kind, name in KINDS.items():
        days = [day for day in scores if day.kind == kind and not day.refused and not is_undetected(day)]
        rows = [row for key in SCENARIOS if (row := [day for day in days if day.key == key])]
        outside = [100.0 - 100.0 * float(np.mean([day.inside for day in row])) for row in rows]
        widths = [float(np.median([day.widths[ABOVE_60] for day in row])) for row in rows]
        cut_s = [day.cut_s for day in days if "W-REMOUNT" in day.codes]
        other = sum(day.key == "pose" and not day.is_held for day in days)
        yield judge(f"{name}: the held pose is not the assumed one", other, 0, "days", 0)
        yield judge(
            f"{name}: `good` days that are further off than allowed", sum(map(is_wrong, days)), 0, "days", 0
        )
        yield judge(f"{name}: truth outside the ranges, worst scenario", max(outside), 10.0, "%", 1)
        yield judge(
            f"{name}: time left out after a slip nobody confirmed", max(cut_s, default=0.0), 0, "s", 0
        )
        yield judge(
            f"{name}: median width of the range of time above 60 deg, worst scenario",
            max(widths),
            40.0,
            "points",
            1,
        )


def find_missing(data: Path) -> str:
    """Return a line that names the missing recorded motion; empty if all is available."""
    missing = [name for name in ("real_motion", "skin_motion") if not (data / name).is_dir()]
    return f"Skipped: missing: {', '.join(missing)}." if missing else ""


def compare_on_stated(data: Path, seeds: int, log: Path | None) -> Section:
    """Return the section; without the data, it only names what is missing."""
    title = "The pose, as people state it"
    if missing := find_missing(data):
        return Section(title, (missing,))
    scores = list(run(tuple(SCENARIOS), range(seeds), log, data))
    prose = PROSE.format(last=seeds - 1, devices=name_devices())
    return Section(
        title, (prose, *draw(scores), UNDETECTED_PROSE, draw_undetected(scores)), tuple(judge_days(scores))
    )


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
