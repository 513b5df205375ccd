"""What is left out and why, where the time goes, and what that makes of the verdict."""

import io
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from acromion.fusion.caveats import Caveat
from acromion.fusion.conventions import CalibrationState, Pose
from acromion.fusion.elevation import Elevation, ElevationSegment, group_rows
from acromion.fusion.errors import TooShort
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.pipeline import Analysis, analyse
from acromion.fusion.pose.calibrate import Calibration
from acromion.fusion.quality import Quality, TimeAccount
from acromion.fusion.quality.time_account import (
    account_time,
    divide_time,
    find_exclusions,
    leave_out,
    make_disjoint,
    propose_nonwear,
)
from acromion.fusion.quality.verdict import assess_quality, flag_gyro_drift, flag_untrusted, flag_upside_down
from acromion.fusion.readers import read_recording
from acromion.fusion.readers.preview import inspect_recording
from acromion.fusion.recording import Float64Array, QualityFlag, Recording, Segment, Span, flag_spans
from acromion.fusion.sensor.model import GyroBias
from tests.badfiles.gt3x_files import replaced, second
from tests.badfiles.order_files import ordered, thinned_at_random
from tests.badfiles.table_files import stalls
from tests.factories import elevate

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
    for rows in map(group_rows, recording.segments):
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
    ("hours", "facts"),
    [
        (3.9, {"hours": 4}),
        (0.5, {"hours": 4}),
        (0.49, {"hours": 4, "minutes": 30}),  # no ranges and rates either
    ],
)
def test_few_hours_are_noted_and_leave_the_verdict_good(hours: float, facts: dict[str, int]) -> None:
    quality = judge(hours)

    assert (quality.verdict, quality.reasons) == ("good", ())
    assert (quality.flags[0].code, quality.flags[0].facts) == ("W-FEW-HOURS", facts)


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


# A gyroscope that wandered, and an arm that would have been raised most of the day.


def wander(*last_axis_dps: float) -> GyroBias:
    bias_dps = np.zeros((len(last_axis_dps), 3))
    bias_dps[:, 2] = last_axis_dps
    return GyroBias(np.linspace(0.0, 600.0 * (len(bias_dps) - 1), len(bias_dps)), bias_dps)


def test_an_offset_that_wanders_by_1_dps_is_flagged_from_one_extreme_to_the_other() -> None:
    (flag,) = flag_gyro_drift(wander(0.2, 0.5, -0.5, 0.1))

    assert (flag.code, flag.first_s, flag.last_s, flag.facts) == ("W-GYRO-DRIFT", 600, 1200, {"dps": 1.0})


@pytest.mark.parametrize(
    "offset_dps", [(0.0, 0.99), (12.0, 12.0)], ids=["wanders by less", "large but steady"]
)
def test_a_smaller_wander_and_a_large_steady_offset_are_no_drift(offset_dps: tuple[float, ...]) -> None:
    assert flag_gyro_drift(wander(*offset_dps)) == ()


@pytest.mark.parametrize(
    ("angle_deg", "seconds", "codes"),
    [(91.0, 3600, ["W-UPSIDE"]), (89.9, 3600, []), (91.0, 3599, [])],
)
def test_an_arm_above_level_for_most_of_an_hour_is_a_sensor_upside_down(
    angle_deg: float, seconds: int, codes: list[str]
) -> None:
    exposure = summarise_exposure(elevate(np.full(seconds, angle_deg), rate_hz=1.0))

    assert [flag.code for flag in flag_upside_down(exposure)] == codes


# What `inspect` calls missing is what the analysis calls missing: one count.


def missing_s(analysis: Analysis) -> dict[str, float]:
    """The missing time by what it consists of."""
    return {part.name: part.duration_us / 1e6 for part in analysis.time.parts if part.account == "missing"}


@pytest.mark.parametrize(
    ("content", "name"),
    [
        (ordered(thinned_at_random(2000, 4000)).encode(), "shift.csv"),
        (stalls().encode(), "shift.csv"),
        (replaced(59, second(59, stamp=59 + 3600))(), "shift.gt3x"),
        (replaced(30, second(30, n_rows=60))(), "shift.gt3x"),
    ],
    ids=["pieces under 1 s", "stalls", "last second an hour late", "60 rows in a second"],
)
def test_inspect_and_analysis_count_alike(content: bytes, name: str) -> None:
    recording = read_recording(io.BytesIO(content), file_name=name)

    told = inspect_recording(recording, find_exclusions(recording))

    assert missing_s(analyse(recording)).get("missing", 0.0) == pytest.approx(told["missing_s"], abs=1e-4)


@pytest.mark.parametrize("place", [0, 59])
def test_one_second_alone_makes_no_hole_of_an_hour(place: int) -> None:
    stamp = -3600 if place == 0 else 3659
    content = replaced(place, second(place, stamp=stamp))()

    recording = read_recording(io.BytesIO(content), file_name="shift.gt3x")

    assert recording.duration_us == 60_000_000
    assert [flag.code for flag in recording.flags] == ["W-CLOCK-FWD"]
    assert f"{recording.start:%H:%M:%S}" == "08:00:00"


@pytest.mark.parametrize(
    ("holes_us", "told"),
    [
        (5_000_000, {"missing": 5_000_000}),
        (4_500_000, {"missing": 5_000_000}),
        (3_000_000, {"missing": 3_000_000, "untrusted": 2_000_000}),
    ],
    ids=["only holes", "less than a second", "two seconds that are not trusted"],
)
def test_what_was_recorded_and_is_not_trusted_is_a_part_of_its_own(
    holes_us: int, told: dict[str, int]
) -> None:
    time = TimeAccount(65_000_000, 60_000_000, 5_000_000, 0)

    parts = divide_time(time, {"work": 60_000_000}, (), holes_us).parts

    assert {part.name: part.duration_us for part in parts if part.account == "missing"} == told


# A sensor on a desk is proposed as not worn; an arm at rest for a while is not, and nothing is left out.

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
