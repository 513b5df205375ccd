"""The day file: the angle of a whole recording, from which the page draws any stretch in a few milliseconds.

It has one line of JSON (segments, proposals, excluded spans), then plain arrays, which are memory-mapped: the
angle of each row in hundredths of a degree (-1 if invalid), the lowest and highest angle of every 16, 256,
... rows, and the moments of quarter seconds from which stillness is scored. It contains no figure of the
report, and can be created again from the recording.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from acromion.fusion.conventions import MAIN_THRESHOLD_DEG

DAY_NAME = "day.bin"
OWN_CURVE, REFERENCE_CURVE = "own.bin", "reference.bin"
"""Of a comparison: both angles at common times, on the recording's clock, without stillness."""
ROWS_PER_STEP = 16
LEVELS = 4
UNITS_PER_DEG = 100
INVALID = -1
ALIGN_BYTES = 64

Angles = NDArray[np.int16]
Table = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class DaySegment:
    """An unbroken run for the file.

    ``angle_deg`` (n,): NaN if invalid; ``quiet`` (m, 6): mean and mean square of the acceleration's axes in
    blocks of ``block_s``, in g.
    """

    start_s: float
    rate_hz: float
    angle_deg: NDArray[np.float32]
    block_s: float
    quiet: Table


@dataclass(frozen=True, slots=True)
class HighEpisode:
    """A continuous time above a threshold, and its highest angle."""

    start_s: float
    end_s: float
    highest_deg: float


@dataclass(frozen=True, slots=True)
class Stretch:
    """Part of a curve: values from ``start_s``, one per ``step_s``; None if no row is valid.

    ``low`` and ``high`` are equal if each value is a single row.
    """

    start_s: float
    step_s: float
    low: list[float | None]
    high: list[float | None]


def write_day(path: Path, segments: Sequence[DaySegment], facts: Mapping[str, Any]) -> None:
    """Write the file; ``facts`` contains the other JSON data for the page."""
    arrays: list[NDArray[Any]] = []
    heads = []
    for segment in segments:
        exact = segment.angle_deg * UNITS_PER_DEG
        rounded = np.rint(exact)
        # Angles below the main threshold must stay below it, so that time above it matches the report.
        is_lifted = (rounded > exact) & (rounded == MAIN_THRESHOLD_DEG * UNITS_PER_DEG)
        rows = np.where(np.isnan(exact), INVALID, rounded - is_lifted).astype("<i2")
        packed = [rows, *_reduce_levels(rows), segment.quiet.astype("<f4")]
        arrays += packed
        about = {"start_s": segment.start_s, "rate_hz": segment.rate_hz, "block_s": segment.block_s}
        heads.append(about | {"shapes": [list(array.shape) for array in packed]})
    head = json.dumps({"facts": dict(facts), "segments": heads}).encode() + b"\n"
    with path.open("wb") as file:
        file.write(head)
        for array in arrays:
            file.write(bytes(-file.tell() % ALIGN_BYTES))
            file.write(np.ascontiguousarray(array).data)


def _reduce_levels(rows: Angles) -> Iterator[Angles]:
    """Return the lowest and highest angle of every 16, 256, ... rows, each of shape (m, 2)."""
    low = high = rows
    for _ in range(LEVELS):
        low, high = _reduce(low, high, ROWS_PER_STEP)
        yield np.stack([low, high], axis=1)


def _reduce(low: Angles, high: Angles, step: int) -> tuple[Angles, Angles]:
    """Return the lowest valid and the highest of every ``step`` values; the last group may be short."""
    if not len(low):
        return low, high
    edges = np.arange(0, len(low), step)
    above = np.where(low == INVALID, np.iinfo(np.int16).max, low)
    top = np.maximum.reduceat(high, edges)
    return np.where(top == INVALID, INVALID, np.minimum.reduceat(above, edges)).astype("<i2"), top


@dataclass(frozen=True, slots=True, eq=False)
class _OpenSegment:
    """A segment of an open file. ``levels`` have shape (n, 2); the first has one row per sample."""

    start_s: float
    rate_hz: float
    block_s: float
    levels: tuple[Angles, ...]
    quiet: Table

    @property
    def end_s(self) -> float:
        return self.start_s + len(self.levels[0]) / self.rate_hz


@dataclass(frozen=True, slots=True, eq=False)
class DayFile:
    """An open day file."""

    facts: Mapping[str, Any]
    segments: tuple[_OpenSegment, ...]

    def cut(self, from_s: float, to_s: float, points: int) -> list[Stretch]:
        """Return the curve between two times in s, with about ``points`` values."""
        span_s = max(to_s - from_s, 1e-6)
        return [
            _cut_segment(segment, from_s, to_s, max(1.0, segment.rate_hz * span_s / points))
            for segment in self.segments
            if segment.end_s > from_s and segment.start_s < to_s
        ]

    def find_highest(self, threshold_deg: float, least_s: float, count: int) -> list[HighEpisode]:
        """Find the ``count`` highest episodes at or above a threshold, highest first.

        A dip shorter than ``least_s`` does not end an episode; an episode shorter than ``least_s`` does not
        count.
        """
        found = [
            episode
            for segment in self.segments
            for episode in _find_episodes(segment, threshold_deg, least_s)
        ]
        return sorted(found, key=lambda episode: (-episode.highest_deg, episode.start_s))[:count]

    def measure_above(self, start_s: float, end_s: float, threshold_deg: float) -> tuple[float, float]:
        """Return the valid time between two times, and its part at or above a threshold, both in s."""
        valid_s = above_s = 0.0
        for segment in self.segments:
            first, stop = (round((at_s - segment.start_s) * segment.rate_hz) for at_s in (start_s, end_s))
            rows = segment.levels[0][max(first, 0) : max(stop, 0), 0]
            valid_s += np.count_nonzero(rows != INVALID) / segment.rate_hz
            above_s += np.count_nonzero(rows >= threshold_deg * UNITS_PER_DEG) / segment.rate_hz
        return valid_s, above_s

    def measure_quiet(self, start_s: float, end_s: float) -> tuple[NDArray[np.float64], float] | None:
        """Return mean acceleration, shape (3,), and the largest standard deviation of an axis, in g.

        Both cover the whole quarter seconds between two times. Returns None if these are not in one segment,
        or if there is no whole quarter second.
        """
        for segment in self.segments:
            first = int(np.ceil((start_s - segment.start_s) / segment.block_s - 1e-6))
            stop = int((end_s - segment.start_s) / segment.block_s + 1e-6)
            if 0 <= first < stop <= len(segment.quiet):
                moments = segment.quiet[first:stop].astype(np.float64).mean(axis=0)
                variance = moments[3:] - moments[:3] ** 2
                return moments[:3], float(np.sqrt(max(variance.max(), 0.0)))
        return None


def open_day(path: Path) -> DayFile:
    """Map the file. Raises FileNotFoundError."""
    with path.open("rb") as file:
        head = json.loads(file.readline())
        at = file.tell()
    mapped = np.memmap(path, np.uint8, "r")
    segments = []
    for about in head["segments"]:
        arrays = []
        for shape in about.pop("shapes"):
            kind = np.dtype("<f4") if len(shape) == 2 and shape[1] == 6 else np.dtype("<i2")
            at += -at % ALIGN_BYTES
            size_bytes = kind.itemsize * int(np.prod(shape))
            arrays.append(mapped[at : at + size_bytes].view(kind).reshape(shape))
            at += size_bytes
        rows = np.broadcast_to(arrays[0][:, None], (len(arrays[0]), 2))
        segments.append(_OpenSegment(levels=(rows, *arrays[1:-1]), quiet=arrays[-1], **about))
    return DayFile(head["facts"], tuple(segments))


def _find_episodes(segment: _OpenSegment, threshold_deg: float, least_s: float) -> Iterator[HighEpisode]:
    """Find episodes in one segment; invalid time ends an episode."""
    rows = segment.levels[0][:, 0]
    is_above = rows >= threshold_deg * UNITS_PER_DEG
    edges = np.flatnonzero(np.diff(is_above, prepend=False, append=False))
    starts, stops = edges[::2], edges[1::2]
    if not len(starts):
        return
    invalid = np.concatenate([[0], np.cumsum(rows == INVALID)])
    gaps = starts[1:] - stops[:-1]
    is_end = (gaps >= least_s * segment.rate_hz) | (invalid[starts[1:]] > invalid[stops[:-1]])
    starts, stops = starts[np.append(True, is_end)], stops[np.append(is_end, True)]
    highest = np.maximum.reduceat(rows, starts)
    for start, stop, top in zip(starts.tolist(), stops.tolist(), highest.tolist(), strict=True):
        if stop - start >= least_s * segment.rate_hz:
            start_s, end_s = (segment.start_s + row / segment.rate_hz for row in (start, stop))
            yield HighEpisode(start_s, end_s, top / UNITS_PER_DEG)


def _cut_segment(segment: _OpenSegment, from_s: float, to_s: float, rows_per_value: float) -> Stretch:
    """Return a stretch from the coarsest level that is fine enough, reduced further."""
    level = min(LEVELS, int(np.log(rows_per_value) / np.log(ROWS_PER_STEP) + 1e-9))
    step = max(1, round(rows_per_value / ROWS_PER_STEP**level))
    rows, row_s = segment.levels[level], ROWS_PER_STEP**level / segment.rate_hz
    first = max(0, int((from_s - segment.start_s) / (row_s * step))) * step
    stop = min(len(rows), int(np.ceil((to_s - segment.start_s) / (row_s * step)) + 1) * step)
    low, high = _reduce(rows[first:stop, 0], rows[first:stop, 1], step)
    return Stretch(segment.start_s + first * row_s, step * row_s, _to_degrees(low), _to_degrees(high))


def _to_degrees(rows: Angles) -> list[float | None]:
    return [None if value == INVALID else value / UNITS_PER_DEG for value in rows.tolist()]
