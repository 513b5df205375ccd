"""Section (h): a sensor that turns on the arm while it is worn, through calibration and fusion."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.validation.document import Goal, Section, draw_table, judge
from benchmarks.validation.worn import DEVICES, NAMES, Worn, find_rmse_deg
from fusion.calibration import calibrate
from fusion.elevation import estimate_elevation
from fusion.recording import MICROSECONDS, Recording, Segment
from fusion.simulation import SimulatedShift, simulate_shift
from fusion.simulation.body import ArmState
from fusion.simulation.parts import Device
from fusion.simulation.sensor import sense

HOURS, RATE_HZ, SEEDS, QUIET_SEEDS = 2.0, 50.0, (1, 2, 3), tuple(range(1, 11))
ANGLES_DEG = (20.0, 30.0, 45.0, 60.0, 90.0, 180.0)
PLACES = (0.1, 0.5, 0.9)
GRADUAL_S, ABRUPT_S = 600.0, 0.5
BAND = 1.96
LIMIT_DEG = 10.0
BACK_HOURS, BACK_AT, BACK_MINUTES, BACK_ANGLES_DEG = 3.0, 0.4, (20.0, 60.0), (20.0, 30.0, 45.0, 60.0, 90.0)
SURE_DEG, BACK_SURE_DEG = 60.0, 45.0
HEADER = ("turn", "found", "valid %, least", "RMSE deg, worst", "in the band %, worst")
ALONG = np.array([0.0, 0.0, 1.0])

PROSE = f"""\
Simulated days of {HOURS:g} h ({RATE_HZ:g} Hz, both devices, seeds {SEEDS[0]} to {SEEDS[-1]}) on which the
sensor turns on the arm while it is worn: across the arm's axis, at a tenth, half and nine tenths of the
day, within {ABRUPT_S:g} s or over {GRADUAL_S / 60:g} minutes. The gyroscope feels the turn, as it does
when a strap slips, so that no sample contradicts another; only the postures tell. No window is given: the
pose is proposed. *Found*: days on which a slip was found; *valid*: share of the rows that the result
calls valid, the least of the days. *RMSE*: of these rows, the worst day; *in the band*: share of these
rows within 1.96 times the standard deviation given for each second (the pose left out), the worst day.
Where less than half is valid, the report's verdict is poor. The rules were set on other days: 52 mixed ones
and 60 hard ones of even seeds ([decision 32](decisions/0032-turned-and-pushed-back.md)).

What is not found stands in the table: a turn of 20 deg is not always told from other work, and one that
ends two minutes before the recording does only where it is large. These rows stay valid and are wrong by
up to the turn. Hours of other work without any walking look like a turn and are left out
(tests/fusion/test_other_work.py). A turn about the arm's own axis does not change the angle. Days without
any turn, of an hour (seeds {QUIET_SEEDS[0]} to {QUIET_SEEDS[-1]}) and of {BACK_HOURS:g} hours (the odd ones),
are to raise no alarm. The recordings of BROAD and of the project are shorter than the ten minutes that the
search asks for."""

BACK_PROSE = f"""\
The same on days of {BACK_HOURS:g} h, with the sensor turned at {100 * BACK_AT:g} % of the day and pushed back
to its first place after 20 minutes or an hour. *Valid between*: share of the rows in which it sat turned
that the result calls valid, the most of the days: read from an axis of their own where the turn was found,
wrong by up to the turn where it was not. On the days of seed 1 nobody walks in those 20 minutes."""


@dataclass(frozen=True, slots=True)
class Turned:
    """One day: whether a turn was found, and what the angle is worth.

    ``turned_percent``: share of the rows between two turns that are valid.
    """

    is_found: bool
    valid_percent: float
    rmse_deg: float
    covered_percent: float
    turned_percent: float = 0.0


@dataclass(frozen=True, slots=True)
class Turn:
    """``angle_deg`` about ``axis`` (arm's frame), from ``start_s`` on, within ``during_s``; back from
    ``back_s`` on, as fast.
    """

    angle_deg: float
    axis: NDArray[np.float64]
    start_s: float
    during_s: float
    back_s: float = np.inf

    def apply(self, state: ArmState, time_s: NDArray[np.float64]) -> ArmState:
        """What the sensor feels, seen from the frame in which it sat before."""
        there, back = (
            np.clip((time_s - at_s) / self.during_s, 0.0, 1.0) for at_s in (self.start_s, self.back_s)
        )
        turn = Rotation.from_rotvec(np.radians(self.angle_deg) * (there - back)[:, None] * self.axis)
        way = ((there > 0.0) & (there < 1.0)).astype(float) - ((back > 0.0) & (back < 1.0))
        slip_dps = (way * self.angle_deg / self.during_s)[:, None] * self.axis
        return replace(state, acc_g=turn.apply(state.acc_g), gyr_dps=turn.apply(state.gyr_dps) - slip_dps)


@cache
def _play(device: Device, seed: int, hours: float) -> tuple[SimulatedShift, tuple[ArmState, ...]]:
    shift = simulate_shift(device, hours, seed, RATE_HZ)
    return shift, tuple(block.state for block in shift.blocks())


def wear_turning(device: Device, seed: int, turn: Turn | None, hours: float = HOURS) -> Worn:
    """Play a day with the sensor turning as told; nothing else differs, down to the noise."""
    shift, states = _play(device, seed, hours)
    rows, first = [], 0
    for number, state in enumerate(states):
        time_s = (first + np.arange(len(state.elevation_deg))) / shift.rate_hz
        felt = turn.apply(state, time_s) if turn else state
        acc, gyr = shift.count(sense(felt, shift.errors, time_s, np.random.default_rng([seed, 3, number])))
        rows.append(np.hstack([acc * shift.part.acc_g_per_lsb, gyr * shift.part.gyr_dps_per_lsb]))
        first += len(time_s)
    both = np.concatenate(rows).astype(np.float32)
    segment = Segment(0, shift.rate_hz, both[:, :3].copy(), both[:, 3:].copy())
    duration_us = round(first / shift.rate_hz * MICROSECONDS)
    recording = Recording(device, "0" * 64, shift.start, None, duration_us, (segment,))
    return Worn(shift, recording, np.concatenate([state.elevation_deg for state in states]))


def measure(worn: Worn, turned_s: tuple[float, float] = (0.0, 0.0)) -> Turned:
    """Calibrate, fuse, and hold the valid rows against the truth; ``turned_s``: between two turns."""
    samples = calibrate(worn.recording, "n-pose")
    (found,) = estimate_elevation(samples).segments
    error_deg = (found.elevation_deg - worn.truth_deg)[found.valid]
    second = (np.arange(len(found)) / found.rate_hz).astype(np.int64)[found.valid]
    between = slice(*(round(at_s * found.rate_hz) for at_s in turned_s))
    sigma_deg = np.zeros(1) if found.sigma_deg is None else found.sigma_deg
    return Turned(
        bool(samples.remounts),
        100.0 * float(found.valid.mean()),
        find_rmse_deg(error_deg),
        100.0 * float(np.mean(np.abs(error_deg) <= BAND * sigma_deg[second])),
        100.0 * float(found.valid[between].mean()) if turned_s[1] else 0.0,
    )


def list_turns(seed: int) -> Iterator[tuple[tuple[float, float, bool], Turn]]:
    """Every case with its angle, place and whether it takes minutes; the axis is drawn anew for each."""
    chance = np.random.default_rng([seed, 27])
    for is_gradual in (False, True):
        for angle_deg in ANGLES_DEG:
            for place in PLACES:
                about = chance.uniform(0.0, 2.0 * np.pi)
                across = np.array([np.cos(about), np.sin(about), 0.0])
                during_s = GRADUAL_S if is_gradual else ABRUPT_S
                turn = Turn(angle_deg, across, place * HOURS * 3600.0, during_s)
                yield (angle_deg, place, is_gradual), turn


def list_backs(seed: int) -> Iterator[tuple[tuple[float, float], Turn]]:
    """Turns that are undone, with their angle and how many minutes they last."""
    chance = np.random.default_rng([seed, 32])
    for angle_deg in BACK_ANGLES_DEG:
        for minutes in BACK_MINUTES:
            about = chance.uniform(0.0, 2.0 * np.pi)
            across = np.array([np.cos(about), np.sin(about), 0.0])
            start_s = BACK_AT * BACK_HOURS * 3600.0
            yield (angle_deg, minutes), Turn(angle_deg, across, start_s, ABRUPT_S, start_s + 60.0 * minutes)


def compare_slips() -> Section:
    found: dict[tuple[float, float, bool], list[Turned]] = {}
    along: list[Turned] = []
    for device in DEVICES:
        for seed in SEEDS:
            for case, turn in list_turns(seed):
                found.setdefault(case, []).append(measure(wear_turning(device, seed, turn)))
            along.append(measure(wear_turning(device, seed, Turn(90.0, ALONG, HOURS * 1800.0, ABRUPT_S))))
    quiet, backs = _measure_unturned(), _measure_backs()
    rows = [_draw_case(_name_case(*case), days) for case, days in found.items()]
    rows.append(_draw_case("90 deg about the arm's axis", along))
    rows += [_draw_case(f"no turn, {NAMES[d]}, {hours:g} h", days) for (d, hours), days in quiet.items()]
    unturned = [*along, *(day for days in quiet.values() for day in days)]
    goals = (*_judge_slips(found, unturned), _judge_backs(backs))
    paragraphs = (PROSE, draw_table(HEADER, rows), BACK_PROSE, _draw_backs(backs))
    return Section("(h) A sensor that turns while it is worn", paragraphs, goals)


def _measure_unturned() -> dict[tuple[Device, float], list[Turned]]:
    return {
        (device, hours): [measure(wear_turning(device, seed, None, hours)) for seed in seeds]
        for hours, seeds in ((1.0, QUIET_SEEDS), (BACK_HOURS, QUIET_SEEDS[::2]))
        for device in DEVICES
    }


def _measure_backs() -> dict[tuple[float, float], list[Turned]]:
    backs: dict[tuple[float, float], list[Turned]] = {}
    for device in DEVICES:
        for seed in SEEDS:
            for case, turn in list_backs(seed):
                worn = wear_turning(device, seed, turn, BACK_HOURS)
                backs.setdefault(case, []).append(measure(worn, (turn.start_s, turn.back_s)))
    return backs


def _draw_backs(backs: Mapping[tuple[float, float], Sequence[Turned]]) -> str:
    rows = [
        [*_draw_case(f"{angle_deg:g} deg for {minutes:g} minutes", days), _find_most(days)]
        for (angle_deg, minutes), days in backs.items()
    ]
    return draw_table((*HEADER, "valid between %, most"), rows)


def _find_most(days: Sequence[Turned]) -> str:
    return f"{max(day.turned_percent for day in days):.1f}"


def _judge_backs(backs: Mapping[tuple[float, float], Sequence[Turned]]) -> Goal:
    days = [day for (angle_deg, _), found in backs.items() if angle_deg >= BACK_SURE_DEG for day in found]
    missed = sum(not day.is_found for day in days)
    what = f"turns of {BACK_SURE_DEG:g} deg and more, pushed back after 20 minutes or an hour: "
    return judge(what + "not found", missed, 0, f"of {len(days)}", 0)


def _name_case(angle_deg: float, place: float, is_gradual: bool) -> str:  # noqa: FBT001 (a key's three parts)
    return f"{angle_deg:g} deg at {100 * place:g} %, {'10 minutes' if is_gradual else 'abrupt'}"


def _draw_case(name: str, days: Sequence[Turned]) -> list[str]:
    return [
        name,
        f"{sum(day.is_found for day in days)}/{len(days)}",
        f"{min(day.valid_percent for day in days):.1f}",
        f"{max(day.rmse_deg for day in days):.2f}",
        f"{min(day.covered_percent for day in days):.1f}",
    ]


def _judge_slips(
    found: Mapping[tuple[float, float, bool], Sequence[Turned]], unturned: Sequence[Turned]
) -> tuple[Goal, ...]:
    large = [
        day
        for (angle_deg, place, is_gradual), days in found.items()
        if angle_deg >= SURE_DEG and not (is_gradual and place == PLACES[-1])
        for day in days
    ]
    missed = sum(not day.is_found for day in large)
    alarms = sum(day.is_found for day in unturned)
    what = f"turns of {SURE_DEG:g} deg and more, ten minutes or more before the end: "
    return (
        judge(what + "not found", missed, 0, f"of {len(large)}", 0),
        judge(what + "RMSE of valid rows, worst", max(day.rmse_deg for day in large), LIMIT_DEG),
        judge("no turn across the arm: alarms", alarms, 0, f"of {len(unturned)}", 0),
    )
