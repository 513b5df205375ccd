"""Everything that is counted segment by segment: sums that are filled in place, and stays in time order."""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from functools import partial

import numpy as np

from fusion.elevation import ElevationSegment
from fusion.exposure.bins import CELLS, THRESHOLDS_DEG, PartHistograms
from fusion.exposure.cycles import CycleTally, start_cycles
from fusion.exposure.episodes import ShiftedStays, Stays, find_stays, start_shifted_stays
from fusion.exposure.eva import EvaTally, start_eva
from fusion.exposure.metric_filter import MetricAngle, is_filtered
from fusion.exposure.parts import DayDivision, DayParts, Stretches, cut_day, split_hours, split_minutes
from fusion.exposure.peaks import SecondTally, ShiftedSeconds
from fusion.exposure.pose_error import LoweredEntries, start_lowered_entries
from fusion.exposure.recovery import RecoveryTally, start_recovery
from fusion.exposure.resampling import spread_errors
from fusion.exposure.speeds import FrequencyTally, SpeedTally, measure_generalised, measure_inclination
from fusion.exposure.types import Velocity
from fusion.recording import MICROSECONDS, BoolArray, Float64Array, IntArray, Segment

Count = Callable[[], None]

EXACT = np.zeros(1)
"""The errors of the angle where none is known: the angle as it was read."""


@dataclass(frozen=True, slots=True, eq=False)
class SpeedTallies:
    """The four speeds of the day, and the rest that the fused one shows."""

    inclination: SpeedTally
    generalised: SpeedTally
    generalised_accelerometer: SpeedTally
    gyroscope: SpeedTally
    recovery: RecoveryTally

    def add_vertical(self, segment: ElevationSegment, angle: MetricAngle) -> None:
        """Count the speed that is taken from the fused vertical, and the rest that it shows."""
        if segment.vertical is None or not is_filtered(segment.rate_hz):
            speeds_dps = measure_inclination(angle.elevation_deg, angle.valid, angle.rate_hz)
            self.recovery.add(angle, 0, speeds_dps)
        else:
            for first, speeds_dps in measure_generalised(segment, angle.valid):
                self.generalised.add(segment, first, speeds_dps, segment.rate_hz)
                self.recovery.add(angle, first, speeds_dps)
        self.recovery.end_segment(angle)

    def add_samples(self, segment: Segment, gyro_bias_dps: Float64Array | None, valid: BoolArray) -> None:
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
    lowered: LoweredEntries | None = None

    def add(self, angle: MetricAngle) -> None:
        """Count one segment's angle."""
        self.stays.add(angle)
        self.seconds.add(angle)
        if self.lowered is not None:
            self.lowered.add(angle)


@dataclass(frozen=True, slots=True, eq=False)
class DayTally:
    """All that is counted."""

    duration_us: int
    hours: DayParts
    division: DayDivision
    stretches: Stretches
    by_hour: PartHistograms
    by_stretch: PartHistograms
    by_second: SecondTally
    speeds: SpeedTallies
    errors: ErrorTally | None
    frequency: FrequencyTally
    eva: EvaTally
    cycles: CycleTally
    stays: dict[int, list[Stays]] = field(default_factory=lambda: {c: [] for c in THRESHOLDS_DEG})

    def list_counts(self, angle: MetricAngle) -> list[Count]:
        """List what is to be counted of one segment's angle; each fills sums of its own, in any order."""
        counts: list[Count] = [partial(self._add_stays, angle)]
        if self.errors is not None:
            counts.append(partial(self.errors.add, angle))
        tallies = (self.eva, self.cycles, self.by_hour, self.by_stretch, self.by_second, self.frequency)
        counts += [partial(tally.add, angle) for tally in tallies]
        return [*counts, partial(self.speeds.inclination.add_inclination, angle)]

    def _add_stays(self, angle: MetricAngle) -> None:
        for threshold_deg, stays in self.stays.items():
            stays.append(find_stays(angle, threshold_deg))

    def list_entries(self, threshold_deg: int) -> IntArray:
        """Give the times of the entries above a threshold."""
        return np.concatenate([stays.entry_us for stays in self.stays[threshold_deg]])


def start_day(
    duration_us: int,
    start: datetime | None,
    division: DayDivision,
    bias_sigma_deg: float | None,
    *,
    is_npose: bool = False,
) -> DayTally:
    """Start with nothing counted; without a known error of the angle, no figure gets an interval."""
    hours = split_hours(start, duration_us)
    stretches = cut_day(split_minutes(duration_us), hours.edges_us, division.list_edges())
    block_edges_us = stretches.block_edges_us
    seconds = -(-duration_us // MICROSECONDS)
    errors_deg, errors = EXACT, None
    if bias_sigma_deg is not None:
        errors_deg = spread_errors(bias_sigma_deg)
        errors = _start_errors(seconds, stretches, bias_sigma_deg, is_npose=is_npose)
    return DayTally(
        duration_us,
        hours,
        division,
        stretches,
        PartHistograms(hours.edges_us, np.zeros((len(hours.labels), CELLS), np.int64)),
        stretches.start_histograms(),
        SecondTally(np.zeros((seconds, 2))),
        SpeedTallies(
            SpeedTally(block_edges_us),
            SpeedTally(block_edges_us),
            SpeedTally(block_edges_us),
            SpeedTally(block_edges_us),
            start_recovery(errors_deg, block_edges_us),
        ),
        errors,
        FrequencyTally(block_edges_us),
        start_eva(errors_deg, block_edges_us),
        start_cycles(errors_deg, block_edges_us),
    )


def _start_errors(duration_s: int, stretches: Stretches, sigma_deg: float, *, is_npose: bool) -> ErrorTally:
    errors_deg = spread_errors(sigma_deg)
    return ErrorTally(
        sigma_deg,
        start_shifted_stays(errors_deg, stretches),
        ShiftedSeconds(errors_deg, np.zeros((duration_s, len(errors_deg) + 1), np.float32)),
        start_lowered_entries(errors_deg, stretches.edges_us) if is_npose else None,
    )
