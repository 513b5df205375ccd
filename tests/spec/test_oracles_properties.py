"""What must hold for any movement: EXPOSURE.md part D, rows 24, 25 and 26."""

from itertools import pairwise, permutations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from fusion.elevation import Elevation, ElevationSegment
from fusion.exposure import Exposure, summarise_exposure
from tests.factories import elevate

CUBE = [
    np.diag(signs) @ np.eye(3)[list(order)]
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if round(np.linalg.det(np.diag(signs) @ np.eye(3)[list(order)])) == 1
]


def move(rate_hz: float, turn: NDArray[np.float64] | None = None) -> Exposure:
    """Lift and turn for five minutes, seen by a sensor mounted in one of the 24 ways."""
    time_s = np.arange(round(300 * rate_hz)) / rate_hz
    angle = 50 + 30 * np.sin(2 * np.pi * 0.11 * time_s) + 15 * np.sin(2 * np.pi * 0.5 * time_s)
    polar, plane = np.radians(angle), np.radians(40 * np.sin(2 * np.pi * 0.07 * time_s))
    vertical = np.stack([np.sin(polar) * np.cos(plane), np.sin(polar) * np.sin(plane), np.cos(polar)], axis=1)
    seen = (vertical @ (np.eye(3) if turn is None else turn).T).astype(np.float32)
    segment = ElevationSegment(0, rate_hz, angle.astype(np.float32), np.ones(len(angle), np.bool_), seen)
    return summarise_exposure(Elevation((segment,), None))


def list_figures(exposure: Exposure) -> list[float]:
    generalised = exposure.velocity_dps["generalised"]
    inclination = exposure.velocity_dps["inclination"]
    assert generalised is not None
    assert inclination is not None
    return [
        *(part.percent for part in exposure.bins),
        *(exposure.percentiles_deg[p] for p in (10, 50, 90)),
        *(entries.count for entries in exposure.entries),
        *(cycles.count for cycles in exposure.cycles),
        generalised.p50_dps,
        generalised.mean_dps,
        inclination.p50_dps,
    ]


@pytest.mark.parametrize(
    "turn", CUBE, ids=lambda turn: "".join("xyz"[int(i)] for i in np.abs(turn).argmax(1))
)
def test_24_no_figure_depends_on_how_the_sensor_is_mounted(turn: NDArray[np.float64]) -> None:
    assert list_figures(move(50.0, turn)) == pytest.approx(list_figures(move(50.0)), abs=1e-3)


@pytest.mark.parametrize("rate_hz", [64.0, 99.7, 499.3])
def test_24_no_figure_depends_on_the_rate_by_more_than_its_resolution(rate_hz: float) -> None:
    assert list_figures(move(rate_hz)) == pytest.approx(list_figures(move(100.0)), abs=0.15)


DAYS = st.lists(
    st.tuples(st.sampled_from([5.0, 25.0, 33.0, 61.0, 77.0, 95.0, 178.0]), st.integers(1, 900)),
    min_size=1,
    max_size=30,
)


def live(parts: list[tuple[float, int]]) -> Exposure:
    return summarise_exposure(elevate(np.concatenate([np.full(n, angle) for angle, n in parts]), rate_hz=1.0))


@given(DAYS)
def test_25_bins_make_the_whole_and_hours_make_the_day(parts: list[tuple[float, int]]) -> None:
    exposure = live(parts)

    assert sum(part.duration_s for part in exposure.bins) == exposure.analysed_s
    assert sum(hour.analysed_s for hour in exposure.by_hour) == exposure.analysed_s
    assert sum(part.percent for part in exposure.bins) == pytest.approx(100.0)


@given(DAYS)
def test_26_higher_thresholds_and_longer_windows_hold_less(parts: list[tuple[float, int]]) -> None:
    exposure = live(parts)

    above = [item.percent for item in exposure.time_above]
    percentiles = list(exposure.percentiles_deg.values())
    windows = [w.percent_above_60 for w in exposure.peak_windows if w.percent_above_60 is not None]
    assert above == sorted(above, reverse=True)
    assert percentiles == sorted(percentiles)
    assert all(short >= long - 1e-6 for short, long in pairwise(windows))
