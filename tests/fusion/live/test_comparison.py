"""What was shown against the report: differences worked out by hand."""

import numpy as np
import pytest

from fusion.elevation import Elevation, ElevationSegment
from fusion.live import LiveRows, ShownAngles, compare_shown

ROWS = 1000


def show(angle_deg: float, *, valid_from: int = 0) -> ShownAngles:
    shown = ShownAngles()
    rows = np.arange(ROWS)
    shown.keep(LiveRows(rows * 10_000, np.full(ROWS, angle_deg, np.float32), rows >= valid_from))
    return shown


def report(*angles_deg: float) -> Elevation:
    """Ten seconds at 100 Hz, in equal parts of each angle."""
    angle_deg = np.repeat(np.array(angles_deg, np.float32), ROWS // len(angles_deg))
    return Elevation((ElevationSegment(0, 100.0, angle_deg, np.isfinite(angle_deg)),), None)


def test_the_same_angle_does_not_differ() -> None:
    found = compare_shown(show(40.0), report(40.0))

    assert found is not None
    assert (found.compared_s, found.rmse_deg, found.bias_deg) == (10.0, 0.0, 0.0)
    assert found.live_percent == found.report_percent == (0.0, 100.0, 0.0, 0.0)


def test_an_error_in_half_of_the_time() -> None:
    # Live 62, report 62 then 58: off by 0 and by 4: mean 2, root mean square sqrt(8).
    found = compare_shown(show(62.0), report(62.0, 58.0))

    assert found is not None
    assert found.bias_deg == pytest.approx(2.0)
    assert found.rmse_deg == pytest.approx(8.0**0.5)
    assert found.report_percent == (0.0, 50.0, 50.0, 0.0)


def test_only_moments_that_both_know_are_compared() -> None:
    found = compare_shown(show(40.0, valid_from=300), report(40.0, np.nan))

    assert found is not None
    assert found.compared_s == 2.0  # from 3 s to 5 s


def test_nothing_in_common_is_no_comparison() -> None:
    assert compare_shown(show(40.0), report(np.nan)) is None
