"""The figures of one recording as frozen values; the modules that compute them define them in detail."""

from dataclasses import dataclass, field

from acromion.fusion.recording import Float64Array

LEAST_RANGED_S = 1800.0
"""With less analysed time, under six blocks of 5 minutes, there are no ranges and no rates per hour."""


@dataclass(frozen=True, slots=True)
class Interval:
    """95 % range of a figure, in the figure's own unit.

    ``low``, ``high``: its limits: percentiles 2.5 and 97.5 of the draws
    (:mod:`acromion.fusion.exposure.summary`).
    ``low_pose``, ``high_pose``: the limits of the range that also
    includes the one-sided error of the N-pose; None for any other pose, and for figures without this range.
    """

    low: float
    high: float
    low_pose: float | None = None
    high_pose: float | None = None

    @property
    def with_pose(self) -> "Interval | None":
        """The range that also includes the error of the N-pose, or None."""
        if self.low_pose is None or self.high_pose is None:
            return None
        return Interval(self.low_pose, self.high_pose)


@dataclass(frozen=True, slots=True)
class ElevationBin:
    """Time with ``lower_deg <= elevation < upper_deg`` (the last bin is closed).

    ``lower_deg``, ``upper_deg``: edges of the bin.
    ``duration_s``: analysed time inside.
    ``percent``: its share of the analysed time.
    ``interval``: of ``percent``; None if not known.
    """

    lower_deg: float
    upper_deg: float
    duration_s: float
    percent: float
    interval: Interval | None = None


@dataclass(frozen=True, slots=True)
class TimeAbove:
    """Time with ``elevation >= threshold_deg``.

    ``threshold_deg``: 30, 60 or 90.
    ``duration_s``: analysed time at or above it.
    ``percent``: its share of the analysed time.
    ``interval``: of ``percent``; None if not known.
    """

    threshold_deg: float
    duration_s: float
    percent: float
    interval: Interval | None = None


@dataclass(frozen=True, slots=True)
class Entries:
    """Repetitions: rises above a threshold, with 10 deg of hysteresis around it.

    ``threshold_deg``: 30, 60 or 90.
    ``count``: number of rises.
    ``per_hour``: rises per analysed hour; None under half an hour (:data:`LEAST_RANGED_S`).
    ``busy_minutes_percent``: share of the analysed minutes with two entries or more (the frequency criterion
    of EN 1005-4).
    """

    threshold_deg: float
    count: int
    per_hour: float | None
    busy_minutes_percent: float | None = None


@dataclass(frozen=True, slots=True)
class Episodes:
    """Sustained stays above a threshold.

    ``threshold_deg``: 30, 60 or 90.
    ``count``: number of stays.
    ``longest_s``, ``median_s``: their durations; None without a stay.
    ``longest_start_s``: start of the longest, from the recording's first sample; None without a stay.
    ``censored``: stays that a gap, an exclusion or an end of the recording cuts, so that they lasted longer.
    ``per_hour``: stays per analysed hour.
    ``total_s``: sum of all durations.
    ``p90_s``: 90th percentile of the durations; None without a stay.
    ``longer_s``: pairs (limit, seconds): time in stays longer than 5, 10, 30 and 60 s.
    """

    threshold_deg: float
    count: int
    longest_s: float | None
    median_s: float | None
    longest_start_s: float | None
    censored: int
    per_hour: float | None = None
    total_s: float = 0.0
    p90_s: float | None = None
    longer_s: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Cycles:
    """Rainflow ranges of one class (ASTM E1049).

    ``lower_deg``, ``upper_deg``: the range of a cycle is at least ``lower_deg`` and less than ``upper_deg``;
    None means no limit.
    ``count``: cycles; a half cycle counts 0.5.
    """

    lower_deg: float
    upper_deg: float | None
    count: float


@dataclass(frozen=True, slots=True)
class Velocity:
    """One kind of speed over the analysed time.

    ``p10_dps``, ``p50_dps``, ``p90_dps``, ``p99_dps``, ``mean_dps``: time-weighted percentiles and mean.
    """

    p10_dps: float
    p50_dps: float
    p90_dps: float
    p99_dps: float
    mean_dps: float


@dataclass(frozen=True, slots=True)
class PeakWindow:
    """The window of ``length_s`` with the largest share of time above 60 deg.

    ``length_s``: length of the window.
    ``start_s``: its start, from the recording's first sample; None if no window qualifies.
    ``percent_above_60``: share of its analysed time at or above 60 deg; None if no window qualifies.
    """

    length_s: int
    start_s: float | None
    percent_above_60: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Eva:
    """Exposure variation analysis: time by class of angle and class of uninterrupted duration.

    ``angle_edges_deg``: edges of the a classes of angle, a + 1 values.
    ``duration_edges_s``: edges of the d classes of duration, d + 1 values; None means no limit.
    ``percent``: shape (a, d): share of the analysed time.
    ``intervals``: of each cell, in rows; empty if not known.
    """

    angle_edges_deg: tuple[float, ...]
    duration_edges_s: tuple[float | None, ...]
    percent: Float64Array
    intervals: tuple[tuple[Interval, ...], ...] = ()


@dataclass(frozen=True, slots=True)
class PartExposure:
    """The main figures of one part of the day: a clock hour, a period of the diary, a task.

    ``label``: the hour, or the name in the diary.
    ``start_s``, ``end_s``: from the recording's first sample.
    ``analysed_s``: analysed time inside.
    ``percentiles_deg``: elevation by percent.
    ``time_above_percent``: share of the analysed time at or above a threshold, by the threshold in deg.
    ``entries_above_60_per_h``: rises above 60 deg per analysed hour; None if nothing was analysed.
    ``kind``: of a period: "work", "break" and so on; empty for an hour.
    ``recorded_s``: of a period: its duration minus the time that belongs to other periods.
    ``reason``: of a period: why its time is excluded; empty if it is analysed.
    ``intervals``: by the names of the figures; empty if not known.
    ``periods``: how many rows of the diary were pooled.
    ``episodes_above_60_longest_s``: of a period or task: longest episode above 60 deg, cut at the edges of
    the rows.
    ``recovery_neutral_slow_percent``: of a period or task: share of its analysed time with arm down and
    nearly still.
    ``time_above_60_less_rest_percent``: of a task: its share of time above 60 deg minus that of all other
    analysed time.
    """

    label: str
    start_s: float
    end_s: float
    analysed_s: float
    percentiles_deg: dict[int, float]
    time_above_percent: dict[int, float]
    entries_above_60_per_h: float | None
    kind: str = ""
    recorded_s: float | None = None
    reason: str = ""
    intervals: dict[str, Interval] = field(default_factory=dict)
    periods: int = 1
    episodes_above_60_longest_s: float | None = None
    recovery_neutral_slow_percent: float | None = None
    time_above_60_less_rest_percent: float | None = None


@dataclass(frozen=True, slots=True)
class Recovery:
    """Time in which the arm recovers: arm down and nearly still, or slow at any angle.

    ``neutral_slow_percent``, ``neutral_slow_per_h``: arm down and nearly still: share of the analysed
    time, and periods per analysed hour (None under half an hour).
    ``slow_percent``, ``slow_per_h``: slow at any angle: the same.
    ``longest_without_s``: longest time without a period of arm down and nearly still.
    """

    neutral_slow_percent: float
    neutral_slow_per_h: float | None
    slow_percent: float
    slow_per_h: float | None
    longest_without_s: float


@dataclass(frozen=True, slots=True)
class Frequency:
    """How fast the arm moves up and down.

    ``inclination_velocity_mpf_hz``: mean power frequency of the speed of inclination; None without an
    unbroken minute.
    ``inclination_velocity_zero_crossings_per_h``: reversals per analysed hour; None under half an hour.
    """

    inclination_velocity_mpf_hz: float | None
    inclination_velocity_zero_crossings_per_h: float | None


@dataclass(frozen=True, slots=True)
class HourVariation:
    """Variation of one figure between the clock hours, in the figure's own unit.

    ``hours``: number of clock hours compared.
    ``coefficient_percent``: standard deviation over mean; None if the mean is 0.
    ``spread``: largest minus smallest.
    ``last_less_first``: the last hour's value minus the first's.
    """

    hours: int
    coefficient_percent: float | None
    spread: float
    last_less_first: float


@dataclass(frozen=True, slots=True)
class EvaSummary:
    """Summary figures of the EVA matrix.

    ``by_angle_percent``, ``by_duration_percent``: sums of its rows and of its columns.
    ``cell_sd_percent``: standard deviation of its cells.
    ``centroid_deg``, ``centroid_s``: its centre of mass.
    """

    by_angle_percent: tuple[float, ...]
    by_duration_percent: tuple[float, ...]
    cell_sd_percent: float
    centroid_deg: float
    centroid_s: float


@dataclass(frozen=True, slots=True, eq=False)
class MinuteProfile:
    """The day in minutes, for the timeline: arrays of shape (m,).

    ``start_s``: start of each minute, from the recording's first sample.
    ``p10_deg``, ``p50_deg``, ``p90_deg``: percentiles of elevation; NaN if a minute has no analysed time.
    ``analysed_s``: analysed time of each minute.
    """

    start_s: Float64Array
    p10_deg: Float64Array
    p50_deg: Float64Array
    p90_deg: Float64Array
    analysed_s: Float64Array


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """All figures of one recording.

    ``analysed_s``: the time that all shares refer to.
    ``bins``: time in bins of elevation.
    ``time_above``: time at or above 30, 60 and 90 deg.
    ``percentiles_deg``: elevation by percent: 1, 5, 10, 25, 50, 75, 90, 95, 99.
    ``entries``, ``cycles``, ``episodes``: repetitions, rainflow cycles and sustained stays.
    ``velocity_dps``: by kind: "inclination", "generalised", "generalised_accelerometer", "gyroscope"; None if
    it could not be computed.
    ``elevation_p99_deg``: peak: the 99th percentile.
    ``peak_windows``: windows with the largest share above 60 deg.
    ``eva``: exposure variation analysis.
    ``by_hour``, ``by_period``: the main figures by clock hour, and by period of the diary.
    ``minutes``: the day in minutes.
    ``histogram_s``: shape (1800,): analysed seconds in each 0.1 deg cell of 0 to 180; all shares derive from
    them.
    ``metric_filter_hz``: corner of the low-pass before all figures; None if the series was too slow to
    filter.
    ``intervals``: by column name, for figures without an ``interval`` field; empty if not known.
    ``recovery``, ``frequency``: None if not computed.
    ``hour_variation``: variation between the hours, by figure.
    ``eva_summary``: summary figures of the EVA matrix.
    ``conventions``: the bins summed to the classes of each of
    :data:`acromion.fusion.conventions.CONVENTIONS`, by its key.
    ``by_task``: the periods again, with those of one kind and label pooled; they also add up to the
    recording.
    ``angle_sigma_deg``: standard deviation of a constant error of the angle that the intervals include; None
    or 0: not known.
    ``quarter_hours``: up to three windows of 15 minutes with the most time above 60 deg, largest first,
    without overlap.
    ``by_mark``: the 15 minutes before each mark of the diary, then all other analysed time (kind "rest").
    ``by_posture``: the time in each of :data:`acromion.fusion.diary.POSTURES`, then the time whose posture
    is not stated (kind "unstated"); empty if no posture is stated.
    """

    analysed_s: float
    bins: tuple[ElevationBin, ...]
    time_above: tuple[TimeAbove, ...]
    percentiles_deg: dict[int, float]
    entries: tuple[Entries, ...]
    cycles: tuple[Cycles, ...]
    episodes: tuple[Episodes, ...]
    velocity_dps: dict[str, Velocity | None]
    elevation_p99_deg: float
    peak_windows: tuple[PeakWindow, ...]
    eva: Eva
    by_hour: tuple[PartExposure, ...]
    by_period: tuple[PartExposure, ...]
    minutes: MinuteProfile
    histogram_s: Float64Array
    metric_filter_hz: float | None = 5.0
    intervals: dict[str, Interval] = field(default_factory=dict)
    recovery: Recovery | None = None
    frequency: Frequency | None = None
    hour_variation: dict[str, HourVariation] = field(default_factory=dict)
    eva_summary: EvaSummary | None = None
    conventions: dict[str, tuple[ElevationBin, ...]] = field(default_factory=dict)
    by_task: tuple[PartExposure, ...] = ()
    angle_sigma_deg: float | None = None
    quarter_hours: tuple[PeakWindow, ...] = ()
    by_mark: tuple[PartExposure, ...] = ()
    by_posture: tuple[PartExposure, ...] = ()

    @property
    def figures(self) -> dict[str, float | None]:
        """The main figures by the names of the tables, such as ``time_above_60_percent``; None: unknown."""
        return {
            **{f"time_{b.lower_deg:g}_{b.upper_deg:g}_percent": b.percent for b in self.bins},
            **{f"time_above_{item.threshold_deg:g}_percent": item.percent for item in self.time_above},
            **{f"elevation_p{percent}_deg": angle for percent, angle in self.percentiles_deg.items()},
            **{f"entries_above_{item.threshold_deg:g}_per_h": item.per_hour for item in self.entries},
        }

    def __repr__(self) -> str:
        above = ", ".join(
            f"{item.percent:.1f} % at {item.threshold_deg:g} deg or above" for item in self.time_above
        )
        median = f"median {self.percentiles_deg[50]:.1f} deg"
        return f"Exposure({self.analysed_s / 3600.0:.2f} h analysed, {above}, {median})"
