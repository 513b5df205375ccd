"""The ten tasks of the paper, each by itself and all in one session."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.simulation import SimulatedShift
from tests.simulated_shifts import play_shift
from tests.simulated_tasks import CALIBRATION_S, LOWERING_S, TASKS, simulate_session, simulate_task

TRUNK_FLEXION, THROWS = 7, 10


@pytest.fixture(scope="module")
def session() -> SimulatedShift:
    return simulate_session(1, "gt9x")


@pytest.fixture(scope="module")
def elevation_deg(session: SimulatedShift) -> NDArray[np.float64]:
    return play_shift(session).elevation_deg


def at(session: SimulatedShift, time_s: float) -> int:
    return round(time_s * session.rate_hz)


def test_a_session_holds_each_task_as_often_as_the_paper_asks(session: SimulatedShift) -> None:
    names = Counter(entry.name for entry in session.plan)
    rests = [entry.end_s - entry.start_s for entry in session.plan if entry.name == "rest"]

    assert names == {
        "calibration": 1, "rest": len(TASKS),
        **{f"repetition {number}": 9 if number == THROWS else 5 for number in TASKS},
    }  # fmt: skip
    assert (session.plan[0].start_s, session.plan[0].end_s) == (0.0, CALIBRATION_S)
    assert all(before.end_s <= after.start_s for before, after in pairwise(session.plan))
    assert min(rests) >= 20.0


def test_the_arm_hangs_when_it_has_been_lowered(
    session: SimulatedShift, elevation_deg: NDArray[np.float64]
) -> None:
    ends_s = [entry.end_s + LOWERING_S for entry in session.plan if entry.name.startswith("repetition")]

    lowered_deg = elevation_deg[[at(session, end_s) for end_s in ends_s]]

    assert lowered_deg.max() < 10.0


@pytest.mark.parametrize(
    ("number", "lowest_deg", "highest_deg"), [(2, 70.0, 110.0), (TRUNK_FLEXION, 0.0, 15.0)]
)
def test_the_arm_stays_about_level_while_it_rotates_and_plumb_while_the_trunk_bends(
    session: SimulatedShift,
    elevation_deg: NDArray[np.float64],
    number: int,
    lowest_deg: float,
    highest_deg: float,
) -> None:
    first = next(entry for entry in session.plan if entry.name == f"repetition {number}")

    task_deg = elevation_deg[at(session, first.start_s + 1.0) : at(session, first.end_s)]

    assert lowest_deg <= task_deg.min() <= task_deg.max() <= highest_deg


def test_a_person_does_a_task_alike_in_a_session_and_alone_and_people_differ(session: SimulatedShift) -> None:
    alone, together = (
        [entry.end_s - entry.start_s for entry in shift.plan if entry.name == name]
        for shift, name in ((simulate_task(8, 1, "gt9x"), "repetition"), (session, "repetition 8"))
    )

    assert together == pytest.approx(alone)
    assert simulate_session(2, "gt9x").plan != session.plan
    assert np.array_equal(simulate_session(1, "lsm9ds1").motion.strokes, session.motion.strokes)
