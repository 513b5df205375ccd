"""The figures of one recording, as frozen values; what each means stands with the function that makes it."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Interval:
    """95 % range of a figure."""

    low: float
    high: float


@dataclass(frozen=True, slots=True)
class ElevationBin:
    """Time with ``lower_deg <= elevation < upper_deg`` (the last bin is closed)."""

    lower_deg: float
    upper_deg: float
    duration_s: float
    percent: float
    interval: Interval | None = None


@dataclass(frozen=True, slots=True)
class TimeAbove:
    """Time with ``elevation >= threshold_deg``."""

    threshold_deg: float
    duration_s: float
    percent: float
    interval: Interval | None = None


@dataclass(frozen=True, slots=True)
class Entries:
    """Repetitions: rises above a threshold, with 10 deg of hysteresis about it."""

    threshold_deg: float
    count: int
    per_hour: float
    busy_minutes_percent: float | None = None
    """Share of the minutes of work with two entries or more (the criterion of frequency in EN 1005-4)."""


@dataclass(frozen=True, slots=True)
class Episodes:
    """Sustained stays above a threshold; None where there was none.

    ``longest_start_s`` (seconds from the recording's first sample) says when the longest began.
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
    """Seconds in stays longer than 5, 10, 30 and 60 s: pairs of (limit, seconds)."""


@dataclass(frozen=True, slots=True)
class Cycles:
    """Rainflow ranges (ASTM E1049); a half cycle counts 0.5. ``upper_deg`` None is unbounded."""

    lower_deg: float
    upper_deg: float | None
    count: float


@dataclass(frozen=True, slots=True)
class Velocity:
    """Time-weighted percentiles and mean of one kind of speed, deg/s."""

    p10_dps: float
    p50_dps: float
    p90_dps: float
    p99_dps: float
    mean_dps: float


@dataclass(frozen=True, slots=True)
class PeakWindow:
    """The window of ``length_s`` with the largest share of time above 60 deg; None where none qualifies."""

    length_s: int
    start_s: float | None
    percent_above_60: float | None


@dataclass(frozen=True, slots=True, eq=False)
class Eva:
    """Exposure variation analysis: percent of time by angle class (rows) and duration class (columns)."""

    angle_edges_deg: tuple[float, ...]
    duration_edges_s: tuple[float | None, ...]
    percent: NDArray[np.float64]
    intervals: tuple[tuple[Interval, ...], ...] = ()
    """Of each cell; empty where that is not known."""


@dataclass(frozen=True, slots=True)
class PartExposure:
    """The main figures of one part of the day: a clock hour or a period of the diary.

    Only of a period are known: its ``kind``, ``recorded_s`` (from its first to its last moment less what
    other periods cut out of it), and why its time is excluded (``reason``, empty where it is analysed).
    """

    label: str
    start_s: float
    end_s: float
    analysed_s: float
    percentiles_deg: dict[int, float]
    percent_above: dict[int, float]
    entries_above_60_per_h: float | None
    kind: str = ""
    recorded_s: float | None = None
    reason: str = ""
    intervals: dict[str, Interval] = field(default_factory=dict)
    """By the names of the figures; empty where that is not known."""
    periods: int = 1
    """How many rows of the diary were pooled."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """Time hanging and slow, time slow at any angle, and the longest time without the former."""

    neutral_slow_percent: float
    neutral_slow_per_hour: float
    slow_percent: float
    slow_per_hour: float
    longest_without_s: float


@dataclass(frozen=True, slots=True)
class Frequency:
    """Of the speed of inclination: mean power frequency (None under a minute) and changes of direction."""

    mean_power_hz: float | None
    crossings_per_hour: float


@dataclass(frozen=True, slots=True)
class HourVariation:
    """How one figure differs between the clock hours."""

    hours: int
    coefficient_percent: float | None
    spread: float
    last_less_first: float


@dataclass(frozen=True, slots=True)
class EvaSummary:
    """The EVA matrix in a few figures."""

    by_angle_percent: tuple[float, ...]
    by_duration_percent: tuple[float, ...]
    cell_sd_percent: float
    centroid_deg: float
    centroid_s: float


@dataclass(frozen=True, slots=True, eq=False)
class MinuteProfile:
    """The day in minutes, for the timeline: shapes (m,); NaN where a minute holds no analysed time."""

    start_s: NDArray[np.float64]
    p10_deg: NDArray[np.float64]
    p50_deg: NDArray[np.float64]
    p90_deg: NDArray[np.float64]
    analysed_s: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """All figures of one recording."""

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
    histogram_s: NDArray[np.float64]
    """Shape (1800,): analysed seconds in each 0.1 deg cell of 0 to 180; all shares derive from them."""
    metric_filter_hz: float | None = 5.0
    """Corner of the low-pass all figures were taken behind; None where the series was too slow to filter."""
    intervals: dict[str, Interval] = field(default_factory=dict)
    """By column name, for figures without an interval of their own; empty where that is not known."""
    recovery: Recovery | None = None
    frequency: Frequency | None = None
    hour_variation: dict[str, HourVariation] = field(default_factory=dict)
    eva_summary: EvaSummary | None = None
    conventions: dict[str, tuple[ElevationBin, ...]] = field(default_factory=dict)
    """The bins added up to the classes of each of :data:`fusion.conventions.CONVENTIONS`, by its key."""
    by_task: tuple[PartExposure, ...] = ()
    """The periods once more, those of one kind and label pooled; they too add up to the recording."""
    angle_sigma_deg: float | None = None
    """Standard deviation of a constant error of the angle that the ranges hold; None or 0: not known."""
