"""Cues, each worked out by hand; rows of 10 Hz."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.live import LiveRows
from fusion.live.cues import CueRule, CueWatch


def lay(*poses: tuple[float, float], rate_hz: float = 10.0) -> LiveRows:
    """Each (angle, seconds) in turn; NaN is an angle that is not counted."""
    angle_deg = np.concatenate([np.full(round(seconds * rate_hz), angle) for angle, seconds in poses])
    time_us = (np.arange(len(angle_deg)) * round(1e6 / rate_hz)).astype(np.int64)
    return LiveRows(time_us, angle_deg.astype(np.float32), np.isfinite(angle_deg))


def find_times_s(rule: CueRule, rows: LiveRows) -> list[float]:
    return [cue.time_s for cue in CueWatch((rule,)).take(rows)]


HOLD = CueRule("hold", 60.0, seconds=10.0)
SHARE = CueRule("share", 60.0, percent=10.0)
STAYS = CueRule("stays", 60.0, seconds=30.0)


def test_an_arm_held_up_brings_a_cue_after_its_time_and_again() -> None:
    # Above from 5.0 s on (the row before is at 4.9 s): 10 s have passed at 14.9 s, 20 s at 24.9 s.
    assert find_times_s(HOLD, lay((20.0, 5.0), (70.0, 21.0), (20.0, 5.0))) == pytest.approx([14.9, 24.9])


def test_an_arm_that_comes_down_in_time_brings_none() -> None:
    assert find_times_s(HOLD, lay((20.0, 5.0), (70.0, 9.9), (20.0, 1.0), (70.0, 9.9))) == []


def test_the_angle_itself_counts_as_above() -> None:
    assert len(find_times_s(HOLD, lay((20.0, 5.0), (60.0, 10.5)))) == 1


def test_what_is_not_counted_ends_a_stay() -> None:
    assert find_times_s(HOLD, lay((20.0, 5.0), (70.0, 9.0), (np.nan, 0.5), (70.0, 9.0))) == []


def test_a_hole_ends_a_stay() -> None:
    rows = lay((70.0, 18.0))
    late = rows.time_us.copy()
    late[90:] += 1_000_000

    assert find_times_s(HOLD, LiveRows(late, rows.elevation_deg, rows.valid)) == []


def test_no_share_is_told_before_most_of_a_quarter_hour_is_known() -> None:
    # 80 % of 900 s: 720 s after the first row, whose step is not known.
    (first, *_) = find_times_s(SHARE, lay((70.0, 800.0)))

    assert first == pytest.approx(720.0, abs=0.2)


def test_a_share_is_told_when_it_is_passed_and_again_a_minute_later() -> None:
    # 10 % of what is known, t seconds, is passed when t - 1000 > 0.1 x 900: 90 s after 1000 s.
    (first, second, *_) = find_times_s(SHARE, lay((20.0, 1000.0), (70.0, 200.0)))

    assert first == pytest.approx(1090.0, abs=1.2)
    assert second == pytest.approx(first + 60.0, abs=0.2)


def test_what_lies_more_than_a_quarter_hour_back_is_forgotten() -> None:
    # 60 s above, then 15 min below: another 60 s are 6.7 %, no cue; together they would be more than 10 %.
    assert find_times_s(SHARE, lay((70.0, 60.0), (20.0, 901.0), (70.0, 60.0))) == []


def test_long_stays_add_up_to_a_cue() -> None:
    # Three stays of 12 s: the third passes 30 s in all, 24 + 6 s; but counts only once it has lasted 7 s.
    stays = ((70.0, 12.0), (20.0, 5.0)) * 3
    (only,) = find_times_s(STAYS, lay((20.0, 5.0), *stays))

    assert only == pytest.approx(5.0 + 2 * 17.0 + 7.0, abs=0.2)


def test_short_movements_bring_no_cue_however_many() -> None:
    assert find_times_s(STAYS, lay(*((70.0, 6.0), (20.0, 2.0)) * 30)) == []


def test_stays_of_five_minutes_ago_are_forgotten() -> None:
    assert find_times_s(STAYS, lay((70.0, 25.0), (20.0, 305.0), (70.0, 25.0))) == []


def test_several_rules_give_their_cues_in_order() -> None:
    cues = CueWatch((HOLD, CueRule("hold", 30.0, seconds=5.0))).take(lay((20.0, 1.0), (70.0, 10.5)))

    assert [cue.rule.angle_deg for cue in cues] == [30.0, 30.0, 60.0] or [
        cue.rule.angle_deg for cue in cues
    ] == [30.0, 60.0, 30.0]


@settings(max_examples=20)
@given(st.lists(st.integers(1, 399), max_size=5))
def test_cues_do_not_depend_on_how_the_rows_are_cut(cuts: list[int]) -> None:
    rows = lay((20.0, 5.0), (70.0, 30.0), (20.0, 5.0))
    bounds = [0, *sorted(set(cuts)), 400]
    watch = CueWatch((HOLD, STAYS))

    pieces = [
        watch.take(LiveRows(rows.time_us[a:b], rows.elevation_deg[a:b], rows.valid[a:b]))
        for a, b in itertools.pairwise(bounds)
    ]

    assert [cue for piece in pieces for cue in piece] == CueWatch((HOLD, STAYS)).take(rows)
