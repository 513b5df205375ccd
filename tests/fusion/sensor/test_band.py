"""Equations whose unknowns are tied to their neighbours only: their matrix is a band."""

import numpy as np
import pytest

from fusion.sensor.model import solve_band

# 4 2 0     the diagonal, then the one below it
# 2 5 2
# 0 2 5
BAND = np.array([[4.0, 5.0, 5.0], [2.0, 2.0, 0.0]])


def test_each_row_of_the_right_side_is_solved_by_itself_and_what_is_given_stays() -> None:
    band, right = BAND.copy(), np.array([[8.0, 18.0, 19.0], [4.0, 2.0, 0.0]])
    given = right.copy()

    solved = solve_band(band, right)

    assert solved == pytest.approx(np.array([[1.0, 2.0, 3.0], [1.0, 0.0, 0.0]]), abs=1e-14)
    assert (band == BAND).all()
    assert (right == given).all()


def test_a_band_that_is_not_positive_definite_is_refused() -> None:
    with pytest.raises(np.linalg.LinAlgError):
        solve_band(np.array([[1.0, 1.0], [2.0, 0.0]]), np.ones((1, 2)))
