"""A sensor on a desk is proposed as not worn; an arm at rest for a while is not, and nothing is left out."""

from dataclasses import replace

import numpy as np
import pytest

from fusion.caveats import Caveat
from fusion.elevation import Elevation, ElevationSegment
from fusion.quality.flags import flag_untrusted
from fusion.quality.time_account import propose_nonwear
from fusion.recording import Float64Array, QualityFlag, Recording, Segment, Span, flag_spans

MINUTE = 60_000_000


def lie(*, still_min: float, noise_g: float = 0.005, moving_min: float = 10.0) -> Recording:
    """Move, lie still, move again; 20 samples a second."""
    random, parts = np.random.default_rng(0), []
    for minutes, spread_g in ((moving_min, 0.2), (still_min, noise_g), (moving_min, 0.2)):
        parts.append(random.normal(0, spread_g, (round(minutes * 1200), 3)) + np.array([0, 0, 1]))
    acc_g = np.concatenate(parts).astype(np.float32)
    segment = Segment(0, 20.0, acc_g, np.zeros_like(acc_g))
    return Recording("other", "", None, None, segment.duration_us, (segment,))


@pytest.mark.parametrize(
    ("still_min", "proposed"), [(10, (Span(10 * MINUTE, 10 * MINUTE, "not-worn"),)), (9, ())]
)
def test_ten_minutes_without_movement_are_proposed(still_min: int, proposed: tuple[Span, ...]) -> None:
    assert propose_nonwear(lie(still_min=still_min)) == proposed


@pytest.mark.parametrize(("swing_g", "count"), [(0.0129, 1), (0.0131, 0)])
def test_still_is_a_standard_deviation_under_0_013_g(swing_g: float, count: int) -> None:
    recording = lie(still_min=30, noise_g=0.0)
    recording.segments[0].acc_g[12_000:48_000, 0] += np.tile([swing_g, -swing_g], 18_000).astype(np.float32)

    assert len(propose_nonwear(recording)) == count


@pytest.mark.parametrize(
    ("axis", "added_g", "count"),
    [(1, np.tile([0.02, -0.02], 18_000), 0), (2, np.linspace(0, 0.1, 36_000), 1)],
    ids=["one axis moves", "a slow drift of temperature"],
)
def test_one_axis_that_moves_is_enough_and_a_drift_is_no_movement(
    axis: int, added_g: Float64Array, count: int
) -> None:
    recording = lie(still_min=30)
    recording.segments[0].acc_g[12_000:48_000, axis] += added_g.astype(np.float32)

    assert len(propose_nonwear(recording)) == count


@pytest.mark.parametrize(("end_min", "count"), [(20, 0), (14, 1)], ids=["all of it", "a part of it"])
def test_what_the_diary_leaves_out_already_is_not_proposed(end_min: int, count: int) -> None:
    left_out = (Span(5 * MINUTE, (end_min - 5) * MINUTE, "break"),)

    assert len(propose_nonwear(lie(still_min=15), left_out)) == count


def test_a_caveat_tells_where_its_stretches_lie() -> None:
    (flag,) = flag_spans(Caveat.GAP, [Span(0, 2_000_000), Span(5_000_000, 1_000_000)])

    assert flag == QualityFlag("W-GAP", 2, 3.0, 0.0, 6.0, spans_s=((0.0, 2.0), (5.0, 6.0)))


def test_of_many_stretches_the_hundred_longest_are_told() -> None:
    (flag,) = flag_spans(Caveat.GAP, [Span(1000 * k, k + 1) for k in range(150)])

    assert (flag.count, len(flag.spans_s), flag.spans_s[0][0]) == (150, 100, 0.05)


def flag_distrust(
    *rows: slice, bridged: bool = False, left_out: tuple[Span, ...] = ()
) -> tuple[QualityFlag, ...]:
    recording = lie(still_min=1, moving_min=1)
    valid = np.ones(len(recording.segments[0]), np.bool_)
    for stretch in rows:
        valid[stretch] = False
    if bridged:
        recording = replace(recording, segments=(replace(recording.segments[0], bridged=((100, 140),)),))
    segment = ElevationSegment(0, 20.0, np.zeros(len(valid), np.float32), valid)
    return flag_untrusted(recording, Elevation((segment,), None), left_out)


def test_stretches_whose_direction_was_not_trusted_are_told_with_their_times() -> None:
    (flag,) = flag_distrust(slice(100, 140), slice(200, 300))

    assert (flag.code, flag.seconds, flag.spans_s) == ("W-UNTRUSTED", 7.0, ((5.0, 7.0), (10.0, 15.0)))


def test_a_bridged_hole_and_what_is_left_out_are_not_distrust() -> None:
    assert flag_distrust(slice(100, 140), bridged=True) == ()
    assert flag_distrust(slice(100, 140), left_out=(Span(5_000_000, 2_000_000, "break"),)) == ()
