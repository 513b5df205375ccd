"""Rows that stand in a table twice are counted once."""

from collections.abc import Iterable

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.recording import Recording
from tests.badfiles.arm import minute
from tests.fusion.readers.seen import codes
from tests.fusion.readers.tables.table_builder import HEADER, read_text

ACC_G, GYR_DPS = minute()
ROWS = len(ACC_G)
PERIOD_US = 10_000


def row(k: int, stamp_us: int) -> str:
    values = (*ACC_G[k], *GYR_DPS[k])
    return ",".join([str(stamp_us), *(f"{value:.6f}" for value in values)]) + "\n"


def read_rows(numbers: Iterable[int]) -> Recording:
    return read_text(HEADER + "\n" + "".join(row(k, PERIOD_US * k) for k in numbers))


def accelerations(recording: Recording) -> NDArray[np.float32]:
    return np.concatenate([segment.acc_g for segment in recording.segments])


@pytest.mark.parametrize(
    ("numbers", "repeated"),
    [
        ([*range(ROWS), *range(ROWS)], ROWS),
        ([*range(3000), *range(2000, ROWS)], 1000),
        ([*range(3000), *range(2970, ROWS)], 30),
        ([*range(3000), *range(2000, 3000), *range(2000, ROWS)], 2000),
    ],
    ids=["a file put after itself", "ten seconds again", "0.3 s again", "ten seconds thrice"],
)
def test_rows_that_come_again_are_counted_once(numbers: list[int], repeated: int) -> None:
    recording = read_rows(numbers)

    once = read_rows(range(ROWS))
    assert recording.duration_us == once.duration_us
    assert np.array_equal(accelerations(recording), accelerations(once))
    assert [(flag.code, flag.count) for flag in recording.flags] == [("W-DUP", repeated)]


def test_a_counter_that_starts_over_with_other_readings_repeats_nothing() -> None:
    rows = [row(k, PERIOD_US * (k % 3000)) for k in range(ROWS)]

    recording = read_text(HEADER + "\n" + "".join(rows))

    assert recording.duration_us == PERIOD_US * ROWS
    assert "W-DUP" not in codes(recording)


def test_a_held_value_that_a_clock_set_back_stamps_again_is_no_copy() -> None:
    rows = [row(min(k, 2900), PERIOD_US * (k if k < 3000 else k - 50)) for k in range(3040)]

    recording = read_text(HEADER + "\n" + "".join(rows))

    assert codes(recording)[0] == "W-CLOCK-BACK"
