"""From elevation to all figures of a recording: one segment at a time, then the day."""

from dataclasses import dataclass, field, replace
from datetime import datetime

import numpy as np
from numpy.typing import NDArray

from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.exposure.bins import (
    CELLS,
    THRESHOLDS_DEG,
    PartHistograms,
    find_percentiles,
    summarise_bins,
    summarise_time_above,
)
from fusion.exposure.by_period import DayDivision, summarise_periods
from fusion.exposure.cycles import RANGE_EDGES_DEG, count_cycles, summarise_cycles
from fusion.exposure.episodes import Stays, find_stays, summarise_entries, summarise_episodes
from fusion.exposure.eva import SHAPE, summarise_eva, tally_eva
from fusion.exposure.frequency import FrequencyTally
from fusion.exposure.intervals import (
    add_above_intervals,
    add_bin_intervals,
    draw_figures,
    name_percentile_intervals,
    name_speed_intervals,
    sum_blocks,
)
from fusion.exposure.metric_filter import CORNER_HZ, MetricAngle, filter_elevation, is_filtered
from fusion.exposure.parts import DayParts, profile_minutes, split_hours, split_minutes, summarise_parts
from fusion.exposure.peaks import SecondTally, ShiftedSeconds, find_peak_windows
from fusion.exposure.recovery import RecoveryTally
from fusion.exposure.resampling import draw_blocks, split_blocks, spread_errors
from fusion.exposure.rows import IntArray, find_end_us
from fusion.exposure.shifted_stays import ShiftedStays, name_stay_intervals, start_shifted_stays
from fusion.exposure.types import Exposure, Velocity
from fusion.exposure.variation import describe_hours, summarise_eva_matrix
from fusion.exposure.velocity import SpeedTally, measure_generalised, measure_inclination
from fusion.recording import MICROSECONDS, BoolArray, Recording, Segment

MAIN_THRESHOLD_DEG = 60
UNDIVIDED = DayDivision()


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTallies:
    """The four speeds of the day."""

    inclination: SpeedTally
    generalised: SpeedTally
    generalised_accelerometer: SpeedTally
    gyroscope: SpeedTally
    recovery: RecoveryTally = field(default_factory=RecoveryTally)

    def add_vertical(self, segment: ElevationSegment, angle: MetricAngle) -> None:
        """Count the speed that is taken from the fused vertical, and the rest that it shows."""
        if segment.vertical is None or not is_filtered(segment.rate_hz):
            speeds_dps = measure_inclination(angle.elevation_deg, angle.valid, angle.rate_hz)
            self.recovery.add(angle.elevation_deg, angle.valid, speeds_dps, angle.rate_hz)
        else:
            for first, speeds_dps in measure_generalised(segment, angle.valid):
                self.generalised.add(segment, first, speeds_dps, segment.rate_hz)
                rows = slice(first, first + len(speeds_dps))
                self.recovery.add(angle.elevation_deg[rows], angle.valid[rows], speeds_dps, angle.rate_hz)
        self.recovery.end_segment(angle.rate_hz)

    def add_samples(
        self, segment: Segment, gyro_bias_dps: NDArray[np.float64] | None, valid: BoolArray
    ) -> None:
        """Count the speeds that are taken from what the sensor wrote."""
        if not is_filtered(segment.rate_hz):
            return
        self.generalised_accelerometer.add_accelerometer(segment, valid)
        if gyro_bias_dps is not None:
            self.gyroscope.add_gyroscope(segment, gyro_bias_dps, valid)

    def list_kinds(self) -> dict[str, SpeedTally]:
        """Give each speed by its name in results.json."""
        return {
            "inclination": self.inclination,
            "generalised": self.generalised,
            "generalised_accelerometer": self.generalised_accelerometer,
            "gyroscope": self.gyroscope,
        }

    def summarise(self) -> dict[str, Velocity | None]:
        """Give the figures of each speed; None where it could not be computed."""
        return {kind: tally.summarise() for kind, tally in self.list_kinds().items()}


@dataclass(frozen=True, slots=True, eq=False)
class ErrorTally:
    """What is counted again with the angle read a little too high or too low."""

    sigma_deg: float
    stays: ShiftedStays
    seconds: ShiftedSeconds

    def add(self, angle: MetricAngle) -> None:
        """Count one segment's angle."""
        self.stays.add(angle)
        self.seconds.add(angle)


@dataclass(frozen=True, slots=True, eq=False)
class DayTally:
    """What the segments leave behind: sums that are filled in place, and stays in time order."""

    duration_us: int
    hours: DayParts
    by_hour: PartHistograms
    by_minute: PartHistograms
    by_second: SecondTally
    division: DayDivision
    by_piece: PartHistograms
    speeds: SpeedTallies
    errors: ErrorTally | None
    frequency: FrequencyTally = field(default_factory=FrequencyTally)
    cycles: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(RANGE_EDGES_DEG) - 1))
    eva_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(SHAPE))
    stays: dict[int, list[Stays]] = field(default_factory=lambda: {c: [] for c in THRESHOLDS_DEG})

    def add(self, angle: MetricAngle) -> None:
        """Count one segment's angle."""
        self.by_hour.add(angle)
        self.by_minute.add(angle)
        self.by_second.add(angle)
        if self.division.pieces:
            self.by_piece.add(angle)
        for threshold_deg, stays in self.stays.items():
            stays.append(find_stays(angle, threshold_deg))
        self.cycles.__iadd__(count_cycles(angle))
        self.eva_s.__iadd__(tally_eva(angle))
        self.frequency.add(angle)
        if self.errors is not None:
            self.errors.add(angle)
        self.speeds.inclination.add_inclination(angle)


def summarise_exposure(  # noqa: PLR0913  each is an input of its own
    elevation: Elevation,
    start: datetime | None = None,
    samples: Recording | None = None,
    gyro_bias_dps: NDArray[np.float64] | None = None,
    bias_sigma_deg: float | None = None,
    *,
    division: DayDivision = UNDIVIDED,
) -> Exposure:
    """Summarise how much the arm was raised; only valid rows count.

    Parameters
    ----------
    elevation
        Before the metric filter, which is applied here to each segment at its own rate.
    start
        The clock at the first sample, for the figures by clock hour.
    samples
        The recording the elevation was made from: gives its length, and the two speeds that need samples.
    gyro_bias_dps
        Shape (3,), sensor frame: offset for the gyroscope's speed, without which that speed is None.
    bias_sigma_deg
        Standard deviation of a constant error of the angle (fusion and pose); without it no interval.
    division
        The periods of the diary, for the figures by period; what they leave out must not be valid.

    Raises
    ------
    TooShort
        When there is no valid row at all.
    """
    day = _start_day(_measure_length(elevation, samples), start, division, bias_sigma_deg)
    segments = {segment.start_us: segment for segment in samples.segments} if samples else {}
    for segment in elevation.segments:
        if len(segment) == 0:
            continue
        angle = filter_elevation(segment)
        day.add(angle)
        day.speeds.add_vertical(segment, angle)
        sampled = segments.get(segment.start_us)
        if sampled is not None and len(sampled) == len(segment):
            day.speeds.add_samples(sampled, gyro_bias_dps, angle.valid)
    exposure = _summarise_day(day, _name_filter(elevation))
    return exposure if day.errors is None else _add_intervals(exposure, day, day.errors)


def _measure_length(elevation: Elevation, samples: Recording | None) -> int:
    ends_us = [find_end_us(segment) for segment in elevation.segments]
    return max([*ends_us, samples.duration_us if samples else 0, 1])


def _start_day(
    duration_us: int, start: datetime | None, division: DayDivision, bias_sigma_deg: float | None
) -> DayTally:
    hours, minute_edges_us = split_hours(start, duration_us), split_minutes(duration_us)
    block_edges_us = split_blocks(duration_us)
    seconds = -(-duration_us // MICROSECONDS)
    return DayTally(
        duration_us,
        hours,
        PartHistograms(hours.edges_us, np.zeros((len(hours.labels), CELLS), np.int64)),
        PartHistograms(minute_edges_us, np.zeros((len(minute_edges_us) - 1, CELLS), np.int32)),
        SecondTally(np.zeros((seconds, 2))),
        division,
        division.start_histograms(),
        SpeedTallies(
            SpeedTally(block_edges_us),
            SpeedTally(block_edges_us),
            SpeedTally(block_edges_us),
            SpeedTally(block_edges_us),
        ),
        None if bias_sigma_deg is None else _start_errors(seconds, block_edges_us, bias_sigma_deg),
    )


def _start_errors(seconds: int, block_edges_us: IntArray, sigma_deg: float) -> ErrorTally:
    errors_deg = spread_errors(sigma_deg)
    shifted = ShiftedSeconds(errors_deg, np.zeros((seconds, len(errors_deg) + 1), np.float32))
    return ErrorTally(sigma_deg, start_shifted_stays(errors_deg, block_edges_us), shifted)


def _name_filter(elevation: Elevation) -> float | None:
    filtered = any(is_filtered(segment.rate_hz) for segment in elevation.segments)
    return CORNER_HZ if filtered else None


def _summarise_day(day: DayTally, metric_filter_hz: float | None) -> Exposure:
    cell_us: IntArray = day.by_hour.cell_us.sum(axis=0, dtype=np.int64)
    analysed_s = int(cell_us.sum()) / MICROSECONDS
    if analysed_s == 0.0:
        raise TooShort(s=0.0)
    percentiles_deg = find_percentiles(cell_us)
    main_entries_us = np.concatenate([stays.entry_us for stays in day.stays[MAIN_THRESHOLD_DEG]])
    by_hour = summarise_parts(day.hours, day.by_hour, main_entries_us)
    eva = summarise_eva(day.eva_s)
    return Exposure(
        analysed_s=analysed_s,
        bins=summarise_bins(cell_us),
        time_above=summarise_time_above(cell_us),
        percentiles_deg=percentiles_deg,
        entries=tuple(
            summarise_entries(c, stays, analysed_s, day.by_minute) for c, stays in day.stays.items()
        ),
        cycles=summarise_cycles(day.cycles),
        episodes=tuple(summarise_episodes(c, stays, analysed_s) for c, stays in day.stays.items()),
        velocity_dps=day.speeds.summarise(),
        elevation_p99_deg=percentiles_deg[99],
        peak_windows=find_peak_windows(day.by_second, day.duration_us),
        eva=eva,
        by_hour=by_hour,
        by_period=summarise_periods(day.division, day.by_piece, main_entries_us),
        minutes=profile_minutes(day.by_minute),
        histogram_s=cell_us / MICROSECONDS,
        metric_filter_hz=metric_filter_hz,
        recovery=day.speeds.recovery.summarise(analysed_s),
        frequency=day.frequency.summarise(analysed_s),
        hour_variation=describe_hours(by_hour),
        eva_summary=summarise_eva_matrix(eva),
    )


def _add_intervals(exposure: Exposure, day: DayTally, errors: ErrorTally) -> Exposure:
    blocks = sum_blocks(day.by_minute.cell_us)
    block_us = blocks.sum(axis=1)
    draws = draw_blocks(block_us, errors.sigma_deg)
    figures = draw_figures(blocks, draws)
    intervals = {
        **name_percentile_intervals(figures),
        **name_stay_intervals(errors.stays, exposure.episodes, draws, block_us / MICROSECONDS),
        **errors.seconds.name_intervals(exposure.peak_windows, draws),
    }
    for kind, tally in day.speeds.list_kinds().items():
        intervals |= name_speed_intervals(kind, exposure.velocity_dps[kind], tally, draws)
    return replace(
        exposure,
        bins=add_bin_intervals(exposure.bins, figures),
        time_above=add_above_intervals(exposure.time_above, figures),
        intervals=intervals,
    )
