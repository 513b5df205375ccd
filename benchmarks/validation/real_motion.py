"""Shifts made of recorded human motion, with the same scenarios as simulated days.

    python -m benchmarks.validation.real_motion --log FILE [--arm r] [--shifts N] [--only A B] [--styles DIR]

Right arms (``--arm r``) are to settle on, left arms to score on. ``--figures`` prints how the recorded people
stand and walk beside the simulated ones.
"""

import argparse
import zlib
from functools import partial
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.validation.document import Section
from benchmarks.validation.people import OWN_REPEAT_DEG, SCENARIOS, Made, draw, name_devices, run
from benchmarks.validation.real_clips import (
    STRIDE_TURN_S,
    Clip,
    Library,
    Side,
    Track,
    feel,
    load_library,
)
from fusion.simulation.shift import EARLY_S, IDLE_S, LATE_S, POSES, REPEATED_S, RESTLESS_S, Course

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "real_motion"
RATE_HZ, SHIFT_S, POSE_S, FIRST_SEED = 100.0, 2400.0, 10.0, 1
PAUSE_S, WALK_S, WALK_SHARE, PAUSE_SHARE = (6.0, 20.0), (30.0, 90.0), 0.35, 0.6
PAUSE_SD_DEG = 5.0
STANCE_DEG, STRAP_ON_S, AHEAD_S = (8.0, 15.0), 3.0, 30.0

PROSE = """\
{shifts} shifts of 40 minutes a scenario from 28 clips of CMU Graphics Lab (subjects 01 to 03, optical, 11
minutes; mocap.cs.cmu.edu, free for any use), left arms. {devices}, both at 100 Hz. Errors are over valid worn
rows. *Met*: A, D with the window, E: RMSE and every 30 deg bin within 1 (deg, points), at most 5 s dropped,
nothing asked, the held pose chosen; C, D: the caveat is there; F: found, valid rows within 3 deg; G: no
caveat, at most 5 s dropped; H: valid rows within 2 deg; J: ranges within 0.5 of A's. *In ranges*: of time
above 30, 60, 90 deg, P10, P50 and P90, the share whose 95 % range holds the truth; 90 is the goal of B, C, D
and I. *Width*: of the range of time above 60 deg."""


def make_shift(library: Library, course: Course, seed: int) -> Made:
    """Draw a shift from the clips: one subject's steps, everybody's work."""
    kind = (course.opening, course.table_s, course.tilt_deg, course.is_repeated, course.walks)
    track = Track(np.random.default_rng([seed, zlib.crc32(repr(kind).encode())]))
    stride = library.strides[str(track.chance.choice(sorted(library.strides)))]
    work = [clip for name in sorted(library.work) for clip in library.work[name]]
    table_s = 0.0
    if course.table_s:
        track.hold(_hang(track.chance, 90.0), course.table_s, sway_deg=0.0)
        table_s = course.table_s + STRAP_ON_S
    poses_s = _open(track, course, work, stride)
    again_s = [share * SHIFT_S - AHEAD_S for share in POSES] if course.is_repeated else []
    while track.length_s < SHIFT_S:
        if again_s and track.length_s >= again_s[0]:
            again_s.pop(0)
            poses_s.append(track.hold(_pose(track.chance, course), REPEATED_S))
        if course.walks and track.chance.random() < WALK_SHARE:
            _walk(track, stride)
        else:
            is_first = track.length_s < SHIFT_S / 2.0
            clips = work if course.walks else _choose_others(library, is_first=is_first)
            _work(track, clips, EARLY_S if course.opening == "none" else 0.0)
    if again_s:
        poses_s.append(track.hold(_pose(track.chance, course), REPEATED_S))
    return Made(RATE_HZ, feel(track.join(), RATE_HZ), tuple(poses_s), table_s)


def _open(track: Track, course: Course, work: list[Clip], stride: list[Clip]) -> list[tuple[float, float]]:
    """What comes before the work, and when the pose is held in it."""
    chance, begun_s = track.chance, track.length_s
    if course.opening in {"late", "paused"}:
        paused_s = begun_s + (RESTLESS_S if course.opening == "late" else 0.0)
        track.go_on(stride[0])
        while track.length_s < begun_s + LATE_S:
            _work(track, work, np.inf)
            if track.length_s >= paused_s:
                pause(track)
    if course.opening in {"pose", "late", "paused"}:
        return [track.hold(_hang(chance, course.tilt_deg), POSE_S)]
    stance = _hang(chance, chance.uniform(*STANCE_DEG))
    track.go_on(work[0])
    while course.opening == "idle" and track.length_s < IDLE_S:
        track.hold(_sway_by(chance, OWN_REPEAT_DEG) * stance, float(chance.uniform(*PAUSE_S)))
        _work(track, work, np.inf)
    return []


def _choose_others(library: Library, *, is_first: bool) -> list[Clip]:
    """Without walking, the first half is the work of one subject, the second that of another."""
    first, second = sorted(library.work)[:2]
    return library.work[first if is_first else second]


def _hang(chance: np.random.Generator, tilt_deg: float) -> Rotation:
    """An arm ``tilt_deg`` from plumb, turned any way about itself."""
    about, spin = chance.uniform(0.0, 2.0 * np.pi, 2)
    tilt = np.radians(tilt_deg) * np.array([np.cos(about), np.sin(about), 0.0])
    return Rotation.from_rotvec(tilt) * Rotation.from_rotvec([0.0, 0.0, spin])


def _pose(chance: np.random.Generator, course: Course) -> Rotation:
    """A pose held again, as well as it is repeated."""
    return _sway_by(chance, course.repeat_deg) * _hang(chance, course.tilt_deg)


def _sway_by(chance: np.random.Generator, sd_deg: float) -> Rotation:
    return Rotation.from_rotvec([*np.radians(sd_deg * chance.standard_normal(2)), 0.0])


def _walk(track: Track, stride: list[Clip]) -> None:
    until_s = track.length_s + track.chance.uniform(*WALK_S)
    track.go_on_with_nearest(stride)
    while track.length_s < until_s:
        step = stride[int(track.chance.integers(len(stride)))]
        track.go_on(step, STRIDE_TURN_S)


def _work(track: Track, clips: list[Clip], no_pause_s: float) -> None:
    track.go_on_with_nearest(clips)
    if track.length_s > no_pause_s and track.chance.random() < PAUSE_SHARE:
        pause(track)


def pause(track: Track) -> None:
    """Hold about the posture in which a clip ends, each time another one."""
    turn = _sway_by(track.chance, PAUSE_SD_DEG) * track.now
    track.hold(turn, float(track.chance.uniform(*PAUSE_S)))


def compare_on_recorded(folder: Path, shifts: int, log: Path | None) -> Section:
    """The section on left arms; where the data is absent, it only names what is missing."""
    title = "The pose on recorded motion"
    if not folder.is_dir():
        return Section(title, (f"Skipped: {folder.name} is not there.",))
    maker = partial(make_shift, load_library(folder, "l"))
    scores = list(run(maker, tuple(SCENARIOS), range(FIRST_SEED, FIRST_SEED + shifts), log))
    return Section(title, (PROSE.format(shifts=shifts, devices=name_devices()), draw(scores)))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.validation.real_motion")
    parser.add_argument("--shifts", type=int, default=12)
    parser.add_argument("--arm", choices=("l", "r"), default="l")
    parser.add_argument("--only", nargs="+", choices=tuple(SCENARIOS), default=tuple(SCENARIOS))
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--log", type=Path, required=True)
    given = parser.parse_args()
    side: Side = given.arm
    maker = partial(make_shift, load_library(given.data, side))
    seeds = range(FIRST_SEED, FIRST_SEED + given.shifts)
    print(draw(list(run(maker, given.only, seeds, given.log))))


if __name__ == "__main__":
    main()
