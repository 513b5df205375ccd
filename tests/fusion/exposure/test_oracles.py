"""Published packages that compute the same: pingouin for agreement, rainflow for cycles."""

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from fusion.agreement.statistics import find_icc, measure_agreement
from fusion.exposure.cycles import RANGE_EDGES_DEG, CycleTally, count_rainflow
from fusion.exposure.metric_filter import MetricAngle

matplotlib = pytest.importorskip("matplotlib")
pingouin = pytest.importorskip("pingouin")
rainflow = pytest.importorskip("rainflow")
pd = pytest.importorskip("pandas")

Vector = NDArray[np.float64]


def measure_pair(seed: int, count: int, bias_deg: float) -> tuple[Vector, Vector]:
    """Make an angle and another with noise and a bias, shape (n,), deg."""
    chance = np.random.default_rng(seed)
    reference_deg = chance.uniform(0.0, 120.0, count)
    return reference_deg + bias_deg + chance.normal(0.0, 1.0 + seed, count), reference_deg


PAIRS = pytest.mark.parametrize(("seed", "count", "bias_deg"), [(1, 12, 0.0), (2, 60, 4.0), (9, 200, -15.0)])


@pytest.mark.filterwarnings("ignore:The inplace keyword")  # pandas 3.1 about pingouin's own code
@PAIRS
def test_icc_is_that_of_pingouin(seed: int, count: int, bias_deg: float) -> None:
    ours_deg, reference_deg = measure_pair(seed, count, bias_deg)
    moments = np.arange(count)
    table = pd.DataFrame(
        {
            "moment": np.tile(moments, 2),
            "system": np.repeat(["ours", "reference"], count),
            "angle_deg": np.concatenate([ours_deg, reference_deg]),
        }
    )

    found = pingouin.intraclass_corr(table, targets="moment", raters="system", ratings="angle_deg")

    absolute_single = found.set_index("Type")["ICC"].filter(regex=r"^ICC(2|\(A,1\))$").item()
    assert find_icc(ours_deg, reference_deg) == pytest.approx(absolute_single, abs=1e-9)


@pytest.fixture
def axes() -> Iterator[object]:
    figure = matplotlib.figure.Figure()
    yield figure.add_subplot()
    figure.clear()


@PAIRS
def test_bias_and_limits_of_agreement_are_those_that_pingouin_draws(
    axes: object, seed: int, count: int, bias_deg: float
) -> None:
    ours_deg, reference_deg = measure_pair(seed, count, bias_deg)
    agreement = measure_agreement(ours_deg, reference_deg, 1.0)

    drawn = pingouin.plot_blandaltman(ours_deg, reference_deg, agreement=1.96, confidence=None, ax=axes)

    lines = [line.get_ydata()[0] for line in drawn.lines if line.get_color() == "k"]
    assert [agreement.bias_deg, agreement.loa_high_deg, agreement.loa_low_deg] == pytest.approx(lines)


LEVELS = st.lists(st.integers(0, 180), min_size=3, max_size=120)
"""Of two samples, rainflow 3.2 counts nothing; the standard, and we, half a cycle."""


def keep_turning_points(levels: list[int]) -> list[int]:
    """Leave out what is no end, peak or valley, as rainflow does."""
    moving = [levels[0]] + [b for a, b in pairwise(levels) if a != b]
    inner = [b for a, b, c in zip(moving, moving[1:], moving[2:], strict=False) if (b - a) * (c - b) < 0]
    return moving if len(moving) < 3 else [moving[0], *inner, moving[-1]]


@given(LEVELS)
@settings(deadline=None)
def test_every_range_and_its_count_are_those_of_rainflow(levels: list[int]) -> None:
    points = np.array(keep_turning_points(levels), np.float64)

    ranges_deg, counts, _ = count_rainflow(points, np.zeros(len(points), np.int64))

    theirs = [(cycle[0], cycle[2]) for cycle in rainflow.extract_cycles(levels)]
    ours = list(zip(ranges_deg.tolist(), counts.tolist(), strict=True))
    assert Counter(pair for pair in ours if pair[0] > 0) == Counter(pair for pair in theirs if pair[0] > 0)


@given(st.lists(st.sampled_from(range(0, 181, 5)), min_size=3, max_size=120))
@settings(deadline=None)
def test_cycles_of_each_class_are_those_of_rainflow(levels: list[int]) -> None:
    angle = MetricAngle(0, 2.0, np.array(levels, np.float64), np.ones(len(levels), np.bool_))
    tally = CycleTally(np.zeros(1), np.array([0, 10**9]))

    tally.add(angle)

    counts = np.zeros(len(RANGE_EDGES_DEG) - 1)
    for range_deg, _, count, _, _ in rainflow.extract_cycles(levels):
        if range_deg >= 10:
            counts[np.searchsorted(np.array(RANGE_EDGES_DEG[:-1]), range_deg, side="right") - 1] += count
    assert [cycle.count for cycle in tally.summarise()] == counts.tolist()
