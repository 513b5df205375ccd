"""Published packages that compute the same: pingouin for agreement, rainflow for cycles."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.agreement.statistics import find_icc, measure_agreement
from fusion.exposure.cycles import RANGE_EDGES_DEG, CycleTally, count_rainflow
from fusion.exposure.metric_filter import MetricAngle

matplotlib = pytest.importorskip("matplotlib")
pingouin = pytest.importorskip("pingouin")
rainflow = pytest.importorskip("rainflow")
pd = pytest.importorskip("pandas")

CHANCE = np.random.default_rng(2)
REFERENCE_DEG = CHANCE.uniform(0.0, 120.0, 60)
OURS_DEG = REFERENCE_DEG + 4.0 + CHANCE.normal(0.0, 3.0, 60)
STEPS = st.lists(st.sampled_from(range(0, 181, 5)), min_size=3, max_size=60)


@pytest.mark.filterwarnings("ignore:The inplace keyword")  # pandas 3.1 about pingouin's own code
def test_icc_is_that_of_pingouin() -> None:
    table = pd.DataFrame(
        {
            "moment": np.tile(np.arange(len(OURS_DEG)), 2),
            "system": np.repeat(["ours", "reference"], len(OURS_DEG)),
            "angle_deg": np.concatenate([OURS_DEG, REFERENCE_DEG]),
        }
    )

    found = pingouin.intraclass_corr(table, targets="moment", raters="system", ratings="angle_deg")

    absolute_single = found.set_index("Type")["ICC"].filter(regex=r"^ICC(2|\(A,1\))$").item()
    assert find_icc(OURS_DEG, REFERENCE_DEG) == pytest.approx(absolute_single, abs=1e-9)


def test_bias_and_limits_of_agreement_are_those_that_pingouin_draws() -> None:
    agreement = measure_agreement(OURS_DEG, REFERENCE_DEG, 1.0)
    axes = matplotlib.figure.Figure().add_subplot()

    drawn = pingouin.plot_blandaltman(OURS_DEG, REFERENCE_DEG, agreement=1.96, confidence=None, ax=axes)

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
@settings(max_examples=50, deadline=None)
def test_every_range_and_its_count_are_those_of_rainflow(levels: list[int]) -> None:
    points = np.array(keep_turning_points(levels), np.float64)

    ranges_deg, counts, _ = count_rainflow(points, np.zeros(len(points), np.int64))

    theirs = [(cycle[0], cycle[2]) for cycle in rainflow.extract_cycles(levels)]
    ours = list(zip(ranges_deg.tolist(), counts.tolist(), strict=True))
    assert Counter(pair for pair in ours if pair[0] > 0) == Counter(pair for pair in theirs if pair[0] > 0)


@given(STEPS, STEPS)
@settings(max_examples=50, deadline=None)
def test_cycles_of_each_class_are_those_of_rainflow_before_and_after_a_hole(
    before: list[int], after: list[int]
) -> None:
    valid = np.ones(len(before) + 1 + len(after), np.bool_)
    valid[len(before)] = False
    angle = MetricAngle(0, 2.0, np.array([*before, 90, *after], np.float64), valid)
    tally = CycleTally(np.zeros(1), np.array([0, 10**9]))

    tally.add(angle)

    counts = np.zeros(len(RANGE_EDGES_DEG) - 1)
    for range_deg, _, count, _, _ in (*rainflow.extract_cycles(before), *rainflow.extract_cycles(after)):
        if range_deg >= 10:
            counts[np.searchsorted(np.array(RANGE_EDGES_DEG[:-1]), range_deg, side="right") - 1] += count
    assert [cycle.count for cycle in tally.summarise()] == counts.tolist()
