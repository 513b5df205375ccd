"""A live session: the angle of LiveElevation, what was lost, rises, and the pose that is held."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import UnusableArrays
from acromion.fusion.live import (
    Frames,
    LiveElevation,
    LiveRows,
    LiveSession,
    ShownAngles,
    compare_shown,
    replay_frames,
)
from acromion.fusion.orientation.live import LiveVertical
from acromion.fusion.recording import Recording
from tests.factories import MadeRecording, hold
from tests.fusion.made_motion import angle_between_deg, tumble

UPWARDS = np.array([0.0, 0.0, 1.0])


def play(*poses: tuple[float, float]) -> Frames:
    return send(hold(*poses))


def send(made: MadeRecording) -> Frames:
    (frames,) = replay_frames(made.recording, 1e6)
    return frames


HANGING = play((0.0, 30.0))


def start(*, pose_s: float | None = None, axis: NDArray[np.float64] | None = None) -> LiveSession:
    session = LiveSession(100.0, axis)
    if pose_s is not None:
        session.ask_pose(pose_s)
    return session


def leave_out(frames: Frames, first: int, stop: int) -> Frames:
    kept = np.r_[0:first, stop : len(frames)]
    return Frames(frames.time_us[kept], frames.counter[kept], frames.acc_g[kept], frames.gyr_dps[kept])


def take_all(session: LiveSession, frames: Frames) -> NDArray[np.float32]:
    return session.take(frames).elevation_deg


def test_the_angle_is_that_of_live_elevation_to_the_bit() -> None:
    made = hold((0.0, 10.0), (95.0, 10.0), (20.0, 10.0))
    segment = made.recording.segments[0]
    expected = LiveElevation(100.0, UPWARDS).update(segment.acc_g, segment.gyr_dps)
    session = LiveSession(100.0, UPWARDS)

    chunks = [session.take(frames).elevation_deg for frames in replay_frames(made.recording, 0.07)]

    assert np.array_equal(np.concatenate(chunks), expected)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 1896), max_size=6))
def test_the_session_does_not_depend_on_how_the_frames_are_cut(cuts: list[int]) -> None:
    motion, rows = tumble(20.0, seed=1), np.arange(2000)
    acc, gyr = motion.acc_g.astype(np.float32), motion.gyr_dps.astype(np.float32)
    whole = leave_out(leave_out(Frames(rows * 10_000, rows, acc, gyr), 1400, 1500), 600, 603)
    cut, uncut = start(pose_s=0.0), start(pose_s=0.0)

    bounds = itertools.pairwise([0, *sorted(set(cuts)), len(whole)])
    pieces = [take_all(cut, whole.cut(a, b)) for a, b in bounds]

    assert np.array_equal(np.concatenate(pieces), take_all(uncut, whole), equal_nan=True)
    assert cut.status() == uncut.status()


def test_time_above_and_rises_are_counted() -> None:
    # Twice 10 s at 95 deg; the change is centred on the boundary, so 60 deg is passed 0.1 to 0.2 s after it
    # on the way up, and as long before it on the way down.
    made = hold((0.0, 10.0), (95.0, 10.0), (0.0, 10.0), (95.0, 10.0), (0.0, 10.0))
    session = LiveSession(100.0, UPWARDS)

    session.take(send(made))

    status = session.status()
    assert status.rises == 2
    assert status.above_s[1] == pytest.approx(20.0, abs=0.6)
    assert status.above_s[2] == pytest.approx(20.0, abs=1.6)
    assert status.above_s[0] > status.above_s[1] > status.above_s[2]
    assert status.counted_s == 47.0  # 50 s less the first 3 s of the segment


@pytest.mark.parametrize(
    "poses",
    [((95.0, 10.0), (0.0, 5.0)), ((57.0, 10.0), (63.0, 5.0), (57.0, 5.0), (63.0, 5.0))],
    ids=["up when counting begins", "within the hysteresis"],
)
def test_what_is_no_rise_is_not_counted(poses: tuple[tuple[float, float], ...]) -> None:
    session = LiveSession(100.0, UPWARDS)

    session.take(play(*poses))

    assert session.status().rises == 0


def test_a_short_hole_is_counted_by_the_counter_and_bridged_and_its_time_is_not_counted() -> None:
    session = LiveSession(100.0, UPWARDS)

    valid = session.take(leave_out(HANGING, 1000, 1003)).valid

    status = session.status()
    assert valid[300:].all()
    assert (status.frames, status.lost, status.holes) == (2997, 3, 1)
    assert status.missing_s == pytest.approx(0.03)
    assert status.counted_s == pytest.approx(30.0 - 3.0 - 0.03)


def test_a_bridged_hole_reads_as_the_readers_bridge_of_it() -> None:
    made = hold((0.0, 5.0), (95.0, 5.0))
    segment = made.recording.segments[0]
    acc, gyr = segment.acc_g.copy(), segment.gyr_dps.copy()
    for values in (acc, gyr):
        for k in (1, 2):
            weight = k / 3
            mixed = values[499].astype(np.float64) * (1.0 - weight) + values[502] * weight
            values[499 + k] = mixed.astype(np.float32)
    expected = LiveElevation(100.0, UPWARDS).update(acc, gyr)

    shown = take_all(LiveSession(100.0, UPWARDS), leave_out(send(made), 500, 502))

    assert np.array_equal(shown, np.delete(expected, [500, 501]))


def test_after_a_long_hole_nothing_is_counted_for_three_seconds_and_the_bias_is_still_known() -> None:
    frames = leave_out(HANGING, 1000, 1100)
    session = LiveSession(100.0, UPWARDS)

    valid = session.take(frames.cut(0, 1010)).valid
    assert session.status().has_rested
    valid = np.concatenate([valid, session.take(frames.cut(1010, len(frames))).valid])

    assert not valid[1000:1300].any()
    assert valid[1300:].all()
    assert session.status().missing_s == pytest.approx(1.0)


def test_a_sensor_that_never_rested_says_so() -> None:
    session = LiveSession(100.0, UPWARDS)

    session.take(play((0.0, 0.5), (95.0, 0.5), (0.0, 0.5), (95.0, 0.5), (0.0, 0.5)))

    assert not session.status().has_rested


def test_the_pose_held_becomes_the_axis() -> None:
    # The arm hangs 12 s: 5 s of countdown, 5 s held; the sensor is strapped on askew.
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.0, 0.8, 0.6]])
    made = hold((0.0, 12.0), (95.0, 10.0), mounting=turn)
    session = start(pose_s=5.0)

    rows = session.take(send(made))

    assert session.pose_window_s == (5.0, 10.0)
    assert np.isnan(rows.elevation_deg[:1000]).all()
    assert rows.elevation_deg[1000] == pytest.approx(0.0, abs=0.1)
    assert rows.elevation_deg[-1] == pytest.approx(95.0, abs=0.5)
    assert session.status().pose == "held"


def test_the_countdown_and_the_hold_are_told() -> None:
    session = LiveSession(100.0)
    session.take(HANGING.cut(0, 1))
    session.ask_pose(5.0)

    session.take(HANGING.cut(1, 201))
    counting = session.status()
    session.take(HANGING.cut(201, 701))
    holding = session.status()

    assert (counting.pose, counting.pose_left_s) == ("countdown", 3.0)
    assert (holding.pose, holding.pose_left_s) == ("holding", 3.0)


RAISED_TOO_SOON = play((0.0, 7.0), (95.0, 10.0))


@pytest.mark.parametrize(
    ("frames", "pose", "refused"),
    [
        (RAISED_TOO_SOON, "none", "moving"),
        (leave_out(HANGING, 700, 720), "none", "hole"),
        (leave_out(HANGING, 300, 320), "held", ""),
    ],
    ids=["the arm moved", "a hole in the hold", "a hole in the countdown"],
)
def test_a_pose_is_refused_with_its_reason(frames: Frames, pose: str, refused: str) -> None:
    session = start(pose_s=5.0)

    session.take(frames)

    status = session.status()
    assert (status.pose, status.pose_refused) == (pose, refused)


def test_the_old_axis_stays_until_a_new_pose_is_accepted() -> None:
    session = start(pose_s=5.0, axis=UPWARDS)

    rows = session.take(RAISED_TOO_SOON)

    assert rows.elevation_deg[-1] == pytest.approx(95.0, abs=0.5)
    assert (session.status().pose, session.status().pose_refused) == ("held", "moving")


def test_frames_that_are_no_numbers_change_nothing() -> None:
    bad = HANGING.acc_g.copy()
    bad[3, 1] = np.nan
    session = LiveSession(100.0, UPWARDS)

    with pytest.raises(UnusableArrays):
        session.take(replace(HANGING, acc_g=bad))

    assert session.status().frames == 0


def test_a_replay_skips_the_counter_over_a_hole_of_the_file() -> None:
    first = hold((0.0, 10.0)).recording.segments[0]
    recording = Recording("other", "", None, None, 21_000_000, (first, replace(first, start_us=11_000_000)))

    frames = list(replay_frames(recording, 1e6))

    assert frames[1].counter[0] - frames[0].counter[-1] - 1 == 100
    assert frames[1].time_us[0] == 11_000_000


def test_a_replay_does_not_send_what_was_bridged() -> None:
    segment = replace(hold((0.0, 10.0)).recording.segments[0], bridged=((500, 502),))
    recording = Recording("other", "", None, None, 10_000_000, (segment,))

    (frames,) = replay_frames(recording, 1e6)

    assert len(frames) == 998
    assert frames.counter[500] == 502


@pytest.mark.parametrize(("x_sign", "is_doubted"), [(1.0, False), (-1.0, True)])
def test_a_left_handed_frame_is_doubted_once_the_arm_has_moved(x_sign: float, is_doubted: bool) -> None:
    # The registers of an LSM9DS1: x of both sensors points the other way.
    frames, turn = play((0.0, 5.0), *((95.0, 2.0), (0.0, 2.0)) * 3), np.array([x_sign, 1.0, 1.0], np.float32)
    frames = replace(frames, acc_g=frames.acc_g * turn, gyr_dps=frames.gyr_dps * turn)
    session = LiveSession(100.0, UPWARDS)

    session.take(frames.cut(0, 400))
    at_rest = session.status().is_frame_doubtful
    session.take(frames.cut(400, len(frames)))

    assert not at_rest
    assert session.status().is_frame_doubtful is is_doubted


# Real-time elevation: causal, the same however the samples are cut.

OFFSET = np.array([10.0, -20.0, 15.0])


@pytest.mark.parametrize("axis", [None, UPWARDS])
@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 999), max_size=6))
def test_the_result_does_not_depend_on_how_the_samples_are_cut(
    axis: NDArray[np.float64] | None, cuts: list[int]
) -> None:
    motion = tumble(10.0, seed=1)
    bounds = [0, 0, *sorted(cuts), 1000]  # an empty chunk gives no row and changes nothing
    chunked = LiveElevation(100.0, axis)

    pieces = [chunked.update(motion.acc_g[a:b], motion.gyr_dps[a:b]) for a, b in itertools.pairwise(bounds)]

    whole = LiveElevation(100.0, axis).update(motion.acc_g, motion.gyr_dps)
    assert np.array_equal(np.concatenate(pieces), whole, equal_nan=True)


def test_an_arm_raised_after_hanging_is_read_from_the_first_rest_on() -> None:
    # A still moment is 1.5 s: the 150th sample completes it.
    made = hold((0.0, 5.0), (95.0, 10.0)).recording.segments[0]

    elevation_deg = LiveElevation(100.0).update(made.acc_g, made.gyr_dps)

    assert np.isnan(elevation_deg[:149]).all()
    assert np.isfinite(elevation_deg[149:]).all()
    assert elevation_deg[-1] == pytest.approx(95.0, abs=0.5)


def test_with_a_known_arm_axis_it_starts_at_once_if_anything_is_felt() -> None:
    live = LiveElevation(100.0, arm_axis=np.array([0.0, 0.0, 1.0]))

    assert np.isnan(live.update([0.0, 0.0, 0.0], [0.0, 0.0, 0.0])).all()
    assert live.update([1.0, 0.0, 0.0], [0.0, 0.0, 0.0]) == pytest.approx([90.0])


def test_an_offset_of_27_deg_per_s_is_taken_off_at_the_first_rest() -> None:
    motion = tumble(60.0, seed=3)
    live = LiveVertical(100.0)

    up = live.update(motion.acc_g, motion.gyr_dps + OFFSET)

    assert live.bias_dps == pytest.approx(OFFSET, abs=0.05)
    assert angle_between_deg(up[200:], motion.up[200:]).max() < 1.0


def test_the_turn_of_a_slow_even_movement_is_not_taken_for_bias() -> None:
    # At 2 deg/s gravity varies by 0.015 g in 1.5 s: still, by the limits.
    angle = np.radians(2.0 * np.arange(3000) / 100.0)
    acc_g = np.column_stack([np.zeros(3000), np.sin(angle), np.cos(angle)])
    live = LiveVertical(100.0)

    live.update(acc_g, np.tile([2.0, 0.0, 0.0], (3000, 1)))

    assert live.has_rested
    assert live.bias_dps == pytest.approx([0.0, 0.0, 0.0], abs=0.01)


def test_until_the_first_rest_gentle_movement_shows_the_offset() -> None:
    # An arm that swings by 5 deg in 3 s is never still.
    time_s = np.arange(6000) / 100.0
    angle = np.radians(5.0) * np.sin(2.0 * np.pi * time_s / 3.0)
    rate_dps = 5.0 * 2.0 * np.pi / 3.0 * np.cos(2.0 * np.pi * time_s / 3.0)
    acc_g = np.column_stack([np.zeros(6000), np.sin(angle), np.cos(angle)])
    gyr_dps = np.column_stack([rate_dps, np.zeros(6000), np.zeros(6000)])
    live = LiveVertical(100.0)

    live.update(acc_g, gyr_dps + OFFSET)

    assert not live.has_rested
    assert live.bias_dps == pytest.approx(OFFSET, abs=1.0)


def test_a_bias_given_beforehand_is_used_from_the_first_sample() -> None:
    motion = tumble(30.0, seed=4, still_s=0.0)

    up = LiveVertical(100.0, bias_dps=OFFSET).update(motion.acc_g, motion.gyr_dps + OFFSET)

    assert angle_between_deg(up, motion.up).max() < 1.0


@pytest.mark.parametrize("rate_hz", [0.0, -5.0, np.nan, np.inf])
def test_a_rate_that_is_not_positive_is_refused_at_once(rate_hz: float) -> None:
    with pytest.raises(UnusableArrays) as refused:
        LiveElevation(rate_hz)

    assert refused.value.facts["why"] == "rate"


UNIT = np.tile([0.0, 0.0, 1.0], (300, 1))


@pytest.mark.parametrize(
    ("acc", "gyr_rows", "why"),
    [(UNIT[:3] * np.nan, 3, "finite"), (UNIT[:3], 4, "shape"), (9.80665 * UNIT, 300, "unit")],
    ids=["no numbers", "lengths that differ", "metres per second squared"],
)
def test_samples_that_cannot_be_fused_are_refused_while_waiting_too(
    acc: NDArray[np.float64], gyr_rows: int, why: str
) -> None:
    with pytest.raises(UnusableArrays) as refused:
        LiveElevation(100.0).update(acc, np.zeros((gyr_rows, 3)))

    assert refused.value.facts["why"] == why


@pytest.mark.parametrize(
    "axis", [[1.0, 0.0], [np.nan, 0.0, 1.0], [0.0, 0.0, 0.0], ["a", "b", "c"], [0.0, 0.0, 9.81]]
)
def test_an_arm_axis_that_is_no_unit_vector_is_refused_at_once(axis: list[object]) -> None:
    with pytest.raises(UnusableArrays):
        LiveElevation(100.0, np.array(axis))


def test_a_chunk_that_is_refused_changes_nothing() -> None:
    acc, gyr = np.tile([0.0, 0.0, 1.0], (200, 1)), np.zeros((200, 3))
    broken = np.where(np.arange(200)[:, None] < 199, acc, np.nan)
    live = LiveElevation(100.0)

    with pytest.raises(UnusableArrays):
        live.update(broken, gyr)

    # As at the very first chunk: a moment of stillness is waited for again.
    assert np.isnan(live.update(acc[:1], gyr[:1])).all()


# What was shown against the report: differences worked out by hand.

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
