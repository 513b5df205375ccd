"""The fast metrics against the slow, obvious ones, over random piecewise signals with holes and distrust."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.elevation import Elevation, ElevationSegment
from fusion.exposure import summarise_exposure
from tests.fusion.exposure import slow_exposure

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
