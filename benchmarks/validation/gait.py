"""Compare how recorded and simulated people stand and walk.

    python -m benchmarks.validation.gait [--data DIR ...]

Each angle is between the mean of gravity, as measured by a sensor on the upper arm, and the shoulder-elbow
line.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from acromion.fusion.numerics import compute_angle_deg
from acromion.fusion.recording import Float64Array
from acromion.fusion.simulation.activities import Choreography, draw_person, stand, walk
from acromion.fusion.simulation.body import Body, play
from acromion.fusion.simulation.body import compute_readings as compute_body_readings
from benchmarks.validation.document import Section, draw_table
from benchmarks.validation.real_clips import CLIP_HZ, Clip, Side, compute_readings, load_library
from benchmarks.validation.stated import DATA

RATE_HZ, STAND_S, WALK_S, ENDS_S = 50.0, 60.0, 60.0, 4.0
SIDES: tuple[Side, ...] = ("r", "l")
UP = np.array([0.0, 0.0, 1.0])
CALM_S, CALM_DEG = 0.5, 2.0
HANGING_DEG = 25.0
SEEDS = range(2, 82, 2)
PROSE = """\
Angle between gravity's mean and the shoulder-elbow line, deg: median (quartiles; extremes). Acted styles
(motion dataset 1 of Bandai Namco Research, CC BY-NC 4.0, 15 styles of one actor, both arms; not in the
project): standing 15 (13 to 17; 5 to 20), walking 21 (17 to 26; 12 to 66), one from the other 12 (9 to 16; 3
to 34)."""


@dataclass(frozen=True, slots=True)
class Gait:
    """Angles of one person's arm, deg: standing and walking from the arm axis, and from each other."""

    name: str
    stance_deg: float
    gait_deg: float
    apart_deg: float


def measure_recorded(folder: Path) -> list[Gait]:
    """Measure both arms of every subject with plain walking; stance: calm half seconds of a hanging arm."""
    found = []
    for side in SIDES:
        library = load_library(folder, side)
        for name, strides in sorted(library.strides.items()):
            walked = np.concatenate([compute_readings(clip, CLIP_HZ).acc_g for clip in strides]).mean(axis=0)
            stances = [up for clip in library.work.get(name, []) for up in _find_stances(clip)]
            stood = np.mean(stances, axis=0) if stances else np.full(3, np.nan)
            found.append(_compare(f"{name} {side}", stood, walked))
    return found


def _find_stances(clip: Clip) -> list[Float64Array]:
    """Return directions of the vertical in half seconds in which the arm hangs and hardly turns."""
    up = clip.turn.inv().apply(UP)
    size = round(CALM_S * CLIP_HZ)
    calm = []
    for first in range(0, len(up) - size + 1, size):
        part = up[first : first + size]
        turned_deg = compute_angle_deg(part[0], part[-1])
        if turned_deg < CALM_DEG and compute_angle_deg(part.mean(axis=0), UP) < HANGING_DEG:
            calm.append(part.mean(axis=0))
    return calm


def measure_simulated(seeds: Sequence[int]) -> list[Gait]:
    """Measure the people of ``fusion/simulation``."""
    found = []
    for seed in seeds:
        chance = np.random.default_rng([seed, 1])
        body = Choreography(draw_person(chance))
        stand(body, STAND_S, chance)
        stood_s = body.time_s
        walk(body, WALK_S, chance)
        acc_g = compute_body_readings(
            play(body.finish(), 0, int(body.time_s * RATE_HZ), RATE_HZ), Body()
        ).acc_g
        walked = slice(round((stood_s + ENDS_S) * RATE_HZ), -round(ENDS_S * RATE_HZ))
        stood = slice(0, round(stood_s * RATE_HZ))
        found.append(_compare(f"seed {seed}", acc_g[stood].mean(axis=0), acc_g[walked].mean(axis=0)))
    return found


def _compare(name: str, stood: Float64Array, walked: Float64Array) -> Gait:
    if np.isnan(stood).any():
        return Gait(name, np.nan, compute_angle_deg(walked, UP), np.nan)
    return Gait(
        name, compute_angle_deg(stood, UP), compute_angle_deg(walked, UP), compute_angle_deg(stood, walked)
    )


def draw_gaits(people: dict[str, list[Gait]]) -> str:
    """Return one row per source: minimum, quartiles and maximum of each angle."""
    rows = []
    for source, gaits in people.items():
        columns = [[one.stance_deg for one in gaits], [one.gait_deg for one in gaits]]
        columns.append([one.apart_deg for one in gaits])
        rows.append([source, str(len(gaits)), *(_describe(column) for column in columns)])
    return draw_table(("source", "arms", "standing", "walking", "walking from standing"), rows)


def _describe(values: Sequence[float]) -> str:
    known = np.array(values)[~np.isnan(values)]
    if not len(known):
        return "-"
    low, first, middle, third, high = np.percentile(known, [0, 25, 50, 75, 100])
    return f"{middle:.0f} ({first:.0f} to {third:.0f}; {low:.0f} to {high:.0f})"


def compare_gaits(folder: Path) -> Section:
    """Return the section; without the data, for simulated people only."""
    people = {"recorded": measure_recorded(folder)} if folder.is_dir() else {}
    people["simulated, 40 people"] = measure_simulated(SEEDS)
    return Section("Simulated people", (PROSE, draw_gaits(people)))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.gait")
    parser.add_argument("--data", type=Path, nargs="+", default=[DATA / "real_motion"])
    given = parser.parse_args()
    people = {folder.parent.name + "/" + folder.name: measure_recorded(folder) for folder in given.data}
    for gaits in people.values():
        for one in gaits:
            print(f"{one.name}: {one.stance_deg:.1f}, {one.gait_deg:.1f}, {one.apart_deg:.1f}")
    people["simulated"] = measure_simulated(SEEDS)
    print(draw_gaits(people))


if __name__ == "__main__":
    main()
