"""The ten tasks of the paper, each by itself and all in one session."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.simulation import SimulatedShift
from tests.simulated_shifts import play_shift
from tests.simulated_tasks import CALIBRATION_S, LOWERING_S, TASKS, simulate_session, simulate_task

QUASI_STATIC = (2, 5)
TRUNK_FLEXION, THROWS = 7, 10


@pytest.fixture(scope="module")
def session() -> SimulatedShift:
    return simulate_session(1, "gt9x")


@pytest.fixture(scope="module")
def elevation_deg(session: SimulatedShift) -> NDArray[np.float64]:
    return play_shift(session).elevation_deg


def at(session: SimulatedShift, time_s: float) -> int:
    return round(time_s * session.rate_hz)


@pytest.mark.parametrize("number", TASKS)
def test_a_session_holds_each_task_as_often_as_the_paper_asks(session: SimulatedShift, number: int) -> None:
    names = [entry.name for entry in session.plan]

    assert names.count(f"repetition {number}") == (9 if number == THROWS else 5)


def test_a_session_has_one_calibration_at_its_start(session: SimulatedShift) -> None:
    calibrations = [entry for entry in session.plan if entry.name == "calibration"]

    assert [(entry.start_s, entry.end_s) for entry in calibrations] == [(0.0, CALIBRATION_S)]


def test_the_person_sits_after_each_task_for_at_least_twenty_seconds(session: SimulatedShift) -> None:
    rests = [entry.end_s - entry.start_s for entry in session.plan if entry.name == "rest"]

    assert len(rests) == len(TASKS)
    assert min(rests) >= 20.0


def test_who_stands_between_the_tasks_lets_the_arm_hang() -> None:
    standing = simulate_session(1, "gt9x", seated=False)
    rests = [entry for entry in standing.plan if entry.name == "rest"]
    elevation_deg = play_shift(standing).elevation_deg

    largest_deg = [elevation_deg[at(standing, r.start_s + 1.0) : at(standing, r.end_s)].max() for r in rests]

    assert max(largest_deg) < 10.0


def test_the_entries_of_a_session_follow_each_other(session: SimulatedShift) -> None:
    assert all(before.end_s <= after.start_s for before, after in pairwise(session.plan))


def test_the_arm_hangs_when_it_has_been_lowered(
    session: SimulatedShift, elevation_deg: NDArray[np.float64]
) -> None:
    ends_s = [entry.end_s + LOWERING_S for entry in session.plan if entry.name.startswith("repetition")]

    lowered_deg = elevation_deg[[at(session, end_s) for end_s in ends_s]]

    assert lowered_deg.max() < 10.0


@pytest.mark.parametrize("number", QUASI_STATIC)
def test_the_arm_stays_about_level_while_it_rotates(
    session: SimulatedShift, elevation_deg: NDArray[np.float64], number: int
) -> None:
    first = next(entry for entry in session.plan if entry.name == f"repetition {number}")

    turning_deg = elevation_deg[at(session, first.start_s + 1.0) : at(session, first.end_s)]

    assert np.abs(turning_deg - 90.0).max() < 20.0


def test_the_arm_stays_plumb_while_the_trunk_bends(
    session: SimulatedShift, elevation_deg: NDArray[np.float64]
) -> None:
    first = next(entry for entry in session.plan if entry.name == f"repetition {TRUNK_FLEXION}")

    bending_deg = elevation_deg[at(session, first.start_s) : at(session, first.end_s)]

    assert bending_deg.max() < 15.0


def test_a_person_moves_alike_whatever_the_device() -> None:
    gt9x, lsm9ds1 = simulate_session(3, "gt9x"), simulate_session(3, "lsm9ds1")

    assert np.array_equal(gt9x.motion.strokes, lsm9ds1.motion.strokes)


def list_durations_s(shift: SimulatedShift, name: str) -> list[float]:
    return [entry.end_s - entry.start_s for entry in shift.plan if entry.name == name]


@pytest.mark.parametrize("number", [8, THROWS])
def test_a_person_does_a_task_alike_in_a_session_and_alone(session: SimulatedShift, number: int) -> None:
    alone_s = list_durations_s(simulate_task(number, 1, "gt9x"), "repetition")

    assert list_durations_s(session, f"repetition {number}") == pytest.approx(alone_s)


def test_people_differ() -> None:
    assert simulate_session(1, "gt9x").plan != simulate_session(2, "gt9x").plan
