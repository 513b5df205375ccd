"""The statistics of agreement, against values worked out by hand, and what must always hold."""

from math import isnan, sqrt

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from fusion.agreement.statistics import (
    Agreement,
    find_concordance,
    find_icc,
    find_r,
    find_repeated_limits,
    measure_agreement,
)

OURS = np.array([12.0, 20.0, 34.0, 38.0])
REFERENCE = np.array([10.0, 20.0, 30.0, 40.0])
"""Differences 2, 0, 4, -2: mean 1, squares 24, absolute 8; about the mean 1, 1, 9, 9."""

ANGLES = arrays(np.float64, st.integers(3, 40), elements=st.floats(0, 180, width=32))


def measure(ours: object, reference: object) -> Agreement:
    return measure_agreement(np.asarray(ours, float), np.asarray(reference, float), 1.0)


def test_bias_is_ours_less_the_reference() -> None:
    assert measure(OURS, REFERENCE).bias_deg == pytest.approx(1.0)


def test_rmse_is_the_root_of_the_mean_square() -> None:
    assert measure(OURS, REFERENCE).rmse_deg == pytest.approx(sqrt(24 / 4))


def test_mean_absolute_error_leaves_the_sign_out() -> None:
    assert measure(OURS, REFERENCE).mean_absolute_error_deg == pytest.approx(8 / 4)


def test_limits_of_agreement_lie_at_two_sample_standard_deviations() -> None:
    agreement = measure(OURS, REFERENCE)

    sd = sqrt((1 + 1 + 9 + 9) / 3)
    assert (agreement.loa_low_deg, agreement.loa_high_deg) == pytest.approx((1 - 1.96 * sd, 1 + 1.96 * sd))


def test_r_by_hand() -> None:
    # About the means 26 and 25: ours -14 -6 8 12 (squares 440), reference -15 -5 5 15 (500), products 460.
    assert find_r(OURS, REFERENCE) == pytest.approx(460 / sqrt(440 * 500))


def test_concordance_by_hand() -> None:
    # Over n: covariance 115, variances 110 and 125, means one apart: 2 * 115 / (110 + 125 + 1).
    assert find_concordance(OURS, REFERENCE) == pytest.approx(230 / 236)


def test_icc_by_hand() -> None:
    # Row means 11 20 32 39 about 25.5: sum of squares 465, MSR = 2 * 465 / 3 = 310.
    # Columns: 4 * (0.25 + 0.25) = 2 = MSC. Residuals of each row +-(d - 1) / 2: 2 * (1 + 1 + 9 + 9) / 4 = 10,
    # MSE = 10 / 3. ICC(A,1) = (310 - 10/3) / (310 + 10/3 + 2 (2 - 10/3) / 4).
    assert find_icc(OURS, REFERENCE) == pytest.approx((310 - 10 / 3) / (310 + 10 / 3 + (2 - 10 / 3) / 2))


def test_a_reference_that_hardly_moves_has_no_r() -> None:
    agreement = measure([44.0, 45.0, 47.0], [45.0, 45.0, 46.0])

    assert (agreement.is_quasi_static, isnan(agreement.r), isnan(agreement.icc)) == (True, True, True)


def test_no_row_gives_no_number() -> None:
    agreement = measure([], [])

    assert (agreement.count, isnan(agreement.rmse_deg)) == (0, True)


def test_repeated_measures_by_hand() -> None:
    # Errors 1, 3 and 5, 7: bias 4; within: (2 + 2) / (4 - 2) = 2; between mean square 2 * (4 + 4) / 1 = 16,
    # m0 = (16 - 8) / 4 = 2, so between = (16 - 2) / 2 = 7; spread 1.96 * sqrt(7 + 2) = 5.88.
    one, other = measure([11.0, 13.0], [10.0, 10.0]), measure([15.0, 17.0], [10.0, 10.0])

    limits = find_repeated_limits([one, other])

    assert (limits.bias_deg, limits.low_deg, limits.high_deg) == pytest.approx((4.0, -1.88, 9.88))


def test_one_group_has_the_plain_limits() -> None:
    agreement = measure(OURS, REFERENCE)

    limits = find_repeated_limits([agreement])

    assert (limits.low_deg, limits.high_deg) == pytest.approx((agreement.loa_low_deg, agreement.loa_high_deg))


@given(ANGLES, st.floats(-50, 50))
def test_a_constant_error_is_the_bias_and_all_of_the_rmse(reference: np.ndarray, shift: float) -> None:
    agreement = measure(reference + shift, reference)

    assert agreement.bias_deg == pytest.approx(shift, abs=1e-9)
    assert agreement.rmse_deg == pytest.approx(abs(shift), abs=1e-9)


@given(st.data())
def test_swapping_the_sides_turns_the_bias_and_nothing_else(data: st.DataObject) -> None:
    ours = data.draw(ANGLES)
    reference = data.draw(arrays(np.float64, len(ours), elements=st.floats(0, 180, width=32)))

    forth, back = measure(ours, reference), measure(reference, ours)

    assert forth.bias_deg == pytest.approx(-back.bias_deg, abs=1e-9)
    assert forth.rmse_deg == pytest.approx(back.rmse_deg)
    assert forth.loa_low_deg == pytest.approx(-back.loa_high_deg, abs=1e-9)


@given(st.data())
def test_mean_absolute_error_never_exceeds_the_rmse_nor_concordance_the_correlation(
    data: st.DataObject,
) -> None:
    ours = data.draw(ANGLES)
    reference = data.draw(arrays(np.float64, len(ours), elements=st.floats(0, 180, width=32)))
    assume(min(ours.std(), reference.std()) > 0.1)

    agreement = measure(ours, reference)

    assert agreement.mean_absolute_error_deg <= agreement.rmse_deg + 1e-9
    assert abs(find_concordance(ours, reference)) <= abs(find_r(ours, reference)) + 1e-9


@given(ANGLES)
def test_the_same_angle_twice_agrees_fully(reference: np.ndarray) -> None:
    assume(reference.std() > 5.0)

    agreement = measure(reference, reference)

    assert (agreement.r, agreement.icc, agreement.concordance) == pytest.approx((1.0, 1.0, 1.0))
