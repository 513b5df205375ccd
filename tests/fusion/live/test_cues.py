"""Cues, each worked out by hand; rows of 10 Hz."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.live import LiveRows
from acromion.fusion.live.cues import CueRule, CueWatch


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


@pytest.mark.parametrize(
    ("rule", "rows", "times_s"),
    [
        # Above from 5.0 s on (the row before is at 4.9 s): 10 s have passed at 14.9 s, 20 s at 24.9 s.
        (HOLD, lay((20.0, 5.0), (70.0, 21.0), (20.0, 5.0)), [14.9, 24.9]),
        (HOLD, lay((20.0, 5.0), (70.0, 9.9), (20.0, 1.0), (70.0, 9.9)), []),
        (HOLD, lay((20.0, 5.0), (60.0, 10.5)), [14.9]),
        (HOLD, lay((20.0, 5.0), (70.0, 9.0), (np.nan, 0.5), (70.0, 9.0)), []),
        # 60 s above, then 15 min below: another 60 s are 6.7 %, no cue; together they would be over 10 %.
        (SHARE, lay((70.0, 60.0), (20.0, 901.0), (70.0, 60.0)), []),
        # The third stay of 12 s passes 30 s in all, 24 + 6 s; but counts only once it has lasted 7 s.
        (STAYS, lay((20.0, 5.0), *((70.0, 12.0), (20.0, 5.0)) * 3), [45.9]),
        (STAYS, lay(*((70.0, 6.0), (20.0, 2.0)) * 30), []),
        (STAYS, lay((70.0, 25.0), (20.0, 305.0), (70.0, 25.0)), []),
    ],
    ids=[
        "held up, and again", "down in time", "at the angle itself", "not counted ends a stay",
        "over a quarter hour ago", "long stays add up", "short movements", "stays of five minutes ago",
    ],
)  # fmt: skip
def test_a_rule_brings_its_cues(rule: CueRule, rows: LiveRows, times_s: list[float]) -> None:
    assert find_times_s(rule, rows) == pytest.approx(times_s, abs=0.2 if rule is STAYS else 1e-6)


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


def test_several_rules_give_their_cues_in_order() -> None:
    cues = CueWatch((HOLD, CueRule("hold", 30.0, seconds=5.0))).take(lay((20.0, 1.0), (70.0, 10.5)))

    assert [(cue.rule.angle_deg, round(cue.time_s, 1)) for cue in cues] == [
        (30.0, 5.9),
        (60.0, 10.9),
        (30.0, 10.9),
    ]


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
