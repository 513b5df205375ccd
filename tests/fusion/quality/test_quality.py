"""What is left out and why, where the time goes, and what that makes of the verdict."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.exposure import summarise_exposure
from fusion.orientation.angle_rows import AngleRows, lay_rows
from fusion.pose.calibrate import Calibration
from fusion.pose.windows import StillPeriod
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
    laid = map(lay_rows, recording.segments)
    return Elevation(tuple(elevate(rows) for rows in laid), None)


def elevate(rows: AngleRows) -> ElevationSegment:
    angle = np.full(len(rows), 40, np.float32)
    return ElevationSegment(rows.start_us, rows.rate_hz, angle, np.ones(len(rows), np.bool_))


def account(recording: Recording) -> TimeAccount:
    exclusions = find_exclusions(recording)
    return account_time(recording, leave_out(fuse(recording), exclusions), exclusions)


def strike(segment: Segment, row: int, value_g: float = -16.0, rows: int = 1) -> Segment:
    """Drive one axis of the accelerometer to a value."""
    acc_g = segment.acc_g.copy()
    acc_g[row : row + rows, 1] = value_g
    return replace(segment, acc_g=acc_g)


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


def test_a_segment_under_a_second_is_excluded() -> None:
    recording = record(rest(20), rest(0.9, 25_000_000))

    assert find_exclusions(recording) == (Span(25_000_000, 900_000, "short-segment"),)


def test_a_segment_of_a_second_is_kept() -> None:
    assert find_exclusions(record(rest(20), rest(1.0, 25_000_000))) == ()


def test_a_clipped_sample_is_excluded_with_a_tenth_of_a_second_on_each_side() -> None:
    recording = replace(record(strike(rest(20), 500)), acc_range_g=16.0)

    assert find_exclusions(recording) == (Span(4_900_000, 210_000, "clipped"),)


def test_the_highest_count_of_a_signed_range_is_clipped() -> None:
    recording = replace(record(strike(rest(20), 500, 32767 / 2048)), acc_range_g=16.0)

    assert len(find_exclusions(recording)) == 1


def test_a_hard_knock_inside_the_range_is_not_clipped() -> None:
    recording = replace(record(strike(rest(20), 500, 15.9)), acc_range_g=16.0)

    assert find_exclusions(recording) == ()


def test_the_margin_of_a_clipped_sample_stays_inside_its_segment() -> None:
    recording = replace(record(rest(20), strike(rest(20, 30_000_000), 3)), acc_range_g=16.0)

    assert find_exclusions(recording) == (Span(30_000_000, 140_000, "clipped"),)


def test_clipped_samples_near_each_other_are_one_stretch() -> None:
    recording = replace(record(strike(strike(rest(20), 500), 515)), acc_range_g=16.0)

    assert find_exclusions(recording) == (Span(4_900_000, 360_000, "clipped"),)


def test_without_a_known_range_resting_at_the_extreme_is_clipping() -> None:
    recording = record(strike(rest(20), 500, 8.0, rows=3))

    assert find_exclusions(recording) == (Span(4_900_000, 230_000, "clipped"),)


def test_without_a_known_range_a_single_knock_is_not_clipping() -> None:
    assert find_exclusions(record(strike(rest(20), 500, 8.0))) == ()


def test_the_gyroscope_clips_too() -> None:
    segment = rest(20)
    segment.gyr_dps[700, 2] = 2000.0
    recording = replace(record(segment), gyr_range_dps=2000.0)

    assert find_exclusions(recording) == (Span(6_900_000, 210_000, "clipped"),)


def test_leaving_out_shares_the_angle_and_does_not_change_the_input() -> None:
    elevation = fuse(record(rest(20)))
    shorter = leave_out(elevation, (Span(5_000_000, 1_000_000, "clipped"),))

    assert shorter.segments[0].elevation_deg is elevation.segments[0].elevation_deg
    assert np.count_nonzero(~shorter.segments[0].valid) == 100
    assert elevation.segments[0].valid.all()


def test_a_row_that_is_half_left_out_is_left_out() -> None:
    shorter = leave_out(fuse(record(rest(20))), (Span(5_004_000, 2_000, "clipped"),))

    assert np.flatnonzero(~shorter.segments[0].valid).tolist() == [500]


@pytest.mark.parametrize("rate_hz", [99.5, 476.03, 952.0])
def test_clipping_makes_nothing_missing_at_any_rate(rate_hz: float) -> None:
    segment = rest(20, rate_hz=rate_hz)
    for row in (500, 700, 1100):
        segment = strike(segment, row)
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
@settings(max_examples=40, deadline=None)
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


def test_nine_seconds_are_too_short() -> None:
    with pytest.raises(TooShort) as error:
        account(record(rest(9)))

    assert error.value.facts == {"s": 9.0}


def test_too_short_says_what_left_out_most_and_that_a_person_can_undo_it() -> None:
    recording = record(rest(60))
    spans = (Span(0, 40_000_000, "break"), Span(40_000_000, 18_000_000, "docked"))

    with pytest.raises(TooShort) as error:
        account_time(recording, leave_out(fuse(recording), spans), spans)

    assert error.value.facts == {"s": 2.0, "left_out": "break", "left_out_s": 40.0, "cure": "left out"}


def test_ready_angles_have_no_minimum() -> None:
    recording = replace(record(rest(2)), device="angles")

    assert account_time(recording, fuse(recording), ()).analysed_us == 2_000_000


def test_a_full_shift_without_a_caveat_is_good() -> None:
    assert judge(8.0) == Quality("good", (), ())


@pytest.mark.parametrize(
    ("hours", "verdict"), [(3.9, "caution"), (1.9, "poor")], ids=["under four hours", "under two hours"]
)
def test_few_hours_say_little_about_a_day(hours: float, verdict: str) -> None:
    quality = judge(hours)

    assert (quality.verdict, quality.reasons) == (verdict, ("W-FEW-HOURS",))


@pytest.mark.parametrize(("hours", "limit"), [(3.9, 4), (2.0, 4), (1.9, 2)])
def test_few_hours_name_the_limit_that_makes_the_verdict(hours: float, limit: int) -> None:
    assert judge(hours).flags[0].facts == {"hours": limit}


@pytest.mark.parametrize(("minutes", "facts"), [(29.9, {"hours": 2, "minutes": 30}), (30, {"hours": 2})])
def test_few_hours_tell_when_ranges_and_rates_are_not_given(minutes: float, facts: dict[str, int]) -> None:
    assert judge(minutes / 60.0).flags[0].facts == facts


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
        ("W-REMOUNT", 14400.0, "poor"),
    ],
)
def test_a_caveat_weighs_what_it_costs_in_8_hours(code: str, seconds: float, verdict: str) -> None:
    assert judge(8.0, QualityFlag(code, seconds=seconds)).verdict == verdict


@pytest.mark.parametrize(
    "code", ["W-POSE-ASSUMED", "W-WHICH-POSE", "W-SLIP", "W-PUT-BACK", "W-POSE-UNSTEADY"]
)
def test_what_nobody_confirmed_is_never_good(code: str) -> None:
    assert judge(8.0, QualityFlag(code)).verdict == "caution"


def test_an_axis_that_was_given_is_a_caution() -> None:
    assert judge(8.0, QualityFlag("W-AXIS", facts={"deg": 8.0})).verdict == "caution"


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
    recording = replace(record(strike(strike(rest(70), 500), 2000)), acc_range_g=16.0)

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


def test_bridged_rows_are_missing_and_not_distrusted() -> None:
    recording = record(replace(rest(70), bridged=tuple((k, k + 3) for k in range(0, 6000, 100))))
    elevation = fuse(recording)
    for first, stop in recording.segments[0].bridged:
        elevation.segments[0].valid[first:stop] = False
    time = account_time(recording, elevation, ())

    codes = {flag.code for flag in assess_quality(recording, None, time, ()).flags}
    assert time.missing_us == 1_800_000
    assert "W-UNTRUSTED" not in codes


@pytest.mark.parametrize(("pose", "warned"), [("n-pose", True), ("side-lean", False)])
def test_the_n_pose_is_named_as_reading_up_to_15_deg_low(pose: str, warned: bool) -> None:
    still = StillPeriod(0.0, 5.0, np.array([0, 0, 1.0]), np.zeros(3), 1.0)
    calibration = Calibration(pose, np.array([0, 0, 1.0]), 5.0, "given", (still,), np.zeros(3))  # type: ignore[arg-type]

    flags = assess(record(rest(70)), calibration)
    assert ("W-NPOSE" in flags) is warned
    assert not warned or flags["W-NPOSE"].facts == {"reads_low_by_up_to_deg": 15}


@pytest.mark.parametrize("state", ["axis", "none"])
def test_where_no_pose_was_held_the_n_pose_is_not_named(state: str) -> None:
    calibration = Calibration("n-pose", np.array([0, 0, 1.0]), 8.0, state, (), np.zeros(3))  # type: ignore[arg-type]

    assert "W-NPOSE" not in assess(record(rest(70)), calibration)
