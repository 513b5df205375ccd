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
from fusion.exposure.cycles import RANGE_EDGES_DEG, count_cycles, summarise_cycles
from fusion.exposure.episodes import Stays, find_stays, summarise_entries, summarise_episodes
from fusion.exposure.eva import SHAPE, summarise_eva, tally_eva
from fusion.exposure.intervals import (
    add_above_intervals,
    add_bin_intervals,
    draw_days,
    name_percentile_intervals,
)
from fusion.exposure.metric_filter import CORNER_HZ, MetricAngle, filter_elevation, is_filtered
from fusion.exposure.parts import DayParts, profile_minutes, split_hours, split_minutes, summarise_parts
from fusion.exposure.peaks import SecondTally, find_peak_windows
from fusion.exposure.rows import IntArray, find_end_us
from fusion.exposure.types import Exposure, Velocity
from fusion.exposure.velocity import SpeedTally
from fusion.recording import MICROSECONDS, BoolArray, Recording, Segment

MAIN_THRESHOLD_DEG = 60


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTallies:
    """The four speeds of the day."""

    inclination: SpeedTally = field(default_factory=SpeedTally)
    generalised: SpeedTally = field(default_factory=SpeedTally)
    generalised_accelerometer: SpeedTally = field(default_factory=SpeedTally)
    gyroscope: SpeedTally = field(default_factory=SpeedTally)

    def add_vertical(self, segment: ElevationSegment, valid: BoolArray) -> None:
        """Count the speed that is taken from the fused vertical."""
        if is_filtered(segment.rate_hz):
            self.generalised.add_generalised(segment, valid)

    def add_samples(
        self, segment: Segment, gyro_bias_dps: NDArray[np.float64] | None, valid: BoolArray
    ) -> None:
        """Count the speeds that are taken from what the sensor wrote."""
        if not is_filtered(segment.rate_hz):
            return
        self.generalised_accelerometer.add_accelerometer(segment, valid)
        if gyro_bias_dps is not None:
            self.gyroscope.add_gyroscope(segment, gyro_bias_dps, valid)

    def summarise(self) -> dict[str, Velocity | None]:
        """Give each speed by its name in results.json; None where it could not be computed."""
        return {
            "inclination": self.inclination.summarise(),
            "generalised": self.generalised.summarise(),
            "generalised_accelerometer": self.generalised_accelerometer.summarise(),
            "gyroscope": self.gyroscope.summarise(),
        }


@dataclass(frozen=True, slots=True, eq=False)
class DayTally:
    """What the segments leave behind: sums that are filled in place, and stays in time order."""

    duration_us: int
    hours: DayParts
    by_hour: PartHistograms
    by_minute: PartHistograms
    by_second: SecondTally
    speeds: SpeedTallies = field(default_factory=SpeedTallies)
    cycles: NDArray[np.float64] = field(default_factory=lambda: np.zeros(len(RANGE_EDGES_DEG) - 1))
    eva_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(SHAPE))
    stays: dict[int, list[Stays]] = field(default_factory=lambda: {c: [] for c in THRESHOLDS_DEG})

    def add(self, angle: MetricAngle) -> None:
        """Count one segment's angle."""
        self.by_hour.add(angle)
        self.by_minute.add(angle)
        self.by_second.add(angle)
        for threshold_deg, stays in self.stays.items():
            stays.append(find_stays(angle, threshold_deg))
        self.cycles.__iadd__(count_cycles(angle))
        self.eva_s.__iadd__(tally_eva(angle))
        self.speeds.inclination.add_inclination(angle)


def summarise_exposure(
    elevation: Elevation,
    start: datetime | None = None,
    samples: Recording | None = None,
    gyro_bias_dps: NDArray[np.float64] | None = None,
    bias_sigma_deg: float | None = None,
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

    Raises
    ------
    TooShort
        When there is no valid row at all.
    """
    day = _start_day(elevation, start, samples)
    segments = {segment.start_us: segment for segment in samples.segments} if samples else {}
    for segment in elevation.segments:
        if len(segment) == 0:
            continue
        angle = filter_elevation(segment)
        day.add(angle)
        day.speeds.add_vertical(segment, angle.valid)
        sampled = segments.get(segment.start_us)
        if sampled is not None and len(sampled) == len(segment):
            day.speeds.add_samples(sampled, gyro_bias_dps, angle.valid)
    exposure = _summarise_day(day, _name_filter(elevation))
    return exposure if bias_sigma_deg is None else _add_intervals(exposure, day, bias_sigma_deg)


def _start_day(elevation: Elevation, start: datetime | None, samples: Recording | None) -> DayTally:
    ends_us = [find_end_us(segment) for segment in elevation.segments]
    duration_us = max([*ends_us, samples.duration_us if samples else 0, 1])
    hours, minute_edges_us = split_hours(start, duration_us), split_minutes(duration_us)
    return DayTally(
        duration_us,
        hours,
        PartHistograms(hours.edges_us, np.zeros((len(hours.labels), CELLS), np.int64)),
        PartHistograms(minute_edges_us, np.zeros((len(minute_edges_us) - 1, CELLS), np.int32)),
        SecondTally(np.zeros((-(-duration_us // MICROSECONDS), 2))),
    )


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
    return Exposure(
        analysed_s=analysed_s,
        bins=summarise_bins(cell_us),
        time_above=summarise_time_above(cell_us),
        percentiles_deg=percentiles_deg,
        entries=tuple(summarise_entries(c, stays, analysed_s) for c, stays in day.stays.items()),
        cycles=summarise_cycles(day.cycles),
        episodes=tuple(summarise_episodes(c, stays) for c, stays in day.stays.items()),
        velocity_dps=day.speeds.summarise(),
        elevation_p99_deg=percentiles_deg[99],
        peak_windows=find_peak_windows(day.by_second, day.duration_us),
        eva=summarise_eva(day.eva_s),
        by_hour=summarise_parts(day.hours, day.by_hour, main_entries_us),
        by_period=(),
        minutes=profile_minutes(day.by_minute),
        histogram_s=cell_us / MICROSECONDS,
        metric_filter_hz=metric_filter_hz,
    )


def _add_intervals(exposure: Exposure, day: DayTally, bias_sigma_deg: float) -> Exposure:
    draws = draw_days(day.by_minute.cell_us, bias_sigma_deg)
    return replace(
        exposure,
        bins=add_bin_intervals(exposure.bins, draws),
        time_above=add_above_intervals(exposure.time_above, draws),
        intervals=name_percentile_intervals(draws),
    )
