"""The clock of a stream: wraps, restarts, lost frames; all hand-worked at 100 Hz (10,000 us)."""

import numpy as np
import pytest

from fusion.live.lines import StreamClock

Frame = tuple[int | None, int | None, int]


def place(*frames: Frame) -> list[tuple[int, int]]:
    clock = StreamClock(10_000.0)
    return [clock.place(*frame) for frame in frames]


def test_without_a_stamp_rows_are_a_period_apart_however_they_come() -> None:
    # Four rows in one burst each 40 ms.
    bursts = [(None, None, 40_000 * (k // 4)) for k in range(4000)]

    placed = np.array(place(*bursts))

    assert placed[:, 1].tolist() == list(range(4000))
    assert np.abs(np.diff(placed[:, 0]) - 10_000).max() <= 500
    assert placed[-1, 0] == pytest.approx(39_990_000, abs=40_000)


def test_without_a_stamp_the_time_follows_a_board_whose_rate_is_another() -> None:
    # 101 Hz for 100 Hz, over 60 s.
    placed = place(*((None, None, 9_901 * k) for k in range(6000)))

    assert placed[-1][0] == pytest.approx(9_901 * 5999, abs=30_000)


@pytest.mark.parametrize(
    ("first", "second", "placed"),
    [
        (((1 << 32) - 4_000, 5, 0), (6_000, 6, 10_000), (10_000, 1)),
        ((0, 255, 0), (10_000, 0, 10_000), (10_000, 1)),
        ((0, 65_534, 0), (40_000, 2, 40_000), (40_000, 4)),  # 65,535, 0 and 1 were lost
        ((0, 10, 0), (30_000, 13, 30_000), (30_000, 3)),
        ((0, None, 0), (40_000, None, 40_000), (40_000, 4)),
        ((0, None, 0), (14_000, None, 14_000), (14_000, 1)),
        ((None, None, 0), (None, None, 1_000_000), (1_000_000, 100)),
        ((None, 7, 0), (None, 8, 1_000_000), (10_500, 1)),
    ],
    ids=[
        "stamp wraps", "8 bits wrap", "16 bits wrap over a loss", "counter shows a loss",
        "time shows a loss", "a late frame is no loss", "a silence is a loss", "counter shows a delay",
    ],
)  # fmt: skip
def test_a_frame_is_placed_by_its_stamp_its_counter_and_its_arrival(
    first: tuple[int | None, int | None, int],
    second: tuple[int | None, int | None, int],
    placed: tuple[int, int],
) -> None:
    assert place(first, second) == [(0, 0), placed]


def test_a_board_that_restarts_goes_on_by_the_arrivals() -> None:
    # Stamps begin anew after 2 s without a frame: 200 periods, 199 frames lost.
    clock = StreamClock(10_000.0)
    clock.place(500_000_000, 40_000, 0)

    assert clock.place(1_000, 0, 2_000_000) == (2_000_000, 200)
    assert clock.restarts == 1


def test_time_never_goes_back() -> None:
    clock = StreamClock(10_000.0)
    clock.place(500_000, None, 100)

    assert clock.place(400_000, None, 100)[0] == 10_000
