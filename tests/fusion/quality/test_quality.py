"""What is left out and why, where the time goes, and what that makes of the verdict."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.conventions import CalibrationState, Pose
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.exposure import summarise_exposure
from fusion.orientation.angle_rows import lay_rows
from fusion.pose.calibrate import Calibration
from fusion.quality import Quality, TimeAccount
from fusion.quality.time_account import account_time, find_exclusions, leave_out, make_disjoint
from fusion.quality.verdict import assess_quality
from fusion.recording import QualityFlag, Recording, Segment, Span

HOUR_US = 3_600_000_000


def rest(seconds: float, start_us: int = 0, rate_hz: float = 100.0) -> Segment:
    """Lie still with a little noise, so that no channel rests at a value."""
    noise = np.random.default_rng(start_us).normal(0, 0.01, (round(seconds * rate_hz), 3))
    acc_g, gyr_dps = (noise + np.array([0, 0, 1])).astype(np.float32), noise.astype(np.float32)
    return Segment(start_us, rate_hz, acc_g, gyr_dps)


def record(*segments: Segment, duration_us: int | None = None) -> Recording:
    return Recording("gt9x", "0" * 64, None, None, duration_us or segments[-1].end_us, segments)


def fuse(recording: Recording) -> Elevation:
    """Trust every row, at 40 deg."""
    segments = []
    for rows in map(lay_rows, recording.segments):
        angle = np.full(len(rows), 40, np.float32)
        segments.append(ElevationSegment(rows.start_us, rows.rate_hz, angle, np.ones(len(rows), np.bool_)))
    return Elevation(tuple(segments), None)


def account(recording: Recording) -> TimeAccount:
    exclusions = find_exclusions(recording)
    return account_time(recording, leave_out(fuse(recording), exclusions), exclusions)


def strike(segment: Segment, *rows: int, value_g: float = -16.0) -> Segment:
    """Drive one axis of the accelerometer to a value."""
    acc_g = segment.acc_g.copy()
    acc_g[list(rows), 1] = value_g
    return replace(segment, acc_g=acc_g)


def turn_fast(segment: Segment, row: int) -> Segment:
    segment.gyr_dps[row, 2] = 2000.0
    return segment


def judge(hours: float, *flags: QualityFlag, missing_us: int = 0) -> Quality:
    """Assess a recording without samples to look at, of which ``hours`` were analysed."""
    analysed_us = round(hours * HOUR_US)
    recording = replace(record(rest(2)), device="angles", flags=flags)
    time = TimeAccount(analysed_us + missing_us, analysed_us, missing_us, 0)
    return assess_quality(recording, None, time, ())


def test_time_the_device_was_docked_is_excluded_and_not_missing() -> None:
    recording = replace(
        record(rest(20), rest(20, 50_000_000)), excluded=(Span(20_000_000, 10_000_000, "docked"),)
    )

    assert account(recording) == TimeAccount(70_000_000, 40_000_000, 20_000_000, 10_000_000)


@pytest.mark.parametrize(
    ("seconds", "spans"), [(0.9, (Span(25_000_000, 900_000, "short-segment"),)), (1.0, ())]
)
def test_a_segment_under_a_second_is_excluded(seconds: float, spans: tuple[Span, ...]) -> None:
    assert find_exclusions(record(rest(20), rest(seconds, 25_000_000))) == spans


@pytest.mark.parametrize(
    ("segment", "ranges", "clipped_us"),
    [
        (strike(rest(20), 500), (16.0, None), (4_900_000, 210_000)),
        (strike(rest(20), 500, value_g=32767 / 2048), (16.0, None), (4_900_000, 210_000)),
        (strike(rest(20), 500, value_g=15.9), (16.0, None), None),
        (strike(rest(20, 30_000_000), 3), (16.0, None), (30_000_000, 140_000)),
        (strike(rest(20), 500, 515), (16.0, None), (4_900_000, 360_000)),
        (strike(rest(20), 500, 501, 502, value_g=8.0), (None, None), (4_900_000, 230_000)),
        (strike(rest(20), 500, value_g=8.0), (None, None), None),
        (turn_fast(rest(20), 700), (None, 2000.0), (6_900_000, 210_000)),
    ],
    ids=[
        "a tenth of a second on each side", "highest count of a signed range", "hard knock inside the range",
        "not beyond its segment", "near each other", "rests at its extreme without a known range",
        "single knock without a known range", "gyroscope",
    ],
)  # fmt: skip
def test_clipped_samples_are_excluded(
    segment: Segment, ranges: tuple[float | None, float | None], clipped_us: tuple[int, int] | None
) -> None:
    recording = replace(record(segment), acc_range_g=ranges[0], gyr_range_dps=ranges[1])

    assert find_exclusions(recording) == ((Span(*clipped_us, "clipped"),) if clipped_us else ())


def test_leaving_out_shares_the_angle_takes_half_rows_and_does_not_change_the_input() -> None:
    elevation = fuse(record(rest(20)))
    shorter = leave_out(elevation, (Span(5_004_000, 10_000, "clipped"),))

    assert shorter.segments[0].elevation_deg is elevation.segments[0].elevation_deg
    assert np.flatnonzero(~shorter.segments[0].valid).tolist() == [500, 501]
    assert elevation.segments[0].valid.all()


@pytest.mark.parametrize("rate_hz", [99.5, 476.03])
def test_clipping_makes_nothing_missing_at_any_rate(rate_hz: float) -> None:
    segment = strike(rest(20, rate_hz=rate_hz), 500, 700, 1100)
    time = account(replace(record(segment), acc_range_g=16.0))

    assert time.missing_us == 0
    assert time.excluded_us == pytest.approx(600_000, abs=40_000)


@given(st.lists(st.tuples(st.integers(-50, 250), st.integers(0, 80), st.sampled_from("abc")), max_size=12))
def test_disjoint_spans_cover_the_same_time_with_the_last_reason(pieces: list[tuple[int, int, str]]) -> None:
    painted = np.full(200, "-")
    for start_us, length_us, reason in pieces:
        painted[max(start_us, 0) : max(start_us + length_us, 0)] = reason
    repainted = np.full(200, "-")
    for span in make_disjoint([Span(*piece) for piece in pieces], 200):
        assert (repainted[span.start_us : span.end_us] == "-").all()
        repainted[span.start_us : span.end_us] = span.reason

    assert repainted.tolist() == painted.tolist()


@given(
    st.lists(st.tuples(st.floats(0.1, 9.0), st.integers(60_000, 5_000_000)), min_size=2, max_size=6),
    st.floats(50.0, 500.0),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=25, deadline=None)
def test_every_microsecond_is_analysed_missing_or_excluded(
    parts: list[tuple[float, int]], rate_hz: float, seed: int
) -> None:
    random, segments, start_us = np.random.default_rng(seed), [], 0
    for seconds, hole_us in [(12.0, 100_000), *parts]:
        struck = strike(rest(seconds, start_us, rate_hz), int(random.integers(0, 5)))
        segments.append(struck)
        start_us = struck.end_us + hole_us
    recording = replace(record(*segments), acc_range_g=16.0)
    exclusions = find_exclusions(recording)
    elevation = leave_out(fuse(recording), exclusions)
    time = account_time(recording, elevation, exclusions)

    assert time.analysed_us + time.missing_us + time.excluded_us == time.recorded_us == recording.duration_us
    assert min(time.analysed_us, time.missing_us, time.excluded_us) >= 0
    assert round(summarise_exposure(elevation).analysed_s * 1e6) == time.analysed_us


def test_too_short_says_what_left_out_most_and_that_a_person_can_undo_it() -> None:
    recording = record(rest(60))
    spans = (Span(0, 40_000_000, "break"), Span(40_000_000, 10_100_000, "docked"))

    with pytest.raises(TooShort) as error:
        account_time(recording, leave_out(fuse(recording), spans), spans)

    assert error.value.facts == {"s": 9.9, "left_out": "break", "left_out_s": 40.0, "cure": "left out"}


def test_ready_angles_have_no_minimum() -> None:
    recording = replace(record(rest(2)), device="angles")

    assert account_time(recording, fuse(recording), ()).analysed_us == 2_000_000


def test_a_full_shift_without_a_caveat_is_good() -> None:
    assert judge(8.0) == Quality("good", (), ())


@pytest.mark.parametrize(
    ("hours", "verdict", "facts"),
    [
        (3.9, "caution", {"hours": 4}),
        (2.0, "caution", {"hours": 4}),
        (1.9, "poor", {"hours": 2}),
        (0.5, "poor", {"hours": 2}),
        (0.49, "poor", {"hours": 2, "minutes": 30}),  # no ranges and rates either
    ],
)
def test_few_hours_say_little_about_a_day(hours: float, verdict: str, facts: dict[str, int]) -> None:
    quality = judge(hours)

    assert (quality.verdict, quality.reasons) == (verdict, ("W-FEW-HOURS",))
    assert quality.flags[0].facts == facts


def test_less_than_half_analysed_is_poor() -> None:
    quality = judge(5.0, missing_us=6 * HOUR_US)

    assert (quality.verdict, quality.reasons) == ("poor", ("W-LOWCOVER", "W-UNTRUSTED"))


@pytest.mark.parametrize(
    ("code", "seconds", "verdict"),
    [
        ("W-GAP", 287.0, "good"),
        ("W-GAP", 289.0, "caution"),
        ("W-CLIP", 28.0, "good"),
        ("W-CLIP", 29.0, "caution"),
        ("W-DUP", 1.0, "good"),
        ("W-WRAP", 0.0, "good"),
        ("W-BIAS", 0.0, "caution"),
        ("W-NO-STILL", 0.0, "poor"),
        ("W-POSE-DOUBT", 10.0, "poor"),
        ("W-POSE-SHORT", 1.0, "caution"),
        ("W-PUBLISHED", 0.0, "caution"),
        ("W-REMOUNT", 14399.0, "caution"),
        ("W-POSE-ASSUMED", 0.0, "caution"),
        ("W-WHICH-POSE", 0.0, "caution"),
        ("W-SLIP", 0.0, "caution"),
        ("W-PUT-BACK", 0.0, "caution"),
        ("W-POSE-UNSTEADY", 0.0, "caution"),
        ("W-AXIS", 0.0, "caution"),
        ("W-REMOUNT", 14400.0, "poor"),
    ],
)
def test_a_caveat_weighs_what_it_costs_in_8_hours(code: str, seconds: float, verdict: str) -> None:
    assert judge(8.0, QualityFlag(code, seconds=seconds)).verdict == verdict


def test_the_gravest_caveat_comes_first() -> None:
    quality = judge(8.0, QualityFlag("W-DUP"), QualityFlag("W-BIAS"), QualityFlag("W-NO-STILL"))

    assert [flag.code for flag in quality.flags] == ["W-NO-STILL", "W-BIAS", "W-DUP"]
    assert quality.reasons == ("W-NO-STILL", "W-BIAS")


def test_within_a_grade_the_caveat_that_cost_the_most_time_comes_first() -> None:
    spikes, stuck = QualityFlag("W-SPIKE", seconds=5.0), QualityFlag("W-STUCK-PART", seconds=60.0)
    short_pose = QualityFlag("W-POSE-SHORT", seconds=90.0)  # 90 s of a pose: none of them lost

    quality = judge(8.0, short_pose, QualityFlag("W-DOCKED", seconds=600.0), spikes, stuck)

    assert [flag.code for flag in quality.flags] == ["W-STUCK-PART", "W-SPIKE", "W-POSE-SHORT", "W-DOCKED"]


def assess(recording: Recording, calibration: Calibration | None = None) -> dict[str, QualityFlag]:
    quality = assess_quality(recording, calibration, account(recording), find_exclusions(recording))
    return {flag.code: flag for flag in quality.flags}


def test_holes_are_flagged_with_their_number_length_and_place() -> None:
    recording = record(rest(20), rest(20, 25_000_000), rest(30, 46_000_000))

    assert assess(recording)["W-GAP"] == QualityFlag(
        "W-GAP", 2, 6.0, 20.0, 46.0, spans_s=((20.0, 25.0), (45.0, 46.0))
    )


def test_holes_the_reader_has_flagged_are_not_flagged_again() -> None:
    told = QualityFlag("W-GAP", 1, 5.0, 20.0, 25.0)
    recording = replace(record(rest(20), rest(60, 25_000_000)), flags=(told,))

    assert assess(recording)["W-GAP"] is told


def test_clipping_is_flagged_with_its_number_length_and_place() -> None:
    recording = replace(record(strike(rest(70), 500, 2000)), acc_range_g=16.0)

    assert assess(recording)["W-CLIP"] == QualityFlag(
        "W-CLIP", 2, 0.42, 4.9, 20.11, spans_s=((4.9, 5.11), (19.9, 20.11))
    )


def test_under_a_minute_is_flagged_as_short() -> None:
    assert assess(record(rest(59)))["W-SHORT"].seconds == 59.0


def test_time_the_fusion_did_not_trust_is_flagged() -> None:
    recording = record(rest(70))
    elevation = leave_out(fuse(recording), (Span(10_000_000, 4_000_000),))
    time = account_time(recording, elevation, ())

    flags = {flag.code: flag for flag in assess_quality(recording, None, time, ()).flags}
    assert flags["W-UNTRUSTED"].seconds == 4.0


@pytest.mark.parametrize(
    ("pose", "state", "warned"),
    [
        ("n-pose", "given", True),
        ("side-lean", "given", False),
        ("n-pose", "axis", False),
        ("n-pose", "none", False),
    ],
)
def test_an_n_pose_that_was_held_is_named_as_reading_up_to_15_deg_low(
    pose: Pose, state: CalibrationState, warned: bool
) -> None:
    calibration = Calibration(pose, np.array([0, 0, 1.0]), 5.0, state, (), np.zeros(3))

    flag = assess(record(rest(70)), calibration).get("W-NPOSE")

    assert (flag.facts if flag else None) == ({"reads_low_by_up_to_deg": 15} if warned else None)
