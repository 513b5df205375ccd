"""What holds for the exposure of any movement: parts add up, rate and holes do not matter, trust does."""

from datetime import datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from acromion.fusion.elevation import Elevation, ElevationSegment
from acromion.fusion.errors import TooShort
from acromion.fusion.exposure.metric_filter import design_filter, filter_angle, filter_elevation
from acromion.fusion.exposure.parts import find_quarter_hours
from acromion.fusion.exposure.speeds import BLOCK_ROWS, SpeedTally, filter_blocks
from acromion.fusion.exposure.summary import summarise_exposure
from acromion.fusion.exposure.types import Exposure, Velocity
from acromion.fusion.recording import MICROSECONDS, Recording, Segment
from tests.factories import elevate

START = datetime(2026, 3, 2, 7, 12, 30)  # noqa: DTZ001 - a device's own clock, which has no zone


def wander(seconds: float, rate_hz: float = 100.0, seed: int = 0) -> NDArray[np.float64]:
    """Swing slowly between hanging and overhead, with faster work on top; the same curve at any rate."""
    time_s = np.arange(round(seconds * rate_hz)) / rate_hz
    phase = np.random.default_rng(seed).uniform(0, 2 * np.pi, 3)
    slow = 50 + 45 * np.sin(2 * np.pi * time_s / 37 + phase[0])
    work = 12 * np.sin(2 * np.pi * 0.4 * time_s + phase[1]) + 6 * np.sin(2 * np.pi * 1.1 * time_s + phase[2])
    return np.asarray(np.clip(slow + work, 0, 180), np.float64)


def distrust(elevation: Elevation, rows: slice) -> Elevation:
    """Mark rows as not valid."""
    elevation.segments[0].valid[rows] = False
    return elevation


def shares(exposure: Exposure) -> list[float]:
    return [part.percent for part in exposure.bins]


@pytest.mark.parametrize("rate_hz", [20.0, 99.87, 952.0])
def test_the_metric_filter_is_scipys_to_the_last_digit(rate_hz: float) -> None:
    noise = np.random.default_rng(1).normal(45, 20, 5000).astype(np.float32)

    expected = sosfiltfilt(butter(2, 5, fs=rate_hz, output="sos"), noise.astype(np.float64))
    assert filter_angle(noise, rate_hz) == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("rate_hz", [20.0, 99.87, 100.0, 476.0, 1000.0])
def test_the_section_is_scipys_to_the_bit(rate_hz: float) -> None:
    expected = butter(2, 5, fs=rate_hz, output="sos")[0]

    assert design_filter(rate_hz) == (*expected[:3], *expected[4:])


@pytest.mark.parametrize("rows", [1, 2, 9, 10])
def test_a_run_too_short_for_the_usual_padding_mirrors_what_it_has(rows: int) -> None:
    noise = np.random.default_rng(1).normal(45, 20, rows)

    expected = sosfiltfilt(butter(2, 5, fs=100, output="sos"), noise, padlen=min(9, rows - 1))
    assert filter_angle(noise, 100.0) == pytest.approx(expected, abs=1e-10)


def test_the_filtered_angle_stays_between_0_and_180_deg_and_has_six_decimals() -> None:
    edges = np.where(np.arange(1000) % 200 < 100, 0.0, 180.0)
    angle_deg = filter_elevation(elevate(edges).segments[0]).elevation_deg

    assert (angle_deg.min(), angle_deg.max()) == (0.0, 180.0)
    assert np.array_equal(angle_deg, np.round(angle_deg, 6))


def test_under_20_hz_nothing_is_filtered_and_it_is_said() -> None:
    exposure = summarise_exposure(elevate(np.array([0.0, 180.0] * 50), rate_hz=19.9))

    assert exposure.metric_filter_hz is None
    assert shares(exposure)[0] == pytest.approx(50.0)


@given(st.integers(0, 1000), st.floats(20.0, 600.0), st.lists(st.integers(2, 4000), min_size=1, max_size=4))
@settings(max_examples=25, deadline=None)
def test_bins_hours_and_minutes_each_add_up_to_the_analysed_time(
    seed: int, rate_hz: float, lengths: list[int]
) -> None:
    curve = wander(sum(lengths) / rate_hz + 1, rate_hz, seed)
    runs = np.split(curve[: sum(lengths)], np.cumsum(lengths)[:-1])
    exposure = summarise_exposure(elevate(*runs, rate_hz=rate_hz), START)

    analysed_us = round(exposure.analysed_s * 1e6)
    assert sum(round(part.duration_s * 1e6) for part in exposure.bins) == analysed_us
    assert sum(round(part.analysed_s * 1e6) for part in exposure.by_hour) == analysed_us
    assert round(exposure.histogram_s.sum() * 1e6) == analysed_us
    assert exposure.minutes.analysed_s.sum() == pytest.approx(exposure.analysed_s, abs=1e-3)
    assert exposure.eva.percent.sum() == pytest.approx(100.0)


@pytest.mark.parametrize("rate_hz", [50.0, 99.87, 500.0])
def test_the_rate_does_not_matter(rate_hz: float) -> None:
    at_100 = summarise_exposure(elevate(wander(120)))  # a curve that grazes no threshold
    other = summarise_exposure(elevate(wander(120, rate_hz), rate_hz=rate_hz))

    assert shares(other) == pytest.approx(shares(at_100), abs=0.25)
    assert [e.count for e in other.entries] == [e.count for e in at_100.entries]
    assert [c.count for c in other.cycles] == [c.count for c in at_100.cycles]
    slow, fast = (exposure.velocity_dps["inclination"] for exposure in (at_100, other))
    assert slow is not None
    assert fast is not None
    assert fast.p90_dps == pytest.approx(slow.p90_dps, rel=0.02)


def test_a_hole_leaves_the_denominator() -> None:
    whole = wander(370)  # ten slow swings
    exposure = summarise_exposure(elevate(whole, whole, hole_s=100.0))

    assert exposure.analysed_s == 740.0
    assert shares(exposure) == pytest.approx(shares(summarise_exposure(elevate(whole))))


def test_rows_that_are_not_trusted_count_nowhere() -> None:
    exposure = summarise_exposure(
        distrust(elevate(np.repeat([10.0, 80.0], 6000)), slice(6000, 12_000)), START
    )

    assert exposure.analysed_s == 60.0
    assert exposure.time_above[0].duration_s < 0.1  # the filter's slope just before the step
    assert np.isnan(exposure.minutes.p50_deg[1])


def test_rows_that_are_no_number_count_nowhere_and_spoil_no_others() -> None:
    angle = np.full(6000, 40.0)
    angle[3000:3100] = np.nan
    exposure = summarise_exposure(elevate(angle))

    assert exposure.analysed_s == 59.0
    assert shares(exposure)[2] == 100.0


@pytest.mark.parametrize(("rows", "is_bridged"), [(4, True), (5, False)])
def test_a_step_of_up_to_50_ms_over_rows_without_a_number_is_bridged_for_the_filter_only(
    rows: int, *, is_bridged: bool
) -> None:
    # 40 deg before the hole and 60 deg behind it: a filter that goes on rounds the step off, one that
    # restarts gives 40 deg up to the hole.
    angle = np.repeat([40.0, 60.0], 100).astype(np.float32)
    angle[100 : 100 + rows] = np.nan
    filtered = filter_elevation(ElevationSegment(0, 100.0, angle, np.ones(200, np.bool_)))

    assert (filtered.elevation_deg[99] > 41.0) == is_bridged
    assert filtered.valid.sum() == 200 - rows


def test_without_a_trusted_row_there_is_no_figure() -> None:
    with pytest.raises(TooShort):
        summarise_exposure(elevate(np.full(6000, 40.0), valid=False))


def test_gaps_under_half_a_second_are_merged_and_stays_under_half_a_second_dropped() -> None:
    levels = [10, 80, 10, 80, 10, 80, 10]
    rows = [20, 20, 4, 20, 20, 4, 20]  # at 10 Hz: a gap of 0.4 s, and a stay of 0.4 s
    exposure = summarise_exposure(elevate(np.repeat(levels, rows).astype(np.float64), rate_hz=10.0))

    holds = exposure.episodes[1]
    assert (holds.count, holds.longest_s, holds.longest_start_s) == (1, 4.4, 2.0)
    assert exposure.entries[1].count == 3  # repetitions are counted before any merging


def test_the_profile_gives_each_minute_its_own_median() -> None:
    exposure = summarise_exposure(elevate(np.repeat([15.0, 75.0, 100.0], 600), rate_hz=10.0))

    assert exposure.minutes.p50_deg == pytest.approx([15.0, 75.0, 100.0], abs=0.1)
    assert exposure.minutes.start_s.tolist() == [0.0, 60.0, 120.0]


@pytest.mark.parametrize(
    ("start", "parts"),
    [
        (START, [("2026-03-02T07:00", 0.0, 2850.0), ("2026-03-02T08:00", 2850.0, 4000.0)]),
        (None, [("+00:00", 0.0, 3600.0), ("+01:00", 3600.0, 4000.0)]),
    ],
)
def test_hours_begin_at_the_full_hours_of_the_clock_if_there_is_one(
    start: datetime | None, parts: list[tuple[str, float, float]]
) -> None:
    exposure = summarise_exposure(elevate(np.full(4000, 50.0), rate_hz=1.0), start)

    assert [(part.label, part.start_s, part.end_s) for part in exposure.by_hour] == parts


def test_an_hour_without_analysed_time_stays_in_the_list_without_figures() -> None:
    half_hour = np.full(1800, 50.0)
    exposure = summarise_exposure(elevate(half_hour, half_hour, rate_hz=1.0, hole_s=6 * 1800), START)

    empty = exposure.by_hour[2]
    assert (empty.analysed_s, empty.percentiles_deg, empty.entries_above_60_per_h) == (0.0, {}, None)


def test_entries_belong_to_the_hour_in_which_the_arm_rose() -> None:
    angle = np.full(36_000, 10.0)
    angle[30_000:30_100] = 80.0  # 50 min after 7:12:30
    exposure = summarise_exposure(elevate(angle, rate_hz=10.0), START)

    assert [part.entries_above_60_per_h for part in exposure.by_hour] == pytest.approx([0.0, 3600 / 750])


@pytest.mark.parametrize(("untrusted_s", "percent"), [(12, 100.0), (13, None)])
def test_a_window_needs_80_percent_of_analysed_time_and_counts_by_it(
    untrusted_s: int, percent: float | None
) -> None:
    exposure = summarise_exposure(distrust(elevate(np.full(60, 70.0), rate_hz=1.0), slice(0, untrusted_s)))

    assert exposure.peak_windows[0].percent_above_60 == percent


def test_an_arm_at_exactly_60_deg_is_above_60_deg_in_every_figure() -> None:
    exposure = summarise_exposure(elevate(np.full(60, 60.0), rate_hz=1.0))

    assert exposure.time_above[1].percent == 100.0
    assert exposure.peak_windows[0].percent_above_60 == 100.0


# The speeds that need more than the angle: of the vertical, of the accelerometer, of the gyroscope.

NOTHING = np.zeros(3)


def turn(rate_dps: float, seconds: float, rate_hz: float) -> tuple[Elevation, Recording]:
    """Lift the arm at an even rate, with what a sensor without error would read."""
    angle = 10.0 + rate_dps * np.arange(round(seconds * rate_hz)) / rate_hz
    radians = np.radians(angle)
    vertical = np.stack([np.sin(radians), np.zeros_like(radians), np.cos(radians)], axis=1).astype(np.float32)
    rates = np.tile(np.array([0.0, -rate_dps, 0.0], np.float32), (len(angle), 1))
    valid = np.ones(len(angle), np.bool_)
    elevation = Elevation((ElevationSegment(0, rate_hz, angle.astype(np.float32), valid, vertical),), None)
    segment = Segment(0, rate_hz, vertical, rates)
    return elevation, Recording("gt9x", "0" * 64, None, None, segment.duration_us, (segment,))


def speed(name: str, elevation: Elevation, recording: Recording, bias_dps: NDArray[np.float64]) -> Velocity:
    velocity = summarise_exposure(elevation, None, recording, bias_dps).velocity_dps[name]
    assert velocity is not None
    return velocity


@pytest.mark.parametrize("rate_hz", [99.87, 500.0])
@pytest.mark.parametrize("name", ["inclination", "generalised", "generalised_accelerometer", "gyroscope"])
def test_a_slow_lift_has_its_own_speed_in_all_four_kinds(name: str, rate_hz: float) -> None:
    elevation, recording = turn(9.0, 15.0, rate_hz)

    assert speed(name, elevation, recording, NOTHING).p50_dps == pytest.approx(9.0, abs=0.02)


def test_the_gyroscopes_offset_is_taken_off_and_without_it_there_is_no_speed() -> None:
    elevation, recording = turn(9.0, 15.0, 100.0)

    velocity = speed("gyroscope", elevation, recording, np.array([0.0, -2.0, 0.0]))

    assert velocity.p50_dps == pytest.approx(7.0, abs=0.02)
    assert summarise_exposure(elevation, None, recording).velocity_dps["gyroscope"] is None


def test_without_samples_and_vertical_only_the_inclination_has_a_speed() -> None:
    segment = ElevationSegment(0, 100.0, np.full(1000, 40.0, np.float32), np.ones(1000, np.bool_))

    velocity = summarise_exposure(Elevation((segment,), None)).velocity_dps
    assert {name for name, value in velocity.items() if value is not None} == {"inclination"}


@pytest.mark.parametrize("name", ["inclination", "generalised", "generalised_accelerometer", "gyroscope"])
def test_no_speed_is_taken_across_rows_that_are_not_trusted(name: str) -> None:
    elevation, recording = turn(9.0, 15.0, 100.0)
    elevation.segments[0].valid[500:1000] = False
    elevation.segments[0].elevation_deg[700:] += 40.0  # a jump while nobody trusts the angle
    elevation.segments[0].vertical[700:, 1] += 0.5  # type: ignore[index]

    assert speed(name, elevation, recording, NOTHING).p90_dps == pytest.approx(9.0, abs=0.6)


def test_filtering_in_blocks_is_filtering_the_whole() -> None:
    noise = np.random.default_rng(3).normal(0, 1, (2 * BLOCK_ROWS + 777, 3)).astype(np.float32)
    blocks = list(filter_blocks(noise, 500.0))

    whole = sosfiltfilt(butter(2, 5, fs=500, output="sos"), noise.astype(np.float64), axis=0)
    joined = np.concatenate([blocks[0][1], *(block[1:] for _, block in blocks[1:])])
    assert joined == pytest.approx(whole, abs=1e-10)


def test_each_row_of_the_gyroscope_counts_once_however_many_blocks_there_are() -> None:
    elevation, recording = turn(0.001, (2 * BLOCK_ROWS + 777) / 100.0, 100.0)
    speeds = SpeedTally()
    speeds.add_gyroscope(recording.segments[0], NOTHING, elevation.segments[0].valid)

    assert speeds.cell_s.sum() == pytest.approx(len(recording.segments[0]) / 100.0, abs=1e-6)


# The three quarter hours with the most time above 60 deg.

HOUR_S = 3600


def find_in(
    above: dict[int, float], *, length_s: int = 2 * HOUR_S
) -> list[tuple[float | None, float | None]]:
    """Return start and share of the quarter hours where ``above[s]`` seconds from ``s`` lie above 60 deg."""
    seconds = np.zeros((length_s, 2))
    seconds[:, 0] = 1.0
    for start_s, duration_s in above.items():
        seconds[start_s : start_s + int(duration_s), 1] = 1.0
    windows = find_quarter_hours(seconds, length_s * MICROSECONDS)
    return [(window.start_s, window.percent_above_60) for window in windows]


@pytest.mark.parametrize(
    ("above", "length_s", "percents"),
    [
        ({0: 90, 2700: 450, 5400: 180, 6500: 45}, 2 * HOUR_S, [50.0, 20.0, 10.0]),
        ({600: 90}, 2 * HOUR_S, [10.0]),
        ({0: 300}, 899, []),
    ],
    ids=["three of four", "without time above: none", "less than a quarter hour"],
)
def test_the_three_stand_in_the_order_of_their_time_above(
    above: dict[int, float], length_s: int, percents: list[float]
) -> None:
    assert [percent for _, percent in find_in(above, length_s=length_s)] == percents


def test_none_of_them_overlap() -> None:
    found = find_in({1000: 2700})

    assert sorted(start_s for start_s, _ in found if start_s is not None) == [1000, 1900, 2800]
