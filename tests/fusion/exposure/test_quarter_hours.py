"""The three quarter hours with the most time above 60 deg."""

import numpy as np

from fusion.exposure.peaks import find_quarter_hours
from fusion.recording import MICROSECONDS

HOUR_S = 3600


def find_in(
    above: dict[int, float], *, length_s: int = 2 * HOUR_S
) -> list[tuple[float | None, float | None]]:
    """Give start and share of the quarter hours where ``above[s]`` seconds from ``s`` lie above 60 deg."""
    seconds = np.zeros((length_s, 2))
    seconds[:, 0] = 1.0
    for start_s, duration_s in above.items():
        seconds[start_s : start_s + int(duration_s), 1] = 1.0
    windows = find_quarter_hours(seconds, length_s * MICROSECONDS)
    return [(window.start_s, window.percent_above_60) for window in windows]


def test_the_three_stand_in_the_order_of_their_time_above() -> None:
    found = find_in({0: 90, 2700: 450, 5400: 180, 6500: 45})

    assert [percent for _, percent in found] == [50.0, 20.0, 10.0]


def test_none_of_them_overlap() -> None:
    found = find_in({1000: 2700})

    assert sorted(start_s for start_s, _ in found if start_s is not None) == [1000, 1900, 2800]


def test_a_quarter_hour_without_time_above_is_none() -> None:
    assert find_in({600: 90}) == [(0.0, 10.0)]


def test_less_than_a_quarter_hour_holds_none() -> None:
    assert find_in({0: 300}, length_s=899) == []
