"""Two clocks of one motion: a known offset and drift are found, holes stay holes."""

from math import isnan, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray

from acromion.fusion.comparison.agreement import (
    Agreement,
    compute_concordance,
    compute_icc,
    compute_repeated_limits,
    measure_agreement,
)
from acromion.fusion.comparison.alignment import (
    Alignment,
    ClockSettings,
    Run,
    Runs,
    WindowLag,
    align,
    compute_pearson_r,
    interpolate,
    pair,
)
from acromion.fusion.errors import NotAligned, NothingInCommon

SECONDS = 900.0


def move(time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Work with long still parts: bursts of swings of no fixed rhythm, a held arm in between."""
    swing = 30 * np.sin(1.05 * time_s + 2 * np.sin(0.1317 * time_s)) + 12 * np.sin(0.3719 * time_s + 1)
    return np.asarray(60 + np.clip(4 * np.sin(0.0437 * time_s), 0, 1) * swing)


def see(rate_hz: float, offset_s: float, drift_ppm: float, noise_deg: float, seed: int) -> Runs:
    """The motion as seen with a clock of its own."""
    clock_s = offset_s + np.arange(int(SECONDS * rate_hz)) / rate_hz
    recording_s = (clock_s - offset_s) / (1 + drift_ppm / 1e6)
    noise = np.random.default_rng(seed).normal(0, noise_deg, len(clock_s))
    return (Run(offset_s, rate_hz, (move(recording_s) + noise).astype(np.float32)),)


@pytest.mark.parametrize(
    ("offset_s", "drift_ppm"), [(0.0, 0.0), (-37.2, 40.0), (1.7e9, -120.0), (4.0, 300.0)]
)
def test_offset_is_found_to_5_ms_and_drift_to_5_ppm(offset_s: float, drift_ppm: float) -> None:
    ours, reference = see(100, 0, 0, 0.5, 1), see(60, offset_s, drift_ppm, 0.5, 2)

    found = align(ours, reference)

    assert found.offset_s == pytest.approx(offset_s, abs=0.005)
    assert found.drift_ppm == pytest.approx(drift_ppm, abs=5)


def test_a_short_reference_is_found_within_a_long_recording_and_tells_no_drift() -> None:
    whole = see(60, 0.0, 0, 0.5, 2)[0]
    low = whole.values * np.float32(0.85) + np.float32(9)  # an error of the pose shifts no clock
    part = Run(0.0, 60.0, low[300 * 60 : 400 * 60])

    found = align(see(100, 0, 0, 0.5, 1), (part,))

    assert found.offset_s == pytest.approx(-300, abs=0.005)
    assert (found.is_drift_fitted, found.drift_ppm) == (False, 0.0)


@pytest.mark.parametrize(
    ("clock", "expected"),
    [(ClockSettings(5.25, 10.0), (5.25, 10.0)), (ClockSettings(drift_ppm=80.0), (5.0, 80.0))],
)
def test_what_is_given_by_hand_stays_and_the_rest_is_found(
    clock: ClockSettings, expected: tuple[float, float]
) -> None:
    found = align(see(100, 0, 0, 0, 1), see(60, 5.0, 80.0, 0, 2), clock)

    assert (found.offset_s, found.drift_ppm) == pytest.approx(expected, abs=0.005)


def test_motions_that_are_not_alike_are_refused() -> None:
    noise = np.random.default_rng(3).normal(60, 10, 9000).astype(np.float32)

    with pytest.raises(NotAligned):
        align(see(100, 0, 0, 0, 1), (Run(0.0, 60.0, noise),))


def test_a_few_seconds_of_like_motion_tell_no_shift_but_it_may_be_given_by_hand() -> None:
    ours, piece = (
        see(100, 0, 0, 0, 1),
        (Run(0.0, 60.0, see(60, 0.0, 0, 0, 2)[0].values[320 * 60 : 328 * 60]),),
    )

    with pytest.raises(NotAligned) as refusal:
        align(ours, piece)

    assert float(refusal.value.facts["motion_s"]) < 8.1
    assert align(ours, piece, ClockSettings(offset_s=-320.0)).offset_s == -320.0


def test_a_short_motion_that_fits_in_two_places_is_refused() -> None:
    # A burst of 20 s that comes twice: nothing tells which of them the reference saw.
    burst = np.concatenate([np.full(600, 60.0), see(10, 0.0, 0, 0, 2)[0].values[300:500], np.full(600, 60.0)])

    with pytest.raises(NotAligned) as refusal:
        align((Run(0.0, 10.0, np.tile(burst, 2)),), (Run(0.0, 10.0, burst[500:900]),))

    assert refusal.value.facts["rival"] == pytest.approx(1.0, abs=0.02)


def test_the_margin_of_a_drift_is_10_ms_over_the_span_of_its_stretches() -> None:
    windows = tuple(WindowLag(start_s, 0.0, 0.9) for start_s in (10.0, 250.0, 410.0))

    found = Alignment(0.0, 40.0, is_drift_fitted=True, windows=windows)

    assert found.drift_margin_ppm == pytest.approx(25.0)


def test_a_hole_of_either_side_stays_a_hole_and_the_slower_side_gives_the_moments() -> None:
    ours = (Run(0.0, 10.0, np.arange(100.0)),)
    reference = (Run(0.0, 20.0, np.arange(60.0)), Run(5.0, 20.0, np.arange(100.0)))

    paired = pair(ours, reference, Alignment(0.0, 0.0))

    # The first reference run ends at 2.95 s, the second lasts from 5 to 9.95 s: rows 0 to 29 and 50 to 99.
    assert paired.rate_hz == pytest.approx(10.0)
    assert [(run.start_s, len(run)) for run in paired.runs] == [(0.0, 30), (5.0, 50)]


def test_no_common_time_is_refused() -> None:
    run = (Run(0.0, 10.0, np.zeros(100)),)

    with pytest.raises(NothingInCommon):
        pair(run, run, Alignment(1000.0, 0.0))


def test_between_its_values_a_run_follows_a_cubic_exactly() -> None:
    time_s = np.arange(20) / 10
    run = Run(0.0, 10.0, time_s**3 - 2 * time_s)

    assert interpolate(run, np.array([0.02, 0.53, 1.87])) == pytest.approx(
        [0.02**3 - 0.04, 0.53**3 - 1.06, 1.87**3 - 3.74]
    )


# The statistics of agreement, against values worked out by hand, and what must always hold.

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
    assert compute_pearson_r(OURS, REFERENCE) == pytest.approx(460 / sqrt(440 * 500))
    # Over n: covariance 115, variances 110 and 125, means one apart: 2 * 115 / (110 + 125 + 1).
    assert compute_concordance(OURS, REFERENCE) == pytest.approx(230 / 236)


def test_icc_by_hand() -> None:
    # Row means 11 20 32 39 about 25.5: sum of squares 465, MSR = 2 * 465 / 3 = 310.
    # Columns: 4 * (0.25 + 0.25) = 2 = MSC. Residuals of each row +-(d - 1) / 2: 2 * (1 + 1 + 9 + 9) / 4 = 10,
    # MSE = 10 / 3. ICC(A,1) = (310 - 10/3) / (310 + 10/3 + 2 (2 - 10/3) / 4).
    assert compute_icc(OURS, REFERENCE) == pytest.approx((310 - 10 / 3) / (310 + 10 / 3 + (2 - 10 / 3) / 2))


def test_a_reference_that_hardly_moves_has_no_r_and_no_rows_no_number() -> None:
    still, empty = measure([44.0, 45.0, 47.0], [45.0, 45.0, 46.0]), measure([], [])

    assert (still.is_quasi_static, isnan(still.r), isnan(still.icc)) == (True, True, True)
    assert (empty.count, isnan(empty.rmse_deg)) == (0, True)


def test_repeated_measures_by_hand() -> None:
    # Errors 1, 3 and 5, 7: bias 4; within: (2 + 2) / (4 - 2) = 2; between mean square 2 * (4 + 4) / 1 = 16,
    # m0 = (16 - 8) / 4 = 2, so between = (16 - 2) / 2 = 7; spread 1.96 * sqrt(7 + 2) = 5.88.
    one, other = measure([11.0, 13.0], [10.0, 10.0]), measure([15.0, 17.0], [10.0, 10.0])

    limits, plain = compute_repeated_limits([one, other]), compute_repeated_limits([one])

    assert (limits.bias_deg, limits.low_deg, limits.high_deg) == pytest.approx((4.0, -1.88, 9.88))
    assert (plain.low_deg, plain.high_deg) == pytest.approx((one.loa_low_deg, one.loa_high_deg))
