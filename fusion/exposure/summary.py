"""From elevation to all figures of a recording: one segment at a time, then the day."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import datetime
from functools import partial
from typing import Any, TypeVar

import numpy as np

from fusion.conventions import CONVENTIONS, MAIN_THRESHOLD_DEG
from fusion.elevation import Elevation, ElevationSegment
from fusion.errors import TooShort
from fusion.exposure.bins import (
    divide_by_convention,
    find_percentiles,
    sum_time,
    summarise_bins,
    summarise_time_above,
)
from fusion.exposure.episodes import summarise_entries, summarise_episodes
from fusion.exposure.eva import summarise_eva_matrix
from fusion.exposure.intervals import add_intervals, describe_hours
from fusion.exposure.metric_filter import CORNER_HZ, filter_elevation, is_filtered
from fusion.exposure.parts import (
    DayDivision,
    Group,
    profile_minutes,
    summarise_group,
    summarise_parts,
)
from fusion.exposure.peaks import find_peak_windows, find_quarter_hours
from fusion.exposure.tally import Count, DayTally
from fusion.exposure.types import (
    LEAST_RANGED_S,
    ElevationBin,
    Entries,
    Episodes,
    Exposure,
    PartExposure,
    TimeAbove,
)
from fusion.recording import MICROSECONDS, Float64Array, IntArray, Recording, Segment
from fusion.runs import find_end_us, find_valid_samples

Value = TypeVar("Value", ElevationBin, TimeAbove, Entries, Episodes, PartExposure)
UNDIVIDED = DayDivision()
ROWS_FOR_TWO = 100_000
"""Fewer rows are counted before a thread has begun."""


def summarise_exposure(
    elevation: Elevation,
    start: datetime | None = None,
    samples: Recording | None = None,
    gyro_bias_dps: Float64Array | None = None,
    bias_sigma_deg: float | None = None,
    *,
    division: DayDivision = UNDIVIDED,
    is_npose: bool = False,
) -> Exposure:
    """Summarise how much the arm was raised; only valid rows count.

    Parameters
    ----------
    elevation
        Before the metric filter, which is applied here to each segment at the rate of its rows.
    start
        The clock at the first sample, for the figures by clock hour.
    samples
        The recording the elevation was made from: gives its length, and the two speeds that need samples.
    gyro_bias_dps
        Shape (3,), sensor frame: offset for the gyroscope's speed, without which that speed is None.
    bias_sigma_deg
        Standard deviation of a constant error of the angle (fusion and pose); 0 where it is not known, then
        the intervals are of the sampling of the day alone. Without it no interval.
    division
        The periods of the diary, for the figures by period; what they leave out must not be valid.
    is_npose
        Whether the arm's axis is that of the N-pose, whose one-sided error then widens the intervals of time
        above, bins from 30 deg, percentiles and entries (:mod:`fusion.exposure.resampling`).

    Raises
    ------
    TooShort
        When there is no valid row at all.
    """
    ends_us = [find_end_us(segment) for segment in elevation.segments]
    duration_us = max([*ends_us, samples.duration_us if samples else 0, 1])
    day = DayTally(duration_us, start, division, bias_sigma_deg, is_npose=is_npose)
    segments = {segment.start_us: segment for segment in samples.segments} if samples else {}
    for segment in elevation.segments:
        if len(segment) > 0:
            _add_segment(day, segment, segments.get(segment.start_us), gyro_bias_dps)
    filtered = any(is_filtered(segment.rate_hz) for segment in elevation.segments)
    exposure = _summarise_day(day, CORNER_HZ if filtered else None)
    if day.errors is None:
        return exposure
    return replace(add_intervals(exposure, day, day.errors), angle_sigma_deg=bias_sigma_deg)


def _add_segment(
    day: DayTally,
    segment: ElevationSegment,
    sampled: Segment | None,
    gyro_bias_dps: Float64Array | None,
) -> None:
    """Count a segment; its filtered angle, the largest thing here, is let go before the next."""
    angle = filter_elevation(segment)
    counts: list[Count] = [partial(day.speeds.add_vertical, segment, angle), *day.list_counts(angle)]
    if sampled is not None and abs(find_end_us(sampled) - find_end_us(segment)) <= 1:
        valid = find_valid_samples(angle.valid, len(sampled))
        counts.insert(1, partial(day.speeds.add_samples, sampled, gyro_bias_dps, valid))
    if len(segment) < ROWS_FOR_TWO:
        for count in counts:
            count()
        return
    with ThreadPoolExecutor(2) as pool:  # two at a time: the kernels let go of the interpreter
        for counted in [pool.submit(count) for count in counts]:
            counted.result()


def _summarise_day(day: DayTally, metric_filter_hz: float | None) -> Exposure:
    cell_us: IntArray = day.by_hour.cell_us.sum(axis=0, dtype=np.int64)
    analysed_s = int(cell_us.sum()) / MICROSECONDS
    if analysed_s == 0.0:
        raise TooShort(s=0.0)
    percentiles_deg = find_percentiles(cell_us)
    minutes = day.stretches.sum_minutes(day.by_stretch)
    by_hour = summarise_parts(day.hours, day.by_hour, day.list_entries(MAIN_THRESHOLD_DEG))
    eva = day.eva.summarise()
    bins = summarise_bins(cell_us)
    exposure = Exposure(
        analysed_s=analysed_s,
        bins=bins,
        time_above=summarise_time_above(cell_us),
        percentiles_deg=percentiles_deg,
        entries=tuple(summarise_entries(c, stays, analysed_s, minutes) for c, stays in day.stays.items()),
        cycles=day.cycles.summarise(),
        episodes=tuple(summarise_episodes(c, stays, analysed_s) for c, stays in day.stays.items()),
        velocity_dps={kind: tally.summarise() for kind, tally in day.speeds.kinds.items()},
        elevation_p99_deg=percentiles_deg[99],
        peak_windows=find_peak_windows(day.by_second.seconds, day.duration_us),
        quarter_hours=find_quarter_hours(day.by_second.seconds, day.duration_us),
        eva=eva,
        by_hour=by_hour,
        by_period=(),
        minutes=profile_minutes(minutes),
        histogram_s=cell_us / MICROSECONDS,
        metric_filter_hz=metric_filter_hz,
        recovery=day.speeds.recovery.summarise(analysed_s),
        frequency=day.frequency.summarise(analysed_s),
        hour_variation=describe_hours(by_hour),
        eva_summary=summarise_eva_matrix(eva),
        conventions={item.key: divide_by_convention(bins, item) for item in CONVENTIONS},
    )
    return _divide_day(exposure, day) if day.division.pieces else exposure


def _divide_day(exposure: Exposure, day: DayTally) -> Exposure:
    """Add the figures by period and by task of the diary."""
    cell_us = sum_time(day.by_stretch.cell_us, day.stretches.piece_of)
    entries = np.histogram(day.list_entries(MAIN_THRESHOLD_DEG), day.division.list_edges())[0]

    def summarise(groups: tuple[Group, ...]) -> tuple[PartExposure, ...]:
        return tuple(summarise_group(day.division, group, cell_us, entries) for group in groups)

    return replace(
        exposure,
        by_period=summarise(day.division.group_by_row()),
        by_task=summarise(day.division.group_by_task()),
    )


def withhold_short(exposure: Exposure) -> Exposure:
    """Take ranges and rates per hour from figures of less than half an hour, its parts included.

    So little time tells neither how often in an hour, nor how far another hour would lie from this one.
    """
    if exposure.analysed_s >= LEAST_RANGED_S:
        return exposure
    recovery, frequency = exposure.recovery, exposure.frequency
    no_rates: dict[str, Any] = {"intervals": {}, "entries_above_60_per_h": None}
    return replace(
        exposure,
        bins=_replace_each(exposure.bins, interval=None),
        time_above=_replace_each(exposure.time_above, interval=None),
        entries=_replace_each(exposure.entries, per_hour=None),
        episodes=_replace_each(exposure.episodes, per_hour=None),
        eva=replace(exposure.eva, intervals=()),
        by_hour=_replace_each(exposure.by_hour, **no_rates),
        by_period=_replace_each(exposure.by_period, **no_rates),
        by_task=_replace_each(exposure.by_task, **no_rates),
        intervals={},
        recovery=recovery and replace(recovery, neutral_slow_per_hour=None, slow_per_hour=None),
        frequency=frequency and replace(frequency, crossings_per_hour=None),
        conventions={
            key: _replace_each(classes, interval=None) for key, classes in exposure.conventions.items()
        },
    )


def _replace_each(values: tuple[Value, ...], **changes: Any) -> tuple[Value, ...]:
    return tuple(replace(value, **changes) for value in values)
