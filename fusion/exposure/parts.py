"""Figures for parts of the day: minutes, clock hours, diary periods, and the windows of highest load."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from math import ceil

import numpy as np

from acromion.fusion.clocks import is_repeated, read_clock
from acromion.fusion.diary import POSTURES
from acromion.fusion.exposure.bins import (
    AnyArray,
    PartHistograms,
    find_percentile_cells,
    find_percentiles,
    summarise_time_above,
)
from acromion.fusion.exposure.metric_filter import MetricAngle
from acromion.fusion.exposure.periods import Mark, Period, Piece
from acromion.fusion.exposure.resampling import Figures, Resampling
from acromion.fusion.exposure.types import MinuteProfile, PartExposure, PeakWindow
from acromion.fusion.numba_kernels import kernel
from acromion.fusion.recording import MICROSECONDS, Float64Array, IntArray
from acromion.fusion.runs import EvenRun, find_end_us, find_part_rows

# The figures of the parts of the day: minutes, clock hours, periods of the diary.

PART_PERCENTS = (10, 50, 90)
MINUTE_US = 60 * MICROSECONDS
HOUR_US = 60 * MINUTE_US


@dataclass(frozen=True, slots=True, eq=False)
class DayParts:
    """Consecutive parts of the recording: edges of shape (p + 1,), and a name for each."""

    edges_us: IntArray
    labels: tuple[str, ...]


def split_minutes(duration_us: int) -> IntArray:
    """Return the edges of the minutes from the first sample; the last may end after the recording."""
    return np.arange(-(-duration_us // MINUTE_US) + 1, dtype=np.int64) * MINUTE_US


def split_hours(start: datetime | None, duration_us: int) -> DayParts:
    """Split the recording at the full hours of its clock, or every hour if it has no clock.

    A start with a time zone follows its zone over clock changes (an hour may occur twice or not at all); a
    device clock without a zone does not change. Labels are "2027-03-14T22:00", with the offset from UTC if
    the zone has that hour twice ("2026-10-25T02:00+02:00"), or "+01:00" from the first sample.
    """
    into_us = 0 if start is None else (start.minute * 60 + start.second) * MICROSECONDS + start.microsecond
    full_us = np.arange(HOUR_US - into_us, duration_us, HOUR_US, dtype=np.int64)
    edges_us = np.concatenate([[0], full_us, [duration_us]])

    def label(edge_us: int) -> str:
        if start is None:
            return f"+{edge_us // HOUR_US:02d}:00"
        shown = read_clock(start, edge_us)
        return f"{shown:%Y-%m-%dT%H:00}" + (shown.isoformat()[-6:] if is_repeated(shown) else "")

    return DayParts(edges_us, tuple(map(label, edges_us[:-1].tolist())))


def profile_minutes(minutes: PartHistograms) -> MinuteProfile:
    """Return each minute's P10, P50 and P90 and its analysed time."""
    places = find_percentile_cells(minutes.cell_us, np.array(PART_PERCENTS, np.float64)) / 10.0
    analysed_us = minutes.cell_us.sum(axis=1, dtype=np.int64)
    start_s, analysed_s = minutes.edges_us[:-1] / MICROSECONDS, analysed_us / MICROSECONDS
    return MinuteProfile(start_s, places[:, 0], places[:, 1], places[:, 2], analysed_s)


def summarise_parts(
    parts: DayParts, histograms: PartHistograms, entry_us: IntArray
) -> tuple[PartExposure, ...]:
    """Return the main figures of each part; ``entry_us`` are the times of the entries above 60 deg."""
    entries = np.histogram(entry_us, parts.edges_us)[0]
    return tuple(
        summarise_part(label, parts.edges_us[k : k + 2], histograms.cell_us[k], int(entries[k]))
        for k, label in enumerate(parts.labels)
    )


def summarise_part(label: str, edges_us: IntArray, cell_us: IntArray, entries: int) -> PartExposure:
    """Return the main figures of one part from its cells, shape (1800,), and its entries above 60 deg."""
    start_s, end_s = (float(edge) / MICROSECONDS for edge in edges_us)
    analysed_s = int(cell_us.sum()) / MICROSECONDS
    if analysed_s == 0.0:
        return PartExposure(label, start_s, end_s, 0.0, {}, {}, None)
    return PartExposure(
        label,
        start_s,
        end_s,
        analysed_s,
        find_percentiles(cell_us, PART_PERCENTS),
        {int(above.threshold_deg): above.percent for above in summarise_time_above(cell_us)},
        entries * 3600.0 / analysed_s,
    )


# The figures of each period of the diary, from consecutive pieces of the day.


REST_KIND = "work"
BEFORE_MARK_US = 15 * MINUTE_US
"""The time before a mark that is shown beside the rest of the shift."""

Group = tuple[int, ...]
"""Indices of pieces that are summed into one part."""


@dataclass(frozen=True, slots=True)
class DayDivision:
    """The diary's periods, the pieces of the whole recording that belong to each, its marks and postures."""

    periods: tuple[Period, ...] = ()
    pieces: tuple[Piece, ...] = ()
    marks: tuple[Mark, ...] = ()
    postures: tuple[Period, ...] = ()

    def list_edges(self) -> IntArray:
        """Return the edges of the pieces, shape (p + 1,); empty without a diary."""
        edges_us = [piece.start_us for piece in self.pieces[:1]] + [piece.end_us for piece in self.pieces]
        return np.array(edges_us, np.int64)

    def list_windows(self) -> IntArray:
        """Return the 15 minutes before each mark, within the recording: microseconds, shape (m, 2)."""
        ends_us = np.array([mark.time_us for mark in self.marks], np.int64)
        return np.stack([np.maximum(ends_us - BEFORE_MARK_US, 0), ends_us], axis=1)

    def list_posture_edges(self) -> IntArray:
        """Return where the posture may change, in any order."""
        return np.array([edge for p in self.postures for edge in (p.start_us, p.end_us)], np.int64)

    def find_postures(self, begins_us: IntArray) -> IntArray:
        """Return the place in :data:`acromion.fusion.diary.POSTURES` at sorted times; -1: not stated."""
        found = np.full(len(begins_us), -1, np.int64)
        for period in self.postures:
            first, stop = np.searchsorted(begins_us, (period.start_us, period.end_us))
            found[first:stop] = POSTURES.index(period.kind)
        return found

    def group_by_row(self) -> tuple[Group, ...]:
        """Return the pieces of each row, in the order of the diary, then the pieces without a row.

        A row that other rows cover completely is omitted.
        """
        owners = (*range(len(self.periods)), -1)
        owned = (tuple(k for k, piece in enumerate(self.pieces) if piece.period == o) for o in owners)
        return tuple(group for group in owned if group)

    def group_by_task(self) -> tuple[Group, ...]:
        """Return the pieces grouped by kind and label, each group at the place of its first row.

        Excluded and analysed pieces stay separate.
        """
        groups: dict[tuple[str, str, str], list[int]] = {}
        for group in self.group_by_row():
            for k in group:
                kind, label = self.name_owner(k)
                groups.setdefault((kind, label, self.pieces[k].reason), []).append(k)
        return tuple(tuple(sorted(group)) for group in groups.values())

    def name_owner(self, piece: int) -> tuple[str, str]:
        """Return the kind and label of the row that a piece belongs to."""
        found = self.pieces[piece]
        if found.period < 0:
            return ("outside" if found.reason else REST_KIND), ""
        return self.periods[found.period].kind, self.periods[found.period].label


def snap_periods(periods: Sequence[Period], runs: Sequence[EvenRun]) -> tuple[Period, ...]:
    """Move each edge to the start of a sample, so that no sample belongs to two periods.

    The move is less than one sample period. The parts of the day then add up to the microsecond.
    """
    snapped = (
        replace(period, start_us=_snap(period.start_us, runs), end_us=_snap(period.end_us, runs))
        for period in periods
    )
    return tuple(period for period in snapped if period.end_us > period.start_us)


def _snap(time_us: int, runs: Sequence[EvenRun]) -> int:
    for run in runs:
        if run.start_us < time_us < find_end_us(run):
            row = ceil((time_us - run.start_us - 1) * (run.rate_hz / MICROSECONDS))
            return run.start_us + round(row * MICROSECONDS / run.rate_hz)
    return time_us


def summarise_group(
    division: DayDivision,
    group: Group,
    cell_us: AnyArray,
    entries: IntArray,
    longest_s: Float64Array,
    rest_s: Float64Array,
) -> PartExposure:
    """Return the main figures of several pieces together.

    ``cell_us``, shape (p, 1800), ``entries`` above 60 deg, the longest episode above 60 deg and the seconds
    with arm down and nearly still, shape (p,), are those of each piece. Excluded time only has a duration, no
    figures.
    """
    pieces, chosen = [division.pieces[k] for k in group], list(group)
    kind, label = division.name_owner(group[0])
    edges_us = np.array([pieces[0].start_us, pieces[-1].end_us], np.int64)
    summed_us: IntArray = cell_us[chosen].sum(axis=0, dtype=np.int64)
    part = summarise_part(label, edges_us, summed_us, int(entries[chosen].sum()))
    return replace(
        part,
        kind=kind,
        recorded_s=sum(piece.end_us - piece.start_us for piece in pieces) / MICROSECONDS,
        reason=pieces[0].reason,
        periods=len({piece.period for piece in pieces}),
        episodes_above_60_longest_s=(float(longest_s[chosen].max()) or None) if part.analysed_s else None,
        recovery_neutral_slow_percent=(
            100.0 * float(rest_s[chosen].sum()) / part.analysed_s if part.analysed_s else None
        ),
    )


# The windows with the most time above 60 deg.

WINDOWS_S = (60, 900, 3600)
THRESHOLD_DEG = 60.0
LEAST_COVER = 0.8
QUARTER_HOURS = 3
QUARTER_HOUR_S = 900


class SecondTally:
    """Analysed time and time at or above 60 deg in each second from the first sample.

    ``seconds``: shape (s, 2); the last second may extend past the end of the recording.
    """

    def __init__(self, duration_s: int) -> None:
        """Start with nothing counted."""
        self.seconds = np.zeros((duration_s, 2))

    def add(self, angle: MetricAngle) -> None:
        """Count a segment's valid rows."""
        seconds, rows = _cut_seconds(angle)
        counts = np.zeros((len(rows) - 1, 2), np.int64)
        _count_above(angle.elevation_deg, angle.valid, rows, counts)
        self.seconds[seconds] += counts / angle.rate_hz


def _cut_seconds(angle: MetricAngle) -> tuple[slice, IntArray]:
    """Return the seconds that a segment overlaps, and the first row of each."""
    first, stop = angle.start_us // MICROSECONDS, -(-find_end_us(angle) // MICROSECONDS)
    return slice(first, stop), find_part_rows(angle, np.arange(first, stop + 1) * MICROSECONDS)


@kernel
def _count_above(angle_deg, valid, rows, counts):  # type: ignore[no-untyped-def]
    """Count valid rows, and rows at or above 60 deg, in each part."""
    for part in range(len(rows) - 1):
        for i in range(rows[part], rows[part + 1]):
            if valid[i]:
                counts[part, 0] += 1
                if angle_deg[i] >= THRESHOLD_DEG:
                    counts[part, 1] += 1


def find_peak_windows(seconds: Float64Array, duration_us: int) -> tuple[PeakWindow, ...]:
    """Return the worst windows of 1, 15 and 60 minutes.

    A window starts at a whole second, is within the recording, may span gaps, and counts if at least 80 % of
    it was analysed; of equal ones the earliest is returned.
    """
    seconds = seconds[: duration_us // MICROSECONDS]
    return tuple(_find_peak_window(seconds, length_s) for length_s in WINDOWS_S)


def find_quarter_hours(seconds: Float64Array, duration_us: int) -> tuple[PeakWindow, ...]:
    """Return up to three windows of 15 minutes with the most time above 60 deg, without overlap.

    Each is the worst window in the remaining time. The result is empty if no time is above 60 deg.
    """
    seconds = seconds[: duration_us // MICROSECONDS]
    free = [(0, len(seconds))]
    found: list[PeakWindow] = []
    while free and len(found) < QUARTER_HOURS:
        candidates = [(_find_peak_window(seconds[a:b], QUARTER_HOUR_S), a, b) for a, b in free]
        window, first, stop = max(candidates, key=lambda one: one[0].percent_above_60 or 0.0)
        if window.start_s is None or not window.percent_above_60:
            break
        start = first + int(window.start_s)
        found.append(PeakWindow(QUARTER_HOUR_S, float(start), window.percent_above_60))
        free.remove((first, stop))
        free += [(first, start), (start + QUARTER_HOUR_S, stop)]
    return tuple(found)


def _find_peak_window(seconds: Float64Array, length_s: int) -> PeakWindow:
    best, percent = _find_worst_window(seconds[:, 0], seconds[:, 1], length_s)
    return (
        PeakWindow(length_s, float(best), float(percent)) if best >= 0 else PeakWindow(length_s, None, None)
    )


@kernel
def _find_worst_window(analysed_s, above_s, length_s):  # type: ignore[no-untyped-def]
    """Return the first second of the window with the largest share above, and that share; -1 if none."""
    best, highest = -1, -1.0
    analysed, above = 0.0, 0.0
    for i in range(len(analysed_s)):
        analysed += analysed_s[i]
        above += above_s[i]
        if i >= length_s:
            analysed -= analysed_s[i - length_s]
            above -= above_s[i - length_s]
        if i >= length_s - 1 and analysed >= LEAST_COVER * length_s - 1e-6:
            percent = 100.0 * above / analysed
            if percent > highest + 1e-7:  # so that rounding of sums does not break a tie
                best, highest = i - length_s + 1, percent
    return best, max(highest, 0.0)


class ShiftedSeconds:
    """For each second, how many valid rows reach each number of levels; a level is 60 deg minus an error.

    ``errors_deg``: shape (g,), evenly spaced.
    ``seconds``: shape (s, g + 1).
    """

    def __init__(self, errors_deg: Float64Array, duration_s: int) -> None:
        """Start with nothing counted."""
        self.errors_deg = errors_deg
        self.seconds = np.zeros((duration_s, len(errors_deg) + 1), np.float32)

    def add(self, angle: MetricAngle) -> None:
        """Count a segment's valid rows."""
        seconds, rows = _cut_seconds(angle)
        lowest = THRESHOLD_DEG - self.errors_deg[-1]
        step = self.errors_deg[1] - self.errors_deg[0]
        how = (rows, lowest, step, 1.0 / angle.rate_hz)
        _count_levels(angle.elevation_deg, angle.valid, how, self.seconds[seconds])

    def draw(self, windows: tuple[PeakWindow, ...], draws: Resampling) -> Figures:
        """Draw the worst windows with the error of the angle only.

        The worst window is searched again for each error. Windows of other days cannot be drawn from one day.
        """
        analysed_s = self.seconds.sum(axis=1, dtype=np.float64)
        above_s = np.cumsum(self.seconds[:, ::-1], axis=1, dtype=np.float64)[:, :-1]
        columns = [np.ascontiguousarray(column) for column in above_s.T]
        found: Figures = {}
        for window in windows:
            if window.start_s is not None:
                shares = [_find_worst_window(analysed_s, column, window.length_s)[1] for column in columns]
                name = f"worst_{window.length_s // 60}_min_above_60_percent"
                found[name] = draws.look_up(np.array(shares), self.errors_deg)
        return found


@kernel
def _count_levels(angle_deg, valid, how, seconds):  # type: ignore[no-untyped-def]
    """Count valid rows by the number of evenly spaced levels that they reach."""
    rows, lowest, step, period_s = how
    levels = seconds.shape[1] - 1
    for second in range(len(rows) - 1):
        for i in range(rows[second], rows[second + 1]):
            if valid[i]:
                reached = int(np.floor((angle_deg[i] - lowest) / step + 1e-9)) + 1
                seconds[second, min(max(reached, 0), levels)] += period_s
