"""The statistics of agreement, against values worked out by hand, and what must always hold."""

from math import isnan, sqrt

import numpy as np
import pytest

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


def measure(ours: object, reference: object) -> Agreement:
    return measure_agreement(np.asarray(ours, float), np.asarray(reference, float), 1.0)


def test_agreement_by_hand() -> None:
    agreement, sd = measure(OURS, REFERENCE), sqrt((1 + 1 + 9 + 9) / 3)

    assert agreement.bias_deg == pytest.approx(1.0)
    assert agreement.rmse_deg == pytest.approx(sqrt(24 / 4))
    assert agreement.mean_absolute_error_deg == pytest.approx(8 / 4)
    assert (agreement.loa_low_deg, agreement.loa_high_deg) == pytest.approx((1 - 1.96 * sd, 1 + 1.96 * sd))


def test_correlation_and_concordance_by_hand() -> None:
    # About the means 26 and 25: ours -14 -6 8 12 (squares 440), reference -15 -5 5 15 (500), products 460.
    assert find_r(OURS, REFERENCE) == pytest.approx(460 / sqrt(440 * 500))
    # Over n: covariance 115, variances 110 and 125, means one apart: 2 * 115 / (110 + 125 + 1).
    assert find_concordance(OURS, REFERENCE) == pytest.approx(230 / 236)


def test_icc_by_hand() -> None:
    # Row means 11 20 32 39 about 25.5: sum of squares 465, MSR = 2 * 465 / 3 = 310.
    # Columns: 4 * (0.25 + 0.25) = 2 = MSC. Residuals of each row +-(d - 1) / 2: 2 * (1 + 1 + 9 + 9) / 4 = 10,
    # MSE = 10 / 3. ICC(A,1) = (310 - 10/3) / (310 + 10/3 + 2 (2 - 10/3) / 4).
    assert find_icc(OURS, REFERENCE) == pytest.approx((310 - 10 / 3) / (310 + 10 / 3 + (2 - 10 / 3) / 2))


def test_a_reference_that_hardly_moves_has_no_r_and_no_rows_no_number() -> None:
    still, empty = measure([44.0, 45.0, 47.0], [45.0, 45.0, 46.0]), measure([], [])

    assert (still.is_quasi_static, isnan(still.r), isnan(still.icc)) == (True, True, True)
    assert (empty.count, isnan(empty.rmse_deg)) == (0, True)


def test_repeated_measures_by_hand() -> None:
    # Errors 1, 3 and 5, 7: bias 4; within: (2 + 2) / (4 - 2) = 2; between mean square 2 * (4 + 4) / 1 = 16,
    # m0 = (16 - 8) / 4 = 2, so between = (16 - 2) / 2 = 7; spread 1.96 * sqrt(7 + 2) = 5.88.
    one, other = measure([11.0, 13.0], [10.0, 10.0]), measure([15.0, 17.0], [10.0, 10.0])

    limits, plain = find_repeated_limits([one, other]), find_repeated_limits([one])

    assert (limits.bias_deg, limits.low_deg, limits.high_deg) == pytest.approx((4.0, -1.88, 9.88))
    assert (plain.low_deg, plain.high_deg) == pytest.approx((one.loa_low_deg, one.loa_high_deg))
