"""Everything that is counted segment by segment: sums that are filled in place, and stays in time order."""

from collections.abc import Callable
from datetime import datetime
from functools import partial

import numpy as np

from fusion.elevation import ElevationSegment
from fusion.exposure.bins import CELLS, THRESHOLDS_DEG, PartHistograms, Stretches, cut_day
from fusion.exposure.cycles import CycleTally
from fusion.exposure.episodes import LoweredEntries, ShiftedStays, Stays, find_stays
from fusion.exposure.eva import EvaTally
from fusion.exposure.metric_filter import MetricAngle, is_filtered
from fusion.exposure.parts import DayDivision, split_hours, split_minutes
from fusion.exposure.peaks import SecondTally, ShiftedSeconds
from fusion.exposure.recovery import SLOW_DPS, RecoveryTally
from fusion.exposure.resampling import spread_errors
from fusion.exposure.speeds import FrequencyTally, SpeedTally, measure_generalised, measure_inclination
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray, Segment

Count = Callable[[], None]

EXACT = np.zeros(1)
"""The errors of the angle where none is known: the angle as it was read."""


class SpeedTallies:
    """The four speeds of the day, by their names in results.json, and the rest that the fused one shows."""

    def __init__(self, errors_deg: Float64Array, edges_us: IntArray) -> None:
        """Start with nothing counted."""
        names = ("inclination", "generalised", "generalised_accelerometer", "gyroscope")
        self.kinds = {name: SpeedTally(edges_us) for name in names}
        self.recovery = RecoveryTally(errors_deg, edges_us)

    def add_vertical(self, segment: ElevationSegment, angle: MetricAngle) -> None:
        """Count the speed that is taken from the fused vertical, and the rest that it shows."""
        if segment.vertical is None or not is_filtered(segment.rate_hz):
            slow = measure_inclination(angle.elevation_deg, angle.valid, angle.rate_hz) < SLOW_DPS
        else:
            slow = np.zeros(len(angle), np.bool_)
            for first, speeds_dps in measure_generalised(segment, angle.valid):
                self.kinds["generalised"].add(segment, first, speeds_dps, segment.rate_hz)
                slow[first : first + len(speeds_dps)] = speeds_dps < SLOW_DPS
        self.recovery.add(angle, slow)

    def add_samples(self, segment: Segment, gyro_bias_dps: Float64Array | None, valid: BoolArray) -> None:
        """Count the speeds that are taken from what the sensor wrote."""
        if is_filtered(segment.rate_hz):
            self.kinds["generalised_accelerometer"].add_accelerometer(segment, valid)
            if gyro_bias_dps is not None:
                self.kinds["gyroscope"].add_gyroscope(segment, gyro_bias_dps, valid)


class ErrorTally:
    """What is counted again with the angle read a little too high or too low."""

    def __init__(self, sigma_deg: float, duration_s: int, stretches: Stretches, *, is_npose: bool) -> None:
        """Start with nothing counted."""
        errors_deg = spread_errors(sigma_deg)
        self.sigma_deg = sigma_deg
        self.stays = ShiftedStays(errors_deg, stretches)
        self.seconds = ShiftedSeconds(errors_deg, duration_s)
        self.lowered = LoweredEntries(errors_deg, stretches.edges_us) if is_npose else None

    def add(self, angle: MetricAngle) -> None:
        """Count one segment's angle."""
        self.stays.add(angle)
        self.seconds.add(angle)
        if self.lowered is not None:
            self.lowered.add(angle)


class DayTally:
    """All that is counted; without a known error of the angle, no figure gets an interval."""

    def __init__(
        self,
        duration_us: int,
        start: datetime | None,
        division: DayDivision,
        bias_sigma_deg: float | None,
        *,
        is_npose: bool,
    ) -> None:
        """Start with nothing counted."""
        self.duration_us, self.division = duration_us, division
        self.hours = split_hours(start, duration_us)
        self.stretches = cut_day(split_minutes(duration_us), self.hours.edges_us, division.list_edges())
        hours, stretches = len(self.hours.labels), len(self.stretches.minute_of)
        self.by_hour = PartHistograms(self.hours.edges_us, np.zeros((hours, CELLS), np.int64))
        self.by_stretch = PartHistograms(self.stretches.edges_us, np.zeros((stretches, CELLS), np.int32))
        seconds, block_edges_us = -(-duration_us // MICROSECONDS), self.stretches.block_edges_us
        errors_deg, self.errors = EXACT, None
        if bias_sigma_deg is not None:
            errors_deg = spread_errors(bias_sigma_deg)
            self.errors = ErrorTally(bias_sigma_deg, seconds, self.stretches, is_npose=is_npose)
        self.by_second = SecondTally(seconds)
        self.speeds = SpeedTallies(errors_deg, block_edges_us)
        self.frequency = FrequencyTally(block_edges_us)
        self.eva = EvaTally(errors_deg, block_edges_us)
        self.cycles = CycleTally(errors_deg, block_edges_us)
        self.stays: dict[int, list[Stays]] = {c: [] for c in THRESHOLDS_DEG}

    def list_counts(self, angle: MetricAngle) -> list[Count]:
        """List what is to be counted of one segment's angle; each fills sums of its own, in any order."""
        tallies = (self.eva, self.cycles, self.by_hour, self.by_stretch, self.by_second, self.frequency)
        counts: list[Count] = [partial(self._add_stays, angle)]
        if self.errors is not None:
            counts.append(partial(self.errors.add, angle))
        counts += [partial(tally.add, angle) for tally in tallies]
        return [*counts, partial(self.speeds.kinds["inclination"].add_inclination, angle)]

    def _add_stays(self, angle: MetricAngle) -> None:
        for threshold_deg, stays in self.stays.items():
            stays.append(find_stays(angle, threshold_deg))

    def list_entries(self, threshold_deg: int) -> IntArray:
        """Return the times of the entries above a threshold."""
        return np.concatenate([stays.entry_us for stays in self.stays[threshold_deg]])
