"""Simulated days of eight hours, in pieces: morning and afternoon are shared by all scenarios of a seed.

    python -m benchmarks.validation.simulated_days --log FILE [--days N] [--even] [--only A B]

Both devices feel the same motion at 25 Hz, without the error of their clocks; all other errors are theirs.
Odd seeds are scored, even ones (``--even``) are to settle rules on.
"""

import argparse
import zlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.validation.document import Section
from benchmarks.validation.people import SCENARIOS, Made, draw, run
from fusion.simulation.activities import ACTIVITIES, HANGING, Choreography, relax
from fusion.simulation.body import ArmState, Body, feel, play
from fusion.simulation.people import BRISK_SHARE, Person, draw_person
from fusion.simulation.shift import Course, PlannedActivity, begin_day, hold_pose, work

RATE_HZ, DAY_S = 25.0, 8 * 3600.0
HALF_S, BREAK_S, LAST_POSE_S = 0.47 * DAY_S, 0.06 * DAY_S, 30.0
OPENING, MORNING, NOON, AFTERNOON, EVENING = range(5)

Chance = np.random.Generator
Score = Callable[[Choreography, Chance], list[PlannedActivity]]

PROSE = """\
{days} days of 8 h a scenario (odd seeds, 1 to {last}), both devices at {rate_hz:g} Hz; columns and goals as
above. One person in five walks briskly."""


def make_day(course: Course, seed: int) -> Made:
    """Play a day: opening, morning, noon, afternoon, evening, with poses where the course has them."""
    person = find_person(seed)
    opened, begun_s, table_s = _open(person, course, seed)
    pieces, poses_s = [opened], list(begun_s)
    for piece in (MORNING, NOON, AFTERNOON, EVENING):
        at_s = sum(len(one.elevation_deg) for one in pieces) / RATE_HZ
        if piece in {MORNING, AFTERNOON}:
            pieces.append(play_half(seed, piece, course.walks))
        elif course.is_repeated:
            posed, held_s = _pose(person, course, seed, piece)
            pieces.append(posed)
            poses_s += [(at_s + start_s, at_s + end_s) for start_s, end_s in held_s]
    state = ArmState(
        np.concatenate([one.acc_g for one in pieces]),
        np.concatenate([one.gyr_dps for one in pieces]),
        np.zeros((1, 3)),
        np.concatenate([one.elevation_deg for one in pieces]),
    )
    return Made(RATE_HZ, state, tuple(poses_s), table_s, is_seen=not is_brisk(seed))


def is_brisk(seed: int) -> bool:
    """Whether the person of a seed walks briskly: as many as the simulator draws."""
    return seed // 2 % round(1.0 / BRISK_SHARE) == 0


def find_person(seed: int) -> Person:
    """The person of a seed."""
    return draw_person(np.random.default_rng([seed, 50]), is_brisk=is_brisk(seed))


@lru_cache(maxsize=4)
def play_half(seed: int, piece: int, walks: bool) -> ArmState:  # noqa: FBT001 - a key of three parts
    """Half a day of work, with a break in it, as all scenarios of a seed share it."""

    def write(body: Choreography, chance: Chance) -> list[PlannedActivity]:
        plan = work(body, HALF_S / 2, DAY_S, chance, walks=walks)
        body.go(0.8, relax(body, chance))
        ACTIVITIES["break"](body, BREAK_S / 2, chance)
        return plan + work(body, HALF_S, DAY_S, chance, walks=walks)

    return _play(find_person(seed), write, np.random.default_rng([seed, 51, piece, walks]))[0]


def _open(
    person: Person, course: Course, seed: int
) -> tuple[ArmState, tuple[tuple[float, float], ...], float]:
    """What comes before the work, when a pose is held in it, and until when the sensor lies on a table."""
    key = [seed, 52, zlib.crc32(course.opening.encode()), round(course.table_s), round(course.tilt_deg)]

    def write(body: Choreography, chance: Chance) -> list[PlannedActivity]:
        return begin_day(body, course, chance)

    state, plan = _play(person, write, np.random.default_rng(key))
    table_s = max((entry.end_s for entry in plan if entry.name == "table"), default=0.0)
    return state, _find_poses(plan), table_s


def _pose(
    person: Person, course: Course, seed: int, piece: int
) -> tuple[ArmState, tuple[tuple[float, float], ...]]:
    """The pose once more, and some work after it."""

    def write(body: Choreography, chance: Chance) -> list[PlannedActivity]:
        body.wait(0.5)
        pose = hold_pose(body, course, chance)
        return [pose, *work(body, body.time_s + LAST_POSE_S, DAY_S, chance, walks=course.walks)]

    state, plan = _play(person, write, np.random.default_rng([seed, 53, piece]))
    return state, _find_poses(plan)


def _find_poses(plan: list[PlannedActivity]) -> tuple[tuple[float, float], ...]:
    return tuple((entry.start_s, entry.end_s) for entry in plan if entry.name == "calibration")


def _play(person: Person, write: Score, chance: Chance) -> tuple[ArmState, list[PlannedActivity]]:
    """Play a piece that ends as all pieces begin: with the arm plumb and at rest."""
    body = Choreography(person)
    plan = write(body, chance)
    body.go(1.5, HANGING)
    body.wait(0.5)
    motion, count = body.finish(), int(body.time_s * RATE_HZ)
    return feel(play(motion, 0, count, RATE_HZ), Body()), plan


def compare_on_simulated(days: int, log: Path | None) -> Section:
    """The section on odd seeds."""
    seeds = range(1, 1 + 2 * days, 2)
    scores = list(run(make_day, tuple(SCENARIOS), seeds, log))
    prose = PROSE.format(days=days, last=seeds[-1], rate_hz=RATE_HZ)
    return Section("The pose on simulated days", (prose, draw(scores)))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.simulated_days")
    parser.add_argument("--days", type=int, default=40)
    parser.add_argument("--even", action="store_true")
    parser.add_argument("--only", nargs="+", choices=tuple(SCENARIOS), default=tuple(SCENARIOS))
    parser.add_argument("--log", type=Path, required=True)
    given = parser.parse_args()
    first = 2 if given.even else 1
    seeds = range(first, first + 2 * given.days, 2)
    print(draw(list(run(make_day, given.only, seeds, given.log))))


if __name__ == "__main__":
    main()
