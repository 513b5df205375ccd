"""Published packages that compute the same: pingouin for agreement, rainflow for cycles."""

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.comparison.agreement import compute_icc, measure_agreement
from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.speeds import RANGE_EDGES_DEG, CycleTally, count_rainflow
from acromion.fusion.exposure.summary import summarise_exposure
from tests.fusion.exposure import slow_exposure

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
    assert compute_icc(OURS_DEG, REFERENCE_DEG) == pytest.approx(absolute_single, abs=1e-9)


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


# The fast metrics against the slow, obvious ones, over random piecewise signals with holes and distrust.

# where the rules turn: thresholds, thresholds plus and minus the hysteresis, edges of bins
TURNING_DEG = st.sampled_from(
    [0.0, 20.0, 24.5, 25.0, 30.0, 35.0, 35.5, 54.5, 55.0, 60.0, 65.0, 65.5, 90.0, 95.5, 180.0]
)
ANY_DEG = st.integers(0, 360).map(lambda half: half / 2)
PIECES = st.tuples(TURNING_DEG | ANY_DEG, st.integers(1, 40), st.booleans(), st.integers(0, 9))


def make_segment(
    start_us: int, rate_hz: float, pieces: list[tuple[float, int, bool, int]]
) -> ElevationSegment:
    """Hold or ramp to each level in turn; one piece in ten is not trusted."""
    angle, valid, level = [], [], pieces[0][0]
    for target, rows, ramp, trust in pieces:
        path = np.linspace(level, target, rows + 1)[1:] if ramp else np.full(rows, target)
        angle.append(np.round(path * 8) / 8)  # exact in float32
        valid.append(np.full(rows, trust > 0))
        level = target
    return ElevationSegment(
        start_us, rate_hz, np.concatenate(angle).astype(np.float32), np.concatenate(valid)
    )


@st.composite
def elevations(draw: st.DrawFn) -> Elevation:
    rate_hz = draw(st.sampled_from([2.0, 4.0, 10.0]))
    segments, start_us = [], 0
    for pieces in draw(st.lists(st.lists(PIECES, min_size=1, max_size=25), min_size=1, max_size=3)):
        segment = make_segment(start_us, rate_hz, pieces)
        segments.append(segment)
        hole_us = draw(st.integers(1, 40)) * 500_000
        start_us += round(len(segment) * 1e6 / rate_hz) + hole_us
    if not any(segment.valid.any() for segment in segments):
        segments[0].valid[:] = True
    return Elevation(tuple(segments), None)


def end_s(elevation: Elevation) -> float:
    last = elevation.segments[-1]
    return last.start_us / 1e6 + len(last) / last.rate_hz


@given(elevations())
@settings(max_examples=40, deadline=None)
def test_entries_are_those_of_the_trigger_walked_row_by_row(elevation: Elevation) -> None:
    exposure = summarise_exposure(elevation)

    for entries in exposure.entries:
        assert entries.count == slow_exposure.count_entries(elevation, entries.threshold_deg)


@given(elevations())
@settings(max_examples=40, deadline=None)
def test_episodes_are_those_of_the_trigger_merged_and_dropped_one_by_one(elevation: Elevation) -> None:
    exposure = summarise_exposure(elevation)

    for episodes in exposure.episodes:
        slow = slow_exposure.list_episodes(elevation, episodes.threshold_deg)
        longest = max(slow, key=lambda episode: (round(episode[1], 6), -episode[0]), default=None)
        assert episodes.count == len(slow)
        assert episodes.censored == sum(censored for _, _, censored in slow)
        assert episodes.median_s == pytest.approx(
            slow_exposure.median_episode(elevation, episodes.threshold_deg)
        )
        assert episodes.longest_s == pytest.approx(longest[1] if longest else None)
        assert episodes.longest_start_s == pytest.approx(longest[0] if longest else None)


@given(elevations())
@settings(max_examples=20, deadline=None)
def test_the_worst_minute_is_the_worst_of_all_minutes_tried_one_by_one(elevation: Elevation) -> None:
    exposure = summarise_exposure(elevation)

    slow = slow_exposure.find_worst_window(elevation, 60, end_s(elevation))
    minute = exposure.peak_windows[0]
    assert minute.start_s == (None if slow is None else slow[0])
    assert minute.percent_above_60 == pytest.approx(None if slow is None else slow[1])
