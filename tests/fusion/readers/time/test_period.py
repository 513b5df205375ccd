"""The sample period is found however many rows are lost, so that what is lost is missing."""

import numpy as np
import pytest
from numpy.typing import NDArray

from fusion.readers.timebase.grid import estimate_period_us


def stamp(rate_hz: float, lost: float, jitter_us: float, clock_us: int) -> NDArray[np.int64]:
    random = np.random.default_rng(1)
    kept = np.flatnonzero(random.random(6000) >= lost)
    exact = kept * 1e6 / rate_hz + random.uniform(-jitter_us, jitter_us, len(kept))
    return (np.floor(exact / clock_us) * clock_us).astype(np.int64)


@pytest.mark.parametrize("rate_hz", [100.0, 119.0, 952.0])
@pytest.mark.parametrize("lost", [0.0, 0.2])
@pytest.mark.parametrize("jitter_us", [0.0, 200.0])
def test_lost_rows_do_not_lengthen_the_period(rate_hz: float, lost: float, jitter_us: float) -> None:
    period_us = estimate_period_us(stamp(rate_hz, lost, jitter_us, clock_us=1))

    assert period_us == pytest.approx(1e6 / rate_hz, rel=2e-3)


@pytest.mark.parametrize("rate_hz", [119.0, 499.7])
@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_a_millisecond_clock_is_fine_enough_up_to_500_hz(rate_hz: float, lost: float) -> None:
    period_us = estimate_period_us(stamp(rate_hz, lost, 0.0, clock_us=1000))

    assert period_us == pytest.approx(1e6 / rate_hz, rel=2e-3)


def test_every_tenth_row_lost_is_no_slower_sensor() -> None:
    rows = np.arange(6000)

    period_us = estimate_period_us((rows[rows % 10 != 9] * 10_000).astype(np.int64))

    assert period_us == 10_000.0
